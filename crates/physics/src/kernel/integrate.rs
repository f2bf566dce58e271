//! Time integration of one component of motion: position with velocity, or rotation with spin.
//!
//! A step is: `before` (schemes that move before the force is known), force, `after`.

use crate::IntegratorKind;
use crate::cube::*;

/// A component after (a part of) a step.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Advance {
    /// Velocity \[m/s\] or \[rad/s\].
    pub v: f32,
    /// Displacement in this part of the step \[m\] or \[rad\].
    pub dx: f32,
}

/// An integration scheme.
#[cfg_attr(feature = "gpu", cube)]
pub trait Scheme: Send + Sync + 'static {
    /// Ahead of the force, with the acceleration `a` of the step before.
    fn before(v: f32, a: f32, dt: f32) -> Advance;
    /// With the acceleration `a` of this step and `a_old` of the one before.
    fn after(v: f32, a: f32, a_old: f32, dt: f32) -> Advance;
}

/// Semi-implicit Euler: the new velocity moves the position (GPUDEM eq. 34-36).
pub struct Euler;

#[cfg_attr(feature = "gpu", cube)]
impl Scheme for Euler {
    #[inline(always)]
    fn before(v: f32, _a: f32, _dt: f32) -> Advance {
        Advance { v, dx: 0.0f32 }
    }
    #[inline(always)]
    fn after(v: f32, a: f32, _a_old: f32, dt: f32) -> Advance {
        let v = v + a * dt;
        Advance { v, dx: v * dt }
    }
}

/// Constant acceleration over the step (GPUDEM eq. 37).
pub struct Exact;

#[cfg_attr(feature = "gpu", cube)]
impl Scheme for Exact {
    #[inline(always)]
    fn before(v: f32, _a: f32, _dt: f32) -> Advance {
        Advance { v, dx: 0.0f32 }
    }
    #[inline(always)]
    fn after(v: f32, a: f32, _a_old: f32, dt: f32) -> Advance {
        Advance { v: v + a * dt, dx: (v + 0.5f32 * a * dt) * dt }
    }
}

/// Adams-Bashforth 2 for the velocity, trapezoid for the position (GPUDEM eq. 38-40). In the first step
/// `a_old = a`, which makes the velocity's step one of Euler.
pub struct Adams;

#[cfg_attr(feature = "gpu", cube)]
impl Scheme for Adams {
    #[inline(always)]
    fn before(v: f32, _a: f32, _dt: f32) -> Advance {
        Advance { v, dx: 0.0f32 }
    }
    #[inline(always)]
    fn after(v: f32, a: f32, a_old: f32, dt: f32) -> Advance {
        let new = v + dt * (1.5f32 * a - 0.5f32 * a_old);
        Advance { v: new, dx: 0.5f32 * dt * (v + new) }
    }
}

/// Velocity Verlet.
pub struct VelocityVerlet;

#[cfg_attr(feature = "gpu", cube)]
impl Scheme for VelocityVerlet {
    #[inline(always)]
    fn before(v: f32, a: f32, dt: f32) -> Advance {
        let v = v + 0.5f32 * a * dt;
        Advance { v, dx: v * dt }
    }
    #[inline(always)]
    fn after(v: f32, a: f32, _a_old: f32, dt: f32) -> Advance {
        Advance { v: v + 0.5f32 * a * dt, dx: 0.0f32 }
    }
}

/// Local non-viscous damping of one component (RVE paper): an acceleration that does positive work is
/// reduced by the fraction `c`, one that does negative work is raised by it. Judged at mid-step.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn locally_damped(v: f32, a: f32, c: f32, dt: f32) -> f32 {
    let power = a * (v + 0.5f32 * a * dt);
    let sign = select(power > 0.0f32, 1.0f32, select(power < 0.0f32, 0.0f32 - 1.0f32, 0.0f32));
    a * (1.0f32 - c * sign)
}

/// Code that is compiled once for each scheme.
pub trait Visitor {
    /// What it returns.
    type Output;
    /// Runs with the scheme `S`.
    fn visit<S: Scheme>(self) -> Self::Output;
}

/// Runs `visitor` with the type of the scheme.
#[inline(always)]
pub fn visit<V: Visitor>(kind: IntegratorKind, visitor: V) -> V::Output {
    match kind {
        IntegratorKind::Euler => visitor.visit::<Euler>(),
        IntegratorKind::Exact => visitor.visit::<Exact>(),
        IntegratorKind::Adams => visitor.visit::<Adams>(),
        IntegratorKind::VelocityVerlet => visitor.visit::<VelocityVerlet>(),
    }
}
