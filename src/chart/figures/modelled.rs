//! Over-modelling: what is drawn and held beyond what the pictures need.

use super::Runs;
use crate::chart::figure::{Axis, Curve, Figure, Panel, Stroke};
use crate::chart::flown::Flown;
use crate::chart::sheet::Sheet;

/// How much more than needed may be drawn.
const AIM: f64 = 1.3;

/// Drawn and held over needed.
pub fn over_modelling(runs: &Runs<'_>) -> Figure {
    let mut panels = Vec::new();
    let mut sheet = Sheet::new(
        "modelled",
        &[
            "flight",
            "storage",
            "policy",
            "tolerance_px",
            "drawn_over_needed",
            "drawn_over_needed_max",
            "drawn_over_front",
            "resident_over_needed",
            "needed_over_view_cut",
            "drawn_over_seen",
            "resident_over_seen",
            "needed_triangles_mean",
            "needed_bytes_mean",
        ],
    );
    for (flight, storage, title) in runs.places() {
        let base = runs.sweep.base(flight, storage);
        panels.extend(runs.get(&base).map(|flown| panel(title, flown)));
        let measured = runs.flown.iter().filter(|one| (one.run.flight, one.run.storage) == (flight, storage));
        for one in measured.filter(|one| one.measured.drawn_over_needed.is_some()) {
            let figures = &one.measured;
            sheet.push([
                runs.flight_name(flight),
                storage.to_string().into(),
                one.run.policy.name().into(),
                one.run.tolerance_px.into(),
                figures.drawn_over_needed.into(),
                figures.drawn_over_needed_max.into(),
                figures.drawn_over_front.into(),
                figures.resident_over_needed.into(),
                figures.needed_over_view_cut.into(),
                figures.drawn_over_seen.into(),
                figures.resident_over_seen.into(),
                figures.needed_triangles_mean.into(),
                figures.needed_bytes_mean.into(),
            ]);
        }
    }
    Figure {
        title: "Over-modelling".into(),
        text: format!(
            "Triangles drawn (skirts and cut edges included) over those that the picture needs, the aim being at most {AIM}: \
             those of the stored reps with a part in the view's pyramid before the horizon, at the tolerance and by exact \
             distances; the same over those of the needed reps as wholes (front), as pages reach beyond the view; stored bytes \
             held over those of the pages needed; and the ground's needed triangles over those of one cut over the whole view. \
             In the table sums over the flight are compared. In these what stands behind a hill or a house counts as needed; \
             seen is what of the needed is not wholly behind something nearer, objects as wholes."
        ),
        panels,
        sheet,
        has_table: true,
    }
}

fn panel(title: String, flown: &Flown) -> Panel {
    let series = |name: &str, of: fn(&crate::chart::Moment) -> Option<f64>| {
        let spots: Vec<(f64, f64)> =
            flown.series.iter().filter_map(|moment| Some((moment.since_s, of(moment)?))).collect();
        Curve::new(name, Stroke::Line, spots)
    };
    let ends = flown.series.first().into_iter().chain(flown.series.last());
    let aim: Vec<(f64, f64)> = ends.map(|moment| (moment.since_s, AIM)).collect();
    let curves = vec![
        Curve::new("aim", Stroke::Dashed, aim),
        series("drawn ÷ needed", |moment| moment.drawn_over_needed),
        series("drawn ÷ front", |moment| moment.drawn_over_front),
        series("drawn ÷ seen", |moment| moment.drawn_over_seen),
        series("held ÷ needed", |moment| moment.resident_over_needed),
    ];
    let (x, y) = (Axis::linear("time of the flight, s"), Axis::log("over what is needed", 0.1));
    Panel { title, x, y, curves }
}
