use super::*;

fn folder() -> (tempfile::TempDir, SettingsFile) {
    let folder = tempfile::tempdir().unwrap();
    let file = SettingsFile::at(folder.path().join("config/settings.toml"));
    (folder, file)
}

fn written(text: &str) -> (tempfile::TempDir, SettingsFile) {
    let (folder, file) = folder();
    std::fs::create_dir_all(file.path.parent().unwrap()).unwrap();
    std::fs::write(&file.path, text).unwrap();
    (folder, file)
}

fn pose(lat_deg: f64) -> Pose {
    Pose { eye: Geodetic::from_degrees(lat_deg, -122.5, 345.6), heading_rad: 5.0, pitch_rad: -0.75 }
}

#[test]
fn what_is_saved_comes_back() {
    use super::super::panels::Side;
    let (_folder, mut file) = folder();
    assert_eq!(file.load(), (Settings::default(), None));
    let mut settings = Settings::default();
    settings.window = WindowSettings { width_px: 801.5, height_px: 600.0, maximized: true, ..settings.window };
    settings.quality.set(Quality { tolerance_px: 2.5, footprint: ByteSize(300 << 20), frame_ms: None });
    settings.panels = Open { status: false, hud: true, hud_brief: true, side: Some(Side::Help) };
    settings.overlays = Overlays { zones: true, cells: false, page_state: true };
    settings.remember_view("dive", "00ff", pose(37.8));
    file.save(&settings).unwrap();
    assert_eq!(file.load(), (settings.clone(), None));
    let (loaded, _) = file.load();
    assert_eq!(loaded.quality.quality().frame_ms, None);
    let [found, expected] = [loaded.last_view("dive", "00ff").unwrap(), pose(37.8)];
    assert!(found.eye.to_ecef().distance_m(expected.eye.to_ecef()) < 1e-6);
    assert!((found.heading_rad - expected.heading_rad).abs() < 1e-12);
    assert_eq!(loaded.last_view("dive", "other"), None);
    // Nothing but the file lies there.
    assert_eq!(std::fs::read_dir(file.path.parent().unwrap()).unwrap().count(), 1);
}

#[test]
fn missing_keys_have_defaults_and_unknown_ones_stay() {
    let text = "novelty = 7\n[quality]\ntolerance_px = 3\nsharpness = \"high\"\n[window]\nwidth_px = 900\n[later]\na = [1, 2]\n";
    let (_folder, mut file) = written(text);
    let (settings, said) = file.load();
    assert_eq!(said, None);
    assert_eq!(settings.quality.tolerance_px, 3.0);
    assert_eq!(settings.quality.frame_ms, Some(33.0));
    assert_eq!(settings.window.width_px, 900.0);
    assert_eq!(settings.window.height_px, WindowSettings::default().height_px);
    file.save(&settings).unwrap();
    let table: toml::Table = std::fs::read_to_string(&file.path).unwrap().parse().unwrap();
    assert_eq!(table["novelty"].as_integer(), Some(7));
    assert_eq!(table["later"]["a"][1].as_integer(), Some(2));
    assert_eq!(table["quality"]["sharpness"].as_str(), Some("high"));
    assert_eq!(table["quality"]["tolerance_px"].as_float(), Some(3.0));
}

#[test]
fn a_broken_file_is_set_aside_and_not_lost() {
    let (_folder, mut file) = written("[quality]\ntolerance_px = [\n");
    for attempt in 1..=2 {
        let (settings, said) = file.load();
        assert_eq!(settings, Settings::default());
        let said = said.unwrap();
        assert!(said.contains(&format!("settings.toml.broken-{attempt}")) && said.contains("line "), "{said}");
        assert!(!file.path.exists());
        std::fs::write(&file.path, "[quality]\nframe_ms = \"never\"\n").unwrap();
    }
    let first = file.path.with_file_name("settings.toml.broken-1");
    assert_eq!(std::fs::read_to_string(first).unwrap(), "[quality]\ntolerance_px = [\n");
    let (_, said) = file.load();
    assert!(said.unwrap().contains("off"));
    file.save(&Settings::default()).unwrap();
    assert_eq!(file.load().1, None);
}

#[test]
fn bytes_that_are_no_text_are_broken_too() {
    let (_folder, mut file) = written("");
    for bytes in [vec![0xff, 0xfe, 0x00], vec![b'#'; FILE_BYTES_MAX as usize + 1]] {
        std::fs::write(&file.path, bytes).unwrap();
        assert!(file.load().1.unwrap().contains("broken"));
    }
}

#[test]
fn what_cannot_be_read_is_not_replaced() {
    let (_folder, mut file) = folder();
    // A folder in the file's place.
    std::fs::create_dir_all(&file.path).unwrap();
    let (settings, said) = file.load();
    assert_eq!(settings, Settings::default());
    assert!(said.unwrap().contains("cannot read"));
    file.save(&settings).unwrap();
    assert!(file.path.is_dir());
}

#[test]
fn a_folder_that_cannot_be_written_is_told() {
    let (folder, _) = folder();
    let blocked = folder.path().join("blocked");
    std::fs::write(&blocked, "").unwrap();
    let said = SettingsFile::at(blocked.join("settings.toml")).save(&Settings::default()).unwrap_err().to_string();
    assert!(said.contains("blocked") && said.contains("check"), "{said}");
}

#[test]
fn wild_numbers_are_brought_into_range() {
    let (_folder, mut file) = written(
        "[window]\nwidth_px = nan\nheight_px = -5\nscale = 1e300\n[quality]\ntolerance_px = inf\nfootprint_bytes = 1\n\
         frame_ms = 0\n[[last_view]]\nworld = \"w\"\nrecipe_hash = \"h\"\nlat_deg = 91\nlon_deg = 0\nheight_m = 1\n\
         heading_deg = 0\npitch_deg = nan\n",
    );
    let (settings, said) = file.load();
    assert_eq!(said, None);
    assert_eq!(settings.window.width_px, WindowSettings::default().width_px);
    assert_eq!((settings.window.height_px, settings.window.scale), (SIDE_PX[0], SCALE[1]));
    let quality = settings.quality.quality();
    assert_eq!(quality, quality.sane());
    assert_eq!((quality.tolerance_px, quality.frame_ms), (1.0, Some(8.0)));
    assert_eq!(settings.last_view("w", "h"), None);
    let mut wild = settings;
    wild.quality.footprint_bytes = u64::MAX;
    file.save(&wild).unwrap();
    assert_eq!(file.load().1, None);
}

#[test]
fn views_are_bounded_and_the_longest_unvisited_goes() {
    let mut settings = Settings::default();
    for at in 0..LAST_VIEWS_MAX + 5 {
        settings.remember_view(&format!("world {at}"), "h", pose(at as f64));
    }
    settings.remember_view("world 6", "h", pose(-1.0));
    assert_eq!(settings.last_views.len(), LAST_VIEWS_MAX);
    assert_eq!(settings.last_view("world 4", "h"), None);
    assert!((settings.last_view("world 6", "h").unwrap().eye.lat_deg() + 1.0).abs() < 1e-12);
    assert!(settings.last_view("world 5", "h").is_some());
    settings.remember_view("world 6", "h", pose(f64::NAN));
    assert_eq!(settings.last_view("world 6", "h"), None);
}

#[test]
fn hidden_sets_are_kept_by_name_and_those_of_other_worlds_stay() {
    let mut sets = SetSettings { hidden: vec!["elsewhere".into(), "a".into()], ..SetSettings::default() };
    sets.keep([("a", false), ("b", true), ("c", true)].into_iter());
    assert_eq!(sets.hidden, ["b", "c", "elsewhere"]);
    let text = toml::to_string(&Settings { sets: sets.clone(), ..Settings::default() }).unwrap();
    assert_eq!(toml::from_str::<Settings>(&text).unwrap().sets, sets);
    let many: Vec<String> = (0..300).map(|at| at.to_string()).collect();
    sets.keep(many.iter().map(|name| (&**name, true)));
    assert_eq!((sets.hidden.len(), &*sets.hidden[0]), (HIDDEN_NAMES_MAX, "0"));
}
