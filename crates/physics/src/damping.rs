//! Dashpots from the coefficient of restitution.

use crate::{ContactEnd, LawError, Preparation, damping_ratio};

/// `2√(5/6) β` of the Hertz dashpot, which makes the restitution equal `e` at every speed, for the
/// contact end of the world. `power` is the exponent of the spring's force.
///
/// With the contact ending at δ ≤ 0 the closed form of [`damping_ratio`] holds; where tension is clipped,
/// β is found so that the same e results.
pub fn hertz_damping(p: &Preparation<'_>, power: f64) -> Result<f64, LawError> {
    Ok(2.0 * (5.0_f64 / 6.0).sqrt() * ratio(p, power)?)
}

/// `2 β` of the linear dashpot.
pub fn linear_damping(p: &Preparation<'_>) -> Result<f64, LawError> {
    Ok(2.0 * ratio(p, 1.0)?)
}

fn ratio(p: &Preparation<'_>, power: f64) -> Result<f64, LawError> {
    let e = p.pair.restitution;
    match p.end {
        ContactEnd::Tension => Ok(damping_ratio(e)),
        ContactEnd::NoTension if e > 0.0 => Ok(clipped_damping_ratio(e, power)),
        ContactEnd::NoTension => Err(LawError::Range {
            law: p.info.name,
            name: "restitution",
            value: e,
            allowed: "above 0 and up to 1 where contacts cannot pull (end = \"no-tension\"), because no \
                      dashpot stops a body that the spring alone pushes back"
                .to_owned(),
        }),
    }
}

/// The β that gives the restitution `e` in (0, 1] where the force is clipped at zero, for a spring with
/// force ∝ δ^power and the dashpot of the matching law.
fn clipped_damping_ratio(e: f64, power: f64) -> f64 {
    if e >= 1.0 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    while clipped_restitution(high, power) > e {
        high *= 2.0;
    }
    for _ in 0..60 {
        let mid = 0.5 * (low + high);
        if clipped_restitution(mid, power) > e {
            low = mid;
        } else {
            high = mid;
        }
    }
    0.5 * (low + high)
}

/// Restitution of an impact with `x¨ = -max(x^p + c x^((p-1)/2) x˙, 0)`, from x = 0 with unit speed.
///
/// With Sₙ = p x^(p-1), the dashpot of the Hertz law is `2√(5/6) β √Sₙ x˙` and that of the linear law
/// `2 β x˙`. Once the force is clipped the body flies freely: the speed then is the one it leaves with.
fn clipped_restitution(beta: f64, power: f64) -> f64 {
    let c = 2.0 * beta * if power > 1.0 { (5.0 / 6.0 * power).sqrt() } else { 1.0 };
    let acceleration = |x: f64, v: f64| {
        let x = x.max(0.0);
        -(x.powf(power) + c * x.powf(0.5 * (power - 1.0)) * v)
    };
    let (mut x, mut v) = (0.0_f64, 1.0_f64);
    // Large damping slows the return: time runs in steps bounded by the stiffness, not by its end.
    let dt = 2e-3 / (1.0 + c);
    loop {
        let k1 = (v, acceleration(x, v));
        let k2 = (v + 0.5 * dt * k1.1, acceleration(x + 0.5 * dt * k1.0, v + 0.5 * dt * k1.1));
        let k3 = (v + 0.5 * dt * k2.1, acceleration(x + 0.5 * dt * k2.0, v + 0.5 * dt * k2.1));
        let k4 = (v + dt * k3.1, acceleration(x + dt * k3.0, v + dt * k3.1));
        let force = k1.1;
        if v < 0.0 && force >= 0.0 {
            return -v;
        }
        x += dt / 6.0 * (k1.0 + 2.0 * k2.0 + 2.0 * k3.0 + k4.0);
        v += dt / 6.0 * (k1.1 + 2.0 * k2.1 + 2.0 * k3.1 + k4.1);
        if x <= 0.0 && v < 0.0 {
            return -v;
        }
    }
}
