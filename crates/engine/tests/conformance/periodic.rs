//! Periodic axes: what repeats with the cell, and what does not.

use glebe_engine::lattice::{add, dot, norm, scale, sub};
use glebe_engine::prepare;
use glebe_engine::spec::{Motion, ParticleSet, Pose, Rotation, Side, Stage, Step, Vec3, WorldSpec};
use glebe_engine::surface::quaternion;
use glebe_physics::IntegratorKind;

use crate::support::{Random, Run, Subject, grain, mesh, open_world, plane, rectangle, sphere_mass, unit};

/// Largest difference of forces between images of one configuration, as a share of the largest force: places
/// some periods away are rounded differently.
const IMAGE: f64 = 1e-7;

/// Open part of the ledger as a share of the work of seams: the rounding of displacements to f32.
const SEAMS: f64 = 2e-7;

const RADIUS: f64 = 1e-3;

/// Cell vectors of a sheared cell \[m\].
const CELL: [Vec3; 3] = [[0.0122, 0.0, 0.0], [0.003, 0.0122, 0.0], [0.0, 0.0, 0.009]];

/// Grains in a cell that is periodic along its first two vectors, between walls.
fn bed() -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.1, 4e-6, grain(0.5, 0.4));
    w.domain.origin = [0.0; 3];
    w.domain.cell = [0, 1, 2].map(|row| CELL.map(|vector| vector[row]));
    w.domain.sides = [[Side::Periodic; 2], [Side::Periodic; 2], [Side::Wall; 2]];
    w.gravity = [0.0, 0.0, -9.81];
    let mut r = Random(21);
    for i in 0..100 {
        let at = [i % 5, i / 5 % 5, i / 25].map(|k| 0.2 * (f64::from(k) + 0.5));
        let x = add(add(scale(CELL[0], at[0]), scale(CELL[1], at[1])), [0.0, 0.0, 0.0105 * at[2]]);
        w.particles.push_moving(add(x, r.vector(1e-4)), RADIUS, 0, r.vector(0.1), [0.0; 3]);
    }
    w
}

/// A blade that is dragged 5.5 periods along one axis and 2.5 back along the other meets the bed all the way, and
/// at its end as one that stands 5 and 2 periods nearer.
pub fn a_blade_is_felt_however_far_it_goes(subject: &Subject) {
    let mut w = bed();
    let (vertices, triangles) = rectangle([-0.004, -0.003], [0.004, 0.003]);
    let upright = quaternion([0.0, 1.0, 0.0], std::f64::consts::FRAC_PI_2);
    w.surfaces =
        vec![mesh(vertices, triangles, Pose { translation: [0.006, 0.006, 0.0045], rotation: upright })];
    let parts = 11;
    let steps = 250;
    let path = sub(scale(CELL[0], 5.5), scale(CELL[1], 2.5));
    w.surfaces[0].motion.velocity = scale(path, 1.0 / (4e-6 * f64::from(parts) * steps as f64));
    let mut run = Run::new(subject, w);
    for part in 0..parts {
        run.steps(steps);
        let impulse = std::mem::take(&mut run.g.impulse[0]);
        assert!(norm([impulse[0], impulse[1], impulse[2]]) > 0.0, "nothing is felt in part {part}");
    }
    let after = |periods: [f64; 2]| {
        let mut state = run.state();
        let back = add(scale(CELL[0], periods[0]), scale(CELL[1], periods[1]));
        let base = &mut state.progress.surfaces[0].base.translation;
        *base = sub(*base, back);
        state.progress.stale = true;
        let mut run = Run::resume(subject, run.c.clone(), state);
        let on_blade = run.detail().on_triangles[0].clone();
        (run.steps(1).bodies(), on_blade)
    };
    let (far, near) = (after([0.0; 2]), after([5.0, -2.0]));
    let largest = far.0.iter().map(|b| norm(b.force)).fold(0.0, f64::max);
    assert!(far.1.iter().any(|f| norm(*f) > 0.01 * largest), "the blade touches nothing: {:?}", far.1);
    for (a, b) in far.1.iter().zip(&near.1) {
        assert!(norm(sub(*a, *b)) <= IMAGE * largest, "{a:?} and {b:?} N on the blade");
    }
    for (a, b) in far.0.iter().zip(&near.0) {
        assert!(norm(sub(a.force, b.force)) <= IMAGE * largest, "{a:?} and {b:?}");
    }
}

/// Grains that fall through the seams of a sheared cell, several times along each axis: what their potential energy
/// gains there is work, and the ledger stays as open as that of a fall without seams.
pub fn the_ledger_closes_through_seams(subject: &Subject) {
    // Changes of velocity are then the same in f32 as they should be.
    let dt = 2_f64.powi(-14);
    for integrator in IntegratorKind::ALL {
        let mut w = bed();
        w.domain.cell = [[0.0122, 0.003, 0.001], [0.0, 0.0122, -0.004], [0.0, 0.0, 0.0131]];
        w.domain.sides = [[Side::Periodic; 2]; 3];
        w.gravity = [4.0, 0.5, -9.0];
        w.time.integrator = integrator;
        w.time.step = Step::Fixed(dt);
        w.particles = ParticleSet::default();
        let v = [0.0, -1.0, 0.25];
        w.particles.push_moving([0.001; 3], 1e-3, 0, v, [20.0, 0.0, 0.0]);
        w.particles.push_moving([0.006; 3], 2e-3, 0, v, [0.0; 3]);
        let mass: f64 = [1e-3, 2e-3].iter().map(|r| sphere_mass(*r, &w.materials[0])).sum();
        let (steps, g2) = (4000, dot(w.gravity, w.gravity));
        let mut run = Run::new(subject, w);
        let energy = |run: &mut Run| run.moment().kinetic() + run.moment().potential;
        let before = energy(&mut run);
        // A seam passes what gravity did over a period: together nearly all that it did.
        let time = steps as f64 * dt;
        let fallen = mass * (dot(run.c.spec.gravity, v) * time + 0.5 * g2 * time * time);
        run.steps(steps);
        let name = integrator.name();
        let work = run.g.ledger.work;
        assert!((work / fallen - 1.0).abs() < 0.1, "{name}: work {work:e} J, gravity did {fallen:e} J");
        // Semi-implicit Euler falls half a step ahead; the others follow the parabola.
        let ahead = if integrator == IntegratorKind::Euler { 0.5 * mass * g2 * dt * time } else { 0.0 };
        let open = before + work - energy(&mut run) - ahead;
        assert!(open.abs() < SEAMS * work, "{name}: open by {:.1e} of the work", open / work);
    }
}

/// What `prepare` says of a plane of this normal in the bed, turned about `axis` in its second stage.
fn refusal(normal: Vec3, axis: Option<Vec3>) -> Option<String> {
    let mut w = bed();
    w.surfaces = vec![plane(normal, [0.0, 0.0, 1e-4])];
    let rotation = axis.map(|axis| Rotation { axis, center: [0.0; 3], rate: 2.0 });
    let moves = vec![(0, Motion { rotation, ..Motion::default() })];
    w.stages.push(Stage { name: "turn".to_owned(), moves, ..Stage::default() });
    prepare(w).err().map(|e| e.to_string())
}

#[test]
fn a_plane_that_does_not_repeat_is_refused() {
    let (up, aside) = ([0.0, 0.0, 1.0], unit(CELL[1]));
    assert_eq!(refusal(up, None), None);
    let tilted = refusal([0.0, 0.6, 0.8], None).unwrap();
    assert!(
        tilted.contains("`surface`") && tilted.contains("not parallel to the periodic axis y"),
        "{tilted}"
    );
    // A turn about its own normal leaves a plane where it is; one about a periodic axis turns it out of the other.
    assert_eq!(refusal(up, Some(up)), None);
    let turned = refusal(up, Some(aside)).unwrap();
    assert!(turned.contains("stage `turn`") && turned.contains("out of the periodic axis x"), "{turned}");
}

#[test]
fn a_mesh_of_very_many_periods_is_refused() {
    let mut w = bed();
    let (vertices, triangles) = rectangle([-4.0, -3.0], [4.0, 3.0]);
    w.surfaces = vec![mesh(vertices, triangles, Pose::default())];
    let error = prepare(w).err().unwrap().to_string();
    assert!(error.contains("`surface`") && error.contains("periods long"), "{error}");
}

/// A grain that overlaps a mesh only through the seam starts inside it all the same.
#[test]
fn a_grain_inside_a_mesh_beyond_the_seam_is_refused() {
    let mut w = bed();
    w.guards.overlap_stops = true;
    w.particles = ParticleSet::default();
    w.particles.push([0.0002, 0.006, 0.004], RADIUS, 0);
    let (vertices, triangles) = rectangle([-0.002; 2], [0.002; 2]);
    let upright = quaternion([0.0, 1.0, 0.0], std::f64::consts::FRAC_PI_2);
    let at = add([0.0, 0.006, 0.004], scale(CELL[0], 3.0));
    w.surfaces = vec![mesh(vertices, triangles, Pose { translation: at, rotation: upright })];
    let error = prepare(w).err().unwrap().to_string();
    assert!(error.contains("inside the surface `surface`"), "{error}");
}
