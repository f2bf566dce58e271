//! Stress, strain and fabric of periodic samples.

use glebe_engine::lattice::{determinant, dot, mul, norm};
use glebe_engine::measure::Interior;
use glebe_engine::spec::{Domain, Side, Vec3, WorldSpec};
use glebe_physics::{ContactModel, LawChoice};

use crate::support::{Random, Run, Subject, grain, open_world};

/// Largest relative error of a sum over contacts in f32, exact overlaps given.
const SUM: f64 = 1e-5;

const RADIUS: f64 = 1e-3;
/// Normal stiffness of the linear law \[N/m\].
const STIFFNESS: f64 = 1e5;

/// An empty cube of a side \[m\], periodic along all axes, with linear springs and no friction.
pub fn cube(side: f64, dt: f64) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.1, dt, grain(0.5, 0.0));
    w.domain = Domain::aligned([0.0; 3], [side; 3], [[Side::Periodic; 2]; 3], None);
    w.contact = ContactModel {
        normal: LawChoice::named("linear").with("stiffness", STIFFNESS),
        tangential: LawChoice::named("none"),
        ..ContactModel::default()
    };
    w
}

/// `n`³ spheres on a lattice of this spacing along each axis \[m\].
fn cubic(n: u32, spacing: Vec3, dt: f64) -> WorldSpec {
    let mut w = cube(1.0, dt);
    let side = spacing.map(|d| f64::from(n) * d);
    w.domain = Domain::aligned([0.0; 3], side, [[Side::Periodic; 2]; 3], None);
    for i in 0..n.pow(3) {
        let at = [i % n, i / n % n, i / (n * n)].map(f64::from);
        w.particles.push([0, 1, 2].map(|k| (at[k] + 0.25) * spacing[k]), RADIUS, 0);
    }
    w
}

/// The sample as it is now.
pub fn interior(run: &mut Run) -> Interior {
    let m = run.moment();
    let (cell, strain) = run.c.cell(&run.g);
    Interior::new(&m.tensors.unwrap(), &cell, &strain)
}

pub fn assert_close(what: &str, a: f64, b: f64, scale: f64) {
    assert!((a - b).abs() <= SUM * scale, "{what}: {a:e} instead of {b:e}");
}

/// Along each axis of a simple cubic lattice a chain of springs runs through an area of the two other spacings.
pub fn stress_of_a_cubic_lattice(on: &Subject) {
    let spacing = [1.98, 1.985, 1.999].map(|x| x * RADIUS);
    let mut run = Run::new(on, cubic(5, spacing, 1e-6));
    let i = interior(&mut run);
    let volume: f64 = spacing.iter().product();
    let sigma = spacing.map(|d| STIFFNESS * (2.0 * RADIUS - d) * d / volume);
    let p = sigma.iter().sum::<f64>() / 3.0;
    for a in 0..3 {
        for b in 0..3 {
            let (stress, fabric) = if a == b { (sigma[a], 1.0 / 3.0) } else { (0.0, 0.0) };
            assert_close(&format!("stress {a}{b}"), i.stress[a][b], stress, p);
            assert_close(&format!("fabric {a}{b}"), i.fabric[a][b], fabric, 1.0);
        }
    }
    assert_close("p", i.p(), p, p);
    let q = (1.5 * sigma.iter().map(|s| (s - p) * (s - p)).sum::<f64>()).sqrt();
    assert_close("q", i.q(), q, p);
    let solid = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
    assert_close("void ratio", i.void_ratio, volume / solid - 1.0, 1.0);
    assert_eq!((i.mechanical_coordination, i.rattlers), (6.0, 0));
    let tensors = run.moment().tensors.unwrap();
    let stiffness = 125.0 * STIFFNESS * dot(spacing, spacing);
    assert_close("stiffness", tensors.stiffness, stiffness, stiffness);
}

/// In a sheared cell a pair that touches through seams has the branch to the nearest image.
pub fn stress_of_a_pair_through_seams(on: &Subject) {
    let mut w = cube(0.012, 1e-6);
    w.domain.cell = [[0.0122, 0.003, 0.001], [0.0, 0.0122, -0.004], [0.0, 0.0, 0.0131]];
    let branch = [0.0012, -0.0011, 0.0010];
    let at = mul(&w.domain.cell, [0.97, 0.02, 0.99]);
    w.particles.push(at, RADIUS, 0);
    let beyond = mul(&w.domain.cell, [1.0, -1.0, 1.0]);
    w.particles.push([0, 1, 2].map(|k| at[k] + branch[k] - beyond[k]), RADIUS, 0);
    // Nobody's neighbour.
    w.particles.push(mul(&w.domain.cell, [0.5; 3]), RADIUS, 0);
    let volume = determinant(&w.domain.cell);
    let mut run = Run::new(on, w);
    let i = interior(&mut run);
    let force = STIFFNESS * (2.0 * RADIUS - norm(branch)) / norm(branch);
    for a in 0..3 {
        for b in 0..3 {
            let expected = branch[a] * branch[b] * force / volume;
            assert_close(&format!("stress {a}{b}"), i.stress[a][b], expected, i.p());
            assert_close("fabric", i.fabric[a][b], branch[a] * branch[b] / dot(branch, branch), 1.0);
        }
    }
    // A particle with one contact carries nothing.
    assert_eq!((i.mechanical_coordination, i.rattlers), (0.0, 3));
}

/// A gas without contacts has a kinetic stress alone.
pub fn stress_of_a_gas(on: &Subject) {
    let mut w = cubic(4, [2.5 * RADIUS; 3], 1e-6);
    let mut r = Random(4);
    w.particles.velocity = (0..64).map(|_| r.vector(2.0)).collect();
    w.particles.spin = vec![[0.0; 3]; 64];
    let mut sum = [[0.0; 3]; 3];
    for v in &w.particles.velocity {
        for a in 0..3 {
            for b in 0..3 {
                sum[a][b] += v[a] * v[b];
            }
        }
    }
    let mass = crate::support::sphere_mass(RADIUS, &w.materials[0]);
    let volume = (10.0 * RADIUS).powi(3);
    let mut run = Run::new(on, w);
    let i = interior(&mut run);
    let scale = sum[0][0] * mass / volume;
    for a in 0..3 {
        for b in 0..3 {
            assert_close("kinetic stress", i.kinetic_stress[a][b], sum[a][b] * mass / volume, scale);
        }
    }
    assert_eq!((i.p(), i.rattlers, i.fabric[0][0]), (0.0, 64, 0.0));
}
