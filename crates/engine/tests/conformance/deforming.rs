//! Cells that deform.

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status};
use glebe_engine::cell::Cell;
use glebe_engine::generate::{FillRequest, Region, generate};
use glebe_engine::lattice::{Lattice, Vec3x3, add, determinant, mul, norm, scale, sub};
use glebe_engine::measure::Interior;
use glebe_engine::prepare;
use glebe_engine::spec::{Deformation, Domain, Drive, Side, Stage, Until, Vec3, WorldSpec};
use glebe_engine::state::State;
use glebe_physics::{ContactModel, IntegratorKind, LawChoice};

use crate::samples::{cube, interior};
use crate::support::{Body, REFERENCE, Random, Run, Subject, Together, assert_near, grain};

const RADIUS: f64 = 1e-3;
/// Normal stiffness of linear springs \[N/m\].
const STIFFNESS: f64 = 1e5;

/// The distance of two places, to the nearest image.
fn apart(lattice: &Lattice, a: Vec3, b: Vec3) -> f64 {
    let d = sub(a, b);
    norm(sub(d, mul(&lattice.cell, lattice.periods(d).map(f64::round))))
}

/// Rates of a stage: xx, yy, zz, yz, xz, xy.
fn rates(rates: [f64; 6]) -> Deformation {
    Deformation { drive: rates.map(Drive::Rate), ..Deformation::default() }
}

/// Largest relative error of a stress after some hundred steps: of f32 sums, and of the motion that their rounding
/// causes.
const STRESS: f64 = 2e-5;

/// Half of the neighbours of a lattice, as branches: all centres are in equal surroundings, so none moves on its own,
/// and every branch follows the cell.
struct Crystal {
    /// Cell of the sample by columns, and places of one sphere per branch family in fractions.
    spec: WorldSpec,
    branches: Vec<Vec3>,
}

/// `n`³ spheres on a simple cubic lattice.
fn cubic(n: u32, spacing: f64) -> Crystal {
    let mut spec = cube(f64::from(n) * spacing, 1e-6);
    for i in 0..n.pow(3) {
        let at = [i % n, i / n % n, i / (n * n)].map(|k| (f64::from(k) + 0.25) * spacing);
        spec.particles.push(at, RADIUS, 0);
    }
    Crystal { spec, branches: vec![[spacing, 0.0, 0.0], [0.0, spacing, 0.0], [0.0, 0.0, spacing]] }
}

/// `n`³ cubes of four spheres on a face-centred cubic lattice with neighbours at `distance`.
fn face_centred(n: u32, distance: f64) -> Crystal {
    let a = distance * std::f64::consts::SQRT_2;
    let mut spec = cube(f64::from(n) * a, 1e-6);
    for i in 0..n.pow(3) {
        let at = [i % n, i / n % n, i / (n * n)].map(f64::from);
        for face in [[0.0; 3], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]] {
            spec.particles.push([0, 1, 2].map(|k| (at[k] + face[k] + 0.2) * a), RADIUS, 0);
        }
    }
    let h = 0.5 * a;
    let branches = vec![[h, h, 0.0], [h, -h, 0.0], [h, 0.0, h], [h, 0.0, -h], [0.0, h, h], [0.0, h, -h]];
    Crystal { spec, branches }
}

/// Stress of a lattice with linear springs and dashpots whose branches follow `map`, moving with the gradient `u`.
fn stress(c: &Crystal, map: &Vec3x3, u: &Vec3x3, dashpot: f64) -> Vec3x3 {
    let per_sphere = determinant(&c.spec.domain.cell) / c.spec.particles.len() as f64 * determinant(map);
    let mut sum = [[0.0; 3]; 3];
    for branch in &c.branches {
        let d = mul(map, *branch);
        let approach = -glebe_engine::lattice::dot(d, mul(u, d)) / norm(d);
        let force = STIFFNESS * (2.0 * RADIUS - norm(d)) + dashpot * approach;
        for a in 0..3 {
            for b in 0..3 {
                sum[a][b] += force / norm(d) * d[a] * d[b] / per_sphere;
            }
        }
    }
    sum
}

/// Compression along three axes at different rates, and simple shear in two planes: the stress is that of the lattice
/// mapped by the closed form of the deformation, dashpots included, also through the seams.
pub fn a_lattice_follows_its_cell(on: &Subject) {
    let (steps, dt, dashpot) = (300, 1e-6, 2.0);
    let compression = [12.0, -5.0, 8.0, 0.0, 0.0, 0.0];
    let shear = [0.0, 0.0, 0.0, 0.0, 20.0, 15.0];
    for integrator in [IntegratorKind::Euler, IntegratorKind::VelocityVerlet] {
        for (rate, mut crystal) in
            [(compression, cubic(5, 1.98e-3)), (shear, cubic(5, 1.98e-3)), (shear, face_centred(3, 1.98e-3))]
        {
            crystal.spec.contact.normal =
                LawChoice::named("linear").with("stiffness", STIFFNESS).with("damping", dashpot);
            crystal.spec.stages[0].deformation = Some(rates(rate));
            crystal.spec.time.integrator = integrator;
            let mut run = Run::new(on, crystal.spec.clone());
            run.steps(steps);
            let t = steps as f64;
            let grown = |k: usize| (t * (-rate[k] * dt).ln_1p()).exp();
            let map = [
                [grown(0), -t * dt * rate[5], -t * dt * rate[4]],
                [0.0, grown(1), 0.0],
                [0.0, 0.0, grown(2)],
            ];
            let u = [[-rate[0], -rate[5], -rate[4]], [0.0, -rate[1], 0.0], [0.0, 0.0, -rate[2]]];
            let expected = stress(&crystal, &map, &u, dashpot);
            let i = interior(&mut run);
            let p = expected[0][0] + expected[1][1] + expected[2][2];
            for a in 0..3 {
                for b in 0..3 {
                    let off = (i.stress[a][b] - expected[a][b]).abs() / p;
                    assert!(off < STRESS, "{rate:?}: stress {a}{b} off by {off:.1e} of the trace");
                }
            }
            let cell = run.g.cell.unwrap();
            let volume = determinant(&crystal.spec.domain.cell) * determinant(&map);
            assert!((determinant(&cell.matrix) / volume - 1.0).abs() < 1e-12);
            let strain = rate.map(|r| r * t * dt);
            assert_near(
                "strain",
                [0, 1, 2].map(|k| i.strain[k][k]),
                [strain[0], strain[1], strain[2]],
                1e-12,
            );
            assert!((i.strain[0][1] - 0.5 * strain[5]).abs() < 1e-12);
        }
    }
}

/// Bulk and shear modulus of a face-centred cubic packing with normal and tangential springs: for contacts of
/// stiffness kₙ and kₜ at the distance l, `K = 2√2 kₙ/(3l)` and `(C₁₁ - C₁₂)/2 = √2 (kₙ + 3kₜ)/(4l)`, from `C = l²/V Σ
/// (kₙ nnnn + kₜ n(1 - nn)n)` over the six contacts of a sphere.
pub fn moduli_of_a_packing(on: &Subject) {
    let (l, kt, dt) = (2.0 * RADIUS * (1.0 - 1e-4), 0.4 * STIFFNESS, 1e-6);
    let measured = |rate: [f64; 6]| {
        let mut w = face_centred(3, l).spec;
        w.materials = vec![grain(1.0, 10.0)];
        w.contact.tangential = LawChoice::named("linear").with("stiffness", kt);
        w.stages[0].deformation = Some(rates(rate));
        let mut run = Run::new(on, w);
        let before = interior(&mut run);
        run.steps(200);
        let after = interior(&mut run);
        (before, after)
    };
    let near = |name: &str, found: f64, theory: f64| {
        // What stress and size change on the way is a ten-thousandth.
        assert!((found / theory - 1.0).abs() < 2e-3, "{name}: {found:e} Pa, theory {theory:e} Pa");
    };
    let (a, b) = measured([0.3, 0.3, 0.3, 0.0, 0.0, 0.0]);
    let root = std::f64::consts::SQRT_2;
    let bulk = (b.p() - a.p()) / (b.volumetric_strain() - a.volumetric_strain());
    near("bulk modulus", bulk, 2.0 * root * STIFFNESS / (3.0 * l));
    let (a, b) = measured([0.3, -0.3, 0.0, 0.0, 0.0, 0.0]);
    let difference = |i: &Interior| i.stress[0][0] - i.stress[1][1];
    let shear = (difference(&b) - difference(&a)) / (4.0 * 0.3 * 200.0 * dt);
    near("shear modulus", shear, root * (STIFFNESS + 3.0 * kt) / (4.0 * l));
}

/// `count` spheres of 1-2 mm packed in a sheared periodic cell, pressed together by 2 %, moving and spinning, with
/// friction.
pub fn packed(count: usize, seed: u64, rate: [f64; 6]) -> WorldSpec {
    let mut r = Random(seed);
    let radii: Vec<f64> = (0..count).map(|_| RADIUS * (1.0 + r.unit())).collect();
    let solid: f64 = radii.iter().map(|r| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3)).sum();
    let side = (solid / 0.6).cbrt();
    let region = Region { min: [0.0; 3], max: [side; 3], periodic: [true; 3] };
    let positions = generate("dense", &FillRequest::new(region, &radii, seed)).unwrap();
    let mut w = cube(side, 2e-6);
    w.contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    w.materials = vec![grain(0.5, 0.5)];
    for (x, radius) in positions.into_iter().zip(radii) {
        w.particles.push_moving(scale(x, 0.98), radius, 0, r.vector(0.1), r.vector(50.0));
    }
    w.domain = Domain::aligned([0.0; 3], [0.98 * side; 3], [[Side::Periodic; 2]; 3], None);
    w.stages[0].deformation = Some(rates(rate));
    w
}

/// Strains of all kinds, fast: lists last some tens of steps.
const FAST: [f64; 6] = [20.0, -10.0, 15.0, 25.0, -20.0, 30.0];

pub fn deforming_trajectories_equal_the_reference(on: &Subject) {
    for (k, integrator) in IntegratorKind::ALL.into_iter().enumerate() {
        let mut w = packed(150, 3, FAST);
        w.time.integrator = integrator;
        w.local_damping = [0.0, 0.2][k % 2];
        let mut run = Run::new(on, w.clone());
        let mut reference = Run::new(&REFERENCE, w);
        run.steps(100);
        reference.steps(100);
        assert_eq!(run.g.cell.map(|c| c.matrix), reference.g.cell.map(|c| c.matrix));
        let lattice = run.c.lattice_now(&run.g);
        let b = reference.bodies();
        let largest = |f: fn(&Body) -> Vec3| b.iter().map(|b| norm(f(b))).fold(0.0, f64::max);
        let most = &on.bounds.trajectory;
        for (i, (a, b)) in run.bodies().iter().zip(&b).enumerate() {
            let d = apart(&lattice, a.x, b.x) / RADIUS;
            let (v, w) = (norm(sub(a.v, b.v)) / largest(|b| b.v), norm(sub(a.w, b.w)) / largest(|b| b.w));
            let name = integrator.name();
            assert!(d <= most.place, "{name}: {i} is {d:.1e} radii off");
            assert!(v <= most.velocity, "{name}: velocity of {i} off by {v:.1e} of the largest");
            assert!(w <= most.spin, "{name}: spin of {i} off by {w:.1e} of the largest");
        }
        let (a, b) = (interior(&mut run), interior(&mut reference));
        let off = (a.p() / b.p() - 1.0).abs();
        assert!(off <= most.velocity, "p {:e} and {:e} Pa", a.p(), b.p());
        let (a, b) = (run.g.ledger, reference.g.ledger);
        let works = [
            ("work", a.work, b.work),
            ("damping", a.damping, b.damping),
            ("friction", a.friction, b.friction),
        ];
        for (row, a, b) in works {
            assert!(
                (a - b).abs() <= on.bounds.ledger * b.abs(),
                "{row}: {a:e} J, the reference finds {b:e} J"
            );
        }
    }
}

/// The work of the cell is what energies and losses do not account for.
pub fn the_ledger_closes_in_a_deforming_cell(on: &Subject) {
    let mut w = packed(60, 5, [40.0, 30.0, 20.0, 0.0, 0.0, 40.0]);
    w.time.step = glebe_engine::spec::Step::Fixed(1e-6);
    let mut run = Run::new(on, w);
    let energy = |run: &mut Run| {
        let m = run.moment();
        m.kinetic() + m.elastic_normal + m.elastic_tangential
    };
    let before = energy(&mut run);
    run.steps(600);
    let change = energy(&mut run) - before;
    let l = run.g.ledger;
    let open = l.work - l.dissipated() - l.stiffness_change - change;
    assert!(l.work > 0.2 * before, "work {:e} J", l.work);
    assert!(open.abs() < 0.01 * l.work, "open by {:.2e} of the work", open / l.work);
}

/// Momentum of the particles' own motion stays none while cells shrink and shear and particles cross seams.
pub fn momentum_in_a_deforming_cell(on: &Subject) {
    let mut w = packed(100, 8, FAST);
    let masses: Vec<f64> =
        w.particles.radius.iter().map(|r| crate::support::sphere_mass(*r, &w.materials[0])).collect();
    for v in &mut w.particles.velocity {
        *v = scale(*v, 40.0);
    }
    let momentum = |vs: &[Vec3]| vs.iter().zip(&masses).fold([0.0; 3], |s, (v, m)| add(s, scale(*v, *m)));
    let mean = scale(momentum(&w.particles.velocity), 1.0 / masses.iter().sum::<f64>());
    for v in &mut w.particles.velocity {
        *v = sub(*v, mean);
    }
    let mut run = Run::new(on, w);
    let places = |run: &Run| {
        let p = run.state().particles;
        let mut all: Vec<_> = p.id.iter().zip(&p.place).map(|(id, place)| (*id, place.lo)).collect();
        all.sort_unstable();
        all
    };
    let before = places(&run);
    run.steps(300);
    let jumps = |a: u32, b: u32| a.abs_diff(b) > u32::MAX / 2;
    let crossed = before.iter().zip(places(&run)).filter(|(a, b)| (0..3).any(|k| jumps(a.1[k], b.1[k])));
    assert!(crossed.count() > 0, "no particle crossed a seam");
    let v: Vec<Vec3> = run.bodies().iter().map(|b| b.v).collect();
    let size: f64 = v.iter().zip(&masses).map(|(v, m)| m * norm(*v)).sum();
    let left = norm(momentum(&v)) / size;
    assert!(left < on.bounds.momentum, "momentum of {left:.1e} of its parts");
}

/// A world that deforms is the same alone, in a batch of others that do not, and after a checkpoint.
pub fn a_deforming_world_keeps_its_bits(on: &Subject) {
    let steps = 300;
    let alone = |integrator| {
        let mut w = packed(120, 2, FAST);
        w.time.integrator = integrator;
        w
    };
    for integrator in [IntegratorKind::Euler, IntegratorKind::VelocityVerlet] {
        let mut run = Run::new(on, alone(integrator));
        run.steps(steps / 2 + 3);
        let bytes = run.state().to_bytes();
        run.steps(steps - steps / 2 - 3);
        let lists = on.backend != Backend::Reference;
        assert!(!lists || run.g.rebuilds > 1, "lists were made {} times", run.g.rebuilds);
        let state = run.state();
        let others = [packed(60, 6, [0.0; 6]), packed(60, 7, [-30.0, 0.0, 20.0, 0.0, 0.0, 10.0])];
        let [a, b] = others;
        let mut batch = Together::new(on, vec![a, alone(integrator), b]);
        for part in [[10, steps / 2, steps], [steps, steps - steps / 2, 3]] {
            batch.advance(&part);
        }
        assert_eq!(batch.state(1).hash(), state.hash());
        if on.exact_states {
            let mut resumed = Run::resume(on, run.c.clone(), State::from_bytes(&bytes).unwrap());
            resumed.steps(steps - steps / 2 - 3);
            assert_eq!(resumed.state().hash(), state.hash(), "after a checkpoint");
        }
    }
}

/// A stage stands still where it does not say how the cell moves, and a stage that follows goes on from there.
pub fn stages_deform_one_after_the_other(on: &Subject) {
    let mut w = packed(60, 4, [0.0; 6]);
    let dt = 2e-6;
    let stage = |steps: f64, deformation| Stage {
        until: Until { at_most: Some(steps * dt), ..Until::default() },
        deformation,
        ..Stage::default()
    };
    let rate = [10.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    w.stages =
        vec![stage(50.0, Some(rates(rate))), stage(20.0, None), stage(40.0, Some(rates(rate.map(|r| -r))))];
    w.sampling.series = 30.0 * dt;
    let before = w.domain.cell;
    let mut batch = Batch::new(vec![w], on.backend).map_err(|e| e.1).unwrap();
    let mut strains = vec![0.0];
    while batch.running() {
        let Ok(()) = batch.advance(&mut Blind);
        strains.push(batch.progress(0).cell.unwrap().strain[0][0]);
    }
    assert_eq!(batch.status(0), &Status::Done);
    let expected = [0.0, 30.0, 50.0, 50.0, 50.0, 30.0, 10.0].map(|n| n * dt * 10.0);
    for (found, expected) in strains.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{strains:?}");
    }
    let mut cell = Cell::new(before);
    cell.begin(Some(&rates(rate)));
    (0..50).for_each(|_| cell.step(dt));
    cell.begin(Some(&rates(rate.map(|r| -r))));
    (0..40).for_each(|_| cell.step(dt));
    assert_eq!(batch.progress(0).cell.unwrap().matrix, cell.matrix);
}

/// A cell that becomes too narrow stops its world, at the same step on every backend.
pub fn a_cell_that_becomes_too_narrow_stops(on: &Subject) {
    let mut w = cube(0.0063, 1e-6);
    w.particles.push([0.0015; 3], RADIUS, 0);
    w.particles.push([0.0046; 3], RADIUS, 0);
    w.stages[0].deformation = Some(rates([90.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    let mut batch = Together::new(on, vec![w]);
    let failure = batch.try_advance(&[1000]).remove(0).unwrap_err();
    // Two cut-offs of 2 + 1 radii each.
    let steps = (6.3_f64 / 6.0).ln() / 9e-5;
    assert!((failure.step as f64 - steps).abs() <= 1.0, "{failure:?} instead of {steps}");
    assert!(failure.what.contains("across its second and third vectors"), "{failure:?}");
}

/// Spheres of 1 to 1.5 mm apart from each other in a cell that leans by the share `lean` of its first vector, moving and
/// spinning, with friction, sheared on.
fn leaning(lean: f64, seed: u64) -> WorldSpec {
    let side = 0.011;
    let mut w = cube(side, 2e-6);
    w.contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    w.materials = vec![grain(0.5, 0.5)];
    w.domain.cell[0][1] = lean * side;
    w.domain.cell[1][2] = 0.3 * side;
    let (constants, _) = prepare(w.clone()).unwrap();
    let lattice = &constants.lattice;
    let mut r = Random(seed);
    let mut bodies: Vec<(Vec3, f64)> = Vec::new();
    while bodies.len() < 60 {
        let radius = RADIUS * (1.0 + 0.5 * r.unit());
        let x = mul(&w.domain.cell, [0; 3].map(|_| r.unit()));
        if bodies.iter().all(|(y, s)| apart(lattice, x, *y) > s + radius) {
            bodies.push((x, radius));
        }
    }
    for (x, radius) in bodies {
        w.particles.push_moving(x, radius, 0, r.vector(2.0), r.vector(50.0));
    }
    w.stages[0].deformation = Some(rates([10.0, -10.0, 0.0, -40.0, 20.0, -45.0]));
    w.sampling.series = 1e-3;
    w
}

/// A batch tells samples that lean too much in other cells of the same images, which changes nothing: neither energies nor
/// how particles go on, with what their contacts remember.
pub fn a_cell_that_leans_is_told_in_another(on: &Subject) {
    for integrator in [IntegratorKind::Adams, IntegratorKind::VelocityVerlet] {
        let (dt, steps) = (2e-6, 400);
        let mut w = leaning(0.53, 3);
        w.time.integrator = integrator;
        w.stages[0].until = Until { at_most: Some(f64::from(steps) * dt), ..Until::default() };
        let mut straight = Run::new(on, w.clone());
        straight.steps(u64::from(steps as u32));
        let mut batch = Batch::new(vec![w], on.backend).map_err(|e| e.1).unwrap();
        let mut last = batch.moment(0);
        while batch.running() {
            let Ok(()) = batch.advance(&mut Blind);
            last = batch.moment(0);
        }
        assert_eq!(batch.status(0), &Status::Done);
        let (turned, cell) = (batch.progress(0).cell.unwrap(), straight.g.cell.unwrap());
        assert!(cell.leaning().is_some() && turned.leaning().is_none(), "{:?}", turned.matrix);
        assert!((determinant(&turned.matrix) / determinant(&cell.matrix) - 1.0).abs() < 1e-12);
        let other = straight.moment();
        assert!(other.contacts > 20, "{} contacts", other.contacts);
        assert_eq!(last.contacts, other.contacts);
        for (a, b) in [
            (last.kinetic(), other.kinetic()),
            (last.elastic_normal, other.elastic_normal),
            (last.elastic_tangential, other.elastic_tangential),
        ] {
            assert!((a - b).abs() < 1e-3 * b, "{a:e} J and {b:e} J");
        }
        let resumed = Run::resume(on, batch.constants(0).clone(), batch.state(0));
        let lattice = straight.c.lattice_now(&straight.g);
        let b = straight.bodies();
        let largest = |f: fn(&Body) -> Vec3| b.iter().map(|b| norm(f(b))).fold(0.0, f64::max);
        let most = &on.bounds.frame;
        for (i, (a, b)) in resumed.bodies().iter().zip(&b).enumerate() {
            let d = apart(&lattice, a.x, b.x) / RADIUS;
            let (v, w) = (norm(sub(a.v, b.v)) / largest(|b| b.v), norm(sub(a.w, b.w)) / largest(|b| b.w));
            assert!(d <= most.place, "{i} is {d:.1e} radii off");
            assert!(v <= most.velocity && w <= most.spin, "{i}: {v:.1e}, {w:.1e} off");
        }
    }
}

/// The same alone, among others, and after a checkpoint behind which the cell is told in another.
pub fn a_cell_that_leans_keeps_its_bits(on: &Subject) {
    let dt = 2e-6;
    let of = |seed: u64, lean: f64, steps: f64| {
        let mut w = leaning(lean, seed);
        w.stages[0].until = Until { at_most: Some(steps * dt), ..Until::default() };
        w.sampling.series = 100.0 * dt;
        w
    };
    let finished = |mut batch: Batch, w: usize| {
        while batch.running() {
            let Ok(()) = batch.advance(&mut Blind);
        }
        assert_eq!(batch.status(w), &Status::Done);
        assert!(batch.progress(w).cell.unwrap().matrix[0][1] < 0.0, "the cell was not told in another");
        batch.state(w).hash()
    };
    let begun = |worlds| Batch::new(worlds, on.backend).map_err(|e| e.1).unwrap();
    let mut alone = begun(vec![of(5, 0.53, 450.0)]);
    let Ok(()) = alone.advance(&mut Blind);
    let bytes = alone.state(0).to_bytes();
    let hash = finished(alone, 0);
    let among = begun(vec![of(6, 0.2, 300.0), of(5, 0.53, 450.0), of(7, 0.54, 500.0)]);
    assert_eq!(finished(among, 1), hash, "in a batch");
    if on.exact_states {
        let (constants, _) = prepare(of(5, 0.53, 450.0)).unwrap();
        let state = State::from_bytes(&bytes).unwrap();
        assert!(state.progress.cell.unwrap().matrix[0][1] > 0.0);
        let resumed = Batch::from_states(vec![(constants, state)], on.backend);
        assert_eq!(finished(resumed, 0), hash, "after a checkpoint");
    }
}

/// Simple shear at a constant volume goes on for periods, and so does what it takes to shear the sample.
pub fn a_sample_shears_without_end(on: &Subject) {
    let dt = 2e-6;
    let mut w = packed(120, 4, [0.0, 0.0, 0.0, 0.0, 0.0, 45.0]);
    w.stages[0].until = Until { at_most: Some(2.5 / 45.0), ..Until::default() };
    w.sampling.series = 500.0 * dt;
    let mut batch = Batch::new(vec![w], on.backend).map_err(|e| e.1).unwrap();
    let mut leans: Vec<f64> = Vec::new();
    while batch.running() {
        let Ok(()) = batch.advance(&mut Blind);
        let cell = batch.progress(0).cell.unwrap();
        leans.push(cell.matrix[0][1] / cell.matrix[0][0]);
        assert!(batch.moment(0).contacts > 120, "at {:.2}", cell.strain[0][1]);
    }
    assert_eq!(batch.status(0), &Status::Done);
    let cell = batch.progress(0).cell.unwrap();
    assert!((2.0 * cell.strain[0][1] - 2.5).abs() < 1e-3, "{:?}", cell.strain);
    let turns = leans.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > 0.5).count();
    assert_eq!(turns, 2, "{leans:?}");
    let last = leans.last().unwrap();
    assert!((last + 0.5).abs() < 1e-3, "{last}");
}

fn refusal(change: impl FnOnce(&mut WorldSpec)) -> Option<String> {
    let mut w = packed(60, 4, FAST);
    change(&mut w);
    prepare(w).err().map(|e| e.to_string())
}

#[test]
fn what_cannot_deform_is_refused() {
    assert_eq!(refusal(|_| ()), None);
    let said = |change: fn(&mut WorldSpec), part: &str| {
        let said = refusal(change).unwrap_or_default();
        assert!(said.contains(part) && said.contains("stage `run`"), "{said}");
    };
    said(|w| w.domain.sides[2] = [Side::Open; 2], "walls, open sides or surfaces");
    said(|w| w.gravity = [0.0, 0.0, -9.81], "gravity");
    said(|w| w.domain.cell[1][0] = 1e-4, "turn the cell");
    said(|w| w.stages[0].deformation = Some(rates([0.0, 0.0, 60.0, 0.0, 0.0, 0.0])), "a step");
    said(|w| w.stages[0].deformation = Some(rates([f64::NAN; 6])), "a step");
}
