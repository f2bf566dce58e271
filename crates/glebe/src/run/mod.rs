//! One simulation from a specification to an output folder: series, frames, checkpoints, plots, summary.

mod fields;
mod network;
mod plots;
mod recorder;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glebe_engine::backend::{Backend, Unavailable};
use glebe_engine::batch::Status;
use glebe_engine::spec::WorldSpec;
use glebe_engine::state::State;
use glebe_engine::{BytesError, Constants, SetupError, prepare};
use glebe_io::checkpoint::{self, CheckpointError, CheckpointWriter, Header};
pub use glebe_io::output::Existing;
use glebe_io::output::summary::{self, Summary};
use glebe_io::output::{OutputDir, OutputError};

pub use glebe_study::default_bed_folder;
use glebe_study::drive::{Drive, Event, Outcome, blocked, doubts, told};
pub use glebe_study::drive::{Listener, Pulse, Silent};
use glebe_study::scene_hash;

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
    /// Whether checkpoints hold what contacts remember.
    pub checkpoint_history: bool,
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
            checkpoint_history: true,
            warnings: Vec::new(),
        }
    }
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
            Self::Output(e) => e.is_input(),
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
    admit(settings.backend, std::slice::from_ref(&constants))?;
    let scene_hash = scene_hash(&constants, &fresh);
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
        let (state, _) = found.parts();
        let state = State::from_bytes(state)
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

    let mut checkpoints =
        CheckpointWriter::new(&dir.checkpoints(), after.as_ref().map(|c| c.path.as_path()))?;
    if after.is_none() {
        // Before there is anything else in the folder, so that a run killed at any moment can be resumed.
        let header = header(&constants, &scene_hash, settings.backend, state.progress.step, (0, 0));
        checkpoints.write(&header, &state.to_bytes())?;
    }
    // Only now: an input that is refused costs no time.
    let beds = settings.beds.as_deref();
    let (drive, events) = Drive::new(vec![(constants.clone(), state)], settings.backend, beds);
    for event in events {
        if let Event::Reused(_, line) = event {
            note(line, listener);
        }
    }
    if constants.spec.network {
        note(network::legend(&constants), listener);
    }
    let counts = after.as_ref().map(|c| (c.header.rows, c.header.frames, c.parts().1));
    let run = Run {
        recorder: Recorder::new(&dir, &constants, counts)?,
        checkpoints,
        furrows: Furrows::default(),
        drive,
        constants,
        scene_hash,
        dir,
    };
    run.finish(settings, listener, warnings, notes)
}

struct Run {
    constants: Arc<Constants>,
    scene_hash: String,
    dir: OutputDir,
    drive: Drive,
    recorder: Recorder,
    checkpoints: CheckpointWriter,
    furrows: Furrows,
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
        let mut written_at = self.drive.batch().time(0);
        while self.drive.batch().running() && !listener.interrupted() {
            let events = self.drive.advance(&mut self.recorder)?;
            self.furrows.look(self.drive.batch());
            let mut stage_ended = false;
            for event in events {
                match event {
                    Event::StageEnded(_, result) => {
                        stage_ended = true;
                        listener.note(&told(&result, &self.constants));
                        for doubt in doubts(&result, &self.constants) {
                            listener.warn(&doubt);
                        }
                    }
                    Event::NotKept(_, line) => {
                        listener.warn(&line);
                        warnings.push(line);
                    }
                    _ => {}
                }
            }
            let last = self.recorder.last.as_ref();
            let kinetic = last.map(|s| s.ledger.translation + s.ledger.rotation);
            listener.pulse(&Pulse { drive: &self.drive, kinetic, worlds: 1, ended: 0, later: 0 });
            let batch = self.drive.batch();
            if matches!(batch.status(0), Status::Failed(_)) {
                break;
            }
            let due = settings.checkpoint_time.is_some_and(|dt| batch.time(0) - written_at >= dt);
            if stage_ended || due || written.elapsed() >= settings.checkpoint_every {
                self.checkpoint(settings)?;
                (written, written_at) = (Instant::now(), self.drive.batch().time(0));
            }
        }
        if *self.drive.batch().status(0) == Status::Running {
            self.checkpoint(settings)?;
        }
        let furrows = std::mem::take(&mut self.furrows);
        let results = &self.drive.batch().progress(0).results;
        plots::write(&self.dir, &self.constants, results, &furrows)?;
        // Of all stages, so that a run in parts ends with the same warnings as a whole one.
        warnings.extend(results.iter().flat_map(|result| doubts(result, &self.constants)));
        warnings.extend(blocked(&self.constants, self.drive.batch().progress(0)));
        let summary = self.summary(warnings, notes);
        summary.write(&self.dir.summary())?;
        Ok(summary)
    }

    fn checkpoint(&mut self, settings: &Settings) -> Result<(), RunError> {
        let start = Instant::now();
        let batch = self.drive.batch();
        let Ok(mut state) = batch.sound_state(0) else {
            // The last good one is worth more; the next step tells of the fault.
            return Ok(());
        };
        let written = self.recorder.counts()?;
        let step = state.progress.step;
        let mut header = header(&self.constants, &self.scene_hash, batch.backend(), step, written);
        // The last one is what the run ended with.
        if !settings.checkpoint_history && batch.running() {
            state.contacts.clear();
            state.surface_contacts.clear();
            header.forgetful = true;
        }
        let seen = self.recorder.seen();
        header.seen = seen.len() as u64;
        self.checkpoints.write(&header, &[state.to_bytes(), seen].concat())?;
        self.recorder.time += start.elapsed();
        Ok(())
    }

    fn summary(&self, warnings: Vec<String>, notes: Vec<String>) -> Summary {
        let (c, batch) = (&self.constants, self.drive.batch());
        let Outcome { status, reason, state_hash, particles, stages } = self.drive.outcome(0);
        let wall_s = self.drive.started().elapsed().as_secs_f64();
        let mut phases: std::collections::BTreeMap<String, f64> =
            batch.times(0).rows().iter().map(|(name, s)| ((*name).to_owned(), *s)).collect();
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
            device: batch.backend().device(),
            state_hash: state_hash.unwrap_or_default(),
            particles,
            stages,
            performance: summary::Performance {
                particle_steps_per_second: self.drive.particle_steps() / wall_s,
                wall_s,
                steps: self.drive.steps(),
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
        forgetful: false,
        seen: 0,
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
            "the checkpoint was written on {} and is continued on {device}: the results agree as averages do, the \
             bits differ",
            header.device
        ));
    }
    if header.forgetful {
        lines.push(
            "the checkpoint leaves out what contacts remember (checkpoint_history = false): the run ends with other \
             bits than one that was never stopped"
                .to_owned(),
        );
    }
    lines
}
