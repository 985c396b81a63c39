//! Where pictures and recordings go, and names that never take the place of a file that is there.

use crate::camera::FlightPath;
use crate::store::write_whole;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// A PNG, into the user's folder for pictures.
    Screenshot,
    /// A flight path in JSON, into the user's folder for documents.
    Recording,
}

impl OutputKind {
    fn extension(self) -> &'static str {
        match self {
            Self::Screenshot => "png",
            Self::Recording => "json",
        }
    }

    fn noun(self) -> &'static str {
        match self {
            Self::Screenshot => "screenshot",
            Self::Recording => "recording",
        }
    }
}

/// Names tried within one second before giving up.
const NAMES_MAX: u32 = 1000;
const SECS_PER_DAY: u64 = 86_400;

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("cannot save the {noun} {}: {cause}; check the folder's rights and the disk's free space", file.display())]
    Write { noun: &'static str, file: PathBuf, cause: io::Error },
    #[error(
        "cannot save the {noun}: {} has {NAMES_MAX} files of this second already; move some away",
        folder.display()
    )]
    NoName { noun: &'static str, folder: PathBuf },
}

/// The user's folder for this kind, if there is one, else the folder that the program was started in.
pub fn output_folder(kind: OutputKind) -> PathBuf {
    let known = directories::UserDirs::new().and_then(|user| {
        let folder = match kind {
            OutputKind::Screenshot => user.picture_dir(),
            OutputKind::Recording => user.document_dir(),
        };
        folder.filter(|folder| folder.is_dir()).map(Path::to_owned)
    });
    known.unwrap_or_else(|| PathBuf::from("."))
}

/// Writes a new file into a folder, under a name with date and time; whole or not at all.
/// Returns where it lies. The folder is made where it is missing.
pub fn save_new(
    kind: OutputKind,
    folder: &Path,
    now: SystemTime,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<PathBuf, OutputError> {
    let fail = |file: &Path, cause| OutputError::Write { noun: kind.noun(), file: file.to_owned(), cause };
    std::fs::create_dir_all(folder).map_err(|cause| fail(folder, cause))?;
    let file = reserve(kind, folder, now)?;
    match write_whole(&file, write) {
        Ok(()) => Ok(file),
        Err(cause) => {
            // Ours and empty; the first error is the one to tell.
            drop(std::fs::remove_file(&file));
            Err(fail(&file, cause))
        }
    }
}

/// Writes a flight into the user's folder for recordings.
pub fn save_recording(path: &FlightPath) -> Result<PathBuf, OutputError> {
    let folder = output_folder(OutputKind::Recording);
    save_new(OutputKind::Recording, &folder, SystemTime::now(), |file| file.write_all(path.to_json().as_bytes()))
}

/// Makes an empty file under the first free name.
fn reserve(kind: OutputKind, folder: &Path, now: SystemTime) -> Result<PathBuf, OutputError> {
    let stem = format!("stoop-{}", utc_stamp(now));
    for attempt in 1..=NAMES_MAX {
        let again = if attempt > 1 { format!("-{attempt}") } else { String::new() };
        let file = folder.join(format!("{stem}{again}.{}", kind.extension()));
        match File::create_new(&file) {
            Ok(_) => return Ok(file),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(cause) => return Err(OutputError::Write { noun: kind.noun(), file, cause }),
        }
    }
    Err(OutputError::NoName { noun: kind.noun(), folder: folder.to_owned() })
}

/// `2026-01-31T12-34-56Z`: UTC in the order of ISO 8601, without the colons that some file systems refuse. Times
/// before 1970 count as its start.
fn utc_stamp(time: SystemTime) -> String {
    let secs = time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (year, month, day) = civil_from_days(secs / SECS_PER_DAY);
    let of_day = secs % SECS_PER_DAY;
    format!("{year:04}-{month:02}-{day:02}T{:02}-{:02}-{:02}Z", of_day / 3600, of_day / 60 % 60, of_day % 60)
}

/// Year, month and day of the Gregorian calendar, from days since 1 January 1970 (Hinnant 2014, "chrono-Compatible
/// Low-Level Date Algorithms", `civil_from_days`). Years start in March there, so that the leap day is the last.
fn civil_from_days(days: u64) -> (u64, u64, u64) {
    const DAYS_PER_ERA: u64 = 146_097;
    const DAYS_FROM_YEAR_0: u64 = 719_468;
    let shifted = days + DAYS_FROM_YEAR_0;
    let (era, of_era) = (shifted / DAYS_PER_ERA, shifted % DAYS_PER_ERA);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    (era * 400 + year_of_era + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::time::Duration;

    #[test]
    fn stamps_are_those_of_known_moments() {
        // `date -u -d @SECS`
        for (secs, stamp) in [
            (0, "1970-01-01T00-00-00Z"),
            (951_782_399, "2000-02-28T23-59-59Z"),
            (951_782_400, "2000-02-29T00-00-00Z"),
            (951_868_800, "2000-03-01T00-00-00Z"),
            (1_709_210_096, "2024-02-29T12-34-56Z"),
            (4_107_542_400, "2100-03-01T00-00-00Z"),
            (1_798_761_599, "2026-12-31T23-59-59Z"),
        ] {
            assert_eq!(utc_stamp(UNIX_EPOCH + Duration::from_secs(secs)), stamp);
        }
        assert_eq!(utc_stamp(UNIX_EPOCH - Duration::from_secs(5)), "1970-01-01T00-00-00Z");
    }

    #[test]
    fn files_of_one_second_get_names_of_their_own() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("new");
        let save = |text: &'static str| {
            save_new(OutputKind::Screenshot, &inside, UNIX_EPOCH, |file| file.write_all(text.as_bytes())).unwrap()
        };
        let (first, second) = (save("one"), save("two"));
        assert_eq!(first, inside.join("stoop-1970-01-01T00-00-00Z.png"));
        assert_eq!(second, inside.join("stoop-1970-01-01T00-00-00Z-2.png"));
        assert_eq!(std::fs::read_to_string(first).unwrap(), "one");
        assert_eq!(std::fs::read_to_string(second).unwrap(), "two");
        assert_eq!(std::fs::read_dir(&inside).unwrap().count(), 2);
    }

    #[test]
    fn a_failure_leaves_nothing_and_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let failed = save_new(OutputKind::Recording, folder.path(), UNIX_EPOCH, |file| {
            file.write_all(b"half")?;
            Err(io::Error::other("the disk is full"))
        });
        let message = failed.unwrap_err().to_string();
        assert!(message.contains("stoop-1970-01-01T00-00-00Z.json"), "{message}");
        assert!(message.contains("the disk is full") && message.contains("check"), "{message}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_folder_that_cannot_be_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "x").unwrap();
        let failed = save_new(OutputKind::Screenshot, &file, UNIX_EPOCH, |_| Ok(()));
        assert!(failed.unwrap_err().to_string().contains(&*file.to_string_lossy()));
    }
}
