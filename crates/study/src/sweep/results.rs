//! What a sweep leaves: `worlds.csv`, plots with fits, `summary.json`.

use std::collections::BTreeMap;
use std::time::Instant;

use glebe_io::output::{Cell, OutputDir, file_word, summary, write_atomic, write_table};
use glebe_io::study::{COLUMNS, Value, Values};
use glebe_report::{Axis, Plot, Series, Style};
use serde::Serialize;

use super::{Measure, Row, StudyError, Sweep};
use crate::ensemble::{Ensemble, short, told_once};
use crate::fit::{Fit, linear, power};

/// Points by which a curve is drawn.
const CURVE: usize = 100;

/// The content of a sweep's `summary.json`. Numbers that are not finite are written as `null`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Title of the study.
    pub title: String,
    /// Failed if the device was lost or no world is done, interrupted if worlds are left.
    pub status: summary::Status,
    /// What happened to the device, if it was lost; worlds that it took along are left for `--resume`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// What made these results; the hash is of all worlds.
    pub provenance: summary::Provenance,
    /// The device that computed.
    pub device: String,
    /// How worlds were chosen.
    pub sampler: &'static str,
    /// What varied, and what followed it.
    pub parameters: Vec<Named>,
    /// What was measured, with curves through it.
    pub measures: Vec<Measured>,
    /// How the worlds ended.
    pub counts: Counts,
    /// The worlds.
    pub worlds: Vec<WorldSummary>,
    /// How fast it was, since it was started or resumed.
    pub performance: summary::Performance,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A value of the scene that varied.
#[derive(Clone, Debug, Serialize)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// The value, as for `--set`.
    pub path: String,
    /// Its SI unit.
    pub unit: &'static str,
}

/// A number that worlds measured.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// Which.
    #[serde(flatten)]
    pub measure: Measure,
    /// Curves of its mean over each parameter that is a number and varied.
    pub fits: Vec<Fitted>,
}

/// Curves through results.
#[derive(Clone, Debug, Serialize)]
pub struct Fitted {
    /// The parameter.
    pub parameter: String,
    /// How many worlds they go through.
    pub worlds: usize,
    /// `y = a + b x`
    pub linear: Option<Fit>,
    /// `y = a x^b`, where all values are above 0.
    pub power: Option<Fit>,
}

/// How many worlds ended how.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// All.
    pub worlds: usize,
    /// Went through all their stages.
    pub done: usize,
    /// Were stopped by a guard.
    pub failed: usize,
    /// Could not be set up.
    pub refused: usize,
    /// Are left for `--resume`.
    pub interrupted: usize,
}

impl Counts {
    /// Of worlds that ended so.
    pub(crate) fn of(statuses: impl IntoIterator<Item = summary::Status>) -> Self {
        let mut counts = Self::default();
        for status in statuses {
            counts.worlds += 1;
            *match status {
                summary::Status::Done => &mut counts.done,
                summary::Status::Failed => &mut counts.failed,
                summary::Status::Refused => &mut counts.refused,
                _ => &mut counts.interrupted,
            } += 1;
        }
        counts
    }

    /// How a study stands, whose device was lost or not.
    pub(crate) fn status(self, lost: bool) -> summary::Status {
        match self {
            _ if lost => summary::Status::Failed,
            Self { interrupted: 1.., .. } => summary::Status::Interrupted,
            Self { done: 0, .. } => summary::Status::Failed,
            _ => summary::Status::Done,
        }
    }
}

/// A world of the summary.
#[derive(Clone, Debug, Serialize)]
pub struct WorldSummary {
    /// Its number.
    pub world: usize,
    /// The arguments of `--set` by which `glebe run` of the scene gives the same world.
    pub set: Vec<String>,
    /// How it ended.
    pub status: summary::Status,
    /// Why it is not done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Digest of its final state.
    pub state_hash: Option<String>,
    /// The stages that ended.
    pub stages: Vec<summary::Stage>,
}

impl Sweep<'_> {
    /// Writes table, plots and summary.
    pub(super) fn write(
        self,
        ensemble: &Ensemble<'_>,
        started: Instant,
        mut warnings: Vec<String>,
        hash: &str,
    ) -> Result<Summary, StudyError> {
        let (study, dir) = (&self.plan.study, &ensemble.dir);
        let why = ensemble.lost.clone().unwrap_or_else(|| "stopped by the user".to_owned());
        let left = |w| Row::not_run(w, summary::Status::Interrupted, why.clone());
        let rows: Vec<Row> = (0..self.plan.worlds.len())
            .map(|w| self.rows.get(&w).cloned().unwrap_or_else(|| left(w)))
            .collect();
        self.table(dir, &rows)?;
        let counts = Counts::of(rows.iter().map(|row| row.status));
        let mut measures = Vec::new();
        for measure in &self.plan.measures {
            let mut fits = Vec::new();
            for k in 0..study.parameters.len() {
                fits.extend(self.fitted(dir, k, measure, &rows)?);
            }
            measures.push(Measured { measure: measure.clone(), fits });
        }
        let mut said: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for row in &rows {
            for doubt in &row.doubts {
                said.entry(doubt.clone()).or_default().push(row.world);
            }
        }
        warnings.extend(told_once(said, rows.len()));
        let followers = study.followers.iter().map(|f| (&f.name, &f.path, f.unit));
        let parameters = study.parameters.iter().map(|p| (&p.name, &p.path, p.unit)).chain(followers);
        let wall_s = started.elapsed().as_secs_f64();
        let summary = Summary {
            title: study.title.clone(),
            status: counts.status(ensemble.lost.is_some()),
            reason: ensemble.lost.clone(),
            provenance: summary::Provenance {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                commit: ensemble.settings.commit.clone(),
                scene_hash: hash.to_owned(),
                seed: study.seed,
            },
            device: ensemble.settings.backend.device(),
            sampler: study.sampler.name(),
            parameters: parameters
                .map(|(name, path, unit)| Named { name: name.clone(), path: path.clone(), unit })
                .collect(),
            measures,
            counts,
            worlds: rows
                .into_iter()
                .zip(&self.plan.worlds)
                .map(|(row, planned)| WorldSummary {
                    world: row.world,
                    set: planned.world.sets.clone(),
                    status: row.status,
                    reason: row.reason,
                    state_hash: row.state_hash,
                    stages: row.stages,
                })
                .collect(),
            performance: summary::Performance {
                particle_steps_per_second: ensemble.particle_steps / wall_s,
                wall_s,
                steps: ensemble.steps,
                phases: BTreeMap::new(),
            },
            warnings,
        };
        write_atomic(&dir.summary(), |out| {
            serde_json::to_writer_pretty(&mut *out, &summary)?;
            out.write_all(b"\n")
        })?;
        Ok(summary)
    }

    fn table(&self, dir: &OutputDir, rows: &[Row]) -> Result<(), StudyError> {
        let [world, ends @ ..] = COLUMNS;
        let (study, measures) = (&self.plan.study, &self.plan.measures);
        let mut header = vec![world.to_owned()];
        header.extend(study.parameters.iter().map(|p| p.name.clone()));
        header.extend(study.followers.iter().map(|f| f.name.clone()));
        header.extend(
            measures.iter().flat_map(|m| ["mean", "std", "n"].map(|x| format!("{}.{x}", m.full_name()))),
        );
        header.extend(ends.map(str::to_owned));
        let cells = |row: &Row| {
            let mut cells = vec![Cell::Count(row.world as u64)];
            cells.extend(self.plan.worlds[row.world].world.values.iter().map(|value| match value {
                Value::Number(x) => Cell::Number(*x),
                Value::Whole(n) => Cell::Count(*n),
                Value::Text(_) => Cell::Text(value.shown()),
            }));
            for measure in measures {
                let m = row.measured(&measure.stage, &measure.name);
                let m = m.unwrap_or(summary::Measure { mean: f64::NAN, std: f64::NAN, n: 0 });
                cells.extend([Cell::Number(m.mean), Cell::Number(m.std), Cell::Count(m.n)]);
            }
            cells.extend([
                Cell::Count(row.particles),
                Cell::Count(row.lost),
                Cell::Text(word(row.status).to_owned()),
            ]);
            let text = |text: &Option<String>| Cell::Text(text.clone().unwrap_or_default());
            cells.extend([text(&row.reason), text(&row.state_hash)]);
            cells
        };
        Ok(write_table(&dir.worlds(), &header, &rows.iter().map(cells).collect::<Vec<_>>())?)
    }

    /// The curves of a measure over a parameter, if that is a number which varies, and their plot.
    fn fitted(
        &self,
        dir: &OutputDir,
        parameter: usize,
        measure: &Measure,
        rows: &[Row],
    ) -> Result<Option<Fitted>, StudyError> {
        let p = &self.plan.study.parameters[parameter];
        let point = |row: &Row| {
            let x = self.plan.worlds[row.world].world.values.get(parameter)?.number()?;
            let done = row.status == summary::Status::Done;
            row.measured(&measure.stage, &measure.name).filter(|m| done && m.n > 0).map(|m| (x, m.mean))
        };
        let (x, y): (Vec<f64>, Vec<f64>) = rows.iter().filter_map(point).unzip();
        let [low, high] = [f64::min, f64::max].map(|f: fn(f64, f64) -> f64| x.iter().copied().reduce(f));
        let (Some(low), Some(high)) = (low, high) else { return Ok(None) };
        if low == high {
            return Ok(None);
        }
        let (line, law) = (linear(&x, &y), power(&x, &y));
        let logarithmic = matches!(p.values, Values::Range { logarithmic: true, .. });
        let along: Vec<f64> = (0..=CURVE)
            .map(|k| {
                let share = k as f64 / CURVE as f64;
                if logarithmic { low * (high / low).powf(share) } else { low + share * (high - low) }
            })
            .collect();
        let told_line = |f: Fit| {
            let sign = if f.b < 0.0 { '-' } else { '+' };
            format!("{} {sign} {} x, R² {:.4}", short(f.a), short(f.b.abs()), f.r2)
        };
        let told_power = |f: Fit| format!("{} x^{:.3}, R² {:.4}", short(f.a), f.b, f.r2);
        let curves = [
            line.map(|f| (told_line(f), of(&along, |x| f.a + f.b * x))),
            law.map(|f| (told_power(f), of(&along, |x| f.a * x.powf(f.b)))),
        ];
        let styles = [Style::Line, Style::Dashed];
        let mut series = vec![Series { name: "worlds", x: &x, y: &y, style: Style::Points }];
        series.extend(curves.iter().zip(styles).filter_map(|(curve, style)| {
            let (name, y) = curve.as_ref()?;
            Some(Series { name, x: &along, y, style })
        }));
        let across = Axis::new(&p.name, p.unit);
        let svg = Plot {
            title: &format!("{} over {}", measure.full_name(), p.name),
            x: if logarithmic { across.log() } else { across },
            y: Axis::new(&measure.name, measure.unit),
            series,
            ..Plot::default()
        }
        .to_svg();
        let [stage, name, over] = [&measure.stage, &measure.name, &p.name].map(|n| file_word(n));
        dir.write_plot(&format!("{stage}_{name}_over_{over}"), &svg)?;
        Ok(Some(Fitted { parameter: p.name.clone(), worlds: x.len(), linear: line, power: law }))
    }
}

fn of(x: &[f64], curve: impl Fn(f64) -> f64) -> Vec<f64> {
    x.iter().map(|x| curve(*x)).collect()
}

/// How a status is written in tables.
pub(crate) fn word(status: summary::Status) -> &'static str {
    match status {
        summary::Status::Done => "done",
        summary::Status::Failed => "failed",
        summary::Status::Refused => "refused",
        _ => "interrupted",
    }
}
