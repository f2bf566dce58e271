//! Inlets and outlets: nothing is lost, nothing is counted twice, and every bit repeats.

use glebe_engine::batch::{Batch, Blind, Status};
use glebe_engine::exchange::{Grains, Inlet, Outlet, Room, Supply};
use glebe_engine::generate::SizeDistribution;
use glebe_engine::prepare;
use glebe_engine::spec::{Domain, Frustum, Pose, Sampling, Side, Until, WorldSpec};
use glebe_engine::state::State;

use crate::support::{Subject, frustum, grain, open_world};

/// Largest share of the energy that came in which the ledger may leave open: dashpots and friction are taken at the
/// beginning of each step.
const OPEN: f64 = 0.02;
/// Kilograms per second, and how long \[s\].
const RATE: f64 = 0.04;
const TIME: f64 = 0.024;

/// Grains that are shot down onto a bar, over which they go out.
fn shower() -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.1, 1e-5, grain(0.5, 0.4));
    let walls = [[Side::Wall; 2], [Side::Periodic; 2], [Side::Wall; 2]];
    w.domain = Domain::aligned([-0.012, -0.012, 0.0], [0.012, 0.012, 0.045], walls, Some(0));
    w.gravity = [0.0, 0.0, -9.81];
    w.seed = 4;
    let bar = Frustum { axis: [0.0, 1.0, 0.0], ends: [-0.011, 0.011], radii: [0.004; 2], closed: true };
    w.surfaces.push(frustum(bar, Pose { translation: [0.0, 0.0, 0.02], ..Pose::default() }));
    let sizes = SizeDistribution::Sieve(vec![(0.8e-3, 0.0), (1e-3, 0.4), (1.4e-3, 1.0)]);
    w.inlets.push(Inlet {
        name: "feed".to_owned(),
        room: Room::Box { min: [-0.008, -0.012, 0.033], max: [0.008, 0.012, 0.044] },
        supply: Supply::Mass(RATE, Grains { material: 0, sizes }),
        velocity: [0.0, 0.0, -2.0],
        most: None,
        every: 1e-3,
        stages: None,
    });
    w.outlets.push(Outlet {
        name: "drain".to_owned(),
        room: Room::Beyond { axis: [0.0, 0.0, -1.0], limit: -0.012 },
        every: 5e-4,
        stages: None,
    });
    w.sampling = Sampling { series: 5e-4, ..Sampling::default() };
    w.stages[0].until = Until { at_most: Some(TIME), ..Until::default() };
    w
}

fn run(batch: &mut Batch) {
    while batch.running() {
        let Ok(()) = batch.advance(&mut Blind);
    }
    for w in 0..batch.len() {
        assert_eq!(*batch.status(w), Status::Done);
    }
}

fn mass(state: &State) -> f64 {
    state.particles.velocity.iter().map(|v| 1.0 / f64::from(v.inv_mass)).sum()
}

/// The mass that came in is inside or went out, to the particle; so is the energy; and the bits are those of any other
/// run: alone, in a batch, and after a checkpoint.
pub fn what_comes_in_is_inside_or_went_out(on: &Subject) {
    let spec = shower();
    let mut batch = Batch::new(vec![spec.clone()], on.backend).unwrap();
    while batch.progress(0).step < 1200 {
        let Ok(()) = batch.advance(&mut Blind);
    }
    let middle = batch.state(0).to_bytes();
    run(&mut batch);
    let state = batch.state(0);
    assert!(batch.constants(0).radius_max >= 1.4e-3);
    let g = &state.progress;
    let (came, left) = (g.inlets[0].flow, g.outlets[0]);
    assert!(came.particles > 70 && left.particles > 8, "{came:?} {left:?}");
    assert_eq!(came.particles, g.inlets[0].made);
    assert_eq!(came.particles, left.particles + state.particles.len() as u64);
    assert_eq!(batch.particles(0), state.particles.len());
    assert!(g.lost.is_empty(), "{:?}", g.lost);
    assert!((came.mass - left.mass - mass(&state)).abs() < 1e-12 * came.mass);
    // It owes less than a grain: there was room for all.
    assert!((came.mass + g.inlets[0].owed - RATE * TIME).abs() < 1e-9 * came.mass);
    assert!(g.inlets[0].owed < 4.2 * 1.4e-3_f64.powi(3) * 2500.0 * 1.01, "{}", g.inlets[0].owed);
    let mut radii = state.particles.place.iter().map(|p| f64::from(p.radius));
    assert!(radii.all(|r| (0.799e-3..1.401e-3).contains(&r)));
    let moment = batch.moment(0);
    let mut ledger = g.ledger;
    ledger.stiffness_change += ledger.elastic_tangential - moment.elastic_tangential;
    ledger.translation = moment.translation;
    ledger.rotation = moment.rotation;
    ledger.potential = moment.potential;
    ledger.elastic_normal = moment.elastic_normal;
    ledger.elastic_tangential = moment.elastic_tangential;
    assert!(ledger.entered > 0.0 && ledger.removed > 0.05 * ledger.entered, "{ledger:?}");
    assert!(ledger.dissipated() > 0.1 * ledger.entered, "{ledger:?}");
    assert!(ledger.integrator().abs() < OPEN * ledger.entered, "{:e}: {ledger:?}", ledger.integrator());

    let mut other = spec.clone();
    other.seed = 5;
    let mut both = Batch::new(vec![other, spec], on.backend).unwrap();
    run(&mut both);
    if on.exact_sums {
        assert_eq!(both.state(1).hash(), state.hash(), "another batch, other bits");
    }
    assert_eq!(both.state(1).particles, state.particles);
    assert_ne!(both.state(0).particles.place, state.particles.place, "the seed has no effect");
    if on.exact_states {
        let (fresh, _) = prepare(shower()).unwrap();
        let middle = State::from_bytes(&middle).unwrap();
        middle.belongs_to(&fresh).unwrap();
        let mut resumed = Batch::from_states(vec![(fresh, middle)], on.backend);
        run(&mut resumed);
        assert_eq!(resumed.state(0).particles, state.particles, "after a checkpoint, other bits");
        assert_eq!(resumed.state(0).contacts, state.contacts);
        assert_eq!(resumed.state(0).progress.inlets, state.progress.inlets);
    }
}

/// Particles that an outlet takes come back through the inlet that it feeds, each with its number, radius and mass.
pub fn what_leaves_comes_back(on: &Subject) {
    let mut w = shower();
    w.inlets[0].supply = Supply::Outlet(0);
    for i in 0..40 {
        let at = [f64::from(i % 4) * 0.004 - 0.006, f64::from(i / 4 % 5) * 0.004 - 0.009, 0.034];
        let z = at[2] + 0.004 * f64::from(i / 20);
        w.particles.push_moving([at[0], at[1], z], 1e-3 + f64::from(i) * 1e-5, 0, [0.0, 0.0, -2.0], [0.0; 3]);
    }
    let (_, start) = prepare(w.clone()).unwrap();
    let mut batch = Batch::new(vec![w], on.backend).unwrap();
    run(&mut batch);
    let end = batch.state(0);
    let inlet = &end.progress.inlets[0];
    assert!(inlet.flow.particles > 10 && inlet.made == 0, "{inlet:?}");
    assert_eq!(end.progress.outlets[0].particles, inlet.flow.particles + inlet.queue.len() as u64);
    let kinds = |state: &State| {
        let p = &state.particles;
        let inside =
            (0..p.len()).map(|i| (p.id[i], p.place[i].radius.to_bits(), p.velocity[i].inv_mass.to_bits()));
        let out = state.progress.inlets[0].queue.iter();
        let out = out.map(|w| (w.id, w.radius.to_bits(), w.inv_mass.to_bits()));
        let mut all: Vec<_> = inside.chain(out).collect();
        all.sort_unstable();
        all
    };
    assert_eq!(kinds(&start), kinds(&end));
}
