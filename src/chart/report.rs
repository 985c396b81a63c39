//! What a sweep leaves in its folder: the page, the tables, the recommended profile.

use super::choose::{self, FRAME_AIM_MS, FrameTimes, Recommended};
use super::figure::Figure;
use super::figures::{Runs, accuracy, debt, fetch, modelled, speed, stability, waits};
use super::flown::{Flown, runs_sheet};
use super::page::{self, Entry, Frame};
use super::plot::PlotError;
use super::profile::Profile;
use super::sheet::{Cell, Sheet};
use super::sweep::Sweep;
use crate::record::{RecordError, write_text};
use serde_json::json;
use std::path::{Path, PathBuf};

/// The page.
pub const PAGE_FILE: &str = "index.html";
/// All tables as JSON.
pub const DATA_FILE: &str = "data.json";
/// The recommendation, for `stoop --profile`.
pub const PROFILE_FILE: &str = "profile.json";

#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Plot(#[from] PlotError),
    #[error(transparent)]
    Write(#[from] RecordError),
    #[error("cannot encode {what}: {cause}")]
    Encode { what: String, cause: String },
    #[error("cannot make the folder {}: {source}; check its place and rights", folder.display())]
    Folder { folder: PathBuf, source: std::io::Error },
}

/// What was flown, and all that is told of it.
pub struct Report<'a> {
    pub world: &'a str,
    /// As it was typed, less the folder that is written to.
    pub command: &'a str,
    pub sweep: &'a Sweep,
    pub flown: &'a [Flown],
    /// Figures beside those of the sweep, and whether they tell of this machine.
    pub further: Vec<Figure>,
    /// Of live flights, by tolerance.
    pub frame_times: &'a FrameTimes,
}

impl Report<'_> {
    /// The figures of the sweep, in the order of the page.
    fn figures(&self) -> Vec<Figure> {
        let runs = Runs { sweep: self.sweep, flown: self.flown };
        let sweep = self.sweep;
        let mut figures = vec![
            accuracy::accuracy(&runs),
            accuracy::dominance(&runs),
            debt::debts(&runs),
            debt::debt_over_time(&runs),
            waits::waits(&runs),
        ];
        // A list of one varies nothing.
        figures.extend((sweep.footprints.len() > 1).then(|| fetch::fetch_by_footprint(&runs)));
        figures.extend((sweep.speeds.len() > 1).then(|| speed::debt_by_speed(&runs)));
        figures.extend((sweep.sizes_px.len() > 1).then(|| speed::cost_by_size(&runs)));
        figures.push(modelled::over_modelling(&runs));
        figures.retain(|figure| !figure.sheet.rows.is_empty());
        figures
    }

    /// Writes all files; each appears whole or not at all.
    pub fn write(self, folder: &Path) -> Result<Profile, ReportError> {
        std::fs::create_dir_all(folder).map_err(|source| ReportError::Folder { folder: folder.to_owned(), source })?;
        let mut figures = self.figures();
        figures.extend(self.further.iter().cloned());
        figures.push(stability::stability());
        let candidates = choose::candidates(self.sweep, self.flown, self.frame_times);
        let choice = choose::choose(self.sweep, &candidates);
        let recommendation = choose::sheet(&candidates, choice.as_ref());
        let runs = runs_sheet(self.sweep, self.flown).map_err(|error| encode("runs", error))?;
        let profile = self.profile(choice.as_ref());

        let sheets: Vec<&Sheet> =
            [&runs].into_iter().chain(figures.iter().map(|figure| &figure.sheet)).chain([&recommendation]).collect();
        for sheet in &sheets {
            let csv = sheet.csv().map_err(|error| encode(&sheet.file_name(), error))?;
            write_text(&folder.join(sheet.file_name()), &String::from_utf8_lossy(&csv))?;
        }
        let data: serde_json::Map<String, serde_json::Value> =
            sheets.iter().map(|sheet| (sheet.name.clone(), sheet.json())).collect();
        let data = json!({ "world": self.world, "command": self.command, "tables": data });
        write_text(&folder.join(DATA_FILE), &pretty("data", &data)?)?;
        write_text(&folder.join(PROFILE_FILE), &pretty("the profile", &profile)?)?;
        let page = self.page(&figures, &recommendation, choice.as_ref())?;
        write_text(&folder.join(PAGE_FILE), &page)?;
        Ok(profile)
    }

    fn profile(&self, choice: Option<&Recommended>) -> Profile {
        Profile {
            tolerance_px: choice.map(|choice| choice.candidate.tolerance_px),
            footprint_bytes: choice.map(|choice| choice.candidate.footprint.0),
            frame_ms: (!self.frame_times.is_empty()).then_some(FRAME_AIM_MS),
            world: self.world.to_owned(),
            storage: self.sweep.storages[0].to_string(),
            why: choice.map_or_else(String::new, |choice| choose::why(self.sweep, choice)),
            command: self.command.to_owned(),
        }
    }

    fn page(&self, figures: &[Figure], table: &Sheet, choice: Option<&Recommended>) -> Result<String, PlotError> {
        let title = format!("{}: speed against accuracy", self.world);
        let frame = Frame { title: &title, head: &self.head(), recommendation: &self.recommendation(table, choice) };
        let entries: Vec<Entry<'_>> = figures.iter().map(|figure| Entry { figure, command: self.command }).collect();
        page::page(&frame, &entries)
    }

    fn head(&self) -> String {
        let sweep = self.sweep;
        let list = |words: Vec<String>| page::escaped(&words.join(", "));
        let flights = list(sweep.flights.iter().map(|flight| flight.name.clone()).collect());
        let storages = list(sweep.storages.iter().map(ToString::to_string).collect());
        let policies = list(sweep.policies.iter().map(ToString::to_string).collect());
        let [width_px, height_px] = sweep.sizes_px[0];
        format!(
            "<p>{} flights by the virtual clock over {flights}; storage: {storages}; policies: {policies}. Where nothing else \
             is said: {} px of tolerance, a footprint of {}, {width_px} × {height_px} pixels. Which setting to take stands \
             <a href=\"#recommendation\">at the end</a>.</p>\n<p class=\"source\">Made by <code>{}</code>; every run with all \
             its figures: <a href=\"runs.csv\">runs.csv</a>; all tables: <a href=\"{DATA_FILE}\">{DATA_FILE}</a>.</p>",
            self.flown.len(),
            sweep.tolerances_px[0],
            sweep.footprints[0],
            page::escaped(self.command),
        )
    }

    fn recommendation(&self, table: &Sheet, choice: Option<&Recommended>) -> String {
        let Some(choice) = choice else { return "<p>There is nothing to choose from.</p>".to_owned() };
        let one = &choice.candidate;
        format!(
            "<p class=\"choice\">On {}: a tolerance of {} px and a footprint of {} bytes ({}).<br>It is {}.<br>\
             <code>stoop WORLD --profile {PROFILE_FILE}</code></p>\n{}\n\
             <p class=\"source\">All numbers: <a href=\"{file}\">{file}</a></p>",
            page::escaped(&self.sweep.storages[0].to_string()),
            page::shown(&Cell::from(one.tolerance_px)),
            page::shown(&Cell::from(one.footprint.0)),
            one.footprint,
            page::escaped(&choose::why(self.sweep, choice)),
            page::table(table),
            file = table.file_name(),
        )
    }
}

fn encode(what: &str, cause: impl ToString) -> ReportError {
    ReportError::Encode { what: what.to_owned(), cause: cause.to_string() }
}

fn pretty(what: &str, value: &impl serde::Serialize) -> Result<String, ReportError> {
    let mut text = serde_json::to_string_pretty(value).map_err(|error| encode(what, error))?;
    text.push('\n');
    Ok(text)
}
