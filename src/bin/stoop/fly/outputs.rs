//! The pictures that a flight leaves behind.

use super::schedule::PictureTimes;
use crate::cli;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use stoop::engine::LastPicture;
use stoop::record::{Video, picture_name, write_npy, write_png, write_text};

/// Where pictures, ids, depths and the video of a flight go.
pub struct Outputs {
    frames: Option<PathBuf>,
    aov: Option<PathBuf>,
    video: Option<Video>,
    times: PictureTimes,
    step_s: f64,
}

/// What a frame is to leave behind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Due {
    /// The time that the picture stands for.
    picture_s: Option<f64>,
    aov: bool,
    video: bool,
}

impl Due {
    /// Whether the frame must be drawn.
    pub fn wants_pixels(&self) -> bool {
        self.picture_s.is_some() || self.video
    }

    /// Whether ids and depth must be drawn with the picture.
    pub fn wants_aov(&self) -> bool {
        self.picture_s.is_some() && self.aov
    }
}

impl Outputs {
    pub fn create(arguments: &super::Arguments, step_s: f64) -> anyhow::Result<Self> {
        for folder in arguments.frames.iter().chain(&arguments.aov) {
            cli::make_folder(folder)?;
        }
        // A flight must not end without its report for want of a folder.
        if let Some(folder) =
            arguments.report.as_deref().and_then(Path::parent).filter(|folder| *folder != Path::new(""))
        {
            cli::make_folder(folder)?;
        }
        let video = match &arguments.video {
            Some(file) => Some(Video::create(file, arguments.size.0, 1.0 / step_s)?),
            None => None,
        };
        Ok(Self {
            frames: arguments.frames.clone(),
            aov: arguments.aov.clone(),
            video,
            times: arguments.picture_times(),
            step_s,
        })
    }

    pub fn due(&mut self, t_s: f64) -> Due {
        Due { picture_s: self.times.due(t_s, self.step_s), aov: self.aov.is_some(), video: self.video.is_some() }
    }

    /// Whether any frame may be asked for.
    pub fn want_pixels(&self) -> bool {
        self.frames.is_some() || self.aov.is_some() || self.video.is_some()
    }

    pub fn write(&mut self, picture: LastPicture<'_>, due: Due, size_px: [u32; 2]) -> anyhow::Result<()> {
        if !due.wants_pixels() {
            return Ok(());
        }
        let rgba = picture.read_color()?;
        if let Some(video) = &mut self.video {
            video.push(&rgba)?;
        }
        let Some(picture_s) = due.picture_s else { return Ok(()) };
        let name = picture_name(picture_s, self.step_s);
        if let Some(folder) = &self.frames {
            write_png(&folder.join(format!("{name}.png")), size_px, &rgba)?;
        }
        if let Some(folder) = &self.aov {
            write_aov(picture, folder, &name, size_px)?;
        }
        Ok(())
    }

    pub fn finish(&mut self) -> anyhow::Result<()> {
        self.video.take().map_or(Ok(()), |video| Ok(video.finish()?))
    }
}

/// Writes `NAME.ids.npy`, `NAME.ids.json` and `NAME.depth.npy` of the frame just drawn.
pub fn write_aov(picture: LastPicture<'_>, folder: &Path, name: &str, size_px: [u32; 2]) -> anyhow::Result<()> {
    let ids = picture.read_ids()?;
    write_npy(&folder.join(format!("{name}.ids.npy")), size_px, &ids)?;
    write_npy(&folder.join(format!("{name}.depth.npy")), size_px, &picture.read_depth()?)?;
    let shown: BTreeSet<u32> = ids.iter().copied().filter(|&id| id != 0).collect();
    let legend: serde_json::Map<_, _> = shown.into_iter().map(|id| (id.to_string(), picture.describe_id(id))).collect();
    write_text(&folder.join(format!("{name}.ids.json")), &serde_json::to_string_pretty(&legend)?)?;
    Ok(())
}
