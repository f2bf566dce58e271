//! A cell that deforms, and what drives it.
//!
//! The cell matrix C follows `Ċ = U C` with the velocity gradient U of the world. Particles move with `U x` and a
//! motion of their own: velocities of a state are the latter. In fractions of the cell the common motion is none, so
//! places stay exact integers, and steps encode nothing anew. A pair across a seam sees the velocity of the image, since
//! what it sees is `vⱼ - vᵢ + U d` with the branch d to the nearest image. Own velocities obey `v̇ = f/m - U v` (Evans
//! and Morriss, Phys. Rev. A 30, 1528, 1984, doi 10.1103/PhysRevA.30.1528), which does not ask where a particle is, so
//! every image moves alike; in steady simple shear that is Newton's second law of the whole motion.
//!
//! U is an upper triangle: the first cell vector keeps its direction, and the second stays in the plane of the first
//! two.
//!
//! A cell that shears on and on would lean ever more. The images of all particles are those of a lattice, which other
//! cells have too: where a vector has come to lean by more than [`LEAN`] of the length that it leans along, whole periods
//! are taken off it, and places are told in the new cell. Neither forces nor motions change by that, so a sample may shear
//! without end (Lees and Edwards, J. Phys. C 5, 1921, 1972, doi 10.1088/0022-3719/5/15/006, with seams that slide
//! instead).
//!
//! A component of U is prescribed, or a servo goes for a stress: every few steps, the same number on every backend, it
//! looks at the stress and sets a rate for the steps to come, in proportion to what is missing, with a part that adds
//! up. What a strain would do to the stress it takes from the sample: the stiffness of its contacts, as if each
//! particle had six.
//!
//! Steps between two acts are as many as change the largest target σ by a tenth, at the rates ε̇ that are known
//! beforehand (the inertial number's and the prescribed ones) and without anything giving way: `n = σ / (10 M ε̇ Δt)`,
//! 1 to 20. The modulus is that of the mean field with six contacts a grain at a solid share of 0.6, `M = 0.7 k/d`, and
//! the stiffness k of a contact that of two mean grains that meet at `√(σ/ρ)`: such an impact presses them as σ does,
//! whatever the law. So n is a function of the scene alone.
//!
//! Its rates are at most those of the stage's inertial number, and what the prescribed rates may ask for besides. A
//! sample dissipates: against a held stress σₕ it gives no more work than prescribed rates put in, `σₕ |ε̇ₕ| ≤ Σ σ
//! ε̇`. So one that dilates at a ratio R of stresses may widen R times as fast as it is shortened, and no limit may
//! be below.

use std::f64::consts::PI;

use glebe_physics::Impact;
use serde::{Deserialize, Serialize};

use crate::failure::SetupError;
use crate::lattice::{Lattice, Vec3x3, determinant, product};
use crate::measure::Tensors;
use crate::setup::Constants;
use crate::spec::{Deformation, Drive};
use crate::state::Progress;

/// Most strain per step \[-\], each component.
pub const STRAIN_PER_STEP: f64 = 1e-4;
/// What a displacement may grow by when it is seen in the cell of the next step: all components together.
pub const STEP_GROWTH: f64 = 1.0 + 6.0 * STRAIN_PER_STEP;
/// Cut-offs that a window of a cell that deforms is high at the start, instead of 2.5: as long as one window is higher
/// than two of them the cell may go on, so each axis may shorten to 55 % before that; cells of one window to two
/// cut-offs.
pub const WINDOW: f64 = 3.6;

/// Share of a length up to which a cell vector leans along it. More than a half, so that a shear to and fro does not turn
/// the cell again and again.
pub const LEAN: f64 = 0.55;
/// Strain after which a cell whose shear follows a stress is looked at again.
const LOOK: f64 = 0.1;

/// Share of a missing stress that the servo makes good until it looks again.
const GAIN: f64 = 0.3;
/// Share that its rate grows by for as long as stress is missing and it is not as fast as allowed.
const RESET: f64 = 0.03;
/// Share of the way to a new rate that it goes at once. Dashpots answer a rate with a stress, which would turn the rate
/// around the next time: whatever the restitution, theirs is at most a few times the missing stress.
const EASE: f64 = 0.25;
/// Share of the largest target by which the stress may change until the servo looks again.
const CHANGE: f64 = 0.1;
/// Most steps between two acts: softer samples need no more of them than these.
const CONTROL_STEPS_MOST: f64 = 20.0;

/// Row and column of the driven components, in the order of [`Deformation::drive`].
pub const COMPONENTS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]];

/// The cell of a world that deforms, as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// C \[m\]; columns are the cell vectors.
    pub matrix: Vec3x3,
    /// U \[1/s\].
    pub gradient: Vec3x3,
    /// Strain since the start, positive in compression: minus the sum of the symmetric parts of `U Δt` \[-\].
    pub strain: Vec3x3,
    /// Sum of `|U| Δt` since the start \[-\]: no distance has shrunk by more than a factor `exp(-path)`.
    pub path: f64,
    /// C at the last rebuild \[m\].
    pub reference: Vec3x3,
    /// `path` at the last rebuild.
    pub reference_path: f64,
    /// Part of the servo's rates that adds up, by component \[1/s\].
    pub held: [f64; 6],
    /// Steps done when the servo last acted, and one.
    pub governed: u64,
}

impl Cell {
    /// A cell that has not moved yet.
    pub fn new(matrix: Vec3x3) -> Self {
        let none = [[0.0; 3]; 3];
        Self {
            matrix,
            gradient: none,
            strain: none,
            path: 0.0,
            reference: matrix,
            reference_path: 0.0,
            held: [0.0; 6],
            governed: 0,
        }
    }

    /// Takes up the prescribed rates of a stage; the servo has not acted yet.
    pub fn begin(&mut self, deformation: Option<&Deformation>) {
        self.gradient = [[0.0; 3]; 3];
        self.held = [0.0; 6];
        let drives = deformation.map(|d| d.drive).unwrap_or_default();
        for (drive, [a, b]) in drives.into_iter().zip(COMPONENTS) {
            if let Drive::Rate(rate) = drive {
                self.gradient[a][b] = -rate;
            }
        }
    }

    /// Sets the rates of the servo until it acts again, `interval` \[s\] later.
    fn govern(&mut self, c: &Constants, d: &Deformation, interval: f64, t: &Tensors) {
        let volume = determinant(&self.matrix);
        let pressure = (0..3).map(|k| stress(t, k)).sum::<f64>() / (3.0 * volume);
        let scale = largest_target(d);
        let scale = if scale > 0.0 { scale } else { pressure.max(0.0) };
        let limit = (own_rate(c, d, scale) + power(d, t) / volume / scale.max(f64::MIN_POSITIVE))
            .min(STRAIN_PER_STEP / c.dt);
        // The mean field of an isotropic sample with six contacts a particle: a fifth of Σ k d²/V against a strain
        // along an axis, a fifteenth against an angle.
        let contacts = 3.0 * t.particles as f64;
        let stiffness = t.stiffness / (t.contacts.max(1) as f64) * contacts / volume;
        for (k, target) in d.targets() {
            let modulus = stiffness / if k < 3 { 5.0 } else { 15.0 };
            let missing = target - stress(t, k) / volume;
            // Without a contact nothing is known of the stiffness: as fast as allowed.
            let strain = if modulus > 0.0 { missing / modulus } else { missing.signum() * f64::MAX };
            let wanted = self.held[k] + GAIN * strain / interval;
            if wanted.abs() < limit {
                self.held[k] += RESET * strain / interval;
            }
            let [a, b] = COMPONENTS[k];
            let before = -self.gradient[a][b];
            let rate = before + EASE * (wanted.clamp(-limit, limit) - before);
            self.gradient[a][b] = -rate.clamp(-limit, limit);
        }
    }

    /// The cell after a step `dt` \[s\].
    pub fn step(&mut self, dt: f64) {
        for (a, row) in self.strain.iter_mut().enumerate() {
            for (b, x) in row.iter_mut().enumerate() {
                *x -= 0.5 * dt * (self.gradient[a][b] + self.gradient[b][a]);
            }
        }
        self.matrix = product(&self.map(dt), &self.matrix);
        self.path += dt * self.gradient.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
    }

    /// The affine map of the next step `dt` \[s\], `I + U Δt`.
    pub fn map(&self, dt: f64) -> Vec3x3 {
        [0, 1, 2].map(|a| [0, 1, 2].map(|b| f64::from(u8::from(a == b)) + dt * self.gradient[a][b]))
    }

    /// The periods to take off: of the second vector off the third, of the first off the third, of the first off the
    /// second; none if the cell leans little.
    pub fn leaning(&self) -> Option<[i64; 3]> {
        let [[x, xy, xz], [_, y, yz], _] = self.matrix;
        let off =
            |lean: f64, length: f64| if lean.abs() > LEAN * length { (lean / length).round() } else { 0.0 };
        let yz = off(yz, y);
        let off = [yz, off(xz - yz * xy, x), off(xy, x)];
        (off != [0.0; 3]).then(|| off.map(|n| n as i64))
    }

    /// The cell with these periods taken off, of the same images.
    pub fn upright(&mut self, [yz, xz, xy]: [i64; 3]) {
        for [a, b, c] in &mut self.matrix {
            *c -= yz as f64 * *b + xz as f64 * *a;
            *b -= xy as f64 * *a;
        }
    }

    /// Steps `dt` \[s\] of at most `most` until the cell leans too much, where its rates of shear stay what they are, or
    /// until it should be looked at where they follow the servo of `d`.
    pub fn steps_upright(&self, d: &Deformation, dt: f64, most: u64) -> u64 {
        let followed = d.drive[3..].iter().any(|drive| matches!(drive, Drive::Stress(_)));
        let most = if followed { most.min((LOOK / STRAIN_PER_STEP) as u64) } else { most };
        if self.gradient[0][1] == 0.0 && self.gradient[0][2] == 0.0 && self.gradient[1][2] == 0.0 {
            return most;
        }
        let mut cell = *self;
        let upright = |_: &u64| {
            cell.step(dt);
            cell.leaning().is_none()
        };
        (1..most).take_while(upright).count() as u64 + 1
    }

    /// Makes the present cell the one that lists are made of.
    pub fn refer(&mut self) {
        self.reference = self.matrix;
        self.reference_path = self.path;
    }

    /// What is left of a skin \[m\] of lists that hold pairs up to `touch` + `skin`.
    pub fn skin_left(&self, skin: f64, touch: f64) -> f64 {
        skin - (self.path - self.reference_path) * (touch + skin)
    }
}

/// Volume times stress of a component, of contacts and motion \[J\]; shear as the mean of both.
fn stress(t: &Tensors, component: usize) -> f64 {
    let [a, b] = COMPONENTS[component];
    0.5 * (t.contact[a][b] + t.contact[b][a] + t.kinetic[a][b] + t.kinetic[b][a])
}

/// The largest of the stresses that a servo goes for \[Pa\]; 0 if it goes for none.
fn largest_target(d: &Deformation) -> f64 {
    d.targets().map(|(_, target)| target.abs()).fold(0.0, f64::max)
}

/// Strain rate of the inertial number at a stress \[1/s\].
fn own_rate(c: &Constants, d: &Deformation, stress: f64) -> f64 {
    d.inertial_number / (2.0 * c.radius_mean) * (stress / c.density_mean).sqrt()
}

/// Steps between two acts of the servo: those given, or what stiffness, stress and rates allow.
pub fn control_steps(c: &Constants, d: &Deformation) -> u64 {
    d.control_steps.unwrap_or_else(|| {
        let stress = largest_target(d);
        let given: f64 =
            d.drive.iter().map(|x| if let Drive::Rate(rate) = x { rate.abs() } else { 0.0 }).sum();
        let rate = own_rate(c, d, stress) + given;
        let change = modulus(c, stress) * rate * c.dt;
        // Against targets of 0 alone no change is small.
        let steps = if stress > 0.0 { CHANGE * stress / change } else { CONTROL_STEPS_MOST };
        steps.clamp(1.0, CONTROL_STEPS_MOST) as u64
    })
}

/// Modulus of a sample under a stress, at most \[Pa\]: the mean field of the stiffest pair of materials.
fn modulus(c: &Constants, stress: f64) -> f64 {
    let diameter = 2.0 * c.radius_mean;
    let mass = c.density_mean * PI / 6.0 * diameter.powi(3);
    let impact = Impact { m_eff: 0.5 * mass, r_eff: 0.25 * diameter, diameter };
    let speed = (stress / c.density_mean).sqrt();
    let times = c.pairs.iter().map(|p| p.laws.normal.collision_time(&p.normal, &impact, speed));
    let stiffness = impact.m_eff * (PI / times.fold(f64::INFINITY, f64::min)).powi(2);
    0.7 * stiffness / diameter
}

/// What prescribed rates put into the sample \[W\], or 0 if they take out.
fn power(d: &Deformation, t: &Tensors) -> f64 {
    let put_in = |(k, drive): (usize, &Drive)| match drive {
        Drive::Rate(rate) => rate * stress(t, k),
        Drive::Stress(_) => 0.0,
    };
    d.drive.iter().enumerate().map(put_in).sum::<f64>().max(0.0)
}

/// How far the stresses are from those that a servo goes for, as a share of the largest of these.
pub fn off_target(d: &Deformation, t: &Tensors, cell: &Vec3x3) -> f64 {
    let volume = determinant(cell);
    let most = |values: &mut dyn Iterator<Item = f64>| values.map(f64::abs).fold(0.0, f64::max);
    let off = most(&mut d.targets().map(|(k, target)| target - stress(t, k) / volume));
    off / most(&mut d.targets().map(|(_, target)| target)).max(f64::MIN_POSITIVE)
}

impl Constants {
    /// How the servo drives the cell, if it does in the present stage, and the steps between two of its acts.
    fn servo(&self, g: &Progress) -> Option<(&Deformation, u64)> {
        let deformation = self.spec.stages.get(g.stage)?.deformation.as_ref()?;
        deformation.targets().next().map(|_| (deformation, self.control_steps[g.stage]))
    }

    /// Whether the servo looks at the stress before the next step.
    pub fn governs(&self, g: &Progress) -> bool {
        let due = |(_, every)| (g.step - g.stage_since).is_multiple_of(every);
        self.servo(g).is_some_and(due) && g.cell.is_some_and(|cell| cell.governed != g.step + 1)
    }

    /// Steps until it does so the next time.
    pub fn steps_governed(&self, g: &Progress) -> u64 {
        self.servo(g).map_or(u64::MAX, |(_, every)| every - (g.step - g.stage_since) % every)
    }

    /// Lets the servo act on what it sees.
    pub fn govern(&self, g: &mut Progress, tensors: Option<&Tensors>) {
        let step = g.step;
        let servo = self.servo(g);
        if let (Some((d, every)), Some(cell), Some(t)) = (servo, &mut g.cell, tensors) {
            cell.govern(self, d, every as f64 * self.dt, t);
            cell.governed = step + 1;
        }
    }
}

/// The first axis along which a cell is less than two cut-offs high \[m\], with its height \[m\]: a particle could
/// meet two images of another.
pub fn too_narrow(lattice: &Lattice, cutoff: f64) -> Option<(usize, f64)> {
    (0..3).map(|k| (k, lattice.height[k])).find(|(_, h)| *h < 2.0 * cutoff)
}

/// Refuses what a world that deforms cannot have, and warns of what is too fast.
pub fn check(c: &Constants) -> Result<Vec<String>, SetupError> {
    let (spec, dt) = (&c.spec, c.dt);
    let bad = |what: String| Err(SetupError::Invalid(what));
    let stages: Vec<_> =
        spec.stages.iter().filter_map(|s| Some((s.name.as_str(), s.deformation.as_ref()?))).collect();
    let unmet = spec.stages.iter().find(|s| {
        s.until.stress_within.is_some() && s.deformation.is_none_or(|d| d.targets().next().is_none())
    });
    if let Some(stage) = unmet {
        return bad(format!(
            "the stage `{}` ends at a stress, but goes for none; give the cell a stress in it",
            stage.name
        ));
    }
    let Some((name, _)) = stages.first() else { return Ok(Vec::new()) };
    if !c.is_sample() {
        return bad(format!(
            "the stage `{name}` deforms the cell, but the world has walls, open sides or surfaces; only a cell that is \
             periodic along x, y and z and has none can deform"
        ));
    }
    if spec.gravity != [0.0; 3] {
        return bad(format!(
            "the stage `{name}` deforms the cell, and there is gravity; a sample would fall without end. Set gravity to \
             [0, 0, 0]"
        ));
    }
    if [[1, 0], [2, 0], [2, 1]].into_iter().any(|[a, b]| spec.domain.cell[a][b] != 0.0) {
        return bad(format!(
            "the stage `{name}` deforms the cell, whose first vector is not along x, or whose second is not in the plane of \
             x and y; turn the cell"
        ));
    }
    let mut warnings = Vec::new();
    for (name, d) in stages {
        if d.control_steps == Some(0) {
            return bad(format!(
                "the servo of the stage `{name}` acts every 0 steps; give 1 or more, or leave it out"
            ));
        }
        if !(d.inertial_number > 0.0 && d.inertial_number.is_finite()) {
            return bad(format!(
                "the servo of the stage `{name}` acts up to an inertial number of {}; it is above 0",
                d.inertial_number
            ));
        }
        if let Some((_, target)) = d.targets().find(|(_, target)| !target.is_finite()) {
            return bad(format!("the stage `{name}` goes for a stress of {target} Pa"));
        }
        let scale = largest_target(d);
        for drive in d.drive {
            let Drive::Rate(rate) = drive else { continue };
            if !rate.is_finite() || rate.abs() * dt > STRAIN_PER_STEP {
                return bad(format!(
                    "the stage `{name}` strains the cell by {:e} a step ({rate:e} 1/s over {dt:e} s); allowed is \
                     {STRAIN_PER_STEP:e}. Lower the rate",
                    rate.abs() * dt
                ));
            }
            let own = own_rate(c, d, scale);
            if scale > 0.0 && rate.abs() > own * (1.0 + 1e-9) {
                warnings.push(format!(
                    "the stage `{name}` strains the cell at an inertial number of {:.1e} at {scale:e} Pa, above {:.1e}: its \
                     curves depend on the rate. At {own:.3e} 1/s they hardly would",
                    d.inertial_number * rate.abs() / own,
                    d.inertial_number
                ));
            }
        }
    }
    Ok(warnings)
}
