//! Batches of worlds on a device.

mod group;
mod launches;
mod sight;
mod stretch;
mod transfer;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use cubecl::prelude::*;

use self::group::{first_rooms, with_newcomers};
use super::choices::Choices;
use super::device::{Buffer, Device, Told};
use super::layout::{BLOCK, MERGED, SUMS, Shape, Signature, pose, world};
use super::tables::{Region, Rooms, classes};
use crate::backend::cpu::CpuFleet;
use crate::backend::{Detail, Fleet, Job, Moment, PhaseTimes};
use crate::failure::Failure;
use crate::setup::{BoundaryShape, Constants};
use crate::state::{Particles, Progress, State};

/// Most steps between two looks at a world by the host.
const STRETCH: u64 = 1024;
/// Worlds from which on their lists end at all times.
const CROWD: usize = 4;

/// Worlds on a device.
pub struct GpuFleet<R: Runtime> {
    device: Device<R>,
    groups: Vec<Group>,
    /// Group and place in it of each world.
    at: Vec<(usize, usize)>,
}

/// Worlds that run the same kernels.
struct Group {
    signature: Signature,
    worlds: Vec<Arc<Constants>>,
    regions: Vec<Region>,
    /// Particles in each world.
    counts: Vec<usize>,
    states: Vec<u32>,
    /// Progress of each world when it was last put or ran.
    last: Vec<Progress>,
    padded: u32,
    cells: u32,
    rooms: [u32; 3],
    bound_rows: Vec<u32>,
    /// Where each world's series of surface forces begins.
    series_at: Vec<usize>,
    /// Launches of steps between two looks at lists.
    launches: u32,
    /// Most launches of a group: forces on surfaces are kept for so many.
    held: u32,
    /// Most surfaces of a world whose forces are kept.
    names: u32,
    /// Whether a surface is present in the stretch under way.
    follows: bool,
    /// What is left of a world's stretch that was cut for lack of room.
    cut: Vec<Option<Cut>>,
    b: Buffers,
    times: PhaseTimes,
}

struct Buffers {
    world_of: Buffer,
    world_of_cell: Buffer,
    worlds: Buffer,
    states: Buffer,
    flags: Buffer,
    pairs: Buffer,
    place: Buffer,
    vel: Buffer,
    spin: Buffer,
    own: Buffer,
    refs: Buffer,
    tree: Buffer,
    slow: Buffer,
    lists: Buffer,
    nbr: Buffer,
    hist: Buffer,
    world_of_kept: Buffer,
    held: Buffer,
    kept: Buffer,
    kept_hist: Buffer,
    bounds: Buffer,
    poses: Buffer,
    tris: Buffer,
    verts: Buffer,
    nodes: Buffer,
    ordered: Buffer,
    rows: Buffer,
    facets: Buffer,
    told: Buffer,
    row_count: Buffer,
    row_mem: Buffer,
    push: Buffer,
    row_sums: Buffer,
    sums: Buffer,
    sights: Buffer,
    series: Buffer,
    gathered: Buffer,
    bins: Buffer,
    counters: Buffer,
    starts: Buffer,
    order: Buffer,
    renamed: Buffer,
    listed: Buffer,
    widths: Buffer,
    width_starts: Buffer,
    near_count: Buffer,
    near_flag: Buffer,
    row_starts: Buffer,
    facet_starts: Buffer,
    totals: Buffer,
}

/// What kernels are specialised for in a world.
fn signature(c: &Constants, fused: bool) -> Signature {
    let merged = c.count <= MERGED && !c.spec.throughput;
    Signature {
        laws: Choices::of(c),
        integrator: c.spec.time.integrator,
        ledger: c.spec.sampling.energy_ledger,
        surfaces: !c.boundaries.is_empty(),
        rounds: c.boundaries.iter().any(|b| matches!(b.shape, BoundaryShape::Frustum(_))),
        damping: c.spec.local_damping > 0.0,
        merged,
        told: !merged && c.boundaries.iter().any(|b| matches!(b.shape, BoundaryShape::Mesh(..))),
        shape: if c.spec.throughput { Shape::LARGE } else { Shape::of(c.count) },
        sample: c.is_sample(),
        deforms: c.deforms(),
        orthogonal: c.lattice.orthogonal && !c.deforms(),
        graded: classes(c).count() > 1,
        search: c.spec.search,
        fused,
    }
}

impl<R: Runtime> GpuFleet<R> {
    /// Takes worlds in.
    pub fn new(client: ComputeClient<R>, told: Told, worlds: Vec<(Arc<Constants>, &mut State)>) -> Self {
        let device = Device::new(client, told);
        let fused = device.fuses();
        let (groups, at) = grouped(worlds, |(c, _)| c, fused);
        let groups = groups
            .into_iter()
            .map(|(signature, mut worlds)| {
                let of = worlds.len();
                let rooms = worlds.iter().map(|(c, s)| first_rooms(c, s.particles.len(), of)).collect();
                Group::new(&device, signature, &mut worlds, rooms)
            })
            .collect();
        Self { device, groups, at }
    }

    /// The memory that worlds need at first. Crowds whose lists grow need more.
    pub fn need(client: ComputeClient<R>, worlds: &[Arc<Constants>]) -> Need {
        let device = Device::measuring(client);
        // The same memory, however sums are rounded.
        let (groups, _) = grouped(worlds.iter(), |c| c, true);
        let needs = groups.into_iter().map(|(signature, worlds)| {
            let counted: Vec<_> = worlds.iter().map(|c| ((*c).clone(), with_newcomers(c, c.count))).collect();
            let rooms: Vec<Rooms> =
                counted.iter().map(|(c, count)| first_rooms(c, *count, worlds.len())).collect();
            let group = Group::allocate(&device, signature, &counted, &rooms);
            let b = group.b.all();
            // Tables, sums over a stretch, what surfaces feel in it, and where they stand.
            let surfaces = |c: &Constants| {
                let cell = if c.deforms() { world::CELL_WORDS as usize } else { 0 };
                c.spec.surfaces.len() * 12 + c.boundaries.len() * pose::WORDS as usize + cell
            };
            let followed: usize = worlds.iter().map(|c| STRETCH as usize * surfaces(c)).sum();
            let tables = worlds.len() * world::WORDS as usize;
            let stretch = 4 * (group.blocks() * SUMS as usize * 2 + followed + tables);
            Need {
                all: (group.b.bytes() + stretch) as u64,
                largest: b.iter().map(|b| b.bytes()).max().unwrap_or(0) as u64,
                longest: b.iter().map(|b| b.len).max().unwrap_or(0) as u64,
            }
        });
        needs.fold(Need::default(), |sum, need| Need {
            all: sum.all + need.all,
            largest: sum.largest.max(need.largest),
            longest: sum.longest.max(need.longest),
        })
    }
}

/// Memory of a device \[bytes\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Need {
    /// In all.
    pub all: u64,
    /// Of the largest buffer.
    pub largest: u64,
    /// Elements of the longest buffer.
    pub longest: u64,
}

/// What worlds of one signature are together, as far as kernels count; and for each world its group and its place
/// in it.
type Grouped<W> = (Vec<(Signature, Vec<W>)>, Vec<(usize, usize)>);

fn grouped<W>(
    worlds: impl IntoIterator<Item = W>,
    constants: impl Fn(&W) -> &Arc<Constants>,
    fused: bool,
) -> Grouped<W> {
    let mut groups: Vec<(Signature, Vec<W>)> = Vec::new();
    let (mut at, mut counts) = (Vec::new(), Vec::<usize>::new());
    for world in worlds {
        let c = constants(&world);
        let s = signature(c, fused);
        let fits = |g: &usize| groups[*g].0 == s && counts[*g] + c.count <= together(&s);
        let g = (0..groups.len()).find(fits).unwrap_or_else(|| {
            groups.push((s, Vec::new()));
            counts.push(0);
            groups.len() - 1
        });
        counts[g] += c.count;
        at.push((g, groups[g].1.len()));
        groups[g].1.push(world);
    }
    (groups, at)
}

/// Particles of one signature that run together at most: a list's entries are counted in u32, and so are their floats.
fn together(s: &Signature) -> usize {
    /// Entries that a particle's list may come to have room for.
    const MOST: u32 = 24;
    (u32::MAX / (MOST * s.quads().max(1))) as usize
}

impl<R: Runtime> Drop for GpuFleet<R> {
    fn drop(&mut self) {
        let large = self.groups.iter().any(|group| group.b.all().iter().any(|b| b.is_large()));
        self.groups.clear();
        if large {
            self.device.give_back();
        }
    }
}

impl<R: Runtime> Fleet for GpuFleet<R> {
    fn advance(&mut self, jobs: &mut [Job<'_>]) {
        for g in 0..self.groups.len() {
            let mut mine: Vec<(usize, &mut Job<'_>)> = jobs
                .iter_mut()
                .filter(|j| self.at[j.world].0 == g)
                .map(|j| (self.at[j.world].1, j))
                .collect();
            let group = &mut self.groups[g];
            let mut left: Vec<u64> = mine.iter().map(|(_, j)| j.steps).collect();
            while left.iter().any(|&n| n > 0) && self.device.broken().is_none() {
                group.stretch(&self.device, &mut mine, &mut left);
            }
        }
        for job in jobs {
            if let Some(failure) = self.fault(job.world, job.progress) {
                job.outcome = Err(failure);
            }
        }
    }

    fn fault(&self, world: usize, progress: &Progress) -> Option<Failure> {
        let fault = self.device.broken()?;
        let (g, w) = self.at[world];
        Some(Failure {
            time: progress.step as f64 * self.groups[g].worlds[w].dt,
            step: progress.step,
            what: format!("the device failed: {}", fault.why),
            cause: fault.remedy.to_owned(),
        })
    }

    fn observe(&mut self, asked: &[(usize, &Progress)]) -> Vec<Moment> {
        let mut seen = vec![Moment::default(); asked.len()];
        for (g, group) in self.groups.iter_mut().enumerate() {
            let of = |world: usize| (self.at[world].0 == g).then(|| self.at[world].1);
            let (places, mine): (Vec<usize>, Vec<_>) =
                asked.iter().enumerate().filter_map(|(k, (w, p))| Some((k, (of(*w)?, *p)))).unzip();
            if mine.is_empty() || self.device.broken().is_some() {
                continue;
            }
            let began = Instant::now();
            for (k, moment) in places.into_iter().zip(group.observe(&self.device, &mine)) {
                seen[k] = moment;
            }
            group.times.looks += began.elapsed().as_secs_f64();
        }
        seen
    }

    fn detail(&mut self, world: usize, state: &State) -> Detail {
        // Frames are rare: the host looks at contacts one by one.
        let (g, w) = self.at[world];
        let mut theirs = state.clone();
        let mut host = CpuFleet::new(vec![(self.groups[g].worlds[w].clone(), &mut theirs)]);
        let mut detail = host.detail(0, state);
        // The host has its own order of particles.
        let ordered = host.state(0, &state.progress).particles.id;
        let count: HashMap<u32, u32> = ordered.into_iter().zip(detail.coordination).collect();
        detail.coordination =
            state.particles.id.iter().map(|id| count.get(id).copied().unwrap_or_default()).collect();
        detail
    }

    fn state(&self, world: usize, progress: &Progress) -> State {
        let (g, w) = self.at[world];
        if self.device.broken().is_some() {
            return State { progress: progress.clone(), ..State::default() };
        }
        self.groups[g].state(&self.device, w, progress)
    }

    fn particles(&self, world: usize, _: &Progress) -> Particles {
        let (g, w) = self.at[world];
        if self.device.broken().is_some() {
            return Particles::default();
        }
        self.groups[g].particles(&self.device, w)
    }

    fn load(&mut self, world: usize, state: &mut State) {
        let (g, w) = self.at[world];
        let group = &mut self.groups[g];
        if self.device.broken().is_some() {
            return;
        }
        if state.particles.len() > (group.regions[w].blocks * BLOCK) as usize {
            group.enlarge(&self.device, w, state);
            return;
        }
        group.put(&self.device, w, state);
        if let Some(needs) = group.relist(&self.device, &mut [(w, &mut state.progress)]) {
            group.regrow(&self.device, needs, w, state);
        }
    }

    fn renew(&mut self, world: usize, progress: &mut Progress) {
        let (g, w) = self.at[world];
        if self.device.broken().is_none() {
            self.groups[g].renew(&self.device, w, progress);
        }
    }

    fn times(&self, world: usize) -> PhaseTimes {
        self.groups[self.at[world].0].times
    }

    fn bytes_per_particle(&self, world: usize) -> f64 {
        let group = &self.groups[self.at[world].0];
        group.b.bytes() as f64 / group.counts.iter().sum::<usize>().max(1) as f64
    }
}

impl Buffers {
    fn all(&self) -> [&Buffer; 49] {
        [
            &self.world_of,
            &self.world_of_cell,
            &self.worlds,
            &self.states,
            &self.flags,
            &self.pairs,
            &self.place,
            &self.vel,
            &self.spin,
            &self.own,
            &self.refs,
            &self.slow,
            &self.lists,
            &self.nbr,
            &self.hist,
            &self.world_of_kept,
            &self.held,
            &self.kept,
            &self.kept_hist,
            &self.bounds,
            &self.poses,
            &self.tris,
            &self.verts,
            &self.nodes,
            &self.ordered,
            &self.rows,
            &self.facets,
            &self.told,
            &self.row_count,
            &self.row_mem,
            &self.push,
            &self.row_sums,
            &self.sums,
            &self.sights,
            &self.series,
            &self.gathered,
            &self.bins,
            &self.counters,
            &self.starts,
            &self.order,
            &self.renamed,
            &self.listed,
            &self.widths,
            &self.width_starts,
            &self.near_count,
            &self.near_flag,
            &self.row_starts,
            &self.facet_starts,
            &self.totals,
        ]
    }

    fn bytes(&self) -> usize {
        self.all().iter().map(|b| b.bytes()).sum()
    }
}

/// What the host reads of a stretch.
struct Report {
    flags: Vec<u32>,
    /// Sums of the ledger over each world, as pairs.
    sums: Vec<f32>,
    /// Forces on surfaces, step by step.
    series: Vec<f32>,
}

/// A stretch that was cut: it goes on as if it had not been.
struct Cut {
    /// Steps done.
    done: u64,
    /// Steps left of it.
    steps: u64,
    /// Sums of the ledger so far, over blocks of particles and of those near surfaces.
    sums: [Vec<f32>; 2],
}

/// A world of a group and what its rebuild had no room for: entries, rows, facets.
type Lack = (usize, [u32; 3]);
