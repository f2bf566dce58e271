//! From equal states, a backend finds the forces of the reference.

use std::sync::OnceLock;

use glebe_engine::generate::{FillRequest, Region, generate};
use glebe_engine::lattice::{add, norm, sub};
use glebe_engine::spec::{Domain, Pose, Side, Vec3, WorldSpec};
use glebe_physics::{
    ContactEnd, ContactModel, History, IntegratorKind, LawChoice, Material, PairLaws, PairOverride,
};

use crate::support::{
    Body, CPU, REFERENCE, Random, Run, Subject, combinations, grain, label, mesh, open_world,
};

const SIZE: f64 = 0.030;

/// Sizes of spheres in a packing.
#[derive(Clone, Copy, PartialEq)]
enum Grading {
    /// R = 1 to 3 mm: one size class.
    Narrow,
    /// R = 0.8 to 3 mm: several. Smaller ones would have their centres between the ridges, where directions are no better
    /// known than places.
    Wide,
}

/// 400 spheres, packed in a box that is periodic along x, pressed together by 2 %.
fn packed(grading: Grading) -> &'static (Vec<f64>, Vec<Vec3>) {
    static PACKED: [OnceLock<(Vec<f64>, Vec<Vec3>)>; 2] = [const { OnceLock::new() }; 2];
    let least = if grading == Grading::Narrow { 1.0 } else { 0.8 };
    PACKED[grading as usize].get_or_init(|| {
        let mut r = Random(5);
        let radii: Vec<f64> = (0..400).map(|_| 1e-3 * (least + (3.0 - least) * r.unit())).collect();
        let region = Region { min: [0.0; 3], max: [SIZE, SIZE, 2.0 * SIZE], periodic: [true, false, false] };
        let x = generate("dense", &FillRequest::new(region, &radii, 3)).unwrap();
        (radii, x)
    })
}

/// What distances are pressed to unless something else is said.
const PRESSED: f64 = 0.98;

/// The packing `copies` times over along x, in walls along y, on a zigzag mesh, of two materials, all moving and spinning.
fn world(contact: ContactModel, copies: usize) -> WorldSpec {
    pressed(contact, copies, PRESSED, Grading::Narrow)
}

/// The same with distances pressed to another part of what they were.
fn pressed(contact: ContactModel, copies: usize, part: f64, grading: Grading) -> WorldSpec {
    let (radii, positions) = packed(grading);
    let other = Material {
        youngs_modulus: 3e7,
        poissons_ratio: 0.2,
        friction: 0.3,
        static_friction: 0.4,
        ..grain(0.8, 0.0)
    };
    let mut w = open_world([0.0; 3], 1.0, 2e-6, grain(0.5, 0.5));
    w.materials.push(other);
    let side = SIZE * part;
    let sides = [[Side::Periodic; 2], [Side::Wall; 2], [Side::Open; 2]];
    let long = copies as f64 * side;
    w.domain = Domain::aligned([0.0, 0.0, -0.01], [long, side, 0.08], sides, Some(1));
    w.contact = contact;
    w.gravity = [0.0, 0.0, -9.81];
    let mut r = Random(9);
    for copy in 0..copies {
        for (i, x) in positions.iter().enumerate() {
            let x = add(x.map(|c| c * part), [copy as f64 * side, 0.0, 0.0]);
            w.particles.push_moving(x, radii[i], i % 2, r.vector(0.2), r.vector(100.0));
        }
    }
    // Ridges along x that end where the period ends.
    let rows = 12;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for k in 0..=rows {
        let y = side * f64::from(k) / f64::from(rows);
        let z = if k % 2 == 0 { 1e-4 } else { 6e-4 };
        vertices.extend([[0.0, y, z], [long, y, z]]);
    }
    for k in 0..rows as u32 {
        triangles.extend([[2 * k, 2 * k + 1, 2 * k + 2], [2 * k + 1, 2 * k + 3, 2 * k + 2]]);
    }
    w.surfaces = vec![mesh(vertices, triangles, Pose::default())];
    w
}

pub fn one_step_forces_equal_the_reference(on: &Subject) {
    for (k, mut contact) in combinations().into_iter().enumerate() {
        contact.end = [ContactEnd::Tension, ContactEnd::NoTension][k % 2];
        contact.history = [History::Truncated, History::Unbounded, History::None][k % 3];
        let name = label(&contact);
        let mut spec = world(contact, 1);
        spec.time.integrator = IntegratorKind::ALL[k % 4];
        spec.local_damping = if k % 5 == 0 { 0.2 } else { 0.0 };
        let mut run = Run::new(on, spec);
        run.steps(10);
        let mut reference = Run::resume(&REFERENCE, run.c.clone(), run.state());
        one_step_agrees(on, &name, 1, &mut run, &mut reference);
    }
}

/// Blocks of a device are shaped by the number of particles: a few to a block, one to a unit, surfaces together with
/// pairs and apart, as in worlds of which there are many. Pressed hard, a block has more contacts than it has room for at
/// a time. Where sizes differ much, units are dealt out to lists.
pub fn crowds_step_as_on_the_cpu(on: &Subject) {
    let contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    let mut beds = Vec::new();
    for grading in [Grading::Narrow, Grading::Wide] {
        beds.extend([(3, PRESSED, false, grading), (43, PRESSED, false, grading), (3, 0.94, true, grading)]);
    }
    beds.extend([(43, 0.94, false, Grading::Narrow), (43, PRESSED, true, Grading::Narrow)]);
    for (copies, part, throughput, grading) in beds {
        let mut bed = pressed(contact.clone(), copies, part, grading);
        bed.throughput = throughput;
        let mut run = Run::new(on, bed);
        run.steps(3);
        let mut other = Run::resume(&CPU, run.c.clone(), run.state());
        one_step_agrees(
            on,
            &format!(
                "{copies} copies pressed to {part}, throughput {throughput}, wide {}",
                grading == Grading::Wide
            ),
            copies,
            &mut run,
            &mut other,
        );
    }
}

/// One more step gives the same forces and torques on either side.
fn one_step_agrees(on: &Subject, name: &str, copies: usize, run: &mut Run, reference: &mut Run) {
    let detail = reference.detail();
    assert!(detail.network.len() > 700 * copies, "{name}: only {} contacts", detail.network.len());
    assert!(reference.moment().surface_contacts > 40 * copies as u64);
    let mut sizes = vec![0.0; 400 * copies];
    // Of contacts that part, spring and dashpot may cancel, so that what is left is smaller than what was summed.
    let force = |f: &[f32; 3]| norm(f.map(f64::from));
    let mean =
        detail.network.iter().map(|link| force(&link.force)).sum::<f64>() / detail.network.len() as f64;
    for link in &detail.network {
        for i in link.id {
            sizes[i as usize] += force(&link.force).max(0.01 * mean);
        }
    }
    let before = reference.bodies();
    run.steps(1);
    reference.steps(1);
    let (dt, damping) = (reference.c.dt, reference.c.spec.local_damping);
    for (i, (a, b)) in run.bodies().iter().zip(reference.bodies()).enumerate() {
        let inertia = 0.4 * b.mass * b.radius * b.radius;
        // What the network does not hold, contacts with surfaces, is at most this.
        let size = 2.0 * sizes[i] + norm(b.force);
        let off = norm(sub(a.force, b.force));
        assert!(
            off <= on.bounds.force * size,
            "{name}: force on {i} off by {:.2e} of {size:.3e} N",
            off / size
        );
        let off = std::array::from_fn(|k| {
            let by_chance = left_to_rounding(b.torque[k], inertia * before[i].w[k] / dt, damping);
            ((a.torque[k] - b.torque[k]).abs() - by_chance).max(0.0)
        });
        let off = norm(off);
        let size = size * b.radius;
        assert!(
            off <= on.bounds.torque * size,
            "{name}: torque on {i} off by {:.2e} of {size:.3e} N m",
            off / size
        );
    }
}

/// How far a damped torque may be off because local damping takes its sign from the spin at mid-step: rolling
/// resistance at several contacts turns a spin into its opposite, and its sign there is chance. `stop` is the torque
/// that stops the spin in one step.
fn left_to_rounding(damped: f64, stop: f64, damping: f64) -> f64 {
    [-1.0, 1.0]
        .map(|sign| damped / (1.0 - sign * damping))
        .into_iter()
        .filter(|free| (stop + 0.5 * free).abs() < 1e-5 * free.abs())
        .fold(0.0, |_, free| 2.0 * damping * free.abs())
}

pub fn short_trajectories_equal_the_reference(on: &Subject) {
    let contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    trajectories_agree(on, &world(contact, 1));
}

/// Contacts that remember more than a tangential spring: rolling and twisting springs, on surfaces too.
pub fn trajectories_with_rolling_springs_equal_the_reference(on: &Subject) {
    let rolling = LawChoice::named("moment-rotation").with("rolling_strength", 0.05);
    trajectories_agree(on, &world(ContactModel { rolling, ..ContactModel::default() }, 1));
}

/// The same with as much as laws remember: plastic overlap and JKR's attachment besides.
pub fn trajectories_with_all_memory_equal_the_reference(on: &Subject) {
    let stiffness = |law: LawChoice| law.with("stiffness", 2e4).with("unloading_stiffness", 3e4);
    let normal = stiffness(LawChoice::named("luding")).with("adhesion_stiffness", 1e4).with("damping", 0.1);
    let cohesion = LawChoice::named("jkr").with("work_of_adhesion", 0.5);
    let rolling = LawChoice::named("moment-rotation");
    let mut w = world(ContactModel { normal, rolling, cohesion, ..ContactModel::default() }, 1);
    // Where static friction exceeds sliding friction the force jumps when a contact begins to slip, and rounding decides
    // the step: a card and the reference, alike to the seventh digit, have been seen to differ by one.
    w.materials.iter_mut().for_each(|m| m.static_friction = m.friction);
    trajectories_agree(on, &w);
}

/// Other laws in every slot where particles of one kind meet.
pub fn trajectories_with_laws_by_pair_equal_the_reference(on: &Subject) {
    let laws = PairLaws {
        normal: Some(LawChoice::named("eepa").with("plasticity", 0.6).with("adhesion", 0.3)),
        tangential: Some(LawChoice::named("linear").with("stiffness", 2e3)),
        rolling: Some(LawChoice::named("constant-torque")),
        cohesion: Some(LawChoice::named("constant").with("force", 1e-3)),
        bond: None,
    };
    let rolling = LawChoice::named("moment-rotation");
    let mut w = world(ContactModel { rolling, ..ContactModel::default() }, 1);
    w.pairs.push((0, 0, PairOverride { laws, ..PairOverride::default() }));
    trajectories_agree(on, &w);
}

fn trajectories_agree(on: &Subject, w: &WorldSpec) {
    let mut run = Run::new(on, w.clone());
    let mut reference = Run::new(&REFERENCE, w.clone());
    run.steps(200);
    reference.steps(200);
    let b = reference.bodies();
    let largest = |f: fn(&Body) -> Vec3| b.iter().map(|b| norm(f(b))).fold(0.0, f64::max);
    let most = &on.bounds.trajectory;
    for (i, (a, b)) in run.bodies().iter().zip(&b).enumerate() {
        let mut d = sub(a.x, b.x);
        d[0] -= (d[0] / (PRESSED * SIZE)).round() * PRESSED * SIZE;
        let x = norm(d) / 2e-3;
        let (v, w) = (norm(sub(a.v, b.v)) / largest(|b| b.v), norm(sub(a.w, b.w)) / largest(|b| b.w));
        assert!(x < most.place, "position of {i} off by {x:.2e} radii");
        assert!(v < most.velocity, "velocity of {i} off by {v:.2e} of the largest");
        assert!(w < most.spin, "spin of {i} off by {w:.2e} of the largest");
    }
    let (a, b) = (run.g.ledger, reference.g.ledger);
    for (row, a, b) in [
        ("friction", a.friction, b.friction),
        ("dashpots", a.dashpots, b.dashpots),
        ("rolling", a.rolling, b.rolling),
        ("stiffness change", a.stiffness_change, b.stiffness_change),
    ] {
        // A law without dashpots loses nothing in them.
        let error = if a == b { 0.0 } else { (a / b - 1.0).abs() };
        assert!(error < on.bounds.ledger, "{row}: {a:e} J, the reference finds {b:e} J");
    }
    let total = |run: &Run| run.bodies().iter().fold([0.0; 3], |sum, b| add(sum, b.force));
    assert!(norm(sub(total(&run), total(&reference))) < 1e-4 * norm(total(&reference)).max(1e-2));
}
