//! Equal runs give equal bits.

use std::convert::Infallible;
use std::sync::Arc;

use glebe_engine::batch::{Batch, Blind, Frame, Glance, Observer, Sample, Status};
use glebe_engine::lattice::{add, norm, sub};
use glebe_engine::poses::{PoseTable, TimedPose};
use glebe_engine::spec::{Action, Domain, Pose, Rotation, Side, Stage, Until, Vec3, WorldSpec};
use glebe_engine::state::{Particles, State};
use glebe_engine::surface::quaternion;
use glebe_physics::{ContactModel, IntegratorKind, LawChoice};

use crate::support::{Random, Run, Subject, Together, bodies, grain, mesh, open_world, rectangle};

const RADIUS: f64 = 1e-3;

/// `count` spheres of 0.6-1 mm tumbling over a turning blade in a box that is periodic along x. The
/// blade turns steadily for even seeds, by a table for odd ones.
fn tumbling(count: u32, seed: u64) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.1, 4e-6, grain(0.5, 0.4));
    let (side, columns) = (0.0255, 12);
    let sides = [[Side::Periodic; 2], [Side::Wall; 2], [Side::Wall, Side::Open]];
    w.domain = Domain::aligned([0.0; 3], [side, side, 0.2], sides, Some(0));
    w.contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    w.gravity = [0.0, 0.0, -9.81];
    w.time.integrator = IntegratorKind::ALL[seed as usize % 4];
    let (vertices, triangles) = rectangle([-0.01, -0.02], [0.01, 0.02]);
    let pose = Pose { translation: [0.5 * side, 0.5 * side, 2e-3], rotation: [1.0, 0.0, 0.0, 0.0] };
    w.surfaces = vec![mesh(vertices, triangles, pose)];
    if seed.is_multiple_of(2) {
        w.surfaces[0].motion.rotation =
            Some(Rotation { axis: [0.0, 1.0, 0.0], center: pose.translation, rate: 4.0 });
    } else {
        // It swings to and fro with rows every 28 steps, from a little after the beginning on.
        let row = |k: u32| {
            let side = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let pose = Pose {
                translation: [1e-4 * f64::from(k), 0.0, 1e-4 * side],
                rotation: quaternion([0.0, 1.0, 0.0], 0.02 * side),
            };
            TimedPose { time: 1.1e-4 * f64::from(k) + 3e-5, pose }
        };
        w.surfaces[0].motion.poses =
            Some(Arc::new(PoseTable::new(&(0..12).map(row).collect::<Vec<_>>()).unwrap()));
    }
    let mut r = Random(seed);
    for i in 0..count {
        let at = [i % columns, i / columns % columns, i / (columns * columns)];
        let x = add(at.map(|k| (2.1 * f64::from(k) + 1.1) * RADIUS), r.vector(5e-5));
        w.particles.push_moving(x, RADIUS * (0.6 + 0.4 * r.unit()), 0, r.vector(0.5), r.vector(100.0));
    }
    w
}

fn ran(on: &Subject, seed: u64) -> State {
    let (count, steps) = (on.budget.tumblers, on.budget.tumbling);
    let mut run = Run::new(on, tumbling(count, seed));
    run.steps(steps);
    run.state()
}

/// Keeps the particles of every glance, with places and time, and holds looks against them.
#[derive(Default)]
struct Both {
    glanced: Option<(Particles, Vec<Vec3>, f64)>,
    compared: u32,
}

impl Observer for Both {
    type Error = Infallible;
    fn wants_glance(&self, _: usize, _: &Sample) -> bool {
        true
    }
    fn wants_look(&self, _: usize, _: &Sample) -> bool {
        true
    }
    fn glance(&mut self, _: usize, seen: &Glance<'_>) -> Result<(), Infallible> {
        self.glanced = Some((seen.particles.clone(), seen.positions.to_vec(), seen.time));
        Ok(())
    }
    fn look(&mut self, _: usize, frame: &Frame<'_>) -> Result<(), Infallible> {
        let looked = (frame.state.particles.clone(), frame.positions.to_vec(), frame.time);
        assert_eq!(self.glanced.take().unwrap(), looked);
        self.compared += 1;
        Ok(())
    }
}

/// A glance shows the particles of the state as they are.
pub fn a_glance_shows_the_particles(on: &Subject) {
    let mut w = tumbling(on.budget.tumblers / 3, 4);
    let dt = 4e-6;
    w.stages[0].until = Until { at_most: Some(90.0 * dt), ..Until::default() };
    w.sampling.series = 30.0 * dt;
    let mut batch = Batch::new(vec![w], on.backend).map_err(|e| e.1).unwrap();
    let mut both = Both::default();
    while batch.running() {
        let Ok(()) = batch.advance(&mut both);
    }
    assert_eq!((batch.status(0), both.compared), (&Status::Done, 4));
}

pub fn runs_repeat(on: &Subject) {
    let state = ran(on, 1);
    assert!(!state.contacts.is_empty() && !state.surface_contacts.is_empty());
    assert_eq!(state.hash(), ran(on, 1).hash());
    assert_ne!(state.hash(), ran(on, 5).hash());
}

pub fn threads_change_no_bit(on: &Subject) {
    let hash = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let state = pool.install(|| ran(on, 2));
        assert!(state.progress.rebuilds > 1, "lists were never rebuilt");
        state.hash()
    };
    let one = hash(1);
    assert_eq!(one, hash(2), "two threads");
    assert_eq!(one, hash(7), "seven threads");
}

/// Worlds of which there are many take kernels of their own, alone and in a batch.
pub fn a_world_alone_equals_itself_in_a_batch(on: &Subject) {
    alone_as_in_a_batch(on, false);
    if on.every_law {
        alone_as_in_a_batch(on, true);
    }
}

fn alone_as_in_a_batch(on: &Subject, throughput: bool) {
    let (count, steps) = (on.budget.tumblers, on.budget.tumbling);
    let tumbling = |count, seed| {
        let mut w = tumbling(count, seed);
        w.throughput = throughput;
        w
    };
    let alone = |parts: &[u64]| {
        let mut run = Run::new(on, tumbling(count, 3));
        for part in parts {
            run.steps(*part);
        }
        run.state()
    };
    let specs = vec![tumbling(count / 3, 6), tumbling(count, 3), tumbling(7, 5)];
    let mut batch = Together::new(on, specs);
    // The others take other numbers of steps, and the middle one takes its own in two parts.
    for part in [[10, steps / 2, steps], [steps, steps - steps / 2, 3]] {
        batch.advance(&part);
    }
    let seen = batch.state(1);
    assert_eq!(seen.hash(), alone(&[steps / 2, steps - steps / 2]).hash());
    // In one piece nothing moves otherwise either; a device rounds what it accounts where a job ends.
    let mut whole = alone(&[steps]);
    let rows = |s: &State| {
        let l = s.progress.ledger;
        [l.friction, l.dashpots, l.rolling, l.damping, l.stiffness_change, l.work, l.elastic_tangential]
    };
    let open = if on.exact_sums { 0.0 } else { 1e-12 * rows(&whole).map(f64::abs).iter().sum::<f64>() };
    for (a, b) in rows(&seen).into_iter().zip(rows(&whole)) {
        assert!((a - b).abs() <= open, "{a:e} instead of {b:e}, {open:e} apart at most");
    }
    whole.progress.ledger = seen.progress.ledger;
    assert_eq!(seen.hash(), whole.hash());
}

/// Worlds that share their first stages: one does them, another takes its state, a third begins by itself.
pub fn a_world_that_waits_ends_as_if_it_had_not(on: &Subject) {
    let (dt, steps) = (4e-6, on.budget.tumbling as f64);
    let mut w = tumbling(on.budget.tumblers / 3, 4);
    let stage = |name: &str, share: f64, actions: Vec<Action>| {
        let until = Until { at_most: Some(share * steps * dt), ..Until::default() };
        Stage { name: name.to_owned(), until, actions, ..Stage::default() }
    };
    // The state that it takes up has fewer particles than it began with.
    let half = Action::RemoveBeyond { axis: [1.0, 0.0, 0.0], limit: 0.0128 };
    w.stages = vec![stage("begin", 0.2, vec![half]), stage("go on", 0.3, Vec::new())];
    w.sampling.series = 0.05 * steps * dt;
    let mut batch = Batch::new(vec![w.clone(), w.clone(), w], on.backend).map_err(|e| e.1).unwrap();
    batch.wait(1);
    batch.wait(2);
    while batch.progress(0).results.is_empty() {
        let Ok(()) = batch.advance(&mut Blind);
    }
    assert_eq!((batch.status(1), batch.time(1)), (&Status::Waiting, 0.0));
    let state = batch.state(0);
    batch.begin_from(1, Some(state));
    batch.begin_from(2, None);
    while batch.running() {
        let Ok(()) = batch.advance(&mut Blind);
    }
    assert!(batch.progress(0).results[0].trimmed > 0);
    for w in [1, 2] {
        assert_eq!((batch.status(w), batch.particles(w)), (&Status::Done, batch.particles(0)));
        if on.exact_states || w == 2 {
            assert_eq!(batch.state(w).hash(), batch.state(0).hash(), "world {w}");
        }
    }
}

/// A surface that comes or goes changes the world in place: nothing is other than where the whole state is put anew, which
/// a removal asks for that finds no particle.
pub fn a_surface_comes_and_goes_as_with_a_new_state(on: &Subject) {
    let (dt, steps) = (4e-6, on.budget.tumbling as f64);
    let world = |anew: bool| {
        let mut w = tumbling(on.budget.tumblers / 3, 4);
        let far = || anew.then_some(Action::RemoveBeyond { axis: [1.0, 0.0, 0.0], limit: 1.0 });
        let stage = |name: &str, actions: Vec<Action>| {
            let until = Until { at_most: Some(0.25 * steps * dt), ..Until::default() };
            Stage { name: name.to_owned(), until, actions, ..Stage::default() }
        };
        let doing = |name: &str, own: Action| stage(name, [own].into_iter().chain(far()).collect());
        w.stages = vec![
            stage("begin", Vec::new()),
            doing("go", Action::Withdraw(0)),
            doing("come", Action::Insert(0)),
        ];
        w.sampling.series = 0.125 * steps * dt;
        w
    };
    let (in_place, anew) = (world(false), world(true));
    let mut batch = Batch::new(vec![in_place.clone(), anew, in_place], on.backend).map_err(|e| e.1).unwrap();
    while batch.running() {
        let Ok(()) = batch.advance(&mut Blind);
    }
    let [a, b, c] = [0, 1, 2].map(|w| batch.state(w));
    assert_eq!(batch.status(0), &Status::Done);
    assert!(!a.contacts.is_empty() && a.progress.surfaces[0].present);
    assert_eq!(a.hash(), c.hash());
    if on.exact_states {
        assert_eq!(a.hash(), b.hash());
    }
}

/// Every integrator goes on from a state taken between two rebuilds as if nothing had happened.
pub fn a_checkpoint_goes_on(on: &Subject) {
    let (count, steps) = (on.budget.tumblers, on.budget.tumbling);
    for seed in 0..4 {
        let mut run = Run::new(on, tumbling(count / 3, seed));
        run.steps(steps / 2 + 3);
        let bytes = run.state().to_bytes();
        let mut resumed = Run::resume(on, run.c.clone(), State::from_bytes(&bytes).unwrap());
        run.steps(steps / 2);
        resumed.steps(steps / 2);
        let (a, b) = (run.state(), resumed.state());
        if on.exact_states {
            assert_eq!(a.hash(), b.hash(), "{}", IntegratorKind::ALL[seed as usize].name());
        } else {
            for (a, b) in bodies(&run.c, &a).iter().zip(bodies(&run.c, &b)) {
                assert!(norm(sub(a.x, b.x)) < 1e-5 * RADIUS, "{a:?} instead of {b:?}");
            }
        }
    }
}

pub fn leavers_are_listed(on: &Subject) {
    let mut w = open_world([0.0; 3], 0.05, 1e-5, grain(0.5, 0.5));
    for i in 0..20 {
        let away = if i % 5 == 0 { 8.0 } else { 0.01 };
        let x = [0.005 * f64::from(i) - 0.0475, 0.0, 0.0];
        w.particles.push_moving(x, RADIUS, 0, [0.0, away, 0.0], [0.0; 3]);
    }
    let mut run = Run::new(on, w);
    run.steps(1000);
    let ids: Vec<u32> = run.g.lost.iter().map(|l| l.id).collect();
    assert_eq!(ids, [0, 5, 10, 15]);
    assert!(run.g.lost.iter().all(|l| l.side == [1, 1] && l.position[1] >= 0.05));
    assert_eq!(run.bodies().len(), 16);
    let energy: f64 = run.g.ledger.removed;
    let each = 0.5 * 64.0 * crate::support::sphere_mass(RADIUS, &grain(0.5, 0.5));
    assert!((energy / (4.0 * each) - 1.0).abs() < 1e-5, "removed {energy:e} J");
}
