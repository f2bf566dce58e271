//! Every table and key of a calibration file, described as those of scenes are.

use super::super::fields::FOLLOW;
use crate::scene::table::{Field, Kind, Names, Rule, TableSpec};
use crate::units::Dimension;

const NUMBER: Kind = Kind::Number(Dimension::NONE);
/// More than this is taken for a slip \[-\].
const MOST: f64 = 1e6;

/// The whole file.
pub(super) static CALIBRATION: TableSpec = TableSpec {
    doc: "A glebe calibration: which values of a scene are free, and what its measures should come to.",
    fields: &[
        Field::new("title", Kind::Text, "Name for output and messages.").or("\"\""),
        Field::new("scene", Kind::Path, "The scene file, relative to the calibration.")
            .optional("each experiment names its own, or see `study`"),
        Field::new(
            "study",
            Kind::Path,
            "A study of periodic samples (`glebe rve`) in place of a scene, relative to the calibration; nothing may vary \
             in it.",
        )
        .optional("see `scene`"),
        Field::new("seed", Kind::Integer, "Seed of the search.").or("1").at_least(0.0),
        Field::new(
            "experiment",
            Kind::Named(Names::New, &EXPERIMENT),
            "Several scenes, or the scene in several ways, that share the free parameters, by name.",
        )
        .optional("there is one, the scene as it is"),
        Field::new("free", Kind::Named(Names::New, &FREE), "The free parameters, by name."),
        Field::new("follow", Kind::Named(Names::New, &FOLLOW), "Values that follow a free one, by name.").or("{}"),
        Field::new("target", Kind::Named(Names::New, &TARGET), "What is to be met, by name."),
        Field::new("method", Kind::Table(&METHOD), "How it is searched.").or("{}"),
        Field::new(
            "surrogate",
            Kind::Table(&SURROGATE),
            "A Gaussian process through what was simulated that stands for simulations where it is sure enough.",
        )
        .optional("everything is simulated"),
        Field::new("stop", Kind::Table(&STOP), "When the search ends: as soon as one of these holds.").or("{}"),
        Field::new(
            "good",
            NUMBER,
            "Evaluations up to this cost count as good: at 1 they miss the targets by their scatters, on average.",
        )
        .or("1.0")
        .above(0.0),
        Field::new(
            "probe",
            NUMBER,
            "The share of their ranges by which parameters are changed, one by one, after a search for the least cost, \
             to find how the targets depend on them; 0 leaves that out.",
        )
        .or("0.05")
        .at_least(0.0)
        .at_most(0.5),
    ],
    rules: &[Rule::AtMostOne(&["scene", "study"])],
};

static EXPERIMENT: TableSpec = TableSpec {
    doc: "A scene that is run for every set of parameters.",
    fields: &[
        Field::new("scene", Kind::Path, "The scene file, relative to the calibration.")
            .optional("that of the calibration"),
        Field::new("study", Kind::Path, "A study of periodic samples in place of a scene.")
            .optional("that of the calibration"),
        Field::new(
            "set",
            Kind::Any,
            "Values of the scene that are other here: a list of texts, each as for --set.",
        )
        .optional("none"),
    ],
    rules: &[Rule::AtMostOne(&["scene", "study"])],
};

static FREE: TableSpec = TableSpec {
    doc: "A value of the scene that is free.",
    fields: &[
        Field::new("path", Kind::Text, "The value, as for --set, such as \"material.soil.density\"."),
        Field::new("bounds", Kind::Any, "[least, largest], as the scene would have them."),
        Field::new(
            "scale",
            Kind::Words(&["linear", "logarithmic"]),
            "Whether equal steps between the bounds are equal differences or equal ratios.",
        )
        .or("\"linear\""),
    ],
    rules: &[],
};

static TARGET: TableSpec = TableSpec {
    doc: "A number that a measure should come to, or a curve that was measured.",
    fields: &[
        Field::new("experiment", Kind::Text, "The name of its experiment.").optional("there is only one"),
        Field::new(
            "measure",
            Kind::Text,
            "Of a scene, stage and measure or survey, such as \"till.draught_force\"; of periodic samples a number of their table, \
             such as \"peak.q_over_p\".",
        )
        .optional("see `file`"),
        Field::new(
            "statistic",
            Kind::Words(&["mean", "std"]),
            "The mean of the measure or its standard deviation.",
        )
        .or("\"mean\""),
        Field::new("value", Kind::Any, "What it should be, in the unit of the measure.")
            .optional("needed with `measure`"),
        Field::new(
            "scatter",
            Kind::Any,
            "How far it may be off: the standard deviation of what was measured. Costs are in scatters.",
        )
        .optional("needed, but for a curve with `scatter_column`"),
        Field::new(
            "file",
            Kind::Path,
            "A curve that was measured, relative to the calibration: CSV with headings, each with its unit if that is not \
             the SI unit, such as `force [kN]`. Simulated curves are interpolated at its abscissae.",
        )
        .optional("see `measure`"),
        Field::new(
            "x",
            Kind::Text,
            "The abscissa: a column of the series of the scene, such as \"time\" (since the stage began) or \"sweep.path\"; \
             of periodic samples a column of their curves, such as \"strain\".",
        )
        .optional("needed with `file`"),
        Field::new("y", Kind::Text, "The ordinate, such as \"sweep.draught\"; of periodic samples \"q\" or \"eps_v\".")
            .optional("needed with `file`"),
        Field::new("x_column", Kind::Text, "The heading of the abscissa in the file, without its unit.")
            .optional("that of `x`"),
        Field::new("y_column", Kind::Text, "The heading of the ordinate in the file, without its unit.")
            .optional("that of `y`"),
        Field::new("scatter_column", Kind::Text, "The heading of the scatter in the file, without its unit.")
            .optional("see `scatter`"),
        Field::new("stage", Kind::Text, "The stage of the scene that the curve is of.")
            .optional("the scene has only one"),
        Field::new(
            "weight",
            NUMBER,
            "How much it counts beside the other targets; the points of a curve count together as one number does.",
        )
        .or("1.0")
        .above(0.0),
    ],
    rules: &[
        Rule::ExactlyOne(&["measure", "file"]),
        Rule::Excludes("file", &["statistic", "value"]),
        Rule::Excludes("measure", &["x", "y", "x_column", "y_column", "scatter_column", "stage"]),
        Rule::Excludes("scatter", &["scatter_column"]),
    ],
};

static METHOD: TableSpec = TableSpec {
    doc: "How parameters are searched.",
    fields: &[
        Field::new(
            "differential-evolution",
            Kind::Table(&EVOLUTION),
            "Differential evolution, rand/1/bin (Storn and Price 1997), which is taken unless another is named.",
        )
        .or("{}"),
        Field::new(
            "cma-es",
            Kind::Table(&CMA_ES),
            "Evolution strategy with covariance matrix adaptation (Hansen 2016).",
        )
        .optional("not taken"),
        Field::new(
            "bayesian-filter",
            Kind::Table(&FILTER),
            "Iterative Bayesian filter (Cheng et al. 2019): the distribution of the parameters.",
        )
        .optional("not taken"),
    ],
    rules: &[Rule::AtMostOne(&["differential-evolution", "cma-es", "bayesian-filter"])],
};

static EVOLUTION: TableSpec = TableSpec {
    doc: "Differential evolution; the defaults are those of Nagy et al. 2024.",
    fields: &[
        Field::new("population", Kind::Integer, "Agents, NP.").or("60").at_least(4.0).at_most(MOST),
        Field::new("weight", NUMBER, "Differential weight, F.").or("0.8").above(0.0).at_most(2.0),
        Field::new("crossover", NUMBER, "Crossover ratio, CR.").or("0.5").at_least(0.0).at_most(1.0),
        Field::new("adaptive", Kind::Bool, "Whether each agent adapts F and CR (jDE, Brest et al. 2006).")
            .or("false"),
    ],
    rules: &[],
};

static CMA_ES: TableSpec = TableSpec {
    doc: "CMA-ES.",
    fields: &[Field::new("population", Kind::Integer, "Points of a round.")
        .optional("4 + 3 ln of the number of free parameters")
        .at_least(4.0)
        .at_most(MOST)],
    rules: &[],
};

static FILTER: TableSpec = TableSpec {
    doc: "The iterative Bayesian filter.",
    fields: &[
        Field::new("samples", Kind::Integer, "Samples of a round; powers of 2 lie best.")
            .or("128")
            .at_least(8.0)
            .at_most(MOST),
        Field::new("effective", NUMBER, "The share of the samples that the effective sample size is to be.")
            .or("0.3")
            .above(0.0)
            .at_most(0.9),
    ],
    rules: &[],
};

static SURROGATE: TableSpec = TableSpec {
    doc: "A Gaussian process that stands for simulations. What could be the best, and one in ten that it is sure of, are simulated \
          all the same.",
    fields: &[
        Field::new("after", Kind::Integer, "So many evaluations are simulated before it is asked.")
            .optional("ten for each free parameter")
            .at_least(2.0)
            .at_most(MOST),
        Field::new(
            "spread",
            NUMBER,
            "A set of parameters is simulated if the standard deviation of its cost is predicted to be more than this share of \
             the cost, or more than this number of scatters where that is less than one; noise of targets not counted.",
        )
        .or("0.1")
        .above(0.0),
    ],
    rules: &[],
};

static STOP: TableSpec = TableSpec {
    doc: "When a search ends.",
    fields: &[
        Field::new("rounds", Kind::Integer, "Rounds (generations), the first included.")
            .optional("45 of differential evolution, 100 of CMA-ES, 5 of the filter")
            .at_least(1.0)
            .at_most(MOST),
        Field::new(
            "evaluations",
            Kind::Integer,
            "The most evaluations that are simulated; the first round is run whatever it takes.",
        )
        .optional("as many as the rounds take")
        .at_least(1.0),
        Field::new("cost", NUMBER, "A cost that is low enough, in scatters of the targets.")
            .optional("none is")
            .at_least(0.0),
        Field::new("stagnation", Kind::Integer, "Rounds without a lower cost.")
            .optional("they do not matter")
            .at_least(1.0),
    ],
    rules: &[],
};
