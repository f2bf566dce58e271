//! Positions as exact integers.
//!
//! Each axis of the cell is divided into `m` windows. A position is `x = origin + C·(hi + (lo + r)/2³²)/m`:
//! `lo: u32` the fraction of a window, `hi: i32` the window, `r: f32` the rest below one unit, |r| ≤ ½,
//! whose whole part is carried into `lo` and `hi` every step, so that creep of far less than a unit per
//! step is not lost.
//!
//! The difference of two particles closer than half a window is the wrapping difference of their `lo`:
//! exact, with the minimum image for free, and as fine for a 100 m domain as for a small one.

use crate::spec::{Domain, Side, Vec3};

/// Units per window.
pub const UNITS: f64 = 4_294_967_296.0;

/// A 3×3 matrix by rows.
pub type Vec3x3 = [Vec3; 3];

/// The windows of a world's cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// Corner of the cell \[m\].
    pub origin: Vec3,
    /// The cell matrix \[m\]; columns are the cell vectors.
    pub cell: Vec3x3,
    /// Windows along each axis, ≥ 1.
    pub windows: [u32; 3],
    /// Length of the cell along each axis in units: where the windows of an open axis end.
    pub extent: [i64; 3],
    /// Which axes wrap.
    pub periodic: [bool; 3],
    /// Matrix from units to metres; columns are the axes.
    pub unit: Vec3x3,
    /// Its inverse.
    pub inverse: Vec3x3,
    /// Perpendicular height of a window along each axis \[m\].
    pub height: Vec3,
    /// Whether `unit` is diagonal.
    pub orthogonal: bool,
}

/// An encoded position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Encoded {
    /// Window.
    pub hi: [i32; 3],
    /// Fraction of the window.
    pub lo: [u32; 3],
    /// Rest below one unit.
    pub rest: [f32; 3],
}

impl Lattice {
    /// The lattice of `domain` for particles that interact up to `cutoff` \[m\]: windows at least so many cut-offs
    /// high, 2.5 unless the cell is going to shrink.
    ///
    /// # Errors
    /// The axis of a periodic side that is lower than two cut-offs: a particle would meet its own image.
    pub fn new(domain: &Domain, cutoff: f64, window: f64) -> Result<Self, (usize, f64)> {
        let inverse = invert(&domain.cell);
        let mut windows = [1_u32; 3];
        let mut height = [0.0; 3];
        let mut extent = [0; 3];
        let mut share = [1.0; 3];
        let mut periodic = [false; 3];
        for k in 0..3 {
            let row = inverse[k];
            let h = 1.0 / dot(row, row).sqrt();
            periodic[k] = domain.sides[k][0] == Side::Periodic;
            if periodic[k] && h < 2.0 * cutoff {
                return Err((k, h));
            }
            windows[k] = (h / (window * cutoff)).floor().clamp(1.0, 1e9) as u32;
            height[k] = h / f64::from(windows[k]);
            if !periodic[k] && height[k] < window * cutoff {
                // A narrow domain: its one window reaches beyond it.
                share[k] = height[k] / (window * cutoff);
                height[k] = window * cutoff;
            }
            extent[k] = (f64::from(windows[k]) * UNITS * share[k]).round() as i64;
        }
        let mut unit = domain.cell;
        for row in &mut unit {
            for k in 0..3 {
                row[k] /= f64::from(windows[k]) * UNITS * share[k];
            }
        }
        Ok(Self {
            origin: domain.origin,
            cell: domain.cell,
            windows,
            extent,
            periodic,
            inverse: invert(&unit),
            orthogonal: diagonal(&unit),
            unit,
            height,
        })
    }

    /// The same windows in a cell that has deformed and is periodic along all axes: places keep their numbers.
    pub fn deformed(&self, cell: &Vec3x3) -> Self {
        let inverse = invert(cell);
        let windows = self.windows.map(f64::from);
        let unit = cell.map(|row| [0, 1, 2].map(|k| row[k] / (windows[k] * UNITS)));
        Self {
            cell: *cell,
            inverse: invert(&unit),
            orthogonal: diagonal(&unit),
            unit,
            height: [0, 1, 2].map(|k| 1.0 / (norm(inverse[k]) * windows[k])),
            ..self.clone()
        }
    }

    /// A difference of places in periods of the cell, 0 along axes that do not wrap.
    pub fn periods(&self, d: Vec3) -> Vec3 {
        let units = mul(&self.inverse, d);
        [0, 1, 2]
            .map(|k| if self.periodic[k] { units[k] / (f64::from(self.windows[k]) * UNITS) } else { 0.0 })
    }

    /// Encodes a position \[m\].
    pub fn encode(&self, x: Vec3) -> Encoded {
        let mut e = self.encode_beside(x);
        for k in 0..3 {
            e.hi[k] = self.wrapped(k, i64::from(e.hi[k]));
        }
        e
    }

    /// Encodes a position \[m\] that may be periods away from the cell, and stays there.
    pub fn encode_beside(&self, x: Vec3) -> Encoded {
        let d = sub(x, self.origin);
        let mut e = Encoded::default();
        for k in 0..3 {
            // Units as a double are exact to 2⁻²¹ of a unit in a 100 m domain of millimetre grains.
            let units = dot(self.inverse[k], d);
            let mut whole = units.round();
            let hi = (whole / UNITS).floor();
            e.rest[k] = (units - whole) as f32;
            whole -= hi * UNITS;
            e.lo[k] = whole as u64 as u32;
            e.hi[k] = hi as i32;
        }
        e
    }

    /// The window index with periodic axes wrapped.
    pub fn wrapped(&self, axis: usize, hi: i64) -> i32 {
        if self.periodic[axis] { hi.rem_euclid(i64::from(self.windows[axis])) as i32 } else { hi as i32 }
    }

    /// Position \[m\] of an encoded one.
    #[inline]
    pub fn decode(&self, hi: [i32; 3], lo: [u32; 3], rest: [f32; 3]) -> Vec3 {
        let u = |k: usize| f64::from(hi[k]) * UNITS + f64::from(lo[k]) + f64::from(rest[k]);
        add(self.origin, mul(&self.unit, [u(0), u(1), u(2)]))
    }

    /// The same place, or an image of it, where `periods` of the cell vector `onto` are taken off the vector `of`; both
    /// axes wrap. What is rounded is far below a unit.
    pub fn turned(&self, mut e: Encoded, onto: usize, of: usize, periods: i64) -> Encoded {
        let [n, m] = [onto, of].map(|k| i128::from(self.windows[k]));
        // The vector was the new one and so many periods along `onto`.
        let slid = i128::from(periods) * n;
        let along = slid * i128::from(Self::units(e.hi[of], e.lo[of]));
        let below = (along.rem_euclid(m) as f64 + slid as f64 * f64::from(e.rest[of])) / m as f64;
        let rest = f64::from(e.rest[onto]) + below;
        let whole =
            i128::from(Self::units(e.hi[onto], e.lo[onto])) + along.div_euclid(m) + rest.round() as i128;
        let units = whole.rem_euclid(n << 32) as i64;
        e.rest[onto] = (rest - rest.round()) as f32;
        e.hi[onto] = (units >> 32) as i32;
        e.lo[onto] = units as u32;
        e
    }

    /// Units from the origin along an axis, without the rest.
    pub fn units(hi: i32, lo: u32) -> i64 {
        (i64::from(hi) << 32) + i64::from(lo)
    }

    /// Units from `a` to `b` along an axis, to the nearest image where the axis wraps.
    pub fn difference(&self, axis: usize, a: i64, b: i64) -> i64 {
        let d = b - a;
        if !self.periodic[axis] {
            return d;
        }
        let span = i64::from(self.windows[axis]) << 32;
        let half = span / 2;
        // Most pairs are not across a seam, and a division takes longer than all else that is done to a pair.
        if (-half..half).contains(&d) {
            return d;
        }
        let d = d.rem_euclid(span);
        if d >= half { d - span } else { d }
    }

    /// The windows of `now` in the image nearest to `from`; both are places in windows and fractions.
    #[inline]
    pub fn unwrapped(&self, from: ([i32; 3], [u32; 3]), now: ([i32; 3], [u32; 3])) -> [i32; 3] {
        let mut hi = now.0;
        for k in (0..3).filter(|&k| self.periodic[k]) {
            let a = Self::units(from.0[k], from.1[k]);
            let b = Self::units(now.0[k], now.1[k]);
            hi[k] = ((a + self.difference(k, a, b)) >> 32) as i32;
        }
        hi
    }

    /// Metres of a difference in units.
    pub fn metres(&self, d: [i64; 3]) -> Vec3 {
        mul(&self.unit, d.map(|u| u as f64))
    }
}

fn diagonal(m: &Vec3x3) -> bool {
    (0..3).all(|r| (0..3).all(|c| r == c || m[r][c] == 0.0))
}

/// Inverse of a matrix given by rows.
fn invert(m: &[Vec3; 3]) -> [Vec3; 3] {
    let [a, b, c] = *m;
    // Columns of the inverse are cross products of the rows, over the determinant.
    let (p, q, r) = (cross(b, c), cross(c, a), cross(a, b));
    let det = dot(a, p);
    [0, 1, 2].map(|k| [p[k] / det, q[k] / det, r[k] / det])
}

/// Determinant of a matrix given by rows.
pub fn determinant(m: &[Vec3; 3]) -> f64 {
    dot(m[0], cross(m[1], m[2]))
}

/// `m·v` with `m` given by rows.
#[inline]
pub fn mul(m: &[Vec3; 3], v: Vec3) -> Vec3 {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}
/// `a b` with both given by rows.
pub fn product(a: &Vec3x3, b: &Vec3x3) -> Vec3x3 {
    a.map(|row| [0, 1, 2].map(|k| row[0] * b[0][k] + row[1] * b[1][k] + row[2] * b[2][k]))
}
/// `a·b`
#[inline]
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
/// `a × b`
#[inline]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
/// `a + b`
#[inline]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
/// `a - b`
#[inline]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
/// `s a`
#[inline]
pub fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}
/// `|a|`
#[inline]
pub fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}
