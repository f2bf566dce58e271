//! Batches of worlds and their stages: the only thing that runs. A single simulation is a batch of one.

use std::cell::{OnceCell, RefCell};
use std::convert::Infallible;
use std::sync::Arc;

use serde::Serialize;

use crate::backend::{Backend, Detail, Fleet, Job, Moment, PhaseTimes};
use crate::cell::off_target;
use crate::failure::{Failure, SetupError};
use crate::lattice::dot;
use crate::measure::Interior;
use crate::setup::{Constants, prepare};
use crate::spec::{Action, Pose, Until, Vec3, WorldSpec};
use crate::speed::too_fast;
use crate::state::{Bonds, Ledger, MeasureState, Particles, Progress, StageResult, State, draught};
use crate::survey::survey;

/// Steps after which a stage that waits for a low kinetic energy may end though it was never above it.
const PATIENCE: u64 = 100;

/// Kinetic energy of translation as a share of the elastic one below which a sample has reached its stress. Grains that
/// nothing touches spin on for ever, and carry nothing.
const CALM: f64 = 1e-3;

/// How a world stands.
#[derive(Clone, Debug, PartialEq)]
pub enum Status {
    /// Under way.
    Running,
    /// Held until it is given the state to begin from ([`Batch::begin_from`]).
    Waiting,
    /// All stages ended.
    Done,
    /// Stopped with a reason; the other worlds of the batch go on.
    Failed(Failure),
}

/// One row of a world's series.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Simulated time \[s\].
    pub time: f64,
    /// Steps done.
    pub step: u64,
    /// Stage in progress.
    pub stage: usize,
    /// Energy accounts.
    pub ledger: Ledger,
    /// Pairs in contact.
    pub contacts: u64,
    /// Contacts with surfaces.
    pub surface_contacts: u64,
    /// Mean number of contacts of a particle.
    pub coordination: f64,
    /// Largest overlap as a fraction of the smaller radius.
    pub overlap: f64,
    /// Largest speed \[m/s\].
    pub speed: f64,
    /// Particles in the world.
    pub particles: usize,
    /// Bonds made and broken so far.
    pub bonds: Bonds,
    /// Each surface of the specification.
    pub surfaces: Vec<SurfaceSample>,
    /// Each inlet of the specification, then each outlet.
    pub flows: Vec<FlowSample>,
    /// Stress, strain and fabric of a sample ([`Constants::is_sample`]).
    pub interior: Option<Interior>,
}

/// An inlet or outlet in a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FlowSample {
    /// Particles that went through it since the start.
    pub particles: u64,
    /// Their mass \[kg\].
    pub mass: f64,
    /// Mass per time since the last sample \[kg/s\].
    pub rate: f64,
}

/// A surface in a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SurfaceSample {
    /// Mean force of the particles on it since the last sample \[N\].
    pub force: Vec3,
    /// Mean torque about its frame's origin \[N m\].
    pub torque: Vec3,
    /// The force against its velocity \[N\].
    pub draught: f64,
    /// Path of its origin since the stage began \[m\].
    pub path: f64,
    /// Where it stands.
    pub pose: Pose,
    /// Whether it is there.
    pub present: bool,
    /// Volume that it has lost to wear since the start \[m³\], if it wears.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wear: Option<f64>,
}

/// What a world shows at a frame.
pub struct Frame<'a> {
    /// The world's constants.
    pub constants: &'a Constants,
    /// Complete state.
    pub state: &'a State,
    /// Positions in the order of storage \[m\].
    pub positions: &'a [Vec3],
    /// Simulated time \[s\].
    pub time: f64,
    world: usize,
    fleet: RefCell<&'a mut dyn Fleet>,
    detail: OnceCell<Detail>,
}

impl Frame<'_> {
    /// Coordination, contacts and forces on triangles. Found when first asked for, on the host: of a world on a device this takes
    /// far longer than all else in the frame.
    pub fn detail(&self) -> &Detail {
        self.detail.get_or_init(|| self.fleet.borrow_mut().detail(self.world, self.state))
    }
}

/// The particles of a world at one moment.
#[derive(Debug)]
pub struct Glance<'a> {
    /// Particles in the order of storage.
    pub particles: &'a Particles,
    /// Their positions \[m\].
    pub positions: &'a [Vec3],
    /// Simulated time \[s\].
    pub time: f64,
}

/// Receives what worlds report. Every method may fail; the first error stops the batch's advance.
pub trait Observer {
    /// The observer's error.
    type Error;
    /// A row of the series.
    fn sample(&mut self, _world: usize, _sample: &Sample) -> Result<(), Self::Error> {
        Ok(())
    }
    /// Whether frames are wanted. Those that nobody wants are counted all the same, and cost nothing.
    fn wants_frames(&self) -> bool {
        true
    }
    /// A frame is due.
    fn frame(&mut self, _world: usize, _frame: &Frame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }
    /// Whether the world shall be [shown](Self::look) with a sample that was just reported.
    fn wants_look(&self, _world: usize, _sample: &Sample) -> bool {
        false
    }
    /// Whether the particles of the world shall be [shown](Self::glance) with a sample that was just reported.
    fn wants_glance(&self, _world: usize, _sample: &Sample) -> bool {
        false
    }
    /// The particles of a world that were asked for. On a device this takes far less than a look.
    fn glance(&mut self, _world: usize, _glance: &Glance<'_>) -> Result<(), Self::Error> {
        Ok(())
    }
    /// A world that was asked for.
    fn look(&mut self, _world: usize, _frame: &Frame<'_>) -> Result<(), Self::Error> {
        Ok(())
    }
    /// A stage ended.
    fn stage_ended(
        &mut self,
        _world: usize,
        _index: usize,
        _result: &StageResult,
    ) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// An [`Observer`] that looks at nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Blind;

impl Observer for Blind {
    type Error = Infallible;
    fn wants_frames(&self) -> bool {
        false
    }
}

/// A batch of worlds on one backend.
pub struct Batch {
    worlds: Vec<World>,
    fleet: Box<dyn Fleet>,
    backend: Backend,
}

struct World {
    constants: Arc<Constants>,
    progress: Progress,
    status: Status,
    /// Steps between samples, and between frames.
    every: u64,
    frames: Option<u64>,
    particles: usize,
}

impl Batch {
    /// Prepares worlds. The first that cannot be run is named by its index.
    pub fn new(specs: Vec<WorldSpec>, backend: Backend) -> Result<Self, (usize, SetupError)> {
        let mut worlds = Vec::with_capacity(specs.len());
        for (i, spec) in specs.into_iter().enumerate() {
            worlds.push(prepare(spec).map_err(|e| (i, e))?);
        }
        Ok(Self::from_states(worlds, backend))
    }

    /// Takes up worlds from states, to go on where they were left.
    pub fn from_states(mut worlds: Vec<(Arc<Constants>, State)>, backend: Backend) -> Self {
        let fleet = backend.fleet(worlds.iter_mut().map(|(c, s)| (c.clone(), s)).collect());
        let worlds = worlds
            .into_iter()
            .map(|(constants, state)| {
                let every = constants.sample_steps();
                let frames = constants.spec.sampling.frames.map(|f| constants.whole_rows(f));
                let mut world = World {
                    particles: state.particles.len(),
                    progress: state.progress,
                    status: Status::Running,
                    constants,
                    every,
                    frames,
                };
                world.status = world.by_stages();
                world
            })
            .collect();
        Self { worlds, fleet, backend }
    }

    /// Number of worlds.
    pub fn len(&self) -> usize {
        self.worlds.len()
    }
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.worlds.is_empty()
    }
    /// The backend.
    pub fn backend(&self) -> Backend {
        self.backend
    }
    /// Whether any world is under way.
    pub fn running(&self) -> bool {
        self.worlds.iter().any(|w| w.status == Status::Running)
    }
    /// How a world stands.
    pub fn status(&self, world: usize) -> &Status {
        &self.worlds[world].status
    }
    /// A world's constants.
    pub fn constants(&self, world: usize) -> &Arc<Constants> {
        &self.worlds[world].constants
    }
    /// A world's progress.
    pub fn progress(&self, world: usize) -> &Progress {
        &self.worlds[world].progress
    }
    /// Simulated time of a world \[s\].
    pub fn time(&self, world: usize) -> f64 {
        self.worlds[world].time()
    }
    /// Particles in a world.
    pub fn particles(&self, world: usize) -> usize {
        self.worlds[world].particles
    }
    /// The complete state of a world; a pure read.
    pub fn state(&self, world: usize) -> State {
        self.fleet.state(world, &self.worlds[world].progress)
    }
    /// The complete state of a world, if its backend can be trusted once it was read.
    ///
    /// # Errors
    /// Why it cannot be trusted.
    pub fn sound_state(&self, world: usize) -> Result<State, Failure> {
        let state = self.state(world);
        self.fault(world).map_or(Ok(state), Err)
    }
    /// Why what was last read of a world may be wrong, if its backend failed.
    pub fn fault(&self, world: usize) -> Option<Failure> {
        self.fleet.fault(world, &self.worlds[world].progress)
    }
    /// Time spent in a world's phases.
    pub fn times(&self, world: usize) -> PhaseTimes {
        self.fleet.times(world)
    }
    /// Bytes per particle of a world.
    pub fn bytes_per_particle(&self, world: usize) -> f64 {
        self.fleet.bytes_per_particle(world)
    }
    /// Energies and contacts of a world now.
    pub fn moment(&mut self, world: usize) -> Moment {
        self.fleet.moment(world, &self.worlds[world].progress)
    }
    /// Coordination, network and triangle forces of a world now.
    pub fn detail(&mut self, world: usize) -> Detail {
        let state = self.state(world);
        self.fleet.detail(world, &state)
    }

    /// Holds a world that is under way until it is given a state.
    pub fn wait(&mut self, world: usize) {
        let status = &mut self.worlds[world].status;
        if *status == Status::Running {
            *status = Status::Waiting;
        }
    }
    /// Lets a waiting world begin from a state, or from its own if there is none.
    pub fn begin_from(&mut self, world: usize, state: Option<State>) {
        if self.worlds[world].status != Status::Waiting {
            return;
        }
        if let Some(mut state) = state {
            self.fleet.load(world, &mut state);
            self.worlds[world].particles = state.particles.len();
            self.worlds[world].progress = state.progress;
        }
        self.worlds[world].status = self.worlds[world].by_stages();
    }

    /// Advances every running world to its next sample or stage end, and reports.
    pub fn advance<O: Observer>(&mut self, observer: &mut O) -> Result<(), O::Error> {
        for w in 0..self.worlds.len() {
            while self.worlds[w].status == Status::Running && !self.worlds[w].progress.stage_begun {
                self.begin_stage(w, observer)?;
            }
        }
        let mut jobs: Vec<Job<'_>> = Vec::new();
        for (world, w) in self.worlds.iter_mut().enumerate() {
            if w.status == Status::Running {
                let steps = w.steps_to_go();
                jobs.push(Job { world, steps, progress: &mut w.progress, outcome: Ok(()) });
            }
        }
        self.fleet.advance(&mut jobs);
        let outcomes: Vec<_> = jobs.into_iter().map(|j| (j.world, j.outcome)).collect();
        let mut sound = Vec::new();
        for (w, outcome) in outcomes {
            match outcome {
                Ok(()) if self.worlds[w].rests() => sound.push(w),
                Ok(()) => {}
                Err(failure) => self.worlds[w].status = Status::Failed(failure),
            }
            self.turn_upright(w);
        }
        let asked: Vec<_> = sound.iter().map(|&w| (w, &self.worlds[w].progress)).collect();
        let moments = self.fleet.observe(&asked);
        for (w, moment) in sound.into_iter().zip(moments) {
            self.sample(w, &moment, observer)?;
        }
        Ok(())
    }

    /// Stops a world whose backend can no longer be trusted, before what was read of it is reported.
    fn fails(&mut self, w: usize) -> bool {
        let fault = self.fault(w);
        let failed = fault.is_some();
        if let Some(failure) = fault {
            self.worlds[w].status = Status::Failed(failure);
        }
        failed
    }

    fn sample<O: Observer>(&mut self, w: usize, moment: &Moment, observer: &mut O) -> Result<(), O::Error> {
        if self.fails(w) {
            return Ok(());
        }
        let world = &mut self.worlds[w];
        world.particles = world.constants.count_now(&world.progress);
        let sample = world.sample(moment);
        let frame = world.frames.is_some_and(|f| world.progress.step.is_multiple_of(f));
        self.report(w, &sample, frame, observer)?;
        if self.worlds[w].status != Status::Running {
            return Ok(());
        }
        self.exchange(w);
        if self.fails(w) {
            return Ok(());
        }
        let world = &mut self.worlds[w];
        if let Some(ended_by) = world.stage_end(moment) {
            self.end_stage(w, ended_by, observer)?;
        }
        Ok(())
    }

    /// Reports a sample, and shows the world, or its particles, if a `frame` is due or they are asked for.
    fn report<O: Observer>(
        &mut self,
        w: usize,
        sample: &Sample,
        frame: bool,
        observer: &mut O,
    ) -> Result<(), O::Error> {
        observer.sample(w, sample)?;
        if observer.wants_glance(w, sample) {
            let particles = self.fleet.particles(w, &self.worlds[w].progress);
            if self.fails(w) {
                return Ok(());
            }
            let world = &self.worlds[w];
            let positions = decoded(&world.constants, &world.progress, &particles);
            let time = world.time();
            observer.glance(w, &Glance { particles: &particles, positions: &positions, time })?;
        }
        let look = observer.wants_look(w, sample);
        let shown = frame && observer.wants_frames();
        if !look && !shown {
            self.worlds[w].progress.frames += u64::from(frame);
            return Ok(());
        }
        let state = self.state(w);
        if self.fails(w) {
            return Ok(());
        }
        let world = &mut self.worlds[w];
        world.progress.frames += u64::from(frame);
        let positions = positions(&world.constants, &state);
        let seen = Frame {
            constants: &world.constants,
            state: &state,
            positions: &positions,
            time: world.time(),
            world: w,
            fleet: RefCell::new(self.fleet.as_mut()),
            detail: OnceCell::new(),
        };
        if look {
            observer.look(w, &seen)?;
        }
        if shown { observer.frame(w, &seen) } else { Ok(()) }
    }

    /// Does the actions of the present stage. The first sample and frame of a world are taken here.
    fn begin_stage<O: Observer>(&mut self, w: usize, observer: &mut O) -> Result<(), O::Error> {
        let c = self.worlds[w].constants.clone();
        if self.worlds[w].progress.step == 0 && self.worlds[w].progress.samples == 0 {
            let moment = self.moment(w);
            if self.fails(w) {
                return Ok(());
            }
            let world = &mut self.worlds[w];
            world.progress.ledger.initial =
                moment.kinetic() + moment.potential + moment.elastic_normal + moment.elastic_tangential;
            let sample = world.sample(&moment);
            let frame = world.frames.is_some();
            self.report(w, &sample, frame, observer)?;
        }
        let actions = c.spec.stages[self.worlds[w].progress.stage].actions.clone();
        let trimmed = if actions.is_empty() { 0 } else { self.act(w, &actions) };
        if self.fails(w) {
            return Ok(());
        }
        let world = &mut self.worlds[w];
        world.progress.trimmed = trimmed;
        world.progress.stage_begun = true;
        if c.spec.stages[world.progress.stage].only_acts() {
            self.end_stage(w, "actions", observer)?;
        } else if let Some(failure) = too_fast(&c, &world.progress) {
            world.status = Status::Failed(failure);
        }
        Ok(())
    }

    /// Does actions on a world; returns how many particles were removed.
    fn act(&mut self, w: usize, actions: &[Action]) -> u64 {
        let c = self.worlds[w].constants.clone();
        let before = self.moment(w);
        let g = &mut self.worlds[w].progress;
        let mut of_particles = Vec::new();
        for action in actions {
            match action {
                Action::Insert(s) => {
                    let surface = &mut g.surfaces[*s];
                    surface.since = if surface.present { surface.since } else { g.step };
                    surface.present = true;
                }
                Action::Withdraw(s) => {
                    let pose = g.surfaces[*s].placed(&c, *s, g).pose;
                    g.surfaces[*s].base = pose;
                    g.surfaces[*s].present = false;
                }
                Action::RemoveBeyond { .. } | Action::Bond => of_particles.push(action),
            }
        }
        if of_particles.is_empty() {
            let mut g = g.clone();
            unsettle(&mut g);
            self.fleet.renew(w, &mut g);
            self.settle_account(w, g, &before, 0.0);
            return 0;
        }
        let mut state = self.state(w);
        let mut removed = 0;
        for action in of_particles {
            match action {
                Action::RemoveBeyond { axis, limit } => {
                    let keep: Vec<bool> =
                        positions(&c, &state).iter().map(|x| dot(*x, *axis) <= *limit).collect();
                    removed += state.remove(&keep);
                }
                Action::Bond => state.bond(&c),
                Action::Insert(_) | Action::Withdraw(_) => {}
            }
        }
        self.take_over(w, state, &before, 0.0);
        removed
    }

    /// Tells a sample whose cell has come to lean in one that leans less.
    fn turn_upright(&mut self, w: usize) {
        let world = &self.worlds[w];
        if world.status != Status::Running || world.progress.cell.is_none_or(|cell| cell.leaning().is_none())
        {
            return;
        }
        let mut state = self.state(w);
        if self.fails(w) {
            return;
        }
        state.upright(&self.worlds[w].constants);
        self.fleet.load(w, &mut state);
        self.worlds[w].progress = state.progress;
    }

    /// Lets inlets and outlets act that are due.
    fn exchange(&mut self, w: usize) {
        let c = self.worlds[w].constants.clone();
        let g = &mut self.worlds[w].progress;
        if c.spec.inlets.is_empty() && c.spec.outlets.is_empty() {
            return;
        }
        c.accrue(g);
        if !c.exchanges(g) {
            return;
        }
        let mut state = self.state(w);
        let (entered, changed) = c.exchange(&mut state);
        if changed {
            let before = self.moment(w);
            self.take_over(w, state, &before, entered);
        }
    }

    /// Loads a world's state that was changed from the moment `before`, with particles of the energy `entered` \[J\]
    /// added, and accounts for what was taken out.
    fn take_over(&mut self, w: usize, mut state: State, before: &Moment, entered: f64) {
        unsettle(&mut state.progress);
        self.fleet.load(w, &mut state);
        self.worlds[w].particles = state.particles.len();
        self.settle_account(w, state.progress, before, entered);
    }

    /// Gives a world that was changed from the moment `before` its progress, and accounts for the energy that went.
    fn settle_account(&mut self, w: usize, mut g: Progress, before: &Moment, entered: f64) {
        let after = self.fleet.moment(w, &g);
        let energy = |m: &Moment| m.kinetic() + m.potential + m.elastic_normal + m.elastic_tangential;
        g.ledger.entered += entered;
        g.ledger.removed += energy(before) + entered - energy(&after);
        g.ledger.elastic_tangential += after.elastic_tangential - before.elastic_tangential;
        self.worlds[w].progress = g;
    }

    /// What the particles of a world come to now that its stage ends.
    fn surveys(&self, w: usize, c: &Constants) -> Vec<MeasureState> {
        let surveys = &c.spec.stages[self.worlds[w].progress.stage].surveys;
        if surveys.is_empty() {
            return Vec::new();
        }
        let state = self.state(w);
        let one = |found: Option<f64>| {
            let mut value = MeasureState::default();
            if let Some(x) = found {
                value.add(x);
            }
            value
        };
        surveys.iter().map(|s| one(survey(c, &state, &s.of))).collect()
    }

    fn end_stage<O: Observer>(
        &mut self,
        w: usize,
        ended_by: &'static str,
        observer: &mut O,
    ) -> Result<(), O::Error> {
        let c = self.worlds[w].constants.clone();
        let surveyed = self.surveys(w, &c);
        let world = &mut self.worlds[w];
        // Where the motion changes the new one begins from where the surface stands; a motion that lasts over
        // stages goes on undisturbed.
        let next = world.progress.stage + 1;
        let placed: Vec<_> = (0..c.spec.surfaces.len())
            .map(|s| {
                let moved = |stage: usize| {
                    c.spec.stages.get(stage).is_some_and(|st| st.moves.iter().any(|(m, _)| *m == s))
                };
                (moved(next) || moved(next - 1))
                    .then(|| world.progress.surfaces[s].placed(&c, s, &world.progress).pose)
            })
            .collect();
        let g = &mut world.progress;
        let index = g.stage;
        let mut measures = std::mem::take(&mut g.measures);
        measures.extend(surveyed);
        let result = StageResult {
            name: c.spec.stages[index].name.clone(),
            ended_by: ended_by.to_owned(),
            time: g.step as f64 * c.dt,
            trimmed: g.trimmed,
            measures,
        };
        for (surface, pose) in g.surfaces.iter_mut().zip(placed) {
            if let Some(pose) = pose {
                surface.base = pose;
                surface.since = g.step;
            }
        }
        g.path.fill(0.0);
        g.stage += 1;
        if let Some(cell) = &mut g.cell {
            cell.begin(c.spec.stages.get(g.stage).and_then(|s| s.deformation.as_ref()));
        }
        g.stage_since = g.step;
        g.stage_begun = false;
        g.was_above = false;
        g.kinetic = 0.0;
        g.trimmed = 0;
        let measures = c.spec.stages.get(g.stage).map_or(0, |s| s.measures.len());
        g.measures = vec![MeasureState::default(); measures];
        g.results.push(result.clone());
        if g.stage == c.spec.stages.len() {
            world.status = Status::Done;
        }
        observer.stage_ended(w, index, &result)
    }
}

impl World {
    /// How a world that did not fail stands.
    fn by_stages(&self) -> Status {
        let done = self.progress.stage >= self.constants.spec.stages.len();
        if done { Status::Done } else { Status::Running }
    }

    fn time(&self) -> f64 {
        self.progress.step as f64 * self.constants.dt
    }

    /// Steps to the next sample or the stage's end by time, whichever is first, or until the cell leans too much.
    fn steps_to_go(&self) -> u64 {
        let g = &self.progress;
        let to_sample = self.every - g.step % self.every;
        let steps = match self.stage_steps() {
            Some(limit) => to_sample.min(g.stage_since.saturating_add(limit).saturating_sub(g.step)).max(1),
            None => to_sample,
        };
        let deformation = self.constants.spec.stages[g.stage].deformation.as_ref();
        match (&g.cell, deformation) {
            (Some(cell), Some(d)) => cell.steps_upright(d, self.constants.dt, steps),
            _ => steps,
        }
    }

    /// Whether it is at a sample or at the end of its stage.
    fn rests(&self) -> bool {
        let g = &self.progress;
        let ended = self.stage_steps().is_some_and(|limit| g.step - g.stage_since >= limit);
        g.step.is_multiple_of(self.every) || ended
    }

    /// The most steps that the present stage takes.
    fn stage_steps(&self) -> Option<u64> {
        let until = &self.constants.spec.stages[self.progress.stage].until;
        until.at_most.map(|t| (t / self.constants.dt).round() as u64)
    }

    fn stage_end(&mut self, moment: &Moment) -> Option<&'static str> {
        let kinetic = moment.kinetic();
        let stage = &self.constants.spec.stages[self.progress.stage];
        let until = stage.until;
        let done = self.progress.step - self.progress.stage_since;
        if let Some(limit) = until.kinetic_energy_below {
            self.progress.was_above |= kinetic >= limit;
            // Grains that begin to fall are slow too: without having been above the limit the energy must at
            // least not be rising.
            let quiet = done >= PATIENCE && kinetic <= self.progress.kinetic;
            self.progress.kinetic = kinetic;
            if kinetic < limit && (self.progress.was_above || quiet) {
                return Some("kinetic energy");
            }
        }
        if let (Some(share), Some(deformation), Some(tensors)) =
            (until.stress_within, &stage.deformation, &moment.tensors)
        {
            let calm = moment.translation < CALM * (moment.elastic_normal + moment.elastic_tangential);
            let (cell, _) = self.constants.cell(&self.progress);
            if calm && off_target(deformation, tensors, &cell) <= share {
                return Some("stress");
            }
        }
        let over = self.stage_steps().is_some_and(|s| done >= s);
        let waits = until.kinetic_energy_below.is_some() || until.stress_within.is_some();
        over.then_some(if waits { "at most" } else { "duration" })
    }

    fn sample(&mut self, m: &Moment) -> Sample {
        let c = self.constants.clone();
        let g = &mut self.progress;
        let mut ledger = g.ledger;
        // The spring's stiffness has changed since the last force; what that cost belongs to this moment.
        ledger.stiffness_change += ledger.elastic_tangential - m.elastic_tangential;
        ledger.translation = m.translation;
        ledger.rotation = m.rotation;
        ledger.potential = m.potential;
        ledger.elastic_normal = m.elastic_normal;
        ledger.elastic_tangential = m.elastic_tangential;
        let (cell, strain) = c.cell(g);
        let n = g.impulse_steps.max(1) as f64;
        let surfaces = (0..c.spec.surfaces.len())
            .map(|s| {
                let mean = g.impulse[s].map(|x| x / n);
                let placed = g.surfaces[s].placed(&c, s, g);
                SurfaceSample {
                    force: [mean[0], mean[1], mean[2]],
                    torque: [mean[3], mean[4], mean[5]],
                    draught: draught(&mean, placed.velocity),
                    path: g.path[s],
                    pose: placed.pose,
                    present: g.surfaces[s].present,
                    wear: g.worn(&c, s).map(|facets| facets.iter().sum()),
                }
            })
            .collect();
        let time = n * c.dt;
        let doors = g.inlets.iter_mut().map(|inlet| &mut inlet.flow).chain(&mut g.outlets);
        let flows = doors
            .map(|flow| FlowSample {
                particles: flow.particles,
                mass: flow.mass,
                rate: std::mem::take(&mut flow.recent) / time,
            })
            .collect();
        for sum in &mut g.impulse {
            *sum = [0.0; 6];
        }
        g.impulse_steps = 0;
        g.samples += 1;
        Sample {
            time: g.step as f64 * c.dt,
            step: g.step,
            stage: g.stage,
            ledger,
            contacts: m.contacts,
            surface_contacts: m.surface_contacts,
            coordination: (2 * m.contacts + m.surface_contacts) as f64 / self.particles.max(1) as f64,
            overlap: m.overlap,
            speed: m.speed,
            particles: self.particles,
            bonds: g.bonds,
            surfaces,
            flows,
            interior: m.tensors.map(|t| Interior::new(&t, &cell, &strain)),
        }
    }
}

/// Tells that a configuration is not that of its lists and accelerations.
fn unsettle(g: &mut Progress) {
    g.stale = true;
    g.primed = false;
}

/// Positions of all particles in the order of storage \[m\].
pub fn positions(c: &Constants, state: &State) -> Vec<Vec3> {
    decoded(c, &state.progress, &state.particles)
}

fn decoded(c: &Constants, progress: &Progress, p: &Particles) -> Vec<Vec3> {
    let lattice = c.lattice_now(progress);
    (0..p.len()).map(|i| lattice.decode(p.hi[i], p.place[i].lo, p.rest[i])).collect()
}

impl State {
    /// Keeps the particles for which `keep` is true, with the contacts among them; returns how many went.
    pub fn remove(&mut self, keep: &[bool]) -> u64 {
        let before = self.particles.len();
        self.particles.retain(keep);
        let mut here: Vec<u32> = self.particles.id.clone();
        here.sort_unstable();
        let stays = |id: u32| here.binary_search(&id).is_ok();
        self.contacts.retain(|m| stays(m.id[0]) && stays(m.id[1]));
        self.surface_contacts.retain(|m| stays(m.id));
        (before - self.particles.len()) as u64
    }
}

impl crate::spec::Stage {
    /// Whether the stage has no end but its actions.
    pub fn only_acts(&self) -> bool {
        self.until == Until::default()
    }
}
