//! Particles that leave the domain or are removed take the energy of their springs along.

use glebe_engine::batch::{Batch, Status};
use glebe_engine::spec::{Action, Stage, Until, WorldSpec};
use glebe_engine::state::Ledger;
use glebe_physics::IntegratorKind;

use crate::support::{Last, Run, Subject, grain, open_world, plane};

/// Largest open part of the ledger, as a share of the energy of the springs that went.
const OPEN: f64 = 0.01;

const RADIUS: f64 = 2e-3;
const HALF: f64 = 0.05;
const DT: f64 = 2e-7;

/// Three grains that fly towards the high side of y, spinning: 0 pressed against 1 behind it, and 2 against a plane.
fn pressed(integrator: IntegratorKind) -> WorldSpec {
    let mut w = open_world([0.0; 3], HALF, DT, grain(0.8, 0.5));
    w.time.integrator = integrator;
    let (v, spin) = ([0.0, 5.0, 0.0], [120.0, 30.0, 0.0]);
    let y = HALF - 0.05 * RADIUS;
    w.particles.push_moving([0.0, y, 0.01], RADIUS, 0, v, spin);
    w.particles.push_moving([0.0, y - 1.95 * RADIUS, 0.01], RADIUS, 0, v, spin);
    w.particles.push_moving([0.01, y, 0.95 * RADIUS], RADIUS, 0, v, spin);
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
    w
}

pub fn leavers_take_their_springs_along(subject: &Subject) {
    // The last one splits its steps; a software device has no time for those between.
    let ends = [IntegratorKind::Euler, IntegratorKind::VelocityVerlet];
    for &integrator in if subject.every_law { &IntegratorKind::ALL[..] } else { &ends } {
        let name = integrator.name();
        let mut run = Run::new(subject, pressed(integrator));
        let before = run.moment();
        run.g.ledger.initial = before.kinetic() + before.elastic_normal;
        assert_eq!((before.contacts, before.surface_contacts), (1, 1));
        let pressed = before.elastic_normal;
        let mut last = before;
        let mut stiffness = 0.0;
        while run.g.lost.len() < 2 {
            assert!(run.g.step < 500, "{name}: lost are {:?}", run.g.lost);
            if run.g.lost.is_empty() {
                last = run.moment();
                stiffness = run.g.ledger.stiffness_change;
            }
            run.steps(1);
        }
        run.steps(1);
        assert_eq!(run.g.lost.iter().map(|l| l.id).collect::<Vec<_>>(), [0, 2], "{name}");
        let now = run.moment();
        assert!(last.elastic_normal > 0.5 * pressed && now.elastic_normal == 0.0, "{name}: {last:?}");
        let spring = last.elastic_tangential;
        assert!(spring > 0.02 * last.elastic_normal && now.elastic_tangential == 0.0, "{name}: {last:?}");
        let ledger = Ledger { translation: now.translation, rotation: now.rotation, ..run.g.ledger };
        assert_eq!(ledger.elastic_tangential, 0.0, "{name}");
        let open = ledger.integrator() / last.elastic_normal;
        assert!(open.abs() < OPEN, "{name}: open by {open:.2e} of the springs, {ledger:?}");
        // What the tangential springs held is gone with the particles, and not for a change of stiffness.
        let changed = (ledger.stiffness_change - stiffness).abs();
        assert!(changed < 0.1 * spring, "{name}: {changed:e} of {spring:e} J");
    }
}

pub fn trimmed_particles_take_their_springs_along(subject: &Subject) {
    for integrator in IntegratorKind::ALL {
        let mut w = pressed(integrator);
        let stage = |steps: u32, actions| Stage {
            until: Until { at_most: Some(f64::from(steps) * DT), ..Until::default() },
            actions,
            ..Stage::default()
        };
        let trim = Action::RemoveBeyond { axis: [0.0, 1.0, 0.0], limit: HALF - RADIUS };
        w.stages = vec![stage(75, vec![]), stage(25, vec![trim])];
        w.sampling.series = DT;
        let mut batch = Batch::new(vec![w], subject.backend).map_err(|e| e.1).unwrap();
        let mut last = Last::default();
        let mut springs = 0.0;
        while batch.running() {
            if batch.progress(0).stage == 0 {
                springs = batch.moment(0).elastic_normal;
            }
            let Ok(()) = batch.advance(&mut last);
        }
        assert_eq!((batch.status(0), batch.particles(0)), (&Status::Done, 1));
        let ledger = last.0.unwrap().ledger;
        let open = ledger.integrator() / springs;
        assert!(springs > 0.0 && open.abs() < OPEN, "{}: open by {open:.2e}, {ledger:?}", integrator.name());
    }
}
