//! Videos: frames piped to the program ffmpeg.

use super::flight::RecordError;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A video under way.
pub struct Video {
    file: PathBuf,
    ffmpeg: Child,
}

impl Video {
    /// Starts ffmpeg, which chooses the codec by the file's ending.
    pub fn create(file: &Path, size_px: [u32; 2], frames_per_s: f64) -> Result<Self, RecordError> {
        let ffmpeg = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgba"])
            .args(["-s", &format!("{}x{}", size_px[0], size_px[1]), "-r", &frames_per_s.to_string(), "-i", "-"])
            // Most players want even sides and this pixel format.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"])
            .arg(file)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|source| RecordError::NoFfmpeg { file: file.to_owned(), source })?;
        Ok(Self { file: file.to_owned(), ffmpeg })
    }

    /// Adds a frame of RGBA8 rows from the top.
    pub fn push(&mut self, rgba: &[u8]) -> Result<(), RecordError> {
        let Some(pipe) = self.ffmpeg.stdin.as_mut() else { return Ok(()) };
        pipe.write_all(rgba).map_err(|error| self.failed(error.to_string()))
    }

    /// Ends the video and waits until it is written.
    pub fn finish(self) -> Result<(), RecordError> {
        let file = self.file;
        let fail = |cause: String| RecordError::Ffmpeg { file: file.clone(), cause };
        let output = self.ffmpeg.wait_with_output().map_err(|error| fail(error.to_string()))?;
        if output.status.success() { Ok(()) } else { Err(fail(last_line(&output.stderr))) }
    }

    /// What ffmpeg said tells more than the broken pipe.
    fn failed(&mut self, otherwise: String) -> RecordError {
        drop(self.ffmpeg.stdin.take());
        let mut said = Vec::new();
        if let Some(stderr) = self.ffmpeg.stderr.as_mut() {
            let _ = std::io::Read::read_to_end(stderr, &mut said);
        }
        let cause = if said.is_empty() { otherwise } else { last_line(&said) };
        RecordError::Ffmpeg { file: self.file.clone(), cause }
    }
}

fn last_line(text: &[u8]) -> String {
    String::from_utf8_lossy(text).lines().last().unwrap_or("no word from it").trim().to_owned()
}
