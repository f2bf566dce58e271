//! What a sweep will run: the worlds of a study, each made once to see that it can be, and their batches.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glebe_engine::spec::Component;
use glebe_engine::state::{Progress, State};
use glebe_engine::{Constants, prepare};
use glebe_io::scene::{Scene, SceneError};
use glebe_io::study::Study;
use rayon::prelude::*;
use serde::Serialize;

use crate::digest::{Digest, scene_hash};
use crate::drive::steps_left;
use crate::ensemble::divide;
use crate::sample::{self, TooManyDimensions, World};

/// A study with its worlds, each of which was made once, to see that it can be.
pub struct Plan {
    /// The study.
    pub study: Study,
    /// Its worlds, in order.
    pub worlds: Vec<Planned>,
    /// What is measured, by stage.
    pub measures: Vec<Measure>,
    /// What looks wrong with worlds but does not stop them.
    pub warnings: Vec<String>,
    first: Option<Arc<Constants>>,
}

/// A world of a plan.
#[derive(Debug)]
pub struct Planned {
    /// Its values.
    pub world: World,
    /// What is known of it, or why it cannot be set up.
    pub fate: Result<Facts, Vec<SceneError>>,
}

/// What is known of a world before it runs.
#[derive(Clone, Debug)]
pub struct Facts {
    /// Digest of all that it is made of.
    pub scene_hash: String,
    /// Particles at the start.
    pub particles: usize,
    /// The most steps that it takes; stages that wait without limit count as none.
    pub steps: u64,
}

/// A number that worlds measure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Measure {
    /// The stage.
    pub stage: String,
    /// Its name.
    pub name: String,
    /// Its SI unit.
    pub unit: &'static str,
}

impl Measure {
    /// `till.draught_force`
    pub fn full_name(&self) -> String {
        format!("{}.{}", self.stage, self.name)
    }
}

/// A world that was set up.
pub(super) struct Made {
    pub(super) constants: Arc<Constants>,
    pub(super) state: State,
    pub(super) scene_hash: String,
    warnings: Vec<String>,
}

impl Plan {
    /// Chooses the worlds and makes each of them once, without keeping it. None if `interrupted` before the last.
    ///
    /// # Errors
    /// A sampler that cannot spread points over so many parameters.
    pub fn new(
        study: Study,
        interrupted: impl Fn() -> bool + Sync,
    ) -> Result<Option<Self>, TooManyDimensions> {
        let worlds = sample::worlds(&study)?;
        let look = |world: World| {
            if interrupted() {
                return None;
            }
            Some(match make(&study, &world) {
                Ok(made) => {
                    let facts = Facts {
                        scene_hash: made.scene_hash,
                        particles: made.constants.count,
                        steps: steps_left(&made.constants, &Progress::default()),
                    };
                    (Planned { world, fate: Ok(facts) }, made.warnings)
                }
                Err(errors) => (Planned { world, fate: Err(errors) }, Vec::new()),
            })
        };
        let made: Option<Vec<_>> = worlds.into_par_iter().map(look).collect();
        let Some(made) = made else { return Ok(None) };
        let first = made.iter().find(|(planned, _)| planned.fate.is_ok());
        let first =
            first.and_then(|(planned, _)| make(&study, &planned.world).ok()).map(|made| made.constants);
        let measures = first.as_deref().map(measures).unwrap_or_default();
        let mut said: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (w, (_, warnings)) in made.iter().enumerate() {
            for warning in warnings {
                said.entry(warning.clone()).or_default().push(w);
            }
        }
        let warnings = told_once(said, made.len());
        let worlds = made.into_iter().map(|(planned, _)| planned).collect();
        Ok(Some(Self { study, worlds, measures, warnings, first }))
    }

    /// The first world that can be set up, to choose a device for; empty if there is no such world.
    pub fn first(&self) -> &[Arc<Constants>] {
        self.first.as_slice()
    }

    /// How many worlds cannot be set up.
    pub fn refused(&self) -> usize {
        self.worlds.iter().filter(|w| w.fate.is_err()).count()
    }

    /// The worlds of each batch: of those given, in order, as many as memory holds, or in as many batches as asked for.
    pub fn batches(&self, worlds: &[usize], asked: Option<usize>, memory: Option<u64>) -> Vec<Vec<usize>> {
        let particles = |w: usize| self.worlds[w].fate.as_ref().map_or(0, |f| f.particles);
        divide(worlds, particles, asked, memory)
    }

    /// A digest of all worlds.
    pub(super) fn digest(&self) -> String {
        self.worlds
            .iter()
            .fold(Digest::default(), |digest, planned| {
                let fate = planned.fate.as_ref();
                let fate = fate.map(|f| f.scene_hash.as_str()).map_err(|errors| reason(errors));
                digest.debug(&planned.world.sets).debug(&fate)
            })
            .finish()
    }
}

pub(super) fn make(study: &Study, world: &World) -> Result<Made, Vec<SceneError>> {
    let name = study.scene.display().to_string();
    let scene = Scene::parse(&name, &study.scene_text, &world.sets)?;
    let built = scene.build(study.scene.parent().unwrap_or(Path::new("")))?;
    let (constants, state) = prepare(built.world.clone()).map_err(|e| vec![built.locate(&e)])?;
    let scene_hash = scene_hash(&constants, &state);
    let warnings = built.warnings.iter().map(ToString::to_string).chain(constants.warnings.clone()).collect();
    Ok(Made { constants, state, scene_hash, warnings })
}

fn measures(c: &Constants) -> Vec<Measure> {
    let of_stage = |stage: &glebe_engine::spec::Stage| {
        let name = stage.name.clone();
        let measure = move |m: &glebe_engine::spec::Measure| Measure {
            stage: name.clone(),
            name: m.name.clone(),
            unit: if matches!(m.component, Component::Torque(_)) { "N m" } else { "N" },
        };
        stage.measures.iter().map(measure).collect::<Vec<_>>()
    };
    c.spec.stages.iter().flat_map(of_stage).collect()
}

/// What was said of some worlds, each once.
pub(crate) fn told_once(said: BTreeMap<String, Vec<usize>>, all: usize) -> Vec<String> {
    let told = |(text, worlds): (String, Vec<usize>)| match worlds[..] {
        [w] => format!("world {w}: {text}"),
        _ if worlds.len() == all => format!("all worlds: {text}"),
        _ => format!("{} worlds, the first is {}: {text}", worlds.len(), worlds[0]),
    };
    said.into_iter().map(told).collect()
}

/// Why a world cannot be set up, in a line.
pub fn reason(errors: &[SceneError]) -> String {
    let one = |error: &SceneError| match error.advice() {
        Some(advice) => format!("{error} ({advice})"),
        None => error.to_string(),
    };
    errors.iter().map(one).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ensemble::BYTES;

    #[test]
    fn batches_are_as_few_as_memory_holds_or_as_many_as_asked_for() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../io/tests/scene_common");
        let text = "scene = \"example.toml\"\n[vary.s]\npath = \"seed\"\nvalues = [1, 2, 3, 4, 5]\n";
        let study = Study::parse("study.toml", text, &folder, &[]).unwrap();
        let planned = |world| {
            let facts = Facts { scene_hash: String::new(), particles: 1000, steps: 1 };
            Planned { world, fate: Ok(facts) }
        };
        let worlds = sample::worlds(&study).unwrap().into_iter().map(planned).collect();
        let mut plan = Plan { study, worlds, measures: Vec::new(), warnings: Vec::new(), first: None };
        let all = [0, 1, 2, 3, 4];
        let of_worlds = |n: f64| Some((2.0 * n * 1000.0 * BYTES) as u64);
        assert_eq!(plan.batches(&all, None, None), [all]);
        assert_eq!(plan.batches(&all, None, of_worlds(2.5)), [vec![0, 1], vec![2, 3], vec![4]]);
        assert_eq!(plan.batches(&all, Some(2), of_worlds(1.0)), [vec![0, 1, 2], vec![3, 4]]);
        assert_eq!(plan.batches(&[1, 4], Some(9), None), [[1], [4]]);
        assert_eq!(plan.batches(&[], Some(2), None), Vec::<Vec<usize>>::new());
        // One that is larger than the memory is tried alone.
        if let Ok(facts) = &mut plan.worlds[1].fate {
            facts.particles = 9000;
        }
        assert_eq!(plan.batches(&all, None, of_worlds(2.5)), [vec![0], vec![1], vec![2, 3], vec![4]]);
    }
}
