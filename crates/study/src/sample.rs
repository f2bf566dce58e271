//! Which worlds a study has: points spread over ranges, and the values that they stand for.

use glebe_engine::generate::{Purpose, Rng};
use glebe_io::study::{Follower, Parameter, Sampler, Study, Value, Values};

/// A world of a study.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Values of the parameters, then of the followers.
    pub values: Vec<Value>,
    /// What makes it of the scene, as arguments of `--set`.
    pub sets: Vec<String>,
}

/// Why a study has no worlds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "a Sobol sequence is known here for up to {MOST_DIMENSIONS} parameters, and {found} vary: take \
     sampler = \"latin-hypercube\""
)]
pub struct TooManyDimensions {
    /// How many vary.
    pub found: usize,
}

/// The worlds of a study, in order.
///
/// # Errors
/// More parameters than the sampler can spread points over.
pub fn worlds(study: &Study) -> Result<Vec<World>, TooManyDimensions> {
    let parameters = &study.parameters;
    let dimensions = parameters.len();
    let rows: Vec<Vec<Value>> = match study.sampler {
        Sampler::List => {
            let listed = |p: &Parameter, k: usize| match &p.values {
                Values::Listed(values) => values.get(k).cloned(),
                Values::Range { .. } => None,
            };
            let row = |k| parameters.iter().map(|p| listed(p, k)).collect::<Option<Vec<_>>>();
            (0..).map_while(row).take(if parameters.is_empty() { 0 } else { usize::MAX }).collect()
        }
        Sampler::LatinHypercube => spread(parameters, latin_hypercube(study.points, dimensions, study.seed)),
        Sampler::Sobol => spread(parameters, shifted_sobol(study.points, dimensions, study.seed)?),
        _ => grid(parameters),
    };
    Ok(rows.into_iter().map(|row| world(study, row)).collect())
}

fn world(study: &Study, values: Vec<Value>) -> World {
    World::new(study.parameters.iter().map(|p| p.path.as_str()), &study.followers, values)
}

impl World {
    /// With values of the parameters that stand at these paths, and of what follows them.
    pub(crate) fn new<'a>(
        paths: impl Iterator<Item = &'a str>,
        followers: &'a [Follower],
        mut values: Vec<Value>,
    ) -> Self {
        let following = |f: &Follower| {
            let of = values.get(f.of).and_then(Value::number).unwrap_or(f64::NAN);
            Value::rounded(fifteen_digits(f.factor * of), f.whole)
        };
        let following: Vec<Value> = followers.iter().map(following).collect();
        values.extend(following);
        let paths = paths.chain(followers.iter().map(|f| f.path.as_str()));
        let sets = paths.zip(&values).map(|(path, value)| format!("{path}={value}")).collect();
        Self { values, sets }
    }
}

/// Every combination; the last parameter changes fastest.
fn grid(parameters: &[Parameter]) -> Vec<Vec<Value>> {
    parameters.iter().fold(vec![Vec::new()], |rows, parameter| {
        let values = match &parameter.values {
            Values::Listed(values) => values.clone(),
            Values::Range { count, .. } => {
                let last = count.saturating_sub(1).max(1) as f64;
                (0..*count).map(|k| at(&parameter.values, k as f64 / last)).collect()
            }
        };
        let extended = |row: Vec<Value>| {
            values.clone().into_iter().map(move |value| row.iter().cloned().chain([value]).collect())
        };
        rows.into_iter().flat_map(extended).collect()
    })
}

fn spread(parameters: &[Parameter], points: Vec<Vec<f64>>) -> Vec<Vec<Value>> {
    let row = |point: Vec<f64>| parameters.iter().zip(point).map(|(p, u)| at(&p.values, u)).collect();
    points.into_iter().map(row).collect()
}

/// The value at a share of the way through what a parameter may be, 0 to 1.
fn at(values: &Values, share: f64) -> Value {
    match values {
        Values::Listed(values) => {
            let k = (share * values.len() as f64) as usize;
            values.get(k).or(values.last()).cloned().unwrap_or(Value::Number(f64::NAN))
        }
        &Values::Range { range, logarithmic, whole, .. } => within(range, logarithmic, whole, share),
    }
}

/// The value at a share of the way through a range, 0 to 1.
pub(crate) fn within([from, to]: [f64; 2], logarithmic: bool, whole: bool, share: f64) -> Value {
    // The ends as they were written, whatever the rounding.
    let x = match share {
        0.0 => from,
        1.0 => to,
        _ if logarithmic => libm::exp(libm::log(from) + share * libm::log(to / from)),
        _ => from + share * (to - from),
    };
    Value::rounded(fifteen_digits(x), whole)
}

/// A number as people would write it: 0.08 and not 0.07999999999999999.
fn fifteen_digits(x: f64) -> f64 {
    format!("{x:.14e}").parse().unwrap_or(x)
}

/// Points of a Latin hypercube (McKay, Beckman and Conover 1979, "A comparison of three methods for selecting values
/// of input variables"): along every dimension each of as many strata as points holds one, at random within it.
pub fn latin_hypercube(points: usize, dimensions: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = Rng::new(seed, Purpose::Samples);
    let mut all = vec![Vec::with_capacity(dimensions); points];
    for _ in 0..dimensions {
        for (point, stratum) in all.iter_mut().zip(rng.permutation(points)) {
            let next_below = |x: f64, limit: f64| if x < limit { x } else { limit.next_down() };
            // Rounding must not carry a point into the next stratum.
            let limit = (stratum + 1) as f64 / points as f64;
            point.push(next_below((stratum as f64 + rng.unit()) / points as f64, limit));
        }
    }
    all
}

/// Most dimensions of [`shifted_sobol`].
pub const MOST_DIMENSIONS: usize = 1 + DIRECTIONS.len();

/// Primitive polynomials (degree, coefficients between the first and the last as bits) and initial direction numbers
/// of dimensions 2 to 21: Joe and Kuo 2008, "Constructing Sobol sequences with better two-dimensional projections",
/// table `new-joe-kuo-6`.
const DIRECTIONS: [(u32, u32, &[u32]); 20] = [
    (1, 0, &[1]),
    (2, 1, &[1, 3]),
    (3, 1, &[1, 3, 1]),
    (3, 2, &[1, 1, 1]),
    (4, 1, &[1, 1, 3, 3]),
    (4, 4, &[1, 3, 5, 13]),
    (5, 2, &[1, 1, 5, 5, 17]),
    (5, 4, &[1, 1, 5, 5, 5]),
    (5, 7, &[1, 1, 7, 11, 19]),
    (5, 11, &[1, 1, 5, 1, 1]),
    (5, 13, &[1, 1, 1, 3, 11]),
    (5, 14, &[1, 3, 5, 5, 31]),
    (6, 1, &[1, 3, 3, 9, 7, 49]),
    (6, 13, &[1, 1, 1, 15, 21, 21]),
    (6, 16, &[1, 3, 1, 13, 27, 49]),
    (6, 19, &[1, 1, 1, 15, 7, 5]),
    (6, 22, &[1, 3, 1, 15, 13, 25]),
    (6, 25, &[1, 1, 5, 5, 19, 61]),
    (7, 1, &[1, 3, 7, 11, 23, 15, 103]),
    (7, 4, &[1, 3, 7, 13, 13, 15, 69]),
];

/// The first points of a Sobol sequence (Sobol 1967; in the order of Antonov and Saleev 1979), beginning with the
/// origin, as 32-bit fractions.
///
/// # Errors
/// More than [`MOST_DIMENSIONS`].
fn sobol(points: usize, dimensions: usize) -> Result<Vec<Vec<u32>>, TooManyDimensions> {
    if dimensions > MOST_DIMENSIONS {
        return Err(TooManyDimensions { found: dimensions });
    }
    let directions: Vec<[u32; 32]> = (0..dimensions).map(directions).collect();
    let mut point = vec![0; dimensions];
    let mut all = Vec::with_capacity(points);
    for n in 0..points {
        all.push(point.clone());
        // The lowest bit of n that is 0.
        let bit = (!n).trailing_zeros().min(31) as usize;
        for (x, v) in point.iter_mut().zip(&directions) {
            *x ^= v[bit];
        }
    }
    Ok(all)
}

/// The direction numbers of a dimension, from 0, as 32-bit fractions.
fn directions(dimension: usize) -> [u32; 32] {
    let Some((degree, coefficients, first)) = dimension.checked_sub(1).and_then(|d| DIRECTIONS.get(d)) else {
        // The first dimension is van der Corput's sequence.
        return std::array::from_fn(|k| 1 << (31 - k));
    };
    let s = *degree as usize;
    let mut v = [0; 32];
    for k in 0..32 {
        v[k] = if k < s {
            first[k] << (31 - k)
        } else {
            let taps = (1..s).filter(|i| coefficients >> (s - 1 - i) & 1 == 1);
            taps.fold(v[k - s] ^ (v[k - s] >> s), |sum, i| sum ^ v[k - i])
        };
    }
    v
}

/// A Sobol sequence whose digits are shifted by random ones (Cranley and Patterson 1976, in base 2), which keeps how
/// evenly its points lie and takes the first away from the corner. 2ⁿ points lie best.
///
/// # Errors
/// More than [`MOST_DIMENSIONS`].
pub fn shifted_sobol(
    points: usize,
    dimensions: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, TooManyDimensions> {
    let mut rng = Rng::new(seed, Purpose::Samples);
    let shift: Vec<u32> = (0..dimensions).map(|_| (rng.bits() >> 32) as u32).collect();
    // The middle of the interval that the digits leave.
    let share = |x: u32| (f64::from(x) + 0.5) / (1_u64 << 32) as f64;
    let shifted = |point: Vec<u32>| point.iter().zip(&shift).map(|(x, s)| share(x ^ s)).collect();
    Ok(sobol(points, dimensions)?.into_iter().map(shifted).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(sampler: Sampler, text: &str) -> Study {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../io/tests/scene_common");
        let text = format!("scene = \"example.toml\"\nsampler = \"{}\"\n{text}", sampler.name());
        Study::parse("study.toml", &text, &folder, &[]).unwrap()
    }

    fn sets(study: &Study) -> Vec<String> {
        worlds(study).unwrap().into_iter().map(|w| w.sets.join(" ")).collect()
    }

    const TWO: &str = "[vary.a]\npath = \"material.soil.density\"\nvalues = [1000, \"2 t/m^3\"]\n\
                       [vary.b]\npath = \"particles.bed.seed\"\nvalues = [7, 8]\n\
                       [follow.c]\npath = \"material.soil.friction\"\nof = \"a\"\nfactor = 5e-4\n";

    #[test]
    fn a_grid_goes_through_its_last_parameter_first() {
        let expected = ["1000.0 7 0.5", "1000.0 8 0.5", "2000.0 7 1.0", "2000.0 8 1.0"].map(|row| {
            let v: Vec<&str> = row.split(' ').collect();
            format!(
                "material.soil.density={} particles.bed.seed={} material.soil.friction={}",
                v[0], v[1], v[2]
            )
        });
        assert_eq!(sets(&study(Sampler::Grid, TWO)), expected);
    }

    #[test]
    fn a_list_takes_the_values_side_by_side() {
        let worlds = worlds(&study(Sampler::List, TWO)).unwrap();
        let values: Vec<_> = worlds.into_iter().map(|w| w.values).collect();
        let row = |a, b, c| vec![Value::Number(a), Value::Whole(b), Value::Number(c)];
        assert_eq!(values, [row(1000.0, 7, 0.5), row(2000.0, 8, 1.0)]);
    }

    #[test]
    fn ranges_have_equal_differences_or_ratios_and_exact_ends() {
        let numbers = |spacing: &str| {
            let text = format!(
                "[vary.e]\npath = \"material.soil.youngs_modulus\"\nrange = [\"0.1 MPa\", \"10 MPa\"]\ncount = 3\n\
                 spacing = \"{spacing}\"\n"
            );
            let worlds = worlds(&study(Sampler::Grid, &text)).unwrap();
            worlds.iter().map(|w| w.values[0].number().unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(numbers("linear"), [1e5, 5.05e6, 1e7]);
        let ratios = numbers("logarithmic");
        assert_eq!((ratios[0], ratios[2]), (1e5, 1e7));
        assert!((ratios[1] / 1e6 - 1.0).abs() < 1e-12, "{ratios:?}");
    }

    #[test]
    fn spread_worlds_lie_in_their_ranges() {
        let text = "points = 16\n[vary.e]\npath = \"material.soil.youngs_modulus\"\nrange = [1e5, 1e7]\n\
                    spacing = \"logarithmic\"\n[vary.n]\npath = \"particles.bed.count\"\nrange = [10, 20]\n\
                    [vary.law]\npath = \"contact.normal\"\nvalues = [\"hertz\", \"linear\"]\n";
        for sampler in [Sampler::LatinHypercube, Sampler::Sobol] {
            let worlds = worlds(&study(sampler, text)).unwrap();
            let column = |k: usize| worlds.iter().map(|w| w.values[k].clone()).collect::<Vec<_>>();
            let numbers = |k: usize| column(k).iter().map(|v| v.number().unwrap()).collect::<Vec<f64>>();
            assert_eq!(worlds.len(), 16);
            assert!(numbers(0).iter().all(|x| (1e5..=1e7).contains(x)));
            // Equal ratios: as many below the geometric mean as above; texts take equal shares.
            assert_eq!(numbers(0).iter().filter(|x| **x < 1e6).count(), 8, "{sampler:?}");
            assert_eq!(column(2).iter().filter(|v| **v == Value::Text("\"linear\"".to_owned())).count(), 8);
            assert!(column(1).iter().all(|v| matches!(v, Value::Whole(10..=20))), "{:?}", column(1));
        }
    }

    #[test]
    fn each_stratum_of_a_latin_hypercube_holds_one_point() {
        for points in [1, 7, 100, 1000] {
            let all = latin_hypercube(points, 5, 3);
            for d in 0..5 {
                let mut strata: Vec<usize> = all.iter().map(|x| (x[d] * points as f64) as usize).collect();
                strata.sort_unstable();
                assert_eq!(strata, (0..points).collect::<Vec<_>>(), "{points} points, dimension {d}");
            }
        }
        assert_eq!(latin_hypercube(20, 3, 1), latin_hypercube(20, 3, 1));
        assert_ne!(latin_hypercube(20, 3, 1), latin_hypercube(20, 3, 2));
    }

    /// The beginning of the sequence as Joe and Kuo print it on their page, in three dimensions.
    #[test]
    fn a_sobol_sequence_begins_as_it_must() {
        let points = sobol(10, 3).unwrap();
        let share = |x: &u32| f64::from(*x) / 4294967296.0;
        let points: Vec<Vec<f64>> = points.iter().map(|p| p.iter().map(share).collect()).collect();
        let expected = [
            [0.0, 0.0, 0.0],
            [0.5, 0.5, 0.5],
            [0.75, 0.25, 0.25],
            [0.25, 0.75, 0.75],
            [0.375, 0.375, 0.625],
            [0.875, 0.875, 0.125],
            [0.625, 0.125, 0.875],
            [0.125, 0.625, 0.375],
            [0.1875, 0.3125, 0.9375],
            [0.6875, 0.8125, 0.4375],
        ];
        assert_eq!(points, expected);
        assert_eq!(sobol(4, MOST_DIMENSIONS + 1), Err(TooManyDimensions { found: MOST_DIMENSIONS + 1 }));
    }

    /// 2ⁿ points of a net in base 2 have one point in each interval of 2⁻ⁿ along every axis, and the first two
    /// dimensions one in each elementary rectangle of that area; a shift of digits keeps both.
    #[test]
    fn sobol_points_are_a_net_shifted_or_not() {
        let one_each = |cells: Vec<usize>| {
            let mut cells = cells;
            cells.sort_unstable();
            assert_eq!(cells, (0..cells.len()).collect::<Vec<_>>());
        };
        for seed in [1, 2] {
            let points = shifted_sobol(256, MOST_DIMENSIONS, seed).unwrap();
            for d in 0..MOST_DIMENSIONS {
                one_each(points.iter().map(|p| (p[d] * 256.0) as usize).collect());
            }
            for wide in 0..=8 {
                let (a, b) = (f64::from(1 << wide), f64::from(1 << (8 - wide)));
                one_each(
                    points.iter().map(|p| (p[0] * a) as usize * b as usize + (p[1] * b) as usize).collect(),
                );
            }
        }
    }

    /// Squared L2-star discrepancy (Warnock 1972): how far shares of points differ from shares of volume.
    fn discrepancy(points: &[Vec<f64>]) -> f64 {
        let (n, d) = (points.len() as f64, points[0].len() as i32);
        let one: f64 = points.iter().map(|x| x.iter().map(|u| 1.0 - u * u).product::<f64>()).sum();
        let pairs = points.iter().flat_map(|x| points.iter().map(move |y| (x, y)));
        let two: f64 =
            pairs.map(|(x, y)| x.iter().zip(y).map(|(a, b)| 1.0 - a.max(*b)).product::<f64>()).sum();
        3f64.powi(-d) - 2f64.powi(1 - d) / n * one + two / (n * n)
    }

    /// Of n random points it is (2⁻ᵈ - 3⁻ᵈ) / n on average; a low-discrepancy sequence must be far below and fall
    /// faster than 1/n.
    #[test]
    fn sobol_points_lie_more_evenly_than_random_ones() {
        for d in [2, 5] {
            let random = |n: usize| (2f64.powi(-(d as i32)) - 3f64.powi(-(d as i32))) / n as f64;
            let of = |n: usize| discrepancy(&shifted_sobol(n, d, 1).unwrap());
            let [few, many] = [128, 1024].map(|n| of(n) / random(n));
            assert!(few < 0.5 && many < 0.5 * few, "{d} dimensions: {few} and {many} of random");
        }
    }
}
