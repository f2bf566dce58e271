//! Cost against the number of particles (Nagy et al. 2024, section 3.2, figure 5, table B.5 column 2).
//!
//! The paper's: material, step 1e-4 s with `exact`, 2500 steps, numbers that double. Chosen: boxes that grow with the
//! number of spheres, so that each start has a solid fraction of 0.2; the limits on the exponent, and on a device two more
//! doublings, since 2^20 spheres hardly fill it; its exponent is that of the sizes that cost four times the smallest and
//! more. The quick size takes 300 steps and fewer spheres. It shares its machine with other things, so it reports the
//! exponents and asks that lists are the cheaper search where they must be by far. There each size is timed three times, and
//! the fastest counts.
//!
//! Brute force is the reference backend, which looks at every pair in every step, in f64 and on one thread for each world:
//! what it costs is its own, how it grows is that of every search without lists. The paper found both searches equally fast
//! near 250 particles. Looking at every pair only to make lists (`search = "all-pairs"` in a scene) is timed besides, where
//! the cells are: it is worth while up to more particles, and its exponent is told, which nears 2 where lists take all of the
//! time.

use std::time::Instant;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Status};
use glebe_engine::prepare;
use glebe_engine::spec::{Search, WorldSpec};
use glebe_engine::state::State;
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{Record, SceneFile, Trial, largest, scene_file, upper_power};
use crate::device::admit;

pub(super) const CASE: Case = Case {
    id: "A2",
    name: "scaling",
    shows: "the cost of a step grows as the number of particles, with brute force as its square; the forces are the same",
    source: "Nagy et al. 2024 (GPUDEM), section 3.2, figure 5, table B.5 column 2",
    run,
};

pub(super) const SCENE: SceneFile = scene_file!("A2-scaling/scene.toml");
/// Spheres of which forces are compared, and steps before: they lie on the floor and on each other.
const COMPARED: (usize, u64) = (512, 2500);
/// Steps of the scene that are not timed.
const BEGIN: u64 = 10;
/// Largest difference of forces, over the largest force: the lists' are of f32.
const SAME: f64 = 1e-3;

struct Size {
    /// Powers of two, the first and the last.
    cells: [u32; 2],
    all_pairs: [u32; 2],
    brute: [u32; 2],
    steps: u64,
    brute_steps: u64,
    /// How often each size is timed.
    repeats: usize,
}

const QUICK: Size =
    Size { cells: [6, 13], all_pairs: [6, 12], brute: [6, 10], steps: 300, brute_steps: 20, repeats: 3 };
const FULL: Size =
    Size { cells: [6, 20], all_pairs: [6, 14], brute: [6, 12], steps: 2500, brute_steps: 100, repeats: 1 };
/// The last power of two of the full size on a device, which the paper's largest number does not fill; with all pairs.
const DEVICE_LAST: [u32; 2] = [22, 18];
/// What exponents may differ by from 1 and 2.
const APART: f64 = 0.25;

/// The scene with `count` spheres, for a number of steps after its first.
pub(super) fn world(count: usize, steps: u64) -> Result<WorldSpec, CaseError> {
    // Mean volume of spheres of R = 25 to 35 mm, evenly by number: 4π/3 of the mean of R³.
    let volume = 4.0 / 3.0 * std::f64::consts::PI * (35e-3_f64.powi(4) - 25e-3_f64.powi(4)) / 4.0 / 10e-3;
    let width = (count as f64 * volume / 0.2).cbrt();
    SCENE.world(&[
        format!("particles.cloud.count={count}"),
        format!("domain.max=[{width:?}, {width:?}, {:?}]", 2.0 * width),
        format!("stage.fall.duration={:?}", steps as f64 * 1e-4),
    ])
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let size = if trial.quick { QUICK } else { FULL };
    let mut found = Findings::default();
    let on_host = trial.quick || Backend::ALL.contains(&trial.backend);
    let last = if on_host { [size.cells[1], size.all_pairs[1]] } else { DEVICE_LAST };
    let timed =
        |found: &mut Findings, name, way, sizes, steps| costs(found, name, way, sizes, steps, size.repeats);
    let grid = (trial.backend, Search::Grid);
    let cells = timed(&mut found, "cells", grid, [size.cells[0], last[0]], size.steps)?;
    let by_pairs = (trial.backend, Search::AllPairs);
    let all_pairs = timed(&mut found, "all_pairs", by_pairs, [size.all_pairs[0], last[1]], size.steps)?;
    let reference = (Backend::Reference, Search::Grid);
    let brute = timed(&mut found, "brute_force", reference, size.brute, size.brute_steps)?;

    let exponents = [("cells", upper_power(&cells), 1.0), ("brute_force", upper_power(&brute), 2.0)];
    for (name, exponent, expected) in exponents {
        let name = format!("{name}_exponent_of_the_upper_sizes");
        if trial.quick {
            found.report(name, exponent);
        } else {
            found.near(name, exponent, expected, APART);
        }
    }
    let at_most = largest(brute.iter().zip(&cells).map(|(brute, cells)| brute[1] / cells[1]));
    found.between("brute_force_over_cells_at_most", at_most, 2.0, 1e9);
    found.report("all_pairs_exponent_of_the_upper_sizes", upper_power(&all_pairs));
    for (name, other) in [("brute_force", &brute), ("all_pairs", &all_pairs)] {
        if let Some(particles) = crossover(&cells, other) {
            found.report(format!("crossover_with_{name}_particles"), particles);
        }
    }
    found.near("force_difference_over_largest", differences(trial.backend)?, 0.0, SAME);
    found.figures.push(("cost", figure(&cells, &all_pairs, &brute)));
    Ok(found)
}

/// Number of particles and wall time of a step \[s\] for doubling numbers.
fn costs(
    found: &mut Findings,
    name: &str,
    (backend, search): (Backend, Search),
    [first, last]: [u32; 2],
    steps: u64,
    repeats: usize,
) -> Result<Vec<[f64; 2]>, CaseError> {
    let mut costs = Vec::new();
    for power in first..=last {
        let count = 1_usize << power;
        let mut world = world(count, steps)?;
        world.search = search;
        let (constants, state) = prepare(world)?;
        admit(backend, std::slice::from_ref(&constants))?;
        let mut each = f64::INFINITY;
        for _ in 0..repeats {
            let mut batch = Batch::from_states(vec![(constants.clone(), state.clone())], backend);
            while batch.running() && batch.progress(0).stage == 0 {
                advance(&mut batch);
            }
            let (began, before) = (Instant::now(), batch.progress(0).step);
            while batch.running() {
                advance(&mut batch);
            }
            if *batch.status(0) != Status::Done {
                return Err(CaseError::stopped(&constants.spec.title, batch.status(0)));
            }
            each = each.min(began.elapsed().as_secs_f64() / (batch.progress(0).step - before) as f64);
        }
        found.report(format!("{name}_{count:07}_us_per_step"), 1e6 * each);
        costs.push([count as f64, each]);
    }
    Ok(costs)
}

fn advance(batch: &mut Batch) {
    let Ok(()) = batch.advance(&mut Record::default());
}

/// Where both cost the same, between sizes by power laws; none if one is cheaper throughout.
fn crossover(cells: &[[f64; 2]], brute: &[[f64; 2]]) -> Option<f64> {
    let ratios: Vec<[f64; 2]> =
        cells.iter().zip(brute).map(|(c, b)| [c[0].ln(), (b[1] / c[1]).ln()]).collect();
    let pair = ratios.windows(2).find(|pair| pair[0][1] <= 0.0 && pair[1][1] > 0.0)?;
    let [[n, below], [m, above]] = [pair[0], pair[1]];
    Some((n - below * (m - n) / (above - below)).exp())
}

/// Largest difference of the forces that both searches find from the same state in a step, over the largest force.
fn differences(backend: Backend) -> Result<f64, CaseError> {
    let (count, steps) = COMPARED;
    let (constants, state) = prepare(world(count, steps - BEGIN + 1)?)?;
    admit(backend, std::slice::from_ref(&constants))?;
    let mut settled = Batch::from_states(vec![(constants.clone(), state)], backend);
    while settled.running() && settled.progress(0).step < steps {
        advance(&mut settled);
    }
    let forces = |backend: Backend, state: State| {
        let mut batch = Batch::from_states(vec![(constants.clone(), state)], backend);
        while batch.running() {
            advance(&mut batch);
        }
        let p = batch.state(0).particles;
        let mut forces: Vec<(u32, [f32; 3])> = p.id.into_iter().zip(p.force).collect();
        forces.sort_by_key(|f| f.0);
        forces
    };
    let state = settled.state(0);
    let (listed, all) = (forces(backend, state.clone()), forces(Backend::Reference, state));
    if listed.len() != count || all.len() != count {
        return Ok(f64::INFINITY);
    }
    let scale = largest(all.iter().flat_map(|f| f.1).map(|x| f64::from(x.abs())));
    let apart =
        listed.iter().zip(&all).flat_map(|(a, b)| [0, 1, 2].map(|k| f64::from(a.1[k]) - f64::from(b.1[k])));
    Ok(largest(apart.map(f64::abs)) / scale)
}

fn figure(cells: &[[f64; 2]], all_pairs: &[[f64; 2]], brute: &[[f64; 2]]) -> String {
    let of = |costs: &[[f64; 2]], k: usize| costs.iter().map(|cost| cost[k]).collect::<Vec<_>>();
    let [[cells_n, cells_t], [pairs_n, pairs_t], [brute_n, brute_t]] =
        [cells, all_pairs, brute].map(|costs| [0, 1].map(|k| of(costs, k)));
    let Some(last) = cells.last() else { return String::new() };
    let linear: Vec<f64> = cells_n.iter().map(|n| last[1] * n / last[0]).collect();
    Plot {
        title: "Deposition: cost of a step",
        x: Axis::new("particles", "").log(),
        y: Axis::new("wall time of a step", "s").log(),
        series: vec![
            Series { name: "lists through cells", x: &cells_n, y: &cells_t, style: Style::Line },
            Series { name: "lists from all pairs", x: &pairs_n, y: &pairs_t, style: Style::Line },
            Series { name: "brute force", x: &brute_n, y: &brute_t, style: Style::Line },
            Series { name: "linear", x: &cells_n, y: &linear, style: Style::Dashed },
        ],
        ..Plot::default()
    }
    .to_svg()
}
