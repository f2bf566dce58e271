//! A half full drum turns faster and faster (Fang et al. 2021, section 4.2.4, figure 13, table 2).
//!
//! The paper's: a drum of 60 mm x 5 mm, half full of spheres (R 0.265 mm by its table, ρ 2500 kg/m³, E 7e7 Pa, ν
//! 0.24, e 0.97, μ 0.16 among them and 0.45 on the wall, μr 0.09), a step of 1e-6 s, Froude numbers `Fr = ω² R/g` of
//! 1e-3, 0.01, 0.5, 1.5, and what is to be seen: rolling, cascading, cataracting, centrifuging. The paper has
//! pictures only. Its 1e-4, which rolls like 1e-3, would take 1e12 particle-steps and is left out.
//!
//! Chosen: 52 600 spheres; how far the drum turns (half a turn below Fr = 0.01, one there, two above), of which the
//! second half is observed; and by what the regimes are told apart:
//!
//! - wall covered: share of sectors of 10° in which a sphere is within 0.75 of a diameter of the wall (centres within
//!   1.25). A bed that rolls covers half of them (up to 0.65 asked for), a drum that centrifuges all (0.99).
//! - in flight: share of spheres that touch nothing and are where the section, in cells two diameters wide and one high,
//!   is less than half as dense as a bed (0.58). Touching nothing alone tells no regime: in a layer that flows spheres
//!   collide, and the stiffer they are the less of the time they touch. Few in a bed that rolls or cascades (below
//!   0.1), many that cataract (above 0.1).
//! - slope of the middle half of the surface of a bed that rolls or cascades, where the mean section is half as dense as
//!   a bed: between 15° and 45°, the range of glass beads. The highest spheres of a column are those that jump.
//! - height of the centre of mass over the axis, which rises from one regime to the next.
//!
//! The quick size has spheres of 1 mm, 3320 of them, E 7e6 Pa, a step of 1.5e-5 s, and Fr = 0.01, 0.5, 1.5. Its ends are
//! as many diameters apart as the paper's, 9.4: friction on the ends adds its share of the flowing layer's depth over
//! that distance to the slope. The torque against rolling is the paper's, by each body's own radius (`chrono`).
//!
//! The full size takes 52.6 k · 1.1e7 = 6e11 particle-steps, 3e11 of them for Fr = 1e-3.

use std::f64::consts::{PI, TAU};

use glebe_engine::batch::{Frame, Status};
use glebe_engine::prepare;
use glebe_engine::spec::WorldSpec;
use glebe_report::{Axis, Plot, Series, Style};
use glebe_study::fit::line;

use super::case::{Case, CaseError, Findings};
use super::trial::{Look, SceneFile, Trial, least, mean, run_with, scene_file, settled};

pub(super) const CASE: Case = Case {
    id: "B7",
    name: "drum",
    shows: "a half full drum rolls, cascades, cataracts and centrifuges as it turns faster",
    source: "Fang et al. 2021 (Chrono::GPU), section 4.2.4, figure 13, table 2",
    run,
};

const SCENE: SceneFile = scene_file!("B7-drum/scene.toml");
/// Radius of the drum \[m\].
const DRUM: f64 = 0.03;
/// Distance of its ends \[m\]: the paper's, and as many diameters of the quick size.
const LENGTH: f64 = 0.005;
const QUICK_LENGTH: f64 = 0.018868;
/// Solid fraction of a bed.
const BULK: f64 = 0.58;
const GRAVITY: f64 = 9.81;
/// From this Froude number on spheres are flung, and from that on they stay at the wall.
const FLUNG: f64 = 0.1;
const HELD: f64 = 1.0;
const SECTORS: usize = 36;
/// Most spheres that a picture shows.
const SHOWN: usize = 4000;

/// What a drum shows, as means over the time that it is observed.
#[derive(Clone, Debug, Default)]
struct Seen {
    covered: Vec<f64>,
    flying: Vec<f64>,
    /// Sum of the sections that were looked at.
    section: Option<Section>,
    height: Vec<f64>,
    speed: Vec<f64>,
    /// Positions in the drum's section, and speeds over the wall's, when last looked at.
    last: Vec<[f64; 3]>,
}

/// Solid fractions over the drum's section, in cells two diameters wide and one high.
#[derive(Clone, Debug)]
struct Section {
    /// Diameter of a sphere \[m\].
    diameter: f64,
    /// Columns, each from below.
    columns: Vec<Vec<f64>>,
}

impl Section {
    fn new(positions: &[[f64; 3]], radius: f64, length: f64) -> Self {
        let diameter = 2.0 * radius;
        let [across, up] = [2.0, 1.0].map(|cells: f64| (2.0 * DRUM / (cells * diameter)).ceil() as usize);
        let mut section = Self { diameter, columns: vec![vec![0.0; up]; across] };
        let share = 4.0 / 3.0 * PI * radius.powi(3) / (2.0 * diameter * diameter * length);
        for [x, _, z] in positions {
            let [column, row] = section.cell(*x, *z);
            section.columns[column][row] += share;
        }
        section
    }

    /// Column and row of a place.
    fn cell(&self, x: f64, z: f64) -> [usize; 2] {
        let column = (x + DRUM) / (2.0 * self.diameter);
        let row = (z + DRUM) / self.diameter;
        let last = self.columns.len() - 1;
        [(column as usize).min(last), (row as usize).min(self.columns[0].len() - 1)]
    }

    fn add(&mut self, other: &Self) {
        for (all, new) in self.columns.iter_mut().flatten().zip(other.columns.iter().flatten()) {
            *all += new;
        }
    }

    /// Inclination of the surface \[deg\]: the line through the heights at which columns within half the drum's radius of
    /// its axis are half as dense as a bed, as means over so many sections.
    fn slope(&self, sections: usize) -> f64 {
        let edge = 0.5 * BULK * sections as f64;
        let (mut x, mut z) = (Vec::new(), Vec::new());
        for (k, column) in self.columns.iter().enumerate() {
            let at = (k as f64 + 0.5) * 2.0 * self.diameter - DRUM;
            let Some(top) = column.iter().rposition(|share| *share >= edge) else { continue };
            let above = column.get(top + 1).copied().unwrap_or(0.0);
            let part = (column[top] - edge) / (column[top] - above);
            if at.abs() < 0.5 * DRUM {
                x.push(at);
                z.push((top as f64 + 0.5 + part) * self.diameter - DRUM);
            }
        }
        line(&x, &z).map_or(f64::NAN, |[_, b]| b.atan().to_degrees().abs())
    }
}

/// A drum's speed.
#[derive(Clone, Copy)]
struct Drum {
    froude: f64,
    /// \[rad/s\]
    rate: f64,
    /// How long it turns \[s\].
    duration: f64,
}

impl Drum {
    fn new(froude: f64) -> Self {
        let rate = (froude * GRAVITY / DRUM).sqrt();
        let turns = if froude > FLUNG {
            2.0
        } else if froude < 0.01 {
            0.5
        } else {
            1.0
        };
        Self { froude, rate, duration: turns * TAU / rate }
    }

    fn world(self, quick: bool) -> Result<WorldSpec, CaseError> {
        let mut sets = vec![
            format!("stage.turn.duration={:?}", self.duration),
            format!("stage.turn.move.drum.rotation.rate={:?}", self.rate),
            format!("output.series={:?}", self.duration / 200.0),
        ];
        if quick {
            let end = 0.5 * QUICK_LENGTH;
            sets.push(format!("geometry.drum.cylinder.length={QUICK_LENGTH:?}"));
            sets.push(format!(
                "particles.grains.region={{ min = [-0.0208, -{end:?}, -0.0208], max = [0.0208, {end:?}, 0.0208] }}"
            ));
            let coarse = [
                "particles.grains.count=3320",
                "domain.min=[-0.035, -0.012, -0.035]",
                "domain.max=[0.035, 0.012, 0.035]",
                "particles.grains.radius=\"1 mm\"",
                "material.grain.youngs_modulus=7e6",
                "material.wall.youngs_modulus=7e6",
                "time.step=1.5e-5",
            ];
            sets.extend(coarse.map(str::to_owned));
        }
        SCENE.world(&sets)
    }
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let drums: Vec<Drum> = if trial.quick { vec![0.01, 0.5, 1.5] } else { vec![1e-3, 0.01, 0.5, 1.5] }
        .into_iter()
        .map(Drum::new)
        .collect();
    let (_, bed) = settled(drums[0].world(trial.quick)?, trial.backend)?;
    let worlds = drums
        .iter()
        .map(|drum| Ok((prepare(drum.world(trial.quick)?)?.0, bed.clone())))
        .collect::<Result<Vec<_>, CaseError>>()?;
    let began = bed.progress.step as f64 * worlds[0].0.dt;
    let mut seen = vec![Seen::default(); drums.len()];
    let length = if trial.quick { QUICK_LENGTH } else { LENGTH };
    let mut look = Look(|world: usize, frame: &Frame<'_>| {
        let drum = drums[world];
        if frame.time - began > 0.5 * drum.duration {
            seen[world].add(drum, length, frame);
        }
    });
    let batch = run_with(worlds, trial.backend, &mut look)?;
    let mut found = Findings::default();
    for (w, drum) in drums.iter().enumerate() {
        if *batch.status(w) != Status::Done {
            return Err(CaseError::stopped(&batch.constants(w).spec.title, batch.status(w)));
        }
        let lost = batch.progress(w).lost.len() as f64;
        found.zero(format!("Fr_{}_lost", drum.froude), lost);
        seen[w].judge(*drum, &mut found);
    }
    let heights: Vec<f64> = seen.iter().map(|s| mean(s.height.iter().copied())).collect();
    let least = least(heights.windows(2).map(|pair| pair[1] - pair[0]));
    found.between("least_rise_of_the_centre_over_R", least, 0.0, 1.0);
    let pictures = ["picture-1", "picture-2", "picture-3", "picture-4"];
    for ((name, drum), seen) in pictures.into_iter().zip(&drums).zip(&seen) {
        found.figures.push((name, picture(*drum, seen)));
    }
    found.figures.push(("regimes", figure(&drums, &seen)));
    Ok(found)
}

impl Seen {
    fn add(&mut self, drum: Drum, length: f64, frame: &Frame<'_>) {
        let particles = &frame.state.particles;
        let n = particles.len();
        let radius = particles.place.first().map_or(f64::NAN, |p| f64::from(p.radius));
        let wall = drum.rate * DRUM;
        let speed = |k: usize| {
            let v = particles.velocity[k].v.map(f64::from);
            (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt() / wall
        };
        let mut sectors = [false; SECTORS];
        for [x, _, z] in frame.positions {
            if x.hypot(*z) > DRUM - 2.5 * radius {
                let sector = (z.atan2(*x) + PI) / TAU * SECTORS as f64;
                sectors[(sector as usize).min(SECTORS - 1)] = true;
            }
        }
        self.covered.push(sectors.iter().filter(|s| **s).count() as f64 / SECTORS as f64);
        let section = Section::new(frame.positions, radius, length);
        let flies = |k: &usize| {
            let [column, row] = section.cell(frame.positions[*k][0], frame.positions[*k][2]);
            frame.detail().coordination[*k] == 0 && section.columns[column][row] < 0.5 * BULK
        };
        self.flying.push((0..n).filter(flies).count() as f64 / n as f64);
        match &mut self.section {
            Some(sum) => sum.add(&section),
            None => self.section = Some(section),
        }
        self.height.push(mean(frame.positions.iter().map(|x| x[2])) / DRUM);
        self.speed.push(mean((0..n).map(speed)));
        self.last = frame.positions.iter().enumerate().map(|(k, x)| [x[0], x[2], speed(k)]).collect();
    }

    fn judge(&self, drum: Drum, found: &mut Findings) {
        let of = |values: &[f64]| mean(values.iter().copied());
        let name = |what: &str| format!("Fr_{}_{what}", drum.froude);
        let [covered, flying] = [&self.covered, &self.flying].map(|v| of(v));
        let slope = self.section.as_ref().map_or(f64::NAN, |section| section.slope(self.flying.len()));
        found.report(name("centre_height_over_R"), of(&self.height));
        found.report(name("mean_speed_over_wall"), of(&self.speed));
        if drum.froude > HELD {
            found.between(name("wall_covered"), covered, 0.99, 1.0);
            found.report(name("in_flight"), flying);
        } else if drum.froude > FLUNG {
            found.report(name("wall_covered"), covered);
            found.between(name("in_flight"), flying, 0.1, 1.0);
        } else {
            found.between(name("wall_covered"), covered, 0.0, 0.65);
            found.between(name("in_flight"), flying, 0.0, 0.1);
            found.between(name("slope_deg"), slope, 15.0, 45.0);
        }
    }
}

fn picture(drum: Drum, seen: &Seen) -> String {
    let every = seen.last.len().div_ceil(SHOWN).max(1);
    let bands = [("below 0.3", 0.0, 0.3), ("0.3 to 0.8", 0.3, 0.8), ("above 0.8", 0.8, f64::INFINITY)];
    let spheres = bands.map(|(name, low, high)| {
        let inside = seen.last.iter().step_by(every).filter(|s| (low..high).contains(&s[2]));
        let (x, z): (Vec<f64>, Vec<f64>) = inside.map(|s| (s[0], s[1])).unzip();
        (format!("|v|/(ωR) {name}"), x, z)
    });
    let around: Vec<f64> = (0..=120).map(|k| TAU * f64::from(k) / 120.0).collect();
    let [x, z] = [f64::cos, f64::sin].map(|f| around.iter().map(|a| DRUM * f(*a)).collect::<Vec<_>>());
    let mut series: Vec<Series<'_>> =
        spheres.iter().map(|(name, x, y)| Series { name, x, y, style: Style::Points }).collect();
    series.push(Series { name: "", x: &x, y: &z, style: Style::Line });
    Plot {
        title: &format!("A drum at Fr = {}", drum.froude),
        x: Axis::new("x", "m"),
        y: Axis::new("z", "m"),
        series,
        equal_units: true,
        ..Plot::default()
    }
    .to_svg()
}

fn figure(drums: &[Drum], seen: &[Seen]) -> String {
    let x: Vec<f64> = drums.iter().map(|d| d.froude).collect();
    let of = |column: fn(&Seen) -> &Vec<f64>| -> Vec<f64> {
        seen.iter().map(|s| mean(column(s).iter().copied())).collect()
    };
    let [covered, flying, height] = [of(|s| &s.covered), of(|s| &s.flying), of(|s| &s.height)];
    Plot {
        title: "Regimes of a half full drum",
        x: Axis::new("Froude number", "").log(),
        y: Axis::new("share, or height over R", ""),
        series: vec![
            Series { name: "wall covered", x: &x, y: &covered, style: Style::Line },
            Series { name: "in flight", x: &x, y: &flying, style: Style::Line },
            Series { name: "height of the centre of mass", x: &x, y: &height, style: Style::Line },
        ],
        ..Plot::default()
    }
    .to_svg()
}
