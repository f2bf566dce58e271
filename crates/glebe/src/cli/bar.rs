//! The progress bar of a run or a sweep.

use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::Ui;
use super::check::duration;
use crate::run::{Listener, Pulse};

/// Set by the first Ctrl-C (or SIGTERM); the second ends the program at once.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// From now on Ctrl-C lets the run finish its sampling interval and write a checkpoint.
pub(super) fn catch_interrupts() -> Result<(), String> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    })
    .map_err(|e| format!("Ctrl-C cannot be caught: {e}"))
}

/// Whether the user asked to stop.
pub(super) fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}

/// Shows a run on the terminal: log lines, and below them the bar.
pub(super) struct Watch<'a> {
    ui: &'a Ui,
    bar: ProgressBar,
    /// Rates are taken over the time since: wall time, steps, particle-steps.
    mark: (Instant, f64, f64),
    rates: (f64, f64),
}

impl<'a> Watch<'a> {
    pub(super) fn new(ui: &'a Ui) -> Self {
        let shown = !ui.quiet() && !ui.json() && std::io::stderr().is_terminal();
        let target = if shown { ProgressDrawTarget::stderr_with_hz(4) } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(0), target);
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3} %\n{msg}") {
            bar.set_style(style);
        }
        Self { ui, bar, mark: (Instant::now(), 0.0, 0.0), rates: (0.0, 0.0) }
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

impl Listener for Watch<'_> {
    fn note(&mut self, line: &str) {
        self.bar.suspend(|| self.ui.note(line));
    }

    fn warn(&mut self, line: &str) {
        self.bar.suspend(|| self.ui.warn(line));
    }

    fn pulse(&mut self, pulse: &Pulse<'_>) {
        let (since, steps, particle_steps) = self.mark;
        let elapsed = since.elapsed();
        if self.bar.is_hidden() || elapsed < Duration::from_millis(500) {
            return;
        }
        let seconds = elapsed.as_secs_f64();
        let drive = pulse.drive;
        // A new batch counts from 0.
        let since = |now: f64, then: f64| if now >= then { now - then } else { now };
        let done = [drive.steps() as f64, drive.particle_steps()];
        self.rates = (since(done[0], steps) / seconds, since(done[1], particle_steps) / seconds);
        self.mark = (Instant::now(), done[0], done[1]);

        let left = drive.steps_left() + pulse.later;
        let rate = self.rates.0;
        self.bar.set_length(drive.steps() + left);
        self.bar.set_position(drive.steps());
        let place = match pulse.kinetic {
            Some(kinetic) => {
                let (c, g) = (drive.batch().constants(0), drive.batch().progress(0));
                let stages = &c.spec.stages;
                let name = stages.get(g.stage).map_or("", |s| s.name.as_str());
                let (k, n) = ((g.stage + 1).min(stages.len()), stages.len());
                format!("t = {:.4} s   {name} ({k}/{n})   E_kin {kinetic:.3e} J", g.step as f64 * c.dt)
            }
            None => format!("{} of {} worlds", pulse.ended, pulse.worlds),
        };
        self.bar.set_message(format!(
            "{place}   {rate:.0} steps/s   {:.2} M particle-steps/s   ETA {}",
            self.rates.1 / 1e6,
            duration(left as f64 / rate.max(1e-9)),
        ));
    }

    fn interrupted(&self) -> bool {
        interrupted()
    }
}
