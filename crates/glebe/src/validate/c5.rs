//! Cost against the number of grains of a sample and of samples (Lubbe et al. 2022, section 11, figures 12 and 13).
//!
//! The paper's: strain-driven isotropic compression of equal grains of 0.15 mm in diameter (its text says 0.015 mm),
//! table 1, its cost linear in both numbers. Chosen: that samples are dense, where the paper ends at a solid fraction
//! of 12 %; the steps; the limits on the exponents; on a device larger samples besides, since 32 000 grains cost it hardly
//! more than 2000, and the exponent of those that cost four times the smallest and more. Every sample must end with the
//! same bits as alone, in full every tenth of the second search. The quick size shares its machine with other things and reports the exponents.
//!
//! Both searches of the paper are timed, a uniform grid, which is taken unless a scene says otherwise, and a hierarchy of
//! bounding volumes, also for radii that are spread over 1:2.5 and 1:10, as in the paper. Where radii are more than 1:3
//! apart the grid is one for each size class.

use std::time::Instant;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status};
use glebe_engine::cell::STRAIN_PER_STEP;
use glebe_engine::prepare;
use glebe_engine::spec::{Deformation, Drive, Search, Stage, Until, WorldSpec};
use glebe_report::Axis;

use super::case::{Case, CaseError, Findings};
use super::samples::{cell, figure};
use super::trial::{SceneFile, Trial, power_law, scene_file, upper_power};
use crate::device::admit;

pub(super) const CASE: Case = Case {
    id: "C5",
    name: "scaling-of-samples",
    shows: "the cost is linear in grains and in samples, and a sample has the same bits in a batch and alone",
    source: "Lubbe et al. 2022 (RVE), section 11, figures 12 and 13",
    run,
};

const SCENE: SceneFile = scene_file!("C1-homogenisation/scene.toml");
/// \[m\]
const RADIUS: f64 = 75e-6;

struct Size {
    grains: &'static [usize],
    samples: &'static [usize],
    /// Grains of each of several samples.
    each: usize,
    /// Grains of the samples of several gradings.
    graded: usize,
    steps: u64,
}

const QUICK: Size =
    Size { grains: &[200, 400, 800, 1600], samples: &[1, 2, 4, 8], each: 400, graded: 1600, steps: 300 };
const FULL: Size = Size {
    grains: &[2000, 4000, 8000, 16_000, 32_000],
    samples: &[50, 100, 200, 400],
    each: 2000,
    graded: 32_000,
    steps: 2000,
};
/// Largest over smallest radius, even by number between them.
const GRADINGS: [f64; 3] = [1.0, 2.5, 10.0];
/// The two that are compared.
const SEARCHES: [Search; 2] = [Search::Grid, Search::Bvh];
/// What a device is full with.
const MORE_GRAINS: [usize; 4] = [64_000, 128_000, 256_000, 512_000];
/// Share of the cell that grains fill at first, so that they soon touch.
const DENSE: f64 = 0.58;
/// Strain along each axis, or as much as steps allow.
const STRAIN: f64 = 0.04;
/// What exponents may differ by from 1.
const APART: f64 = 0.25;

/// A sample of equal grains under compression from all sides.
pub(super) fn world(grains: usize, seed: usize, steps: u64) -> Result<WorldSpec, CaseError> {
    graded(grains, 1.0, seed, steps)
}

/// One whose radii go down from that of the equal grains to the share 1/`grading` of it.
fn graded(grains: usize, grading: f64, seed: usize, steps: u64) -> Result<WorldSpec, CaseError> {
    let radii = [RADIUS / grading, RADIUS];
    let sizes = if grading > 1.0 { format!("{{ uniform = {radii:?} }}") } else { format!("{RADIUS:?}") };
    let mut world = SCENE.world(&[
        format!("particles.grains.count={grains}"),
        format!("particles.grains.radius={sizes}"),
        format!("domain.max={}", cell(grains, radii, DENSE)),
        format!("seed={seed}"),
    ])?;
    let dt = prepare(world.clone())?.0.dt;
    let strain = STRAIN.min(0.9 * STRAIN_PER_STEP * steps as f64);
    let rate = Drive::Rate(strain / (steps as f64 * dt));
    let still = Drive::Rate(0.0);
    world.stages = vec![Stage {
        name: "compress".to_owned(),
        deformation: Some(Deformation {
            drive: [rate, rate, rate, still, still, still],
            inertial_number: 1.0,
            ..Deformation::default()
        }),
        until: Until { at_most: Some(steps as f64 * dt), ..Until::default() },
        ..Stage::default()
    }];
    world.sampling.series = steps as f64 * dt;
    // As in studies, which samples are for.
    world.throughput = true;
    Ok(world)
}

/// Wall time of a step of worlds together \[s\], and their digests: the least of three, or of one in the quick size.
pub(super) fn timed(
    worlds: Vec<WorldSpec>,
    trial: Trial<'_>,
    steps: u64,
) -> Result<(f64, Vec<String>), CaseError> {
    least_of(if trial.quick { 1 } else { 3 }, worlds, trial, steps)
}

fn least_of(
    repeats: usize,
    worlds: Vec<WorldSpec>,
    trial: Trial<'_>,
    steps: u64,
) -> Result<(f64, Vec<String>), CaseError> {
    let made = worlds.into_iter().map(prepare).collect::<Result<Vec<_>, _>>()?;
    let constants: Vec<_> = made.iter().map(|(constants, _)| constants.clone()).collect();
    admit(trial.backend, &constants)?;
    let mut best = f64::INFINITY;
    let mut hashes = Vec::new();
    for _ in 0..repeats {
        let mut batch = Batch::from_states(made.clone(), trial.backend);
        let began = Instant::now();
        while batch.running() {
            let Ok(()) = batch.advance(&mut Blind);
        }
        best = best.min(began.elapsed().as_secs_f64() / steps as f64);
        if let Some(w) = (0..batch.len()).find(|&w| *batch.status(w) != Status::Done) {
            return Err(CaseError::stopped(&batch.constants(w).spec.title, batch.status(w)));
        }
        hashes = (0..batch.len()).map(|w| batch.state(w).hash()).collect();
    }
    Ok((best, hashes))
}

fn with(search: Search, mut world: WorldSpec) -> WorldSpec {
    world.search = search;
    world
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let size = if trial.quick { QUICK } else { FULL };
    let mut found = Findings::default();
    let on_device = !trial.quick && !Backend::ALL.contains(&trial.backend);
    let more: &[usize] = if on_device { &MORE_GRAINS } else { &[] };
    let counts = [size.grains, more].concat();
    let mut costs = SEARCHES.map(|_| Vec::new());
    for &grains in &counts {
        let world = world(grains, 1, size.steps)?;
        for (costs, search) in costs.iter_mut().zip(SEARCHES) {
            costs.push(timed(vec![with(search, world.clone())], trial, size.steps)?.0);
        }
    }
    let figure = scaling(&mut found, trial, "grains", "one sample", &counts, &costs);
    found.figures.push(("grains", figure));

    let mut together = SEARCHES.map(|_| Vec::new());
    let mut costs = SEARCHES.map(|_| Vec::new());
    for &samples in size.samples {
        let worlds =
            (1..=samples).map(|seed| world(size.each, seed, size.steps)).collect::<Result<Vec<_>, _>>()?;
        for (k, search) in SEARCHES.into_iter().enumerate() {
            let worlds = worlds.iter().map(|world| with(search, world.clone())).collect();
            let (cost, hashes) = timed(worlds, trial, size.steps)?;
            costs[k].push(cost);
            together[k] = hashes;
        }
    }
    let each = format!("samples of {} grains", size.each);
    let figure = scaling(&mut found, trial, "samples", &each, size.samples, &costs);
    found.figures.push(("samples", figure));

    let mut other = 0.0;
    for (search, together) in SEARCHES.into_iter().zip(&together) {
        // Of the many in full, some tell as much of the second search.
        let stride = if trial.quick || search == Search::Grid { 1 } else { 10 };
        for (k, hash) in together.iter().enumerate().step_by(stride) {
            let alone = with(search, world(size.each, k + 1, size.steps)?);
            let alone = least_of(1, vec![alone], trial, size.steps)?.1;
            other += f64::from(u8::from(alone.first() != Some(hash)));
        }
    }
    found.zero("samples_with_other_bits_alone", other);

    for grading in GRADINGS {
        let world = graded(size.graded, grading, 1, size.steps)?;
        let mut costs = [0.0; 2];
        for (cost, search) in costs.iter_mut().zip(SEARCHES) {
            *cost = timed(vec![with(search, world.clone())], trial, size.steps)?.0;
        }
        let [grid, bvh] = costs;
        found.report(format!("us_per_step_of_1_to_{grading}_grid"), 1e6 * grid);
        found.report(format!("bvh_over_grid_of_1_to_{grading}"), bvh / grid);
    }
    Ok(found)
}

/// Asks that the cost of steps \[s\] is linear in numbers, for each search, and draws it.
fn scaling(
    found: &mut Findings,
    trial: Trial<'_>,
    name: &str,
    of: &str,
    counts: &[usize],
    costs: &[Vec<f64>; 2],
) -> String {
    let counts: Vec<f64> = counts.iter().map(|n| *n as f64).collect();
    for (search, costs) in SEARCHES.into_iter().zip(costs) {
        let both: Vec<[f64; 2]> = counts.iter().zip(costs).map(|(n, t)| [*n, *t]).collect();
        let exponent = if trial.quick { power_law(&counts, costs) } else { upper_power(&both) };
        let name = format!("exponent_over_{name}_{}", search.name());
        if trial.quick {
            found.report(name, exponent);
        } else {
            found.near(name, exponent, 1.0, APART);
        }
    }
    let mut ratios = costs[1].iter().zip(&costs[0]).map(|(bvh, grid)| bvh / grid);
    found.report(format!("bvh_over_grid_of_most_{name}"), ratios.next_back().unwrap_or(f64::NAN));
    let microseconds = |costs: &Vec<f64>| costs.iter().map(|s| 1e6 * s).collect::<Vec<f64>>();
    let named = |k: usize| (SEARCHES[k].name().to_owned(), counts.as_slice(), microseconds(&costs[k]));
    let y = Axis::new("wall time of a step", "µs").log();
    figure(&format!("Cost of a step of {of}"), Axis::new(name, "").log(), y, &[named(0), named(1)])
}
