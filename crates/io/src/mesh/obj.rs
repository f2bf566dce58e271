//! OBJ: vertices by number and faces of any length. Only the geometry of `v` and `f` lines is read.

use std::{borrow::Cow, path::Path};

use glebe_engine::spec::Vec3;

use super::{
    Corners,
    error::{MeshError, Place},
    polygon,
};

/// Reads all faces, cut into triangles. Positive indices may point forward in the file.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Corners>, MeshError> {
    let mut vertices: Vec<Vec3> = Vec::new();
    let mut faces = Vec::new();
    let last = super::last_line(bytes);
    for (line, text) in logical_lines(bytes) {
        let text = text.split('#').next().unwrap_or_default();
        let mut words = text.split_ascii_whitespace();
        let syntax = |expected: &'static str| {
            if line == last {
                let what = format!("where {expected} should stand");
                return MeshError::CutShort { path: path.into(), place: Place::Line(line), what };
            }
            let found = text.trim().chars().take(60).collect();
            MeshError::Syntax { path: path.into(), line, expected, found }
        };
        match words.next() {
            // A fourth number is a weight, six are a position and a colour; neither moves the point.
            Some("v") => {
                let mut point: Vec3 = [0.0; 3];
                for slot in &mut point {
                    *slot = words
                        .next()
                        .and_then(|w| w.parse().ok())
                        .ok_or_else(|| syntax("`v` and three numbers"))?;
                }
                if let Some(&value) = point.iter().find(|v| !v.is_finite()) {
                    return Err(MeshError::NotFinite { path: path.into(), place: Place::Line(line), value });
                }
                vertices.push(point);
            }
            Some("f") => {
                let mut corners = Vec::with_capacity(4);
                for word in words {
                    // v, v/vt, v//vn or v/vt/vn.
                    let index: i64 = word
                        .split('/')
                        .next()
                        .and_then(|w| w.parse().ok())
                        .ok_or_else(|| syntax("`f` and vertex numbers (v, v/vt, v//vn or v/vt/vn)"))?;
                    corners.push(resolve(index, vertices.len()).ok_or_else(|| MeshError::FaceIndex {
                        path: path.into(),
                        line,
                        index,
                        vertices: vertices.len(),
                    })?);
                }
                if corners.len() < 3 {
                    return Err(syntax("a face of at least three vertices"));
                }
                faces.push((line, corners));
            }
            // Normals, texture, groups, materials, lines, points: nothing that particles meet.
            _ => {}
        }
    }
    let mut soup = Vec::new();
    for (line, corners) in faces {
        let at = |index: usize| {
            vertices.get(index).copied().ok_or_else(|| MeshError::FaceIndex {
                path: path.into(),
                line,
                index: index as i64 + 1,
                vertices: vertices.len(),
            })
        };
        let corners = corners.into_iter().map(at).collect::<Result<Vec<_>, _>>()?;
        if !polygon::triangulate(&corners, &mut soup) {
            let (path, place) = (path.into(), Place::Line(line));
            return Err(MeshError::Polygon { path, place, corners: corners.len() });
        }
    }
    Ok(soup)
}

/// Index from 0 of the vertex that a file calls `index` when it has given `count` so far.
fn resolve(index: i64, count: usize) -> Option<usize> {
    match index {
        0 => None,
        1.. => usize::try_from(index - 1).ok(),
        _ => count.checked_sub(usize::try_from(index.unsigned_abs()).ok()?),
    }
}

/// Lines with the number of their last physical line, joined where one ends in a backslash.
fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = bytes.split(|b| *b == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (mut number, raw) = lines.next()?;
        let mut text = String::from_utf8_lossy(raw);
        while let Some(start) = text.trim_end().strip_suffix('\\') {
            let mut joined = format!("{start} ");
            let Some((next, raw)) = lines.next() else {
                text = Cow::Owned(joined);
                break;
            };
            joined.push_str(&String::from_utf8_lossy(raw));
            (number, text) = (next, Cow::Owned(joined));
        }
        Some((number + 1, text))
    })
}
