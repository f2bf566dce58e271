//! Direct shear of glass beads (Fang et al. 2021, section 4.2.1, figure 9, table 2).
//!
//! The paper's: a box of 12 x 12 cm; beads (R 3 mm, ρ 2550 kg/m³, E 4e7 Pa, ν 0.22, e 0.87, μ 0.18 among them and 0.4
//! on the box, no rolling resistance); normal stresses of 3.1, 6.4, 12.5, 24.2 kPa; 1 mm/s; a step of 1e-5 s. It
//! shows curves and no numbers, so what is asked for is their shape: the stress comes to a plateau, and what it
//! reaches is linear in the normal stress.
//!
//! Chosen: halves 30 mm (below) and 80 mm high, beads up to 30 mm over the shear plane, each half with a flange where
//! the other leaves the sample bare; the upper half moves 8 mm. No surface of a scene is driven by a force, so the
//! lid is a dead weight: a layer of 20 x 20 spheres of a bead's size, so heavy that they give the stress, put on the
//! settled and trimmed beads where each touches the first, without friction on the box. It rises and falls with the
//! beads; it does not stay flat as a plate does. The shear stress is the force on the lower half along the motion
//! over the area of the box.
//!
//! Tolerances: the largest stress, of means over 0.4 mm, lies on a line over the normal stress with R² > 0.98; this
//! line has a slope between 0.2 and 0.6 (11° to 31°, around what is measured on glass beads) and at 0 at most a tenth
//! of the largest stress; the last quarter of the way differs from the one before by at most 15 %, and is between 0.6
//! and 1 times the largest. In the quick size, with two stresses, the line needs no R².
//!
//! The quick size takes 10 mm/s, a step of 2e-5 s and 6 mm. The full size takes 5.2 k · 8.2e5 · 4 = 1.7e10
//! particle-steps.

use glebe_engine::batch::Sample;
use glebe_engine::spec::{TriMesh, Vec3, WorldSpec};
use glebe_io::mesh::{StlFormat, write_stl};
use glebe_report::{Axis, Plot, Series, Style};
use glebe_study::fit::{line, linear};

use super::case::{Case, CaseError, Findings};
use super::trial::{Folder, SceneFile, Trial, at_rest, keep, mean, run_to_end, scene_file, settled};

pub(super) const CASE: Case = Case {
    id: "B4",
    name: "direct-shear",
    shows: "the shear stress of beads comes to a plateau, and its largest value is linear in the normal stress",
    source: "Fang et al. 2021 (Chrono::GPU), section 4.2.1, figure 9, table 2",
    run,
};

const SCENE: SceneFile = scene_file!("B4-direct-shear/scene.toml");
/// Normal stresses \[Pa\].
const STRESSES: [f64; 4] = [3.1e3, 6.4e3, 12.5e3, 24.2e3];
/// Half the width of the box, its depth below the shear plane and height above, width of the flanges \[m\].
const HALF: f64 = 0.06;
const DEPTH: f64 = 0.03;
const HEIGHT: f64 = 0.08;
const FLANGE: f64 = 0.03;
/// Beads reach so far above the shear plane \[m\].
const LEVEL: f64 = 0.03;
/// Radius of beads \[m\], and spheres along a side of the lid.
const RADIUS: f64 = 0.003;
const ALONG: usize = 20;
/// Way over which stresses are averaged before the largest is taken \[m\].
const WINDOW: f64 = 4e-4;

struct Size {
    stresses: &'static [f64],
    /// \[m/s\]
    speed: f64,
    /// \[m\]
    way: f64,
    /// \[s\]
    step: f64,
}

const QUICK: Size = Size { stresses: &[6.4e3, 24.2e3], speed: 0.01, way: 6e-3, step: 2e-5 };
const FULL: Size = Size { stresses: &STRESSES, speed: 1e-3, way: 8e-3, step: 1e-5 };

/// Way \[m\] and stresses \[Pa\] on the lower half.
#[derive(Default)]
struct Curve {
    way: Vec<f64>,
    shear: Vec<f64>,
    normal: Vec<f64>,
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let size = if trial.quick { QUICK } else { FULL };
    let folder = Folder::new("direct-shear")?;
    for (name, mesh) in [("lower", half(-DEPTH, HALF)), ("upper", half(HEIGHT, -HALF))] {
        write_stl(&folder.0.join(format!("{name}.stl")), &mesh, name, StlFormat::Binary)
            .map_err(|e| CaseError::Scene(e.to_string()))?;
    }
    let sets = [
        format!("time.step={:?}", size.step),
        format!("stage.shear.duration={:?}", size.way / size.speed),
        format!("stage.shear.move.upper.velocity=[{:?}, 0, 0]", size.speed),
        format!("output.series={:?}", 0.1 * WINDOW / size.speed),
    ];
    let (constants, state) = settled(SCENE.world_in(&folder.0, &sets)?, trial.backend)?;
    let bed = keep(at_rest(&constants, &state), |x, radius| x[2] < LEVEL - radius);
    let worlds = size.stresses.iter().map(|stress| loaded(&bed, *stress)).collect::<Result<_, _>>()?;
    let done = run_to_end(worlds, trial.backend)?.all_done()?;

    let mut found = Findings::default();
    found.report("beads", bed.particles.len() as f64);
    let curves: Vec<Curve> = done.series.iter().map(|series| Curve::new(series)).collect();
    let largest: Vec<f64> = curves.iter().map(|curve| curve.largest(size.way)).collect();
    for (w, stress) in size.stresses.iter().enumerate() {
        let name = |what: &str| format!("at_{:.1}_kPa_{what}", stress / 1e3);
        let [third, last] = [0.5, 0.75].map(|from| curves[w].mean(&curves[w].shear, from, from + 0.25));
        found.zero(name("lost"), done.batch.progress(w).lost.len() as f64);
        found.report(name("largest_Pa"), largest[w]);
        found.report(name("plateau_Pa"), last);
        found.report(name("normal_on_the_floor_Pa"), curves[w].mean(&curves[w].normal, 0.75, 1.0));
        found.between(name("plateau_over_largest"), last / largest[w], 0.6, 1.0);
        found.near(name("last_quarter_over_third"), last / third, 1.0, 0.15);
    }
    let [at_zero, slope] = line(size.stresses, &largest).unwrap_or([f64::NAN; 2]);
    found.between("slope", slope, 0.2, 0.6);
    let top = largest.iter().copied().fold(0.0, f64::max);
    found.near("at_no_stress_over_largest", at_zero / top, 0.0, 0.1);
    if !trial.quick {
        let r2 = linear(size.stresses, &largest).map_or(f64::NAN, |fit| fit.r2);
        found.between("straightness_R2", r2, 0.98, 1.0);
    }
    found.figures.push(("curves", curves_figure(size.stresses, &curves)));
    found.figures.push(("envelope", envelope_figure(size.stresses, &largest, [at_zero, slope])));
    Ok(found)
}

/// Half of the box from the shear plane to `end`, and its flange outside of the wall at x = `side`. The half below has a
/// floor.
fn half(end: f64, side: f64) -> TriMesh {
    let mut mesh = TriMesh::default();
    let mut add = |corners: [Vec3; 4]| {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(corners);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    };
    let (h, out) = (HALF, side + FLANGE.copysign(side));
    let around = [[-h, -h], [h, -h], [h, h], [-h, h]];
    for k in 0..4 {
        let [[ax, ay], [bx, by]] = [around[k], around[(k + 1) % 4]];
        add([[ax, ay, 0.0], [bx, by, 0.0], [bx, by, end], [ax, ay, end]]);
    }
    add([[side, -h, 0.0], [out, -h, 0.0], [out, h, 0.0], [side, h, 0.0]]);
    if end < 0.0 {
        add(around.map(|[x, y]| [x, y, end]));
    }
    mesh
}

/// The bed under a lid that gives a stress \[Pa\].
fn loaded(bed: &WorldSpec, stress: f64) -> Result<WorldSpec, CaseError> {
    let mut spec = bed.clone();
    let named = spec.materials.iter().position(|m| m.name == "lid");
    let lid = named.ok_or_else(|| CaseError::Scene("no material `lid`".to_owned()))?;
    let volume = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3) * (ALONG * ALONG) as f64;
    spec.materials[lid].density = stress * (2.0 * HALF).powi(2) / (spec.gravity[2].abs() * volume);
    let place = |k: usize| 2.0 * HALF * ((k as f64 + 0.5) / ALONG as f64 - 0.5);
    for column in 0..ALONG * ALONG {
        let [x, y] = [place(column % ALONG), place(column / ALONG)];
        // As low as the beads below let it.
        let on = |bead: &Vec3| {
            let left = 4.0 * RADIUS * RADIUS - (bead[0] - x).powi(2) - (bead[1] - y).powi(2);
            (left > 0.0).then(|| bead[2] + left.sqrt())
        };
        let height = bed.particles.position.iter().filter_map(on).fold(f64::NEG_INFINITY, f64::max);
        // Columns as wide as a bead hold many beads.
        let height = if height.is_finite() { height } else { LEVEL };
        spec.particles.push([x, y, height], RADIUS, lid);
    }
    Ok(spec)
}

impl Curve {
    fn new(series: &[Sample]) -> Self {
        let mut curve = Self::default();
        let area = (2.0 * HALF).powi(2);
        for sample in series.iter().filter(|s| s.stage == 1) {
            if let [lower, upper] = sample.surfaces.as_slice() {
                curve.way.push(upper.path);
                curve.shear.push(lower.force[0] / area);
                curve.normal.push(-lower.force[2] / area);
            }
        }
        curve
    }

    /// Mean between two shares of the way.
    fn mean(&self, values: &[f64], from: f64, to: f64) -> f64 {
        let end = self.way.last().copied().unwrap_or(f64::NAN);
        let inside = self.way.iter().zip(values).filter(|(x, _)| (from * end..=to * end).contains(*x));
        mean(inside.map(|(_, y)| *y))
    }

    /// Largest of means over a window.
    fn largest(&self, way: f64) -> f64 {
        let rows = ((WINDOW / way * self.way.len() as f64).round() as usize).max(1);
        self.shear.windows(rows).map(|w| mean(w.iter().copied())).fold(f64::NAN, f64::max)
    }
}

fn curves_figure(stresses: &[f64], curves: &[Curve]) -> String {
    let names: Vec<String> = stresses.iter().map(|s| format!("{:.1} kPa", s / 1e3)).collect();
    let series = names.iter().zip(curves);
    Plot {
        title: "Direct shear of glass beads",
        x: Axis::new("displacement", "m"),
        y: Axis::new("shear stress", "Pa").from_zero(),
        series: series
            .map(|(name, curve)| Series { name, x: &curve.way, y: &curve.shear, style: Style::Line })
            .collect(),
        ..Plot::default()
    }
    .to_svg()
}

fn envelope_figure(stresses: &[f64], largest: &[f64], [at_zero, slope]: [f64; 2]) -> String {
    let ends = [0.0, 25e3];
    let fitted = ends.map(|x| at_zero + slope * x);
    Plot {
        title: "Largest shear stress against normal stress",
        x: Axis::new("normal stress", "Pa").from_zero(),
        y: Axis::new("largest shear stress", "Pa").from_zero(),
        series: vec![
            Series { name: "found", x: stresses, y: largest, style: Style::Points },
            Series { name: "straight line", x: &ends, y: &fitted, style: Style::Dashed },
        ],
        ..Plot::default()
    }
    .to_svg()
}
