//! Oblique impact of a sphere on a plane without gravity (Fang et al. 2021, section 4.1.1 and figure 5).
//!
//! If friction is saturated throughout the impact, rigid-body dynamics give the rebound: with θ from the
//! normal, `e_t = v't/vt = 1 - μ(1+e)/tan θ` and `ω = 5/2 μ(1+e) vₙ/R`, for θ above `arctan(7/2 μ(1+e))`.
//!
//! The paper's: friction 0.3, the formulae. Chosen: e = 0.9 (the paper's figure has 1), R, ρ, E, ν, 1 m/s,
//! angles, and a step of 1/2000 of the collision. The formulae take e as measured.

use glebe_engine::spec::WorldSpec;
use glebe_physics::hertz_collision_time;
use glebe_report::{Axis, Mark, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{SceneFile, Trial, largest, run_to_end, scene_file};

pub(super) const CASE: Case = Case {
    id: "B1",
    name: "oblique-impact",
    shows: "rebound and spin of a sphere that hits a plane at 5 to 85 degrees, against closed forms",
    source: "Fang et al. 2021 (Chrono::GPU), section 4.1.1; Wu, Thornton and Li 2003",
    run,
};

const SCENE: SceneFile = scene_file!("B1-oblique-impact/scene.toml");
/// Speed before the impact \[m/s\].
const SPEED: f64 = 1.0;
const STEPS_PER_COLLISION: f64 = 2000.0;
/// Degrees between angles.
const STEP: f64 = 2.5;

/// One impact.
struct Impact {
    /// Angle from the normal \[degrees\].
    angle: f64,
    /// Restitution of the normal velocity.
    e: f64,
    /// Of the tangential velocity.
    e_t: f64,
    /// Spin times radius over the normal speed before.
    spin: f64,
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let mut angles = Vec::new();
    let mut worlds = Vec::new();
    let mut angle = 5.0;
    while angle < 85.0 + 0.5 * STEP {
        angles.push(angle);
        worlds.push(world(angle)?);
        angle += STEP;
    }
    let friction = worlds[0].materials[0].friction;
    let prescribed = worlds[0].materials[0].restitution;
    let done = run_to_end(worlds, trial.backend)?.all_done()?;
    let impacts: Vec<Impact> = angles
        .iter()
        .enumerate()
        .map(|(w, &angle)| {
            let p = done.batch.state(w).particles;
            let v = p.velocity[0].v.map(f64::from);
            let (sin, cos) = angle.to_radians().sin_cos();
            let spin = f64::from(p.spin[0].w[1]) * f64::from(p.place[0].radius);
            Impact { angle, e: v[2] / (SPEED * cos), e_t: v[0] / (SPEED * sin), spin: spin / (SPEED * cos) }
        })
        .collect();

    let critical = (3.5 * friction * (1.0 + prescribed)).atan().to_degrees();
    let rebound = |e: f64, angle: f64| 1.0 - friction * (1.0 + e) / angle.to_radians().tan();
    let spin = |e: f64| 2.5 * friction * (1.0 + e);
    let mut found = Findings::default();
    let sliding = || impacts.iter().filter(|i| i.angle >= critical + 3.0);
    let e_t = largest(sliding().map(|i| (i.e_t / rebound(i.e, i.angle) - 1.0).abs()));
    let turning = largest(sliding().map(|i| (i.spin / spin(i.e) - 1.0).abs()));
    found.near("sliding_rebound_worst_relative_error", e_t, 0.0, 0.01);
    found.near("sliding_spin_worst_relative_error", turning, 0.0, 0.01);
    found.near(
        "restitution_worst_relative_error",
        largest(impacts.iter().map(|i| (i.e / prescribed - 1.0).abs())),
        0.0,
        0.005,
    );
    // Smooth: third differences of neighbouring angles stay small. The limit is chosen.
    let below: Vec<f64> = impacts.iter().filter(|i| i.angle < critical).map(|i| i.e_t).collect();
    let kinks = below.windows(4).map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs());
    found.near("sticking_rebound_worst_third_difference", largest(kinks), 0.0, 0.05);
    found.report("critical_angle_degrees", critical);

    let x: Vec<f64> = impacts.iter().map(|i| i.angle).collect();
    let closed: Vec<f64> = x.iter().map(|&a| if a >= critical { a } else { f64::NAN }).collect();
    let plot = |title, label: &str, y: Vec<f64>, reference: Vec<f64>| {
        Plot {
            title,
            x: Axis::new("impact angle from the normal", "°"),
            y: Axis::new(label, ""),
            series: vec![
                Series { name: "glebe", x: &x, y: &y, style: Style::Points },
                Series { name: "closed form, sliding", x: &x, y: &reference, style: Style::Dashed },
            ],
            marks: vec![Mark { x: critical, label: "critical angle" }],
            ..Plot::default()
        }
        .to_svg()
    };
    let e_t = impacts.iter().map(|i| i.e_t).collect();
    let reference = closed.iter().map(|&a| rebound(prescribed, a)).collect();
    found.figures.push(("rebound", plot("Tangential restitution", "tangential restitution", e_t, reference)));
    let turned = impacts.iter().map(|i| i.spin).collect();
    let reference = closed.iter().map(|&a| if a.is_nan() { a } else { spin(prescribed) }).collect();
    let label = "spin · radius / normal speed";
    found.figures.push(("spin", plot("Spin after the impact", label, turned, reference)));
    Ok(found)
}

/// An impact at `angle` degrees from the normal.
fn world(angle: f64) -> Result<WorldSpec, CaseError> {
    let (sin, cos) = angle.to_radians().sin_cos();
    let mut world = SCENE.world(&[])?;
    let (m, r) = (&world.materials[0], world.particles.radius[0]);
    let mass = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3) * m.density;
    let e_star = m.youngs_modulus / (2.0 * (1.0 - m.poissons_ratio * m.poissons_ratio));
    let collision = hertz_collision_time(mass, r, e_star, SPEED * cos);
    world = SCENE.world(&[
        format!("particles.ball.velocity=[{:?}, 0, {:?}]", SPEED * sin, -SPEED * cos),
        format!("time.step={:?}", collision / STEPS_PER_COLLISION),
        format!("stage.impact.duration={:?}", 1.5 * collision),
    ])?;
    Ok(world)
}
