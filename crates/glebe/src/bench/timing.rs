//! Steps of a prepared bed against the clock.

use std::time::Instant;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status};
use glebe_engine::spec::Search;
use rayon::prelude::*;

use super::BenchError;
use super::bed::{Bed, Prepared};
use crate::device::admit;

/// Stages of the bed's world after it is prepared: the first step, a warm-up, and what is timed.
const FIRST: usize = 0;
const WARM: usize = 1;
const TIMED: usize = 2;

/// Share by which friction in the worlds of a batch differs at most.
const SMOOTHER: f64 = 0.1;

/// What was measured on one bed, or on several worlds of it together.
pub struct Row {
    /// The bed.
    pub bed: Bed,
    /// How its particles find those near to them.
    pub search: Search,
    /// Worlds that began with it.
    pub worlds: usize,
    /// Whether it came prepared from the cache.
    pub cached: bool,
    /// Steps in which it was prepared.
    pub prepare_steps: u64,
    /// Particle-steps a second of each repeat, in order.
    pub rates: Vec<f64>,
    /// Phases, with their seconds in all repeats.
    pub phases: Vec<(&'static str, f64)>,
    /// Wall time of all repeats \[s\].
    pub wall: f64,
    /// Wall time from the bed's state to the end of its first step \[s\], in the first repeat: on a device with what its
    /// kernels take to be compiled, unless an earlier bed had the same.
    pub first_step: f64,
    /// Steps of one repeat.
    pub steps: u64,
    /// Rebuilds of neighbour lists in them, of all worlds.
    pub rebuilds: u64,
    /// Contacts of a particle at the end, in the first world as all that follows, each pair counted at both.
    pub coordination: f64,
    /// Contacts that a step evaluates for each particle, at the end: each pair counts once.
    pub contacts: f64,
    /// Particles that have left the beds since they were made.
    pub lost: usize,
    /// Memory that the engine counts per particle.
    pub bytes_per_particle: f64,
}

impl Row {
    /// Nothing measured yet.
    pub fn new(bed: Bed, search: Search, worlds: usize, prepared: &Prepared, steps: u64) -> Self {
        Self {
            bed,
            search,
            worlds,
            cached: prepared.cached,
            prepare_steps: prepared.state.progress.step,
            rates: Vec::new(),
            phases: Vec::new(),
            wall: 0.0,
            first_step: 0.0,
            steps,
            rebuilds: 0,
            coordination: 0.0,
            contacts: 0.0,
            lost: 0,
            bytes_per_particle: 0.0,
        }
    }

    /// Median rate \[particle-steps/s\].
    pub fn median(&self) -> f64 {
        median(self.rates.clone())
    }

    /// Rate over that of `other`: the median over repeats, in which both took turns.
    pub fn rate_over(&self, other: &Self) -> f64 {
        median(self.rates.iter().zip(&other.rates).map(|(own, other)| own / other).collect())
    }

    /// Time per contact over that of `other`.
    pub fn time_per_contact_over(&self, other: &Self) -> f64 {
        other.contacts / (self.rate_over(other) * self.contacts)
    }

    /// Least and largest rate \[particle-steps/s\].
    pub fn range(&self) -> [f64; 2] {
        self.rates.iter().fold([f64::INFINITY, 0.0], |[lo, hi], r| [lo.min(*r), hi.max(*r)])
    }

    /// Largest less smallest rate, over the median.
    pub fn spread(&self) -> f64 {
        let [least, largest] = self.range();
        (largest - least) / self.median()
    }

    /// Phases, with their shares of the wall time; the rest is sampling and what is between phases.
    pub fn shares(&self) -> impl Iterator<Item = (&'static str, f64)> {
        self.phases.iter().map(|(name, seconds)| (*name, seconds / self.wall))
    }

    /// Steps from one rebuild to the next, if there was one.
    pub fn steps_per_rebuild(&self) -> Option<f64> {
        (self.rebuilds > 0).then(|| self.steps as f64 * self.worlds as f64 / self.rebuilds as f64)
    }

    /// Wall time of a step over the contacts that it evaluates \[s\].
    pub fn time_per_contact(&self) -> f64 {
        1.0 / (self.median() * self.contacts)
    }

    /// Times the bed once more, from the same state as ever. Worlds of a batch differ in friction, so that each goes its
    /// own way.
    pub fn time(&mut self, prepared: &Prepared, ledger: bool, backend: Backend) -> Result<(), BenchError> {
        let many = self.worlds > 1;
        let among = |world: usize| many.then(|| SMOOTHER * world as f64 / self.worlds as f64);
        let constants: Vec<_> = (0..self.worlds)
            .into_par_iter()
            .map(|world| self.bed.constants(self.steps, self.search, ledger, among(world)))
            .collect::<Result<_, _>>()?;
        admit(backend, &constants)?;
        let began = Instant::now();
        let worlds = constants.into_iter().map(|c| (c, prepared.state.clone())).collect();
        let mut batch = Batch::from_states(worlds, backend);
        let stage = self.bed.preparing();
        through(&mut batch, stage + FIRST);
        if self.rates.is_empty() {
            self.first_step = began.elapsed().as_secs_f64();
        }
        through(&mut batch, stage + WARM);
        let rebuilt = |batch: &Batch| (0..batch.len()).map(|w| batch.progress(w).rebuilds).sum::<u64>();
        let (rebuilds, phases) = (rebuilt(&batch), batch.times(0).rows());
        let began = Instant::now();
        through(&mut batch, stage + TIMED);
        let seconds = began.elapsed().as_secs_f64();
        if let Some(w) = (0..batch.len()).find(|w| *batch.status(*w) != Status::Done) {
            return Err(BenchError::Stopped { bed: self.bed, status: batch.status(w).clone() });
        }
        let all: usize = (0..batch.len()).map(|w| batch.particles(w)).sum();
        self.wall += seconds;
        self.rates.push(all as f64 * self.steps as f64 / seconds);
        self.phases.resize(phases.len(), ("", 0.0));
        for (sum, (before, now)) in self.phases.iter_mut().zip(phases.iter().zip(batch.times(0).rows())) {
            *sum = (now.0, sum.1 + now.1 - before.1);
        }
        self.rebuilds = rebuilt(&batch) - rebuilds;
        let particles = batch.particles(0);
        let moment = batch.moment(0);
        let each = |contacts: u64| contacts as f64 / particles.max(1) as f64;
        self.coordination = each(2 * moment.contacts + moment.surface_contacts);
        self.contacts = each(moment.contacts + moment.surface_contacts);
        self.lost = (0..batch.len()).map(|w| batch.progress(w).lost.len()).sum();
        self.bytes_per_particle = batch.bytes_per_particle(0);
        Ok(())
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

/// To the end of a stage of all worlds, which take it step for step together.
fn through(batch: &mut Batch, stage: usize) {
    while batch.running() && (0..batch.len()).any(|w| batch.progress(w).stage <= stage) {
        let Ok(()) = batch.advance(&mut Blind);
    }
}
