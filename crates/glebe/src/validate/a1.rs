//! Deposition of spheres in a box (Nagy et al. 2024, section 3.1, figure 4, table B.5 column 1).
//!
//! The paper's: box, material, step 1e-4 s with `exact`, 8519 spheres of 40 ± 12 mm. Its 509 spheres of
//! 200 ± 60 mm do not fit the box, so they are 100 ± 30 mm here. Chosen: the starting cloud (at rest,
//! solid fraction 0.3; the paper has none), the limits on what is left of the energies (the paper:
//! "approaches zero", "converges to a constant value"), and the energy ledger, which is judged with
//! `euler` at 50 steps per collision (2e-5 s, for a fall from 2.8 m) on the 509 spheres, in full size on
//! the 8519 as well.
//!
//! The 509 spheres are four beds, which differ by their seed: late on, most of a bed's kinetic energy is that of a few
//! spheres that still roll or drop, so that one bed's need not fall over half a second. Of twelve beds one did not
//! from 1.0 to 1.5 s; all had less than 1e-3 of their peak left at 1.5 s. Every bed is held to the limits on what is
//! left, and their mean must fall.

use std::ops::Range;

use glebe_engine::batch::Sample;
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{Finished, SceneFile, Trial, kinetic, largest, peak_kinetic, run_to_end, scene_file};
use glebe_study::fit::line;

pub(super) const CASE: Case = Case {
    id: "A1",
    name: "deposition",
    shows: "spheres that fall into a box come to rest, none is lost, and every joule is accounted for",
    source: "Nagy et al. 2024 (GPUDEM), section 3.1, figure 4, table B.5 column 1",
    run,
};

const SCENE: SceneFile = scene_file!("A1-deposition/scene.toml");
/// Time before the end over which the potential energy must not change \[s\].
const END: f64 = 0.1;
/// Time before the end over which the kinetic energy must fall \[s\].
const TREND: f64 = 0.5;
/// Beds of 509 spheres.
const BEDS: u64 = 4;

struct Variant {
    name: &'static str,
    large: bool,
    integrator: &'static str,
    /// \[s\]
    step: f64,
    /// Whether the quick size has it.
    quick: bool,
    /// Whether its energy must be accounted for.
    closes: bool,
}

const VARIANTS: [Variant; 6] = [
    Variant { name: "8519_euler", large: false, integrator: "euler", step: 1e-4, quick: true, closes: false },
    Variant { name: "8519_exact", large: false, integrator: "exact", step: 1e-4, quick: true, closes: false },
    Variant { name: "509_euler", large: true, integrator: "euler", step: 1e-4, quick: true, closes: false },
    Variant { name: "509_exact", large: true, integrator: "exact", step: 1e-4, quick: true, closes: false },
    Variant {
        name: "509_euler_fine",
        large: true,
        integrator: "euler",
        step: 2e-5,
        quick: true,
        closes: true,
    },
    Variant {
        name: "8519_euler_fine",
        large: false,
        integrator: "euler",
        step: 2e-5,
        quick: false,
        closes: true,
    },
];

impl Variant {
    fn beds(&self) -> u64 {
        if self.large { BEDS } else { 1 }
    }

    /// Changes of the scene for a bed, counted from 1.
    fn sets(&self, bed: u64) -> Vec<String> {
        let mut sets =
            vec![format!("time.step={:?}", self.step), format!("time.integrator={}", self.integrator)];
        if self.large {
            sets.push(format!("seed={bed}"));
            sets.push("particles.cloud.count=509".to_owned());
            sets.push("particles.cloud.radius={ uniform = [\"70 mm\", \"130 mm\"] }".to_owned());
        }
        sets
    }
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let variants: Vec<&Variant> = VARIANTS.iter().filter(|v| v.quick || !trial.quick).collect();
    let beds = variants.iter().flat_map(|v| (1..=v.beds()).map(|bed| v.sets(bed)));
    let worlds = beds.map(|sets| SCENE.world(&sets)).collect::<Result<_, _>>()?;
    let done = run_to_end(worlds, trial.backend)?.all_done()?;
    let mut found = Findings::default();
    let mut curves = Vec::new();
    let mut first = 0;
    for v in &variants {
        let next = first + v.beds() as usize;
        judge(&mut found, v, &done, first..next);
        curves.push(Curve::new(v, &done.series[first]));
        first = next;
    }
    found.figures.push(("kinetic-energy", kinetic_figure(&curves)));
    found.figures.push(("potential-energy", potential_figure(&curves)));
    Ok(found)
}

/// What is asked of the beds `worlds` of a variant.
fn judge(found: &mut Findings, v: &Variant, done: &Finished, worlds: Range<usize>) {
    let beds = &done.series[worlds.clone()];
    let most = |of: fn(&[Sample]) -> f64| largest(beds.iter().map(|series| of(series)));
    found.near(format!("{}_kinetic_left_of_peak", v.name), most(kinetic_left), 0.0, 1e-3);
    found.between(format!("{}_kinetic_trend_decades_per_s", v.name), trend(beds), -100.0, 0.0);
    found.near(format!("{}_potential_change_at_end", v.name), most(potential_change), 0.0, 1e-3);
    let lost: usize = worlds.map(|w| done.batch.progress(w).lost.len()).sum();
    found.zero(format!("{}_lost", v.name), lost as f64);
    let open = most(|series| series.last().map_or(f64::NAN, unaccounted).abs());
    let name = format!("{}_energy_unaccounted_of_dissipated", v.name);
    if v.closes {
        found.near(name, open, 0.0, 0.01);
    } else {
        found.report(name, open);
    }
}

fn kinetic_left(series: &[Sample]) -> f64 {
    series.last().map_or(f64::NAN, kinetic) / peak_kinetic(series)
}

/// Decades per second by which the mean kinetic energy of beds rises before their end.
fn trend(beds: &[Vec<Sample>]) -> f64 {
    let rows = beds.iter().map(Vec::len).min().unwrap_or(0);
    let mean = |row: usize| beds.iter().map(|series| kinetic(&series[row])).sum::<f64>() / beds.len() as f64;
    let Some(end) = rows.checked_sub(1).map(|last| beds[0][last].time) else { return f64::NAN };
    let late = (0..rows).filter(|row| beds[0][*row].time > end - TREND);
    let (time, decades): (Vec<f64>, Vec<f64>) =
        late.map(|row| (beds[0][row].time, mean(row).log10())).unzip();
    line(&time, &decades).map_or(f64::NAN, |[_, slope]| slope)
}

/// Share of the potential energy lost in falling by which it changed before the end.
fn potential_change(series: &[Sample]) -> f64 {
    let Some((first, last)) = series.first().zip(series.last()) else { return f64::NAN };
    let fallen = first.ledger.potential - last.ledger.potential;
    let before = series.iter().rfind(|s| s.time <= last.time - END).unwrap_or(first);
    (before.ledger.potential - last.ledger.potential).abs() / fallen
}

/// Energy that the ledger does not find, over what was dissipated.
fn unaccounted(last: &Sample) -> f64 {
    last.ledger.integrator() / last.ledger.dissipated()
}

struct Curve {
    name: String,
    time: Vec<f64>,
    kinetic: Vec<f64>,
    potential: Vec<f64>,
}

impl Curve {
    /// Energies in shares: kinetic of its peak, potential of what it was.
    fn new(v: &Variant, series: &[Sample]) -> Self {
        let peak = peak_kinetic(series);
        let start = series.first().map_or(1.0, |s| s.ledger.potential);
        Self {
            name: v.name.replace('_', " "),
            time: series.iter().map(|s| s.time).collect(),
            kinetic: series.iter().map(|s| kinetic(s) / peak).collect(),
            potential: series.iter().map(|s| s.ledger.potential / start).collect(),
        }
    }
}

fn kinetic_figure(curves: &[Curve]) -> String {
    let (ends, limit) = ([0.0, 1.5], [1e-3; 2]);
    let mut series: Vec<Series<'_>> = curves
        .iter()
        .map(|c| Series { name: &c.name, x: &c.time, y: &c.kinetic, style: Style::Line })
        .collect();
    series.push(Series { name: "limit at 1.5 s", x: &ends, y: &limit, style: Style::Dashed });
    Plot {
        title: "Deposition: kinetic energy",
        x: Axis::new("time", "s"),
        y: Axis::new("kinetic energy / its peak", "").log(),
        series,
        ..Plot::default()
    }
    .to_svg()
}

fn potential_figure(curves: &[Curve]) -> String {
    Plot {
        title: "Deposition: potential energy",
        x: Axis::new("time", "s"),
        y: Axis::new("potential energy / at the start", "").from_zero(),
        series: curves
            .iter()
            .map(|c| Series { name: &c.name, x: &c.time, y: &c.potential, style: Style::Line })
            .collect(),
        ..Plot::default()
    }
    .to_svg()
}
