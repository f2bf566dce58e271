//! Batches of worlds on a device.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

use cubecl::prelude::*;
use glebe_physics::IntegratorKind;

use super::choices::Choices;
use super::device::{Buffer, Device, MOST_BLOCKS, QUAD, Told, grid};
use super::fault::Fault;
use super::launch::{Arguments, settings};
use super::layout::{
    BLOCK, FACET_WORDS, INNER, LOOK, MERGED, NONE, PAIR_QUADS, PARTNER, PERIOD, REFER, RELIST, SECOND,
    SIGHTS, SLICE, SLOTS, SUMS, Shape, Signature, TOUCHING, boundary, flag, halt, inner, pose, status, world,
};
use super::step::Purpose;
use super::tables::{Meshes, Region, Rooms, cell_room, deform, pair_quads, stand, status_row, world_row};
use super::{lists, rows, scan, step, sums};
use crate::backend::common::{
    Portrait, leavers, narrow_failure, overlap_failure, runaway_failure, too_deep, unload,
};
use crate::backend::cpu::CpuFleet;
use crate::backend::{Detail, Fleet, Job, Moment, PhaseTimes};
use crate::cell::too_narrow;
use crate::failure::Failure;
use crate::measure::Tensors;
use crate::setup::{BoundaryShape, Constants};
use crate::state::{ContactMemory, Particles, Place, Progress, Spin, State, SurfaceMemory, Velocity};

/// Most steps between two looks at a world by the host.
const STRETCH: u64 = 1024;
/// Stretches of so few steps are attended: lists are rebuilt only when they have to be.
const ATTENDED: u64 = 16;

/// Worlds from which on their lists end at all times.
const CROWD: usize = 4;
/// Bytes that the forces of blocks on surfaces may take in all steps of a group.
const PUSHED: usize = 64 << 20;

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
    slow: Buffer,
    lists: Buffer,
    nbr: Buffer,
    hist: Buffer,
    bounds: Buffer,
    poses: Buffer,
    tris: Buffer,
    verts: Buffer,
    nodes: Buffer,
    ordered: Buffer,
    rows: Buffer,
    facets: Buffer,
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
    Signature {
        laws: Choices::of(c),
        integrator: c.spec.time.integrator,
        ledger: c.spec.sampling.energy_ledger,
        surfaces: !c.boundaries.is_empty(),
        rounds: c.boundaries.iter().any(|b| matches!(b.shape, BoundaryShape::Frustum(_))),
        damping: c.spec.local_damping > 0.0,
        merged: c.count <= MERGED && !c.spec.throughput,
        shape: if c.spec.throughput { Shape::LARGE } else { Shape::of(c.count) },
        sample: c.is_sample(),
        deforms: c.deforms(),
        orthogonal: c.lattice.orthogonal && !c.deforms(),
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
            }
        });
        needs.fold(Need::default(), |sum, need| Need {
            all: sum.all + need.all,
            largest: sum.largest.max(need.largest),
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
}

/// What worlds of one signature are together, as far as a launch reaches; and for each world its group and its place
/// in it.
type Grouped<W> = (Vec<(Signature, Vec<W>)>, Vec<(usize, usize)>);

fn grouped<W>(
    worlds: impl IntoIterator<Item = W>,
    constants: impl Fn(&W) -> &Arc<Constants>,
    fused: bool,
) -> Grouped<W> {
    let mut groups: Vec<(Signature, Vec<W>)> = Vec::new();
    let (mut at, mut blocks) = (Vec::new(), Vec::<usize>::new());
    for world in worlds {
        let c = constants(&world);
        let (s, most) = (signature(c, fused), most_blocks(c.count));
        let fits = |g: &usize| groups[*g].0 == s && blocks[*g] + most <= MOST_BLOCKS;
        let g = (0..groups.len()).find(fits).unwrap_or_else(|| {
            groups.push((s, Vec::new()));
            blocks.push(0);
            groups.len() - 1
        });
        blocks[g] += most;
        at.push((g, groups[g].1.len()));
        groups[g].1.push(world);
    }
    (groups, at)
}

/// The most blocks of a step's launch that a world can come to need: of its particles, and of those near surfaces.
pub fn most_blocks(count: usize) -> usize {
    2 * count.max(1).div_ceil(BLOCK as usize)
}

/// Particles that a world gets room for: where more come through inlets, half as many again.
fn with_newcomers(c: &Constants, count: usize) -> usize {
    if c.spec.inlets.is_empty() { count } else { count + count / 2 + BLOCK as usize }
}

/// A guess at what a world needs room for; a rebuild that needs more is repeated with more.
fn first_rooms(c: &Constants, count: usize, worlds: usize) -> Rooms {
    let n = count.max(1) as u32;
    // Soft grains that fall on each other come to need more than grains at rest. To take more is slow for many worlds.
    let listed = if worlds < CROWD { 16 } else { 20 };
    let surfaces = !c.boundaries.is_empty();
    Rooms {
        lists: listed * n.next_multiple_of(BLOCK),
        rows: if surfaces { n.min(4096 + n / 8).next_multiple_of(BLOCK) } else { BLOCK },
        facets: if surfaces { 4 * n.min(4096 + n / 8) } else { 1 },
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
            for (k, moment) in places.into_iter().zip(group.observe(&self.device, &mine)) {
                seen[k] = moment;
            }
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
        if let Some(needs) = group.relist(&self.device, &mut [(w, state)]) {
            group.regrow(&self.device, needs, w, state);
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
    fn all(&self) -> [&Buffer; 43] {
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
            &self.bounds,
            &self.poses,
            &self.tris,
            &self.verts,
            &self.nodes,
            &self.ordered,
            &self.rows,
            &self.facets,
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

/// Where particles stand in the order of storage.
struct Places(Vec<(u32, u32)>);

impl Places {
    fn of(ids: &[u32]) -> Self {
        let mut places: Vec<(u32, u32)> = ids.iter().zip(0..).map(|(id, i)| (*id, i)).collect();
        places.sort_unstable();
        Self(places)
    }

    fn get(&self, id: u32) -> Option<usize> {
        // Numbers have few gaps: most particles stand where theirs says.
        let guess = (id as usize).min(self.0.len().saturating_sub(1));
        let at = if self.0.get(guess)?.0 == id {
            guess
        } else {
            self.0.binary_search_by_key(&id, |(id, _)| *id).ok()?
        };
        Some(self.0[at].1 as usize)
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

/// A world of a group and what its rebuild had no room for: entries, rows, facets.
type Lack = (usize, [u32; 3]);

impl Group {
    fn new<R: Runtime>(
        device: &Device<R>,
        signature: Signature,
        worlds: &mut [(Arc<Constants>, &mut State)],
        mut rooms: Vec<Rooms>,
    ) -> Self {
        loop {
            let counted: Vec<_> =
                worlds.iter().map(|(c, s)| (c.clone(), with_newcomers(c, s.particles.len()))).collect();
            let counts: Vec<usize> = counted.iter().map(|(_, count)| *count).collect();
            let mut group = Self::allocate(device, signature, &counted, &rooms);
            if device.broken().is_some() {
                return group;
            }
            for w in 0..worlds.len() {
                group.put(device, w, worlds[w].1);
            }
            let mut states: Vec<(usize, &mut State)> =
                worlds.iter_mut().enumerate().map(|(w, (_, s))| (w, &mut **s)).collect();
            let Some(needs) = group.relist(device, &mut states) else { return group };
            if device.broken().is_some() {
                return group;
            }
            for need in needs {
                widen(&mut rooms, &counts, need);
            }
        }
    }

    /// Lays worlds of so many particles out and takes memory.
    fn allocate<R: Runtime>(
        device: &Device<R>,
        signature: Signature,
        worlds: &[(Arc<Constants>, usize)],
        rooms: &[Rooms],
    ) -> Self {
        let (mut padded, mut cells, mut begins) = (0_u32, 0_u32, [0_u32; 3]);
        let (mut pairs, mut boundaries) = (0_u32, 0_u32);
        let mut regions = Vec::new();
        let (mut quads, mut meshes) = (Vec::new(), Meshes::default());
        for ((c, count), room) in worlds.iter().zip(rooms) {
            let count = *count;
            let region = Region {
                first: padded,
                blocks: (count.max(1) as u32).div_ceil(BLOCK),
                cells,
                cell_room: cell_room(c, count),
                begins,
                rooms: *room,
                pairs,
                boundaries,
            };
            padded += region.blocks * BLOCK;
            cells += region.cell_room;
            begins[0] += room.lists;
            begins[1] += room.rows;
            begins[2] += room.facets;
            pairs += c.pairs.len() as u32;
            boundaries += c.boundaries.len() as u32;
            quads.extend(pair_quads(c));
            meshes.add(c);
            regions.push(region);
        }
        debug_assert_eq!(quads.len(), (pairs * PAIR_QUADS) as usize);
        let per = |blocks: &dyn Fn(&Region) -> u32| -> Vec<u32> {
            regions.iter().enumerate().flat_map(|(w, r)| vec![w as u32; blocks(r) as usize]).collect()
        };
        let n = padded as usize;
        let names = worlds.iter().map(|(c, _)| c.spec.surfaces.len()).max().unwrap_or(0);
        let [entries, row_room, facet_room] = begins.map(|x| x as usize);
        let pushed = row_room / signature.rows_of_block() * names;
        let held = (PUSHED / (2 * QUAD * pushed).max(1)).clamp(1, PERIOD as usize) as u32;
        let b = Buffers {
            world_of: device.upload(&[per(&|r| r.blocks), per(&|r| r.rooms.rows / BLOCK)].concat()),
            world_of_cell: device.upload(&per(&|r| r.cell_room / BLOCK)),
            worlds: device.zeros(1, 4),
            states: device.zeros(worlds.len() * status::WORDS as usize, 4),
            flags: device.zeros(worlds.len() * flag::WORDS as usize, 4),
            pairs: device.upload(&quads),
            place: device.zeros(2 * n, QUAD),
            vel: device.zeros(2 * n, QUAD),
            spin: device.zeros(2 * n, QUAD),
            own: device.zeros(4 * n, QUAD),
            refs: device.zeros(4 * n, QUAD),
            slow: device.zeros(6 * n, QUAD),
            lists: device.zeros(2 * n + 2 * n / SLICE as usize, 4),
            nbr: device.zeros(2 * entries, 4),
            hist: device.zeros((2 * entries * signature.quads() as usize).max(1), QUAD),
            bounds: device.upload(&meshes.rows),
            poses: device.zeros(1, 4),
            tris: device.upload(&meshes.triangles),
            verts: device.upload(&meshes.vertices),
            nodes: device.upload(&meshes.nodes),
            ordered: device.upload(&meshes.order),
            rows: device.zeros(2 * n + 6 * row_room, 4),
            facets: device.zeros(2 * FACET_WORDS as usize * facet_room, 4),
            row_count: device.zeros(2 * row_room, 4),
            row_mem: device.zeros(2 * signature.row_quads() as usize * row_room * SLOTS as usize, QUAD),
            push: device.zeros(2 * (row_room * SLOTS as usize + held as usize * pushed), QUAD),
            row_sums: device
                .zeros(if signature.merged { 1 } else { (row_room + 1) * step::ROW_QUADS as usize }, QUAD),
            sums: device.zeros(1, 4),
            sights: device.zeros(signature.blocks(n, row_room) * signature.sights() as usize, 4),
            series: device.zeros(1, 4),
            gathered: device.zeros(worlds.len() * 2 * SUMS.max(signature.sights()) as usize, 4),
            bins: device.zeros(n, 4),
            counters: device.zeros(cells as usize, 4),
            starts: device.zeros(cells as usize + 1, 4),
            order: device.zeros(n, 4),
            renamed: device.zeros(n, 4),
            widths: device.zeros(n / SLICE as usize, 4),
            width_starts: device.zeros(n / SLICE as usize + 1, 4),
            near_count: device.zeros(n, 4),
            near_flag: device.zeros(n, 4),
            row_starts: device.zeros(n + 1, 4),
            facet_starts: device.zeros(n + 1, 4),
            totals: device.zeros((n.max(cells as usize) / scan::TILE as usize) + 2, 4),
        };
        Self {
            signature,
            worlds: worlds.iter().map(|(c, _)| c.clone()).collect(),
            states: vec![0; worlds.len() * status::WORDS as usize],
            counts: vec![0; worlds.len()],
            last: vec![Progress::default(); worlds.len()],
            regions,
            padded,
            cells,
            rooms: begins,
            bound_rows: meshes.rows,
            series_at: vec![0; worlds.len()],
            launches: PERIOD,
            held,
            names: names as u32,
            follows: false,
            b,
            times: PhaseTimes::default(),
        }
    }

    /// Where quad `q` of what pairs remember begins.
    fn plane(&self, q: usize) -> usize {
        2 * q * self.rooms[0] as usize
    }

    fn state_word(&self, w: usize, k: u32) -> u32 {
        self.states[w * status::WORDS as usize + k as usize]
    }

    fn set_state(&mut self, w: usize, k: u32, x: u32) {
        self.states[w * status::WORDS as usize + k as usize] = x;
    }

    /// Copies a state into the first halves of the world's columns; its lists are still to be made.
    fn put<R: Runtime>(&mut self, device: &Device<R>, w: usize, state: &State) {
        let region = self.regions[w];
        let p = &state.particles;
        let n = p.len();
        let first = region.first as usize;
        self.counts[w] = n;
        let row = status_row(&state.progress, n);
        let at = w * status::WORDS as usize;
        self.states[at..at + row.len()].copy_from_slice(&row);
        self.set_state(w, status::ASKED, if state.progress.stale { REFER } else { RELIST });

        let bits = |x: [f32; 3]| x.map(f32::to_bits);
        let place: Vec<[u32; 4]> =
            p.place.iter().map(|x| [x.lo[0], x.lo[1], x.lo[2], x.radius.to_bits()]).collect();
        let vel: Vec<[f32; 4]> = p.velocity.iter().map(|x| [x.v[0], x.v[1], x.v[2], x.inv_mass]).collect();
        let spin: Vec<[u32; 4]> = p
            .spin
            .iter()
            .map(|x| {
                let [a, b, c] = bits(x.w);
                [a, b, c, x.material]
            })
            .collect();
        device.write(&self.b.place, first, &place);
        device.write(&self.b.vel, first, &vel);
        device.write(&self.b.spin, first, &spin);
        let own: Vec<[u32; 4]> = (0..n)
            .flat_map(|i| {
                let (h, r) = (p.hi[i].map(|x| x as u32), bits(p.rest[i]));
                [[h[0], h[1], h[2], p.id[i]], [r[0], r[1], r[2], 0]]
            })
            .collect();
        device.write(&self.b.own, 2 * first, &own);
        let refs: Vec<[u32; 4]> = (0..n)
            .flat_map(|i| {
                let (l, h) = (p.lo_ref[i], p.hi_ref[i].map(|x| x as u32));
                [[l[0], l[1], l[2], p.place[i].radius.to_bits()], [h[0], h[1], h[2], p.id[i]]]
            })
            .collect();
        device.write(&self.b.refs, 2 * first, &refs);
        let slow: Vec<[f32; 4]> = (0..n)
            .flat_map(|i| [p.acceleration[i], p.angular[i], p.force[i]].map(|x| [x[0], x[1], x[2], 0.0]))
            .collect();
        device.write(&self.b.slow, 3 * first, &slow);
        let places = Places::of(&p.id);
        self.put_contacts(device, w, state, &places);
        self.put_surface_contacts(device, w, state, &places);
    }

    /// What pairs remember, as lists of touching neighbours that the first rebuild takes over.
    fn put_contacts<R: Runtime>(&self, device: &Device<R>, w: usize, state: &State, places: &Places) {
        let region = &self.regions[w];
        let n = state.particles.len();
        let pairs: Vec<[usize; 2]> =
            state.contacts.iter().map(|m| m.id.map(|id| places.get(id).unwrap_or(usize::MAX))).collect();
        let known = || pairs.iter().zip(&state.contacts).filter(|(pair, _)| !pair.contains(&usize::MAX));
        let mut counts = vec![0_u32; n];
        for (pair, _) in known() {
            for &i in pair {
                counts[i] += 1;
            }
        }
        let slices = (region.blocks * BLOCK / SLICE) as usize;
        let mut offsets = vec![region.begins[0]; slices];
        let mut used = 0;
        for (offset, members) in offsets.iter_mut().zip(counts.chunks(SLICE as usize)) {
            *offset += used;
            used += members.iter().max().unwrap_or(&0) * SLICE;
        }
        offsets[n.div_ceil(SLICE as usize)..].fill(region.begins[0] + used);
        let mut entries = vec![0_u32; used as usize];
        let mut history = vec![vec![[0.0_f32; 4]; used as usize]; self.signature.quads() as usize];
        let mut filled = vec![0_u32; n];
        for (&[a, b], m) in known() {
            for (i, entry) in [(a, region.first + b as u32), (b, SECOND | (region.first + a as u32))] {
                let from = offsets[i / SLICE as usize] - region.begins[0] + i as u32 % SLICE;
                let to = (from + filled[i] * SLICE) as usize;
                entries[to] = TOUCHING | entry;
                for (q, plane) in history.iter_mut().enumerate() {
                    plane[to] = quad_of(&m.history, q);
                }
                filled[i] += 1;
            }
        }
        entries.truncate(region.rooms.lists as usize);
        device.write(&self.b.lists, region.first as usize, &counts);
        device.write(&self.b.lists, 2 * self.padded as usize + (region.first / SLICE) as usize, &offsets);
        device.write(&self.b.nbr, region.begins[0] as usize, &entries);
        for (q, mut plane) in history.into_iter().enumerate() {
            plane.truncate(region.rooms.lists as usize);
            device.write(&self.b.hist, self.plane(q) + region.begins[0] as usize, &plane);
        }
    }

    fn put_surface_contacts<R: Runtime>(&self, device: &Device<R>, w: usize, state: &State, places: &Places) {
        let region = &self.regions[w];
        let n = state.particles.len();
        let mut row_of = vec![NONE; n];
        let (mut counts, mut memory) = (Vec::new(), Vec::<[f32; 4]>::new());
        // What does not fit goes with an attempt that fails: the lists to be made have no less in them.
        for same in state.surface_contacts.chunk_by(|a, b| a.id == b.id) {
            let Some(i) = places.get(same[0].id) else { continue };
            if counts.len() as u32 == region.rooms.rows {
                break;
            }
            row_of[i] = region.begins[1] + counts.len() as u32;
            counts.push(same.len().min(SLOTS as usize) as u32);
            let wide = self.signature.row_quads() as usize;
            let mut slots = vec![[0.0_f32; 4]; wide * SLOTS as usize];
            for (k, m) in same.iter().take(SLOTS as usize).enumerate() {
                slots[wide * k] = [m.n[0], m.n[1], m.n[2], m.surface as f32];
                (1..wide).for_each(|q| slots[wide * k + q] = quad_of(&m.history, q - 1));
            }
            memory.extend(slots);
        }
        device.write(&self.b.rows, region.first as usize, &row_of);
        device.write(&self.b.row_count, region.begins[1] as usize, &counts);
        device.write(
            &self.b.row_mem,
            (region.begins[1] * SLOTS * self.signature.row_quads()) as usize,
            &memory,
        );
    }

    /// Uploads tables for jobs of a number of steps from the progress of each world (`None` for idle ones), with
    /// poses of the present or of the lists' reference. Says which worlds have a mesh too many periods away.
    fn prepare<R: Runtime>(
        &mut self,
        device: &Device<R>,
        jobs: &[Option<(&Progress, u64, bool)>],
    ) -> Vec<usize> {
        let mut astray = Vec::new();
        let mut poses = Vec::new();
        let mut worlds = Vec::new();
        let mut series = 0_u32;
        for (w, job) in jobs.iter().enumerate() {
            let c = self.worlds[w].clone();
            worlds.extend(world_row(&c, &self.regions[w], series));
            self.series_at[w] = series as usize;
            if let Some((g, steps, reference)) = job {
                series += *steps as u32 * c.spec.surfaces.len() as u32 * 12;
                let begin = (self.regions[w].boundaries * boundary::WORDS) as usize;
                let end = begin + c.boundaries.len() * boundary::WORDS as usize;
                if !stand(&mut poses, &c, g, *steps, *reference, &mut self.bound_rows[begin..end]) {
                    astray.push(w);
                }
            }
        }
        for (w, job) in jobs.iter().enumerate() {
            let (g, steps, reference) = job.unwrap_or((&self.last[w], 0, false));
            deform(&mut worlds, w * world::WORDS as usize, &self.worlds[w], g, steps, reference);
        }
        self.b.worlds = device.upload(&worlds);
        self.b.bounds = device.upload(&self.bound_rows);
        self.b.poses = device.upload(&poses);
        self.b.series = device.zeros(series as usize, 4);
        self.b.states = device.upload(&self.states);
        let mut flags = vec![0_u32; self.worlds.len() * flag::WORDS as usize];
        for f in flags.chunks_exact_mut(flag::WORDS as usize) {
            f[flag::STALE as usize] = NONE;
            f[flag::WHO as usize] = NONE;
        }
        self.b.flags = device.upload(&flags);
        astray
    }

    /// Makes the lists of worlds that were just put; what there was no room for.
    fn relist<R: Runtime>(
        &mut self,
        device: &Device<R>,
        loaded: &mut [(usize, &mut State)],
    ) -> Option<Vec<Lack>> {
        let mut jobs = vec![None; self.worlds.len()];
        for (w, state) in loaded.iter() {
            jobs[*w] = Some((&state.progress, 0, !state.progress.stale));
        }
        self.prepare(device, &jobs);
        if device.broken().is_some() {
            return None;
        }
        self.begin(device, 0);
        self.rebuild(device);
        let flags = self.fetch(device).flags;
        for (w, state) in loaded.iter_mut() {
            let g = &mut state.progress;
            if g.stale {
                g.refer(&self.worlds[*w]);
                g.stale = false;
                g.rebuilds += 1;
            }
            self.last[*w] = g.clone();
        }
        Self::needs(&flags)
    }

    fn needs(flags: &[u32]) -> Option<Vec<Lack>> {
        let needs: Vec<Lack> = flags
            .chunks_exact(flag::WORDS as usize)
            .enumerate()
            .filter(|(_, f)| f[flag::HALT as usize] == halt::ROOM)
            .map(|(w, f)| (w, [0, 1, 2].map(|k| f[(flag::NEED + k) as usize])))
            .collect();
        (!needs.is_empty()).then_some(needs)
    }

    /// Takes more memory: every world is read and put again, world `w` from `given`, which is not on the device yet.
    fn regrow<R: Runtime>(&mut self, device: &Device<R>, needs: Vec<Lack>, w: usize, given: &mut State) {
        let mut rooms: Vec<Rooms> = self.regions.iter().map(|r| r.rooms).collect();
        for need in needs {
            widen(&mut rooms, &self.counts, need);
        }
        self.lay_out_anew(device, rooms, w, given);
    }

    /// Takes memory for a world that has become too large for its part, and loads it.
    fn enlarge<R: Runtime>(&mut self, device: &Device<R>, w: usize, given: &mut State) {
        let mut rooms: Vec<Rooms> = self.regions.iter().map(|r| r.rooms).collect();
        let (c, room) = (&self.worlds[w], rooms[w]);
        let first = first_rooms(c, with_newcomers(c, given.particles.len()), self.worlds.len());
        rooms[w] = Rooms {
            lists: first.lists.max(room.lists),
            rows: first.rows.max(room.rows),
            facets: first.facets.max(room.facets),
        };
        self.lay_out_anew(device, rooms, w, given);
    }

    /// Takes other memory, carries the worlds over, and loads world `w`.
    fn lay_out_anew<R: Runtime>(
        &mut self,
        device: &Device<R>,
        rooms: Vec<Rooms>,
        w: usize,
        given: &mut State,
    ) {
        let mut states: Vec<State> = (0..self.worlds.len())
            .map(|k| if k == w { std::mem::take(given) } else { self.state(device, k, &self.last[k]) })
            .collect();
        let mut worlds: Vec<(Arc<Constants>, &mut State)> =
            self.worlds.iter().cloned().zip(states.iter_mut()).collect();
        let times = self.times;
        *self = Self::new(device, self.signature, &mut worlds, rooms);
        self.times = times;
        *given = std::mem::take(&mut states[w]);
    }

    /// Reads states, flags, and what steps have left.
    fn fetch<R: Runtime>(&mut self, device: &Device<R>) -> Report {
        if self.signature.ledger {
            self.over_blocks(device, SUMS, true, &self.b.sums);
        }
        let b = &self.b;
        let mut all = device.read_all(&[&b.states, &b.flags, &b.gathered, &b.series]).into_iter();
        device.settle();
        self.states = all.next().unwrap_or_default();
        let [flags, sums, series] = std::array::from_fn(|_| all.next().unwrap_or_default());
        let floats = |words: Vec<u32>| words.into_iter().map(f32::from_bits).collect();
        Report { flags, sums: floats(sums), series: floats(series) }
    }

    /// Sums over the blocks of each world.
    fn over_blocks<R: Runtime>(&self, device: &Device<R>, quantities: u32, pairs: bool, blocks: &Buffer) {
        let worlds = self.worlds.len();
        // SAFETY: the kernel stays within the blocks of the worlds, for which the buffers were laid out.
        #[allow(unsafe_code)]
        unsafe {
            sums::over_blocks::launch_unchecked::<R>(
                device.client(),
                grid(worlds * quantities as usize),
                CubeDim::new_1d(BLOCK),
                worlds as u32,
                self.padded / self.signature.shape.owners,
                self.b.worlds.arg(),
                blocks.arg(),
                self.b.gathered.arg(),
                quantities,
                pairs,
                self.signature,
            );
        }
    }

    /// Lets the servos act that are due.
    fn govern<R: Runtime>(&mut self, device: &Device<R>, jobs: &mut [(usize, &mut Job<'_>)], left: &[u64]) {
        let due: Vec<usize> = (0..jobs.len())
            .filter(|&k| left[k] > 0 && self.worlds[jobs[k].0].governs(jobs[k].1.progress))
            .collect();
        if due.is_empty() {
            return;
        }
        let asked: Vec<(usize, &Progress)> = due.iter().map(|&k| (jobs[k].0, &*jobs[k].1.progress)).collect();
        let seen = self.observe(device, &asked);
        for (k, moment) in due.into_iter().zip(seen) {
            let (w, job) = &mut jobs[k];
            self.worlds[*w].govern(job.progress, moment.tensors.as_ref());
        }
    }

    /// One stretch of steps of every job.
    fn stretch<R: Runtime>(
        &mut self,
        device: &Device<R>,
        jobs: &mut [(usize, &mut Job<'_>)],
        left: &mut [u64],
    ) {
        let began = Instant::now();
        self.govern(device, jobs, left);
        let mut asked: Vec<Option<(&Progress, u64, bool)>> = vec![None; self.worlds.len()];
        let (mut longest, mut follows) = (0, false);
        for w in 0..self.worlds.len() {
            self.set_state(w, status::BASE, 0);
            self.set_state(w, status::TARGET, 0);
            self.set_state(w, status::REBUILDS, 0);
            self.set_state(w, status::REBUILT, NONE);
        }
        for ((w, job), n) in jobs.iter().zip(left.iter()) {
            let steps = steps_ahead(
                &self.worlds[*w],
                job.progress,
                (*n).min(STRETCH).min(self.worlds[*w].steps_governed(job.progress)),
            );
            self.states[*w * status::WORDS as usize + status::TARGET as usize] = steps as u32;
            longest = longest.max(steps);
            asked[*w] = Some((&*job.progress, steps, false));
            follows |= job.progress.surfaces.iter().any(|s| s.present);
        }
        self.follows = follows;
        let astray = self.prepare(device, &asked);
        if !astray.is_empty() {
            for ((w, job), left) in
                jobs.iter_mut().zip(left.iter_mut()).filter(|((w, _), _)| astray.contains(w))
            {
                *left = 0;
                let g = &job.progress;
                job.outcome = Err(Failure {
                    time: g.step as f64 * self.worlds[*w].dt,
                    step: g.step,
                    what: "a mesh is more than 500 periods away from the cell".to_owned(),
                    cause: "on a device images of particles are told within 500 periods; let the tool turn back, \
                            or run with --device cpu"
                        .to_owned(),
                });
            }
            return;
        }
        self.b.sums = device.zeros(self.blocks() * SUMS as usize * 2, 4);
        if device.broken().is_some() {
            return;
        }
        let split = self.signature.integrator == IntegratorKind::VelocityVerlet;
        if split && jobs.iter().any(|(_, j)| !j.progress.primed) {
            self.look(device, Purpose::Prime);
        }
        let mut report;
        let mut left_over = longest as u32;
        let attended = longest <= ATTENDED;
        let mut idle = 0;
        loop {
            let mut kept = None;
            // Groups end where lists do.
            let left_at_start = left_over;
            let age = jobs.iter().map(|(w, _)| self.state_word(*w, status::SINCE)).max().unwrap_or(0);
            let mut next = self.launches.min(PERIOD.saturating_sub(age).max(1));
            while left_over > 0 {
                let k = next.min(left_over).min(self.held);
                next = self.launches;
                for launch in 0..k {
                    self.step(device, launch);
                }
                if self.follows {
                    self.collect(device, k);
                }
                self.begin(device, k);
                left_over = left_over.saturating_sub(k);
                kept = attended.then(|| self.fetch(device)).filter(|report| !self.rebuilding(report));
                if kept.is_none() {
                    self.rebuild(device);
                }
            }
            report = match kept {
                Some(report) => report,
                None => self.fetch(device),
            };
            let open = (0..self.worlds.len())
                .map(|w| self.state_word(w, status::TARGET).saturating_sub(self.state_word(w, status::BASE)))
                .max()
                .unwrap_or(0);
            if open == 0 || device.broken().is_some() {
                break;
            }
            // A round may end in new lists alone; several in a row have done nothing.
            idle = if open == left_at_start { idle + 1 } else { 0 };
            if idle == 3 {
                device.breaks(Fault::refused(
                    "it runs no step: its driver refused a kernel or dropped launches",
                ));
                break;
            }
            left_over = open;
        }
        let rebuilds =
            (0..self.worlds.len()).map(|w| self.state_word(w, status::REBUILDS)).max().unwrap_or(0);
        // How long groups are decides how much is done in vain, never what comes out. They end where the lists of one
        // world do. Of many, whose lists end at all times, each waits half a group for new ones, but short groups end in
        // rebuilds that few of them need.
        let lasts = (longest as u32).checked_div(rebuilds).unwrap_or(PERIOD).min(PERIOD);
        self.launches = if jobs.len() < CROWD { lasts.max(8) } else { (3 * lasts.isqrt()).max(4) };
        self.finish(device, jobs, left, &report, split);
        self.times.device += began.elapsed().as_secs_f64();
    }

    /// Takes the outcome of a stretch over into the worlds' progress.
    fn finish<R: Runtime>(
        &mut self,
        device: &Device<R>,
        jobs: &mut [(usize, &mut Job<'_>)],
        left: &mut [u64],
        report: &Report,
        split: bool,
    ) {
        if device.broken().is_some() {
            return;
        }
        let Report { flags, sums, series } = report;
        let mut stopped = Vec::new();
        for ((w, job), left) in jobs.iter_mut().zip(left.iter_mut()) {
            let c = self.worlds[*w].clone();
            let w = *w;
            let done = u64::from(self.state_word(w, status::BASE));
            let beats = u64::from(flags[w * flag::WORDS as usize + flag::BEATS as usize]);
            if beats != done {
                device.breaks(Fault::refused(format!(
                    "{beats} of {done} steps were run: its driver refused a kernel or dropped launches"
                )));
                return;
            }
            let g = &mut *job.progress;
            let begin = g.step;
            let surfaces = c.spec.surfaces.len();
            for t in 0..done as usize {
                g.step += u64::from(split);
                let forces: Vec<[f64; 6]> = (0..surfaces)
                    .map(|s| {
                        let from = self.series_at[w] + (t * surfaces + s) * 12;
                        std::array::from_fn(|q| {
                            f64::from(series[from + 2 * q]) + f64::from(series[from + 2 * q + 1])
                        })
                    })
                    .collect();
                g.account(&c, &forces);
                g.step += u64::from(!split);
            }
            g.primed |= done > 0;
            *left -= done;
            self.book(w, sums, g, done);
            let rebuilt = self.state_word(w, status::REBUILT);
            g.skin = f64::from(f32::from_bits(self.state_word(w, status::SKIN)));
            g.rebuilds += u64::from(self.state_word(w, status::REBUILDS));
            let now = g.step;
            for t in 0..=done {
                if t > 0
                    && let Some(cell) = &mut g.cell
                {
                    cell.step(c.dt);
                }
                if t == u64::from(rebuilt) {
                    g.step = begin + t;
                    g.refer(&c);
                }
            }
            g.step = now;
            self.last[w] = g.clone();
            let f = &flags[w * flag::WORDS as usize..(w + 1) * flag::WORDS as usize];
            let worst = f64::from(f32::from_bits(f[flag::WORST as usize]));
            let deep = too_deep(&c, g, worst);
            match f[flag::HALT as usize] {
                halt::NO => {
                    job.outcome = narrow_failure(&c, g, &c.lattice_now(g));
                    *left = if job.outcome.is_ok() { *left } else { 0 };
                }
                halt::LEFT | halt::ROOM => stopped.push(w),
                why => {
                    *left = 0;
                    let progress = g.clone();
                    job.outcome =
                        Err(self.failure(device, w, &progress, f[flag::WHO as usize], why, deep, worst));
                }
            }
        }
        for w in stopped {
            if let Some((_, job)) = jobs.iter_mut().find(|(k, _)| *k == w) {
                self.relieve(device, w, job.progress, flags);
            }
        }
    }

    /// Takes out the particles that left a world, or takes more memory, and makes its lists again.
    fn relieve<R: Runtime>(&mut self, device: &Device<R>, w: usize, g: &mut Progress, flags: &[u32]) {
        let c = self.worlds[w].clone();
        let before = self.observe(device, &[(w, g)]).pop().unwrap_or_default();
        let mut state = self.state(device, w, g);
        let keep = leavers(&c, &state.particles, &mut state.progress);
        state.remove(&keep);
        state.progress.stale = true;
        if keep.contains(&false) && self.signature.integrator == IntegratorKind::VelocityVerlet {
            // The next step begins with the acceleration of this one, which those that left had a part in.
            state.progress.primed = false;
        }
        let needs = Self::needs(flags).unwrap_or_default();
        // Another world's need may have been met with its own meanwhile.
        let held = self.regions[w].rooms;
        let lacks =
            |[lists, rows, facets]: [u32; 3]| lists > held.lists || rows > held.rows || facets > held.facets;
        let needs: Vec<Lack> = needs.into_iter().filter(|(k, need)| *k == w && lacks(*need)).collect();
        if needs.is_empty() {
            self.put(device, w, &state);
            if let Some(needs) = self.relist(device, &mut [(w, &mut state)]) {
                self.regrow(device, needs, w, &mut state);
            }
        } else {
            self.regrow(device, needs, w, &mut state);
        }
        if keep.contains(&false) {
            let after = self.observe(device, &[(w, &state.progress)]).pop().unwrap_or_default();
            let gone = [
                before.elastic_normal - after.elastic_normal,
                before.elastic_tangential - after.elastic_tangential,
            ];
            unload(&mut state.progress, gone);
        }
        *g = state.progress;
    }

    /// Dissipation and work of a stretch.
    fn book(&self, w: usize, sums: &[f32], g: &mut Progress, done: u64) {
        if !self.signature.ledger || done == 0 {
            return;
        }
        let mut total = [0.0_f64; SUMS as usize];
        for (q, sum) in total.iter_mut().enumerate() {
            let at = (w * SUMS as usize + q) * 2;
            *sum = f64::from(sums[at]) + f64::from(sums[at + 1]);
        }
        let [friction, dash, roll, damped, work, before, tangential, last] = total;
        let l = &mut g.ledger;
        l.friction += friction;
        l.dashpots += dash;
        l.rolling += roll;
        l.damping += damped;
        l.work += work;
        l.stiffness_change += l.elastic_tangential + (tangential - last) - before;
        l.elastic_tangential = last;
    }

    fn failure<R: Runtime>(
        &self,
        device: &Device<R>,
        w: usize,
        g: &Progress,
        who: u32,
        why: u32,
        deep: bool,
        worst: f64,
    ) -> Failure {
        let c = &self.worlds[w];
        let state = self.state(device, w, g);
        let describe = |id: u32| state.describe(c, id);
        if why == halt::CONTACTS {
            return Failure {
                time: g.step as f64 * c.dt,
                step: g.step,
                what: format!("{} touches more than {SLOTS} walls of surfaces at once", describe(who)),
                cause:
                    "the GPU backend holds no more contacts of one particle; coarsen the mesh or run with \
                        --device cpu"
                        .to_owned(),
            };
        }
        if deep && why == halt::OVERLAP {
            return overlap_failure(c, g, &describe(who), "its neighbour", worst);
        }
        let i = state.particles.id.iter().position(|&id| id == who);
        let v = i.map_or([f64::NAN; 3], |i| state.particles.velocity[i].v.map(f64::from));
        runaway_failure(c, g, &describe(who), v)
    }

    fn step<R: Runtime>(&self, device: &Device<R>, k: u32) {
        let b = &self.b;
        let blocks = (self.padded / BLOCK) as usize;
        let split = self.signature.integrator == IntegratorKind::VelocityVerlet;
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            if split {
                step::drift::launch_unchecked::<R>(
                    device.client(),
                    grid(blocks),
                    CubeDim::new_1d(BLOCK),
                    k,
                    self.padded,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.flags.arg(),
                    b.place.arg(),
                    b.vel.arg(),
                    b.spin.arg(),
                    b.own.arg(),
                    b.refs.arg(),
                    b.slow.arg(),
                    self.signature,
                );
            }
        }
        self.launch_step(device, k, Purpose::Step, &b.sums);
    }

    /// Sums the forces on surfaces of the steps of a group.
    fn collect<R: Runtime>(&self, device: &Device<R>, launches: u32) {
        let b = &self.b;
        let span = self.signature.rows_of_block() as u32;
        // SAFETY: the kernel stays within the worlds and the launches that `push` was laid out for.
        #[allow(unsafe_code)]
        unsafe {
            step::collect::launch_unchecked::<R>(
                device.client(),
                grid(self.worlds.len() * launches as usize),
                CubeDim::new_1d(BLOCK),
                launches,
                self.worlds.len() as u32,
                self.rooms[1] / span,
                self.rooms[1],
                self.names,
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.push.arg(),
                b.series.arg(),
                span,
            );
        }
    }

    /// Blocks of a step.
    fn blocks(&self) -> usize {
        self.signature.blocks(self.padded as usize, self.rooms[1] as usize)
    }

    fn launch_step<R: Runtime>(&self, device: &Device<R>, k: u32, purpose: Purpose, sums: &Buffer) {
        let b = &self.b;
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            if self.signature.surfaces && !self.signature.merged {
                step::surfaces::launch_unchecked::<R>(
                    device.client(),
                    grid((self.rooms[1] / BLOCK) as usize),
                    CubeDim::new_1d(BLOCK),
                    k,
                    self.padded,
                    self.rooms[1],
                    self.rooms[2],
                    self.names,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.flags.arg(),
                    b.pairs.arg(),
                    b.place.arg(),
                    b.vel.arg(),
                    b.spin.arg(),
                    b.own.arg(),
                    b.refs.arg(),
                    b.bounds.arg(),
                    b.poses.arg(),
                    b.tris.arg(),
                    b.verts.arg(),
                    b.rows.arg(),
                    b.facets.arg(),
                    b.row_count.arg(),
                    b.row_mem.arg(),
                    b.push.arg(),
                    b.row_sums.arg(),
                    self.signature,
                    purpose,
                );
            }
            let mut a = Arguments::of(&[
                k,
                self.blocks() as u32,
                self.padded,
                self.rooms[0],
                self.rooms[1],
                self.rooms[2],
                self.names,
            ]);
            let kernel = step::step::Step::<R>::new(
                settings(self.signature.shape.units),
                device.client().clone(),
                (),
                (),
                (),
                (),
                (),
                (),
                (),
                a.buffer(&b.world_of),
                a.buffer(&b.worlds),
                a.buffer(&b.states),
                a.buffer(&b.flags),
                a.buffer(&b.pairs),
                a.buffer(&b.place),
                a.buffer(&b.vel),
                a.buffer(&b.spin),
                a.buffer(&b.own),
                a.buffer(&b.refs),
                a.buffer(&b.slow),
                a.buffer(&b.lists),
                a.buffer(&b.nbr),
                a.buffer(&b.hist),
                a.buffer(&b.bounds),
                a.buffer(&b.poses),
                a.buffer(&b.tris),
                a.buffer(&b.verts),
                a.buffer(&b.rows),
                a.buffer(&b.facets),
                a.buffer(&b.row_count),
                a.buffer(&b.row_mem),
                a.buffer(&b.push),
                a.buffer(&b.row_sums),
                a.buffer(sums),
                self.signature,
                purpose,
            );
            a.launch_unchecked::<R, _>(
                device.client(),
                grid(self.blocks()),
                kernel,
                self.signature.shape.units,
                self.signature.beside(),
            );
        }
    }

    /// Runs the contact phase on the present configuration.
    fn look<R: Runtime>(&self, device: &Device<R>, purpose: Purpose) {
        self.launch_step(device, 0, purpose, &self.b.sights);
    }

    /// Looks at worlds.
    fn observe<R: Runtime>(&mut self, device: &Device<R>, asked: &[(usize, &Progress)]) -> Vec<Moment> {
        let mut jobs = vec![None; self.worlds.len()];
        for w in 0..self.worlds.len() {
            self.set_state(w, status::BASE, 0);
            self.set_state(w, status::TARGET, 0);
        }
        for (w, g) in asked {
            jobs[*w] = Some((*g, 0, false));
            self.set_state(*w, status::ASKED, LOOK);
        }
        self.prepare(device, &jobs);
        if device.broken().is_some() {
            return Vec::new();
        }
        self.look(device, Purpose::Observe);
        self.over_blocks(device, self.signature.sights(), false, &self.b.sights);
        let seen: Vec<f32> = device.read(&self.b.gathered, 0, self.b.gathered.len);
        for (w, _) in asked {
            self.set_state(*w, status::ASKED, 0);
        }
        asked.iter().map(|(w, _)| self.moment(*w, &seen)).collect()
    }

    /// What was seen of a world.
    fn moment(&self, w: usize, seen: &[f32]) -> Moment {
        let of = |q: u32| {
            let at = (w * self.signature.sights() as usize + q as usize) * 2;
            f64::from(seen[at]) + f64::from(seen[at + 1])
        };
        let contacts = (0.5 * of(5)).round() as u64;
        let tensors = self.signature.sample.then(|| {
            let inside = std::array::from_fn(|q| of(SIGHTS + q as u32));
            tensors(&inside, self.counts[w] as u64, contacts)
        });
        Moment {
            translation: of(0),
            rotation: of(1),
            potential: of(2),
            elastic_normal: of(3),
            elastic_tangential: of(4),
            contacts,
            surface_contacts: of(6) as u64,
            overlap: of(sums::OVERLAP),
            speed: of(sums::SPEED).sqrt(),
            tensors,
        }
    }

    fn sum<R: Runtime>(&self, device: &Device<R>, n: u32, input: &Buffer, out: &Buffer) {
        let tiles = n.div_ceil(scan::TILE);
        let totals = &self.b.totals;
        let dim = CubeDim::new_1d(BLOCK);
        // SAFETY: the kernels check their bounds.
        #[allow(unsafe_code)]
        unsafe {
            scan::tiles::launch_unchecked::<R>(
                device.client(),
                grid(tiles as usize),
                dim,
                n,
                input.arg(),
                out.arg(),
                totals.arg(),
            );
            scan::join::launch_unchecked::<R>(device.client(), grid(1), dim, tiles, totals.arg());
            scan::spread::launch_unchecked::<R>(
                device.client(),
                grid((n as usize + 1).div_ceil(BLOCK as usize)),
                dim,
                n,
                tiles,
                totals.arg(),
                out.arg(),
            );
        }
    }

    /// Ends a group of `launches` steps: counts them and decides which worlds rebuild.
    fn begin<R: Runtime>(&self, device: &Device<R>, launches: u32) {
        let worlds = self.worlds.len() as u32;
        // SAFETY: the kernel checks its bounds.
        #[allow(unsafe_code)]
        unsafe {
            lists::begin::launch_unchecked::<R>(
                device.client(),
                grid((worlds as usize).div_ceil(BLOCK as usize)),
                CubeDim::new_1d(BLOCK),
                launches,
                worlds,
                self.b.worlds.arg(),
                self.b.states.arg(),
                self.b.flags.arg(),
            );
        }
    }

    /// Whether any world rebuilds, or stopped.
    fn rebuilding(&self, report: &Report) -> bool {
        (0..self.worlds.len()).any(|w| {
            self.state_word(w, status::REBUILDING) == 1
                || report.flags[w * flag::WORDS as usize + flag::HALT as usize] != halt::NO
        })
    }

    /// Rebuilds the lists of the worlds that need it.
    fn rebuild<R: Runtime>(&self, device: &Device<R>) {
        let b = &self.b;
        let (n, worlds) = (self.padded, self.worlds.len() as u32);
        let dim = CubeDim::new_1d(BLOCK);
        let by_world = grid((worlds as usize).div_ceil(BLOCK as usize));
        let by_particle = || grid((n / BLOCK) as usize);
        let client = device.client();
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            lists::bin::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                n,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.place.arg(),
                b.own.arg(),
                b.refs.arg(),
                b.bins.arg(),
                b.counters.arg(),
            );
            self.sum(device, self.cells, &b.counters, &b.starts);
            lists::scatter::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.bins.arg(),
                b.starts.arg(),
                b.counters.arg(),
                b.order.arg(),
            );
            lists::sort::launch_unchecked::<R>(
                client,
                grid((self.cells / BLOCK) as usize),
                dim,
                n,
                self.cells,
                b.world_of_cell.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.starts.arg(),
                b.own.arg(),
                b.order.arg(),
            );
            lists::gather::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                n,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.order.arg(),
                b.place.arg(),
                b.vel.arg(),
                b.spin.arg(),
                b.own.arg(),
                b.refs.arg(),
                b.slow.arg(),
                b.renamed.arg(),
            );
            lists::measure::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                n,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.starts.arg(),
                b.refs.arg(),
                b.own.arg(),
                b.lists.arg(),
                b.widths.arg(),
                b.nbr.arg(),
                self.signature.orthogonal,
            );
            self.sum(device, n / SLICE, &b.widths, &b.width_starts);
            lists::fill::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                n,
                self.rooms[0],
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.starts.arg(),
                b.refs.arg(),
                b.own.arg(),
                b.order.arg(),
                b.renamed.arg(),
                b.width_starts.arg(),
                b.lists.arg(),
                b.nbr.arg(),
                b.hist.arg(),
                self.signature.orthogonal,
                self.signature.quads(),
            );
            if self.signature.surfaces {
                self.rebuild_rows(device);
            }
            lists::commit::launch_unchecked::<R>(
                client,
                by_world,
                dim,
                worlds,
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.row_starts.arg(),
                self.signature.surfaces,
            );
        }
    }

    fn rebuild_rows<R: Runtime>(&self, device: &Device<R>) {
        let b = &self.b;
        let n = self.padded;
        let dim = CubeDim::new_1d(BLOCK);
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            rows::approach::launch_unchecked::<R>(
                device.client(),
                grid((n / BLOCK) as usize),
                dim,
                n,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.refs.arg(),
                b.bounds.arg(),
                b.poses.arg(),
                b.nodes.arg(),
                b.ordered.arg(),
                b.tris.arg(),
                b.verts.arg(),
                b.facets.arg(),
                b.near_count.arg(),
                b.near_flag.arg(),
                self.signature,
            );
            self.sum(device, n, &b.near_flag, &b.row_starts);
            self.sum(device, n, &b.near_count, &b.facet_starts);
            rows::settle::launch_unchecked::<R>(
                device.client(),
                grid((n / BLOCK) as usize),
                dim,
                n,
                self.rooms[1],
                self.rooms[2],
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.refs.arg(),
                b.order.arg(),
                b.bounds.arg(),
                b.poses.arg(),
                b.nodes.arg(),
                b.ordered.arg(),
                b.tris.arg(),
                b.verts.arg(),
                b.row_starts.arg(),
                b.facet_starts.arg(),
                b.rows.arg(),
                b.facets.arg(),
                b.row_count.arg(),
                b.row_mem.arg(),
                self.signature,
            );
        }
    }

    /// The complete state of a world.
    fn state<R: Runtime>(&self, device: &Device<R>, w: usize, g: &Progress) -> State {
        let region = &self.regions[w];
        let n = self.counts[w];
        let first = region.first as usize;
        let padded = self.padded as usize;
        let parity = self.state_word(w, status::PARITY) as usize;
        let listed = self.state_word(w, status::LISTED) as usize;
        let b = &self.b;
        let float = |q: u32| f32::from_bits(q);
        let place: Vec<[u32; 4]> = device.read(&b.place, parity * padded + first, n);
        let vel: Vec<[f32; 4]> = device.read(&b.vel, parity * padded + first, n);
        let spin: Vec<[u32; 4]> = device.read(&b.spin, parity * padded + first, n);
        let own: Vec<[u32; 4]> = device.read(&b.own, 2 * (listed * padded + first), 2 * n);
        let refs: Vec<[u32; 4]> = device.read(&b.refs, 2 * (listed * padded + first), 2 * n);
        let slow: Vec<[f32; 4]> = device.read(&b.slow, 3 * (listed * padded + first), 3 * n);
        if device.broken().is_some() {
            return State { progress: g.clone(), ..State::default() };
        }
        let three = |q: &[f32; 4]| [q[0], q[1], q[2]];
        let mut p = Particles::default();
        for i in 0..n {
            let (x, v, s, h, r) = (place[i], vel[i], spin[i], own[2 * i], own[2 * i + 1]);
            let (lo, hi) = (refs[2 * i], refs[2 * i + 1]);
            p.id.push(h[3]);
            p.place.push(Place { lo: [x[0], x[1], x[2]], radius: float(x[3]) });
            p.velocity.push(Velocity { v: three(&v), inv_mass: v[3] });
            p.spin.push(Spin { w: [float(s[0]), float(s[1]), float(s[2])], material: s[3] });
            p.hi.push([h[0] as i32, h[1] as i32, h[2] as i32]);
            p.rest.push([float(r[0]), float(r[1]), float(r[2])]);
            p.acceleration.push(three(&slow[3 * i]));
            p.angular.push(three(&slow[3 * i + 1]));
            p.force.push(three(&slow[3 * i + 2]));
            p.lo_ref.push([lo[0], lo[1], lo[2]]);
            p.hi_ref.push([hi[0] as i32, hi[1] as i32, hi[2] as i32]);
        }
        let contacts = self.contacts(device, w, &p, listed);
        let surface_contacts = self.surface_contacts(device, w, &p, parity, listed);
        State { particles: p, contacts, surface_contacts, progress: g.clone() }
    }

    fn contacts<R: Runtime>(
        &self,
        device: &Device<R>,
        w: usize,
        p: &Particles,
        listed: usize,
    ) -> Vec<ContactMemory> {
        let (c, region) = (&self.worlds[w], &self.regions[w]);
        let (n, first) = (p.len(), region.first as usize);
        let padded = self.padded as usize;
        let b = &self.b;
        let slices = (region.blocks * BLOCK / SLICE) as usize;
        let counts: Vec<u32> = device.read(&b.lists, listed * padded + first, n);
        let offsets: Vec<u32> = device.read(
            &b.lists,
            2 * padded + listed * padded / SLICE as usize + first / SLICE as usize,
            slices,
        );
        if device.broken().is_some() {
            return Vec::new();
        }
        let used = (0..n)
            .map(|i| offsets[i / SLICE as usize] - region.begins[0] + counts[i] * SLICE)
            .max()
            .unwrap_or(0)
            .next_multiple_of(SLICE)
            .min(region.rooms.lists) as usize;
        let from = listed * self.rooms[0] as usize + region.begins[0] as usize;
        let nbr: Vec<u32> = device.read(&b.nbr, from, used);
        let quads = self.signature.quads() as usize;
        let hist: Vec<Vec<[f32; 4]>> =
            (0..quads).map(|q| device.read(&b.hist, self.plane(q) + from, used)).collect();
        if device.broken().is_some() {
            return Vec::new();
        }
        let h = c.history.len();
        let mut contacts = Vec::new();
        for i in 0..n {
            let begin = (offsets[i / SLICE as usize] - region.begins[0]) as usize + i % SLICE as usize;
            for k in 0..counts[i] as usize {
                let at = begin + k * SLICE as usize;
                let entry = nbr[at];
                // Each pair is told by the particle of the lower number.
                if entry & TOUCHING == 0 || entry & SECOND != 0 {
                    continue;
                }
                let j = (entry & PARTNER) as usize - first;
                let floats = hist.iter().flat_map(|plane| plane[at]).take(h);
                contacts.push(ContactMemory { id: [p.id[i], p.id[j]], history: floats.collect() });
            }
        }
        contacts.sort_unstable_by_key(|m| m.id);
        contacts
    }

    fn surface_contacts<R: Runtime>(
        &self,
        device: &Device<R>,
        w: usize,
        p: &Particles,
        parity: usize,
        listed: usize,
    ) -> Vec<SurfaceMemory> {
        if !self.signature.surfaces {
            return Vec::new();
        }
        let (c, region) = (&self.worlds[w], &self.regions[w]);
        let b = &self.b;
        let (n, begin) = (p.len(), region.begins[1] as usize);
        let row_of: Vec<u32> = device.read(&b.rows, listed * self.padded as usize + region.first as usize, n);
        if device.broken().is_some() {
            return Vec::new();
        }
        let used = row_of.iter().filter(|r| **r != NONE).map(|r| *r as usize + 1 - begin).max().unwrap_or(0);
        let half = parity * self.rooms[1] as usize;
        let counts: Vec<u32> = device.read(&b.row_count, half + begin, used);
        let wide = self.signature.row_quads() as usize;
        let row_quads = wide * SLOTS as usize;
        let memory: Vec<[f32; 4]> = device.read(&b.row_mem, (half + begin) * row_quads, used * row_quads);
        let h = c.history.len();
        let mut found = Vec::new();
        for (i, row) in row_of.iter().enumerate().filter(|(_, r)| **r != NONE) {
            let row = *row as usize - begin;
            for k in 0..counts[row] as usize {
                let at = wide * (row * SLOTS as usize + k);
                let m = memory[at];
                found.push(SurfaceMemory {
                    id: p.id[i],
                    surface: m[3] as u32,
                    n: [m[0], m[1], m[2]],
                    history: memory[at + 1..at + wide].iter().flatten().take(h).copied().collect(),
                });
            }
        }
        found.sort_by_key(|m| (m.id, m.surface));
        found
    }
}

/// The sums over a sample, from those of [`inner`].
fn tensors(sums: &[f64; INNER as usize], particles: u64, contacts: u64) -> Tensors {
    let at = |k: u32| sums[k as usize];
    let symmetric = |k: u32| {
        let [xx, yy, zz, xy, yz, zx] = [0, 1, 2, 3, 4, 5].map(|q| at(k + q));
        [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]
    };
    Tensors {
        particles,
        contacts,
        contact: [0, 3, 6].map(|row| [0, 1, 2].map(|k| at(inner::CONTACT + row + k))),
        kinetic: symmetric(inner::KINETIC),
        fabric: symmetric(inner::FABRIC),
        stiffness: at(inner::STIFFNESS),
        solid: 4.0 / 3.0 * std::f64::consts::PI * at(inner::CUBES),
        rattlers: [0, 1].map(|k| at(inner::RATTLERS + k).round() as u64),
    }
}

/// Steps of `most` until the cell has become too narrow.
fn steps_ahead(c: &Constants, g: &Progress, most: u64) -> u64 {
    let Some(mut cell) = g.cell else { return most };
    let narrow = (1..most).find(|_| {
        cell.step(c.dt);
        too_narrow(&c.lattice.deformed(&cell.matrix), c.cutoff()).is_some()
    });
    narrow.unwrap_or(most)
}

/// Quad `q` of what a contact remembers.
fn quad_of(history: &[f32], q: usize) -> [f32; 4] {
    std::array::from_fn(|k| history.get(4 * q + k).copied().unwrap_or_default())
}

/// Widens the rooms of a world that lacks some, and those of the others in proportion to their particles: what one world
/// comes to need the others of a study will soon need too, and taking memory is slow.
fn widen(rooms: &mut [Rooms], counts: &[usize], (w, need): Lack) {
    let held = rooms[w];
    let more = if counts.len() < CROWD { 1.25 } else { 1.5 };
    let each = |need: u32, held: u32| (need > held).then(|| more * f64::from(need) / counts[w].max(1) as f64);
    let [lists, rows, facets] =
        [each(need[0], held.lists), each(need[1], held.rows), each(need[2], held.facets)];
    for (r, &count) in rooms.iter_mut().zip(counts) {
        let grown = |room: u32, each: Option<f64>| {
            each.map_or(room, |each| room.max((each * count.max(1) as f64).ceil() as u32))
        };
        r.lists = grown(r.lists, lists).next_multiple_of(BLOCK);
        r.rows = grown(r.rows, rows).next_multiple_of(BLOCK);
        r.facets = grown(r.facets, facets);
    }
}

impl State {
    /// Particle `id` in words: number, place, speed, contacts.
    fn describe(&self, c: &Constants, id: u32) -> String {
        let Some(i) = self.particles.id.iter().position(|&k| k == id) else {
            return format!("particle {id}");
        };
        let pairs = self.contacts.iter().filter(|m| m.id.contains(&id));
        let mut with: Vec<String> =
            pairs.map(|m| (if m.id[0] == id { m.id[1] } else { m.id[0] }).to_string()).collect();
        let surfaces = self.surface_contacts.iter().filter(|m| m.id == id);
        with.extend(surfaces.map(|m| format!("`{}`", c.boundaries[m.surface as usize].name)));
        Portrait::of(&c.lattice_now(&self.progress), &self.particles, i).describe(with)
    }
}
