//! Small numbers beside large ones: creep, the overlap of a sphere at rest, a packing that hardly touches.

use glebe_engine::backend::Backend;
use glebe_engine::generate::solid_volume;
use glebe_engine::lattice::{add, dot, scale, sub};
use glebe_engine::spec::{Domain, Pose, Side, Vec3, WorldSpec};
use glebe_engine::surface::quaternion;
use glebe_physics::{ContactModel, LawChoice};

use crate::support::{
    Random, Run, affordable, assert_near, e_star, grain, mesh, open_world, plane, rectangle,
    states_are_exact, turned,
};

/// Relative error of a creep path, of a resting overlap, and of a mean stress.
const CREEP: f64 = 0.01;
const REST: f64 = 0.01;
const STRESS: f64 = 0.01;

/// A particle creeps by 1e-13 m a step 100 m from the origin, its rest below one unit at its largest; and a mesh
/// creeps into a heavy one.
pub fn creep_is_not_lost(backend: Backend) {
    const SPEED: f64 = 1e-7;
    const DT: f64 = 1e-6;
    const RADIUS: f64 = 2e-3;
    let steps = affordable(backend, 1_000_000, 20_000);
    let far = [100.0, -100.0, 100.0];
    let mut m = grain(1.0, 0.0);
    m.density = 1e16;
    let mut w = open_world([0.0; 3], 150.0, DT, m);
    w.contact.tangential = LawChoice::named("none");
    w.sampling.energy_ledger = false;
    let v = [SPEED, -SPEED, 0.5 * SPEED];
    w.particles.push_moving(far, RADIUS, 0, v, [0.0; 3]);
    let heavy = add(far, [0.1, 0.0, 0.0]);
    w.particles.push(heavy, RADIUS, 0);
    let (vertices, triangles) = rectangle([-0.01; 2], [0.01; 2]);
    let floor = Pose { translation: sub(heavy, [0.0, 0.0, RADIUS]), ..Pose::default() };
    w.surfaces = vec![mesh(vertices, triangles, floor)];
    w.surfaces[0].motion.velocity = [0.0, 0.0, SPEED];
    let e = e_star(&w.materials[0]);
    let mut run = Run::new(backend, w);
    run.edit(|_, state| {
        if states_are_exact(backend) {
            state.particles.rest[0] = [0.5, -0.5, 0.5];
        }
    });
    let start = run.bodies();
    run.steps(steps);
    let end = run.bodies();
    let time = steps as f64 * DT;
    assert_near("the particle's path", sub(end[0].x, start[0].x), scale(v, time), CREEP * SPEED * time);
    // The force was that of the step before the last.
    let overlap = (0.75 * end[1].force[2] / (e * RADIUS.sqrt())).powf(2.0 / 3.0);
    let expected = SPEED * (time - DT) + start[1].radius - RADIUS;
    assert!((overlap / expected - 1.0).abs() < CREEP, "the mesh crept {overlap:e} instead of {expected:e} m");
}

/// CHRONO's example: R = 1 mm, 2500 kg/m³, g = 9.8 m/s², F = 1e8 N/m^1.5 δ^1.5: δ = 1.0174e-8 m.
pub fn resting_overlap(backend: Backend) {
    const EXPECTED: f64 = 1.0174e-8;
    const RADIUS: f64 = 1e-3;
    const G: f64 = 9.8;
    let tilted =
        |axis: Vec3, angle: f64| -> (&str, Vec3) { ("a tilted plane", turned([0.0, 0.0, 1.0], axis, angle)) };
    let grounds = [
        ("a plane", [0.0, 0.0, 1.0]),
        tilted([0.0, 1.0, 0.0], std::f64::consts::FRAC_PI_6),
        ("a triangulated floor", [0.0, 0.0, 1.0]),
        ("a sphere", [0.0, 0.0, 1.0]),
    ];
    for half in [0.5, 50.0] {
        for (what, normal) in grounds {
            let mut w = open_world([0.0; 3], half, 2e-6, grain(1.0, 0.0));
            w.contact = ContactModel {
                normal: LawChoice::named("hertz-stiffness")
                    .with("stiffness", 4.472_136e6)
                    .with("damping", 2e7),
                tangential: LawChoice::named("none"),
                ..ContactModel::default()
            };
            w.gravity = scale(normal, -G);
            let base = [0.8 * half, -0.7 * half, 0.9 * half];
            let height = match what {
                "a triangulated floor" => {
                    let (vertices, triangles) = rectangle([-0.004, -0.005], [0.005, 0.004]);
                    let rotation = quaternion([0.0, 0.0, 1.0], 0.4);
                    w.surfaces = vec![mesh(vertices, triangles, Pose { translation: base, rotation })];
                    RADIUS
                }
                "a sphere" => {
                    // Heavy enough not to feel the other, and where its own weight holds it.
                    let mut rock = w.materials[0].clone();
                    rock.density = 2.5e6;
                    w.materials.push(rock);
                    w.surfaces = vec![plane(normal, base)];
                    let weight = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3) * 2.5e6 * G;
                    let sunk = (weight / 1e8).powf(2.0 / 3.0);
                    w.particles.push(add(base, scale(normal, RADIUS - sunk)), RADIUS, 1);
                    3.0 * RADIUS - sunk
                }
                _ => {
                    w.surfaces = vec![plane(normal, base)];
                    RADIUS
                }
            };
            w.particles.push(add(base, scale(normal, height)), RADIUS, 0);
            let mut run = Run::new(backend, w);
            run.steps(4000);
            let b = run.bodies();
            let overlap = match b.as_slice() {
                [below, top] => below.radius + top.radius - dot(sub(top.x, below.x), normal),
                [top] => top.radius - dot(sub(top.x, base), normal),
                _ => unreachable!(),
            };
            let error = (overlap / EXPECTED - 1.0).abs();
            assert!(error < REST, "on {what} in a {} m box: δ = {overlap:e} m", 2.0 * half);
        }
    }
}

/// A periodic crystal of 256 spheres of 0.1 mm and E = 8 GPa, pressed to about 50 Pa: overlaps of 1e-8 R.
fn packing_at_50_pa() -> WorldSpec {
    let radius = f64::from(1e-4_f32);
    let overlap = 1e-8 * radius;
    let edge = 2.0_f64.sqrt() * (2.0 * radius - overlap);
    let mut w = open_world([0.0; 3], 1.0, 1e-9, grain(1.0, 0.0));
    w.domain = Domain::aligned([0.0; 3], [4.0 * edge; 3], [[Side::Periodic; 2]; 3], None);
    w.materials[0].youngs_modulus = 8e9;
    // RVE eq. 1-4: K_N = E R for equal spheres.
    let stiffness = 8e9 * radius;
    w.contact = ContactModel {
        normal: LawChoice::named("linear").with("stiffness", stiffness),
        tangential: LawChoice::named("none"),
        ..ContactModel::default()
    };
    let mut r = Random(2);
    for cell in 0..64 {
        let corner = [cell % 4, cell / 4 % 4, cell / 16].map(|k| f64::from(k) + 0.13);
        for at in [[0.0; 3], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 0.5, 0.0]] {
            let x = add(scale(add(corner, at), edge), r.vector(0.15 * overlap));
            w.particles.push(x, radius, 0);
        }
    }
    w
}

/// Mean contact stress `tr(Σ d ⊗ f)/3V` \[Pa\].
fn mean_stress(run: &mut Run) -> f64 {
    let b = run.bodies();
    let cell = run.c.spec.domain.cell[0][0];
    let sum: f64 = run
        .detail()
        .network
        .iter()
        .map(|(ids, f)| {
            let [i, j] = ids.map(|i| i as usize);
            let d = sub(b[i].x, b[j].x).map(|d| d - (d / cell).round() * cell);
            dot(d, f.map(f64::from))
        })
        .sum();
    sum / (3.0 * cell.powi(3))
}

pub fn stress_of_a_packing_at_50_pa(backend: Backend) {
    let w = packing_at_50_pa();
    assert!((solid_volume(&w.particles.radius) / (4.0 * 2.0_f64.sqrt() * 2e-4).powi(3) - 0.74).abs() < 0.01);
    let mut run = Run::new(backend, w);
    let mut reference = Run::resume(Backend::Reference, run.c.clone(), run.state());
    assert!(run.moment().contacts > 1500, "{} contacts", run.moment().contacts);
    let (found, expected) = (mean_stress(&mut run), mean_stress(&mut reference));
    assert!((20.0..100.0).contains(&expected), "the packing is at {expected} Pa");
    assert!((found / expected - 1.0).abs() < STRESS, "{found} Pa, the reference finds {expected} Pa");
}
