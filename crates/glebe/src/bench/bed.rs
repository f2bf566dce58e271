//! The bed that is timed, and how it is settled once and kept.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Frame, Observer, Sample, Status};
use glebe_engine::generate::{FillRequest, GenerateError, Region, SizeDistribution, generate, solid_volume};
use glebe_engine::spec::{Domain, Side, Stage, Step, Time, Until, Vec3, WorldSpec};
use glebe_engine::state::{StageResult, State};
use glebe_engine::{Constants, SetupError, prepare};
use glebe_io::checkpoint::{self, CheckpointError, Header};
use glebe_io::output::OutputError;
use glebe_physics::{IntegratorKind, LawChoice, Material};
use sha2::{Digest, Sha256};

use super::BenchError;
use crate::cli::Ui;

/// Sizes of a bed's particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BedKind {
    /// R = 2 mm, step 1e-5 s.
    Mono,
    /// R = 1.6 to 2.4 mm, evenly by number, step 9e-6 s.
    Poly,
}

impl BedKind {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono => "mono",
            Self::Poly => "poly",
        }
    }

    /// Least and largest radius \[m\].
    fn radii(self) -> [f64; 2] {
        match self {
            Self::Mono => [2e-3; 2],
            Self::Poly => [1.6e-3, 2.4e-3],
        }
    }

    /// Time step \[s\].
    pub fn step(self) -> f64 {
        match self {
            Self::Mono => 1e-5,
            Self::Poly => 9e-6,
        }
    }
}

/// Solid fraction of the bed when it is made.
const SOLID_FRACTION: f64 = 0.60;
/// Solid fraction below which no bed is made.
const LOOSEST: f64 = 0.50;
/// Height of the open-topped box over its width; the bed fills about a cube.
const HEADROOM: f64 = 1.25;
const SEED: u64 = 1;
/// Steps between samples.
pub const SAMPLE_STEPS: u64 = 1000;
/// Kinetic energy below which a bed counts as settled, over that of a fall of every particle by 2 mm (R of
/// the mono bed).
const SETTLED: f64 = 1e-4;
/// Most time that settling takes \[s\].
const SETTLE_MOST: f64 = 0.2;
/// Steps before timing: lists and caches warm up.
pub const WARM_UP: u64 = 100;

/// A bed.
#[derive(Clone, Copy, Debug)]
pub struct Bed {
    /// Sizes of its particles.
    pub kind: BedKind,
    /// How many.
    pub count: usize,
}

/// A settled bed.
pub struct Settled {
    /// Its state after the stage in which it settled.
    pub state: State,
    /// Whether it was found in the cache.
    pub cached: bool,
}

impl Bed {
    pub fn material() -> Material {
        Material {
            name: "glass".to_owned(),
            density: 2600.0,
            youngs_modulus: 2e8,
            poissons_ratio: 0.3,
            restitution: 0.5,
            friction: 0.5,
            static_friction: 0.5,
            rolling_friction: 0.01,
        }
    }

    fn radii(&self) -> Result<Vec<f64>, GenerateError> {
        let [min, max] = self.kind.radii();
        if min == max {
            return Ok(vec![min; self.count]);
        }
        SizeDistribution::Uniform { min, max }.sample(self.count, SEED)
    }

    /// Width of the box \[m\].
    fn width(radii: &[f64]) -> f64 {
        (solid_volume(radii) / SOLID_FRACTION).cbrt()
    }

    /// The bed's world: it settles, warms up, and runs for `steps`. Its particles have the radii given and
    /// are where `place` puts them.
    fn world(&self, radii: &[f64], place: impl Fn(usize) -> Vec3, steps: u64, ledger: bool) -> WorldSpec {
        let width = Self::width(radii);
        let sides = [[Side::Wall; 2], [Side::Wall; 2], [Side::Wall, Side::Open]];
        let domain = Domain::aligned([0.0; 3], [width, width, HEADROOM * width], sides, Some(0));
        let dt = self.kind.step();
        let time = Time { step: Step::Fixed(dt), integrator: IntegratorKind::Euler, force: false };
        let mut world = WorldSpec::new(domain, time);
        world.title = format!("{} bed of {}", self.kind.name(), self.count);
        world.materials = vec![Self::material()];
        world.contact.rolling = LawChoice::named("constant-torque");
        world.gravity = [0.0, 0.0, -9.81];
        world.sampling.series = SAMPLE_STEPS as f64 * dt;
        world.sampling.energy_ledger = ledger;
        for (i, r) in radii.iter().enumerate() {
            world.particles.push(place(i), *r, 0);
        }
        let weight = solid_volume(radii) * Self::material().density * 9.81;
        let stage = |name: &str, kinetic_energy_below, at_most| Stage {
            name: name.to_owned(),
            until: Until { kinetic_energy_below, at_most: Some(at_most) },
            ..Stage::default()
        };
        world.stages = vec![
            stage("settle", Some(SETTLED * weight * 2e-3), SETTLE_MOST),
            stage("warm up", None, WARM_UP as f64 * dt),
            stage("timed", None, steps as f64 * dt),
        ];
        world
    }

    /// Constants of the settled bed's world. They depend on radii and not on places, which are the state's.
    pub fn constants(&self, steps: u64, ledger: bool) -> Result<Arc<Constants>, BenchError> {
        let radii = self.radii()?;
        let middle = 0.5 * Self::width(&radii);
        Ok(prepare(self.world(&radii, |_| [middle; 3], steps, ledger))?.0)
    }

    /// The settled bed: from the folder `cache` if it is there, else made, and kept there.
    pub fn settled(&self, cache: Option<&Path>, ui: &Ui) -> Result<Settled, BenchError> {
        let key = self.key()?;
        let path = cache.map(|folder| folder.join(format!("{key}.glebe")));
        if let Some(state) = path.as_deref().and_then(|path| load(path, &key)) {
            return Ok(Settled { state, cached: true });
        }
        ui.note(&format!("settling the {} bed of {} particles", self.kind.name(), self.count));
        let state = self.settle()?;
        if let Some(path) = path {
            store(&path, key, &state)?;
        }
        Ok(Settled { state, cached: false })
    }

    fn settle(&self) -> Result<State, BenchError> {
        let radii = self.radii()?;
        let width = Self::width(&radii);
        let region = Region::walled([0.0; 3], [width, width, HEADROOM * width]);
        let places = dense(FillRequest::new(region, &radii, SEED))?;
        let world = self.world(&radii, |i| places[i], 1, false);
        let mut batch = Batch::new(vec![world], Backend::Cpu).map_err(|(_, e): (usize, SetupError)| e)?;
        while batch.running() && batch.progress(0).stage == 0 {
            let Ok(()) = batch.advance(&mut Blind);
        }
        match batch.status(0) {
            Status::Failed(_) => {
                Err(BenchError::Stopped { count: self.count, status: batch.status(0).clone() })
            }
            _ => Ok(batch.state(0)),
        }
    }

    /// A digest of all that the settled bed depends on.
    fn key(&self) -> Result<String, BenchError> {
        let plan = self.world(&self.radii()?, |_| [0.0; 3], 1, false);
        let what = format!("{} {SOLID_FRACTION} {SEED} {plan:?}", env!("CARGO_PKG_VERSION"));
        // Writing to a string does not fail.
        Ok(Sha256::digest(what).iter().fold(String::new(), |mut hex, byte| {
            let _ = write!(hex, "{byte:02x}");
            hex
        }))
    }
}

/// A packing as dense as [`SOLID_FRACTION`], or, in boxes so narrow that their walls do not let it be,
/// nearly so.
fn dense(request: FillRequest<'_>) -> Result<Vec<Vec3>, GenerateError> {
    let mut fraction = SOLID_FRACTION;
    loop {
        match generate("dense", &FillRequest { solid_fraction: Some(fraction), ..request }) {
            Err(GenerateError::Jammed { .. }) if fraction > LOOSEST => fraction -= 0.02,
            ended => return ended,
        }
    }
}

/// The state in a file, if it is there, whole, and this bed's.
fn load(path: &Path, key: &str) -> Option<State> {
    let found = checkpoint::read(path).ok().filter(|c| c.header.scene_hash == key)?;
    State::from_bytes(&found.state).ok()
}

fn store(path: &Path, scene_hash: String, state: &State) -> Result<(), CheckpointError> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|source| OutputError::Io {
            path: folder.to_owned(),
            action: "make this folder",
            source,
        })?;
    }
    let header = Header {
        glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
        scene_hash,
        step: state.progress.step,
        ..Header::default()
    };
    checkpoint::write(path, &header, &state.to_bytes())
}

/// Looks at nothing.
pub struct Blind;

impl Observer for Blind {
    type Error = std::convert::Infallible;
    fn sample(&mut self, _: usize, _: &Sample) -> Result<(), Self::Error> {
        Ok(())
    }
    fn frame(&mut self, _: usize, _: &Frame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }
    fn stage_ended(&mut self, _: usize, _: usize, _: &StageResult) -> Result<(), Self::Error> {
        Ok(())
    }
}
