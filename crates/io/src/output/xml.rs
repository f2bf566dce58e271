//! What VTK's XML files have in common: raw appended data, little-endian, compressed in blocks with zlib.
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
    /// Tensors, by rows.
    TensorF64(&'a [[[f64; 3]; 3]]),
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
            Self::TensorF64(v) => v.len(),
        }
    }

    /// Whether there is no entry.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn vtk_type(&self) -> &'static str {
        match self {
            Self::F32(_) | Self::Vec3F32(_) => "Float32",
            Self::F64(_) | Self::Vec3F64(_) | Self::TensorF64(_) => "Float64",
            Self::I32(_) => "Int32",
            Self::U32(_) => "UInt32",
        }
    }

    fn components(&self) -> usize {
        match self {
            Self::Vec3F32(_) | Self::Vec3F64(_) => 3,
            Self::TensorF64(_) => 9,
            _ => 1,
        }
    }

    pub(super) fn is_point_type(&self) -> bool {
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
            Self::TensorF64(v) => {
                v.as_flattened().as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect()
            }
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

/// A file of a collection.
pub trait Part {
    /// The extension of its name.
    const EXTENSION: &'static str;
    /// Writes the file, whole or not at all, with the simulated `time` \[s\] as its `TimeValue`.
    ///
    /// # Errors
    /// [`OutputError::Columns`] for columns that do not fit together, [`OutputError::Io`].
    fn write(&self, path: &Path, time: f64) -> Result<(), OutputError>;
}

/// Whether each column has `expected` values, one for each of what is called `of`.
pub(super) fn check_columns(columns: &[Column], expected: usize, of: &str) -> Result<(), String> {
    for column in columns {
        let found = column.values.len();
        if found != expected {
            return Err(format!("column `{}` has {found} values for {expected} {of}", column.name));
        }
    }
    Ok(())
}

/// The two halves of a file: the description, and the data that it points into.
#[derive(Default)]
pub(super) struct Encoded {
    xml: String,
    appended: Vec<u8>,
}

impl Encoded {
    /// Begins a file of a data set of this type with the time \[s\].
    pub fn begin(kind: &str, attributes: &str, time: f64) -> std::io::Result<Self> {
        let mut file = Self::default();
        file.line(0, "<?xml version=\"1.0\"?>");
        file.line(
            0,
            &format!(
                "<VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\" \
                 compressor=\"vtkZLibDataCompressor\">"
            ),
        );
        file.line(1, &format!("<{kind}{attributes}>"));
        file.line(2, "<FieldData>");
        file.array("TimeValue", Values::F64(&[time]), " NumberOfTuples=\"1\"")?;
        file.line(2, "</FieldData>");
        Ok(file)
    }

    /// Writes the file, whole or not at all, once the data set is described.
    pub fn write(mut self, path: &Path, kind: &str) -> Result<(), OutputError> {
        self.line(1, &format!("</{kind}>"));
        self.line(1, "<AppendedData encoding=\"raw\">");
        self.xml.push_str("   _");
        write_atomic(path, |out| {
            out.write_all(self.xml.as_bytes())?;
            out.write_all(&self.appended)?;
            out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
        })
    }

    /// The columns of points or cells.
    pub fn columns(&mut self, tag: &str, columns: &[Column]) -> std::io::Result<()> {
        self.line(2, &format!("<{tag}>"));
        for column in columns {
            self.array(column.name, column.values, "")?;
        }
        self.line(2, &format!("</{tag}>"));
        Ok(())
    }

    pub fn line(&mut self, depth: usize, text: &str) {
        self.xml.push_str(&"  ".repeat(depth));
        self.xml.push_str(text);
        self.xml.push('\n');
    }

    pub fn array(&mut self, name: &str, values: Values, attributes: &str) -> std::io::Result<()> {
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
