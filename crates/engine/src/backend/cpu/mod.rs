//! The CPU backend: every pair evaluated once, in lanes; sums in a fixed order, so that the same bits come
//! out for any number of threads and any width of vector unit.
//!
//! A step has three phases over blocks of particles: contacts write what they find beside their
//! candidate; each particle sums its contacts in a fixed order and moves; the ledger, if kept, takes
//! dissipation with velocities at mid-step.

#[macro_use]
mod widest;
mod contacts;
mod integrate;
mod lanes;
mod list;
mod pairs;
mod tree;

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use glebe_physics::IntegratorKind;
use glebe_physics::kernel::integrate::{Scheme, Visitor, visit};
use rayon::prelude::*;

use self::contacts::{Found, Phase, Purpose, Scratch, Space, run};
use self::integrate::{Columns, Contacts, Displacements, Moved, Step, advance, quad};
use self::lanes::Pair;
use self::list::{BLOCK, Block, Incoming, Memory, Share};
use super::common::{
    Portrait, Standing, leavers, narrow_failure, overlap_failure, quoted, runaway_failure, strays, too_deep,
    unload,
};
use super::team::Team;
use super::worlds::{World, Worlds};
use super::{Detail, Link, Moment, PhaseTimes, Touch};
use crate::cell::STEP_GROWTH;
use crate::failure::Failure;
use crate::lattice::norm;
use crate::measure::Tensors;
use crate::setup::{Constants, SKIN_MAX, SKIN_MIN, SKIN_WIDER};
use crate::spec::Pose;
use crate::state::{Particles, Progress, Spin, State, Velocity};

/// A rebuild fewer steps than this after the last one widens the skin. With wide gradings it costs some 16 steps.
const REBUILT_SOON: u64 = 60;
/// A rebuild more steps than this after the last one narrows the skin by [`SKIN_NARROWER`].
const REBUILT_LATE: u64 = 100;
/// See [`REBUILT_LATE`].
const SKIN_NARROWER: f64 = 0.8;

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
    static DISPLACEMENTS: RefCell<Displacements> = const { RefCell::new([[0.0; 4]; BLOCK]) };
}

/// Worlds on the CPU. They run side by side, and large ones also on several threads inside.
pub type CpuFleet = Worlds<CpuWorld>;

/// A world on the CPU.
pub struct CpuWorld {
    c: Arc<Constants>,
    space: Space,
    p: Particles,
    blocks: Vec<Block>,
    /// What each block has summed in the last step, for its own particles and for guests.
    sums: Vec<Share>,
    /// The dissipating part of it; empty where no ledger is kept.
    drains: Vec<Share>,
    incoming: Incoming,
    found: Vec<Found>,
    moved: Vec<Moved>,
    pairs: Vec<Pair>,
    standing: Vec<Standing>,
    step: Step,
    times: PhaseTimes,
}

impl World for CpuWorld {
    fn new(c: Arc<Constants>, state: &mut State) -> Self {
        let space = Space { lattice: c.lattice.clone(), gradient: None };
        let mut world = Self {
            pairs: c.pairs.iter().map(Pair::new).collect(),
            step: Step::new(&c, &space),
            space,
            standing: c.boundaries.iter().map(|_| Standing::default()).collect(),
            c,
            p: Particles::default(),
            blocks: Vec::new(),
            sums: Vec::new(),
            drains: Vec::new(),
            incoming: Incoming::default(),
            found: Vec::new(),
            moved: Vec::new(),
            times: PhaseTimes::default(),
        };
        world.load(state);
        world
    }

    fn constants(&self) -> &Arc<Constants> {
        &self.c
    }

    fn parts(&self) -> usize {
        self.blocks.len()
    }

    fn step(&mut self, g: &mut Progress, team: &Team) -> Result<(), Failure> {
        let kind = self.c.spec.time.integrator;
        let split = kind == IntegratorKind::VelocityVerlet;
        let mut clock = Clock(Instant::now());
        if split {
            if !g.primed {
                self.stand(g);
                self.forces(Purpose::Prime, team);
                self.prime();
            }
            let moved = self.motion(g, kind, true, team);
            self.check(g, moved)?;
            // The force belongs to the end of the step, for surfaces too.
            g.step += 1;
            self.deform(g)?;
            self.times.integration += clock.lap();
            if self.strayed(g, moved) {
                self.rebuild(g);
                clock.lap();
            }
        }
        self.stand(g);
        self.times.surfaces += clock.lap();
        self.forces(Purpose::Step, team);
        self.times.forces += clock.lap();
        let moved = self.motion(g, kind, false, team);
        self.times.integration += clock.lap();
        self.account(g, split, moved);
        self.times.ledger += clock.lap();
        self.guard(g)?;
        self.check(g, moved)?;
        g.primed = true;
        if !split {
            g.step += 1;
            self.deform(g)?;
        }
        let stale = self.strayed(g, moved);
        self.times.surfaces += clock.lap();
        if stale {
            self.rebuild(g);
        }
        Ok(())
    }

    fn observe(&mut self, g: &Progress) -> Moment {
        let mut m = Moment::default();
        let found = self.look(g);
        for f in &found {
            m.elastic_normal += f.energy_normal;
            m.elastic_tangential += f.energy_before;
            m.contacts += f.contacts[0];
            m.surface_contacts += f.contacts[1];
            m.overlap = m.overlap.max(f64::from(f.worst.0));
        }
        let sums: Vec<[f64; 4]> = (0..self.blocks.len())
            .into_par_iter()
            .map(|b| {
                let mut s = [0.0; 4];
                for i in b * BLOCK..((b + 1) * BLOCK).min(self.p.len()) {
                    let p = Portrait::of(&self.space.lattice, &self.p, i);
                    let e = p.energy(&self.c);
                    (0..3).for_each(|k| s[k] += e[k]);
                    s[3] = f64::max(s[3], norm(p.v));
                }
                s
            })
            .collect();
        for s in sums {
            m.translation += s[0];
            m.rotation += s[1];
            m.potential += s[2];
            m.speed = m.speed.max(s[3]);
        }
        m.tensors = self.c.is_sample().then(|| self.tensors(&found));
        m
    }

    fn detail(&mut self, g: &Progress) -> Detail {
        let found = self.look(g);
        let mut d = Detail { coordination: vec![0; self.p.len()], ..Detail::default() };
        for s in 0..self.c.spec.surfaces.len() {
            d.on_triangles.push(vec![[0.0; 3]; self.c.boundaries[s].shape.triangles()]);
        }
        for (block, f) in self.blocks.iter().zip(&found) {
            for pair in &f.pairs {
                let [i, j] = pair.of.map(|i| i as usize);
                d.coordination[i] += 1;
                d.coordination[j] += 1;
                d.network.push(Link {
                    id: [self.p.id[i], self.p.id[j]],
                    branch: pair.branch,
                    force: pair.force,
                });
            }
            for pull in &f.surface {
                let i = block.first + pull.local as usize;
                d.coordination[i] += 1;
                d.touches.push(Touch {
                    id: self.p.id[i],
                    surface: pull.boundary,
                    branch: pull.branch,
                    force: pull.force,
                });
                if let Some(s) = self.c.boundaries[pull.boundary as usize].surface {
                    for k in 0..3 {
                        d.on_triangles[s][pull.triangle as usize][k] -= f64::from(pull.force[k]);
                    }
                }
            }
        }
        d
    }

    fn state(&self, g: &Progress) -> State {
        let (contacts, surface_contacts) = list::memories(&self.c, &self.p, &self.blocks);
        State { particles: self.p.clone(), contacts, surface_contacts, progress: g.clone() }
    }

    fn load(&mut self, state: &mut State) {
        self.p = state.particles.clone();
        let g = &mut state.progress;
        self.take_cell(g);
        if g.stale {
            self.refer(g);
            g.stale = false;
        } else {
            self.arrange(g);
        }
        self.list(g, &Memory::Stored(&state.contacts, &state.surface_contacts));
    }

    fn times(&self) -> PhaseTimes {
        self.times
    }

    fn bytes(&self) -> (usize, usize) {
        let per_particle = size_of::<crate::state::Place>()
            + size_of::<Velocity>()
            + size_of::<Spin>()
            + 6 * size_of::<[f32; 3]>()
            + size_of::<[u32; 3]>()
            + size_of::<u32>() * 2;
        let lists: usize = self
            .blocks
            .iter()
            .map(|b| {
                b.candidates.capacity() * (size_of::<list::Candidate>() + 1)
                    + b.history.capacity() * size_of::<list::Quad>()
                    + (b.start.capacity() + b.guests.capacity()) * 4
            })
            .sum();
        let sums = (self.sums.capacity() + self.drains.capacity()) * size_of::<Share>();
        let bytes = self.p.len() * per_particle + lists + sums + self.incoming.entry.len() * 4;
        (bytes, self.p.len())
    }
}

impl CpuWorld {
    /// Puts the particles in the order of lists and makes the present configuration their reference; returns the
    /// old index of each particle.
    fn refer(&mut self, g: &mut Progress) -> Vec<u32> {
        self.p.hi_ref.clone_from(&self.p.hi);
        self.p.lo_ref.clear();
        self.p.lo_ref.extend(self.p.place.iter().map(|p| p.lo));
        g.refer(&self.c);
        g.rebuilds += 1;
        self.arrange(g)
    }

    /// Puts the particles in the order of lists of the reference configuration, if another backend left them in
    /// its own; returns the old index of each.
    fn arrange(&mut self, g: &Progress) -> Vec<u32> {
        let order = list::order(&self.c, &self.c.lattice_then(g), &self.p, g.skin);
        self.p.reorder(&order);
        order
    }

    fn reference_poses(&self, g: &Progress) -> Vec<Option<Pose>> {
        let pose = |b: &crate::setup::Boundary| match b.surface {
            Some(s) => g.surfaces[s].present.then_some(g.surfaces[s].reference),
            None => Some(b.pose),
        };
        self.c.boundaries.iter().map(pose).collect()
    }

    /// Builds the lists of the reference configuration, and room for what they find.
    fn list(&mut self, g: &Progress, memory: &Memory<'_>) {
        self.blocks = list::build(&self.c, &self.p, g, &self.reference_poses(g), memory);
        self.incoming = list::incoming(&self.blocks, self.p.len());
        let shares = self.blocks.iter().map(Block::shares).sum();
        self.sums.clear();
        self.sums.resize(shares, Share::default());
        self.drains.clear();
        if self.c.spec.sampling.energy_ledger {
            self.drains.resize(shares, Share::default());
        }
        self.found.resize_with(self.blocks.len(), Found::default);
        self.moved.resize(self.blocks.len(), Moved::default());
    }

    /// New lists from the present configuration. Particles that left the domain are taken out and listed.
    fn rebuild(&mut self, g: &mut Progress) {
        let began = Instant::now();
        let interval = g.step - g.rebuilt;
        // Fast flows need a wider reach, creeping ones waste it; the choice depends on this world alone.
        let mean = self.c.radius_mean;
        if interval < REBUILT_SOON {
            g.skin = (SKIN_WIDER * g.skin).min(SKIN_MAX * mean);
        } else if interval > REBUILT_LATE {
            g.skin = (SKIN_NARROWER * g.skin).max(SKIN_MIN * mean);
        }
        let mut old: Vec<u32> = (0..self.p.len() as u32).collect();
        let keep = leavers(&self.c, &self.p, g);
        if keep.contains(&false) {
            unload(g, self.springs(g, &keep));
            self.p.retain(&keep);
            let mut at = keep.iter();
            old.retain(|_| *at.next().unwrap_or(&true));
        }
        let old: Vec<u32> = self.refer(g).into_iter().map(|k| old[k as usize]).collect();
        let blocks = std::mem::take(&mut self.blocks);
        self.list(g, &Memory::Lists(&blocks, &old));
        self.times.lists += began.elapsed().as_secs_f64();
    }

    /// Takes up the cell of the present step, and places boundaries.
    fn stand(&mut self, g: &Progress) {
        self.take_cell(g);
        for (standing, boundary) in self.standing.iter_mut().zip(&self.c.boundaries) {
            standing.place(boundary, &self.c, g);
        }
    }

    /// Whether a particle or a surface has moved so far that the lists may miss a contact.
    fn strayed(&self, g: &Progress, moved: Moved) -> bool {
        let Some(cell) = &g.cell else {
            return moved.displacement.sqrt() > 0.5 * g.skin as f32 || self.surface_strayed(g);
        };
        // Displacements were measured in the cell before this step.
        let left = cell.skin_left(g.skin, self.c.touch());
        left <= 0.0 || STEP_GROWTH as f32 * moved.displacement.sqrt() > 0.5 * left as f32
    }

    /// Looks things up in the cell of `g`, if it deforms.
    fn take_cell(&mut self, g: &Progress) {
        if let Some(cell) = &g.cell {
            self.space =
                Space { lattice: self.c.lattice.deformed(&cell.matrix), gradient: Some(cell.gradient) };
            self.step = Step::new(&self.c, &self.space);
        }
    }

    /// Moves the cell by a step, if it deforms.
    fn deform(&mut self, g: &mut Progress) -> Result<(), Failure> {
        if let Some(cell) = &mut g.cell {
            cell.step(self.c.dt);
            self.take_cell(g);
            narrow_failure(&self.c, g, &self.space.lattice)?;
        }
        Ok(())
    }

    /// Whether a surface has moved so far that the lists may miss it.
    fn surface_strayed(&self, g: &Progress) -> bool {
        self.c.boundaries.iter().any(|boundary| {
            let Some(s) = boundary.surface.filter(|&s| g.surfaces[s].present) else { return false };
            let reference = g.surfaces[s].reference;
            let now = g.surfaces[s].placed(&self.c, s, g).pose;
            if now == reference {
                return false;
            }
            strays(&self.c, boundary, &reference, &now) > 0.5 * g.skin
        })
    }

    fn phase<'a>(
        c: &'a Constants,
        space: &'a Space,
        pairs: &'a [Pair],
        p: &'a Particles,
        standing: &'a [Standing],
        purpose: Purpose,
    ) -> Phase<'a> {
        let ledger = c.spec.sampling.energy_ledger;
        let dt = if purpose == Purpose::Step { c.dt as f32 } else { 0.0 };
        Phase { c, space, pairs, p, standing, purpose, ledger, dt, quads: list::quads(c) }
    }

    /// Contacts of every block.
    fn forces(&mut self, purpose: Purpose, team: &Team) {
        let phase = Self::phase(&self.c, &self.space, &self.pairs, &self.p, &self.standing, purpose);
        each(&phase, &mut self.blocks, [&mut self.sums, &mut self.drains], &mut self.found, team);
    }

    /// Accelerations of the present configuration, without a step.
    fn prime(&mut self) {
        for block in &self.blocks {
            let contacts = Contacts { block, sums: &self.sums, drains: &[], incoming: &self.incoming };
            let shares = contacts.shares(contacts.sums);
            for local in 0..block.count() {
                let Share { force: f, torque: t } = shares.sum(local);
                let i = block.first + local;
                let (r, inv_mass) = (self.p.place[i].radius, self.p.velocity[i].inv_mass);
                let carried = self.step.carried(quad(self.p.velocity[i].v));
                for k in 0..3 {
                    self.p.acceleration[i][k] = f[k] * inv_mass + self.step.gravity[k] - carried[k];
                    self.p.angular[i][k] = t[k] * 2.5 * inv_mass / (r * r);
                }
            }
        }
    }

    /// Moves all particles, ahead of or with the force.
    fn motion(&mut self, g: &mut Progress, kind: IntegratorKind, ahead: bool, team: &Team) -> Moved {
        let moved = visit(kind, Motion { world: self, ahead, first: !g.primed, team });
        g.ledger.work += moved.lifted;
        moved
    }

    /// Dissipation, surface forces and work of the step.
    fn account(&mut self, g: &mut Progress, split: bool, moved: Moved) {
        let surfaces = self.c.spec.surfaces.len();
        let mut forces = vec![[0.0; 6]; surfaces];
        for f in &self.found {
            for (sum, x) in forces.iter_mut().flatten().zip(f.on_surface.iter().flatten()) {
                *sum += x;
            }
        }
        g.bonds.broken += self.found.iter().map(|f| f.broken).sum::<u64>();
        let ledger = &mut g.ledger;
        ledger.work += self.found.iter().map(|f| f.work).sum::<f64>();
        ledger.damping += moved.damped;
        if self.c.spec.sampling.energy_ledger {
            let before = ledger.elastic_tangential;
            ledger.elastic_tangential = 0.0;
            for f in &self.found {
                ledger.friction += f.friction_loss;
                ledger.rolling += f.roll_lost;
                ledger.elastic_tangential += f.energy_tangential;
                ledger.stiffness_change -= f.energy_before;
            }
            ledger.stiffness_change += before;
            // Mid-step velocity: the mean of old and new, with which the change of kinetic energy is exact for
            // a force held over the step; in a split step the new one is already in the middle.
            let dt = -self.c.dt;
            let late = if split { 1.0 } else { 0.5 } * moved.drain;
            let [dash, roll] =
                self.found.iter().fold([0.0; 2], |s, f| [s[0] + f.drain[0], s[1] + f.drain[1]]);
            // The late part is a sum over particles, not over contacts: it is shared as the early ones are.
            let share = if dash + roll == 0.0 { 0.0 } else { roll / (dash + roll) };
            ledger.dashpots += dt * (dash + (1.0 - share) * late);
            ledger.rolling += dt * (roll + share * late);
        }
        g.rub(self.found.iter().flat_map(|f| &f.rubs));
        g.account(&self.c, &forces);
    }

    /// Stops the world when particles overlap too much.
    fn guard(&self, g: &mut Progress) -> Result<(), Failure> {
        let mut worst = (0.0_f32, 0, 0);
        for f in &self.found {
            if f.worst.0 > worst.0 {
                worst = f.worst;
            }
        }
        let depth = f64::from(worst.0);
        if !too_deep(&self.c, g, depth) {
            return Ok(());
        }
        let other = match worst.2.checked_sub(u32::MAX - self.c.boundaries.len() as u32) {
            Some(_) => quoted(&self.c, (u32::MAX - worst.2) as usize),
            None => self.describe(worst.2 as usize),
        };
        Err(overlap_failure(&self.c, g, &self.describe(worst.1 as usize), &other, depth))
    }

    /// Stops the world when a particle runs away.
    fn check(&self, g: &Progress, moved: Moved) -> Result<(), Failure> {
        let Some(i) = moved.runaway else { return Ok(()) };
        let i = i as usize;
        Err(runaway_failure(&self.c, g, &self.describe(i), self.p.velocity[i].v.map(f64::from)))
    }

    /// What particle `i` touched in the last step: particles and boundaries.
    fn touching(&self, i: usize) -> (Vec<usize>, Vec<usize>) {
        let (home, local) = (i / BLOCK, i % BLOCK);
        let entries = self.incoming.start[i] as usize..self.incoming.start[i + 1] as usize;
        let visited = self.incoming.entry[entries].iter();
        let hosts = visited.map(|&share| self.incoming.base.partition_point(|&base| base <= share) - 1);
        let mut particles = Vec::new();
        for block in std::iter::once(home).chain(hosts).map(|b| &self.blocks[b]) {
            for (q, _) in block.candidates.iter().zip(&block.touching).filter(|(_, touching)| **touching) {
                let pair = [block.first + q.owner as usize, q.partner as usize];
                particles.extend(pair.iter().position(|&x| x == i).map(|side| pair[1 - side]));
            }
        }
        let patches = &self.blocks[home].patches;
        let patches = patches.iter().filter(|q| q.local as usize == local && !q.contacts.is_empty());
        (particles, patches.map(|q| q.boundary as usize).collect())
    }

    /// A particle in words: number, place, speed, contacts.
    fn describe(&self, i: usize) -> String {
        let (particles, boundaries) = self.touching(i);
        let particles = particles.into_iter().map(|j| self.p.id[j].to_string());
        let boundaries = boundaries.into_iter().map(|b| quoted(&self.c, b));
        Portrait::of(&self.space.lattice, &self.p, i).describe(particles.chain(boundaries).collect())
    }

    /// Energy of the normal and of the tangential springs of particles that do not stay \[J\].
    fn springs(&mut self, g: &Progress, stays: &[bool]) -> [f64; 2] {
        // A pair stands in the block of one of the two.
        let mut blocks = BTreeSet::new();
        for i in (0..stays.len()).filter(|&i| !stays[i]) {
            let (particles, boundaries) = self.touching(i);
            if !particles.is_empty() || !boundaries.is_empty() {
                blocks.insert(i / BLOCK);
                blocks.extend(particles.into_iter().map(|j| j / BLOCK));
            }
        }
        self.stand(g);
        let phase = Self::phase(&self.c, &self.space, &self.pairs, &self.p, &self.standing, Purpose::Observe);
        let mut found = Found::default();
        let mut energy = [0.0; 2];
        for b in blocks {
            let block = &mut self.blocks[b];
            SCRATCH.with_borrow_mut(|scratch| run(&phase, block, &mut [], &mut [], &mut found, scratch));
            let gone = |i: u32| !stays[i as usize];
            let pairs = found.pairs.iter().filter(|q| q.of.into_iter().any(gone)).map(|q| q.energy);
            let surface = found.surface.iter().filter(|q| gone(block.first as u32 + q.local));
            for e in pairs.chain(surface.map(|q| q.energy)) {
                (0..2).for_each(|k| energy[k] += f64::from(e[k]));
            }
        }
        energy
    }

    /// Runs the contact phase on the present configuration without changing it.
    fn look(&mut self, g: &Progress) -> Vec<Found> {
        self.stand(g);
        let phase = Self::phase(&self.c, &self.space, &self.pairs, &self.p, &self.standing, Purpose::Observe);
        let mut found: Vec<Found> = Vec::new();
        found.resize_with(self.blocks.len(), Found::default);
        each(&phase, &mut self.blocks, [&mut self.sums, &mut self.drains], &mut found, &Team::nobody());
        found
    }

    /// Sums over the contacts that were found.
    fn tensors(&self, found: &[Found]) -> Tensors {
        let mut t = Tensors::default();
        let mut contacts = vec![0_u32; self.p.len()];
        for pair in found.iter().flat_map(|f| &f.pairs) {
            t.add_contact(pair.branch, pair.force.map(f64::from), f64::from(pair.stiffness));
            pair.of.into_iter().for_each(|i| contacts[i as usize] += 1);
        }
        for (i, n) in contacts.into_iter().enumerate() {
            let v = self.p.velocity[i];
            let mass = 1.0 / f64::from(v.inv_mass);
            t.add_particle(mass, f64::from(self.p.place[i].radius), v.v.map(f64::from), n);
        }
        t
    }
}

/// Pairs of particles within reach of each other in the present configuration of a state: their places in the order of
/// storage, and how far their centres are apart \[m\].
pub fn near_pairs(c: &Constants, state: &State) -> Vec<([usize; 2], f64)> {
    let (mut p, mut g) = (state.particles.clone(), state.progress.clone());
    p.hi_ref.clone_from(&p.hi);
    p.lo_ref = p.place.iter().map(|place| place.lo).collect();
    g.refer(c);
    g.skin = SKIN_MIN * c.radius_mean;
    let lattice = c.lattice_then(&g);
    let order = list::order(c, &lattice, &p, g.skin);
    p.reorder(&order);
    let mut found = Vec::new();
    for block in list::build(c, &p, &g, &[], &Memory::Stored(&[], &[])) {
        for q in &block.candidates {
            let [i, j] = [block.first + q.owner as usize, q.partner as usize];
            let (from, to) = (p.place[i].lo, p.place[j].lo);
            let apart = [0, 1, 2].map(|k| to[k].wrapping_sub(from[k]));
            let d = pairs::metres::<false>(&lattice.unit, [apart[0], apart[1], apart[2], 0]);
            found.push(([i, j].map(|k| order[k] as usize), norm(d)));
        }
    }
    found
}

/// Blocks that are not worth waking threads for: one takes some tens of microseconds.
const FEW: usize = 4;

/// The contact phase over all blocks, on as many threads as pay.
fn each(
    phase: &Phase<'_>,
    blocks: &mut [Block],
    shares: [&mut [Share]; 2],
    found: &mut [Found],
    team: &Team,
) {
    let [mut sums, mut drains] = shares;
    let mut work = Vec::with_capacity(blocks.len());
    for (block, found) in blocks.iter_mut().zip(found) {
        let shares = block.shares();
        let (own, rest) = sums.split_at_mut(shares);
        let (own_drains, rest_drains) = drains.split_at_mut(shares.min(drains.len()));
        (sums, drains) = (rest, rest_drains);
        work.push((block, own, own_drains, found));
    }
    team.each(work, FEW, |(block, sums, drains, found)| {
        SCRATCH.with_borrow_mut(|scratch| run(phase, block, sums, drains, found, scratch));
    });
}

struct Clock(Instant);

impl Clock {
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        (now - std::mem::replace(&mut self.0, now)).as_secs_f64()
    }
}

fn advance_widest<S: Scheme>(
    c: &mut Columns<'_>,
    s: &Step,
    moved: &mut Moved,
    contacts: Option<Contacts<'_>>,
    first: bool,
    dx: &mut Displacements,
) {
    widest!(advance::<S: Scheme>(
        c: &mut Columns<'_>,
        s: &Step,
        moved: &mut Moved,
        contacts: Option<Contacts<'_>>,
        first: bool,
        dx: &mut Displacements,
    ));
}

/// The integrator's loop, compiled once per scheme.
struct Motion<'a> {
    world: &'a mut CpuWorld,
    ahead: bool,
    first: bool,
    team: &'a Team,
}

impl Visitor for Motion<'_> {
    type Output = Moved;

    fn visit<S: Scheme>(self) -> Moved {
        let Self { world: w, ahead, first, team } = self;
        let (blocks, incoming, s) = (&w.blocks, &w.incoming, w.step);
        let (sums, drains) = (&w.sums[..], &w.drains[..]);
        let p = &mut w.p;
        let mut place = p.place.chunks_mut(BLOCK);
        let mut hi = p.hi.chunks_mut(BLOCK);
        let mut rest = p.rest.chunks_mut(BLOCK);
        let mut velocity = p.velocity.chunks_mut(BLOCK);
        let mut spin = p.spin.chunks_mut(BLOCK);
        let mut acceleration = p.acceleration.chunks_mut(BLOCK);
        let mut angular = p.angular.chunks_mut(BLOCK);
        let mut force = p.force.chunks_mut(BLOCK);
        let mut lo_ref = p.lo_ref.chunks(BLOCK);
        let columns = |b: usize| {
            Some(Columns {
                first: b * BLOCK,
                place: place.next()?,
                hi: hi.next()?,
                rest: rest.next()?,
                velocity: velocity.next()?,
                spin: spin.next()?,
                acceleration: acceleration.next()?,
                angular: angular.next()?,
                force: force.next()?,
                lo_ref: lo_ref.next()?,
            })
        };
        let work: Vec<_> = (0..).map_while(columns).zip(blocks).zip(&mut w.moved).collect();
        team.each(work, FEW, |((mut c, block), moved)| {
            *moved = Moved::default();
            let contacts = Contacts { block, sums, incoming, drains };
            let contacts = (!ahead).then_some(contacts);
            DISPLACEMENTS.with_borrow_mut(|dx| {
                advance_widest::<S>(&mut c, &s, moved, contacts, first, dx);
            });
        });
        w.moved.iter().fold(Moved::default(), |all, m| Moved {
            displacement: all.displacement.max(m.displacement),
            runaway: all.runaway.or(m.runaway),
            lifted: all.lifted + m.lifted,
            damped: all.damped + m.damped,
            drain: all.drain + m.drain,
        })
    }
}
