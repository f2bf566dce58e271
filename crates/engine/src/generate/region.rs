//! Where spheres are put, and measures of how they lie there.

use std::f64::consts::PI;

use super::grid::Grid;
use crate::spec::Vec3;

/// Spheres whose surfaces meet closer than this share of the smaller radius touch and do not overlap:
/// coordinates are rounded.
const TOUCHING: f64 = 1e-9;

/// An axis-aligned box; along periodic axes it repeats, along the others its sides are walls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Corner of least coordinates \[m\].
    pub min: Vec3,
    /// Corner of greatest coordinates \[m\].
    pub max: Vec3,
    /// Which axes are periodic.
    pub periodic: [bool; 3],
}

impl Region {
    /// A box with walls on all sides, from `min` to `max` \[m\].
    pub fn walled(min: Vec3, max: Vec3) -> Self {
        Self { min, max, periodic: [false; 3] }
    }

    /// Its width along `axis` \[m\].
    pub fn width(&self, axis: usize) -> f64 {
        self.max[axis] - self.min[axis]
    }

    /// Its volume \[m³\].
    pub fn volume(&self) -> f64 {
        self.width(0) * self.width(1) * self.width(2)
    }

    /// The coordinates along `axis` that the centre of a sphere may have \[m\].
    pub(super) fn reach(&self, axis: usize, radius: f64) -> (f64, f64) {
        if self.periodic[axis] {
            (self.min[axis], self.max[axis])
        } else {
            let low = self.min[axis] + radius;
            // Where a sphere just fits, rounding must not turn the interval round.
            (low, (self.max[axis] - radius).max(low))
        }
    }

    /// The image of `x` inside, along periodic axes; elsewhere unchanged.
    pub(super) fn wrap(&self, x: Vec3) -> Vec3 {
        [0, 1, 2].map(|k| {
            if !self.periodic[k] {
                return x[k];
            }
            let inside = self.min[k] + (x[k] - self.min[k]).rem_euclid(self.width(k));
            // Rounding can give the far side itself, which is the near side.
            if inside < self.max[k] { inside } else { self.min[k] }
        })
    }

    pub(super) fn images(&self) -> Images {
        let width = [0, 1, 2].map(|k| self.width(k));
        Images {
            width,
            half: [0, 1, 2].map(|k| if self.periodic[k] { 0.5 * width[k] } else { f64::INFINITY }),
        }
    }
}

/// Differences of positions to the nearest image, for positions less than a period apart from inside.
#[derive(Clone, Copy)]
pub(super) struct Images {
    width: Vec3,
    half: Vec3,
}

impl Images {
    #[inline]
    pub(super) fn difference(&self, a: Vec3, b: Vec3) -> Vec3 {
        [0, 1, 2].map(|k| {
            let d = a[k] - b[k];
            if d > self.half[k] {
                d - self.width[k]
            } else if d < -self.half[k] {
                d + self.width[k]
            } else {
                d
            }
        })
    }

    #[inline]
    pub(super) fn distance_squared(&self, a: Vec3, b: Vec3) -> f64 {
        let d = self.difference(a, b);
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    }
}

/// The pair of spheres that overlap most, relative to the smaller of the two: their indices and
/// `(r_a + r_b - distance) / min(r_a, r_b)`; `None` if no two overlap.
///
/// `positions` \[m\] and `radii` \[m\] have one entry per sphere; spheres may lie outside the region,
/// whose walls do not matter here. Along a periodic axis nearest images count, which needs a period of
/// at least four of the largest radius. The cost grows linearly with the number of spheres, whatever
/// their sizes. Spheres whose coordinates are not finite overlap nothing.
pub fn worst_overlap(positions: &[Vec3], radii: &[f64], region: &Region) -> Option<(usize, usize, f64)> {
    let n = positions.len().min(radii.len());
    let positions: Vec<Vec3> = positions[..n].iter().map(|&x| region.wrap(x)).collect();
    let radii = &radii[..n];
    let mut bounds = *region;
    for k in (0..3).filter(|&k| !region.periodic[k]) {
        let along = || positions.iter().map(|x| x[k]).filter(|x| x.is_finite());
        bounds.min[k] = along().fold(f64::INFINITY, f64::min);
        bounds.max[k] = along().fold(f64::NEG_INFINITY, f64::max);
    }
    let mut grid = Grid::new(bounds, radii, 0.0);
    let images = region.images();
    let mut worst: Option<(usize, usize, f64)> = None;
    for i in grid.coarse_first() {
        let x = positions[i];
        grid.visit(i, x, |j| {
            let touch = radii[i] + radii[j];
            let square = images.distance_squared(x, positions[j]);
            if square < touch * touch {
                let share = (touch - square.sqrt()) / radii[i].min(radii[j]);
                if share > worst.map_or(TOUCHING, |w| w.2) {
                    worst = Some((i.min(j), i.max(j), share));
                }
            }
        });
        grid.insert(i, x);
    }
    worst
}

/// Volume of all spheres \[m³\] of the given radii \[m\].
pub fn solid_volume(radii: &[f64]) -> f64 {
    4.0 / 3.0 * PI * radii.iter().map(|r| r * r * r).sum::<f64>()
}

/// Share of the region's volume \[-\] that spheres of the given radii \[m\] take when all lie in it.
pub fn solid_fraction(radii: &[f64], region: &Region) -> f64 {
    solid_volume(radii) / region.volume()
}
