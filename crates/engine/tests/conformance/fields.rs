//! Coarse graining: what the cells of a field add up to, and that momentum is balanced in them.

use glebe_engine::field::{Field, FieldSpec, Kernel, Point};
use glebe_engine::measure::Interior;
use glebe_engine::spec::{Domain, Side, Vec3};
use glebe_physics::{ContactModel, LawChoice};

use crate::samples::cube;
use crate::support::{Random, Run, Subject, grain, open_world};

/// Largest relative error of sums of forces in f32.
const SUM: f64 = 1e-5;
/// Largest relative error of sums that the kernel's normalisation makes exact.
const EXACT: f64 = 1e-12;

const KERNELS: [Kernel; 2] = [Kernel::Gaussian, Kernel::Lucy];

fn spec(min: Vec3, max: Vec3, cells: [usize; 3], kernel: Kernel, width: f64) -> FieldSpec {
    FieldSpec {
        name: "field".to_owned(),
        min,
        max,
        cells,
        kernel,
        width,
        every: 1.0,
        window: None,
        profile: None,
    }
}

fn look(run: &mut Run, field: &mut Field) {
    let state = run.state();
    let positions = glebe_engine::batch::positions(&run.c, &state);
    let detail = run.detail();
    field.look(&run.c, &state, &positions, &detail);
}

fn mass(run: &Run) -> f64 {
    run.bodies().iter().map(|b| b.mass).sum()
}

/// Means over the cells of a field that covers a periodic sample are those of the sample: mass and momentum exactly,
/// stress and fabric as the backend itself sums them, and the mean of two moments is the mean of their means.
pub fn a_sample_on_a_grid_is_the_sample(on: &Subject) {
    let side = 0.011;
    let mut w = cube(side, 1e-6);
    let mut r = Random(8);
    for _ in 0..220 {
        let at = r.vector(0.5 * side).map(|x| x + 0.5 * side);
        let v = r.vector(0.3);
        w.particles.push_moving(at, (0.6 + 0.4 * r.unit()) * 1e-3, 0, v, [0.0; 3]);
    }
    let volume = side.powi(3);
    let mut run = Run::new(on, w);
    for kernel in KERNELS {
        let moment = run.moment();
        let (cell, strain) = run.c.cell(&run.g);
        let sample = Interior::new(&moment.tensors.unwrap(), &cell, &strain);
        let mut field = Field::new(spec([0.0; 3], [side; 3], [6, 5, 7], kernel, 0.0025));
        look(&mut run, &mut field);
        let cells = field.points();
        let mean = |f: &dyn Fn(&Point) -> f64| cells.iter().map(f).sum::<f64>() / cells.len() as f64;
        let total = mass(&run);
        assert!((mean(&|p| p.density) * volume / total - 1.0).abs() < EXACT);
        let contacts = mean(&|p| p.contact_density) * volume;
        assert!((contacts / moment.contacts as f64 - 1.0).abs() < EXACT, "{contacts}");
        assert!(moment.contacts > 150, "{}", moment.contacts);
        for k in 0..3 {
            let momentum: f64 = run.bodies().iter().map(|b| b.mass * b.v[k]).sum();
            assert!((mean(&|p| p.momentum[k]) * volume - momentum).abs() < EXACT * total);
        }
        for a in 0..3 {
            for b in 0..3 {
                let close = |what: &str, x: f64, y: f64, scale: f64| {
                    assert!((x - y).abs() <= SUM * scale, "{kernel:?} {what} {a}{b}: {x:e}, sample {y:e}");
                };
                close("stress", mean(&|p| p.stress[a][b]), sample.stress[a][b], sample.p());
                let flow = mean(&|p| p.kinetic_stress[a][b] + p.density * p.velocity[a] * p.velocity[b]);
                close("flow", flow, sample.kinetic_stress[a][b], sample.kinetic_stress[0][0]);
                let fabric = mean(&|p| p.fabric[a][b] * p.contact_density) * volume / contacts;
                close("fabric", fabric, sample.fabric[a][b], 1.0);
            }
        }
        // Not all cells are alike, and profiles have the same means.
        let spread = cells.iter().map(|p| p.density).fold(0.0, f64::max) / (total / volume);
        assert!(spread > 1.05, "{spread}");
        for (axis, planes) in [6.0, 5.0, 7.0].into_iter().enumerate() {
            let profile = field.profile(axis);
            let sum: f64 = profile.iter().map(|(_, p)| p.density).sum();
            assert!((sum / planes * volume / total - 1.0).abs() < EXACT);
        }
        let before = cells;
        let first = field.to_bytes();
        run.steps(20);
        field.clear();
        look(&mut run, &mut field);
        let after = field.points();
        assert!(field.restore(&first).unwrap().is_empty());
        look(&mut run, &mut field);
        assert_eq!(field.looks(), 2);
        for ((a, b), both) in before.iter().zip(&after).zip(field.points()) {
            let mean = 0.5 * (a.stress[2][2] + b.stress[2][2]);
            assert!((both.stress[2][2] - mean).abs() <= 1e-12 * sample.p());
        }
    }
}

/// Spheres at rest upon each other: at every height the stress, over the area, is the weight above, the floor carries
/// all of it, and each sphere adds its own where it is: momentum is balanced in every plane, within the kernel's reach
/// of the floor too.
pub fn a_column_carries_its_weight(on: &Subject) {
    // The radius is a number of f32, so that overlaps are what they are meant to be.
    let (stiffness, radius, gravity, n) = (1e3, 1.0 / 1024.0, 9.81, 12);
    let material = grain(0.5, 0.0);
    let weight = crate::support::sphere_mass(radius, &material) * gravity;
    let mut w = open_world([0.0; 3], 0.1, 1e-6, material);
    let (half, top) = (0.005, 0.034);
    let sides = [[Side::Periodic; 2], [Side::Periodic; 2], [Side::Wall, Side::Open]];
    w.domain = Domain::aligned([-half, -half, 0.0], [half, half, top], sides, Some(0));
    w.gravity = [0.0, 0.0, -gravity];
    w.contact = ContactModel {
        normal: LawChoice::named("linear").with("stiffness", stiffness),
        tangential: LawChoice::named("none"),
        ..ContactModel::default()
    };
    let mut z = radius - f64::from(n) * weight / stiffness;
    for above in (0..n).rev() {
        w.particles.push([0.0, 0.0, z], radius, 0);
        z += 2.0 * radius - f64::from(above) * weight / stiffness;
    }
    let mut run = Run::new(on, w);
    let area = 4.0 * half * half;
    for kernel in KERNELS {
        // Below the floor, so that nothing is cut off.
        let (low, high, planes) = (-0.006, 0.03, 180);
        let grid = spec([-half, -half, low], [half, half, high], [5, 5, planes], kernel, 0.002);
        let mut field = Field::new(grid);
        look(&mut run, &mut field);
        let profile = field.profile(2);
        let h = (high - low) / planes as f64;
        let all = f64::from(n) * weight;
        // From the top down: weight of the matter above less what the floor carries above.
        let mut above = 0.0;
        for (z, p) in profile.iter().rev() {
            let own = (p.density * gravity - p.surface_force[2]) * h * area;
            let carried = p.stress[2][2] * area;
            assert!(
                (carried - above - 0.5 * own).abs() < 2e-3 * all,
                "{kernel:?} {z}: {carried} N, {above} N"
            );
            above += own;
        }
        assert!(above.abs() < SUM * all, "{above:e} of {all:e} N are not carried by the floor");
        let floor: f64 = profile.iter().map(|(_, p)| p.surface_force[2] * h * area).sum();
        assert!((floor / all - 1.0).abs() < SUM, "the floor carries {floor} of {all} N");
        let total = profile.iter().map(|(_, p)| p.density * h * area).sum::<f64>();
        assert!((total / mass(&run) - 1.0).abs() < EXACT);
        // In the middle of the column, where neither end is in reach.
        let (_, middle) = &profile[105];
        assert!(middle.stress[2][2] * area > 0.3 * all && middle.stress[0][0].abs() < SUM * all / area);
    }
}
