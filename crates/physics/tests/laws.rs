//! Laws against closed forms: paths of loading, pull-off, rupture, what is stored and lost.

// Clippy's permission for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use glebe_physics::kernel64::bond::{Bond, BondLaw, Held, Hold, Parting, Visitor as OfBond};
use glebe_physics::kernel64::cohesion::{Attraction, Cohesion, CohesionLaw, Visitor as OfCohesion};
use glebe_physics::kernel64::contact::{Coefficients, Memory, Touch, nothing, pressed};
use glebe_physics::kernel64::normal::{Normal, NormalForce, NormalLaw, Visitor as OfNormal};
use glebe_physics::kernel64::powers::cube_root;
use glebe_physics::kernel64::rolling::{Roll, Rolling, RollingLaw, Torques, Visitor as OfRolling};
use glebe_physics::kernel64::tangential::TangentialLaw;
use glebe_physics::kernel64::vector::v3;
use glebe_physics::{
    ContactModel, LawChoice, Laws, Layout, Material, Mixing, PairCoefficients, PairOverride, PairProperties,
    ShearModulusRule, Slot,
};

const E: f64 = 1e7;
const NU: f64 = 0.25;
const RADIUS: f64 = 1e-3;
/// Of equal spheres.
const R_EFF: f64 = 0.5 * RADIUS;

fn e_star() -> f64 {
    0.5 * E / (1.0 - NU * NU)
}

fn grain() -> Material {
    Material {
        name: "grain".to_owned(),
        density: 2500.0,
        youngs_modulus: E,
        poissons_ratio: NU,
        restitution: 1.0,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.1,
    }
}

fn prepared(model: &ContactModel, over: &PairOverride) -> (Laws, PairCoefficients) {
    let laws = Laws::resolve(model).unwrap();
    let m = grain();
    let pair = PairProperties::new(&m, &m, &Mixing::default(), ShearModulusRule::Mindlin, over);
    (laws, laws.prepare(model, &pair, RADIUS).unwrap())
}

fn coefficients([a, b, c, d]: [f64; 4]) -> Coefficients {
    Coefficients { a, b, c, d }
}

fn touch(delta: f64) -> Touch {
    Touch { delta, vn: 0.0, r_eff: R_EFF, m_eff: 1e-6, diameter: 4.0 * R_EFF }
}

struct Press<'a>(&'a Coefficients, f64, Memory);

impl OfNormal for Press<'_> {
    type Output = NormalForce;
    fn visit<L: Normal>(self) -> NormalForce {
        L::force(self.0, touch(self.1), self.2)
    }
}

struct Pull<'a>(&'a Coefficients, f64, Memory);

impl OfCohesion for Pull<'_> {
    type Output = Attraction;
    fn visit<L: Cohesion>(self) -> Attraction {
        L::attraction(self.0, touch(self.1), self.2)
    }
}

struct Turn<'a>(&'a Coefficients, Roll, Memory);

impl OfRolling for Turn<'_> {
    type Output = Torques;
    fn visit<L: Rolling>(self) -> Torques {
        L::torques(self.0, self.1, self.2)
    }
}

/// Two spheres led along a path of overlaps: force in all, energy in all, and losses so far.
struct Led {
    laws: Laws,
    pair: PairCoefficients,
    normal: Memory,
    cohesion: Memory,
    lost: f64,
    work: f64,
    last: Option<(f64, f64)>,
}

impl Led {
    fn new(model: &ContactModel, over: &PairOverride) -> Self {
        let (laws, pair) = prepared(model, over);
        let (normal, cohesion) = (nothing(), nothing());
        Self { laws, pair, normal, cohesion, lost: 0.0, work: 0.0, last: None }
    }

    /// Force and energy at an overlap.
    fn to(&mut self, delta: f64) -> (f64, f64) {
        let (mut force, mut energy) = (0.0, 0.0);
        let law = CohesionLaw::ALL[self.laws.cohesion as usize];
        if delta >= -self.pair.range {
            let a = law.visit(Pull(&coefficients(self.pair.cohesion), delta, self.cohesion));
            self.cohesion = a.memory;
            self.lost += a.lost;
            (force, energy) = (force - a.force, energy + a.energy);
        }
        let law = NormalLaw::ALL[self.laws.normal as usize];
        let n = law.visit(Press(&coefficients(self.pair.normal), pressed(touch(delta)).delta, self.normal));
        if delta >= 0.0 {
            self.normal = n.memory;
            self.lost += n.lost;
            (force, energy) = (force + n.elastic - n.pull, energy + n.energy);
        } else {
            self.normal = nothing();
        }
        if let Some((before, f)) = self.last {
            self.work += 0.5 * (f + force) * (delta - before);
        }
        self.last = Some((delta, force));
        (force, energy)
    }

    /// Leads to `end` in `n` steps; returns the least and the largest force on the way.
    fn lead(&mut self, end: f64, n: usize) -> (f64, f64) {
        let from = self.last.map_or(0.0, |l| l.0);
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        for k in 1..=n {
            let (f, _) = self.to(from + (end - from) * k as f64 / n as f64);
            range = (range.0.min(f), range.1.max(f));
        }
        range
    }
}

fn with_cohesion(law: LawChoice) -> ContactModel {
    ContactModel { cohesion: law, ..ContactModel::default() }
}

fn with_normal(law: LawChoice) -> ContactModel {
    ContactModel { normal: law, ..ContactModel::default() }
}

fn near(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * b.abs(), "{a:e} instead of {b:e}");
}

#[test]
fn cube_roots() {
    for k in -40..10 {
        let x = 1.7 * 10_f64.powi(k) / 3.0;
        if x > 1e-36 {
            near(cube_root(x), x.cbrt(), 1e-12);
        }
    }
    assert_eq!(cube_root(0.0), 0.0);
    near(f64::from(glebe_physics::kernel::powers::cube_root(1e-12)), 1e-4, 2e-7);
}

#[test]
fn floats_of_the_slots_follow_each_other() {
    let model = ContactModel {
        rolling: LawChoice::named("moment-rotation"),
        normal: LawChoice::named("luding").with("stiffness", 1e4).with("unloading_stiffness", 2e4),
        ..with_cohesion(LawChoice::named("jkr").with("work_of_adhesion", 0.05))
    };
    let laws = Laws::resolve(&model).unwrap();
    let layout = Layout::of(&[laws]);
    let places = [Slot::Tangential, Slot::Rolling, Slot::Normal, Slot::Cohesion].map(|s| layout.place(s));
    assert_eq!(places, [0..4, 4..8, 8..9, 9..10]);
    assert_eq!(layout.floats(), 10);
    assert_eq!(Layout::signs(&[laws]).len(), 10);
    let other = Laws::resolve(&ContactModel { tangential: LawChoice::named("none"), ..model }).unwrap();
    assert_eq!(Layout::of(&[other]).place(Slot::Rolling), 0..4);
    assert_eq!(Layout::of(&[other]).place(Slot::Tangential), 0..0);
    // Of pairs with different laws each slot has room for the longest.
    let plain = Laws::resolve(&ContactModel::default()).unwrap();
    assert_eq!(Layout::of(&[plain, other]), layout);
    assert_eq!(Layout::signs(&[plain, other]), Layout::signs(&[laws]));
}

/// DMT's pull-off force is 2π w R*, in touch and not beyond.
#[test]
fn dmt_pulls_off() {
    let w = 0.05;
    let mut led = Led::new(
        &with_cohesion(LawChoice::named("dmt").with("work_of_adhesion", w)),
        &PairOverride::default(),
    );
    let (least, _) = led.lead(1e-6, 100);
    assert!(least < 0.0);
    near(led.to(0.0).0, -2.0 * PI * w * R_EFF, 1e-12);
    assert_eq!(led.pair.range, 0.0);
}

/// Hertz and SJKR together pull most where the slopes cancel: with `2 π³ κ³ R*²/(3 E*²)`.
#[test]
fn sjkr_pulls_off() {
    let kappa = 2e5;
    let model = with_cohesion(LawChoice::named("sjkr").with("energy_density", kappa));
    let mut led = Led::new(&model, &PairOverride::default());
    let balance = (PI * kappa * R_EFF.sqrt() / e_star()).powi(2);
    let (least, _) = led.lead(3.0 * balance, 30_000);
    near(least, -2.0 / 3.0 * PI.powi(3) * kappa.powi(3) * R_EFF.powi(2) / e_star().powi(2), 1e-6);
}

/// JKR: at first touch 8/9 of the pull-off force, which is 3/2 π w R*; bodies part at the closed form's distance, where 5/9
/// of it are left. Work is energy and what is lost in parting.
#[test]
fn jkr_pulls_off_and_parts() {
    let w = 0.05;
    let mut led = Led::new(
        &with_cohesion(LawChoice::named("jkr").with("work_of_adhesion", w)),
        &PairOverride::default(),
    );
    let off = 1.5 * PI * w * R_EFF;
    let parts = 0.75 * (PI * PI * w * w * R_EFF / (e_star() * e_star())).cbrt();
    // Before they touch, nothing pulls.
    assert_eq!(led.to(-0.5 * parts), (0.0, 0.0));
    near(led.to(0.0).0, -8.0 / 9.0 * off, 1e-9);
    led.work = 0.0;
    led.lead(20.0 * parts, 20_000);
    let (least, _) = led.lead(-0.999_999 * parts, 200_000);
    near(least, -off, 1e-7);
    near(led.to(-0.999_999 * parts).0, -5.0 / 9.0 * off, 2e-3);
    let (_, stored) = led.to(-0.999_999 * parts);
    near(led.work, stored, 1e-4);
    assert_eq!(led.lost, 0.0);
    assert_eq!(led.to(-1.000_01 * parts), (0.0, 0.0));
    near(led.lost, stored, 1e-4);
    assert!(led.pair.range > 1.2 * parts);
    // Pressed hard, JKR tends to Hertz.
    let hertz = 4.0 / 3.0 * e_star() * R_EFF.sqrt() * (1e-4_f64).powf(1.5);
    near(led.to(1e-4).0, hertz, 1e-2);
    assert!(led.to(1e-4).0 < hertz);
}

/// The radius of contact solves JKR's own equations: `δ = a²/R* - √(2π w a/E*)`, `F = 4 E* a³/(3 R*) - √(8π w E* a³)`.
#[test]
fn jkr_solves_its_equations() {
    let w = 0.05;
    let mut led = Led::new(
        &with_cohesion(LawChoice::named("jkr").with("work_of_adhesion", w)),
        &PairOverride::default(),
    );
    led.to(0.0);
    for k in 1..200 {
        let a = 1e-6 * 1.04_f64.powi(k);
        let delta = a * a / R_EFF - (2.0 * PI * w * a / e_star()).sqrt();
        let force = 4.0 * e_star() * a.powi(3) / (3.0 * R_EFF) - (8.0 * PI * w * e_star() * a.powi(3)).sqrt();
        // Beyond the radius at which bodies part.
        let slope = 2.0 * a / R_EFF - 0.5 * (2.0 * PI * w / (e_star() * a)).sqrt();
        if slope > 1e-2 * 2.0 * a / R_EFF {
            led.to(0.0);
            let scale = 4.0 * e_star() * a.powi(3) / (3.0 * R_EFF);
            let found = led.to(delta).0;
            assert!((found - force).abs() < 1e-6 * (scale + force.abs()), "{found:e} instead of {force:e}");
        }
    }
}

/// Willett's bridge: 2π R γ cos θ in touch, with R = 2 R*; half of it where `1.05 ŝ + 2.5 ŝ² = 1`; none beyond the rupture
/// distance, and none before bodies have touched. Rupture loses what parting took.
#[test]
fn bridges_form_and_rupture() {
    let (gamma, theta, content) = (0.072, 0.3, 0.01);
    let law = LawChoice::named("capillary").with("surface_tension", gamma).with("liquid_content", content);
    let mut led = Led::new(&with_cohesion(law.with("contact_angle", theta)), &PairOverride::default());
    let most = 2.0 * PI * RADIUS * gamma * f64::cos(theta);
    let volume = content * 4.0 / 3.0 * PI * RADIUS.powi(3);
    let ruptures = (1.0 + 0.5 * theta) * (volume.cbrt() + 0.1 * volume.powf(2.0 / 3.0) / RADIUS);
    assert_eq!(led.to(-0.1 * ruptures), (0.0, 0.0));
    near(led.to(0.0).0, -most, 1e-9);
    led.work = 0.0;
    let half = (-1.05 + (1.05_f64.powi(2) + 10.0).sqrt()) / 5.0;
    near(led.to(-half * (volume / RADIUS).sqrt()).0, -0.5 * most, 1e-9);
    led.to(0.0);
    led.work = 0.0;
    led.lead(-0.999_999_9 * ruptures, 100_000);
    let (force, stored) = led.to(-0.999_999_9 * ruptures);
    assert!(force < 0.0);
    near(led.work, stored, 1e-6);
    assert_eq!(led.to(-1.000_001 * ruptures), (0.0, 0.0));
    near(led.lost, stored, 1e-6);
    assert_eq!(led.to(-0.5 * ruptures), (0.0, 0.0), "a ruptured bridge stays ruptured");
}

/// Loading, unloading, reloading, and tension: each branch has its slope, and work is what is stored and lost.
fn plastic_path(model: &ContactModel, power: f64, [k1, k2, ka]: [f64; 3]) {
    let mut led = Led::new(model, &PairOverride::default());
    let z = |delta: f64| delta.powf(power);
    let top: f64 = 2e-5;
    let n = 20_000;
    led.to(0.0);
    for k in 1..=4 {
        let delta = 0.25 * top * f64::from(k);
        led.lead(delta, n);
        near(led.last.unwrap().1, k1 * z(delta), 1e-9);
    }
    let loaded = led.work;
    let plastic = (1.0 - k1 / k2) * z(top);
    let free = plastic.powf(1.0 / power);
    // Unloading along k2 to where the force vanishes.
    let part = 0.5 * (top + free);
    led.lead(part, n);
    near(led.last.unwrap().1, k2 * (z(part) - plastic), 1e-7);
    led.lead(free, n);
    assert!(led.last.unwrap().1.abs() < 1e-6 * k1 * z(top));
    let given_back = loaded - led.work;
    assert!(led.to(free).1.abs() < 1e-8 * loaded);
    near(led.lost, loaded - given_back, 1e-3);
    // Reloading comes back to where unloading began, and goes on along k1.
    led.lead(top, n);
    near(led.last.unwrap().1, k1 * z(top), 1e-6);
    led.lead(1.1 * top, n);
    near(led.last.unwrap().1, k1 * z(1.1 * top), 1e-9);
    // Tension grows along k2 until -ka, then ebbs with the overlap.
    let plastic = (1.0 - k1 / k2) * z(1.1 * top);
    let turns = k2 * plastic / (k2 + ka);
    let (least, _) = led.lead(0.5 * turns.powf(1.0 / power), 4 * n);
    near(least, -ka * turns, 1e-4);
    near(led.last.unwrap().1, -ka * 0.5_f64.powf(power) * turns, 1e-6);
    // From there it reloads along k2.
    let (delta, force) = led.last.unwrap();
    led.to(1.05 * delta);
    near(led.last.unwrap().1, force + k2 * (z(1.05 * delta) - z(delta)), 1e-6);
    led.lead(0.0, n);
    assert!(led.to(0.0).1.abs() < 1e-10 * loaded, "{:?} is stored in bodies that part", led.to(0.0));
    near(led.lost, led.work, 1e-3);
}

#[test]
fn luding_loads_unloads_and_reloads() {
    let law = LawChoice::named("luding").with("stiffness", 1e4).with("unloading_stiffness", 3e4);
    plastic_path(&with_normal(law.with("adhesion_stiffness", 5e3)), 1.0, [1e4, 3e4, 5e3]);
}

#[test]
fn eepa_loads_unloads_and_reloads() {
    let k1 = 4.0 / 3.0 * e_star() * R_EFF.sqrt();
    let law = LawChoice::named("eepa").with("plasticity", 0.6).with("adhesion", 0.3);
    plastic_path(&with_normal(law), 1.5, [k1, k1 / (1.0 - 0.36), 0.3 * k1]);
}

#[test]
fn unloading_is_not_softer_than_loading() {
    let law = LawChoice::named("luding").with("stiffness", 1e4).with("unloading_stiffness", 9e3);
    let model = with_normal(law);
    let (laws, m) = (Laws::resolve(&model).unwrap(), grain());
    let pair =
        PairProperties::new(&m, &m, &Mixing::default(), ShearModulusRule::Mindlin, &PairOverride::default());
    let error = laws.prepare(&model, &pair, RADIUS).unwrap_err().to_string();
    assert!(error.contains("at least the stiffness of loading, 10000 N/m"), "{error}");
}

/// A pair without cohesion feels none, whatever the law.
#[test]
fn a_pair_may_have_no_cohesion() {
    for law in glebe_physics::laws(Slot::Cohesion).iter().filter(|law| law.name != "none") {
        let required = law.parameters.iter().filter(|p| p.required);
        let choice = required.fold(LawChoice::named(law.name), |c, p| c.with(p.name, p.typical));
        let dry = PairOverride { cohesion: Some(0.0), ..PairOverride::default() };
        let half = PairOverride { cohesion: Some(0.5), ..PairOverride::default() };
        let model = with_cohesion(choice);
        let [mut dry, mut half, mut whole] =
            [dry, half, PairOverride::default()].map(|over| Led::new(&model, &over));
        assert_eq!(dry.pair.range, 0.0, "{}", law.name);
        for delta in [0.0_f64, 1e-7, 1e-6, 1e-5] {
            let hertz = 4.0 / 3.0 * e_star() * R_EFF.sqrt() * delta.powf(1.5);
            let (force, energy) = dry.to(delta);
            assert!((force - hertz).abs() <= 1e-12 * hertz, "{}: {force:e} N", law.name);
            assert!((energy - 0.4 * hertz * delta).abs() <= 1e-12 * energy, "{}", law.name);
        }
        let hertz = 4.0 / 3.0 * e_star() * R_EFF.sqrt() * 1e-9_f64.powf(1.5);
        let pulls = |led: &mut Led| hertz - led.to(1e-9).0;
        let (half, whole) = (pulls(&mut half), pulls(&mut whole));
        assert!(whole > 0.0 && (half / whole - 0.5).abs() < 0.05, "{}: {half:e}, {whole:e}", law.name);
    }
}

fn roll(wi: [f64; 3]) -> Roll {
    let inertia = 1e-12;
    Roll {
        n: v3(0.0, 0.0, 1.0),
        wi: v3(wi[0], wi[1], wi[2]),
        arm_i: RADIUS,
        arm_j: RADIUS,
        r_i: RADIUS,
        r_j: 2.0 * RADIUS,
        inv_inertia_i: 1.0 / inertia,
        inv_inertia_j: 1.0 / inertia,
        r_eff: 2.0 / 3.0 * RADIUS,
        load: 0.02,
        stiffness: 1e3,
        shear_stiffness: 8e2,
        dt: 1e-6,
        ..Roll::default()
    }
}

/// Turns by an angle in steps; returns torque and memory.
fn turned(law: &str, w: [f64; 3], steps: usize, m: Memory) -> (Torques, Memory) {
    let model = ContactModel { rolling: LawChoice::named(law), ..ContactModel::default() };
    let (laws, pair) = prepared(&model, &PairOverride::default());
    let (mut m, mut t) = (m, Torques::default());
    for _ in 0..steps {
        t = RollingLaw::ALL[laws.rolling as usize].visit(Turn(&coefficients(pair.rolling), roll(w), m));
        m = t.memory;
    }
    (t, m)
}

/// EPSD: `2.25 kₙ (μr R*)² θ` against rolling, up to `μr R* Fₙ`; held at rest; twist is free.
#[test]
fn epsd_is_a_spring_with_a_limit() {
    let (mu, r_eff, load) = (0.1, 2.0 / 3.0 * RADIUS, 0.02);
    let stiffness = 2.25 * 1e3 * (mu * r_eff).powi(2);
    let (_, m) = turned("epsd", [0.0, 1.0, 5.0], 100, nothing());
    let (held, _) = turned("epsd", [0.0; 3], 1, m);
    // The pair's mean spin turns the spring about n by 2.5e-4.
    near(held.on_i.y, -stiffness * 1e-4, 1e-7);
    assert_eq!((held.on_i.z, held.brake_i.y), (0.0, 0.0));
    near(held.on_j.y, stiffness * 1e-4, 1e-7);
    near(held.energy, 0.5 * stiffness * 1e-8, 1e-7);
    let (slips, m) = turned("epsd", [0.0, 100.0, 0.0], 3000, m);
    near(slips.on_i.y, -mu * r_eff * load, 1e-9);
    near(slips.lost, mu * r_eff * load * 1e-4, 1e-6);
    let (held, _) = turned("epsd", [0.0; 3], 1, m);
    near(held.on_i.y, -mu * r_eff * load, 1e-9);
}

/// The moment rotation law: `η min(r)² Kₜ θ` against rolling and twist, each up to `α min(r) Fₙ`.
#[test]
fn moments_have_limits() {
    let (eta, alpha, load) = (2.0, 0.2, 0.02);
    let stiffness = eta * RADIUS * RADIUS * 8e2;
    let (t, m) = turned("moment-rotation", [0.3, 0.4, -0.2], 100, nothing());
    for (found, w) in [(t.on_i.x, 0.3), (t.on_i.y, 0.4), (t.on_i.z, -0.2)] {
        // The pair's mean spin turns the springs about n by 1e-5.
        near(found, -stiffness * w * 1e-4, 2e-5);
    }
    near(t.energy, 0.5 * stiffness * (0.25 + 0.04) * 1e-8, 1e-9);
    let (t, m) = turned("moment-rotation", [30.0, 0.0, -20.0], 2000, m);
    near(t.on_i.x, -alpha * RADIUS * load, 1e-4);
    near(t.on_i.z, alpha * RADIUS * load, 1e-9);
    near(t.on_j.z, -alpha * RADIUS * load, 1e-9);
    near(t.lost, alpha * RADIUS * load * 50e-6, 1e-3);
    let (t, _) = turned("moment-rotation", [0.0; 3], 1, m);
    near(t.on_i.z, alpha * RADIUS * load, 1e-9);
    assert_eq!(t.lost, 0.0);
}

/// Contacts of a world share places for what laws of a slot remember, whichever the laws of their materials are.
#[test]
fn what_laws_of_a_slot_remember_has_the_same_signs() {
    let histories: [Vec<&[f64]>; 5] = [
        NormalLaw::ALL.iter().map(|l| l.history()).collect(),
        TangentialLaw::ALL.iter().map(|l| l.history()).collect(),
        RollingLaw::ALL.iter().map(|l| l.history()).collect(),
        CohesionLaw::ALL.iter().map(|l| l.history()).collect(),
        BondLaw::ALL.iter().map(|l| l.history()).collect(),
    ];
    for slot in histories {
        let longest = slot.iter().max_by_key(|h| h.len()).unwrap();
        for history in &slot {
            assert!(longest.starts_with(history), "{history:?} beside {longest:?}");
        }
    }
}

struct Holding<'a>(&'a PairCoefficients, Parting, Held);

impl OfBond for Holding<'_> {
    type Output = Hold;
    fn visit<L: Bond>(self) -> Hold {
        L::hold(&coefficients(self.0.bond), coefficients(self.0.strength), self.1, self.2)
    }
}

/// A bond that is led along one way at a time: force and moment of a beam of its section, the energy of its springs,
/// and it breaks where the largest stress of the beam reaches the strength, with all that it held.
#[test]
fn a_parallel_bond_is_a_beam_until_it_breaks() {
    let (kn, ks, tensile, shear, share, beta) = (1e10, 4e9, 2e5, 1e5, 0.7, 0.6);
    let bond = LawChoice::named("parallel")
        .with("normal_stiffness", kn)
        .with("shear_stiffness", ks)
        .with("tensile_strength", tensile)
        .with("shear_strength", shear)
        .with("radius", share)
        .with("moment_contribution", beta);
    let model = ContactModel { bond, ..ContactModel::default() };
    let (laws, pair) = prepared(&model, &PairOverride::default());
    let law = BondLaw::ALL[laws.bond as usize];
    let r = share * RADIUS;
    let (area, inertia) = (PI * r * r, 0.25 * PI * r.powi(4));
    let rest = 2.02 * RADIUS;
    // Leads the bond to what it bears times `part` in 1000 steps.
    let led = |u: f64, rate: [f64; 3], part: f64| {
        let mut held = Held { rest, ..Held::default() };
        let mut last = Hold::default();
        for k in 1..=1000 {
            let now = part * f64::from(k) / 1000.0;
            let [slide, bend, twist] = rate.map(|x| 0.5 * part * x / 1000.0);
            let parting = Parting {
                n: v3(1.0, 0.0, 0.0),
                delta: 2.0 * RADIUS - rest - now * u,
                r_i: RADIUS,
                r_j: RADIUS,
                vt: v3(0.0, 2.0 * slide, 0.0),
                wi: v3(twist, 0.0, bend),
                wj: v3(-twist, 0.0, -bend),
                dt: 1.0,
            };
            last = law.visit(Holding(&pair, parting, held));
            if last.broke > 0.0 {
                return (last, k);
            }
            held = last.held;
        }
        (last, 1000)
    };
    let cases = [
        ("tension", tensile / kn, [0.0; 3], tensile * area, 0.0),
        ("shear", 0.0, [shear / ks, 0.0, 0.0], shear * area, 0.0),
        ("bending", 0.0, [0.0, tensile / (kn * beta * r), 0.0], 0.0, tensile * inertia / (beta * r)),
        ("twist", 0.0, [0.0, 0.0, shear / (ks * beta * r)], 0.0, 2.0 * shear * inertia / (beta * r)),
    ];
    for (name, u, rate, force, moment) in cases {
        let (b, _) = led(u, rate, 0.999);
        let size = |v: glebe_physics::kernel64::vector::V3| (v.x * v.x + v.y * v.y + v.z * v.z).sqrt();
        assert_eq!(b.broke, 0.0, "{name}");
        assert!((size(b.force) - 0.999 * force).abs() < 1e-12 * tensile * area, "{name}: {:?}", b.force);
        assert!(
            (size(b.moment) - 0.999 * moment).abs() < 1e-12 * tensile * area * r,
            "{name}: {:?}",
            b.moment
        );
        let way = size(v3(u, rate[0], 0.0)) * force + size(v3(0.0, rate[1], rate[2])) * moment;
        near(b.energy, 0.5 * way * 0.999 * 0.999, 1e-6);
        let (b, k) = led(u, rate, 1.001);
        assert_eq!((b.broke, b.energy, b.held), (1.0, 0.0, Held::default()), "{name} at {k}");
        assert!(k >= 998 && b.lost > 0.4999 * way && b.lost < 0.502 * way, "{name}: {:e} J", b.lost);
        assert_eq!((size(b.force), size(b.moment)), (0.0, 0.0), "{name}");
    }
    // It pulls i towards j, and pushes when pressed, which breaks it not.
    let (b, _) = led(tensile / kn, [0.0; 3], 0.5);
    assert!(b.force.x > 0.0);
    let (b, _) = led(-10.0 * tensile / kn, [0.0; 3], 1.0);
    assert!(b.force.x < 0.0 && b.broke == 0.0);
}

/// Hertz's dashpot is that of Tsuji et al. (1992) with α = √5 β.
#[test]
fn hertz_has_the_dashpot_of_tsuji() {
    let e: f64 = 0.4;
    let over = PairOverride { restitution: Some(e), ..PairOverride::default() };
    let (laws, pair) = prepared(&ContactModel::default(), &over);
    let ln = e.ln();
    let beta = -ln / ln.hypot(PI);
    for delta in [1e-6, 1e-5, 1e-4] {
        let pressed = Touch { vn: 0.3, ..touch(delta) };
        let k = 4.0 / 3.0 * e_star() * R_EFF.sqrt();
        let tsuji = 5.0_f64.sqrt() * beta * (pressed.m_eff * k).sqrt() * delta.powf(0.25) * pressed.vn;
        near(
            NormalLaw::ALL[laws.normal as usize].visit(Damp(&coefficients(pair.normal), pressed)),
            tsuji,
            1e-12,
        );
    }
}

struct Damp<'a>(&'a Coefficients, Touch);

impl OfNormal for Damp<'_> {
    type Output = f64;
    fn visit<L: Normal>(self) -> f64 {
        L::force(self.0, self.1, nothing()).viscous
    }
}
