//! Balls fall on a bed of glass beads (Fang et al. 2021, section 4.2.2, figure 10, table 2).
//!
//! The paper's: beads (ρ 2500 kg/m³, R 1 mm, E 7e7 Pa, ν 0.24, e 0.9, μ 0.3, no rolling resistance), their number 115
//! 964, the step 5e-6 s; a ball of 25.4 mm of three densities, dropped from three heights. The experiment (Ambroso et
//! al. 2005) gives `d = 0.14/μ (ρb/ρg)^½ D^⅔ H^⅓`, with the bulk density ρg and H, the total drop, which counts the
//! penetration; the paper's balls lie on a straight line with 0.122.
//!
//! Chosen: a box of 10 x 10 cm; the ball has the beads' properties, and the walls too; beads fall from a solid
//! fraction of 0.45 to make the bed; a ball is put over the settled bed (see `projectile.rs`). Penetration is that of
//! its lowest point when it is deepest. Tolerances: k between 0.11 and 0.15, which covers the paper's and the
//! experiment's; the nine drops lie on a line through 0 with R² > 0.95, and every one within 20 % of it.
//!
//! The quick size has beads of 2.5 mm, 7.4 k of them, a step of 1.25e-5 s, and two drops, of 10 cm. A ball of five
//! beads' diameter meets few of them, so its k is asked to be within a third of the paper's; 0.083 was found, near
//! the edge of that. The full size takes 116 k · (8e4 + 9 · 3e4) = 4e10 particle-steps.

use glebe_report::{Axis, Plot, Series, Style};
use glebe_study::fit::linear;

use super::case::{Case, CaseError, Findings};
use super::projectile::{Ball, Bed, Path, paths_figure};
use super::trial::{SceneFile, Trial, largest, scene_file};

pub(super) const CASE: Case = Case {
    id: "B5",
    name: "cratering",
    shows: "how deep balls sink into beads: straight in (ρb/ρg)^½ D^⅔ H^⅓ / μ, with the slope of the experiment",
    source: "Fang et al. 2021 (Chrono::GPU), section 4.2.2, figure 10, table 2; Ambroso et al. 2005",
    run,
};

const SCENE: SceneFile = scene_file!("B5-cratering/scene.toml");
/// Diameter of the ball \[m\].
const DIAMETER: f64 = 0.0254;
/// Densities of balls \[kg/m³\], and heights over the surface \[m\].
const DENSITIES: [f64; 3] = [280.0, 700.0, 2200.0];
const HEIGHTS: [f64; 3] = [0.05, 0.10, 0.20];
/// Slopes: of the experiment, and of the paper.
const EXPERIMENT: f64 = 0.14;
const PAPER: f64 = 0.122;

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let drops: Vec<[f64; 2]> = if trial.quick {
        vec![[DENSITIES[1], HEIGHTS[1]], [DENSITIES[2], HEIGHTS[1]]]
    } else {
        DENSITIES.iter().flat_map(|density| HEIGHTS.map(|height| [*density, height])).collect()
    };
    let spec = SCENE.world(&sets(trial.quick))?;
    let g = spec.gravity[2].abs();
    let friction = spec.materials.first().map_or(f64::NAN, |m| m.friction);
    let bed = Bed::settle(spec, 0.06, trial)?;
    let balls: Vec<Ball> = drops
        .iter()
        .map(|[density, height]| Ball {
            radius: 0.5 * DIAMETER,
            density: *density,
            speed: (2.0 * g * height).sqrt(),
            rolling: None,
        })
        .collect();
    let paths = bed.hit(&balls, "ball", trial)?;

    let mut found = Findings::default();
    found.report("bulk_density_kg_per_m3", bed.density);
    found.report("bed_height_m", bed.surface);
    let depths: Vec<f64> = paths.iter().map(Path::deepest).collect();
    let scaled = |k: usize| {
        let [density, height] = drops[k];
        let ratio = (density / bed.density).sqrt();
        ratio * DIAMETER.powf(2.0 / 3.0) * (height + depths[k]).cbrt() / friction
    };
    let scales: Vec<f64> = (0..drops.len()).map(scaled).collect();
    let slope = scales.iter().zip(&depths).map(|(x, y)| x * y).sum::<f64>()
        / scales.iter().map(|x| x * x).sum::<f64>();
    for ([density, height], depth) in drops.iter().zip(&depths) {
        found.report(format!("depth_m_density_{density}_height_{height}"), *depth);
    }
    for (path, [density, height]) in paths.iter().zip(&drops) {
        found.report(format!("speed_left_m_s_density_{density}_height_{height}"), path.speed_left());
    }
    found.report("paper_slope", PAPER);
    found.report("experiment_slope", EXPERIMENT);
    if trial.quick {
        found.near("slope", slope, PAPER, PAPER / 3.0);
    } else {
        found.between("slope", slope, 0.11, 0.15);
        let r2 = linear(&scales, &depths).map_or(f64::NAN, |fit| fit.r2);
        found.between("straightness_R2", r2, 0.95, 1.0);
    }
    let off = scales.iter().zip(&depths).map(|(x, y)| (y / (slope * x) - 1.0).abs());
    found.near("largest_distance_from_the_line", largest(off), 0.0, 0.2);
    found.figures.push(("depth", figure(&scales, &depths, slope)));
    let names: Vec<String> =
        drops.iter().map(|[density, height]| format!("{density} kg/m³, {height} m")).collect();
    found.figures.push(("fall", paths_figure("Balls sink into beads", &names, &paths)));
    Ok(found)
}

fn sets(quick: bool) -> Vec<String> {
    if !quick {
        return Vec::new();
    }
    ["particles.bed.count=7422", "particles.bed.radius=\"2.5 mm\"", "time.step=1.25e-5"]
        .map(str::to_owned)
        .to_vec()
}

fn figure(scales: &[f64], depths: &[f64], slope: f64) -> String {
    let ends = [0.0, 1.1 * scales.iter().copied().fold(0.0, f64::max)];
    let [own, paper, experiment] = [slope, PAPER, EXPERIMENT].map(|k| ends.map(|x| k * x));
    Plot {
        title: "Penetration of balls that fall on beads",
        x: Axis::new("(ρb/ρg)^½ D^⅔ H^⅓ / μ", "m").from_zero(),
        y: Axis::new("penetration", "m").from_zero(),
        series: vec![
            Series { name: "found", x: scales, y: depths, style: Style::Points },
            Series { name: "its slope", x: &ends, y: &own, style: Style::Line },
            Series { name: "the paper, 0.122", x: &ends, y: &paper, style: Style::Dashed },
            Series { name: "experiment, 0.14", x: &ends, y: &experiment, style: Style::Dashed },
        ],
        ..Plot::default()
    }
    .to_svg()
}
