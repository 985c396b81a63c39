//! What `stoop export` writes of a made-up Earth.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should stop")]

mod earth;

#[test]
fn a_collection_without_attributes_is_exported_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (world, out) = (folder.path().join("world"), folder.path().join("houses.geojson"));
    earth::write(&world);
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_stoop"))
        .args(["export", world.to_str().unwrap(), "--collection", "houses", "--out", out.to_str().unwrap()])
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let written: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(out).unwrap()).unwrap();
    let features = written["features"].as_array().unwrap();
    assert_eq!(features.len(), earth::houses().len());
    for (feature, house) in features.iter().zip(earth::houses()) {
        let (properties, corners) = (&feature["properties"], &feature["geometry"]["coordinates"][0]);
        let base_m = properties["base_m"].as_f64().unwrap();
        assert!((base_m - f64::from(house.base_m)).abs() < 0.1, "{feature}");
        assert!((properties["top_m"].as_f64().unwrap() - base_m - earth::HOUSE_M).abs() < 0.1, "{feature}");
        assert_eq!(corners.as_array().unwrap().len(), 5, "rings are closed: {feature}");
    }
    assert!(String::from_utf8(output.stdout).unwrap().starts_with(&format!("{} features", features.len())));
}
