//! Adhesion of soft bodies (Johnson, Kendall and Roberts 1971), as what it pulls beyond Hertz's force at the same overlap:
//! with the normal law `hertz` the two are JKR's force. Bodies attach when they touch and part at
//! `δ = -3/4 (π² w² R*/E*²)^(1/3)`; the largest tension on the way is `3/2 π w R*`.
//!
//! With the radius of contact `a = λ² y²`, `λ³ = √(2π w/E*) R*`: `y⁴ - y = δ R*/λ⁴ = D` and
//! `F = π w R* (8/3 y⁶ - 4 y³)`. Newton's method finds y from above, where it cannot go astray.
//!
//! Coefficients: a = π w \[N/m\], b = √(2π w/E*) \[√m\]. Remembered: 1 while attached.

use std::f64::consts::PI;

use super::{Attraction, Coefficients, Cohesion, Memory, Touch, cube_root};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// JKR's adhesion.
pub struct Jkr;

impl Law for Jkr {
    const INFO: LawInfo = LawInfo {
        name: "jkr",
        summary: "adhesion of soft bodies, on top of the normal law `hertz`; they part beyond touch",
        source: "Johnson, Kendall and Roberts 1971; explicit in the overlap as in Parteli et al. 2014",
        parameters: &[ParameterInfo {
            name: "work_of_adhesion",
            unit: "J/m^2",
            required: true,
            default: None,
            min: 0.0,
            typical: 0.05,
            summary: "energy w to part a unit of area; times the cohesion of the pair",
        }],
    };
    const HISTORY: &'static [f64] = &[1.0];

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        let w = p.pair.cohesion * p.value("work_of_adhesion");
        Ok([PI * w, (2.0 * PI * w / p.pair.e_star).sqrt(), 0.0, 0.0])
    }

    fn range(k: &[f64; 4], radius: f64) -> f64 {
        // Half as much again, so that bodies are seen to part.
        1.5 * 0.472_470_4 * (k[1] * radius).cbrt() * k[1]
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Cohesion for Jkr {
    #[inline(always)]
    fn attraction(k: &Coefficients, c: Touch, m: Memory) -> Attraction {
        // λ⁴/R*, the unit of overlap.
        let unit = f32::max(cube_root(k.b * c.r_eff) * k.b, 1.0e-30f32);
        let depth = c.delta / unit;
        let apart = 0.0f32 - 0.472_470_4f32;
        let held = select(m.a > 0.5f32, depth >= apart, c.delta >= 0.0f32);
        let attached = (held || c.delta >= 0.0f32) && k.a > 0.0f32;
        let d = f32::max(depth, apart);
        // Both are above the root: the first is near it for large overlaps, the second where bodies part.
        let far = 1.0f32 + root(root(f32::max(d, 0.0f32)));
        let near = 0.629_960_5f32 + root((d - apart) * 0.419_973_7f32);
        let y = closer(f32::min(far, near), d);
        let y = closer(y, d);
        let y = closer(y, d);
        let y = closer(y, d);
        let y = closer(y, d);
        let y = closer(y, d);
        let p = y * y * y;
        // √(D/y⁴): Hertz's force is q³ times that of the same area of contact. Differences are written out.
        let q = root(f32::max(1.0f32 - 1.0f32 / p, 0.0f32));
        let q2 = q * q;
        let touches = c.delta >= 0.0f32;
        let less = select(touches, (1.0f32 + q + q2) / (1.0f32 + q), p);
        let force = k.a * c.r_eff * p * (4.0f32 - (8.0f32 / 3.0f32) * less);
        let work = select(touches, (1.0f32 + q + q2 + q2 * q + q2 * q2) / (1.0f32 + q), p);
        let sum = p * y * ((16.0f32 / 15.0f32) * p * work - (8.0f32 / 3.0f32) * p + 1.0f32) + 0.6f32;
        let energy = k.a * unit * c.r_eff * sum;
        let parts = m.a > 0.5f32 && !attached;
        let one = select(attached, 1.0f32, 0.0f32);
        Attraction {
            force: select(attached, force, 0.0f32),
            energy: select(attached, energy, 0.0f32),
            lost: select(parts, energy, 0.0f32),
            memory: Memory { a: one, b: 0.0f32, c: 0.0f32, d: 0.0f32 },
        }
    }
}

/// One of Newton's steps towards the larger root of `y⁴ - y = d`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn closer(y: f32, d: f32) -> f32 {
    let p = y * y * y;
    y - (p * y - y - d) / f32::max(4.0f32 * p - 1.0f32, 1.0e-3f32)
}
