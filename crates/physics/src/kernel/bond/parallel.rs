//! Parallel bonds (Potyondy and Cundall 2004): a beam of round section between two particles, of radius
//! `R = λ min(rᵢ, rⱼ)`, `A = π R²`, `I = A R²/4`, `J = 2 I`. It acts beside the contact.
//!
//! `F = kₙ A u` along n and `-kₛ A s` across it, `M = -kₙ I θ` across n and `-kₛ J φ` about it, with the stretch u since
//! it was made, the shear s, the bending θ and the twist φ. It breaks, and is gone, when the largest stress reaches its
//! strength: `kₙ (u + β R |θ|) ≥ σ_c` in tension or `kₛ (|s| + β R |φ|) ≥ τ_c` in shear. The paper has β = 1; less lets
//! moments count for less (Potyondy 2011).
//!
//! The stretch is that of the places, not a sum over steps, so that creep is not lost.
//!
//! Coefficients: a = kₙ, b = kₛ \[N/m³\], c = λ, d = gap \[m\]. Strength: a = σ_c, b = τ_c \[Pa\], c = β,
//! d = π λ².

use super::{BOND_HISTORY, Bond, Coefficients, Held, Hold, Parting, length, plus, scaled, strained};
use crate::cube::*;
use crate::{Impact, Law, LawError, LawInfo, ParameterInfo, Preparation, linear_collision_time};

/// Parallel bonds.
pub struct Parallel;

const fn required(
    name: &'static str,
    unit: &'static str,
    typical: f64,
    summary: &'static str,
) -> ParameterInfo {
    ParameterInfo { name, unit, required: true, default: None, min: f64::MIN_POSITIVE, typical, summary }
}

impl Law for Parallel {
    const INFO: LawInfo = LawInfo {
        name: "parallel",
        summary: "beams between particles that carry force and moment until they break",
        source: "Potyondy and Cundall 2004, the parallel bond; moment contribution factor: Potyondy 2011",
        parameters: &[
            required("normal_stiffness", "N/m^3", 1e10, "stiffness kₙ per area, against tension and bending"),
            required("shear_stiffness", "N/m^3", 4e9, "stiffness kₛ per area, against shear and twist"),
            required("tensile_strength", "Pa", 1e5, "tensile stress σ_c at which it breaks"),
            required("shear_strength", "Pa", 1e5, "shear stress τ_c at which it breaks"),
            ParameterInfo {
                name: "radius",
                unit: "",
                required: false,
                default: Some(1.0),
                min: f64::MIN_POSITIVE,
                typical: 1.0,
                summary: "radius of the bond as a share λ of the smaller particle's, up to 1",
            },
            ParameterInfo {
                name: "moment_contribution",
                unit: "",
                required: false,
                default: Some(1.0),
                min: 0.0,
                typical: 1.0,
                summary: "share β of moments in the stresses that break it, up to 1",
            },
            ParameterInfo {
                name: "gap",
                unit: "m",
                required: false,
                default: Some(0.0),
                min: 0.0,
                typical: 1e-4,
                summary: "particles no farther apart than this are bonded",
            },
        ],
    };
    const HISTORY: &'static [f64] = BOND_HISTORY;
    const FROM_MATERIAL: bool = false;

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        for name in ["radius", "moment_contribution"] {
            let value = p.value(name);
            if value > 1.0 {
                return Err(LawError::Range { law: p.info.name, name, value, allowed: "up to 1".to_owned() });
            }
        }
        Ok([p.value("normal_stiffness"), p.value("shear_stiffness"), p.value("radius"), p.value("gap")])
    }

    fn strength(p: &Preparation<'_>) -> [f64; 4] {
        let share = p.value("radius");
        let section = std::f64::consts::PI * share * share;
        [p.value("tensile_strength"), p.value("shear_strength"), p.value("moment_contribution"), section]
    }

    fn collision_time(k: &[f64; 4], i: &Impact, _speed: f64) -> f64 {
        // The smaller radius is at most twice the effective one.
        let radius = k[2] * 2.0 * i.r_eff;
        linear_collision_time(i.m_eff, k[0].max(k[1]) * std::f64::consts::PI * radius * radius)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Bond for Parallel {
    #[inline(always)]
    fn hold(k: &Coefficients, strength: Coefficients, p: Parting, h: Held) -> Hold {
        let size = f32::min(p.r_i, p.r_j);
        let radius = k.c * size;
        let area = strength.d * size * size;
        let inertia = 0.25f32 * area * radius * radius;
        let to = strained(p, h);
        let stretch = (p.r_i + p.r_j - h.rest) - p.delta;
        let slid = length(to.shear);
        let bent = length(to.bend);
        let lever = strength.c * radius;
        let tension = k.a * (stretch + lever * bent);
        let shear = k.b * (slid + lever * f32::abs(to.twist));
        let whole = tension < strength.a && shear < strength.b;
        let bonded = h.rest > 0.0f32;
        let on = select(bonded && whole, 1.0f32, 0.0f32);
        let broke = select(bonded, 1.0f32, 0.0f32) - on;
        let direct = k.a * (area * stretch * stretch + inertia * bent * bent);
        let sheared = k.b * (area * slid * slid + 2.0f32 * inertia * to.twist * to.twist);
        let energy = 0.5f32 * (direct + sheared);
        let pull = scaled(p.n, k.a * area * stretch);
        let turn = scaled(p.n, 0.0f32 - 2.0f32 * k.b * inertia * to.twist);
        Hold {
            force: scaled(plus(pull, scaled(to.shear, 0.0f32 - k.b * area)), on),
            moment: scaled(plus(turn, scaled(to.bend, 0.0f32 - k.a * inertia)), on),
            energy: energy * on,
            lost: energy * broke,
            broke,
            held: Held {
                rest: h.rest * on,
                shear: scaled(to.shear, on),
                bend: scaled(to.bend, on),
                twist: to.twist * on,
            },
        }
    }
}
