//! Share of time per phase (Nagy et al. 2024, table B.6).
//!
//! `glebe run --profile` prints it for any run; here it is taken for the falling spheres of case A2. Chosen: their
//! numbers. The paper counts operations on its card, two thirds of which search contacts, since its cells are filled
//! anew in each step; lists that last for many steps leave less to search, which is no mistake, so shares are reported.
//! What is asked is that the phases account for the time that passed. A device takes its steps without the host and
//! tells two phases, steps and looks at energies, each with the compilation of its kernels.

use std::time::Instant;

use glebe_engine::batch::{Batch, Status};
use glebe_engine::prepare;
use glebe_report::{Axis, Plot, Series, Style};

use super::a2::world;
use super::case::{Case, CaseError, Findings};
use super::trial::{Record, Trial};
use crate::device::admit;

pub(super) const CASE: Case = Case {
    id: "A7",
    name: "phases",
    shows: "the phases of a step account for the time of a run; their shares against the number of particles",
    source: "Nagy et al. 2024 (GPUDEM), section 3.5, table B.6",
    run,
};

/// Powers of two, and steps.
const QUICK: ([u32; 3], u64) = ([8, 10, 12], 600);
const FULL: ([u32; 3], u64) = ([12, 15, 18], 2500);

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let (powers, steps) = if trial.quick { QUICK } else { FULL };
    let mut found = Findings::default();
    let mut curves: Vec<(&'static str, Vec<f64>)> = Vec::new();
    for power in powers {
        let count = 1_usize << power;
        let mut world = world(count, steps)?;
        world.sampling.energy_ledger = true;
        let (constants, state) = prepare(world)?;
        admit(trial.backend, std::slice::from_ref(&constants))?;
        let title = constants.spec.title.clone();
        let mut batch = Batch::from_states(vec![(constants, state)], trial.backend);
        let (before, began) = (batch.times(0).rows(), Instant::now());
        while batch.running() {
            let Ok(()) = batch.advance(&mut Record::default());
        }
        let wall = began.elapsed().as_secs_f64();
        if *batch.status(0) != Status::Done {
            return Err(CaseError::stopped(&title, batch.status(0)));
        }
        let mut sum = 0.0;
        for (name, seconds) in batch.times(0).rows() {
            let earlier = before.iter().find(|row| row.0 == name).map_or(0.0, |row| row.1);
            let share = (seconds - earlier) / wall;
            found.report(format!("{name}_share_of_{count}"), share);
            sum += share;
            match curves.iter_mut().find(|curve| curve.0 == name) {
                Some(curve) => curve.1.push(share),
                None => curves.push((name, vec![share])),
            }
        }
        // The rest is sampling, every hundredth step, of the CPU, and what is between the phases.
        found.between(format!("phases_of_{count}"), sum, 0.7, 1.001);
    }
    let n = powers.map(|power| f64::from(1_u32 << power));
    let series = curves.iter().map(|(name, y)| Series { name, x: &n, y, style: Style::Line });
    let plot = Plot {
        title: "Share of time per phase",
        x: Axis::new("particles", "").log(),
        y: Axis::new("share of the wall time", "").from_zero(),
        series: series.collect(),
        ..Plot::default()
    };
    found.figures.push(("shares", plot.to_svg()));
    Ok(found)
}
