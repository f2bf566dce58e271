//! Meshes from PLY. Only `vertex` (x, y, z) and `face` (a list of vertex numbers) are read; other elements and
//! properties are passed over.

use std::path::Path;

use glebe_engine::spec::Vec3;

use super::{
    Corners,
    error::{MeshError, Place},
    polygon,
};
use crate::ply::{self, Body, Element, PlyFault};

/// What stops reading: a file that is not PLY, or a mesh that is none.
enum Stop {
    File(PlyFault),
    Mesh(MeshError),
}

impl From<PlyFault> for Stop {
    fn from(fault: PlyFault) -> Self {
        Self::File(fault)
    }
}

impl From<MeshError> for Stop {
    fn from(error: MeshError) -> Self {
        Self::Mesh(error)
    }
}

/// Reads all faces, cut into triangles.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Corners>, MeshError> {
    ply::read(bytes, |elements, body| faces(path, elements, body)).map_err(|stop| match stop {
        Stop::Mesh(error) => error,
        Stop::File(PlyFault::CutShort { place, what }) => {
            MeshError::CutShort { path: path.into(), place, what: what.to_owned() }
        }
        Stop::File(PlyFault::Syntax { line, expected, found }) => {
            MeshError::Syntax { path: path.into(), line, expected, found }
        }
    })
}

fn faces(path: &Path, elements: &[Element], body: &mut Body<'_>) -> Result<Vec<Corners>, Stop> {
    let mut vertices: Vec<Vec3> = Vec::new();
    let mut soup = Vec::new();
    let mut row = Vec::new();
    for element in elements.iter().filter(|e| !e.properties.is_empty()) {
        match element.name.as_str() {
            "vertex" => {
                let at = [element.find(&["x"]), element.find(&["y"]), element.find(&["z"])];
                let [Some(x), Some(y), Some(z)] = at else {
                    return Err(element.missing("vertices with the properties x, y and z").into());
                };
                for _ in 0..element.count {
                    let mut point = [0.0; 3];
                    for (k, property) in element.properties.iter().enumerate() {
                        property.read(body, &mut row)?;
                        if let (Some(axis), None) = ([x, y, z].iter().position(|p| *p == k), property.list) {
                            point[axis] = row[0];
                        }
                    }
                    if let Some(&value) = point.iter().find(|c| !c.is_finite()) {
                        let (path, place) = (path.into(), body.place());
                        return Err(MeshError::NotFinite { path, place, value }.into());
                    }
                    vertices.push(point);
                }
            }
            "face" => {
                let corners = element
                    .find(&["vertex_indices", "vertex_index"])
                    .filter(|k| element.properties[*k].list.is_some())
                    .ok_or_else(|| element.missing("faces with a list vertex_indices or vertex_index"))?;
                let mut polygon = Vec::new();
                for _ in 0..element.count {
                    for (k, property) in element.properties.iter().enumerate() {
                        property.read(body, &mut row)?;
                        if k != corners {
                            continue;
                        }
                        polygon.clear();
                        for &index in &row {
                            polygon.push(corner(path, &vertices, index, body.place())?);
                        }
                    }
                    if !polygon::triangulate(&polygon, &mut soup) {
                        let (path, place) = (path.into(), body.place());
                        return Err(MeshError::Polygon { path, place, corners: polygon.len() }.into());
                    }
                }
            }
            _ => element.skip(body)?,
        }
    }
    Ok(soup)
}

fn corner(path: &Path, vertices: &[Vec3], index: f64, place: Place) -> Result<Vec3, MeshError> {
    let vertex = (index >= 0.0 && index.fract() == 0.0).then(|| vertices.get(index as usize)).flatten();
    vertex.copied().ok_or_else(|| MeshError::VertexIndex {
        path: path.into(),
        place,
        index,
        vertices: vertices.len(),
    })
}
