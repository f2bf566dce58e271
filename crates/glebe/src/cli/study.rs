//! What the verbs that run studies have in common.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use glebe_engine::Constants;
use glebe_engine::backend::Backend;
use glebe_io::output::summary::{Performance, Status};
use glebe_io::scene::SceneError;
use glebe_study::sweep::{Counts, Settings, StudyError, reason};
use serde::Serialize;
use serde_json::{Value, json};

use super::bar::{Watch, catch_interrupts, interrupted};
use super::check::{duration, folder_of};
use super::run::{ComputeArgs, before_the_start};
use super::{Ended, Problem, Ui};
use crate::device::memory;
use crate::run::default_bed_folder;

/// A study, and how it is computed.
#[derive(Debug, clap::Args)]
pub(super) struct StudyArgs {
    /// The study file
    pub(super) study: PathBuf,
    /// Replaces a value of the study: keys joined by dots, such as vary.density.count=8
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub(super) sets: Vec<String>,
    #[command(flatten)]
    pub(super) compute: ComputeArgs,
    /// Batches to divide the worlds into [default: as few as memory allows]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    batches: Option<u32>,
    /// Wall time between checkpoints of worlds under way [s]
    #[arg(long, value_name = "SECONDS", default_value_t = 600)]
    checkpoint_every: u64,
}

/// What a study came to.
pub(super) struct Came {
    summary: Value,
    status: Status,
    /// What happened to the device, if it was lost.
    reason: Option<String>,
    /// What is said if it failed, and the table that tells why.
    nothing: &'static str,
    table: &'static str,
}

impl Came {
    pub(super) fn of(summary: &impl Serialize, status: Status, reason: Option<&str>) -> Self {
        let reason = reason.map(str::to_owned);
        Self { summary: json!(summary), status, reason, nothing: "no world is done", table: "worlds.csv" }
    }

    /// What is said if it failed, and the table that tells why.
    pub(super) fn or(self, nothing: &'static str, table: &'static str) -> Self {
        Self { nothing, table, ..self }
    }
}

/// Tells of those that are refused, each a `what`; an error if none is left, after what `first` says of the first.
pub(super) fn tell_refused(
    what: &str,
    fates: &[Option<&[SceneError]>],
    first: impl FnOnce() -> String,
    ui: &Ui,
) -> Result<(), Problem> {
    if let [Some(errors), ..] = fates
        && fates.iter().all(Option::is_some)
    {
        ui.note(&first());
        return Err(Problem::Scene(errors.to_vec()));
    }
    for (w, errors) in fates.iter().enumerate() {
        if let Some(errors) = errors {
            ui.warn(&format!("{what} {w} is refused: {}", reason(errors)));
        }
    }
    Ok(())
}

impl StudyArgs {
    /// Plans the study, runs it on a device that has room for `worlds` of the plan, and says what came of it. There is no
    /// plan if the user interrupts it.
    pub(super) fn run<P>(
        &self,
        verb: &str,
        ui: &Ui,
        plan: impl FnOnce(&Path, &[String], &Ui) -> Result<Option<P>, Problem>,
        worlds: impl FnOnce(&P) -> &[Arc<Constants>],
        run: impl FnOnce(&P, &Settings, &mut Watch<'_>) -> Result<(Came, String), StudyError>,
    ) -> Result<Ended, Problem> {
        let compute = &self.compute;
        let ui = &ui.quieted(compute.quiet);
        catch_interrupts().map_err(Problem::Failed)?;
        compute.start_threads()?;
        // Before worlds are made, which can take minutes; how large they are is seen then.
        let device = compute.device.open(0)?;
        let Some(plan) = plan(&self.study, &self.sets, ui)? else { return Ok(before_the_start(ui)) };
        let chosen = device.admit(worlds(&plan))?;
        chosen.note.iter().for_each(|line| ui.note(line));
        if interrupted() {
            return Ok(before_the_start(ui));
        }
        let mut watch = Watch::new(ui);
        let (came, text) = run(&plan, &self.settings(chosen.backend), &mut watch)?;
        drop(watch);
        self.finish(verb, &came, &text, ui)
    }

    fn out(&self) -> PathBuf {
        self.compute.out.clone().unwrap_or_else(|| folder_of(&self.study).join("out"))
    }

    /// How the study is to be run on a backend.
    fn settings(&self, backend: Backend) -> Settings {
        Settings {
            backend,
            existing: self.compute.existing(),
            beds: default_bed_folder().filter(|_| !self.compute.no_cache),
            batches: self.batches.map(|n| n as usize),
            memory: memory(backend),
            checkpoint_every: Duration::from_secs(self.checkpoint_every),
            commit: option_env!("GLEBE_COMMIT").map(str::to_owned),
            sets: self.sets.clone(),
            ..Settings::new(self.out())
        }
    }

    /// Says what came of it; `text` is what people read if it is done.
    fn finish(&self, verb: &str, came: &Came, text: &str, ui: &Ui) -> Result<Ended, Problem> {
        let out = self.out();
        let mut value = came.summary.clone();
        value["out"] = json!(out);
        let resume = self.compute.resume_with(verb, &self.study, &out, &self.sets);
        if came.status == Status::Interrupted {
            value["resume"] = json!(resume);
            ui.result(&value, "");
            ui.note(&format!("interrupted; what has ended is kept. To go on: {resume}"));
            return Ok(Ended::Interrupted);
        }
        if let Some(reason) = &came.reason {
            return Err(Problem::Failed(format!("{reason}\nWhat has ended is kept. To go on: {resume}")));
        }
        if came.status == Status::Failed {
            return Err(Problem::Failed(format!(
                "{}; {} tells why of each",
                came.nothing,
                out.join(came.table).display()
            )));
        }
        let text =
            if self.compute.quiet { String::new() } else { format!("{text}results in {}", out.display()) };
        ui.result(&value, &text);
        Ok(Ended::Done)
    }
}

/// A line on how many ended how, and how fast it was.
pub(super) fn counted(what: &str, counts: Counts, p: &Performance, device: &str) -> String {
    let mut text = format!("{} of {} {what} done", counts.done, counts.worlds);
    // Writing to a string cannot fail.
    for (count, how) in [(counts.failed, "failed"), (counts.refused, "refused")] {
        if count > 0 {
            let _ = write!(text, ", {count} {how}");
        }
    }
    let _ = writeln!(
        text,
        "; {} steps in {} ({:.2} M particle-steps/s on {device})",
        p.steps,
        duration(p.wall_s),
        p.particle_steps_per_second / 1e6,
    );
    text
}
