//! The moment rotation law of periodic samples (RVE eq. 5-8): springs against rolling and twisting, `K = η min(rᵢ, rⱼ)² Kₜ`,
//! at most `α min(rᵢ, rⱼ) Fₙ`. α is dimensionless here: the paper leaves the length out. Kₜ is the stiffness of the
//! tangential spring, without which there is no moment.
//!
//! Coefficients: a = η rolling, b = α rolling, c = η twisting, d = α twisting. Remembered: the rolling angle of body i
//! relative to j, three floats, and the angle of twist about n \[rad\].

use super::{Coefficients, Memory, Roll, Rolling, Torques, V3, dot, minus, plus, rolled, scaled};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// Springs against rolling and twisting.
pub struct MomentRotation;

const fn parameter(name: &'static str, default: f64, summary: &'static str) -> ParameterInfo {
    ParameterInfo { name, unit: "", required: false, default: Some(default), min: 0.0, typical: default, summary }
}

impl Law for MomentRotation {
    const INFO: LawInfo = LawInfo {
        name: "moment-rotation",
        summary: "springs against rolling and twisting, each with a limit",
        source: "Lubbe et al. 2022 (RVE), eq. 5-8",
        parameters: &[
            parameter("rolling_stiffness", 2.0, "stiffness coefficient η of rolling"),
            parameter("rolling_strength", 0.2, "strength α of rolling, times the smaller radius"),
            parameter("twisting_stiffness", 2.0, "stiffness coefficient η of twisting"),
            parameter("twisting_strength", 0.2, "strength α of twisting, times the smaller radius"),
        ],
    };
    const HISTORY: &'static [f64] = &[-1.0, -1.0, -1.0, 1.0];

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        let names = ["rolling_stiffness", "rolling_strength", "twisting_stiffness", "twisting_strength"];
        Ok(names.map(|name| p.value(name)))
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Rolling for MomentRotation {
    #[inline(always)]
    fn torques(k: &Coefficients, r: Roll, m: Memory) -> Torques {
        let size = select(r.r_j > 0.0f32, f32::min(r.r_i, r.r_j), r.r_i);
        let unit = size * size * r.shear_stiffness;
        let t = rolled(r, V3 { x: m.a, y: m.b, z: m.c }, k.a * unit, 0.0f32, k.b * size);

        let stiffness = k.c * unit;
        let most = k.d * size * r.load / f32::max(stiffness, 1.0e-30f32);
        let trial = m.d + dot(minus(r.wi, r.wj), r.n) * r.dt;
        let twist = f32::max(f32::min(trial, most), 0.0f32 - most);
        let half = 0.5f32 * stiffness;

        let on_i = plus(t.force, scaled(r.n, 0.0f32 - stiffness * twist));
        let none = V3 { x: 0.0f32, y: 0.0f32, z: 0.0f32 };
        Torques {
            on_i,
            on_j: scaled(on_i, 0.0f32 - 1.0f32),
            brake_i: none,
            brake_j: none,
            energy: t.energy + half * twist * twist,
            energy_before: t.energy_before + half * m.d * m.d,
            lost: t.friction_loss + stiffness * twist * (trial - twist),
            memory: Memory { a: t.stretch.x, b: t.stretch.y, c: t.stretch.z, d: twist },
        }
    }
}
