//! The curve of a sample: what it shows at every moment of consolidation and loading.

use std::path::Path;

use glebe_engine::batch::Sample;
use glebe_io::output::columns::CURVE;
use glebe_io::output::series::Series;
use glebe_io::output::{Cell, OutputError, write_table};
use glebe_io::study::Program;

/// What is kept while a world runs: time, stage, strain since the beginning of the consolidation and stress by
/// component, void ratio, mechanical coordination, particles with fewer than two contacts, kinetic over elastic energy.
pub(super) const RAW: [&str; 18] = [
    "time",
    "stage",
    "eps_xx",
    "eps_yy",
    "eps_zz",
    "eps_yz",
    "eps_xz",
    "eps_xy",
    "stress_xx",
    "stress_yy",
    "stress_zz",
    "stress_yz",
    "stress_xz",
    "stress_xy",
    "void_ratio",
    "coordination",
    "rattlers",
    "kinetic_over_elastic",
];
pub(super) type Raw = [f64; RAW.len()];

/// Columns that a finished curve has besides: strain of the loading along what it drives, volumetric and deviatoric
/// strain, mean and deviatoric stress.
pub(super) const DERIVED: [&str; 5] = ["strain", "eps_v", "eps_q", "p", "q"];

/// Rows and columns of tensors in the order of their components.
const COMPONENTS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]];

/// A row of a world that is periodic along all axes.
pub(super) fn row(sample: &Sample) -> Option<Raw> {
    let inside = sample.interior.as_ref()?;
    let ledger = &sample.ledger;
    let elastic = ledger.elastic_normal + ledger.elastic_tangential;
    let mut row = [0.0; RAW.len()];
    row[0] = sample.time;
    row[1] = sample.stage as f64;
    for (k, [a, b]) in COMPONENTS.into_iter().enumerate() {
        row[2 + k] = inside.strain[a][b];
        row[8 + k] = 0.5 * (inside.stress[a][b] + inside.stress[b][a]);
    }
    row[14] = inside.void_ratio;
    row[15] = inside.mechanical_coordination;
    row[16] = inside.rattlers as f64;
    row[17] = if elastic > 0.0 { (ledger.translation + ledger.rotation) / elastic } else { 0.0 };
    Some(row)
}

/// Keeps the rows of a world that is under way.
pub(super) fn keep(path: &Path, rows: &[Raw]) -> Result<(), OutputError> {
    let cells = |row: &Raw| row.map(Cell::Number).to_vec();
    write_table(path, &RAW.map(str::to_owned), &rows.iter().map(cells).collect::<Vec<_>>())
}

/// The first rows of a world that was kept, if there are so many.
pub(super) fn kept(path: &Path, rows: u64) -> Option<Vec<Raw>> {
    let series = Series::read(path).ok()?;
    if series.names != RAW || (series.rows() as u64) < rows {
        return None;
    }
    Some((0..rows as usize).map(|k| std::array::from_fn(|column| series.columns[column][k])).collect())
}

/// The curve of a sample that has ended, as columns.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    /// Simulated time since the loading began \[s\]; below 0 in the consolidation.
    pub time: Vec<f64>,
    /// 0 in the consolidation, then the stages of the loading.
    pub stage: Vec<f64>,
    /// Strain along what the program drives since the loading began: axial, of the angle, or volumetric \[-\].
    pub strain: Vec<f64>,
    /// Volumetric strain since then \[-\].
    pub eps_v: Vec<f64>,
    /// Deviatoric strain since then \[-\].
    pub eps_q: Vec<f64>,
    /// Mean stress \[Pa\].
    pub p: Vec<f64>,
    /// Deviatoric stress \[Pa\].
    pub q: Vec<f64>,
    /// Void ratio \[-\].
    pub void_ratio: Vec<f64>,
    /// Everything else, as it was kept.
    raw: Vec<Raw>,
}

impl Curve {
    /// From the rows of a world.
    pub(super) fn new(rows: &[Raw], program: Option<Program>) -> Self {
        let begins = rows.iter().rfind(|row| row[1] == 0.0).copied().unwrap_or([0.0; RAW.len()]);
        let ends = |k: usize| rows.get(k + 1).is_none_or(|next| next[1] != rows[k][1]);
        let mut curve = Self::default();
        for (k, row) in rows.iter().enumerate() {
            // A compression in steps is at rest at their ends alone.
            if program == Some(Program::IsotropicCompression) && !ends(k) {
                continue;
            }
            let mut row = *row;
            row[0] -= begins[0];
            for component in 2..8 {
                row[component] -= begins[component];
            }
            let [eps, stress] =
                [2, 8].map(|from: usize| -> [f64; 6] { std::array::from_fn(|k| row[from + k]) });
            curve.time.push(row[0]);
            curve.stage.push(row[1]);
            curve.strain.push(match program {
                Some(Program::SimpleShear) => 2.0 * eps[4],
                Some(Program::IsotropicCompression) => trace(&eps),
                _ => eps[2],
            });
            curve.eps_v.push(trace(&eps));
            curve.eps_q.push((deviator(&eps) / 1.5).sqrt());
            curve.p.push(trace(&stress) / 3.0);
            curve.q.push((1.5 * deviator(&stress)).sqrt());
            curve.void_ratio.push(row[14]);
            curve.raw.push(row);
        }
        curve
    }

    /// Rows.
    pub fn len(&self) -> usize {
        self.raw.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.raw.is_empty()
    }

    /// The rows of the loading, with the last of the consolidation.
    pub fn loading(&self) -> std::ops::Range<usize> {
        let first = self.stage.iter().rposition(|stage| *stage == 0.0).unwrap_or(0);
        first..self.len()
    }

    /// Column names of [`cells`](Self::cells).
    pub(super) fn header() -> Vec<String> {
        CURVE.iter().map(|(name, _)| (*name).to_owned()).collect()
    }

    /// A column of the loading by its name, one of [`CURVE`]; none if there is no such column.
    pub fn column(&self, name: &str) -> Option<Vec<f64>> {
        let derived = [&self.strain, &self.eps_v, &self.eps_q, &self.p, &self.q];
        let rows = self.loading();
        if let Some(k) = DERIVED.iter().position(|n| *n == name) {
            return Some(derived[k][rows].to_vec());
        }
        let k = RAW.iter().position(|n| *n == name)?;
        Some(self.raw[rows].iter().map(|row| row[k]).collect())
    }

    /// A row.
    pub(super) fn cells(&self, k: usize) -> Vec<Cell> {
        let derived = [&self.strain, &self.eps_v, &self.eps_q, &self.p, &self.q].map(|column| column[k]);
        let [before, after] = [&self.raw[k][..2], &self.raw[k][2..]];
        before.iter().chain(&derived).chain(after).map(|x| Cell::Number(*x)).collect()
    }

    /// The curve as it was written, `samples/000000.csv` and so on. None if there is no such file.
    pub fn read(path: &Path) -> Option<Self> {
        let series = Series::read(path).ok()?;
        if series.names != Self::header() {
            return None;
        }
        let column = |name: &str| series.column(name).map(<[f64]>::to_vec);
        let raw = |k: usize| {
            std::array::from_fn(|name| series.column(RAW[name]).map_or(f64::NAN, |column| column[k]))
        };
        Some(Self {
            time: column("time")?,
            stage: column("stage")?,
            strain: column("strain")?,
            eps_v: column("eps_v")?,
            eps_q: column("eps_q")?,
            p: column("p")?,
            q: column("q")?,
            void_ratio: column("void_ratio")?,
            raw: (0..series.rows()).map(raw).collect(),
        })
    }
}

fn trace(m: &[f64; 6]) -> f64 {
    m[0] + m[1] + m[2]
}

/// `s:s` of the deviator of a symmetric tensor.
fn deviator(m: &[f64; 6]) -> f64 {
    let mean = trace(m) / 3.0;
    let normal: f64 = m[..3].iter().map(|x| (x - mean).powi(2)).sum();
    normal + 2.0 * m[3..].iter().map(|x| x * x).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(time: f64, stage: f64, eps_zz: f64, stress: [f64; 6]) -> Raw {
        let mut row = [0.0; RAW.len()];
        (row[0], row[1], row[4]) = (time, stage, eps_zz);
        row[8..14].copy_from_slice(&stress);
        row
    }

    #[test]
    fn strain_and_time_begin_with_the_loading_and_q_is_that_of_the_difference() {
        let even = [1e5, 1e5, 1e5, 0.0, 0.0, 0.0];
        let rows = [
            raw(0.0, 0.0, 0.0, [0.0; 6]),
            raw(1.0, 0.0, 0.1, even),
            raw(2.0, 1.0, 0.15, [1e5, 1e5, 3e5, 0.0, 0.0, 0.0]),
        ];
        let curve = Curve::new(&rows, Some(Program::DrainedTriaxial));
        assert_eq!((curve.time[1], curve.strain[1]), (0.0, 0.0));
        assert!((curve.strain[2] - 0.05).abs() < 1e-15 && (curve.eps_v[2] - 0.05).abs() < 1e-15);
        // Of a triaxial state q = σ₁ - σ₃ and ε_q = 2/3 (ε₁ - ε₃).
        assert!((curve.q[2] - 2e5).abs() < 1e-6 && (curve.p[2] - 5e5 / 3.0).abs() < 1e-6);
        assert!((curve.eps_q[2] - 2.0 / 3.0 * 0.05).abs() < 1e-15);
        assert_eq!(curve.loading(), 1..3);
        // Shear alone: q = √3 τ.
        let sheared = Curve::new(&[raw(0.0, 0.0, 0.0, [0.0, 0.0, 0.0, 0.0, 1e4, 0.0])], None);
        assert!((sheared.q[0] - 3_f64.sqrt() * 1e4).abs() < 1e-9);
    }

    #[test]
    fn columns_are_those_of_the_table() {
        let names: Vec<&str> = RAW[..2].iter().chain(&DERIVED).chain(&RAW[2..]).copied().collect();
        assert_eq!(Curve::header(), names);
        let even = [1e5, 1e5, 1e5, 0.0, 0.0, 0.0];
        let rows = [raw(0.0, 0.0, 0.0, even), raw(1.0, 0.0, 0.1, even), raw(2.0, 1.0, 0.15, even)];
        let curve = Curve::new(&rows, Some(Program::DrainedTriaxial));
        for name in names {
            assert_eq!(curve.column(name).unwrap().len(), 2, "{name}");
        }
        assert_eq!(curve.column("time").unwrap(), [0.0, 1.0]);
        assert!(curve.column("series").is_none());
    }

    #[test]
    fn of_a_compression_in_steps_the_ends_are_kept() {
        let rows: Vec<Raw> =
            [0.0, 0.0, 1.0, 1.0, 2.0].iter().map(|stage| raw(0.0, *stage, 0.0, [0.0; 6])).collect();
        assert_eq!(Curve::new(&rows, Some(Program::IsotropicCompression)).len(), 3);
        assert_eq!(Curve::new(&rows, None).len(), 5);
    }

    #[test]
    fn rows_that_were_kept_come_back_as_they_were() {
        let folder = std::env::temp_dir().join(format!("glebe-curve-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("rows.csv");
        let rows = [raw(0.1, 0.0, 1.0 / 3.0, [1e5; 6]), raw(0.2, 1.0, 2e-17, [7.0; 6])];
        keep(&path, &rows).unwrap();
        assert_eq!(kept(&path, 2).unwrap(), rows);
        assert_eq!(kept(&path, 1).unwrap(), rows[..1]);
        assert!(kept(&path, 3).is_none(), "a file that lacks rows is none");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
