//! Calibration files: which values of a scene are free, and what its measures should come to. TOML in, a checked
//! [`Calibration`] or every mistake at once.
//!
//! ```toml
//! scene = "scene.toml"
//!
//! [free.density]
//! path = "material.soil.density"
//! bounds = [500, 2500]
//!
//! [free.stiffness]
//! path = "material.soil.youngs_modulus"
//! bounds = ["50 kPa", "10 MPa"]
//! scale = "logarithmic"
//!
//! [target.draught]
//! measure = "till.draught_force"
//! value = "309.5 N"
//! scatter = "14.5 N"
//!
//! [target.push]                     # a curve: CSV with the headings "displacement [mm]" and "force [kN]"
//! file = "push.csv"
//! stage = "till"
//! x = "sweep.path"
//! x_column = "displacement"
//! y = "sweep.draught"
//! y_column = "force"
//! scatter = "10 N"
//! ```

mod fields;
mod target;

use std::path::{Path, PathBuf};

use super::{Follower, Study, follower, number_in, read_scene, target};
use crate::input;
use crate::scene::check::{Checker, Known, Record, quoted};
use crate::scene::document::{self, Node, Value as Written};
use crate::scene::error::{Place, SceneError, Source};
use crate::scene::schema::schema_of;
use crate::scene::set;
use crate::scene::spelling::advice;
use crate::scene::table::{Field, Kind};
use crate::scene::{Located, MOST_BYTES, first};
use crate::units::Dimension;
use fields::CALIBRATION;
pub use target::{Quantity, Statistic, Target};

/// Columns of results that are not parameters or targets; nothing free may be called like one.
pub const CALIBRATION_COLUMNS: [&str; 6] = ["evaluation", "round", "cost", "status", "reason", "state_hash"];

/// A calibration file that passed every check that does not need its worlds.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Calibration {
    /// Name for output and messages.
    pub title: String,
    /// Seed of the search.
    pub seed: u64,
    /// The scenes that share the parameters; at least one.
    pub experiments: Vec<Experiment>,
    /// The free parameters, in the order of the file.
    pub free: Vec<Free>,
    /// What follows them, in the order of the file.
    pub followers: Vec<Follower>,
    /// What is to be met, in the order of the file.
    pub targets: Vec<Target>,
    /// How it is searched.
    pub method: Method,
    /// What may stand for simulations, if anything.
    pub surrogate: Option<Surrogate>,
    /// When the search ends.
    pub stop: Stop,
    /// The cost up to which an evaluation counts as good.
    pub good: f64,
    /// The share of their ranges by which parameters are changed to find how the targets depend on them; 0 if not.
    pub probe: f64,
    /// The file itself.
    pub text: String,
    name: String,
}

/// A scene, or a study of periodic samples, that is run for every set of parameters.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Its name; empty if there is only one.
    pub name: String,
    /// The scene file: the calibration's folder, or that of the study, with the path as written.
    pub scene: PathBuf,
    /// What stands in it.
    pub scene_text: String,
    /// The study and its file, if the scene is one of periodic samples.
    pub samples: Option<(PathBuf, Study)>,
    /// By which arguments of `--set` it is changed.
    pub sets: Vec<String>,
}

/// A free parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Free {
    /// Its name.
    pub name: String,
    /// The value of the scenes, as for `--set`.
    pub path: String,
    /// Its SI unit; empty if it has none.
    pub unit: &'static str,
    /// The least and the largest, in SI units.
    pub bounds: [f64; 2],
    /// Whether equal steps are equal ratios; the bounds are then above 0.
    pub logarithmic: bool,
    /// Whether it is rounded to a whole number.
    pub whole: bool,
}

/// How parameters are searched.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Differential evolution: population, F, CR, and whether agents adapt F and CR.
    DifferentialEvolution {
        /// Agents.
        population: usize,
        /// F.
        weight: f64,
        /// CR.
        crossover: f64,
        /// Whether each agent adapts F and CR.
        adaptive: bool,
    },
    /// CMA-ES.
    CmaEs {
        /// Points of a round, if other than usual.
        population: Option<usize>,
    },
    /// The iterative Bayesian filter.
    BayesianFilter {
        /// Samples of a round.
        samples: usize,
        /// The share of them that the effective sample size is to be.
        effective: f64,
    },
}

impl Method {
    /// Its name in files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::DifferentialEvolution { .. } => "differential-evolution",
            Self::CmaEs { .. } => "cma-es",
            Self::BayesianFilter { .. } => "bayesian-filter",
        }
    }
}

/// A Gaussian process that stands for simulations where it is sure enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surrogate {
    /// So many evaluations are simulated before it is asked; at least two.
    pub after: usize,
    /// A set of parameters is simulated if the standard deviation of its cost is predicted to be more than this share of the
    /// cost, or more than this number of scatters where that is less than one; above 0.
    pub spread: f64,
}

/// When a search ends: as soon as one of these holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// So many rounds are done, the first included.
    pub rounds: usize,
    /// Another round, after the first, would simulate more evaluations than this.
    pub evaluations: Option<usize>,
    /// A cost is not above this.
    pub cost: Option<f64>,
    /// So many rounds brought no lower cost.
    pub stagnation: Option<usize>,
}

impl Calibration {
    /// Reads the calibration file `path`; see [`Calibration::parse`].
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the file.
    pub fn load(path: &Path, sets: &[String]) -> Result<Self, Vec<SceneError>> {
        let help = "give the path of a calibration; `glebe new NAME --template calibration` makes one";
        let text =
            input::read_text(path, MOST_BYTES).map_err(|e| vec![SceneError::unreadable(path, &e, help)])?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(&path.display().to_string(), &text, folder, sets)
    }

    /// Reads the calibration `text`, for which `name` stands in messages, and the scenes that it names, relative to
    /// `folder`. Each of `sets` is `path=value` and replaces or adds a value of the calibration before anything is
    /// checked, as for scenes ([`crate::scene::Scene::parse`]).
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the file; none of them is a warning.
    pub fn parse(name: &str, text: &str, folder: &Path, sets: &[String]) -> Result<Self, Vec<SceneError>> {
        let source = Source::new(name, text);
        let mut root = document::parse(&source).map_err(first)?;
        let found = set::apply(&mut root, &CALIBRATION, sets);
        let known = Known::default();
        let mut reader = Reader { checker: Checker { known: &known, found }, models: Vec::new() };
        let file = reader.checker.table(&root, &CALIBRATION, "");
        let experiments = reader.experiments(&file, folder)?;
        let mut calibration = reader.calibration(&file, experiments, folder);
        let (_, mut errors): (Vec<_>, Vec<_>) =
            reader.checker.found.into_iter().partition(SceneError::is_warning);
        if errors.is_empty() {
            text.clone_into(&mut calibration.text);
            name.clone_into(&mut calibration.name);
            return Ok(calibration);
        }
        errors.sort_by_key(|e| {
            if e.place().source().name() == name { e.place().span().start } else { usize::MAX }
        });
        Err(first(errors))
    }

    /// What is wrong with a target, as is seen when its scene is made; it points at the name of the target.
    pub fn wrong(&self, target: &str, what: String) -> SceneError {
        let source = Source::new(&self.name, &self.text);
        let place = document::parse(&source).ok().and_then(|root| {
            let targets = root.get("target")?.entries();
            targets.iter().find(|entry| entry.key.value == target).map(|entry| entry.key.place.clone())
        });
        let place = place.unwrap_or_else(|| Place::new(&source, 0..0));
        SceneError::new("undefined", &place, what).label("this target")
    }

    /// Whether a file can be read and is meant to be a calibration.
    pub fn is_at(path: &Path) -> bool {
        input::read_text(path, MOST_BYTES).is_ok_and(|text| Self::is_meant(&text))
    }

    /// Whether a text is meant to be a calibration: it says what is free, or has targets.
    pub fn is_meant(text: &str) -> bool {
        let parsed = document::parse(&Source::new("", text));
        parsed.is_ok_and(|root| root.get("free").is_some() || root.get("target").is_some())
    }
}

/// The JSON Schema of calibration files, for editors.
pub fn calibration_schema() -> serde_json::Value {
    schema_of(&CALIBRATION, "glebe calibration")
}

struct Reader<'a> {
    checker: Checker<'a>,
    /// What the experiments run.
    models: Vec<Model>,
}

/// What an experiment runs, as it is written.
#[derive(Default)]
struct Model {
    /// The scene, if it could be read.
    scene: Option<Node>,
    /// The study of periodic samples, if it is one.
    study: Option<Node>,
}

impl Reader<'_> {
    fn experiments(&mut self, file: &Record, folder: &Path) -> Result<Vec<Experiment>, Vec<SceneError>> {
        let nothing = [];
        let named = if file.has("experiment") { file.named("experiment") } else { &nothing };
        let mut all = Vec::new();
        if named.is_empty() {
            if !names_model(file) {
                let message = "the calibration needs `scene`".to_owned();
                self.checker.error(
                    SceneError::new("missing", &file.place, message).label("`scene` is missing").help(
                        "write scene = \"…\", or study = \"…\" for periodic samples, or [experiment.NAME] with one of them \
                         for each of several",
                    ),
                );
            }
            all.extend(self.model(file, "", Vec::new(), folder)?);
        }
        for (name, record) in named {
            let sets = self.sets(record, &name.value);
            if !names_model(record) && !names_model(file) {
                let message = format!("`experiment.{}` needs `scene`", name.value);
                self.checker.error(
                    SceneError::new("missing", &name.place, message).label("of which scene?").help(
                        "write its scene = \"…\" or study = \"…\" here, or one for all above the tables",
                    ),
                );
            }
            let from = if names_model(record) { record } else { file };
            all.extend(self.model(from, &name.value, sets, folder)?);
        }
        Ok(all)
    }

    /// The experiment of the scene or study that a table names.
    fn model(
        &mut self,
        record: &Record,
        name: &str,
        sets: Vec<String>,
        folder: &Path,
    ) -> Result<Option<Experiment>, Vec<SceneError>> {
        let mut model = Model::default();
        let mut experiment = Experiment {
            name: name.to_owned(),
            scene: PathBuf::new(),
            scene_text: String::new(),
            samples: None,
            sets,
        };
        let located = |key: &str| {
            record.located_if(key).map(|l| Located { value: folder.join(&l.value), place: l.place })
        };
        if let Some(path) = located("study") {
            if let Some((root, text)) = read_scene(&mut self.checker, &path)? {
                let title = path.value.display().to_string();
                let study = Study::parse(&title, &text, path.value.parent().unwrap_or(Path::new("")), &[])?;
                if !study.parameters.is_empty() || study.rve.is_none() {
                    let message = match study.rve {
                        None => format!("`{title}` is no study of periodic samples: it lacks [consolidate]"),
                        Some(_) => format!("something varies in `{title}` already"),
                    };
                    self.checker.error(SceneError::new("conflict", &path.place, message).label("this study").help(
                        "a calibration takes a study of periodic samples (`glebe rve`) without [vary]; write scene = \"…\" for \
                         a scene",
                    ));
                }
                let source = Source::new(&study.scene.display().to_string(), &study.scene_text);
                model.scene = Some(document::parse(&source).map_err(first)?);
                model.study = Some(root);
                (experiment.scene, experiment.scene_text) = (study.scene.clone(), study.scene_text.clone());
                experiment.samples = Some((path.value, study));
            }
        } else if let Some(path) = located("scene") {
            if let Some((root, text)) = read_scene(&mut self.checker, &path)? {
                model.scene = Some(root);
                experiment.scene_text = text;
            }
            experiment.scene = path.value;
        } else {
            return Ok(None);
        }
        self.models.push(model);
        Ok(Some(experiment))
    }

    /// A list of arguments of `--set`.
    fn sets(&mut self, record: &Record, name: &str) -> Vec<String> {
        let Some(node) = record.node("set") else { return Vec::new() };
        let items = if let Written::Array(items) = &node.value { items.as_slice() } else { &[] };
        let texts: Option<Vec<String>> = items
            .iter()
            .map(|item| if let Written::Text(text) = &item.value { Some(text.clone()) } else { None })
            .collect();
        if let (Written::Array(_), Some(texts)) = (&node.value, texts) {
            return texts;
        }
        let message = format!("`experiment.{name}.set` is {}", node.kind());
        self.checker.error(
            SceneError::new("wrong-kind", &node.place, message)
                .label("not a list of texts")
                .help("write set = [\"stage.till.move.sweep.velocity=[1, 0, 0]\"], as for --set"),
        );
        Vec::new()
    }

    fn calibration(&mut self, file: &Record, experiments: Vec<Experiment>, folder: &Path) -> Calibration {
        let free: Vec<Free> = file.named("free").iter().filter_map(|(n, r)| self.free(&n.value, r)).collect();
        let some = |key: &str, message: &str, help: &str| {
            (file.has(key) && file.named(key).is_empty()).then(|| {
                SceneError::new("missing", file.place(key), message.to_owned()).label("empty").help(help)
            })
        };
        let empty = [
            some(
                "free",
                "nothing is free in this calibration",
                "write [free.NAME] with a path and its bounds",
            ),
            some(
                "target",
                "this calibration has no target",
                "write [target.NAME] with a measure and its value, or with the file of a curve",
            ),
        ];
        empty.into_iter().flatten().for_each(|error| self.checker.error(error));
        let names: Vec<(&str, bool)> =
            file.named("free").iter().map(|(name, _)| (name.value.as_str(), true)).collect();
        let first = self.models.first();
        let (scene, own) = (first.and_then(|m| m.scene.as_ref()), first.and_then(|m| m.study.as_ref()));
        let followers = file
            .named("follow")
            .iter()
            .filter_map(|(n, r)| follower(&mut self.checker, scene, own, &n.value, r, &names))
            .collect();
        let targets = file
            .named("target")
            .iter()
            .filter_map(|(n, r)| self.target(&n.value, r, &experiments, folder))
            .collect();
        self.names_differ(file);
        let method = method(file);
        let stop = self.stop(file, &method);
        let surrogate = file.table("surrogate").map(|table| surrogate(table, free.len()));
        Calibration {
            title: file.text("title"),
            seed: file.integer("seed"),
            experiments,
            free,
            followers,
            targets,
            method,
            surrogate,
            stop,
            good: file.number("good"),
            probe: file.number("probe"),
            text: String::new(),
            name: String::new(),
        }
    }

    fn free(&mut self, name: &str, record: &Record) -> Option<Free> {
        // It must lead somewhere in each scene; one message is enough.
        let mut found = None;
        for Model { scene, study } in &self.models {
            let Some(scene) = scene else { continue };
            found = Some(target(&mut self.checker, scene, study.as_ref(), record)?);
        }
        let (path, kind) = found?;
        let whole = matches!(kind, Kind::Integer);
        let Some(dimension) = number_in(&kind).or(whole.then_some(Dimension::NONE)) else {
            let message = format!("`free.{name}` is free between bounds, and `{path}` is no number");
            self.checker.error(
                SceneError::new("wrong-kind", record.place("path"), message)
                    .label("no number")
                    .help(format!("there it is {}; `glebe sweep` tries values one by one", kind.expected())),
            );
            return None;
        };
        let key = format!("free.{name}.bounds");
        let node = record.node("bounds")?;
        let ends = match &node.value {
            Written::Array(items) if items.len() == 2 => [&items[0], &items[1]],
            _ => {
                self.checker.wrong_kind(node, &Kind::Window(dimension), &key);
                return None;
            }
        };
        let any = Field::new("", Kind::Number(dimension), "");
        let ends = ends.map(|end| self.checker.number(end, dimension, &any, &key));
        let [Some(low), Some(high)] = ends else { return None };
        let logarithmic = record.text("scale") == "logarithmic";
        let wrong = if low >= high {
            let message = format!("`{key}` goes from {low} to {high}; the second must be larger");
            Some(("order", message, "not ascending", "write [least, largest]"))
        } else if logarithmic && low <= 0.0 {
            let message = format!("`{key}` begins at {low}, and equal ratios need numbers above 0");
            Some(("range", message, "not above 0", "or take scale = \"linear\""))
        } else {
            None
        };
        if let Some((code, message, label, help)) = wrong {
            self.checker.error(SceneError::new(code, &node.place, message).label(label).help(help));
            return None;
        }
        let unit = number_in(&kind).map_or("", |d| d.si);
        Some(Free { name: name.to_owned(), path, unit, bounds: [low, high], logarithmic, whole })
    }

    fn experiment(&mut self, name: &str, record: &Record, experiments: &[Experiment]) -> Option<usize> {
        let names: Vec<&str> = experiments.iter().map(|e| e.name.as_str()).collect();
        match record.located_if("experiment") {
            None if experiments.len() <= 1 => Some(0),
            None => {
                let message = format!("`target.{name}` needs `experiment`: there are {}", names.len());
                self.checker.error(
                    SceneError::new("missing", &record.place, message)
                        .label("of which?")
                        .help(format!("write experiment = …, one of {}", quoted(&names))),
                );
                None
            }
            Some(wanted) => {
                let at = names.iter().position(|n| *n == wanted.value && !n.is_empty());
                if at.is_none() {
                    let known: Vec<&str> = names.into_iter().filter(|n| !n.is_empty()).collect();
                    let message = format!("no experiment is called `{}`", wanted.value);
                    self.checker.error(
                        SceneError::new("undefined", &wanted.place, message).label("not there").help(advice(
                            &wanted.value,
                            &known,
                            "there is only one, without a name",
                        )),
                    );
                }
                at
            }
        }
    }

    fn names_differ(&mut self, file: &Record) {
        let mut taken: Vec<&str> = CALIBRATION_COLUMNS.to_vec();
        let tables = ["free", "follow", "target"];
        for (name, _) in tables.iter().flat_map(|table| file.named(table)) {
            if taken.contains(&name.value.as_str()) || name.value.contains('.') {
                let message = format!("`{}` cannot be the name of a parameter or target", name.value);
                self.checker.error(SceneError::new("duplicate", &name.place, message).label("taken").help(
                    format!(
                        "names head columns of results: each once, without dots, and none of {}",
                        quoted(&CALIBRATION_COLUMNS)
                    ),
                ));
            }
            taken.push(&name.value);
        }
        let mut paths: Vec<Located<String>> = Vec::new();
        for (name, record) in file.named("free").iter().chain(file.named("follow")) {
            let Some(path) = record.located_if("path") else { continue };
            if paths.contains(&path) {
                let message = format!("`{}` sets `{}`, which another sets already", name.value, path.value);
                self.checker.error(SceneError::new("duplicate", &path.place, message).label("again"));
            }
            paths.push(path);
        }
    }

    fn stop(&mut self, file: &Record, method: &Method) -> Stop {
        let stop = file.table_or_empty("stop");
        let count =
            |key: &str| stop.has(key).then(|| usize::try_from(stop.integer(key)).unwrap_or(usize::MAX));
        let filters = matches!(method, Method::BayesianFilter { .. });
        for key in ["cost", "stagnation"] {
            if filters && stop.has(key) {
                let message = format!("`stop.{key}` means nothing together with `bayesian-filter`");
                self.checker.error(
                    SceneError::new("conflict", stop.place(key), message)
                        .label("has no effect")
                        .help("it looks for a distribution, not for the least cost: take `rounds`"),
                );
            }
        }
        let rounds = match method {
            Method::DifferentialEvolution { .. } => 45,
            Method::CmaEs { .. } => 100,
            Method::BayesianFilter { .. } => 5,
        };
        Stop {
            rounds: count("rounds").unwrap_or(rounds),
            evaluations: count("evaluations"),
            cost: stop.number_if("cost"),
            stagnation: count("stagnation"),
        }
    }
}

fn method(file: &Record) -> Method {
    let table = file.table_or_empty("method");
    let whole = |record: &Record, key: &str| usize::try_from(record.integer(key)).unwrap_or(usize::MAX);
    if let Some(cma) = table.table("cma-es") {
        return Method::CmaEs { population: cma.has("population").then(|| whole(cma, "population")) };
    }
    if let Some(filter) = table.table("bayesian-filter") {
        return Method::BayesianFilter {
            samples: whole(filter, "samples"),
            effective: filter.number("effective"),
        };
    }
    let evolution = table.table_or_empty("differential-evolution");
    Method::DifferentialEvolution {
        population: whole(&evolution, "population"),
        weight: evolution.number("weight"),
        crossover: evolution.number("crossover"),
        adaptive: evolution.flag("adaptive"),
    }
}

/// Ten points for each parameter teach it before it is asked (Loeppky, Sacks and Welch 2009, "Choosing the sample size of a
/// computer experiment: a practical guide").
fn surrogate(table: &Record, free: usize) -> Surrogate {
    let after = table.has("after").then(|| usize::try_from(table.integer("after")).unwrap_or(usize::MAX));
    Surrogate { after: after.unwrap_or(10 * free), spread: table.number("spread") }
}

/// Whether a table names what is run.
fn names_model(record: &Record) -> bool {
    record.written("scene") || record.written("study")
}
