//! Steps of a settled bed against the clock.

use std::time::Instant;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Status};

use super::bed::{Bed, Blind, Settled};
use super::{BenchArgs, BenchError};
use crate::cli::Ui;

/// Stages of the bed's world after it has settled.
const WARM: usize = 1;
const TIMED: usize = 2;

/// What was measured on one bed.
pub struct Row {
    /// The bed.
    pub bed: Bed,
    /// Whether it came settled from the cache.
    pub cached: bool,
    /// Steps in which it settled.
    pub settle_steps: u64,
    /// Particle-steps a second of each repeat, ascending.
    pub rates: Vec<f64>,
    /// Phases, with their shares of the wall time of all repeats; the rest is sampling and what is between
    /// phases.
    pub phases: Vec<(&'static str, f64)>,
    /// Rebuilds of neighbour lists in the timed steps.
    pub rebuilds: u64,
    /// Contacts per particle at the end.
    pub coordination: f64,
    /// Memory that the engine counts per particle.
    pub bytes_per_particle: f64,
}

impl Row {
    /// Median rate \[particle-steps/s\].
    pub fn median(&self) -> f64 {
        let n = self.rates.len();
        0.5 * (self.rates[(n - 1) / 2] + self.rates[n / 2])
    }

    /// Largest less smallest rate, over the median.
    pub fn spread(&self) -> f64 {
        (self.rates[self.rates.len() - 1] - self.rates[0]) / self.median()
    }
}

/// Times the bed as often as asked for, each time from the same state.
pub fn time(bed: &Bed, settled: &Settled, args: &BenchArgs, ui: &Ui) -> Result<Row, BenchError> {
    let constants = bed.constants(args.steps, args.ledger)?;
    let mut row = Row {
        bed: *bed,
        cached: settled.cached,
        settle_steps: settled.state.progress.step,
        rates: Vec::new(),
        phases: Vec::new(),
        rebuilds: 0,
        coordination: 0.0,
        bytes_per_particle: 0.0,
    };
    let mut wall = 0.0;
    for repeat in 1..=args.repeat {
        ui.note(&format!("timing the {} bed of {}: {repeat} of {}", bed.kind.name(), bed.count, args.repeat));
        let mut batch = Batch::from_states(vec![(constants.clone(), settled.state.clone())], Backend::Cpu);
        through(&mut batch, WARM);
        let (rebuilds, phases) = (batch.progress(0).rebuilds, batch.times(0).rows());
        let began = Instant::now();
        through(&mut batch, TIMED);
        let seconds = began.elapsed().as_secs_f64();
        if *batch.status(0) != Status::Done {
            return Err(BenchError::Stopped { count: bed.count, status: batch.status(0).clone() });
        }
        wall += seconds;
        row.rates.push(batch.particles(0) as f64 * args.steps as f64 / seconds);
        row.phases.resize(phases.len(), ("", 0.0));
        for (sum, (before, now)) in row.phases.iter_mut().zip(phases.iter().zip(batch.times(0).rows())) {
            *sum = (now.0, sum.1 + now.1 - before.1);
        }
        row.rebuilds = batch.progress(0).rebuilds - rebuilds;
        let moment = batch.moment(0);
        row.coordination =
            (2 * moment.contacts + moment.surface_contacts) as f64 / batch.particles(0).max(1) as f64;
        row.bytes_per_particle = batch.bytes_per_particle(0);
    }
    for phase in &mut row.phases {
        phase.1 /= wall;
    }
    row.rates.sort_by(f64::total_cmp);
    Ok(row)
}

/// To the end of a stage.
fn through(batch: &mut Batch, stage: usize) {
    while batch.running() && batch.progress(0).stage <= stage {
        let Ok(()) = batch.advance(&mut Blind);
    }
}
