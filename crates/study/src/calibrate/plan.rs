//! What a calibration will run.

use std::path::Path;
use std::sync::Arc;

use glebe_engine::Constants;
use glebe_engine::backend::Backend;
use glebe_engine::state::Progress;
use glebe_io::scene::SceneError;
use glebe_io::study::{Calibration, Method, Quantity, Study, Target};

use super::probe::POINTS;
use super::searcher;
use crate::beds::Bed;
use crate::capture::Wanted;
use crate::digest::Digest;
use crate::drive::steps_left;
use crate::ensemble::{Made, make};
use crate::rve;
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
    /// Curves that the worlds of each experiment are to give.
    pub(super) curves: Vec<Vec<Wanted>>,
    /// Experiments on periodic samples, those of one study together.
    pub(super) groups: Vec<Group>,
}

/// Experiments on the samples of one study.
pub(super) struct Group {
    pub(super) study: Study,
    /// Their numbers.
    pub(super) experiments: Vec<usize>,
}

impl Plan {
    /// Makes the scenes in the middle of all ranges.
    ///
    /// # Errors
    /// Scenes that cannot be set up there.
    pub fn new(calibration: Calibration) -> Result<Self, Vec<SceneError>> {
        let groups = groups(&calibration);
        let mut plan = Self {
            calibration,
            particles: Vec::new(),
            steps: 0,
            particle_steps: 0.0,
            warnings: Vec::new(),
            constants: Vec::new(),
            scene_hashes: Vec::new(),
            curves: Vec::new(),
            groups,
        };
        let own = plan.world(&vec![0.5; plan.calibration.free.len()]);
        for e in 0..plan.calibration.experiments.len() {
            let (constants, hash, steps, new) = match &plan.calibration.experiments[e].samples {
                None => {
                    let Made { constants, scene_hash, warnings, .. } = plan.made(e, &own)?;
                    let steps = steps_left(&constants, &Progress::default());
                    plan.curves.push(plan.wanted(e, &constants)?);
                    (constants, scene_hash, steps, warnings)
                }
                Some((_, study)) => {
                    let (constants, samples) = plan.samples(e, study, &own)?;
                    let steps =
                        samples.samples.iter().filter_map(|s| Some(s.fate.as_ref().ok()?.steps)).sum();
                    plan.curves.push(Vec::new());
                    (constants, samples.digest(), steps, samples.warnings)
                }
            };
            plan.particles.push(constants.count);
            plan.steps += steps;
            plan.particle_steps += steps as f64 * constants.count as f64;
            let new = new.into_iter().filter(|w| !plan.warnings.contains(w)).collect::<Vec<_>>();
            plan.warnings.extend(new);
            plan.constants.push(constants);
            plan.scene_hashes.push(hash);
        }
        let (free, targets) = (plan.calibration.free.len(), plan.calibration.targets.len());
        let numbers: usize = plan.calibration.targets.iter().map(|t| t.values.len()).sum();
        if numbers < free {
            plan.warnings.push(format!(
                "{targets} target{} cannot tell {free} free parameters apart: many sets of them will do equally well",
                if targets == 1 { "" } else { "s" }
            ));
        }
        Ok(plan)
    }

    /// The targets of an experiment, with their numbers.
    pub(super) fn targets_of(&self, experiment: usize) -> Vec<(usize, &Target)> {
        let all = self.calibration.targets.iter().enumerate();
        all.filter(|(_, target)| target.experiment == experiment).collect()
    }

    /// The curves that the worlds of an experiment are to give.
    fn wanted(&self, e: usize, c: &Constants) -> Result<Vec<Wanted>, Vec<SceneError>> {
        let mut all = Vec::new();
        for (_, target) in self.targets_of(e) {
            if let Quantity::Curve { stage: Some(stage), x, y, at, .. } = &target.quantity {
                let wanted = Wanted::of(c, &target.name, stage, [x, y], at);
                all.push(wanted.map_err(|why| vec![self.calibration.wrong(&target.name, why)])?);
            }
        }
        Ok(all)
    }

    /// The samples of an experiment with a set of parameters, and the first that can be loaded; or why there is none.
    fn samples(
        &self,
        e: usize,
        study: &Study,
        own: &World,
    ) -> Result<(Arc<Constants>, rve::Plan), Vec<SceneError>> {
        let sets = [self.calibration.experiments[e].sets.as_slice(), &own.sets].concat();
        let variant = World { values: Vec::new(), sets };
        let plan = rve::Plan::of(study.clone(), vec![variant], || false).ok_or_else(Vec::new)?;
        let load = |facts: &rve::Facts| facts.rve.load;
        for (_, target) in self.targets_of(e) {
            let load = plan.samples.iter().find_map(|s| load(s.fate.as_ref().ok()?));
            let Quantity::Curve { x, at, .. } = &target.quantity else { continue };
            let furthest = at.last().copied().unwrap_or(0.0);
            if let Some(load) =
                load.filter(|load| x == "strain" && load.cycles == 0 && furthest > load.strain * 1.001)
            {
                let why = format!(
                    "`{}` was measured up to a strain of {furthest}, and samples are loaded up to {}: raise load.strain, or \
                     take these lines out of the file",
                    target.name, load.strain
                );
                return Err(vec![self.calibration.wrong(&target.name, why)]);
            }
        }
        let refused = plan.samples.iter().find_map(|sample| sample.fate.as_ref().err());
        match (refused, plan.first()) {
            (None, [constants, ..]) => Ok((constants.clone(), plan)),
            (refused, _) => Err(refused.cloned().unwrap_or_default()),
        }
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
        (round, most + if self.probes() { POINTS * c.free.len() } else { 0 })
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

    /// The world of an experiment with a set of parameters.
    fn made(&self, e: usize, own: &World) -> Result<Made, Vec<SceneError>> {
        let e = &self.calibration.experiments[e];
        make(&e.scene, &e.scene_text, &[e.sets.as_slice(), &own.sets].concat())
    }

    /// Whether all evaluations begin from the same settled beds.
    pub(super) fn shares_beds(&self, backend: Backend) -> bool {
        let all = &self.calibration.experiments;
        let scenes: Vec<usize> = (0..all.len()).filter(|e| all[*e].samples.is_none()).collect();
        let keys = |share: f64| -> Option<Vec<String>> {
            let own = self.world(&vec![share; self.calibration.free.len()]);
            let key = |e: &usize| {
                let made = self.made(*e, &own).ok()?;
                Some(Bed::of(&made.constants, &made.state, backend)?.key)
            };
            scenes.iter().map(key).collect()
        };
        keys(0.5).is_some_and(|middle| keys(0.25).as_ref() == Some(&middle))
    }

    /// A digest of all that results depend on.
    pub(super) fn digest(&self) -> String {
        let c = &self.calibration;
        let experiments: Vec<_> = c.experiments.iter().map(|e| (&e.name, &e.sets)).collect();
        let digest = Digest::default()
            .debug(&self.scene_hashes)
            .debug(&experiments)
            .debug(&(c.seed, &c.free, &c.followers, &c.targets))
            .debug(&(c.method, c.probe));
        match c.surrogate {
            Some(surrogate) => digest.debug(&surrogate).finish(),
            None => digest.finish(),
        }
    }
}

fn groups(calibration: &Calibration) -> Vec<Group> {
    let mut groups: Vec<(&Path, Group)> = Vec::new();
    for (e, experiment) in calibration.experiments.iter().enumerate() {
        let Some((path, study)) = &experiment.samples else { continue };
        match groups.iter_mut().find(|(of, _)| of == path) {
            Some((_, group)) => group.experiments.push(e),
            None => groups.push((path, Group { study: study.clone(), experiments: vec![e] })),
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}
