//! A ball that falls on a bed.
//!
//! The engine's scenes have no ball that waits until a bed has settled, so the bed is made by a world of its own and
//! the ball is put over it in another, which begins with the settled particles at rest. It is let go a little above
//! the surface with the speed of its fall so far, and contacts of the bed have found their forces again before it
//! arrives. A slow ball starts so low that a sphere which stands out of the surface may be where it starts: the bed is
//! levelled there, such spheres are taken away.

use std::f64::consts::PI;

use glebe_engine::batch::{Glance, Status};
use glebe_engine::lattice::{norm, sub};
use glebe_engine::prepare;
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_report::{Axis, Plot, Series, Style};

use super::case::CaseError;
use super::trial::{Trial, Watch, at_rest, keep, mean, run_with, settled};

/// Height above the surface from which a ball is computed \[m\].
const ABOVE: f64 = 0.01;

/// A bed at rest.
pub struct Bed {
    /// Its world, with the settled particles and the stages that are left.
    spec: WorldSpec,
    /// Height of its surface \[m\]: that of an even bed of the same mass.
    pub surface: f64,
    /// Density of the bulk \[kg/m³\].
    pub density: f64,
}

/// A ball about to arrive.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    /// \[m\]
    pub radius: f64,
    /// Its density \[kg/m³\], which its material gets.
    pub density: f64,
    /// How fast it is when it meets the surface \[m/s\].
    pub speed: f64,
    /// Rolling friction of all materials while it falls; each has its own if none.
    pub rolling: Option<f64>,
}

/// How a ball moves: a row for each sample.
#[derive(Clone, Debug, Default)]
pub struct Path {
    /// Time since it meets the surface \[s\].
    pub time: Vec<f64>,
    /// Depth of its lowest point under the surface \[m\].
    pub depth: Vec<f64>,
    /// Velocity upwards \[m/s\].
    pub velocity: Vec<f64>,
}

impl Bed {
    /// Lets the particles of a world settle in its first stage. Density and surface are those of the middle, as wide as
    /// `width` along x and y: walls and floors order spheres, so these stay out of it.
    pub fn settle(spec: WorldSpec, width: f64, trial: Trial<'_>) -> Result<Self, CaseError> {
        let (constants, state) = settled(spec, trial.backend)?;
        let spec = at_rest(&constants, &state);
        let at = &spec.particles.position;
        let floor = spec.domain.origin[2];
        let in_middle = |x: Vec3| x[0].abs().max(x[1].abs()) < 0.5 * width;
        let middle: Vec<usize> = (0..at.len()).filter(|k| in_middle(at[*k])).collect();
        let top = middle.iter().map(|k| at[*k][2] - floor).fold(0.0, f64::max);
        let mass = |from: f64, to: f64| {
            let inside = middle.iter().filter(|k| (from..to).contains(&(at[**k][2] - floor)));
            inside.map(|k| mass_of(&spec, *k)).sum::<f64>()
        };
        // The middle half of the height is the bulk; what is above its middle has the bulk's density up to the surface.
        let [low, high] = [0.25 * top, 0.75 * top];
        let density = mass(low, high) / (width * width * (high - low));
        let surface = floor + high + mass(high, f64::INFINITY) / (width * width * density);
        Ok(Self { spec, surface, density })
    }

    /// The paths of balls of a material, each in a world of its own.
    pub fn hit(&self, balls: &[Ball], material: &str, trial: Trial<'_>) -> Result<Vec<Path>, CaseError> {
        let g = self.spec.gravity[2].abs();
        let worlds = balls.iter().map(|ball| self.with(ball, material, g)).collect::<Result<Vec<_>, _>>()?;
        // The ball is the last.
        let numbers: Vec<u32> = worlds.iter().map(|spec| spec.particles.len() as u32 - 1).collect();
        let worlds = worlds.into_iter().map(prepare).collect::<Result<Vec<_>, _>>()?;
        let mut paths = vec![Path::default(); balls.len()];
        let mut watch = Watch(|world: usize, seen: &Glance<'_>| {
            let particles = seen.particles;
            // A ball that has left the box leaves its path shorter.
            let Some(k) = particles.id.iter().position(|id| *id == numbers[world]) else { return };
            let (ball, path) = (&balls[world], &mut paths[world]);
            path.time.push(seen.time - approach(ball, g));
            path.depth.push(self.surface - (seen.positions[k][2] - ball.radius));
            path.velocity.push(f64::from(particles.velocity[k].v[2]));
        });
        let batch = run_with(worlds, trial.backend, &mut watch)?;
        for w in 0..batch.len() {
            if *batch.status(w) != Status::Done {
                return Err(CaseError::stopped(&batch.constants(w).spec.title, batch.status(w)));
            }
        }
        Ok(paths)
    }

    fn with(&self, ball: &Ball, material: &str, g: f64) -> Result<WorldSpec, CaseError> {
        let centre = [0.0, 0.0, self.surface + above(ball, g) + ball.radius];
        let in_the_way = |x: Vec3, radius: f64| norm(sub(x, centre)) < radius + ball.radius;
        let mut spec = keep(self.spec.clone(), |x, radius| !in_the_way(x, radius));
        let named = spec.materials.iter().position(|m| m.name == material);
        let id = named.ok_or_else(|| CaseError::Scene(format!("no material `{material}`")))?;
        spec.materials[id].density = ball.density;
        if let Some(rolling) = ball.rolling {
            spec.materials.iter_mut().for_each(|m| m.rolling_friction = rolling);
        }
        let speed = (ball.speed * ball.speed - 2.0 * g * above(ball, g)).max(0.0).sqrt();
        spec.particles.push_moving(centre, ball.radius, id, [0.0, 0.0, -speed], [0.0; 3]);
        Ok(spec)
    }
}

/// Depths over time, a named curve for each path.
pub fn paths_figure(title: &str, names: &[String], paths: &[Path]) -> String {
    let curves = names.iter().zip(paths);
    Plot {
        title,
        x: Axis::new("time since the surface", "s"),
        y: Axis::new("depth of the lowest point", "m"),
        series: curves
            .map(|(name, path)| Series { name, x: &path.time, y: &path.depth, style: Style::Line })
            .collect(),
        ..Plot::default()
    }
    .to_svg()
}

/// Height that a ball starts at: not more than it falls in all.
fn above(ball: &Ball, g: f64) -> f64 {
    ABOVE.min(ball.speed * ball.speed / (2.0 * g))
}

/// Time from its start to the surface \[s\].
fn approach(ball: &Ball, g: f64) -> f64 {
    let start = (ball.speed * ball.speed - 2.0 * g * above(ball, g)).max(0.0).sqrt();
    (ball.speed - start) / g
}

/// \[kg\]
fn mass_of(spec: &WorldSpec, k: usize) -> f64 {
    let particles = &spec.particles;
    4.0 / 3.0 * PI * particles.radius[k].powi(3) * spec.materials[particles.material[k]].density
}

impl Path {
    /// Deepest place of its lowest point under the surface \[m\].
    pub fn deepest(&self) -> f64 {
        self.depth.iter().copied().fold(f64::NAN, f64::max)
    }

    /// Time and depth \[s, m\] at which it is first no faster downwards than `speed` \[m/s\] under the surface; none if it
    /// never is.
    pub fn slowed_to(&self, speed: f64) -> Option<[f64; 2]> {
        let inside = self.time.iter().position(|t| *t > 0.0)?;
        let k = inside + self.velocity[inside..].iter().position(|v| *v >= -speed)?;
        let before = k.checked_sub(1)?;
        // Between two rows, at a velocity as straight as they are near each other.
        let [from, to] = [self.velocity[before], self.velocity[k]];
        let share = if to > from { (from + speed) / (from - to) } else { 1.0 };
        let between = |column: &[f64]| column[before] + share * (column[k] - column[before]);
        Some([between(&self.time), between(&self.depth)])
    }

    /// Largest acceleration upwards \[m/s²\], as means over a span \[s\].
    pub fn peak_acceleration(&self, span: f64) -> f64 {
        let row = self.time.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::NAN, f64::max);
        let rows = (span / row).round().max(1.0) as usize;
        let after = self.time.iter().zip(&self.velocity).skip(rows);
        let pairs = self.time.iter().zip(&self.velocity).zip(after);
        pairs.map(|((t0, v0), (t1, v1))| (v1 - v0) / (t1 - t0)).fold(f64::NAN, f64::max)
    }

    /// Mean speed of the last tenth of the rows \[m/s\].
    pub fn speed_left(&self) -> f64 {
        let last = self.velocity.len() - self.velocity.len() / 10;
        mean(self.velocity[last..].iter().map(|v| v.abs()))
    }
}
