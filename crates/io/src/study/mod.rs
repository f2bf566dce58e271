//! Study files: a scene and what varies in it. TOML in, a checked [`Study`] or every mistake at once.
//!
//! ```toml
//! scene = "scene.toml"
//! sampler = "grid"                  # grid | list | latin-hypercube | sobol
//!
//! [vary.density]
//! path = "material.soil.density"
//! range = [1400, 2000]
//! count = 4
//!
//! [vary.speed]
//! path = "stage.till.move.sweep.velocity.0"
//! values = ["0.5 m/s", "1 m/s"]
//! ```

mod calibration;
mod fields;
pub mod measured;
mod rve;

use std::fmt;
use std::path::{Path, PathBuf};

use crate::input;
use crate::scene::check::{Checker, Known, Record, quoted};
use crate::scene::document::{self, Node, Value as Written};
use crate::scene::error::{Place, SceneError, Source};
use crate::scene::fields::SCENE;
use crate::scene::schema::schema_of;
use crate::scene::set;
use crate::scene::spelling::advice;
use crate::scene::table::{Field, Kind};
use crate::scene::{Located, MOST_BYTES, first};
use crate::units::Dimension;
pub use calibration::{
    CALIBRATION_COLUMNS, Calibration, Experiment, Free, Method, Quantity, Statistic, Stop, Surrogate, Target,
    calibration_schema,
};
use fields::{SAMPLERS, STUDY};
pub use rve::{Aim, Consolidate, Load, Prepare, Program, Rve};

/// More worlds than this are taken for a slip \[-\].
pub const MOST_WORLDS: usize = 100_000;

/// Columns of results that are not parameters or measures; nothing that varies may be called like one.
pub const COLUMNS: [&str; 6] = ["world", "particles", "lost", "status", "reason", "state_hash"];

/// Further columns of that sort in the results of samples.
pub const SAMPLE_COLUMNS: [&str; 2] = ["variant", "seed"];

/// A study file that passed every check that does not need its worlds.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Study {
    /// Name for output and messages.
    pub title: String,
    /// The scene file: the study's folder with the path as written.
    pub scene: PathBuf,
    /// What stands in it.
    pub scene_text: String,
    /// How worlds are chosen.
    pub sampler: Sampler,
    /// How many worlds the samplers choose that spread them over ranges; 0 for the others.
    pub points: usize,
    /// Seed of these samplers.
    pub seed: u64,
    /// What varies, in the order of the file.
    pub parameters: Vec<Parameter>,
    /// What follows, in the order of the file.
    pub followers: Vec<Follower>,
    /// What is done with periodic samples, if the study is of such.
    pub rve: Option<Rve>,
    /// The file itself.
    pub text: String,
    name: String,
    folder: PathBuf,
    sets: Vec<String>,
}

/// How worlds are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sampler {
    /// Every combination of values; the last parameter changes fastest.
    #[default]
    Grid,
    /// World k has the k-th value of each parameter.
    List,
    /// As many strata of every parameter as worlds, one world in each.
    LatinHypercube,
    /// A Sobol sequence, shifted at random.
    Sobol,
}

impl Sampler {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        let at = SAMPLERS.values.iter().position(|s| *s == self);
        at.and_then(|at| SAMPLERS.words.get(at)).copied().unwrap_or_default()
    }

    /// Whether it spreads a given number of worlds over ranges.
    pub fn spreads(self) -> bool {
        matches!(self, Self::LatinHypercube | Self::Sobol)
    }
}

/// A value of the scene that varies.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// The value of the scene, as for `--set`.
    pub path: String,
    /// Its SI unit; empty if it has none.
    pub unit: &'static str,
    /// What it may be.
    pub values: Values,
}

/// What a parameter may be.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Any of these.
    Listed(Vec<Value>),
    /// Numbers in a range.
    Range {
        /// First and last, in SI units; the first is smaller.
        range: [f64; 2],
        /// How many a grid takes; 0 for other samplers.
        count: usize,
        /// Whether equal steps are equal ratios; the range is then above 0.
        logarithmic: bool,
        /// Whether they are rounded to whole numbers.
        whole: bool,
    },
}

/// A value of the scene that is a multiple of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Follower {
    /// Its name.
    pub name: String,
    /// The value of the scene, as for `--set`.
    pub path: String,
    /// Its SI unit; empty if it has none.
    pub unit: &'static str,
    /// Number of the parameter.
    pub of: usize,
    /// Its ratio to the parameter, both in SI units.
    pub factor: f64,
    /// Whether it is rounded to a whole number.
    pub whole: bool,
}

/// One value, as one world has it. It prints itself as TOML.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number in SI units.
    Number(f64),
    /// A whole number.
    Whole(u64),
    /// Anything else, as TOML.
    Text(String),
}

impl Value {
    /// As a number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(x) => Some(*x),
            Self::Whole(n) => Some(*n as f64),
            Self::Text(_) => None,
        }
    }

    /// As it is shown in tables: a plain text without its quotes.
    pub fn shown(&self) -> String {
        let text = self.to_string();
        let inside = |quote: char| text.strip_prefix(quote)?.strip_suffix(quote);
        inside('"').or_else(|| inside('\'')).unwrap_or(&text).to_owned()
    }

    /// A number, rounded if it is to be whole; below 0 there are no whole numbers in scenes.
    pub fn rounded(x: f64, whole: bool) -> Self {
        if whole { Self::Whole(x.round().max(0.0) as u64) } else { Self::Number(x) }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(x) => write!(f, "{x:?}"),
            Self::Whole(n) => write!(f, "{n}"),
            Self::Text(text) => f.write_str(text),
        }
    }
}

impl Study {
    /// Reads the study file `path`; see [`Study::parse`].
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the file.
    pub fn load(path: &Path, sets: &[String]) -> Result<Self, Vec<SceneError>> {
        let help = "give the path of a study file; `glebe new NAME --template sweep` makes one";
        let text =
            input::read_text(path, MOST_BYTES).map_err(|e| vec![SceneError::unreadable(path, &e, help)])?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(&path.display().to_string(), &text, folder, sets)
    }

    /// Reads the study `text`, for which `name` stands in messages, and the scene that it names, relative to
    /// `folder`. Each of `sets` is `path=value` and replaces or adds a value of the study before anything is
    /// checked, as for scenes ([`crate::scene::Scene::parse`]).
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the file; none of them is a warning. What is wrong with
    /// the worlds of the scene is found when they are made.
    pub fn parse(name: &str, text: &str, folder: &Path, sets: &[String]) -> Result<Self, Vec<SceneError>> {
        let source = Source::new(name, text);
        let mut root = document::parse(&source).map_err(first)?;
        let found = set::apply(&mut root, &STUDY, sets);
        let known = Known::default();
        let checker = Checker { known: &known, found };
        let mut reader = Reader { checker, own: root, scene: None, scene_text: String::new() };
        let file = reader.checker.table(&reader.own, &STUDY, "");
        let scene = file
            .located_if("scene")
            .map(|scene| Located { value: folder.join(scene.value), place: scene.place });
        if let Some(scene) = &scene
            && let Some((root, text)) = read_scene(&mut reader.checker, scene)?
        {
            reader.scene = Some(root);
            reader.scene_text = text;
        }
        let mut study = reader.study(&file);
        let (_, mut errors): (Vec<_>, Vec<_>) =
            reader.checker.found.into_iter().partition(SceneError::is_warning);
        if errors.is_empty() {
            study.scene = scene.map(|s| s.value).unwrap_or_default();
            text.clone_into(&mut study.text);
            name.clone_into(&mut study.name);
            folder.clone_into(&mut study.folder);
            study.sets = sets.to_vec();
            return Ok(study);
        }
        errors.sort_by_key(|e| {
            if e.place().source().name() == name { e.place().span().start } else { usize::MAX }
        });
        Err(first(errors))
    }

    /// What is done with the samples of a variant: as the study says, with what varies of it set by arguments of
    /// `--set`. Those of values of the scene are ignored. None if the study is not of samples.
    ///
    /// # Errors
    /// Everything that is wrong with the values.
    pub fn rve_with(&self, sets: &[String]) -> Result<Option<Rve>, Vec<SceneError>> {
        let own: Vec<String> =
            self.sets.iter().chain(sets.iter().filter(|set| of_samples(set))).cloned().collect();
        Ok(Self::parse(&self.name, &self.text, &self.folder, &own)?.rve)
    }

    /// Whether a file can be read and is meant to be a study.
    pub fn is_at(path: &Path) -> bool {
        input::read_text(path, MOST_BYTES).is_ok_and(|text| Self::is_meant(&text))
    }

    /// Whether a text is meant to be a study rather than a scene: it says what varies, or names a scene.
    pub fn is_meant(text: &str) -> bool {
        let parsed = document::parse(&Source::new("", text));
        parsed.is_ok_and(|root| root.get("vary").is_some() || root.get("scene").is_some())
    }
}

/// The JSON Schema of study files, for editors.
pub fn schema() -> serde_json::Value {
    schema_of(&STUDY, "glebe study")
}

/// Whether a path, with or without a value after it, is one of what is done with samples rather than of the scene.
pub fn of_samples(path: &str) -> bool {
    path.split_once('.').is_some_and(|(part, _)| rve::PARTS.contains(&part.trim()))
}

/// Reads what the tables of a study mean in its scene.
struct Reader<'a> {
    checker: Checker<'a>,
    /// The file itself.
    own: Node,
    /// The scene; absent if it could not be read, so that nothing is said of what it should hold.
    scene: Option<Node>,
    scene_text: String,
}

impl Reader<'_> {
    fn study(&mut self, file: &Record) -> Study {
        let sampler = SAMPLERS.value(&file.text("sampler"));
        let points = usize::try_from(file.integer("points")).unwrap_or(usize::MAX);
        self.points_fit(file, sampler);
        let rve = self.rve(file);
        let vary = file.named("vary");
        let failed = file.written("vary") && !file.has("vary");
        if vary.is_empty() && !failed && rve.is_none() {
            let message = "nothing varies in this study".to_owned();
            self.checker.error(
                SceneError::new("missing", file.place("vary"), message)
                    .label("no `vary`")
                    .help("write [vary.NAME] with a path and its values"),
            );
        }
        let parameters: Vec<Parameter> =
            vary.iter().map(|(name, record)| self.parameter(&name.value, record, sampler)).collect();
        self.lists_are_equal(file, &parameters, sampler);
        let numbers = |p: &Parameter| match &p.values {
            Values::Listed(values) => values.iter().all(|v| v.number().is_some()),
            Values::Range { .. } => true,
        };
        let varied: Vec<(&str, bool)> = parameters.iter().map(|p| (p.name.as_str(), numbers(p))).collect();
        let (scene, own) = (self.scene.as_ref(), Some(&self.own));
        let followers = file
            .named("follow")
            .iter()
            .filter_map(|(n, r)| follower(&mut self.checker, scene, own, &n.value, r, &varied))
            .collect();
        self.names_differ(file);
        self.not_too_many(file, &parameters, sampler);
        Study {
            title: file.text("title"),
            scene: PathBuf::new(),
            scene_text: std::mem::take(&mut self.scene_text),
            sampler,
            points,
            seed: file.integer("seed"),
            parameters,
            followers,
            rve,
            text: String::new(),
            name: String::new(),
            folder: PathBuf::new(),
            sets: Vec::new(),
        }
    }

    fn points_fit(&mut self, file: &Record, sampler: Sampler) {
        let name = sampler.name();
        if sampler.spreads() && !file.written("points") {
            let message = format!("the sampler `{name}` needs `points`");
            self.checker.error(
                SceneError::new("missing", file.place("sampler"), message)
                    .label("needs `points`")
                    .help("write points = …, how many worlds there are to be"),
            );
        }
        if !sampler.spreads() && file.has("points") {
            let message = format!("`points` means nothing together with the sampler `{name}`");
            self.checker.error(
                SceneError::new("conflict", file.place("points"), message)
                    .label("has no effect")
                    .help("take it away, or write sampler = \"latin-hypercube\" or \"sobol\""),
            );
        }
    }

    fn parameter(&mut self, name: &str, record: &Record, sampler: Sampler) -> Parameter {
        let nothing = Values::Listed(Vec::new());
        let found =
            self.scene.as_ref().and_then(|scene| target(&mut self.checker, scene, Some(&self.own), record));
        let Some((path, kind)) = found else {
            return Parameter { name: name.to_owned(), path: String::new(), unit: "", values: nothing };
        };
        let unit = number_in(&kind).map_or("", |dimension| dimension.si);
        let values = match (record.node("values"), record.node("range")) {
            (Some(node), _) => Values::Listed(self.listed(node, &kind, &format!("vary.{name}.values"))),
            (None, Some(_)) if sampler == Sampler::List => {
                let message =
                    format!("`vary.{name}` has a range, and the sampler `list` takes values one by one");
                self.checker.error(
                    SceneError::new("conflict", record.place("range"), message)
                        .label("no list")
                        .help("write values = […], or another sampler"),
                );
                nothing
            }
            (None, Some(node)) => self.range(node, record, &kind, name, sampler).unwrap_or(nothing),
            (None, None) => nothing,
        };
        Parameter { name: name.to_owned(), path, unit, values }
    }

    fn listed(&mut self, node: &Node, kind: &Kind, path: &str) -> Vec<Value> {
        let Written::Array(items) = &node.value else {
            let message = format!("`{path}` is {}", node.kind());
            self.checker.error(
                SceneError::new("wrong-kind", &node.place, message)
                    .label("not a list")
                    .help("expected is a list of values, such as [1, 2, 3]"),
            );
            return Vec::new();
        };
        if items.is_empty() {
            let message = format!("`{path}` is empty");
            self.checker.error(SceneError::new("missing", &node.place, message).label("no values"));
        }
        items.iter().filter_map(|item| self.value(item, kind, path)).collect()
    }

    /// One of a list of values. Whether the scene lets it pass is seen when its world is made.
    fn value(&mut self, node: &Node, kind: &Kind, path: &str) -> Option<Value> {
        let one_of = |text: &str| match kind {
            Kind::Either(kinds) => kinds.iter().any(|k| k.words().contains(&text)),
            _ => false,
        };
        let dimension = number_in(kind).filter(|_| match &node.value {
            Written::Integer(_) | Written::Float(_) => true,
            Written::Text(text) => !one_of(text),
            _ => !matches!(kind, Kind::Either(_)),
        });
        match (dimension, &node.value) {
            (Some(dimension), _) => {
                let any = Field::new("", Kind::Number(dimension), "");
                self.checker.number(node, dimension, &any, path).map(Value::Number)
            }
            (None, Written::Integer(Some(n))) if matches!(kind, Kind::Integer) && *n >= 0 => {
                Some(Value::Whole(n.unsigned_abs()))
            }
            (None, _) if matches!(kind, Kind::Integer) => {
                self.checker.wrong_kind(node, kind, path);
                None
            }
            (None, _) => Some(Value::Text(node.place.text().to_owned())),
        }
    }

    fn range(
        &mut self,
        node: &Node,
        record: &Record,
        kind: &Kind,
        name: &str,
        sampler: Sampler,
    ) -> Option<Values> {
        let path = format!("vary.{name}.range");
        let whole = matches!(kind, Kind::Integer);
        let Some(dimension) = number_in(kind).or(whole.then_some(Dimension::NONE)) else {
            let message = format!("`vary.{name}` has a range, and what it varies is no number");
            self.checker.error(
                SceneError::new("wrong-kind", &node.place, message)
                    .label("of what?")
                    .help(format!("write values = […]; each is {}", kind.expected())),
            );
            return None;
        };
        let logarithmic = record.text("spacing") == "logarithmic";
        let ends = match &node.value {
            Written::Array(items) if items.len() == 2 => [&items[0], &items[1]],
            _ => {
                self.checker.wrong_kind(node, &Kind::Window(dimension), &path);
                return None;
            }
        };
        let any = Field::new("", Kind::Number(dimension), "");
        let ends = ends.map(|end| self.checker.number(end, dimension, &any, &path));
        let [Some(from), Some(to)] = ends else { return None };
        let mut bad = |place: &Place, kind, message: String, label: &str, help: &str| {
            self.checker.error(SceneError::new(kind, place, message).label(label).help(help));
        };
        if from >= to {
            let message = format!("`{path}` goes from {from} to {to}; the second must be larger");
            bad(&node.place, "order", message, "not ascending", "write [from, to]");
        }
        if logarithmic && from <= 0.0 {
            let message = format!("`{path}` begins at {from}, and equal ratios need numbers above 0");
            bad(&node.place, "range", message, "not above 0", "or take spacing = \"linear\"");
        }
        let counted = record.written("count");
        if sampler == Sampler::Grid && !counted {
            let message = format!("`vary.{name}` needs `count`: a grid takes so many values from its range");
            bad(&node.place, "missing", message, "how many?", "write count = …");
        }
        if sampler != Sampler::Grid && counted {
            let message = format!("`count` means nothing together with the sampler `{}`", sampler.name());
            bad(record.place("count"), "conflict", message, "has no effect", "`points` says how many worlds");
        }
        let count = usize::try_from(record.integer("count")).unwrap_or(usize::MAX);
        Some(Values::Range { range: [from, to], count, logarithmic, whole })
    }

    /// A list takes the k-th value of each, so each needs as many.
    fn lists_are_equal(&mut self, file: &Record, parameters: &[Parameter], sampler: Sampler) {
        if sampler != Sampler::List {
            return;
        }
        let counts: Vec<usize> = parameters
            .iter()
            .map(|p| if let Values::Listed(values) = &p.values { values.len() } else { 0 })
            .collect();
        let Some(&first) = counts.first() else { return };
        for ((name, record), count) in file.named("vary").iter().zip(&counts) {
            if *count != first && *count > 0 && first > 0 {
                let message = format!(
                    "`vary.{}` has {count} values, `vary.{}` has {first}",
                    name.value, parameters[0].name
                );
                self.checker.error(
                    SceneError::new("length", record.place("values"), message)
                        .label("another number")
                        .help("the sampler `list` takes one value of each for every world"),
                );
            }
        }
    }

    fn names_differ(&mut self, file: &Record) {
        let mut taken: Vec<&str> = COLUMNS.to_vec();
        if file.written("consolidate") {
            taken.extend(SAMPLE_COLUMNS);
        }
        let columns = taken.clone();
        for (name, _) in file.named("vary").iter().chain(file.named("follow")) {
            if taken.contains(&name.value.as_str()) || name.value.contains('.') {
                let message = format!("`{}` cannot be the name of a parameter", name.value);
                self.checker.error(SceneError::new("duplicate", &name.place, message).label("taken").help(
                    format!(
                        "names head columns of results: each once, without dots, and none of {}",
                        quoted(&columns)
                    ),
                ));
            }
            taken.push(&name.value);
        }
        let mut paths: Vec<Located<String>> = Vec::new();
        for (name, record) in file.named("vary").iter().chain(file.named("follow")) {
            let Some(path) = record.located_if("path") else { continue };
            if paths.contains(&path) {
                let message = format!("`{}` sets `{}`, which another sets already", name.value, path.value);
                self.checker.error(SceneError::new("duplicate", &path.place, message).label("again"));
            }
            paths.push(path);
        }
    }

    fn not_too_many(&mut self, file: &Record, parameters: &[Parameter], sampler: Sampler) {
        if sampler != Sampler::Grid {
            return;
        }
        let counts = parameters.iter().map(|p| match &p.values {
            Values::Listed(values) => values.len() as f64,
            Values::Range { count, .. } => *count as f64,
        });
        let worlds: f64 = counts.product();
        if worlds > MOST_WORLDS as f64 {
            let message = format!("the grid has {worlds:.0} worlds; allowed are {MOST_WORLDS}");
            self.checker.error(
                SceneError::new("range", file.place("vary"), message)
                    .label("too many")
                    .help("take fewer values, or sampler = \"sobol\" with points = …"),
            );
        }
    }
}

/// A scene and its text, if it can be read. The scene's own mistakes of syntax are told alone: nothing can be looked up
/// in it.
fn read_scene(
    checker: &mut Checker<'_>,
    path: &Located<PathBuf>,
) -> Result<Option<(Node, String)>, Vec<SceneError>> {
    match input::read_text(&path.value, MOST_BYTES) {
        Ok(text) => {
            let root =
                document::parse(&Source::new(&path.value.display().to_string(), &text)).map_err(first)?;
            Ok(Some((root, text)))
        }
        Err(error) => {
            let message = format!("cannot read `{}`: {error}", path.value.display());
            checker.error(SceneError::new("unreadable", &path.place, message).label("this scene"));
            Ok(None)
        }
    }
}

/// What the scene expects at the path of a record, and the path itself; of what is done with samples, what the file
/// itself expects, if its `own` tables may vary.
fn target(
    checker: &mut Checker<'_>,
    scene: &Node,
    own: Option<&Node>,
    record: &Record,
) -> Option<(String, Kind)> {
    let path = record.located_if("path")?;
    // Inside the quotes, if nothing in it is escaped.
    let span = path.place.span();
    let inside = span.start + 1..span.end.saturating_sub(1);
    let at = if inside.len() == path.value.len() { path.place.part(inside) } else { path.place };
    let (root, table) = match own {
        Some(own) if of_samples(&path.value) => (own, &STUDY),
        _ => (scene, &SCENE),
    };
    match set::leads_to(root, table, &path.value, &at) {
        Ok(kind) => Some((path.value, kind)),
        Err(error) => {
            checker.error(error);
            None
        }
    }
}

/// What follows one of those that vary, given by name and whether they are numbers.
fn follower(
    checker: &mut Checker<'_>,
    scene: Option<&Node>,
    own: Option<&Node>,
    name: &str,
    record: &Record,
    varied: &[(&str, bool)],
) -> Option<Follower> {
    let target = scene.and_then(|scene| target(checker, scene, own, record));
    let of = record.located_if("of")?;
    let Some(at) = varied.iter().position(|(name, _)| *name == of.value) else {
        let names: Vec<&str> = varied.iter().map(|(name, _)| *name).collect();
        let message = format!("nothing that varies is called `{}`", of.value);
        checker.error(
            SceneError::new("undefined", &of.place, message).label("what it should follow").help(advice(
                &of.value,
                &names,
                "nothing varies",
            )),
        );
        return None;
    };
    let numbers = varied[at].1;
    let (path, kind) = target?;
    let whole = matches!(kind, Kind::Integer);
    let dimension = number_in(&kind);
    if !numbers || (dimension.is_none() && !whole) {
        let culprit = if numbers { &path } else { &of.value };
        let message = format!("`follow.{name}` multiplies a number, and `{culprit}` is none");
        let place = if numbers { record.place("path") } else { &of.place };
        checker.error(SceneError::new("wrong-kind", place, message).label("no number"));
        return None;
    }
    let unit = dimension.map_or("", |d| d.si);
    Some(Follower { name: name.to_owned(), path, unit, of: at, factor: record.number("factor"), whole })
}

/// The dimension of what a value is, if it can be a number with one.
fn number_in(kind: &Kind) -> Option<Dimension> {
    match kind {
        Kind::Number(dimension) => Some(*dimension),
        Kind::Either(kinds) => kinds.iter().find_map(number_in),
        _ => None,
    }
}
