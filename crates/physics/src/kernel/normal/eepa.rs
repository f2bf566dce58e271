//! Elasto-plastic adhesion with the exponent of Hertz (EEPA; Morrissey 2013, Thakur et al. 2014):
//! `F = clamp(k₂ (z - z₀), -k_a z, k₁ z)`, `z = δ^1.5`, after which `z₀ = z - F/k₂`. `k₁ = 4/3 E* √R*` is that of Hertz,
//! `k₂ = k₁/(1 - λ²)` with the plasticity λ, `k_a` a share of k₁. The constant pull-off f₀ of the papers is the law of
//! cohesion `constant`. The dashpot is that of Hertz.
//!
//! Coulomb's limit belongs to `F + k_a z`, so that is the spring's part, and `k_a z` the pull.
//!
//! Coefficients: a = 2 E* \[Pa\], b = 2√(5/6) β, c = k₂/k₁, d = k_a/k₁. Remembered: z₀ \[m^1.5\].

use super::{Coefficients, Memory, Normal, NormalForce, Touch, cube_root};
use crate::cube::*;
use crate::{Impact, Law, LawError, LawInfo, ParameterInfo, Preparation, hertz_collision_time, hertz_damping};

/// Elasto-plastic adhesion.
pub struct Eepa;

impl Law for Eepa {
    const INFO: LawInfo = LawInfo {
        name: "eepa",
        summary: "elasto-plastic adhesion with the exponent of Hertz",
        source: "Morrissey 2013; Thakur et al. 2014",
        parameters: &[
            ParameterInfo {
                name: "plasticity",
                unit: "",
                required: true,
                default: None,
                min: 0.0,
                typical: 0.6,
                summary: "contact plasticity λ from 0 (elastic) to below 1; unloading is 1/(1 - λ²) times as stiff",
            },
            ParameterInfo {
                name: "adhesion",
                unit: "",
                required: false,
                default: Some(0.0),
                min: 0.0,
                typical: 0.3,
                summary: "largest tension as a share of the force of first loading; times the cohesion of the pair",
            },
        ],
    };
    const HISTORY: &'static [f64] = &[1.0];

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        let plasticity = p.value("plasticity");
        if plasticity > 0.995 {
            return Err(LawError::Range {
                law: p.info.name,
                name: "plasticity",
                value: plasticity,
                allowed: "from 0 to 0.995: unloading is 100 times as stiff as loading there".to_owned(),
            });
        }
        let stiffer = 1.0 / (1.0 - plasticity * plasticity);
        let adhesion = p.pair.cohesion * p.value("adhesion");
        Ok([2.0 * p.pair.e_star, hertz_damping(p, 1.5)?, stiffer, adhesion])
    }

    fn collision_time(k: &[f64; 4], i: &Impact, speed: f64) -> f64 {
        hertz_collision_time(i.m_eff, i.r_eff, 0.5 * k[0] * k[2], speed)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Normal for Eepa {
    #[inline(always)]
    fn force(k: &Coefficients, c: Touch, m: Memory) -> NormalForce {
        let slope = k.a * root(c.r_eff * c.delta);
        let k1 = (2.0f32 / 3.0f32) * k.a * root(c.r_eff);
        let k2 = k.c * k1;
        let z = c.delta * root(c.delta);
        let pull = k.d * k1 * z;
        let most = k1 * z;
        let trial = k2 * (z - m.a);
        let force = f32::min(f32::max(trial, 0.0f32 - pull), most);
        // Kept to the bit where nothing yields.
        let after = select(force == trial, m.a, z - force / k2);
        // Overlaps without force, before and after; what is lost is a power of them while z and z₀ change together.
        let free = square(cube_root(after));
        let freed = after - m.a * square(cube_root(m.a)) / f32::max(free, 1.0e-30f32);
        NormalForce {
            elastic: force + pull,
            viscous: k.b * root(slope * c.m_eff) * c.vn,
            stiffness: slope * select(trial > most, 1.0f32, k.c),
            energy: k2 * ((0.4f32 * z - after) * c.delta + 0.6f32 * after * free),
            pull,
            lost: select(free > 0.0f32, 0.6f32 * k2 * (c.delta - free) * freed, 0.0f32),
            memory: Memory { a: after, b: 0.0f32, c: 0.0f32, d: 0.0f32 },
        }
    }
}

#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn square(x: f32) -> f32 {
    x * x
}
