//! Particle generators: size statistics, and packings that are what they promise.

// Clippy's permission for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use glebe_engine::generate::{
    FillRequest, GenerateError, Region, SizeDistribution, fills, generate, solid_fraction, solid_volume,
    worst_overlap,
};

const UNIFORM: SizeDistribution = SizeDistribution::Uniform { min: 1.6e-3, max: 2.4e-3 };

/// Three kinds of soil: equal, uniform 1.6-2.4 mm, and large spheres among many of a third of their size.
fn soils(n: usize) -> [(&'static str, Vec<f64>); 3] {
    let mixture = (0..n).map(|i| if i % 8 == 0 { 3e-3 } else { 1e-3 }).collect();
    [("equal", vec![2e-3; n]), ("uniform", UNIFORM.sample(n, 3).unwrap()), ("1:3", mixture)]
}

/// A region with a square floor and more height than the spheres need at `fraction`; about a cube of it
/// gets filled.
fn roomy(radii: &[f64], fraction: f64, periodic: [bool; 3]) -> Region {
    let side = (solid_volume(radii) / fraction).cbrt();
    Region { min: [-0.3, 0.1, 2.0], max: [-0.3 + side, 0.1 + side, 2.0 + 2.5 * side], periodic }
}

fn asked(region: Region, radii: &[f64], seed: u64, fraction: f64) -> FillRequest<'_> {
    FillRequest { solid_fraction: Some(fraction), ..FillRequest::new(region, radii, seed) }
}

/// Centres keep a radius from walls and stay inside periodic sides.
fn assert_inside(label: &str, positions: &[[f64; 3]], radii: &[f64], region: &Region) {
    assert_eq!(positions.len(), radii.len(), "{label}");
    for (i, (x, r)) in positions.iter().zip(radii).enumerate() {
        for k in 0..3 {
            let inside = if region.periodic[k] {
                x[k] >= region.min[k] && x[k] < region.max[k]
            } else {
                x[k] - r >= region.min[k] - 1e-12 && x[k] + r <= region.max[k] + 1e-12
            };
            assert!(inside, "{label}: sphere {i} of radius {r} at {x:?} leaves {region:?} along axis {k}");
        }
    }
}

/// Solid fraction of the layer from the floor to the highest sphere's top.
fn reached_fraction(positions: &[[f64; 3]], radii: &[f64], region: &Region, up: usize) -> f64 {
    let mut layer = *region;
    layer.max[up] = positions.iter().zip(radii).map(|(x, r)| x[up] + r).fold(f64::MIN, f64::max);
    solid_fraction(radii, &layer)
}

fn mean_and_std(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt())
}

/// Asserts mean and standard deviation within four standard errors; that of the deviation follows from
/// the fourth moment (`kurtosis`: 1.8 uniform, 3 normal).
fn assert_moments(values: &[f64], mean: f64, std: f64, kurtosis: f64) {
    let n = values.len() as f64;
    let (got_mean, got_std) = mean_and_std(values);
    let mean_error = std / n.sqrt();
    let std_error = std * ((kurtosis - 1.0) / (4.0 * n)).sqrt();
    assert!((got_mean - mean).abs() < 4.0 * mean_error, "mean {got_mean}, not {mean} ± {mean_error}");
    assert!((got_std - std).abs() < 4.0 * std_error, "std {got_std}, not {std} ± {std_error}");
}

#[test]
fn sizes_have_the_moments_of_their_distribution() {
    let n = 100_000;
    assert_eq!(SizeDistribution::Constant(0.02).sample(3, 1).unwrap(), [0.02; 3]);
    assert_moments(&UNIFORM.sample(n, 1).unwrap(), 2e-3, 0.8e-3 / 12_f64.sqrt(), 1.8);
    let normal = SizeDistribution::Normal { mean: 5e-3, std: 0.5e-3, min: 1e-3, max: 9e-3 };
    assert_moments(&normal.sample(n, 1).unwrap(), 5e-3, 0.5e-3, 3.0);
    let lognormal = SizeDistribution::LogNormal { median: 4e-3, sigma: 0.4, min: 1e-5, max: 1.0 };
    let logs: Vec<f64> = lognormal.sample(n, 1).unwrap().iter().map(|r| r.ln()).collect();
    assert_moments(&logs, 4e-3_f64.ln(), 0.4, 3.0);
}

/// Share of the mass below a radius.
fn finer(radii: &[f64], limit: f64) -> f64 {
    let mass = |below: f64| radii.iter().filter(|r| **r < below).map(|r| r * r * r).sum::<f64>();
    mass(limit) / mass(f64::INFINITY)
}

#[test]
fn a_sieve_curve_is_met_by_mass() {
    // Nothing between 2 and 3 mm.
    let curve = [(1e-3, 0.0), (2e-3, 0.3), (3e-3, 0.3), (4e-3, 0.8), (8e-3, 1.0)];
    let sizes = SizeDistribution::Sieve(curve.to_vec());
    assert_eq!(sizes.limits(), (1e-3, 8e-3));
    let radii = sizes.sample(20_000, 3).unwrap();
    assert_eq!(radii, sizes.sample(20_000, 3).unwrap());
    assert_ne!(radii, sizes.sample(20_000, 4).unwrap());
    assert!(radii.iter().all(|r| (1e-3..=8e-3).contains(r) && !(2.0001e-3..2.9999e-3).contains(r)));
    for (radius, share) in curve {
        assert!((finer(&radii, radius) - share).abs() < 2e-3, "{radius}: {}", finer(&radii, radius));
    }
    // Straight lines in a diagram over the logarithm of size.
    for (from, to) in [(0, 1), (2, 3), (3, 4)] {
        let ((a, low), (b, high)) = (curve[from], curve[to]);
        let middle = finer(&radii, (a * b).sqrt());
        assert!((middle - 0.5 * (low + high)).abs() < 4e-3, "{middle} between {a} and {b}");
    }
    // Few particles: the largest class, half of one particle by number, is not left to chance.
    let shares: Vec<f64> = (0..50).map(|seed| finer(&sizes.sample(500, seed).unwrap(), 4e-3)).collect();
    let mean = shares.iter().sum::<f64>() / 50.0;
    assert!((mean - 0.8).abs() < 0.02, "{mean}");
    assert!(shares.iter().all(|share| (share - 0.8).abs() < 0.1), "{shares:?}");
}

#[test]
fn truncated_sizes_are_drawn_again_not_clipped() {
    // A normal distribution cut at ± one deviation: std² = 1 - 2 φ(1) / (2 Φ(1) - 1), textbook.
    let cut = SizeDistribution::Normal { mean: 5e-3, std: 1e-3, min: 4e-3, max: 6e-3 };
    let radii = cut.sample(100_000, 4).unwrap();
    assert!(radii.iter().all(|r| (4e-3..=6e-3).contains(r)));
    let (phi, inside): (f64, f64) = (0.241_970_724_519_143_37, 0.682_689_492_137_085_9);
    let std = 1e-3 * (1.0 - 2.0 * phi / inside).sqrt();
    // Flatter than a normal distribution: the bound of a kurtosis of 3 holds.
    assert_moments(&radii, 5e-3, std, 3.0);
    assert_eq!(radii.iter().filter(|r| **r == 4e-3 || **r == 6e-3).count(), 0);
}

#[test]
fn sizes_repeat_to_the_bit_and_differ_between_seeds() {
    let normal = SizeDistribution::LogNormal { median: 5e-3, sigma: 0.3, min: 1e-3, max: 9e-3 };
    assert_eq!(normal.sample(50, 7).unwrap(), normal.sample(50, 7).unwrap());
    assert_ne!(normal.sample(50, 7).unwrap(), normal.sample(50, 8).unwrap());
    // These bits are part of the promise: the same on every platform and in every version.
    let bits: Vec<u64> = normal.sample(2, 7).unwrap().iter().map(|r| r.to_bits()).collect();
    // An independent program gives them too.
    assert_eq!(bits, [4575844559568239729, 4570508461458782888]);
}

#[test]
fn bad_sizes_say_which_value_and_what_is_allowed() {
    let message = |sizes: SizeDistribution| sizes.sample(10, 1).unwrap_err().to_string();
    assert!(
        message(SizeDistribution::Constant(-1e-3))
            .contains("constant radius is -0.001: it must be finite and above 0")
    );
    assert!(message(SizeDistribution::Constant(f64::NAN)).contains("NaN"));
    assert!(message(SizeDistribution::Uniform { min: 2e-3, max: 1e-3 }).contains("at least min = 0.002"));
    let normal = SizeDistribution::Normal { mean: 5e-3, std: -1.0, min: 1e-3, max: 9e-3 };
    assert!(message(normal).contains("normal.std is -1: it must be finite and at least 0"));
    let lognormal = SizeDistribution::LogNormal { median: 0.0, sigma: 0.1, min: 1e-3, max: 9e-3 };
    assert!(message(lognormal).contains("log_normal.median is 0"));
    let sieve = |points: &[(f64, f64)]| message(SizeDistribution::Sieve(points.to_vec()));
    assert!(sieve(&[(1e-3, 0.0)]).contains("two or more"));
    assert!(sieve(&[(1e-3, 0.1), (2e-3, 1.0)]).contains("0 at the finest radius and 1 at the coarsest"));
    assert!(sieve(&[(1e-3, 0.0), (2e-3, 0.9)]).contains("0.9"));
    assert!(sieve(&[(2e-3, 0.0), (2e-3, 1.0)]).contains("larger than the one before it"));
    assert!(
        sieve(&[(1e-3, 0.0), (2e-3, 0.6), (3e-3, 0.5), (4e-3, 1.0)]).contains("not below the one before it")
    );
    assert!(sieve(&[(0.0, 0.0), (2e-3, 1.0)]).contains("above 0"));
    let never = SizeDistribution::Normal { mean: 5e-3, std: 1e-4, min: 1e-2, max: 2e-2 };
    assert!(message(never).contains("widen the limits"));
}

#[test]
fn worst_overlap_is_that_of_all_pairs() {
    // Random places without any care, radii 1:10, periodic along x: the grid must agree with all pairs.
    let sizes = SizeDistribution::LogNormal { median: 3e-3, sigma: 0.8, min: 1e-3, max: 1e-2 };
    let region = Region { min: [0.0; 3], max: [0.2, 0.1, 0.1], periodic: [true, false, false] };
    let mut pairs = 0;
    for seed in 0..40 {
        let radii = sizes.sample(50, seed).unwrap();
        let scatter = SizeDistribution::Uniform { min: 1e-9, max: 0.1 }.sample(150, seed + 1000).unwrap();
        let at: Vec<[f64; 3]> = scatter.chunks(3).map(|c| [2.0 * c[0], c[1], c[2]]).collect();
        let mut worst: Option<(usize, usize, f64)> = None;
        for i in 0..50 {
            for j in i + 1..50 {
                let mut d = [at[i][0] - at[j][0], at[i][1] - at[j][1], at[i][2] - at[j][2]];
                d[0] -= 0.2 * (d[0] / 0.2).round();
                let distance = d.iter().map(|d| d * d).sum::<f64>().sqrt();
                let share = (radii[i] + radii[j] - distance) / radii[i].min(radii[j]);
                if share > worst.map_or(0.0, |w| w.2) {
                    worst = Some((i, j, share));
                }
            }
        }
        pairs += usize::from(worst.is_some());
        let found = worst_overlap(&at, &radii, &region);
        assert_eq!(found.map(|w| (w.0, w.1)), worst.map(|w| (w.0, w.1)), "seed {seed}");
        assert!((found.map_or(0.0, |w| w.2) - worst.map_or(0.0, |w| w.2)).abs() < 1e-9, "seed {seed}");
    }
    assert!(pairs > 20, "only {pairs} of 40 clouds had an overlap to find");
}

#[test]
fn worst_overlap_sees_through_periodic_sides_and_beyond_the_region() {
    let mut region = Region::walled([0.0; 3], [1.0; 3]);
    let at = [[0.05, 0.5, 0.5], [0.98, 0.5, 0.5], [7.0, 8.0, 9.0], [7.0, 8.0, 9.05], [f64::NAN, 0.0, 0.0]];
    let radii = [0.1, 0.1, 0.03, 0.03, 0.1];
    let (i, j, share) = worst_overlap(&at, &radii, &region).unwrap();
    assert_eq!((i, j), (2, 3));
    assert!((share - 1.0 / 3.0).abs() < 1e-9);
    region.periodic[0] = true;
    let (i, j, share) = worst_overlap(&at, &radii, &region).unwrap();
    assert_eq!((i, j), (0, 1));
    assert!((share - 1.3).abs() < 1e-9);
    assert_eq!(worst_overlap(&[], &[], &region), None);
    // Touching is not overlapping.
    let walled = Region::walled([0.0; 3], [1.0; 3]);
    assert_eq!(worst_overlap(&[[0.1, 0.0, 0.0], [0.3, 0.0, 0.0]], &[0.1, 0.1], &walled), None);
}

/// What every registered fill promises, whoever adds one.
#[test]
fn every_fill_stays_inside_repeats_to_the_bit_and_knows_its_limits() {
    for fill in fills() {
        let fraction = fill.fraction_default.unwrap_or(0.2);
        for (soil, radii) in soils(800) {
            for periodic in [[false; 3], [true, true, false], [false, true, false]] {
                let label = format!("{} {soil} {periodic:?}", fill.name);
                let region = roomy(&radii, fraction * 0.9, periodic);
                let made = generate(fill.name, &FillRequest::new(region, &radii, 5)).unwrap();
                assert_inside(&label, &made, &radii, &region);
                let overlap = worst_overlap(&made, &radii, &region).map_or(0.0, |worst| worst.2);
                let allowed = if fill.name == "dense" { 0.01 } else { 0.0 };
                assert!(overlap <= allowed, "{label}: overlap {overlap}");
                let again = generate(fill.name, &FillRequest::new(region, &radii, 5)).unwrap();
                assert_eq!(made, again, "{label}");
                if fill.name != "lattice" {
                    let other = generate(fill.name, &FillRequest::new(region, &radii, 6)).unwrap();
                    assert_ne!(made, other, "{label}");
                }
            }
        }
        let radii = [1e-3; 10];
        let region = Region::walled([0.0; 3], [1.0; 3]);
        for fraction in [0.0, -0.1, f64::NAN, fill.fraction_max + 0.01] {
            let error = generate(fill.name, &asked(region, &radii, 1, fraction)).unwrap_err().to_string();
            assert!(error.contains("solid_fraction is") && error.contains("at most"), "{error}");
        }
        assert_eq!(generate(fill.name, &FillRequest::new(region, &[], 1)).unwrap().len(), 0);
        // A shaft as wide as the sphere leaves no choice but the height.
        let shaft = Region::walled([0.0; 3], [1.0, 1.0, 2.0]);
        let made = generate(fill.name, &FillRequest::new(shaft, &[0.5], 1)).unwrap();
        assert_eq!(made[0][..2], [0.5; 2], "{}", fill.name);
        assert_inside(fill.name, &made, &[0.5], &shaft);
    }
}

#[test]
fn dense_reaches_sixty_percent_without_deep_overlaps() {
    for (soil, radii) in soils(4000) {
        for periodic in [[false; 3], [true, true, false]] {
            let region = roomy(&radii, 0.60, periodic);
            let made = generate("dense", &asked(region, &radii, 2, 0.60)).unwrap();
            assert_inside(soil, &made, &radii, &region);
            let overlap = worst_overlap(&made, &radii, &region).map_or(0.0, |worst| worst.2);
            assert!(overlap <= 0.01, "{soil}: {overlap}");
            let reached = reached_fraction(&made, &radii, &region, 2);
            assert!((reached / 0.60 - 1.0).abs() < 0.01, "{soil}: {reached}");
        }
    }
}

#[test]
fn dense_fills_a_fully_periodic_cell() {
    let radii = UNIFORM.sample(1000, 1).unwrap();
    let side = (solid_volume(&radii) / 0.6).cbrt();
    let region = Region { min: [0.0; 3], max: [side; 3], periodic: [true; 3] };
    let made = generate("dense", &FillRequest::new(region, &radii, 2)).unwrap();
    assert!(worst_overlap(&made, &radii, &region).map_or(0.0, |worst| worst.2) <= 0.01);
    let error = generate("dense", &asked(region, &radii, 2, 0.5)).unwrap_err().to_string();
    assert!(error.contains("0.6000") && error.contains("periodic along `up`"), "{error}");
}

#[test]
fn rain_and_random_give_the_solid_fraction_asked_for() {
    for (fill, fraction) in [("rain", 0.3), ("rain", 0.45), ("random", 0.3)] {
        for (soil, radii) in soils(3000) {
            let region = roomy(&radii, fraction, [true, true, false]);
            let made = generate(fill, &asked(region, &radii, 2, fraction)).unwrap();
            assert_inside(soil, &made, &radii, &region);
            assert_eq!(worst_overlap(&made, &radii, &region), None, "{fill} {soil}");
            let reached = reached_fraction(&made, &radii, &region, 2);
            assert!((reached / fraction - 1.0).abs() < 0.01, "{fill} {soil}: {reached}, not {fraction}");
        }
    }
}

#[test]
fn rain_is_disordered_and_mixes_sizes() {
    // Sorted radii, so that any trace of the input's order shows as a gradient of sizes.
    let mut radii = UNIFORM.sample(4000, 9).unwrap();
    radii.sort_by(f64::total_cmp);
    let region = roomy(&radii, 0.3, [false; 3]);
    let made = generate("rain", &FillRequest::new(region, &radii, 1)).unwrap();
    let (mean_radius, std_radius) = mean_and_std(&radii);
    for k in 0..3 {
        let along: Vec<f64> = made.iter().map(|x| x[k]).collect();
        let (mean, std) = mean_and_std(&along);
        let sum: f64 = along.iter().zip(&radii).map(|(x, r)| (x - mean) * (r - mean_radius)).sum();
        let correlation = sum / (radii.len() as f64 * std * std_radius);
        assert!(correlation.abs() < 4.0 / (radii.len() as f64).sqrt(), "axis {k}: {correlation}");
        // Of a lattice, coordinates fall on few values: the Fourier sum at its pitch is near 1.
        for pitch in (20..80).map(|tenths| tenths as f64 * 1e-4) {
            let phase = |x: &f64| 2.0 * std::f64::consts::PI * x / pitch;
            let (c, s) = along.iter().fold((0.0, 0.0), |(c, s), x| (c + phase(x).cos(), s + phase(x).sin()));
            let order = (c * c + s * s).sqrt() / along.len() as f64;
            assert!(order < 0.15, "axis {k}: order {order} at a pitch of {pitch}");
        }
    }
}

#[test]
fn the_floor_is_on_the_axis_of_gravity() {
    for fill in fills() {
        let radii = UNIFORM.sample(500, 1).unwrap();
        for up in 0..3 {
            let mut region = Region::walled([-1.0; 3], [-0.96; 3]);
            region.max[up] = 1.0;
            let made = generate(fill.name, &FillRequest { up, ..asked(region, &radii, 1, 0.25) }).unwrap();
            let top = made.iter().map(|x| x[up]).fold(f64::MIN, f64::max);
            assert!(top < -0.9, "{}: pile along axis {up} reaches {top}", fill.name);
        }
    }
}

#[test]
fn lattice_fills_rows_from_the_floor() {
    let radii = [0.05; 30];
    let region = Region { min: [0.0; 3], max: [0.3, 0.45, 1.0], periodic: [false, true, false] };
    let made = generate("lattice", &FillRequest::new(region, &radii, 1)).unwrap();
    let first_row: Vec<f64> = made[..3].iter().map(|x| x[0]).collect();
    for (got, want) in first_row.iter().zip([0.05, 0.15, 0.25]) {
        assert!((got - want).abs() < 1e-12);
    }
    let layers = |z: f64| made.iter().filter(|x| (x[2] - z).abs() < 1e-12).count();
    assert_eq!([layers(0.05), layers(0.15), layers(0.25)], [12, 12, 6]);
    let error = generate("lattice", &FillRequest::new(region, &[0.05; 121], 1)).unwrap_err();
    assert!(matches!(error, GenerateError::NoRoom { placed: 120, count: 121, .. }), "{error}");
}

#[test]
fn spheres_that_do_not_fit_are_refused_with_numbers_and_advice() {
    let radii = vec![8.5e-3; 38912];
    let region = Region::walled([0.0; 3], [0.7, 0.6, 0.5]);
    let error = generate("rain", &FillRequest::new(region, &radii, 1)).unwrap_err().to_string();
    let needed =
        "38912 spheres need 3.337e-1 m³ at a solid fraction of 0.300, 159 % of the region's 2.100e-1 m³";
    assert!(error.contains(needed), "{error}");
    assert!(
        error.contains("enlarge the region") && error.contains("solid fraction of up to 0.45"),
        "{error}"
    );
}

#[test]
fn random_says_how_far_it_came() {
    let radii = [2e-3; 1000];
    let region = roomy(&radii, 0.42, [true, true, false]);
    let error = generate("random", &asked(region, &radii, 1, 0.42)).unwrap_err();
    let GenerateError::NoRoom { reached, asked, placed, .. } = error else { panic!("{error}") };
    assert!((asked / 0.42 - 1.0).abs() < 1e-6);
    // Random sequential addition saturates at 0.384.
    assert!(reached > 0.34 && reached < 0.384, "{reached}");
    assert!((reached / asked - placed as f64 / 1000.0).abs() < 1e-9);
}

#[test]
fn dense_between_close_walls_says_that_it_jams() {
    let radii = [2e-3; 60];
    let region = roomy(&radii, 0.60, [false; 3]);
    let error = generate("dense", &asked(region, &radii, 1, 0.60)).unwrap_err().to_string();
    assert!(
        error.contains("could not push 60 spheres apart") && error.contains("lower solid fraction"),
        "{error}"
    );
}

#[test]
fn bad_requests_name_the_value() {
    let cube = Region::walled([0.0; 3], [1.0; 3]);
    let message = |request: FillRequest| generate("random", &request).unwrap_err().to_string();
    let error = generate("ramdom", &FillRequest::new(cube, &[0.1], 1)).unwrap_err().to_string();
    assert!(error.contains("`ramdom`") && error.contains("lattice, random, dense, rain"), "{error}");
    assert!(message(FillRequest::new(cube, &[0.1, -0.1], 1)).contains("radius of particle 1 is -0.1"));
    assert!(message(FillRequest { up: 3, ..FillRequest::new(cube, &[0.1], 1) }).contains("up is 3"));
    assert!(
        message(FillRequest::new(cube, &[0.6], 1))
            .contains("width along x is 1: it must be at least the diameter")
    );
    let periodic = Region { periodic: [false, true, false], ..cube };
    assert!(message(FillRequest::new(periodic, &[0.3], 1)).contains("two diameters"));
    let flat = Region::walled([0.0; 3], [1.0, 1.0, 0.0]);
    assert!(message(FillRequest::new(flat, &[0.1], 1)).contains("region.max along z is 0"));
    let endless = Region::walled([f64::NEG_INFINITY, 0.0, 0.0], [1.0; 3]);
    assert!(message(FillRequest::new(endless, &[0.1], 1)).contains("region.min along x"));
}
