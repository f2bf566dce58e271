//! Nothing passes through a surface unseen, however fast it is.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::sync::Arc;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status, positions};
use glebe_engine::spec::{Domain, Motion, Pose, Shape, Side, Stage, Step, Surface, Time, TriMesh, WorldSpec};
use glebe_physics::{IntegratorKind, Material};

/// Radius of the sphere that flies \[m\].
const RADIUS: f64 = 1e-3;
/// Step \[s\].
const STEP: f64 = 1e-6;
const STEPS: f64 = 100.0;

/// A sphere of 1 mm flies at `speed` against a square of two triangles, from a distance of `gap` steps; one of 10 mm
/// is far away.
fn against_a_plate(speed: f64, gap: f64) -> WorldSpec {
    let domain = Domain::aligned([-1.0; 3], [1.0; 3], [[Side::Open; 2]; 3], None);
    let time = Time { step: Step::Fixed(STEP), integrator: IntegratorKind::Euler, force: true };
    let mut w = WorldSpec::new(domain, time);
    w.materials.push(Material {
        name: "stone".to_owned(),
        density: 2500.0,
        youngs_modulus: 1e9,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.0,
    });
    let vertices = vec![[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]];
    w.surfaces = vec![Surface {
        name: "plate".to_owned(),
        material: 0,
        shape: Shape::Mesh(Arc::new(TriMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] })),
        pose: Pose::default(),
        motion: Motion::default(),
        absent: false,
    }];
    let height = RADIUS + gap * speed * STEP;
    w.particles.push_moving([0.03, 0.01, height], RADIUS, 0, [0.0, 0.0, -speed], [0.0; 3]);
    w.particles.push([0.5, 0.5, 0.5], 10.0 * RADIUS, 0);
    let mut stage = Stage::default();
    stage.until.at_most = Some(STEPS * STEP);
    w.stages = vec![stage];
    w
}

#[test]
fn a_sphere_bounces_or_the_run_stops() {
    for backend in [Backend::Cpu, Backend::Reference] {
        let (mut bounced, mut stopped) = (0, 0);
        for k in 0..60 {
            // From a hundredth of a radius to ten radii in a step, at several phases of the step.
            let speed = RADIUS / STEP * 10.0_f64.powf(-2.0 + 0.05 * f64::from(k));
            for phase in [0.01, 0.3, 0.6, 0.99] {
                let world = against_a_plate(speed, 3.0 + phase);
                let mut batch = Batch::new(vec![world], backend).map_err(|e| e.1).unwrap();
                while batch.running() {
                    batch.advance(&mut Blind).unwrap();
                }
                if let Status::Failed(failure) = batch.status(0) {
                    assert!(failure.what.contains("particle 0 at ("), "{failure}");
                    assert!(failure.cause.contains("step"), "{failure}");
                    stopped += 1;
                    continue;
                }
                let state = batch.state(0);
                let flyer = state.particles.id.iter().position(|id| *id == 0);
                let height = flyer.map(|i| positions(batch.constants(0), &state)[i][2]);
                assert!(height.is_some_and(|z| z > 0.0), "{speed:.3e} m/s, phase {phase}: {height:?} m");
                bounced += 1;
            }
        }
        assert!(bounced > 20 && stopped > 60, "{bounced} bounced, {stopped} stopped");
    }
}
