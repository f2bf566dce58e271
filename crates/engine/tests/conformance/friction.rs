//! Coulomb friction: the cap, sliding at constant μ, sticking and slipping.

use glebe_engine::lattice::{norm, sub};
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_physics::{ContactModel, LawInfo, Slot, laws};

use crate::support::{
    Run, Subject, Together, choice, e_star, each_law, grain, has_spring, label, open_world, plane,
    sphere_mass,
};

/// Relative error of sliding speeds and distances, whatever the step.
const SLIDING: f64 = 2e-3;

const RADIUS: f64 = 2e-3;
const STEPS: [f64; 3] = [8e-6, 3e-6, 1e-6];

pub fn total_force_stays_below_the_cap(on: &Subject) {
    const FRICTION: f64 = 0.3;
    let throws = [(0.05, 0.0), (0.5, 0.0), (0.0, 200.0), (0.3, -100.0)];
    // Of what other laws of cohesion pull, forces do not tell.
    let told = |m: &ContactModel| ["none", "constant"].contains(&m.cohesion.law.as_str());
    for contact in each_law().into_iter().filter(has_spring).filter(told) {
        let name = label(&contact);
        let attraction = contact.cohesion.parameters.iter().map(|p| p.1).sum::<f64>();
        let mut w = open_world([0.0; 3], 0.1, 2e-6, grain(0.5, FRICTION));
        w.contact = contact;
        for (k, (along, spin)) in throws.into_iter().enumerate() {
            let at = [0.0, 0.02 * k as f64, 1.001 * RADIUS];
            w.particles.push_moving(at, RADIUS, 0, [along, 0.0, -0.5], [0.0, spin, 0.0]);
        }
        w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
        let mut run = Run::new(on, w);
        let (mut touched, mut slipped) = ([0; 4], 0);
        for _ in 0..600 {
            run.steps(1);
            for (k, b) in run.bodies().iter().enumerate().filter(|(_, b)| b.force != [0.0; 3]) {
                let f = b.force;
                let (tangential, cap) = (norm([f[0], f[1], 0.0]), FRICTION * (f[2] + attraction).max(0.0));
                // The load is a difference of spring and dashpot; it vanishes at the end of a contact.
                assert!(
                    tangential <= cap * (1.0 + on.bounds.cap) + 1e-6,
                    "{name}: {tangential:e} N, the cap is {cap:e} N"
                );
                touched[k] += 1;
                slipped += u32::from(tangential > 0.999 * cap);
            }
        }
        assert!(touched.iter().all(|n| *n > 50), "{name}: {touched:?} steps in contact");
        assert!(slipped > 10, "{name}: slipped in {slipped} steps");
    }
}

/// Springs so short that their squares are next to nothing, as those of bodies that hardly slide, stay finite: devices
/// that take what is below 10⁻³⁸ for zero would divide by it.
pub fn a_spring_of_next_to_nothing_stays_finite(on: &Subject) {
    let mut w = open_world([0.0; 3], 0.1, 1e-6, grain(0.5, 0.5));
    w.gravity = [0.0; 3];
    let speeds = [1e-13, 3e-14, 1e-14, 1e-16];
    for (k, v) in speeds.into_iter().enumerate() {
        let y = 0.02 * k as f64;
        w.particles.push_moving([0.0, y, 0.0], RADIUS, 0, [v, 0.0, 0.0], [0.0; 3]);
        w.particles.push_moving([0.0, y, 1.999 * RADIUS], RADIUS, 0, [0.0; 3], [0.0; 3]);
    }
    let mut run = Run::new(on, w);
    run.steps(5);
    for (k, pair) in run.bodies().chunks(2).enumerate() {
        for b in pair {
            assert!(b.v.iter().chain(&b.w).chain(&b.force).all(|x| x.is_finite()), "{k}: {:?}", b.force);
            assert!(b.force[0].abs() < 1e-6 && b.force[2].abs() > 1e-5, "{k}: {:?} N", b.force);
        }
    }
    let state = run.state();
    assert_eq!(state.contacts.len(), speeds.len());
    for (m, v) in state.contacts.iter().zip(speeds) {
        // What slides for five steps of a microsecond.
        let most = 1e-5 * v;
        assert!(m.history.iter().all(|x| f64::from(x.abs()) <= most), "{v}: {:?}", m.history);
    }
}

/// A sphere launched on a plane without spin slides at `v0 - μ g t` until it rolls at 5/7 of its speed.
pub fn a_sphere_slides_until_it_rolls(on: &Subject) {
    const FRICTION: f64 = 0.2;
    const G: f64 = 9.81;
    const SPEED: f64 = 0.05;
    let mut m = grain(0.5, FRICTION);
    m.rolling_friction = 0.0;
    m.youngs_modulus = 5e6;
    let rolls = 2.0 * SPEED / (7.0 * FRICTION * G);
    // At rest on the plane from the start.
    let overlap = (0.75 * sphere_mass(RADIUS, &m) * G / (e_star(&m) * RADIUS.sqrt())).powf(2.0 / 3.0);
    for dt in STEPS {
        let mut w = open_world([0.0; 3], 0.1, dt, m.clone());
        w.gravity = [0.0, 0.0, -G];
        w.particles.push_moving([0.0, 0.0, RADIUS - overlap], RADIUS, 0, [SPEED, 0.0, 0.0], [0.0; 3]);
        w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
        let mut run = Run::new(on, w);
        let half = (0.5 * rolls / dt).round();
        run.steps(half as u64);
        let (b, t) = (run.bodies()[0], half * dt);
        let sliding = SPEED - FRICTION * G * t;
        let spin = 2.5 * FRICTION * G * t * (RADIUS - overlap) / (RADIUS * RADIUS);
        assert!((b.v[0] / sliding - 1.0).abs() < SLIDING, "dt {dt:e}: {} m/s instead of {sliding}", b.v[0]);
        assert!((b.w[1] / spin - 1.0).abs() < SLIDING, "dt {dt:e}: {} rad/s instead of {spin}", b.w[1]);
        run.steps((rolls / dt).round() as u64);
        let b = run.bodies()[0];
        let rolling = 5.0 / 7.0 * SPEED;
        assert!(
            (b.v[0] / rolling - 1.0).abs() < 2.0 * SLIDING,
            "dt {dt:e}: {} m/s instead of {rolling}",
            b.v[0]
        );
        let past = b.v[0] - b.w[1] * (RADIUS - overlap);
        assert!(past.abs() < SLIDING * SPEED, "dt {dt:e}: it still slides at {past:e} m/s");
    }
}

/// Rolling resistance slows a sphere that rolls on a plane by 5/7 μr g and holds it once it stands; twist about the
/// normal goes on.
pub fn rolling_resistance_stops_a_sphere(on: &Subject) {
    const G: f64 = 9.81;
    const SPEED: f64 = 0.05;
    const DT: f64 = 8e-6;
    const TWIST: f64 = 5.0;
    let mut m = grain(0.5, 0.5);
    m.youngs_modulus = 5e6;
    let slows = 5.0 / 7.0 * m.rolling_friction * G;
    let overlap = (0.75 * sphere_mass(RADIUS, &m) * G / (e_star(&m) * RADIUS.sqrt())).powf(2.0 / 3.0);
    // GPUDEM's torque acts against the whole spin.
    let twist = |law: &LawInfo| if law.name == "gpudem" { 0.0 } else { TWIST };
    // Springs resist otherwise, see `springs.rs`.
    let others = ["none", "epsd", "moment-rotation"];
    let resisting: Vec<_> = laws(Slot::Rolling).iter().filter(|law| !others.contains(&law.name)).collect();
    let worlds = resisting.iter().map(|law| {
        let mut w = open_world([0.0; 3], 0.1, DT, m.clone());
        w.contact.rolling = choice(law);
        w.gravity = [0.0, 0.0, -G];
        let spin = [0.0, SPEED / (RADIUS - overlap), twist(law)];
        w.particles.push_moving([0.0, 0.0, RADIUS - overlap], RADIUS, 0, [SPEED, 0.0, 0.0], spin);
        w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
        w
    });
    let mut batch = Together::new(on, worlds.collect());
    let half = (0.5 * SPEED / slows / DT).round();
    batch.steps(half as u64);
    let rolling = SPEED - slows * half * DT;
    for (k, law) in resisting.iter().enumerate() {
        let b = batch.bodies(k)[0];
        let error = (b.v[0] / rolling - 1.0).abs();
        assert!(error < SLIDING, "{}: {} m/s instead of {rolling}", law.name, b.v[0]);
        assert!((b.w[2] - twist(law)).abs() <= 1e-6 * TWIST, "{}: twist became {}", law.name, b.w[2]);
    }
    batch.steps(2 * half as u64);
    let stood: Vec<_> = (0..resisting.len()).map(|k| batch.bodies(k)[0]).collect();
    let way = 0.5 * SPEED * SPEED / slows;
    batch.steps(half as u64);
    for (k, law) in resisting.iter().enumerate() {
        let b = batch.bodies(k)[0];
        let error = (b.x[0] / way - 1.0).abs();
        assert!(error < SLIDING, "{}: it stands at {} instead of {way} m", law.name, b.x[0]);
        let drift = norm(sub(b.x, stood[k].x)) / RADIUS;
        assert!(drift < 1e-6, "{}: where it stood, it moved by {drift:.2e} radii", law.name);
    }
}

/// A sphere between two plates: pressed by a load on each, it cannot turn. It moves at `along` and is pulled by
/// `pull_share` of both loads. Returns load, mass and the stretch of the springs that holds the pull.
fn block(dt: f64, along: f64, pull_share: f64) -> (WorldSpec, [f64; 3]) {
    let overlap = 5e-3 * RADIUS;
    let mut m = grain(0.5, SLIDING_FRICTION);
    m.static_friction = STATIC_FRICTION;
    let load = 4.0 / 3.0 * e_star(&m) * RADIUS.sqrt() * overlap.powf(1.5);
    let mass = sphere_mass(RADIUS, &m);
    let nu = m.poissons_ratio;
    let g_star = m.youngs_modulus / (4.0 * (2.0 - nu) * (1.0 + nu));
    let stretch = pull_share * load / (8.0 * g_star * (RADIUS * overlap).sqrt());
    let mut w = open_world([0.0; 3], 10.0, dt, m);
    let pull = 2.0 * pull_share * load / mass;
    w.gravity = [pull, 0.0, 0.0];
    w.particles.push_moving([0.0; 3], RADIUS, 0, [along, 0.0, 0.0], [0.0; 3]);
    let height = RADIUS - overlap;
    w.surfaces =
        vec![plane([0.0, 0.0, 1.0], [0.0, 0.0, -height]), plane([0.0, 0.0, -1.0], [0.0, 0.0, height])];
    w.contact = ContactModel::default();
    (w, [load, mass, stretch])
}

const SLIDING_FRICTION: f64 = 0.3;
const STATIC_FRICTION: f64 = 0.5;

/// Pulled with a force between μ and μ0 times the load, a block at rest stays and a sliding one goes on, at
/// the same pace for every step; without the pull it stops and stays.
pub fn a_block_slides_and_sticks(on: &Subject) {
    const PULL: f64 = 0.4;
    const SPEED: f64 = 0.2;
    const DURATION: f64 = 2e-3;
    let after = |dt: f64, along: f64, pull: f64, duration: f64| -> (Vec3, Vec3, f64) {
        let (w, [load, mass, stretch]) = block(dt, along, pull);
        let mut run = Run::new(on, w);
        if along == 0.0 {
            // In balance: a pull that comes at once would overshoot and break the hold.
            run.steps(1).edit(|_, state| {
                state.particles.velocity[0].v = [0.0; 3];
                state.surface_contacts.iter_mut().for_each(|m| m.history[0] = stretch as f32);
            });
        }
        run.steps((duration / dt).round() as u64);
        let b = run.bodies()[0];
        assert_eq!(run.moment().surface_contacts, 2);
        (b.x, b.v, 2.0 * SLIDING_FRICTION * load / mass)
    };
    for dt in STEPS {
        let (x, v, _) = after(dt, 0.0, PULL, DURATION);
        assert!(
            x[0].abs() < 1e-4 * RADIUS && v[0].abs() < 1e-3 * SPEED,
            "dt {dt:e}: held, it went {x:?} at {v:?}"
        );

        let (_, v, friction) = after(dt, SPEED, PULL, DURATION);
        let gained = friction * (PULL / SLIDING_FRICTION - 1.0) * DURATION;
        let error = (v[0] - SPEED - gained).abs() / gained;
        assert!(error < 0.02, "dt {dt:e}: sliding, it gained {} instead of {gained} m/s", v[0] - SPEED);

        let stops = SPEED / friction;
        let (_, v, _) = after(dt, SPEED, 0.0, 0.5 * stops);
        assert!((v[0] / (0.5 * SPEED) - 1.0).abs() < 0.02, "dt {dt:e}: half way it moves at {} m/s", v[0]);
        let (x, v, _) = after(dt, SPEED, 0.0, 4.0 * stops);
        let way = 0.5 * SPEED * stops;
        assert!((x[0] / way - 1.0).abs() < 0.05, "dt {dt:e}: it stopped after {} instead of {way} m", x[0]);
        assert!(v[0].abs() < 0.05 * SPEED, "dt {dt:e}: it did not stop: {v:?}");
    }
}
