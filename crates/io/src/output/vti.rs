//! VTK's image files (`.vti`), as ParaView opens them: columns on the cells of a regular grid.

use std::path::Path;

use super::atomic::OutputError;
use super::xml::{Column, Encoded, Part, check_columns};

/// A regular grid with columns on its cells, in the order of x, then y, then z.
#[derive(Clone, Debug)]
pub struct ImageData<'a> {
    /// Its least corner \[m\].
    pub origin: [f64; 3],
    /// Widths of a cell \[m\].
    pub spacing: [f64; 3],
    /// Cells along each axis.
    pub cells: [usize; 3],
    /// One entry per cell each.
    pub cell_data: Vec<Column<'a>>,
}

impl Part for ImageData<'_> {
    const EXTENSION: &'static str = "vti";

    fn write(&self, path: &Path, time: f64) -> Result<(), OutputError> {
        check_columns(&self.cell_data, self.cells.iter().product(), "cells")
            .map_err(|what| OutputError::columns(path, what))?;
        let packed = self.encode(time).map_err(|e| OutputError::io(path, "compress this file", e))?;
        packed.write(path, "ImageData")
    }
}

impl ImageData<'_> {
    fn encode(&self, time: f64) -> std::io::Result<Encoded> {
        let [x, y, z] = self.cells;
        let extent = format!("\"0 {x} 0 {y} 0 {z}\"");
        let three = |v: [f64; 3]| v.map(|x| format!("{x:?}")).join(" ");
        let (origin, spacing) = (three(self.origin), three(self.spacing));
        let attributes = format!(
            " WholeExtent={extent} Origin=\"{origin}\" Spacing=\"{spacing}\" Direction=\"1 0 0 0 1 0 0 0 1\""
        );
        let mut file = Encoded::begin("ImageData", &attributes, time)?;
        file.line(2, &format!("<Piece Extent={extent}>"));
        file.columns("CellData", &self.cell_data)?;
        file.line(2, "</Piece>");
        Ok(file)
    }
}
