//! Neighbour lists: which particles and surfaces may touch before the next rebuild.
//!
//! In the grid particles are ordered by size level, then by rows of cells along the first axis, then by position along
//! the row. A particle looks through the nine rows around its own in its level and in every coarser one,
//! within a window along the row: memory follows particles, never empty space, and small particles do not
//! pay for the cells of large ones. The other searches order them along the curve of [`crate::curve`].
//!
//! A list is a pure function of the reference configuration (places at the last rebuild, in their order), so
//! a checkpoint stores that and not the list.

use rayon::prelude::*;

use super::tree::Tree;
use crate::curve::Curve;
use crate::lattice::{Lattice, UNITS, dot, sub};
use crate::setup::{BoundaryShape, Constants, LEVEL_RATIO, MEMORY};
use crate::spec::{Pose, Search, Vec3};
use crate::state::{ContactMemory, History, Particles, Progress, SurfaceMemory};
use crate::surface::Span;

/// Particles per block: the unit of parallel work. Fixed, so that results do not depend on threads.
pub const BLOCK: usize = 256;

/// Candidates of a run of particles and what their contacts remember.
#[derive(Debug, Default)]
pub struct Block {
    /// First particle.
    pub first: usize,
    /// Candidates of particle `first + l` are `start[l]..start[l + 1]`.
    pub start: Vec<u32>,
    /// Each pair stands once.
    pub candidates: Vec<Candidate>,
    /// Partners that are not the block's own, ascending.
    pub guests: Vec<u32>,
    /// Whether the pair touched in the last step.
    pub touching: Vec<bool>,
    /// History, as many quads per candidate as the laws' floats fill, seen from this block's particle.
    pub history: Vec<Quad>,
    /// Candidates with surfaces.
    pub patches: Vec<Patch>,
    /// Triangles of the patches.
    pub facets: Vec<Facet>,
}

/// A pair that may touch.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// The first particle, counted from the block's first.
    pub owner: u32,
    /// The other particle.
    pub partner: u32,
    /// Where the other's share is summed: the block's particles come first, then the guests.
    pub slot: u32,
}

/// Four numbers, as vector units load them.
pub type Quad = [f32; 4];

/// What the contacts of one block give one particle. The fourth numbers are always 0.
#[derive(Clone, Copy, Debug, Default)]
pub struct Share {
    /// Force \[N\].
    pub force: Quad,
    /// Torque \[N m\].
    pub torque: Quad,
}

impl Share {
    /// Adds a force and a torque.
    #[inline(always)]
    pub fn add(&mut self, force: [f32; 3], torque: [f32; 3]) {
        for x in 0..3 {
            self.force[x] += force[x];
            self.torque[x] += torque[x];
        }
    }
}

impl Block {
    /// Number of particles.
    pub fn count(&self) -> usize {
        self.start.len() - 1
    }

    /// Number of particles that the block sums contacts for: its own and the guests.
    pub fn shares(&self) -> usize {
        self.count() + self.guests.len()
    }

    /// Candidates of the particle `local`.
    pub fn of(&self, local: usize) -> std::ops::Range<usize> {
        self.start[local] as usize..self.start[local + 1] as usize
    }
}

/// A particle near a surface.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Particle, counted from the block's first.
    pub local: u32,
    /// Boundary.
    pub boundary: u32,
    /// Range in the block's facets; empty for planes.
    pub facets: (u32, u32),
    /// Contacts of the last step.
    pub contacts: Vec<Touching>,
}

/// A triangle, or a part of a shell of revolution, near a particle.
#[derive(Clone, Copy, Debug)]
pub struct Facet {
    /// Triangle or part.
    pub triangle: u32,
    /// Image of the particle that is near, in periods along each axis.
    pub shift: [i32; 3],
}

/// A contact with a surface.
#[derive(Clone, Copy, Debug)]
pub struct Touching {
    /// Unit vector into the surface.
    pub n: [f32; 3],
    /// History.
    pub history: [f32; MEMORY],
}

/// Where contact memory is taken from when lists are built.
pub enum Memory<'a> {
    /// The lists before, with the old index of each particle.
    Lists(&'a [Block], &'a [u32]),
    /// A stored state: ascending by numbers.
    Stored(&'a [ContactMemory], &'a [SurfaceMemory]),
}

/// For each particle, the shares that other blocks sum for it.
#[derive(Debug, Default)]
pub struct Incoming {
    /// Entries of particle j are `start[j]..start[j + 1]`.
    pub start: Vec<u32>,
    /// Shares, counted over all blocks.
    pub entry: Vec<u32>,
    /// First share of each block, and their number.
    pub base: Vec<u32>,
}

/// A size level and its rows.
struct Level {
    radius: f64,
    /// Cells per window.
    cells: [u32; 3],
    /// Cells along each axis; only for periodic axes.
    count: [i64; 3],
    rows: Vec<Row>,
}

#[derive(Clone, Copy)]
struct Row {
    at: [i32; 2],
    begin: u32,
    end: u32,
}

/// A row and the ranges of particles in the rows around it.
type RowsAround = ([i32; 2], Vec<(u32, u32)>);

/// Sort key: level, row (third axis before second), units along the row, number. Along the curve the code stands for the
/// units, in one row.
type Key = (u8, i32, i32, i64, u32);

/// The size level of a radius: radii of a level differ at most by [`LEVEL_RATIO`].
fn level_of(radius: f64, largest: f64) -> u8 {
    let mut limit = largest / LEVEL_RATIO;
    let mut level = 0;
    while radius <= limit && level < 30 {
        limit /= LEVEL_RATIO;
        level += 1;
    }
    level
}

/// Cell of a reference place along an axis with `cells` per window.
fn cell(hi: i32, lo: u32, cells: u32) -> i32 {
    hi * cells as i32 + ((u64::from(lo) * u64::from(cells)) >> 32) as i32
}

fn levels(c: &Constants, lattice: &Lattice, p: &Particles, skin: f64) -> Vec<Level> {
    let mut largest: Vec<f64> = Vec::new();
    for place in &p.place {
        let l = usize::from(level_of(f64::from(place.radius), c.radius_max));
        if largest.len() <= l {
            largest.resize(l + 1, 0.0);
        }
        largest[l] = largest[l].max(f64::from(place.radius));
    }
    largest
        .into_iter()
        .map(|radius| {
            let cutoff = 2.0 * radius + c.range + skin;
            // Rounding must not make a cell smaller than the cut-off.
            let cells = lattice.height.map(|h| ((h / cutoff) * (1.0 - 1e-9)).floor().clamp(1.0, 1e6) as u32);
            let count = [0, 1, 2].map(|k| i64::from(cells[k]) * i64::from(lattice.windows[k]));
            Level { radius, cells, count, rows: Vec::new() }
        })
        .collect()
}

/// The order in which particles are stored: neighbours in space are neighbours in memory.
pub fn order(c: &Constants, lattice: &Lattice, p: &Particles, skin: f64) -> Vec<u32> {
    if c.spec.search != Search::Grid {
        // The domain as it was at first, so that codes do not change in kind while a cell deforms.
        let (curve, bits) = (Curve::of(&c.lattice), Curve::bits(p.len()));
        let share = |i: usize, k: usize| {
            let at = Lattice::units(p.hi_ref[i][k], p.lo_ref[i][k]).clamp(0, lattice.extent[k] - 1);
            (at as f64 / lattice.extent[k] as f64 * UNITS) as u32
        };
        let code = |i: usize| curve.code(bits, [0, 1, 2].map(|k| share(i, k)));
        return sorted(p.len(), |i| (0, 0, 0, i64::from(code(i)), p.id[i]));
    }
    let levels = levels(c, lattice, p, skin);
    let key = |i: usize| -> Key {
        let level = level_of(f64::from(p.place[i].radius), c.radius_max);
        let cells = levels[usize::from(level)].cells;
        let (hi, lo) = (p.hi_ref[i], p.lo_ref[i]);
        let row = [1, 2].map(|k| cell(hi[k], lo[k], cells[k]));
        (level, row[1], row[0], Lattice::units(hi[0], lo[0]), p.id[i])
    };
    sorted(p.len(), key)
}

fn sorted(count: usize, key: impl Fn(usize) -> Key) -> Vec<u32> {
    let mut keyed: Vec<(Key, u32)> = (0..count).map(|i| (key(i), i as u32)).collect();
    // Stable and adaptive: particles hardly change places between rebuilds.
    keyed.par_sort();
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// Builds the lists of the reference configuration, whose order is that of [`order`].
pub fn build(
    c: &Constants,
    p: &Particles,
    g: &Progress,
    boundaries: &[Option<Pose>],
    memory: &Memory<'_>,
) -> Vec<Block> {
    let lattice = &c.lattice_then(g);
    let finder = match c.spec.search {
        Search::Grid => Finder::Grid(Rows::new(c, lattice, p, g.skin)),
        Search::Bvh => Finder::Bvh(Tree::new(p)),
        Search::AllPairs => Finder::AllPairs,
    };
    let search = Around { c, lattice, p, finder: &finder, skin: g.skin };
    let blocks = p.len().div_ceil(BLOCK);
    (0..blocks)
        .into_par_iter()
        .map(|b| {
            let mut block = search.block(b * BLOCK, ((b + 1) * BLOCK).min(p.len()));
            search.surfaces(&mut block, boundaries);
            recall(c, p, &mut block, memory);
            block
        })
        .collect()
}

/// The grid: levels and their rows.
struct Rows {
    levels: Vec<Level>,
    /// Units along the row of each particle.
    along: Vec<i64>,
    /// Level of each particle.
    of: Vec<u8>,
}

impl Rows {
    fn new(c: &Constants, lattice: &Lattice, p: &Particles, skin: f64) -> Self {
        let mut levels = levels(c, lattice, p, skin);
        let mut along = Vec::with_capacity(p.len());
        let mut of = Vec::with_capacity(p.len());
        for i in 0..p.len() {
            let (hi, lo) = (p.hi_ref[i], p.lo_ref[i]);
            along.push(Lattice::units(hi[0], lo[0]));
            let l = level_of(f64::from(p.place[i].radius), c.radius_max);
            of.push(l);
            let level = &mut levels[usize::from(l)];
            let at = [1, 2].map(|k| cell(hi[k], lo[k], level.cells[k]));
            match level.rows.last_mut() {
                Some(row) if row.at == at => row.end += 1,
                _ => level.rows.push(Row { at, begin: i as u32, end: i as u32 + 1 }),
            }
        }
        Self { levels, along, of }
    }
}

/// What finds the particles near one.
enum Finder {
    Grid(Rows),
    Bvh(Tree),
    AllPairs,
}

struct Around<'a> {
    c: &'a Constants,
    /// Positions in the cell of the reference.
    lattice: &'a Lattice,
    p: &'a Particles,
    finder: &'a Finder,
    skin: f64,
}

impl Around<'_> {
    fn block(&self, first: usize, end: usize) -> Block {
        let mut block = Block { first, start: vec![0], ..Block::default() };
        let mut partners = Vec::with_capacity(8 * (end - first));
        let mut around = Vec::new();
        for i in first..end {
            match self.finder {
                Finder::Grid(rows) => self.through(rows, i, &mut around, &mut partners),
                Finder::Bvh(tree) => {
                    let beyond = f64::from(self.p.place[i].radius) + self.c.range + self.skin;
                    tree.near(self.lattice, self.p, i, beyond, |j| self.candidate(i, j, &mut partners));
                }
                Finder::AllPairs => (i + 1..self.p.len()).for_each(|j| self.candidate(i, j, &mut partners)),
            }
            block.start.push(partners.len() as u32);
        }
        let own = first as u32..end as u32;
        block.guests.extend(partners.iter().filter(|j| !own.contains(j)));
        block.guests.sort_unstable();
        block.guests.dedup();
        let count = own.len() as u32;
        block.candidates.reserve_exact(partners.len());
        for local in 0..block.count() {
            for &partner in &partners[block.of(local)] {
                let slot = if own.contains(&partner) {
                    partner - own.start
                } else {
                    count + block.guests.partition_point(|&guest| guest < partner) as u32
                };
                block.candidates.push(Candidate { owner: local as u32, partner, slot });
            }
        }
        block
    }

    /// Candidates of `i` in the grid. Neighbours in the order mostly share their row, and so the rows around it.
    fn through(&self, rows: &Rows, i: usize, around: &mut Vec<RowsAround>, partners: &mut Vec<u32>) {
        around.resize_with(rows.levels.len(), || ([i32::MIN; 2], Vec::new()));
        for (l, level) in rows.levels.iter().enumerate().take(usize::from(rows.of[i]) + 1) {
            let at = [1, 2].map(|k| cell(self.p.hi_ref[i][k], self.p.lo_ref[i][k], level.cells[k]));
            if around[l].0 != at {
                around[l].0 = at;
                self.rows_around(at, level, &mut around[l].1);
            }
            for &(begin, end) in &around[l].1 {
                self.row(rows, i, l, begin as usize, end as usize, partners);
            }
        }
    }

    /// The rows of a level around the row `center`, each once, in the order of storage.
    fn rows_around(&self, center: [i32; 2], level: &Level, found: &mut Vec<(u32, u32)>) {
        found.clear();
        let mut near = [[0_i32; 3]; 2];
        let mut n = [0; 2];
        for (a, axis) in [1, 2].into_iter().enumerate() {
            for d in -1..=1 {
                let mut at = center[a] + d;
                if self.lattice.periodic[axis] {
                    at = i64::from(at).rem_euclid(level.count[axis]) as i32;
                }
                if !near[a][..n[a]].contains(&at) {
                    near[a][n[a]] = at;
                    n[a] += 1;
                }
            }
        }
        for &z in &near[1][..n[1]] {
            for &y in &near[0][..n[0]] {
                if let Ok(k) = level.rows.binary_search_by(|r| (r.at[1], r.at[0]).cmp(&(z, y))) {
                    found.push((level.rows[k].begin, level.rows[k].end));
                }
            }
        }
    }

    /// Candidates of `i` in one row of level `l`.
    fn row(&self, rows: &Rows, i: usize, l: usize, begin: usize, end: usize, partners: &mut Vec<u32>) {
        let same = usize::from(rows.of[i]) == l;
        // Within a level each pair stands at the particle that is stored first.
        let begin = if same { begin.max(i + 1) } else { begin };
        if begin >= end {
            return;
        }
        let lattice = self.lattice;
        let ri = f64::from(self.p.place[i].radius);
        let beyond = self.c.range + self.skin;
        let reach = ((ri + rows.levels[l].radius + beyond) / lattice.height[0] * UNITS) as i64 + 1;
        let span = i64::from(lattice.windows[0]) << 32;
        let images: &[i64] = if lattice.periodic[0] { &[0, -1, 1] } else { &[0] };
        let row = &rows.along[begin..end];
        for &image in images {
            let at = rows.along[i] + image * span;
            let from = row.partition_point(|&x| x < at - reach);
            for (k, &x) in row.iter().enumerate().skip(from) {
                if x > at + reach {
                    break;
                }
                self.candidate(i, begin + k, partners);
            }
        }
    }

    /// Takes `j` if it is within reach of `i`.
    #[inline]
    fn candidate(&self, i: usize, j: usize, partners: &mut Vec<u32>) {
        let d = self.between(i, j);
        let [ri, rj] = [i, j].map(|k| f64::from(self.p.place[k].radius));
        let s = ri + rj + (self.c.range + self.skin);
        if dot(d, d) < s * s {
            partners.push(j as u32);
        }
    }

    /// From i to the nearest image of j in the reference configuration \[m\].
    fn between(&self, i: usize, j: usize) -> Vec3 {
        let (p, lattice) = (self.p, self.lattice);
        let d = [0, 1, 2].map(|k| {
            let a = Lattice::units(p.hi_ref[i][k], p.lo_ref[i][k]);
            let b = Lattice::units(p.hi_ref[j][k], p.lo_ref[j][k]);
            lattice.difference(k, a, b)
        });
        lattice.metres(d)
    }

    /// Candidates with surfaces: those within reach of the present poses.
    fn surfaces(&self, block: &mut Block, boundaries: &[Option<Pose>]) {
        let count = block.count();
        let mut near = Vec::new();
        let span = |(b, pose): (usize, &Option<Pose>)| {
            Span::new(self.c, &self.c.boundaries[b].shape, pose.as_ref()?)
        };
        let spans: Vec<Option<Span>> = boundaries.iter().enumerate().map(span).collect();
        for local in 0..count {
            let i = block.first + local;
            let at = self.lattice.decode(self.p.hi_ref[i], self.p.lo_ref[i], [0.0; 3]);
            let reach = f64::from(self.p.place[i].radius) + self.c.range + self.skin;
            for (b, pose) in boundaries.iter().enumerate() {
                let Some(pose) = pose else { continue };
                match &self.c.boundaries[b].shape {
                    BoundaryShape::Plane(normal) => {
                        let n = crate::surface::rotate(pose.rotation, *normal);
                        if dot(n, sub(at, pose.translation)) < reach {
                            block.patches.push(patch(local, b, (0, 0)));
                        }
                    }
                    BoundaryShape::Frustum(frustum) => {
                        let begin = block.facets.len();
                        let axis = crate::surface::rotate(pose.rotation, frustum.axis);
                        for shift in spans[b].iter().flat_map(|span| span.images(self.c, at, reach)) {
                            let x = sub(self.c.shifted(at, shift), pose.translation);
                            let near = |part: &u32| frustum.touch(axis, x, *part, shift, reach).is_some();
                            let parts = (0..frustum.parts()).filter(near);
                            block.facets.extend(parts.map(|part| Facet { triangle: part, shift }));
                        }
                        let end = block.facets.len();
                        if end > begin {
                            block.patches.push(patch(local, b, (begin as u32, end as u32)));
                        }
                    }
                    BoundaryShape::Mesh(mesh, bvh) => {
                        let begin = block.facets.len();
                        for shift in spans[b].iter().flat_map(|span| span.images(self.c, at, reach)) {
                            near.clear();
                            let x = pose.inverse(self.c.shifted(at, shift));
                            bvh.near(x, reach, &mut near);
                            // Boxes around long triangles reach far; only what is near is looked at each step.
                            near.retain(|&t| {
                                let corners = mesh.triangles[t as usize];
                                let vertices = corners.map(|v| sub(mesh.vertices[v as usize], x));
                                crate::surface::touch(vertices, t, shift, reach).is_some()
                            });
                            near.sort_unstable();
                            block.facets.extend(near.iter().map(|&triangle| Facet { triangle, shift }));
                        }
                        let end = block.facets.len();
                        if end > begin {
                            block.patches.push(patch(local, b, (begin as u32, end as u32)));
                        }
                    }
                }
            }
        }
    }
}

fn patch(local: usize, boundary: usize, facets: (u32, u32)) -> Patch {
    Patch { local: local as u32, boundary: boundary as u32, facets, contacts: Vec::new() }
}

/// Quads that hold what a contact remembers.
pub fn quads(c: &Constants) -> usize {
    c.history.len().div_ceil(4)
}

/// Gives the candidates of a new block what their contacts remember.
fn recall(c: &Constants, p: &Particles, block: &mut Block, memory: &Memory<'_>) {
    let h = c.history.len();
    let n = block.candidates.len();
    block.touching = vec![false; n];
    block.history = vec![[0.0; 4]; n * quads(c)];
    for local in 0..block.count() {
        let i = block.first + local;
        for k in block.of(local) {
            let j = block.candidates[k].partner as usize;
            if let Some((history, swapped)) = memory.pair(p, i, j, quads(c)) {
                block.touching[k] = true;
                let own = &mut block.history[k * quads(c)..(k + 1) * quads(c)];
                for (f, new) in own.as_flattened_mut()[..h].iter_mut().enumerate() {
                    *new = if swapped { history[f] * c.history[f] } else { history[f] };
                }
            }
        }
    }
    for patch in &mut block.patches {
        patch.contacts = memory.surface(p, block.first + patch.local as usize, patch, h);
    }
}

impl Memory<'_> {
    /// The history of the pair (i, j) in `quads` quads, and whether it is seen from j.
    fn pair(&self, p: &Particles, i: usize, j: usize, quads: usize) -> Option<(&[f32], bool)> {
        match self {
            Self::Lists(blocks, old) => {
                let (oi, oj) = (old[i] as usize, old[j] as usize);
                let find = |a: usize, b: usize| {
                    let block = &blocks[a / BLOCK];
                    let own = block.of(a % BLOCK);
                    let k = own.start + block.candidates[own].iter().position(|q| q.partner as usize == b)?;
                    Some((block, k))
                };
                // A pair stands once: at one of the two.
                let ((block, k), swapped) =
                    find(oi, oj).map(|x| (x, false)).or_else(|| find(oj, oi).map(|x| (x, true)))?;
                let history = || block.history[k * quads..(k + 1) * quads].as_flattened();
                block.touching[k].then(|| (history(), swapped))
            }
            Self::Stored(contacts, _) => {
                let (a, b) = (p.id[i], p.id[j]);
                let id = [a.min(b), a.max(b)];
                let k = contacts.binary_search_by(|m| m.id.cmp(&id)).ok()?;
                Some((&contacts[k].history, a > b))
            }
        }
    }

    /// The contacts of particle i with the surface of `patch`.
    fn surface(&self, p: &Particles, i: usize, patch: &Patch, h: usize) -> Vec<Touching> {
        match self {
            Self::Lists(blocks, old) => {
                let o = old[i] as usize;
                let block = &blocks[o / BLOCK];
                let local = (o % BLOCK) as u32;
                let from = block.patches.partition_point(|q| q.local < local);
                block.patches[from..]
                    .iter()
                    .take_while(|q| q.local == local)
                    .find(|q| q.boundary == patch.boundary)
                    .map_or_else(Vec::new, |q| q.contacts.clone())
            }
            Self::Stored(_, surfaces) => {
                let key = (p.id[i], patch.boundary);
                let from = surfaces.partition_point(|m| (m.id, m.surface) < key);
                surfaces[from..]
                    .iter()
                    .take_while(|m| (m.id, m.surface) == key)
                    .map(|m| {
                        let mut history = [0.0; MEMORY];
                        history[..h].copy_from_slice(&m.history);
                        Touching { n: m.n, history }
                    })
                    .collect()
            }
        }
    }
}

/// Where the shares of each particle are, for `n` particles.
pub fn incoming(blocks: &[Block], n: usize) -> Incoming {
    let mut start = vec![0_u32; n + 1];
    for &j in blocks.iter().flat_map(|block| &block.guests) {
        start[j as usize + 1] += 1;
    }
    for j in 0..n {
        start[j + 1] += start[j];
    }
    let mut next = start.clone();
    let mut entry = vec![0; start[n] as usize];
    let mut base = vec![0];
    let mut share = 0;
    for block in blocks {
        for (guest, &j) in block.guests.iter().enumerate() {
            let at = &mut next[j as usize];
            entry[*at as usize] = share + (block.count() + guest) as u32;
            *at += 1;
        }
        share += block.shares() as u32;
        base.push(share);
    }
    Incoming { start, entry, base }
}

/// What contacts remember, in a form that no backend's layout shows in.
pub fn memories(c: &Constants, p: &Particles, blocks: &[Block]) -> (Vec<ContactMemory>, Vec<SurfaceMemory>) {
    let h = c.history.len();
    let (mut contacts, mut surfaces) = (Vec::new(), Vec::new());
    for block in blocks {
        for local in 0..block.count() {
            let a = p.id[block.first + local];
            for k in block.of(local) {
                if !block.touching[k] {
                    continue;
                }
                let b = p.id[block.candidates[k].partner as usize];
                let own = &block.history[k * quads(c)..(k + 1) * quads(c)];
                let mut history = History::from_slice(&own.as_flattened()[..h]);
                if a > b {
                    history.iter_mut().zip(&c.history).for_each(|(x, sign)| *x *= sign);
                }
                contacts.push(ContactMemory { id: [a.min(b), a.max(b)], history });
            }
        }
        for q in &block.patches {
            let id = p.id[block.first + q.local as usize];
            surfaces.extend(q.contacts.iter().map(|t| SurfaceMemory {
                id,
                surface: q.boundary,
                n: t.n,
                history: History::from_slice(&t.history[..h]),
            }));
        }
    }
    contacts.sort_unstable_by_key(|m| m.id);
    surfaces.sort_by_key(|m| (m.id, m.surface));
    (contacts, surfaces)
}
