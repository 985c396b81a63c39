//! What can be wrong with a world: what, where, and what to do.

use crate::content::{PageId, PageKind};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// What is wrong with the bytes of a page.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PageFault {
    #[error("it ends too early")]
    Truncated,
    #[error("it does not begin like a page")]
    Magic,
    #[error("its version {0} is newer than this program; update stoop")]
    FutureVersion(u8),
    #[error("it belongs to another cell or layer")]
    WrongPage,
    #[error("its checksum is wrong")]
    Checksum,
    #[error("it is malformed: {0}")]
    Malformed(&'static str),
}

/// What cannot be written as a page.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    #[error("a picture needs {expected} bytes of RGB, not {found}")]
    PictureSize { expected: usize, found: usize },
    #[error("the picture cannot be written as JPEG: {0}")]
    Jpeg(String),
    #[error("{0} objects are too many for a page")]
    TooManyObjects(usize),
    #[error("{attributes} attributes for {objects} objects")]
    Attributes { objects: usize, attributes: usize },
    #[error("an object lies in cell {0}, outside of its page's")]
    Outside(crate::forest::CellId),
    #[error("{0} bytes are too many for a page")]
    TooLarge(usize),
    #[error("the page's posts are not closed")]
    Open,
}

#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("{}: no world here (there is no world.json); name the directory that stoop-prepare wrote", .0.display())]
    NotAWorld(PathBuf),
    #[error("{}: version {found} is newer than this program (it reads {supported}); update stoop", .file.display())]
    FutureVersion { file: PathBuf, found: u32, supported: u32 },
    #[error("{}: {cause}; prepare the world again", .file.display())]
    Manifest { file: PathBuf, cause: String },
    #[error("{}: {cause}; prepare the world again, or copy the file again", .file.display())]
    Index { file: PathBuf, cause: String },
    #[error("{}: {} at byte {offset}: {fault}; copy the file again, or prepare the world again", .file.display(), PageName(*.page))]
    Page { file: PathBuf, page: PageId, offset: u64, fault: PageFault },
    #[error("{}: {cause}; copy the file again, or prepare the world again", .file.display())]
    Pack { file: PathBuf, cause: String },
    #[error("{}: {cause}; prepare the layout again, or fly without --layout", .file.display())]
    Layout { file: PathBuf, cause: String },
    #[error("{}: the disk is full; nothing was kept: make room and start again", .0.display())]
    DiskFull(PathBuf),
    #[error("{}: there is a world already; name another directory, or ask to replace it", .0.display())]
    Exists(PathBuf),
    #[error("{}: another program is changing this world; wait until it is done", .0.display())]
    Busy(PathBuf),
    #[error("{}: cannot lie over another world: {cause}; open it alone, or prepare one world of both", .world.display())]
    Stack { world: PathBuf, cause: String },
    #[error("{}: is not empty and not a world; name a new or an empty directory", .0.display())]
    Occupied(PathBuf),
    #[error("{}: a page at byte {offset} of {len} bytes is beyond what a pack can hold", .file.display())]
    TooLarge { file: PathBuf, offset: u64, len: usize },
    #[error("{}: {cause}; write http://HOST/FOLDER, https://HOST/FOLDER or s3://BUCKET/FOLDER", .address.display())]
    Address { address: PathBuf, cause: String },
    #[error("{}: a world behind an address cannot be changed; change it in a folder, and put it there again", .0.display())]
    ReadOnly(PathBuf),
    #[error("{}: no world here (the server has no world.json there); name the address of a folder that stoop-prepare wrote", .0.display())]
    NoWorldThere(PathBuf),
    #[error("{}: it is not on the server; copy all of the world there", .file.display())]
    Missing { file: PathBuf },
    #[error("{}: it has changed on the server since it was opened; open it again", .file.display())]
    Changed { file: PathBuf },
    #[error("{}: {cause}; check the network and the address, then try again", .file.display())]
    Unanswered { file: PathBuf, cause: String },
    #[error("{}: the server does not let it be read: {cause}; check the address and who may read it (for s3:// the AWS_ variables, see --help)", .file.display())]
    Denied { file: PathBuf, cause: String },
    #[error("{}: the server sends whole files only; put the world on one that answers requests for byte ranges (nginx, Apache, Caddy, S3 and most others do)", .file.display())]
    NoRanges { file: PathBuf },
    #[error("{}: {cause}; put the world on another server, or tell its owner", .file.display())]
    Answer { file: PathBuf, cause: String },
    #[error("{}: the cache cannot be used: {cause}; name another folder by --cache, or leave it away", .folder.display())]
    Cache { folder: PathBuf, cause: String },
    #[error("{}: {source}", .file.display())]
    Io { file: PathBuf, source: io::Error },
}

impl StoreError {
    pub(super) fn io(file: &Path, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::DiskFull(file.to_owned()),
            _ => Self::Io { file: file.to_owned(), source },
        }
    }

    /// Whether trying again can help: a device's failure may pass, and so may a network's; broken bytes stay broken.
    pub fn is_transient(&self) -> bool {
        match self {
            Self::Io { source, .. } => source.kind() != io::ErrorKind::NotFound,
            Self::Unanswered { .. } => true,
            _ => false,
        }
    }
}

/// `terrain page of cell 12/3/1/4`
struct PageName(PageId);

impl fmt::Display for PageName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cell = self.0.cell;
        match self.0.kind {
            PageKind::Terrain => write!(f, "terrain page of cell {cell}"),
            PageKind::Imagery => write!(f, "imagery page of cell {cell}"),
            PageKind::Objects { collection, rep } => {
                write!(f, "objects page (collection {collection}, rep {rep}) of cell {cell}")
            }
            PageKind::Segment => write!(f, "index segment of cell {cell}"),
        }
    }
}
