//! One step of the integrator for every particle.

use glebe_physics::kernel64::integrate::{Scheme, Visitor, locally_damped};
use glebe_physics::kernel64::vector::{V3, dot, minus, plus, scaled};

use super::{Body, array, carried, v3};
use crate::backend::common::runaway_distance;
use crate::lattice::{Lattice, Vec3x3, add, norm, sub};
use crate::setup::Constants;
use crate::spec::Vec3;

/// What a motion finds.
pub struct Moved {
    /// Velocities and spins before it.
    pub before: Vec<(V3, V3)>,
    /// Lowest particle that moved too far, or is not a number.
    pub runaway: Option<usize>,
    /// Work of seams on particles that crossed them \[J\].
    pub lifted: f64,
    /// Lost to local damping \[J\].
    pub damped: f64,
}

/// Moves all particles.
pub struct Motion<'a> {
    /// The world.
    pub c: &'a Constants,
    /// Positions in the cell as it is.
    pub lattice: &'a Lattice,
    /// Velocity gradient of the cell \[1/s\], if it deforms.
    pub gradient: Option<Vec3x3>,
    /// Its particles.
    pub bodies: &'a mut [Body],
    /// Force and torque on each; `None` ahead of the force.
    pub sums: Option<&'a [[V3; 2]]>,
    /// Whether there is no acceleration of a step before.
    pub first: bool,
}

impl Visitor for Motion<'_> {
    type Output = Moved;

    fn visit<S: Scheme>(self) -> Moved {
        let (dt, fall) = (self.c.dt, v3(self.c.fall()));
        let before = self.bodies.iter().map(|b| (b.v, b.w)).collect();
        let mut moved = Moved { before, runaway: None, lifted: 0.0, damped: 0.0 };
        for (i, b) in self.bodies.iter_mut().enumerate() {
            let dx = match self.sums {
                None => ahead::<S>(b, dt),
                Some(sums) => {
                    let (v, flow) = (b.v, carried(self.gradient, b.v));
                    let dx = with_force::<S>(b, sums[i], self.c, flow, self.first, &mut moved.damped);
                    moved.lifted -= 0.5 * dt * dot(flow, plus(v, b.v)) / b.inv_mass;
                    dx
                }
            };
            let far = runaway_distance(self.c);
            // Not a number fails the comparison too.
            if norm(dx) <= far {
                let before = b.turns(self.lattice);
                b.moved = add(b.moved, dx);
                moved.lifted += dot(v3(sub(b.turns(self.lattice), before)), fall) / b.inv_mass;
            } else {
                moved.runaway.get_or_insert(i);
            }
        }
        moved
    }
}

/// Moves a particle with the acceleration of the step before; returns its displacement.
fn ahead<S: Scheme>(b: &mut Body, dt: f64) -> Vec3 {
    let (v, w) = (array(b.v), array(b.w));
    let x = zip(v, array(b.a), |v, a| S::before(v, a, dt));
    let y = zip(w, array(b.alpha), |w, a| S::before(w, a, dt));
    b.v = v3(x.map(|s| s.v));
    b.w = v3(y.map(|s| s.v));
    x.map(|s| s.dx)
}

/// Moves a particle with force and torque; returns its displacement.
fn with_force<S: Scheme>(
    b: &mut Body,
    [force, torque]: [V3; 2],
    c: &Constants,
    flow: V3,
    first: bool,
    damped: &mut f64,
) -> Vec3 {
    let (dt, damping) = (c.dt, c.spec.local_damping);
    let free = plus(scaled(force, b.inv_mass), v3(c.spec.gravity));
    let turning = scaled(torque, b.inv_inertia());
    let reduced = |v: V3, a: V3| {
        v3(zip(array(v), array(a), |v, a| if damping > 0.0 { locally_damped(v, a, damping, dt) } else { a }))
    };
    let (a, alpha) = (reduced(b.v, free), reduced(b.w, turning));
    let braked = a;
    let a = minus(a, flow);
    let (a_old, alpha_old) = if first { (a, alpha) } else { (b.a, b.alpha) };
    let advance = |v: V3, a: V3, old: V3| {
        let (v, a, old) = (array(v), array(a), array(old));
        [0, 1, 2].map(|k| S::after(v[k], a[k], old[k], dt))
    };
    let (x, y) = (advance(b.v, a, a_old), advance(b.w, alpha, alpha_old));
    let (v, w) = (v3(x.map(|s| s.v)), v3(y.map(|s| s.v)));
    let work = |lost: V3, old: V3, new: V3| 0.5 * dt * dot(lost, plus(old, new));
    *damped += work(minus(free, braked), b.v, v) / b.inv_mass
        + work(minus(turning, alpha), b.w, w) / b.inv_inertia();
    (b.force, b.a, b.alpha, b.v, b.w) = (force, a, alpha, v, w);
    x.map(|s| s.dx)
}

fn zip<T>(a: Vec3, b: Vec3, f: impl Fn(f64, f64) -> T) -> [T; 3] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}
