//! How the tables of an input file are described: one static list of fields per table, from which follow
//! parsing, errors, defaults, the JSON Schema and the documentation.

use glebe_physics::{LawInfo, Slot};

use crate::units::Dimension;

/// A table of the file.
pub(crate) struct TableSpec {
    /// One line for the schema.
    pub doc: &'static str,
    pub fields: &'static [Field],
    /// What must hold between fields.
    pub rules: &'static [Rule],
}

/// A key of a table.
pub(crate) struct Field {
    pub key: &'static str,
    pub kind: Kind,
    pub need: Need,
    /// Allowed values of numbers.
    pub range: Range,
    /// Values outside are most likely slips of a unit; they get a warning.
    pub usual: Option<(f64, f64)>,
    pub doc: &'static str,
}

/// What a value may be.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    /// An SI number or a text with a unit.
    Number(Dimension),
    Integer,
    Bool,
    Text,
    /// A path, relative to the scene file.
    Path,
    Words(&'static [&'static str]),
    /// A name of a registry, whose rows are (name, what it does).
    Choice(fn() -> Vec<(&'static str, &'static str)>),
    Vector(Dimension),
    /// A vector of any length but zero, or `"x"`, `"-z"`; read as a unit vector.
    Direction,
    /// `[from, to]`, `from < to`.
    Window(Dimension),
    /// A list of two numbers or more.
    Numbers(Dimension),
    /// The name of something defined in the file.
    Reference(Names),
    /// A list of such names.
    References(Names),
    /// `surface.component`, such as `"sweep.fx"`.
    Probe,
    /// A law's name, or a table of that name with parameters.
    Law(Slot),
    /// The parameters of a law.
    Parameters(&'static LawInfo),
    /// Whatever it is: what it means depends on other values.
    Any,
    /// `[low, high]`, each of a kind.
    LowHigh(&'static Kind),
    Table(&'static TableSpec),
    /// A table of tables, each with a name of the given sort.
    Named(Names, &'static TableSpec),
    List(&'static TableSpec),
    /// The first alternative whose shape fits.
    Either(&'static [Kind]),
}

/// Which names a key or value is one of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Names {
    /// Any: the key defines the name.
    New,
    Material,
    Surface,
    Stage,
    Outlet,
    /// Two materials with a dash between.
    Pair,
}

#[derive(Clone, Copy)]
pub(crate) enum Need {
    Required,
    /// May be absent; the words say what that means.
    Optional(&'static str),
    /// TOML text of the value used when absent.
    Default(&'static str),
    /// Takes the value of another key.
    Like(&'static str),
}

/// An interval of allowed numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    pub min: f64,
    pub min_excluded: bool,
    pub max: f64,
}

impl Range {
    const ANY: Self = Self { min: f64::NEG_INFINITY, min_excluded: false, max: f64::INFINITY };

    pub fn contains(&self, x: f64) -> bool {
        (x > self.min || x == self.min && !self.min_excluded) && x <= self.max
    }

    /// In words, after "allowed is".
    pub fn words(&self) -> String {
        let Self { min, min_excluded, max } = *self;
        // What laws write for "above 0".
        let (min, min_excluded) = if min == f64::MIN_POSITIVE { (0.0, true) } else { (min, min_excluded) };
        match (min_excluded, max == f64::INFINITY) {
            (false, true) => format!("{min} or more"),
            (true, true) => format!("more than {min}"),
            (false, false) => format!("{min} to {max}"),
            (true, false) => format!("more than {min}, up to {max}"),
        }
    }
}

/// What must hold between the fields of a table.
pub(crate) enum Rule {
    ExactlyOne(&'static [&'static str]),
    AtMostOne(&'static [&'static str]),
    AtLeastOne(&'static [&'static str]),
    /// The first makes no sense without all of the others.
    Needs(&'static str, &'static [&'static str]),
    /// The first makes no sense together with any of the others.
    Excludes(&'static str, &'static [&'static str]),
}

/// Words and what they stand for.
pub(crate) struct Words<T: 'static> {
    pub words: &'static [&'static str],
    pub values: &'static [T],
}

impl<T: Copy + Default> Words<T> {
    /// The value of a word that the checker let through.
    pub fn value(&self, word: &str) -> T {
        self.words
            .iter()
            .position(|w| *w == word)
            .and_then(|at| self.values.get(at))
            .copied()
            .unwrap_or_default()
    }
}

macro_rules! words {
    ($($word:expr => $value:expr),* $(,)?) => {
        $crate::scene::table::Words { words: &[$($word),*], values: &[$($value),*] }
    };
}
pub(crate) use words;

impl Field {
    pub const fn new(key: &'static str, kind: Kind, doc: &'static str) -> Self {
        Self { key, kind, need: Need::Required, range: Range::ANY, usual: None, doc }
    }
    pub const fn or(mut self, literal: &'static str) -> Self {
        self.need = Need::Default(literal);
        self
    }
    pub const fn optional(mut self, absent: &'static str) -> Self {
        self.need = Need::Optional(absent);
        self
    }
    pub const fn like(mut self, key: &'static str) -> Self {
        self.need = Need::Like(key);
        self
    }
    pub const fn at_least(mut self, min: f64) -> Self {
        self.range.min = min;
        self
    }
    pub const fn above(mut self, min: f64) -> Self {
        self.range.min = min;
        self.range.min_excluded = true;
        self
    }
    pub const fn at_most(mut self, max: f64) -> Self {
        self.range.max = max;
        self
    }
    pub const fn usual(mut self, from: f64, to: f64) -> Self {
        self.usual = Some((from, to));
        self
    }
}

impl TableSpec {
    pub fn keys(&self) -> Vec<&'static str> {
        self.fields.iter().map(|f| f.key).collect()
    }
    pub fn field(&self, key: &str) -> Option<&'static Field> {
        self.fields.iter().find(|f| f.key == key)
    }
}

impl Kind {
    /// The words that may be written, if it is one of a list.
    pub fn words(&self) -> Vec<&'static str> {
        match self {
            Self::Words(words) => words.to_vec(),
            Self::Choice(rows) => rows().into_iter().map(|(name, _)| name).collect(),
            Self::Law(slot) => glebe_physics::laws(*slot).iter().map(|law| law.name).collect(),
            _ => Vec::new(),
        }
    }

    /// For messages: what is expected.
    pub fn expected(&self) -> String {
        match self {
            Self::Number(dimension) => dimension.expected(),
            Self::Integer => "a whole number".to_owned(),
            Self::Bool => "true or false".to_owned(),
            Self::Text => "a text in quotes".to_owned(),
            Self::Path => "a file name in quotes".to_owned(),
            Self::Words(_) | Self::Choice(_) => {
                let all: Vec<String> = self.words().iter().map(|w| format!("\"{w}\"")).collect();
                if all.len() == 1 { all.concat() } else { format!("one of {}", all.join(", ")) }
            }
            Self::Vector(dimension) => format!("[x, y, z], each {}", dimension.expected()),
            Self::Direction => "a direction, such as [0, 0, 1] or \"z\"".to_owned(),
            Self::Window(dimension) => format!("[from, to], each {}", dimension.expected()),
            Self::Numbers(dimension) => format!("a list of two or more, each {}", dimension.expected()),
            Self::Reference(names) => format!("the name of a {}", names.noun()),
            Self::References(names) => format!("a list of names of {}s", names.noun()),
            Self::Probe => "a surface and its component, such as \"tool.fx\"".to_owned(),
            Self::Parameters(law) => format!("a table with the parameters of `{}`", law.name),
            Self::Any => "a value".to_owned(),
            Self::Law(_) => "a law's name, or a table of that name with its parameters".to_owned(),
            Self::LowHigh(kind) => format!("[low, high], each {}", kind.expected()),
            Self::Table(spec) | Self::Named(_, spec) => {
                let keys: Vec<String> = spec.fields.iter().take(3).map(|f| format!("`{}`", f.key)).collect();
                format!("a table with keys such as {}", keys.join(", "))
            }
            Self::List(_) => "a list of tables".to_owned(),
            Self::Either(kinds) => kinds.iter().map(Self::expected).collect::<Vec<_>>().join("; or "),
        }
    }
}

impl Names {
    pub fn noun(self) -> &'static str {
        match self {
            Self::New => "name",
            Self::Material => "material",
            Self::Surface => "surface",
            Self::Stage => "stage",
            Self::Outlet => "outlet",
            Self::Pair => "pair of materials",
        }
    }
}
