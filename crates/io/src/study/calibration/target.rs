//! What a calibration is to meet: numbers of measures, and curves.

use std::path::Path;

use super::{Experiment, Reader};
use crate::output::columns::{CURVE, Column, SAMPLE_NUMBERS, in_curve, in_series};
use crate::scene::check::Record;
use crate::scene::document::{Node, Value as Written};
use crate::scene::error::{Place, SceneError};
use crate::scene::spelling::advice;
use crate::scene::table::{Field, Kind};
use crate::study::measured::{self, Headings};
use crate::units::Dimension;

/// What is to be met.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Its name.
    pub name: String,
    /// Number of the experiment.
    pub experiment: usize,
    /// What of the experiment.
    pub quantity: Quantity,
    /// What it should come to, in SI units: one number, or one for each point of a curve.
    pub values: Vec<f64>,
    /// How far each may be off: the standard deviation of what was measured, in SI units; above 0.
    pub scatters: Vec<f64>,
    /// How much it counts; above 0. The points of a curve share it.
    pub weight: f64,
    /// The SI unit of the values.
    pub unit: &'static str,
}

/// What of an experiment.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Quantity {
    /// A number of a measure of a scene.
    Measure {
        /// The stage that measures it.
        stage: String,
        /// The measure.
        measure: String,
        /// What of it.
        statistic: Statistic,
    },
    /// A number of periodic samples, one of [`SAMPLE_NUMBERS`]: its mean over the seeds.
    Number(&'static str),
    /// A curve.
    Curve {
        /// The stage; none of periodic samples.
        stage: Option<String>,
        /// Column of the abscissa.
        x: String,
        /// Column of the ordinate.
        y: String,
        /// Abscissae that were measured, ascending, in SI units.
        at: Vec<f64>,
        /// The SI unit of the abscissae.
        x_unit: &'static str,
    },
}

/// A number of a measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Statistic {
    /// The mean.
    #[default]
    Mean,
    /// The standard deviation.
    Std,
}

impl Target {
    /// Whether it is a curve.
    pub fn is_curve(&self) -> bool {
        matches!(self.quantity, Quantity::Curve { .. })
    }
}

impl Reader<'_> {
    pub(super) fn target(
        &mut self,
        name: &str,
        record: &Record,
        experiments: &[Experiment],
        folder: &Path,
    ) -> Option<Target> {
        let experiment = self.experiment(name, record, experiments)?;
        let sampled = experiments.get(experiment)?.samples.is_some();
        let weight = record.number("weight");
        if record.written("file") {
            return self.curve(name, record, experiment, sampled, folder);
        }
        let (quantity, dimension) =
            if sampled { self.sample_number(record)? } else { self.measure(record, experiment)? };
        let any = Field::new("", Kind::Number(dimension), "");
        let value = self.quantity(name, record, "value", dimension, &any);
        let scatter = self.quantity(name, record, "scatter", dimension, &above_zero(dimension));
        Some(Target {
            name: name.to_owned(),
            experiment,
            quantity,
            values: vec![value?],
            scatters: vec![scatter?],
            weight,
            unit: dimension.si,
        })
    }

    /// A number with its unit, which must be there.
    fn quantity(
        &mut self,
        name: &str,
        record: &Record,
        key: &str,
        dimension: Dimension,
        field: &Field,
    ) -> Option<f64> {
        if !record.written(key) {
            let message = format!("`target.{name}` needs `{key}`");
            self.checker.error(
                SceneError::new("missing", &record.place, message)
                    .label(format!("`{key}` is missing"))
                    .help(format!("it is {}", dimension.expected())),
            );
        }
        self.checker.number(record.node(key)?, dimension, field, &format!("target.{name}.{key}"))
    }

    /// A measure of a scene.
    fn measure(&mut self, record: &Record, experiment: usize) -> Option<(Quantity, Dimension)> {
        let wanted = record.located_if("measure")?;
        let scene = self.models.get(experiment)?.scene.as_ref()?;
        let all = measures(scene);
        let found = all.iter().find(|m| m.full_name() == wanted.value);
        let Some(Measured { stage, name, of }) = found else {
            let all: Vec<String> = all.iter().map(Measured::full_name).collect();
            let all: Vec<&str> = all.iter().map(String::as_str).collect();
            let message = format!("the scene measures no `{}`", wanted.value);
            let help = advice(&wanted.value, &all, "no stage of it measures anything");
            self.checker.error(
                SceneError::new("undefined", &wanted.place, message).label("STAGE.MEASURE").help(help),
            );
            return None;
        };
        let statistic = if record.text("statistic") == "std" { Statistic::Std } else { Statistic::Mean };
        let dimension = match of.rsplit_once('.').map_or(of.as_str(), |(_, part)| part) {
            "tx" | "ty" | "tz" => Dimension::TORQUE,
            "angle-of-repose" => Dimension::ANGLE,
            "bulk-density" => Dimension::DENSITY,
            _ => Dimension::FORCE,
        };
        if statistic == Statistic::Std && !of.contains('.') {
            let message = format!("`{}` is one number, which has no standard deviation", wanted.value);
            self.checker.error(
                SceneError::new("conflict", record.place("statistic"), message)
                    .label("has no effect")
                    .help("take it away"),
            );
        }
        let quantity = Quantity::Measure { stage: stage.clone(), measure: name.clone(), statistic };
        Some((quantity, dimension))
    }

    /// A number of periodic samples.
    fn sample_number(&mut self, record: &Record) -> Option<(Quantity, Dimension)> {
        let wanted = record.located_if("measure")?;
        if record.written("statistic") {
            let message =
                "`statistic` means nothing of periodic samples, whose numbers are means over their seeds";
            self.checker.error(
                SceneError::new("conflict", record.place("statistic"), message.to_owned())
                    .label("has no effect")
                    .help("take it away"),
            );
        }
        let found = SAMPLE_NUMBERS.iter().find(|(name, _)| *name == wanted.value);
        if found.is_none() {
            let message = format!("periodic samples have no number `{}`", wanted.value);
            self.unknown(&wanted.value, &wanted.place, message, &SAMPLE_NUMBERS);
        }
        found.map(|(name, dimension)| (Quantity::Number(name), *dimension))
    }

    fn unknown(&mut self, wanted: &str, place: &Place, message: String, known: &[Column]) {
        let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
        self.checker.error(
            SceneError::new("undefined", place, message).label("not there").help(advice(wanted, &names, "")),
        );
    }

    /// A curve that was measured.
    fn curve(
        &mut self,
        name: &str,
        record: &Record,
        experiment: usize,
        sampled: bool,
        folder: &Path,
    ) -> Option<Target> {
        for key in ["x", "y"] {
            if !record.written(key) {
                let message = format!("`target.{name}` needs `{key}`");
                self.checker.error(
                    SceneError::new("missing", &record.place, message)
                        .label(format!("`{key}` is missing"))
                        .help("name the column of the simulated curve, such as x = \"strain\", y = \"q\""),
                );
            }
        }
        if !record.written("scatter") && !record.written("scatter_column") {
            let message = format!("`target.{name}` needs `scatter` or `scatter_column`");
            self.checker.error(
                SceneError::new("missing", &record.place, message)
                    .label("how far may it be off?")
                    .help("costs are in scatters: write the standard deviation of what was measured"),
            );
        }
        let (x, y) = (self.simulated(record, "x", sampled)?, self.simulated(record, "y", sampled)?);
        let stage = if sampled { None } else { Some(self.stage(name, record, experiment)?) };
        if sampled && record.written("stage") {
            let message = format!("`target.{name}.stage` means nothing of periodic samples");
            self.checker.error(
                SceneError::new("conflict", record.place("stage"), message)
                    .label("has no effect")
                    .help("their curves are those of the loading"),
            );
        }
        let file = record.located_if("file")?;
        let heading = |key: &str, of: &str| record.located_if(key).map_or(of.to_owned(), |h| h.value);
        let (in_x, in_y) = (heading("x_column", &x.0), heading("y_column", &y.0));
        let in_scatter = record.located_if("scatter_column").map(|h| h.value);
        let headings = Headings { x: (&in_x, x.1), y: (&in_y, y.1), scatter: in_scatter.as_deref() };
        let scatter = record
            .written("scatter")
            .then(|| self.quantity(name, record, "scatter", y.1, &above_zero(y.1)))
            .flatten();
        let curve = match measured::read(&folder.join(&file.value), headings) {
            Ok(curve) => curve,
            Err(error) => {
                self.checker.error(
                    SceneError::new("unreadable", &file.place, error.to_string()).label("this curve").help(
                        "`x_column`, `y_column` and `scatter_column` name its headings where they are not those of `x` and \
                         `y`",
                    ),
                );
                return None;
            }
        };
        let scatters = match (scatter, curve.scatter.is_empty()) {
            (Some(scatter), _) => vec![scatter; curve.y.len()],
            (None, false) => curve.scatter,
            (None, true) => return None,
        };
        Some(Target {
            name: name.to_owned(),
            experiment,
            quantity: Quantity::Curve { stage, x: x.0, y: y.0, at: curve.x, x_unit: x.1.si },
            values: curve.y,
            scatters,
            weight: record.number("weight"),
            unit: y.1.si,
        })
    }

    /// A column of simulated curves, and what it holds.
    fn simulated(&mut self, record: &Record, key: &str, sampled: bool) -> Option<(String, Dimension)> {
        let wanted = record.located_if(key)?;
        let name = wanted.value;
        let found = if sampled { in_curve(&name) } else { in_series(&name) };
        match found {
            Some(dimension) => return Some((name, dimension)),
            None if sampled => {
                let message = format!("curves of periodic samples have no column `{name}`");
                self.unknown(&name, &wanted.place, message, &CURVE);
            }
            None => {
                let message = format!("the series of a scene has no column `{name}`");
                self.checker.error(
                    SceneError::new("undefined", &wanted.place, message).label("not there").help(
                        "write \"time\", or a surface with one of fx, fy, fz, tx, ty, tz, draught, path, x, y, z, such as \
                         \"sweep.draught\"; the first line of series.csv has them all",
                    ),
                );
            }
        }
        None
    }

    /// The stage that a curve is of.
    fn stage(&mut self, name: &str, record: &Record, experiment: usize) -> Option<String> {
        let scene = self.models.get(experiment)?.scene.as_ref()?;
        let names: Vec<String> = stages(scene).map(|stage| text(stage.get("name"))).collect();
        let all: Vec<&str> = names.iter().map(String::as_str).collect();
        let (message, place, wanted) = match (record.located_if("stage"), &all[..]) {
            (None, [only]) => return Some((*only).to_owned()),
            (None, _) => {
                let message = format!("`target.{name}` needs `stage`: the scene has {}", all.len());
                (message, record.place.clone(), String::new())
            }
            (Some(wanted), _) if all.contains(&wanted.value.as_str()) => return Some(wanted.value),
            (Some(wanted), _) => {
                (format!("the scene has no stage `{}`", wanted.value), wanted.place, wanted.value)
            }
        };
        self.checker.error(
            SceneError::new("undefined", &place, message).label("of which stage?").help(advice(
                &wanted,
                &all,
                "the scene has none",
            )),
        );
        None
    }
}

fn above_zero(dimension: Dimension) -> Field {
    Field::new("", Kind::Number(dimension), "").above(0.0)
}

/// A measure or survey as it is written in a scene.
struct Measured {
    stage: String,
    name: String,
    of: String,
}

impl Measured {
    fn full_name(&self) -> String {
        format!("{}.{}", self.stage, self.name)
    }
}

fn stages(scene: &Node) -> impl Iterator<Item = &Node> {
    let stages = match scene.get("stage").map(|n| &n.value) {
        Some(Written::Array(stages)) => stages.as_slice(),
        _ => &[],
    };
    stages.iter()
}

fn text(node: Option<&Node>) -> String {
    match node.map(|n| &n.value) {
        Some(Written::Text(text)) => text.clone(),
        _ => String::new(),
    }
}

fn measures(scene: &Node) -> Vec<Measured> {
    let of_stage = |stage: &Node| {
        let name = text(stage.get("name"));
        let entries = ["measure", "survey"].map(|key| stage.get(key).map(Node::entries).unwrap_or_default());
        let measure = move |entry: &crate::scene::document::Entry| Measured {
            stage: name.clone(),
            name: entry.key.value.clone(),
            of: text(entry.node.get("of")),
        };
        entries.into_iter().flatten().map(measure).collect::<Vec<_>>()
    };
    stages(scene).flat_map(of_stage).collect()
}
