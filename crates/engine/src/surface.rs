//! Rigid surfaces: where they stand, what they touch, and which touches are one physical contact.

use glebe_physics::kernel64::triangle::{closest_to_origin, foot_of_plane};
use glebe_physics::kernel64::vector::V3;

use crate::lattice::{add, cross, dot, norm, scale, sub};
use crate::setup::{BoundaryShape, Constants};
use crate::spec::{Motion, Pose, TriMesh, Vec3};

impl Pose {
    /// The pose of a body frame point in the world \[m\].
    pub fn apply(&self, x: Vec3) -> Vec3 {
        add(self.translation, rotate(self.rotation, x))
    }
    /// The body frame coordinates of a world point \[m\].
    pub fn inverse(&self, x: Vec3) -> Vec3 {
        rotate(reversed(self.rotation), sub(x, self.translation))
    }
}

/// `q x q*` for a unit quaternion (w, x, y, z).
pub fn rotate(q: [f64; 4], x: Vec3) -> Vec3 {
    let u = [q[1], q[2], q[3]];
    let t = scale(cross(u, x), 2.0);
    add(x, add(scale(t, q[0]), cross(u, t)))
}

/// The unit quaternion of the turn that takes `q` back.
pub fn reversed([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [w, -x, -y, -z]
}

/// The unit quaternion of a turn by `angle` \[rad\] about the unit vector `axis`.
pub fn quaternion(axis: Vec3, angle: f64) -> [f64; 4] {
    let (s, c) = (0.5 * angle).sin_cos();
    [c, s * axis[0], s * axis[1], s * axis[2]]
}

/// The turn `b`, then `a`.
pub fn compose(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// The pose and velocity of a driven surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placed {
    /// Where it stands.
    pub pose: Pose,
    /// Velocity of its frame's origin \[m/s\].
    pub velocity: Vec3,
    /// Angular velocity \[rad/s\].
    pub spin: Vec3,
}

impl Motion {
    /// Whether it moves at all.
    pub fn is_fixed(&self) -> bool {
        *self == Self::default()
    }

    /// Where a surface stands that stood at `base` when the motion began `t` seconds ago. A closed form of
    /// time: nothing accumulates, and a restart changes no bit.
    pub fn at(&self, base: &Pose, t: f64) -> Placed {
        let mut moved = scale(self.velocity, t);
        let mut velocity = self.velocity;
        if let Some(o) = self.oscillation {
            let rate = std::f64::consts::TAU * o.frequency;
            moved = add(moved, scale(o.amplitude, (rate * t + o.phase).sin() - o.phase.sin()));
            velocity = add(velocity, scale(o.amplitude, rate * (rate * t + o.phase).cos()));
        }
        let mut pose = *base;
        let mut spin = [0.0; 3];
        if let Some(r) = self.rotation {
            let q = quaternion(r.axis, r.rate * t);
            let arm = rotate(q, sub(base.translation, r.center));
            pose.rotation = compose(q, base.rotation);
            pose.translation = add(r.center, arm);
            spin = scale(r.axis, r.rate);
            velocity = add(velocity, cross(spin, arm));
        }
        if let Some(poses) = &self.poses {
            // Only one of both turns, so the order does not matter.
            let away = poses.at(t);
            moved = add(moved, away.pose.translation);
            velocity = add(velocity, away.velocity);
            pose.rotation = compose(away.pose.rotation, pose.rotation);
            spin = add(spin, away.spin);
        }
        pose.translation = add(pose.translation, moved);
        Placed { pose, velocity, spin }
    }

    /// The unit vectors of the axes about which it turns, with the rates \[rad/s\].
    pub fn turns(&self) -> impl Iterator<Item = (Vec3, f64)> {
        let steady = self.rotation.filter(|r| r.rate != 0.0).map(|r| (r.axis, r.rate));
        steady.into_iter().chain(self.poses.iter().flat_map(|poses| poses.turns()))
    }

    /// Whether its rotation and its table both turn, which is no sum.
    pub fn turns_twice(&self) -> bool {
        self.rotation.is_some() && self.poses.iter().any(|poses| poses.turns().next().is_some())
    }

    /// Where it leads on the whole: its velocity without oscillation, a table's from end to end \[m/s\].
    pub fn heading(&self) -> Vec3 {
        self.poses.iter().fold(self.velocity, |v, poses| add(v, poses.mean_velocity()))
    }
}

/// A bounding volume hierarchy over the triangles of a rigid mesh, in the mesh's own frame: a rigid mesh
/// never needs it rebuilt.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

#[derive(Clone, Debug)]
struct Node {
    min: Vec3,
    max: Vec3,
    /// Leaf: first triangle in `order`; else index of the second child (the first follows its parent).
    link: u32,
    /// Triangles of a leaf, 0 for an inner node.
    count: u32,
}

const LEAF: usize = 4;

impl Bvh {
    /// The hierarchy of a mesh.
    pub fn new(mesh: &TriMesh) -> Self {
        let corners = |t: &[u32; 3]| t.map(|v| mesh.vertices[v as usize]);
        let boxes: Vec<(Vec3, Vec3)> = mesh.triangles.iter().map(|t| bounds(&corners(t))).collect();
        let mut bvh = Self { nodes: Vec::new(), order: (0..mesh.triangles.len() as u32).collect() };
        let end = bvh.order.len();
        if end > 0 {
            bvh.split(&boxes, 0, end);
        }
        bvh
    }

    fn split(&mut self, boxes: &[(Vec3, Vec3)], begin: usize, end: usize) {
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &t in &self.order[begin..end] {
            let (a, b) = boxes[t as usize];
            for k in 0..3 {
                min[k] = min[k].min(a[k]);
                max[k] = max[k].max(b[k]);
            }
        }
        let node = self.nodes.len();
        let count = end - begin;
        self.nodes.push(Node { min, max, link: begin as u32, count: count as u32 });
        if count <= LEAF {
            return;
        }
        let size = sub(max, min);
        let axis = (0..3).fold(0, |a, k| if size[k] > size[a] { k } else { a });
        let middle = begin + count / 2;
        let center = |t: &u32| boxes[*t as usize].0[axis] + boxes[*t as usize].1[axis];
        self.order[begin..end]
            .select_nth_unstable_by(count / 2, |a, b| center(a).total_cmp(&center(b)).then(a.cmp(b)));
        self.split(boxes, begin, middle);
        self.nodes[node].link = self.nodes.len() as u32;
        self.nodes[node].count = 0;
        self.split(boxes, middle, end);
    }

    /// The corners of the box around the mesh.
    pub fn corners(&self) -> Option<[Vec3; 8]> {
        let root = self.nodes.first()?;
        Some(std::array::from_fn(|corner: usize| {
            std::array::from_fn(|k| if corner >> k & 1 == 0 { root.min[k] } else { root.max[k] })
        }))
    }

    /// The nodes: lowest and highest corner, then for a leaf its first place in [`Self::order`] and its number
    /// of triangles, for others the second child (the first follows its parent) and 0.
    pub fn boxes(&self) -> impl Iterator<Item = (Vec3, Vec3, u32, u32)> {
        self.nodes.iter().map(|n| (n.min, n.max, n.link, n.count))
    }

    /// The triangles in the order of the leaves.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Appends the triangles whose boxes come within `reach` of the body frame point `x`.
    pub fn near(&self, x: Vec3, reach: f64, found: &mut Vec<u32>) {
        let mut stack = [0_u32; 64];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let at = stack[depth] as usize;
            let node = &self.nodes[at];
            let gap = |k: usize| (node.min[k] - x[k]).max(x[k] - node.max[k]).max(0.0);
            if gap(0) * gap(0) + gap(1) * gap(1) + gap(2) * gap(2) > reach * reach {
                continue;
            }
            if node.count > 0 {
                let first = node.link as usize;
                found.extend_from_slice(&self.order[first..first + node.count as usize]);
            } else {
                // Halving keeps the depth below 32 levels for any mesh that u32 can count.
                stack[depth] = node.link;
                stack[depth + 1] = at as u32 + 1;
                depth += 2;
            }
        }
    }
}

impl Bvh {
    /// Whether the body frame point `x` is inside the closed `mesh` of this hierarchy: a ray from it leaves through
    /// an odd number of triangles (Jordan). The ray is askew to what is usual in meshes, so that it meets no edge.
    pub fn encloses(&self, mesh: &TriMesh, x: Vec3) -> bool {
        const RAY: Vec3 = [0.533_718_4, 0.285_771_9, 0.795_929_3];
        let mut inside = false;
        let mut stack: Vec<usize> = (0..self.nodes.len().min(1)).collect();
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at];
            let (mut from, mut to) = (0.0_f64, f64::INFINITY);
            for k in 0..3 {
                from = from.max((node.min[k] - x[k]) / RAY[k]);
                to = to.min((node.max[k] - x[k]) / RAY[k]);
            }
            if from > to {
                continue;
            }
            if node.count == 0 {
                stack.extend([at + 1, node.link as usize]);
            }
            let first = node.link as usize;
            for &t in self.order.iter().skip(first).take(node.count as usize) {
                let [a, b, c] = mesh.triangles[t as usize].map(|v| sub(mesh.vertices[v as usize], x));
                // The ray passes between the corners if the volumes that it spans with the sides agree in sign.
                let sides = [(a, b), (b, c), (c, a)].map(|(p, q)| dot(RAY, cross(p, q)));
                let ahead = dot(a, cross(b, c)) * sides.iter().sum::<f64>() > 0.0;
                let within = sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0);
                inside ^= ahead && within;
            }
        }
        inside
    }
}

impl TriMesh {
    /// Whether every edge joins two triangles.
    pub fn is_closed(&self) -> bool {
        let mut edges: Vec<[u32; 2]> = self
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        !edges.is_empty() && edges.chunk_by(|a, b| a == b).all(|same| same.len() == 2)
    }
}

fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    points.iter().fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(lo, hi), p| {
        ([0, 1, 2].map(|k| lo[k].min(p[k])), [0, 1, 2].map(|k| hi[k].max(p[k])))
    })
}

/// The box around a surface that is no plane as it stands, in periods of the cell along axes that wrap.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    min: Vec3,
    max: Vec3,
}

impl Span {
    /// The box around a shape in `pose`; `None` for a plane and for a mesh without triangles.
    pub fn new(c: &Constants, shape: &BoundaryShape, pose: &Pose) -> Option<Self> {
        let mut span = Self { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3] };
        for x in shape.corners()? {
            let at = c.lattice.periods(sub(pose.apply(x), c.lattice.origin));
            for k in 0..3 {
                span.min[k] = span.min[k].min(at[k]);
                span.max[k] = span.max[k].max(at[k]);
            }
        }
        Some(span)
    }

    /// Its length along an axis that wraps, in periods.
    pub fn periods(&self, axis: usize) -> f64 {
        self.max[axis] - self.min[axis]
    }

    /// The images of particles anywhere in the cell that come within `reach` \[m\] of the box along an axis, lowest
    /// and highest; none but 0 where it does not wrap.
    pub fn all_images(&self, c: &Constants, axis: usize, reach: f64) -> [i32; 2] {
        if !c.lattice.periodic[axis] {
            return [0; 2];
        }
        let reach = c.periods_high(axis, reach);
        [(self.min[axis] - reach).floor() as i32, (self.max[axis] + reach).floor() as i32]
    }

    /// The images of a particle at `x` that come within `reach` \[m\] of the box, in periods along each axis:
    /// however far the mesh has moved, and however many periods it is long.
    pub fn images(&self, c: &Constants, x: Vec3, reach: f64) -> impl Iterator<Item = [i32; 3]> + use<> {
        let at = c.lattice.periods(sub(x, c.lattice.origin));
        let [x, y, z] = [0, 1, 2].map(|k| {
            if !c.lattice.periodic[k] {
                return 0..=0;
            }
            let reach = c.periods_high(k, reach);
            (self.min[k] - reach - at[k]).ceil() as i32..=(self.max[k] + reach - at[k]).floor() as i32
        });
        x.flat_map(move |a| {
            let z = z.clone();
            y.clone().flat_map(move |b| z.clone().map(move |c| [a, b, c]))
        })
    }
}

/// A place where a sphere and a surface touch, relative to the sphere's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Unit vector from the sphere's centre into the surface.
    pub n: Vec3,
    /// Distance from the centre \[m\].
    pub distance: f64,
    /// Triangle, or part of a shell of revolution; 0 for a plane.
    pub triangle: u32,
    /// Image of the sphere that touches, in periods along each axis.
    pub shift: [i32; 3],
    /// 0 face, 1 edge, 2 vertex.
    rank: u8,
}

impl SurfacePoint {
    /// Where a sphere whose centre is `height` above a plane of unit normal `normal` touches it, or `None`
    /// beyond `reach`.
    #[inline]
    pub fn of_plane(normal: Vec3, height: f64, reach: f64) -> Option<Self> {
        let into = scale(normal, -height.signum());
        let at = Self { n: into, distance: height.abs(), triangle: 0, shift: [0; 3], rank: 0 };
        (height.abs() < reach).then_some(at)
    }
}

impl SurfacePoint {
    /// Where a sphere touches a part of a shell of revolution: unit vector into the surface and distance from the
    /// centre \[m\], 0 for a face and 1 for a rim.
    pub fn of_part(n: Vec3, distance: f64, part: u32, shift: [i32; 3], rank: u8) -> Self {
        Self { n, distance, triangle: part, shift, rank }
    }
}

/// The point of a triangle closest to a sphere's centre, or `None` beyond `reach`. Vertices are relative
/// to the centre of the sphere's image `shift`.
pub fn touch(vertices: [Vec3; 3], triangle: u32, shift: [i32; 3], reach: f64) -> Option<SurfacePoint> {
    let [a, b, c] = vertices.map(|v| V3 { x: v[0], y: v[1], z: v[2] });
    let closest = closest_to_origin(a, b, c);
    let p = if closest.feature == 0 { foot_of_plane(a, b, c) } else { closest.point };
    let point = [p.x, p.y, p.z];
    let distance = norm(point);
    if distance >= reach {
        return None;
    }
    let n = if distance > 0.0 {
        scale(point, 1.0 / distance)
    } else {
        // The centre lies on the surface: the face's normal is as good as its opposite.
        let m = cross(sub(vertices[1], vertices[0]), sub(vertices[2], vertices[0]));
        scale(m, 1.0 / norm(m))
    };
    let rank = [0, 1, 1, 1, 2, 2, 2][closest.feature as usize];
    Some(SurfacePoint { n, distance, triangle, shift, rank })
}

/// Reduces the touches of one sphere, in all its images, with one mesh to its physical contacts, in a fixed
/// order.
///
/// Face beats edge beats vertex; of equals the closer, then the lower triangle. A touch is dropped when it
/// lies on or below the plane through an accepted contact across its normal, raised by that contact's
/// overlap: there the surface is flat or convex and the touch belongs to the same contact. What remains are
/// the walls of concave corners. So a floor acts as one plane whatever its triangulation, and a convex
/// edge acts once.
pub fn physical_contacts(touches: &mut Vec<SurfacePoint>, radius: f64) {
    touches.sort_unstable_by(|a, b| {
        a.rank
            .cmp(&b.rank)
            .then(a.distance.total_cmp(&b.distance))
            .then((a.triangle, a.shift).cmp(&(b.triangle, b.shift)))
    });
    let mut kept = 0;
    for t in 0..touches.len() {
        let q = touches[t];
        let shadowed = touches[..kept].iter().any(|p| {
            // Height of q above the plane at p, towards the centre.
            let height = p.distance - q.distance * dot(q.n, p.n);
            height <= (radius - p.distance).max(1e-6 * radius)
        });
        if !shadowed {
            touches[kept] = q;
            kept += 1;
        }
    }
    touches.truncate(kept);
}
