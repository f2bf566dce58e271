//! Stages, samples and frames: what happens when, whatever else is observed.

// Clippy's permission for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use std::convert::Infallible;
use std::sync::Arc;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Frame, Observer, Sample, Status};
use glebe_engine::spec::{
    Action, Domain, Motion, Oscillation, ParticleSet, Pose, Shape, Side, Stage, Step, Surface, Time, TriMesh,
    Until, WorldSpec,
};
use glebe_engine::state::StageResult;
use glebe_engine::{SetupError, prepare};
use glebe_physics::{History, IntegratorKind, LawChoice, Material};

/// Everything that a batch reports of its first world.
#[derive(Default)]
struct Log {
    samples: Vec<Sample>,
    frames: Vec<f64>,
    ended: Vec<StageResult>,
}

impl Observer for Log {
    type Error = Infallible;
    fn sample(&mut self, _: usize, sample: &Sample) -> Result<(), Infallible> {
        self.samples.push(sample.clone());
        Ok(())
    }
    fn frame(&mut self, _: usize, frame: &Frame<'_>) -> Result<(), Infallible> {
        self.frames.push(frame.time);
        Ok(())
    }
    fn stage_ended(&mut self, _: usize, _: usize, result: &StageResult) -> Result<(), Infallible> {
        self.ended.push(result.clone());
        Ok(())
    }
}

fn run(spec: WorldSpec) -> Log {
    let mut batch = Batch::new(vec![spec], Backend::Cpu).map_err(|e| e.1).unwrap();
    let mut log = Log::default();
    while batch.running() {
        let Ok(()) = batch.advance(&mut log);
    }
    assert_eq!(*batch.status(0), Status::Done);
    log
}

fn stage(name: &str, seconds: f64) -> Stage {
    let until = Until { at_most: Some(seconds), ..Until::default() };
    Stage { name: name.to_owned(), until, ..Stage::default() }
}

/// A grain in a box of one metre; steps of 0.1 ms, samples of 1 ms.
fn world() -> WorldSpec {
    let domain = Domain::aligned([0.0; 3], [1.0; 3], [[Side::Wall; 2]; 3], Some(0));
    let time = Time { step: Step::Fixed(1e-4), integrator: IntegratorKind::Euler, force: true };
    let mut w = WorldSpec::new(domain, time);
    w.materials.push(Material {
        name: "grain".to_owned(),
        density: 2500.0,
        youngs_modulus: 1e7,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.0,
    });
    w.particles.push([0.5, 0.5, 0.5], 0.02, 0);
    w.sampling.series = 1e-3;
    w
}

fn square(absent: bool, motion: Motion) -> Surface {
    let vertices = vec![[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]];
    Surface {
        name: "plate".to_owned(),
        material: 0,
        shape: Shape::Mesh(Arc::new(TriMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] })),
        pose: Pose { translation: [0.3, 0.3, 0.2], ..Pose::default() },
        motion,
        absent,
    }
}

/// Frames once came one sample early, and later still after a stage that ended between samples.
#[test]
fn frames_stand_at_multiples_of_their_interval() {
    let mut w = world();
    w.sampling.frames = Some(5e-3);
    w.stages = vec![stage("odd", 0.0123), stage("rest", 0.02)];
    let log = run(w);
    let expected = [0.0, 5e-3, 10e-3, 15e-3, 20e-3, 25e-3, 30e-3];
    assert_eq!(log.frames.len(), expected.len(), "{:?}", log.frames);
    for (frame, time) in log.frames.iter().zip(expected) {
        assert!((frame - time).abs() < 1e-9, "{:?}", log.frames);
    }
}

/// A state counts its frames, so that whoever does not want them gets the same state.
#[test]
fn frames_that_nobody_wants_change_no_bit() {
    let mut w = world();
    w.sampling.frames = Some(5e-3);
    w.stages = vec![stage("odd", 0.0123)];
    let hash = |wanted: bool| {
        let mut batch = Batch::new(vec![w.clone()], Backend::Cpu).map_err(|e| e.1).unwrap();
        let mut log = Log::default();
        while batch.running() {
            let Ok(()) = if wanted { batch.advance(&mut log) } else { batch.advance(&mut Blind) };
        }
        assert_eq!(log.frames.len(), if wanted { 3 } else { 0 });
        batch.state(0).hash()
    };
    assert_eq!(hash(true), hash(false));
}

/// A surface's own motion once began anew at every stage: an oscillating floor jumped.
#[test]
fn an_own_motion_goes_on_through_stages() {
    let oscillation = Oscillation { amplitude: [0.0, 0.0, 1e-2], frequency: 7.0, phase: 0.3 };
    let motion = Motion { oscillation: Some(oscillation), ..Motion::default() };
    let pose = |stages: Vec<Stage>| {
        let mut w = world();
        w.surfaces.push(square(false, motion.clone()));
        w.stages = stages;
        run(w).samples.last().unwrap().surfaces[0].pose
    };
    assert_eq!(pose(vec![stage("a", 0.031), stage("b", 0.019)]), pose(vec![stage("whole", 0.05)]));
}

/// An absent surface once moved on unseen and appeared elsewhere.
#[test]
fn an_absent_surface_waits_where_it_is() {
    let mut w = world();
    w.surfaces.push(square(true, Motion { velocity: [0.7, 0.0, 0.0], ..Motion::default() }));
    w.stages = vec![stage("settle", 0.05), Stage { actions: vec![Action::Insert(0)], ..stage("go", 0.1) }];
    let log = run(w);
    let before = log.samples.iter().rfind(|s| s.time < 0.0501).unwrap().surfaces[0];
    assert_eq!((before.pose.translation[0], before.path, before.present), (0.3, 0.0, false));
    let after = log.samples.last().unwrap().surfaces[0];
    assert!((after.pose.translation[0] - 0.37).abs() < 1e-12, "{:?}", after.pose);
    assert!((after.path - 0.07).abs() < 1e-9, "{}", after.path);
}

/// A grain that starts to fall is slow too: a stage that waits for rest once ended in mid-air.
#[test]
fn settling_does_not_end_in_free_fall() {
    let mut w = world();
    w.gravity = [0.0, 0.0, -9.81];
    let until = Until { kinetic_energy_below: Some(0.05), at_most: Some(2.0), ..Until::default() };
    w.stages = vec![Stage { until, ..stage("settle", 0.0) }];
    let log = run(w);
    assert_eq!(log.ended[0].ended_by, "kinetic energy");
    // The fall of 0.48 m takes 0.31 s.
    assert!(log.ended[0].time > 0.31, "{}", log.ended[0].time);
}

#[test]
fn a_grain_inside_a_surface_is_refused_before_anything_runs() {
    let mut w = world();
    w.surfaces.push(square(false, Motion::default()));
    w.particles.push([0.31, 0.3, 0.205], 0.02, 0);
    w.stages = vec![stage("any", 0.01)];
    match prepare(w) {
        Err(SetupError::Particle { id: 1, why, .. }) => assert!(why.contains("`plate`"), "{why}"),
        other => panic!("not refused: {:?}", other.err()),
    }
}

#[test]
fn numbers_that_point_nowhere_are_refused() {
    let mut w = world();
    w.stages = vec![Stage { actions: vec![Action::Insert(3)], ..stage("lost", 0.01) }];
    let error = prepare(w).err().unwrap().to_string();
    assert!(error.contains("`lost`") && error.contains("does not exist"), "{error}");
    let mut w = world();
    w.particles.radius.pop();
    w.stages = vec![stage("any", 0.01)];
    assert!(prepare(w).err().unwrap().to_string().contains("differ in length"));
}

/// A spring that is never shortened once booked its whole path anew in every step.
#[test]
fn the_ledger_closes_with_unbounded_history() {
    let mut w = world();
    w.contact.history = History::Unbounded;
    w.gravity = [0.0, 0.0, -9.81];
    w.particles = ParticleSet::default();
    w.particles.push_moving([0.5, 0.5, 0.02 - 1e-6], 0.02, 0, [0.5, 0.0, 0.0], [0.0; 3]);
    w.time.step = Step::Fixed(1e-5);
    w.stages = vec![stage("slide", 0.02)];
    let ledger = run(w).samples.last().unwrap().ledger;
    assert!(ledger.friction > 0.0 && ledger.dissipated() > 1e-3 * ledger.initial);
    let open = ledger.integrator().abs() / ledger.dissipated();
    assert!(open < 0.01, "open by {open} of the dissipated energy: {ledger:?}");
}

/// Bonds are made by a stage, hold from then on, and are counted; without a law of bonds such a stage is refused.
#[test]
fn a_stage_bonds_particles() {
    let mut w = world();
    w.particles = ParticleSet::default();
    for k in 0..4 {
        let v = [0.0, 0.0, if k == 0 { -0.1 } else { 0.1 }];
        w.particles.push_moving([0.5, 0.5, 0.3 + 0.0401 * f64::from(k)], 0.02, 0, v, [0.0; 3]);
    }
    w.time.step = Step::Fixed(1e-6);
    let bond = Stage { actions: vec![Action::Bond], ..stage("held", 0.01) };
    w.stages = vec![stage("free", 1e-3), bond];
    let error = prepare(w.clone()).err().unwrap().to_string();
    assert!(error.contains("`held`") && error.contains("contact.bond"), "{error}");
    let law = |strength: f64| {
        LawChoice::named("parallel")
            .with("normal_stiffness", 1e9)
            .with("shear_stiffness", 1e9)
            .with("tensile_strength", strength)
            .with("shear_strength", 1e6)
            .with("gap", 5e-4)
    };
    w.contact.bond = law(1e6);
    let held = run(w.clone()).samples;
    let at = |time: f64| held.iter().find(|s| s.time > time).unwrap().bonds;
    assert_eq!((at(0.0).made, at(2e-3).made, at(9e-3).broken), (0, 3, 0));
    // The lowest flies on alone where its bond cannot stop it.
    w.contact.bond = law(2e4);
    let torn = run(w.clone());
    let last = torn.samples.last().unwrap();
    assert_eq!((last.bonds.made, last.bonds.broken), (3, 1));
    let open = last.ledger.integrator().abs() / last.ledger.initial;
    // The integrator is off by force · speed · step / 2 where the force ends.
    assert!(open < 2e-3, "open by {open} of the energy: {:?}", last.ledger);
    assert!(last.ledger.friction > 0.0);
    // A gap or a stretch that lists do not reach.
    w.contact.bond = law(1e9);
    let error = prepare(w).err().unwrap().to_string();
    assert!(error.contains("tensile_strength over normal_stiffness"), "{error}");
}
