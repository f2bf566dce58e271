//! Fields of one run: what is looked at when, and what is written of it.

use glebe_engine::Constants;
use glebe_engine::batch::{Frame, Sample};
use glebe_engine::field::{Field, Point};
use glebe_io::output::columns::SYMMETRIC;
use glebe_io::output::vti::ImageData;
use glebe_io::output::vtp::{Column, Values};
use glebe_io::output::{Cell, Collection, FrameWriter, OutputDir, OutputError, file_word, write_table};

/// The fields of a run.
pub(super) struct Fields {
    dir: OutputDir,
    all: Vec<Recorded>,
}

struct Recorded {
    field: Field,
    writer: FrameWriter,
    /// Steps between two rows of the series, between two results, and before each that count.
    rows: u64,
    every: u64,
    window: u64,
}

impl Recorded {
    /// Whether it looks at the world at a step: at a row of the series, in the window before a result.
    fn looks(&self, step: u64) -> bool {
        let ahead = (self.every - step % self.every) % self.every;
        step.is_multiple_of(self.rows) && (ahead == 0 || ahead < self.window)
    }
}

impl Fields {
    /// Begins, or goes on from what a checkpoint holds.
    pub(super) fn new(dir: &OutputDir, c: &Constants, after: Option<&[u8]>) -> Result<Self, OutputError> {
        let mut rest = after;
        let mut all = Vec::new();
        for spec in &c.spec.fields {
            let at = dir.field(&spec.name);
            let mut field = Field::new(spec.clone());
            let (every, rows) = (c.whole_rows(spec.every), c.sample_steps());
            let window = spec.window.map_or(0, |window| c.whole_rows(window));
            let name = file_word(&spec.name);
            let writer = match rest {
                None => FrameWriter::create(at, &[&name])?,
                Some(bytes) => {
                    let Some((count, bytes)) = taken(&mut field, bytes) else { return Err(foreign(at)) };
                    rest = Some(bytes);
                    FrameWriter::resume(at, &[&name], count)?
                }
            };
            all.push(Recorded { field, writer, rows, every, window });
        }
        match rest {
            Some([_, ..]) => Err(foreign(dir.field("fields"))),
            _ => Ok(Self { dir: dir.clone(), all }),
        }
    }

    /// What is to be kept with a checkpoint: of each field the number of results and what it has seen since the last.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let bytes = |r: &Recorded| [r.writer.count().to_le_bytes().to_vec(), r.field.to_bytes()].concat();
        self.all.iter().flat_map(bytes).collect()
    }

    /// Whether any of them looks at the world with this sample.
    pub(super) fn look_at(&self, sample: &Sample) -> bool {
        self.all.iter().any(|r| r.looks(sample.step))
    }

    /// Looks, and writes the results that are due.
    pub(super) fn look(&mut self, frame: &Frame<'_>) -> Result<(), OutputError> {
        let step = frame.state.progress.step;
        for r in self.all.iter_mut().filter(|r| r.looks(step)) {
            r.field.look(frame.constants, frame.state, frame.positions, frame.detail());
            if step.is_multiple_of(r.every) {
                write(&self.dir, r, frame.time)?;
                r.field.clear();
            }
        }
        Ok(())
    }
}

/// Takes what a checkpoint holds of a field; returns the number of its results and what is left.
fn taken<'a>(field: &mut Field, bytes: &'a [u8]) -> Option<(u64, &'a [u8])> {
    let (count, bytes) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*count), field.restore(bytes)?))
}

fn foreign(at: Collection) -> OutputError {
    let what =
        "the checkpoint holds other fields than the scene asks for; start again with --force".to_owned();
    OutputError::Malformed { path: at.list, what }
}

fn write(dir: &OutputDir, r: &mut Recorded, time: f64) -> Result<(), OutputError> {
    let spec = r.field.spec().clone();
    if let Some(axis) = spec.profile {
        let name = ["x", "y", "z"][axis];
        let rows: Vec<Vec<Cell>> = r.field.profile(axis).iter().map(|(at, p)| row(*at, p)).collect();
        write_table(&dir.profile(&spec.name, r.writer.count()), &header(name), &rows)?;
    }
    let points = r.field.points();
    let scalar = |f: fn(&Point) -> f64| -> Vec<f64> { points.iter().map(f).collect() };
    let vector = |f: fn(&Point) -> [f64; 3]| -> Vec<[f64; 3]> { points.iter().map(f).collect() };
    let tensor = |f: fn(&Point) -> [[f64; 3]; 3]| -> Vec<[[f64; 3]; 3]> { points.iter().map(f).collect() };
    let scalars = [
        ("solid_fraction", scalar(|p| p.solid_fraction)),
        ("density", scalar(|p| p.density)),
        ("contact_density", scalar(|p| p.contact_density)),
    ];
    let vectors = [
        ("momentum", vector(|p| p.momentum)),
        ("velocity", vector(|p| p.velocity)),
        ("surface_force", vector(|p| p.surface_force)),
    ];
    let tensors = [
        ("stress", tensor(|p| p.stress)),
        ("kinetic_stress", tensor(|p| p.kinetic_stress)),
        ("fabric", tensor(|p| p.fabric)),
    ];
    let scalars = scalars.iter().map(|(name, values)| Column::new(name, Values::F64(values)));
    let vectors = vectors.iter().map(|(name, values)| Column::new(name, Values::Vec3F64(values)));
    let tensors = tensors.iter().map(|(name, values)| Column::new(name, Values::TensorF64(values)));
    let image = ImageData {
        origin: spec.min,
        spacing: r.field.spacing(),
        cells: spec.cells,
        cell_data: scalars.chain(vectors).chain(tensors).collect(),
    };
    r.writer.write(time, &[(0, image)])
}

/// The columns of a profile along the axis `name`.
fn header(name: &str) -> Vec<String> {
    let scalars = [name, "solid_fraction", "density", "vx", "vy", "vz", "contact_density"];
    let tensors = ["stress", "kinetic_stress", "fabric"];
    let components =
        tensors.iter().flat_map(|tensor| SYMMETRIC.map(|(_, component)| format!("{tensor}_{component}")));
    let forces = ["x", "y", "z"].map(|axis| format!("surface_force_{axis}"));
    scalars.map(str::to_owned).into_iter().chain(components).chain(forces).collect()
}

fn row(at: f64, p: &Point) -> Vec<Cell> {
    let [vx, vy, vz] = p.velocity;
    let mut row = vec![at, p.solid_fraction, p.density, vx, vy, vz, p.contact_density];
    for tensor in [&p.stress, &p.kinetic_stress, &p.fabric] {
        row.extend(SYMMETRIC.map(|([a, b], _)| 0.5 * (tensor[a][b] + tensor[b][a])));
    }
    row.extend(p.surface_force);
    row.into_iter().map(Cell::Number).collect()
}
