//! STL, as its inventor defined it (3D Systems, StereoLithography Interface Specification, 1988):
//! loose triangles, as text or as 50 bytes each.

use std::{fmt::Write as _, fs, path::Path};

use glebe_engine::spec::{TriMesh, Vec3};

use super::{
    Corners,
    error::{MeshError, Place},
};

/// Header and count of a binary file \[bytes\].
const HEADER: usize = 84;
/// One triangle of a binary file: normal, three vertices, attribute \[bytes\].
const RECORD: usize = 50;

/// The two kinds of STL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StlFormat {
    /// Text; coordinates keep all digits.
    Ascii,
    /// 50 bytes a triangle; coordinates are rounded to `f32`.
    Binary,
}

/// Reads either kind. The first word does not decide: binary files may begin with "solid" too.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Corners>, MeshError> {
    if bytes.is_empty() {
        return Err(MeshError::NoTriangles { path: path.into(), degenerate: 0 });
    }
    let claimed = bytes.get(80..HEADER).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let expected = claimed.map(|n| HEADER as u64 + u64::from(n) * RECORD as u64);
    if expected == Some(bytes.len() as u64) {
        return parse_binary(path, &bytes[HEADER..]);
    }
    // Text has no NUL; a binary file has one in its count or its first attribute at the latest.
    let start = &bytes[..bytes.len().min(1024)];
    let text = start.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(start).trim_ascii_start();
    let begins = |word: &str| text.get(..word.len()).is_some_and(|t| t.eq_ignore_ascii_case(word.as_bytes()));
    if !start.contains(&0) && (begins("solid") || begins("facet")) {
        return parse_ascii(path, bytes);
    }
    match (claimed, expected) {
        (Some(claimed), Some(expected)) => {
            Err(MeshError::Length { path: path.into(), claimed, expected, found: bytes.len() as u64 })
        }
        _ => Err(MeshError::CutShort {
            path: path.into(),
            place: Place::Byte(bytes.len()),
            what: format!("within the {HEADER} bytes that a binary STL begins with"),
        }),
    }
}

/// `records` holds whole records only.
fn parse_binary(path: &Path, records: &[u8]) -> Result<Vec<Corners>, MeshError> {
    let mut soup = Vec::with_capacity(records.len() / RECORD);
    for (number, record) in records.chunks_exact(RECORD).enumerate() {
        let mut corners = [[0.0; 3]; 3];
        // Vertices follow the normal (12 bytes), which exporters get wrong and nobody needs.
        for (slot, b) in corners.as_flattened_mut().iter_mut().zip(record[12..48].chunks_exact(4)) {
            let value = f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            if !value.is_finite() {
                let place = Place::Facet(number + 1, HEADER + number * RECORD);
                return Err(MeshError::NotFinite { path: path.into(), place, value });
            }
            *slot = value;
        }
        soup.push(corners);
    }
    Ok(soup)
}

fn parse_ascii(path: &Path, bytes: &[u8]) -> Result<Vec<Corners>, MeshError> {
    let mut soup = Vec::new();
    let mut state = State::Outside;
    let last = super::last_line(bytes);
    for (index, raw) in bytes.split(|b| *b == b'\n').enumerate() {
        let line = index + 1;
        let text = String::from_utf8_lossy(raw);
        let text = text.trim_start_matches('\u{FEFF}').trim();
        if text.is_empty() {
            continue;
        }
        let ended = matches!(state, State::Ended);
        state = match state.next(text) {
            Ok(Step::To(state)) => state,
            Ok(Step::Facet(corners)) => {
                soup.push(corners);
                State::Outside
            }
            Err(Fault::NotFinite(value)) => {
                return Err(MeshError::NotFinite { path: path.into(), place: Place::Line(line), value });
            }
            // A last line that breaks off is no mistake of whoever wrote it.
            Err(Fault::Syntax(expected)) if line == last && !ended => {
                return Err(cut_short(path, line, expected));
            }
            Err(Fault::Syntax(expected)) => {
                let found = text.chars().take(60).collect();
                return Err(MeshError::Syntax { path: path.into(), line, expected, found });
            }
        };
    }
    match state {
        State::Ended => Ok(soup),
        State::Outside => Err(cut_short(path, last, "`facet` or `endsolid`")),
        State::Facet => Err(cut_short(path, last, "`outer loop`")),
        State::Loop(_, 3) => Err(cut_short(path, last, "`endloop`")),
        State::Loop(..) => Err(cut_short(path, last, "`vertex x y z`")),
        State::LoopEnded(_) => Err(cut_short(path, last, "`endfacet`")),
    }
}

fn cut_short(path: &Path, line: usize, expected: &str) -> MeshError {
    let what = format!("where {expected} should follow or be completed");
    MeshError::CutShort { path: path.into(), place: Place::Line(line), what }
}

/// Where in the grammar a text file stands.
enum State {
    /// In a solid (its first line may be missing), between facets.
    Outside,
    /// After `facet normal …`.
    Facet,
    /// In a loop with so many vertices read.
    Loop(Corners, usize),
    /// After `endloop`.
    LoopEnded(Corners),
    /// After `endsolid`; another solid may follow.
    Ended,
}

enum Step {
    To(State),
    Facet(Corners),
}

enum Fault {
    Syntax(&'static str),
    NotFinite(f64),
}

impl State {
    /// The state after the line `text`. Keywords are matched in any case.
    fn next(self, text: &str) -> Result<Step, Fault> {
        let mut words = text.split_ascii_whitespace();
        let word = words.next().unwrap_or_default().to_ascii_lowercase();
        match (self, word.as_str()) {
            (Self::Outside | Self::Ended, "solid") => Ok(Step::To(Self::Outside)),
            (Self::Outside, "endsolid") => Ok(Step::To(Self::Ended)),
            (Self::Outside, "facet") => Ok(Step::To(Self::Facet)),
            (Self::Outside, _) => Err(Fault::Syntax("`facet normal …` or `endsolid`")),
            (Self::Facet, "outer") => Ok(Step::To(Self::Loop([[0.0; 3]; 3], 0))),
            (Self::Facet, _) => Err(Fault::Syntax("`outer loop`")),
            (Self::Loop(mut corners, n @ 0..3), "vertex") => {
                corners[n] = vertex(words)?;
                Ok(Step::To(Self::Loop(corners, n + 1)))
            }
            (Self::Loop(corners, 3), "endloop") => Ok(Step::To(Self::LoopEnded(corners))),
            (Self::Loop(_, 3), _) => Err(Fault::Syntax("`endloop` after three vertices")),
            (Self::Loop(..), _) => Err(Fault::Syntax("`vertex x y z`")),
            (Self::LoopEnded(corners), "endfacet") => Ok(Step::Facet(corners)),
            (Self::LoopEnded(_), _) => Err(Fault::Syntax("`endfacet`")),
            (Self::Ended, _) => Err(Fault::Syntax("`solid` or nothing after `endsolid`")),
        }
    }
}

fn vertex<'a>(words: impl Iterator<Item = &'a str>) -> Result<Vec3, Fault> {
    const EXPECTED: Fault = Fault::Syntax("`vertex` and three numbers");
    let mut point = [0.0; 3];
    let mut count = 0;
    for word in words {
        let value: f64 = word.parse().map_err(|_| EXPECTED)?;
        *point.get_mut(count).ok_or(EXPECTED)? = value;
        count += 1;
    }
    if count < 3 {
        return Err(EXPECTED);
    }
    match point.iter().find(|v| !v.is_finite()) {
        Some(value) => Err(Fault::NotFinite(*value)),
        None => Ok(point),
    }
}

/// Writes `mesh` as an STL solid called `name` (binary: its first 70 bytes or so).
///
/// # Errors
/// The file cannot be written; a triangle names a vertex that does not exist, or a coordinate is not
/// finite in the format.
pub fn write_stl(path: &Path, mesh: &TriMesh, name: &str, format: StlFormat) -> Result<(), MeshError> {
    let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut soup = Vec::with_capacity(mesh.triangles.len());
    for (triangle, indices) in mesh.triangles.iter().enumerate() {
        let fault = |what| MeshError::Unwritable { path: path.into(), triangle, what };
        let mut corners = [[0.0; 3]; 3];
        for (corner, index) in corners.iter_mut().zip(indices) {
            *corner = *mesh
                .vertices
                .get(*index as usize)
                .ok_or_else(|| fault("names a vertex that is not there"))?;
        }
        let limit = if format == StlFormat::Binary { f64::from(f32::MAX) } else { f64::MAX };
        if !corners.as_flattened().iter().all(|c| c.abs() <= limit) {
            return Err(fault("has a coordinate that is not a finite number of the format"));
        }
        soup.push(corners);
    }
    let bytes = match format {
        StlFormat::Ascii => to_ascii(&soup, &name).into_bytes(),
        StlFormat::Binary => to_binary(&soup, &name),
    };
    fs::write(path, bytes).map_err(|source| MeshError::Write { path: path.into(), source })
}

fn to_ascii(soup: &[Corners], name: &str) -> String {
    let mut text = format!("solid {name}\n");
    for corners in soup {
        let [x, y, z] = normal(corners);
        // Writing to a String cannot fail.
        let _ = writeln!(text, "facet normal {x:e} {y:e} {z:e}\n  outer loop");
        for [x, y, z] in corners {
            let _ = writeln!(text, "    vertex {x:e} {y:e} {z:e}");
        }
        text.push_str("  endloop\nendfacet\n");
    }
    let _ = writeln!(text, "endsolid {name}");
    text
}

fn to_binary(soup: &[Corners], name: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER + soup.len() * RECORD);
    // Never beginning with "solid", which simple readers take for text.
    bytes.extend_from_slice(format!("glebe STL {name}").as_bytes());
    bytes.resize(80, 0);
    bytes.extend_from_slice(&(soup.len() as u32).to_le_bytes());
    for corners in soup {
        for value in normal(corners).iter().chain(corners.as_flattened()) {
            bytes.extend_from_slice(&(*value as f32).to_le_bytes());
        }
        bytes.extend_from_slice(&[0, 0]);
    }
    bytes
}

/// Unit normal, 0 where there is none.
fn normal(corners: &Corners) -> Vec3 {
    let n = super::assemble::area_vector(corners);
    let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
    if length > 0.0 { n.map(|c| c / length) } else { [0.0; 3] }
}
