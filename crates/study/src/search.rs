//! Searches for the point of the unit cube at which a cost is least, and for the distribution of such points. A search
//! asks for the costs of a round of points at once, so that each round can be one batch; it is a function of its seed
//! and the costs told, so that a search which was stopped is taken up by telling the costs again.

mod cmaes;
mod evolution;
mod filter;
mod gaussian;
mod kmeans;
pub mod matrix;
mod mixture;

use glebe_engine::generate::Rng;

pub use cmaes::CmaEs;
pub use evolution::{DifferentialEvolution, Evolution};
pub use filter::{Filter, Posterior};
pub use gaussian::{GaussianProcess, Kernel, LeftOut, Prediction};
pub use kmeans::{Clusters, clusters};
pub use mixture::Mixture;

/// What all searches have in common.
pub trait Search {
    /// The points of the next round, in the unit cube.
    fn ask(&mut self) -> Vec<Vec<f64>>;

    /// The costs of these points, in their order; infinite where there is none.
    fn tell(&mut self, costs: &[f64]);

    /// The costs of those that the search goes on from.
    fn costs(&self) -> Vec<f64>;

    /// What is known of the distribution of the point, from a search for that.
    fn posterior(&self) -> Option<&Posterior> {
        None
    }
}

/// A coordinate reflected at 0 and 1 until it lies between.
fn reflected(x: f64) -> f64 {
    let y = x.rem_euclid(2.0);
    if y > 1.0 { 2.0 - y } else { y }
}

/// One of the numbers below `n`.
fn pick(rng: &mut Rng, n: usize) -> usize {
    ((rng.unit() * n as f64) as usize).min(n.saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least cost of a search after some rounds, and its point.
    pub(super) fn least(
        search: &mut dyn Search,
        rounds: usize,
        cost: impl Fn(&[f64]) -> f64,
    ) -> (f64, Vec<f64>) {
        let mut best = (f64::INFINITY, Vec::new());
        for _ in 0..rounds {
            let points = search.ask();
            assert!(points.iter().flatten().all(|u| (0.0..=1.0).contains(u)), "outside of the cube");
            let costs: Vec<f64> = points.iter().map(|x| cost(x)).collect();
            for (x, cost) in points.iter().zip(&costs) {
                if *cost < best.0 {
                    best = (*cost, x.clone());
                }
            }
            search.tell(&costs);
        }
        best
    }

    /// Coordinates of test functions, from -`half` to `half`.
    pub(super) fn scaled(u: &[f64], half: f64) -> Vec<f64> {
        u.iter().map(|u| half * (2.0 * u - 1.0)).collect()
    }

    /// Least at 0.6 of each half width, 0 there.
    pub(super) fn sphere(u: &[f64]) -> f64 {
        scaled(u, 5.0).iter().map(|x| (x - 3.0) * (x - 3.0)).sum()
    }

    /// Rosenbrock 1960: a bent valley, 0 at (1, 1, …).
    pub(super) fn rosenbrock(u: &[f64]) -> f64 {
        let x = scaled(u, 2.0);
        x.windows(2).map(|p| 100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2)).sum()
    }

    /// Rastrigin 1974: a grid of local minima, 0 at (1, 1, …) as shifted here.
    pub(super) fn rastrigin(u: &[f64]) -> f64 {
        let x = scaled(u, 5.12);
        let term = |x: f64| x * x - 10.0 * (std::f64::consts::TAU * x).cos() + 10.0;
        x.iter().map(|x| term(x - 1.0)).sum()
    }

    #[test]
    fn coordinates_are_reflected_into_the_cube() {
        for (x, expected) in
            [(0.25, 0.25), (-0.25, 0.25), (1.25, 0.75), (2.5, 0.5), (-1.75, 0.25), (1.0, 1.0)]
        {
            assert_eq!(reflected(x), expected, "{x}");
        }
    }

    #[test]
    fn a_search_is_a_function_of_its_seed_and_the_costs() {
        let searches = |seed: u64| -> Vec<Box<dyn Search>> {
            let evolution = Evolution { adaptive: true, ..Evolution::default() };
            vec![
                Box::new(DifferentialEvolution::new(3, Evolution::default(), seed)),
                Box::new(DifferentialEvolution::new(3, evolution, seed)),
                Box::new(CmaEs::new(3, None, seed)),
                Box::new(Filter::new(3, 32, 0.3, 1.0, seed)),
            ]
        };
        for (k, mut search) in searches(5).into_iter().enumerate() {
            let points = |search: &mut dyn Search| {
                let costs = |points: &[Vec<f64>]| points.iter().map(|x| sphere(x)).collect::<Vec<_>>();
                let mut all = Vec::new();
                for _ in 0..3 {
                    let points = search.ask();
                    search.tell(&costs(&points));
                    all.extend(points);
                }
                all
            };
            let first = points(search.as_mut());
            assert_eq!(first, points(searches(5)[k].as_mut()), "search {k}");
            assert_ne!(first, points(searches(6)[k].as_mut()), "search {k}");
        }
    }

    /// Points without a cost, whole rounds of them too, cost a search nothing but time.
    #[test]
    fn failures_do_not_stop_a_search() {
        let searches: [Box<dyn Search>; 3] = [
            Box::new(DifferentialEvolution::new(2, Evolution { population: 20, ..Evolution::default() }, 1)),
            Box::new(CmaEs::new(2, None, 1)),
            Box::new(Filter::new(2, 64, 0.3, 1.0, 1)),
        ];
        for (k, mut search) in searches.into_iter().enumerate() {
            let points = search.ask();
            search.tell(&vec![f64::INFINITY; points.len()]);
            let cost = |u: &[f64]| if u[0] < 0.5 { f64::INFINITY } else { sphere(u) };
            let (found, x) = least(search.as_mut(), 60, cost);
            assert!(found < 0.05 && x[0] > 0.5, "search {k}: {found} at {x:?}");
        }
    }
}
