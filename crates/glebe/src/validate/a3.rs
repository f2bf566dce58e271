//! Step sizes and integrators (Nagy et al. 2024, section 3.3, figures 6 and A.16).
//!
//! The paper's: material of table B.5 column 2, walls of the thesis' table 6.2 column 3, steps and 2.5 s,
//! four integrators at 1e-3 s. Chosen: 1024 spheres in 0.7 × 0.7 m, starting at rest at a solid fraction
//! of 0.3, pairs with a wall mixed by the mean.
//!
//! The order of convergence is measured on one impact, whose rebound speed is known: e times the speed
//! before. Errors are root mean squares over phases, the parts of a step that are left when the sphere
//! touches.

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Sample, Status};
use glebe_engine::spec::WorldSpec;
use glebe_physics::{IntegratorKind, hertz_collision_time};
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{SceneFile, Trial, kinetic, mean, peak_kinetic, power_law, run_to_end, scene_file};

pub(super) const CASE: Case = Case {
    id: "A3",
    name: "step-study",
    shows: "energy left by large steps and by four integrators, and the integrators' order on one impact",
    source: "Nagy et al. 2024 (GPUDEM), section 3.3, figures 6 and A.16, table B.5 column 2",
    run,
};

const DEPOSITION: SceneFile = scene_file!("A3-step-study/scene.toml");
const IMPACT: SceneFile = scene_file!("A3-step-study/impact.toml");
/// Steps of the study \[s\].
const STEPS: [(&str, f64); 5] =
    [("1e-4", 1e-4), ("1e-3", 1e-3), ("2e-3", 2e-3), ("5e-3", 5e-3), ("1e-2", 1e-2)];
/// Part of the series that "left" is a mean over \[s\].
const END: f64 = 0.1;

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let mut found = Findings::default();
    depositions(&mut found, trial.backend)?;
    convergence(&mut found, trial.backend)?;
    Ok(found)
}

fn depositions(found: &mut Findings, backend: Backend) -> Result<(), CaseError> {
    let mut names: Vec<String> = Vec::new();
    let mut worlds = Vec::new();
    for (name, step) in STEPS {
        names.push(format!("step {name} s"));
        worlds.push(DEPOSITION.world(&[format!("time.step={step:?}")])?);
    }
    for kind in IntegratorKind::ALL {
        names.push(kind.name().to_owned());
        worlds.push(DEPOSITION.world(&[format!("time.integrator={}", kind.name())])?);
    }
    let done = run_to_end(worlds, backend)?;
    let left: Vec<f64> = done.series.iter().map(|series| left_of_peak(series)).collect();
    let failed = |w: usize| matches!(done.batch.status(w), Status::Failed(_));

    let (by_step, by_kind) = left.split_at(STEPS.len());
    for (w, (name, _)) in STEPS.iter().enumerate() {
        if failed(w) {
            found.report(format!("step_{name}_stopped_at_s"), done.batch.time(w));
        } else {
            found.report(format!("step_{name}_kinetic_left_of_peak"), by_step[w]);
        }
    }
    for (kind, left) in IntegratorKind::ALL.iter().zip(by_kind) {
        found.report(format!("{}_kinetic_left_of_peak", kind.name()), *left);
    }
    // A world that was stopped because a sphere ran away has blown up: more than any energy.
    let order: Vec<f64> =
        (0..STEPS.len()).map(|w| if failed(w) { f64::INFINITY } else { by_step[w] }).collect();
    let calmer = order.windows(2).filter(|p| p[1] < p[0]).count();
    found.zero("larger_steps_that_leave_less", calmer as f64);
    // Blow-up: stopped, or a tenth of the peak is left. The two largest steps, as in figure 6b.
    found.near("steps_that_blow_up", order.iter().filter(|left| **left > 0.1).count() as f64, 2.0, 0.0);
    found.near("step_1e-3_kinetic_left", by_step[1], 0.0, 1e-3);
    let of = |kind| IntegratorKind::ALL.iter().position(|k| *k == kind).map_or(f64::NAN, |k| by_kind[k]);
    // The paper: "an order of magnitude more kinetic energy remains".
    let decades = (of(IntegratorKind::Adams) / of(IntegratorKind::Euler)).log10();
    found.between("adams_above_euler_decades", decades, 1.0, 12.0);

    let curves: Vec<[Vec<f64>; 2]> = done
        .series
        .iter()
        .map(|series| {
            let peak = peak_kinetic(series);
            [series.iter().map(|s| s.time).collect(), series.iter().map(|s| kinetic(s) / peak).collect()]
        })
        .collect();
    let plot = |title, range: std::ops::Range<usize>| {
        let series =
            range.map(|w| Series { name: &names[w], x: &curves[w][0], y: &curves[w][1], style: Style::Line });
        Plot {
            title,
            x: Axis::new("time", "s"),
            y: Axis::new("kinetic energy / its peak", "").log(),
            series: series.collect(),
            ..Plot::default()
        }
        .to_svg()
    };
    found.figures.push(("steps", plot("Deposition with different steps", 0..STEPS.len())));
    let kinds = STEPS.len()..names.len();
    found.figures.push(("integrators", plot("Deposition with a step of 1e-3 s", kinds)));
    Ok(())
}

/// Kinetic energy at the end, as a share of its peak.
fn left_of_peak(series: &[Sample]) -> f64 {
    let end = series.last().map_or(0.0, |s| s.time - END);
    mean(series.iter().filter(|s| s.time > end).map(kinetic)) / peak_kinetic(series)
}

/// Steps in the time of an elastic collision. With 400 what single precision leaves (3e-7 to 7e-7 of the
/// speed) would be as large as the error of `euler` and `velocity-verlet`, and no order could be seen.
const RESOLUTIONS: [f64; 4] = [25.0, 50.0, 100.0, 200.0];
const PHASES: usize = 16;
/// Speed before the impact \[m/s\].
const SPEED: f64 = 1.0;

fn convergence(found: &mut Findings, backend: Backend) -> Result<(), CaseError> {
    let mut curves = Vec::new();
    for (label, e) in [("elastic", 1.0), ("damped", 0.5)] {
        for kind in IntegratorKind::ALL {
            let errors = RESOLUTIONS
                .map(|n| rebound_error(kind, e, n, backend))
                .into_iter()
                .collect::<Result<Vec<_>, _>>()?;
            // Errors fall as steps per collision grow: the order is minus the slope.
            let order = -power_law(&RESOLUTIONS, &errors);
            let name = format!("{label}_{}_order", kind.name());
            match (label, kind) {
                ("elastic", IntegratorKind::Exact) => found.near(name, order, 1.0, 0.1),
                ("elastic", IntegratorKind::Euler | IntegratorKind::VelocityVerlet) => {
                    found.between(name, order, 2.0, 4.0);
                }
                ("damped", _) => found.between(name, order, 0.9, 4.0),
                _ => found.report(name, order),
            }
            curves.push((format!("{}, e = {e}", kind.name()), errors));
        }
    }
    let series = curves.iter().enumerate().map(|(k, (name, errors))| {
        let style = if k < IntegratorKind::ALL.len() { Style::Line } else { Style::Dashed };
        Series { name, x: &RESOLUTIONS, y: errors, style }
    });
    let plot = Plot {
        title: "One impact: error of the rebound speed",
        x: Axis::new("steps per collision", "").log(),
        y: Axis::new("relative error, root mean square", "").log(),
        series: series.collect(),
        ..Plot::default()
    };
    found.figures.push(("convergence", plot.to_svg()));
    Ok(())
}

/// Root mean square over phases of the error of the rebound speed, relative to the speed before.
fn rebound_error(kind: IntegratorKind, e: f64, resolution: f64, backend: Backend) -> Result<f64, CaseError> {
    let plain = IMPACT.world(&[])?;
    let collision = collision_time(&plain);
    let step = collision / resolution;
    let world = IMPACT.world(&[
        format!("time.integrator={}", kind.name()),
        format!("time.step={step:?}"),
        format!("material.clay.restitution={e:?}"),
        format!("stage.impact.duration={:?}", 2.0 * collision),
    ])?;
    let worlds = (0..PHASES)
        .map(|phase| {
            let mut world = world.clone();
            // One step and a part of one away from the wall.
            world.particles.position[0][2] += SPEED * step * (1.0 + phase as f64 / PHASES as f64);
            world
        })
        .collect();
    let done = run_to_end(worlds, backend)?.all_done()?;
    let square = |w: usize| {
        let v = f64::from(done.batch.state(w).particles.velocity[0].v[2]);
        (v / SPEED - e).powi(2)
    };
    Ok(mean((0..PHASES).map(square)).sqrt())
}

/// Duration of the elastic collision of the world's sphere with the wall \[s\].
fn collision_time(world: &WorldSpec) -> f64 {
    let (m, r) = (&world.materials[0], world.particles.radius[0]);
    let mass = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3) * m.density;
    let e_star = m.youngs_modulus / (2.0 * (1.0 - m.poissons_ratio * m.poissons_ratio));
    hertz_collision_time(mass, r, e_star, SPEED)
}
