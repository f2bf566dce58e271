//! The keys of fields that are measured while a world runs, and what they mean.

use glebe_engine::field::{FieldSpec, Kernel};
use glebe_engine::spec::Vec3;

use super::check::{Checker, Record};
use super::error::SceneError;
use super::fields::{LENGTH, POINT, TIME};
use super::model::{DomainPart, ascend};
use super::table::{Field, Kind, TableSpec, Words, words};
use crate::output::file_word;

/// Most cells of a field; each takes 240 bytes of memory.
const MOST_CELLS: f64 = 4e6;

const KERNELS: Words<Kernel> = words! {
    "gaussian" => Kernel::Gaussian, "lucy" => Kernel::Lucy,
};

pub(super) static FIELD: TableSpec = TableSpec {
    doc: "A field by coarse graining on a regular grid: solid fraction, density, momentum, velocity, stress, kinetic stress, fabric. Written as fields/NUMBER_NAME.vti, listed in fields/NAME.pvd.",
    fields: &[
        Field::new("name", Kind::Text, "Its name, each once."),
        Field::new("min", POINT, "Least corner of the grid [m].").optional("the domain's"),
        Field::new("max", POINT, "Largest corner of the grid [m].").optional("the domain's"),
        Field::new("spacing", LENGTH, "Width of a cell [m]; rounded so that whole cells fill the grid.").above(0.0),
        Field::new("kernel", Kind::Words(KERNELS.words), "How particles and contacts are spread: by a Gaussian cut off at three widths, or by Lucy's function, which ends at one.")
            .or("\"gaussian\""),
        Field::new("width", LENGTH, "Width of the kernel [m], not below the spacing: standard deviation of the Gaussian, radius of Lucy's function.")
            .above(0.0),
        Field::new("every", TIME, "Time between two results [s]; rounded to whole rows of the series.").above(0.0),
        Field::new("window", TIME, "Time before each result over which it is the mean of all rows [s].")
            .optional("that moment alone")
            .above(0.0),
        Field::new("profile", Kind::Words(&AXES), "Axis along which means over planes are written too, as fields/NUMBER_NAME.csv.")
            .optional("no profile"),
    ],
    rules: &[],
};

const AXES: [&str; 3] = ["x", "y", "z"];

/// The fields that a table of output asks for.
pub(super) fn fields(output: &Record, domain: &DomainPart, checker: &mut Checker) -> Vec<FieldSpec> {
    let mut all: Vec<FieldSpec> = Vec::new();
    for record in output.list("field") {
        let field = field(record, domain, checker);
        let file = file_word(&field.name);
        if all.iter().any(|other| file_word(&other.name).eq_ignore_ascii_case(&file)) {
            let message = format!("two fields have the file name `{file}`");
            checker.error(
                SceneError::new("duplicate", record.place("name"), message)
                    .label("again")
                    .help("give each field its own name; signs and capitals do not tell them apart"),
            );
        }
        all.push(field);
    }
    all
}

/// Contacts are a part of frames.
pub(super) fn contacts_need_frames(output: &Record, checker: &mut Checker) {
    if output.flag("contacts") && !output.written("frames") {
        checker.error(
            SceneError::new(
                "missing",
                output.place("contacts"),
                "contacts are shown in frames, and there are none",
            )
            .label("nothing would be written")
            .help("write frames = \"20 ms\" in [output], or leave `contacts` out"),
        );
    }
}

fn field(record: &Record, domain: &DomainPart, checker: &mut Checker) -> FieldSpec {
    let name = record.text("name");
    let corner = |key: &str, otherwise: Vec3| if record.has(key) { record.vector(key) } else { otherwise };
    let (min, max) = (corner("min", domain.min), corner("max", domain.max));
    let path = format!("output.field.{name}");
    ascend(record, &path, min, max, checker);
    let mut wrong = |key: &str, message: String, help: String| {
        checker.error(SceneError::new("range", record.place(key), message).label("this value").help(help));
    };
    if record.has("name") && !name.chars().any(char::is_alphanumeric) {
        let help = "give it a name with a letter or a digit: files are called by it".to_owned();
        wrong("name", format!("`{name}` is no name for a field"), help);
    }
    let spacing = record.number("spacing");
    let count = [0, 1, 2].map(|k| ((max[k] - min[k]) / spacing).round().max(1.0));
    let cells = count.iter().product::<f64>();
    if cells > MOST_CELLS {
        let message = format!("`{path}` has {cells:.0} cells");
        let help = format!("allowed are {MOST_CELLS:.0}; take a larger `spacing`, or a smaller grid");
        wrong("spacing", message, help);
    }
    let width = record.number("width");
    let largest = (0..3).map(|k| (max[k] - min[k]) / count[k]).fold(0.0, f64::max);
    if width < largest * (1.0 - 1e-9) {
        let message = format!("the kernel of `{path}` is {width} m wide, less than a cell of {largest} m");
        let help = "take a `width` of the spacing or more; one to three particle radii are usual".to_owned();
        wrong("width", message, help);
    }
    let (every, window) = (record.number("every"), record.number_if("window"));
    if window.is_some_and(|window| window > every) {
        let message = format!("`{path}` is to be the mean over more than the {every} s between two results");
        wrong("window", message, "a window ends at a result and is at most `every`".to_owned());
    }
    FieldSpec {
        name,
        min,
        max,
        cells: count.map(|x| if x <= MOST_CELLS { x as usize } else { 1 }),
        kernel: KERNELS.value(&record.text("kernel")),
        width,
        every,
        window,
        profile: AXES.iter().position(|axis| *axis == record.text("profile")),
    }
}
