//! Fleets of worlds that a backend runs one by one.

use std::sync::Arc;

use rayon::prelude::*;

use super::team::Team;
use super::{Detail, Fleet, Job, Moment, PhaseTimes};
use crate::failure::Failure;
use crate::setup::Constants;
use crate::state::{Progress, State};

/// A world that runs by itself; see [`Fleet`] for what is asked of it.
pub trait World: Send + Sized {
    /// Takes a world in.
    fn new(c: Arc<Constants>, state: &mut State) -> Self;
    /// What does not change.
    fn constants(&self) -> &Arc<Constants>;
    /// One step, with the help of a team.
    fn step(&mut self, g: &mut Progress, team: &Team) -> Result<(), Failure>;
    /// Parts of a step that threads may do side by side.
    fn parts(&self) -> usize {
        1
    }
    /// Energies and contacts now.
    fn observe(&mut self, g: &Progress) -> Moment;
    /// Coordination and forces on triangles now.
    fn detail(&mut self, g: &Progress) -> Detail;
    /// The complete state.
    fn state(&self, g: &Progress) -> State;
    /// Replaces the state.
    fn load(&mut self, state: &mut State);
    /// Time spent since it was taken in.
    fn times(&self) -> PhaseTimes {
        PhaseTimes::default()
    }
    /// Bytes held for its particles and contacts, and the number of particles.
    fn bytes(&self) -> (usize, usize);
}

/// Worlds side by side, on as many threads as there are.
pub struct Worlds<W>(Vec<W>);

impl<W: World> Worlds<W> {
    /// Takes worlds in.
    pub fn new(worlds: Vec<(Arc<Constants>, &mut State)>) -> Self {
        Self(worlds.into_iter().map(|(c, s)| W::new(c, s)).collect())
    }
}

/// Parts of a step that a member of a team has at least.
const PARTS_EACH: usize = 4;
/// Steps for each of its members that a team is made for: a thread takes some tens of microseconds to start.
const WORTH: u64 = 16;

fn advance<W: World>(world: &mut W, job: &mut Job<'_>, team: &Team) {
    let c = world.constants().clone();
    job.outcome = (0..job.steps).try_for_each(|_| {
        if c.governs(job.progress) {
            let tensors = world.observe(job.progress).tensors;
            c.govern(job.progress, tensors.as_ref());
        }
        world.step(job.progress, team)
    });
}

/// What is asked of worlds beside the worlds that it is asked of, each once.
fn side_by_side<W, T>(
    worlds: &mut [W],
    asked: impl IntoIterator<Item = T>,
    of: impl Fn(&T) -> usize,
) -> Vec<(&mut W, T)> {
    let mut worlds: Vec<Option<&mut W>> = worlds.iter_mut().map(Some).collect();
    asked.into_iter().filter_map(|t| Some((worlds[of(&t)].take()?, t))).collect()
}

impl<W: World> Fleet for Worlds<W> {
    fn advance(&mut self, jobs: &mut [Job<'_>]) {
        let mut paired = side_by_side(&mut self.0, jobs, |job| job.world);
        if let [(world, job)] = &mut paired[..] {
            let members = rayon::current_num_threads().min(world.parts() / PARTS_EACH);
            let members = if job.steps < WORTH * members as u64 { 0 } else { members };
            Team::at_work(members, |team| advance(*world, job, team));
            return;
        }
        paired.into_par_iter().for_each(|(world, job)| advance(world, job, &Team::nobody()));
    }

    fn observe(&mut self, asked: &[(usize, &Progress)]) -> Vec<Moment> {
        let paired: Vec<_> = side_by_side(&mut self.0, asked, |(world, _)| *world);
        paired.into_par_iter().map(|(world, (_, progress))| world.observe(progress)).collect()
    }

    fn detail(&mut self, world: usize, state: &State) -> Detail {
        self.0[world].detail(&state.progress)
    }

    fn state(&self, world: usize, progress: &Progress) -> State {
        self.0[world].state(progress)
    }

    fn load(&mut self, world: usize, state: &mut State) {
        self.0[world].load(state);
    }

    fn times(&self, world: usize) -> PhaseTimes {
        self.0[world].times()
    }

    fn bytes_per_particle(&self, world: usize) -> f64 {
        let (bytes, particles) = self.0[world].bytes();
        bytes as f64 / particles.max(1) as f64
    }
}
