//! How far pictures are off the settled ones: FLIP (Andersson et al. 2020) and root mean square.

use super::figure::{Axis, Curve, Figure, Panel, Spot, Stroke};
use super::flown::REFERENCE_PX;
use super::sheet::Sheet;
use super::sweep::{Run, Sweep};
use crate::camera::View;
use crate::engine::{Engine, EngineError, EngineParams, FrameRequest, Mode, Source, Stills};
use crate::render::RenderError;
use crate::simulate::{Library, SimulationError, fly};
use crate::units::ByteSize;
use image::RgbImage;
use image_compare::Algorithm;
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, FlipPool, flip};

/// Pictures of one flight at most.
pub const PICTURES_MAX: u32 = 1000;
/// The reference lacks nothing for want of memory.
const REFERENCE_FOOTPRINT: ByteSize = ByteSize(4 << 30);
/// The largest value of a channel.
const CHANNEL_MAX: f64 = 255.0;

#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    #[error("two pictures of {0:?} pixels cannot be compared; choose another --size")]
    Compare([u32; 2]),
}

/// Errors of one picture against another of the same size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureError {
    /// Mean, 0 to 1, seen on a screen of 67 pixels a degree.
    pub flip: f64,
    /// Of the worst channel, in its steps: 0 to 255.
    pub rms: f64,
}

/// Compares two pictures.
pub fn compare(reference: &RgbImage, picture: &RgbImage) -> Result<PictureError, ImageError> {
    let size_px: [u32; 2] = picture.dimensions().into();
    if reference.dimensions() != picture.dimensions() {
        return Err(ImageError::Compare(size_px));
    }
    let of = |image: &RgbImage| FlipImageRgb8::with_data(image.width(), image.height(), image.as_raw());
    let map = flip(of(reference), of(picture), DEFAULT_PIXELS_PER_DEGREE);
    let rms = image_compare::rgb_similarity_structure(&Algorithm::RootMeanSquared, reference, picture)
        .map_err(|_| ImageError::Compare(size_px))?;
    Ok(PictureError { flip: FlipPool::from_image(&map).mean().into(), rms: CHANNEL_MAX * (1.0 - rms.score) })
}

/// One picture of a run.
struct Shot {
    run: Run,
    since_s: f64,
    error: PictureError,
}

/// Pictures of our policy at each tolerance on the first storage model, at `count` times of each flight.
pub fn picture_errors(library: &Library, source: &Source, sweep: &Sweep, count: u32) -> Result<Figure, ImageError> {
    let mut shots = Vec::new();
    for flight in 0..sweep.flights.len() {
        let base = sweep.base(flight, sweep.storages[0]);
        let runs: Vec<Run> = sweep.tolerances_px.iter().map(|&tolerance_px| Run { tolerance_px, ..base }).collect();
        let times_s = times_s(sweep.flight(&base).path.duration_s(), sweep.step_s, count);
        let references = references(source, sweep, &base, &times_s)?;
        for run in runs {
            let pictures = pictures(library, source, sweep, &run, &times_s)?;
            for ((&since_s, reference), picture) in times_s.iter().zip(&references).zip(&pictures) {
                shots.push(Shot { run, since_s, error: compare(reference, picture)? });
            }
        }
    }
    Ok(figure(sweep, &shots))
}

/// In the middle of as many equal parts, at a frame.
fn times_s(duration_s: f64, step_s: f64, count: u32) -> Vec<f64> {
    let middle_s = |at: u32| duration_s * (f64::from(at) + 0.5) / f64::from(count);
    (0..count).map(|at| (middle_s(at) / step_s).floor() * step_s).collect()
}

fn view(sweep: &Sweep, run: &Run, since_s: f64) -> View {
    let flight = sweep.flight(run);
    View::new(flight.path.at(flight.path.start_s() + since_s), flight.path.fovy_rad(), run.size_px)
}

fn references(source: &Source, sweep: &Sweep, run: &Run, times_s: &[f64]) -> Result<Vec<RgbImage>, ImageError> {
    let params = EngineParams {
        mode: Mode::Settled,
        tolerance_px: REFERENCE_PX,
        footprint: REFERENCE_FOOTPRINT,
        ..EngineParams::default()
    };
    let mut engine = Engine::new(source.clone(), params)?;
    let mut pictures = Vec::new();
    for &since_s in times_s {
        engine.frame(&FrameRequest { view: view(sweep, run, since_s), t_s: since_s, ids: false })?;
        pictures.push(rgb(run.size_px, &engine.picture().read_color()?)?);
    }
    Ok(pictures)
}

/// The first frame at or after each time.
fn pictures(
    library: &Library,
    source: &Source,
    sweep: &Sweep,
    run: &Run,
    times_s: &[f64],
) -> Result<Vec<RgbImage>, ImageError> {
    let params = EngineParams { tolerance_px: run.tolerance_px, footprint: run.footprint, ..EngineParams::default() };
    let mut stills = Stills::open(source.clone(), &params)?;
    let (mut pictures, mut drawn) = (Vec::new(), Ok(()));
    let flight = sweep.flight(run);
    fly(library, &flight.path, sweep.setup(run), |frame, simulation| {
        let since_s = frame.report.t_s - flight.path.start_s();
        while drawn.is_ok() && times_s.get(pictures.len()).is_some_and(|&due_s| since_s >= due_s - 1e-9) {
            let request = FrameRequest { view: frame.view, t_s: frame.report.t_s, ids: false };
            drawn =
                stills.draw(simulation.index(), &frame.selection, &request).map_err(ImageError::from).and_then(|()| {
                    pictures.push(rgb(run.size_px, &stills.picture().read_color()?)?);
                    Ok(())
                });
        }
        drawn.is_ok() && pictures.len() < times_s.len()
    })?;
    drawn.map(|()| pictures)
}

/// Without its alpha.
fn rgb(size_px: [u32; 2], rgba: &[u8]) -> Result<RgbImage, ImageError> {
    let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    RgbImage::from_raw(size_px[0], size_px[1], rgb).ok_or(ImageError::Compare(size_px))
}

/// A figure's name, and its value.
type Told = (&'static str, fn(&PictureError) -> f64);

fn figure(sweep: &Sweep, shots: &[Shot]) -> Figure {
    let mut sheet = Sheet::new("images", &["flight", "storage", "tolerance_px", "since_s", "flip", "rms"]);
    for shot in shots {
        sheet.push([
            sweep.flights[shot.run.flight].name.as_str().into(),
            shot.run.storage.to_string().into(),
            shot.run.tolerance_px.into(),
            shot.since_s.into(),
            shot.error.flip.into(),
            shot.error.rms.into(),
        ]);
    }
    let figures: [Told; 2] =
        [("FLIP, mean of the pictures", |error| error.flip), ("RMS, steps of 255", |error| error.rms)];
    let panels = figures.map(|(name, of)| {
        let curves = sweep.flights.iter().enumerate().map(|(at, flight)| {
            let mut spots: Vec<Spot> = sweep.tolerances_px.iter().map(|&px| mean_of(shots, at, px, of)).collect();
            spots.sort_by(|a, b| a.x.total_cmp(&b.x));
            Curve { name: flight.name.clone(), stroke: Stroke::Dotted, spots }
        });
        Panel {
            title: name.to_owned(),
            x: Axis::log("tolerance, px", 1e-3),
            y: Axis::linear(name),
            curves: curves.collect(),
        }
    });
    Figure {
        title: "Image error".into(),
        text: format!(
            "Pictures by the virtual clock on {} against the settled ones at {REFERENCE_PX} px. RMS is that of the worst \
             colour channel. Pictures depend on the GPU and its driver, if little.",
            sweep.storages[0]
        ),
        panels: panels.into(),
        sheet,
        has_table: true,
    }
}

fn mean_of(shots: &[Shot], flight: usize, tolerance_px: f64, of: fn(&PictureError) -> f64) -> Spot {
    let found = shots.iter().filter(|shot| shot.run.flight == flight && shot.run.tolerance_px == tolerance_px);
    let errors: Vec<f64> = found.map(|shot| of(&shot.error)).collect();
    Spot::from((tolerance_px, errors.iter().sum::<f64>() / errors.len().max(1) as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_picture_has_no_error_and_another_one_has() {
        let gray = |level: u8| RgbImage::from_pixel(32, 16, image::Rgb([level; 3]));
        assert_eq!(compare(&gray(100), &gray(100)).unwrap(), PictureError { flip: 0.0, rms: 0.0 });
        let off = compare(&gray(100), &gray(110)).unwrap();
        assert!((off.rms - 10.0).abs() < 1e-3 && off.flip > 0.01, "{off:?}");
        assert!(compare(&gray(100), &gray(200)).unwrap().flip > off.flip);
        assert!(compare(&gray(100), &RgbImage::new(3, 3)).is_err());
        assert_eq!(times_s(10.0, 1.0, 2), [2.0, 7.0]);
    }
}
