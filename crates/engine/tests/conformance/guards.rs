//! A world that goes wrong stops, says why, and leaves the others of its batch alone.

use glebe_engine::spec::WorldSpec;

use crate::support::{Subject, Together, grain, open_world};

const RADIUS: f64 = 1e-3;

/// Two spheres that meet at 2 m/s, and one far away.
fn meeting(stiffness: f64) -> WorldSpec {
    let mut m = grain(0.5, 0.3);
    m.youngs_modulus = stiffness;
    let mut w = open_world([0.0; 3], 0.1, 2e-6, m);
    w.guards.overlap_stops = true;
    w.particles.push([0.05, 0.0, 0.0], RADIUS, 0);
    w.particles.push_moving([-1.01 * RADIUS, 0.0, 0.0], RADIUS, 0, [1.0, 0.0, 0.0], [0.0; 3]);
    w.particles.push_moving([1.01 * RADIUS, 0.0, 0.0], RADIUS, 0, [-1.0, 0.0, 0.0], [0.0; 3]);
    w
}

pub fn a_world_that_goes_wrong_stops_alone(on: &Subject) {
    const STEPS: u64 = 1000;
    const SOFT: f64 = 3e4;
    let mut warned = meeting(SOFT);
    warned.guards.overlap_stops = false;
    // Through everything in one step.
    let mut fast = meeting(1e8);
    fast.particles.velocity[1] = [5e3, 0.0, 0.0];
    let mut batch = Together::new(on, vec![meeting(1e8), meeting(SOFT), warned, fast]);
    let outcomes = batch.try_advance(&[STEPS; 4]);
    let step = |k: usize| batch.worlds[k].1.step;
    let worst = |k: usize| batch.worlds[k].1.worst_overlap;

    assert_eq!(outcomes[0], Ok(()));
    assert!(step(0) == STEPS && worst(0) < 0.3, "{} steps, {} R", step(0), worst(0));
    let mut alone = Together::new(on, vec![meeting(1e8)]);
    alone.steps(STEPS);
    assert_eq!(batch.state(0).hash(), alone.state(0).hash());

    let deep = outcomes[1].as_ref().unwrap_err();
    assert!(step(1) < STEPS && deep.step == step(1) && worst(1) > 0.3, "{deep}, {} steps", step(1));
    assert!(deep.what.contains("particle 1") && deep.what.contains("30 %"), "{deep}");

    assert_eq!(outcomes[2], Ok(()));
    assert!(step(2) == STEPS && worst(2) > 0.3, "{} steps, {} R", step(2), worst(2));

    let away = outcomes[3].as_ref().unwrap_err();
    assert!(step(3) < STEPS && away.what.contains("particle 1"), "{away}");
}
