//! VTK's PolyData files (`.vtp`), as ParaView opens them: clouds of points, meshes, lines.

use std::path::Path;

use super::atomic::OutputError;
pub use super::xml::{Column, Part, Values};
use super::xml::{Encoded, check_columns};

/// The cells of a `.vtp` file.
#[derive(Clone, Copy, Debug)]
pub enum Cells<'a> {
    /// Each point is one.
    Points,
    /// Point indices of triangles.
    Triangles(&'a [[u32; 3]]),
    /// Point indices of lines.
    Lines(&'a [[u32; 2]]),
}

/// What a `.vtp` file holds: a cloud of points, a triangle mesh, or lines.
#[derive(Clone, Debug)]
pub struct PolyData<'a> {
    /// Coordinates \[m\]: vectors.
    pub points: Values<'a>,
    /// What joins them.
    pub cells: Cells<'a>,
    /// One entry per point each.
    pub point_data: Vec<Column<'a>>,
    /// One entry per cell each.
    pub cell_data: Vec<Column<'a>>,
}

impl Cells<'_> {
    /// The tag of such cells, and the point indices of all of them, so many a cell.
    fn listed(&self, points: usize) -> (&'static str, Vec<u32>, usize) {
        match self {
            Self::Points => ("Verts", (0..points as u32).collect(), 1),
            Self::Triangles(triangles) => ("Polys", triangles.as_flattened().to_vec(), 3),
            Self::Lines(lines) => ("Lines", lines.as_flattened().to_vec(), 2),
        }
    }
}

impl Part for PolyData<'_> {
    const EXTENSION: &'static str = "vtp";

    fn write(&self, path: &Path, time: f64) -> Result<(), OutputError> {
        let points = self.points.len();
        // VTK's connectivity is written as Int32.
        let many = |cells: usize| points > i32::MAX as usize || cells > i32::MAX as usize / 3;
        let columns = |what| OutputError::columns(path, what);
        if many(0) {
            return Err(columns(format!("{points} points are more than one file can index")));
        }
        let (tag, corners, size) = self.cells.listed(points);
        let cells = corners.len() / size;
        self.check(&corners, cells, many(cells)).map_err(columns)?;
        let packed = self.encode(time, (tag, &corners, size));
        packed.map_err(|e| OutputError::io(path, "compress this file", e))?.write(path, "PolyData")
    }
}

impl PolyData<'_> {
    fn check(&self, corners: &[u32], cells: usize, many: bool) -> Result<(), String> {
        let points = self.points.len();
        if !self.points.is_point_type() {
            return Err("points must be vectors of three coordinates".to_owned());
        }
        if many {
            return Err(format!("{points} points and {cells} cells are more than one file can index"));
        }
        check_columns(&self.point_data, points, "points")?;
        check_columns(&self.cell_data, cells, "cells")?;
        match corners.iter().find(|&&v| v as usize >= points) {
            Some(bad) => Err(format!("a cell uses point {bad} beyond the {points} points")),
            None => Ok(()),
        }
    }

    fn encode(&self, time: f64, (tag, corners, size): (&str, &[u32], usize)) -> std::io::Result<Encoded> {
        let cells = corners.len() / size;
        let mut file = Encoded::begin("PolyData", "", time)?;
        let counts = ["Verts", "Lines", "Strips", "Polys"]
            .map(|kind| format!("NumberOf{kind}=\"{}\"", if kind == tag { cells } else { 0 }));
        let piece = format!("<Piece NumberOfPoints=\"{}\" {}>", self.points.len(), counts.join(" "));
        file.line(2, &piece);
        file.line(2, "<Points>");
        file.array("Points", self.points, "")?;
        file.line(2, "</Points>");
        file.columns("PointData", &self.point_data)?;
        file.columns("CellData", &self.cell_data)?;
        for kind in ["Verts", "Lines", "Polys"] {
            let corners = if kind == tag { corners } else { &[] };
            let connectivity: Vec<i32> = corners.iter().map(|&v| v as i32).collect();
            let offsets: Vec<i32> = (1..=(corners.len() / size) as i32).map(|k| k * size as i32).collect();
            file.line(2, &format!("<{kind}>"));
            file.array("connectivity", Values::I32(&connectivity), "")?;
            file.array("offsets", Values::I32(&offsets), "")?;
            file.line(2, &format!("</{kind}>"));
        }
        file.line(2, "</Piece>");
        Ok(file)
    }
}
