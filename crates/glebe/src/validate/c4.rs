//! Samples in one batch and one after the other (Lubbe et al. 2022, section 11.1, figure 11).
//!
//! The paper's: 100 samples of 2000 equal grains of 0.15 mm in 1 to 100 batches under strain-driven isotropic
//! compression; all at once is 9.8 times as fast as one after the other on its card, and memory is linear. Chosen:
//! samples that are dense, where the paper ends at a solid fraction of 12 %; the steps. Times are of the machine: the
//! quick size, 20 samples of 400 grains, shares it with other things and reports the speedup; in full it is asked for
//! on a device, on which a sample alone leaves most units idle. On the CPU a single sample uses all cores as well.
//! Every division must give the same bits.

use glebe_report::Axis;

use super::c5::{timed, world};
use super::case::{Case, CaseError, Findings};
use super::samples::figure;
use super::trial::Trial;
use glebe_engine::backend::Backend;
use glebe_engine::prepare;

pub(super) const CASE: Case = Case {
    id: "C4",
    name: "batches-of-samples",
    shows: "samples run together are as those run one after the other, and faster where one leaves a device idle",
    source: "Lubbe et al. 2022 (RVE), section 11.1, figure 11",
    run,
};

/// The paper's speedup of one batch.
const PAPER: f64 = 9.8;

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let (samples, grains, steps): (usize, usize, u64) =
        if trial.quick { (20, 400, 100) } else { (100, 2000, 2000) };
    let mut found = Findings::default();
    let worlds = (1..=samples).map(|seed| world(grains, seed, steps)).collect::<Result<Vec<_>, _>>()?;
    let (mut together, mut times, mut first) = (Vec::new(), Vec::new(), Vec::new());
    let mut other = 0.0;
    for each in [1, samples / 10, samples / 2, samples] {
        let (mut time, mut hashes) = (0.0, Vec::new());
        for batch in worlds.chunks(each) {
            let (seconds, of_batch) = timed(batch.to_vec(), trial, steps)?;
            time += seconds;
            hashes.extend(of_batch);
        }
        if first.is_empty() {
            first.clone_from(&hashes);
        }
        other += hashes.iter().zip(&first).filter(|(a, b)| a != b).count() as f64;
        together.push(each as f64);
        times.push(time);
    }
    found.zero("samples_with_other_bits", other);
    let speedups: Vec<f64> = times.iter().map(|time| times[0] / time).collect();
    for (each, speedup) in together.iter().zip(&speedups) {
        found.report(format!("speedup_of_{each}_together"), *speedup);
    }
    found.report("paper_speedup_of_100_together", PAPER);
    let fastest = times.last().map_or(f64::NAN, |time| (samples * grains) as f64 / time);
    found.report("million_particle_steps_per_s_of_one_batch", 1e-6 * fastest);
    let speedup = speedups.last().copied().unwrap_or(f64::NAN);
    if !trial.quick && !matches!(trial.backend, Backend::Cpu | Backend::Reference) {
        found.between("speedup_of_one_batch", speedup, PAPER, 1e4);
    }
    let of = |count: usize| -> Result<Option<f64>, CaseError> {
        let made = worlds[..count]
            .iter()
            .map(|w| Ok(prepare(w.clone())?.0))
            .collect::<Result<Vec<_>, CaseError>>()?;
        Ok(trial.backend.memory(&made).map(|memory| memory.needed as f64))
    };
    if let (Some(half), Some(all)) = (of(samples / 2)?, of(samples)?) {
        found.near("memory_of_all_over_half", all / half, 2.0, 0.2);
    }
    let curve = [("found".to_owned(), together.as_slice(), speedups)];
    let x = Axis::new("samples in a batch", "").log();
    let y = Axis::new("speedup over one at a time", "").from_zero();
    found.figures.push(("speedup", figure("Samples in one batch", x, y, &curve)));
    Ok(found)
}
