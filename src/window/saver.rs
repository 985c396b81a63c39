//! Saves pictures beside the frames: encoding and writing take many frames' time.

use super::files::{OutputKind, output_folder, save_new};
use crate::record::png_bytes;
use crossbeam_channel::{Receiver, Sender, bounded};
use std::io::Write;
use std::thread::{Builder, JoinHandle};
use std::time::SystemTime;

/// Pictures that wait to be saved; more are refused, with a message.
const WAITING_MAX: usize = 4;

struct Picture {
    size_px: [u32; 2],
    rgba: Vec<u8>,
    taken: SystemTime,
}

/// A thread that writes pictures; dropped, it first finishes those that wait.
pub struct Saver {
    pictures: Option<Sender<Picture>>,
    said: Receiver<Result<String, String>>,
    thread: Option<JoinHandle<()>>,
}

impl Saver {
    /// `notify` is called from the thread when something was said.
    pub fn start(notify: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (pictures, waiting) = bounded::<Picture>(WAITING_MAX);
        // Room for one message of each picture that waits and of the one under way.
        let (say, said) = bounded(WAITING_MAX + 1);
        let thread = Builder::new().name("saver".into()).spawn(move || {
            for picture in waiting {
                // Full: the window shows no messages any more.
                let _ = say.try_send(save(&picture));
                notify();
            }
        })?;
        Ok(Self { pictures: Some(pictures), said, thread: Some(thread) })
    }

    /// RGBA8, rows from the top; false when too many wait.
    pub fn save(&self, size_px: [u32; 2], rgba: Vec<u8>) -> bool {
        let picture = Picture { size_px, rgba, taken: SystemTime::now() };
        self.pictures.as_ref().is_some_and(|pictures| pictures.try_send(picture).is_ok())
    }

    /// What became of pictures since the last call.
    pub fn said(&self) -> impl Iterator<Item = Result<String, String>> + '_ {
        self.said.try_iter()
    }
}

impl Drop for Saver {
    fn drop(&mut self) {
        self.pictures = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn save(picture: &Picture) -> Result<String, String> {
    let bytes =
        png_bytes(picture.size_px, &picture.rgba).map_err(|error| format!("cannot encode the picture: {error}"))?;
    let folder = output_folder(OutputKind::Screenshot);
    save_new(OutputKind::Screenshot, &folder, picture.taken, |file| file.write_all(&bytes))
        .map(|file| format!("saved {}", file.display()))
        .map_err(|error| error.to_string())
}
