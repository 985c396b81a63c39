//! Finding source files: `file` in a recipe is a file, a folder, a glob, or a .zip that holds such.

use super::PrepareError;
use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

/// One file to read, on disk or inside a .zip on disk.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SourceFile {
    pub path: PathBuf,
    /// Name inside the .zip.
    pub inside: Option<String>,
}

/// What readers read from.
pub trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

impl std::fmt::Display for SourceFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.inside {
            Some(inside) => write!(f, "{}: {inside}", self.path.display()),
            None => self.path.display().fmt(f),
        }
    }
}

impl SourceFile {
    /// The file's own name, without folders.
    pub fn name(&self) -> String {
        let name = match &self.inside {
            Some(inside) => Path::new(inside).file_name(),
            None => self.path.file_name(),
        };
        name.map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
    }

    /// Whether the name ends in one of `.ext`; cases do not count.
    pub fn has_extension(&self, extensions: &[&str]) -> bool {
        has_extension(&self.name(), extensions)
    }

    /// The files beside it that differ from it in their extension alone; cases do not count.
    pub fn siblings(&self) -> Result<Vec<Self>, PrepareError> {
        let Some(inside) = &self.inside else {
            let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let paths = list_folder(folder)?.into_iter().filter(|path| has_same_stem(path, &self.path));
            return Ok(paths.map(|path| Self { path, inside: None }).collect());
        };
        let names = names_in_zip(&self.path)?.into_iter();
        let alike = names.filter(|name| has_same_stem(Path::new(name), Path::new(inside)));
        Ok(alike.map(|name| Self { path: self.path.clone(), inside: Some(name) }).collect())
    }

    /// The whole file; those in a .zip are unpacked into memory.
    pub fn read(&self) -> Result<Vec<u8>, PrepareError> {
        let Some(inside) = &self.inside else {
            return std::fs::read(&self.path).map_err(|e| PrepareError::read(&self.path, e));
        };
        let mut zip = open_zip(&self.path)?;
        let damaged = |what: String| PrepareError::damaged(self.path.display(), inside, what);
        let mut entry = zip.by_name(inside).map_err(|e| damaged(e.to_string()))?;
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|e| damaged(e.to_string()))?;
        Ok(bytes)
    }

    /// Length of the (unpacked) file.
    pub fn bytes(&self) -> Result<u64, PrepareError> {
        let Some(inside) = &self.inside else {
            return Ok(std::fs::metadata(&self.path).map_err(|e| PrepareError::read(&self.path, e))?.len());
        };
        let mut zip = open_zip(&self.path)?;
        let entry = zip.by_name(inside).map_err(|e| PrepareError::damaged(self.path.display(), inside, e))?;
        Ok(entry.size())
    }

    /// A reader: buffered from disk, or over the unpacked bytes.
    pub fn open(&self) -> Result<Box<dyn ReadSeek>, PrepareError> {
        match &self.inside {
            Some(_) => Ok(Box::new(Cursor::new(self.read()?))),
            None => {
                let file = File::open(&self.path).map_err(|e| PrepareError::read(&self.path, e))?;
                Ok(Box::new(BufReader::with_capacity(1 << 16, file)))
            }
        }
    }
}

/// Whether a name ends in one of `.ext`; cases do not count.
pub fn has_extension(name: &str, extensions: &[&str]) -> bool {
    let name = name.to_ascii_lowercase();
    extensions.iter().any(|ext| name.strip_suffix(ext).is_some_and(|stem| stem.ends_with('.')))
}

/// Whether two files lie in the same folder under names that differ in their extension alone; cases do not count.
fn has_same_stem(one: &Path, other: &Path) -> bool {
    let stem = |path: &Path| path.with_extension("").to_string_lossy().to_lowercase();
    stem(one) == stem(other)
}

/// All files that `file` means, in name order. In folders and .zip files only those with one of the `extensions`
/// (without dot, lower case) count; a file named as such is taken whatever its extension.
pub fn resolve(root: &Path, file: &str, extensions: &[&str]) -> Result<Vec<SourceFile>, PrepareError> {
    let path = root.join(file);
    let found = if path.is_file() {
        expand(&path, extensions)?
    } else if path.is_dir() {
        expand_all(list_folder(&path)?, extensions)?
    } else if file.contains(['*', '?', '[']) {
        expand_all(list_glob(root, file)?, extensions)?
    } else {
        return Err(PrepareError::Missing { file: path.display().to_string(), asked: file.to_owned() });
    };
    if found.is_empty() {
        let what = format!("holds no file that can be read here (.{})", extensions.join(", ."));
        return Err(PrepareError::value(path.display(), "the whole", what, "check `file` in the recipe"));
    }
    Ok(found)
}

fn list_folder(path: &Path) -> Result<Vec<PathBuf>, PrepareError> {
    let entries = std::fs::read_dir(path).map_err(|e| PrepareError::read(path, e))?;
    entries.map(|entry| entry.map(|e| e.path()).map_err(|e| PrepareError::read(path, e))).collect()
}

fn list_glob(root: &Path, file: &str) -> Result<Vec<PathBuf>, PrepareError> {
    // Only what the recipe says is a pattern; a folder named "a[1]" above it is not.
    let pattern = Path::new(&glob::Pattern::escape(&root.to_string_lossy())).join(file);
    let bad = |what: String| PrepareError::value(file, "glob", what, "write a pattern such as tiles/*.hgt");
    let paths = glob::glob(&pattern.to_string_lossy()).map_err(|e| bad(e.to_string()))?;
    paths.map(|path| path.map_err(|e| bad(e.to_string()))).collect()
}

fn expand_all(mut paths: Vec<PathBuf>, extensions: &[&str]) -> Result<Vec<SourceFile>, PrepareError> {
    paths.sort();
    let mut found = Vec::new();
    for path in paths.iter().filter(|p| p.is_file()) {
        let name = path.to_string_lossy();
        if has_extension(&name, extensions) || has_extension(&name, &["zip"]) {
            found.extend(expand(path, extensions)?);
        }
    }
    Ok(found)
}

fn expand(path: &Path, extensions: &[&str]) -> Result<Vec<SourceFile>, PrepareError> {
    if !has_extension(&path.to_string_lossy(), &["zip"]) {
        return Ok(vec![SourceFile { path: path.to_owned(), inside: None }]);
    }
    let mut names = names_in_zip(path)?;
    names.retain(|name| has_extension(name, extensions));
    names.sort();
    Ok(names.into_iter().map(|name| SourceFile { path: path.to_owned(), inside: Some(name) }).collect())
}

fn names_in_zip(path: &Path) -> Result<Vec<String>, PrepareError> {
    let zip = open_zip(path)?;
    let damaged = |error| PrepareError::damaged(path.display(), "zip directory", error);
    zip.file_names().map(|name| name.map(|name| name.into_owned()).map_err(damaged)).collect()
}

fn open_zip(path: &Path) -> Result<zip::ZipArchive<BufReader<File>>, PrepareError> {
    let file = File::open(path).map_err(|e| PrepareError::read(path, e))?;
    zip::ZipArchive::new(BufReader::new(file)).map_err(|e| PrepareError::damaged(path.display(), "zip directory", e))
}
