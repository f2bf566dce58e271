//! What inlets and outlets do to a state, and what is refused.

use super::faces::CLEAR;
use super::*;
use crate::prepare;
use crate::spec::{Domain, Stage, Step, Time};
use crate::state::ContactMemory;
use glebe_physics::{IntegratorKind, Material};

const GRAINS: f64 = 1e-3;

fn world(outlets: Vec<Outlet>, rate: f64) -> WorldSpec {
    let domain = Domain::aligned([0.0; 3], [0.02; 3], [[Side::Periodic; 2]; 3], None);
    let time = Time { step: Step::Fixed(1e-6), integrator: IntegratorKind::Euler, force: true };
    let mut w = WorldSpec::new(domain, time);
    w.materials = vec![Material {
        name: "grain".to_owned(),
        density: 2500.0,
        youngs_modulus: 1e7,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.0,
    }];
    w.stages = vec![Stage { name: "run".to_owned(), ..Stage::default() }];
    let sizes = SizeDistribution::Uniform { min: 0.5 * GRAINS, max: GRAINS };
    w.inlets.push(Inlet {
        name: "feed".to_owned(),
        room: Room::Box { min: [0.0, 0.0, 0.01], max: [0.02; 3] },
        supply: Supply::Number(rate, Grains { material: 0, sizes }),
        velocity: [0.0, 0.0, -1.0],
        most: None,
        every: 1e-3,
        stages: None,
    });
    w.outlets = outlets;
    w
}

/// Those that stay keep what they remember, bit for bit; those that go take it along; new ones have none.
#[test]
fn survivors_keep_their_memory() {
    let room = Room::Sphere { center: [0.004, 0.004, 0.004], radius: 0.001 };
    let outlet = Outlet { name: "drain".to_owned(), room, every: 1e-3, stages: None };
    let mut w = world(vec![outlet], 2000.0);
    for x in [0.004, 0.006, 0.008] {
        w.particles.push([x, 0.004, 0.004], GRAINS, 0);
    }
    let (c, mut state) = prepare(w).unwrap();
    let memory = |a: u8, b: u8| ContactMemory {
        id: [a, b].map(u32::from),
        history: [0.1 + f32::from(a), -0.3, 1e-30, 7.0].into(),
    };
    state.contacts = vec![memory(0, 1), memory(1, 2)];
    state.progress.step = 1000;
    c.accrue(&mut state.progress);
    let (entered, changed) = c.exchange(&mut state);
    assert!(changed && entered > 0.0);
    assert_eq!(state.contacts, [memory(1, 2)]);
    assert_eq!(state.particles.id, [1, 2, 3, 4]);
    assert_eq!((state.progress.outlets[0].particles, state.progress.inlets[0].made), (1, 2));
    assert_eq!(c.count_now(&state.progress), 4);
}

/// What finds no room waits; what found room touches nothing, through periodic seams either.
#[test]
fn particles_come_where_there_is_room() {
    let (c, mut state) = prepare(world(Vec::new(), 1e6)).unwrap();
    state.progress.step = 1000;
    c.accrue(&mut state.progress);
    c.exchange(&mut state);
    let (n, inlet) = (state.particles.len(), &state.progress.inlets[0]);
    assert!((200..1000).contains(&n), "{n}");
    assert!((inlet.owed + n as f64 - 1000.0).abs() < 1e-6);
    let x = positions(&c, &state);
    for i in 0..n {
        for j in 0..i {
            let mut d = sub(x[i], x[j]);
            for k in 0..3 {
                d[k] -= 0.02 * (d[k] / 0.02).round();
            }
            let [a, b] = [i, j].map(|k| f64::from(state.particles.place[k].radius));
            assert!(norm(d) > (a + b) * (1.0 - 1e-6), "{i} and {j}");
        }
    }
    assert!(x.iter().all(|x| (0.01..=0.02).contains(&x[2])));
}

#[test]
fn rooms_hold_what_they_draw() {
    let rooms = [
        Room::Box { min: [-1.0, 0.0, 2.0], max: [0.0, 0.5, 3.0] },
        Room::Cylinder { from: [0.0, 1.0, 0.0], to: [0.7, 1.5, -1.0], radius: 0.3 },
        Room::Sphere { center: [1.0, 2.0, 3.0], radius: 0.4 },
    ];
    let mut rng = Rng::new(3, Purpose::InletPlaces);
    for room in rooms {
        let [low, high] = room.bounds().unwrap();
        let mut mean = [0.0; 3];
        for _ in 0..4000 {
            let x = room.draw(0.1, [false; 3], &mut rng);
            assert!(room.contains(x), "{room:?} {x:?}");
            assert!((0..3).all(|k| x[k] >= low[k] + 0.0999 && x[k] <= high[k] - 0.0999), "{room:?} {x:?}");
            mean = add(mean, scale(x, 1.0 / 4000.0));
        }
        // Evenly: the mean is the middle.
        assert!((0..3).all(|k| (mean[k] - 0.5 * (low[k] + high[k])).abs() < 0.03), "{room:?} {mean:?}");
    }
}

#[test]
fn what_cannot_work_is_refused() {
    let why = |change: &dyn Fn(&mut WorldSpec)| {
        let mut w = world(Vec::new(), 10.0);
        change(&mut w);
        prepare(w).unwrap_err().to_string()
    };
    let thin = why(&|w| w.inlets[0].room = Room::Box { min: [0.0; 3], max: [0.02, 0.02, 0.001] });
    assert!(thin.contains("does not fit into the region of the inlet `feed`"), "{thin}");
    let beyond = why(&|w| w.inlets[0].room = Room::Box { min: [0.0; 3], max: [0.02, 0.02, 0.03] });
    assert!(beyond.contains("along z, beyond the domain of 0 to 0.02 m"), "{beyond}");
    let endless = why(&|w| w.inlets[0].room = Room::Beyond { axis: [0.0, 0.0, 1.0], limit: 0.0 });
    assert!(endless.contains("has no end"), "{endless}");
    let flat = why(&|w| {
        w.domain.sides = [[Side::Open; 2]; 3];
        w.surfaces = ramp().surfaces;
        w.surfaces[0].shape = Shape::Plane { normal: [0.0, 0.0, 1.0] };
        w.inlets[0].room = Room::Surface(0);
    });
    assert!(flat.contains("on a surface that is no mesh"), "{flat}");
    let foreign = why(&|w| w.inlets[0].supply = Supply::Outlet(0));
    assert!(foreign.contains("an outlet that does not exist"), "{foreign}");
    let stage = why(&|w| w.inlets[0].stages = Some(vec![1]));
    assert!(stage.contains("a stage that does not exist"), "{stage}");
}

/// A ramp of one wide and one narrow face in the open, as an inlet.
fn ramp() -> WorldSpec {
    let mut w = world(Vec::new(), 4000.0);
    w.domain.sides = [[Side::Open; 2]; 3];
    let vertices =
        vec![[0.002, 0.004, 0.004], [0.014, 0.004, 0.004], [0.014, 0.016, 0.008], [0.005, 0.016, 0.008]];
    let mesh = crate::spec::TriMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] };
    w.surfaces.push(crate::spec::Surface {
        name: "ramp".to_owned(),
        material: 0,
        shape: Shape::Mesh(std::sync::Arc::new(mesh)),
        pose: crate::spec::Pose::default(),
        motion: crate::spec::Motion::default(),
        absent: false,
    });
    w.inlets[0].room = Room::Surface(0);
    w
}

/// Spheres come off the faces of a mesh, evenly over their area, touch them and are on the side of the normal, also if the
/// mesh waits; and no more come than was foreseen.
#[test]
fn particles_come_off_the_faces_of_a_mesh() {
    for absent in [false, true] {
        let mut w = ramp();
        w.surfaces[0].absent = absent;
        w.stages[0].until.at_most = Some(0.01);
        let (c, mut state) = prepare(w).unwrap();
        assert_eq!(c.most_to_come(), Some(40));
        for row in 1..=10 {
            state.progress.step = 1000 * row;
            c.accrue(&mut state.progress);
            c.exchange(&mut state);
            // The next ones find the faces free again.
            for hi in &mut state.particles.hi {
                hi[2] += 1;
            }
        }
        assert_eq!(state.particles.len(), 40);
    }
    let (c, state) = prepare(ramp()).unwrap();
    let faces = c.faces(0, &state.progress).unwrap();
    let n = scale([0.0, -0.004, 0.012], 1.0 / norm([0.0, -0.004, 0.012]));
    let mut rng = Rng::new(3, Purpose::InletPlaces);
    let radius = 0.6 * GRAINS;
    let first = (0..4000).filter(|_| {
        let x = faces.draw(radius, &mut rng);
        let height = dot(n, sub(x, [0.002, 0.004, 0.004]));
        assert!((height / radius - (1.0 + CLEAR)).abs() < 1e-9, "{height}");
        let on = sub(x, scale(n, height));
        assert!((0.004..=0.016).contains(&on[1]) && (0.002..=0.014).contains(&on[0]), "{on:?}");
        assert!(!c.meets_surface(&state.progress, x, radius));
        // Below the diagonal from (2, 4) to (14, 16) mm.
        on[0] - 0.002 > on[1] - 0.004
    });
    // Areas are as 12 to 9; the standard deviation of the share is 0.008.
    let share = first.count() as f64 / 4000.0;
    assert!((share - 12.0 / 21.0).abs() < 0.03, "{share}");
}

/// What will come is known ahead: by mass to the particle, in stages that have an end, or not at all.
#[test]
fn what_will_come_is_counted() {
    let mut w = world(Vec::new(), 1000.0);
    assert_eq!(prepare(w.clone()).unwrap().0.most_to_come(), Some(0), "a stage without an end only acts");
    w.stages[0].until.kinetic_energy_below = Some(1.0);
    assert_eq!(prepare(w.clone()).unwrap().0.most_to_come(), None);
    w.inlets[0].most = Some(1e-4);
    let by_mass = prepare(w.clone()).unwrap().0.most_to_come().unwrap();
    // Radii of 0.5 to 1 mm, 2500 kg/m³: 4.9 mg on average.
    assert!((15..26).contains(&by_mass), "{by_mass}");
    w.stages[0].until.at_most = Some(0.0055);
    assert_eq!(prepare(w.clone()).unwrap().0.most_to_come(), Some(5));
    let Supply::Number(rate, _) = &mut w.inlets[0].supply else { panic!("another supply") };
    *rate = 1e9;
    w.inlets[0].most = None;
    let many = prepare(w).unwrap().0.most_to_come().unwrap();
    assert!((5_499_999..=5_500_001).contains(&many), "{many}");
}
