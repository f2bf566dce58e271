//! How a point load comes down through a lattice (Fang et al. 2021, section 4.1.3, figures 7 and 8; Goldenberg and
//! Goldhirsch, Nature 2005).
//!
//! The paper's: 15 rows of 61 and 60 spheres by turns in a plane, a box 122 radii wide, friction 0, 0.1, 0.2 among
//! spheres, a load on the sphere at the middle of the top, put on gradually; the forces on the floor before and with
//! it. It says neither material nor radius, walls nor loads. What it finds: one peak below the load (an elastic
//! response) for small loads or friction, two (a hyperbolic one) for large loads without; the force below the load,
//! over the load, is the same for all small loads and then falls; friction widens the range in which it is.
//!
//! Chosen: R 5 mm, ρ 2500 kg/m³, Hertz with E 1e9 Pa, ν 0.3, e 0.5; floor and walls without friction; local damping
//! of 0.5 and a step of 4e-6 s. The load is weight: the sphere gets heavier from world to world, each of which begins
//! with the particles and contacts of the one before (0.2 s under its own weight, then loads from 0.5 to 146 weights
//! of a sphere in steps of a half, 40 ms each).
//!
//! Asked for: the floor carries the whole load, within 1 % (this is exact); with μ = 0.2 and the least load the force
//! below the load is the largest (within 5 %); with μ = 0 and the largest load it is below 0.8 of the largest, with a
//! peak on either side; the force below the load, over the load, is the same for the two least loads (within 5 %) and
//! falls by a fifth at least from the least to the largest load without friction; with μ = 0.2 it has fallen less
//! than that at every load above 5 weights.
//!
//! **It fails** with μ = 0.2, and passes what is asked of μ = 0. The shapes are the paper's: without friction one
//! peak up to 1.1 weights and two from 5.7 on, with μ = 0.2 one peak up to 5.7 weights and two at 65. But beside each
//! side wall a force is left that no load explains, 0.09 weights of a sphere at the least load and 0.2 at 5.7: the
//! rows were not at rest when the forces without load were taken, and the floor carries 1.095 of the least load. At
//! 146 weights it carries 1.044; there and at 97 the middle gets no more with μ = 0.2 than without friction, where it
//! rises again. Longer rests and an end of loads near 45 weights are to be tried.
//!
//! The quick size has μ = 0 and 0.2, the full size 0.1 too. It takes 907 · (5e4 + 15 · 1e4) · 3 = 5e8 particle-steps,
//! and is a chain of worlds: a card gains nothing here.

use glebe_engine::batch::{Frame, Status};
use glebe_engine::spec::{ParticleSet, WorldSpec};
use glebe_engine::state::State;
use glebe_engine::{Constants, prepare};
use glebe_report::{Axis, Plot, Series, Style};
use std::sync::Arc;

use super::case::{Case, CaseError, Findings};
use super::trial::{Look, SceneFile, Trial, least, run_with, scene_file};

pub(super) const CASE: Case = Case {
    id: "B3",
    name: "point-load",
    shows: "forces below a point load on a lattice: one peak or two, by load and friction",
    source: "Fang et al. 2021 (Chrono::GPU), section 4.1.3, figure 8; Goldenberg and Goldhirsch 2005",
    run,
};

const SCENE: SceneFile = scene_file!("B3-point-load/scene.toml");
const RADIUS: f64 = 0.005;
/// Materials in the order of the scene.
const GRAIN: usize = 0;
const LOADED: usize = 1;
const ROWS: usize = 15;
/// Spheres in a long row.
const LONG: usize = 61;
/// Least and largest load over the weight of a sphere, and the ratio of one to the next.
const LOADS: [f64; 2] = [0.5, 200.0];
const RATIO: f64 = 1.5;
/// How long the rows settle, and how long a load stays \[s\].
const SETTLE: f64 = 0.2;
const HOLD: f64 = 0.04;

/// Forces on the floor with a load, over the load and without what there is without it.
struct Response {
    /// Over the weight of a sphere.
    load: f64,
    /// Of each sphere of the lowest row, from left to right.
    share: Vec<f64>,
}

impl Response {
    fn middle(&self) -> f64 {
        self.share[LONG / 2]
    }
    fn largest(&self) -> f64 {
        self.share.iter().copied().fold(f64::NAN, f64::max)
    }
    /// Place of the largest share over the radius, from the middle.
    fn peak(&self) -> f64 {
        let at = self.share.iter().position(|s| *s == self.largest()).unwrap_or(LONG / 2);
        place(at, 0) / RADIUS
    }
}

fn run(trial: Trial<'_>) -> Result<Findings, CaseError> {
    let frictions: &[f64] = if trial.quick { &[0.0, 0.2] } else { &[0.0, 0.1, 0.2] };
    let chains = chains(frictions, trial)?;
    let mut found = Findings::default();
    for (friction, chain) in frictions.iter().zip(&chains) {
        for (end, response) in [("least", chain.first()), ("largest", chain.last())] {
            let Some(response) = response else { continue };
            let name = |what: &str| format!("mu_{friction}_{end}_load_{what}");
            found.near(name("carried"), response.share.iter().sum(), 1.0, 0.01);
            let middle = response.middle() / response.largest();
            found.report(name("largest_at_over_R"), response.peak());
            if *friction == 0.0 && end == "largest" {
                found.between(name("middle_over_largest"), middle, 0.0, 0.8);
            } else if *friction == 0.2 && end == "least" {
                found.between(name("middle_over_largest"), middle, 0.95, 1.0);
            } else {
                found.report(name("middle_over_largest"), middle);
            }
        }
    }
    let over_first = |chain: &[Response], k: usize| chain[k].middle() / chain[0].middle();
    let [smooth, rough] = [&chains[0], &chains[chains.len() - 1]];
    found.between("mu_0_middle_at_largest_over_least_load", over_first(smooth, smooth.len() - 1), 0.0, 0.8);
    for (friction, chain) in frictions.iter().zip(&chains) {
        let name = format!("mu_{friction}_middle_at_second_over_least_load");
        found.near(name, over_first(chain, 1), 1.0, 0.05);
    }
    let above = (0..smooth.len()).filter(|k| smooth[*k].load > 5.0);
    let gain = least(above.map(|k| over_first(rough, k) - over_first(smooth, k)));
    found.between("mu_0.2_kept_more_of_the_middle_than_mu_0", gain, 0.0, 10.0);
    for (name, (friction, chain)) in
        ["profiles-1", "profiles-2", "profiles-3"].into_iter().zip(frictions.iter().zip(&chains))
    {
        found.figures.push((name, profiles(*friction, chain)));
    }
    found.figures.push(("middle", middles(frictions, &chains)));
    Ok(found)
}

/// The responses to ascending loads, for each friction.
fn chains(frictions: &[f64], trial: Trial<'_>) -> Result<Vec<Vec<Response>>, CaseError> {
    let begin = frictions.iter().map(|friction| Ok(prepare(world(*friction, 0.0, SETTLE)?)?));
    let free = hold(begin.collect::<Result<_, CaseError>>()?, trial)?;
    let mut states: Vec<State> = free.iter().map(|(state, _)| state.clone()).collect();
    let mut chains: Vec<Vec<Response>> = frictions.iter().map(|_| Vec::new()).collect();
    let mut load = LOADS[0];
    while load <= LOADS[1] {
        let mut worlds = Vec::new();
        for (friction, state) in frictions.iter().zip(&states) {
            let (constants, fresh) = prepare(world(*friction, load, HOLD)?)?;
            let begun = state.begin_anew(&constants, &fresh)?;
            worlds.push((constants, begun));
        }
        let force = load * weight(&worlds[0].0.spec);
        let held = hold(worlds, trial)?;
        for (chain, ((_, with), (_, without))) in chains.iter_mut().zip(held.iter().zip(&free)) {
            let share = with.iter().zip(without).map(|(with, without)| (with - without) / force);
            chain.push(Response { load, share: share.collect() });
        }
        states = held.into_iter().map(|(state, _)| state).collect();
        load *= RATIO;
    }
    Ok(chains)
}

/// Runs worlds to their end: their states, and the forces of their lowest rows on the floor \[N\].
fn hold(worlds: Vec<(Arc<Constants>, State)>, trial: Trial<'_>) -> Result<Vec<(State, Vec<f64>)>, CaseError> {
    let mut forces = vec![vec![0.0; LONG]; worlds.len()];
    let mut look = Look(|world: usize, frame: &Frame<'_>| {
        let forces = &mut forces[world];
        forces.fill(0.0);
        for touch in &frame.detail().touches {
            if let Some(force) = forces.get_mut(touch.id as usize)
                && touch.branch[2] < -0.5 * RADIUS
            {
                *force += f64::from(touch.force[2]);
            }
        }
    });
    let batch = run_with(worlds, trial.backend, &mut look)?;
    for w in 0..batch.len() {
        if *batch.status(w) != Status::Done {
            return Err(CaseError::stopped(&batch.constants(w).spec.title, batch.status(w)));
        }
    }
    Ok(forces.into_iter().enumerate().map(|(w, forces)| (batch.state(w), forces)).collect())
}

/// The rows, with a load over the weight of a sphere on the middle of the top.
fn world(friction: f64, load: f64, duration: f64) -> Result<WorldSpec, CaseError> {
    let mut spec = SCENE.world(&[
        format!("material.grain.friction={friction:?}"),
        format!("material.loaded.friction={friction:?}"),
        format!("material.loaded.density={:?}", 2500.0 * (1.0 + load)),
        format!("stage.settle.duration={duration:?}"),
    ])?;
    spec.particles = ParticleSet::default();
    for row in 0..ROWS {
        let z = RADIUS * (1.0 + 3.0_f64.sqrt() * row as f64);
        let count = LONG - row % 2;
        for k in 0..count {
            let top = row + 1 == ROWS && k == LONG / 2;
            spec.particles.push([place(k, row), 0.0, z], RADIUS, if top { LOADED } else { GRAIN });
        }
    }
    Ok(spec)
}

/// x of a sphere of a row \[m\].
fn place(k: usize, row: usize) -> f64 {
    RADIUS * (2.0 * k as f64 - (LONG - 1 - row % 2) as f64)
}

/// Of a sphere \[N\].
fn weight(spec: &WorldSpec) -> f64 {
    let volume = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
    volume * spec.materials[GRAIN].density * spec.gravity[2].abs()
}

fn profiles(friction: f64, chain: &[Response]) -> String {
    let x: Vec<f64> = (0..LONG).map(|k| place(k, 0) / RADIUS).collect();
    let every = (chain.len() / 4).max(1);
    let shown: Vec<(String, &Response)> =
        chain.iter().step_by(every).map(|r| (format!("{:.1} weights", r.load), r)).collect();
    Plot {
        title: &format!("Forces on the floor below a point load, μ = {friction}"),
        x: Axis::new("place over R", ""),
        y: Axis::new("added force over the load", "").from_zero(),
        series: shown
            .iter()
            .map(|(name, r)| Series { name, x: &x, y: &r.share, style: Style::Line })
            .collect(),
        ..Plot::default()
    }
    .to_svg()
}

fn middles(frictions: &[f64], chains: &[Vec<Response>]) -> String {
    let columns: Vec<(String, Vec<f64>, Vec<f64>)> = frictions
        .iter()
        .zip(chains)
        .map(|(friction, chain)| {
            let x = chain.iter().map(|r| r.load).collect();
            (format!("μ = {friction}"), x, chain.iter().map(Response::middle).collect())
        })
        .collect();
    Plot {
        title: "The force below a point load",
        x: Axis::new("load over the weight of a sphere", "").log(),
        y: Axis::new("added force at the middle over the load", "").from_zero(),
        series: columns.iter().map(|(name, x, y)| Series { name, x, y, style: Style::Line }).collect(),
        ..Plot::default()
    }
    .to_svg()
}
