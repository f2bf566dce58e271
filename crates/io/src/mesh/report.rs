//! What was found in a mesh.

use std::fmt;

use glebe_engine::spec::Vec3;

/// What was found in a mesh, after its [`Transform`](super::Transform).
///
/// Displayed in one to three lines: size; whether it is closed; what was changed or looks odd.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct MeshReport {
    /// Triangles kept.
    pub triangles: usize,
    /// Vertices that they use.
    pub vertices: usize,
    /// Least coordinates \[m\].
    pub min: Vec3,
    /// Greatest coordinates \[m\].
    pub max: Vec3,
    /// Parts: triangles connected over edges that exactly two of them share.
    pub parts: usize,
    /// Edges of only one triangle.
    pub open_edges: usize,
    /// Edges of three triangles or more.
    pub non_manifold_edges: usize,
    /// Triangles wound against most of the part they belong to.
    pub flipped: usize,
    /// Triangles left out because they have no usable area.
    pub degenerate: usize,
    /// Triangles left out because they repeat another (same vertices, either winding).
    pub duplicates: usize,
    /// Vertices joined with one that was not equal but within the tolerance.
    pub welded: usize,
    /// Enclosed volume \[m³\] if every edge joins two triangles of the same winding; negative if the
    /// normals point inwards.
    pub volume: Option<f64>,
}

impl MeshReport {
    /// Lengths of the bounding box's sides \[m\].
    pub fn size(&self) -> Vec3 {
        [0, 1, 2].map(|k| self.max[k] - self.min[k])
    }

    /// Whether no edge is open or shared by more than two triangles.
    pub fn is_closed(&self) -> bool {
        self.open_edges == 0 && self.non_manifold_edges == 0
    }
}

impl fmt::Display for MeshReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.size();
        let longest = size.into_iter().fold(0.0, f64::max);
        let (unit, per_metre) = if longest < 10.0 { ("mm", 1e3) } else { ("m", 1.0) };
        // What rounding left of a zero is not worth its digits.
        let length = |c: f64| if c.abs() < 1e-7 * longest { short(0.0) } else { short(c * per_metre) };
        let triple = |v: Vec3, separator: &str| v.map(length).join(separator);
        write!(
            f,
            "{}, {}, {}; {} {unit}, from ({}) to ({}) {unit}",
            plural(self.triangles, "triangle", "triangles"),
            plural(self.vertices, "vertex", "vertices"),
            plural(self.parts, "part", "parts"),
            triple(size, " × "),
            triple(self.min, ", "),
            triple(self.max, ", "),
        )?;

        if let Some(v) = self.volume {
            let (unit, value) = if v.abs() < 0.1 { ("cm³", v.abs() * 1e6) } else { ("m³", v.abs()) };
            write!(f, "\nclosed, volume {} {unit}", short(value))?;
            if v < 0.0 {
                f.write_str(", normals point inwards")?;
            }
        } else {
            let shape = if self.is_closed() { "closed" } else { "not closed" };
            let faults = list(&[
                (self.open_edges, "open edge", "open edges"),
                (
                    self.non_manifold_edges,
                    "edge of three or more triangles",
                    "edges of three or more triangles",
                ),
                (self.flipped, "flipped triangle", "flipped triangles"),
            ]);
            write!(f, "\n{shape}: {faults}")?;
        }

        let removed = list(&[
            (self.degenerate, "degenerate triangle left out", "degenerate triangles left out"),
            (self.duplicates, "repeated triangle left out", "repeated triangles left out"),
            (self.welded, "near vertex joined", "near vertices joined"),
        ]);
        let mut notes = Vec::from_iter((!removed.is_empty()).then_some(removed));
        if longest > 20.0 {
            notes.push("larger than 20 m: if it was drawn in millimetres, set unit = \"mm\"".into());
        }
        if !notes.is_empty() {
            write!(f, "\n{}", notes.join("; "))?;
        }
        Ok(())
    }
}

/// The counts that are not zero.
fn list(counts: &[(usize, &str, &str)]) -> String {
    let found = counts.iter().filter(|(n, ..)| *n > 0).map(|(n, one, many)| plural(*n, one, many));
    found.collect::<Vec<_>>().join(", ")
}

fn plural(n: usize, one: &str, many: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { many })
}

/// Four significant digits at least, without trailing zeros.
fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 12) };
    let text = format!("{value:.*}", digits as usize);
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.into() }
}
