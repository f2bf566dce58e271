//! Dense and loose samples of the same sand (Lubbe et al. 2022, section 10, figure 10).
//!
//! The paper's: 100 kPa, the sand of C2, samples of different void ratios, of which it gives no numbers. Chosen: void
//! ratios of 0.56 to 0.80; the pressure of the preparation; the end at 30 %; the limits. The paper states that the
//! dense sample has a peak and softens, that hardening goes with contraction and softening with dilation, and that q
//! over p has a slope of 3. The quick size has three samples of 400 grains, loaded at an inertial number of 1e-2, and
//! the stiffness of C2's.
//!
//! A loose sample is one above the critical void ratio, which is about 0.9 with the strengths of table 2: one of
//! 0.80, the loosest of this case, dilates, and no bound on the loosest can hold. Samples of 0.556, 0.736 and 0.930,
//! strained by stages of a scene with the same sand and rate, whose servo acts every 4 steps instead of 20 and may be
//! ten times as fast, had slopes of 3.02, 3.01 and 2.92, ended at void ratios of 0.91, 0.91 and 0.88 and q over p of
//! 2.13, 2.13 and 2.29; the densest had a peak of 2.47 and grew by 21 %, the loosest shrank by 2.8 %.
//!
//! The quick size fails (`glebe validate C3 --quick`): the sample of 0.80 grows by 8.0 % where the loosest is to shrink,
//! for that reason; that of 0.56 ends at 0.989 of its peak (0.95 at most), and q over p at the end differs by 0.42
//! between samples (0.2 at most). Void ratios at the end (0.91 on average), slopes and void ratios as prepared
//! are as asked for.

use glebe_report::Axis;
use glebe_study::fit::line;

use super::case::{Case, CaseError, Findings};
use super::samples::{Loading, SAND, Samples, end, figure, quick_sand, quick_study, tolerance};
use super::trial::{SceneFile, Trial, scene_file};

pub(super) const CASE: Case = Case {
    id: "C3",
    name: "void-ratios",
    shows: "dense samples peak and dilate, loose ones harden and contract, and all end in one critical state",
    source: "Lubbe et al. 2022 (RVE), section 10, figure 10",
    run,
};

const STUDY: SceneFile = scene_file!("C3-void-ratios/study.toml");
const QUICK: [f64; 3] = [0.56, 0.68, 0.80];
const FULL: [f64; 5] = [0.56, 0.62, 0.68, 0.74, 0.80];

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let (sand, sets, targets) = if trial.quick {
        let mut sets = quick_study();
        sets.push(format!("vary.void_ratio.values={QUICK:?}"));
        (quick_sand().to_vec(), sets, &QUICK[..])
    } else {
        (Vec::new(), Vec::new(), &FULL[..])
    };
    let changes: Vec<_> = sand.iter().map(|(from, to)| (*from, to.as_str())).collect();
    let study =
        Samples { name: "C3-void-ratios", scene: &SAND, changes: &changes, study: &STUDY, sets: &sets };
    let done = study.run(trial)?;
    let mut found = Findings::default();
    let loadings: Vec<Loading<'_>> = done.curves.iter().map(Loading::of).collect();
    for ((target, sample), loading) in targets.iter().zip(&done.summary.samples).zip(&loadings) {
        let name = format!("at_{target}");
        found.near(
            format!("{name}_void_ratio_prepared"),
            sample.void_ratio.unwrap_or(f64::NAN),
            *target,
            tolerance(trial.quick),
        );
        found.report(format!("{name}_preparation_friction"), sample.friction.unwrap_or(f64::NAN));
        found.report(format!("{name}_void_ratio_consolidated"), loading.void_ratio[0]);
        // Since σ₃ is held, dq/dp = 3.
        let slope = line(loading.p, loading.q).map_or(f64::NAN, |[_, slope]| slope);
        found.near(format!("{name}_slope_of_q_over_p"), slope, 3.0, 0.15);
    }
    let ends: Vec<[f64; 3]> =
        loadings.iter().map(|l| [end(&l.ratio()), end(l.void_ratio), end(l.eps_v)]).collect();
    let peak = |l: &Loading<'_>| l.ratio().into_iter().fold(0.0, f64::max);
    let (dense, loose) = (0, loadings.len() - 1);
    found.between("dense_end_over_peak", ends[dense][0] / peak(&loadings[dense]), 0.3, 0.95);
    found.between("dense_volumetric_strain_at_the_end", ends[dense][2], -0.3, -5e-3);
    found.between("loose_end_over_peak", ends[loose][0] / peak(&loadings[loose]), 0.9, 1.0);
    found.between("loose_volumetric_strain_at_the_end", ends[loose][2], 5e-3, 0.3);
    let spread = |values: &mut dyn Iterator<Item = f64>| {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        high - low
    };
    let before = spread(&mut loadings.iter().map(|l| l.void_ratio[0]));
    let after = spread(&mut ends.iter().map(|e| e[1]));
    found.report("critical_q_over_p", ends.iter().map(|e| e[0]).sum::<f64>() / ends.len() as f64);
    found.report("critical_void_ratio", ends.iter().map(|e| e[1]).sum::<f64>() / ends.len() as f64);
    found.between("spread_of_void_ratios_at_the_end_over_the_start", after / before, 0.0, 0.5);
    let ratios = spread(&mut ends.iter().map(|e| e[0]));
    found.between("spread_of_q_over_p_at_the_end", ratios, 0.0, 0.2);

    let named = |x: fn(&Loading<'_>) -> Vec<f64>| -> Vec<(String, Vec<f64>)> {
        targets.iter().zip(&loadings).map(|(e, l)| (format!("e = {e}"), x(l))).collect()
    };
    let draw = |title, x: fn(&Loading<'_>) -> Vec<f64>, ax, y: fn(&Loading<'_>) -> Vec<f64>, ay| {
        let (xs, ys) = (named(x), named(y));
        let curves: Vec<(String, &[f64], Vec<f64>)> =
            xs.iter().zip(ys).map(|((name, x), (_, y))| (name.clone(), x.as_slice(), y)).collect();
        figure(title, ax, ay, &curves)
    };
    let axial = || Axis::new("axial strain", "");
    let strain: fn(&Loading<'_>) -> Vec<f64> = |l| l.strain.to_vec();
    let p: fn(&Loading<'_>) -> Vec<f64> = |l| l.p.to_vec();
    let q = || Axis::new("q", "Pa").from_zero();
    found.figures.push(("stress", draw("Stress", strain, axial(), |l| l.q.to_vec(), q())));
    let volume = Axis::new("volumetric strain, contraction positive", "");
    found.figures.push(("volume", draw("Volume", strain, axial(), |l| l.eps_v.to_vec(), volume)));
    found.figures.push(("path", draw("Stress path", p, Axis::new("p", "Pa"), |l| l.q.to_vec(), q())));
    let specific = Axis::new("specific volume 1 + e", "");
    let v: fn(&Loading<'_>) -> Vec<f64> = |l| l.void_ratio.iter().map(|e| 1.0 + e).collect();
    found
        .figures
        .push(("specific-volume", draw("Specific volume", p, Axis::new("p", "Pa").log(), v, specific)));
    Ok(found)
}
