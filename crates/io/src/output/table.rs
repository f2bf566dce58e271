//! Tables of mixed columns as CSV, such as `worlds.csv`.

use std::io;
use std::path::Path;

use super::atomic::{OutputError, write_atomic};
use super::series::number;

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// A number; empty if it is none.
    Number(f64),
    /// A count.
    Count(u64),
    /// A text; line breaks become spaces.
    Text(String),
}

impl Cell {
    fn text(&self) -> String {
        match self {
            Self::Number(x) if x.is_nan() => String::new(),
            Self::Number(x) => {
                let mut text = String::new();
                number(&mut text, *x);
                text
            }
            Self::Count(n) => n.to_string(),
            Self::Text(text) => text.replace(['\n', '\r'], " "),
        }
    }
}

/// Writes a table under a header of names, whole or not at all.
///
/// # Errors
/// [`OutputError::Columns`] if a row is longer or shorter than the header, [`OutputError::Io`].
pub fn write_table(path: &Path, header: &[String], rows: &[Vec<Cell>]) -> Result<(), OutputError> {
    if let Some(row) = rows.iter().find(|row| row.len() != header.len()) {
        let what = format!("a row of {} cells does not fit {} columns", row.len(), header.len());
        return Err(OutputError::columns(path, what));
    }
    write_atomic(path, |out| {
        let mut writer = csv::Writer::from_writer(out);
        writer.write_record(header).map_err(io::Error::from)?;
        for row in rows {
            writer.write_record(row.iter().map(Cell::text)).map_err(io::Error::from)?;
        }
        writer.flush()
    })
}
