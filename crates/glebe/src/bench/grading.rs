//! How large the spheres of a bed are.

use glebe_engine::generate::{GenerateError, SizeDistribution};
use glebe_physics::{LawChoice, Material};

/// Sizes of a bed's particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BedKind {
    /// R = 2 mm, step 1e-5 s.
    Mono,
    /// R = 1.6 to 2.4 mm, evenly by number, step 9e-6 s.
    Poly,
    /// R = 1 to 3 mm, equal volumes in equal ratios of size, step 5e-6 s.
    #[value(name = "1:3")]
    OneToThree,
    /// R = 1 to 10 mm, equal volumes in equal ratios of size, step 5e-6 s.
    #[value(name = "1:10")]
    OneToTen,
    /// R = 1 to 20 mm, equal volumes in equal ratios of size, step 5e-6 s.
    #[value(name = "1:20")]
    OneToTwenty,
    /// Soft soil, R = 7 to 10 mm, evenly by number, step 1e-4 s.
    Soil,
    /// What other engines are compared on: R = 1.6 to 2.4 mm, soft, no rolling resistance, step 2e-5 s.
    Peers,
}

impl BedKind {
    /// Every kind.
    pub const ALL: [Self; 7] = [
        Self::Mono,
        Self::Poly,
        Self::OneToThree,
        Self::OneToTen,
        Self::OneToTwenty,
        Self::Soil,
        Self::Peers,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono => "mono",
            Self::Poly => "poly",
            Self::OneToThree => "1:3",
            Self::OneToTen => "1:10",
            Self::OneToTwenty => "1:20",
            Self::Soil => "soil",
            Self::Peers => "peers",
        }
    }

    /// Least and largest radius \[m\].
    pub fn radii(self) -> [f64; 2] {
        match self {
            Self::Mono => [2e-3; 2],
            Self::Poly | Self::Peers => [1.6e-3, 2.4e-3],
            Self::OneToThree => [1e-3, 3e-3],
            Self::OneToTen => [1e-3, 1e-2],
            Self::OneToTwenty => [1e-3, 2e-2],
            Self::Soil => [7e-3, 1e-2],
        }
    }

    /// How radii are spread between the least and the largest.
    pub fn grading(self) -> &'static str {
        match self {
            Self::Mono => "equal radii",
            Self::Poly | Self::Soil | Self::Peers => "even by number",
            Self::OneToThree | Self::OneToTen | Self::OneToTwenty => "equal volumes in equal ratios of size",
        }
    }

    /// Time step \[s\]: 25 to 29 % of the Rayleigh time of the smallest; 13 % for soil (the main job's), 20 % for
    /// the bed of other engines.
    pub fn step(self) -> f64 {
        match self {
            Self::Mono => 1e-5,
            Self::Poly => 9e-6,
            Self::OneToThree | Self::OneToTen | Self::OneToTwenty => 5e-6,
            Self::Soil => 1e-4,
            Self::Peers => 2e-5,
        }
    }

    /// What the spheres are made of: glass, or the soil of the tillage template.
    pub fn material(self) -> Material {
        let glass = Material {
            name: "glass".to_owned(),
            density: 2600.0,
            youngs_modulus: 2e8,
            poissons_ratio: 0.3,
            restitution: 0.5,
            friction: 0.5,
            static_friction: 0.5,
            rolling_friction: 0.01,
        };
        match self {
            Self::Soil => Material {
                name: "soil".to_owned(),
                density: 1850.0,
                youngs_modulus: 2e6,
                poissons_ratio: 0.38,
                friction: 0.6,
                static_friction: 0.7,
                rolling_friction: 0.03,
                ..glass
            },
            Self::Peers => Material { youngs_modulus: 2e7, ..glass },
            _ => glass,
        }
    }

    /// The law of rolling resistance.
    pub fn rolling(self) -> LawChoice {
        LawChoice::named(if self == Self::Peers { "none" } else { "constant-torque" })
    }

    /// The radii of `count` spheres \[m\].
    pub fn spheres(self, count: usize, seed: u64) -> Result<Vec<f64>, GenerateError> {
        let [min, max] = self.radii();
        match self {
            Self::Mono => SizeDistribution::Constant(min).sample(count, seed),
            Self::Poly | Self::Soil | Self::Peers => {
                SizeDistribution::Uniform { min, max }.sample(count, seed)
            }
            Self::OneToThree | Self::OneToTen | Self::OneToTwenty => Ok(equal_volumes(min, max, count)),
        }
    }
}

/// Radii such that every octave between `min` and `max` holds the same volume, so that small spheres are
/// many and large ones are much: the number of radii above r falls as r⁻³. The radii are its quantiles in
/// the middles of `count` equal parts, so that few spheres too have both ends.
fn equal_volumes(min: f64, max: f64, count: usize) -> Vec<f64> {
    let [most, least] = [min, max].map(|r: f64| r.powi(-3));
    let share = |i: usize| (i as f64 + 0.5) / count as f64;
    (0..count).map(|i| (most + share(i) * (least - most)).cbrt().recip()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_gradings_hold_equal_volumes_in_equal_ratios_of_size() {
        for kind in [BedKind::OneToThree, BedKind::OneToTen, BedKind::OneToTwenty] {
            let [min, max] = kind.radii();
            let radii = kind.spheres(100_000, 1).unwrap();
            assert!(radii.iter().all(|r| (min..=max).contains(r)));
            // Four classes, each from the same ratio of sizes.
            let mut volumes = [0.0; 4];
            for r in radii {
                let class = 4.0 * (r / min).ln() / (max / min).ln();
                volumes[class as usize] += r.powi(3);
            }
            let all: f64 = volumes.iter().sum();
            for v in volumes {
                assert!((v / all - 0.25).abs() < 5e-3, "{}: {volumes:?}", kind.name());
            }
        }
    }
}
