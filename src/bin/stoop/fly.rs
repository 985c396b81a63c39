//! `stoop fly`: a headless flight.

mod outputs;
mod schedule;
mod virtual_clock;

use crate::cli::{self, WrongUsage};
use anyhow::Context;
use clap::ValueEnum;
use outputs::Outputs;
pub use outputs::write_aov;
use schedule::{PictureTimes, Progress};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;
use stoop::camera::{FlightPath, View};
use stoop::chart::Profile;
use stoop::engine::{Engine, EngineParams, FrameRequest, GroundProbe, Mode, Source};
use stoop::paging::{PlannerParams, PolicyName, PolicyParams};
use stoop::record::{FlightHeader, FlightLog};
use stoop::select::{CollectionSet, ObjectsMode};
use stoop::storage::{Faults, StorageModel};
use stoop::units::ByteSize;

const DETAILS: &str = "\
How a flight runs:
  without a mode   lock-step: frames at fixed steps, a frame draws what its budget reads; the same input gives
                   the same frames, requests and figures on every run, machine times apart
  --settled        every frame waits until nothing is left to load: the reference for accuracy
  --live           frames follow the real clock, threads read and decode; writing pictures and audits stops the clock
  --virtual MODEL  frames at fixed steps of a virtual clock, reads take as long as the storage model says; no thread and
                   no GPU, and the same report on every run and machine; pictures are drawn only where --frames, --aov
                   or --video ask for them, or an audit; --footprint holds for the flight, its pictures come on top
  --sync-reads     with --live, --virtual or without a mode: each frame reads what its front lacks and waits for it, and
                   nothing is fetched ahead; waited_s in the report tells how long frames stood still (by a clock:
                   lock-step has none)

Storage models: latency in ms, MB (10^6 bytes) a second in all, requests served at once:
  hdd 10,120,1 (seeks only)   ssd 0.1,500,8   lan 2,100,6   wan 60,5,6   mobile 150,1,4

Policies (--policy): what is fetched ahead of the front, and in which order
  demand           nothing: the front only
  front            a view that is widened as it turns, by priority (Varadhan & Manocha 2002)
  range            all that an observer may reach within the next frames (Funkhouser 1996)
  vgis             the front where the eye will be after the lead time (Davis et al. 1999)
  foresight        the default: by expected fall of detail debt per byte over the views that are foretold
  oracle           as foresight, told the path: what no real flight knows
Their parameters are JSON (--policy-params), by policy; names that do not exist are errors that tell which do:
  {\"foresight\": {\"views\": 5, \"reach_s\": 2, \"trust_s\": 1}, \"vgis\": {\"leads\": 1.5}}

Files:
  DIR/t0012.00.png         the picture at 12 s (--frames)
  DIR/t0012.00.ids.npy     with --aov: NumPy u32, height x width, rows from the top: what each pixel shows; 0 is the sky
  DIR/t0012.00.ids.json    what those ids stand for: {\"17\": {\"cell\": \"12/3/1/5\"}, \"9\": {\"collection\": \"houses\", \"object\": 4}}
  DIR/t0012.00.depth.npy   NumPy f32: metres from the eye along the view direction; inf is the sky
  FILE.json                the report (--report); frames.csv and timings.csv are written beside it

The flight is JSON: {\"fovy_deg\": 60, \"hz\": 60, \"columns\": [\"t_s\", \"lon_deg\", \"lat_deg\", \"height_m\", \"heading_deg\",
\"pitch_deg\"], \"samples\": [[0, -84.4, 33.7, 1e7, 0, -90], ...]}; heights are metres above the WGS84 ellipsoid.

Faults (--faults), each optional, commas between them, drawn by --seed; seconds count from the first frame:
  errors=SHARE      so many of the reads fail, 0 to 1; another attempt may succeed
  corrupt=SHARE     so many of the pages are stored wrong for good, 0 to 1
  spike_ms=MS       so late are some requests, 0 to 600000
  spikes=SHARE      how many of them, 0 to 1 [default: 0.01 with spike_ms]
  die_s=S           the server dies then, and reads fail after 2 s
  revive_s=S        and is there again then [default: never]
  halve_s=S         from then on the bandwidth is half

Examples:
  stoop fly WORLD --path dive.json --frames pictures --at-secs 0,12,18 --report report.json
  stoop fly WORLD --path dive.json --live --size 1280x720 --footprint 512MiB --report live.json
  stoop fly WORLD --path dive.json --live --storage wan --faults errors=0.01,spike_ms=2000 --seed 7 --report wan.json
  stoop fly WORLD --path dive.json --virtual wan --report wan.json
  stoop fly WORLD --path dive.json --virtual 20,50,4 --policy vgis --no-level-skip --report levels.json
  stoop fly WORLD --path dive.json --virtual mobile --frames pictures --at-secs 5,15 --audit 0
  stoop fly WORLD --path dive.json --live --sync-reads --report waits.json
  stoop fly WORLD --path dive.json --live --profile charts/profile.json --report live.json
  stoop fly WORLD --path dive.json --virtual ssd --modelled 30 --report modelled.json
  stoop fly WORLD --path dive.json --policy foresight --policy-params params.json --report tuned.json
  stoop fly WORLD --path dive.json --settled --tolerance-px 0.25 --frames reference --every-secs 1";

const PARAMS_EXAMPLE: &str = r#"{"foresight": {"reach_s": 2}}"#;

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum ObjectsArgument {
    /// No objects
    Off,
    /// All objects of the cells in view, without thresholds
    Flat,
    /// Objects above the threshold, by cell
    Cells,
    /// As cells, with groups for small objects where the world has them
    Groups,
}

#[derive(clap::Args)]
#[command(after_help = DETAILS)]
pub struct Arguments {
    /// Folders or addresses (http://, https://, s3://) of worlds; several lie over one another, the first one uppermost
    #[arg(value_name = "WORLD", required = true)]
    worlds: Vec<PathBuf>,
    #[command(flatten)]
    cache: cli::CacheArguments,
    /// The flight, JSON
    #[arg(long, value_name = "FILE")]
    path: PathBuf,
    /// Pixels
    #[arg(long, default_value = "640x360")]
    size: cli::SizePx,
    /// Follow the real clock
    #[arg(long, group = "mode")]
    live: bool,
    /// Wait in every frame until nothing is left to load
    #[arg(long, group = "mode")]
    settled: bool,
    /// Follow a virtual clock over a storage model: hdd, ssd, lan, wan, mobile, or LATENCY_MS,MB_PER_S,PARALLEL
    #[arg(long = "virtual", value_name = "STORAGE", group = "mode")]
    virtual_storage: Option<StorageModel>,
    /// Seconds from frame to frame [default: 1/hz of the flight; not with --live]
    #[arg(long, value_name = "S", value_parser = cli::positive, conflicts_with = "live")]
    step_secs: Option<f64>,
    /// What is fetched, and in which order: demand (the front only), front, range, vgis, foresight, oracle (knows the
    /// path); --settled and --sync-reads fetch the front alone, whatever the policy
    #[arg(long, value_name = "NAME", default_value_t)]
    policy: PolicyName,
    /// Parameters of policies, JSON, by policy: {"foresight": {"reach_s": 2}}; what is left out has its default
    #[arg(long, value_name = "FILE")]
    policy_params: Option<PathBuf>,
    /// Fly by this single-seek layout of the world: what the next place needs comes in one read
    #[arg(long, value_name = "NAME")]
    layout: Option<String>,
    /// Load intermediate levels too, each page after its parent; otherwise a page that would be passed before it
    /// arrives is not asked for
    #[arg(long)]
    no_level_skip: bool,
    /// Each frame reads what it lacks and waits for it, and nothing is fetched ahead: the baseline to compare with; not
    /// with --settled, which waits anyway
    #[arg(long, conflicts_with = "settled")]
    sync_reads: bool,
    /// With --live, hold reads back to a storage model: hdd, ssd, lan, wan, mobile, or milliseconds from request to
    /// first byte, MB (10^6 bytes) a second, and requests served at once
    #[arg(long, value_name = "NAME|LATENCY_MS,MB_PER_S,PARALLEL")]
    storage: Option<StorageModel>,
    /// Make reads go wrong: with --virtual, or with --live over --storage or over the disk as it is; see below
    #[arg(long, value_name = "KEY=VALUE,...")]
    faults: Option<Faults>,
    /// Seed of --faults: whom they hit
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Take tolerance and footprint, and with --live the frame time, from a profile as stoop-chart writes it; flags win
    #[arg(long, value_name = "FILE.json")]
    profile: Option<PathBuf>,
    /// Allowed screen-space error, pixels of the given size [default: the profile's, else 1]
    #[arg(long, value_parser = cli::positive)]
    tolerance_px: Option<f64>,
    /// Hard limit of the bytes held for pages, GPU arenas, decoding and index [default: the profile's, else 256MiB]
    #[arg(long, value_parser = cli::bytes)]
    footprint: Option<ByteSize>,
    /// Hold this frame time by drawing coarser; with --live
    #[arg(long, value_name = "MS", value_parser = cli::positive, requires = "live")]
    frame_ms: Option<f64>,
    /// How objects are drawn
    #[arg(long, value_enum, default_value = "groups")]
    objects: ObjectsArgument,
    /// Objects that project smaller are neither drawn nor read, pixels; a second value is for single objects where
    /// groups stand in for them, which VGIS has at 10; without it groups stand in by their errors
    #[arg(long, value_name = "PX[,PX]", default_value = "1", value_delimiter = ',', value_parser = cli::positive)]
    threshold_px: Vec<f64>,
    /// Write pictures into this folder: of every frame, or when --at-secs or --every-secs say
    #[arg(long, value_name = "DIR")]
    frames: Option<PathBuf>,
    /// Pictures at these times of the flight, seconds
    #[arg(long, value_name = "S,...", value_delimiter = ',', value_parser = cli::number, conflicts_with = "every_secs")]
    at_secs: Vec<f64>,
    /// A picture each so many seconds
    #[arg(long, value_name = "S", value_parser = cli::positive)]
    every_secs: Option<f64>,
    /// Also write ids and depth of each picture into this folder
    #[arg(long, value_name = "DIR")]
    aov: Option<PathBuf>,
    /// Count holes against the settled frame in every Nth frame; 0 never [default: 1 with --frames and not --live, else 0]
    #[arg(long, value_name = "N")]
    audit: Option<u32>,
    /// With --virtual, measure over-modelling in every Nth frame: what is drawn and held over what the picture needs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    modelled: Option<u32>,
    /// Write a video with the program ffmpeg
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// Write the report here, and frames.csv and timings.csv beside it
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
}

impl Arguments {
    fn check_combinations(&self) -> anyhow::Result<()> {
        let timed = !self.at_secs.is_empty() || self.every_secs.is_some();
        if timed && self.frames.is_none() && self.aov.is_none() {
            return Err(WrongUsage(
                "--at-secs and --every-secs choose pictures: name a folder by --frames or --aov".into(),
            )
            .into());
        }
        if !self.live && self.storage.is_some() {
            return Err(
                WrongUsage("--storage is for the real clock: add --live, or name it by --virtual".into()).into()
            );
        }
        if !self.live && self.virtual_storage.is_none() && self.faults.is_some() {
            return Err(WrongUsage("--faults needs a clock: add --live or --virtual STORAGE".into()).into());
        }
        if self.virtual_storage.is_none() && self.modelled.is_some() {
            return Err(WrongUsage("--modelled is for the virtual clock: add --virtual STORAGE".into()).into());
        }
        if self.threshold_px.len() > 2 {
            return Err(WrongUsage("--threshold-px takes one number or two".into()).into());
        }
        Ok(())
    }

    /// Takes from the profile what no flag says.
    fn take_profile(&mut self) -> anyhow::Result<()> {
        let Some(file) = &self.profile else { return Ok(()) };
        let profile = Profile::load(file)?;
        self.tolerance_px = self.tolerance_px.or(profile.tolerance_px);
        self.footprint = self.footprint.or(profile.footprint());
        self.frame_ms = self.frame_ms.or(profile.frame_ms.filter(|_| self.live));
        Ok(())
    }

    fn tolerance_px(&self) -> f64 {
        self.tolerance_px.unwrap_or(EngineParams::default().tolerance_px)
    }

    fn footprint(&self) -> ByteSize {
        self.footprint.unwrap_or(EngineParams::default().footprint)
    }

    fn mode(&self) -> Mode {
        match (self.live, self.settled) {
            (true, _) => Mode::Live,
            (_, true) => Mode::Settled,
            _ => Mode::LockStep,
        }
    }

    fn audit_every(&self) -> u32 {
        self.audit.unwrap_or(u32::from(self.frames.is_some() && !self.live))
    }

    fn planner(&self) -> anyhow::Result<PlannerParams> {
        let params = match &self.policy_params {
            None => PolicyParams::default(),
            Some(file) => {
                let text = std::fs::read_to_string(file)
                    .with_context(|| format!("cannot read the policies' parameters {}", file.display()))?;
                serde_json::from_str(&text).with_context(|| {
                    format!("{}: no parameters of policies; write for example {PARAMS_EXAMPLE}", file.display())
                })?
            }
        };
        Ok(PlannerParams { policy: self.policy, params, level_skip: !self.no_level_skip })
    }

    fn params(&self) -> anyhow::Result<EngineParams> {
        Ok(EngineParams {
            tolerance_px: self.tolerance_px(),
            threshold_px: self.threshold_px.first().copied().unwrap_or(1.0),
            objects: match self.objects {
                ObjectsArgument::Off => ObjectsMode::Off,
                ObjectsArgument::Flat => ObjectsMode::Flat,
                ObjectsArgument::Cells => ObjectsMode::Cells,
                ObjectsArgument::Groups => match self.threshold_px.get(1) {
                    Some(&single_px) => ObjectsMode::Vgis { single_px },
                    None => ObjectsMode::Groups,
                },
            },
            hidden: CollectionSet::NONE,
            footprint: self.footprint(),
            frame_ms: self.frame_ms,
            mode: self.mode(),
            planner: self.planner()?,
            storage: self.storage,
            faults: self.faults.unwrap_or(Faults::NONE),
            seed: self.seed,
            sync_reads: self.sync_reads,
        })
    }

    fn picture_times(&self) -> PictureTimes {
        match (self.frames.is_some() || self.aov.is_some(), self.every_secs) {
            (false, _) => PictureTimes::Never,
            (true, Some(every_s)) => PictureTimes::every(every_s),
            (true, None) if self.at_secs.is_empty() => PictureTimes::Always,
            (true, None) => PictureTimes::at(self.at_secs.clone()),
        }
    }
}

/// The worlds, and the layout that is to be flown by; one that cannot be is said, and the packs serve.
fn open(arguments: &Arguments) -> anyhow::Result<Source> {
    let Some(name) = &arguments.layout else { return cli::open(&arguments.worlds, &arguments.cache) };
    let [world] = &arguments.worlds[..] else {
        return Err(WrongUsage("--layout belongs to one world: name one".into()).into());
    };
    let (source, refused) = Source::with_layout(cli::open_world(world, &arguments.cache)?, name);
    if let Some(refused) = refused {
        eprintln!("stoop: {refused}; the packs serve");
    }
    Ok(source)
}

pub fn run(mut arguments: Arguments) -> anyhow::Result<ExitCode> {
    arguments.check_combinations()?;
    arguments.take_profile()?;
    let path = FlightPath::load(&arguments.path)?;
    let opened = Instant::now();
    let source = open(&arguments)?;
    if let Some(storage) = arguments.virtual_storage {
        return virtual_clock::fly(&arguments, path, source, storage);
    }
    let mut engine = Engine::new(source, arguments.params()?)?;
    if arguments.policy == PolicyName::Oracle {
        let known = path.clone();
        engine.set_way(Some(Arc::new(move |t_s| known.at(t_s))));
    }
    let step_s = arguments.step_secs.unwrap_or(1.0 / path.hz());
    let mut flight = Flight {
        outputs: Outputs::create(&arguments, step_s)?,
        log: FlightLog::new(header(&arguments, &path, engine.source(), engine.mode().name())),
        progress: Progress::new(path.end_s()),
        audit_every: arguments.audit_every(),
        size_px: arguments.size.0,
        opened,
        path,
        engine,
    };
    if arguments.live {
        flight.fly_live()?
    } else {
        flight.fly_stepped(step_s)?
    }
    flight.finish(arguments.report.as_deref())
}

fn header(arguments: &Arguments, path: &FlightPath, source: &Source, mode: &str) -> FlightHeader {
    let ground = GroundProbe::new(source);
    FlightHeader {
        world: source.manifest.name.clone(),
        mode: mode.to_owned(),
        policy: arguments.policy.to_string(),
        size_px: arguments.size.0,
        tolerance_px: arguments.tolerance_px(),
        footprint_limit_bytes: arguments.footprint().0,
        arrivals_s: path.arrivals_s(|lat_rad, lon_rad| ground.height_m(lat_rad, lon_rad)),
    }
}

/// Whether the frame after so many is one of every so many; 0 is none.
fn is_audited(every: u32, frames: usize) -> bool {
    every > 0 && (frames as u64).is_multiple_of(u64::from(every))
}

struct Flight {
    path: FlightPath,
    engine: Engine,
    outputs: Outputs,
    log: FlightLog,
    progress: Progress,
    audit_every: u32,
    size_px: [u32; 2],
    opened: Instant,
}

impl Flight {
    /// Frames at fixed steps from the flight's start to its end.
    fn fly_stepped(&mut self, step_s: f64) -> anyhow::Result<()> {
        // A step that divides the flight must reach its end in spite of rounding.
        let frames = (self.path.duration_s() / step_s + 1e-6).floor() as u64 + 1;
        for frame in 0..frames {
            self.fly_frame(self.path.start_s() + frame as f64 * step_s)?;
        }
        Ok(())
    }

    /// Frames as fast as they go; the last one shows the flight's end.
    fn fly_live(&mut self) -> anyhow::Result<()> {
        let mut clock = schedule::FlightClock::start();
        loop {
            let t_s = (self.path.start_s() + clock.elapsed_s()).min(self.path.end_s());
            let aside_s = self.fly_frame(t_s)?;
            clock.pause(aside_s);
            if t_s >= self.path.end_s() {
                return Ok(());
            }
        }
    }

    /// One frame with its pictures; returns the seconds spent beside flying.
    fn fly_frame(&mut self, t_s: f64) -> anyhow::Result<f64> {
        let view = View::new(self.path.at(t_s), self.path.fovy_rad(), self.size_px);
        let due = self.outputs.due(t_s);
        let audit = is_audited(self.audit_every, self.log.frames.len());
        let request = FrameRequest { view, t_s, ids: audit || due.wants_aov() };
        let mut report = self.engine.frame(&request)?;
        let drawn = Instant::now();
        if self.log.frames.is_empty() {
            self.log.first_frame_ms = Some(self.opened.elapsed().as_secs_f64() * 1000.0);
        }
        if audit {
            self.engine.audit(&request, &mut report)?;
        }
        self.outputs.write(self.engine.picture(), due, self.size_px)?;
        for failure in self.engine.take_failures() {
            eprintln!("stoop: at {t_s:.2} s: {failure}; flying on with coarser detail");
        }
        self.log.frames.push(report);
        self.progress.at(t_s);
        Ok(drawn.elapsed().as_secs_f64())
    }

    fn finish(mut self, report: Option<&std::path::Path>) -> anyhow::Result<ExitCode> {
        self.progress.end();
        self.outputs.finish()?;
        self.log.wasted_bytes = self.engine.wasted_bytes();
        self.log.ride = self.engine.ride_counts();
        if let Some(file) = report {
            self.log.write(file)?;
        }
        schedule::print_summary(&self.log.summary(), self.engine.adapter_name());
        Ok(ExitCode::SUCCESS)
    }
}
