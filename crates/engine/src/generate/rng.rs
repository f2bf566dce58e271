//! Random numbers with the same bits on every platform and in every later version of glebe.

/// The golden ratio's fraction in 64 bits, odd: the increment of SplitMix64.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// What a stream of numbers is for, so that sizes and positions made from one seed are independent.
#[derive(Clone, Copy, Debug)]
pub enum Purpose {
    /// Radii of particles.
    Sizes = 1,
    /// Their positions.
    Positions = 2,
    /// Values of parameters from world to world.
    Samples = 3,
    /// Radii of particles that come through inlets.
    InletSizes = 4,
    /// Their positions.
    InletPlaces = 5,
}

/// SplitMix64 (Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators"): a
/// counter and a mixing function.
#[derive(Clone, Debug)]
pub struct Rng(u64);

impl Rng {
    /// A stream of its own for each seed and purpose.
    pub fn new(seed: u64, purpose: Purpose) -> Self {
        // Mixed, because seeds 1, 2, 3 … and purposes must not start at neighbouring counters.
        Self(mix(mix(seed) ^ (purpose as u64).wrapping_mul(GOLDEN)))
    }

    /// A stream of its own for each seed, purpose and two numbers.
    pub fn of(seed: u64, purpose: Purpose, numbers: [u64; 2]) -> Self {
        let Self(start) = Self::new(seed, purpose);
        Self(numbers.into_iter().fold(start, |state, n| mix(state ^ mix(n.wrapping_add(GOLDEN)))))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        mix(self.0)
    }

    /// Uniform in [0, 1), a multiple of 2⁻⁵³.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Uniform in [low, high).
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Standard normal, by the polar method (Marsaglia and Bray 1964). The second value is dropped:
    /// a generator without hidden state is worth the logarithm.
    pub fn normal(&mut self) -> f64 {
        loop {
            let (u, v) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                // libm's, not std's: std calls the platform's, whose last bit differs.
                return u * (-2.0 * libm::log(s) / s).sqrt();
            }
        }
    }

    /// The numbers 0 … n-1 in random order (Fisher-Yates).
    pub fn permutation(&mut self, n: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..n).collect();
        for last in (1..n).rev() {
            // The high word of a product; its bias, n / 2⁶⁴, is far below what can be seen.
            let pick = ((u128::from(self.bits()) * (last as u128 + 1)) >> 64) as usize;
            order.swap(last, pick);
        }
        order
    }
}

/// SplitMix64's output function.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
