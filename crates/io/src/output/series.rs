//! `series.csv`: one row of numbers per sample, under a header of names.

use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::atomic::{OutputError, write_atomic};

/// Appends rows to `series.csv`. What is on disk always ends with a whole batch of rows, unless the
/// machine stops in the middle of a write; [`Series::read`] and [`SeriesWriter::resume`] then ignore
/// the unfinished last row.
#[derive(Debug)]
pub struct SeriesWriter {
    path: PathBuf,
    file: File,
    columns: usize,
    rows: u64,
    text: String,
}

impl SeriesWriter {
    /// Begins a series with these column names, replacing a file at `path`.
    ///
    /// # Errors
    /// [`OutputError::Columns`] without columns or with a name twice, [`OutputError::Io`].
    pub fn create(path: &Path, columns: &[&str]) -> Result<Self, OutputError> {
        if columns.is_empty() {
            return Err(OutputError::columns(path, "a series needs at least one column".to_owned()));
        }
        if let Some(k) = (1..columns.len()).find(|&k| columns[..k].contains(&columns[k])) {
            return Err(OutputError::columns(path, format!("the column name `{}` stands twice", columns[k])));
        }
        let header = header(path, columns)?;
        write_atomic(path, |out| out.write_all(&header))?;
        Self::append_to(path, columns.len(), 0)
    }

    /// Continues a series after its first `rows` rows; later rows, written after the checkpoint, are
    /// cut off.
    ///
    /// # Errors
    /// [`OutputError::Malformed`] if the columns are others or there are fewer rows,
    /// [`OutputError::Io`].
    pub fn resume(path: &Path, columns: &[&str], rows: u64) -> Result<Self, OutputError> {
        if rows == 0 {
            return Self::create(path, columns);
        }
        let text = read_text(path)?;
        let header = header(path, columns)?;
        let malformed = |what: String| OutputError::Malformed { path: path.to_owned(), what };
        let Some(body) = text.as_bytes().strip_prefix(header.as_slice()) else {
            return Err(malformed(
                "its columns are not those of this scene: the scene or its output was changed since the \
                 checkpoint; start again with --force"
                    .to_owned(),
            ));
        };
        let ends = || body.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(at, _)| at + 1);
        let length = ends().nth(rows as usize - 1).ok_or_else(|| {
            malformed(format!(
                "holds {} rows, but the checkpoint was taken after {rows}: put the missing rows back, or \
                 start again with --force",
                ends().count()
            ))
        })?;
        let writer = Self::append_to(path, columns.len(), rows)?;
        let end = (header.len() + length) as u64;
        writer.file.set_len(end).map_err(|e| OutputError::io(path, "cut rows off this file", e))?;
        Ok(writer)
    }

    fn append_to(path: &Path, columns: usize, rows: u64) -> Result<Self, OutputError> {
        let file = OpenOptions::new()
            .append(true)
            .open(path)
            .map_err(|e| OutputError::io(path, "open this file for writing", e))?;
        Ok(Self { path: path.to_owned(), file, columns, rows, text: String::new() })
    }

    /// Appends rows, given one after the other in `values`, and hands them to the system at once.
    ///
    /// # Errors
    /// [`OutputError::Columns`] if `values` does not fill whole rows, [`OutputError::Io`].
    pub fn append(&mut self, values: &[f64]) -> Result<(), OutputError> {
        if !values.len().is_multiple_of(self.columns) {
            let what = format!("{} values do not fill rows of {}", values.len(), self.columns);
            return Err(OutputError::columns(&self.path, what));
        }
        self.text.clear();
        for row in values.chunks_exact(self.columns) {
            for (k, value) in row.iter().enumerate() {
                if k > 0 {
                    self.text.push(',');
                }
                number(&mut self.text, *value);
            }
            self.text.push('\n');
        }
        let write = |e| OutputError::io(&self.path, "append to this file", e);
        self.file.write_all(self.text.as_bytes()).map_err(write)?;
        self.rows += (values.len() / self.columns) as u64;
        Ok(())
    }

    /// Number of rows so far, to be kept with a checkpoint.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Makes all rows durable; to be called before a checkpoint that counts on them is written.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn sync(&self) -> Result<(), OutputError> {
        self.file.sync_data().map_err(|e| OutputError::io(&self.path, "make this file durable", e))
    }
}

/// A series in memory, as columns of equal length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Names of the columns.
    pub names: Vec<String>,
    /// Values by column.
    pub columns: Vec<Vec<f64>>,
}

impl Series {
    /// Reads `series.csv`. An unfinished last row is left out.
    ///
    /// # Errors
    /// [`OutputError::Malformed`] with line and column, [`OutputError::Io`].
    pub fn read(path: &Path) -> Result<Self, OutputError> {
        let text = read_text(path)?;
        let malformed = |what: String| OutputError::Malformed { path: path.to_owned(), what };
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(whole.as_bytes());
        let names: Vec<String> = match reader.headers() {
            Ok(header) if !header.is_empty() => header.iter().map(str::to_owned).collect(),
            _ => return Err(malformed("holds no header line: it is not a series".to_owned())),
        };
        let mut columns = vec![Vec::new(); names.len()];
        for record in reader.records() {
            let record = record.map_err(|e| malformed(e.to_string()))?;
            let line = record.position().map_or(0, csv::Position::line);
            if record.len() != names.len() {
                let what = format!("line {line} has {} values for {} columns", record.len(), names.len());
                return Err(malformed(what));
            }
            for ((field, name), column) in record.iter().zip(&names).zip(&mut columns) {
                let number = field.trim().parse();
                column.push(number.map_err(|_| {
                    malformed(format!("line {line}, column `{name}`: `{field}` is not a number"))
                })?);
            }
        }
        Ok(Self { names, columns })
    }

    /// The column of that name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.names.iter().position(|n| n == name).map(|k| self.columns[k].as_slice())
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }
}

fn read_text(path: &Path) -> Result<String, OutputError> {
    std::fs::read_to_string(path).map_err(|e| match e.kind() {
        io::ErrorKind::InvalidData => OutputError::Malformed {
            path: path.to_owned(),
            what: "is not text: it is not a series".to_owned(),
        },
        _ => OutputError::io(path, "read this series", e),
    })
}

/// The shortest digits that read back as the same number.
pub(super) fn number(text: &mut String, value: f64) {
    // Writing to a string cannot fail. `{}` has no exponent, `{:?}` puts `.0` behind whole numbers.
    let _ = if value.fract() == 0.0 && value.abs() < 1e15 {
        write!(text, "{value}")
    } else {
        write!(text, "{value:?}")
    };
}

/// The header line. Names of surfaces come from scenes and may need quotes; a line break in one would make
/// the header two lines, and becomes a space.
fn header(path: &Path, columns: &[&str]) -> Result<Vec<u8>, OutputError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let names = columns.iter().map(|name| name.replace(['\n', '\r'], " "));
    writer
        .write_record(names)
        .map_err(io::Error::from)
        .and_then(|()| writer.into_inner().map_err(csv::IntoInnerError::into_error))
        .map_err(|e| OutputError::io(path, "write the header of this file", e))
}
