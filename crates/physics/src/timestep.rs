//! Stable time steps.

use std::f64::consts::PI;

use crate::Material;

/// Rayleigh time of a sphere \[s\]: `π R √(ρ/G) / (0.1631 ν + 0.8766)`.
pub fn rayleigh_time(radius: f64, m: &Material) -> f64 {
    PI * radius * (m.density / m.shear_modulus()).sqrt() / (0.1631 * m.poissons_ratio + 0.8766)
}

/// Duration of an elastic Hertz impact \[s\]: `2.87 (m*²/(R* E*² v))^(1/5)`.
pub fn hertz_collision_time(m_eff: f64, r_eff: f64, e_star: f64, speed: f64) -> f64 {
    2.87 * (m_eff * m_eff / (r_eff * e_star * e_star * speed)).powf(0.2)
}

/// Duration of a linear impact without damping \[s\]: `π √(m*/k)`.
pub fn linear_collision_time(m_eff: f64, stiffness: f64) -> f64 {
    PI * (m_eff / stiffness).sqrt()
}

/// E* of a Hertz contact with the stiffness k̂ of the law `hertz-stiffness` \[Pa\]: both give
/// `F = 4/3 E* √R* δ^1.5`, so `E* = 3 k̂ / (4 √(D R*))` with D = 4R* or, on a wall, 2R.
pub fn equivalent_e_star(stiffness: f64, diameter: f64, r_eff: f64) -> f64 {
    0.75 * stiffness / (diameter * r_eff).sqrt()
}

/// Largest share of the Rayleigh time that `step = "auto"` takes.
pub const AUTO_RAYLEIGH_SHARE: f64 = 0.15;
/// Steps per collision that `step = "auto"` takes at least.
pub const AUTO_STEPS_PER_COLLISION: f64 = 25.0;
/// Share of the Rayleigh time above which a step draws a warning.
pub const WARN_RAYLEIGH_SHARE: f64 = 0.3;
