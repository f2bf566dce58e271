//! The progress bar of a run.

use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glebe_study::drive::steps_left;
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
    mark: (Instant, u64, f64),
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
        Self { ui, bar, mark: (Instant::now(), 0, 0.0), rates: (0.0, 0.0) }
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
        self.rates =
            ((pulse.steps - steps) as f64 / seconds, (pulse.particle_steps - particle_steps) / seconds);
        self.mark = (Instant::now(), pulse.steps, pulse.particle_steps);

        let (c, g) = (pulse.constants, pulse.progress);
        let stages = &c.spec.stages;
        let left = steps_left(c, g);
        self.bar.set_length(g.step + left);
        self.bar.set_position(g.step);
        let name = stages.get(g.stage).map_or("", |s| s.name.as_str());
        self.bar.set_message(format!(
            "t = {:.4} s   {name} ({}/{})   {:.0} steps/s   {:.2} M particle-steps/s   E_kin {:.3e} J   ETA {}",
            g.step as f64 * c.dt,
            (g.stage + 1).min(stages.len()),
            stages.len(),
            self.rates.0,
            self.rates.1 / 1e6,
            pulse.kinetic,
            duration(left as f64 / self.rates.0.max(1e-9)),
        ));
    }

    fn interrupted(&self) -> bool {
        interrupted()
    }
}
