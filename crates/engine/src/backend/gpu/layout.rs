//! How a batch lies in device memory.
//!
//! Particles of all worlds stand one after the other, each world from a block's beginning. Columns of particles
//! exist twice: a step reads one half and writes the other, and so does a rebuild, so that a world's halves are
//! told by its own two parities and no world waits for another. Lists, which are far longer, exist once.

use cubecl::ir::features::EnumSet;
use cubecl::prelude::*;
use glebe_physics::IntegratorKind;

use super::choices::Choices;
use crate::spec::Search;

/// Four f32.
pub type F4 = Vector<f32, Const<4>>;
/// Four u32, or the bits of f32.
pub type U4 = Vector<u32, Const<4>>;

/// Units per block.
pub const BLOCK: u32 = 256;
/// Particles whose lists lie interleaved.
pub const SLICE: u32 = 32;
/// Marks that there is none.
pub const NONE: u32 = u32::MAX;

/// Bits of a list's entry: the other particle's place in the order of storage.
pub const PARTNER: u32 = 0x3fff_ffff;
/// Bit of a list's entry: the pair touched in the last step.
pub const TOUCHING: u32 = 0x4000_0000;
/// Bit of a list's entry: the other particle has the lower number, and the pair is evaluated from there.
pub const SECOND: u32 = 0x8000_0000;

/// Asked of a world: lists of its reference as it is.
pub const RELIST: u32 = 1;
/// Asked of a world: lists of its present configuration.
pub const REFER: u32 = 2;
/// Asked of a world: energies and counts.
pub const LOOK: u32 = 3;

/// What kernels of contacts may do: quotients may be products with rounded reciprocals, two units in the last place, as
/// in the shading languages, at a quarter of the price.
pub fn quick() -> EnumSet<FastMath> {
    FastMath::AllowReciprocal | FastMath::ReducedPrecision | FastMath::UnsignedZero | FastMath::NotInf
}

/// What kernels are specialised for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Signature {
    /// Laws.
    pub laws: Choices,
    /// Integrator.
    pub integrator: IntegratorKind,
    /// Whether dissipation is accounted.
    pub ledger: bool,
    /// Whether there are boundaries.
    pub surfaces: bool,
    /// Whether some are shells of revolution.
    pub rounds: bool,
    /// Whether there is local damping.
    pub damping: bool,
    /// Whether a step is one launch, contacts with surfaces included. It saves the time of a launch, which small
    /// worlds consist of, but takes so many registers that large ones are faster with two.
    pub merged: bool,
    /// Whether facets are told apart in a launch before contacts with surfaces: those of a particle take their time one after the
    /// other, and others wait for the particle that has most. Only where there are triangles is that worth a launch.
    pub told: bool,
    /// What a block of a step is.
    pub shape: Shape,
    /// Whether stress and fabric are measured.
    pub sample: bool,
    /// Whether the cell deforms.
    pub deforms: bool,
    /// Whether the cell is a box along the axes.
    pub orthogonal: bool,
    /// Whether particles are of several size classes, see [`crate::classes`].
    pub graded: bool,
    /// How particles find those near to them.
    pub search: Search,
    /// Whether the device's `fma` is fused.
    pub fused: bool,
}

impl Signature {
    /// F4 that hold what a contact remembers.
    pub fn quads(&self) -> u32 {
        self.laws.layout.floats().div_ceil(4) as u32
    }

    /// F4 that a remembered contact with a surface takes: normal and boundary, then what it remembers.
    pub fn row_quads(&self) -> u32 {
        1 + self.quads()
    }

    /// Whether particles near surfaces have blocks of their own in a step.
    pub fn near_blocks(&self) -> bool {
        self.surfaces && self.merged
    }

    /// Blocks of a step that should run side by side on a processor, 0 for as many as there is room for. Where surfaces ride
    /// along, fewer registers would be too few; where there are more units than blocks to fill a device, none are saved.
    pub fn beside(&self) -> u32 {
        if self.near_blocks() || self.shape != Shape::LARGE { 0 } else { 24 }
    }

    /// Blocks of a step over `padded` particles and `rows` of those near surfaces, which come last.
    pub fn blocks(&self, padded: usize, rows: usize) -> usize {
        let near = if self.near_blocks() { rows / self.shape.near as usize } else { 0 };
        padded / self.shape.owners as usize + near
    }

    /// Whether each size class has a grid of its own.
    pub fn grids(&self) -> bool {
        self.graded && self.search == Search::Grid
    }

    /// Sums of an observation per block.
    pub fn sights(&self) -> u32 {
        SIGHTS + if self.sample { INNER } else { 0 }
    }

    /// Particles near surfaces that share a block.
    pub fn rows_of_block(&self) -> usize {
        (if self.merged { self.shape.near } else { BLOCK }) as usize
    }
}

/// What a block of a step is. Its units share the contacts of the particles that it owns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Shape {
    /// Particles.
    pub owners: u32,
    /// Units.
    pub units: u32,
    /// Particles of a block of those near surfaces, fewer than units: as many units look at surfaces meanwhile.
    pub near: u32,
}

impl Shape {
    /// The shape where there are more particles than a device has units.
    pub const LARGE: Self = Self { owners: SLICE, units: SLICE, near: SLICE / 2 };

    /// The shape for a world: small blocks, so that none waits long for another, and more units than particles where
    /// those are too few to fill a device. Blocks near surfaces own fewer particles, since theirs is the longest chain.
    pub fn of(count: usize) -> Self {
        match count {
            1025..=16_384 => Self { owners: SLICE, units: 2 * SLICE, near: SLICE / 2 },
            16_385..=MERGED => Self { owners: 2 * SLICE, units: 2 * SLICE, near: SLICE },
            _ => Self::LARGE,
        }
    }
}

/// F4 of a pair of materials: normal, tangential, rolling, cohesion, friction, clip, bond, its strength.
pub const PAIR_QUADS: u32 = 8;

/// Words of the table of worlds; floats as bits.
pub mod world {
    /// Words per world.
    pub const WORDS: u32 = 100;
    /// First particle.
    pub const FIRST: u32 = 0;
    /// Number of materials.
    pub const MATERIALS: u32 = 1;
    /// First pair of materials.
    pub const PAIRS: u32 = 2;
    /// First boundary.
    pub const BOUNDARIES: u32 = 3;
    /// Number of boundaries.
    pub const BOUNDARY_COUNT: u32 = 4;
    /// First cell.
    pub const CELLS: u32 = 5;
    /// Cells held.
    pub const CELL_ROOM: u32 = 6;
    /// First list entry.
    pub const LISTS: u32 = 7;
    /// List entries held.
    pub const LIST_ROOM: u32 = 8;
    /// First row of particles near surfaces.
    pub const ROWS: u32 = 9;
    /// Rows held.
    pub const ROW_ROOM: u32 = 10;
    /// First facet.
    pub const FACETS: u32 = 11;
    /// Facets held.
    pub const FACET_ROOM: u32 = 12;
    /// Blocks of particles.
    pub const BLOCKS: u32 = 13;
    /// Windows along each axis.
    pub const WINDOWS: u32 = 14;
    /// 1 along each axis that wraps.
    pub const PERIODIC: u32 = 17;
    /// Upper ends of open axes: windows (3), fractions (3).
    pub const EXTENT: u32 = 20;
    /// Step \[s\].
    pub const DT: u32 = 26;
    /// Gravity.
    pub const GRAVITY: u32 = 27;
    /// Local damping.
    pub const DAMPING: u32 = 30;
    /// Square of the displacement that is too much \[m²\].
    pub const RUNAWAY: u32 = 31;
    /// Overlap that stops the world.
    pub const OVERLAP: u32 = 32;
    /// Metres per unit: leading parts (9), rests (9). This and what follows up to `PATH` is the cell; one that deforms
    /// has as many words for each step, see [`super::cell_at`].
    pub const UNIT: u32 = 33;
    /// Units per metre (9).
    pub const INVERSE: u32 = 51;
    /// Height of a window along each axis \[m\].
    pub const HEIGHT: u32 = 60;
    /// How much any distance may have shrunk since the start, as [`super::path_word`] writes it.
    pub const PATH: u32 = 63;
    /// Words of a cell.
    pub const CELL_WORDS: u32 = 31;
    /// Interaction distance beyond touch \[m\].
    pub const RANGE: u32 = 64;
    /// Mean radius \[m\].
    pub const RADIUS_MEAN: u32 = 65;
    /// Largest radius \[m\].
    pub const RADIUS_MAX: u32 = 66;
    /// First entry of the series of surface forces.
    pub const SERIES: u32 = 67;
    /// Surfaces whose forces are kept.
    pub const SURFACES: u32 = 68;
    /// First slice.
    pub const SLICES: u32 = 69;
    /// Energy gained by a particle of unit mass that wraps upwards along each axis \[m²/s²\].
    pub const WRAP: u32 = 70;
    /// The cell of the job's first step, less `UNIT`.
    pub const CELL: u32 = 73;
    /// Words from the cell of a step to that of the next; 0 if it stands still.
    pub const CELL_STRIDE: u32 = 74;
    /// `PATH` at the last rebuild before the job.
    pub const REFERENCE: u32 = 75;
    /// Velocity gradient of the cell (9) \[1/s\].
    pub const GRADIENT: u32 = 76;
    /// Size classes.
    pub const GRADES: u32 = 85;
    /// First cell of each class, counted from `CELLS`, and the end of the last.
    pub const CLASSES: u32 = 86;
    /// Axes of the curve that particles are ordered along (2), see [`crate::curve`].
    pub const CURVE: u32 = 95;
    /// First node of the hierarchy over the particles.
    pub const NODES: u32 = 97;
    /// Its leaves, a power of two.
    pub const LEAVES: u32 = 98;
}

/// Words per unit of strain in `world::PATH`, and per mean radius in `pose::PATH`.
const PATH_UNITS: f64 = 1_048_576.0;

/// A sum of strains, or a path in mean radii, as a whole number, rounded up, of which differences alone matter: they are
/// the same wherever a run was split.
pub fn path_word(path: f64) -> u32 {
    (path * PATH_UNITS).ceil() as u64 as u32
}

/// Words of a world's state that only the rebuild's one-unit kernels and the host write.
pub mod status {
    /// Words per world.
    pub const WORDS: u32 = 41;
    /// Steps done of this job when the group of launches began.
    pub const BASE: u32 = 0;
    /// Steps asked for.
    pub const TARGET: u32 = 1;
    /// Half of the columns that a step writes, at `BASE`.
    pub const PARITY: u32 = 2;
    /// Half of the columns that a rebuild writes.
    pub const LISTED: u32 = 3;
    /// Whether a rebuild is under way.
    pub const REBUILDING: u32 = 4;
    /// Skin \[m\], as bits.
    pub const SKIN: u32 = 5;
    /// Steps since the last rebuild, at `BASE`.
    pub const SINCE: u32 = 6;
    /// Rebuilds done in this job.
    pub const REBUILDS: u32 = 7;
    /// Particles.
    pub const COUNT: u32 = 8;
    /// Whether accelerations are known.
    pub const PRIMED: u32 = 9;
    /// Cells per window along each axis.
    pub const CELLS: u32 = 10;
    /// What the host asks for, or 0.
    pub const ASKED: u32 = 13;
    /// Rows of particles near surfaces.
    pub const ROWS: u32 = 14;
    /// Step of this job at the last rebuild, or `NONE`.
    pub const REBUILT: u32 = 15;
    /// Facets near particles.
    pub const FACETS: u32 = 16;
    /// Cells per window along each axis, for each size class where there are several.
    pub const GRIDS: u32 = 17;
}

/// Words of a world's state that many units write.
pub mod flag {
    /// Words per world.
    pub const WORDS: u32 = 9;
    /// Launch of the group in which lists became outdated.
    pub const STALE: u32 = 0;
    /// Why the world stopped, see [`super::halt`].
    pub const HALT: u32 = 1;
    /// Lowest particle concerned.
    pub const WHO: u32 = 2;
    /// Largest overlap as a fraction of the smaller radius, as bits.
    pub const WORST: u32 = 3;
    /// List entries, rows and facets needed.
    pub const NEED: u32 = 4;
    /// Steps that ran: must be those that were counted, or a kernel was silently not run.
    pub const BEATS: u32 = 7;
    /// Bonds that broke.
    pub const BROKEN: u32 = 8;
}

/// Why a world stopped.
pub mod halt {
    /// It did not.
    pub const NO: u32 = 0;
    /// A particle moved too far in one step.
    pub const RUNAWAY: u32 = 1;
    /// An overlap above the limit.
    pub const OVERLAP: u32 = 2;
    /// Particles outside the domain, to be taken out by the host.
    pub const LEFT: u32 = 3;
    /// Too little room for lists, rows or facets.
    pub const ROOM: u32 = 4;
    /// More contacts of one particle with surfaces than are held.
    pub const CONTACTS: u32 = 5;
}

/// Words of the table of boundaries.
pub mod boundary {
    /// Words per boundary.
    pub const WORDS: u32 = 48;
    /// First pose, in words.
    pub const POSE: u32 = 0;
    /// Words from the pose of a step to that of the next; 0 if it stands still.
    pub const STRIDE: u32 = 1;
    /// Material.
    pub const MATERIAL: u32 = 2;
    /// First triangle, or `NONE` but for a mesh.
    pub const TRIANGLES: u32 = 3;
    /// First vertex.
    pub const VERTICES: u32 = 4;
    /// Surface of the specification, or `NONE`.
    pub const SURFACE: u32 = 5;
    /// First node of the hierarchy.
    pub const NODES: u32 = 6;
    /// Largest size of a coordinate of the mesh in its frame \[m\], as bits.
    pub const SIZE: u32 = 7;
    /// First entry of the order of triangles.
    pub const ORDER: u32 = 8;
    /// Images in which particles may meet it, along each axis, as `IMAGE_ZERO` and more: lowest (3), highest (3).
    pub const IMAGES: u32 = 9;
    /// Parts of a shell of revolution, or 0.
    pub const PARTS: u32 = 15;
    /// Its lines in the plane of ρ and h: where they begin (2), along (2), length, each leading part and rest.
    pub const LINES: u32 = 16;
    /// Words of a line.
    pub const LINE: u32 = 10;
}

/// Words of a pose.
pub mod pose {
    /// Words per pose.
    pub const WORDS: u32 = 44;
    /// Windows of the frame's origin (3), fractions (3), rests (3).
    pub const ORIGIN: u32 = 0;
    /// Rotation from the body to the world by rows: leading parts (9), rests (9).
    pub const ROTATION: u32 = 9;
    /// Velocity of the origin (3), angular velocity (3).
    pub const VELOCITY: u32 = 27;
    /// Normal of a plane or axis of a shell of revolution: leading parts (3), rests (3).
    pub const NORMAL: u32 = 33;
    /// 1 if it is there.
    pub const PRESENT: u32 = 39;
    /// How far its farthest point may have moved, counted from the last rebuild before the job, see [`super::path_word`].
    pub const PATH: u32 = 40;
}

/// Steps after which lists are made anew even where they still hold. Then worlds and the host, which launches as many
/// steps before it looks after lists, keep pace, and hardly any launch is in vain.
pub const PERIOD: u32 = 128;

/// Most particles of a world whose steps are one launch.
pub const MERGED: usize = 131_072;
/// Contacts of a particle with surfaces that are remembered.
pub const SLOTS: u32 = 8;
/// Facets that one particle touches and that are compared with each other at once; below 32.
pub const TOUCHED: u32 = 24;
/// Bits of an image's component.
pub const IMAGE_BITS: u32 = 10;
/// Added to each component of an image so that it is not negative.
pub const IMAGE_ZERO: i32 = 512;
/// Sums of the ledger per block.
pub const SUMS: u32 = 8;
/// Sums of an observation per block.
pub const SIGHTS: u32 = 10;
/// Further ones of a sample, see [`inner`].
pub const INNER: u32 = 27;

/// Sums over contacts and particles of a sample.
pub mod inner {
    /// Branch times force on the partner, by rows (9).
    pub const CONTACT: u32 = 0;
    /// Normal times normal: xx, yy, zz, xy, yz, zx.
    pub const FABRIC: u32 = 9;
    /// Stiffness times the square of the branch.
    pub const STIFFNESS: u32 = 15;
    /// Mass times velocity times velocity: xx, yy, zz, xy, yz, zx.
    pub const KINETIC: u32 = 16;
    /// Cubes of radii.
    pub const CUBES: u32 = 22;
    /// Particles without a contact, and with one.
    pub const RATTLERS: u32 = 23;
}

/// A float of a table.
#[cube]
pub fn float_at(table: &Array<u32>, at: u32) -> f32 {
    f32::reinterpret(table[at as usize])
}

/// Where the cell stands at step `t` of a job, as the words of a world: what is looked up with it are `world::UNIT` to
/// `world::PATH`.
#[cube]
pub fn cell_at(worlds: &Array<u32>, c: u32, t: u32) -> u32 {
    worlds[(c + world::CELL) as usize] + t * worlds[(c + world::CELL_STRIDE) as usize]
}

/// How much any distance may have shrunk from one cell to a later one, or how many mean radii a surface has moved from
/// one pose to a later one.
#[cube]
pub fn gone(from: u32, to: u32) -> f32 {
    f32::cast_from(to - from) * comptime!((1.0 / PATH_UNITS) as f32)
}

/// Whether a step launch does anything in a world.
#[cube]
pub fn active(status: &Array<u32>, flags: &Array<Atomic<u32>>, w: u32, k: u32) -> bool {
    let s = w * status::WORDS;
    let f = w * flag::WORDS;
    let stale = flags[(f + flag::STALE) as usize].load();
    let base = status[(s + status::BASE) as usize];
    let target = status[(s + status::TARGET) as usize];
    let since = status[(s + status::SINCE) as usize];
    k <= stale && base + k < target && since + k < PERIOD
}
