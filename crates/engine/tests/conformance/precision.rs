//! Small numbers beside large ones: creep, the overlap of a sphere at rest, a packing that hardly touches.

use std::sync::OnceLock;

use glebe_engine::generate::solid_volume;
use glebe_engine::lattice::{add, dot, norm, scale, sub};
use glebe_engine::prepare;
use glebe_engine::spec::{Domain, Pose, Side, Vec3, WorldSpec};
use glebe_engine::surface::quaternion;
use glebe_physics::{ContactModel, LawChoice, Material};

use crate::packing::{Packing, Repulsion, nearest};

use crate::support::{
    REFERENCE, Run, Subject, assert_near, e_star, grain, mesh, open_world, plane, rectangle, turned,
};

/// Relative error of a creep path, of a resting overlap, and of a mean stress.
const CREEP: f64 = 0.01;
const REST: f64 = 0.01;
const STRESS: f64 = 0.01;
/// How far a sphere of a packing in balance may drift, in mean overlaps.
const DRIFT: f64 = 0.01;
/// Share of contacts that may come and go where their mean overlap is some units of the lattice.
const FLICKER: f64 = 0.06;

/// A particle creeps by 1e-13 m a step 100 m from the origin, its rest below one unit at its largest; and a mesh
/// creeps into a heavy one.
pub fn creep_is_not_lost(on: &Subject) {
    const SPEED: f64 = 1e-7;
    const DT: f64 = 1e-6;
    const RADIUS: f64 = 2e-3;
    let steps = on.budget.creep;
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
    let mut run = Run::new(on, w);
    run.edit(|_, state| state.particles.rest[0] = [0.5, -0.5, 0.5]);
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
pub fn resting_overlap(on: &Subject) {
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
            let mut run = Run::new(on, w);
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

/// A disordered packing at 50 Pa of 300 spheres of quartz, of radii from 0.1 to 0.15 mm, with the resolution of
/// its positions.
struct Loose {
    world: WorldSpec,
    packing: &'static Packing,
    /// Mean overlap \[m\].
    overlap: f64,
    /// A unit of the lattice \[m\].
    unit: f64,
}

/// With Hertz's law overlaps are 1e-5 of a radius, with the linear law of the RVE paper (eq. 1-4: `K_N = E R`,
/// `K_T = ν K_N`; R here is that of the mean sphere for all) 2e-8, some seven units of the lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    HertzMindlin,
    Rve,
}

impl Loose {
    const PRESSURE: f64 = 50.0;
    const LEAST: f64 = 1e-4;

    fn of(law: Law) -> Self {
        static PACKINGS: [OnceLock<Packing>; 2] = [OnceLock::new(), OnceLock::new()];
        let quartz =
            Material { density: 2650.0, youngs_modulus: 8e9, poissons_ratio: 0.2, ..grain(0.5, 0.5) };
        let k = quartz.youngs_modulus * 1.25 * Self::LEAST;
        let (hertz, linear) =
            (|a: f64, b: f64| 4.0 / 3.0 * e_star(&quartz) * (a * b / (a + b)).sqrt(), |_: f64, _: f64| k);
        let (contact, repulsion) = match law {
            Law::HertzMindlin => {
                (ContactModel::default(), Repulsion { stiffness: &hertz, power: 1.5, tolerance: 1e-8 })
            }
            Law::Rve => (
                ContactModel {
                    normal: LawChoice::named("linear").with("stiffness", k),
                    tangential: LawChoice::named("linear").with("stiffness", quartz.poissons_ratio * k),
                    ..ContactModel::default()
                },
                Repulsion { stiffness: &linear, power: 1.0, tolerance: 1e-2 },
            ),
        };
        let packing = PACKINGS[law as usize]
            .get_or_init(|| Packing::compressed(300, Self::LEAST, Self::PRESSURE, repulsion));
        let mut world = open_world([0.0; 3], 1.0, 5e-8, quartz);
        world.domain = Domain::aligned([0.0; 3], [packing.side; 3], [[Side::Periodic; 2]; 3], None);
        world.contact = contact;
        for (x, r) in packing.x.iter().zip(&packing.radius) {
            world.particles.push(*x, *r, 0);
        }
        let unit = prepare(world.clone()).unwrap().0.lattice.unit[0][0];
        let overlap = packing.contacts.iter().map(|c| c.overlap).sum::<f64>() / packing.contacts.len() as f64;
        let share = solid_volume(&packing.radius) / packing.side.powi(3);
        assert!((0.62..0.67).contains(&share), "{law:?}: solid fraction {share:.3}");
        let deep = if law == Law::Rve { 2e-8 } else { 1e-5 };
        let ratio = overlap / (1.25 * Self::LEAST * deep);
        assert!((0.5..2.0).contains(&ratio), "{law:?}: overlaps of {overlap:e} m");
        Self { world, packing, overlap, unit }
    }
}

/// Mean contact stress `tr(Σ d ⊗ f)/3V` \[Pa\].
fn mean_stress(run: &mut Run) -> f64 {
    let b = run.bodies();
    let cell = run.c.spec.domain.cell[0][0];
    let sum: f64 = run
        .detail()
        .network
        .iter()
        .map(|link| {
            let [i, j] = link.id.map(|i| i as usize);
            dot(nearest(sub(b[i].x, b[j].x), cell), link.force.map(f64::from))
        })
        .sum();
    sum / (3.0 * cell.powi(3))
}

/// Mean stress and the force on each particle, from equal states. Forces differ by no more than the error of
/// distances makes of them, beside rounding.
pub fn forces_of_a_packing_at_50_pa_equal_the_reference(on: &Subject) {
    for law in [Law::HertzMindlin, Law::Rve] {
        let Loose { world, packing, unit, .. } = Loose::of(law);
        let mut run = Run::new(on, world);
        let mut reference = Run::resume(&REFERENCE, run.c.clone(), run.state());
        let (found, expected) = (mean_stress(&mut run), mean_stress(&mut reference));
        assert!((expected / Loose::PRESSURE - 1.0).abs() < 1e-3, "{law:?}: the packing is at {expected} Pa");
        assert!(
            (found / expected - 1.0).abs() < STRESS,
            "{law:?}: {found} Pa, the reference finds {expected} Pa"
        );
        run.steps(1);
        reference.steps(1);
        let off = on.bounds.distance * unit;
        // A contact that is none in the reference may add this.
        let mut most = vec![packing.contacts[0].with(off); packing.x.len()];
        for c in &packing.contacts {
            let error = c.with(c.overlap + off) - c.with(c.overlap) + on.bounds.force * c.with(c.overlap);
            c.pair.iter().for_each(|i| most[*i] += error);
        }
        for (i, (a, b)) in run.bodies().iter().zip(reference.bodies()).enumerate() {
            let error = norm(sub(a.force, b.force));
            assert!(
                error <= most[i],
                "{law:?}: force on {i} off by {error:.2e}, more than {:.2e} N",
                most[i]
            );
        }
    }
}

/// A packing in balance stays: pressure, contacts, places, and no kinetic energy above that of its springs
/// stretched by half a unit.
pub fn a_packing_at_50_pa_stays_at_rest(on: &Subject) {
    for law in [Law::HertzMindlin, Law::Rve] {
        let Loose { world, packing, overlap, unit } = Loose::of(law);
        let mut run = Run::new(on, world);
        let start = run.bodies();
        let elastic = run.moment().elastic_normal;
        for _ in 0..5 {
            run.steps(on.budget.at_rest / 5);
            let pressure = mean_stress(&mut run);
            assert!((pressure / Loose::PRESSURE - 1.0).abs() < STRESS, "{law:?}: {pressure} Pa");
            let m = run.moment();
            let heat = m.kinetic() / elastic;
            assert!(
                heat < (0.5 * unit / overlap).powi(2),
                "{law:?}: kinetic over elastic energy is {heat:.2e}"
            );
            if law == Law::Rve {
                // The lightest contacts overlap by less than a unit: they flicker.
                let change = m.contacts as f64 / packing.contacts.len() as f64 - 1.0;
                assert!(change.abs() < FLICKER, "{} of {} contacts", m.contacts, packing.contacts.len());
                continue;
            }
            let mut found: Vec<_> = run.detail().network.iter().map(|c| c.id.map(|i| i as usize)).collect();
            for pair in &mut found {
                pair.sort_unstable();
            }
            found.sort_unstable();
            let lasting: Vec<_> = packing.contacts.iter().map(|c| c.pair).collect();
            assert!(found == lasting, "{} contacts, {} at the start", found.len(), lasting.len());
            for (i, (a, b)) in run.bodies().iter().zip(&start).enumerate() {
                let moved = norm(nearest(sub(a.x, b.x), packing.side)) / overlap;
                assert!(moved < DRIFT, "sphere {i} moved by {moved:.2e} of the mean overlap");
            }
        }
    }
}
