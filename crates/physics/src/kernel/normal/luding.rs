//! Linear elasto-plastic contact with adhesion: loading along k₁, unloading and reloading along k₂ > k₁ from the plastic
//! overlap δ₀, tension down to `-k_c δ` (Luding 2008, eq. 6, with k₂ the same at every overlap). In one line,
//! `F = clamp(k₂ (δ - δ₀), -k_c δ, k₁ δ)`, after which `δ₀ = δ - F/k₂`. The dashpot is linear.
//!
//! Coulomb's limit belongs to `F + k_c δ`, so that is the spring's part, and `k_c δ` the pull.
//!
//! Coefficients: a = k₁, b = k₂, c = k_c \[N/m\], d = γ \[N s/m\]. Remembered: δ₀ \[m\].

use super::{Coefficients, Memory, Normal, NormalForce, Touch};
use crate::cube::*;
use crate::{Impact, Law, LawError, LawInfo, ParameterInfo, Preparation, linear_collision_time};

/// Linear elasto-plastic contact with adhesion.
pub struct Luding;

impl Law for Luding {
    const INFO: LawInfo = LawInfo {
        name: "luding",
        summary: "linear elasto-plastic contact with adhesion: loading k₁, unloading k₂, tension to -k_c δ",
        source: "Luding 2008, eq. 6; Walton and Braun 1986",
        parameters: &[
            ParameterInfo {
                name: "stiffness",
                unit: "N/m",
                required: true,
                default: None,
                min: f64::MIN_POSITIVE,
                typical: 1e4,
                summary: "stiffness k₁ of first loading",
            },
            ParameterInfo {
                name: "unloading_stiffness",
                unit: "N/m",
                required: true,
                default: None,
                min: f64::MIN_POSITIVE,
                typical: 2e4,
                summary: "stiffness k₂ of unloading and reloading, at least k₁; restitution is √(k₁/k₂)",
            },
            ParameterInfo {
                name: "adhesion_stiffness",
                unit: "N/m",
                required: false,
                default: Some(0.0),
                min: 0.0,
                typical: 5e3,
                summary: "slope k_c of the largest tension; times the cohesion of the pair",
            },
            ParameterInfo {
                name: "damping",
                unit: "N s/m",
                required: false,
                default: Some(0.0),
                min: 0.0,
                typical: 0.1,
                summary: "dashpot constant, besides what plastic overlap takes",
            },
        ],
    };
    const HISTORY: &'static [f64] = &[1.0];

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        let (k1, k2) = (p.value("stiffness"), p.value("unloading_stiffness"));
        if k2 < k1 {
            return Err(LawError::Range {
                law: p.info.name,
                name: "unloading_stiffness",
                value: k2,
                allowed: format!("at least the stiffness of loading, {k1} N/m"),
            });
        }
        Ok([k1, k2, p.pair.cohesion * p.value("adhesion_stiffness"), p.value("damping")])
    }

    const FROM_MATERIAL: bool = false;

    fn collision_time(k: &[f64; 4], i: &Impact, _speed: f64) -> f64 {
        linear_collision_time(i.m_eff, k[1])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Normal for Luding {
    #[inline(always)]
    fn force(k: &Coefficients, c: Touch, m: Memory) -> NormalForce {
        let pull = k.c * c.delta;
        let most = k.a * c.delta;
        let trial = k.b * (c.delta - m.a);
        let force = f32::min(f32::max(trial, 0.0f32 - pull), most);
        let soft = 1.0f32 / k.b;
        // Kept to the bit where nothing yields.
        let after = select(force == trial, m.a, c.delta - force * soft);
        // Force and plastic overlap grow and shrink together: the mean force over the change of δ₀.
        let mean = 0.5f32 * force * (after + m.a) / f32::max(after, 1.0e-30f32);
        NormalForce {
            elastic: force + pull,
            viscous: k.d * c.vn,
            stiffness: select(trial > most, k.a, k.b),
            energy: 0.5f32 * force * force * soft,
            pull,
            lost: select(after > 0.0f32, mean * (after - m.a), 0.0f32),
            memory: Memory { a: after, b: 0.0f32, c: 0.0f32, d: 0.0f32 },
        }
    }
}
