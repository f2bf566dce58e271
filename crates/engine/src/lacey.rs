//! How well a class of particles is mixed with the others: Lacey's index over a grid of samples.
//!
//! Lacey (Journal of Applied Chemistry 4, 257, 1954): `M = (S₀² - S²) / (S₀² - Sᵣ²)` with the variance S² of the
//! concentration over samples, that of the segregated state, `S₀² = p (1 - p)`, and that of a mixture at random, Sᵣ².
//! Concentrations are by volume, and samples count with the volume of the particles in them, so that samples at the edge
//! of a bed and grains of several sizes need no choice of a least number. Then
//!
//! - `S² = Σ Vₛ (xₛ - p)² / V`, with xₛ the share of the class in the volume Vₛ of sample s, p that in all;
//! - `Sᵣ² = (K - 1) N / (N - 1) · Σ vᵢ² (cᵢ - p)² / V²` for K samples with particles, N particles of volumes vᵢ, and cᵢ
//!   1 in the class and 0 outside. For equal volumes this is exactly the mean of S² over all ways to deal the particles
//!   out, `p (1 - p) (K - 1) / (N - 1)`, Lacey's `p (1 - p) / n` for samples of n in large beds.
//!
//! M is 0 where every sample holds one class alone, 1 on average after mixing at random, and may be a little above 1.

use crate::generate::solid_volume;
use crate::spec::{Class, Vec3};
use crate::state::State;

/// The index of a class over the samples of a box, whose particles count by their centre; none where there is nothing to
/// mix: one class alone, or one sample.
pub(crate) fn index(
    state: &State,
    positions: &[Vec3],
    class: Class,
    [min, max]: [Vec3; 2],
    samples: [usize; 3],
) -> Option<f64> {
    let counts = positions.iter().enumerate().filter_map(|(i, x)| {
        let at = cell(*x, [min, max], samples)?;
        let radius = f64::from(state.particles.place[i].radius);
        let belongs = match class {
            Class::Material(material) => state.particles.spin[i].material as usize == material,
            Class::RadiusAbove(limit) => radius > limit,
        };
        Some(Grain { sample: at, volume: solid_volume(&[radius]), belongs })
    });
    lacey(&counts.collect::<Vec<_>>(), samples.iter().product())
}

/// A particle of a sample.
struct Grain {
    sample: usize,
    volume: f64,
    belongs: bool,
}

/// The sample that a place belongs to.
fn cell(x: Vec3, [min, max]: [Vec3; 2], samples: [usize; 3]) -> Option<usize> {
    let along = |k: usize| {
        let share = (x[k] - min[k]) / (max[k] - min[k]);
        (0.0..1.0).contains(&share).then(|| ((share * samples[k] as f64) as usize).min(samples[k] - 1))
    };
    Some(along(0)? + samples[0] * (along(1)? + samples[1] * along(2)?))
}

fn lacey(grains: &[Grain], samples: usize) -> Option<f64> {
    let all: f64 = grains.iter().map(|g| g.volume).sum();
    let share = grains.iter().filter(|g| g.belongs).map(|g| g.volume).sum::<f64>() / all;
    let off = |g: &Grain| g.volume * (f64::from(u8::from(g.belongs)) - share);
    // Of each sample the volume, and that of the class beyond its share.
    let mut sums = vec![[0.0; 2]; samples];
    for g in grains {
        sums[g.sample][0] += g.volume;
        sums[g.sample][1] += off(g);
    }
    let filled = sums.iter().filter(|[volume, _]| *volume > 0.0);
    let (occupied, found) = filled.fold((0.0, 0.0), |(n, sum), [v, off]| (n + 1.0, sum + off * off / v));
    let (segregated, number) = (share * (1.0 - share), grains.len() as f64);
    let random =
        (occupied - 1.0) * number / (number - 1.0) * grains.iter().map(|g| off(g).powi(2)).sum::<f64>();
    let index = (segregated - found / all) / (segregated - random / (all * all));
    (segregated > 0.0 && occupied > 1.0 && index.is_finite()).then_some(index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Purpose, Rng};

    fn dealt(of: impl Iterator<Item = (usize, f64, bool)>) -> Vec<Grain> {
        of.map(|(sample, volume, belongs)| Grain { sample, volume, belongs }).collect()
    }

    #[test]
    fn pure_samples_have_the_index_0_whatever_their_sizes() {
        let equal = dealt((0..400).map(|i| (i / 10, 1.0, i < 200)));
        let mixed = dealt((0..400).map(|i| (i / 10, if i < 120 { 8.0 } else { 1.0 }, i < 120)));
        for grains in [equal, mixed] {
            let index = lacey(&grains, 50).unwrap();
            assert!(index.abs() < 1e-12, "{index}");
        }
    }

    #[test]
    fn equal_shares_in_all_samples_are_beyond_random_by_the_closed_form() {
        // Ten of twenty in each of forty samples: S² = 0 and M = 1 / (1 - (K - 1)/(N - 1)).
        let grains = dealt((0..800).map(|i| (i / 20, 2.0, i % 2 == 0)));
        let expected = 1.0 / (1.0 - 39.0 / 799.0);
        let index = lacey(&grains, 40).unwrap();
        assert!((index - expected).abs() < 1e-12, "{index} instead of {expected}");
    }

    #[test]
    fn dealt_at_random_the_index_is_1_on_average() {
        // Equal grains, and a class of eight times the volume: 2000 deals of 400 grains into 20 samples.
        for volume in [1.0, 8.0] {
            let mut mean = 0.0;
            let deals = 2000;
            for deal in 0..deals {
                let mut rng = Rng::of(7, Purpose::InletPlaces, [deal, 0]);
                let mut order: Vec<usize> = (0..400).collect();
                for k in (1..order.len()).rev() {
                    order.swap(k, (rng.between(0.0, (k + 1) as f64) as usize).min(k));
                }
                let grains = dealt(order.iter().enumerate().map(|(at, i)| {
                    let belongs = *i < 100;
                    (at / 20, if belongs { volume } else { 1.0 }, belongs)
                }));
                mean += lacey(&grains, 20).unwrap() / deals as f64;
            }
            // Equal grains: the formula is exact, the standard error of the mean 4e-4. Others: ratios of sums, to 2 %.
            let tolerance = if volume == 1.0 { 2e-3 } else { 2e-2 };
            assert!((mean - 1.0).abs() < tolerance, "{mean} for the volume {volume}");
        }
    }

    #[test]
    fn one_class_or_one_sample_has_no_index() {
        assert_eq!(lacey(&dealt((0..10).map(|i| (i, 1.0, true))), 10), None);
        assert_eq!(lacey(&dealt((0..10).map(|i| (0, 1.0, i < 5))), 1), None);
        assert_eq!(lacey(&[], 4), None);
    }

    #[test]
    fn places_belong_to_the_sample_around_them() {
        let bounds = [[0.0, 0.0, 1.0], [1.0, 2.0, 2.0]];
        assert_eq!(cell([0.1, 1.9, 1.5], bounds, [2, 4, 1]), Some(6));
        assert_eq!(cell([0.9, 0.1, 1.0], bounds, [2, 4, 1]), Some(1));
        assert_eq!(cell([0.9, 2.0, 1.5], bounds, [2, 4, 1]), None);
        assert_eq!(cell([0.9, 1.0, 0.9], bounds, [2, 4, 1]), None);
    }
}
