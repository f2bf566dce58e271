//! Tangential force laws: a spring and a dashpot in the tangent plane, with Coulomb's limit.
//!
//! A law gives the stiffness and damping; how the spring is stretched, turned with the contact and
//! clipped at slip is the same for all and stands here.

use super::contact::{Coefficients, Touch};
use super::normal::NormalForce;
use super::vector::{V3, cross, dot, length, minus, plus, scaled};
use crate::cube::*;

slot! {
    /// The registered tangential laws.
    TangentialLaw: Tangential {
        none::Frictionless,
        mindlin::Mindlin,
        linear::LinearTangential,
        hertz_stiffness::HertzStiffnessTangential,
        rve::RveTangential,
    }
    fn chosen_spring(k: &Coefficients, c: Touch, n: NormalForce) -> Spring = spring(k, c, n);
}

/// What a law with a spring remembers: the stretch ξ of body i relative to j, and whether it slips (0 or 1).
pub const SPRING_HISTORY: &[f64] = &[-1.0, -1.0, -1.0, 1.0];

/// Stiffness and damping of the tangent plane.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spring {
    /// Stiffness Sₜ \[N/m\].
    pub stiffness: f32,
    /// Damping γₜ \[N s/m\].
    pub damping: f32,
}

/// A tangential law.
#[cfg_attr(feature = "gpu", cube)]
pub trait Tangential: Send + Sync + 'static {
    /// Spring and dashpot of a contact, given its normal force.
    fn spring(k: &Coefficients, c: Touch, n: NormalForce) -> Spring;
}

/// Friction of a pair of materials, and what becomes of the spring.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeLaunch))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Friction {
    /// Sliding friction μ.
    pub sliding: f32,
    /// Static friction μ0 ≥ μ.
    pub sticking: f32,
    /// 1: the spring is kept from step to step, 0: forgotten.
    pub remember: f32,
    /// 1: the spring is shortened to the slip limit, 0: it grows without bound (GPUDEM).
    pub truncate: f32,
}

/// The tangential force on body i and the spring after the step.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TangentialForce {
    /// Force on body i \[N\].
    pub force: V3,
    /// The spring's part of it \[N\].
    pub spring: V3,
    /// Stretch ξ of the spring \[m\].
    pub stretch: V3,
    /// 1 while sliding, 0 while sticking.
    pub slip: f32,
    /// Energy of the spring \[J\].
    pub energy: f32,
    /// Energy that the spring would have held at the present stiffness without moving on \[J\].
    pub energy_before: f32,
    /// Energy lost to friction in this step \[J\].
    pub friction_loss: f32,
}

/// Turns the spring with the contact: `stretch` is laid on the plane across `n` with its length kept, then
/// turned about `n` by `twist` \[rad\], the pair's mean spin about n times the step. A rigid rotation of
/// the pair neither gains nor loses tangential force.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn carried(stretch: V3, n: V3, twist: f32) -> V3 {
    let flat = minus(stretch, scaled(n, dot(stretch, n)));
    let turned = plus(flat, scaled(cross(n, flat), twist));
    let old = dot(stretch, stretch);
    let new = dot(turned, turned);
    // √(old/new) as 1 + x/(1 + √(1 + x)): devices whose roots and quotients are rounded carelessly would make the
    // spring grow or shrink turn after turn.
    let x = (old - new) / f32::max(new, 1.0e-37f32);
    scaled(turned, select(new > 0.0f32, 1.0f32 + x / (1.0f32 + root(1.0f32 + x)), 0.0f32))
}

/// What `force` is scaled by so that it is no larger than `cap`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn within(force: V3, cap: f32) -> f32 {
    let size2 = dot(force, force);
    select(size2 > cap * cap, cap * inverse_root(size2), 1.0f32)
}

/// One step of the tangential spring.
///
/// `stretch` has been [`carried()`]; `vt` \[m/s\] is the tangential velocity of i relative to j; `fn_`
/// \[N\] is the normal force that friction acts on, without cohesion.
///
/// The *total* force is capped at `μ max(Fₙ, 0)`, and the spring alone clipped to it (CHRONO). "Spring
/// plus dashpot equal the cap" would feed energy in as δ → 0. A sticking contact slips when the trial
/// force exceeds `μ0 Fₙ`; it sticks again when the trial force is below `μ Fₙ` and the sliding speed
/// reverses or vanishes.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn slide(stretch: V3, slip: f32, s: Spring, f: Friction, fn_: f32, vt: V3, dt: f32) -> TangentialForce {
    let load = f32::max(fn_, 0.0f32);
    let kept = scaled(stretch, f.remember);
    let trial = plus(kept, scaled(vt, dt));
    let dashpot = scaled(vt, s.damping);
    let pull = scaled(trial, s.stiffness);
    let together = plus(pull, dashpot);
    let (slide, stick) = (f.sliding * load, f.sticking * load);
    // Squares are compared where sizes are not needed.
    let size2 = dot(together, together);
    let reversed = dot(vt, kept) <= 0.0f32;
    let slides_on = select(reversed, size2 >= slide * slide, true);
    let slips = select(slip > 0.5f32, slides_on, size2 > stick * stick);
    let cap = select(slips, slide, stick);

    let shorten = within(pull, cap);
    let spring = scaled(pull, 0.0f32 - shorten);
    let total = minus(spring, dashpot);
    let force = scaled(total, within(total, cap));

    // A spring that is never shortened holds no more energy than its force can give back: beyond the limit
    // its stretch is the path slid, which was accounted when it was slid.
    let truncates = f.truncate > 0.5f32;
    let stretched = length(trial);
    let limit = cap / f32::max(s.stiffness, 1.0e-30f32);
    let before = length(kept);
    let holds = select(truncates, before, f32::min(before, limit));
    let held = stretched * shorten;
    let slid = stretched - select(truncates, held, f32::max(before, held));
    let half = 0.5f32 * s.stiffness;
    TangentialForce {
        force,
        spring,
        stretch: scaled(trial, select(truncates, shorten, 1.0f32)),
        slip: select(slips, 1.0f32, 0.0f32),
        energy: half * held * held,
        energy_before: half * holds * holds,
        friction_loss: s.stiffness * held * f32::max(slid, 0.0f32),
    }
}
