//! Nothing passes through a surface unseen, however fast it is.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use std::sync::Arc;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status, positions};
use glebe_engine::prepare;
use glebe_engine::spec::{
    Domain, Motion, Pose, Rotation, Shape, Side, Stage, Step, Surface, Time, TriMesh, Until, WorldSpec,
};
use glebe_physics::{IntegratorKind, Material};

/// Radius of the sphere that flies \[m\].
const RADIUS: f64 = 1e-3;
/// Step \[s\].
const STEP: f64 = 1e-6;
const STEPS: f64 = 100.0;

/// A sphere of 1 mm and a square of two triangles come together at `speed`, of which the square has a `share`, from a
/// distance of `gap` steps; a sphere of 10 mm is far away.
fn against_a_plate(speed: f64, gap: f64, share: f64) -> WorldSpec {
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
        motion: Motion { velocity: [0.0, 0.0, share * speed], ..Motion::default() },
        absent: false,
    }];
    let height = RADIUS + gap * speed * STEP;
    w.particles.push_moving([0.03, 0.01, height], RADIUS, 0, [0.0, 0.0, -(1.0 - share) * speed], [0.0; 3]);
    w.particles.push([0.5, 0.5, 0.5], 10.0 * RADIUS, 0);
    let mut stage = Stage { name: "enter".to_owned(), ..Stage::default() };
    stage.until.at_most = Some(STEPS * STEP);
    w.stages = vec![stage];
    w
}

#[test]
fn a_sphere_bounces_or_the_run_stops() {
    for backend in [Backend::Cpu, Backend::Reference] {
        let (mut bounced, mut stopped, mut refused) = (0, 0, 0);
        for k in 0..60 {
            // From a hundredth of a radius to ten radii in a step, at several phases of the step.
            let speed = RADIUS / STEP * 10.0_f64.powf(-2.0 + 0.05 * f64::from(k));
            for (phase, share) in [(0.01, 0.0), (0.3, 0.0), (0.6, 0.0), (0.99, 0.0), (0.3, 0.5), (0.6, 1.0)] {
                let world = against_a_plate(speed, 3.0 + phase, share);
                let mut batch = match Batch::new(vec![world], backend) {
                    Ok(batch) => batch,
                    Err((_, error)) => {
                        assert!(share * speed * STEP > 0.5 * RADIUS, "{error}");
                        refused += 1;
                        continue;
                    }
                };
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
                let plate = share * speed * STEPS * STEP;
                assert!(
                    height.is_some_and(|z| z > plate),
                    "{speed:.3e} m/s, phase {phase}, share {share}: {height:?} m"
                );
                bounced += 1;
            }
        }
        assert!(
            bounced > 40 && stopped > 90 && refused > 30,
            "{bounced} bounced, {stopped} stopped, {refused} refused"
        );
    }
}

#[test]
fn a_surface_that_goes_far_in_a_step_is_told_or_refused_with_numbers() {
    let told = |part: f64| {
        let world = against_a_plate(part * RADIUS / STEP, 3.0, 1.0);
        prepare(world).map(|(c, _)| c.warnings.clone()).map_err(|e| e.to_string())
    };
    assert_eq!(told(0.09), Ok(Vec::new()));
    let warned = told(0.2).unwrap();
    assert!(warned.len() == 1, "{warned:?}");
    for part in ["`plate`", "2.000e2 m/s", "2.000e-4 m in a step of 1.000e-6 s", "20 %", "5.000e-7 s"] {
        assert!(warned[0].contains(part), "no `{part}` in: {}", warned[0]);
    }
    let refused = told(0.8).unwrap_err();
    for part in ["`plate`", "8.000e2 m/s", "80 %", "more than 50 %", "1.250e-7 s", "`enter`"] {
        assert!(refused.contains(part), "no `{part}` in: {refused}");
    }
    // While it is away it may do what it likes.
    let mut absent = against_a_plate(RADIUS / STEP, 3.0, 1.0);
    absent.surfaces[0].absent = true;
    assert!(prepare(absent).is_ok());
}

/// Turning about a far axis is fast; how far it will be is only known when the surface gets there.
#[test]
fn a_surface_that_will_be_too_fast_stops_the_world_when_its_stage_begins() {
    let mut world = against_a_plate(0.4 * RADIUS / STEP, 3.0, 0.0);
    world.particles.position[0] = [0.5, 0.5, -0.5];
    world.particles.velocity = vec![[0.0; 3]; 2];
    // 0.4 m away, where turning goes half as far again as is allowed, about the place where the plate was.
    let away = Motion { velocity: [0.4 * RADIUS / STEP, 0.0, 0.0], ..Motion::default() };
    let about = Rotation { axis: [0.0, 0.0, 1.0], center: [0.0; 3], rate: 0.75 * RADIUS / STEP / 0.5 };
    let stage = |name: &str, time: f64, motion: Motion| Stage {
        name: name.to_owned(),
        until: Until { at_most: Some(time), ..Until::default() },
        moves: vec![(0, motion)],
        ..Stage::default()
    };
    let turn = Motion { rotation: Some(about), ..Motion::default() };
    world.stages = vec![stage("go", 1000.0 * STEP, away), stage("turn", STEP, turn)];
    for backend in [Backend::Cpu, Backend::Reference] {
        let mut batch = Batch::new(vec![world.clone()], backend).map_err(|e| e.1).unwrap();
        while batch.running() {
            batch.advance(&mut Blind).unwrap();
        }
        let Status::Failed(failure) = batch.status(0) else { panic!("it went on") };
        assert_eq!((batch.progress(0).step, batch.progress(0).stage), (1000, 1));
        let text = failure.to_string();
        for part in
            ["the surface `plate` moves up to", "76 % of the smallest radius", "time.step of", "`turn`"]
        {
            assert!(text.contains(part), "no `{part}` in: {text}");
        }
    }
}
