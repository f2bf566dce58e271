//! One simulation from a specification to an output folder: series, frames, checkpoints, plots, summary.

mod beds;
mod digest;
mod plots;
mod recorder;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glebe_engine::backend::{Backend, Unavailable};
use glebe_engine::batch::{Batch, Status};
use glebe_engine::spec::{Component, Measure, WorldSpec};
use glebe_engine::state::{MeasureState, Progress, StageResult, State};
use glebe_engine::{BytesError, Constants, SetupError, prepare};
use glebe_io::checkpoint::{self, CheckpointError, CheckpointWriter, Header};
use glebe_io::output::summary::{self, Summary};
use glebe_io::output::{OutputDir, OutputError};

pub use beds::default_folder as default_bed_folder;

use self::beds::Bed;
use self::plots::Furrows;
use self::recorder::Recorder;
use crate::device::admit;

/// How a run is to be done.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The output folder.
    pub out: PathBuf,
    /// What computes.
    pub backend: Backend,
    /// What is done with results that are there.
    pub existing: Existing,
    /// Where settled beds are kept; none to keep none.
    pub beds: Option<PathBuf>,
    /// Wall time between checkpoints.
    pub checkpoint_every: Duration,
    /// Simulated time between checkpoints \[s\], if asked for.
    pub checkpoint_time: Option<f64>,
    /// Warnings that the user was given before the run, for the summary.
    pub warnings: Vec<String>,
}

impl Settings {
    /// A new run on the CPU into the folder `out`, with a checkpoint each minute and no kept beds.
    pub fn new(out: impl Into<PathBuf>) -> Self {
        Self {
            out: out.into(),
            backend: Backend::Cpu,
            existing: Existing::Refuse,
            beds: None,
            checkpoint_every: Duration::from_secs(60),
            checkpoint_time: None,
            warnings: Vec::new(),
        }
    }
}

/// What is done with the results of an earlier run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// They stay, and nothing is run.
    Refuse,
    /// They are removed.
    Replace,
    /// They are continued from the last good checkpoint.
    Resume,
}

/// Follows a run.
pub trait Listener {
    /// A line for the log.
    fn note(&mut self, _line: &str) {}
    /// Something the user should know; it is also in the summary.
    fn warn(&mut self, _line: &str) {}
    /// The run goes on.
    fn pulse(&mut self, _pulse: &Pulse<'_>) {}
    /// Whether the run shall stop at the next sample, with a checkpoint.
    fn interrupted(&self) -> bool {
        false
    }
}

/// A [`Listener`] that does not.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Listener for Silent {}

/// How a run stands, at every sample.
#[derive(Clone, Copy, Debug)]
pub struct Pulse<'a> {
    /// The world's constants.
    pub constants: &'a Constants,
    /// Its progress.
    pub progress: &'a Progress,
    /// Steps since the run was started or resumed.
    pub steps: u64,
    /// Particles × steps since then.
    pub particle_steps: f64,
    /// Kinetic energy \[J\].
    pub kinetic: f64,
}

/// Why a run was not done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The world cannot be set up.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The backend cannot run the world.
    #[error(transparent)]
    Device(#[from] Unavailable),
    /// The output folder cannot be used, or writing failed.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A checkpoint cannot be used or written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A checkpoint's content is not a state of this program.
    #[error("{path}: {source}; start the run again with --force")]
    State {
        /// The checkpoint.
        path: PathBuf,
        /// What is wrong.
        source: BytesError,
    },
}

impl RunError {
    /// Whether what was given is at fault, rather than what happened after the start.
    pub fn is_input(&self) -> bool {
        match self {
            Self::Setup(_) | Self::Device(_) | Self::State { .. } => true,
            Self::Output(e) => matches!(
                e,
                OutputError::NotEmpty { .. }
                    | OutputError::NotAFolder { .. }
                    | OutputError::NothingToResume { .. }
            ),
            Self::Checkpoint(e) => !matches!(e, CheckpointError::Output(_)),
        }
    }
}

/// Runs all stages of a world, or those that are left, and writes everything into the output folder.
///
/// A world that fails is no error here: its summary says so.
///
/// # Errors
/// A world that cannot be set up or that the backend cannot run, a folder that cannot be used, a checkpoint of another scene, a full disk.
pub fn run(world: WorldSpec, settings: &Settings, listener: &mut dyn Listener) -> Result<Summary, RunError> {
    let (constants, fresh) = prepare(world)?;
    admit(settings.backend, [&*constants])?;
    let scene_hash = digest::scene_hash(&constants, &fresh);
    for warning in &constants.warnings {
        listener.warn(warning);
    }
    let mut warnings = [settings.warnings.as_slice(), &constants.warnings].concat();
    let mut notes = Vec::new();
    let mut note = |line: String, listener: &mut dyn Listener| {
        listener.note(&line);
        notes.push(line);
    };

    let vacant = OutputDir::is_vacant(&settings.out)?;
    let (dir, state, after) = if settings.existing == Existing::Resume && !vacant {
        let dir = OutputDir::open_existing(&settings.out)?;
        let found = checkpoint::latest_valid(&dir.checkpoints(), &scene_hash)?;
        for line in found.skipped.iter().cloned().chain(strangeness(&found.header, settings.backend)) {
            listener.warn(&line);
            warnings.push(line);
        }
        let state = State::from_bytes(&found.state)
            .and_then(|state| state.belongs_to(&constants).map(|()| state))
            .map_err(|source| RunError::State { path: found.path.clone(), source })?;
        if state.progress.stage >= constants.spec.stages.len()
            && let Ok(summary) = Summary::read(&dir.summary())
            && summary.state_hash == state.hash()
        {
            note("this run is complete: nothing was left to do".to_owned(), listener);
            return Ok(summary);
        }
        note(format!("resumed at t = {:.6} s (step {})", found.header.time, found.header.step), listener);
        (dir, state, Some(found))
    } else {
        let dir = OutputDir::create(&settings.out, settings.existing == Existing::Replace)?;
        if settings.existing == Existing::Resume {
            note("nothing was kept before the run ended: it begins again".to_owned(), listener);
        }
        (dir, fresh, None)
    };

    // Only now: an input that is refused costs no time.
    let mut state = state;
    let mut bed = None;
    if after.is_none() {
        bed =
            settings.beds.as_deref().and_then(|folder| Bed::of(&constants, &state, settings.backend, folder));
        if let Some((kept, stages)) = bed.as_ref().and_then(|b| Some((b.load(&constants)?, b.stages))) {
            state = kept;
            bed = None;
            let names: Vec<_> = constants.spec.stages[..stages].iter().map(|s| s.name.as_str()).collect();
            let line = format!(
                "the state after `{}` was taken from an earlier run (t = {:.6} s); --no-cache computes it",
                names.join("`, `"),
                state.progress.step as f64 * constants.dt
            );
            note(line, listener);
        }
    }
    let mut checkpoints =
        CheckpointWriter::new(&dir.checkpoints(), after.as_ref().map(|c| c.path.as_path()))?;
    if after.is_none() {
        // Before there is anything else in the folder, so that a run killed at any moment can be resumed.
        let header = header(&constants, &scene_hash, settings.backend, state.progress.step, (0, 0));
        checkpoints.write(&header, &state.to_bytes())?;
    }
    let counts = after.as_ref().map(|c| (c.header.rows, c.header.frames));
    let run = Run {
        recorder: Recorder::new(&dir, &constants, counts)?,
        checkpoints,
        furrows: Furrows::default(),
        batch: Batch::from_states(vec![(constants.clone(), state)], settings.backend),
        constants,
        scene_hash,
        dir,
        bed,
        started: Instant::now(),
        steps: 0,
        particle_steps: 0.0,
    };
    run.finish(settings, listener, warnings, notes)
}

struct Run {
    constants: Arc<Constants>,
    scene_hash: String,
    dir: OutputDir,
    batch: Batch,
    recorder: Recorder,
    checkpoints: CheckpointWriter,
    furrows: Furrows,
    /// To be stored when its stages have ended.
    bed: Option<Bed>,
    started: Instant,
    steps: u64,
    particle_steps: f64,
}

impl Run {
    fn finish(
        mut self,
        settings: &Settings,
        listener: &mut dyn Listener,
        mut warnings: Vec<String>,
        notes: Vec<String>,
    ) -> Result<Summary, RunError> {
        let mut written = Instant::now();
        let mut written_at = self.batch.time(0);
        while self.batch.running() && !listener.interrupted() {
            let (step, ended) = (self.batch.progress(0).step, self.batch.progress(0).results.len());
            self.batch.advance(&mut self.recorder)?;
            self.furrows.look(&self.batch);
            let progress = self.batch.progress(0);
            let steps = progress.step - step;
            self.steps += steps;
            self.particle_steps += steps as f64 * self.batch.particles(0) as f64;
            let stage_ended = progress.results.len() > ended;
            for result in &progress.results[ended..] {
                listener.note(&told(result, &self.constants));
                for doubt in doubts(result, &self.constants) {
                    listener.warn(&doubt);
                }
            }
            listener.pulse(&Pulse {
                constants: &self.constants,
                progress,
                steps: self.steps,
                particle_steps: self.particle_steps,
                kinetic: self
                    .recorder
                    .last
                    .as_ref()
                    .map_or(0.0, |s| s.ledger.translation + s.ledger.rotation),
            });
            if matches!(self.batch.status(0), Status::Failed(_)) {
                break;
            }
            if stage_ended {
                self.keep_bed(listener, &mut warnings);
            }
            let due = settings.checkpoint_time.is_some_and(|dt| self.batch.time(0) - written_at >= dt);
            if stage_ended || due || written.elapsed() >= settings.checkpoint_every {
                self.checkpoint()?;
                (written, written_at) = (Instant::now(), self.batch.time(0));
            }
        }
        if *self.batch.status(0) == Status::Running {
            self.checkpoint()?;
        }
        let furrows = std::mem::take(&mut self.furrows);
        let results = &self.batch.progress(0).results;
        plots::write(&self.dir, &self.constants, results, &furrows)?;
        // Of all stages, so that a run in parts ends with the same warnings as a whole one.
        warnings.extend(results.iter().flat_map(|result| doubts(result, &self.constants)));
        let summary = self.summary(warnings, notes);
        summary.write(&self.dir.summary())?;
        Ok(summary)
    }

    fn checkpoint(&mut self) -> Result<(), RunError> {
        let start = Instant::now();
        let state = self.batch.state(0);
        if self.batch.fault(0).is_some() {
            // The last good one is worth more; the next step tells of the fault.
            return Ok(());
        }
        let written = self.recorder.counts()?;
        let step = state.progress.step;
        let header = header(&self.constants, &self.scene_hash, self.batch.backend(), step, written);
        self.checkpoints.write(&header, &state.to_bytes())?;
        self.recorder.time += start.elapsed();
        Ok(())
    }

    /// Keeps the bed when the last of its stages has just ended. A cache that cannot be written is told of
    /// and does not stop the run.
    fn keep_bed(&mut self, listener: &mut dyn Listener, warnings: &mut Vec<String>) {
        let stage = self.batch.progress(0).stage;
        if let Some(bed) = self.bed.take_if(|bed| bed.stages <= stage)
            && bed.stages == stage
            && let Err(error) = bed.store(self.batch.state(0))
        {
            let line = format!("the settled bed was not kept for later runs: {error}");
            listener.warn(&line);
            warnings.push(line);
        }
    }

    fn summary(&self, warnings: Vec<String>, notes: Vec<String>) -> Summary {
        let (c, g) = (&self.constants, self.batch.progress(0));
        let (status, reason) = match self.batch.status(0) {
            Status::Done => (summary::Status::Done, None),
            Status::Failed(failure) => (summary::Status::Failed, Some(failure.to_string())),
            Status::Running => (summary::Status::Interrupted, Some("stopped by the user".to_owned())),
        };
        let wall_s = self.started.elapsed().as_secs_f64();
        let mut phases: std::collections::BTreeMap<String, f64> =
            self.batch.times(0).rows().iter().map(|(name, s)| ((*name).to_owned(), *s)).collect();
        phases.insert("output".to_owned(), self.recorder.time.as_secs_f64());
        Summary {
            title: c.spec.title.clone(),
            status,
            reason,
            provenance: summary::Provenance {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                commit: option_env!("GLEBE_COMMIT").map(str::to_owned),
                scene_hash: self.scene_hash.clone(),
                seed: c.spec.seed,
            },
            device: self.batch.backend().device(),
            state_hash: self.batch.state(0).hash(),
            particles: summary::Particles {
                count: self.batch.particles(0) as u64,
                lost: g.lost.iter().map(lost).collect(),
                removed: g.results.iter().map(|r| r.trimmed).sum::<u64>() + g.trimmed,
            },
            stages: stages(c, g),
            performance: summary::Performance {
                particle_steps_per_second: self.particle_steps / wall_s,
                wall_s,
                steps: self.steps,
                phases,
            },
            warnings,
            notes,
        }
    }
}

/// What a checkpoint after `step` says of itself, with so many rows and frames written.
fn header(
    c: &Constants,
    scene_hash: &str,
    backend: Backend,
    step: u64,
    (rows, frames): (u64, u64),
) -> Header {
    Header {
        glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
        device: backend.maker(),
        scene_hash: scene_hash.to_owned(),
        step,
        time: step as f64 * c.dt,
        rows,
        frames,
    }
}

/// Why a run that goes on from a checkpoint may end with other bits than a whole one.
fn strangeness(header: &Header, backend: Backend) -> Vec<String> {
    let mut lines = Vec::new();
    let (version, device) = (env!("CARGO_PKG_VERSION"), backend.maker());
    if header.glebe_version != version {
        lines.push(format!(
            "the checkpoint was written by glebe {}; this is {version}: results may differ in the last digits",
            header.glebe_version
        ));
    }
    if !header.device.is_empty() && header.device != device {
        lines.push(format!(
            "the checkpoint was computed on {}; this is {device}: bits are the same on one device only, so the \
             run will end with other bits than on {} alone",
            header.device, header.device
        ));
    }
    lines
}

fn lost(l: &glebe_engine::state::Lost) -> summary::Lost {
    let side = format!("{}{}", ['-', '+'][l.side[1]], ['x', 'y', 'z'][l.side[0]]);
    summary::Lost { id: l.id, time: l.time, position: l.position, side }
}

fn stages(c: &Constants, g: &Progress) -> Vec<summary::Stage> {
    let mut start = 0.0;
    let stage = |(spec, result): (&glebe_engine::spec::Stage, &StageResult)| {
        let measures = spec.measures.iter().zip(&result.measures).map(|(measure, m)| {
            let [mean, std] = if m.n == 0 { [f64::NAN; 2] } else { [m.mean, m.std()] };
            (measure.name.clone(), summary::Measure { mean, std, n: m.n })
        });
        let stage = summary::Stage {
            name: result.name.clone(),
            ended_by: result.ended_by.clone(),
            start,
            duration: result.time - start,
            measures: measures.collect(),
        };
        start = result.time;
        stage
    };
    c.spec.stages.iter().zip(&g.results).map(stage).collect()
}

/// A line about a stage that ended.
fn told(result: &StageResult, c: &Constants) -> String {
    let mut line = format!("stage `{}` ended at t = {:.4} s ({})", result.name, result.time, result.ended_by);
    // Writing to a string cannot fail.
    if result.trimmed > 0 {
        let _ = write!(line, ", {} particles removed", result.trimmed);
    }
    let spec = c.spec.stages.iter().find(|s| s.name == result.name);
    for (measure, m) in spec.iter().flat_map(|s| &s.measures).zip(&result.measures) {
        let _ = match m.n {
            0 => write!(line, "; {}: nothing measured", measure.name),
            n => write!(line, "; {} = {:.5} ± {:.3} ({n} steps)", measure.name, m.mean, m.std()),
        };
    }
    line
}

/// Measures of a stage that ended which measured nothing.
fn doubts(result: &StageResult, c: &Constants) -> Vec<String> {
    let Some(spec) = c.spec.stages.iter().find(|s| s.name == result.name) else { return Vec::new() };
    let doubt = |(measure, m): (&Measure, &MeasureState)| {
        let surface = &c.spec.surfaces.get(measure.surface)?.name;
        let why = if m.n == 0 {
            "measured nothing: its window was not reached; lengthen the stage or move the window".to_owned()
        } else if measure.component == Component::Draught && m.mean == 0.0 && m.m2 == 0.0 {
            format!("is 0 throughout: `{surface}` did not move, or nothing touched it")
        } else {
            return None;
        };
        Some(format!("stage `{}`: `{}` of `{surface}` {why}", result.name, measure.name))
    };
    spec.measures.iter().zip(&result.measures).filter_map(doubt).collect()
}
