//! A ball of 1 kg falls slowly on beads in a cylinder (Fang et al. 2021, section 4.2.3, figures 11 and 12, table 2).
//!
//! The paper's: beads (R 5 mm, ρ 2480 kg/m³, E 7e8 Pa, ν 0.24, e 0.9, μ 0.16 among them and 0.45 on walls), a ball of 1
//! kg, a step of 1e-6 s, rolling friction μr that is varied around 0.09, and a constant torque by each body's own radius
//! (`chrono`). It leaves out the ball's size, the vessel, the speeds and the values of μr. The demonstration that comes
//! with its program (`demo_GPU_ballDrop.cpp`) has a ball of R 50 mm, a cylinder 315 mm wide, a bed 150 mm deep, walls of
//! e 0.5, and looks at 0.15 s.
//!
//! What the paper finds: with μr the ball sinks less deep and stops sooner, its peak acceleration hardly changes; with
//! its speed peak and depth rise and the collision gets shorter; a bed deeper than 140 mm is as good as any.
//!
//! Chosen: speeds from 0.25 to 1 m/s; μr 0, 0.09 and 0.2; the ball has the beads' properties; one bed for all, which has
//! settled with 0.09; the ball is put over it (see `projectile.rs`). Beads let the ball creep to rest, so it has stopped
//! when it sinks no faster than at a hundredth of its speed at the surface; fall and creep are looked at for 0.3 s.
//! Depth is that of the lowest point then, the collision lasts from the surface to there, and an acceleration is the
//! mean over 1 ms.
//!
//! Asked for: depth and time fall from each μr to the next at every speed; peak acceleration rises from each speed to
//! the next with every μr, and so does depth, while time falls; peaks of the three μr at a speed are within 0.3 of
//! their mean, for the two largest speeds; in the full size, at 1 m/s, a bed of 200 mm gives depth, time and peak
//! of that of 150 mm within a tenth.
//!
//! In full size on a card four of these do not hold: at 0.25 and 0.5 m/s a ball with μr 0.2 stops 7 and 14 % later than with
//! 0.09; with μr 0.2 that of 1 m/s takes 5 % longer than that of 0.75 m/s; without rolling friction the peak at 0.5 m/s is
//! 0.77 of that at 0.25 m/s. Slow balls begin 3 and 10 mm above the surface of a bed of beads of 10 mm: one bead more or
//! less under them matters, and each value is of one fall.
//!
//! The quick size has a cylinder 240 mm wide, 7.7 k beads, a step of 7e-6 s, and two speeds. The full size takes 13.4 k ·
//! (6e5 + 12 · 3e5) + 18 k · 9e5 = 7e10 particle-steps.

use glebe_engine::spec::WorldSpec;
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::projectile::{Ball, Bed, Path, paths_figure};
use super::trial::{SceneFile, Trial, keep, largest, least, mean, scene_file};

pub(super) const CASE: Case = Case {
    id: "B6",
    name: "low-velocity-cratering",
    shows: "a ball that falls slowly on beads: rolling friction stops it sooner and less deep, with the same peak",
    source: "Fang et al. 2021 (Chrono::GPU), section 4.2.3, figures 11 and 12, table 2",
    run,
};

const SCENE: SceneFile = scene_file!("B6-low-velocity-cratering/scene.toml");
/// Radius of the ball \[m\], and its density \[kg/m³\].
const RADIUS: f64 = 0.05;
const DENSITY: f64 = 1909.859;
/// Rolling frictions.
const ROLLING: [f64; 3] = [0.0, 0.09, 0.2];
/// Speeds at the surface \[m/s\].
const SPEEDS: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
const QUICK_SPEEDS: [f64; 2] = [0.5, 1.0];
/// Share of the speed at the surface at which a ball has stopped.
const STOPPED: f64 = 0.01;
/// Over what time an acceleration is the mean \[s\].
const SPAN: f64 = 1e-3;
/// How much deeper the bed is that depth is tried with.
const DEEPER: f64 = 4.0 / 3.0;

/// How a vessel is filled.
struct Vessel {
    /// \[m\]
    radius: f64,
    /// Beads that fall, in and around it.
    count: f64,
}

/// What a fall comes to.
struct Collision {
    /// \[m\]
    depth: f64,
    /// \[s\]
    time: f64,
    /// Largest acceleration \[m/s²\].
    peak: f64,
}

/// One of these.
type Value = fn(&Collision) -> f64;

impl Collision {
    fn new(ball: &Ball, path: &Path) -> Self {
        let stop = path.slowed_to(STOPPED * ball.speed);
        Self {
            depth: stop.map_or(f64::NAN, |[_, depth]| depth),
            time: stop.map_or(f64::NAN, |[time, _]| time),
            peak: path.peak_acceleration(SPAN),
        }
    }
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let vessel = if trial.quick {
        Vessel { radius: 0.12, count: 10450.0 }
    } else {
        Vessel { radius: 0.1575, count: 18000.0 }
    };
    let speeds: &[f64] = if trial.quick { &QUICK_SPEEDS } else { &SPEEDS };
    let mut found = Findings::default();

    let bed = Bed::settle(world(&vessel, trial.quick)?, 0.1, trial)?;
    found.report("bed_height_m", bed.surface);
    found.report("bulk_density_kg_per_m3", bed.density);
    let ball =
        |speed: f64, rolling: f64| Ball { radius: RADIUS, density: DENSITY, speed, rolling: Some(rolling) };
    let falls: Vec<Ball> =
        ROLLING.iter().flat_map(|rolling| speeds.iter().map(|speed| ball(*speed, *rolling))).collect();
    let paths = bed.hit(&falls, "ball", trial)?;
    let all: Vec<Collision> =
        falls.iter().zip(&paths).map(|(ball, path)| Collision::new(ball, path)).collect();
    // A row for each rolling friction.
    let rows: Vec<&[Collision]> = all.chunks(speeds.len()).collect();

    for (rolling, row) in ROLLING.iter().zip(&rows) {
        for (speed, c) in speeds.iter().zip(*row) {
            let name = |what: &str| format!("mu_r_{rolling}_at_{speed}_m_s_{what}");
            found.report(name("depth_m"), c.depth);
            found.report(name("time_s"), c.time);
            found.report(name("peak_m_s2"), c.peak);
        }
        let by_speed = |of: Value| -> Vec<f64> { row.iter().map(of).collect() };
        let name = |what: &str| format!("mu_r_{rolling}_{what}_over_that_of_the_speed_before");
        found.between(name("least_peak"), least(ratios(&by_speed(|c| c.peak))), 1.0, 100.0);
        found.between(name("least_depth"), least(ratios(&by_speed(|c| c.depth))), 1.0, 100.0);
        found.between(name("largest_time"), largest(ratios(&by_speed(|c| c.time))), 0.0, 1.0);
    }
    for (k, speed) in speeds.iter().enumerate() {
        let by_rolling = |of: Value| -> Vec<f64> { rows.iter().map(|r| of(&r[k])).collect() };
        let name = |what: &str| format!("at_{speed}_m_s_largest_{what}_over_that_of_less_mu_r");
        found.between(name("depth"), largest(ratios(&by_rolling(|c| c.depth))), 0.0, 1.0);
        found.between(name("time"), largest(ratios(&by_rolling(|c| c.time))), 0.0, 1.0);
        let peaks = by_rolling(|c| c.peak);
        let middle = mean(peaks.iter().copied());
        let off = largest(peaks.iter().map(|p| (p / middle - 1.0).abs()));
        let name = format!("at_{speed}_m_s_peak_changes_with_mu_r");
        if k + 2 < speeds.len() {
            found.report(name, off);
        } else {
            found.near(name, off, 0.0, 0.3);
        }
    }
    if !trial.quick {
        let deep = Vessel { count: DEEPER * vessel.count, ..vessel };
        let deep = Bed::settle(world(&deep, false)?, 0.1, trial)?;
        let [speed, rolling] = [speeds[speeds.len() - 1], ROLLING[1]];
        let last = ball(speed, rolling);
        let path = deep.hit(&[last], "ball", trial)?.remove(0);
        let (deep, shallow) = (Collision::new(&last, &path), &rows[1][speeds.len() - 1]);
        found.near("deeper_bed_depth_ratio", deep.depth / shallow.depth, 1.0, 0.1);
        found.near("deeper_bed_time_ratio", deep.time / shallow.time, 1.0, 0.1);
        found.near("deeper_bed_peak_ratio", deep.peak / shallow.peak, 1.0, 0.1);
    }
    let curves: [(&'static str, &str, Value); 3] = [
        ("depth", "penetration", |c| c.depth),
        ("time", "collision time", |c| c.time),
        ("peak", "peak acceleration", |c| c.peak),
    ];
    for ((name, label, of), unit) in curves.into_iter().zip(["m", "s", "m/s²"]) {
        found.figures.push((name, by_speed_figure(Axis::new(label, unit), speeds, &rows, of)));
    }
    let name = |ball: &Ball| format!("{} m/s, μr = {}", ball.speed, ball.rolling.unwrap_or(f64::NAN));
    let names: Vec<String> = falls.iter().map(name).collect();
    found.figures.push(("fall", paths_figure("A ball of 1 kg sinks into beads", &names, &paths)));
    Ok(found)
}

/// The bed before it settles.
fn world(vessel: &Vessel, quick: bool) -> Result<WorldSpec, CaseError> {
    let Vessel { radius, count } = *vessel;
    let mut sets = vec![
        format!("particles.bed.count={count:.0}"),
        format!(
            "particles.bed.region={{ min = [-{radius:?}, -{radius:?}, 0], max = [{radius:?}, {radius:?}, 0.45] }}"
        ),
        format!("geometry.vessel.cylinder.radius={radius:?}"),
    ];
    if quick {
        sets.push("time.step=7e-6".to_owned());
    }
    Ok(keep(SCENE.world(&sets)?, |x, bead| x[0].hypot(x[1]) < radius - bead))
}

/// Ratios of each value to the one before it.
fn ratios(values: &[f64]) -> impl Iterator<Item = f64> {
    values.windows(2).map(|pair| pair[1] / pair[0])
}

fn by_speed_figure(y: Axis, speeds: &[f64], rows: &[&[Collision]], of: Value) -> String {
    let names = ROLLING.map(|rolling| format!("μr = {rolling}"));
    let values: Vec<Vec<f64>> = rows.iter().map(|row| row.iter().map(of).collect()).collect();
    let curves = names.iter().zip(&values);
    Plot {
        title: "A ball of 1 kg falls on beads",
        x: Axis::new("speed at the surface", "m/s"),
        y: y.from_zero(),
        series: curves.map(|(name, y)| Series { name, x: speeds, y, style: Style::Line }).collect(),
        ..Plot::default()
    }
    .to_svg()
}
