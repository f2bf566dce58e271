//! A sphere at rest whose overlap is 1e-5 of its radius (Fang et al. 2021, section 3.1): positions must be
//! exact.
//!
//! The paper's: R, ρ, g, and `F = K δ^1.5` with K = 1e8 N/m^1.5, so that `δ = (m g/K)^(2/3) = 1.0174e-8
//! m`. Chosen: the supports, the 100 m box, damping and step. The overlap is what the positions say, with
//! the radius that the engine holds in single precision (its rounding is 5e-11 m). On the tilted plane
//! gravity is tilted alike. The engine has no sphere that is held, so the supporting one lies on a plane
//! and has come to rest itself.

use std::f64::consts::PI;

use glebe_engine::batch::positions;
use glebe_engine::spec::Vec3;
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{SceneFile, Trial, run_to_end, scene_file};

pub(super) const CASE: Case = Case {
    id: "B11",
    name: "resting-sphere",
    shows: "overlap of 1e-8 m of a sphere of 1 mm on planes, triangles, a sphere, in a 1 m and a 100 m box",
    source: "Fang et al. 2021 (Chrono::GPU), section 3.1",
    run,
};

const SCENE: SceneFile = scene_file!("B11-resting-sphere/scene.toml");
const RADIUS: f64 = 1e-3;
/// K \[N/m^1.5\].
const STIFFNESS: f64 = 1e8;
/// Boxes \[m\].
const BOXES: [f64; 2] = [1.0, 100.0];

/// What the sphere lies on.
struct Support {
    name: &'static str,
    /// The floor's table, given the point of contact and the side of the box.
    floor: fn(at: Vec3, side: f64) -> String,
    /// Unit vector against gravity.
    up: Vec3,
    /// Where the contact is, in shares of the box.
    place: Vec3,
    /// Whether a second sphere is in between.
    sphere: bool,
}

const SLOPE: Vec3 = [0.5, 0.0, 0.866_025_403_784_438_6];
const PLACE: Vec3 = [0.7, 0.6, 0.8];

const SUPPORTS: [Support; 5] = [
    Support { name: "plane", floor: plane, up: [0.0, 0.0, 1.0], place: PLACE, sphere: false },
    Support { name: "tilted_plane", floor: tilted, up: SLOPE, place: PLACE, sphere: false },
    // The upper side of the slab is two triangles that meet on its diagonal, x = y.
    Support { name: "triangle_face", floor: slab, up: [0.0, 0.0, 1.0], place: PLACE, sphere: false },
    Support {
        name: "triangle_edge",
        floor: slab,
        up: [0.0, 0.0, 1.0],
        place: [0.7, 0.7, 0.8],
        sphere: false,
    },
    Support { name: "sphere", floor: plane, up: [0.0, 0.0, 1.0], place: PLACE, sphere: true },
];

fn plane(at: Vec3, _: f64) -> String {
    format!("plane = {{ point = {at:?}, normal = [0, 0, 1] }}")
}

fn tilted(at: Vec3, _: f64) -> String {
    format!("plane = {{ point = {at:?}, normal = {SLOPE:?} }}")
}

fn slab(at: Vec3, side: f64) -> String {
    format!("box = {{ min = [0, 0, {:?}], max = [{side:?}, {side:?}, {:?}] }}", 0.5 * at[2], at[2])
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let variants: Vec<(&Support, f64)> = SUPPORTS.iter().flat_map(|s| BOXES.map(|side| (s, side))).collect();
    let worlds = variants.iter().map(|(s, side)| SCENE.world(&sets(s, *side))).collect::<Result<_, _>>()?;
    let done = run_to_end(worlds, trial.backend)?.all_done()?;
    let spec = &done.batch.constants(0).spec;
    let weight = 4.0 / 3.0 * PI * RADIUS.powi(3) * spec.materials[0].density * spec.gravity[2].abs();
    let reference = (weight / STIFFNESS).powf(2.0 / 3.0);

    let mut found = Findings::default();
    found.near("reference", reference, 1.0174e-8, 1e-12);
    for (w, (support, side)) in variants.iter().enumerate() {
        let state = done.batch.state(w);
        let x = positions(done.batch.constants(w), &state);
        let height =
            |k: usize| (0..3).map(|a| (x[k][a] - support.place[a] * side) * support.up[a]).sum::<f64>();
        let radius = |k: usize| f64::from(state.particles.place[k].radius);
        let of = |id: u32| state.particles.id.iter().position(|i| *i == id).unwrap_or_default();
        let overlap = if support.sphere {
            let (below, ball) = (of(0), of(1));
            radius(ball) + radius(below) - (height(ball) - height(below))
        } else {
            radius(0) - height(0)
        };
        found.near(format!("{}_{side}m", support.name), overlap, reference, 0.01 * reference);
        let speed = done.series[w].last().map_or(f64::NAN, |s| s.speed);
        found.report(format!("{}_{side}m_speed_left", support.name), speed);
    }
    found.figures.push(("approach", figure(&done.series, &variants, reference)));
    Ok(found)
}

/// The overlap on its way to rest; of two contacts the larger, which is the sphere's on the plane, is left
/// out.
fn figure(
    series: &[Vec<glebe_engine::batch::Sample>],
    variants: &[(&Support, f64)],
    reference: f64,
) -> String {
    let shown = variants.iter().zip(series).filter(|((s, _), _)| !s.sphere);
    let curves: Vec<(String, Vec<f64>, Vec<f64>)> = shown
        .map(|((s, side), samples)| {
            let t = samples.iter().map(|s| s.time).collect();
            let d = samples.iter().map(|s| s.overlap * RADIUS / reference).collect();
            (format!("{}, {side} m", s.name.replace('_', " ")), t, d)
        })
        .collect();
    let end = curves.iter().flat_map(|c| &c.1).copied().fold(0.0, f64::max);
    let mut all: Vec<Series<'_>> =
        curves.iter().map(|(name, x, y)| Series { name, x, y, style: Style::Line }).collect();
    let (x, low, high) = ([0.0, end], [0.99; 2], [1.01; 2]);
    all.push(Series { name: "1.0174e-8 m ± 1 %", x: &x, y: &low, style: Style::Dashed });
    all.push(Series { name: "", x: &x, y: &high, style: Style::Dashed });
    Plot {
        title: "A sphere comes to rest",
        x: Axis::new("time", "s"),
        y: Axis::new("overlap / (m g / K)^(2/3)", "").from_zero(),
        series: all,
        ..Plot::default()
    }
    .to_svg()
}

/// Overrides for a support in a box of `side` metres.
fn sets(support: &Support, side: f64) -> Vec<String> {
    let at = support.place.map(|x| x * side);
    let along = |h: f64| [0, 1, 2].map(|k| at[k] + h * support.up[k]);
    let centres = if support.sphere { [along(RADIUS), along(3.0 * RADIUS)] } else { [along(RADIUS); 2] };
    let low = centres[0].map(|x| x - RADIUS);
    let high = centres[1].map(|x| x + RADIUS);
    vec![
        format!("domain.max=[{side:?}, {side:?}, {side:?}]"),
        format!("gravity={:?}", support.up.map(|x| -9.8 * x)),
        format!("geometry.floor={{ material = \"stone\", {} }}", (support.floor)(at, side)),
        format!("particles.ball.count={}", if support.sphere { 2 } else { 1 }),
        format!("particles.ball.region={{ min = {low:?}, max = {high:?} }}"),
    ]
}
