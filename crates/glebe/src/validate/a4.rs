//! A sweep through a layer of soil at four speeds (Nagy et al. 2024, section 4.1, figures 8 and 9, table B.5 column 3).
//!
//! The paper's: soil, box, 147 456 spheres of 4.8 ± 0.8 mm, trimmed at 140 mm, the tool 100 mm deep, its speeds, the
//! window of the stationary part. Chosen: the tool's shape beyond its width and length; the quick size, whose spheres are
//! four times as large and whose step is four times as long.
//!
//! The paper's fit is 8.96 N + 12.03 N s/m · v with R² = 0.969, from a program that drops contacts and never keeps the
//! history of spheres: sign, shape and order are asked for, the numbers are reported beside it. Spheres of 38 mm in a
//! layer of 140 mm are a handful to its depth, so the quick size asks for less of the straight line, and of the third phase, whose
//! way of 60 mm is three of their radii, in the mean of the four speeds: single ones have been 0.77 to 1.47.

use glebe_engine::batch::Sample;
use glebe_engine::prepare;
use glebe_io::mesh::{StlFormat, write_stl};
use glebe_io::tool::Sweep;
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{Folder, SceneFile, Trial, mean, run_states_to_end, scene_file, settled};
use glebe_study::fit::{Fit, linear};

pub(super) const CASE: Case = Case {
    id: "A4",
    name: "tillage",
    shows: "the draught force has three phases and rises with the speed of the tool as a straight line",
    source: "Nagy et al. 2024 (GPUDEM), section 4.1, figures 8 and 9, table B.5 column 3",
    run,
};

const SCENE: SceneFile = scene_file!("A4-tillage/scene.toml");
/// \[m/s\]
const SPEEDS: [f64; 4] = [0.7, 1.0, 1.5, 2.0];
/// The stationary part \[m\].
const STATIONARY: [f64; 2] = [0.28, 0.84];
/// Way of the tool: to where soil is pressed against the far wall \[m\].
const WAY: f64 = 0.96;
/// The paper's fit: force at rest \[N\], and its rise with speed \[N s/m\].
const PAPER: [f64; 2] = [8.96, 12.03];

fn sets(quick: bool, speed: f64) -> Vec<String> {
    let mut sets = vec![
        format!("stage.till.duration={:?}", WAY / speed),
        format!("stage.till.move.sweep.velocity=[{speed:?}, 0, 0]"),
    ];
    if quick {
        sets.push("particles.bed.count=2304".to_owned());
        sets.push("particles.bed.radius={ uniform = [\"16 mm\", \"22.4 mm\"] }".to_owned());
        sets.push("time.step=2e-4".to_owned());
    }
    sets
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let folder = Folder::new("tillage")?;
    let mesh = Sweep::default().mesh().map_err(|e| CaseError::Scene(e.to_string()))?;
    write_stl(&folder.0.join("sweep.stl"), &mesh, "sweep", StlFormat::Binary)
        .map_err(|e| CaseError::Scene(e.to_string()))?;
    let world = |speed| SCENE.world_in(&folder.0, &sets(trial.quick, speed));
    // The bed when the tool is about to enter, which no speed changes.
    let (_, bed) = settled(world(SPEEDS[0])?, trial.backend)?;
    let worlds = SPEEDS
        .iter()
        .map(|speed| Ok((prepare(world(*speed)?)?.0, bed.clone())))
        .collect::<Result<Vec<_>, CaseError>>()?;
    let done = run_states_to_end(worlds, trial.backend)?.all_done()?;

    let mut found = Findings::default();
    let curves: Vec<[Vec<f64>; 2]> = done.series.iter().map(|series| curve(series)).collect();
    let (mut forces, mut pressed) = (Vec::new(), Vec::new());
    for (w, speed) in SPEEDS.iter().enumerate() {
        let of = |from: f64, to: f64| {
            let [x, y] = &curves[w];
            mean(x.iter().zip(y).filter(|(x, _)| (from..to).contains(*x)).map(|(_, y)| *y))
        };
        let stationary = of(STATIONARY[0], STATIONARY[1]);
        let name = format!("at_{speed:.1}_m_s");
        found.report(format!("{name}_draught_N"), stationary);
        found.report(format!("{name}_paper_draught_N"), PAPER[0] + PAPER[1] * speed);
        // The first phase: the tool enters. The third: soil is pressed against the far wall.
        found.between(format!("{name}_entering_over_stationary"), of(0.0, 0.14) / stationary, 0.0, 0.6);
        let (leaving, of_speed) = (of(0.90, WAY) / stationary, format!("{name}_leaving_over_stationary"));
        if trial.quick {
            found.report(of_speed, leaving);
        } else {
            found.between(of_speed, leaving, 1.0, 100.0);
        }
        pressed.push(leaving);
        found.zero(format!("{name}_lost"), done.batch.progress(w).lost.len() as f64);
        forces.push(stationary);
    }
    if trial.quick {
        found.between("leaving_over_stationary", mean(pressed), 1.0, 100.0);
    }
    let nothing = Fit { a: f64::NAN, b: f64::NAN, r2: f64::NAN };
    let Fit { a: at_rest, b: rise, r2 } = linear(&SPEEDS, &forces).unwrap_or(nothing);
    found.report("rise_N_s_per_m", rise);
    found.report("at_rest_N", at_rest);
    let least = if trial.quick { 0.8 } else { 0.95 };
    found.between("rise_over_force", rise / forces[0], 1e-3, 10.0);
    found.between("straightness_R2", r2, least, 1.0);
    found.figures.push(("draught", force_figure(&curves)));
    found.figures.push(("speeds", speed_figure(&forces, rise, at_rest)));
    Ok(found)
}

/// Displacement \[m\] and draught force \[N\] while the tool moves.
fn curve(series: &[Sample]) -> [Vec<f64>; 2] {
    let moving = series.iter().filter(|s| s.stage == 2).filter_map(|s| s.surfaces.first());
    let (x, y) = moving.map(|tool| (tool.path, tool.draught)).unzip();
    [x, y]
}

fn force_figure(curves: &[[Vec<f64>; 2]]) -> String {
    let names = SPEEDS.map(|speed| format!("{speed} m/s"));
    let series = names.iter().zip(curves).map(|(name, [x, y])| Series { name, x, y, style: Style::Line });
    Plot {
        title: "Draught force along the way",
        x: Axis::new("displacement", "m"),
        y: Axis::new("draught force", "N").from_zero(),
        series: series.collect(),
        ..Plot::default()
    }
    .to_svg()
}

fn speed_figure(forces: &[f64], rise: f64, at_rest: f64) -> String {
    let fitted = SPEEDS.map(|v| at_rest + rise * v);
    let paper = SPEEDS.map(|v| PAPER[0] + PAPER[1] * v);
    Plot {
        title: "Draught force against speed",
        x: Axis::new("speed", "m/s"),
        y: Axis::new("mean draught force", "N").from_zero(),
        series: vec![
            Series { name: "found", x: &SPEEDS, y: forces, style: Style::Line },
            Series { name: "straight line", x: &SPEEDS, y: &fitted, style: Style::Dashed },
            Series { name: "the paper's fit", x: &SPEEDS, y: &paper, style: Style::Dashed },
        ],
        ..Plot::default()
    }
    .to_svg()
}
