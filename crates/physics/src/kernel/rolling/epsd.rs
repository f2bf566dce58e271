//! Elastic-plastic spring and dashpot (Ai et al. 2011, model C): `M = -k_r θ`, `k_r = 2.25 kₙ (μr R*)²`, at most `μr R* Fₙ`,
//! with θ the rolling angle that the contact remembers. The spring carries torque at rest, so that piles stand. The
//! dashpot has the ratio η to the critical one, `2 √(I_r k_r)`, with the inertia of rolling about the contact point.
//!
//! Coefficients: a = μr, b = η. Remembered: θ of body i relative to j \[rad\], three floats.

use super::{Coefficients, Memory, Roll, Rolling, Torques, V3, minus, rolled, scaled};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// Elastic-plastic spring and dashpot.
pub struct Epsd;

impl Law for Epsd {
    const INFO: LawInfo = LawInfo {
        name: "epsd",
        summary: "rolling spring with a limit and a dashpot; carries torque at rest",
        source: "Ai et al. 2011, model C",
        parameters: &[ParameterInfo {
            name: "damping",
            unit: "",
            required: false,
            default: Some(0.3),
            min: 0.0,
            typical: 0.3,
            summary: "rolling dashpot as a share of the critical one",
        }],
    };
    const HISTORY: &'static [f64] = &[-1.0, -1.0, -1.0];

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([p.pair.rolling_friction, p.value("damping"), 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Rolling for Epsd {
    #[inline(always)]
    fn torques(k: &Coefficients, r: Roll, m: Memory) -> Torques {
        let arm = k.a * r.r_eff;
        let stiffness = 2.25f32 * r.stiffness * arm * arm;
        // Of a sphere about its contact point the inertia is 7/2 of that about its centre.
        let inertia = 3.5f32 / (r.inv_inertia_i + r.inv_inertia_j);
        let damping = 2.0f32 * k.b * root(inertia * stiffness);
        let t = rolled(r, V3 { x: m.a, y: m.b, z: m.c }, stiffness, damping, arm);
        let brake = minus(t.force, t.spring);
        Torques {
            on_i: t.force,
            on_j: scaled(t.force, 0.0f32 - 1.0f32),
            brake_i: brake,
            brake_j: scaled(brake, 0.0f32 - 1.0f32),
            energy: t.energy,
            energy_before: t.energy_before,
            lost: t.friction_loss,
            memory: Memory { a: t.stretch.x, b: t.stretch.y, c: t.stretch.z, d: 0.0f32 },
        }
    }
}
