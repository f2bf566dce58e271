//! What particles come to at the end of a stage: the slope of a heap, the mass in a box, how they are
//! mixed.

use crate::batch::positions;
use crate::lacey;
use crate::lattice::{dot, norm, sub};
use crate::setup::Constants;
use crate::spec::{Surveyed, Vec3};
use crate::state::State;

/// The part of a heap's height, from its foot, along which its slope is fitted: foot and top are round.
const FLANK: [f64; 2] = [0.2, 0.8];
/// And at least so many mean diameters over the foot: what rolled away lies in one layer around the heap.
const LAYER: f64 = 1.5;
/// Fewest points of a flank.
const FEWEST: usize = 3;

/// What the particles of a state come to; none where there is no such thing, as the slope of a layer.
pub fn survey(c: &Constants, state: &State, of: &Surveyed) -> Option<f64> {
    let places = positions(c, state);
    let radius = |i: usize| f64::from(state.particles.place[i].radius);
    let value = match of {
        Surveyed::AngleOfRepose => {
            let g = norm(c.spec.gravity);
            let up = c.spec.gravity.map(|x| -x / g);
            let spheres: Vec<(Vec3, f64)> = places.iter().enumerate().map(|(i, x)| (*x, radius(i))).collect();
            angle_of_repose(&spheres, up)?
        }
        Surveyed::BulkDensity { min, max } => {
            let mass = |(i, x): (usize, &Vec3)| {
                let r = radius(i);
                let material = state.particles.spin[i].material as usize;
                let sphere = 4.0 / 3.0 * std::f64::consts::PI * r * r * r;
                let inside: f64 = (0..3).map(|k| share_between(x[k], r, [min[k], max[k]])).product();
                inside * sphere * c.spec.materials[material].density
            };
            let volume: f64 = (0..3).map(|k| max[k] - min[k]).product();
            places.iter().enumerate().map(mass).sum::<f64>() / volume
        }
        Surveyed::LaceyIndex { class, min, max, samples } => {
            lacey::index(state, &places, *class, [*min, *max], *samples)?
        }
    };
    value.is_finite().then_some(value)
}

/// The share of a sphere's volume between two planes across an axis. The product over three axes is the share within a box,
/// exactly where no more than one of its faces cuts the sphere.
fn share_between(x: f64, r: f64, [low, high]: [f64; 2]) -> f64 {
    // Below a plane at the height h over the centre: (2 + 3 h/r - (h/r)³)/4.
    let below = |plane: f64| {
        let h = ((plane - x) / r).clamp(-1.0, 1.0);
        0.25 * (2.0 + 3.0 * h - h * h * h)
    };
    below(high) - below(low)
}

/// The slope of a heap \[rad\]: highest points in rings about the axis through its middle, as wide as a mean sphere; a
/// straight line by least squares through those between 20 % and 80 % of its height, and above the lowest layer.
fn angle_of_repose(spheres: &[(Vec3, f64)], up: Vec3) -> Option<f64> {
    let weight: f64 = spheres.iter().map(|(_, r)| r * r * r).sum();
    let middle: Vec3 =
        std::array::from_fn(|k| spheres.iter().map(|(x, r)| r * r * r * x[k]).sum::<f64>() / weight);
    let width = 2.0 * spheres.iter().map(|(_, r)| r).sum::<f64>() / spheres.len() as f64;
    let heights = spheres.iter().map(|(x, r)| (dot(*x, up) - r, dot(*x, up) + r));
    let [foot, top] = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], (bottom, top)| {
        [low.min(bottom), high.max(top)]
    });
    // The highest point of each ring: its distance from the axis and its height.
    let mut rings: Vec<Option<[f64; 2]>> = Vec::new();
    for (x, r) in spheres {
        let out = sub(*x, middle);
        let along = dot(out, up);
        let distance = (dot(out, out) - along * along).max(0.0).sqrt();
        let ring = (distance / width) as usize;
        // What lies that far out is no heap.
        if ring > 1_000_000 {
            return None;
        }
        if rings.len() <= ring {
            rings.resize(ring + 1, None);
        }
        let height = dot(*x, up) + r - foot;
        if rings[ring].is_none_or(|highest| highest[1] < height) {
            rings[ring] = Some([distance, height]);
        }
    }
    let [low, high] = FLANK.map(|share| share * (top - foot));
    let flank = low.max(LAYER * width)..=high;
    let points: Vec<[f64; 2]> = rings.into_iter().flatten().filter(|p| flank.contains(&p[1])).collect();
    if points.len() < FEWEST {
        return None;
    }
    let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / points.len() as f64;
    let [x, y] = [mean(0), mean(1)];
    let (xx, xy) = points
        .iter()
        .fold((0.0, 0.0), |(xx, xy), p| (xx + (p[0] - x) * (p[0] - x), xy + (p[0] - x) * (p[1] - y)));
    Some((-xy / xx).atan())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_cone_is_found_about_any_axis() {
        for (angle, up) in [(20.0_f64, [0.0, 0.0, 1.0]), (33.0, [0.0, 0.6, 0.8])] {
            let slope = angle.to_radians().tan();
            let (r, height) = (0.01, 1.0);
            // Grains fill a cone on a fine grid; x goes along the horizontal, z up, then both are turned with `up`.
            let across = [0.0, up[2], -up[1]];
            let n = (height / slope / (2.0 * r)) as i32;
            let mut spheres = Vec::new();
            for i in -n..=n {
                for j in -n..=n {
                    let (a, b) = (2.0 * r * f64::from(i), 2.0 * r * f64::from(j));
                    let top = height - a.hypot(b) * slope;
                    if top > 2.0 * r {
                        let x = std::array::from_fn(|k| {
                            5.0 + [a, 0.0, 0.0][k] + b * across[k] + (top - r) * up[k]
                        });
                        spheres.push((x, r));
                    }
                }
            }
            // Something at the foot, so that its height is known.
            spheres.push((std::array::from_fn(|k| 5.0 + r * up[k]), r));
            let found = angle_of_repose(&spheres, up).unwrap().to_degrees();
            assert!((found - angle).abs() < 0.5, "{found} for {angle}");
        }
        let layer: Vec<(Vec3, f64)> = (0..100).map(|i| ([f64::from(i), 0.0, 0.0], 0.5)).collect();
        assert_eq!(angle_of_repose(&layer, [0.0, 0.0, 1.0]), None, "a layer has no slope");
    }

    #[test]
    fn a_sphere_is_shared_by_the_planes_that_cut_it() {
        assert_eq!(share_between(0.0, 1.0, [-1.0, 1.0]), 1.0);
        assert_eq!(share_between(0.0, 1.0, [0.0, 5.0]), 0.5);
        assert_eq!(share_between(3.0, 1.0, [-1.0, 2.0]), 0.0);
        // A cap of the height r/2 is 5/32 of the sphere.
        assert!((share_between(0.0, 1.0, [0.5, 2.0]) - 5.0 / 32.0).abs() < 1e-15);
    }
}
