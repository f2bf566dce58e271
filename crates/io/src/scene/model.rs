//! What a scene file says, as checked values, and the checks that need more than one of them.

use std::path::PathBuf;

use glebe_engine::exchange::Outlet;
use glebe_engine::field::FieldSpec;
use glebe_engine::generate::SizeDistribution;
use glebe_engine::spec::{
    Component, Deformation, Drive, Frustum, Guards, Motion, Oscillation, Rotation, Sampling, Search, Side,
    Step, Surveyed, Time, Until, Vec3, Window,
};
use glebe_physics::{ContactModel, LawChoice, Material, Mixing, PairLaws, PairOverride, ShearModulusRule};

use super::check::{Checked, Checker, Record};
use super::doors::{Doors, InletPart, doors};
use super::error::{Located, Place, SceneError};
use super::fields::{
    COMPONENTS, ENDS, HISTORIES, INTEGRATORS, MIXING_RULES, SEARCHES, SHAPES, SHEAR_MODULI, SIDES,
};
use super::outputs;
use super::surveys::survey;
use super::tools;
use crate::tool::Tool;
use crate::units::{self, Dimension};

/// A scene file that passed every check that needs no other file. Numbers are in SI units.
///
/// Values that the engine takes as they are have the engine's types; things are still called by their
/// names. [`Scene::build`] reads the files that it names and makes a world of it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Scene {
    /// Name for output and messages.
    pub title: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Whether a GPU takes the kernels for many worlds, if the scene says so.
    pub throughput: Option<bool>,
    /// How particles find those near to them.
    pub search: Search,
    /// Gravity \[m/s²\].
    pub gravity: Vec3,
    /// The box that the particles are in.
    pub domain: DomainPart,
    /// Step and integrator.
    pub time: Time,
    /// When a run is stopped.
    pub guards: Guards,
    /// Materials in the order of the file, then the built-in ones that it uses. The density of one that was
    /// given none, for walls, is 0.
    pub materials: Vec<Material>,
    /// Pairs with values of their own.
    pub pairs: Vec<PairPart>,
    /// How values of pairs are mixed.
    pub mixing: Mixing,
    /// Which G* expression is used.
    pub shear_modulus: ShearModulusRule,
    /// The contact laws.
    pub contact: ContactModel,
    /// Local non-viscous damping \[-\].
    pub local_damping: f64,
    /// Groups of particles.
    pub particles: Vec<ParticlePart>,
    /// Where particles come in.
    pub inlets: Vec<InletPart>,
    /// Where they are taken away.
    pub outlets: Vec<Outlet>,
    /// Tools and walls.
    pub geometry: Vec<GeometryPart>,
    /// What happens, in order.
    pub stages: Vec<StagePart>,
    /// How often the world is observed.
    pub sampling: Sampling,
    /// Fields that are measured.
    pub fields: Vec<FieldSpec>,
    /// Whether frames show contacts.
    pub network: bool,
    /// Of each material, coefficient over hardness of wear \[1/Pa\]; 0 for none.
    pub wear: Vec<f64>,
    /// Simulated time between checkpoints \[s\]; absent for stage ends only.
    pub checkpoint: Option<f64>,
    /// Wall time between checkpoints \[s\].
    pub checkpoint_wall: f64,
    /// Whether checkpoints hold what contacts remember.
    pub checkpoint_history: bool,
    /// What looks wrong but does not stop a run.
    pub warnings: Vec<SceneError>,
    /// What was added without being asked for, for the log.
    pub notes: Vec<String>,
    pub(super) places: ScenePlaces,
}

/// Where values are that the engine may refuse.
#[derive(Clone, Debug)]
pub(super) struct ScenePlaces {
    pub step: Place,
    pub contact: Place,
    pub domain: Place,
    /// Of the laws of each pair.
    pub pairs: Vec<Place>,
    /// Of inlets and outlets, by name.
    pub doors: Vec<(String, Place)>,
}

/// `[domain]`
#[derive(Clone, Debug)]
pub struct DomainPart {
    /// Corner of least coordinates \[m\].
    pub min: Vec3,
    /// Corner of largest coordinates \[m\].
    pub max: Vec3,
    /// What the low and the high side of each axis do.
    pub sides: [[Side; 2]; 3],
    /// Material of walls.
    pub material: Option<String>,
}

/// `[pair.a-b]`
#[derive(Clone, Debug, PartialEq)]
pub struct PairPart {
    /// The two materials, in the order written.
    pub materials: [String; 2],
    /// The values given.
    pub values: PairOverride,
}

/// `[particles.NAME]`
#[derive(Clone, Debug)]
pub struct ParticlePart {
    /// Its name.
    pub name: Located<String>,
    /// Material; absent if the file names one for each particle.
    pub material: Option<String>,
    /// Where they come from.
    pub origin: Origin,
    /// Velocity at the start \[m/s\], unless the file gives one.
    pub velocity: Vec3,
}

/// Where particles come from.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Origin {
    /// A CSV, VTU, VTP or PLY file, relative to the scene.
    File(Located<PathBuf>),
    /// Generated.
    Generated {
        /// How many.
        count: usize,
        /// Their radii.
        sizes: SizeDistribution,
        /// Name of the fill ([`glebe_engine::generate::fills`]).
        fill: String,
        /// Least and largest corner of where they are placed \[m\]; absent for the domain.
        region: Option<[Vec3; 2]>,
        /// Solid fraction asked for \[-\].
        solid_fraction: Option<f64>,
        /// Seed, if not the scene's.
        seed: Option<u64>,
        /// What errors of the generator point at.
        place: Place,
    },
}

/// `[geometry.NAME]`
#[derive(Clone, Debug)]
pub struct GeometryPart {
    /// Its name.
    pub name: Located<String>,
    /// Its material.
    pub material: String,
    /// Its shape.
    pub shape: Located<GeometryShape>,
    /// Factors on coordinates \[-\], or \[m per unit of the file\], > 0.
    pub scale: Vec3,
    /// Turns after scaling: unit axis through the origin, angle \[rad\].
    pub rotate: Vec<(Vec3, f64)>,
    /// Shift after turning \[m\].
    pub translate: Vec3,
    /// How it moves in stages that do not say otherwise.
    pub motion: MotionPart,
}

/// The shape of a tool or wall.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum GeometryShape {
    /// A mesh file, relative to the scene.
    File(PathBuf),
    /// An axis-aligned closed box.
    Box {
        /// Corner of least coordinates \[m\].
        min: Vec3,
        /// Corner of largest coordinates \[m\].
        max: Vec3,
    },
    /// An unbounded plane.
    Plane {
        /// A point of it \[m\].
        point: Vec3,
        /// Unit normal towards the particles.
        normal: Vec3,
    },
    /// A tool by its parameters.
    Tool(Tool),
    /// An exactly round cylinder or cone.
    Round(Frustum),
    /// A funnel about z with its outlet at z = 0.
    Hopper {
        /// Radius at z = 0 \[m\].
        outlet_radius: f64,
        /// Radius at the top \[m\].
        top_radius: f64,
        /// Height \[m\].
        height: f64,
        /// Flat pieces around.
        segments: u32,
    },
}

/// `[[stage]]`
#[derive(Clone, Debug)]
pub struct StagePart {
    /// Its name, unique.
    pub name: Located<String>,
    /// When it ends.
    pub until: Until,
    /// Particles with `x·axis > limit` are removed: unit axis, limit \[m\].
    pub remove: Option<(Vec3, f64)>,
    /// Surfaces taken away at its beginning.
    pub withdraw: Vec<String>,
    /// Surfaces that come at its beginning.
    pub insert: Vec<String>,
    /// Whether particles are bonded at its beginning.
    pub bond: bool,
    /// Motions by surface.
    pub moves: Vec<(String, MotionPart)>,
    /// What is measured.
    pub measures: Vec<MeasurePart>,
    /// What its particles come to when it ends.
    pub surveys: Vec<SurveyPart>,
    /// How the cell deforms.
    pub deformation: Option<Deformation>,
}

/// A motion whose rotation may leave its centre to the surface, and whose table is in a file.
#[derive(Clone, Debug, Default)]
pub struct MotionPart {
    /// The motion, without its table.
    pub motion: Motion,
    /// The table of poses, relative to the scene.
    pub poses: Option<Located<PathBuf>>,
    /// Whether the rotation's centre is the surface's origin instead of the one in `motion`.
    pub about_origin: bool,
}

/// `measure.NAME`
#[derive(Clone, Debug, PartialEq)]
pub struct MeasurePart {
    /// Its name.
    pub name: String,
    /// The surface measured.
    pub surface: String,
    /// Which component.
    pub component: Component,
    /// When it counts.
    pub window: Window,
}

/// A number that particles come to at the end of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyPart {
    /// Its name.
    pub name: String,
    /// What it is.
    pub of: Surveyed,
}

/// Materials that need no definition.
///
/// Steel: E, ν and density of structural steel; restitution and frictions those of the walls in table 6.2,
/// column 5, of the GPUDEM thesis (2023). They are values of a pair in truth, so a scene that depends on
/// them gives its own, as `[material.steel]` or per pair.
pub(crate) fn built_in() -> Vec<Material> {
    vec![Material {
        name: "steel".to_owned(),
        density: 7850.0,
        youngs_modulus: 2.1e11,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.6,
        static_friction: 0.7,
        rolling_friction: 0.03,
    }]
}

/// Makes the scene of a checked file; what is wrong goes to the checker, and the result is then void.
pub(crate) fn scene(file: &Record, checker: &mut Checker) -> Scene {
    let materials: Vec<Material> =
        file.named("material").iter().map(|(n, m)| material(n, m, checker)).collect();
    let [mixing, contact, output] = ["mixing", "contact", "output"].map(|key| file.table_or_empty(key));
    let (time, guards) = time(&file.table_or_empty("time"));
    let rule = |key| MIXING_RULES.value(&mixing.text(key));
    let mut scene = Scene {
        title: file.text("title"),
        seed: file.integer("seed"),
        throughput: file.has("throughput").then(|| file.flag("throughput")),
        search: SEARCHES.value(&file.text("search")),
        gravity: file.vector("gravity"),
        domain: domain(&file.table_or_empty("domain"), checker),
        time,
        guards,
        materials,
        pairs: pairs(file, checker),
        mixing: Mixing {
            restitution: rule("restitution"),
            friction: rule("friction"),
            static_friction: rule("static_friction"),
            rolling_friction: rule("rolling_friction"),
        },
        shear_modulus: SHEAR_MODULI.value(&mixing.text("shear_modulus")),
        contact: ContactModel {
            normal: contact.law("normal"),
            tangential: contact.law("tangential"),
            rolling: contact.law("rolling"),
            cohesion: contact.law("cohesion"),
            bond: contact.law("bond"),
            end: ENDS.value(&contact.text("end")),
            history: HISTORIES.value(&contact.text("history")),
        },
        local_damping: contact.number("local_damping"),
        particles: file.named("particles").iter().map(|(n, p)| particles(n, p, file, checker)).collect(),
        geometry: file.named("geometry").iter().map(|(n, g)| geometry(n, g, checker)).collect(),
        inlets: Vec::new(),
        outlets: Vec::new(),
        stages: Vec::new(),
        sampling: Sampling {
            series: output.number("series"),
            frames: output.number_if("frames"),
            energy_ledger: output.flag("energy_ledger"),
        },
        fields: Vec::new(),
        network: output.flag("contacts"),
        wear: file.named("material").iter().map(|(_, m)| wear(m)).collect(),
        checkpoint: output.number_if("checkpoint"),
        checkpoint_wall: output.number("checkpoint_wall"),
        checkpoint_history: output.flag("checkpoint_history"),
        warnings: Vec::new(),
        notes: Vec::new(),
        places: ScenePlaces {
            step: file.table_or_empty("time").place("step").clone(),
            contact: contact.place.clone(),
            domain: file.place("domain").clone(),
            doors: ["inlet", "outlet"]
                .iter()
                .flat_map(|kind| file.named(kind))
                .map(|(name, _)| (name.value.clone(), name.place.clone()))
                .collect(),
            pairs: file.named("pair").iter().map(|(_, p)| p.place("contact").clone()).collect(),
        },
    };
    scene.fields = outputs::fields(&output, &scene.domain, checker);
    outputs::contacts_need_frames(&output, checker);
    scene.stages = stages(file, &scene.geometry, checker);
    bonds_are_made(&scene, checker);
    let Doors { inlets, outlets } = doors(file, scene.sampling.series, &scene.stages, checker);
    (scene.inlets, scene.outlets) = (inlets, outlets);
    if let Some(field) = output.list("field").first()
        && scene.stages.iter().any(|stage| stage.deformation.is_some())
    {
        let message = "fields are on a grid that stands still, but the cell deforms in a stage";
        checker.error(
            SceneError::new("conflict", field.place("name"), message)
                .label("this field")
                .help("leave it out: series.csv has stress, strain and fabric of samples that deform"),
        );
    }
    sizes_fit_domain(file, &scene, checker);
    use_built_in(&mut scene);
    scene
}

/// Warns where a law of bonds is chosen and no stage makes any.
fn bonds_are_made(scene: &Scene, checker: &mut Checker) {
    // A law that is not known has its own error.
    let bonds = |law: &LawChoice| !matches!(law.law.as_str(), "none" | "");
    let mut of_pairs = scene.pairs.iter().zip(&scene.places.pairs);
    let of_pair = of_pairs.find(|(p, _)| p.values.laws.bond.as_ref().is_some_and(bonds));
    let own = bonds(&scene.contact.bond).then_some(&scene.places.contact);
    let Some(place) = own.or(of_pair.map(|(_, place)| place)) else { return };
    if scene.stages.iter().any(|stage| stage.bond) {
        return;
    }
    let error = SceneError::new("unusual", place, "a law of bonds is chosen, but no stage bonds particles")
        .label("no bonds will be made")
        .help("set bond = true in the stage at whose beginning they are to be made");
    checker.error(error.warning());
}

fn material(name: &Located<String>, m: &Record, checker: &mut Checker) -> Material {
    static_not_below_sliding(m, checker);
    Material {
        name: name.value.clone(),
        density: m.number_if("density").unwrap_or(0.0),
        youngs_modulus: m.number("youngs_modulus"),
        poissons_ratio: m.number("poissons_ratio"),
        restitution: m.number("restitution"),
        friction: m.number("friction"),
        static_friction: m.number("static_friction"),
        rolling_friction: m.number("rolling_friction"),
    }
}

/// Archard's coefficient over hardness \[1/Pa\].
fn wear(material: &Record) -> f64 {
    material.table("wear").map_or(0.0, |w| w.number("coefficient") / w.number("hardness"))
}

fn static_not_below_sliding(record: &Record, checker: &mut Checker) {
    let (of_rest, sliding) = (record.number("static_friction"), record.number("friction"));
    if of_rest < sliding {
        let message = format!("static friction {of_rest} is below sliding friction {sliding}");
        checker.error(
            SceneError::new("order", record.place("static_friction"), message).label("too small").help(
                format!(
                    "give `static_friction` {sliding} or more, or leave it out to have it equal `friction`"
                ),
            ),
        );
    }
}

fn pair_laws(contact: &Record) -> PairLaws {
    PairLaws {
        normal: contact.law_if("normal"),
        tangential: contact.law_if("tangential"),
        rolling: contact.law_if("rolling"),
        cohesion: contact.law_if("cohesion"),
        bond: contact.law_if("bond"),
    }
}

fn pairs(file: &Record, checker: &mut Checker) -> Vec<PairPart> {
    let mut all: Vec<PairPart> = Vec::new();
    for (name, values) in file.named("pair") {
        static_not_below_sliding(values, checker);
        let Some([a, b]) = checker.known.pair(&name.value) else { continue };
        let same = |p: &PairPart| p.materials == [a, b] || p.materials == [b, a];
        if all.iter().any(same) {
            checker.error(
                SceneError::new(
                    "duplicate",
                    &name.place,
                    format!("the pair of `{a}` and `{b}` is given twice"),
                )
                .label("again")
                .help("the order of the two does not matter; put all values into one table"),
            );
        }
        let values = PairOverride {
            restitution: values.number_if("restitution"),
            friction: values.number_if("friction"),
            static_friction: values.number_if("static_friction"),
            rolling_friction: values.number_if("rolling_friction"),
            cohesion: values.number_if("cohesion"),
            laws: pair_laws(&values.table_or_empty("contact")),
        };
        all.push(PairPart { materials: [a.to_owned(), b.to_owned()], values });
    }
    all
}

fn domain(record: &Record, checker: &mut Checker) -> DomainPart {
    let (min, max) = corners(record, "domain", checker);
    let table = record.table("sides");
    let mut sides = [[Side::Wall; 2]; 3];
    let word = |value: &Checked| match value {
        Checked::Text(word) => SIDES.value(word).0,
        _ => Side::Wall,
    };
    for (axis, both) in ["x", "y", "z"].into_iter().zip(&mut sides) {
        let Some(table) = table else { break };
        *both = match table.get(axis) {
            Some(Checked::LowHigh(pair)) => [word(&pair[0]), word(&pair[1])],
            Some(single) => [word(single); 2],
            None => continue,
        };
        if both[0] != both[1] && both.contains(&Side::Periodic) {
            let message = format!("only one side across {axis} is periodic");
            checker.error(
                SceneError::new("conflict", table.place(axis), message)
                    .label("one periodic side")
                    .help(format!("what leaves one side enters at the other: write {axis} = \"periodic\"")),
            );
        }
    }
    let material = record.located_if("material").map(|m| m.value);
    let has_walls = sides.as_flattened().contains(&Side::Wall);
    if let Some(table) = table
        && has_walls
        && !record.written("material")
    {
        checker.error(
            SceneError::new("missing", &table.place, "the walls of the domain have no material")
                .label("these are walls")
                .help("write material = \"…\" in [domain], or make the sides \"open\" or \"periodic\""),
        );
    }
    DomainPart { min, max, sides, material }
}

/// `min` and `max` of a box, which must ascend along each axis.
pub(super) fn corners(record: &Record, path: &str, checker: &mut Checker) -> (Vec3, Vec3) {
    let (min, max) = (record.vector("min"), record.vector("max"));
    ascend(record, path, min, max, checker);
    (min, max)
}

/// The corners of a box must ascend along each axis.
pub(super) fn ascend(record: &Record, path: &str, min: Vec3, max: Vec3, checker: &mut Checker) {
    for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
        if min[k] >= max[k] {
            let message =
                format!("`{path}` has no extent along {axis}: min is {} m, max is {} m", min[k], max[k]);
            checker.error(
                SceneError::new("order", record.place("max"), message)
                    .label("not above min")
                    .help("each component of `max` must be larger than that of `min`"),
            );
        }
    }
}

fn time(record: &Record) -> (Time, Guards) {
    let number = |key: &str| match record.get(key) {
        Some(Checked::Number(x)) => Some(*x),
        _ => None,
    };
    let step = number("step").map_or(Step::Auto, Step::Fixed);
    let integrator = INTEGRATORS.value(&record.text("integrator"));
    let limit = number("overlap_limit");
    let guards = Guards {
        overlap_limit: limit.unwrap_or(Guards::default().overlap_limit),
        overlap_stops: limit.is_some(),
    };
    (Time { step, integrator, force: record.flag("force") }, guards)
}

fn particles(name: &Located<String>, record: &Record, file: &Record, checker: &mut Checker) -> ParticlePart {
    let material = record.located_if("material");
    if let Some(material) = &material {
        needs_density(material, file, checker);
    }
    let origin = match record.located_if("file") {
        Some(path) => Origin::File(Located { value: PathBuf::from(path.value), place: path.place }),
        None => Origin::Generated {
            count: usize::try_from(record.integer("count")).unwrap_or(usize::MAX),
            sizes: sizes(record, checker),
            fill: record.text("fill"),
            region: record
                .table("region")
                .map(|r| corners(r, &format!("particles.{}.region", name.value), checker).into()),
            solid_fraction: record.number_if("solid_fraction"),
            seed: record.has("seed").then(|| record.integer("seed")),
            place: record.place("count").clone(),
        },
    };
    ParticlePart {
        name: name.clone(),
        material: material.map(|m| m.value),
        origin,
        velocity: record.vector("velocity"),
    }
}

/// Materials of particles have a density.
pub(super) fn needs_density(material: &Located<String>, file: &Record, checker: &mut Checker) {
    if let Some((_, table)) = file.named("material").iter().find(|(n, _)| n.value == material.value)
        && !table.written("density")
    {
        let message = format!("`{}` is a material of particles and has no density", material.value);
        checker.error(SceneError::new("missing", &material.place, message).label("needs a density").help(
            format!("write density = … in [material.{}], for example \"1850 kg/m^3\"", material.value),
        ));
    }
}

pub(super) fn sizes(record: &Record, checker: &mut Checker) -> SizeDistribution {
    let Some(table) = record.table("radius") else {
        return SizeDistribution::Constant(record.number("radius"));
    };
    let mut limits = |t: &Record, min: f64, max: f64| {
        let (min, max) = (t.number_if("min").unwrap_or(min), t.number_if("max").unwrap_or(max));
        if min > max {
            let message = format!("the least radius {min} m is above the largest {max} m");
            checker.error(SceneError::new("order", t.place("min"), message).label("too large"));
        }
        (min, max)
    };
    if let Some([min, max]) = table.window_if("uniform") {
        SizeDistribution::Uniform { min, max }
    } else if let Some(t) = table.table("normal") {
        let (mean, std) = (t.number("mean"), t.number("std"));
        let (min, max) = limits(t, (mean - 3.0 * std).max(0.1 * mean), mean + 3.0 * std);
        SizeDistribution::Normal { mean, std, min, max }
    } else if let Some(t) = table.table("log_normal") {
        let (median, sigma) = (t.number("median"), t.number("sigma"));
        let (min, max) = limits(t, median * (-3.0 * sigma).exp(), median * (3.0 * sigma).exp());
        SizeDistribution::LogNormal { median, sigma, min, max }
    } else if let Some(t) = table.table("sieve") {
        sieve(t, checker)
    } else {
        SizeDistribution::Constant(f64::NAN)
    }
}

fn sieve(t: &Record, checker: &mut Checker) -> SizeDistribution {
    let (opening, passing) = (t.numbers("opening"), t.numbers("passing"));
    let descent = |list: &[f64], wrong: fn(f64, f64) -> bool| {
        list.iter().zip(list.iter().skip(1)).map(|(a, b)| (*a, *b)).find(|(a, b)| wrong(*a, *b))
    };
    let mut wrong = |key: &str, message: String, help: &str| {
        checker.error(SceneError::new("order", t.place(key), message).label("this list").help(help));
    };
    // Lists whose numbers failed have their own errors.
    if let (Some(first), Some(last)) = (passing.first(), passing.last())
        && !opening.is_empty()
    {
        if opening.len() != passing.len() {
            let message = format!("a sieve curve of {} openings and {} shares", opening.len(), passing.len());
            wrong("passing", message, "give one share for each opening");
        }
        if let Some((before, after)) = descent(&opening, |a, b| a >= b) {
            let message = format!("the opening {after} m follows {before} m");
            wrong("opening", message, "list the openings from the finest to the coarsest");
        }
        if let Some((before, after)) = descent(&passing, |a, b| a > b) {
            let message = format!("the share {after} follows {before}");
            wrong("passing", message, "a coarser sieve lets no less mass pass");
        }
        if (*first, *last) != (0.0, 1.0) {
            let message = format!("the shares go from {first} to {last}");
            wrong("passing", message, "they go from 0 at the finest opening to 1 at the coarsest");
        }
    }
    SizeDistribution::Sieve(opening.iter().map(|d| 0.5 * d).zip(passing).collect())
}

fn geometry(name: &Located<String>, record: &Record, checker: &mut Checker) -> GeometryPart {
    let scale = match record.get("scale") {
        Some(Checked::Vector(factors)) => *factors,
        _ => [record.number("scale"); 3],
    };
    // One of a list of lengths.
    let unit = record
        .located_if("unit")
        .and_then(|unit| units::parse(&format!("1 {}", unit.value), Dimension::LENGTH).ok());
    let unit = unit.unwrap_or(1.0);
    let key = SHAPES.iter().copied().find(|key| record.has(key)).unwrap_or("file");
    let shape = match (key, record.table(key)) {
        ("box", Some(t)) => {
            let (min, max) = corners(t, &format!("geometry.{}.box", name.value), checker);
            GeometryShape::Box { min, max }
        }
        ("plane", Some(t)) => GeometryShape::Plane { point: t.vector("point"), normal: t.vector("normal") },
        ("cylinder", Some(t)) => GeometryShape::Round(Frustum {
            axis: t.vector("axis"),
            ends: [-0.5 * t.number("length"), 0.5 * t.number("length")],
            radii: [t.number("radius"); 2],
            closed: t.flag("ends"),
        }),
        ("cone", Some(t)) => GeometryShape::Round(Frustum {
            axis: t.vector("axis"),
            ends: [0.0, t.number("length")],
            radii: [t.number("start_radius"), t.number("end_radius")],
            closed: t.flag("ends"),
        }),
        ("hopper", Some(t)) => GeometryShape::Hopper {
            outlet_radius: t.number("outlet_radius"),
            top_radius: t.number("top_radius"),
            height: t.number("height"),
            segments: tools::count(t, "segments"),
        },
        (key, table) => match table.and_then(|t| tools::read(key, t)) {
            Some(tool) => GeometryShape::Tool(tool),
            None => GeometryShape::File(PathBuf::from(record.text("file"))),
        },
    };
    let translate = record.vector("translate");
    GeometryPart {
        name: name.clone(),
        material: record.text("material"),
        shape: Located { value: shape, place: record.place(key).clone() },
        scale: scale.map(|factor| factor * unit),
        rotate: record.list("rotate").iter().map(|t| (t.vector("axis"), t.number("angle"))).collect(),
        translate,
        motion: record.table("motion").map(motion).unwrap_or_default(),
    }
}

fn motion(t: &Record) -> MotionPart {
    let rotation = t.table("rotation");
    let about_origin = rotation.is_some_and(|r| !r.has("center"));
    let rotation = rotation.map(|r| Rotation {
        axis: r.vector("axis"),
        center: if about_origin { [0.0; 3] } else { r.vector("center") },
        rate: r.number("rate"),
    });
    let oscillation = t.table("oscillation").map(|o| Oscillation {
        amplitude: o.vector("direction").map(|x| x * o.number("amplitude")),
        frequency: o.number("frequency"),
        phase: o.number("phase"),
    });
    let motion = Motion { velocity: t.vector("velocity"), rotation, oscillation, poses: None };
    let poses = t.located_if("poses").map(|p| Located { value: PathBuf::from(p.value), place: p.place });
    MotionPart { motion, poses, about_origin }
}

fn stages(file: &Record, geometry: &[GeometryPart], checker: &mut Checker) -> Vec<StagePart> {
    let records = file.list("stage");
    if records.is_empty() && file.has("stage") {
        checker.error(
            SceneError::new("missing", file.place("stage"), "the scene has no stage")
                .label("empty")
                .help("write [[stage]] with a name and a duration"),
        );
    }
    let mut all: Vec<StagePart> = Vec::new();
    for record in records {
        let stage = stage(record, geometry, file, checker);
        if all.iter().any(|s| s.name == stage.name && !s.name.value.is_empty()) {
            let message = format!("two stages are called `{}`", stage.name.value);
            checker.error(
                SceneError::new("duplicate", &stage.name.place, message)
                    .label("again")
                    .help("results and --set address stages by name: give each its own"),
            );
        }
        all.push(stage);
    }
    all
}

fn stage(record: &Record, geometry: &[GeometryPart], file: &Record, checker: &mut Checker) -> StagePart {
    // Keys whose values failed have their own errors.
    let lasts = record.written("until") || record.written("duration");
    let until = match record.table("until") {
        Some(t) => Until {
            kinetic_energy_below: t.number_if("kinetic_energy_below"),
            stress_within: t.number_if("stress_within"),
            at_most: t.number_if("at_most"),
        },
        None => Until { at_most: record.number_if("duration"), ..Until::default() },
    };
    let remove = record.table("remove").map(|t| match t.table("beyond") {
        Some(beyond) => (beyond.vector("axis"), beyond.number("limit")),
        None => ([0.0, 0.0, 1.0], t.number("above")),
    });
    let values = |key: &str| record.names(key).into_iter().map(|n| n.value).collect::<Vec<_>>();
    let name =
        record.located_if("name").unwrap_or(Located { value: String::new(), place: record.place.clone() });
    let stage = StagePart {
        name,
        until,
        remove,
        withdraw: values("withdraw"),
        insert: values("insert"),
        bond: record.flag("bond"),
        moves: record.named("move").iter().map(|(name, m)| (name.value.clone(), motion(m))).collect(),
        measures: record.named("measure").iter().map(|(name, m)| measure(name, m)).collect(),
        surveys: record
            .named("survey")
            .iter()
            .filter_map(|(name, s)| survey(name, s, file, checker))
            .collect(),
        deformation: record.table("cell").map(|cell| deformation(cell, checker)),
    };
    let acts = ["remove", "withdraw", "insert", "bond"].into_iter().any(|key| record.written(key));
    for (name, _) in record.named("survey") {
        if stage.measures.iter().any(|m| m.name == name.value) {
            let message = format!("`{}` is the name of a measure of this stage already", name.value);
            checker.error(SceneError::new("duplicate", &name.place, message).label("taken"));
        }
    }
    let timed = ["move", "measure", "cell"].into_iter().any(|key| record.written(key));
    if !lasts && (timed || !acts) {
        let message = format!("the stage `{}` has no end", stage.name.value);
        checker.error(
            SceneError::new("missing", &stage.name.place, message)
                .label("needs `duration` or `until`")
                .help("write duration = \"1 s\", or until = { kinetic_energy_below = \"0.1 J\", at_most = \"2 s\" }"),
        );
    }
    for ((_, measured), part) in record.named("measure").iter().zip(&stage.measures) {
        measured_surface_moves(measured, part, &stage, geometry, checker);
    }
    stage
}

fn deformation(record: &Record, checker: &mut Checker) -> Deformation {
    let [rates, stresses] = ["rate", "stress"].map(|key| record.table_or_empty(key));
    let drive = |component: &str| match (rates.number_if(component), stresses.number_if(component)) {
        (Some(_), Some(stress)) => {
            let message = format!("the component {component} of the cell has a rate and a stress");
            checker.error(
                SceneError::new("conflict", stresses.place(component), message)
                    .label("and a rate")
                    .help("leave one of them out: the servo finds the rate that a stress takes"),
            );
            Drive::Stress(stress)
        }
        (None, Some(stress)) => Drive::Stress(stress),
        (rate, None) => Drive::Rate(rate.unwrap_or(0.0)),
    };
    Deformation {
        drive: COMPONENTS.map(drive),
        inertial_number: record.number("inertial_number"),
        control_steps: record.integer_if("control_steps"),
    }
}

/// Warns where a window of displacement or a draught force belongs to a surface that stands still.
fn measured_surface_moves(
    record: &Record,
    measure: &MeasurePart,
    stage: &StagePart,
    geometry: &[GeometryPart],
    checker: &mut Checker,
) {
    let own = geometry.iter().find(|g| g.name.value == measure.surface).map(|g| &g.motion);
    let moved = stage.moves.iter().find(|(name, _)| *name == measure.surface).map(|(_, m)| m);
    let moves = moved
        .or(own)
        .is_none_or(|m| m.motion.velocity != [0.0; 3] || m.motion.oscillation.is_some() || m.poses.is_some());
    let needs = matches!(measure.window, Window::Displacement(..)) || measure.component == Component::Draught;
    if needs && !moves {
        let key = if measure.component == Component::Draught { "of" } else { "over_displacement" };
        let message = format!("`{}` does not move in this stage, so nothing is measured", measure.surface);
        checker.error(
            SceneError::new("unusual", record.place(key), message)
                .label("stands still")
                .help(format!(
                    "write move.{} = {{ velocity = [...] }}, or measure over_time",
                    measure.surface
                ))
                .warning(),
        );
    }
}

fn measure(name: &Located<String>, record: &Record) -> MeasurePart {
    let of = record.text("of");
    let (surface, component) = of.rsplit_once('.').unwrap_or_default();
    let component = match component.as_bytes() {
        [b'f', axis] => Component::Force(usize::from(axis.saturating_sub(b'x'))),
        [b't', axis] => Component::Torque(usize::from(axis.saturating_sub(b'x'))),
        _ => Component::Draught,
    };
    let window = match (record.window_if("over_displacement"), record.window_if("over_time")) {
        (Some([from, to]), _) => Window::Displacement(from, to),
        (None, Some([from, to])) => Window::Time(from, to),
        (None, None) => Window::Stage,
    };
    MeasurePart { name: name.value.clone(), surface: surface.to_owned(), component, window }
}

/// Warns about radii that are far from the domain's size: most likely a slip of a unit.
fn sizes_fit_domain(file: &Record, scene: &Scene, checker: &mut Checker) {
    let width = (0..3).map(|k| scene.domain.max[k] - scene.domain.min[k]).fold(f64::INFINITY, f64::min);
    for ((_, record), part) in file.named("particles").iter().zip(&scene.particles) {
        let Origin::Generated { sizes, .. } = &part.origin else { continue };
        let (least, largest) = sizes.limits();
        let problem = if 2.0 * largest > width {
            "wider than the domain"
        } else if least < 1e-4 * width {
            "less than a ten-thousandth of the domain's width"
        } else {
            continue;
        };
        let message = format!("particles of `{}` are {problem}", part.name.value);
        checker.error(
            SceneError::new("unusual", record.place("radius"), message)
                .label("a slip of the unit?")
                .help(format!("radii go from {least} m to {largest} m; the domain is {width} m wide"))
                .warning(),
        );
    }
}

/// Adds the built-in materials that the scene names and does not define.
fn use_built_in(scene: &mut Scene) {
    for material in built_in() {
        let defined = scene.materials.iter().any(|m| m.name == material.name);
        let named = scene.domain.material.iter().any(|m| *m == material.name)
            || scene.particles.iter().any(|p| p.material.as_ref() == Some(&material.name))
            || scene.inlets.iter().any(|inlet| inlet.material() == Some(&material.name))
            || scene.geometry.iter().any(|g| g.material == material.name)
            || scene.pairs.iter().any(|p| p.materials.contains(&material.name));
        if named && !defined {
            scene.notes.push(format!(
                "material `{}` is built in: density {} kg/m³, E {:e} Pa, ν {}, e {}, μ {}, μ0 {}, μr {}; [material.{}] in the \
                 scene would replace it",
                material.name,
                material.density,
                material.youngs_modulus,
                material.poissons_ratio,
                material.restitution,
                material.friction,
                material.static_friction,
                material.rolling_friction,
                material.name
            ));
            scene.materials.push(material);
            scene.wear.push(0.0);
        }
    }
}
