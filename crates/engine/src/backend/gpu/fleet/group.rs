//! Memory of worlds that run the same kernels: laid out, taken, filled with tables, and taken anew where it is short.

use std::sync::Arc;

use cubecl::prelude::*;

use super::super::device::{Device, QUAD, rows_of_grid};
use super::super::layout::{
    BLOCK, NONE, PAIR_QUADS, PERIOD, REFER, SLICE, SLOTS, SUMS, Signature, boundary, flag, halt, status,
    world,
};
use super::super::tables::{Meshes, Region, Rooms, cell_room, deform, leaves, pair_quads, stand, world_row};
use super::super::{keep, scan, step};
use super::{Buffers, CROWD, Group, Lack};
use crate::backend::PhaseTimes;
use crate::setup::Constants;
use crate::state::{Progress, State};

/// Bytes that the forces of blocks on surfaces may take in all steps of a group.
const PUSHED: usize = 64 << 20;

impl Group {
    pub(super) fn new<R: Runtime>(
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
            let mut progress: Vec<(usize, &mut Progress)> =
                worlds.iter_mut().enumerate().map(|(w, (_, s))| (w, &mut s.progress)).collect();
            let Some(needs) = group.relist(device, &mut progress) else { return group };
            if device.broken().is_some() {
                return group;
            }
            for need in needs {
                widen(&mut rooms, &counts, need);
            }
        }
    }

    /// Lays worlds of so many particles out and takes memory.
    pub(super) fn allocate<R: Runtime>(
        device: &Device<R>,
        signature: Signature,
        worlds: &[(Arc<Constants>, usize)],
        rooms: &[Rooms],
    ) -> Self {
        let (mut padded, mut cells, mut begins) = (0_u32, 0_u32, [0_u32; 3]);
        let (mut pairs, mut boundaries, mut nodes) = (0_u32, 0_u32, 0_u32);
        let mut regions = Vec::new();
        let (mut quads, mut meshes) = (Vec::new(), Meshes::default());
        for ((c, count), room) in worlds.iter().zip(rooms) {
            let count = *count;
            let region = Region {
                first: padded,
                count,
                blocks: (count.max(1) as u32).div_ceil(BLOCK),
                cells,
                cell_room: cell_room(c, count),
                begins,
                rooms: *room,
                nodes,
                pairs,
                boundaries,
            };
            padded += region.blocks * BLOCK;
            cells += region.cell_room;
            // In a binary heap the root is node 1.
            nodes += 2 * leaves(c, region.blocks);
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
        // Blocks of which rows make a grid, with none beyond them.
        let blocks = (padded / BLOCK) as usize;
        let idle = rows_of_grid(blocks) as u32 - padded / BLOCK;
        padded += idle * BLOCK;
        let n = padded as usize;
        let names = worlds.iter().map(|(c, _)| c.spec.surfaces.len()).max().unwrap_or(0);
        let [entries, row_room, facet_room] = begins.map(|x| x as usize);
        let idlers = vec![worlds.len().saturating_sub(1) as u32; idle as usize];
        let pairs_kept = keep::room(begins[0]) as usize;
        let pushed = row_room / signature.rows_of_block() * names;
        let held = (PUSHED / (2 * QUAD * pushed).max(1)).clamp(1, PERIOD as usize) as u32;
        let b = Buffers {
            // Blocks of particles, rows and facets.
            world_of: device.upload(
                &[
                    per(&|r| r.blocks),
                    idlers,
                    per(&|r| r.rooms.rows / BLOCK),
                    per(&|r| r.rooms.facets / BLOCK),
                ]
                .concat(),
            ),
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
            tree: device.zeros(2 * nodes as usize, QUAD),
            slow: device.zeros(6 * n, QUAD),
            lists: device.zeros(n + n / SLICE as usize, 4),
            nbr: device.zeros(entries, 4),
            hist: device.zeros(entries * signature.quads() as usize, QUAD),
            world_of_kept: device.upload(&per(&|r| keep::room(r.rooms.lists) / BLOCK)),
            held: device.zeros(worlds.len(), 4),
            kept: device.zeros(2 * pairs_kept, 4),
            kept_hist: device.zeros(pairs_kept * signature.quads() as usize, QUAD),
            bounds: device.upload(&meshes.rows),
            poses: device.zeros(1, 4),
            tris: device.upload(&meshes.triangles),
            verts: device.upload(&meshes.vertices),
            nodes: device.upload(&meshes.nodes),
            ordered: device.upload(&meshes.order),
            rows: device.zeros(2 * n + 6 * row_room, 4),
            facets: device.zeros(2 * facet_room, QUAD),
            told: device.zeros(if signature.told { 2 * facet_room } else { 1 }, QUAD),
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
            listed: device.zeros(n, 4),
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
            cut: worlds.iter().map(|_| None).collect(),
            b,
            times: PhaseTimes::default(),
        }
    }

    /// Pairs of world `w` that are kept: where they begin, and for how many there is room.
    pub(super) fn kept(&self, w: usize) -> (usize, usize) {
        let region = &self.regions[w];
        (keep::room(region.begins[0]) as usize, keep::room(region.rooms.lists) as usize)
    }

    /// Where F4 `q` of what kept pairs remember begins.
    pub(super) fn kept_plane(&self, q: usize) -> usize {
        q * keep::room(self.rooms[0]) as usize
    }

    pub(super) fn state_word(&self, w: usize, k: u32) -> u32 {
        self.states[w * status::WORDS as usize + k as usize]
    }

    pub(super) fn set_state(&mut self, w: usize, k: u32, x: u32) {
        self.states[w * status::WORDS as usize + k as usize] = x;
    }

    /// Uploads tables for jobs of a number of steps from the progress of each world (`None` for idle ones), with
    /// poses of the present or of the lists' reference. Says which worlds have a mesh too many periods away.
    pub(super) fn prepare<R: Runtime>(
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
    pub(super) fn relist<R: Runtime>(
        &mut self,
        device: &Device<R>,
        loaded: &mut [(usize, &mut Progress)],
    ) -> Option<Vec<Lack>> {
        let mut jobs = vec![None; self.worlds.len()];
        for (w, g) in loaded.iter() {
            jobs[*w] = Some((&**g, 0, !g.stale));
        }
        self.prepare(device, &jobs);
        if device.broken().is_some() {
            return None;
        }
        self.begin(device, 0);
        self.rebuild(device);
        let lacks = Self::needs(&self.fetch(device).flags);
        for (w, g) in loaded.iter_mut() {
            // Lists for which there was no room are still to be made.
            if g.stale && lacks.is_none() {
                g.refer(&self.worlds[*w]);
                g.stale = false;
                g.rebuilds += 1;
            }
            self.last[*w] = g.clone();
        }
        lacks
    }

    /// Makes the lists of a world anew whose surfaces came or went.
    pub(super) fn renew<R: Runtime>(&mut self, device: &Device<R>, w: usize, g: &mut Progress) {
        self.keep_touching(device, w);
        self.set_state(w, status::ASKED, REFER);
        self.set_state(w, status::PRIMED, u32::from(g.primed));
        g.stale = true;
        if let Some(needs) = self.relist(device, &mut [(w, g)]) {
            let mut state = self.state(device, w, g);
            self.regrow(device, needs, w, &mut state);
            *g = state.progress;
        }
    }

    pub(super) fn needs(flags: &[u32]) -> Option<Vec<Lack>> {
        let needs: Vec<Lack> = flags
            .chunks_exact(flag::WORDS as usize)
            .enumerate()
            .filter(|(_, f)| f[flag::HALT as usize] == halt::ROOM)
            .map(|(w, f)| (w, [0, 1, 2].map(|k| f[(flag::NEED + k) as usize])))
            .collect();
        (!needs.is_empty()).then_some(needs)
    }

    /// Takes more memory: every world is read and put again, world `w` from `given`, which is not on the device yet.
    pub(super) fn regrow<R: Runtime>(
        &mut self,
        device: &Device<R>,
        needs: Vec<Lack>,
        w: usize,
        given: &mut State,
    ) {
        let mut rooms: Vec<Rooms> = self.regions.iter().map(|r| r.rooms).collect();
        for need in needs {
            widen(&mut rooms, &self.counts, need);
        }
        self.lay_out_anew(device, rooms, w, given);
    }

    /// Takes memory for a world that has become too large for its part, and loads it.
    pub(super) fn enlarge<R: Runtime>(&mut self, device: &Device<R>, w: usize, given: &mut State) {
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
        let (times, cut) = (self.times, std::mem::take(&mut self.cut));
        // What it had is given back before more is taken.
        *self = Self::allocate(device, self.signature, &[], &[]);
        *self = Self::new(device, self.signature, &mut worlds, rooms);
        (self.times, self.cut) = (times, cut);
        *given = std::mem::take(&mut states[w]);
    }
}

/// Particles that a world gets room for: where more come through inlets, half as many again.
pub(super) fn with_newcomers(c: &Constants, count: usize) -> usize {
    if c.spec.inlets.is_empty() { count } else { count + count / 2 + BLOCK as usize }
}

/// Particles of a world from which on memory is what it is short of.
const HUGE: usize = 4_000_000;

/// A guess at what a world needs room for; a rebuild that needs more is repeated with more.
pub(super) fn first_rooms(c: &Constants, count: usize, worlds: usize) -> Rooms {
    let n = count.max(1) as u32;
    // Grains that fall on each other come to need twice as much as grains at rest. To take more is slow for many worlds, which
    // have room for that from the start; where lists are most of a device's memory there is as little as the skin of slow
    // grains asks for.
    let listed = if worlds >= CROWD {
        40
    } else if count < HUGE {
        16
    } else {
        12
    };
    let surfaces = !c.boundaries.is_empty();
    // A world's sides grow as its volume's power of two thirds.
    let sides = 12 * (f64::from(n).cbrt().powi(2) as u32);
    let rows = n.min(4096 + sides.min(n / 8));
    Rooms {
        lists: listed * n.next_multiple_of(BLOCK),
        rows: if surfaces { rows.next_multiple_of(BLOCK) } else { BLOCK },
        facets: if surfaces { (4 * rows).next_multiple_of(BLOCK) } else { BLOCK },
    }
}

/// Widens the rooms of a world that lacks some, and those of the others in proportion to their particles: what one world
/// comes to need the others of a study will soon need too, and taking memory is slow.
fn widen(rooms: &mut [Rooms], counts: &[usize], (w, need): Lack) {
    let held = rooms[w];
    let more = match counts.len() {
        CROWD.. => 1.5,
        _ if counts[w] < HUGE => 1.25,
        _ => 1.05,
    };
    let each = |need: u32, held: u32| (need > held).then(|| more * f64::from(need) / counts[w].max(1) as f64);
    let [lists, rows, facets] =
        [each(need[0], held.lists), each(need[1], held.rows), each(need[2], held.facets)];
    for (r, &count) in rooms.iter_mut().zip(counts) {
        let grown = |room: u32, each: Option<f64>| {
            each.map_or(room, |each| room.max((each * count.max(1) as f64).ceil() as u32))
        };
        r.lists = grown(r.lists, lists).next_multiple_of(2 * BLOCK);
        r.rows = grown(r.rows, rows).next_multiple_of(BLOCK);
        r.facets = grown(r.facets, facets).next_multiple_of(BLOCK);
    }
}
