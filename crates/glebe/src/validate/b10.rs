//! Stop and restart at any step (Fang et al. 2021, section 3.4).
//!
//! Beside the uninterrupted run goes one that is stopped after *every* step, written to a checkpoint file,
//! read back and taken up anew. Their complete states are compared byte for byte after each step, so a
//! restart at any step continues to the same bits. Done for each integrator.
//!
//! The small file of the paper's program leaves contact history out. That is allowed, but is not the same
//! run: how far it departs is reported.
//!
//! Everything about the scene is chosen.

use std::path::Path;
use std::sync::Arc;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Status, positions};
use glebe_engine::spec::WorldSpec;
use glebe_engine::state::State;
use glebe_engine::{Constants, prepare};
use glebe_io::checkpoint::{self, Header};
use glebe_physics::IntegratorKind;
use glebe_report::{Axis, Plot, Series, Style};

use super::case::{Case, CaseError, Findings};
use super::trial::{Folder, Record, SceneFile, Trial, largest, scene_file};
use crate::device::admit;

pub(super) const CASE: Case = Case {
    id: "B10",
    name: "restart",
    shows: "a run restarted from its file after every step equals the uninterrupted one bit for bit",
    source: "Fang et al. 2021 (Chrono::GPU), section 3.4",
    run,
};

const SCENE: SceneFile = scene_file!("B10-restart/scene.toml");
/// Step after which one run forgets contact history.
const FORGET_AT: u64 = 250;

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let mut found = Findings::default();
    let folder = Folder::new("restart")?;
    let mut curves = Vec::new();
    for kind in IntegratorKind::ALL {
        let world = SCENE.world(&[format!("time.integrator={}", kind.name())])?;
        let together = side_by_side(world, trial.backend, &folder.0.join("state.glebe"))?;
        let name = kind.name();
        found.zero(format!("{name}_steps_that_differ"), together.differing as f64);
        found.report(format!("{name}_steps_compared"), together.steps as f64);
        found.report(format!("{name}_rebuilds"), together.rebuilds as f64);
        found.report(
            format!("{name}_without_history_departs_mm"),
            together.forgetful.last().copied().unwrap_or_default(),
        );
        curves.push((name, together));
    }
    found.figures.push(("departure", figure(&curves)));
    Ok(found)
}

/// Two runs and what is between them.
struct Together {
    steps: u64,
    rebuilds: u64,
    /// Steps after which the states differ in any byte.
    differing: u64,
    /// Time \[s\].
    time: Vec<f64>,
    /// Largest distance between the same sphere in both runs \[mm\].
    restarted: Vec<f64>,
    /// The same, to a run that was restarted once, without history.
    forgetful: Vec<f64>,
}

fn side_by_side(world: WorldSpec, backend: Backend, file: &Path) -> Result<Together, CaseError> {
    let (constants, fresh) = prepare(world)?;
    admit(backend, std::slice::from_ref(&constants))?;
    let take_up = |state: State| Batch::from_states(vec![(constants.clone(), state)], backend);
    let mut stored = fresh.clone();
    let mut whole = take_up(fresh);
    let mut without: Option<Batch> = None;
    let mut all = Together {
        steps: 0,
        rebuilds: 0,
        differing: 0,
        time: Vec::new(),
        restarted: Vec::new(),
        forgetful: Vec::new(),
    };
    while whole.running() {
        let mut piece = take_up(through_file(&stored, file)?);
        advance(&mut piece);
        advance(&mut whole);
        if let Some(b) = without.as_mut().filter(|b| b.running()) {
            advance(b);
        }
        let state = whole.state(0);
        stored = piece.state(0);
        all.steps = state.progress.step;
        all.rebuilds = state.progress.rebuilds;
        all.differing += u64::from(state.to_bytes() != stored.to_bytes());
        all.time.push(whole.time(0));
        all.restarted.push(departure(&constants, &state, &stored));
        let forgotten = without.as_ref().map_or(0.0, |b| departure(&constants, &state, &b.state(0)));
        all.forgetful.push(forgotten);
        // The blade moves by then, so that contacts of all kinds have stretched their springs.
        if all.steps == FORGET_AT {
            let mut state = state;
            state.contacts.clear();
            state.surface_contacts.clear();
            without = Some(take_up(state));
        }
    }
    match whole.status(0) {
        Status::Done => Ok(all),
        other => Err(CaseError::stopped(&constants.spec.title, other)),
    }
}

/// To the next sample: the scene takes one after each step.
fn advance(batch: &mut Batch) {
    let Ok(()) = batch.advance(&mut Record::default());
}

/// The state, written to a file and read back.
fn through_file(state: &State, file: &Path) -> Result<State, CaseError> {
    let header = Header { step: state.progress.step, ..Header::default() };
    checkpoint::write(file, &header, &state.to_bytes())?;
    Ok(State::from_bytes(&checkpoint::read(file)?.state)?)
}

/// Largest distance between the same sphere in both states \[mm\]; infinite if they have not the same
/// spheres.
fn departure(constants: &Arc<Constants>, a: &State, b: &State) -> f64 {
    let places = |s: &State| {
        let mut all: Vec<_> = s.particles.id.iter().copied().zip(positions(constants, s)).collect();
        all.sort_by_key(|p| p.0);
        all
    };
    let (a, b) = (places(a), places(b));
    if a.len() != b.len() {
        return f64::INFINITY;
    }
    let periodic = constants.lattice.periodic;
    let size = |k: usize| constants.spec.domain.cell[k][k];
    let apart = a.iter().zip(&b).map(|((_, x), (_, y))| {
        let d = [0, 1, 2].map(|k| {
            let d = x[k] - y[k];
            if periodic[k] { d - size(k) * (d / size(k)).round() } else { d }
        });
        1e3 * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
    });
    largest(apart)
}

fn figure(curves: &[(&str, Together)]) -> String {
    let Some((_, first)) = curves.first() else { return String::new() };
    let names: Vec<String> = curves.iter().map(|(name, _)| format!("{name}, without history")).collect();
    let mut series: Vec<Series<'_>> = curves
        .iter()
        .zip(&names)
        .map(|((_, c), name)| Series { name, x: &c.time, y: &c.forgetful, style: Style::Line })
        .collect();
    let name = "restarted after every step (euler)";
    series.push(Series { name, x: &first.time, y: &first.restarted, style: Style::Dashed });
    Plot {
        title: "Departure from the uninterrupted run",
        x: Axis::new("time", "s"),
        y: Axis::new("largest distance of a sphere", "mm").from_zero(),
        series,
        ..Plot::default()
    }
    .to_svg()
}
