//! The bed that is timed, and how it is prepared once and kept.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status, positions};
use glebe_engine::generate::{FillRequest, GenerateError, Region, generate, solid_volume};
use glebe_engine::lattice::{add, cross};
use glebe_engine::spec::{
    Deformation, Domain, Drive, Search, Side, Stage, Step, Time, Until, Vec3, WorldSpec,
};
use glebe_engine::state::State;
use glebe_engine::{Constants, prepare};
use glebe_io::checkpoint::{self, Header};
use glebe_io::output::write_atomic;
use glebe_physics::IntegratorKind;
use sha2::{Digest, Sha256};

use super::BenchError;
use super::drum::Drum;
use super::grading::BedKind;
use super::tool::{Placed, Tool};
use crate::cli::Ui;
use crate::device::admit;

/// Solid fraction of the bed when it is made.
const SOLID_FRACTION: f64 = 0.60;
/// Solid fraction below which no bed is made.
const LOOSEST: f64 = 0.50;
/// Height of the open-topped box over its width; the bed fills about a cube.
const HEADROOM: f64 = 1.25;
const SEED: u64 = 1;
/// Gravity \[m/s²\].
pub const GRAVITY: f64 = 9.81;
/// Steps between samples.
pub const SAMPLE_STEPS: u64 = 1000;
/// Kinetic energy below which a bed counts as settled, over that of a fall of every particle by 2 mm (R of
/// the mono bed).
const SETTLED: f64 = 1e-4;
/// Most time that settling takes \[s\].
const SETTLE_MOST: f64 = 0.2;
/// Time in which the bed that other engines are compared on settles \[s\].
const SETTLE_PEERS: f64 = 0.4;
/// Stress at which a periodic sample is consolidated and held across \[Pa\].
const PRESSURE: f64 = 1e5;
/// Inertial number at which it is consolidated and compressed \[-\].
const INERTIAL: f64 = 1e-3;
/// Most time that its consolidation takes \[s\].
const CONSOLIDATE_MOST: f64 = 0.2;
/// Particles from which on a settled mono bed is made of copies of a periodic packing and timed as it is: to make it in one
/// piece and to let it settle would take hours.
const VAST: usize = 8_000_000;
/// Particles of the packing that is copied, at most.
const COPIED: f64 = 2e5;
/// Steps before timing: lists and caches warm up.
pub const WARM_UP: u64 = 100;

/// What a bed does while it is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// It rests in a box, so settled that lists hardly age.
    Settled,
    /// It flows in a rotating drum.
    Flowing,
    /// It is a periodic sample, compressed along z with the stress across held.
    Loaded,
    /// A tool is drawn or turned through it.
    Tilled(Tool),
}

impl Mode {
    /// The modes without a tool.
    pub const ALL: [Self; 3] = [Self::Settled, Self::Flowing, Self::Loaded];

    /// Name in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Settled => "settled",
            Self::Flowing => "flowing",
            Self::Loaded => "loaded",
            Self::Tilled(tool) => tool.name(),
        }
    }
}

/// A bed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bed {
    /// Sizes of its particles.
    pub kind: BedKind,
    /// What it does.
    pub mode: Mode,
    /// How many.
    pub count: usize,
}

/// A bed that can be timed.
pub struct Prepared {
    /// Its state after the stage that prepares it.
    pub state: State,
    /// Whether it was found in the cache.
    pub cached: bool,
}

impl std::fmt::Display for Bed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {} bed of {} particles", self.mode.name(), self.kind.name(), self.count)
    }
}

impl Bed {
    fn radii(&self) -> Result<Vec<f64>, GenerateError> {
        self.kind.spheres(self.count, SEED)
    }

    /// The drum that it flows in, if it does.
    pub fn drum(&self) -> Result<Option<Drum>, GenerateError> {
        Ok(match self.mode {
            Mode::Settled | Mode::Loaded | Mode::Tilled(_) => None,
            Mode::Flowing => Some(Drum::about_half_full_of(&self.radii()?)),
        })
    }

    /// The tool in it, if there is one.
    pub fn tool(&self) -> Result<Option<Placed>, BenchError> {
        let Mode::Tilled(tool) = self.mode else { return Ok(None) };
        Ok(Some(tool.placed(self.count, solid_volume(&self.radii()?))?))
    }

    /// Stages in which it is prepared.
    pub fn preparing(&self) -> usize {
        match self.mode {
            // Soil settles, then the sweep enters.
            Mode::Tilled(Tool::Sweep | Tool::FineSweep) => 2,
            _ if self.is_vast() => 0,
            _ => 1,
        }
    }

    /// Whether it is made of copies and timed as it is.
    fn is_vast(&self) -> bool {
        self.mode == Mode::Settled && self.kind == BedKind::Mono && self.count >= VAST
    }

    /// Width of the box \[m\].
    fn width(radii: &[f64]) -> f64 {
        (solid_volume(radii) / SOLID_FRACTION).cbrt()
    }

    /// Where the spheres are at first \[m\].
    fn places(&self, radii: &[f64]) -> Result<Vec<Vec3>, BenchError> {
        let places = match self.mode {
            Mode::Settled if self.is_vast() => copied(radii, Self::width(radii), COPIED),
            Mode::Settled => {
                let width = Self::width(radii);
                let region = Region::walled([0.0; 3], [width, width, HEADROOM * width]);
                dense(FillRequest::new(region, radii, SEED))
            }
            Mode::Loaded => {
                let region =
                    Region { periodic: [true; 3], ..Region::walled([0.0; 3], [Self::width(radii); 3]) };
                dense(FillRequest::new(region, radii, SEED))
            }
            Mode::Flowing => generate("rain", &Drum::about_half_full_of(radii).cloud(radii, SEED)),
            Mode::Tilled(tool) => {
                let cloud = tool.placed(self.count, solid_volume(radii))?.cloud;
                generate("rain", &FillRequest::new(cloud, radii, SEED))
            }
        };
        Ok(places?)
    }

    /// The bed's world: it is prepared, warms up, and runs for `steps`. Its particles have the radii given and
    /// are where `place` puts them.
    fn world(
        &self,
        radii: &[f64],
        place: impl Fn(usize) -> Vec3,
        steps: u64,
        ledger: bool,
    ) -> Result<WorldSpec, BenchError> {
        let dt = self.kind.step();
        let time = Time { step: Step::Fixed(dt), integrator: IntegratorKind::Euler, force: false };
        let stage = |name: &str, kinetic_energy_below, at_most| Stage {
            name: name.to_owned(),
            until: Until { kinetic_energy_below, at_most: Some(at_most), ..Until::default() },
            ..Stage::default()
        };
        let drum = Drum::about_half_full_of(radii);
        let weight = solid_volume(radii) * self.kind.material().density * GRAVITY;
        let (domain, surfaces, spin, leading) = match self.mode {
            Mode::Settled => {
                let width = Self::width(radii);
                let sides = [[Side::Wall; 2], [Side::Wall; 2], [Side::Wall, Side::Open]];
                let domain = Domain::aligned([0.0; 3], [width, width, HEADROOM * width], sides, Some(0));
                let settle = match self.kind {
                    BedKind::Peers => stage("settle", None, SETTLE_PEERS),
                    _ => stage("settle", Some(SETTLED * weight * 2e-3), SETTLE_MOST),
                };
                (domain, Vec::new(), [0.0; 3], if self.is_vast() { Vec::new() } else { vec![settle] })
            }
            Mode::Loaded => {
                let domain =
                    Domain::aligned([0.0; 3], [Self::width(radii); 3], [[Side::Periodic; 2]; 3], None);
                let until =
                    Until { stress_within: Some(0.01), at_most: Some(CONSOLIDATE_MOST), ..Until::default() };
                let hold = [Drive::Stress(PRESSURE), Drive::Stress(PRESSURE), Drive::Stress(PRESSURE)];
                let consolidate =
                    Stage { deformation: Some(driven(hold)), until, ..stage("consolidate", None, 0.0) };
                (domain, Vec::new(), [0.0; 3], vec![consolidate])
            }
            // The grains turn with the drum from the start.
            Mode::Flowing => (
                drum.domain(),
                vec![drum.surface()?],
                drum.spin(),
                vec![stage("develop", None, drum.develop())],
            ),
            Mode::Tilled(tool) => {
                let placed = tool.placed(self.count, solid_volume(radii))?;
                let sides = [[Side::Wall; 2], [Side::Wall; 2], [Side::Wall, Side::Open]];
                let domain = Domain::aligned(placed.region[0], placed.region[1], sides, Some(0));
                let moving =
                    Stage { moves: vec![(0, placed.motion)], ..stage("enter", None, placed.develop) };
                // As the main job: from a fall of a metre the kinetic energy left is a ten-thousandth.
                let settle = stage("settle", Some(1e-4 * weight), 2.0);
                let leading = if placed.waits { vec![settle, moving] } else { vec![moving] };
                (domain, vec![placed.surface], [0.0; 3], leading)
            }
        };
        let mut world = WorldSpec::new(domain, time);
        world.title = format!("{} bed of {}", self.kind.name(), self.count);
        world.materials = vec![self.kind.material()];
        // Soft soil overlaps deeply where it lands.
        world.guards.overlap_stops = self.kind != BedKind::Soil;
        world.contact.rolling = self.kind.rolling();
        world.gravity = [0.0, 0.0, if self.mode == Mode::Loaded { 0.0 } else { -GRAVITY }];
        world.sampling.series = SAMPLE_STEPS as f64 * dt;
        world.sampling.energy_ledger = ledger;
        world.surfaces = surfaces;
        for (i, r) in radii.iter().enumerate() {
            let at = place(i);
            world.particles.push_moving(at, *r, 0, cross(spin, at), spin);
        }
        let moves = leading.last().map_or_else(Vec::new, |s| s.moves.clone());
        let more = [("first step", 1), ("warm up", WARM_UP), ("timed", steps)];
        let deformation = (self.mode == Mode::Loaded).then(|| self.axial(radii));
        let more = more.map(|(name, n)| Stage {
            moves: moves.clone(),
            deformation,
            ..stage(name, None, n as f64 * dt)
        });
        world.stages = leading.into_iter().chain(more).collect();
        Ok(world)
    }

    /// The compression of a sample along z, as fast as the inertial number allows.
    fn axial(&self, radii: &[f64]) -> Deformation {
        let diameter = 2.0 * radii.iter().sum::<f64>() / radii.len() as f64;
        let rate = INERTIAL / (diameter * (self.kind.material().density / PRESSURE).sqrt());
        driven([Drive::Stress(PRESSURE), Drive::Stress(PRESSURE), Drive::Rate(rate)])
    }

    /// Constants of the prepared bed's world, and with friction less by the share `among` if it is one of many. They depend
    /// on radii and not on places, which are the state's.
    pub fn constants(
        &self,
        steps: u64,
        search: Search,
        ledger: bool,
        among: Option<f64>,
    ) -> Result<Arc<Constants>, BenchError> {
        let radii = self.radii()?;
        let inside = match self.mode {
            Mode::Settled | Mode::Loaded => [0.5 * Self::width(&radii); 3],
            Mode::Flowing => [0.0; 3],
            Mode::Tilled(tool) => {
                let cloud = tool.placed(self.count, solid_volume(&radii))?.cloud;
                [0, 1, 2].map(|k| 0.5 * (cloud.min[k] + cloud.max[k]))
            }
        };
        let mut world = self.world(&radii, |_| inside, steps, ledger)?;
        world.materials[0].friction *= 1.0 - among.unwrap_or(0.0);
        world.throughput = among.is_some();
        world.search = search;
        Ok(prepare(world)?.0)
    }

    /// The bed, prepared: from the folder `cache` if it is there, whatever made it, else made, and kept there.
    pub fn prepared(&self, cache: Option<&Path>, backend: Backend, ui: &Ui) -> Result<Prepared, BenchError> {
        if self.is_vast() {
            ui.note(&format!("the {self} is timed as it is made, of copies of a periodic packing"));
            return Ok(Prepared { state: self.start()?.1, cached: false });
        }
        let key = self.key()?;
        let path = cache.map(|folder| folder.join(format!("{key}.glebe")));
        if let Some(state) = path.as_deref().and_then(|path| checkpoint::kept(path, &key)) {
            return Ok(Prepared { state, cached: true });
        }
        ui.note(&format!("preparing the {self}"));
        let state = self.prepare(backend)?;
        if let Some(path) = path {
            let header = Header {
                glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
                scene_hash: key,
                step: state.progress.step,
                ..Header::default()
            };
            checkpoint::keep(&path, &header, &state)?;
        }
        Ok(Prepared { state, cached: false })
    }

    /// The bed as it is made.
    fn start(&self) -> Result<(Arc<Constants>, State), BenchError> {
        let radii = self.radii()?;
        let places = self.places(&radii)?;
        Ok(prepare(self.world(&radii, |i| places[i], 1, false)?)?)
    }

    fn prepare(&self, backend: Backend) -> Result<State, BenchError> {
        let (constants, state) = self.start()?;
        admit(backend, std::slice::from_ref(&constants))?;
        let mut batch = Batch::from_states(vec![(constants, state)], backend);
        while batch.running() && batch.progress(0).stage < self.preparing() {
            let Ok(()) = batch.advance(&mut Blind);
        }
        match batch.status(0) {
            Status::Failed(_) => Err(BenchError::Stopped { bed: *self, status: batch.status(0).clone() }),
            _ => batch
                .sound_state(0)
                .map_err(|failure| BenchError::Stopped { bed: *self, status: Status::Failed(failure) }),
        }
    }

    /// Writes the prepared bed as `<bed>-<mode>-<particles>.csv`: a row of place \[m\], radius \[m\] and velocity
    /// \[m/s\] per particle, in the order of their numbers.
    pub fn write(&self, prepared: &Prepared, folder: &Path) -> Result<(), BenchError> {
        let constants = self.constants(1, Search::Grid, false, None)?;
        let particles = &prepared.state.particles;
        let mut rows: Vec<_> = positions(&constants, &prepared.state)
            .into_iter()
            .zip(&particles.place)
            .zip(&particles.velocity)
            .zip(&particles.id)
            .collect();
        rows.sort_by_key(|(_, id)| **id);
        let name = format!("{}-{}-{}.csv", self.kind.name().replace(':', "to"), self.mode.name(), self.count);
        write_atomic(&folder.join(name), |out| {
            writeln!(out, "x,y,z,radius,vx,vy,vz")?;
            for (((x, place), velocity), _) in &rows {
                let ([x, y, z], [u, v, w]) = (x, velocity.v);
                writeln!(out, "{x},{y},{z},{},{u},{v},{w}", place.radius)?;
            }
            Ok(())
        })?;
        Ok(())
    }

    /// A digest of all that the prepared bed depends on.
    fn key(&self) -> Result<String, BenchError> {
        let plan = self.world(&self.radii()?, |_| [0.0; 3], 1, false)?;
        let what = format!("{} {SOLID_FRACTION} {SEED} {plan:?}", env!("CARGO_PKG_VERSION"));
        // Writing to a string does not fail.
        Ok(Sha256::digest(what).iter().fold(String::new(), |mut hex, byte| {
            let _ = write!(hex, "{byte:02x}");
            hex
        }))
    }
}

/// A cell without shear, driven along its axes.
fn driven([x, y, z]: [Drive; 3]) -> Deformation {
    let still = Drive::Rate(0.0);
    Deformation { drive: [x, y, z, still, still, still], inertial_number: INERTIAL, ..Deformation::default() }
}

/// Equal spheres in a cube of that width: copies of a dense periodic packing of at most so many, from below.
fn copied(radii: &[f64], width: f64, most: f64) -> Result<Vec<Vec3>, GenerateError> {
    let copies = (radii.len() as f64 / most).cbrt().ceil() as usize;
    let many = radii.len().div_ceil(copies.pow(3)).min(radii.len());
    // A sphere's radius is left free at the sides.
    let margin = radii.first().copied().unwrap_or_default();
    let side = (width - 2.0 * margin) / copies as f64;
    let sides = [side, side, solid_volume(&radii[..many]) / (SOLID_FRACTION * side * side)];
    let region = Region { periodic: [true; 3], ..Region::walled([0.0; 3], sides) };
    let packing = generate("dense", &FillRequest::new(region, &radii[..many], SEED))?;
    let at = |copy: usize| {
        let place = [copy % copies, copy / copies % copies, copy / copies.pow(2)];
        [0, 1, 2].map(|k| margin + place[k] as f64 * sides[k])
    };
    let places = (0..copies.pow(3)).flat_map(|copy| packing.iter().map(move |x| add(*x, at(copy))));
    Ok(places.take(radii.len()).collect())
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

#[cfg(test)]
mod tests {
    use glebe_engine::lattice::{norm, sub};

    use super::*;

    #[test]
    fn copies_of_a_packing_fit_together_and_into_the_box() {
        let radii = [2e-3; 2000];
        let width = Bed::width(&radii);
        let places = copied(&radii, width, 260.0).unwrap();
        assert_eq!(places.len(), radii.len());
        for (k, a) in places.iter().enumerate() {
            assert!(a[..2].iter().all(|x| (radii[0]..=width - radii[0]).contains(x)), "{a:?}");
            assert!((radii[0]..HEADROOM * width).contains(&a[2]), "{a:?}");
            let near = places[..k].iter().map(|b| norm(sub(*a, *b))).fold(f64::INFINITY, f64::min);
            // The packing's spheres overlap by at most a hundredth.
            assert!(near >= 1.99 * radii[0], "{near:e}");
        }
    }
}
