//! The servo that drives a cell to a stress.

use glebe_engine::batch::{Batch, Observer, Sample, Status};
use glebe_engine::measure::Interior;
use glebe_engine::prepare;
use glebe_engine::spec::{Deformation, Drive, Stage, Step, Until, WorldSpec};
use glebe_physics::{ContactModel, LawChoice, Material};

use crate::deforming::packed;
use crate::samples::interior;
use crate::support::{REFERENCE, Run, Subject, Together, grain};

/// Steps that suffice to reach a stress, and to shear by some percent.
const STEPS: u64 = 3000;

/// Every axis to this stress \[Pa\].
fn isotropic(stress: f64) -> Deformation {
    let free = Drive::Rate(0.0);
    let held = Drive::Stress(stress);
    Deformation { drive: [held, held, held, free, free, free], inertial_number: 0.05, control_steps: None }
}

/// A dense sample of soft grains, damped so that it comes to rest soon.
fn sample(count: usize, deformation: Deformation) -> WorldSpec {
    let mut w = packed(count, 3, [0.0; 6]);
    w.particles.velocity = Vec::new();
    w.particles.spin = Vec::new();
    w.materials[0].restitution = 0.1;
    w.local_damping = 0.2;
    w.stages[0].deformation = Some(deformation);
    w
}

/// Stress of all axes is reached and held, whether the sample was looser or tighter, and the cell comes to rest.
pub fn the_servo_reaches_a_stress_and_holds_it(on: &Subject) {
    for target in [2e3, 5e4] {
        let mut run = Run::new(on, sample(100, isotropic(target)));
        let before = interior(&mut run);
        assert!(before.p() > 4e3 && before.p() < 2.5e4, "p is {:e} Pa at the start", before.p());
        let limit = 0.05 / (2.0 * run.c.radius_mean) * (target / 2500.0).sqrt();
        for _ in 0..STEPS / 20 {
            run.steps(20);
            let fastest =
                run.g.cell.unwrap().gradient.into_iter().flatten().fold(0.0, |a: f64, b| a.max(b.abs()));
            assert!(fastest <= limit * (1.0 + 1e-12), "{fastest} 1/s is above {limit} 1/s");
        }
        let i = interior(&mut run);
        for k in 0..3 {
            let off = (i.stress[k][k] / target - 1.0).abs();
            assert!(off < 0.01, "{target} Pa: stress {k} is {:e} Pa", i.stress[k][k]);
        }
        // Of the stress path: strain grows where stress does.
        assert_eq!(i.volumetric_strain() > 0.0, target > before.p());
        let still = run.g.cell.unwrap().gradient.into_iter().flatten().fold(0.0, |a: f64, b| a.max(b.abs()));
        assert!(still < 0.02 * limit, "the cell still moves at {still} 1/s");
    }
}

/// Triaxial compression of a sample: lateral stress is held while the axis is strained, and the deviator grows.
pub fn lateral_stress_is_held(on: &Subject) {
    let target = 1e4;
    let mut d = isotropic(target);
    let mut w = sample(100, d);
    run_to(&mut w, 0.01);
    d.drive[2] = Drive::Rate(4.0);
    let dt = 2e-6;
    w.stages.push(Stage {
        name: "shear".to_owned(),
        until: Until { at_most: Some(STEPS as f64 * dt), ..Until::default() },
        deformation: Some(d),
        ..Stage::default()
    });
    w.sampling.series = 100.0 * dt;
    let mut batch = Batch::new(vec![w], on.backend).map_err(|e| e.1).unwrap();
    let mut seen = Seen::default();
    while batch.running() {
        let Ok(()) = batch.advance(&mut seen);
    }
    assert_eq!(batch.status(0), &Status::Done);
    assert_eq!(batch.progress(0).results[0].ended_by, "stress");
    let sheared: Vec<&Sample> = seen.0.iter().filter(|s| s.stage > 0).collect();
    let stresses = |s: &&Sample| s.interior.unwrap().stress;
    for s in sheared.iter().skip(5).map(stresses) {
        for k in 0..2 {
            assert!((s[k][k] / target - 1.0).abs() < 0.1, "lateral stress {:e} Pa", s[k][k]);
        }
    }
    let last = sheared.last().unwrap().interior.unwrap();
    assert!(last.q() > 0.5 * target, "q is {:e} Pa", last.q());
    // With held lateral stress q grows three times as fast as p.
    assert!((last.q() / (3.0 * (last.p() - target)) - 1.0).abs() < 0.1, "{last:?}");
}

/// A dense sample of stiff grains that hardly roll widens faster than it is shortened, and its servo follows: lateral
/// stress stays within one percent of its target on average, within ten percent at every row.
pub fn a_dense_sample_keeps_its_lateral_stress(on: &Subject) {
    let (target, inertial_number) = (1e4, 0.02);
    let mut d = Deformation { inertial_number, ..isotropic(target) };
    let mut w = sample(120, d);
    w.materials[0] = Material { youngs_modulus: 5e7, poissons_ratio: 0.5, ..grain(1.0, 0.66) };
    w.contact = ContactModel {
        normal: LawChoice::named("rve"),
        tangential: LawChoice::named("rve"),
        rolling: LawChoice::named("moment-rotation")
            .with("rolling_strength", 2.0)
            .with("twisting_strength", 1.5),
        ..ContactModel::default()
    };
    run_to(&mut w, 0.01);
    let diameter = 2.0 * w.particles.radius.iter().sum::<f64>() / w.particles.len() as f64;
    let rate = inertial_number / diameter * (target / w.materials[0].density).sqrt();
    d.drive[2] = Drive::Rate(rate);
    w.stages.push(Stage {
        name: "shear".to_owned(),
        until: Until { at_most: Some(0.06 / rate), ..Until::default() },
        deformation: Some(d),
        ..Stage::default()
    });
    w.sampling.series = 1e-3 / rate;
    let mut batch = Batch::new(vec![w], on.backend).map_err(|e| e.1).unwrap();
    let mut seen = Seen::default();
    while batch.running() {
        let Ok(()) = batch.advance(&mut seen);
    }
    assert_eq!(batch.status(0), &Status::Done);
    let sheared: Vec<_> =
        seen.0.iter().filter(|s| s.stage > 0).map(|s| (s.time, s.interior.unwrap())).collect();
    // Contacts and motion, as the servo has it.
    let across =
        |(_, i): &(f64, Interior), k: usize| (i.stress[k][k] + i.kinetic_stress[k][k]) / target - 1.0;
    let settled = &sheared[5..];
    for k in 0..2 {
        let off = settled.iter().map(|s| across(s, k)).sum::<f64>() / settled.len() as f64;
        assert!(off.abs() < 0.01, "lateral stress {k} is {off:.3} off on average");
        let most = settled.iter().map(|s| across(s, k).abs()).fold(0.0, f64::max);
        assert!(most < 0.1, "lateral stress {k} is {most:.3} off at a time");
    }
    // The inertial number alone allows once.
    let widening = |w: &[(f64, Interior)]| {
        let by = (0..2).map(|k| w[0].1.strain[k][k] - w[1].1.strain[k][k]).fold(0.0, f64::max);
        by / (w[1].0 - w[0].0) / rate
    };
    let fastest = sheared.windows(2).map(widening).fold(0.0, f64::max);
    assert!(fastest > 1.1, "it widens {fastest} times as fast as it is shortened");
}

/// Ends the first stage when its stress is reached.
fn run_to(w: &mut WorldSpec, share: f64) {
    w.stages[0].until = Until { stress_within: Some(share), at_most: Some(0.1), ..Until::default() };
}

#[derive(Default)]
struct Seen(Vec<Sample>);

impl Observer for Seen {
    type Error = std::convert::Infallible;
    fn sample(&mut self, _: usize, sample: &Sample) -> Result<(), Self::Error> {
        self.0.push(sample.clone());
        Ok(())
    }
    fn wants_frames(&self) -> bool {
        false
    }
}

/// A shear stress is reached on a sample under pressure.
pub fn the_servo_reaches_a_shear_stress(on: &Subject) {
    let mut d = isotropic(2e4);
    d.drive[5] = Drive::Stress(3e3);
    let mut run = Run::new(on, sample(100, d));
    run.steps(STEPS);
    let i = interior(&mut run);
    let tau = 0.5 * (i.stress[0][1] + i.stress[1][0]);
    assert!((tau / 3e3 - 1.0).abs() < 0.05, "shear stress {tau:e} Pa");
    assert!((i.p() / 2e4 - 1.0).abs() < 0.02, "p {:e} Pa", i.p());
    assert!(i.strain[0][1] > 0.0);
}

/// A governed world is the same alone and in a batch, and agrees with the reference.
pub fn a_governed_world_keeps_its_bits(on: &Subject) {
    let spec = || sample(100, isotropic(2e4));
    let mut run = Run::new(on, spec());
    run.steps(90);
    let mut batch = Together::new(on, vec![sample(70, isotropic(1e4)), spec(), packed(60, 9, [5.0; 6])]);
    for part in [[10, 45, 90], [33, 45, 3]] {
        batch.advance(&part);
    }
    assert_eq!(batch.state(1).hash(), run.state().hash());
    let mut reference = Run::new(&REFERENCE, spec());
    reference.steps(90);
    let (a, b) = (run.g.cell.unwrap(), reference.g.cell.unwrap());
    for k in 0..3 {
        let off = (a.strain[k][k] / b.strain[k][k] - 1.0).abs();
        assert!(off <= on.bounds.trajectory.velocity, "strain {:e} and {:e}", a.strain[k][k], b.strain[k][k]);
    }
}

#[test]
fn steps_between_acts_follow_stress_stiffness_and_rates() {
    let (target, inertial_number, stiff) = (1e4, 1e-3, 4e9);
    let steps = |change: &dyn Fn(&mut Deformation), youngs_modulus: f64, dt: Option<f64>| {
        let mut d = Deformation { inertial_number, ..isotropic(target) };
        change(&mut d);
        let mut w = sample(70, d);
        w.materials[0].youngs_modulus = youngs_modulus;
        w.contact.normal = LawChoice::named("rve");
        w.materials[0].restitution = 1.0;
        w.time.step = dt.map_or(Step::Auto, Step::Fixed);
        let c = prepare(w).unwrap().0;
        let all = c.control_steps[0];
        (all, c)
    };
    let (n, c) = steps(&|_| (), stiff, Some(1e-7));
    // K = 2 E R* = E r for equal spheres of the mean radius, so the mean field has M = 0.7 K/2r = 0.35 E.
    let rate = inertial_number / (2.0 * c.radius_mean) * (target / c.density_mean).sqrt();
    let change = |n: u64| 0.35 * stiff * rate * c.dt * n as f64 / target;
    assert!((2..20).contains(&n) && change(n) <= 0.1 && change(n + 1) > 0.1, "{n} steps: {}", change(n));
    // Softer grains need fewer acts, faster samples more.
    assert_eq!(steps(&|_| (), 1e6, Some(1e-7)).0, 20);
    assert_eq!(steps(&|d| d.inertial_number = 0.1, stiff, Some(1e-7)).0, 1);
    let driven = steps(&|d| d.drive[2] = Drive::Rate(-3.0 * rate), stiff, Some(1e-7)).0;
    assert!(driven < n / 3, "{driven} and {n}");
    assert_eq!(steps(&|d| d.control_steps = Some(33), stiff, None).0, 33);
    // Nothing is known of a stress that is to vanish.
    let relaxed = |d: &mut Deformation| d.drive = [Drive::Stress(0.0); 6];
    assert_eq!(steps(&relaxed, stiff, None).0, 20);
}

fn refusal(change: impl FnOnce(&mut WorldSpec)) -> Result<Vec<String>, String> {
    let mut w = sample(70, isotropic(1e4));
    w.contact.normal = LawChoice::named("hertz");
    change(&mut w);
    prepare(w).map(|(c, _)| c.warnings.clone()).map_err(|e| e.to_string())
}

#[test]
fn what_cannot_be_governed_is_refused() {
    let quiet = refusal(|_| ()).unwrap();
    assert!(!quiet.iter().any(|w| w.contains("inertial")), "{quiet:?}");
    let said = |change: fn(&mut Deformation), part: &str| {
        let said = refusal(|w| w.stages[0].deformation.iter_mut().for_each(change));
        let said = said.map_or_else(|e| e, |warnings| warnings.join("\n"));
        assert!(said.contains(part) && said.contains("stage `run`"), "{said}");
    };
    said(|d| d.control_steps = Some(0), "every 0 steps");
    said(|d| d.inertial_number = 0.0, "above 0");
    said(|d| d.drive[1] = Drive::Stress(f64::INFINITY), "inf Pa");
    said(|d| d.drive[2] = Drive::Rate(49.0), "inertial number");
    let waits = refusal(|w| {
        w.stages[0].until.stress_within = Some(0.01);
        w.stages[0].deformation = None;
    });
    assert!(waits.unwrap_err().contains("goes for none"));
}
