//! The energy ledger, and what surfaces report.

use glebe_engine::batch::{Batch, Frame, Observer, Sample, Status};
use glebe_engine::lattice::{add, dot, norm, scale, sub};
use glebe_engine::spec::{Domain, Pose, Side, Until};
use glebe_engine::state::StageResult;
use glebe_physics::{ContactModel, LawChoice};

use crate::support::{Random, Run, Subject, grain, mesh, open_world, rectangle};

/// Largest open balance as a share of the dissipated energy, at 50 steps and more per collision.
const CLOSURE: f64 = 0.01;

const RADIUS: f64 = 2e-3;

#[derive(Default)]
struct Last(Option<Sample>);

impl Observer for Last {
    type Error = std::convert::Infallible;
    fn sample(&mut self, _: usize, sample: &Sample) -> Result<(), Self::Error> {
        self.0 = Some(sample.clone());
        Ok(())
    }
    fn frame(&mut self, _: usize, _: &Frame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }
    fn stage_ended(&mut self, _: usize, _: usize, _: &StageResult) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// 64 spheres with friction and rolling resistance fall into a box and come to rest.
pub fn the_ledger_closes(on: &Subject) {
    let mut w = open_world([0.0; 3], 0.1, 4e-6, grain(0.6, 0.4));
    let sides = [[Side::Wall; 2], [Side::Wall; 2], [Side::Wall, Side::Open]];
    w.domain = Domain::aligned([0.0; 3], [0.017, 0.017, 0.06], sides, Some(0));
    w.contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    w.gravity = [0.0, 0.0, -9.81];
    w.sampling.series = 1e-2;
    w.stages[0].until = Until { at_most: Some(0.16), ..Until::default() };
    let mut r = Random(4);
    for i in 0..64 {
        let at = [i % 4, i / 4 % 4, i / 16].map(|k| (2.05 * f64::from(k) + 1.05) * RADIUS);
        let jitter = r.vector(5e-5);
        w.particles.push_moving(
            add(at, jitter),
            RADIUS * (0.85 + 0.15 * r.unit()),
            0,
            r.vector(0.3),
            r.vector(50.0),
        );
    }
    let mut batch = Batch::new(vec![w], on.backend).map_err(|e| e.1).unwrap();
    let mut last = Last::default();
    while batch.running() {
        batch.advance(&mut last).unwrap();
    }
    assert_eq!(*batch.status(0), Status::Done);
    let sample = last.0.unwrap();
    let l = sample.ledger;
    let lost = l.dissipated();
    assert!(
        lost > 0.5 * (l.initial - l.potential) && l.friction > 0.02 * lost && l.rolling > 0.02 * lost,
        "{l:?}"
    );
    assert!(l.integrator().abs() < CLOSURE * lost, "{:.2} % of {l:?}", 100.0 * l.integrator() / lost);
}

/// A moving mesh hits two spheres: the impulse that it reports is the momentum that they gain, the torque their
/// angular momentum, and its work their energy.
pub fn surfaces_account_for_momentum_and_work(on: &Subject) {
    let mut w = open_world([0.0; 3], 0.1, 2e-6, grain(0.7, 0.3));
    let (vertices, triangles) = rectangle([-0.02; 2], [0.02; 2]);
    w.surfaces = vec![mesh(vertices, triangles, Pose::default())];
    w.surfaces[0].motion.velocity = [0.1, 0.0, 0.4];
    w.particles.push_moving([0.003, 0.001, 1.01 * RADIUS], RADIUS, 0, [0.0; 3], [30.0, 0.0, 5.0]);
    w.particles.push_moving([-0.006, 0.004, -1.01 * RADIUS], RADIUS, 0, [0.0, 0.1, 0.9], [0.0; 3]);
    let mut run = Run::new(on, w);
    let before = (run.bodies(), run.moment().kinetic());
    run.steps(1000);
    assert_eq!(run.moment().surface_contacts, 0);
    let after = (run.bodies(), run.moment().kinetic());
    let impulse = run.g.impulse[0].map(|f| f * run.c.dt);
    let gained =
        before.0.iter().zip(&after.0).fold([0.0; 3], |sum, (b, a)| add(sum, scale(sub(a.v, b.v), a.mass)));
    let force = [impulse[0], impulse[1], impulse[2]];
    assert!(norm(gained) > 1e-6);
    assert!(
        norm(add(force, gained)) < on.bounds.balance * norm(gained),
        "impulse {force:?}, momentum {gained:?}"
    );
    let l = run.g.ledger;
    let open = l.work - (after.1 - before.1) - l.dissipated() - l.stiffness_change;
    assert!(open.abs() < 0.01 * l.dissipated(), "work {:e} J leaves {open:e} J, {l:?}", l.work);
    assert!(
        (l.work + dot(force, [0.1, 0.0, 0.4])).abs() < on.bounds.balance * l.work.abs(),
        "work {:e} J",
        l.work
    );
}
