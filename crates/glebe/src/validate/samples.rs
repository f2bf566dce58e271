//! Studies of periodic samples, as `glebe rve` runs them.

use std::f64::consts::PI;

use glebe_io::output::summary::Status;
use glebe_report::{Axis, Plot, Series, Style};
use glebe_study::drive::Silent;
use glebe_study::rve::{Curve, Plan, Summary, run};

use super::case::CaseError;
use super::trial::{Folder, SceneFile, Trial, wrong};
use crate::device::admit;

/// The sand of C2 and C3.
pub const SAND: SceneFile = super::trial::scene_file!("C2-triaxial/scene.toml");
/// Radii of grains \[m\].
pub const RADII: [f64; 2] = [50e-6, 125e-6];
/// Share of the cell that grains fill before they are compressed.
pub const LOOSE: f64 = 0.47;

/// A study of samples with what is other in a quick size.
pub struct Samples<'a> {
    /// Name of the folder that keeps its results.
    pub name: &'a str,
    /// The scene.
    pub scene: &'a SceneFile,
    /// What is other in it.
    pub changes: &'a [(&'a str, &'a str)],
    /// The study.
    pub study: &'a SceneFile,
    /// What is other in it, as `--set` takes it.
    pub sets: &'a [String],
}

/// Samples that have run.
pub struct Done {
    /// What they came to.
    pub summary: Summary,
    /// The curve of each.
    pub curves: Vec<Curve>,
}

impl Samples<'_> {
    /// Runs it; every sample must be done.
    pub fn run(&self, trial: Trial<'_>) -> Result<Done, CaseError> {
        let folder = Folder::new(self.name)?;
        let scene = self.scene.with(self.changes)?;
        let study = folder.study((self.scene, &scene), self.study, self.sets, |_| Ok(()))?;
        let stopped = |how: &str| CaseError::Stopped { title: self.name.to_owned(), how: how.to_owned() };
        let plan = Plan::new(study, || false).map_err(|e| CaseError::Scene(e.to_string()))?;
        let plan = plan.ok_or_else(|| stopped("was interrupted"))?;
        for sample in &plan.samples {
            if let Err(errors) = &sample.fate {
                return Err(wrong(errors));
            }
        }
        admit(trial.backend, plan.first())?;
        let settings = trial.study(self.name);
        let summary = run(&plan, &settings, &mut Silent)?;
        if let Some(sample) = summary.samples.iter().find(|sample| sample.status != Status::Done) {
            let reason = sample.reason.as_deref().unwrap_or_default();
            return Err(stopped(&format!("has a sample that is not done: {reason}")));
        }
        let curve = |w: usize| Curve::read(&settings.out.join(format!("samples/{w:06}.csv")));
        let curves: Option<Vec<_>> = (0..summary.samples.len()).map(curve).collect();
        Ok(Done { curves: curves.ok_or_else(|| stopped("left no curve"))?, summary })
    }
}

/// The cell that so many grains, whose radii are even between two \[m\], fill to a share, as a value of `domain.max`.
pub fn cell(count: usize, [least, most]: [f64; 2], share: f64) -> String {
    let cube = 0.25 * (least + most) * (least * least + most * most);
    let side = (count as f64 * 4.0 / 3.0 * PI * cube / share).cbrt();
    format!("[{side:.6e}, {side:.6e}, {side:.6e}]")
}

/// What the sand has in the quick size: fewer grains, a fifth of the stiffness, with which steps are longer. With a
/// twentieth the sand, whose stress along the axis grows to a dozen times that across, overlapped by a third of its small
/// grains.
pub fn quick_sand() -> [(&'static str, String); 3] {
    [
        ("count = 2000", "count = 400".to_owned()),
        ("[\"2.42 mm\", \"2.42 mm\", \"2.42 mm\"]", cell(400, RADII, LOOSE)),
        ("\"4.3 GPa\"", "\"860 MPa\"".to_owned()),
    ]
}

/// What a study has in the quick size: faster loading, and a preparation at a higher pressure, where grains move faster.
pub fn quick_study() -> Vec<String> {
    vec![
        "load.inertial_number=0.01".to_owned(),
        "prepare.pressure=100e3".to_owned(),
        format!("prepare.tolerance={:?}", tolerance(true)),
    ]
}

/// How near void ratios come to their targets. Those of 400 grains scatter by a hundredth over neighbouring frictions.
pub fn tolerance(quick: bool) -> f64 {
    if quick { 0.01 } else { 0.005 }
}

/// Columns of the loading of a sample.
pub struct Loading<'a> {
    /// Axial strain.
    pub strain: &'a [f64],
    /// Volumetric strain.
    pub eps_v: &'a [f64],
    /// Mean stress \[Pa\].
    pub p: &'a [f64],
    /// Deviatoric stress \[Pa\].
    pub q: &'a [f64],
    /// Void ratio.
    pub void_ratio: &'a [f64],
}

impl<'a> Loading<'a> {
    /// Of a curve.
    pub fn of(curve: &'a Curve) -> Self {
        let rows = curve.loading();
        Self {
            strain: &curve.strain[rows.clone()],
            eps_v: &curve.eps_v[rows.clone()],
            p: &curve.p[rows.clone()],
            q: &curve.q[rows.clone()],
            void_ratio: &curve.void_ratio[rows],
        }
    }

    /// Ratio q/p, each the mean over a fiftieth of the curve, so that single rows do not count.
    pub fn ratio(&self) -> Vec<f64> {
        let half = (self.q.len() / 100).max(1);
        (0..self.q.len())
            .map(|k| {
                let rows = k.saturating_sub(half)..(k + half + 1).min(self.q.len());
                self.q[rows.clone()].iter().sum::<f64>() / self.p[rows].iter().sum::<f64>()
            })
            .collect()
    }
}

/// Mean of a column over the last tenth of its rows.
pub fn end(column: &[f64]) -> f64 {
    let last = column.len().div_ceil(10);
    super::trial::mean(column[column.len() - last..].iter().copied())
}

/// A plot of columns over columns, one curve for each name.
pub fn figure(title: &str, x: Axis, y: Axis, curves: &[(String, &[f64], Vec<f64>)]) -> String {
    let series = curves.iter().map(|(name, x, y)| Series { name, x, y, style: Style::Line });
    Plot { title, x, y, series: series.collect(), ..Plot::default() }.to_svg()
}
