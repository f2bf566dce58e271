//! Which way the contacts of a sample point.

use std::f64::consts::TAU;

use glebe_engine::Constants;
use glebe_engine::lattice::{Lattice, norm};
use glebe_engine::state::State;
use serde::{Deserialize, Serialize};

/// Bins of a turn.
pub const BINS: usize = 36;

/// How many contacts point which way, in two planes: each contact once, from the particle of the smaller number to the
/// other, by the angle from the plane's first axis.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Orientations {
    /// In the plane of x and y, [`BINS`] of them.
    pub xy: Vec<u32>,
    /// In the plane of x and z.
    pub xz: Vec<u32>,
}

impl Orientations {
    /// Of the particles of a world that touch, by their places: spheres that overlap.
    pub(super) fn of(c: &Constants, state: &State) -> Self {
        let lattice = c.lattice_now(&state.progress);
        let p = &state.particles;
        let mut found = Self { xy: vec![0; BINS], xz: vec![0; BINS] };
        let units = |i: usize, k: usize| Lattice::units(p.hi[i][k], p.place[i].lo[k]);
        for i in 0..p.len() {
            for j in i + 1..p.len() {
                let d = lattice.metres([0, 1, 2].map(|k| lattice.difference(k, units(i, k), units(j, k))));
                let touch = f64::from(p.place[i].radius) + f64::from(p.place[j].radius);
                if norm(d) < touch {
                    let sign = if p.id[i] < p.id[j] { 1.0 } else { -1.0 };
                    found.add(d.map(|x| sign * x));
                }
            }
        }
        found
    }

    fn add(&mut self, d: [f64; 3]) {
        for (bins, [a, b]) in [(&mut self.xy, [0, 1]), (&mut self.xz, [0, 2])] {
            let turn = libm::atan2(d[b], d[a]) / TAU;
            let bin = (turn.rem_euclid(1.0) * BINS as f64) as usize % BINS;
            if let Some(count) = bins.get_mut(bin) {
                *count += 1;
            }
        }
    }
}

/// `χ² = Σ (O - E)²/E` of counts against equal ones (Pearson). Of independent directions it has a mean of one less than
/// there are bins, however many there are; divided by their number it falls with it.
pub fn chi_square(counts: &[u32]) -> f64 {
    let all: f64 = counts.iter().map(|n| f64::from(*n)).sum();
    let expected = all / counts.len() as f64;
    counts.iter().map(|n| (f64::from(*n) - expected).powi(2) / expected).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_fall_into_their_bins() {
        let mut found = Orientations { xy: vec![0; BINS], xz: vec![0; BINS] };
        found.add([1.0, 1e-3, -1e-3]);
        found.add([0.0, 1.0, 0.1]);
        found.add([-1.0, -1e-9, 0.0]);
        assert_eq!((found.xy[0], found.xy[9], found.xy[18]), (1, 1, 1));
        assert_eq!((found.xz[35], found.xz[9], found.xz[18]), (1, 1, 1));
    }

    #[test]
    fn chi_square_is_that_of_the_textbook() {
        // Ten throws of each of two sides, found 12 and 8: (2² + 2²)/10.
        assert!((chi_square(&[12, 8]) - 0.8).abs() < 1e-15);
        assert_eq!(chi_square(&[5; 36]), 0.0);
    }
}
