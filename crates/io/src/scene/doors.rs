//! The keys of inlets and outlets, and what they mean.

use glebe_engine::exchange::{Grains, Inlet, Outlet, Room, Supply};
use glebe_engine::generate::SizeDistribution;
use glebe_engine::spec::Vec3;

use super::check::{Checker, Record};
use super::error::{Located, Place, SceneError};
use super::fields::{BEYOND, LENGTH, POINT, REGION, SIZES, TIME};
use super::model::{StagePart, corners, needs_density, sizes};
use super::table::{Field, Kind, Names, Rule, TableSpec};
use crate::units::Dimension;

const STAGES: &str = "Stages in which it acts, by name.";
const EVERY: &str = "Time between two acts [s]; rounded to whole rows of the series.";

pub(super) static INLET: TableSpec = TableSpec {
    doc: "A source of particles: where there is room they are put at random places in its region, without overlap.",
    fields: &[
        Field::new("region", Kind::Table(&INLET_ROOM), "Where they are put, within the domain."),
        Field::new("material", Kind::Reference(Names::Material), "Their material.")
            .optional("they come from an outlet"),
        Field::new(
            "radius",
            Kind::Either(&[LENGTH, Kind::Table(&SIZES)]),
            "Radius [m], or a distribution of radii.",
        )
        .optional("they come from an outlet")
        .above(0.0)
        .usual(1e-6, 10.0),
        Field::new("mass_rate", Kind::Number(Dimension::MASS_RATE), "Mass per time [kg/s].")
            .optional("see `rate` and `from`")
            .above(0.0),
        Field::new("rate", Kind::Number(Dimension::FREQUENCY), "Particles per time [1/s].")
            .optional("see `mass_rate` and `from`")
            .above(0.0),
        Field::new(
            "from",
            Kind::Reference(Names::Outlet),
            "The outlet whose particles come back here, as they were but for place and velocity.",
        )
        .optional("new particles come"),
        Field::new("velocity", Kind::Vector(Dimension::VELOCITY), "Velocity with which they come [m/s].")
            .or("[0, 0, 0]"),
        Field::new("mass", Kind::Number(Dimension::MASS), "Mass after which no more come [kg].")
            .optional("no limit")
            .above(0.0),
        Field::new("every", TIME, EVERY).optional("every row").above(0.0),
        Field::new("stages", Kind::References(Names::Stage), STAGES).optional("all"),
    ],
    rules: &[
        Rule::ExactlyOne(&["mass_rate", "rate", "from"]),
        Rule::Needs("mass_rate", &["material", "radius"]),
        Rule::Needs("rate", &["material", "radius"]),
        Rule::Excludes("from", &["material", "radius"]),
    ],
};

pub(super) static OUTLET: TableSpec = TableSpec {
    doc: "A sink: particles whose centre is in its region are taken away and counted.",
    fields: &[
        Field::new("region", Kind::Table(&OUTLET_ROOM), "Where they are taken."),
        Field::new("every", TIME, EVERY).optional("every row").above(0.0),
        Field::new("stages", Kind::References(Names::Stage), STAGES).optional("all"),
    ],
    rules: &[],
};

const ANOTHER: &str = "another shape";

static INLET_ROOM: TableSpec = TableSpec {
    doc: "A part of space.",
    fields: &[
        Field::new("box", Kind::Table(&REGION), "An axis-aligned box.").optional(ANOTHER),
        Field::new("cylinder", Kind::Table(&CYLINDER), "A cylinder.").optional(ANOTHER),
        Field::new("sphere", Kind::Table(&SPHERE), "A sphere.").optional(ANOTHER),
        Field::new(
            "surface",
            Kind::Reference(Names::Surface),
            "A mesh of `geometry`: they come off its faces, on the side of their normals, wherever it stands, also before \
             a stage inserts it.",
        )
        .optional(ANOTHER),
    ],
    rules: &[Rule::ExactlyOne(&["box", "cylinder", "sphere", "surface"])],
};

static OUTLET_ROOM: TableSpec = TableSpec {
    doc: "A part of space.",
    fields: &[
        Field::new("box", Kind::Table(&REGION), "An axis-aligned box.").optional(ANOTHER),
        Field::new("cylinder", Kind::Table(&CYLINDER), "A cylinder.").optional(ANOTHER),
        Field::new("sphere", Kind::Table(&SPHERE), "A sphere.").optional(ANOTHER),
        Field::new("beyond", Kind::Table(&BEYOND), "What is beyond a plane.").optional(ANOTHER),
    ],
    rules: &[Rule::ExactlyOne(&["box", "cylinder", "sphere", "beyond"])],
};

static CYLINDER: TableSpec = TableSpec {
    doc: "A cylinder.",
    fields: &[
        Field::new("from", POINT, "Where its axis begins [m]."),
        Field::new("to", POINT, "Where its axis ends [m]."),
        Field::new("radius", LENGTH, "Its radius [m].").above(0.0),
    ],
    rules: &[],
};

static SPHERE: TableSpec = TableSpec {
    doc: "A sphere.",
    fields: &[
        Field::new("center", POINT, "Its centre [m]."),
        Field::new("radius", LENGTH, "Its radius [m].").above(0.0),
    ],
    rules: &[],
};

/// `[inlet.NAME]`
#[derive(Clone, Debug)]
pub struct InletPart {
    /// Its name.
    pub name: Located<String>,
    /// Where particles are put.
    pub room: Room,
    /// What comes.
    pub supply: SupplyPart,
    /// Velocity of what comes \[m/s\].
    pub velocity: Vec3,
    /// Mass after which no more come \[kg\].
    pub most: Option<f64>,
    /// Time between two acts \[s\]; every row if absent.
    pub every: Option<f64>,
    /// Stages in which it acts.
    pub stages: Option<Vec<usize>>,
}

/// What comes through an inlet.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum SupplyPart {
    /// Mass per time \[kg/s\], material, radii \[m\].
    Mass(f64, String, SizeDistribution),
    /// Particles per time \[1/s\], material, radii \[m\].
    Number(f64, String, SizeDistribution),
    /// What an outlet took, by its index.
    Outlet(usize),
}

impl InletPart {
    /// Its material, if it makes particles.
    pub fn material(&self) -> Option<&str> {
        match &self.supply {
            SupplyPart::Mass(_, material, _) | SupplyPart::Number(_, material, _) => Some(material),
            SupplyPart::Outlet(_) => None,
        }
    }

    /// What the engine takes, with the number of a material and the time between rows \[s\].
    pub(super) fn inlet(&self, material_id: impl Fn(&str) -> usize, row: f64) -> Inlet {
        let grains = |material: &str, sizes: &SizeDistribution| Grains {
            material: material_id(material),
            sizes: sizes.clone(),
        };
        Inlet {
            name: self.name.value.clone(),
            room: self.room,
            supply: match &self.supply {
                SupplyPart::Mass(rate, material, sizes) => Supply::Mass(*rate, grains(material, sizes)),
                SupplyPart::Number(rate, material, sizes) => Supply::Number(*rate, grains(material, sizes)),
                SupplyPart::Outlet(outlet) => Supply::Outlet(*outlet),
            },
            velocity: self.velocity,
            most: self.most,
            every: self.every.unwrap_or(row),
            stages: self.stages.clone(),
        }
    }
}

/// The inlets and outlets of a file.
pub(super) fn doors(file: &Record, row: f64, stages: &[StagePart], checker: &mut Checker) -> Doors {
    let outlets: Vec<Outlet> = file
        .named("outlet")
        .iter()
        .map(|(name, record)| Outlet {
            name: name.value.clone(),
            room: room(record, file, &format!("outlet.{}", name.value), checker),
            every: record.number_if("every").unwrap_or(row),
            stages: stage_numbers(record, stages),
        })
        .collect();
    let names: Vec<&str> = outlets.iter().map(|outlet| outlet.name.as_str()).collect();
    let mut inlets: Vec<InletPart> = Vec::new();
    for (name, record) in file.named("inlet") {
        let supply = supply(record, file, &names, checker);
        let taken = |part: &InletPart| match (&part.supply, &supply) {
            (SupplyPart::Outlet(a), SupplyPart::Outlet(b)) => a == b,
            _ => false,
        };
        let mut wrong = |place: &Place, kind, message: String, help: &str| {
            checker.error(SceneError::new(kind, place, message).label("again").help(help));
        };
        if names.contains(&name.value.as_str()) {
            let message = format!("an inlet and an outlet are called `{}`", name.value);
            wrong(
                &name.place,
                "duplicate",
                message,
                "columns of series.csv have their names: give each its own",
            );
        }
        if inlets.iter().any(taken) {
            let message = "two inlets take what one outlet took".to_owned();
            wrong(
                record.place("from"),
                "duplicate",
                message,
                "each particle comes back once: leave one of them out",
            );
        }
        inlets.push(InletPart {
            name: name.clone(),
            room: room(record, file, &format!("inlet.{}", name.value), checker),
            supply,
            velocity: record.vector("velocity"),
            most: record.number_if("mass"),
            every: record.number_if("every"),
            stages: stage_numbers(record, stages),
        });
    }
    Doors { inlets, outlets }
}

/// Inlets and outlets.
pub(super) struct Doors {
    pub inlets: Vec<InletPart>,
    pub outlets: Vec<Outlet>,
}

fn supply(record: &Record, file: &Record, outlets: &[&str], checker: &mut Checker) -> SupplyPart {
    if let Some(from) = record.located_if("from") {
        let found = outlets.iter().position(|name| *name == from.value);
        return SupplyPart::Outlet(found.unwrap_or_default());
    }
    if let Some(material) = record.located_if("material") {
        needs_density(&material, file, checker);
    }
    let (material, sizes) = (record.text("material"), sizes(record, checker));
    match record.number_if("mass_rate") {
        Some(rate) => SupplyPart::Mass(rate, material, sizes),
        None => SupplyPart::Number(record.number("rate"), material, sizes),
    }
}

fn room(record: &Record, file: &Record, path: &str, checker: &mut Checker) -> Room {
    let region = record.table_or_empty("region");
    if let Some(t) = region.table("cylinder") {
        let (from, to) = (t.vector("from"), t.vector("to"));
        if from == to {
            let message = format!("the axis of the cylinder of `{path}` has no length");
            checker.error(
                SceneError::new("order", t.place("to"), message)
                    .label("the same point")
                    .help("`from` and `to` are the two ends of its axis"),
            );
        }
        Room::Cylinder { from, to, radius: t.number("radius") }
    } else if let Some(t) = region.table("sphere") {
        Room::Sphere { center: t.vector("center"), radius: t.number("radius") }
    } else if let Some(name) = region.located_if("surface") {
        // Surfaces have the numbers of their tables.
        let found = file.named("geometry").iter().position(|(other, _)| other.value == name.value);
        Room::Surface(found.unwrap_or_default())
    } else if let Some(t) = region.table("beyond") {
        Room::Beyond { axis: t.vector("axis"), limit: t.number("limit") }
    } else {
        let (min, max) = match region.table("box") {
            Some(t) => corners(t, &format!("{path}.region.box"), checker),
            None => ([f64::NAN; 3], [f64::NAN; 3]),
        };
        Room::Box { min, max }
    }
}

/// The numbers of the stages in which an inlet or outlet acts; names were checked.
fn stage_numbers(record: &Record, stages: &[StagePart]) -> Option<Vec<usize>> {
    let number = |name: Located<String>| stages.iter().position(|stage| stage.name.value == name.value);
    record.has("stages").then(|| record.names("stages").into_iter().filter_map(number).collect())
}
