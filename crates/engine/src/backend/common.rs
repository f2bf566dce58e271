//! What every backend says and accounts in the same way.

use crate::cell::too_narrow;
use crate::failure::Failure;
use crate::lattice::{Lattice, dot, norm, sub};
use crate::setup::{Boundary, BoundaryShape, Constants};
use crate::spec::{Pose, Vec3};
use crate::state::{Lost, Particles, Progress};
use crate::surface::{Placed, SurfacePoint, reversed, rotate, touch};

/// A boundary as it stands in a step.
#[derive(Debug, Default)]
pub struct Standing {
    /// Whether it is there.
    pub present: bool,
    /// Pose and velocity.
    pub placed: Placed,
    /// Vertices in the world \[m\]; empty but for meshes.
    pub vertices: Vec<Vec3>,
    /// Unit normal of a plane, or axis of a shell of revolution, in the world.
    pub normal: Vec3,
}

impl Standing {
    /// Places `boundary` as it stands at the step of `g`.
    pub fn place(&mut self, boundary: &Boundary, c: &Constants, g: &Progress) {
        let (present, placed) = match boundary.surface {
            Some(s) => (g.surfaces[s].present, g.surfaces[s].placed(c, s, g)),
            None => (true, Placed { pose: boundary.pose, ..Placed::default() }),
        };
        let moved = self.placed.pose != placed.pose || !self.present;
        self.present = present;
        self.placed = placed;
        if !present || !moved {
            return;
        }
        match &boundary.shape {
            BoundaryShape::Plane(n) => self.normal = rotate(placed.pose.rotation, *n),
            BoundaryShape::Frustum(frustum) => self.normal = rotate(placed.pose.rotation, frustum.axis),
            BoundaryShape::Mesh(mesh, _) => {
                self.vertices.clear();
                self.vertices.extend(mesh.vertices.iter().map(|x| placed.pose.apply(*x)));
            }
        }
    }

    /// Appends where a sphere around `center` comes within `reach` \[m\] of the plane, or of one of the
    /// `facets`: triangles of a mesh or parts of a shell, each with the image of the sphere that is meant.
    #[inline]
    pub fn touches(
        &self,
        c: &Constants,
        boundary: &Boundary,
        center: Vec3,
        reach: f64,
        facets: impl Iterator<Item = (u32, [i32; 3])>,
        found: &mut Vec<SurfacePoint>,
    ) {
        match &boundary.shape {
            BoundaryShape::Plane(_) => {
                let height = dot(self.normal, sub(center, self.placed.pose.translation));
                found.extend(SurfacePoint::of_plane(self.normal, height, reach));
            }
            BoundaryShape::Frustum(frustum) => {
                found.extend(facets.filter_map(|(part, shift)| {
                    let x = sub(c.shifted(center, shift), self.placed.pose.translation);
                    frustum.touch(self.normal, x, part, shift, reach)
                }));
            }
            BoundaryShape::Mesh(mesh, _) => {
                found.extend(facets.filter_map(|(triangle, shift)| {
                    let x = c.shifted(center, shift);
                    let vertices =
                        mesh.triangles[triangle as usize].map(|v| sub(self.vertices[v as usize], x));
                    touch(vertices, triangle, shift, reach)
                }));
            }
        }
    }
}

/// The triangle that shows a contact of a facet, at `arm` from the frame's origin \[m\].
pub fn shown(boundary: &Boundary, standing: &Standing, arm: Vec3, facet: u32) -> u32 {
    let BoundaryShape::Frustum(frustum) = &boundary.shape else { return facet };
    frustum.shown(rotate(reversed(standing.placed.pose.rotation), arm), facet)
}

/// A particle as messages and accounts see it.
#[derive(Clone, Copy, Debug)]
pub struct Portrait {
    /// Persistent number.
    pub id: u32,
    /// Mass \[kg\].
    pub mass: f64,
    /// Radius \[m\].
    pub radius: f64,
    /// Centre \[m\].
    pub x: Vec3,
    /// Velocity \[m/s\].
    pub v: Vec3,
    /// Angular velocity \[rad/s\].
    pub w: Vec3,
}

impl Portrait {
    /// Of particle `i` in the order of storage.
    pub fn of(lattice: &Lattice, p: &Particles, i: usize) -> Self {
        let (place, v, w) = (p.place[i], p.velocity[i], p.spin[i]);
        Self {
            id: p.id[i],
            mass: 1.0 / f64::from(v.inv_mass),
            radius: f64::from(place.radius),
            x: lattice.decode(p.hi[i], place.lo, p.rest[i]),
            v: v.v.map(f64::from),
            w: w.w.map(f64::from),
        }
    }

    /// Energy of translation, rotation and gravity \[J\].
    pub fn energy(&self, c: &Constants) -> [f64; 3] {
        let x = sub(self.x, c.lattice.origin);
        [
            0.5 * self.mass * dot(self.v, self.v),
            0.2 * self.mass * self.radius * self.radius * dot(self.w, self.w),
            -self.mass * dot(c.spec.gravity, x),
        ]
    }

    /// In words: number, place, speed, what it touches.
    pub fn describe(&self, mut touching: Vec<String>) -> String {
        touching.truncate(8);
        let [x, y, z] = self.x;
        format!(
            "particle {} at ({x:.6}, {y:.6}, {z:.6}) m, speed {:.3e} m/s, touching {},",
            self.id,
            norm(self.v),
            if touching.is_empty() { "nothing".to_owned() } else { touching.join(", ") }
        )
    }

    /// Counts the particle as one that left through `side`.
    pub fn leave(&self, c: &Constants, side: [usize; 2], g: &mut Progress) {
        g.lost.push(Lost { id: self.id, time: g.step as f64 * c.dt, position: self.x, side });
        g.ledger.removed += self.energy(c).iter().sum::<f64>();
    }
}

/// Accounts for the energy of the normal and the tangential springs that vanish with particles \[J\].
pub fn unload(g: &mut Progress, [normal, tangential]: [f64; 2]) {
    g.ledger.removed += normal + tangential;
    g.ledger.elastic_tangential -= tangential;
}

/// The axis and side through which a place is outside the domain, if it is.
pub fn outside(l: &Lattice, hi: [i32; 3], lo: [u32; 3]) -> Option<[usize; 2]> {
    (0..3).filter(|&k| !l.periodic[k]).find_map(|k| {
        let u = Lattice::units(hi[k], lo[k]);
        (!(0..=l.extent[k]).contains(&u)).then_some([k, usize::from(u > 0)])
    })
}

/// Lists the particles outside the domain, in the order of their numbers; returns which ones stay.
pub fn leavers(c: &Constants, p: &Particles, g: &mut Progress) -> Vec<bool> {
    let sides: Vec<_> = (0..p.len()).map(|i| outside(&c.lattice, p.hi[i], p.place[i].lo)).collect();
    let mut left: Vec<_> =
        (0..p.len()).filter_map(|i| Some((Portrait::of(&c.lattice, p, i), sides[i]?))).collect();
    left.sort_unstable_by_key(|(p, _)| p.id);
    for (portrait, side) in left {
        portrait.leave(c, side, g);
    }
    sides.iter().map(Option::is_none).collect()
}

/// How far a boundary moves at most from one pose to another \[m\]: a rigid body strays most at a corner of its box; a
/// plane at a corner of the domain, to which its part of the world is confined.
pub fn strays(c: &Constants, boundary: &Boundary, from: &Pose, to: &Pose) -> f64 {
    let corners = match &boundary.shape {
        BoundaryShape::Frustum(frustum) => return frustum.strays(from, to),
        BoundaryShape::Mesh(_, bvh) => bvh.corners(),
        BoundaryShape::Plane(_) => Some(c.spec.domain.corners().map(|x| from.inverse(x))),
    };
    let moved = |x: &Vec3| norm(sub(to.apply(*x), from.apply(*x)));
    corners.iter().flatten().map(moved).fold(0.0, f64::max)
}

/// A name in messages.
pub fn quoted(c: &Constants, boundary: usize) -> String {
    format!("`{}`", c.boundaries[boundary].name)
}

/// The failure of a world whose cell has become too narrow for its lists, if it has.
pub fn narrow_failure(c: &Constants, g: &Progress, lattice: &Lattice) -> Result<(), Failure> {
    let Some((axis, height)) = too_narrow(lattice, c.cutoff()) else { return Ok(()) };
    let what = format!(
        "the cell has become {height:.4e} m high across its {} vectors for each of {} windows, less than two cut-off \
         distances of {:.4e} m",
        ["second and third", "third and first", "first and second"][axis],
        lattice.windows[axis],
        c.cutoff()
    );
    Err(failure(
        c,
        g,
        what,
        "it was compressed or sheared too far for its number of particles; take more particles, or less strain",
    ))
}

/// Whether the overlap `worst`, a fraction of the smaller radius, stops the world. It is remembered.
pub fn too_deep(c: &Constants, g: &mut Progress, worst: f64) -> bool {
    g.worst_overlap = g.worst_overlap.max(worst);
    c.spec.guards.overlap_stops && worst > c.spec.guards.overlap_limit
}

/// The failure of a world where `body` and `other` overlap too much.
pub fn overlap_failure(c: &Constants, g: &Progress, body: &str, other: &str, worst: f64) -> Failure {
    let what = format!(
        "{body} overlaps {other} by {:.0} % of the smaller radius, more than the limit of {:.0} %",
        100.0 * worst,
        100.0 * c.spec.guards.overlap_limit
    );
    failure(
        c,
        g,
        what,
        "the bodies meet too fast for their stiffness, the step is too large, or they started inside each other; \
         raise youngs_modulus, lower the step, or set time.overlap_limit = \"warn\" if soft particles are meant",
    )
}

/// The failure of a world where `body` ran away with velocity `v`.
pub fn runaway_failure(c: &Constants, g: &Progress, body: &str, v: Vec3) -> Failure {
    let (what, cause) = if v.iter().all(|x| x.is_finite()) {
        let far = runaway_distance(c);
        (
            format!(
                "moves more than {far:.3e} m in one step, with which the smallest particle could pass through a surface"
            ),
            "the step is too large for the stiffness or the speeds of this world; take a smaller time.step or \"auto\"",
        )
    } else {
        (
            "has a velocity that is not a number".to_owned(),
            "a force or a moment was larger than can be computed with, 3e38 in SI units: the step is too large for the \
             stiffness or the speeds of this world, or a size, density, stiffness or speed is in another unit; take a \
             smaller time.step or \"auto\", and look at the units",
        )
    };
    failure(c, g, format!("{body} {what}"), cause)
}

/// The failure of a world now.
pub fn failure(c: &Constants, g: &Progress, what: String, cause: &str) -> Failure {
    Failure { time: g.step as f64 * c.dt, step: g.step, what, cause: cause.to_owned() }
}

/// The displacement in one step that is too much \[m\]: with it the smallest sphere could pass through a thin surface,
/// from touching on one side to an allowed overlap on the other, even if the surface comes towards it.
pub fn runaway_distance(c: &Constants) -> f64 {
    let surfaces = if c.moves() { crate::speed::MOST } else { 0.0 };
    (2.0 - c.spec.guards.overlap_limit.min(1.0) - surfaces) * c.radius_min
}
