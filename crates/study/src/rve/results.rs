//! What a study of samples leaves: tables, plots, `summary.json`.

use std::collections::BTreeMap;
use std::time::Instant;

use glebe_io::output::columns::SAMPLE_NUMBERS;
use glebe_io::output::{Cell, summary, write_atomic, write_table};
use glebe_io::study::{Program, Value};
use glebe_report::{Axis, Band, Plot, Series, Style, rose};
use serde::Serialize;

use super::curve::Curve;
use super::fabric::{BINS, chi_square};
use super::statistics::{AVERAGED, Average, Spread};
use super::{Consolidated, Row, Samples, StudyError};
use crate::sweep::word;
pub use crate::sweep::{Counts, Named};

/// Variants up to which a plot names each.
const MOST_NAMED: usize = 12;

/// The content of the `summary.json` of a study of samples. Numbers that are not finite are written as `null`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Title of the study.
    pub title: String,
    /// Failed if the device was lost or no sample is done, interrupted if samples are left.
    pub status: summary::Status,
    /// What happened to the device, if it was lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// What made these results; the hash is of all samples.
    pub provenance: summary::Provenance,
    /// The device that computed.
    pub device: String,
    /// What varied.
    pub parameters: Vec<Named>,
    /// How the samples ended.
    pub counts: Counts,
    /// The samples.
    pub samples: Vec<SampleSummary>,
    /// The variants.
    pub variants: Vec<VariantSummary>,
    /// How fast it was, since it was started or resumed.
    pub performance: summary::Performance,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A sample of the summary.
#[derive(Clone, Debug, Serialize)]
pub struct SampleSummary {
    /// Its number.
    pub sample: usize,
    /// That of its variant.
    pub variant: usize,
    /// How it ended.
    pub status: summary::Status,
    /// Why it is not done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Digest of its final state.
    pub state_hash: Option<String>,
    /// Friction with which it was made.
    pub friction: Option<f64>,
    /// Void ratio that this gave.
    pub void_ratio: Option<f64>,
    /// At the end of its consolidation.
    pub consolidated: Option<Consolidated>,
}

/// A variant of the summary: means and scatter over its samples that are done.
#[derive(Clone, Debug, Serialize)]
pub struct VariantSummary {
    /// What varies, with its values.
    pub name: String,
    /// Arguments of `--set` that make it of the study and its scene.
    pub set: Vec<String>,
    /// Particles of a sample.
    pub particles: usize,
    /// Friction of the preparation.
    pub friction: Spread,
    /// Void ratio after the consolidation.
    pub void_ratio: Spread,
    /// Mechanical coordination number after it.
    pub coordination: Spread,
    /// Mean stress after it \[Pa\].
    pub p: Spread,
    /// χ² of contact orientations after it, in the planes of x and y and of x and z.
    pub chi_square: [Spread; 2],
    /// The same over the number of contacts, which falls with the number of particles.
    pub chi_square_per_contact: Spread,
    /// Largest ratio q/p of the loading.
    pub peak_ratio: Spread,
    /// Strain at which it is reached.
    pub peak_strain: Spread,
    /// Ratio q/p at the end.
    pub last_ratio: Spread,
    /// Void ratio at the end.
    pub last_void_ratio: Spread,
    /// Volumetric strain at the end.
    pub last_eps_v: Spread,
}

/// What a sample came to.
pub(crate) struct Outcome {
    pub(crate) row: Row,
    pub(crate) curve: Option<Curve>,
}

impl Outcome {
    fn done(&self) -> bool {
        self.row.status == summary::Status::Done
    }

    fn consolidated(&self) -> Option<&Consolidated> {
        self.row.consolidated.as_ref()
    }

    /// Ratios of q to p in the loading, with their rows.
    fn ratios(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let loading = self.curve.iter().flat_map(|curve| curve.loading().map(move |k| (curve, k)));
        loading.filter(|(curve, _)| curve.loading().len() > 1).map(|(curve, k)| (k, curve.q[k] / curve.p[k]))
    }

    fn peak(&self) -> Option<(usize, f64)> {
        self.ratios().filter(|(_, x)| x.is_finite()).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn last(&self, read: impl Fn(&Curve) -> &[f64]) -> Option<f64> {
        self.curve.as_ref().filter(|curve| curve.loading().len() > 1).and_then(|c| read(c).last().copied())
    }

    /// One of [`SAMPLE_NUMBERS`].
    pub(crate) fn number(&self, name: &str) -> Option<f64> {
        let of = |read: fn(&Consolidated) -> f64| self.consolidated().map(read);
        let peak = || self.peak().zip(self.curve.as_ref());
        match name {
            "prepared.friction" => self.row.made.map(|m| m[0]),
            "prepared.void_ratio" => self.row.made.map(|m| m[1]),
            "consolidated.void_ratio" => of(|c| c.void_ratio),
            "consolidated.coordination" => of(|c| c.coordination),
            "consolidated.p" => of(|c| c.p),
            "consolidated.q" => of(|c| c.q),
            "consolidated.chi_square_xy" => of(|c| chi_square(&c.orientations.xy)),
            "consolidated.chi_square_xz" => of(|c| chi_square(&c.orientations.xz)),
            "peak.q_over_p" => self.peak().map(|(_, ratio)| ratio),
            "peak.strain" => peak().map(|((k, _), curve)| curve.strain[k]),
            "last.q_over_p" => self.ratios().last().map(|(_, ratio)| ratio),
            "last.p" => self.last(|c| &c.p),
            "last.q" => self.last(|c| &c.q),
            "last.void_ratio" => self.last(|c| &c.void_ratio),
            "last.eps_v" => self.last(|c| &c.eps_v),
            _ => None,
        }
    }
}

impl Samples<'_> {
    /// What the samples came to, with their curves.
    pub(crate) fn outcomes(&mut self) -> Vec<Outcome> {
        let why = self.ensemble.lost.clone().unwrap_or_else(|| "stopped by the user".to_owned());
        let outcome = |w: usize| {
            let left = || Row::without(w, summary::Status::Interrupted, why.clone());
            let row = self.rows.remove(&w).unwrap_or_else(left);
            let curve = row.state_hash.as_ref().and_then(|_| Curve::read(&self.ensemble.dir.sample(w)));
            Outcome { row, curve }
        };
        (0..self.plan.samples.len()).map(outcome).collect()
    }

    /// Writes tables, plots and summary.
    pub(super) fn write(
        mut self,
        started: Instant,
        warnings: Vec<String>,
        hash: &str,
    ) -> Result<Summary, StudyError> {
        let plan = self.plan;
        let outcomes = self.outcomes();
        self.table(&outcomes)?;
        self.curves(&outcomes)?;
        let of_variant = |v: usize| -> Vec<&Outcome> {
            let all = plan.samples.iter().zip(&outcomes);
            all.filter(|(sample, outcome)| sample.variant == v && outcome.done()).map(|(_, o)| o).collect()
        };
        let groups: Vec<Vec<&Outcome>> = (0..plan.variants.len()).map(of_variant).collect();
        let variants: Vec<VariantSummary> =
            groups.iter().enumerate().map(|(v, group)| self.variant(v, group)).collect();
        self.homogenisation(&variants)?;
        self.averages(&groups)?;
        self.roses(&groups)?;
        let counts = counts(&outcomes);
        let study = &plan.study;
        let followers = study.followers.iter().map(|f| (&f.name, &f.path, f.unit));
        let parameters = study.parameters.iter().map(|p| (&p.name, &p.path, p.unit)).chain(followers);
        let wall_s = started.elapsed().as_secs_f64();
        let summary = Summary {
            title: study.title.clone(),
            status: counts.status(self.ensemble.lost.is_some()),
            reason: self.ensemble.lost.clone(),
            provenance: summary::Provenance {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                commit: self.ensemble.settings.commit.clone(),
                scene_hash: hash.to_owned(),
                seed: study.seed,
            },
            device: self.ensemble.settings.backend.device(),
            parameters: parameters
                .map(|(name, path, unit)| Named { name: name.clone(), path: path.clone(), unit })
                .collect(),
            counts,
            samples: outcomes
                .into_iter()
                .zip(&plan.samples)
                .map(|(Outcome { row, .. }, planned)| SampleSummary {
                    sample: row.sample,
                    variant: planned.variant,
                    status: row.status,
                    reason: row.reason,
                    state_hash: row.state_hash,
                    friction: row.made.map(|m| m[0]),
                    void_ratio: row.made.map(|m| m[1]),
                    consolidated: row.consolidated,
                })
                .collect(),
            variants,
            performance: summary::Performance {
                particle_steps_per_second: self.ensemble.particle_steps / wall_s,
                wall_s,
                steps: self.ensemble.steps,
                phases: BTreeMap::new(),
            },
            warnings,
        };
        write_atomic(&self.ensemble.dir.summary(), |out| {
            serde_json::to_writer_pretty(&mut *out, &summary)?;
            out.write_all(b"\n")
        })?;
        Ok(summary)
    }

    /// `worlds.csv`: a row for each sample.
    fn table(&self, outcomes: &[Outcome]) -> Result<(), StudyError> {
        let (plan, study) = (self.plan, &self.plan.study);
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let mut header = names(&["world", "variant", "seed"]);
        header.extend(study.parameters.iter().map(|p| p.name.clone()));
        header.extend(study.followers.iter().map(|f| f.name.clone()));
        header.push("particles".to_owned());
        header.extend(SAMPLE_NUMBERS.iter().map(|(name, _)| (*name).to_owned()));
        header.extend(names(&["status", "reason", "state_hash"]));
        let number = |x: Option<f64>| Cell::Number(x.unwrap_or(f64::NAN));
        let cells = |w: usize, outcome: &Outcome| {
            let (sample, row) = (&plan.samples[w], &outcome.row);
            let facts = sample.fate.as_ref().ok();
            let seed = facts.map_or_else(|| Cell::Text(String::new()), |f| Cell::Count(f.seed));
            let mut cells = vec![Cell::Count(w as u64), Cell::Count(sample.variant as u64), seed];
            cells.extend(plan.variants[sample.variant].values.iter().map(|value| match value {
                Value::Number(x) => Cell::Number(*x),
                Value::Whole(n) => Cell::Count(*n),
                Value::Text(_) => Cell::Text(value.shown()),
            }));
            cells.push(Cell::Count(facts.map_or(0, |f| f.particles as u64)));
            cells.extend(SAMPLE_NUMBERS.iter().map(|(name, _)| number(outcome.number(name))));
            cells.push(Cell::Text(word(row.status).to_owned()));
            let text = |text: &Option<String>| Cell::Text(text.clone().unwrap_or_default());
            cells.extend([text(&row.reason), text(&row.state_hash)]);
            cells
        };
        let rows: Vec<_> = outcomes.iter().enumerate().map(|(w, outcome)| cells(w, outcome)).collect();
        Ok(write_table(&self.ensemble.dir.worlds(), &header, &rows)?)
    }

    /// `curves.csv`: the curves of all samples, one after the other.
    fn curves(&self, outcomes: &[Outcome]) -> Result<(), StudyError> {
        let mut header = vec!["world".to_owned(), "variant".to_owned()];
        header.extend(Curve::header());
        let mut rows = Vec::new();
        for (w, outcome) in outcomes.iter().enumerate() {
            let Some(curve) = &outcome.curve else { continue };
            let before = [w, self.plan.samples[w].variant].map(|n| Cell::Count(n as u64));
            rows.extend((0..curve.len()).map(|k| [before.to_vec(), curve.cells(k)].concat()));
        }
        Ok(write_table(&self.ensemble.dir.table("curves"), &header, &rows)?)
    }

    fn variant(&self, v: usize, group: &[&Outcome]) -> VariantSummary {
        let made = |at: usize| group.iter().filter_map(move |o| o.row.made.map(|m| m[at]));
        let of = |read: fn(&Consolidated) -> f64| {
            Spread::of(group.iter().filter_map(|o| o.consolidated().map(read)))
        };
        let peak = || group.iter().filter_map(|o| Some((o.curve.as_ref()?, o.peak()?)));
        let last = |read: fn(&Curve) -> &[f64]| Spread::of(group.iter().filter_map(|o| o.last(read)));
        let facts = self.plan.samples.iter().filter(|s| s.variant == v).find_map(|s| s.fate.as_ref().ok());
        VariantSummary {
            name: self.plan.name(v),
            set: self.plan.variants[v].sets.clone(),
            particles: facts.map_or(0, |f| f.particles),
            friction: Spread::of(made(0)),
            void_ratio: of(|c| c.void_ratio),
            coordination: of(|c| c.coordination),
            p: of(|c| c.p),
            chi_square: [of(|c| chi_square(&c.orientations.xy)), of(|c| chi_square(&c.orientations.xz))],
            chi_square_per_contact: of(|c| {
                let contacts: u32 = c.orientations.xy.iter().sum();
                chi_square(&c.orientations.xy) / f64::from(contacts)
            }),
            peak_ratio: Spread::of(peak().map(|(_, (_, ratio))| ratio)),
            peak_strain: Spread::of(peak().map(|(curve, (k, _))| curve.strain[k])),
            last_ratio: Spread::of(group.iter().filter_map(|o| o.ratios().last().map(|(_, ratio)| ratio))),
            last_void_ratio: last(|c| &c.void_ratio),
            last_eps_v: last(|c| &c.eps_v),
        }
    }

    /// `homogenisation.csv`: how consolidated samples of a variant scatter; plots over the number of particles, if that
    /// varies.
    fn homogenisation(&self, variants: &[VariantSummary]) -> Result<(), StudyError> {
        let mut header = vec!["variant".to_owned(), "particles".to_owned(), "samples".to_owned()];
        type Read = fn(&VariantSummary) -> Spread;
        let named: [(&str, Read); 6] = [
            ("void_ratio", |v| v.void_ratio),
            ("coordination", |v| v.coordination),
            ("p", |v| v.p),
            ("chi_square_xy", |v| v.chi_square[0]),
            ("chi_square_xz", |v| v.chi_square[1]),
            ("chi_square_per_contact", |v| v.chi_square_per_contact),
        ];
        header.extend(named.iter().flat_map(|(name, _)| ["mean", "std"].map(|x| format!("{name}.{x}"))));
        let cells = |(k, v): (usize, &VariantSummary)| {
            let mut cells = [k, v.particles, v.void_ratio.n].map(|count| Cell::Count(count as u64)).to_vec();
            cells.extend(named.iter().flat_map(|(_, read)| {
                let spread = read(v);
                [Cell::Number(spread.mean), Cell::Number(spread.std)]
            }));
            cells
        };
        let rows: Vec<_> = variants.iter().enumerate().map(cells).collect();
        write_table(&self.ensemble.dir.table("homogenisation"), &header, &rows)?;

        let mut by_size: Vec<&VariantSummary> = variants.iter().filter(|v| v.void_ratio.n > 1).collect();
        by_size.sort_by_key(|v| v.particles);
        by_size.dedup_by_key(|v| v.particles);
        if by_size.len() < 2 {
            return Ok(());
        }
        let x: Vec<f64> = by_size.iter().map(|v| v.particles as f64).collect();
        let column =
            |read: &dyn Fn(&VariantSummary) -> f64| by_size.iter().map(|v| read(v)).collect::<Vec<_>>();
        let scatter = [
            ("void ratio", column(&|v| 100.0 * v.void_ratio.relative())),
            ("coordination", column(&|v| 100.0 * v.coordination.relative())),
            ("mean stress", column(&|v| 100.0 * v.p.relative())),
        ];
        let particles = || Axis::new("particles", "");
        let svg = Plot {
            title: "Scatter over seeds after consolidation",
            x: particles(),
            y: Axis::new("standard deviation over mean", "%").from_zero(),
            series: series(&x, &scatter),
            ..Plot::default()
        }
        .to_svg();
        self.ensemble.dir.write_plot("scatter_over_particles", &svg)?;
        let inverse = [
            ("x-y", column(&|v| 1.0 / v.chi_square[0].mean)),
            ("x-z", column(&|v| 1.0 / v.chi_square[1].mean)),
            ("1 over that of independent directions", vec![1.0 / (BINS as f64 - 1.0); x.len()]),
        ];
        let svg = Plot {
            title: "1/χ² of contact orientations over 36 bins",
            x: particles(),
            y: Axis::new("1/χ²", "").from_zero(),
            series: series(&x, &inverse),
            ..Plot::default()
        }
        .to_svg();
        Ok(self.ensemble.dir.write_plot("chi_square_over_particles", &svg)?)
    }

    /// `bands.csv` and the plots of curves: of each variant the mean of its samples, with a band of one standard
    /// deviation where there are several.
    fn averages(&self, groups: &[Vec<&Outcome>]) -> Result<(), StudyError> {
        let mut header = vec!["variant".to_owned(), "samples".to_owned()];
        header.extend(AVERAGED.iter().flat_map(|(name, _)| ["mean", "std"].map(|x| format!("{name}.{x}"))));
        let mut rows = Vec::new();
        let mut shown = Vec::new();
        for (v, group) in groups.iter().enumerate() {
            let curves: Vec<&Curve> =
                group.iter().filter_map(|o| o.curve.as_ref()).filter(|c| c.loading().len() > 1).collect();
            if curves.is_empty() {
                continue;
            }
            let average = Average::of(&curves);
            for k in 0..average.columns[0].len() {
                let mut cells = vec![Cell::Count(v as u64), Cell::Count(curves.len() as u64)];
                let spreads = average.columns.iter().filter_map(|column| column.get(k));
                cells.extend(spreads.flat_map(|s| [Cell::Number(s.mean), Cell::Number(s.std)]));
                rows.push(cells);
            }
            shown.push((self.plan.name(v), curves.len(), average));
        }
        write_table(&self.ensemble.dir.table("bands"), &header, &rows)?;
        if shown.is_empty() {
            return Ok(());
        }
        let programs = self.plan.samples.iter().filter_map(|s| s.fate.as_ref().ok()?.rve.load);
        let sheared = programs.clone().all(|load| load.program == Program::SimpleShear);
        let stepped = programs.clone().all(|load| load.program == Program::IsotropicCompression);
        let strain = if sheared {
            "shear strain"
        } else if stepped {
            "volumetric strain"
        } else {
            "axial strain"
        };
        let strain = || Axis::new(strain, "");
        let plots = [
            ("q_over_strain", "strain", strain(), "q", Axis::new("q", "Pa").from_zero()),
            ("volumetric_strain", "strain", strain(), "eps_v", Axis::new("volumetric strain", "")),
            ("void_ratio_over_strain", "strain", strain(), "void_ratio", Axis::new("void ratio", "")),
            ("q_over_p", "p", Axis::new("p", "Pa"), "q", Axis::new("q", "Pa").from_zero()),
            (
                "void_ratio_over_log_p",
                "p",
                Axis::new("p", "Pa").log(),
                "void_ratio",
                Axis::new("void ratio", ""),
            ),
        ];
        for (file, across, x, up, y) in plots {
            let curves: Vec<_> = shown
                .iter()
                .map(|(name, samples, average)| {
                    let band = (*samples > 1 && across == "strain").then(|| average.band(up));
                    (name, average.means(across), average.means(up), band)
                })
                .collect();
            let named = curves.len() <= MOST_NAMED;
            let svg = Plot {
                title: &self.plan.study.title,
                x,
                y,
                series: curves
                    .iter()
                    .map(|(name, x, y, _)| {
                        let name = if named { name.as_str() } else { "" };
                        Series { name, x, y, style: Style::Line }
                    })
                    .collect(),
                bands: curves
                    .iter()
                    .enumerate()
                    .filter_map(|(of, (_, x, _, band))| {
                        let [low, high] = band.as_ref()?;
                        Some(Band { of, x, low, high })
                    })
                    .collect(),
                ..Plot::default()
            }
            .to_svg();
            self.ensemble.dir.write_plot(file, &svg)?;
        }
        Ok(())
    }

    /// A rose diagram of each variant: its contacts after the consolidation, all samples together.
    fn roses(&self, groups: &[Vec<&Outcome>]) -> Result<(), StudyError> {
        for (v, group) in groups.iter().enumerate() {
            let all = || group.iter().filter_map(|o| o.consolidated());
            if all().next().is_none() {
                continue;
            }
            let sum = |read: fn(&Consolidated) -> &[u32]| -> Vec<f64> {
                let half = BINS / 2;
                // A contact is a line, which points both ways.
                (0..BINS)
                    .map(|k| {
                        all().map(|c| f64::from(read(c)[k]) + f64::from(read(c)[(k + half) % BINS])).sum()
                    })
                    .collect()
            };
            let planes = [("x-y", sum(|c| &c.orientations.xy)), ("x-z", sum(|c| &c.orientations.xz))];
            let name = self.plan.name(v);
            let title = if name.is_empty() {
                "Contact orientations".to_owned()
            } else {
                format!("Contact orientations: {name}")
            };
            let planes: Vec<(&str, &[f64])> =
                planes.iter().map(|(n, counts)| (*n, counts.as_slice())).collect();
            self.ensemble.dir.write_plot(&format!("rose_{v:03}"), &rose(&title, &planes))?;
        }
        Ok(())
    }
}

fn series<'a>(x: &'a [f64], columns: &'a [(&'a str, Vec<f64>)]) -> Vec<Series<'a>> {
    columns.iter().map(|(name, y)| Series { name, x, y, style: Style::Line }).collect()
}

fn counts(outcomes: &[Outcome]) -> Counts {
    Counts::of(outcomes.iter().map(|outcome| outcome.row.status))
}
