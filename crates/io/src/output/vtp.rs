//! VTK's XML PolyData files (`.vtp`), as ParaView opens them: raw appended data, little-endian,
//! compressed in blocks with zlib.
//!
//! Format: "VTK XML Formats", <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;

use super::atomic::{OutputError, write_atomic};
use super::pvd::escape;

/// Uncompressed bytes per compressed block: enough for a good ratio, small enough that blocks of one
/// column are compressed on several threads.
const BLOCK: usize = 1 << 18;

/// The values of a column, one entry per point or cell.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Values<'a> {
    /// Scalars.
    F32(&'a [f32]),
    /// Scalars in double precision.
    F64(&'a [f64]),
    /// Signed integers.
    I32(&'a [i32]),
    /// Unsigned integers.
    U32(&'a [u32]),
    /// Vectors.
    Vec3F32(&'a [[f32; 3]]),
    /// Vectors in double precision.
    Vec3F64(&'a [[f64; 3]]),
}

impl Values<'_> {
    /// Number of entries (vectors count once).
    pub fn len(&self) -> usize {
        match self {
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
            Self::I32(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::Vec3F32(v) => v.len(),
            Self::Vec3F64(v) => v.len(),
        }
    }

    /// Whether there is no entry.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn vtk_type(&self) -> &'static str {
        match self {
            Self::F32(_) | Self::Vec3F32(_) => "Float32",
            Self::F64(_) | Self::Vec3F64(_) => "Float64",
            Self::I32(_) => "Int32",
            Self::U32(_) => "UInt32",
        }
    }

    fn components(&self) -> usize {
        match self {
            Self::Vec3F32(_) | Self::Vec3F64(_) => 3,
            _ => 1,
        }
    }

    fn is_point_type(&self) -> bool {
        matches!(self, Self::Vec3F32(_) | Self::Vec3F64(_))
    }

    fn to_bytes(self) -> Vec<u8> {
        match self {
            Self::F32(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::F64(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::I32(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::U32(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::Vec3F32(v) => v.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::Vec3F64(v) => v.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    }
}

/// A named column.
#[derive(Clone, Copy, Debug)]
pub struct Column<'a> {
    /// Name, as ParaView shows it.
    pub name: &'a str,
    /// Values.
    pub values: Values<'a>,
}

impl<'a> Column<'a> {
    /// A column of that name.
    pub fn new(name: &'a str, values: Values<'a>) -> Self {
        Self { name, values }
    }
}

/// What a `.vtp` file holds: a cloud of points, or a triangle mesh.
#[derive(Clone, Debug)]
pub struct PolyData<'a> {
    /// Coordinates \[m\]: vectors.
    pub points: Values<'a>,
    /// Point indices of each triangle. `None` for a cloud, whose points are its cells ("vertices").
    pub triangles: Option<&'a [[u32; 3]]>,
    /// One entry per point each.
    pub point_data: Vec<Column<'a>>,
    /// One entry per cell each: per triangle, or per point of a cloud.
    pub cell_data: Vec<Column<'a>>,
}

impl PolyData<'_> {
    /// Writes the file, whole or not at all, with the simulated `time` \[s\] as its `TimeValue`.
    ///
    /// # Errors
    /// [`OutputError::Columns`] for columns that do not fit together, [`OutputError::Io`].
    pub fn write(&self, path: &Path, time: f64) -> Result<(), OutputError> {
        self.check().map_err(|what| OutputError::columns(path, what))?;
        let file = self.encode(time).map_err(|e| OutputError::io(path, "compress this file", e))?;
        write_atomic(path, |out| {
            out.write_all(file.xml.as_bytes())?;
            out.write_all(&file.appended)?;
            out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
        })
    }

    fn check(&self) -> Result<(), String> {
        let points = self.points.len();
        let cells = self.triangles.map_or(points, <[_]>::len);
        if !self.points.is_point_type() {
            return Err("points must be vectors of three coordinates".to_owned());
        }
        // VTK's connectivity is written as Int32.
        if points > i32::MAX as usize || cells > i32::MAX as usize / 3 {
            return Err(format!("{points} points and {cells} cells are more than one file can index"));
        }
        for (columns, expected, of) in
            [(&self.point_data, points, "points"), (&self.cell_data, cells, "cells")]
        {
            for column in columns {
                let found = column.values.len();
                if found != expected {
                    return Err(format!("column `{}` has {found} values for {expected} {of}", column.name));
                }
            }
        }
        let out_of_range = |t: &&[u32; 3]| t.iter().any(|&v| v as usize >= points);
        match self.triangles.and_then(|triangles| triangles.iter().find(out_of_range)) {
            Some(bad) => Err(format!("triangle {bad:?} uses a point beyond the {points} points")),
            None => Ok(()),
        }
    }

    fn encode(&self, time: f64) -> std::io::Result<Encoded> {
        let points = self.points.len();
        let verts = if self.triangles.is_none() { points } else { 0 };
        let polys = self.triangles.map_or(0, <[_]>::len);

        let mut file = Encoded::default();
        file.line(0, "<?xml version=\"1.0\"?>");
        file.line(
            0,
            "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\" \
             compressor=\"vtkZLibDataCompressor\">",
        );
        file.line(1, "<PolyData>");
        file.line(2, "<FieldData>");
        file.array("TimeValue", Values::F64(&[time]), " NumberOfTuples=\"1\"")?;
        file.line(2, "</FieldData>");
        file.line(
            2,
            &format!(
                "<Piece NumberOfPoints=\"{points}\" NumberOfVerts=\"{verts}\" NumberOfLines=\"0\" \
                 NumberOfStrips=\"0\" NumberOfPolys=\"{polys}\">"
            ),
        );
        file.line(2, "<Points>");
        file.array("Points", self.points, "")?;
        file.line(2, "</Points>");
        for (tag, columns) in [("PointData", &self.point_data), ("CellData", &self.cell_data)] {
            file.line(2, &format!("<{tag}>"));
            for column in columns {
                file.array(column.name, column.values, "")?;
            }
            file.line(2, &format!("</{tag}>"));
        }
        let vertices: Vec<i32> = (0..verts as i32).collect();
        let corners: Vec<i32> =
            self.triangles.unwrap_or_default().iter().flatten().map(|&v| v as i32).collect();
        for (tag, connectivity, cells, size) in [("Verts", vertices, verts, 1), ("Polys", corners, polys, 3)]
        {
            let offsets: Vec<i32> = (1..=cells as i32).map(|k| k * size).collect();
            file.line(2, &format!("<{tag}>"));
            file.array("connectivity", Values::I32(&connectivity), "")?;
            file.array("offsets", Values::I32(&offsets), "")?;
            file.line(2, &format!("</{tag}>"));
        }
        file.line(2, "</Piece>");
        file.line(1, "</PolyData>");
        file.line(1, "<AppendedData encoding=\"raw\">");
        file.xml.push_str("   _");
        Ok(file)
    }
}

/// The two halves of a file: the description, and the data that it points into.
#[derive(Default)]
struct Encoded {
    xml: String,
    appended: Vec<u8>,
}

impl Encoded {
    fn line(&mut self, depth: usize, text: &str) {
        self.xml.push_str(&"  ".repeat(depth));
        self.xml.push_str(text);
        self.xml.push('\n');
    }

    fn array(&mut self, name: &str, values: Values, attributes: &str) -> std::io::Result<()> {
        let line = format!(
            "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\"{attributes} format=\"appended\" \
             offset=\"{}\"/>",
            values.vtk_type(),
            escape(name),
            values.components(),
            self.appended.len()
        );
        self.line(3, &line);
        self.append(&values.to_bytes())
    }

    /// Block count, block size, size of a last shorter block (0 if there is none), compressed sizes,
    /// compressed blocks.
    fn append(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        let blocks: Vec<Vec<u8>> = bytes.par_chunks(BLOCK).map(compress).collect::<std::io::Result<_>>()?;
        let mut put = |n: usize| self.appended.extend_from_slice(&(n as u64).to_le_bytes());
        put(blocks.len());
        put(BLOCK);
        put(bytes.len() % BLOCK);
        for block in &blocks {
            put(block.len());
        }
        for block in &blocks {
            self.appended.extend_from_slice(block);
        }
        Ok(())
    }
}

fn compress(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    // Positions and velocities are noise to zlib: higher levels cost time and gain a few per cent.
    let mut encoder = ZlibEncoder::new(Vec::with_capacity(bytes.len() / 2), Compression::fast());
    encoder.write_all(bytes)?;
    encoder.finish()
}
