//! The samples of a study, each made once to see that it can be.

use std::path::Path;
use std::sync::Arc;

use glebe_engine::spec::WorldSpec;
use glebe_engine::state::{Progress, State};
use glebe_engine::{Constants, SetupError, prepare};
use glebe_io::scene::{BuiltScene, Origin, ParticlePart, Scene, SceneError};
use glebe_io::study::{Aim, Rve, Study, of_samples};
use rayon::prelude::*;

use super::program::{loading, preparing};
use crate::digest::{Digest, scene_hash};
use crate::drive::steps_left;
use crate::ensemble::{reason, throughput, told_once};
use crate::sample::{self, TooManyDimensions, World};

/// A study of periodic samples, each of which was made once, to see that it can be.
pub struct Plan {
    /// The study.
    pub study: Study,
    /// Its variants: what varies, each with as many samples as there are seeds.
    pub variants: Vec<World>,
    /// Its samples, the seeds of a variant one after the other.
    pub samples: Vec<Planned>,
    /// What looks wrong but does not stop a sample.
    pub warnings: Vec<String>,
    first: Option<Arc<Constants>>,
}

/// A sample of a plan.
#[derive(Debug)]
pub struct Planned {
    /// Number of its variant.
    pub variant: usize,
    /// Which of the seeds it has, from 0.
    pub nth: u64,
    /// What is known of it, or why it cannot be set up.
    pub fate: Result<Facts, Vec<SceneError>>,
}

/// What is known of a sample before it runs.
#[derive(Clone, Debug)]
pub struct Facts {
    /// What is done with it.
    pub rve: Rve,
    /// Seed of its scene.
    pub seed: u64,
    /// Digest of what is prepared, whatever the friction; equal for samples that differ in their loading alone.
    pub prepared_hash: Option<String>,
    /// Digest of what is loaded.
    pub scene_hash: String,
    /// Particles.
    pub particles: usize,
    /// The most steps that consolidation and loading take.
    pub steps: u64,
}

/// A world that was set up.
pub(super) struct Made {
    pub(super) constants: Arc<Constants>,
    pub(super) state: State,
}

/// The scene of a sample.
struct Cast {
    rve: Rve,
    built: BuiltScene,
}

impl Plan {
    /// Chooses the samples and makes each of them once, without keeping it. None if `interrupted` before the last.
    ///
    /// # Errors
    /// A sampler that cannot spread points over so many parameters.
    pub fn new(
        study: Study,
        interrupted: impl Fn() -> bool + Sync,
    ) -> Result<Option<Self>, TooManyDimensions> {
        let variants = sample::worlds(&study)?;
        Ok(Self::of(study, variants, interrupted))
    }

    /// The same of variants that were chosen elsewhere.
    pub(crate) fn of(
        study: Study,
        variants: Vec<World>,
        interrupted: impl Fn() -> bool + Sync,
    ) -> Option<Self> {
        let seeds = study.rve.as_ref().map_or(1, |rve| rve.seeds);
        let all: Vec<(usize, u64)> =
            (0..variants.len()).flat_map(|v| (0..seeds).map(move |nth| (v, nth))).collect();
        let look = |(variant, nth): (usize, u64)| {
            if interrupted() {
                return None;
            }
            let mut warnings = Vec::new();
            let fate = facts(&study, &variants[variant], nth, &mut warnings);
            Some((Planned { variant, nth, fate }, warnings))
        };
        let made: Option<Vec<_>> = all.into_par_iter().map(look).collect();
        let made = made?;
        let mut samples = Vec::with_capacity(made.len());
        let mut said = std::collections::BTreeMap::new();
        for (w, (planned, warnings)) in made.into_iter().enumerate() {
            for warning in warnings {
                said.entry(warning).or_insert_with(Vec::new).push(w);
            }
            samples.push(planned);
        }
        let warnings = told_once(said, samples.len());
        let mut plan = Self { study, variants, samples, warnings, first: None };
        let first = plan.samples.iter().position(|sample| sample.fate.is_ok());
        plan.first = first.and_then(|w| plan.loaded(w).ok()).map(|made| made.constants);
        Some(plan)
    }

    /// The first sample that can be set up, to choose a device for; empty if there is no such sample.
    pub fn first(&self) -> &[Arc<Constants>] {
        self.first.as_slice()
    }

    /// How many samples cannot be set up.
    pub fn refused(&self) -> usize {
        self.samples.iter().filter(|sample| sample.fate.is_err()).count()
    }

    /// What a variant is called: what varies, with its values.
    pub fn name(&self, variant: usize) -> String {
        let parts = self.study.parameters.iter().zip(&self.variants[variant].values);
        parts.map(|(p, value)| format!("{} {}", p.name, value.shown())).collect::<Vec<_>>().join(", ")
    }

    /// A digest of all samples.
    pub(crate) fn digest(&self) -> String {
        let add = |digest: Digest, planned: &Planned| {
            let fate = planned.fate.as_ref();
            let fate =
                fate.map(|f| (&f.rve, &f.prepared_hash, &f.scene_hash)).map_err(|errors| reason(errors));
            digest.debug(&fate)
        };
        self.samples.iter().fold(Digest::default(), add).finish()
    }

    /// A sample as it is consolidated and loaded, of the particles of its scene.
    pub(super) fn loaded(&self, w: usize) -> Result<Made, String> {
        let cast = self.cast(w)?;
        cast.loaded().map_err(|errors| reason(&errors))
    }

    /// A sample as it is prepared with a friction.
    pub(super) fn prepared(&self, w: usize, friction: f64) -> Result<Made, String> {
        let cast = self.cast(w)?;
        let mut spec = cast.built.world.clone();
        if let Some(prepare) = &cast.rve.prepare {
            preparing(&mut spec, prepare, friction);
        }
        set_up(&cast, spec).map_err(|errors| reason(&errors))
    }

    fn cast(&self, w: usize) -> Result<Cast, String> {
        let sample = &self.samples[w];
        cast(&self.study, &self.variants[sample.variant], sample.nth).map_err(|errors| reason(&errors))
    }
}

fn cast(study: &Study, variant: &World, nth: u64) -> Result<Cast, Vec<SceneError>> {
    let name = study.scene.display().to_string();
    let rve = study.rve_with(&variant.sets)?;
    let mut sets: Vec<String> = variant.sets.iter().filter(|set| !of_samples(set)).cloned().collect();
    let mut scene = Scene::parse(&name, &study.scene_text, &sets)?;
    if nth > 0 {
        sets.push(format!("seed={}", scene.seed.wrapping_add(nth)));
        scene = Scene::parse(&name, &study.scene_text, &sets)?;
    }
    let mut built = scene.build(study.scene.parent().unwrap_or(Path::new("")))?;
    built.world.throughput = throughput(&scene);
    let wrong = |what: String| Err(vec![built.locate(&SetupError::Invalid(what))]);
    let Some(rve) = rve else {
        return wrong("the study says nothing of periodic samples; write [consolidate] into it".to_owned());
    };
    let follows = |part: &ParticlePart| matches!(part.origin, Origin::Generated { seed: None, .. });
    if rve.seeds > 1 && !scene.particles.iter().any(follows) {
        return wrong(format!(
            "the {} seeds of the study would give the same sample again; take the seeds of particles away, so that they \
             follow the scene's",
            rve.seeds
        ));
    }
    if built.world.particles.is_empty() {
        return wrong("a periodic sample needs particles; write [particles.NAME] into the scene".to_owned());
    }
    Ok(Cast { rve, built })
}

impl Cast {
    /// As it is consolidated and loaded.
    fn loaded(&self) -> Result<Made, Vec<SceneError>> {
        let Rve { consolidate, load, .. } = &self.rve;
        let mut spec = self.built.world.clone();
        // The step follows from the material, whatever the stages.
        let dt = set_up(self, spec.clone())?.constants.dt;
        loading(&mut spec, dt, consolidate, load.as_ref());
        set_up(self, spec)
    }
}

fn set_up(cast: &Cast, spec: WorldSpec) -> Result<Made, Vec<SceneError>> {
    let (constants, state) = prepare(spec).map_err(|e| vec![cast.built.locate(&e)])?;
    Ok(Made { constants, state })
}

fn facts(
    study: &Study,
    variant: &World,
    nth: u64,
    warnings: &mut Vec<String>,
) -> Result<Facts, Vec<SceneError>> {
    let cast = cast(study, variant, nth)?;
    warnings.extend(cast.built.warnings.iter().map(ToString::to_string));
    let seed = cast.built.world.seed;
    let loaded = cast.loaded()?;
    warnings.extend(loaded.constants.warnings.clone());
    let mut prepared_hash = None;
    if let Some(prepare) = &cast.rve.prepare {
        let ends = match prepare.aim {
            Aim::VoidRatio { between, .. } => between,
            Aim::Friction(friction) => [friction; 2],
        };
        for friction in ends {
            let mut spec = cast.built.world.clone();
            preparing(&mut spec, prepare, friction);
            let made = set_up(&cast, spec)?;
            if made.constants.lattice != loaded.constants.lattice {
                return Err(vec![
                    cast.built.locate(&SetupError::Invalid(
                        "contacts of the preparation and of the loading begin at other distances; leave out \
                     prepare.youngs_modulus"
                            .to_owned(),
                    )),
                ]);
            }
            prepared_hash.get_or_insert_with(|| scene_hash(&made.constants, &made.state));
        }
    }
    Ok(Facts {
        rve: cast.rve,
        seed,
        prepared_hash,
        scene_hash: scene_hash(&loaded.constants, &loaded.state),
        particles: loaded.constants.count,
        steps: steps_left(&loaded.constants, &Progress::default()),
    })
}
