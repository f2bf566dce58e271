//! An elastic gas keeps its energy for ten million steps.
//!
//! Spheres that lose nothing fly in a periodic box and collide: nothing may drift, neither by the integrator, whose
//! error within a collision must cancel, nor by single precision. All is chosen: 1000 spheres at a solid fraction of
//! 0.2, a step of a hundredth of a collision at √2 times the root mean square of the speeds, 10⁷ steps, of which the
//! quick size takes 20 000. What is asked is the slope of the total energy, elastic energy included, on a line through
//! the series.

use glebe_engine::backend::Backend;
use glebe_engine::batch::Sample;
use glebe_engine::lattice::{add, dot, norm};
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_physics::hertz_collision_time;
use glebe_report::{Axis, Plot, Series, Style};
use glebe_study::fit::line;

use super::case::{Case, CaseError, Findings};
use super::trial::{Finished, SceneFile, Trial, mean, run_to_end, scene_file};

pub(super) const CASE: Case = Case {
    id: "P1",
    name: "elastic-gas",
    shows: "a gas of spheres that lose nothing keeps its energy and momentum for ten million steps",
    source: "conservation of energy; Maxwell's distribution of speeds",
    run,
};

const SCENE: SceneFile = scene_file!("P1-elastic-gas/scene.toml");
const QUICK: u64 = 20_000;
const FULL: u64 = 10_000_000;
/// As in the scene \[m\].
const RADIUS: f64 = 2e-3;
/// A hundredth of a collision at √2 times the root mean square of the speeds \[s\].
const STEP: f64 = 2.29e-6;
/// Rows of the series.
const ROWS: u64 = 1000;
/// Largest change of the total energy over the run, on the line, as a share of it.
const DRIFT: f64 = 1e-4;
/// The same of the momentum, as a share of the sum of its sizes.
const MOMENTUM: f64 = 1e-4;

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let steps = if trial.quick { QUICK } else { FULL };
    let done = fly(steps, trial.backend)?;
    let spec = &done.batch.constants(0).spec;
    let energy: Vec<f64> = done.series[0].iter().map(|s| s.ledger.mechanical()).collect();
    let times: Vec<f64> = done.series[0].iter().map(|s| s.time).collect();
    let start = energy.first().copied().unwrap_or(f64::NAN);
    let share: Vec<f64> = energy.iter().map(|e| e / start - 1.0).collect();
    let flown = steps as f64 * STEP;
    let [at_start, slope] = line(&times, &share).unwrap_or([f64::NAN; 2]);
    let off_line = |(t, e): (&f64, &f64)| (e - at_start - slope * t).powi(2);
    let scatter = mean(times.iter().zip(&share).map(off_line)).sqrt();

    let mut found = Findings::default();
    found.near("energy_change_on_the_line", slope * flown, 0.0, DRIFT);
    found.report("energy_scatter_about_the_line", scatter);
    found.report("energy_change_from_first_to_last_row", share.last().copied().unwrap_or(f64::NAN));

    let state = done.batch.state(0);
    let velocities: Vec<Vec3> = state.particles.velocity.iter().map(|v| v.v.map(f64::from)).collect();
    let squares = velocities.iter().map(|v| dot(*v, *v));
    let rms = mean(squares.clone()).sqrt();
    let sum = velocities.iter().fold([0.0; 3], |sum, v| add(sum, *v));
    found.near("momentum_over_sum_of_sizes", norm(sum) / (rms * velocities.len() as f64), 0.0, MOMENTUM);
    let fourth = mean(squares.map(|v2| v2 * v2)) / rms.powi(4);
    if trial.quick {
        // Too short for the halves to mix.
        found.report("fourth_moment_of_speeds", fourth);
    } else {
        // Maxwell's distribution; of 1000 speeds within four standard deviations.
        found.near("fourth_moment_of_speeds", fourth, 5.0 / 3.0, 0.2);
    }
    found.between("steps_per_collision", collision_time(spec, rms) / STEP, 99.0, 101.0);
    found.report("steps", done.batch.progress(0).step as f64);
    found.report("rebuilds", done.batch.progress(0).rebuilds as f64);
    found.report("largest_overlap", done.series[0].iter().map(|s| s.overlap).fold(0.0, f64::max));
    found.figures.push(("energy", figure(&done.series[0], &share)));
    Ok(found)
}

/// The scene for a number of steps.
fn fly(steps: u64, backend: Backend) -> Result<Finished, CaseError> {
    let world = SCENE.world(&[
        format!("time.step={STEP:?}"),
        format!("stage.fly.duration={:?}", steps as f64 * STEP),
        format!("output.series={:?}", (steps / ROWS) as f64 * STEP),
    ])?;
    run_to_end(vec![world], backend)?.all_done()
}

/// Of two of the world's spheres that meet at √2 times the root mean square of the speeds \[s\].
fn collision_time(world: &WorldSpec, rms: f64) -> f64 {
    let (m, r) = (&world.materials[0], RADIUS);
    let mass = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3) * m.density;
    let e_star = m.youngs_modulus / (2.0 * (1.0 - m.poissons_ratio * m.poissons_ratio));
    hertz_collision_time(0.5 * mass, 0.5 * r, e_star, std::f64::consts::SQRT_2 * rms)
}

fn figure(series: &[Sample], share: &[f64]) -> String {
    let steps: Vec<f64> = series.iter().map(|s| s.step as f64).collect();
    let end = steps.last().copied().unwrap_or_default();
    let (x, low, high) = ([0.0, end], [-DRIFT; 2], [DRIFT; 2]);
    Plot {
        title: "Energy of an elastic gas",
        x: Axis::new("steps", ""),
        y: Axis::new("change of the total energy, share", ""),
        series: vec![
            Series { name: "glebe", x: &steps, y: share, style: Style::Line },
            Series { name: "allowed to its line", x: &x, y: &low, style: Style::Dashed },
            Series { name: "", x: &x, y: &high, style: Style::Dashed },
        ],
        ..Plot::default()
    }
    .to_svg()
}
