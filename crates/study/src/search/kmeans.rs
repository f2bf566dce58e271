//! Clusters of points by k-means.

use glebe_engine::generate::{Purpose, Rng};

use super::matrix::{Eigen, dot, mean_and_covariance};

/// Most clusters that are looked for.
const MOST: usize = 8;
/// Beginnings for each number of clusters.
const STARTS: usize = 8;
const ROUNDS: usize = 100;
/// Sets of even points that clusters are compared with.
const REFERENCES: usize = 10;

/// Points in clusters, the largest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Clusters {
    /// The cluster of each point.
    pub of: Vec<usize>,
    /// How many there are.
    pub count: usize,
    /// How well apart they are: mean silhouette (Rousseeuw 1987), -1 to 1; 0 for one cluster.
    pub silhouette: f64,
}

/// The clusters of points, by k-means (Lloyd 1982, begun as k-means++) for each number from 2 to 8. Taken is the number of
/// the largest silhouette among those at which points are further apart than chance would have it if they lay evenly in
/// their box along the principal axes, the reference of the gap statistic (Tibshirani, Walther and Hastie 2001); one
/// cluster if there is none.
pub fn clusters(points: &[Vec<f64>], seed: u64) -> Clusters {
    let mut best = Clusters { of: vec![0; points.len()], count: points.len().min(1), silhouette: 0.0 };
    let references: Vec<Vec<Vec<f64>>> =
        (1..=REFERENCES as u64).map(|k| even(points, seed.wrapping_add(k))).collect();
    // A cluster of one point says nothing.
    for k in 2..=MOST.min(points.len() / 2) {
        let of = k_means(points, k, seed);
        let found = silhouette(points, &of, k);
        if found > best.silhouette && found > chance(&references, k, seed) {
            best = Clusters { of, count: k, silhouette: found };
        }
    }
    by_size(&best)
}

/// A silhouette that even points do not reach by chance: four standard deviations above their mean.
fn chance(references: &[Vec<Vec<f64>>], k: usize, seed: u64) -> f64 {
    let all: Vec<f64> = references.iter().map(|even| silhouette(even, &k_means(even, k, seed), k)).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let variance = all.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / (all.len() - 1) as f64;
    mean + 4.0 * variance.sqrt()
}

/// As many points, evenly at random in the box of these along their principal axes.
fn even(points: &[Vec<f64>], seed: u64) -> Vec<Vec<f64>> {
    let mut rng = Rng::new(seed, Purpose::Samples);
    let axes =
        Eigen::of(&mean_and_covariance(points, &vec![1.0 / points.len() as f64; points.len()]).1).vectors;
    let spans: Vec<[f64; 2]> = axes
        .iter()
        .map(|axis| {
            points
                .iter()
                .map(|x| dot(x, axis))
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], y| [low.min(y), high.max(y)])
        })
        .collect();
    let mut point = || {
        let along: Vec<f64> = spans.iter().map(|[low, high]| low + (high - low) * rng.unit()).collect();
        (0..axes.len()).map(|k| along.iter().zip(&axes).map(|(y, axis)| y * axis[k]).sum()).collect()
    };
    points.iter().map(|_| point()).collect()
}

/// The same clusters in the order of their sizes.
fn by_size(clusters: &Clusters) -> Clusters {
    let size = |c: usize| clusters.of.iter().filter(|of| **of == c).count();
    let mut order: Vec<usize> = (0..clusters.count).collect();
    order.sort_by_key(|c| std::cmp::Reverse(size(*c)));
    let place = |c: usize| order.iter().position(|o| *o == c).unwrap_or(c);
    Clusters { of: clusters.of.iter().map(|c| place(*c)).collect(), ..*clusters }
}

/// Beginnings far from each other, taken from the points by weight (Arthur and Vassilvitskii 2007, k-means++).
pub(super) fn seeds(points: &[Vec<f64>], weights: &[f64], k: usize, rng: &mut Rng) -> Vec<Vec<f64>> {
    let mut chosen: Vec<Vec<f64>> = Vec::new();
    while chosen.len() < k {
        let far = |x: &Vec<f64>| chosen.iter().map(|c| square(x, c)).fold(f64::INFINITY, f64::min).min(1e9);
        let chances: Vec<f64> = points.iter().zip(weights).map(|(x, w)| w * far(x)).collect();
        let mut left = rng.unit() * chances.iter().sum::<f64>();
        let found = chances.iter().position(|c| {
            left -= c;
            left < 0.0
        });
        let Some(x) = points.get(found.unwrap_or(points.len().saturating_sub(1))) else { break };
        chosen.push(x.clone());
    }
    chosen
}

fn k_means(points: &[Vec<f64>], k: usize, seed: u64) -> Vec<usize> {
    let mut rng = Rng::new(seed, Purpose::Samples);
    let weights = vec![1.0; points.len()];
    let mut best = (f64::INFINITY, Vec::new());
    for _ in 0..STARTS {
        let mut centres = seeds(points, &weights, k, &mut rng);
        let mut of = vec![usize::MAX; points.len()];
        for _ in 0..ROUNDS {
            let next: Vec<usize> = points.iter().map(|x| nearest(x, &centres)).collect();
            if next == of {
                break;
            }
            of = next;
            for (c, centre) in centres.iter_mut().enumerate() {
                let its: Vec<&Vec<f64>> =
                    points.iter().zip(&of).filter(|(_, o)| **o == c).map(|(x, _)| x).collect();
                if !its.is_empty() {
                    for (d, value) in centre.iter_mut().enumerate() {
                        *value = its.iter().map(|x| x[d]).sum::<f64>() / its.len() as f64;
                    }
                }
            }
        }
        let spread: f64 = points.iter().zip(&of).map(|(x, c)| square(x, &centres[*c])).sum();
        if spread < best.0 {
            best = (spread, of);
        }
    }
    best.1
}

fn nearest(x: &[f64], centres: &[Vec<f64>]) -> usize {
    let far = |c: &usize| square(x, &centres[*c]);
    (0..centres.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
}

/// Mean over the points of (b - a) / max(a, b): a is the mean distance to the others of its cluster, b that to the
/// nearest other cluster; 0 for a point alone.
fn silhouette(points: &[Vec<f64>], of: &[usize], k: usize) -> f64 {
    let mut sum = 0.0;
    for (i, x) in points.iter().enumerate() {
        let (mut away, mut counts) = (vec![0.0; k], vec![0.0; k]);
        for (j, y) in points.iter().enumerate().filter(|(j, _)| *j != i) {
            away[of[j]] += square(x, y).sqrt();
            counts[of[j]] += 1.0;
        }
        let mean = |c: usize| away[c] / counts[c];
        let other =
            (0..k).filter(|c| *c != of[i] && counts[*c] > 0.0).map(mean).fold(f64::INFINITY, f64::min);
        let own = mean(of[i]);
        if counts[of[i]] > 0.0 && other.is_finite() && own.max(other) > 0.0 {
            sum += (other - own) / own.max(other);
        }
    }
    sum / points.len() as f64
}

fn square(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| (x - y) * (x - y)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(rng: &mut Rng, n: usize, middle: &[f64], std: f64) -> Vec<Vec<f64>> {
        (0..n).map(|_| middle.iter().map(|m| m + std * rng.normal()).collect()).collect()
    }

    #[test]
    fn clouds_that_lie_apart_are_found_and_ordered_by_size() {
        let mut rng = Rng::new(2, Purpose::Samples);
        let middles = [vec![0.2, 0.2, 0.5, 0.5], vec![0.8, 0.3, 0.5, 0.2], vec![0.5, 0.8, 0.1, 0.9]];
        let sizes = [10, 25, 40];
        let points: Vec<_> =
            middles.iter().zip(sizes).flat_map(|(m, n)| cloud(&mut rng, n, m, 0.04)).collect();
        let found = clusters(&points, 1);
        assert_eq!(found.count, 3);
        assert!(found.silhouette > 0.7, "{}", found.silhouette);
        let expected: Vec<usize> =
            [(2, 10), (1, 25), (0, 40)].iter().flat_map(|(c, n)| vec![*c; *n]).collect();
        assert_eq!(found.of, expected);
    }

    #[test]
    fn one_cloud_is_one_cluster_whatever_its_shape() {
        let mut rng = Rng::new(3, Purpose::Samples);
        let mut clouds = vec![cloud(&mut rng, 60, &[0.5; 6], 0.1), cloud(&mut rng, 200, &[0.5; 2], 0.1)];
        clouds.push((0..150).map(|_| vec![0.5 * rng.unit(), rng.unit()]).collect());
        // A valley.
        let mut valley = |_| {
            let u = rng.unit();
            vec![u, 1.0 - u + 0.01 * rng.normal()]
        };
        clouds.push((0..150).map(&mut valley).collect());
        for points in clouds {
            let found = clusters(&points, 1);
            assert_eq!((found.count, found.silhouette), (1, 0.0));
        }
        assert_eq!(clusters(&[], 1).count, 0);
        assert_eq!(clusters(&[vec![0.3], vec![0.3]], 1).count, 1);
    }

    /// Two pairs on a line, at 0, 1, 10 and 11: for each point a = 1, b = 10.5 or 9.5, by hand.
    #[test]
    fn silhouettes_are_as_defined() {
        let points: Vec<Vec<f64>> = [0.0, 1.0, 10.0, 11.0].iter().map(|x| vec![*x]).collect();
        let expected = 0.5 * (9.5 / 10.5 + 8.5 / 9.5);
        assert!((silhouette(&points, &[0, 0, 1, 1], 2) - expected).abs() < 1e-14);
    }
}
