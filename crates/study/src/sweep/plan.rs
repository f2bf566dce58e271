//! What a sweep will run: the worlds of a study, each made once to see that it can be, and their batches.

use std::collections::BTreeMap;
use std::sync::Arc;

use glebe_engine::Constants;
use glebe_engine::state::Progress;
use glebe_io::scene::SceneError;
use glebe_io::study::Study;
use rayon::prelude::*;

use crate::digest::Digest;
use crate::drive::steps_left;
use crate::ensemble::{Measure, divide, make, measures, reason, told_once};
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
            Some(match make(&study.scene, &study.scene_text, &world.sets) {
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
        let first = first
            .and_then(|(planned, _)| make(&study.scene, &study.scene_text, &planned.world.sets).ok())
            .map(|made| made.constants);
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
