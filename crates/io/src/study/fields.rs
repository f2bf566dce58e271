//! Every table and key of a study file, described as those of scenes are.

use crate::scene::table::{Field, Kind, Names, Rule, TableSpec, Words, words};
use crate::units::Dimension;

use super::Sampler;
use super::rve::{CONSOLIDATE, LOAD, PREPARE};

pub(super) const SAMPLERS: Words<Sampler> = words! {
    "grid" => Sampler::Grid, "list" => Sampler::List,
    "latin-hypercube" => Sampler::LatinHypercube, "sobol" => Sampler::Sobol,
};

/// The whole file.
pub(super) static STUDY: TableSpec = TableSpec {
    doc: "A glebe study: a scene, and which of its values vary from world to world.",
    fields: &[
        Field::new("title", Kind::Text, "Name for output and messages.").or("\"\""),
        Field::new("scene", Kind::Path, "The scene file, relative to the study."),
        Field::new(
            "sampler",
            Kind::Words(SAMPLERS.words),
            "How worlds are chosen: every combination of values (`grid`), the first values together, the second \
             together and so on (`list`), or `points` worlds spread over the ranges (`latin-hypercube`, `sobol`).",
        )
        .or("\"grid\""),
        Field::new("points", Kind::Integer, "How many worlds `latin-hypercube` and `sobol` choose.")
            .optional("the values say how many")
            .at_least(1.0)
            .at_most(super::MOST_WORLDS as f64),
        Field::new("seed", Kind::Integer, "Seed of `latin-hypercube` and `sobol`.").or("1").at_least(0.0),
        Field::new("vary", Kind::Named(Names::New, &VARY), "What varies, by name; the names head the results.")
            .optional("needed for `glebe sweep`"),
        Field::new("follow", Kind::Named(Names::New, &FOLLOW), "Values that follow one that varies, by name.")
            .or("{}"),
        Field::new(
            "seeds",
            Kind::Integer,
            "Samples of each variant, whose scenes have the seed as written, the next and so on (`glebe rve`).",
        )
        .or("1")
        .at_least(1.0)
        .at_most(super::MOST_WORLDS as f64),
        Field::new("prepare", Kind::Table(&PREPARE), "How periodic samples are made (`glebe rve`).")
            .optional("they are consolidated as they are"),
        Field::new("consolidate", Kind::Table(&CONSOLIDATE), "The stress they are brought to (`glebe rve`).")
            .optional("the study is not of periodic samples"),
        Field::new("load", Kind::Table(&LOAD), "How they are loaded (`glebe rve`).").optional("they are not"),
    ],
    rules: &[],
};

static VARY: TableSpec = TableSpec {
    doc: "A value of the scene that varies.",
    fields: &[
        Field::new(
            "path",
            Kind::Text,
            "The value, as for --set, such as \"material.soil.density\", or one of the study's own, such as \"prepare.void_ratio\".",
        ),
        Field::new("values", Kind::Any, "A list of its values, as the scene would have them.")
            .optional("see `range`"),
        Field::new("range", Kind::Any, "[from, to], both included in a grid.").optional("see `values`"),
        Field::new("count", Kind::Integer, "How many values a grid takes from the range.")
            .optional("needed with `range` in a grid")
            .at_least(2.0)
            .at_most(super::MOST_WORLDS as f64),
        Field::new(
            "spacing",
            Kind::Words(&["linear", "logarithmic"]),
            "Whether equal steps in the range are equal differences or equal ratios.",
        )
        .or("\"linear\""),
    ],
    rules: &[Rule::ExactlyOne(&["values", "range"]), Rule::Excludes("values", &["count", "spacing"])],
};

pub(super) static FOLLOW: TableSpec = TableSpec {
    doc: "A value of the scene that is a multiple of another, in SI units.",
    fields: &[
        Field::new("path", Kind::Text, "The value, as for --set."),
        Field::new("of", Kind::Text, "The name of what it follows, in `vary` or `free`."),
        Field::new("factor", Kind::Number(Dimension::NONE), "Its ratio to that.").or("1.0"),
    ],
    rules: &[],
};
