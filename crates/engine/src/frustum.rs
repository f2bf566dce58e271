//! Cylinders and cones as they are, without facets.
//!
//! A surface of revolution meets a sphere in the plane through its axis and the sphere's centre. There the shell is a
//! line from (ρ₀, h₀) to (ρ₁, h₁), with the distance ρ from the axis and the place h along it, and
//!
//! `d = ((ρ - ρ₀)(h₁ - h₀) - (h - h₀)(ρ₁ - ρ₀)) / √((ρ₁ - ρ₀)² + (h₁ - h₀)²)`
//!
//! is the height of the centre (ρ, h) above it, positive outside; beyond its ends the rim is closest. The far side of
//! the shell, which a sphere touches too that is wider than the shell, is the same line seen from (-ρ, h). A disc that
//! closes an end is a line from the axis to the rim.
//!
//! As with any surface R* is the sphere's radius R: the curvature of the shell does not enter the force. Relative
//! curvatures of 1/R along the axis and 1/R ± 1/r around it (Hertz; + outside, - inside) would change the force at a
//! given overlap by about (1 ± R/r)^(-1/4) - 1: 2.5 % for r = 10 R.

use std::f64::consts::TAU;

use crate::lattice::{add, cross, dot, norm, scale, sub};
use crate::spec::{Frustum, Pose, TriMesh, Vec3};
use crate::surface::SurfacePoint;

/// Flat pieces around of the mesh that frames show.
const SECTORS: usize = 72;
/// Most rings of it along the axis.
const RINGS: f64 = 72.0;

/// A line in the plane of ρ and h.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Where it begins: ρ, h \[m\].
    pub from: [f64; 2],
    /// Unit vector along it.
    pub along: [f64; 2],
    /// Its length \[m\].
    pub length: f64,
}

impl Frustum {
    /// What is wrong with it, if anything.
    pub fn fault(&self) -> Option<&'static str> {
        let numbers = self.axis.iter().chain(&self.ends).chain(&self.radii);
        if numbers.into_iter().any(|x| !x.is_finite()) {
            Some("a number that is not finite")
        } else if (norm(self.axis) - 1.0).abs() > 1e-9 {
            Some("an axis that is no unit vector")
        } else if self.ends[0] >= self.ends[1] {
            Some("no length")
        } else if self.radii.iter().any(|r| *r <= 0.0) {
            Some("a radius that is not above 0")
        } else {
            None
        }
    }

    /// What a sphere may touch: the near and the far side of the shell, and the discs at its ends.
    pub fn parts(&self) -> u32 {
        if self.closed { 4 } else { 2 }
    }

    /// The lines of the shell and of the discs at its ends.
    pub fn segments(&self) -> [Segment; 3] {
        let [from, to] = [0, 1].map(|k| [self.radii[k], self.ends[k]]);
        let (dr, dh) = (to[0] - from[0], to[1] - from[1]);
        let length = dr.hypot(dh);
        let shell = Segment { from, along: [dr / length, dh / length], length };
        let disc = |k: usize| Segment { from: [0.0, self.ends[k]], along: [1.0, 0.0], length: self.radii[k] };
        [shell, disc(0), disc(1)]
    }

    /// Where a sphere touches one of the parts, or `None` beyond `reach`. `x` is the centre of the sphere's image
    /// `shift` from the frame's origin and `axis` the axis, both in the world.
    pub fn touch(&self, axis: Vec3, x: Vec3, part: u32, shift: [i32; 3], reach: f64) -> Option<SurfacePoint> {
        let line = self.segments()[(part as usize).saturating_sub(1)];
        let h = dot(x, axis);
        let away = sub(x, scale(axis, h));
        let rho = norm(away);
        let side = if part == 1 { -1.0 } else { 1.0 };
        let outwards = scale(if rho > 0.0 { scale(away, 1.0 / rho) } else { across(axis) }, side);
        let [dr, dh] = [side * rho - line.from[0], h - line.from[1]];
        let [tr, th] = line.along;
        let at = dr * tr + dh * th;
        let (n, distance, rank) = if (0.0..=line.length).contains(&at) {
            let height = dr * th - dh * tr;
            let sign = if height > 0.0 { -1.0 } else { 1.0 };
            ([sign * th, -sign * tr], height.abs(), 0)
        } else {
            let end = if at > 0.0 { line.length } else { 0.0 };
            let [r, a] = [tr * end - dr, th * end - dh];
            let distance = r.hypot(a);
            ([r / distance, a / distance], distance, 1)
        };
        let n = add(scale(outwards, n[0]), scale(axis, n[1]));
        (distance < reach).then(|| SurfacePoint::of_part(n, distance, part, shift, rank))
    }

    /// Whether it is closed and the body frame point `x` is inside.
    pub fn encloses(&self, x: Vec3) -> bool {
        let h = dot(x, self.axis);
        let share = (h - self.ends[0]) / (self.ends[1] - self.ends[0]);
        let radius = self.radii[0] + share * (self.radii[1] - self.radii[0]);
        self.closed && (0.0..=1.0).contains(&share) && norm(sub(x, scale(self.axis, h))) <= radius
    }

    /// The middles of both ends in the body frame, with the radii there \[m\].
    pub fn rims(&self) -> [(Vec3, f64); 2] {
        [0, 1].map(|k| (scale(self.axis, self.ends[k]), self.radii[k]))
    }

    /// The corners of a box around it.
    pub fn corners(&self) -> [Vec3; 8] {
        let u = across(self.axis);
        let v = cross(self.axis, u);
        let r = self.radii[0].max(self.radii[1]);
        std::array::from_fn(|corner| {
            let signed = |bit: usize| if corner >> bit & 1 == 0 { -r } else { r };
            add(scale(self.axis, self.ends[corner >> 2]), add(scale(u, signed(0)), scale(v, signed(1))))
        })
    }

    /// How far any point of it is at most from the place of it in another pose \[m\]. Turning about its axis moves its
    /// points, but not the surface.
    pub fn strays(&self, from: &Pose, to: &Pose) -> f64 {
        let [a, b] = [from, to].map(|pose| crate::surface::rotate(pose.rotation, self.axis));
        let tilt = norm(sub(a, b));
        let far =
            |(middle, radius): (Vec3, f64)| norm(sub(to.apply(middle), from.apply(middle))) + radius * tilt;
        self.rims().into_iter().map(far).fold(0.0, f64::max)
    }

    fn rings(&self) -> usize {
        let piece = TAU * self.radii[0].max(self.radii[1]) / SECTORS as f64;
        (self.segments()[0].length / piece).round().clamp(1.0, RINGS) as usize
    }

    /// A mesh of it in the body frame, for pictures.
    pub fn mesh(&self) -> TriMesh {
        let (u, rings) = (across(self.axis), self.rings());
        let v = cross(self.axis, u);
        let mut mesh = TriMesh::default();
        for ring in 0..=rings {
            let share = ring as f64 / rings as f64;
            let [h, r] = [self.ends, self.radii].map(|[a, b]| a + share * (b - a));
            for sector in 0..SECTORS {
                let (s, c) = (TAU * sector as f64 / SECTORS as f64).sin_cos();
                mesh.vertices.push(add(scale(self.axis, h), add(scale(u, r * c), scale(v, r * s))));
            }
        }
        let at = |ring: usize, sector: usize| (ring * SECTORS + sector % SECTORS) as u32;
        for (ring, sector) in (0..rings).flat_map(|ring| (0..SECTORS).map(move |sector| (ring, sector))) {
            let [a, b, c, d] =
                [at(ring, sector), at(ring, sector + 1), at(ring + 1, sector + 1), at(ring + 1, sector)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
        if self.closed {
            for (ring, end) in [(0, self.ends[0]), (rings, self.ends[1])] {
                let middle = mesh.vertices.len() as u32;
                mesh.vertices.push(scale(self.axis, end));
                mesh.triangles.extend((0..SECTORS).map(|sector| {
                    let [a, b] = [at(ring, sector), at(ring, sector + 1)];
                    if ring == 0 { [middle, b, a] } else { [middle, a, b] }
                }));
            }
        }
        mesh
    }

    /// The number of triangles of [`Frustum::mesh`].
    pub fn triangles(&self) -> usize {
        2 * SECTORS * self.rings() + if self.closed { 2 * SECTORS } else { 0 }
    }

    /// The triangle of [`Frustum::mesh`] that shows the contact of a part at the body frame point `x`.
    pub fn shown(&self, x: Vec3, part: u32) -> u32 {
        let u = across(self.axis);
        let (rings, v) = (self.rings(), cross(self.axis, u));
        let around = dot(x, v).atan2(dot(x, u)).rem_euclid(TAU) / TAU;
        let sector = ((around * SECTORS as f64) as usize).min(SECTORS - 1);
        let place = if part < 2 {
            let along = (dot(x, self.axis) - self.ends[0]) / (self.ends[1] - self.ends[0]);
            let along = along.clamp(0.0, 1.0) * rings as f64;
            let ring = (along as usize).min(rings - 1);
            // Cells are cut from the corner of both beginnings.
            let across = around * SECTORS as f64 - sector as f64;
            2 * (ring * SECTORS + sector) + usize::from(along - ring as f64 > across)
        } else {
            2 * SECTORS * rings + SECTORS * (part as usize - 2) + sector
        };
        place as u32
    }
}

/// A unit vector across a unit vector, the same for the same.
fn across(axis: Vec3) -> Vec3 {
    let least = (0..3).fold(0, |a, k| if axis[k].abs() < axis[a].abs() { k } else { a });
    let mut other = [0.0; 3];
    other[least] = 1.0;
    let across = cross(axis, other);
    scale(across, 1.0 / norm(across))
}
