//! Opens worlds beside the frames: reading an index and laying it over the others takes many frames' time.

use super::WindowOptions;
use crate::store::World;
use crossbeam_channel::{Receiver, Sender, bounded};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};

/// Folders that wait to be opened; more are refused, with a message.
const WAITING_MAX: usize = 4;

/// Worlds over one another.
#[derive(Clone)]
pub struct Opened {
    pub worlds: Vec<Arc<World>>,
    /// All of them.
    pub whole: Arc<World>,
}

/// A thread that opens worlds; dropped, it opens no further ones.
pub struct Opener {
    folders: Option<Sender<PathBuf>>,
    opened: Receiver<Result<Opened, String>>,
    thread: Option<JoinHandle<()>>,
    /// Asked for and not told of yet.
    waiting: usize,
}

impl Opener {
    /// `notify` is called from the thread when a folder was dealt with.
    pub fn start(options: &WindowOptions, notify: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let mut known = Opened { worlds: options.worlds.clone(), whole: options.whole.clone() };
        let (folders, waiting) = bounded::<PathBuf>(WAITING_MAX);
        let (tell, opened) = bounded(WAITING_MAX + 1);
        let thread = Builder::new().name("opener".into()).spawn(move || {
            for folder in waiting {
                let result = known.with(&folder);
                if let Ok(opened) = &result {
                    known = opened.clone();
                }
                // Its end is the window's.
                let _ = tell.send(result);
                notify();
            }
        })?;
        Ok(Self { folders: Some(folders), opened, thread: Some(thread), waiting: 0 })
    }

    /// False when too many wait.
    pub fn open(&mut self, folder: PathBuf) -> bool {
        let taken = self.folders.as_ref().is_some_and(|folders| folders.try_send(folder).is_ok());
        self.waiting += usize::from(taken);
        taken
    }

    /// What became of a folder, if one was dealt with.
    pub fn poll(&mut self) -> Option<Result<Opened, String>> {
        let opened = self.opened.try_recv().ok()?;
        self.waiting = self.waiting.saturating_sub(1);
        Some(opened)
    }

    /// Whether a world is being opened.
    pub fn is_busy(&self) -> bool {
        self.waiting > 0
    }
}

impl Opened {
    /// These worlds and that of a folder, or its manifest.
    fn with(&self, folder: &std::path::Path) -> Result<Self, String> {
        let folder = if folder.is_file() { folder.parent().unwrap_or(folder) } else { folder };
        if self.worlds.iter().any(|world| is_same(world.name(), folder)) {
            return Err(format!("{} is open already", folder.display()));
        }
        let world = World::open(folder).map_err(|error| error.to_string())?;
        let mut worlds = self.worlds.clone();
        worlds.push(Arc::new(world));
        let whole = self.whole.stack_further(&worlds).map_err(|error| error.to_string())?;
        Ok(Self { worlds, whole: Arc::new(whole) })
    }
}

fn is_same(a: &std::path::Path, b: &std::path::Path) -> bool {
    match (std::fs::canonicalize(a), std::fs::canonicalize(b)) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

impl Drop for Opener {
    fn drop(&mut self) {
        self.folders = None;
        // One whose storage hangs is left behind: it holds what it reads, and ends when its read does.
        if let Some(thread) = self.thread.take().filter(JoinHandle::is_finished) {
            let _ = thread.join();
        }
    }
}
