//! Capillary bridges (Willett et al. 2000): `F = 2π R γ cos θ / (1 + 1.05 ŝ + 2.5 ŝ²)`, `ŝ = s √(R/V)`, with the separation
//! s, Derjaguin's radius `R = 2 R*` and the volume V of a bridge. A bridge forms when bodies touch and ruptures at
//! `s = (1 + θ/2) (V^(1/3) + 0.1 V^(2/3)/R)`. Each bridge holds a share of the volume of a sphere: of the radius 2R* between
//! spheres, of the particle's own on a wall.
//!
//! Coefficients: a = 4π γ cos θ \[N/m\], b = ∛(4π/3 share), c = 1 + θ/2. Remembered: 1 while there is a bridge.

use std::f64::consts::PI;

use super::{Attraction, Coefficients, Cohesion, Memory, Touch};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// Capillary bridges.
pub struct Capillary;

impl Law for Capillary {
    const INFO: LawInfo = LawInfo {
        name: "capillary",
        summary: "liquid bridges that form in touch and rupture at a distance",
        source: "Willett et al. 2000, closed form and rupture distance",
        parameters: &[
            ParameterInfo {
                name: "surface_tension",
                unit: "N/m",
                required: true,
                default: None,
                min: 0.0,
                typical: 0.072,
                summary: "surface tension γ of the liquid; times the cohesion of the pair",
            },
            ParameterInfo {
                name: "liquid_content",
                unit: "",
                required: true,
                default: None,
                min: f64::MIN_POSITIVE,
                typical: 0.01,
                summary: "volume of a bridge as a share of a particle's, up to 0.1",
            },
            ParameterInfo {
                name: "contact_angle",
                unit: "rad",
                required: false,
                default: Some(0.0),
                min: 0.0,
                typical: 0.3,
                summary: "contact angle θ of the liquid, below π/2",
            },
        ],
    };
    const HISTORY: &'static [f64] = &[1.0];

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        let (content, angle) = (p.value("liquid_content"), p.value("contact_angle"));
        for (name, value, most) in [("liquid_content", content, 0.1), ("contact_angle", angle, 0.5 * PI)] {
            if value > most {
                return Err(LawError::Range {
                    law: p.info.name,
                    name,
                    value,
                    allowed: format!("up to {most:.4}, where bridges of the closed form end"),
                });
            }
        }
        let tension = p.pair.cohesion * p.value("surface_tension");
        let share = (4.0 / 3.0 * PI * content).cbrt();
        Ok([4.0 * PI * tension * angle.cos(), share, 1.0 + 0.5 * angle, 0.0])
    }

    fn range(k: &[f64; 4], radius: f64) -> f64 {
        // A little more, so that bridges are seen to rupture.
        let side = k[1] * radius;
        if k[0] > 0.0 { 1.05 * k[2] * (side + 0.1 * side * side / radius) } else { 0.0 }
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Cohesion for Capillary {
    #[inline(always)]
    fn attraction(k: &Coefficients, c: Touch, m: Memory) -> Attraction {
        let radius = 2.0f32 * c.r_eff;
        let side = k.b * 0.5f32 * c.diameter;
        let ruptures = k.c * (side + 0.1f32 * side * side / radius);
        let s = f32::max(0.0f32 - c.delta, 0.0f32);
        let held = m.a > 0.5f32 && s <= ruptures;
        let bridged = (held || c.delta >= 0.0f32) && k.a > 0.0f32;
        let length = side * root(side / radius);
        let most = k.a * c.r_eff;
        let x = f32::min(s, ruptures) / length;
        let force = most / (1.0f32 + 1.05f32 * x + 2.5f32 * x * x);
        let energy = most * (length * path(x) - f32::max(c.delta, 0.0f32));
        let parts = m.a > 0.5f32 && !bridged;
        let one = select(bridged, 1.0f32, 0.0f32);
        Attraction {
            force: select(bridged, force, 0.0f32),
            energy: select(bridged, energy, 0.0f32),
            lost: select(parts, energy, 0.0f32),
            memory: Memory { a: one, b: 0.0f32, c: 0.0f32, d: 0.0f32 },
        }
    }
}

/// The integral of `1/(1 + 1.05 t + 2.5 t²)` from 0 to x: an arc tangent, halved three times so that its series is short.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn path(x: f32) -> f32 {
    let d = 2.982_867_7f32;
    let z = halved(halved(halved(x * d / (2.0f32 + 1.05f32 * x))));
    let z2 = z * z;
    let series = 1.0f32 - z2 * (1.0f32 / 3.0f32 - z2 * (0.2f32 - z2 * (1.0f32 / 7.0f32 - z2 / 9.0f32)));
    (16.0f32 / d) * z * series
}

/// The tangent of half the angle whose tangent is z.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn halved(z: f32) -> f32 {
    z / (1.0f32 + root(1.0f32 + z * z))
}
