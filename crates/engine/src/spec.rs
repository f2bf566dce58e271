//! What a world is made of, before it runs: plain data in SI units and f64, filled by scene files, by
//! the library's users and by tests, and never changed by the engine.
//!
//! Axes are right-handed. Stress, strain and overlap are positive in compression.

use std::sync::Arc;

use crate::exchange::{Inlet, Outlet};
use crate::field::FieldSpec;
use crate::poses::PoseTable;
use glebe_physics::{ContactModel, IntegratorKind, Material, Mixing, PairOverride, ShearModulusRule};

/// A vector in SI units.
pub type Vec3 = [f64; 3];

/// Index into [`WorldSpec::materials`].
pub type MaterialId = usize;

/// One independent simulation.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct WorldSpec {
    /// Name for messages and output.
    pub title: String,
    /// Seed of everything random in this world.
    pub seed: u64,
    /// The box or cell, and what its sides do.
    pub domain: Domain,
    /// All materials: of particles, walls and tools.
    pub materials: Vec<Material>,
    /// How values of pairs are mixed.
    pub mixing: Mixing,
    /// Which G* expression is used.
    pub shear_modulus: ShearModulusRule,
    /// Pairs that set values themselves; unordered.
    pub pairs: Vec<(MaterialId, MaterialId, PairOverride)>,
    /// The contact laws.
    pub contact: ContactModel,
    /// Gravity \[m/s²\].
    pub gravity: Vec3,
    /// Local non-viscous damping C \[-\], in [0, 1).
    pub local_damping: f64,
    /// Step and integrator.
    pub time: Time,
    /// When a run is stopped because it went wrong.
    pub guards: Guards,
    /// The particles at the start.
    pub particles: ParticleSet,
    /// Where particles come in.
    pub inlets: Vec<Inlet>,
    /// Where they are taken away.
    pub outlets: Vec<Outlet>,
    /// Walls, planes and meshes, besides the domain's own sides.
    pub surfaces: Vec<Surface>,
    /// What happens, in order. At least one.
    pub stages: Vec<Stage>,
    /// How often the world is observed.
    pub sampling: Sampling,
    /// Whether the world is one of many that run together: a GPU then takes kernels that are slower for a world alone and
    /// faster for many. They round otherwise, so this belongs to the world, which has the same bits wherever it runs.
    pub throughput: bool,
    /// How particles find those near to them.
    pub search: Search,
    /// Fields that are measured.
    pub fields: Vec<FieldSpec>,
    /// Whether frames show contacts.
    pub network: bool,
    /// By material, what surfaces of it lose to wear: volume over the work of sliding on them, Archard's `k / H`
    /// \[1/Pa\]; 0 for none, and empty where nothing wears.
    pub wear: Vec<f64>,
}

impl WorldSpec {
    /// An empty world in `domain`: no particles, no stages, default laws, no gravity.
    pub fn new(domain: Domain, time: Time) -> Self {
        Self {
            title: String::new(),
            seed: 1,
            domain,
            materials: Vec::new(),
            mixing: Mixing::default(),
            shear_modulus: ShearModulusRule::default(),
            pairs: Vec::new(),
            contact: ContactModel::default(),
            gravity: [0.0; 3],
            local_damping: 0.0,
            time,
            guards: Guards::default(),
            particles: ParticleSet::default(),
            inlets: Vec::new(),
            outlets: Vec::new(),
            surfaces: Vec::new(),
            stages: Vec::new(),
            sampling: Sampling::default(),
            throughput: false,
            search: Search::Grid,
            fields: Vec::new(),
            network: false,
            wear: Vec::new(),
        }
    }
}

/// How particles find those near to them when lists are made anew. All find the same; forces are added in the order in
/// which they were found, so that the last bits differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Search {
    /// Through cells as wide as an interaction reaches, for each size class its own.
    #[default]
    Grid,
    /// Down a hierarchy of bounding volumes over the particles in the order of Morton codes, as in the study of
    /// periodic samples of Lubbe et al. 2022.
    Bvh,
    /// By looking at all.
    AllPairs,
}

impl Search {
    /// Every search.
    pub const ALL: [Self; 3] = [Self::Grid, Self::Bvh, Self::AllPairs];

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Grid => "grid",
            Self::Bvh => "bvh",
            Self::AllPairs => "all-pairs",
        }
    }
}

/// The space of a world: the parallelepiped `origin + C·[0,1]³`.
#[derive(Clone, Debug, PartialEq)]
pub struct Domain {
    /// The corner of least coordinates \[m\].
    pub origin: Vec3,
    /// The cell matrix C \[m\]; **columns** are the cell vectors: `cell[row][column]`.
    pub cell: [Vec3; 3],
    /// What the low and the high side of each cell axis do.
    pub sides: [[Side; 2]; 3],
    /// Material of walls at the sides; needed when a side is a wall.
    pub material: Option<MaterialId>,
}

impl Domain {
    /// An axis-aligned box from `min` to `max` \[m\].
    pub fn aligned(min: Vec3, max: Vec3, sides: [[Side; 2]; 3], material: Option<MaterialId>) -> Self {
        let mut cell = [[0.0; 3]; 3];
        for k in 0..3 {
            cell[k][k] = max[k] - min[k];
        }
        Self { origin: min, cell, sides, material }
    }

    /// The eight corners \[m\].
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|corner| {
            std::array::from_fn(|k| {
                self.origin[k] + (0..3).map(|a| self.cell[k][a] * (corner >> a & 1) as f64).sum::<f64>()
            })
        })
    }
}

/// What happens at a side of the domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Side {
    /// Particles that leave are removed, counted and listed.
    Open,
    /// A frictional plane of the domain's material.
    Wall,
    /// Particles re-enter opposite; both sides of an axis together.
    Periodic,
}

/// Time step and integrator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Time {
    /// The step \[s\].
    pub step: Step,
    /// The integration scheme.
    pub integrator: IntegratorKind,
    /// Allows a step above the stable one.
    pub force: bool,
}

/// How the time step is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// The smaller of 15 % of the Rayleigh time and 1/25 of the collision time.
    Auto,
    /// Given \[s\].
    Fixed(f64),
}

/// What stops a world that went wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guards {
    /// Largest overlap as a fraction of the smaller radius.
    pub overlap_limit: f64,
    /// Exceeding it stops the world; otherwise it is counted and reported.
    pub overlap_stops: bool,
}

impl Default for Guards {
    fn default() -> Self {
        Self { overlap_limit: 0.3, overlap_stops: true }
    }
}

/// Particles as columns of equal length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParticleSet {
    /// Centres \[m\].
    pub position: Vec<Vec3>,
    /// Radii \[m\], > 0.
    pub radius: Vec<f64>,
    /// Materials.
    pub material: Vec<MaterialId>,
    /// Velocities \[m/s\]; empty for all at rest.
    pub velocity: Vec<Vec3>,
    /// Angular velocities \[rad/s\]; empty for none.
    pub spin: Vec<Vec3>,
}

impl ParticleSet {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.position.len()
    }
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }
    /// Adds a particle at rest.
    pub fn push(&mut self, position: Vec3, radius: f64, material: MaterialId) {
        self.push_moving(position, radius, material, [0.0; 3], [0.0; 3]);
    }
    /// Adds a moving particle.
    pub fn push_moving(
        &mut self,
        position: Vec3,
        radius: f64,
        material: MaterialId,
        velocity: Vec3,
        spin: Vec3,
    ) {
        self.velocity.resize(self.len(), [0.0; 3]);
        self.spin.resize(self.len(), [0.0; 3]);
        self.position.push(position);
        self.radius.push(radius);
        self.material.push(material);
        self.velocity.push(velocity);
        self.spin.push(spin);
    }
}

/// A rigid surface that particles meet.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name in the scene and in output columns.
    pub name: String,
    /// Its material.
    pub material: MaterialId,
    /// Its shape, in its own frame.
    pub shape: Shape,
    /// Where its frame stands at the start.
    pub pose: Pose,
    /// How it moves in stages that do not say otherwise.
    pub motion: Motion,
    /// Absent until a stage inserts it.
    pub absent: bool,
}

/// The shape of a surface.
#[derive(Clone, Debug)]
pub enum Shape {
    /// An unbounded plane through the frame's origin; particles stay on the side of `normal` (unit).
    Plane {
        /// Unit normal towards the particles.
        normal: Vec3,
    },
    /// A triangle mesh; both sides act.
    Mesh(Arc<TriMesh>),
    /// A cylinder or a cone, exactly; both sides act.
    Frustum(Frustum),
}

/// A shell of revolution with straight sides about an axis through the frame's origin, cut off at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    /// Unit vector of the axis.
    pub axis: Vec3,
    /// Where it begins and ends along the axis \[m\], ascending.
    pub ends: [f64; 2],
    /// Radius at both ends \[m\], > 0.
    pub radii: [f64; 2],
    /// Whether discs close the ends.
    pub closed: bool,
}

/// An indexed triangle mesh, without degenerate triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertices in the surface's frame \[m\].
    pub vertices: Vec<Vec3>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// A rigid placement: `x = translation + rotation · x_body`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Pose {
    /// \[m\]
    pub translation: Vec3,
    /// Unit quaternion (w, x, y, z).
    pub rotation: [f64; 4],
}

impl Default for Pose {
    fn default() -> Self {
        Self { translation: [0.0; 3], rotation: [1.0, 0.0, 0.0, 0.0] }
    }
}

/// A prescribed motion since the beginning of a stage: the sum of its parts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Constant velocity \[m/s\].
    pub velocity: Vec3,
    /// Rotation about an axis that moves along with the translation.
    pub rotation: Option<Rotation>,
    /// Oscillating translation.
    pub oscillation: Option<Oscillation>,
    /// Path and turn by a table. A table that turns goes without `rotation`.
    pub poses: Option<Arc<PoseTable>>,
}

/// Steady rotation about an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation {
    /// Unit vector of the axis.
    pub axis: Vec3,
    /// A point of the axis at the beginning of the stage \[m\].
    pub center: Vec3,
    /// Rate \[rad/s\], right-handed about `axis`.
    pub rate: f64,
}

/// `x(t) = amplitude · sin(2π f t + phase) - amplitude · sin(phase)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oscillation {
    /// Direction times amplitude \[m\].
    pub amplitude: Vec3,
    /// Frequency f \[Hz\].
    pub frequency: f64,
    /// Phase \[rad\].
    pub phase: f64,
}

/// One part of a run.
#[derive(Clone, Debug, Default)]
pub struct Stage {
    /// Name in the scene and the summary.
    pub name: String,
    /// What is done at its beginning, in order.
    pub actions: Vec<Action>,
    /// When it ends; a stage without a duration only acts.
    pub until: Until,
    /// Motions by surface (index into [`WorldSpec::surfaces`]); a surface that no stage moves follows
    /// its own motion.
    pub moves: Vec<(usize, Motion)>,
    /// What is measured.
    pub measures: Vec<Measure>,
    /// What its particles come to when it ends.
    pub surveys: Vec<Survey>,
    /// How the cell deforms; it stands still in stages that do not say.
    pub deformation: Option<Deformation>,
}

/// How a cell deforms in a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deformation {
    /// What drives each component: xx, yy, zz, yz, xz, xy. Strain and stress are positive in compression; the rate of a
    /// shear component is that of the angle, twice that of the strain tensor.
    pub drive: [Drive; 6],
    /// Largest inertial number `I = ε̇ 2r √(ρ/σ)` that the servo may cause \[-\], apart from what prescribed rates ask
    /// for ([`cell`](crate::cell)), with the mean radius and density and the largest target (Lubbe et al., Powder
    /// Technology 2022, doi 10.1016/j.powtec.2022.117631, whose eq. 20 has it inverted).
    pub inertial_number: f64,
    /// Steps between two acts of the servo, ≥ 1; none: as many as the stiffness of the grains allows
    /// ([`cell`](crate::cell)). They are part of the physics: the same on every backend.
    pub control_steps: Option<u64>,
}

impl Default for Deformation {
    fn default() -> Self {
        Self { drive: [Drive::default(); 6], inertial_number: 1e-3, control_steps: None }
    }
}

impl Deformation {
    /// The components that are to reach a stress, with it \[Pa\].
    pub fn targets(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.drive.iter().enumerate().filter_map(|(k, drive)| match drive {
            Drive::Stress(target) => Some((k, *target)),
            Drive::Rate(_) => None,
        })
    }
}

/// What drives a component of a cell's deformation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// A strain rate \[1/s\].
    Rate(f64),
    /// A stress that the servo goes for and holds \[Pa\].
    Stress(f64),
}

impl Default for Drive {
    fn default() -> Self {
        Self::Rate(0.0)
    }
}

/// Something done at once at the beginning of a stage.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Removes particles whose centre `x` has `x·axis > limit` \[m\] (trim); reported, not lost.
    RemoveBeyond {
        /// Unit vector.
        axis: Vec3,
        /// \[m\]
        limit: f64,
    },
    /// Makes an absent surface present.
    Insert(usize),
    /// Makes a surface absent.
    Withdraw(usize),
    /// Bonds particles as the law of bonds of their materials says.
    Bond,
}

/// When a stage ends: at the first that holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Until {
    /// Kinetic energy (translation and rotation) below this \[J\], once it has risen above it or 100
    /// steps have passed.
    pub kinetic_energy_below: Option<f64>,
    /// Every stress that a servo goes for is reached to within this share of the largest of them, and the kinetic
    /// energy of translation is less than a thousandth of the elastic one.
    pub stress_within: Option<f64>,
    /// After this time in the stage \[s\]; for a stage that waits for energy or stress, the most it may take.
    pub at_most: Option<f64>,
}

/// A number measured over a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    /// Name in the summary.
    pub name: String,
    /// Surface measured (index into [`WorldSpec::surfaces`]).
    pub surface: usize,
    /// Which component.
    pub component: Component,
    /// When it counts.
    pub window: Window,
}

/// A number that the particles of a world come to at the end of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// Name in the summary.
    pub name: String,
    /// What it is.
    pub of: Surveyed,
}

/// What particles come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surveyed {
    /// The slope of the heap that they form \[rad\]: highest points in rings about the axis against gravity through their
    /// middle, each ring as wide as a mean particle; a straight line by least squares through those between 20 % and 80 %
    /// of its height that are 1.5 mean diameters over its foot. None if there are fewer than three.
    AngleOfRepose,
    /// Mass over volume in a box \[kg/m³\]; particles that one of its faces cuts count with their share.
    BulkDensity {
        /// Corner of least coordinates \[m\].
        min: Vec3,
        /// Corner of largest coordinates \[m\].
        max: Vec3,
    },
    /// How a class of particles is mixed with the others, by volume over a grid of samples \[-\]: 0 where every sample holds
    /// one class alone, 1 for a mixture at random. None where there is one class or one sample.
    LaceyIndex {
        /// The class.
        class: Class,
        /// Corner of least coordinates \[m\].
        min: Vec3,
        /// Corner of largest coordinates \[m\].
        max: Vec3,
        /// Samples along each axis, ≥ 1.
        samples: [usize; 3],
    },
}

/// A class of particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Class {
    /// Those of a material.
    Material(MaterialId),
    /// Those of a larger radius \[m\].
    RadiusAbove(f64),
}

impl Surveyed {
    /// Its SI unit.
    pub fn unit(&self) -> &'static str {
        match self {
            Self::AngleOfRepose => "rad",
            Self::BulkDensity { .. } => "kg/m^3",
            Self::LaceyIndex { .. } => "1",
        }
    }
}

impl Stage {
    /// What the stage measures and surveys, in the order of its results: names and SI units.
    pub fn measured(&self) -> impl Iterator<Item = (&str, &'static str)> {
        let measures = self.measures.iter().map(|m| (m.name.as_str(), m.component.unit()));
        measures.chain(self.surveys.iter().map(|s| (s.name.as_str(), s.of.unit())))
    }
}

/// A component of the force that particles exert on a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// Force along an axis 0-2 \[N\].
    Force(usize),
    /// Torque about an axis 0-2 through the surface's frame origin \[N m\].
    Torque(usize),
    /// The force against the surface's velocity, `-F·v/|v|` \[N\]: what a tractor has to pull.
    Draught,
}

impl Component {
    /// Its SI unit.
    pub fn unit(&self) -> &'static str {
        if matches!(self, Self::Torque(_)) { "N m" } else { "N" }
    }
}

/// The part of a stage that a measure covers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Window {
    /// All of it.
    #[default]
    Stage,
    /// Time since the beginning of the stage \[s\].
    Time(f64, f64),
    /// Path that the surface's frame has moved since the beginning of the stage \[m\].
    Displacement(f64, f64),
}

/// Intervals of observation. Rounded to whole steps; frames to whole samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Between rows of the series, and checks of stage ends \[s\].
    pub series: f64,
    /// Between frames \[s\]; none if absent.
    pub frames: Option<f64>,
    /// Whether dissipated energy is accounted each step.
    pub energy_ledger: bool,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { series: 1e-3, frames: None, energy_ledger: true }
    }
}
