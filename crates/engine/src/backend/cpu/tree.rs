//! A hierarchy of bounding volumes over particles that stand along a curve: the same as devices build, see the search of
//! their lists, but exact.

use crate::lattice::{Lattice, UNITS};
use crate::state::Particles;

/// Particles of a leaf.
const LEAF: usize = 8;

/// The box around centres \[units\], and the largest radius \[m\]; 0 where there is no particle.
#[derive(Clone, Copy)]
struct Node {
    low: [i64; 3],
    high: [i64; 3],
    radius: f64,
}

impl Node {
    const EMPTY: Self = Self { low: [i64::MAX; 3], high: [i64::MIN; 3], radius: 0.0 };

    fn and(self, other: Self) -> Self {
        Self {
            low: [0, 1, 2].map(|k| self.low[k].min(other.low[k])),
            high: [0, 1, 2].map(|k| self.high[k].max(other.high[k])),
            radius: self.radius.max(other.radius),
        }
    }
}

/// A binary heap: the root is node 1, and leaf `k` is node `leaves + k`.
pub struct Tree {
    nodes: Vec<Node>,
    leaves: usize,
}

impl Tree {
    /// Over the reference places of particles.
    pub fn new(p: &Particles) -> Self {
        let leaves = p.len().div_ceil(LEAF).next_power_of_two();
        let mut nodes = vec![Node::EMPTY; 2 * leaves];
        for i in 0..p.len() {
            let at = [0, 1, 2].map(|k| Lattice::units(p.hi_ref[i][k], p.lo_ref[i][k]));
            let leaf = &mut nodes[leaves + i / LEAF];
            *leaf = leaf.and(Node { low: at, high: at, radius: f64::from(p.place[i].radius) });
        }
        for node in (1..leaves).rev() {
            nodes[node] = nodes[2 * node].and(nodes[2 * node + 1]);
        }
        Self { nodes, leaves }
    }

    /// The particles after `i`, in their order, of leaves that are within `reach` \[m\] and their own radius of it.
    pub fn near(&self, lattice: &Lattice, p: &Particles, i: usize, reach: f64, mut found: impl FnMut(usize)) {
        let at = [0, 1, 2].map(|k| Lattice::units(p.hi_ref[i][k], p.lo_ref[i][k]));
        let mut node = 1_usize;
        while node > 0 {
            // The last leaf below.
            let depth = self.leaves.ilog2() - node.ilog2();
            let last = ((node + 1) << depth) - 1 - self.leaves;
            let past = node + 1;
            let beside = past >> past.trailing_zeros();
            let mut next = if beside == 1 { 0 } else { beside };
            if (last + 1) * LEAF > i + 1 && self.nodes[node].within(lattice, at, reach) {
                if depth > 0 {
                    next = 2 * node;
                } else {
                    ((last * LEAF).max(i + 1)..((last + 1) * LEAF).min(p.len())).for_each(&mut found);
                }
            }
            node = next;
        }
    }
}

impl Node {
    /// Whether a place may be as near to a particle of the box as the particle's radius and `reach` \[m\].
    fn within(&self, lattice: &Lattice, at: [i64; 3], reach: f64) -> bool {
        if self.radius == 0.0 {
            return false;
        }
        let away = [0, 1, 2].map(|k| {
            let from = |x: i64| (self.low[k] - x).max(x - self.high[k]).max(0);
            let span = i64::from(lattice.windows[k]) << 32;
            let near = if lattice.periodic[k] {
                from(at[k]).min(from(at[k] + span)).min(from(at[k] - span))
            } else {
                from(at[k])
            };
            // Planes through both places across the axis are that far from each other.
            near as f64 / UNITS * lattice.height[k]
        });
        let reach = (reach + self.radius) * (1.0 + 1e-9);
        if lattice.orthogonal {
            away.iter().map(|x| x * x).sum::<f64>() <= reach * reach
        } else {
            away.iter().all(|x| *x <= reach)
        }
    }
}
