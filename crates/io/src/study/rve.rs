//! What a study of periodic samples does with each of them: prepare, consolidate, load.

use crate::scene::check::{Checked, Record};
use crate::scene::error::SceneError;
use crate::scene::table::{Field, Kind, Rule, TableSpec, Words, words};
use crate::units::Dimension;

use super::Reader;

/// Keys of a study whose values say what is done with a sample, and may vary like those of its scene.
pub(super) const PARTS: [&str; 3] = ["prepare", "consolidate", "load"];

const NUMBER: Kind = Kind::Number(Dimension::NONE);
const PRESSURE: Kind = Kind::Number(Dimension::PRESSURE);

const INERTIAL: &str = "Largest inertial number: strain rate · 2 mean radius · √(density / pressure).";

pub(super) static PREPARE: TableSpec = TableSpec {
    doc: "How samples are made of the scene's particles: compressed from all sides with a friction of their own, which \
          sets how dense they get. Without it they are compressed with the friction of their material.",
    fields: &[
        Field::new("pressure", PRESSURE, "Mean stress at which a sample is made [Pa].")
            .or("\"50 Pa\"")
            .above(0.0)
            .usual(1.0, 1e8),
        Field::new(
            "void_ratio",
            NUMBER,
            "Void ratio at this pressure; the friction that leads to it is found by bisection.",
        )
        .optional("see `friction`")
        .above(0.0)
        .usual(0.2, 2.0),
        Field::new("tolerance", NUMBER, "How near the void ratio must come.")
            .or("0.005")
            .above(0.0)
            .at_most(1.0),
        Field::new("between", Kind::Window(Dimension::NONE), "Friction that the bisection begins with.")
            .or("[0, 1]")
            .at_least(0.0),
        Field::new("rounds", Kind::Integer, "Rounds of bisection after which a sample is given up.")
            .or("12")
            .at_least(1.0)
            .at_most(50.0),
        Field::new("friction", NUMBER, "Friction between the particles while the sample is made.")
            .optional("see `void_ratio`")
            .at_least(0.0),
        Field::new(
            "youngs_modulus",
            PRESSURE,
            "Young's modulus of all materials while the sample is made [Pa].",
        )
        .optional("that of the scene")
        .above(0.0),
        Field::new("inertial_number", NUMBER, INERTIAL).or("0.01").above(0.0).at_most(1.0),
    ],
    rules: &[
        Rule::ExactlyOne(&["void_ratio", "friction"]),
        Rule::Excludes("friction", &["tolerance", "between", "rounds"]),
    ],
};

pub(super) static CONSOLIDATE: TableSpec = TableSpec {
    doc: "The isotropic stress that every sample is brought to, with its own material.",
    fields: &[
        Field::new("pressure", PRESSURE, "Mean stress [Pa].").above(0.0).usual(1.0, 1e9),
        Field::new("within", NUMBER, "How near every stress must come, as a share of it.")
            .or("0.01")
            .above(0.0)
            .at_most(0.5),
        Field::new("inertial_number", NUMBER, INERTIAL).or("0.01").above(0.0).at_most(1.0),
    ],
    rules: &[],
};

const PROGRAMS: Words<Program> = words! {
    "drained-triaxial" => Program::DrainedTriaxial, "undrained-triaxial" => Program::UndrainedTriaxial,
    "simple-shear" => Program::SimpleShear, "isotropic-compression" => Program::IsotropicCompression,
    "scene" => Program::Scene,
};

pub(super) static LOAD: TableSpec = TableSpec {
    doc: "How consolidated samples are loaded. Without it they are only looked at.",
    fields: &[
        Field::new(
            "program",
            Kind::Words(PROGRAMS.words),
            "Shortened along z with the stress across held (`drained-triaxial`) or at constant volume \
             (`undrained-triaxial`), sheared in the plane of x and z at constant height stress (`simple-shear`), compressed \
             from all sides in steps (`isotropic-compression`), or taken through the stages of the scene (`scene`).",
        ),
        Field::new(
            "strain",
            NUMBER,
            "Axial strain, or change of the angle in simple shear; the amplitude of cycles.",
        )
        .optional("needed with triaxial programs and simple shear")
        .above(0.0)
        .at_most(2.0),
        Field::new("cycles", Kind::Integer, "Cycles between both signs of the strain; 0 for one way only.")
            .or("0")
            .at_least(0.0)
            .at_most(1000.0),
        Field::new("inertial_number", NUMBER, INERTIAL).or("0.001").above(0.0).at_most(1.0),
        Field::new("pressure", PRESSURE, "Where an isotropic compression ends [Pa].")
            .optional("needed with `isotropic-compression`")
            .above(0.0),
        Field::new("points", Kind::Integer, "Rows of a curve; steps of an isotropic compression.")
            .optional("200, or 8 steps")
            .at_least(2.0)
            .at_most(100_000.0),
    ],
    rules: &[],
};

/// What is done with each sample.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Rve {
    /// How it is made; none if its own friction makes it.
    pub prepare: Option<Prepare>,
    /// The stress that it is brought to.
    pub consolidate: Consolidate,
    /// How it is loaded.
    pub load: Option<Load>,
    /// Samples of each variant, which differ in the seed of the scene.
    pub seeds: u64,
}

/// How samples are made.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepare {
    /// Mean stress \[Pa\].
    pub pressure: f64,
    /// What is gone for.
    pub aim: Aim,
    /// Young's modulus of all materials \[Pa\], if another.
    pub youngs_modulus: Option<f64>,
    /// Largest inertial number \[-\].
    pub inertial_number: f64,
}

/// What a preparation goes for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// A void ratio, by bisection of the friction.
    VoidRatio {
        /// The void ratio \[-\].
        target: f64,
        /// How near it must come \[-\].
        tolerance: f64,
        /// Friction to begin with, ascending \[-\].
        between: [f64; 2],
        /// Rounds of bisection after both ends.
        rounds: u64,
    },
    /// Nothing: the friction is given \[-\].
    Friction(f64),
}

/// The stress that samples are brought to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Consolidate {
    /// Mean stress \[Pa\].
    pub pressure: f64,
    /// How near every stress must come, as a share of it.
    pub within: f64,
    /// Largest inertial number \[-\].
    pub inertial_number: f64,
}

/// How samples are loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// The program.
    pub program: Program,
    /// Axial strain or angle; the amplitude of cycles \[-\]; NaN where none is needed.
    pub strain: f64,
    /// Cycles; 0 for one way only.
    pub cycles: u64,
    /// Largest inertial number \[-\].
    pub inertial_number: f64,
    /// Where an isotropic compression ends \[Pa\]; NaN for other programs.
    pub pressure: f64,
    /// Rows of a curve, or steps of an isotropic compression.
    pub points: u64,
}

/// What is done with a consolidated sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Program {
    /// Shortened along z, the stress across held.
    #[default]
    DrainedTriaxial,
    /// Shortened along z at constant volume.
    UndrainedTriaxial,
    /// Sheared in the plane of x and z, the stress along z held.
    SimpleShear,
    /// Compressed from all sides in steps.
    IsotropicCompression,
    /// The stages of the scene.
    Scene,
}

impl Program {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        let at = PROGRAMS.values.iter().position(|p| *p == self);
        at.and_then(|at| PROGRAMS.words.get(at)).copied().unwrap_or_default()
    }
}

impl Reader<'_> {
    /// What the file says about samples, if it is about samples.
    pub(super) fn rve(&mut self, file: &Record) -> Option<Rve> {
        if !file.written("consolidate") {
            let others = PARTS.iter().chain(&["seeds"]).filter(|part| file.written(part));
            for part in others {
                let message =
                    format!("`{part}` is of a study of periodic samples, which needs `consolidate`");
                self.checker.error(
                    SceneError::new("missing", file.place(part), message)
                        .label("needs [consolidate]")
                        .help("write [consolidate] with a pressure, such as \"100 kPa\""),
                );
            }
            return None;
        }
        let consolidate = file.table_or_empty("consolidate");
        let load = file.table("load").map(|record| self.load(record, consolidate.number("pressure")));
        Some(Rve {
            prepare: file.table("prepare").map(prepare),
            consolidate: Consolidate {
                pressure: consolidate.number("pressure"),
                within: consolidate.number("within"),
                inertial_number: consolidate.number("inertial_number"),
            },
            load,
            seeds: file.integer("seeds"),
        })
    }

    fn load(&mut self, record: &Record, consolidated: f64) -> Load {
        let program = PROGRAMS.value(&record.text("program"));
        let isotropic = program == Program::IsotropicCompression;
        let strained = !isotropic && program != Program::Scene;
        let mut asks = |key: &'static str, wanted: bool| {
            let name = program.name();
            if wanted && !record.written(key) {
                let message = format!("the program `{name}` needs `{key}`");
                self.checker.error(
                    SceneError::new("missing", record.place("program"), message)
                        .label(format!("needs `{key}`"))
                        .help(LOAD.field(key).map_or("", |field| field.doc)),
                );
            } else if !wanted && record.written(key) {
                let message = format!("`load.{key}` means nothing together with the program `{name}`");
                self.checker.error(
                    SceneError::new("conflict", record.place(key), message)
                        .label("has no effect")
                        .help("take it away, or choose another program"),
                );
            }
        };
        // What an unknown program needs nobody knows.
        if record.has("program") {
            asks("strain", strained);
            asks("pressure", isotropic);
            if !strained && record.written("cycles") {
                asks("cycles", false);
            }
        }
        let pressure = record.number("pressure");
        if isotropic && pressure == consolidated {
            let message = format!("the compression ends at {pressure} Pa, where it begins");
            self.checker.error(
                SceneError::new("range", record.place("pressure"), message)
                    .label("as consolidated")
                    .help("write another pressure; one below that of `consolidate` swells the sample"),
            );
        }
        let points = if isotropic { 8 } else { 200 };
        Load {
            program,
            strain: record.number("strain"),
            cycles: record.integer("cycles"),
            inertial_number: record.number("inertial_number"),
            pressure,
            points: if record.has("points") { record.integer("points") } else { points },
        }
    }
}

fn prepare(record: &Record) -> Prepare {
    let between = match record.get("between") {
        Some(Checked::Window(window)) => *window,
        _ => [f64::NAN; 2],
    };
    let aim = match record.number_if("friction") {
        Some(friction) => Aim::Friction(friction),
        None => Aim::VoidRatio {
            target: record.number("void_ratio"),
            tolerance: record.number("tolerance"),
            between,
            rounds: record.integer("rounds"),
        },
    };
    Prepare {
        pressure: record.number("pressure"),
        aim,
        youngs_modulus: record.number_if("youngs_modulus"),
        inertial_number: record.number("inertial_number"),
    }
}
