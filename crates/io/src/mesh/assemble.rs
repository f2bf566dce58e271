//! From loose triangles to an indexed mesh: weld, drop, and look at what is left.

use std::collections::{HashMap, HashSet};

use glebe_engine::spec::{TriMesh, Vec3};

use super::{Corners, report::MeshReport};

/// Vertices closer than this fraction of the longest side of the bounding box are one.
const WELD: f64 = 1e-7;
/// A triangle whose height is below this fraction of its longest edge is degenerate: its normal would
/// be made of `f32` rounding (6e-8 per coordinate).
const SLIVER: f64 = 1e-6;

/// Makes the mesh of `soup` (finite coordinates) and the report on it. Vertices stand in the order of
/// their first use, so the result does not depend on the format that the triangles came from.
pub(crate) fn assemble(soup: &[Corners]) -> (TriMesh, MeshReport) {
    let mut report = MeshReport::default();
    let mut welder = Welder::new(soup);
    let mut seen = HashSet::new();
    let mut triangles = Vec::with_capacity(soup.len());
    for corners in soup {
        let indices = corners.map(|p| welder.index(p));
        if is_degenerate(&indices.map(|i| welder.vertices[i as usize])) {
            report.degenerate += 1;
            continue;
        }
        let mut key = indices;
        key.sort_unstable();
        if seen.insert(key) {
            triangles.push(indices);
        } else {
            report.duplicates += 1;
        }
    }
    report.welded = welder.welded;
    let mesh = compact(&welder.vertices, triangles);
    inspect(&mesh, &mut report);
    (mesh, report)
}

/// Finds equal and almost equal points.
struct Welder {
    vertices: Vec<Vec3>,
    exact: HashMap<[u64; 3], u32>,
    cells: HashMap<[i64; 3], Vec<u32>>,
    origin: Vec3,
    tolerance: f64,
    /// Distinct points that became one with another.
    welded: usize,
}

impl Welder {
    fn new(soup: &[Corners]) -> Self {
        let (min, max) = bounds(soup.as_flattened());
        let longest = (0..3).map(|k| max[k] - min[k]).fold(0.0, f64::max);
        Self {
            vertices: Vec::new(),
            exact: HashMap::new(),
            cells: HashMap::new(),
            origin: min,
            // Positive even if all points coincide, for the division below.
            tolerance: (WELD * longest).max(f64::MIN_POSITIVE),
            welded: 0,
        }
    }

    /// The vertex for `point`: the first one seen at it or within the tolerance of it.
    fn index(&mut self, point: Vec3) -> u32 {
        // Adding 0 turns -0 into 0.
        let bits = point.map(|c| (c + 0.0).to_bits());
        if let Some(&index) = self.exact.get(&bits) {
            return index;
        }
        let index = if let Some(near) = self.near(point) {
            self.welded += 1;
            near
        } else {
            let index = self.vertices.len() as u32;
            self.vertices.push(point);
            self.cells.entry([0, 1, 2].map(|k| self.cell(point[k], k))).or_default().push(index);
            index
        };
        self.exact.insert(bits, index);
        index
    }

    fn near(&self, point: Vec3) -> Option<u32> {
        let range = |k: usize| -> std::ops::RangeInclusive<i64> {
            self.cell(point[k] - self.tolerance, k)..=self.cell(point[k] + self.tolerance, k)
        };
        for x in range(0) {
            for y in range(1) {
                for z in range(2) {
                    let near = self.cells.get(&[x, y, z]).into_iter().flatten().find(|index| {
                        let d = subtract(self.vertices[**index as usize], point);
                        dot(d, d) <= self.tolerance * self.tolerance
                    });
                    if near.is_some() {
                        return near.copied();
                    }
                }
            }
        }
        None
    }

    /// Cells are 4 tolerances wide, so that most searches look into one only.
    fn cell(&self, coordinate: f64, axis: usize) -> i64 {
        ((coordinate - self.origin[axis]) / (4.0 * self.tolerance)).floor() as i64
    }
}

fn is_degenerate(corners: &Corners) -> bool {
    let longest =
        (0..3).map(|k| subtract(corners[(k + 1) % 3], corners[k])).map(|e| dot(e, e)).fold(0.0, f64::max);
    let area = area_vector(corners);
    // height = 2 A / longest
    dot(area, area).sqrt() * 2.0 <= SLIVER * longest
}

/// Drops vertices that no triangle uses and numbers the others in the order of use.
fn compact(vertices: &[Vec3], mut triangles: Vec<[u32; 3]>) -> TriMesh {
    let mut number = vec![u32::MAX; vertices.len()];
    let mut used = Vec::new();
    for index in triangles.as_flattened_mut() {
        let slot = &mut number[*index as usize];
        if *slot == u32::MAX {
            *slot = used.len() as u32;
            used.push(vertices[*index as usize]);
        }
        *index = *slot;
    }
    TriMesh { vertices: used, triangles }
}

/// A side of a triangle; sorting brings the sides of one edge together.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    low: u32,
    high: u32,
    triangle: u32,
    /// Whether the triangle runs along it from low to high.
    rising: bool,
}

/// Counts what `mesh` has and lacks.
fn inspect(mesh: &TriMesh, report: &mut MeshReport) {
    report.triangles = mesh.triangles.len();
    report.vertices = mesh.vertices.len();
    (report.min, report.max) = bounds(&mesh.vertices);

    let mut sides = Vec::with_capacity(mesh.triangles.len() * 3);
    for (triangle, t) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            sides.push(Side { low: a.min(b), high: a.max(b), triangle: triangle as u32, rising: a < b });
        }
    }
    sides.sort_unstable();

    let mut pairs = Vec::new();
    for edge in sides.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
        match edge {
            [_] => report.open_edges += 1,
            [a, b] => pairs.push((a.triangle, b.triangle, a.rising == b.rising)),
            _ => report.non_manifold_edges += 1,
        }
    }
    let (parts, flipped) = winding(mesh.triangles.len(), &pairs);
    (report.parts, report.flipped) = (parts, flipped);
    if report.open_edges == 0 && report.non_manifold_edges == 0 && flipped == 0 {
        report.volume = Some(volume(mesh));
    }
}

/// Number of parts connected by `pairs` (triangle, triangle, whether their windings disagree), and of
/// triangles against the winding of most in their part.
///
/// In a one-sided surface (a Möbius band) no choice is free of disagreement; some triangles are then
/// reported, whichever they are.
fn winding(triangles: usize, pairs: &[(u32, u32, bool)]) -> (usize, usize) {
    let mut neighbours = vec![[None; 3]; triangles];
    for &(a, b, disagree) in pairs {
        for (from, to) in [(a, b), (b, a)] {
            if let Some(slot) = neighbours[from as usize].iter_mut().find(|s| s.is_none()) {
                *slot = Some((to, disagree));
            }
        }
    }
    let (mut parts, mut flipped) = (0, 0);
    let mut side: Vec<Option<bool>> = vec![None; triangles];
    let mut one_sided = 0;
    let mut queue = Vec::new();
    for start in 0..triangles {
        if side[start].is_some() {
            continue;
        }
        parts += 1;
        side[start] = Some(false);
        queue.push((start, false));
        let mut count = [0, 0];
        while let Some((triangle, own)) = queue.pop() {
            count[usize::from(own)] += 1;
            for &(next, disagree) in neighbours[triangle].iter().flatten() {
                let wanted = own != disagree;
                match side[next as usize] {
                    None => {
                        side[next as usize] = Some(wanted);
                        queue.push((next as usize, wanted));
                    }
                    Some(other) if other != wanted => one_sided += 1,
                    Some(_) => {}
                }
            }
        }
        flipped += count[0].min(count[1]);
    }
    // A disagreement that no flipping removes is seen from both of its triangles.
    (parts, flipped.max(one_sided / 2))
}

/// Volume enclosed by a closed mesh \[m³\], negative if its normals point inwards: tetrahedra from a
/// point of the mesh (not the far-away origin, which would cost digits).
fn volume(mesh: &TriMesh) -> f64 {
    let Some(&apex) = mesh.vertices.first() else { return 0.0 };
    let six: f64 = mesh
        .triangles
        .iter()
        .map(|t| t.map(|i| subtract(mesh.vertices[i as usize], apex)))
        .map(|[a, b, c]| dot(a, cross(b, c)))
        .sum();
    six / 6.0
}

/// Least and greatest coordinates; zeros if there are no points.
fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    let Some(&first) = points.first() else { return Default::default() };
    points.iter().fold((first, first), |(min, max), p| {
        ([0, 1, 2].map(|k: usize| min[k].min(p[k])), [0, 1, 2].map(|k: usize| max[k].max(p[k])))
    })
}

/// Normal of a triangle times its area.
pub(super) fn area_vector(corners: &Corners) -> Vec3 {
    cross(subtract(corners[1], corners[0]), subtract(corners[2], corners[0])).map(|c| 0.5 * c)
}

fn subtract(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
