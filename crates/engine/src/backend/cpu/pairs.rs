//! Contacts of pairs: candidates are measured, those within reach are dealt into lanes, evaluated, and added to
//! what the block sums for either particle.
//!
//! Every loop over many is either one that vectorises or one without a branch that data decide: candidates
//! that touch and candidates that do not stand in no order that a processor could guess.

use super::contacts::{Found, PairSeen, Phase, Purpose};
use super::lanes::{LANES, Lane3, Lanes, whole};
use super::list::{Block, Quad, Share};
use crate::lattice::{dot, mul};
use crate::setup::MEMORY;
use crate::spec::Vec3;
use crate::state::{Spin, Velocity};

/// Quads that hold what a contact remembers, at most.
const QUADS: usize = MEMORY.div_ceil(4);

/// Working memory of a thread: what a block's candidates are measured by, and the records of a group of contacts.
pub struct Workbench {
    /// By candidate: from the first particle to the second in units, and the bits of the second's radius.
    apart: Vec<[u32; 4]>,
    /// By candidate: radius of the first \[m\].
    radius: Vec<f32>,
    /// By candidate: whether the two are within reach.
    close: Vec<bool>,
    /// Candidates within reach.
    near: Vec<u32>,
    /// By lane, as by candidate.
    dealt: [[u32; 4]; LANES],
    velocity: [[Velocity; LANES]; 2],
    spin: [[Spin; LANES]; 2],
    history: [[Quad; LANES]; QUADS],
    force: [Quad; LANES],
    torque: [[Quad; LANES]; 2],
}

impl Default for Workbench {
    fn default() -> Self {
        Self {
            apart: Vec::new(),
            radius: Vec::new(),
            close: Vec::new(),
            near: Vec::new(),
            dealt: [[0; 4]; LANES],
            velocity: [[Velocity::default(); LANES]; 2],
            spin: [[Spin::default(); LANES]; 2],
            history: [[[0.0; 4]; LANES]; QUADS],
            force: [[0.0; 4]; LANES],
            torque: [[[0.0; 4]; LANES]; 2],
        }
    }
}

/// Units in metres, for cells with and without right angles.
#[inline(always)]
pub fn metres<const ORTHOGONAL: bool>(unit: &[Vec3; 3], apart: [u32; 4]) -> Vec3 {
    let d = [apart[0], apart[1], apart[2]].map(|u| f64::from(u as i32));
    if ORTHOGONAL {
        [d[0] * unit[0][0], d[1] * unit[1][1], d[2] * unit[2][2]]
    } else {
        [0, 1, 2].map(|k| unit[k][0] * d[0] + unit[k][1] * d[1] + unit[k][2] * d[2])
    }
}

/// The pairs of a block.
#[inline(always)]
pub fn pairs(
    ph: &Phase<'_>,
    block: &mut Block,
    sums: &mut [Share],
    drains: &mut [Share],
    found: &mut Found,
    lanes: &mut Lanes,
    bench: &mut Workbench,
) {
    if ph.space.lattice.orthogonal {
        all::<true>(ph, block, sums, drains, found, lanes, bench);
    } else {
        all::<false>(ph, block, sums, drains, found, lanes, bench);
    }
}

#[inline(always)]
fn all<const ORTHOGONAL: bool>(
    ph: &Phase<'_>,
    block: &mut Block,
    sums: &mut [Share],
    drains: &mut [Share],
    found: &mut Found,
    lanes: &mut Lanes,
    bench: &mut Workbench,
) {
    measure::<ORTHOGONAL>(ph, block, bench);
    let count = sift(ph, block, bench);
    let near = std::mem::take(&mut bench.near);
    let mut rest = &near[..count];
    while !rest.is_empty() {
        let (pair, same) = alike(ph, block, rest);
        let group;
        (group, rest) = rest.split_at(same);
        deal::<ORTHOGONAL>(ph, block, lanes, bench, group);
        lanes.evaluate(group.len(), ph.c.layout, &ph.pairs[pair], [ph.dt, ph.lag()], ph.accounts());
        collect::<ORTHOGONAL>(ph, block, [&mut *sums, &mut *drains], found, lanes, bench, group);
    }
    bench.near = near;
}

/// Differences of places, and which candidates are within reach.
#[inline(always)]
fn measure<const ORTHOGONAL: bool>(ph: &Phase<'_>, block: &Block, bench: &mut Workbench) {
    let n = block.candidates.len();
    if bench.apart.len() < n {
        bench.apart.resize(n, [0; 4]);
        bench.radius.resize(n, 0.0);
        bench.close.resize(n, false);
        bench.near.resize(n, 0);
    }
    let apart = &mut bench.apart[..n];
    let radius = &mut bench.radius[..n];
    let place = &ph.p.place[..];
    let own = &place[block.first..];
    for ((apart, radius), q) in apart.iter_mut().zip(&mut *radius).zip(&block.candidates) {
        let (pi, pj) = (&own[q.owner as usize], &place[q.partner as usize]);
        let a = [pi.lo[0], pi.lo[1], pi.lo[2], pi.radius.to_bits()];
        let b = [pj.lo[0], pj.lo[1], pj.lo[2], pj.radius.to_bits()];
        let d = [0, 1, 2, 3].map(|x| b[x].wrapping_sub(a[x]));
        *apart = [d[0], d[1], d[2], b[3]];
        *radius = f32::from_bits(a[3]);
    }
    let range = ph.c.range;
    let unit = &ph.space.lattice.unit;
    for ((close, apart), radius) in bench.close[..n].iter_mut().zip(&*apart).zip(&*radius) {
        let d = metres::<ORTHOGONAL>(unit, *apart);
        let reach = f64::from(*radius) + f64::from(f32::from_bits(apart[3])) + range;
        *close = reach * reach > d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    }
}

/// Lists the candidates within reach, last first, and returns how many they are; in a step, contacts begin and end here.
/// Last first, a particle sums the contacts that it is the first of before those that it is the second of.
#[inline(always)]
fn sift(ph: &Phase<'_>, block: &mut Block, bench: &mut Workbench) -> usize {
    let n = block.candidates.len();
    let close = &bench.close[..n];
    // They seldom differ, which is seen many at once.
    if ph.purpose == Purpose::Step && *close != block.touching[..] {
        for (k, (touching, close)) in block.touching.iter_mut().zip(close).enumerate() {
            if *touching && !*close {
                // The next contact of this pair is born without memory.
                block.history[k * ph.quads..(k + 1) * ph.quads].fill([0.0; 4]);
            }
            *touching = *close;
        }
    }
    let near = &mut bench.near[..n];
    let mut count = 0;
    for (k, close) in close.iter().enumerate().rev() {
        near[count] = k as u32;
        count += usize::from(*close);
    }
    count
}

/// The materials of the first of some candidates, and how many after each other have the same, at most as many
/// as there are lanes.
#[inline(always)]
fn alike(ph: &Phase<'_>, block: &Block, near: &[u32]) -> (usize, usize) {
    let most = near.len().min(LANES);
    let materials = ph.c.spec.materials.len();
    if materials == 1 {
        return (0, most);
    }
    let pair = |k: u32| {
        let q = block.candidates[k as usize];
        let (i, j) = (block.first + q.owner as usize, q.partner as usize);
        ph.p.spin[i].material as usize * materials + ph.p.spin[j].material as usize
    };
    let first = pair(near[0]);
    (first, near[..most].iter().position(|&k| pair(k) != first).unwrap_or(most))
}

/// Puts a group of contacts into the lanes.
#[inline(always)]
fn deal<const ORTHOGONAL: bool>(
    ph: &Phase<'_>,
    block: &Block,
    lanes: &mut Lanes,
    bench: &mut Workbench,
    group: &[u32],
) {
    let used = group.len().min(LANES);
    let group = &group[..used];
    // Columns of one length are checked once for an index.
    let candidates = &block.candidates[..];
    let (between, radius) = (&bench.apart[..candidates.len()], &bench.radius[..candidates.len()]);
    let velocity = &ph.p.velocity[..];
    let spin = &ph.p.spin[..velocity.len()];
    let (history, quads) = (&block.history[..], ph.quads);
    for l in 0..used {
        let k = group[l] as usize;
        let (i, j) = (block.first + candidates[k].owner as usize, candidates[k].partner as usize);
        bench.velocity[0][l] = velocity[i];
        bench.spin[0][l] = spin[i];
        bench.velocity[1][l] = velocity[j];
        bench.spin[1][l] = spin[j];
        bench.dealt[l] = between[k];
        lanes.radius[0][l] = radius[k];
        // Most laws remember no more than one quad, and some nothing.
        if let Some(quad) = history.get(k * quads) {
            bench.history[0][l] = *quad;
        }
    }
    let full = whole(used);
    for q in 1..quads.min(QUADS) {
        for l in 0..used {
            bench.history[q][l] = history[group[l] as usize * quads + q];
        }
    }
    for q in 0..quads.min(QUADS) {
        for l in 0..full {
            for x in 0..4 {
                lanes.history[4 * q + x][l] = bench.history[q][l][x];
            }
        }
    }
    for s in 0..2 {
        for l in 0..full {
            let (v, w) = (&bench.velocity[s][l], &bench.spin[s][l]);
            for x in 0..3 {
                lanes.v[s][x][l] = v.v[x];
                lanes.w[s][x][l] = w.w[x];
            }
            lanes.inv_mass[s][l] = v.inv_mass;
        }
    }
    let (unit, apart) = (&ph.space.lattice.unit, &bench.dealt);
    for l in 0..full {
        lanes.radius[1][l] = f32::from_bits(apart[l][3]);
    }
    lanes.between_spheres(used, |l| metres::<ORTHOGONAL>(unit, apart[l]));
    if let Some(gradient) = &ph.space.gradient {
        // The image moves with the cell.
        for l in 0..used {
            let flow = mul(gradient, metres::<ORTHOGONAL>(unit, apart[l]));
            for x in 0..3 {
                lanes.v[1][x][l] += flow[x] as f32;
            }
        }
    }
}

/// Adds what a group of contacts has found.
#[inline(always)]
fn collect<const ORTHOGONAL: bool>(
    ph: &Phase<'_>,
    block: &mut Block,
    [sums, drains]: [&mut [Share]; 2],
    found: &mut Found,
    lanes: &mut Lanes,
    bench: &mut Workbench,
    group: &[u32],
) {
    let used = group.len().min(LANES);
    let group = &group[..used];
    found.contacts[0] += used as u64;
    if let Some(l) = lanes.worse_overlap(used, found.worst.0) {
        let q = block.candidates[group[l] as usize];
        found.worst = (lanes.ratio[l], block.first as u32 + q.owner, q.partner);
    }
    if ph.accounts() {
        found.sum_energies(lanes, used);
    }
    if ph.breaks() {
        found.broken += lanes.broke[..used].iter().filter(|x| **x > 0.0).count() as u64;
    }
    let unit = &ph.space.lattice.unit;
    let force = |l: usize| [lanes.force[0][l], lanes.force[1][l], lanes.force[2][l]];
    if ph.purpose == Purpose::Observe {
        let pairs = group.iter().map(|&k| (block.candidates[k as usize], bench.apart[k as usize]));
        found.pairs.extend(pairs.enumerate().take(LANES).map(|(l, (q, apart))| PairSeen {
            of: [block.first as u32 + q.owner, q.partner],
            branch: metres::<ORTHOGONAL>(unit, apart),
            force: force(l),
            stiffness: lanes.stiffness[l],
            energy: [lanes.energy_normal[l], lanes.energy_before[l]],
        }));
        return;
    }
    if let Some(gradient) = &ph.space.gradient {
        for (l, &k) in group.iter().enumerate().take(LANES) {
            let flow = mul(gradient, metres::<ORTHOGONAL>(unit, bench.apart[k as usize]));
            found.work += f64::from(ph.dt) * dot(force(l).map(f64::from), flow);
        }
    }
    add(block, sums, bench, group, &lanes.force, &lanes.torque);
    if ph.ledger {
        add(block, drains, bench, group, &lanes.dash, &lanes.drain);
    }
    if ph.purpose != Purpose::Step {
        return;
    }
    for q in 0..ph.quads.min(QUADS) {
        for l in 0..whole(used) {
            for x in 0..4 {
                bench.history[q][l][x] = lanes.history[4 * q + x][l];
            }
        }
        for l in 0..used {
            block.history[group[l] as usize * ph.quads + q] = bench.history[q][l];
        }
    }
}

/// Adds forces and torques of a group of contacts to what both particles of each sum.
#[inline(always)]
fn add(
    block: &Block,
    sums: &mut [Share],
    bench: &mut Workbench,
    group: &[u32],
    force: &Lane3,
    torque: &[Lane3; 2],
) {
    for l in 0..whole(group.len()) {
        bench.force[l] = [force[0][l], force[1][l], force[2][l], 0.0];
        for s in 0..2 {
            bench.torque[s][l] = [torque[s][0][l], torque[s][1][l], torque[s][2][l], 0.0];
        }
    }
    for l in 0..group.len().min(LANES) {
        let q = block.candidates[group[l] as usize];
        let f = bench.force[l];
        let own = &mut sums[q.owner as usize];
        for x in 0..4 {
            own.force[x] += f[x];
            own.torque[x] += bench.torque[0][l][x];
        }
        let other = &mut sums[q.slot as usize];
        for x in 0..4 {
            other.force[x] -= f[x];
            other.torque[x] += bench.torque[1][l][x];
        }
    }
}
