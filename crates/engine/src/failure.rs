//! Why a world could not be set up, or went wrong.

use serde::{Deserialize, Serialize};

use crate::spec::Vec3;

/// Why a specification cannot be run.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SetupError {
    /// A law refused its parameters or materials.
    #[error(transparent)]
    Law(#[from] glebe_physics::LawError),
    /// A law of a pair of materials refused.
    #[error("in the pair `{name}`: {why}")]
    PairLaw {
        /// Index in the specification's pairs.
        pair: usize,
        /// The two materials.
        name: String,
        /// What is wrong.
        why: glebe_physics::LawError,
    },
    /// A periodic axis is too short for the particles.
    #[error(
        "the periodic axis {axis} is {height:.4e} m high, less than two cut-off distances of {cutoff:.4e} m; \
         a particle would meet its own image. Use a larger cell or smaller particles"
    )]
    PeriodicTooShort {
        /// x, y or z.
        axis: char,
        /// Height of the cell \[m\].
        height: f64,
        /// Interaction distance with skin \[m\].
        cutoff: f64,
    },
    /// The step is above the stable one.
    #[error(
        "the time step {step:.3e} s is {share:.0} % of the stable step {stable:.3e} s ({limit}); choose at most \
         {advised:.3e} s, or step = \"auto\", or set time.force = true to run it all the same"
    )]
    StepTooLarge {
        /// As given \[s\].
        step: f64,
        /// Stable step \[s\].
        stable: f64,
        /// Percentage.
        share: f64,
        /// What limits it.
        limit: &'static str,
        /// What `auto` would take \[s\].
        advised: f64,
    },
    /// A surface moves too far in a step.
    #[error(
        "{what}, in the stage `{stage}`; grains pass unseen through what moves more than {most:.0} % of their radius: \
         choose at most time.step = {advised:.3e} s, or move it more slowly"
    )]
    SurfaceTooFast {
        /// The surface, its speed and its way in a step.
        what: String,
        /// When it does.
        stage: String,
        /// Percentage of the smallest radius that is allowed.
        most: f64,
        /// A step with which it moves well \[s\].
        advised: f64,
    },
    /// A particle does not fit.
    #[error("particle {id} at ({:.6}, {:.6}, {:.6}) m {why}", at[0], at[1], at[2])]
    Particle {
        /// Index in the set.
        id: usize,
        /// Centre \[m\].
        at: Vec3,
        /// What is wrong and what to do.
        why: String,
    },
    /// An inlet or outlet cannot work.
    #[error("{why}")]
    Door {
        /// Its name.
        name: String,
        /// What is wrong and what to do.
        why: String,
    },
    /// Something else in the specification.
    #[error("{0}")]
    Invalid(String),
}

/// Why a running world was stopped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[error("at t = {time:.6e} s (step {step}): {what}; {cause}")]
pub struct Failure {
    /// Simulated time \[s\].
    pub time: f64,
    /// Step.
    pub step: u64,
    /// What was found: the particle with its number, position and contacts.
    pub what: String,
    /// The likely cause and what to do.
    pub cause: String,
}
