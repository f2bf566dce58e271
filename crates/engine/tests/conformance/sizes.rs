//! A small sphere on large ones: places and velocities that friction sees have to belong to the same instant.

use glebe_engine::lattice::{norm, sub};
use glebe_engine::spec::WorldSpec;
use glebe_physics::{ContactModel, IntegratorKind, LawChoice, Material, PairLaws, PairOverride};

use crate::support::{Body, Subject, Together, grain, open_world, plane, sphere_mass};

const LARGE: f64 = 5e-3;
const GAP: f64 = 1e-6;
const GRAVITY: f64 = 9.81;
const DT: f64 = 5e-6;
/// Between the vertical and the plane of the three centres where the small sphere starts \[rad\].
const START: f64 = std::f64::consts::PI / 180.0;

/// Distance of the small sphere's centre from the line through the centres of the large ones \[m\].
fn orbit(small: f64) -> f64 {
    let half = LARGE + 0.5 * GAP;
    ((LARGE + small).powi(2) - half * half).sqrt()
}

/// Two large spheres side by side on a floor, so heavy that they stay where they are, and a small one in the notch
/// above them, a degree off the top (Vyas et al. 2025).
fn notch(ratio: f64, integrator: IntegratorKind) -> WorldSpec {
    let small = LARGE / ratio;
    let stiff = |k: f64| PairLaws {
        normal: Some(LawChoice::named("linear").with("stiffness", k)),
        tangential: Some(LawChoice::named("linear").with("stiffness", 0.8 * k).with("damping", 0.0)),
        ..PairLaws::default()
    };
    let base = grain(0.5, 0.5);
    let heavy = Material { name: "heavy".to_owned(), density: 2.5e6, ..base.clone() };
    let mut w = open_world([0.0, 0.0, -0.1], 0.2, DT, base);
    w.materials.push(heavy);
    w.time.integrator = integrator;
    w.gravity = [0.0, 0.0, -GRAVITY];
    let soft = stiff(1e3);
    w.contact = ContactModel {
        normal: soft.normal.unwrap(),
        tangential: soft.tangential.unwrap(),
        rolling: LawChoice::named("none"),
        ..ContactModel::default()
    };
    let floor = 1e6;
    w.pairs.push((1, 1, PairOverride { laws: stiff(floor), ..PairOverride::default() }));
    let sunk = sphere_mass(LARGE, &w.materials[1]) * GRAVITY / floor;
    let mut ground = plane([0.0, 0.0, 1.0], [0.0, 0.0, sunk - LARGE]);
    ground.material = 1;
    w.surfaces = vec![ground];
    let x = LARGE + 0.5 * GAP;
    w.particles.push([-x, 0.0, 0.0], LARGE, 1);
    w.particles.push([x, 0.0, 0.0], LARGE, 1);
    let r = orbit(small);
    w.particles.push([0.0, r * START.sin(), r * START.cos()], small, 0);
    w
}

/// When a small sphere that rolls about the neck without slip passes `angle` \[rad\] from the top \[s\]: its spin is
/// that of a roller of the radius at which it touches, `r = R ρ/(R + L)`, so that
/// `(1 + 2/5 (R/r)²) ρ φ̈ = g sin φ`.
fn time_of(ratio: f64, angle: f64) -> f64 {
    let small = LARGE / ratio;
    let r = orbit(small);
    let lever = r / (small + LARGE);
    let rate = GRAVITY / (r * (1.0 + 0.4 / (lever * lever)));
    let (h, mut phi, mut speed, mut t) = (1e-6, START, 0.0, 0.0);
    while phi < angle {
        speed += 0.5 * h * rate * phi.sin();
        phi += h * speed;
        speed += 0.5 * h * rate * phi.sin();
        t += h;
    }
    t
}

/// A grain in the notch between two spheres rolls down and leaves, whatever the ratio of sizes. If velocities that
/// friction sees are half a step behind the places, they point out of the curve on which it rolls: friction opposes
/// that, and from a ratio of 10 on it holds the grain in the notch, even from below.
pub fn a_grain_in_a_notch_rolls_out_of_it(on: &Subject) {
    const RATIOS: [f64; 3] = [3.0, 10.0, 20.0];
    let from_top = |b: &Body| b.x[1].atan2(b.x[2]).to_degrees();
    let mut held = Vec::new();
    for integrator in IntegratorKind::ALL {
        let name = integrator.name();
        let mut batch = Together::new(on, RATIOS.map(|ratio| notch(ratio, integrator)).to_vec());
        let there = 30.0_f64;
        let steps = RATIOS.map(|ratio| (time_of(ratio, there.to_radians()) / DT).round() as u64);
        batch.advance(&steps);
        for (k, ratio) in RATIOS.into_iter().enumerate() {
            let angle = from_top(&batch.bodies(k)[2]);
            assert!(
                (angle / there - 1.0).abs() < 0.02,
                "{name}, 1:{ratio}: {angle:.2} deg instead of {there}"
            );
        }
        // Until 0.2 s, half as long again or more.
        batch.advance(&steps.map(|s| 40_000 - s));
        for (k, ratio) in RATIOS.into_iter().enumerate() {
            let b = batch.bodies(k);
            let apart = (0..2).map(|i| norm(sub(b[2].x, b[i].x))).fold(f64::INFINITY, f64::min);
            if apart < LARGE + 2.0 * b[2].radius {
                held.push(format!("{name}, 1:{ratio}: {:.1} deg from the top", from_top(&b[2])));
            }
        }
    }
    assert!(held.is_empty(), "held in the notch: {held:?}");
}
