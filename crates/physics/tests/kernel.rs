//! The kernel functions against closed forms; the f64 twin against the f32 source.

use glebe_physics::kernel::tangential::{Friction, Spring, carried, slide};
use glebe_physics::kernel::triangle::closest_to_origin;
use glebe_physics::kernel::vector::{V3, length, minus, plus, scaled, v3};
use glebe_physics::kernel64;

/// A small generator of numbers in [-1, 1): tests need no more.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }
    fn vector(&mut self) -> V3 {
        v3(self.next(), self.next(), self.next())
    }
}

#[test]
fn closest_point_of_a_triangle_is_the_closest() {
    let mut r = Numbers(1);
    let mut seen = [0; 7];
    for _ in 0..2000 {
        let shift = r.vector();
        let [a, b, c] = [0; 3].map(|_| plus(r.vector(), shift));
        let found = closest_to_origin(a, b, c);
        seen[found.feature as usize] += 1;
        // No point of a fine grid of barycentric weights is closer.
        let n = 40;
        for i in 0..=n {
            for j in 0..=n - i {
                let (s, t) = (i as f32 / n as f32, j as f32 / n as f32);
                let p = plus(a, plus(scaled(minus(b, a), s), scaled(minus(c, a), t)));
                assert!(length(found.point) <= length(p) + 1e-5);
            }
        }
    }
    assert!(seen.iter().all(|&n| n > 20), "every feature is met: {seen:?}");
}

#[test]
fn turning_keeps_the_stretch_and_lays_it_on_the_plane() {
    let mut r = Numbers(2);
    for _ in 0..1000 {
        let n = r.vector();
        let n = scaled(n, 1.0 / length(n));
        let stretch = scaled(r.vector(), 1e-6);
        let turned = carried(stretch, n, 1e-3 * r.next());
        assert!((length(turned) - length(stretch)).abs() <= 1e-5 * length(stretch));
        let across = (turned.x * n.x + turned.y * n.y + turned.z * n.z).abs();
        assert!(across <= 1e-5 * length(stretch), "{across}");
    }
}

/// The slip bit: a contact pulled beyond μ0 Fn slides at μ Fn, and sticks again when it reverses.
#[test]
fn friction_drops_from_static_to_sliding_and_sticks_on_reversal() {
    let f = Friction { sliding: 0.4, sticking: 0.6, remember: 1.0, truncate: 1.0 };
    let spring = Spring { stiffness: 1e4, damping: 0.0 };
    let (load, dt) = (1.0, 1e-5);
    let (mut stretch, mut slip, mut peak) = (v3(0.0, 0.0, 0.0), 0.0, 0.0_f32);
    for _ in 0..2000 {
        let t = slide(stretch, slip, spring, f, load, v3(0.01, 0.0, 0.0), dt);
        (stretch, slip) = (t.stretch, t.slip);
        peak = peak.max(length(t.force));
    }
    assert!((peak - 0.6).abs() < 2e-3, "static friction holds up to μ0: {peak}");
    let t = slide(stretch, slip, spring, f, load, v3(0.01, 0.0, 0.0), dt);
    assert_eq!(t.slip, 1.0);
    assert!((length(t.force) - 0.4).abs() < 1e-6, "sliding at μ: {}", length(t.force));
    assert!(t.friction_loss > 0.0);
    let back = slide(stretch, slip, spring, f, load, v3(-0.01, 0.0, 0.0), dt);
    assert_eq!(back.slip, 0.0, "a reversed contact sticks");
}

#[test]
fn an_unbounded_spring_grows_while_the_force_stays_capped() {
    let f = Friction { sliding: 0.5, sticking: 0.5, remember: 1.0, truncate: 0.0 };
    let spring = Spring { stiffness: 1e4, damping: 0.0 };
    let mut stretch = v3(0.0, 0.0, 0.0);
    for _ in 0..1000 {
        let t = slide(stretch, 0.0, spring, f, 1.0, v3(0.1, 0.0, 0.0), 1e-5);
        stretch = t.stretch;
        assert!(length(t.force) <= 0.5 * (1.0 + 1e-6));
    }
    assert!((stretch.x - 1e-3).abs() < 1e-6, "{}", stretch.x);
}

#[test]
fn the_f64_twin_is_the_same_function() {
    let mut r = Numbers(3);
    for _ in 0..200 {
        let [a, b, c] = [0; 3].map(|_| r.vector());
        let wide = |v: V3| kernel64::vector::v3(v.x.into(), v.y.into(), v.z.into());
        let single = closest_to_origin(a, b, c);
        let double = kernel64::triangle::closest_to_origin(wide(a), wide(b), wide(c));
        assert!((f64::from(single.point.x) - double.point.x).abs() < 1e-3);
    }
}

/// Two spheres that turn about each other as one body, as a leap-frog sees them: from place to place they go along a
/// chord, and velocities and spins are those of its middle. With the levers of the end their contact slips by
/// `½ Δt v²/d`, with those of the middle not at all.
#[test]
fn bodies_that_turn_as_one_do_not_slip() {
    use kernel64::contact::{lagging_spin, relative_velocity};
    use kernel64::vector::{V3, cross, dot, length, minus, plus, scaled};
    let v = |x, y, z| V3 { x, y, z };
    let (axis, speed, dt) = (v(0.6, 0.0, 0.8), 40.0, 1e-4);
    let turned = |d: V3, angle: f64| {
        let along = scaled(axis, dot(axis, d) * (1.0 - angle.cos()));
        plus(plus(scaled(d, angle.cos()), scaled(cross(axis, d), angle.sin())), along)
    };
    let (arm_i, arm_j) = (1e-3, 9e-3);
    let before = v(0.008, 0.006, 0.0);
    let d = turned(before, speed * dt);
    let distance = length(d);
    let n = scaled(d, 1.0 / distance);
    // The chord is a little longer for its time than the arc.
    let half = 0.5 * speed * dt;
    let spin = scaled(axis, speed * half.tan() / half);
    let drift = v(0.3, -0.2, 0.1);
    let (vi, vj) = (drift, plus(drift, scaled(minus(d, before), 1.0 / dt)));
    let late = relative_velocity(vi, vj, spin, spin, n, arm_i, arm_j);
    let path = length(minus(vj, vi));
    let expected = 0.5 * dt * speed * path;
    assert!((length(late) / expected - 1.0).abs() < 1e-3, "{} instead of {expected} m/s", length(late));
    let slip = plus(late, lagging_spin(vi, vj, spin, spin, arm_i, arm_j, 0.5 * dt / distance));
    assert!(length(slip) < 1e-12 * path, "{slip:?} m/s");
}
