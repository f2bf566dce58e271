//! Cost against the number of grains of a sample and of samples (Lubbe et al. 2022, section 11, figures 12 and 13).
//!
//! The paper's: strain-driven isotropic compression of equal grains of 0.15 mm in diameter (its text says 0.015 mm),
//! table 1, its cost linear in both numbers. Chosen: that samples are dense, where the paper ends at a solid fraction
//! of 12 %; the steps; the limits on the exponents; on a device larger samples besides, since 32 000 grains cost it hardly
//! more than 2000, and the exponent of those that cost four times the smallest and more. Every sample must end with the
//! same bits as alone. The quick size shares its machine with other things and reports the exponents. The paper compares a uniform grid with a hierarchy
//! of bounding volumes; here is one search for both kinds of samples.

use std::time::Instant;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind, Status};
use glebe_engine::cell::STRAIN_PER_STEP;
use glebe_engine::prepare;
use glebe_engine::spec::{Deformation, Drive, Stage, Until, WorldSpec};
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
    steps: u64,
}

const QUICK: Size = Size { grains: &[200, 400, 800, 1600], samples: &[1, 2, 4, 8], each: 400, steps: 300 };
const FULL: Size = Size {
    grains: &[2000, 4000, 8000, 16_000, 32_000],
    samples: &[50, 100, 200, 400],
    each: 2000,
    steps: 2000,
};
/// What a device is full with.
const MORE_GRAINS: [usize; 4] = [64_000, 128_000, 256_000, 512_000];
/// Share of the cell that grains fill at first, so that they soon touch.
const DENSE: f64 = 0.58;
/// Strain along each axis, or as much as steps allow.
const STRAIN: f64 = 0.04;
/// What exponents may differ by from 1.
const APART: f64 = 0.25;

/// A sample under compression from all sides.
pub(super) fn world(grains: usize, seed: usize, steps: u64) -> Result<WorldSpec, CaseError> {
    let mut world = SCENE.world(&[
        format!("particles.grains.count={grains}"),
        format!("particles.grains.radius={RADIUS:?}"),
        format!("domain.max={}", cell(grains, [RADIUS; 2], DENSE)),
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

/// Wall time of a step of worlds together \[s\], the least of so many, and their digests.
pub(super) fn timed(
    worlds: Vec<WorldSpec>,
    trial: Trial<'_>,
    steps: u64,
    repeats: usize,
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

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let size = if trial.quick { QUICK } else { FULL };
    let repeats = if trial.quick { 1 } else { 3 };
    let mut found = Findings::default();
    let over = |found: &mut Findings, name: &str, counts: &[usize], costs: &[f64]| {
        let x: Vec<f64> = counts.iter().map(|n| *n as f64).collect();
        let both: Vec<[f64; 2]> = x.iter().zip(costs).map(|(n, t)| [*n, *t]).collect();
        let exponent = if trial.quick { power_law(&x, costs) } else { upper_power(&both) };
        if trial.quick {
            found.report(format!("exponent_over_{name}"), exponent);
        } else {
            found.near(format!("exponent_over_{name}"), exponent, 1.0, APART);
        }
        x
    };
    let mut costs = Vec::new();
    let on_device = !trial.quick && !Backend::ALL.contains(&trial.backend);
    let more: &[usize] = if on_device { &MORE_GRAINS } else { &[] };
    let counts = [size.grains, more].concat();
    for &grains in &counts {
        costs.push(timed(vec![world(grains, 1, size.steps)?], trial, size.steps, repeats)?.0);
    }
    let grains = over(&mut found, "grains", &counts, &costs);
    let title = "Cost of a step of one sample";
    let curve = [("found".to_owned(), grains.as_slice(), costs.iter().map(|s| 1e6 * s).collect())];
    let y = || Axis::new("wall time of a step", "µs").log();
    found.figures.push(("grains", figure(title, Axis::new("grains", "").log(), y(), &curve)));

    let (mut costs, mut together) = (Vec::new(), Vec::new());
    for &samples in size.samples {
        let worlds =
            (1..=samples).map(|seed| world(size.each, seed, size.steps)).collect::<Result<_, _>>()?;
        let (cost, hashes) = timed(worlds, trial, size.steps, repeats)?;
        costs.push(cost);
        together = hashes;
    }
    let samples = over(&mut found, "samples", size.samples, &costs);
    let title = format!("Cost of a step of samples of {} grains", size.each);
    let curve = [("found".to_owned(), samples.as_slice(), costs.iter().map(|s| 1e6 * s).collect())];
    found.figures.push(("samples", figure(&title, Axis::new("samples", "").log(), y(), &curve)));

    let mut other = 0.0;
    for (k, hash) in together.iter().enumerate() {
        let alone = timed(vec![world(size.each, k + 1, size.steps)?], trial, size.steps, 1)?.1;
        other += f64::from(u8::from(alone.first() != Some(hash)));
    }
    found.zero("samples_with_other_bits_alone", other);
    Ok(found)
}
