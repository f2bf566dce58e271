//! Drives the worlds of a batch through their stages, each to its own end, and says what they came to.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glebe_engine::Constants;
use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Observer, Status};
use glebe_engine::exchange::{Inlet, InletState, Supply};
use glebe_engine::generate::solid_volume;
use glebe_engine::spec::{Component, Measure, Stage};
use glebe_engine::state::{MeasureState, Progress, StageResult, State};
use glebe_io::output::summary;

use crate::beds::Bed;

/// A batch under way.
pub struct Drive {
    batch: Batch,
    /// Where settled beds are kept, if they are.
    folder: Option<PathBuf>,
    roles: Vec<Role>,
    started: Instant,
    steps: u64,
    particle_steps: f64,
}

/// What a world has to do with settled beds.
enum Role {
    /// Nothing, or no more.
    Alone,
    /// It settles a bed, for itself and those of these numbers.
    Settles(Bed, Vec<usize>),
    /// It waits for one.
    Waits(Bed),
}

/// What happened to a world, by its number in the batch.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Event {
    /// The state after its first stages came from elsewhere, as the line says.
    Reused(usize, String),
    /// A stage ended.
    StageEnded(usize, StageResult),
    /// Its bed could not be kept for later runs, as the line says.
    NotKept(usize, String),
    /// It is done or failed.
    Ended(usize),
}

/// What a world came to.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// How it stands; one that has not ended is interrupted.
    pub status: summary::Status,
    /// Why it is not done.
    pub reason: Option<String>,
    /// Digest of its complete state; none if it was lost with the device.
    pub state_hash: Option<String>,
    /// Its particles.
    pub particles: summary::Particles,
    /// The stages that ended.
    pub stages: Vec<summary::Stage>,
}

/// Follows worlds that are under way.
pub trait Listener {
    /// A line for the log.
    fn note(&mut self, _line: &str) {}
    /// Something the user should know; it is also in the summary.
    fn warn(&mut self, _line: &str) {}
    /// They go on.
    fn pulse(&mut self, _pulse: &Pulse<'_>) {}
    /// Whether they shall stop at the next sample, so that they can be resumed.
    fn interrupted(&self) -> bool {
        false
    }
}

/// A [`Listener`] that does not.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Listener for Silent {}

/// How worlds stand, at every sample.
#[derive(Clone, Copy)]
pub struct Pulse<'a> {
    /// Those that are under way.
    pub drive: &'a Drive,
    /// Kinetic energy, where one world is followed \[J\].
    pub kinetic: Option<f64>,
    /// All worlds, with those of earlier and later batches.
    pub worlds: usize,
    /// Worlds that have ended.
    pub ended: usize,
    /// The most steps of batches that come later.
    pub later: u64,
}

impl Drive {
    /// Takes up worlds from states. Those that begin with stages worth keeping take the state after them from
    /// `beds`, a folder, if it is there; of those that share one which is not, the first settles it and the others
    /// wait for it.
    pub fn new(
        worlds: Vec<(Arc<Constants>, State)>,
        backend: Backend,
        beds: Option<&Path>,
    ) -> (Self, Vec<Event>) {
        let unwatched = vec![usize::MAX; worlds.len()];
        Self::watched(worlds, &unwatched, backend, beds)
    }

    /// The same where samples are needed of each world from a stage on: that stage is part of no bed.
    pub(crate) fn watched(
        mut worlds: Vec<(Arc<Constants>, State)>,
        from: &[usize],
        backend: Backend,
        beds: Option<&Path>,
    ) -> (Self, Vec<Event>) {
        let mut events = Vec::new();
        let mut roles: Vec<Role> = Vec::new();
        let mut settling: BTreeMap<String, usize> = BTreeMap::new();
        // A bed that is neither kept nor shared is no use.
        let wanted = beds.is_some() || worlds.len() > 1;
        for (w, (constants, state)) in worlds.iter_mut().enumerate() {
            let g = &state.progress;
            let fresh = wanted && g.samples == 0 && g.step == 0;
            let bed = fresh.then(|| Bed::of(constants, state, backend)).flatten();
            let Some(bed) = bed.filter(|bed| bed.stages <= from[w]) else {
                roles.push(Role::Alone);
                continue;
            };
            if let Some(kept) = beds.and_then(|folder| bed.load(constants, folder)) {
                *state = kept;
                let line = reused(constants, &bed, &state.progress, "an earlier run");
                events.push(Event::Reused(w, format!("{line}; --no-cache computes it")));
                roles.push(Role::Alone);
            } else if let Some(&first) = settling.get(&bed.key) {
                if let Some(Role::Settles(_, waiting)) = roles.get_mut(first) {
                    waiting.push(w);
                }
                roles.push(Role::Waits(bed));
            } else {
                settling.insert(bed.key.clone(), w);
                roles.push(Role::Settles(bed, Vec::new()));
            }
        }
        let mut batch = Batch::from_states(worlds, backend);
        for (w, role) in roles.iter().enumerate() {
            if matches!(role, Role::Waits(_)) {
                batch.wait(w);
            }
        }
        let folder = beds.map(Path::to_owned);
        let drive = Self { batch, folder, roles, started: Instant::now(), steps: 0, particle_steps: 0.0 };
        (drive, events)
    }

    /// The batch.
    pub fn batch(&self) -> &Batch {
        &self.batch
    }
    /// When it was taken up.
    pub fn started(&self) -> Instant {
        self.started
    }
    /// Steps since then, of all worlds.
    pub fn steps(&self) -> u64 {
        self.steps
    }
    /// Particles × steps since then.
    pub fn particle_steps(&self) -> f64 {
        self.particle_steps
    }

    /// The most steps that its worlds have before them.
    pub fn steps_left(&self) -> u64 {
        let open = |w: &usize| matches!(self.batch.status(*w), Status::Running | Status::Waiting);
        let worlds = (0..self.batch.len()).filter(open);
        worlds.map(|w| steps_left(self.batch.constants(w), self.batch.progress(w))).sum()
    }

    /// Advances every world that is under way to its next sample or stage end.
    ///
    /// # Errors
    /// The observer's.
    pub fn advance<O: Observer>(&mut self, observer: &mut O) -> Result<Vec<Event>, O::Error> {
        let running = |batch: &Batch, w: usize| *batch.status(w) == Status::Running;
        let before: Vec<Option<(u64, usize)>> = (0..self.batch.len())
            .map(|w| {
                let g = self.batch.progress(w);
                running(&self.batch, w).then_some((g.step, g.results.len()))
            })
            .collect();
        self.batch.advance(observer)?;
        let mut events = Vec::new();
        for (w, before) in before.into_iter().enumerate() {
            let Some((step, ended)) = before else { continue };
            let g = self.batch.progress(w);
            let steps = g.step - step;
            self.steps += steps;
            self.particle_steps += steps as f64 * self.batch.particles(w) as f64;
            events.extend(g.results[ended..].iter().map(|result| Event::StageEnded(w, result.clone())));
            if g.results.len() > ended || !running(&self.batch, w) {
                self.hand_on_bed(w, &mut events);
            }
            if !running(&self.batch, w) {
                events.push(Event::Ended(w));
            }
        }
        Ok(events)
    }

    /// Keeps the bed of a world when the last of its stages has just ended, and lets those begin that wait for it;
    /// if it failed before, each has to find out by itself.
    fn hand_on_bed(&mut self, w: usize, events: &mut Vec<Event>) {
        let stage = self.batch.progress(w).stage;
        let failed = matches!(self.batch.status(w), Status::Failed(_));
        let Some(role) = self.roles.get_mut(w) else { return };
        let over = matches!(role, Role::Settles(bed, _) if bed.stages <= stage || failed);
        if !over {
            return;
        }
        let Role::Settles(bed, waiting) = std::mem::replace(role, Role::Alone) else { return };
        let mut state = None;
        // If the backend failed, the next step tells of it.
        if bed.stages == stage
            && !failed
            && (self.folder.is_some() || !waiting.is_empty())
            && let Ok(mut asleep) = self.batch.sound_state(w)
        {
            bed.send_to_sleep(&mut asleep);
            if let Some(folder) = &self.folder
                && let Err(error) = bed.store(&asleep, folder)
            {
                let line = format!("the settled bed was not kept for later runs: {error}");
                events.push(Event::NotKept(w, line));
            }
            state = Some(asleep);
        }
        for w in waiting {
            let Role::Waits(bed) = std::mem::replace(&mut self.roles[w], Role::Alone) else { continue };
            let state = state.clone().map(|mut state| {
                let constants = self.batch.constants(w);
                bed.wake(constants, &mut state);
                events.push(Event::Reused(w, reused(constants, &bed, &state.progress, "another world")));
                state
            });
            self.batch.begin_from(w, state);
        }
    }

    /// What a world came to, so far or in the end.
    pub fn outcome(&self, w: usize) -> Outcome {
        let (c, g) = (self.batch.constants(w), self.batch.progress(w));
        let state = self.batch.sound_state(w);
        let (status, reason) = match (self.batch.status(w), &state) {
            (Status::Failed(failure), _) | (_, Err(failure)) => {
                (summary::Status::Failed, Some(failure.to_string()))
            }
            (Status::Done, _) => (summary::Status::Done, None),
            (Status::Running | Status::Waiting, _) => {
                (summary::Status::Interrupted, Some("stopped by the user".to_owned()))
            }
        };
        Outcome {
            status,
            reason,
            state_hash: state.ok().map(|state| state.hash()),
            particles: summary::Particles {
                count: self.batch.particles(w) as u64,
                lost: g.lost.iter().map(lost).collect(),
                removed: g.results.iter().map(|r| r.trimmed).sum::<u64>() + g.trimmed,
            },
            stages: stages(c, g),
        }
    }
}

fn reused(c: &Constants, bed: &Bed, g: &Progress, from: &str) -> String {
    let names: Vec<_> = c.spec.stages[..bed.stages].iter().map(|s| s.name.as_str()).collect();
    let time = g.step as f64 * c.dt;
    format!("the state after `{}` was taken from {from} (t = {time:.6} s)", names.join("`, `"))
}

fn lost(l: &glebe_engine::state::Lost) -> summary::Lost {
    let side = format!("{}{}", ['-', '+'][l.side[1]], ['x', 'y', 'z'][l.side[0]]);
    summary::Lost { id: l.id, time: l.time, position: l.position, side }
}

fn stages(c: &Constants, g: &Progress) -> Vec<summary::Stage> {
    let mut start = 0.0;
    let stage = |(spec, result): (&Stage, &StageResult)| {
        let measures = spec.measured().zip(&result.measures).map(|((name, _), m)| {
            let [mean, std] = if m.n == 0 { [f64::NAN; 2] } else { [m.mean, m.std()] };
            (name.to_owned(), summary::Measure { mean, std, n: m.n })
        });
        let stage = summary::Stage {
            name: result.name.clone(),
            ended_by: result.ended_by.clone(),
            start,
            duration: result.time - start,
            measures: measures.collect(),
        };
        start = result.time;
        stage
    };
    c.spec.stages.iter().zip(&g.results).map(stage).collect()
}

/// A line about a stage that ended.
pub fn told(result: &StageResult, c: &Constants) -> String {
    let mut line = format!("stage `{}` ended at t = {:.4} s ({})", result.name, result.time, result.ended_by);
    // Writing to a string cannot fail.
    if result.trimmed > 0 {
        let _ = write!(line, ", {} particles removed", result.trimmed);
    }
    let spec = c.spec.stages.iter().find(|s| s.name == result.name);
    for ((name, unit), m) in spec.iter().flat_map(|s| s.measured()).zip(&result.measures) {
        let _ = match m.n {
            0 => write!(line, "; {name}: nothing measured"),
            1 => write!(line, "; {name} = {:.5} {unit}", m.mean),
            n => write!(line, "; {name} = {:.5} ± {:.3} ({n} steps)", m.mean, m.std()),
        };
    }
    line
}

/// Measures of a stage that ended which measured nothing.
pub fn doubts(result: &StageResult, c: &Constants) -> Vec<String> {
    let Some(spec) = c.spec.stages.iter().find(|s| s.name == result.name) else { return Vec::new() };
    let doubt = |(measure, m): (&Measure, &MeasureState)| {
        let surface = &c.spec.surfaces.get(measure.surface)?.name;
        let why = if m.n == 0 {
            "measured nothing: its window was not reached; lengthen the stage or move the window".to_owned()
        } else if measure.component == Component::Draught && m.mean == 0.0 && m.m2 == 0.0 {
            format!("is 0 throughout: `{surface}` did not move, or nothing touched it")
        } else {
            return None;
        };
        Some(format!("stage `{}`: `{}` of `{surface}` {why}", result.name, measure.name))
    };
    let surveyed = spec.surveys.iter().zip(result.measures.iter().skip(spec.measures.len()));
    let nothing = surveyed.filter(|(_, m)| m.n == 0).map(|(survey, _)| {
        let what = "found nothing: the particles form no heap whose flank has three rings of them or more";
        format!("stage `{}`: the survey `{}` {what}", result.name, survey.name)
    });
    spec.measures.iter().zip(&result.measures).filter_map(doubt).chain(nothing).collect()
}

/// Inlets that had no room for more than a tenth of what should have come.
pub fn blocked(c: &Constants, g: &Progress) -> Vec<String> {
    let told = |(inlet, state): (&Inlet, &InletState)| {
        let (came, waits, least, unit) = match &inlet.supply {
            Supply::Mass(_, grains) => {
                let largest = solid_volume(&[grains.sizes.limits().1]);
                let grain = largest * c.spec.materials.get(grains.material)?.density;
                (state.flow.mass, state.owed, grain, "kg")
            }
            Supply::Number(..) => (state.flow.particles as f64, state.owed, 1.0, "particles"),
            Supply::Outlet(_) => (state.flow.particles as f64, state.queue.len() as f64, 1.0, "particles"),
        };
        (waits > 2.0 * least && waits > 0.1 * (came + waits)).then(|| {
            format!(
                "the inlet `{}` had no room for {waits:.4} {unit} beside the {came:.4} that came: enlarge its region, \
                 let what comes move away faster, or lower the rate",
                inlet.name
            )
        })
    };
    c.spec.inlets.iter().zip(&g.inlets).filter_map(told).collect()
}

/// The most steps that a world has before it; a stage that waits without limit counts as none.
pub(crate) fn steps_left(c: &Constants, g: &Progress) -> u64 {
    let stages = &c.spec.stages;
    let most_steps = |stage: &Stage, dt: f64| stage.until.at_most.map_or(0, |t| (t / dt).round() as u64);
    let ahead: u64 = stages.iter().skip(g.stage + 1).map(|s| most_steps(s, c.dt)).sum();
    let present = stages.get(g.stage).map_or(0, |s| most_steps(s, c.dt));
    ahead + present.saturating_sub(g.step - g.stage_since)
}
