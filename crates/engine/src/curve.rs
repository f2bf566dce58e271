//! An order of particles in which those that are near in space are mostly near in number: that of Morton codes, whose
//! bits halve the domain again and again, always across its longest side. A code of b bits names one of 2ᵇ boxes of about
//! the same edges, whatever the shape of the domain.

use crate::lattice::{Lattice, UNITS};

/// Most bits of a code.
pub const BITS: u32 = 30;

/// Which axis each halving is across.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Curve {
    /// 0, 1 or 2, the first halving first.
    pub axes: [u8; BITS as usize],
}

impl Curve {
    /// Of a domain.
    pub fn of(lattice: &Lattice) -> Self {
        let mut edges = [0, 1, 2].map(|k| lattice.extent[k] as f64 / UNITS * lattice.height[k]);
        let axes = std::array::from_fn(|_| {
            let longest = (1..3).fold(0, |a, b| if edges[b] > edges[a] { b } else { a });
            edges[longest] *= 0.5;
            longest as u8
        });
        Self { axes }
    }

    /// Bits of codes for so many particles: one more than it takes to number them.
    pub fn bits(count: usize) -> u32 {
        (usize::BITS - count.saturating_sub(1).leading_zeros() + 1).min(BITS)
    }

    /// The code of a place, given as shares of the domain in units of 2⁻³².
    pub fn code(&self, bits: u32, mut share: [u32; 3]) -> u32 {
        let mut code = 0;
        for axis in &self.axes[..bits as usize] {
            let x = &mut share[usize::from(*axis)];
            code = 2 * code + (*x >> 31);
            *x <<= 1;
        }
        code
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spec::{Domain, Side};

    fn curve(edges: [f64; 3]) -> Curve {
        let domain = Domain::aligned([0.0; 3], edges, [[Side::Open; 2]; 3], None);
        Curve::of(&Lattice::new(&domain, 0.01, 2.5).expect("no side is periodic"))
    }

    #[test]
    fn long_sides_are_halved_first() {
        let c = curve([4.0, 1.0, 2.0]);
        assert_eq!(c.axes[..7], [0, 0, 2, 0, 1, 2, 0]);
        // Far along x and z, at the beginning of y.
        assert_eq!(c.code(4, [0xc000_0000, 0, 0x8000_0000]), 0b1110);
    }

    #[test]
    fn codes_have_room_for_two_boxes_per_particle() {
        assert_eq!([0, 1, 2, 3, 4, 5, 1000, 1024, 1025].map(Curve::bits), [1, 1, 2, 3, 3, 4, 11, 11, 12]);
        assert_eq!(Curve::bits(usize::MAX), BITS);
    }

    #[test]
    fn a_cube_is_filled_octant_by_octant() {
        let c = curve([1.0; 3]);
        let octant = |x: u32| [x & 1, x >> 1 & 1, x >> 2].map(|bit| bit << 31);
        let mut codes: Vec<u32> = (0..8).map(|x| c.code(3, octant(x))).collect();
        codes.sort_unstable();
        assert_eq!(codes, [0, 1, 2, 3, 4, 5, 6, 7]);
    }
}
