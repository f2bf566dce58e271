//! What a calibration will run.

use std::sync::Arc;

use glebe_engine::Constants;
use glebe_engine::backend::Backend;
use glebe_engine::state::Progress;
use glebe_io::scene::SceneError;
use glebe_io::study::{Calibration, Method};

use super::searcher;
use crate::beds::Bed;
use crate::digest::Digest;
use crate::drive::steps_left;
use crate::ensemble::{Made, make};
use crate::sample::{World, within};

/// A calibration whose scenes were made once, with every parameter in the middle of its range.
pub struct Plan {
    /// The calibration.
    pub calibration: Calibration,
    /// Particles of each experiment.
    pub particles: Vec<usize>,
    /// The most steps of an evaluation; stages that wait without limit count as none.
    pub steps: u64,
    /// The most particle-steps of an evaluation, in the middle of the ranges.
    pub particle_steps: f64,
    /// What looks wrong but does not stop it.
    pub warnings: Vec<String>,
    constants: Vec<Arc<Constants>>,
    scene_hashes: Vec<String>,
}

impl Plan {
    /// Makes the scenes in the middle of all ranges.
    ///
    /// # Errors
    /// Scenes that cannot be set up there.
    pub fn new(calibration: Calibration) -> Result<Self, Vec<SceneError>> {
        let mut plan = Self {
            calibration,
            particles: Vec::new(),
            steps: 0,
            particle_steps: 0.0,
            warnings: Vec::new(),
            constants: Vec::new(),
            scene_hashes: Vec::new(),
        };
        for made in plan.made(0.5)? {
            plan.particles.push(made.constants.count);
            let steps = steps_left(&made.constants, &Progress::default());
            plan.steps += steps;
            plan.particle_steps += steps as f64 * made.constants.count as f64;
            let new = made.warnings.into_iter().filter(|w| !plan.warnings.contains(w)).collect::<Vec<_>>();
            plan.warnings.extend(new);
            plan.constants.push(made.constants);
            plan.scene_hashes.push(made.scene_hash);
        }
        let (free, targets) = (plan.calibration.free.len(), plan.calibration.targets.len());
        if targets < free {
            plan.warnings.push(format!(
                "{targets} target{} cannot tell {free} free parameters apart: many sets of them will do equally well",
                if targets == 1 { "" } else { "s" }
            ));
        }
        Ok(plan)
    }

    /// The worlds of the middles of the ranges, to choose a device for.
    pub fn middle(&self) -> &[Arc<Constants>] {
        &self.constants
    }

    /// Evaluations of a round, and of all rounds with those around the best at the most.
    pub fn evaluations(&self) -> (usize, usize) {
        let c = &self.calibration;
        let round = searcher(self).ask().len();
        let most =
            c.stop.evaluations.unwrap_or(usize::MAX).max(round).min(c.stop.rounds.saturating_mul(round));
        (round, most + if self.probes() { 2 * c.free.len() } else { 0 })
    }

    /// Whether evaluations around the best tell how the targets depend on the parameters: a filter tells it itself.
    pub(super) fn probes(&self) -> bool {
        self.calibration.probe > 0.0 && !matches!(self.calibration.method, Method::BayesianFilter { .. })
    }

    /// Values and arguments of `--set` of a point of the unit cube.
    pub fn world(&self, point: &[f64]) -> World {
        let c = &self.calibration;
        let values = c.free.iter().zip(point).map(|(f, u)| within(f.bounds, f.logarithmic, f.whole, *u));
        World::new(c.free.iter().map(|f| f.path.as_str()), &c.followers, values.collect())
    }

    /// The experiments' worlds with every parameter at a share of its range.
    fn made(&self, share: f64) -> Result<Vec<Made>, Vec<SceneError>> {
        let own = self.world(&vec![share; self.calibration.free.len()]).sets;
        let made = |e: &glebe_io::study::Experiment| {
            make(&e.scene, &e.scene_text, &[e.sets.as_slice(), &own].concat())
        };
        self.calibration.experiments.iter().map(made).collect()
    }

    /// Whether all evaluations begin from the same settled beds.
    pub(super) fn shares_beds(&self, backend: Backend) -> bool {
        let keys = |share: f64| -> Option<Vec<String>> {
            let made = self.made(share).ok()?;
            made.iter().map(|m| Some(Bed::of(&m.constants, &m.state, backend)?.key)).collect()
        };
        keys(0.5).is_some_and(|middle| keys(0.25).as_ref() == Some(&middle))
    }

    /// A digest of all that results depend on.
    pub(super) fn digest(&self) -> String {
        let c = &self.calibration;
        let experiments: Vec<_> = c.experiments.iter().map(|e| (&e.name, &e.sets)).collect();
        Digest::default()
            .debug(&self.scene_hashes)
            .debug(&experiments)
            .debug(&(c.seed, &c.free, &c.followers, &c.targets))
            .debug(&(c.method, c.probe))
            .finish()
    }
}
