//! Where worlds run. Every backend takes the same constants and state and gives the same state back; the
//! conformance suites (`tests/`) are written once and run on each.

pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod reference;

pub(crate) mod common;
mod team;
mod worlds;

use std::sync::Arc;

use serde::Serialize;

use crate::failure::Failure;
use crate::measure::Tensors;
use crate::setup::Constants;
use crate::spec::Vec3;
use crate::state::{Particles, Progress, State};

/// A device or a way to use one that is not there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("{what} cannot be used: {why}. What to do: {remedy}")]
pub struct Unavailable {
    /// What was looked for.
    pub what: String,
    /// Why it is not there.
    pub why: String,
    /// How to get it.
    pub remedy: String,
}

impl Unavailable {
    /// From its parts.
    pub fn new(what: &str, why: impl Into<String>, remedy: &str) -> Self {
        Self { what: what.to_owned(), why: why.into(), remedy: remedy.to_owned() }
    }
}

/// Memory that worlds need where they run \[bytes\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// What they need at first; crowds whose lists grow need more.
    pub needed: u64,
    /// What the device has, where it is known.
    pub device: Option<u64>,
}

/// A batch of worlds on a device.
pub trait Fleet: Send {
    /// Advances worlds, each by its own number of steps. A world that fails stops there; the rest go on.
    fn advance(&mut self, jobs: &mut [Job<'_>]);
    /// Energies and contacts of the present configuration of worlds, in their order. Changes nothing.
    fn observe(&mut self, asked: &[(usize, &Progress)]) -> Vec<Moment>;
    /// The same of one world.
    fn moment(&mut self, world: usize, progress: &Progress) -> Moment {
        self.observe(&[(world, progress)]).pop().unwrap_or_default()
    }
    /// Coordination of every particle and the force on every triangle in the present state of a world. Changes nothing.
    fn detail(&mut self, world: usize, state: &State) -> Detail;
    /// The complete state of a world. A pure read: the run goes on as if it had not been taken.
    fn state(&self, world: usize, progress: &Progress) -> State;
    /// The particles of its state, without what contacts remember.
    fn particles(&self, world: usize, progress: &Progress) -> Particles {
        self.state(world, progress).particles
    }
    /// Replaces the state of a world.
    fn load(&mut self, world: usize, state: &mut State);
    /// Takes in what of a world changed that is not of its particles, of which lists know: surfaces that came or went.
    fn renew(&mut self, world: usize, progress: &mut Progress) {
        let mut state = self.state(world, progress);
        self.load(world, &mut state);
        *progress = state.progress;
    }
    /// Why the backend can no longer be trusted, as the failure of a world; what was read of it last may be wrong.
    fn fault(&self, _world: usize, _progress: &Progress) -> Option<Failure> {
        None
    }
    /// Time spent in a world's phases since it was loaded.
    fn times(&self, world: usize) -> PhaseTimes;
    /// Bytes of memory per particle of a world.
    fn bytes_per_particle(&self, world: usize) -> f64;
}

/// Memory of a particle in a dense bed: state, lists, contact history \[bytes\].
pub const BYTES_PER_PARTICLE: f64 = 700.0;

/// Steps asked of one world.
pub struct Job<'a> {
    /// Which world.
    pub world: usize,
    /// How many steps.
    pub steps: u64,
    /// Its progress, carried on.
    pub progress: &'a mut Progress,
    /// How it went.
    pub outcome: Result<(), Failure>,
}

/// Sums over a world at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// Kinetic energy of translation \[J\].
    pub translation: f64,
    /// Kinetic energy of rotation \[J\].
    pub rotation: f64,
    /// Potential energy in gravity \[J\].
    pub potential: f64,
    /// Energy of normal springs and cohesion \[J\].
    pub elastic_normal: f64,
    /// Energy of tangential springs \[J\].
    pub elastic_tangential: f64,
    /// Pairs in contact.
    pub contacts: u64,
    /// Contacts with surfaces.
    pub surface_contacts: u64,
    /// Largest overlap as a fraction of the smaller radius.
    pub overlap: f64,
    /// Largest speed \[m/s\].
    pub speed: f64,
    /// Sums over the contacts of a sample ([`Constants::is_sample`]).
    pub tensors: Option<Tensors>,
}

impl Moment {
    /// Kinetic energy \[J\].
    pub fn kinetic(&self) -> f64 {
        self.translation + self.rotation
    }
}

/// A world in detail.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Detail {
    /// Contacts of each particle, in the order of storage.
    pub coordination: Vec<u32>,
    /// Contacts of particles with each other.
    pub network: Vec<Link>,
    /// Contacts of particles with surfaces and walls.
    pub touches: Vec<Touch>,
    /// For each surface of the specification the force of the particles on each triangle \[N\]; one entry
    /// for a plane.
    pub on_triangles: Vec<Vec<[f64; 3]>>,
}

/// Two particles in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Their numbers.
    pub id: [u32; 2],
    /// From the first to the nearest image of the second \[m\].
    pub branch: Vec3,
    /// Force on the first \[N\].
    pub force: [f32; 3],
}

/// A particle in contact with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// The particle's number.
    pub id: u32,
    /// The surface; domain sides come after the specification's surfaces.
    pub surface: u32,
    /// From the particle to where they touch \[m\].
    pub branch: Vec3,
    /// Force on the particle \[N\].
    pub force: [f32; 3],
}

/// Seconds spent in each phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PhaseTimes {
    /// Ordering and neighbour lists.
    pub lists: f64,
    /// Contact detection and forces.
    pub forces: f64,
    /// Sums and integration.
    pub integration: f64,
    /// Dissipation accounts.
    pub ledger: f64,
    /// Motion of surfaces.
    pub surfaces: f64,
    /// All of these on a device, which takes steps without the host and does not tell them apart.
    pub device: f64,
    /// Looks at the energies and sums of worlds on a device, for samples.
    pub looks: f64,
}

impl PhaseTimes {
    /// Names and values of what the backend tells apart, for tables.
    pub fn rows(&self) -> Vec<(&'static str, f64)> {
        if self.device + self.looks > 0.0 {
            return vec![("device", self.device), ("looks", self.looks)];
        }
        vec![
            ("lists", self.lists),
            ("forces", self.forces),
            ("integration", self.integration),
            ("ledger", self.ledger),
            ("surfaces", self.surfaces),
        ]
    }
}

/// The backends, by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Backend {
    /// Threads and vector units of the host.
    #[default]
    Cpu,
    /// Every pair in f64, without lists: slow, and what the others are compared with.
    Reference,
    /// A graphics processor.
    #[cfg(feature = "gpu")]
    Gpu(gpu::Accelerator),
}

impl Backend {
    /// Every backend.
    pub const ALL: &'static [Self] = &[Self::Cpu, Self::Reference];

    /// Name of the backend.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Reference => "reference",
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => "gpu",
        }
    }

    /// What computes, for people.
    pub fn device(self) -> String {
        match self {
            #[cfg(feature = "gpu")]
            Self::Gpu(accelerator) => accelerator.name(),
            host => format!("{} ({} threads)", host.name(), rayon::current_num_threads()),
        }
    }

    /// What the bits of a run belong to: the name of the backend on the host, where any number of threads
    /// gives the same; elsewhere the device.
    pub fn maker(self) -> String {
        match self {
            Self::Cpu | Self::Reference => self.name().to_owned(),
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => self.device(),
        }
    }

    /// Why worlds cannot be run together on the backend.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "the host runs any world"))]
    pub fn refusal(self, worlds: &[Arc<Constants>]) -> Option<String> {
        match self {
            #[cfg(feature = "gpu")]
            Self::Gpu(accelerator) => accelerator.refusal(worlds),
            Self::Cpu | Self::Reference => None,
        }
    }

    /// Why a world of so many particles has no room on the backend, whatever they are.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "the host runs any world"))]
    pub fn crowded(self, particles: usize) -> Option<String> {
        match self {
            #[cfg(feature = "gpu")]
            Self::Gpu(accelerator) => accelerator.crowded(particles),
            Self::Cpu | Self::Reference => None,
        }
    }

    /// The memory that worlds need on the backend's device; none for the host, which does not know beforehand.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "the host does not know"))]
    pub fn memory(self, worlds: &[Arc<Constants>]) -> Option<Memory> {
        match self {
            #[cfg(feature = "gpu")]
            Self::Gpu(accelerator) => Some(accelerator.memory(worlds)),
            Self::Cpu | Self::Reference => None,
        }
    }

    /// A batch of worlds on the backend.
    pub fn fleet(self, worlds: Vec<(Arc<Constants>, &mut State)>) -> Box<dyn Fleet> {
        match self {
            Self::Cpu => Box::new(cpu::CpuFleet::new(worlds)),
            Self::Reference => Box::new(reference::ReferenceFleet::new(worlds)),
            #[cfg(feature = "gpu")]
            Self::Gpu(accelerator) => accelerator.fleet(worlds),
        }
    }
}
