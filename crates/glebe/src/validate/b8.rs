//! Cost of a step of a bladed mixer against the number of grains (Fang et al. 2021, section 5, figure 15, table 4).
//!
//! The paper's: a vessel of radius 0.5 m; user-stiffness Hertz with `k̂ = 1e5 N/m` and `γ̂ = 1e4 1/s` along and
//! across the normal, friction 0.5, ρ 2800 kg/m³, 2π rad/s, a step of 1e-5 s; a mixer of 2892 triangles; grains whose
//! radius follows from their number. It finds the cost linear up to 123 million grains on an A100, and gives a rule
//! of thumb: well below an hour for 1e6 grains and 1e5 steps, which is 36 ns for a grain and a step.
//!
//! Chosen: the mixer's shape, three rows of three blades on a shaft (see the scene), with exactly as many triangles;
//! the grains fill the vessel up to 0.6 m at a solid fraction of 0.55 and lie around the mixer from the start, where
//! the paper lets them fall on it for 3 s: a step that is timed has contacts with the mixer and among all grains. The
//! mixer turns for a hundredth of a second before steps are timed, and for as long again, when they are. Overlaps of
//! more than 30 % of a radius are told and do not stop it: blades of 2.8 m/s press coarse grains of the paper's
//! stiffness that deep.
//!
//! Asked for: 2892 triangles; nothing lost; the mixer feels grains against its turning; the exponent of cost against
//! number, over the upper half of the sizes, within 0.25 of 1. The quick size, 5000 to 20 000 grains for 2000 steps,
//! is timed on machines that do other things too, and reports the exponent. The full size goes from 20 000 on in
//! steps of four to 20 million, or until the device refuses for want of memory, and says what was largest: 2.7e7 ·
//! 2000 = 5.5e10 particle-steps.

use std::time::Instant;

use glebe_engine::batch::{Batch, Status};
use glebe_engine::prepare;
use glebe_engine::spec::{Shape, Vec3, WorldSpec};
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{Record, SceneFile, Trial, keep, mean, power_law, scene_file};
use crate::device::admit;

pub(super) const CASE: Case = Case {
    id: "B8",
    name: "mixer",
    shows: "the cost of a step of a bladed mixer grows as the number of grains, up to the memory of the device",
    source: "Fang et al. 2021 (Chrono::GPU), section 5, figure 15, table 4",
    run,
};

const SCENE: SceneFile = scene_file!("B8-mixer/scene.toml");
const QUICK: &[u32] = &[5_000, 10_000, 20_000];
const FULL: &[u32] = &[20_000, 80_000, 320_000, 1_280_000, 5_120_000, 20_480_000];
/// Of the grains: height \[m\] and solid fraction of the box that they are made in.
const HEIGHT: f64 = 0.6;
const FRACTION: f64 = 0.55;
/// Radius of the vessel \[m\].
const VESSEL: f64 = 0.5;
const TRIANGLES: f64 = 2892.0;
/// The paper's rule of thumb: an hour for 1e6 grains and 1e5 steps \[s\].
const PAPER: f64 = 3600.0 / 1e11;

/// The mixer of the scene.
struct Mixer {
    radius: f64,
    shaft: f64,
    /// Where it begins along z, and its length.
    low: f64,
    length: f64,
    blades: u32,
    rows: u32,
    blade_height: f64,
    thickness: f64,
    spacing: f64,
    /// Turn of the blades along z \[rad/m\].
    twist: f64,
}

const MIXER: Mixer = Mixer {
    radius: 0.45,
    shaft: 0.05,
    low: 0.02,
    length: 0.459,
    blades: 3,
    rows: 3,
    blade_height: 0.13275,
    thickness: 0.02,
    spacing: 0.153,
    // A pitch of 45° at the tips.
    twist: 1.0 / 0.45,
};

/// What a size costs.
struct Cost {
    grains: f64,
    /// Wall time of a step \[s\].
    step: f64,
    lost: f64,
    /// Deepest overlap over the radius.
    overlap: f64,
    /// Of the grains on the mixer about its axis \[N m\].
    torque: f64,
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let sizes = if trial.quick { QUICK } else { FULL };
    let mut found = Findings::default();
    let first = world(sizes[0])?;
    let triangles = first.surfaces.iter().filter_map(|surface| match &surface.shape {
        Shape::Mesh(mesh) => Some(mesh.triangles.len() as f64),
        Shape::Plane { .. } | Shape::Frustum(_) => None,
    });
    found.near("triangles", triangles.sum(), TRIANGLES, 0.0);
    let mut costs: Vec<Cost> = Vec::new();
    for size in sizes {
        match cost(world(*size)?, trial) {
            Ok(cost) => costs.push(cost),
            // A device without memory for more has shown what it can.
            Err(CaseError::Device(_)) if !costs.is_empty() => break,
            Err(error) => return Err(error),
        }
    }
    for cost in &costs {
        let name = |what: &str| format!("{:08}_grains_{what}", cost.grains);
        found.report(name("ms_per_step"), 1e3 * cost.step);
        found.report(name("ns_per_grain_and_step"), 1e9 * cost.step / cost.grains);
        found.report(name("deepest_overlap_over_radius"), cost.overlap);
        found.zero(name("lost"), cost.lost);
        found.between(name("torque_N_m"), cost.torque, -1e6, 0.0);
    }
    let [n, t] = [|c: &Cost| c.grains, |c: &Cost| c.step].map(|f| costs.iter().map(f).collect::<Vec<_>>());
    let upper = costs.len() / 2;
    let exponent = if trial.quick { power_law(&n, &t) } else { power_law(&n[upper..], &t[upper..]) };
    if trial.quick {
        found.report("exponent", exponent);
    } else {
        found.near("exponent_of_the_upper_half", exponent, 1.0, 0.25);
    }
    found.report("largest_grains", n.last().copied().unwrap_or(f64::NAN));
    found.figures.push(("cost", figure(&n, &t)));
    Ok(found)
}

/// The mixer among about as many grains as would fill the box around the vessel.
fn world(count: u32) -> Result<WorldSpec, CaseError> {
    let volume = 4.0 * VESSEL * VESSEL * HEIGHT * FRACTION / f64::from(count);
    let radius = (volume * 3.0 / (4.0 * std::f64::consts::PI)).cbrt();
    let spec = SCENE
        .world(&[format!("particles.grains.count={count}"), format!("particles.grains.radius={radius:?}")])?;
    Ok(keep(spec, |x, radius| x[0].hypot(x[1]) < VESSEL - radius && !MIXER.meets(x, radius)))
}

impl Mixer {
    /// Whether a sphere may meet it.
    fn meets(&self, x: Vec3, radius: f64) -> bool {
        let (z, out) = (x[2] - self.low, x[0].hypot(x[1]));
        if z < -radius || z > self.length + radius || out > self.radius + radius {
            return false;
        }
        if out < self.shaft + radius {
            return true;
        }
        let in_row = |row: u32| {
            let low = f64::from(row) * self.spacing;
            (low - radius..=low + self.blade_height + radius).contains(&z)
        };
        // A blade is inclined by up to its pitch of 45°, so along a circle it is √2 times as far away as across.
        let apart = 0.5 * self.thickness + std::f64::consts::SQRT_2 * radius;
        let of_blade = |blade: u32| {
            let angle = std::f64::consts::TAU * f64::from(blade) / f64::from(self.blades) - self.twist * z;
            let (sin, cos) = angle.sin_cos();
            let [along, across] = [cos * x[0] + sin * x[1], cos * x[1] - sin * x[0]];
            along > 0.0 && across.abs() < apart
        };
        (0..self.rows).any(in_row) && (0..self.blades).any(of_blade)
    }
}

fn cost(spec: WorldSpec, trial: Trial<'_>) -> Result<Cost, CaseError> {
    let mixer = spec.surfaces.iter().position(|s| s.name == "mixer");
    let (constants, state) = prepare(spec)?;
    let grains = state.particles.len() as f64;
    admit(trial.backend, std::slice::from_ref(&constants))?;
    let mut record = Record { series: vec![Vec::new()] };
    let mut batch = Batch::from_states(vec![(constants.clone(), state)], trial.backend);
    while batch.running() && batch.progress(0).stage == 0 {
        let Ok(()) = batch.advance(&mut record);
    }
    let (began, before) = (Instant::now(), batch.progress(0).step);
    while batch.running() {
        let Ok(()) = batch.advance(&mut record);
    }
    let seconds = began.elapsed().as_secs_f64();
    if *batch.status(0) != Status::Done {
        return Err(CaseError::stopped(&constants.spec.title, batch.status(0)));
    }
    let overlap = record.series[0].iter().map(|sample| sample.overlap).fold(0.0, f64::max);
    let timed: Vec<f64> = record.series[0]
        .iter()
        .filter(|sample| sample.stage == 1)
        .filter_map(|sample| sample.surfaces.get(mixer?))
        .map(|surface| surface.torque[2])
        .collect();
    Ok(Cost {
        grains,
        step: seconds / (batch.progress(0).step - before) as f64,
        lost: batch.progress(0).lost.len() as f64,
        overlap,
        torque: mean(timed),
    })
}

fn figure(n: &[f64], t: &[f64]) -> String {
    let (Some(grains), Some(step)) = (n.last(), t.last()) else { return String::new() };
    let linear: Vec<f64> = n.iter().map(|count| step * count / grains).collect();
    let paper: Vec<f64> = n.iter().map(|count| PAPER * count).collect();
    let series = vec![
        Series { name: "found", x: n, y: t, style: Style::Line },
        Series { name: "linear", x: n, y: &linear, style: Style::Dashed },
        Series { name: "the paper's rule of thumb, on an A100", x: n, y: &paper, style: Style::Dashed },
    ];
    Plot {
        title: "A bladed mixer: cost of a step",
        x: Axis::new("grains", "").log(),
        y: Axis::new("wall time of a step", "s").log(),
        series,
        ..Plot::default()
    }
    .to_svg()
}
