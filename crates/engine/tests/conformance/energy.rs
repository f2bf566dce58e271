//! The energy ledger, and what surfaces report.

use glebe_engine::batch::{Batch, Status};
use glebe_engine::lattice::{add, dot, norm, scale, sub};
use glebe_engine::spec::{Domain, Pose, Side, Until};
use glebe_physics::{ContactModel, IntegratorKind, LawChoice};

use crate::support::{Last, Random, Run, Subject, Together, grain, mesh, open_world, plane, rectangle};

/// Largest open balance as a share of the dissipated energy, at 50 steps and more per collision.
const CLOSURE: f64 = 0.01;

/// Largest relative change of the energy of an elastic gas; that of `exact` grows by percents.
const DRIFT: [(IntegratorKind, f64); 3] =
    [(IntegratorKind::Euler, 2e-5), (IntegratorKind::VelocityVerlet, 2e-5), (IntegratorKind::Adams, 1e-3)];

const RADIUS: f64 = 2e-3;

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

/// A dilute gas of spheres that lose nothing keeps its energy through its collisions, of some 200 steps each.
pub fn an_elastic_gas_keeps_its_energy(on: &Subject) {
    let gas = |integrator: IntegratorKind| {
        let mut w = open_world([0.0; 3], 0.1, 4e-6, grain(1.0, 0.0));
        let side = 0.02;
        w.domain = Domain::aligned([0.0; 3], [side; 3], [[Side::Periodic; 2]; 3], None);
        w.contact.tangential = LawChoice::named("none");
        w.time.integrator = integrator;
        let mut r = Random(6);
        for i in 0..64 {
            let at = [i % 4, i / 4 % 4, i / 16].map(|k| side * (0.25 * f64::from(k) + 0.125));
            w.particles.push_moving(at, RADIUS * (0.5 + 0.5 * r.unit()), 0, r.vector(0.5), [0.0; 3]);
        }
        w
    };
    let mut batch = Together::new(on, DRIFT.map(|(integrator, _)| gas(integrator)).to_vec());
    let before = [0, 1, 2].map(|k| batch.moment(k).kinetic());
    let (mut met, mut free) = ([0; 3], [0; 3]);
    let looks = on.budget.gas / 50;
    for _ in 0..looks {
        batch.steps(50);
        for (k, (integrator, most)) in DRIFT.into_iter().enumerate() {
            let m = batch.moment(k);
            met[k] += m.contacts;
            // Within a contact energy swings with the step, and comes back.
            if m.contacts == 0 {
                free[k] += 1;
                let drift = m.kinetic() / before[k] - 1.0;
                assert!(drift.abs() < most, "{}: energy changed by {drift:.2e}", integrator.name());
            }
        }
    }
    let enough = |k: usize| met[k] > looks && 50 * free[k] > looks;
    assert!((0..3).all(enough), "{met:?} contacts, {free:?} of {looks} looks without one");
}

/// A sphere thrown obliquely at a wall: Mindlin's spring, whose stiffness changes while it is stretched, is not
/// conservative, and its row says by how much, at most 2 % of the energy. Nothing else is left open.
pub fn a_changing_stiffness_is_accounted(on: &Subject) {
    for along in [0.1, 0.2, 0.4, 0.6] {
        let mut w = open_world([0.0; 3], 0.1, 5e-7, grain(1.0, 0.5));
        w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
        w.particles.push_moving([0.0, 0.0, 1.001 * RADIUS], RADIUS, 0, [along, 0.0, -0.5], [0.0; 3]);
        let mut run = Run::new(on, w);
        let before = run.moment().kinetic();
        run.steps(3000);
        let m = run.moment();
        assert_eq!(m.surface_contacts, 0);
        let l = run.g.ledger;
        let change = l.stiffness_change.abs();
        assert!((1e-4..0.02).contains(&(change / before)), "{along} m/s: {:.2e}", change / before);
        let open = before - m.kinetic() - l.dissipated() - l.stiffness_change;
        let accounted = l.dissipated() + change;
        assert!(open.abs() < CLOSURE * accounted, "{along} m/s: {open:e} J are left open of {accounted:e}");
    }
}
