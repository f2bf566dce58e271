//! Which spheres may be close: cells, in one level per size class, so that the cost stays linear when
//! radii differ much (a hierarchical grid; Ogarko and Luding 2012, Comput. Phys. Commun. 183, 931).

use super::region::Region;
use crate::spec::Vec3;

/// The end of a cell's list.
const NONE: u32 = u32::MAX;

/// Spheres by cells. Spheres are inserted in the order of [`Grid::coarse_first`], and each sees those
/// inserted before it: so every pair is visited once, and always from its finer side, whose search is
/// short.
pub(super) struct Grid {
    bounds: Region,
    /// Added to the sum of two radii: how far apart the surfaces of visited pairs may be \[m\].
    gap: f64,
    radii: Vec<f64>,
    levels: Vec<Level>,
    level_of: Vec<u8>,
    /// Next sphere in the same cell.
    next: Vec<u32>,
}

/// The cells of spheres of one size class.
struct Level {
    radius_max: f64,
    cells: [usize; 3],
    /// Cells per metre.
    per_metre: Vec3,
    /// First sphere of each cell.
    head: Vec<u32>,
}

impl Grid {
    /// An empty grid over `bounds`, for spheres of the given radii whose surfaces are up to `gap` apart.
    /// Spheres outside the bounds are found too, only slower.
    pub(super) fn new(bounds: Region, radii: &[f64], gap: f64) -> Self {
        let largest = radii.iter().copied().fold(0.0, f64::max);
        // Class k holds radii in (largest / 2^(k+1), largest / 2^k].
        let class = |radius: f64| libm::floor(libm::log2(largest / radius)).clamp(0.0, 60.0) as u8;
        let classes: Vec<u8> = radii.iter().map(|&r| class(r)).collect();
        let mut sizes = [(0_usize, 0.0_f64); 61];
        for (&class, &radius) in classes.iter().zip(radii) {
            let (count, radius_max) = &mut sizes[class as usize];
            *count += 1;
            *radius_max = radius_max.max(radius);
        }
        let mut levels = Vec::new();
        let mut level_of_class = [0_u8; 61];
        for (class, &(count, radius_max)) in sizes.iter().enumerate().filter(|(_, size)| size.0 > 0) {
            level_of_class[class] = levels.len() as u8;
            levels.push(Level::new(&bounds, count, radius_max, gap));
        }
        let level_of = classes.iter().map(|&class| level_of_class[class as usize]).collect();
        Self { bounds, gap, radii: radii.to_vec(), levels, level_of, next: vec![NONE; radii.len()] }
    }

    /// All spheres, larger classes first.
    pub(super) fn coarse_first(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.radii.len()).collect();
        order.sort_by_key(|&i| self.level_of[i]);
        order
    }

    /// Puts sphere `i` at `x`; once per sphere.
    pub(super) fn insert(&mut self, i: usize, x: Vec3) {
        let level = &mut self.levels[self.level_of[i] as usize];
        let cell = [0, 1, 2].map(|k| level.cell(&self.bounds, k, x[k]));
        let head = &mut level.head[cell[0] + level.cells[0] * (cell[1] + level.cells[1] * cell[2])];
        self.next[i] = *head;
        *head = i as u32;
    }

    /// Calls `f` with every inserted sphere of the same or a larger class whose surface may be within
    /// the gap of sphere `i` at `x`, once each.
    #[inline]
    pub(super) fn visit(&self, i: usize, x: Vec3, mut f: impl FnMut(usize)) {
        for level in &self.levels[..=self.level_of[i] as usize] {
            let reach = self.radii[i] + level.radius_max + self.gap;
            let [xs, ys, zs] = [0, 1, 2].map(|k| level.span(&self.bounds, k, x[k], reach));
            for z in zs.clone() {
                for y in ys.clone() {
                    let row = level.cells[0] * (y % level.cells[1] + level.cells[1] * (z % level.cells[2]));
                    for x in xs.clone() {
                        let mut j = level.head[row + x % level.cells[0]];
                        while j != NONE {
                            f(j as usize);
                            j = self.next[j as usize];
                        }
                    }
                }
            }
        }
    }
}

impl Level {
    fn new(bounds: &Region, count: usize, radius_max: f64, gap: f64) -> Self {
        // Cells grow until they are not many more than spheres, so that a few spheres far apart do not
        // take all memory.
        let mut edge = (2.0 * radius_max + gap).max(f64::MIN_POSITIVE);
        let cells = loop {
            let cells = [0, 1, 2].map(|k| ((bounds.width(k) / edge) as usize).clamp(1, 1_000_000));
            if cells[0] * cells[1] * cells[2] <= 2 * count + 8 {
                break cells;
            }
            edge *= 1.25;
        };
        let per_metre = [0, 1, 2].map(|k| {
            let width = bounds.width(k);
            if width > 0.0 && width.is_finite() { cells[k] as f64 / width } else { 0.0 }
        });
        Self { radius_max, cells, per_metre, head: vec![NONE; cells[0] * cells[1] * cells[2]] }
    }

    /// The cell along axis `k` of a coordinate inside; of one outside, the nearest.
    fn cell(&self, bounds: &Region, k: usize, x: f64) -> usize {
        (((x - bounds.min[k]) * self.per_metre[k]) as usize).min(self.cells[k] - 1)
    }

    /// The cells along axis `k` that meet `x ± reach`; of a periodic axis, to be taken modulo their number.
    fn span(&self, bounds: &Region, k: usize, x: f64, reach: f64) -> std::ops::Range<usize> {
        if !bounds.periodic[k] {
            return self.cell(bounds, k, x - reach)..self.cell(bounds, k, x + reach) + 1;
        }
        let low = libm::floor((x - reach - bounds.min[k]) * self.per_metre[k]);
        let high = libm::floor((x + reach - bounds.min[k]) * self.per_metre[k]);
        let count = (high - low) as usize + 1;
        let first = low.rem_euclid(self.cells[k] as f64) as usize;
        first..first + count.min(self.cells[k])
    }
}
