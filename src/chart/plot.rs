//! Panels as SVG, by the crate `plotters`.

use super::figure::{Axis, Curve, Panel, Scale, Spot, Stroke};
use crate::units::ByteSize;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

/// Pixels of a panel, and of the legend at its right.
pub const PANEL_PX: (u32, u32) = (640, 340);
const LEGEND_PX: u32 = 116;
/// From line to line of the legend, pixels.
const LEGEND_LINE_PX: i32 = 18;
const LEGEND_TOP_PX: i32 = 40;
/// Colours that can be told apart with most kinds of colour blindness (Okabe, Ito 2008), less yellow, which is faint on
/// white.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(110, 110, 110),
];
/// How much room is left beyond the outermost values, as a share.
const ROOM: f64 = 0.06;
/// Labels of an axis of bytes, which are wide.
const BYTE_LABELS_MAX: usize = 6;
/// Steps of a logarithmic axis within a decade, from few labels to many.
const DECADE_STEPS: [&[f64]; 4] =
    [&[1.0], &[1.0, 3.0], &[1.0, 2.0, 5.0], &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]];

#[derive(Debug, thiserror::Error)]
#[error("cannot draw the chart {title:?}: {cause}")]
pub struct PlotError {
    title: String,
    cause: String,
}

/// The colour of a curve's name, the same for all panels of a page.
#[derive(Clone, Debug, Default)]
pub struct Palette {
    names: Vec<String>,
}

impl Palette {
    /// In the order in which names first come up.
    pub fn of<'a>(panels: impl IntoIterator<Item = &'a Panel>) -> Self {
        let mut palette = Self::default();
        for curve in panels.into_iter().flat_map(|panel| &panel.curves) {
            if curve.stroke != Stroke::Dashed && !palette.names.contains(&curve.name) {
                palette.names.push(curve.name.clone());
            }
        }
        palette
    }

    /// Bounds and fronts, which are dashed, are black.
    fn color(&self, curve: &Curve) -> RGBColor {
        if curve.stroke == Stroke::Dashed {
            return BLACK;
        }
        let at = self.names.iter().position(|known| *known == curve.name).unwrap_or(0);
        COLORS[at % COLORS.len()]
    }
}

/// An axis as plotters takes it: linear or logarithmic by its value.
struct Along {
    linear: RangedCoordf64,
    range: Range<f64>,
    scale: Scale,
    is_bytes: bool,
}

impl Along {
    /// Holds all values with some room.
    fn around(axis: &Axis, values: impl Iterator<Item = f64>) -> Self {
        let placed = values.filter(|value| value.is_finite()).map(|value| place(axis.scale, value));
        let (low, high) = placed.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let room = if high > low { ROOM * (high - low) } else { 0.5 * high.abs().max(1e-3) };
        let low = if axis.scale == Scale::Linear && low >= 0.0 { 0.0 } else { low - room };
        let high = high + room;
        let range = value_at(axis.scale, low)..value_at(axis.scale, high);
        Self { linear: (low..high).into(), range, scale: axis.scale, is_bytes: axis.is_bytes }
    }
}

/// Where a value lies on the straight axis.
fn place(scale: Scale, value: f64) -> f64 {
    match scale {
        Scale::Linear => value,
        Scale::Log { least } => value.max(least).log10(),
    }
}

fn value_at(scale: Scale, place: f64) -> f64 {
    match scale {
        Scale::Linear => place,
        Scale::Log { .. } => 10f64.powf(place),
    }
}

impl Ranged for Along {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.linear.map(&place(self.scale, *value), limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match self.scale {
            Scale::Linear => self.linear.key_points(hint),
            Scale::Log { .. } if self.is_bytes => doublings(&self.range, hint.max_num_points()),
            Scale::Log { .. } => {
                let most = hint.max_num_points();
                let round = decades(&self.range, most);
                // Of a short range the values are as good as evenly spaced.
                if round.len() > 1 { round } else { RangedCoordf64::from(self.range.clone()).key_points(most) }
            }
        }
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Along {
    fn format_ext(&self, value: &f64) -> String {
        short(*value)
    }
}

/// The most round values of a range that there is room for.
fn decades(range: &Range<f64>, most: usize) -> Vec<f64> {
    let exponents = || range.start.log10().floor() as i32..=range.end.log10().ceil() as i32;
    let of = |steps: &[f64]| -> Vec<f64> {
        let all = exponents().flat_map(|exponent| steps.iter().map(move |step| step * 10f64.powi(exponent)));
        all.filter(|value| range.contains(value)).collect()
    };
    let fitting = DECADE_STEPS.iter().rev().map(|steps| of(steps)).find(|values| values.len() <= most);
    fitting.unwrap_or_else(|| {
        let all = of(DECADE_STEPS[0]);
        let every = all.len().div_ceil(most.max(1)).max(1);
        all.into_iter().step_by(every).collect()
    })
}

/// Powers of two and, where the range is short, parts between them; no more than there is room for.
fn doublings(range: &Range<f64>, most: usize) -> Vec<f64> {
    let (first, last) = (range.start.max(1.0).log2().floor() as i32, range.end.max(1.0).log2().ceil() as i32);
    let of = |steps: &[f64]| -> Vec<f64> {
        let all = (first..=last).flat_map(|exponent| steps.iter().map(move |step| step * 2f64.powi(exponent)));
        all.filter(|value| range.contains(value)).collect()
    };
    let steps: [&[f64]; 3] = [&[1.0, 1.25, 1.5, 1.75], &[1.0, 1.5], &[1.0]];
    steps.into_iter().map(of).find(|values| values.len() <= BYTE_LABELS_MAX.min(most)).unwrap_or_else(|| {
        let whole = of(&[1.0]);
        let every = whole.len().div_ceil(BYTE_LABELS_MAX.min(most).max(1)).max(1);
        whole.into_iter().step_by(every).collect()
    })
}

/// A number for an axis: three digits that count.
pub fn short(value: f64) -> String {
    let (scaled, suffix) = match value.abs() {
        size if size >= 1e9 => (value / 1e9, " G"),
        size if size >= 1e6 => (value / 1e6, " M"),
        size if size >= 1e4 => (value / 1e3, " k"),
        _ => (value, ""),
    };
    if scaled == 0.0 {
        return "0".to_owned();
    }
    let decimals = (2 - scaled.abs().log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{scaled:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    format!("{text}{suffix}")
}

fn label(axis: &Axis, value: f64) -> String {
    if axis.is_bytes { ByteSize(value.round() as u64).to_string().replace(".00", "") } else { short(value) }
}

/// A panel as an SVG element.
pub fn svg(panel: &Panel, palette: &Palette) -> Result<String, PlotError> {
    let mut text = String::new();
    draw(panel, palette, &mut text)
        .map_err(|cause| PlotError { title: panel.title.clone(), cause: cause.to_string() })?;
    Ok(text)
}

type Drawn = Result<(), Box<dyn std::error::Error>>;
type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<Along, Along>>;

fn draw<'a>(panel: &'a Panel, palette: &Palette, text: &'a mut String) -> Drawn {
    let area: Area<'_> = SVGBackend::with_string(text, PANEL_PX).into_drawing_area();
    area.fill(&WHITE)?;
    let (plot, legend) = area.split_horizontally(PANEL_PX.0 - LEGEND_PX);
    let spots = || panel.curves.iter().flat_map(|curve| &curve.spots);
    let mut chart = ChartBuilder::on(&plot)
        .caption(&panel.title, ("sans-serif", 15))
        .margin(8)
        .margin_right(14)
        .x_label_area_size(42)
        .y_label_area_size(64)
        .build_cartesian_2d(
            Along::around(&panel.x, spots().map(|spot| spot.x)),
            Along::around(&panel.y, spots().map(|spot| spot.y)),
        )?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .label_style(("sans-serif", 12))
        .axis_desc_style(("sans-serif", 13))
        .x_desc(&panel.x.name)
        .y_desc(&panel.y.name)
        .x_labels(7)
        .y_labels(7)
        .x_label_formatter(&|value| label(&panel.x, *value))
        .y_label_formatter(&|value| label(&panel.y, *value))
        .draw()?;
    draw_curves(panel, palette, &mut chart)?;
    draw_legend(panel, palette, &legend)?;
    area.present()?;
    Ok(())
}

fn draw_curves(panel: &Panel, palette: &Palette, chart: &mut Chart<'_>) -> Drawn {
    let mut written = Written::default();
    for curve in &panel.curves {
        let color = palette.color(curve);
        let at = |spot: &Spot| (spot.x, spot.y);
        let spots = || curve.spots.iter().filter(|spot| spot.x.is_finite() && spot.y.is_finite());
        match curve.stroke {
            Stroke::Line | Stroke::Dotted => {
                chart.draw_series(LineSeries::new(spots().map(at), color.stroke_width(2)))?;
            }
            Stroke::Dashed => {
                chart.draw_series(DashedLineSeries::new(spots().map(at), 5, 4, color.stroke_width(1)))?;
            }
            Stroke::Points => {}
        }
        if matches!(curve.stroke, Stroke::Points | Stroke::Dotted) {
            chart.draw_series(spots().map(|spot| Circle::new(at(spot), 3, color.filled())))?;
        }
        name_spots(spots(), color, chart, &mut written)?;
    }
    Ok(())
}

/// Names and colours of all curves.
fn draw_legend(panel: &Panel, palette: &Palette, area: &Area<'_>) -> Drawn {
    let mut names: Vec<&str> = Vec::new();
    for curve in &panel.curves {
        if names.contains(&curve.name.as_str()) {
            continue;
        }
        let y = LEGEND_TOP_PX + LEGEND_LINE_PX * names.len() as i32;
        let half_px = if curve.stroke == Stroke::Dashed { 1 } else { 4 };
        let color = palette.color(curve).filled();
        area.draw(&Rectangle::new([(2, y - half_px), (16, y + half_px)], color))?;
        let style = TextStyle::from(("sans-serif", 12).into_font()).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(curve.name.clone(), (22, y), style))?;
        names.push(&curve.name);
    }
    Ok(())
}

/// Where names stand already, pixels.
#[derive(Default)]
struct Written(Vec<(i32, i32)>);

/// Names nearer than this to one another would run into one another, pixels.
const NAME_PX: (i32, i32) = (52, 12);

impl Written {
    fn is_free(&self, (x, y): (i32, i32)) -> bool {
        self.0.iter().all(|&(a, b)| (x - a).abs() >= NAME_PX.0 || (y - b).abs() >= NAME_PX.1)
    }
}

/// Writes the names of spots where there is room for them.
fn name_spots<'s>(
    spots: impl Iterator<Item = &'s Spot>,
    color: RGBColor,
    chart: &mut Chart<'_>,
    written: &mut Written,
) -> Drawn {
    let style = TextStyle::from(("sans-serif", 11).into_font()).color(&color).pos(Pos::new(HPos::Left, VPos::Bottom));
    for spot in spots {
        let Some(name) = &spot.name else { continue };
        let place = chart.backend_coord(&(spot.x, spot.y));
        if written.is_free(place) {
            written.0.push(place);
            let text = Text::new(name.clone(), (5, -3), style.clone());
            chart.draw_series([EmptyElement::at((spot.x, spot.y)) + text])?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::figure::Curve;

    #[test]
    fn labels_are_short_and_round() {
        let told = [0.0, 0.25, 1.0, 1234.0, 45_678.0, 2.5e6, 3e9].map(short);
        assert_eq!(told, ["0", "0.25", "1", "1234", "45.7 k", "2.5 M", "3 G"]);
        assert_eq!(decades(&(0.7..600.0), 8), [1.0, 3.0, 10.0, 30.0, 100.0, 300.0]);
        assert_eq!(decades(&(2.5..12.0), 9), [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0]);
        assert_eq!(doublings(&(3.0..70.0), 8), [4.0, 8.0, 16.0, 32.0, 64.0]);
        assert_eq!(doublings(&(1.0..1e9), 8).len(), 6);
        assert_eq!(doublings(&(40.0..70.0), 8), [40.0, 48.0, 56.0, 64.0]);
    }

    #[test]
    fn a_panel_has_its_names_and_survives_nothing_to_draw() {
        let axis = Axis::log("debt, px", 1e-3);
        let spots =
            vec![Spot { x: 1.0, y: 0.0, name: Some("1 px <".into()) }, Spot { x: 2.0, y: f64::NAN, name: None }];
        let curves = vec![Curve { name: "a & b".into(), stroke: Stroke::Dotted, spots }];
        let panel = Panel { title: "t".into(), x: Axis::linear("time, s"), y: axis, curves };
        let drawn = svg(&panel, &Palette::of([&panel])).unwrap();
        assert!(drawn.starts_with("<svg") && drawn.contains("1 px &lt;") && drawn.contains("debt, px"));
        let empty = Panel { curves: Vec::new(), ..panel };
        assert!(svg(&empty, &Palette::default()).unwrap().contains("time, s"));
    }
}
