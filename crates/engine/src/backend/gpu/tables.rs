//! What kernels look up: worlds, pairs of materials, boundaries, meshes and poses, as words.

use super::choices::Choices;
use super::layout::{BLOCK, IMAGE_ZERO, NONE, SLICE, boundary, path_word, pose, status, world};
use super::search::LEAF;
use crate::backend::common::{runaway_distance, strays};
use crate::classes::{self, Classes};
use crate::curve::Curve;
use crate::lattice::Lattice;
use crate::setup::{BoundaryShape, Constants, SKIN_MIN};
use crate::spec::{Pose, Search};
use crate::state::Progress;
use crate::surface::{Placed, Span, rotate};

/// What a world has room for.
#[derive(Clone, Copy, Debug)]
pub struct Rooms {
    /// List entries, in steps of two blocks.
    pub lists: u32,
    /// Rows of particles near surfaces.
    pub rows: u32,
    /// Facets.
    pub facets: u32,
}

/// Where a world lies in the buffers of its group.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// First particle.
    pub first: u32,
    /// Particles that there is room for.
    pub count: usize,
    /// Blocks of particles.
    pub blocks: u32,
    /// First cell.
    pub cells: u32,
    /// Cells.
    pub cell_room: u32,
    /// First list entry, row and facet.
    pub begins: [u32; 3],
    /// How many of each there may be.
    pub rooms: Rooms,
    /// First node of the hierarchy over its particles.
    pub nodes: u32,
    /// First pair of materials.
    pub pairs: u32,
    /// First boundary.
    pub boundaries: u32,
}

/// The cells that a world may come to need: as many as its finest grid has, but no more than follow from its
/// particles.
pub fn cell_room(c: &Constants, count: usize) -> u32 {
    cell_rooms(c, count).iter().sum()
}

/// The leaves of the hierarchy over a world's particles, if it has one: a power of two.
pub fn leaves(c: &Constants, blocks: u32) -> u32 {
    if c.spec.search == Search::Bvh { (blocks * BLOCK / LEAF).next_power_of_two() } else { 0 }
}

/// The size classes of a world's particles.
pub fn classes(c: &Constants) -> Classes {
    Classes::of(c.radius_min, c.radius_max)
}

/// The cells of each grid: of size classes, or the boxes along the curve.
fn cell_rooms(c: &Constants, count: usize) -> Vec<u32> {
    if c.spec.search != Search::Grid {
        return vec![(1_u32 << Curve::bits(count)).next_multiple_of(BLOCK)];
    }
    let classes = classes(c);
    let room = |class| {
        let reach = c.touch() - 2.0 * (c.radius_max - classes.radius(class)) + SKIN_MIN * c.radius_mean;
        let cells: f64 = (0..3)
            .map(|k| (c.lattice.height[k] / reach).floor().max(1.0) * f64::from(c.lattice.windows[k]))
            .product();
        (cells.min(4.0 * count as f64 + 1024.0) as u32).next_multiple_of(BLOCK)
    };
    (0..classes.count()).map(room).collect()
}

fn split(x: f64) -> [u32; 2] {
    let h = x as f32;
    [h.to_bits(), ((x - f64::from(h)) as f32).to_bits()]
}

fn put(words: &mut [u32], at: u32, values: &[u32]) {
    words[at as usize..at as usize + values.len()].copy_from_slice(values);
}

/// The row of a world.
pub fn world_row(c: &Constants, r: &Region, series: u32) -> Vec<u32> {
    let mut w = vec![0; world::WORDS as usize];
    let l = &c.lattice;
    put(
        &mut w,
        0,
        &[
            r.first,
            c.spec.materials.len() as u32,
            r.pairs,
            r.boundaries,
            c.boundaries.len() as u32,
            r.cells,
            r.cell_room,
            r.begins[0],
            r.rooms.lists,
            r.begins[1],
            r.rooms.rows,
            r.begins[2],
            r.rooms.facets,
            r.blocks,
        ],
    );
    put(&mut w, world::WINDOWS, &l.windows);
    put(&mut w, world::PERIODIC, &l.periodic.map(u32::from));
    put(&mut w, world::EXTENT, &l.extent.map(|e| (e >> 32) as u32));
    put(&mut w, world::EXTENT + 3, &l.extent.map(|e| e as u32));
    let f = |x: f64| (x as f32).to_bits();
    let limit = if c.spec.guards.overlap_stops { c.spec.guards.overlap_limit } else { f64::INFINITY };
    let far = runaway_distance(c);
    put(&mut w, world::DT, &[f(c.dt)]);
    put(&mut w, world::GRAVITY, &c.spec.gravity.map(f));
    put(&mut w, world::DAMPING, &[f(c.spec.local_damping), f(far * far), f(limit)]);
    put(&mut w, world::UNIT, &cell_words(l, 0.0));
    put(&mut w, world::RANGE, &[f(c.range), f(c.radius_mean), f(c.radius_max)]);
    put(&mut w, world::SERIES, &[series, c.spec.surfaces.len() as u32, r.first / SLICE]);
    put(&mut w, world::WRAP, &c.fall().map(f));
    let mut first = 0;
    for (class, room) in (0..).zip(cell_rooms(c, r.count)) {
        first += room;
        put(&mut w, world::GRADES, &[class + 1]);
        put(&mut w, world::CLASSES + class + 1, &[first]);
    }
    // 16 axes a word, the first in the lowest bits.
    let axes = Curve::of(l).axes;
    let word = |axes: &[u8]| axes.iter().rev().fold(0, |word, axis| 4 * word + u32::from(*axis));
    put(&mut w, world::CURVE, &[word(&axes[..16]), word(&axes[16..]), r.nodes, leaves(c, r.blocks)]);
    w
}

/// The words of a cell.
fn cell_words(l: &Lattice, path: f64) -> [u32; world::CELL_WORDS as usize] {
    let mut w = [0; world::CELL_WORDS as usize];
    for k in 0..9 {
        let [h, low] = split(l.unit[k / 3][k % 3]);
        w[k] = h;
        w[9 + k] = low;
        w[(world::INVERSE - world::UNIT) as usize + k] = (l.inverse[k / 3][k % 3] as f32).to_bits();
    }
    put(&mut w, world::HEIGHT - world::UNIT, &l.height.map(|h| (h as f32).to_bits()));
    w[(world::PATH - world::UNIT) as usize] = path_word(path);
    w
}

/// Appends the cells of a world at `steps + 3` successive steps from that of `g` on, or the one that its lists are
/// made of, and points its row, which begins at word `at` of the table, there. A cell that stands still is in the row
/// itself.
pub fn deform(words: &mut Vec<u32>, at: usize, c: &Constants, g: &Progress, steps: u64, reference: bool) {
    let Some(mut cell) = g.cell else {
        words[at + world::CELL as usize] = at as u32;
        return;
    };
    words[at + world::CELL as usize] = words.len() as u32 - world::UNIT;
    words[at + world::CELL_STRIDE as usize] = world::CELL_WORDS;
    words[at + world::REFERENCE as usize] = path_word(cell.reference_path);
    let gradient = cell.gradient.as_flattened().iter().map(|x| (*x as f32).to_bits());
    words[at + world::GRADIENT as usize..][..9].iter_mut().zip(gradient).for_each(|(word, x)| *word = x);
    if reference {
        (cell.matrix, cell.path) = (cell.reference, cell.reference_path);
    }
    for _ in 0..steps + 3 {
        words.extend(cell_words(&c.lattice.deformed(&cell.matrix), cell.path));
        cell.step(c.dt);
    }
}

/// The coefficients of a world's pairs of materials, and which of the laws of a kernel they have.
pub fn pair_quads(c: &Constants) -> Vec<[f32; 4]> {
    let four = |x: [f64; 4]| x.map(|v| v as f32);
    let choices = Choices::of(c);
    c.pairs
        .iter()
        .flat_map(|p| {
            [
                four(p.normal),
                four(p.tangential),
                four(p.rolling),
                four(p.cohesion),
                four([p.friction[0], p.friction[1], p.remember, p.truncate]),
                four([p.clip, p.range, f64::from(choices.bits(p.laws)), 0.0]),
                four(p.bond),
                four(p.strength),
            ]
        })
        .collect()
}

/// Meshes of a group, one after the other.
#[derive(Default)]
pub struct Meshes {
    /// Vertices: leading parts, rests.
    pub vertices: Vec<[f32; 4]>,
    /// Vertex numbers.
    pub triangles: Vec<[u32; 4]>,
    /// Boxes of the hierarchies.
    pub nodes: Vec<[f32; 4]>,
    /// Triangles in the hierarchies' order.
    pub order: Vec<u32>,
    /// Rows of boundaries, without poses.
    pub rows: Vec<u32>,
}

impl Meshes {
    /// Adds the boundaries of a world.
    pub fn add(&mut self, c: &Constants) {
        for b in &c.boundaries {
            let mut row = [0_u32; boundary::WORDS as usize];
            row[boundary::MATERIAL as usize] = b.material as u32;
            row[boundary::SURFACE as usize] = b.surface.map_or(NONE, |s| s as u32);
            row[boundary::TRIANGLES as usize] = NONE;
            if let BoundaryShape::Frustum(frustum) = &b.shape {
                row[boundary::PARTS as usize] = frustum.parts();
                for (k, line) in (0..).zip(frustum.segments()) {
                    let numbers = line.from.into_iter().chain(line.along).chain([line.length]);
                    for (at, x) in (0..).zip(numbers) {
                        put(&mut row, boundary::LINES + k * boundary::LINE + 2 * at, &split(x));
                    }
                }
            }
            if let BoundaryShape::Mesh(mesh, bvh) = &b.shape {
                row[boundary::TRIANGLES as usize] = self.triangles.len() as u32;
                row[boundary::VERTICES as usize] = (self.vertices.len() / 2) as u32;
                row[boundary::NODES as usize] = (self.nodes.len() / 2) as u32;
                row[boundary::ORDER as usize] = self.order.len() as u32;
                let size = mesh.vertices.iter().flatten().fold(0.0_f64, |a, x| a.max(x.abs()));
                row[boundary::SIZE as usize] = (size as f32).to_bits();
                for x in &mesh.vertices {
                    let h = x.map(|v| v as f32);
                    let l = [0, 1, 2].map(|k| (x[k] - f64::from(h[k])) as f32);
                    self.vertices.push([h[0], h[1], h[2], 0.0]);
                    self.vertices.push([l[0], l[1], l[2], 0.0]);
                }
                self.triangles.extend(mesh.triangles.iter().map(|t| [t[0], t[1], t[2], 0]));
                for (min, max, link, count) in bvh.boxes() {
                    let lo = min.map(|x| x as f32);
                    let hi = max.map(|x| x as f32);
                    self.nodes.push([lo[0], lo[1], lo[2], f32::from_bits(link)]);
                    self.nodes.push([hi[0], hi[1], hi[2], f32::from_bits(count)]);
                }
                self.order.extend_from_slice(bvh.order());
            }
            self.rows.extend_from_slice(&row);
        }
    }
}

fn words(c: &Constants, b: usize, placed: &Placed, present: bool, path: u32) -> [u32; pose::WORDS as usize] {
    let mut w = [0; pose::WORDS as usize];
    let origin = c.lattice.encode_beside(placed.pose.translation);
    put(&mut w, pose::ORIGIN, &origin.hi.map(|h| h as u32));
    put(&mut w, pose::ORIGIN + 3, &origin.lo);
    put(&mut w, pose::ORIGIN + 6, &origin.rest.map(f32::to_bits));
    let columns =
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| rotate(placed.pose.rotation, e));
    for k in 0..9 {
        let [h, l] = split(columns[k % 3][k / 3]);
        w[pose::ROTATION as usize + k] = h;
        w[pose::ROTATION as usize + 9 + k] = l;
    }
    put(&mut w, pose::VELOCITY, &placed.velocity.map(|x| (x as f32).to_bits()));
    put(&mut w, pose::VELOCITY + 3, &placed.spin.map(|x| (x as f32).to_bits()));
    let normal = match &c.boundaries[b].shape {
        BoundaryShape::Plane(n) => Some(n),
        BoundaryShape::Frustum(frustum) => Some(&frustum.axis),
        BoundaryShape::Mesh(..) => None,
    };
    if let Some(n) = normal {
        let n = rotate(placed.pose.rotation, *n);
        for k in 0..3 {
            let [h, l] = split(n[k]);
            w[pose::NORMAL as usize + k] = h;
            w[pose::NORMAL as usize + 3 + k] = l;
        }
    }
    w[pose::PRESENT as usize] = u32::from(present);
    w[pose::PATH as usize] = path;
    w
}

/// Appends the poses of a world's boundaries at `steps + 1` successive steps from that of `g` on, or the reference poses
/// of its lists; completes its rows of the table of boundaries. Says whether images of particles can be told everywhere
/// that a mesh goes.
pub fn stand(
    poses: &mut Vec<u32>,
    c: &Constants,
    g: &Progress,
    steps: u64,
    reference: bool,
    rows: &mut [u32],
) -> bool {
    let mut fine = true;
    for (b, row) in rows.chunks_exact_mut(boundary::WORDS as usize).enumerate() {
        let bound = &c.boundaries[b];
        row[boundary::POSE as usize] = poses.len() as u32;
        row[boundary::STRIDE as usize] = 0;
        let mut range = [[0_i32; 2]; 3];
        if let Some(s) = bound.surface {
            let state = &g.surfaces[s];
            let moves = state.present && !reference && !c.motion(s, g.stage).is_fixed();
            if moves {
                row[boundary::STRIDE as usize] = pose::WORDS;
            }
            let mut path = 0_u32;
            let mut before = state.reference;
            let mut goes = |to: &Pose| {
                path = path.wrapping_add(path_word(strays(c, bound, &before, to) / c.radius_mean));
                before = *to;
                path
            };
            if moves {
                // Step by step, as it was when those steps were done, whatever jobs they belonged to.
                for step in g.rebuilt.max(g.stage_since)..g.step {
                    goes(&state.placed_at(c, s, g.stage, step).pose);
                }
            }
            for step in 0..=if moves { steps } else { 0 } {
                let mut placed = state.placed_at(c, s, g.stage, g.step + step);
                if reference {
                    placed.pose = state.reference;
                }
                let path = goes(&placed.pose);
                if let Some(span) = Span::new(c, &bound.shape, &placed.pose) {
                    for k in 0..3 {
                        let [low, high] = span.all_images(c, k, c.cutoff());
                        range[k] = [range[k][0].min(low), range[k][1].max(high)];
                    }
                }
                poses.extend_from_slice(&words(c, b, &placed, state.present, path));
            }
        } else {
            let placed = Placed { pose: bound.pose, ..Placed::default() };
            poses.extend_from_slice(&words(c, b, &placed, true, 0));
        }
        for k in 0..3 {
            for (end, at) in range[k].into_iter().zip([0, 3]) {
                fine &= (-IMAGE_ZERO..IMAGE_ZERO).contains(&end);
                row[boundary::IMAGES as usize + at + k] = (end + IMAGE_ZERO) as u32;
            }
        }
    }
    fine
}

/// A world's row of states.
pub fn status_row(g: &Progress, count: usize) -> Vec<u32> {
    let mut s = vec![0; status::WORDS as usize];
    s[status::SKIN as usize] = (g.skin as f32).to_bits();
    s[status::SINCE as usize] = (g.step - g.rebuilt).min(u64::from(u32::MAX / 2)) as u32;
    s[status::COUNT as usize] = count as u32;
    s[status::PRIMED as usize] = u32::from(g.primed);
    s[status::REBUILT as usize] = NONE;
    s
}

const _: () = assert!(world::CLASSES + (classes::MOST as u32) < world::WORDS);
const _: () = assert!(status::GRIDS + 3 * classes::MOST as u32 <= status::WORDS);
