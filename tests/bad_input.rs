//! Bad input through the real programs: one clear error that names the file and the remedy, nothing half-written.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).expect("the file is written");
        path
    }

    /// Runs `stoop-prepare` on a recipe.
    fn prepare(&self, recipe: &str) -> Output {
        let recipe = self.write("recipe.toml", recipe);
        let out = self.path("world");
        run(env!("CARGO_BIN_EXE_stoop-prepare"), &[recipe.to_str().unwrap(), "--out", out.to_str().unwrap()])
    }

    /// The recipe fails, says each of `parts` in one line, and leaves no world.
    fn refuses(&self, recipe: &str, parts: &[&str]) {
        let output = self.prepare(recipe);
        says(&output, parts);
        assert!(!self.path("world").join("world.json").exists(), "a world was left behind");
    }
}

fn run(program: &str, arguments: &[&str]) -> Output {
    Command::new(program).args(arguments).output().expect("the program starts")
}

/// Lines that libraries write by themselves: PROJ's log, and the Vulkan loader's where XDG_RUNTIME_DIR is not set.
const FOREIGN: [&str; 2] = ["proj_create", "error: XDG_RUNTIME_DIR"];

/// Failed without a panic, with one line of its own on standard error that holds all `parts`.
fn says(output: &Output, parts: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "it passed");
    let own = error.lines().filter(|line| !FOREIGN.iter().any(|foreign| line.starts_with(foreign)));
    assert_eq!(own.count(), 1, "not one line: {error}");
    assert!(!error.contains("panicked"), "{error}");
    for part in parts {
        assert!(error.contains(part), "{part:?} is not in: {error}");
    }
}

/// A little TIFF of heights without georeference.
fn plain_tiff() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
    let heights: Vec<f32> = (0..64 * 64).map(|n| n as f32).collect();
    encoder.write_image::<tiff::encoder::colortype::Gray32Float>(64, 64, &heights).unwrap();
    bytes.into_inner()
}

const ELEVATION: &str = "name = \"bad\"\n[[elevation]]\nfile = \"heights.tif\"\nvertical = \"ellipsoid\"\n";

#[test]
fn a_missing_file() {
    Case::new().refuses(ELEVATION, &["heights.tif", "not found"]);
}

#[test]
fn a_truncated_tiff() {
    let case = Case::new();
    let whole = plain_tiff();
    case.write("heights.tif", &whole[..whole.len() / 2]);
    case.refuses(ELEVATION, &["heights.tif", "truncated"]);
}

#[test]
fn a_tiff_without_georeference() {
    let case = Case::new();
    case.write("heights.tif", plain_tiff());
    case.refuses(ELEVATION, &["heights.tif", "georeference"]);
}

#[test]
fn an_unknown_crs() {
    let case = Case::new();
    case.write("a.geojson", FOOTPRINT);
    let recipe =
        "name = \"bad\"\n[[buildings]]\nname = \"b\"\nfile = \"a.geojson\"\nheight = 10\ncrs = \"EPSG:123456\"\n";
    case.refuses(recipe, &["EPSG:123456", "not known"]);
}

#[test]
fn a_recipe_with_a_typo() {
    let case = Case::new();
    case.refuses("name = \"bad\"\n[[elevation]]\nfiel = \"heights.tif\"\n", &["recipe.toml", "line 3", "fiel", "file"]);
}

const FOOTPRINT: &str = r#"{"type":"FeatureCollection","features":[{"type":"Feature","properties":{},"geometry":
{"type":"Polygon","coordinates":[[[10,50],[10.001,50],[10.001,50.001],[10,50.001],[10,50]]]}}]}"#;

#[test]
fn a_geojson_with_a_wrong_type() {
    let case = Case::new();
    case.write("a.geojson", FOOTPRINT.replace("Polygon", "Polygoon"));
    case.refuses("name = \"bad\"\n[[buildings]]\nname = \"b\"\nfile = \"a.geojson\"\nheight = 10\n", &["a.geojson"]);
}

/// A small world to break: one building on bare ground.
fn small_world(case: &Case) -> PathBuf {
    case.write("a.geojson", FOOTPRINT);
    let output = case.prepare("name = \"good\"\n[[buildings]]\nname = \"b\"\nfile = \"a.geojson\"\nheight = 10\n");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    case.path("world")
}

fn first_pack(world: &Path) -> PathBuf {
    let mut packs: Vec<_> = std::fs::read_dir(world.join("packs")).unwrap().map(|e| e.unwrap().path()).collect();
    packs.sort_by_key(|path| std::cmp::Reverse(path.metadata().unwrap().len()));
    packs.remove(0)
}

#[test]
fn a_world_with_a_flipped_byte() {
    let case = Case::new();
    let world = small_world(&case);
    let pack = first_pack(&world);
    let mut bytes = std::fs::read(&pack).unwrap();
    let at = bytes.len() - 3;
    bytes[at] ^= 0x40;
    std::fs::write(&pack, bytes).unwrap();
    let output = run(env!("CARGO_BIN_EXE_stoop"), &["check", world.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(printed.contains("checksum") && printed.contains(pack.file_name().unwrap().to_str().unwrap()), "{printed}");
}

#[test]
fn a_world_of_a_future_version() {
    let case = Case::new();
    let world = small_world(&case);
    let manifest = world.join("world.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    assert!(text.contains("\"version\": 1"), "{text}");
    std::fs::write(&manifest, text.replacen("\"version\": 1", "\"version\": 9", 1)).unwrap();
    let output = run(env!("CARGO_BIN_EXE_stoop"), &["info", world.to_str().unwrap()]);
    says(&output, &["world.json", "version 9", "update stoop"]);
}

#[test]
fn a_world_that_is_not_there() {
    let output = run(env!("CARGO_BIN_EXE_stoop"), &["info", "no/such/world"]);
    says(&output, &["no/such/world"]);
}

/// A file system of 256 KiB, where the user may mount one.
struct TinyDisk(PathBuf);

impl TinyDisk {
    fn mount(at: PathBuf) -> Option<Self> {
        std::fs::create_dir_all(&at).ok()?;
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=256k", "tmpfs"]).arg(&at).output();
        mounted.is_ok_and(|output| output.status.success()).then_some(Self(at))
    }
}

impl Drop for TinyDisk {
    fn drop(&mut self) {
        // A disk that stays mounted harms nobody but the folder's removal.
        drop(Command::new("umount").arg(&self.0).output());
    }
}

#[test]
fn a_full_disk() {
    let case = Case::new();
    let Some(disk) = TinyDisk::mount(case.path("disk")) else {
        println!("skipped: mounting a small disk needs root");
        return;
    };
    let mut picture = image::RgbImage::new(1024, 512);
    let mut state = 1u32;
    for pixel in picture.pixels_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        pixel.0 = state.to_be_bytes()[..3].try_into().unwrap();
    }
    picture.save(case.path("noise.png")).unwrap();
    let recipe = case
        .write("recipe.toml", "name = \"big\"\n[[imagery]]\nfile = \"noise.png\"\nbounds_deg = [-180, -90, 180, 90]\n");
    let out = disk.0.join("world");
    let output = run(env!("CARGO_BIN_EXE_stoop-prepare"), &[recipe.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    says(&output, &["space"]);
    assert!(!out.join("world.json").exists(), "a world was left behind");
}

#[test]
fn a_report_that_cannot_be_written() {
    if !Path::new("/dev/full").exists() {
        println!("skipped: there is no /dev/full here");
        return;
    }
    let case = Case::new();
    let world = small_world(&case);
    let path = case.write(
        "path.json",
        r#"{"fovy_deg":60,"hz":1,"columns":["t_s","lon_deg","lat_deg","height_m","heading_deg","pitch_deg"],
"samples":[[0,10,50,1000,0,-90],[1,10,50,900,0,-90]]}"#,
    );
    let output = run(
        env!("CARGO_BIN_EXE_stoop"),
        &["fly", world.to_str().unwrap(), "--path", path.to_str().unwrap(), "--report", "/dev/full", "--size", "64x36"],
    );
    says(&output, &["/dev/full"]);
}
