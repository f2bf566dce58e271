//! What a calibration leaves: `evaluations.csv`, `summary.json`, figures, the best scenes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glebe_io::output::{Cell, OutputDir, file_word, summary, write_atomic, write_table};
use glebe_io::scene::{Scene, rewritten};
use glebe_io::study::{CALIBRATION_COLUMNS, Experiment, Quantity, Statistic, Target, Value, of_samples};
use glebe_report::{Axis, Plot, Series, Style};
use serde::Serialize;

use super::answers::{Agent, Cluster, Interval};
use super::identify::{Known, covariance, doubts, known, uncertainty};
use super::probe::Slopes;
use super::surrogate::Report;
use super::{Calibrator, End, Evaluation};
use crate::drive::Listener;
use crate::ensemble::{StudyError, short, told_once};
use crate::search::{Posterior, Search};
use crate::sweep::word;

/// The status of an evaluation by the surrogate in `evaluations.csv`.
const PREDICTED: &str = "predicted";
/// Samples that a plot of a posterior shows.
const SHOWN: usize = 400;

/// The content of a calibration's `summary.json`. Numbers that are not finite are written as `null`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Title of the calibration.
    pub title: String,
    /// Failed if the device was lost or no evaluation has a cost, interrupted if the search did not end.
    pub status: summary::Status,
    /// What happened to the device, if it was lost; worlds that it took along are left for `--resume`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// What made these results; the hash is of the calibration with all its scenes.
    pub provenance: summary::Provenance,
    /// The device that computed.
    pub device: String,
    /// How it was searched.
    pub method: &'static str,
    /// What ended the search.
    pub ended_by: &'static str,
    /// How evaluations ended.
    pub counts: Counts,
    /// The free parameters, then what follows them.
    pub parameters: Vec<Parameter>,
    /// What was to be met.
    pub targets: Vec<Wanted>,
    /// The best agents, in order.
    pub best: Vec<Agent>,
    /// The best parameters as scenes that run, by experiment.
    pub best_scenes: BTreeMap<String, PathBuf>,
    /// Arguments of `glebe` that run each experiment with them.
    pub best_runs: Vec<Vec<String>>,
    /// Clusters of good agents, the largest first.
    pub clusters: Vec<Cluster>,
    /// How well the clusters are apart: mean silhouette, -1 to 1; 0 for one cluster.
    pub silhouette: f64,
    /// How many different agents are good, and the cost up to which clusters were looked for.
    pub good: usize,
    /// That cost \[scatters\].
    pub clusters_up_to_cost: f64,
    /// What the surrogate did, if there was one, and how far off it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surrogate: Option<Report>,
    /// What a filter found, beside the parameters' intervals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posterior: Option<Posterior>,
    /// The rounds.
    pub rounds: Vec<Round>,
    /// How fast it was, since it was started or resumed.
    pub performance: summary::Performance,
    /// Wall time until the last evaluation ended, summed over all runs that this was resumed in, without what was lost when
    /// one of them was killed \[s\].
    pub computed_s: f64,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// How evaluations ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// All that ended, those around the best included.
    pub evaluations: usize,
    /// Were simulated and have a cost.
    pub done: usize,
    /// Have a cost by the surrogate.
    pub predicted: usize,
    /// Were stopped by a guard, or measured nothing.
    pub failed: usize,
    /// Could not be set up.
    pub refused: usize,
}

/// A parameter.
#[derive(Clone, Debug, Serialize)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// The value of the scene, as for `--set`.
    pub path: String,
    /// Its SI unit.
    pub unit: &'static str,
    /// Its bounds; none for what follows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f64; 2]>,
    /// Its value in the best agent.
    pub best: f64,
    /// What the targets tell of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known: Option<Known>,
    /// How the targets change over its range near the best agent, by name \[scatters\]; of curves the root mean square.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub sensitivity: BTreeMap<String, f64>,
    /// What a filter found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posterior: Option<Interval>,
}

/// A target.
#[derive(Clone, Debug, Serialize)]
pub struct Wanted {
    /// Its name.
    pub name: String,
    /// Stage, measure and number: `till.draught_force mean`; of a curve its axes: `till: sweep.draught over sweep.path`.
    pub measure: String,
    /// Its SI unit; of a curve `scatters`, and the following are of its root mean square deviation.
    pub unit: &'static str,
    /// What it should come to.
    pub value: f64,
    /// How far it may be off.
    pub scatter: f64,
    /// How much it counts.
    pub weight: f64,
    /// What it came to in the best agent.
    pub best: f64,
    /// How far it differs between simulations with next to the same parameters, as a standard deviation \[scatters\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<f64>,
}

/// A round of a search.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Round {
    /// The least cost so far.
    pub best: f64,
    /// Mean cost of those that the search goes on from and that have one, those of the surrogate included.
    pub mean: f64,
    /// How many of the round's evaluations have none.
    pub without: usize,
    /// How many of the round's evaluations are by the surrogate.
    pub predicted: usize,
    /// Of a filter, the noise scale of its posterior, in scatters of the targets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Of a filter, how wide its posterior is beside an even distribution: geometric mean over the parameters of the ratio of
    /// standard deviations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<f64>,
}

impl Round {
    pub(super) fn of(
        costs: &[f64],
        carried: &[f64],
        before: f64,
        predicted: usize,
        posterior: Option<&Posterior>,
    ) -> Self {
        let finite: Vec<f64> = carried.iter().copied().filter(|c| c.is_finite()).collect();
        Self {
            best: costs.iter().copied().fold(before, f64::min),
            mean: finite.iter().sum::<f64>() / finite.len() as f64,
            without: costs.iter().filter(|c| !c.is_finite()).count(),
            predicted,
            scale: posterior.map(|p| p.scale),
            uncertainty: posterior.map(|p| uncertainty(&p.covariance)),
        }
    }
}

impl Calibrator<'_> {
    /// Writes tables, figures, scenes and the summary.
    pub(super) fn write(
        mut self,
        dir: &OutputDir,
        search: &dyn Search,
        end: End,
        slopes: Option<&Slopes>,
        started: Instant,
        hash: &str,
        listener: &mut dyn Listener,
    ) -> Result<Summary, StudyError> {
        self.table(dir)?;
        let posterior = search.posterior().cloned();
        let known = self.known(posterior.as_ref(), slopes, listener);
        let best = self.best_agents();
        let found = self.clusters();
        self.figures(dir, posterior.as_ref())?;
        self.curves(dir)?;
        let best_scenes = if best.is_empty() { BTreeMap::new() } else { self.scenes(dir, &best[0])? };
        let mut said: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (k, e) in self.evaluations.iter().enumerate() {
            for doubt in &e.doubts {
                said.entry(doubt.clone()).or_default().push(k);
            }
        }
        self.warnings.extend(told_once(said, self.evaluations.len()));
        let surrogate = self.reported(posterior.as_ref(), listener);
        let c = &self.plan.calibration;
        let counts = self.counts();
        let wall_s = started.elapsed().as_secs_f64();
        let summary = Summary {
            title: c.title.clone(),
            status: match end {
                _ if self.ensemble.lost.is_some() => summary::Status::Failed,
                End::Open => summary::Status::Interrupted,
                _ if counts.done == 0 => summary::Status::Failed,
                _ => summary::Status::Done,
            },
            reason: self.ensemble.lost.clone(),
            provenance: summary::Provenance {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                commit: self.ensemble.settings.commit.clone(),
                scene_hash: hash.to_owned(),
                seed: c.seed,
            },
            device: self.ensemble.settings.backend.device(),
            method: c.method.name(),
            ended_by: match end {
                End::Cost => "cost",
                End::Rounds => "rounds",
                End::Evaluations => "evaluations",
                End::Stagnation => "stagnation",
                End::Open => "interruption",
            },
            counts,
            parameters: self.parameters(best.first(), known.as_deref(), slopes, posterior.as_ref()),
            targets: self.targets(best.first(), slopes),
            best_runs: self.runs(best.first(), &best_scenes),
            best,
            best_scenes,
            clusters: found.clusters,
            silhouette: found.silhouette,
            good: found.good,
            clusters_up_to_cost: found.up_to,
            surrogate,
            posterior,
            rounds: self.rounds.clone(),
            performance: summary::Performance {
                particle_steps_per_second: self.ensemble.particle_steps / wall_s,
                wall_s,
                steps: self.ensemble.steps,
                phases: BTreeMap::new(),
            },
            computed_s: self.work.rows.values().map(|row| row.seconds).sum::<f64>() + self.sampled_s,
            warnings: self.warnings,
        };
        write_atomic(&dir.summary(), |out| {
            serde_json::to_writer_pretty(&mut *out, &summary)?;
            out.write_all(b"\n")
        })?;
        Ok(summary)
    }

    /// Arguments that run each experiment with the best parameters.
    fn runs(&self, best: Option<&Agent>, scenes: &BTreeMap<String, PathBuf>) -> Vec<Vec<String>> {
        let run = |e: &Experiment| {
            let scene = scenes.get(&e.name)?;
            let Some((study, _)) = &e.samples else {
                return Some(vec!["run".to_owned(), scene.display().to_string()]);
            };
            // The study looks for its scene from its own folder.
            let scene = std::path::absolute(scene).unwrap_or_else(|_| scene.clone());
            let own = best?.set.get(&e.name).into_iter().flatten().filter(|set| of_samples(set)).cloned();
            let sets = std::iter::once(format!("scene='{}'", scene.display())).chain(own);
            let sets = sets.flat_map(|set| ["--set".to_owned(), set]);
            Some(["rve".to_owned(), study.display().to_string()].into_iter().chain(sets).collect())
        };
        self.plan.calibration.experiments.iter().filter_map(run).collect()
    }

    /// What the surrogate did, and warnings of it.
    fn reported(&mut self, posterior: Option<&Posterior>, listener: &mut dyn Listener) -> Option<Report> {
        let surrogate = self.surrogate.as_ref()?;
        let c = &self.plan.calibration;
        let report = surrogate.report(&self.evaluations, posterior, c);
        for line in surrogate.doubts(&c.targets) {
            listener.warn(&line);
            self.warnings.push(line);
        }
        Some(report)
    }

    fn counts(&self) -> Counts {
        let of = |status| self.simulated().filter(|e| e.status == status).count();
        Counts {
            evaluations: self.evaluations.len(),
            predicted: self.evaluations.iter().filter(|e| e.predicted.is_some()).count(),
            done: of(summary::Status::Done),
            failed: of(summary::Status::Failed),
            refused: of(summary::Status::Refused),
        }
    }

    /// What is known of the parameters, and warnings of those that are not determined.
    fn known(
        &mut self,
        posterior: Option<&Posterior>,
        slopes: Option<&Slopes>,
        listener: &mut dyn Listener,
    ) -> Option<Vec<Known>> {
        let c = &self.plan.calibration;
        let weights: Vec<f64> = c.targets.iter().map(|t| t.weight).collect();
        let (covariance, plain) = match (posterior, slopes) {
            (Some(p), _) => (p.covariance.clone(), None),
            (None, Some(slopes)) if slopes.finite() => {
                (covariance(&slopes.sure(&weights)), Some(covariance(&slopes.plain(&weights))))
            }
            (None, Some(_)) => {
                let line = "an evaluation near the best failed, so that it is not known how well the targets determine \
                            the parameters";
                listener.warn(line);
                self.warnings.push(line.to_owned());
                return None;
            }
            (None, None) => return None,
        };
        let names: Vec<&str> = c.free.iter().map(|f| f.name.as_str()).collect();
        let known = known(&names, &covariance, plain.as_ref());
        let mut lines = doubts(&names, &known);
        if let Some(p) = posterior.filter(|p| p.scale > 1.0) {
            lines.push(format!(
                "the posterior is that of scatters {} times as large as stated: more rounds or samples make it narrower",
                short(p.scale)
            ));
        }
        for (t, noise) in c.targets.iter().zip(slopes.map_or(&[][..], |slopes| &slopes.noise)) {
            if *noise > 1.0 {
                lines.push(format!(
                    "simulations with next to the same parameters differ in `{}` by {} of its scatters, and its scatter counts \
                     as that: take more grains, or a scatter that has the noise in it",
                    t.name,
                    short(*noise)
                ));
            }
        }
        for line in &lines {
            listener.warn(line);
        }
        self.warnings.extend(lines);
        Some(known)
    }

    fn parameters(
        &self,
        best: Option<&Agent>,
        known: Option<&[Known]>,
        slopes: Option<&Slopes>,
        posterior: Option<&Posterior>,
    ) -> Vec<Parameter> {
        let c = &self.plan.calibration;
        let value = |name: &str| best.and_then(|b| b.parameters.get(name)).copied().unwrap_or(f64::NAN);
        let free = c.free.iter().enumerate().map(|(k, f)| Parameter {
            name: f.name.clone(),
            path: f.path.clone(),
            unit: f.unit,
            bounds: Some(f.bounds),
            best: value(&f.name),
            known: known.and_then(|known| known.get(k)).cloned(),
            sensitivity: slopes.map_or_else(BTreeMap::new, |slopes| {
                c.targets
                    .iter()
                    .zip(&slopes.found)
                    .map(|(t, rows)| (t.name.clone(), steepness(rows, k)))
                    .collect()
            }),
            posterior: posterior.map(|p| self.interval(p, k)),
        });
        let following = c.followers.iter().map(|f| Parameter {
            name: f.name.clone(),
            path: f.path.clone(),
            unit: f.unit,
            bounds: None,
            best: value(&f.name),
            known: None,
            sensitivity: BTreeMap::new(),
            posterior: None,
        });
        free.chain(following).collect()
    }

    fn targets(&self, best: Option<&Agent>, slopes: Option<&Slopes>) -> Vec<Wanted> {
        let c = &self.plan.calibration;
        let wanted = |(k, t): (usize, &Target)| {
            let measure = match &t.quantity {
                Quantity::Measure { stage, measure, statistic: Statistic::Std } => {
                    format!("{stage}.{measure} std")
                }
                Quantity::Measure { stage, measure, .. } => format!("{stage}.{measure} mean"),
                Quantity::Number(name) => (*name).to_owned(),
                Quantity::Curve { stage, x, y, .. } => {
                    let stage = stage.as_ref().map_or_else(String::new, |stage| format!("{stage}: "));
                    format!("{stage}{y} over {x}")
                }
                _ => String::new(),
            };
            let number = |of: &[f64]| of.first().copied().unwrap_or(f64::NAN);
            let (value, scatter, unit) = if t.is_curve() {
                (0.0, 1.0, "scatters")
            } else {
                (number(&t.values), number(&t.scatters), t.unit)
            };
            let place = c.experiments.get(t.experiment).filter(|e| !e.name.is_empty());
            let place = place.map_or_else(String::new, |e| format!("{}: ", e.name));
            Wanted {
                name: t.name.clone(),
                measure: format!("{place}{measure}"),
                unit,
                value,
                scatter,
                weight: t.weight,
                best: best.and_then(|b| b.targets.get(&t.name)).copied().unwrap_or(f64::NAN),
                noise: slopes.map(|slopes| slopes.noise[k]),
            }
        };
        c.targets.iter().enumerate().map(wanted).collect()
    }

    fn table(&self, dir: &OutputDir) -> Result<(), StudyError> {
        let [number, round, cost, status, reason, hash] = CALIBRATION_COLUMNS;
        let c = &self.plan.calibration;
        let names = c.free.iter().map(|f| &f.name).chain(c.followers.iter().map(|f| &f.name));
        let names = names.chain(c.targets.iter().map(|t| &t.name)).cloned();
        let mut header = vec![number.to_owned(), round.to_owned()];
        header.extend(names);
        header.extend([cost, status, reason, hash].map(str::to_owned));
        let row = |(k, e): (usize, &Evaluation)| {
            let mut cells = vec![Cell::Count(k as u64), Cell::Count(e.round as u64)];
            cells.extend(e.world.values.iter().map(|value| match value {
                Value::Number(x) => Cell::Number(*x),
                Value::Whole(n) => Cell::Count(*n),
                Value::Text(_) => Cell::Text(value.shown()),
            }));
            cells.extend((0..c.targets.len()).map(|t| Cell::Number(self.shown(e, t))));
            let cost = if e.cost.is_finite() { e.cost } else { f64::NAN };
            let (status, reason) = match e.predicted {
                Some(spread) => (PREDICTED, Some(format!("cost within {}", short(spread)))),
                None => (word(e.status), e.reason.clone()),
            };
            cells.extend([
                Cell::Number(cost),
                Cell::Text(status.to_owned()),
                Cell::Text(reason.unwrap_or_default()),
                Cell::Text(e.state_hashes.join(" ").trim().to_owned()),
            ]);
            cells
        };
        let rows: Vec<Vec<Cell>> = self.evaluations.iter().enumerate().map(row).collect();
        Ok(write_table(&dir.evaluations(), &header, &rows)?)
    }

    fn figures(&self, dir: &OutputDir, posterior: Option<&Posterior>) -> Result<(), StudyError> {
        let c = &self.plan.calibration;
        let numbers: Vec<f64> = (1..=self.rounds.len()).map(|k| k as f64).collect();
        // A cost of 0 has no place on a logarithmic axis.
        let shown = |x: f64| if x > 0.0 { x } else { f64::NAN };
        let best: Vec<f64> = self.rounds.iter().map(|r| shown(r.best)).collect();
        let mean: Vec<f64> = self.rounds.iter().map(|r| shown(r.mean)).collect();
        let series = |name, y, style| Series { name, x: &numbers, y, style };
        let svg = Plot {
            title: "Cost by round",
            x: Axis::new("round", ""),
            y: Axis::new("cost", "scatters").log(),
            series: vec![series("best so far", &best, Style::Line), series("mean", &mean, Style::Dashed)],
            ..Plot::default()
        }
        .to_svg();
        dir.write_plot("convergence", &svg)?;
        let (simulated, predicted): (Vec<&Evaluation>, _) =
            self.evaluations.iter().partition(|e| e.predicted.is_none());
        let values = |of: &[&Evaluation], k: usize| -> Vec<f64> {
            of.iter().map(|e| e.world.values[k].number().unwrap_or(f64::NAN)).collect()
        };
        let costs = |of: &[&Evaluation]| of.iter().map(|e| shown(e.cost)).collect::<Vec<f64>>();
        let axis = |k: usize| {
            let free = &c.free[k];
            let axis = Axis::new(&free.name, free.unit);
            if free.logarithmic { axis.log() } else { axis }
        };
        for (k, free) in c.free.iter().enumerate() {
            let (x, y) = (values(&simulated, k), costs(&simulated));
            let (predicted_x, predicted_y) = (values(&predicted, k), costs(&predicted));
            let points = |name, x, y| Series { name, x, y, style: Style::Points };
            let mut series = vec![points("evaluations", &x, &y)];
            if !predicted.is_empty() {
                series.push(points("by the surrogate", &predicted_x, &predicted_y));
            }
            let svg = Plot {
                title: &format!("Cost over {}", free.name),
                x: axis(k),
                y: Axis::new("cost", "scatters").log(),
                series,
                ..Plot::default()
            }
            .to_svg();
            dir.write_plot(&format!("cost_over_{}", file_word(&free.name)), &svg)?;
        }
        let Some(posterior) = posterior else { return Ok(()) };
        let drawn: Vec<Vec<f64>> = posterior
            .resampled(SHOWN)
            .into_iter()
            .map(|x| self.plan.world(x).values.iter().map(|v| v.number().unwrap_or(f64::NAN)).collect())
            .collect();
        for a in 0..c.free.len() {
            for b in a + 1..c.free.len() {
                let column = |k: usize| drawn.iter().map(|x| x[k]).collect::<Vec<f64>>();
                let (x, y) = (column(a), column(b));
                let svg = Plot {
                    title: "Samples of the posterior",
                    x: axis(a),
                    y: axis(b),
                    series: vec![Series { name: "samples", x: &x, y: &y, style: Style::Points }],
                    ..Plot::default()
                }
                .to_svg();
                let [a, b] = [a, b].map(|k| file_word(&c.free[k].name));
                dir.write_plot(&format!("posterior_{a}_{b}"), &svg)?;
            }
        }
        Ok(())
    }

    /// Writes the best parameters as scenes that run.
    fn scenes(&self, dir: &OutputDir, best: &Agent) -> Result<BTreeMap<String, PathBuf>, StudyError> {
        let mut all = BTreeMap::new();
        for experiment in &self.plan.calibration.experiments {
            let from = experiment.scene.parent().unwrap_or(Path::new(""));
            let mut sets = best.set.get(&experiment.name).cloned().unwrap_or_default();
            if experiment.samples.is_some() {
                sets.retain(|set| !of_samples(set));
            }
            let said = Scene::parse("", &experiment.scene_text, &sets).is_ok_and(|s| s.throughput.is_some());
            if !said {
                // As in the study, so that it has the same bits.
                sets.push("throughput=true".to_owned());
            }
            let Some(text) = rewritten(&experiment.scene_text, &sets, from, dir.path()) else { continue };
            let name = match experiment.name.as_str() {
                "" => "best".to_owned(),
                name => format!("best_{}", file_word(name)),
            };
            let remark =
                format!("the best of {} evaluations, cost {}", self.evaluations.len(), short(best.cost));
            all.insert(experiment.name.clone(), dir.write_scene(&name, &text, &remark)?);
        }
        Ok(all)
    }
}

/// How steeply a target changes with parameter k: its slope, or the root mean square of those of a curve.
fn steepness(rows: &[Vec<f64>], k: usize) -> f64 {
    match rows {
        [row] => row[k],
        _ => (rows.iter().map(|row| row[k] * row[k]).sum::<f64>() / rows.len() as f64).sqrt(),
    }
}
