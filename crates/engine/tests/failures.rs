//! What a world says that goes wrong, word for word.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status};
use glebe_engine::prepare;
use glebe_engine::spec::{Domain, Side, Stage, Step, Time, Until, WorldSpec};
use glebe_engine::state::State;
use glebe_physics::{IntegratorKind, Material};

/// Two grains of 10 mm that touch on a floor and come together at `speed`, the second of them in a corner.
fn world(youngs_modulus: f64, speed: f64) -> WorldSpec {
    let sides = [[Side::Wall; 2], [Side::Wall; 2], [Side::Wall, Side::Open]];
    let domain = Domain::aligned([0.0; 3], [0.2, 0.2, 0.2], sides, Some(0));
    let time = Time { step: Step::Fixed(1e-6), integrator: IntegratorKind::Euler, force: true };
    let mut w = WorldSpec::new(domain, time);
    w.materials.push(Material {
        name: "grain".to_owned(),
        density: 2500.0,
        youngs_modulus,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.0,
    });
    w.guards.overlap_stops = true;
    w.particles.push_moving([0.0301, 0.0101, 0.0101], 0.01, 0, [-speed, 0.0, 0.0], [0.0; 3]);
    w.particles.push_moving([0.0101, 0.0101, 0.0101], 0.01, 0, [0.0; 3], [0.0; 3]);
    let until = Until { at_most: Some(1e-3), ..Until::default() };
    w.stages = vec![Stage { name: "go".to_owned(), until, ..Stage::default() }];
    w
}

/// Why the world fails in a batch with a good one, which goes on.
fn why(bad: WorldSpec, spoil: fn(&mut State), backend: Backend) -> String {
    let (good, mut bad) = (prepare(world(1e7, 0.5)).unwrap(), prepare(bad).unwrap());
    spoil(&mut bad.1);
    let mut batch = Batch::from_states(vec![good, bad], backend);
    while batch.running() {
        batch.advance(&mut Blind).unwrap();
    }
    assert_eq!(*batch.status(0), Status::Done);
    let Status::Failed(failure) = batch.status(1) else { panic!("it is {:?}", batch.status(1)) };
    failure.to_string()
}

#[test]
fn causes_are_told_with_particle_place_contacts_and_advice() {
    for backend in [Backend::Cpu, Backend::Reference] {
        // Beyond what its stiffness can stop. Which of both is named first is left to the backend.
        let mut both = [
            ["particle 1 at (0.010094, 0.010100, 0.010100) m, speed 4.377e-2 m/s, touching 0,"],
            ["particle 0 at (0.027076, 0.010100, 0.010100) m, speed 9.956e0 m/s, touching 1,"],
        ]
        .concat();
        let told = why(world(1e4, 10.0), |_| {}, backend);
        if told.contains("overlaps particle 1") {
            both.reverse();
        }
        assert_eq!(
            told,
            format!(
                "at t = 3.020000e-4 s (step 302): {} overlaps {} by 30 % of the smaller radius, more than the limit of \
                 30 %; the bodies meet too fast for their stiffness, the step is too large, or they started inside each \
                 other; raise youngs_modulus, lower the step, or set time.overlap_limit = \"warn\" if soft particles are \
                 meant",
                both[0], both[1]
            )
        );
        // Further in a step than through a wall.
        assert_eq!(
            why(world(1e7, 0.0), |s| s.particles.velocity[0].v[0] = 2e4, backend),
            "at t = 0.000000e0 s (step 0): particle 0 at (0.030100, 0.010100, 0.010100) m, speed 2.000e4 m/s, touching \
             nothing, moves more than 1.700e-2 m in one step, with which the smallest particle could pass through a \
             surface; the step is too large for the stiffness or the speeds of this world; take a smaller time.step or \
             \"auto\""
        );
        // No number any more.
        let nan = why(world(1e7, 0.0), |s| s.particles.velocity[0].v[1] = f32::NAN, backend);
        assert!(
            nan.contains("particle 0 at (") && nan.contains("has a velocity that is not a number; "),
            "{nan}"
        );
        assert!(nan.contains("(step 0)") && nan.contains("take a smaller time.step"), "{nan}");
    }
}
