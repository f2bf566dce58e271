//! Rolling resistance that is a spring with a limit: it carries torque at rest.

use glebe_engine::spec::WorldSpec;
use glebe_physics::LawChoice;

use crate::support::{Run, Subject, e_star, grain, open_world, plane, sphere_mass};

const RADIUS: f64 = 2e-3;
const G: f64 = 9.81;
const DT: f64 = 8e-6;
/// The limit of the torque, as a share of radius times load.
const STRENGTH: f64 = 0.05;

/// A sphere that rests on a slope of that gradient, held by friction.
fn on_slope(law: &LawChoice, gradient: f64) -> WorldSpec {
    let mut m = grain(0.2, 0.8);
    m.youngs_modulus = 5e6;
    m.rolling_friction = STRENGTH;
    let across = G / (1.0 + gradient * gradient).sqrt();
    let overlap = (0.75 * sphere_mass(RADIUS, &m) * across / (e_star(&m) * RADIUS.sqrt())).powf(2.0 / 3.0);
    let mut w = open_world([0.0; 3], 0.5, DT, m);
    w.contact.rolling = law.clone();
    w.gravity = [across * gradient, 0.0, -across];
    w.particles.push([0.0, 0.0, RADIUS - overlap], RADIUS, 0);
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
    w
}

fn springs() -> [LawChoice; 2] {
    let moment = LawChoice::named("moment-rotation").with("rolling_strength", STRENGTH);
    [LawChoice::named("epsd"), moment.with("twisting_strength", STRENGTH)]
}

/// Below the gradient μr a sphere stays where it is; above it rolls down with 5/7 of what is left of its weight.
pub fn a_rolling_spring_holds_a_sphere_on_a_slope(on: &Subject) {
    for law in springs() {
        // A spring without a dashpot swings to twice its balance first.
        let mut run = Run::new(on, on_slope(&law, 0.4 * STRENGTH));
        run.steps(5_000);
        let [x, ..] = run.bodies()[0].x;
        run.steps(20_000);
        let moved = (run.bodies()[0].x[0] - x).abs() / RADIUS;
        assert!(moved < 1e-3, "{}: it moved by {moved:.2e} radii", law.law);

        let gradient = 3.0 * STRENGTH;
        let mut run = Run::new(on, on_slope(&law, gradient));
        let across = G / (1.0 + gradient * gradient).sqrt();
        run.steps(2_000);
        let before = run.bodies()[0].v[0];
        run.steps(8_000);
        let found = (run.bodies()[0].v[0] - before) / (8_000.0 * DT);
        let expected = 5.0 / 7.0 * across * (gradient - STRENGTH);
        assert!((found / expected - 1.0).abs() < 5e-3, "{}: {found} instead of {expected} m/s²", law.law);
    }
}

/// A sphere that twists on a plane is braked by `α r F` and held once it stands; EPSD leaves twist alone.
pub fn twist_is_braked_and_held(on: &Subject) {
    const TWIST: f64 = 5.0;
    for law in springs() {
        let mut w = on_slope(&law, 0.0);
        w.particles.spin = vec![[0.0, 0.0, TWIST]];
        let mut run = Run::new(on, w);
        let mass = run.bodies()[0].mass;
        let slows = STRENGTH * RADIUS * mass * G / (0.4 * mass * RADIUS * RADIUS);
        let half = (0.5 * TWIST / slows / DT).round();
        run.steps(half as u64);
        let (found, expected) = (run.bodies()[0].w[2], TWIST - slows * half * DT);
        if law.law == "epsd" {
            assert!((found / TWIST - 1.0).abs() < 1e-5, "twist became {found}");
            continue;
        }
        assert!((found / expected - 1.0).abs() < 5e-3, "twist became {found}, not {expected} rad/s");
        run.steps(2 * half as u64);
        let swings = run.bodies()[0].w[2];
        assert!(swings.abs() < 0.05 * TWIST, "it twists on at {swings} rad/s");
        // The torque of the spring at rest is remembered.
        assert!(run.moment().elastic_tangential > 0.0);
    }
}
