//! Every table and key of a scene file. A row here is all that parsing, errors, defaults and the schema
//! need; `model.rs` says what becomes of the value.

use glebe_engine::spec::{Search, Side};
use glebe_physics::{ContactEnd, History, IntegratorKind, MixingRule, ShearModulusRule, Slot};

use super::doors::{INLET, OUTLET};
use super::outputs::FIELD;
use super::table::{Field, Kind, Names, Rule, TableSpec, Words, words};
use super::tools::{BLADE, DRUM, MIXER, PLOUGH, SWEEP, WHEEL};
use crate::units::Dimension;

pub(crate) const SIDES: Words<SideWord> = words! {
    "wall" => SideWord(Side::Wall), "open" => SideWord(Side::Open), "periodic" => SideWord(Side::Periodic),
};
pub(crate) const INTEGRATORS: Words<IntegratorKind> = words! {
    "euler" => IntegratorKind::Euler, "exact" => IntegratorKind::Exact,
    "adams" => IntegratorKind::Adams, "velocity-verlet" => IntegratorKind::VelocityVerlet,
};
pub(crate) const SEARCHES: Words<Search> = words! {
    Search::Grid.name() => Search::Grid, Search::Bvh.name() => Search::Bvh,
    Search::AllPairs.name() => Search::AllPairs,
};
pub(crate) const ENDS: Words<ContactEnd> = words! {
    "tension" => ContactEnd::Tension, "no-tension" => ContactEnd::NoTension,
};
pub(crate) const HISTORIES: Words<History> = words! {
    "truncated" => History::Truncated, "unbounded" => History::Unbounded, "none" => History::None,
};
pub(crate) const MIXING_RULES: Words<MixingRule> = words! {
    MixingRule::Min.name() => MixingRule::Min, MixingRule::Max.name() => MixingRule::Max,
    MixingRule::Mean.name() => MixingRule::Mean, MixingRule::Harmonic.name() => MixingRule::Harmonic,
    MixingRule::Geometric.name() => MixingRule::Geometric,
};
pub(crate) const SHEAR_MODULI: Words<ShearModulusRule> = words! {
    "mindlin" => ShearModulusRule::Mindlin, "gpudem" => ShearModulusRule::Gpudem,
};
/// A side with a default, which [`Words::value`] asks for.
#[derive(Clone, Copy)]
pub(crate) struct SideWord(pub Side);

impl Default for SideWord {
    fn default() -> Self {
        Self(Side::Wall)
    }
}

/// The registered ways to place particles, with what they do.
fn fills() -> Vec<(&'static str, &'static str)> {
    glebe_engine::generate::fills().iter().map(|fill| (fill.name, fill.summary)).collect()
}

const SIDE: Kind = Kind::Words(SIDES.words);
static SIDE_PAIR: Kind = Kind::Words(SIDES.words);
const SIDE_OR_PAIR: Kind = Kind::Either(&[SIDE, Kind::LowHigh(&SIDE_PAIR)]);
const MIXED: Kind = Kind::Words(MIXING_RULES.words);
pub(super) const LENGTH: Kind = Kind::Number(Dimension::LENGTH);
pub(super) const TIME: Kind = Kind::Number(Dimension::TIME);
pub(super) const NUMBER: Kind = Kind::Number(Dimension::NONE);
pub(super) const ANGLE: Kind = Kind::Number(Dimension::ANGLE);
pub(super) const POINT: Kind = Kind::Vector(Dimension::LENGTH);

/// The whole file.
pub(crate) static SCENE: TableSpec = TableSpec {
    doc: "A glebe scene: what there is, how it behaves, what happens, what is written. SI units, or texts with a unit.",
    fields: &[
        Field::new("title", Kind::Text, "Name for output and messages.").or("\"\""),
        Field::new("gravity", Kind::Vector(Dimension::ACCELERATION), "Gravity [m/s²].").or("[0, 0, -9.81]"),
        Field::new("seed", Kind::Integer, "Seed of everything random.").or("1").at_least(0.0),
        Field::new(
            "throughput",
            Kind::Bool,
            "Whether a GPU takes the kernels that are fastest for many worlds at once. They round otherwise: a world of a \
             study that is run alone needs them for the same bits.",
        )
        .optional("false, in studies true"),
        Field::new(
            "search",
            Kind::Words(SEARCHES.words),
            "How particles find those near to them: through the cells of a grid, down a hierarchy of bounding volumes, or by \
             looking at all, which costs as the square of their number. All find the same and round otherwise.",
        )
        .or("\"grid\""),
        Field::new("domain", Kind::Table(&DOMAIN), "The box that the particles are in."),
        Field::new("time", Kind::Table(&TIME_TABLE), "Step, integrator and guard.").or("{}"),
        Field::new("material", Kind::Named(Names::New, &MATERIAL), "Materials by name; `steel` is built in.")
            .or("{}"),
        Field::new(
            "pair",
            Kind::Named(Names::Pair, &PAIR),
            "Values of a pair of materials, in any order, as `pair.soil-steel`.",
        )
        .or("{}"),
        Field::new("mixing", Kind::Table(&MIXING), "How values of pairs follow from their materials.")
            .or("{}"),
        Field::new("contact", Kind::Table(&CONTACT), "The contact laws.").or("{}"),
        Field::new("particles", Kind::Named(Names::New, &PARTICLES), "Groups of particles by name.").or("{}"),
        Field::new("inlet", Kind::Named(Names::New, &INLET), "Where particles come in, by name.").or("{}"),
        Field::new("outlet", Kind::Named(Names::New, &OUTLET), "Where they are taken away, by name.")
            .or("{}"),
        Field::new("geometry", Kind::Named(Names::New, &GEOMETRY), "Tools and walls by name.").or("{}"),
        Field::new("stage", Kind::List(&STAGE), "What happens, in order."),
        Field::new("output", Kind::Table(&OUTPUT), "What is written, how often.").or("{}"),
    ],
    rules: &[],
};

static DOMAIN: TableSpec = TableSpec {
    doc: "The box that the particles are in.",
    fields: &[
        Field::new("min", POINT, "Corner of least coordinates [m]."),
        Field::new("max", POINT, "Corner of largest coordinates [m]."),
        Field::new("sides", Kind::Table(&SIDES_TABLE), "What the sides do.").or("{}"),
        Field::new("material", Kind::Reference(Names::Material), "Material of the sides that are walls.")
            .optional("needed when a side is a wall"),
    ],
    rules: &[],
};

static SIDES_TABLE: TableSpec = TableSpec {
    doc: "What the sides of each axis do: a word for both, or [low, high]. Particles that leave through an open side are removed and listed.",
    fields: &[
        Field::new("x", SIDE_OR_PAIR, "Across x.").or("\"wall\""),
        Field::new("y", SIDE_OR_PAIR, "Across y.").or("\"wall\""),
        Field::new("z", SIDE_OR_PAIR, "Across z.").or("\"wall\""),
    ],
    rules: &[],
};

static TIME_TABLE: TableSpec = TableSpec {
    doc: "Step, integrator and guard.",
    fields: &[
        Field::new("step", Kind::Either(&[Kind::Words(&["auto"]), TIME]), "Time step [s]; `auto` takes the smaller of 15 % of the Rayleigh time and 1/25 of the collision time.")
            .or("\"auto\"").above(0.0).usual(1e-9, 1e-1),
        Field::new("integrator", Kind::Words(INTEGRATORS.words), "Time integration; `euler` is semi-implicit.").or("\"euler\""),
        Field::new("overlap_limit", Kind::Either(&[Kind::Words(&["warn"]), NUMBER]), "Largest overlap as a fraction of the smaller radius, beyond which the run stops; `warn` only reports overlaps above 0.3.")
            .or("0.3").above(0.0).at_most(2.0),
        Field::new("force", Kind::Bool, "Allows a step above the stable one.").or("false"),
    ],
    rules: &[],
};

static MATERIAL: TableSpec = TableSpec {
    doc: "A material. The shear modulus follows from Young's modulus and Poisson's ratio.",
    fields: &[
        Field::new("density", Kind::Number(Dimension::DENSITY), "Density of the solid [kg/m³].")
            .optional("needed for materials of particles")
            .above(0.0)
            .usual(50.0, 25e3),
        Field::new("youngs_modulus", Kind::Number(Dimension::PRESSURE), "Young's modulus [Pa].")
            .above(0.0)
            .usual(1e3, 1e12),
        Field::new("poissons_ratio", NUMBER, "Poisson's ratio.").above(-1.0).at_most(0.5),
        Field::new("restitution", NUMBER, "Coefficient of restitution.").at_least(0.0).at_most(1.0),
        Field::new("friction", NUMBER, "Coefficient of sliding friction.").at_least(0.0).usual(0.0, 10.0),
        Field::new("static_friction", NUMBER, "Coefficient of static friction, not below `friction`.")
            .like("friction")
            .at_least(0.0)
            .usual(0.0, 10.0),
        Field::new("rolling_friction", NUMBER, "Coefficient of rolling friction.")
            .or("0.0")
            .at_least(0.0)
            .usual(0.0, 10.0),
        Field::new("wear", Kind::Table(&WEAR), "How tools and walls in `geometry` of this material wear.")
            .optional("they do not"),
    ],
    rules: &[],
};

static WEAR: TableSpec = TableSpec {
    doc: "Archard's law: the volume that a facet loses is coefficient / hardness · ∫ normal force · sliding speed dt. Shapes stay as they are; series.csv has NAME.wear, meshes in frames have wear_depth.",
    fields: &[
        Field::new("coefficient", NUMBER, "Archard's coefficient k [-].").above(0.0).usual(1e-9, 1.0),
        Field::new("hardness", Kind::Number(Dimension::PRESSURE), "Hardness H of the softer body [Pa].")
            .above(0.0)
            .usual(1e6, 1e12),
    ],
    rules: &[],
};

static PAIR: TableSpec = TableSpec {
    doc: "Values of a pair of materials.",
    fields: &[
        Field::new("restitution", NUMBER, "Coefficient of restitution.")
            .optional(MIXED_WORDS)
            .at_least(0.0)
            .at_most(1.0),
        Field::new("friction", NUMBER, "Coefficient of sliding friction.")
            .optional(MIXED_WORDS)
            .at_least(0.0)
            .usual(0.0, 10.0),
        Field::new("static_friction", NUMBER, "Coefficient of static friction.")
            .optional(MIXED_WORDS)
            .at_least(0.0)
            .usual(0.0, 10.0),
        Field::new("rolling_friction", NUMBER, "Coefficient of rolling friction.")
            .optional(MIXED_WORDS)
            .at_least(0.0)
            .usual(0.0, 10.0),
        Field::new(
            "cohesion",
            NUMBER,
            "Strength of cohesion in this pair as a share of what the contact laws say; 0 for none.",
        )
        .optional("1, as the laws say")
        .at_least(0.0),
        Field::new("contact", Kind::Table(&PAIR_CONTACT), "Contact laws of this pair.").or("{}"),
    ],
    rules: &[],
};

static PAIR_CONTACT: TableSpec = TableSpec {
    doc: "Contact laws of a pair, written as in [contact]; what is left out is as it says there.",
    fields: &[
        Field::new("normal", Kind::Law(Slot::Normal), "Normal force.").optional(AS_ELSEWHERE),
        Field::new("tangential", Kind::Law(Slot::Tangential), "Tangential force.").optional(AS_ELSEWHERE),
        Field::new("rolling", Kind::Law(Slot::Rolling), "Rolling torque.").optional(AS_ELSEWHERE),
        Field::new("cohesion", Kind::Law(Slot::Cohesion), "Cohesion.").optional(AS_ELSEWHERE),
        Field::new("bond", Kind::Law(Slot::Bond), "Bonds between particles.").optional(AS_ELSEWHERE),
    ],
    rules: &[],
};

const AS_ELSEWHERE: &str = "that of `contact`";

const MIXED_WORDS: &str = "mixed from the two materials";

static MIXING: TableSpec = TableSpec {
    doc: "How values of pairs follow from their materials, where `pair` says nothing.",
    fields: &[
        Field::new("restitution", MIXED, "For the coefficient of restitution.").or("\"mean\""),
        Field::new("friction", MIXED, "For sliding friction.").or("\"mean\""),
        Field::new("static_friction", MIXED, "For static friction.").or("\"mean\""),
        Field::new("rolling_friction", MIXED, "For rolling friction.").or("\"mean\""),
        Field::new("shear_modulus", Kind::Words(SHEAR_MODULI.words), "Effective shear modulus: Mindlin's, or eq. 2.4 of the GPUDEM thesis (2023), 1.87-2.0 times larger.").or("\"mindlin\""),
    ],
    rules: &[],
};

static CONTACT: TableSpec = TableSpec {
    doc: "The contact laws: a name, or a table such as [contact.normal.linear] with the law's parameters.",
    fields: &[
        Field::new("normal", Kind::Law(Slot::Normal), "Normal force.").or("\"hertz\""),
        Field::new("tangential", Kind::Law(Slot::Tangential), "Tangential force.").or("\"mindlin\""),
        Field::new("rolling", Kind::Law(Slot::Rolling), "Rolling torque.").or("\"none\""),
        Field::new("cohesion", Kind::Law(Slot::Cohesion), "Cohesion.").or("\"none\""),
        Field::new("bond", Kind::Law(Slot::Bond), "Bonds between particles, which a stage with `bond` makes.").or("\"none\""),
        Field::new("end", Kind::Words(ENDS.words), "When a contact ends: at zero overlap, so that the normal force may pull before, or when the force would pull.").or("\"tension\""),
        Field::new("history", Kind::Words(HISTORIES.words), "The tangential spring of a slipping contact: shortened to the slip limit, never shortened, or forgotten each step.").or("\"truncated\""),
        Field::new("local_damping", NUMBER, "Local non-viscous damping.").or("0.0").at_least(0.0).at_most(0.99),
    ],
    rules: &[],
};

static PARTICLES: TableSpec = TableSpec {
    doc: "A group of particles, read from a file or generated.",
    fields: &[
        Field::new("material", Kind::Reference(Names::Material), "Their material.").optional("named by the file's column `material`"),
        Field::new("file", Kind::Path, "CSV file with a header naming x, y, z and R [m], or with units as `R [mm]`; optionally vx, vy, vz [m/s], \
             wx, wy, wz [rad/s] and material, which then count. Or VTU or VTP with an array radius; optionally \
             velocity, angular_velocity and material, the scene's materials counted from 0. Or PLY with vertices of x, y, z \
             and radius, optionally vx, vy, vz, wx, wy, wz and material, a number too.")
            .optional("the particles are generated"),
        Field::new("count", Kind::Integer, "How many to generate.").optional("the particles are read from `file`").at_least(1.0).at_most(4e9),
        Field::new("radius", Kind::Either(&[LENGTH, Kind::Table(&SIZES)]), "Radius [m], or a distribution of radii.")
            .optional("read from `file`").above(0.0).usual(1e-6, 10.0),
        Field::new("fill", Kind::Choice(fills), "How they are placed.").or("\"random\""),
        Field::new("region", Kind::Table(&REGION), "Where they are placed.").optional("the domain"),
        Field::new("solid_fraction", NUMBER, "Share of the region's volume that particles fill; the region's height is cut to it.").optional("the whole region is used").above(0.0).at_most(0.8),
        Field::new("seed", Kind::Integer, "Seed of positions and sizes.").optional("the scene's seed, advanced by one for each further group").at_least(0.0),
        Field::new("velocity", Kind::Vector(Dimension::VELOCITY), "Velocity at the start [m/s].").or("[0, 0, 0]"),
    ],
    rules: &[
        Rule::ExactlyOne(&["file", "count"]),
        Rule::Needs("count", &["radius", "material"]),
        Rule::Excludes("file", &["radius", "fill", "region", "solid_fraction", "seed"]),
    ],
};

pub(super) static SIZES: TableSpec = TableSpec {
    doc: "A distribution of radii: by number, or by mass as a sieve curve.",
    fields: &[
        Field::new("uniform", Kind::Window(Dimension::LENGTH), "Evenly between two radii [m].")
            .optional("another distribution")
            .above(0.0)
            .usual(1e-6, 10.0),
        Field::new("normal", Kind::Table(&NORMAL), "Normal.").optional("another distribution"),
        Field::new("log_normal", Kind::Table(&LOG_NORMAL), "Log-normal.").optional("another distribution"),
        Field::new("sieve", Kind::Table(&SIEVE), "A sieve curve, by mass.").optional("another distribution"),
    ],
    rules: &[Rule::ExactlyOne(&["uniform", "normal", "log_normal", "sieve"])],
};

static SIEVE: TableSpec = TableSpec {
    doc: "A sieve curve: the share of the mass that passes each opening, straight over the logarithm of the opening.",
    fields: &[
        Field::new(
            "opening",
            Kind::Numbers(Dimension::LENGTH),
            "Openings [m], ascending; a sphere passes whose diameter is smaller.",
        )
        .above(0.0)
        .usual(2e-6, 20.0),
        Field::new(
            "passing",
            Kind::Numbers(Dimension::NONE),
            "Share of the mass that passes each opening: from 0 at the first to 1 at the last.",
        )
        .at_least(0.0)
        .at_most(1.0),
    ],
    rules: &[],
};

static NORMAL: TableSpec = TableSpec {
    doc: "A normal distribution of radii, drawn again outside [min, max].",
    fields: &[
        Field::new("mean", LENGTH, "Mean radius [m].").above(0.0).usual(1e-6, 10.0),
        Field::new("std", LENGTH, "Standard deviation [m].").at_least(0.0),
        Field::new("min", LENGTH, "Least radius [m].")
            .optional("three standard deviations below the mean, at least a tenth of it")
            .above(0.0),
        Field::new("max", LENGTH, "Largest radius [m].")
            .optional("three standard deviations above the mean")
            .above(0.0),
    ],
    rules: &[],
};

static LOG_NORMAL: TableSpec = TableSpec {
    doc: "A log-normal distribution of radii, drawn again outside [min, max].",
    fields: &[
        Field::new("median", LENGTH, "Median radius [m].").above(0.0).usual(1e-6, 10.0),
        Field::new("sigma", NUMBER, "Standard deviation of ln(radius).").at_least(0.0).at_most(3.0),
        Field::new("min", LENGTH, "Least radius [m].").optional("median · exp(-3 sigma)").above(0.0),
        Field::new("max", LENGTH, "Largest radius [m].").optional("median · exp(3 sigma)").above(0.0),
    ],
    rules: &[],
};

pub(super) static REGION: TableSpec = TableSpec {
    doc: "An axis-aligned box.",
    fields: &[
        Field::new("min", POINT, "Corner of least coordinates [m]."),
        Field::new("max", POINT, "Corner of largest coordinates [m]."),
    ],
    rules: &[],
};

static GEOMETRY: TableSpec = TableSpec {
    doc: "A tool or wall: one shape, placed by scale, then rotate, then translate.",
    fields: &[
        Field::new("material", Kind::Reference(Names::Material), "Its material."),
        Field::new("file", Kind::Path, "Mesh file: STL, PLY or OBJ, relative to the scene.")
            .optional("another shape"),
        Field::new("unit", Kind::Words(FILE_UNITS), "Unit of the coordinates in `file`.").optional("metres"),
        Field::new("box", Kind::Table(&REGION), "A closed box; both sides of its faces act.")
            .optional("another shape"),
        Field::new("plane", Kind::Table(&PLANE), "An unbounded plane.").optional("another shape"),
        Field::new("sweep", Kind::Table(&SWEEP), "A cultivator sweep.").optional("another shape"),
        Field::new("blade", Kind::Table(&BLADE), "A flat plate across the travel.").optional("another shape"),
        Field::new("plough", Kind::Table(&PLOUGH), "Share and mouldboard of a plough.")
            .optional("another shape"),
        Field::new("wheel", Kind::Table(&WHEEL), "A rigid wheel about y, with or without grousers.")
            .optional("another shape"),
        Field::new("drum", Kind::Table(&DRUM), "A cylinder of flat pieces, with or without lifters.")
            .optional("another shape"),
        Field::new("mixer", Kind::Table(&MIXER), "Rows of blades on a shaft about z.")
            .optional("another shape"),
        Field::new("cylinder", Kind::Table(&CYLINDER), "An exactly round cylinder centred at the origin.")
            .optional("another shape"),
        Field::new("cone", Kind::Table(&CONE), "An exactly round cone, cut off, that begins at the origin.")
            .optional("another shape"),
        Field::new("hopper", Kind::Table(&HOPPER), "A funnel about z, its outlet at z = 0.")
            .optional("another shape"),
        Field::new(
            "scale",
            Kind::Either(&[NUMBER, Kind::Vector(Dimension::NONE)]),
            "Factor on coordinates, or [x, y, z] factors.",
        )
        .or("1.0")
        .above(0.0),
        Field::new("rotate", Kind::List(&TURN), "Turns about axes through the origin, in order.").or("[]"),
        Field::new("translate", POINT, "Shift [m].").or("[0, 0, 0]"),
        Field::new("motion", Kind::Table(&MOTION), "How it moves in stages that do not say otherwise.")
            .or("{}"),
    ],
    rules: &[
        Rule::ExactlyOne(SHAPES),
        Rule::Excludes("plane", &["scale", "rotate"]),
        Rule::Excludes("cylinder", &["scale"]),
        Rule::Excludes("cone", &["scale"]),
        Rule::Needs("unit", &["file"]),
    ],
};

/// Units that files are drawn in.
const FILE_UNITS: &[&str] = &["m", "cm", "mm", "um", "km", "in", "ft"];

/// The keys of a geometry that give its shape.
pub(crate) const SHAPES: &[&str] = &[
    "file", "box", "plane", "sweep", "blade", "plough", "wheel", "drum", "mixer", "cylinder", "cone",
    "hopper",
];

static PLANE: TableSpec = TableSpec {
    doc: "An unbounded plane.",
    fields: &[
        Field::new("point", POINT, "A point of it [m]."),
        Field::new("normal", Kind::Direction, "Towards the particles."),
    ],
    rules: &[],
};

static CYLINDER: TableSpec = TableSpec {
    doc: "An exactly round cylinder shell centred at the origin: both its sides act, and discs at its ends if they are closed.",
    fields: &[
        Field::new("radius", LENGTH, "Radius [m].").above(0.0),
        Field::new("length", LENGTH, "Length along the axis [m].").above(0.0),
        Field::new("axis", Kind::Direction, "Its axis.").or("\"y\""),
        Field::new("ends", Kind::Bool, "Whether discs close its ends.").or("false"),
    ],
    rules: &[],
};

static CONE: TableSpec = TableSpec {
    doc: "An exactly round shell whose radius changes evenly along its axis, from the origin on: both its sides act, and discs at its ends if they are closed.",
    fields: &[
        Field::new("start_radius", LENGTH, "Radius at the origin [m].").above(0.0),
        Field::new("end_radius", LENGTH, "Radius at the other end [m].").above(0.0),
        Field::new("length", LENGTH, "Length along the axis [m].").above(0.0),
        Field::new("axis", Kind::Direction, "Its axis, from the origin to the other end.").or("\"z\""),
        Field::new("ends", Kind::Bool, "Whether discs close its ends.").or("false"),
    ],
    rules: &[],
};

static HOPPER: TableSpec = TableSpec {
    doc: "A funnel about z, its outlet at z = 0.",
    fields: &[
        Field::new("outlet_radius", LENGTH, "Radius at the bottom [m].").above(0.0),
        Field::new("top_radius", LENGTH, "Radius at the top [m].").above(0.0),
        Field::new("height", LENGTH, "Height [m].").above(0.0),
        Field::new("segments", Kind::Integer, "Flat pieces around.").or("72").at_least(3.0).at_most(1e5),
    ],
    rules: &[],
};

static TURN: TableSpec = TableSpec {
    doc: "A turn about an axis through the origin.",
    fields: &[
        Field::new("axis", Kind::Direction, "The axis."),
        Field::new("angle", ANGLE, "The angle [rad], right-handed.").usual(-6.3, 6.3),
    ],
    rules: &[],
};

static MOTION: TableSpec = TableSpec {
    doc: "A prescribed motion: the sum of its parts.",
    fields: &[
        Field::new("velocity", Kind::Vector(Dimension::VELOCITY), "Constant velocity [m/s].")
            .or("[0, 0, 0]")
            .usual(-100.0, 100.0),
        Field::new("rotation", Kind::Table(&ROTATION), "Steady rotation.").optional("none"),
        Field::new("oscillation", Kind::Table(&OSCILLATION), "Oscillating translation.").optional("none"),
        Field::new(
            "poses",
            Kind::Path,
            "CSV file with a header naming time [s], x, y, z [m] and, if it turns, qw, qx, qy, qz or the rotation vector \
             rx, ry, rz [rad], each with a unit if need be, such as `x [mm]`. Time counts from the beginning of the \
             motion; the surface goes and turns about its origin as the rows do, seen from the first row, straight \
             and evenly between rows; it rests before the first and after the last.",
        )
        .optional("none"),
    ],
    rules: &[],
};

static ROTATION: TableSpec = TableSpec {
    doc: "Steady rotation about an axis that moves along with the translation.",
    fields: &[
        Field::new("axis", Kind::Direction, "The axis."),
        Field::new("center", POINT, "A point of the axis when the stage begins [m].")
            .optional("the surface's origin, where `translate` put it"),
        Field::new("rate", Kind::Number(Dimension::ANGULAR_VELOCITY), "Rate [rad/s], right-handed."),
    ],
    rules: &[],
};

static OSCILLATION: TableSpec = TableSpec {
    doc: "Oscillating translation, amplitude · sin(2π frequency t + phase), without the jump at t = 0.",
    fields: &[
        Field::new("direction", Kind::Direction, "The direction."),
        Field::new("amplitude", LENGTH, "Amplitude [m].").at_least(0.0),
        Field::new("frequency", Kind::Number(Dimension::FREQUENCY), "Frequency [Hz].").at_least(0.0),
        Field::new("phase", ANGLE, "Phase [rad].").or("0.0").usual(-6.3, 6.3),
    ],
    rules: &[],
};

static STAGE: TableSpec = TableSpec {
    doc: "One part of a run. It removes, withdraws, inserts and bonds at its beginning; without `until` or `duration` it does only that.",
    fields: &[
        Field::new("name", Kind::Text, "Its name, each once."),
        Field::new("until", Kind::Table(&UNTIL), "When it ends.").optional("see `duration`"),
        Field::new("duration", TIME, "How long it takes [s].")
            .optional("see `until`")
            .above(0.0)
            .usual(1e-6, 1e4),
        Field::new("remove", Kind::Table(&REMOVE), "Takes particles away at its beginning.").optional("none"),
        Field::new("withdraw", Kind::References(Names::Surface), "Surfaces taken away at its beginning.")
            .or("[]"),
        Field::new(
            "insert",
            Kind::References(Names::Surface),
            "Surfaces that are there from its beginning on, and not before.",
        )
        .or("[]"),
        Field::new("bond", Kind::Bool, "Bonds particles at its beginning, as the law of bonds says.")
            .or("false"),
        Field::new("move", Kind::Named(Names::Surface, &MOTION), "Motions of surfaces, by name.").or("{}"),
        Field::new("measure", Kind::Named(Names::New, &MEASURE), "Numbers measured, by name.").or("{}"),
        Field::new(
            "survey",
            Kind::Named(Names::New, &SURVEY),
            "Numbers that the particles come to when the stage ends, by names that no measure has.",
        )
        .or("{}"),
        Field::new("cell", Kind::Table(&CELL), "How the cell deforms, if it is periodic along x, y and z.")
            .optional("it stands still"),
    ],
    rules: &[Rule::AtMostOne(&["until", "duration"])],
};

static CELL: TableSpec = TableSpec {
    doc: "How a periodic cell deforms: components without a rate or a stress keep their length or angle. Strain and stress are positive in compression.",
    fields: &[
        Field::new("rate", Kind::Table(&RATES), "Strain rates [1/s]; those of shear are of the angle.").or("{}"),
        Field::new("stress", Kind::Table(&STRESSES), "Stresses that a servo goes for and holds [Pa].").or("{}"),
        Field::new("inertial_number", NUMBER, "Largest inertial number that the servo may cause, apart from what given rates ask for: strain rate · 2 mean radius · √(density / largest stress).")
            .or("1e-3")
            .above(0.0)
            .at_most(1.0),
        Field::new("control_steps", Kind::Integer, "Steps between two acts of the servo; curves depend on it as they do on the time step.")
            .optional("as many as change the largest stress by a tenth, 1 to 20")
            .at_least(1.0)
            .at_most(1e4),
    ],
    rules: &[],
};

/// The components of a cell's deformation, in the order of the engine.
pub(crate) const COMPONENTS: [&str; 6] = ["xx", "yy", "zz", "yz", "xz", "xy"];

const RATE: Kind = Kind::Number(Dimension::FREQUENCY);
const STRESS: Kind = Kind::Number(Dimension::PRESSURE);
const OTHERWISE: &str = "see the other table; 0 if neither says";

static RATES: TableSpec = TableSpec {
    doc: "Strain rates.",
    fields: &[
        Field::new("xx", RATE, "Along x [1/s].").optional(OTHERWISE),
        Field::new("yy", RATE, "Along y [1/s].").optional(OTHERWISE),
        Field::new("zz", RATE, "Along z [1/s].").optional(OTHERWISE),
        Field::new("yz", RATE, "Of the angle between y and z [1/s].").optional(OTHERWISE),
        Field::new("xz", RATE, "Of the angle between x and z [1/s].").optional(OTHERWISE),
        Field::new("xy", RATE, "Of the angle between x and y [1/s].").optional(OTHERWISE),
    ],
    rules: &[],
};

static STRESSES: TableSpec = TableSpec {
    doc: "Stresses.",
    fields: &[
        Field::new("xx", STRESS, "Along x [Pa].").optional(OTHERWISE),
        Field::new("yy", STRESS, "Along y [Pa].").optional(OTHERWISE),
        Field::new("zz", STRESS, "Along z [Pa].").optional(OTHERWISE),
        Field::new("yz", STRESS, "Shear between y and z [Pa].").optional(OTHERWISE),
        Field::new("xz", STRESS, "Shear between x and z [Pa].").optional(OTHERWISE),
        Field::new("xy", STRESS, "Shear between x and y [Pa].").optional(OTHERWISE),
    ],
    rules: &[],
};

static UNTIL: TableSpec = TableSpec {
    doc: "When a stage ends: at the first that holds.",
    fields: &[
        Field::new(
            "kinetic_energy_below",
            Kind::Number(Dimension::ENERGY),
            "Kinetic energy below this [J], once it has risen above it or 100 steps have passed.",
        )
        .optional("energy does not matter")
        .above(0.0),
        Field::new("stress_within", NUMBER, "Every stress of `cell.stress` is reached to within this share of the largest, and the kinetic energy of translation is less than a thousandth of the elastic one.")
            .optional("stress does not matter")
            .above(0.0)
            .at_most(1.0),
        Field::new("at_most", TIME, "After this time [s].").optional("no limit").above(0.0).usual(1e-6, 1e4),
    ],
    rules: &[Rule::AtLeastOne(&["kinetic_energy_below", "stress_within", "at_most"])],
};

static REMOVE: TableSpec = TableSpec {
    doc: "Which particles are taken away, by their centre.",
    fields: &[
        Field::new("above", LENGTH, "Those above this z [m].").optional("see `beyond`"),
        Field::new("beyond", Kind::Table(&BEYOND), "Those beyond a plane.").optional("see `above`"),
    ],
    rules: &[Rule::ExactlyOne(&["above", "beyond"])],
};

pub(super) static BEYOND: TableSpec = TableSpec {
    doc: "The half-space x · axis > limit.",
    fields: &[
        Field::new("axis", Kind::Direction, "Its direction."),
        Field::new("limit", LENGTH, "Where it begins along the axis [m]."),
    ],
    rules: &[],
};

static MEASURE: TableSpec = TableSpec {
    doc: "Mean and standard deviation of a force or torque that particles exert on a surface.",
    fields: &[
        Field::new(
            "of",
            Kind::Probe,
            "The surface and fx, fy, fz [N], tx, ty, tz [N m] or draught (the force against its velocity) [N].",
        ),
        Field::new(
            "over_displacement",
            Kind::Window(Dimension::LENGTH),
            "While the surface's path since the stage began is in this window [m].",
        )
        .optional("the whole stage"),
        Field::new(
            "over_time",
            Kind::Window(Dimension::TIME),
            "While the time since the stage began is in this window [s].",
        )
        .optional("the whole stage"),
    ],
    rules: &[Rule::AtMostOne(&["over_displacement", "over_time"])],
};

static SURVEY: TableSpec = TableSpec {
    doc: "A number that the particles come to when the stage ends.",
    fields: &[
        Field::new(
            "of",
            Kind::Words(&["angle-of-repose", "bulk-density", "lacey-index"]),
            "The slope of the heap that they form [rad], along the middle of its flank; the mass over the volume of a \
             region [kg/m^3]; or how a class of them is mixed with the others over samples of a region [-], from 0 \
             (segregated) to 1 (at random).",
        ),
        Field::new("region", Kind::Table(&REGION), "The region of a bulk density or of a Lacey index.")
            .optional("needed with `bulk-density` and `lacey-index`"),
        Field::new(
            "spacing",
            LENGTH,
            "Width of a sample [m]; rounded so that whole samples fill the region.",
        )
        .optional("needed with `lacey-index`")
        .above(0.0),
        Field::new("material", Kind::Reference(Names::Material), "The class: particles of this material.")
            .optional("see `radius_above`"),
        Field::new("radius_above", LENGTH, "The class: particles of a larger radius [m].")
            .optional("see `material`")
            .above(0.0),
    ],
    rules: &[Rule::AtMostOne(&["material", "radius_above"])],
};

static OUTPUT: TableSpec = TableSpec {
    doc: "What is written, how often.",
    fields: &[
        Field::new("frames", TIME, "Time between frames of all particles [s].")
            .optional("no frames")
            .above(0.0),
        Field::new("contacts", Kind::Bool, "Whether frames show contacts, as lines with forces.").or("false"),
        Field::new("series", TIME, "Time between rows of series.csv, and between checks of stage ends [s].")
            .or("\"1 ms\"")
            .above(0.0),
        Field::new("field", Kind::List(&FIELD), "Fields on regular grids.").or("[]"),
        Field::new("energy_ledger", Kind::Bool, "Whether dissipated energy is accounted each step.")
            .or("true"),
        Field::new("checkpoint", TIME, "Simulated time between checkpoints [s].")
            .optional("no such; see `checkpoint_wall`")
            .above(0.0),
        Field::new(
            "checkpoint_wall",
            TIME,
            "Wall time between checkpoints [s]; others are written at the beginning, at stage ends and when interrupted.",
        )
        .or("\"1 min\"")
        .at_least(0.0)
        .at_most(1e9),
        Field::new(
            "checkpoint_history",
            Kind::Bool,
            "Whether checkpoints hold what contacts remember. Without it they are smaller, and a run that is continued \
             ends with other bits.",
        )
        .or("true"),
    ],
    rules: &[],
};
