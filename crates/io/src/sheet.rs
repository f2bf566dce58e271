//! Tables of numbers as CSV: columns by their headings, in any order, with units.

use thiserror::Error;

use crate::units::{Dimension, Factor};

/// A column: its name in messages, others of the same meaning, in lower case, and what it holds.
pub(crate) struct Meaning {
    pub name: &'static str,
    pub others: &'static [&'static str],
    pub dimension: Dimension,
}

impl Meaning {
    fn is(&self, heading: &str) -> bool {
        let other = |name: &&str| heading.eq_ignore_ascii_case(name);
        heading.eq_ignore_ascii_case(self.name) || self.others.iter().any(other)
    }
}

/// Why a table cannot be read; the words go on where the name of its file ends.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SheetError {
    /// The file is not CSV text.
    #[error(" is not CSV text: {0}")]
    NotCsv(csv::Error),
    /// A needed column is not there.
    #[error(", line {line}: no column `{missing}` among {}; known are {known}", found.join(", "))]
    MissingColumn {
        /// Line of the header.
        line: u64,
        /// The column.
        missing: String,
        /// The columns that are there.
        found: Vec<String>,
        /// The columns that may be there, in words.
        known: &'static str,
    },
    /// Two columns mean the same.
    #[error(", line {line}: two columns mean `{name}`: rename or remove one")]
    TwiceColumn {
        /// Line of the header.
        line: u64,
        /// The heading.
        name: String,
    },
    /// The unit of a column is not one of what it holds.
    #[error(", line {line}: column `{heading}`: {problem}")]
    Unit {
        /// Line of the header.
        line: u64,
        /// The heading.
        heading: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A line has more or fewer fields than the first.
    #[error(", line {line}: {found} fields, but the first line has {expected}")]
    Ragged {
        /// Line, from 1.
        line: u64,
        /// Fields of the first line.
        expected: usize,
        /// Fields of this one.
        found: usize,
    },
    /// A field that is not what its column holds.
    #[error(", line {line}, column {column} ({name}): `{text}` {problem}")]
    Value {
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        column: usize,
        /// Name of the column.
        name: &'static str,
        /// What stands there.
        text: String,
        /// What is wrong with it.
        problem: &'static str,
    },
}

/// Records of a file with the lines that they begin in; blank lines are passed over.
pub(crate) struct Rows<'a> {
    text: &'a str,
    reader: csv::Reader<&'a [u8]>,
}

impl<'a> Rows<'a> {
    pub fn new(text: &'a str) -> Self {
        let reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        Self { text, reader }
    }

    pub fn next(&mut self) -> Result<Option<(u64, csv::StringRecord)>, SheetError> {
        let mut record = csv::StringRecord::new();
        loop {
            // The reader's position is the end of the record before, ahead of blank lines and, after a
            // carriage return, of its line feed.
            let start = self.reader.position().clone();
            if !self.reader.read_record(&mut record).map_err(SheetError::NotCsv)? {
                return Ok(None);
            }
            if record.iter().any(|field| !field.is_empty()) {
                let rest = self.text.as_bytes().get(start.byte() as usize..).unwrap_or_default();
                let blank = rest.iter().take_while(|b| matches!(b, b'\r' | b'\n'));
                return Ok(Some((start.line() + blank.filter(|b| **b == b'\n').count() as u64, record)));
            }
        }
    }
}

/// A column of numbers.
#[derive(Clone, Copy)]
pub(crate) struct Column {
    pub at: usize,
    name: &'static str,
    factor: Factor,
}

impl Column {
    /// Of a file without headings, in SI units.
    pub fn plain(at: usize, meaning: &Meaning) -> Self {
        Self { at, name: meaning.name, factor: Factor::ONE }
    }
}

/// A heading without its unit, and the unit: `x [mm]`, `R (cm)`.
fn split(heading: &str) -> (&str, Option<&str>) {
    let inner = heading.strip_suffix(']').and_then(|h| h.split_once('['));
    let inner = inner.or_else(|| heading.strip_suffix(')').and_then(|h| h.split_once('(')));
    inner.map_or((heading, None), |(name, unit)| (name.trim(), Some(unit.trim())))
}

/// The headings of a file. A `#` before the first is allowed.
pub(crate) struct Header<'a> {
    line: u64,
    found: Vec<&'a str>,
    meanings: Vec<&'static Meaning>,
    known: &'static str,
}

impl<'a> Header<'a> {
    /// Of the record at a line; `meanings` are the columns that are looked for, `known` the same in words.
    pub fn new(
        line: u64,
        record: &'a csv::StringRecord,
        meanings: Vec<&'static Meaning>,
        known: &'static str,
    ) -> Result<Self, SheetError> {
        let found = record.iter().map(|field| field.trim_start_matches('#').trim()).collect();
        let header = Self { line, found, meanings, known };
        for (index, heading) in header.found.iter().enumerate() {
            if let Some(meaning) = header.meaning(heading)
                && header.find(meaning) != Some(index)
            {
                return Err(SheetError::TwiceColumn { line, name: meaning.name.to_owned() });
            }
        }
        Ok(header)
    }

    fn meaning(&self, heading: &str) -> Option<&'static Meaning> {
        self.meanings.iter().copied().find(|meaning| meaning.is(split(heading).0))
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.found.len()
    }

    /// Headings that mean nothing.
    pub fn unknown(&self) -> Vec<String> {
        self.found.iter().filter(|h| self.meaning(h).is_none()).map(|h| (*h).to_owned()).collect()
    }

    /// Where a column is.
    pub fn find(&self, meaning: &Meaning) -> Option<usize> {
        self.found.iter().position(|h| meaning.is(split(h).0))
    }

    /// A column that must be there.
    pub fn need(&self, meaning: &Meaning) -> Result<Column, SheetError> {
        let line = self.line;
        let at = self.find(meaning).ok_or_else(|| {
            let found = self.found.iter().map(|heading| format!("`{heading}`")).collect();
            SheetError::MissingColumn { line, missing: meaning.name.to_owned(), found, known: self.known }
        })?;
        self.column(at, meaning.name, meaning.dimension)
    }

    fn column(&self, at: usize, name: &'static str, dimension: Dimension) -> Result<Column, SheetError> {
        let factor = match split(self.found[at]).1 {
            Some(unit) => Factor::of(unit, dimension, unit).map_err(|e| SheetError::Unit {
                line: self.line,
                heading: self.found[at].to_owned(),
                problem: e.to_string(),
            })?,
            None => Factor::ONE,
        };
        Ok(Column { at, name, factor })
    }

    /// A column that must be there, by a heading that the user gives, without its unit; `role` is its name in messages.
    pub fn called(
        &self,
        heading: &str,
        role: &'static str,
        dimension: Dimension,
    ) -> Result<Column, SheetError> {
        let line = self.line;
        let mut all = (0..self.found.len()).filter(|k| split(self.found[*k]).0.eq_ignore_ascii_case(heading));
        let at = all.next().ok_or_else(|| {
            let found = self.found.iter().map(|heading| format!("`{heading}`")).collect();
            SheetError::MissingColumn { line, missing: heading.to_owned(), found, known: self.known }
        })?;
        if all.next().is_some() {
            return Err(SheetError::TwiceColumn { line, name: heading.to_owned() });
        }
        self.column(at, role, dimension)
    }

    /// Columns that must all be there.
    pub fn group<const N: usize>(&self, meanings: &[Meaning; N]) -> Result<[Column; N], SheetError> {
        let mut columns = [Column { at: 0, name: "", factor: Factor::ONE }; N];
        for (column, meaning) in columns.iter_mut().zip(meanings) {
            *column = self.need(meaning)?;
        }
        Ok(columns)
    }

    /// Columns of which all must be there or none.
    pub fn optional<const N: usize>(
        &self,
        meanings: &[Meaning; N],
    ) -> Result<Option<[Column; N]>, SheetError> {
        meanings.iter().any(|meaning| self.find(meaning).is_some()).then(|| self.group(meanings)).transpose()
    }
}

/// One line of the file.
pub(crate) struct Row<'a> {
    line: u64,
    fields: &'a csv::StringRecord,
}

impl<'a> Row<'a> {
    /// The record at a line, of as many fields as the first.
    pub fn new(line: u64, fields: &'a csv::StringRecord, expected: usize) -> Result<Self, SheetError> {
        if fields.len() == expected {
            return Ok(Self { line, fields });
        }
        Err(SheetError::Ragged { line, expected, found: fields.len() })
    }

    /// The number of a column, in SI units.
    pub fn number(&self, column: Column) -> Result<f64, SheetError> {
        match self.fields[column.at].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(column.factor.apply(value)),
            Ok(_) => Err(self.fault(column.at, column.name, "is not finite")),
            Err(_) => Err(self.fault(column.at, column.name, "is not a number")),
        }
    }

    /// The numbers of some columns.
    pub fn numbers<const N: usize>(&self, columns: &[Column; N]) -> Result<[f64; N], SheetError> {
        let mut numbers = [0.0; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(*column)?;
        }
        Ok(numbers)
    }

    /// What is wrong with a field.
    pub fn fault(&self, column: usize, name: &'static str, problem: &'static str) -> SheetError {
        let text = self.fields[column].to_owned();
        SheetError::Value { line: self.line, column: column + 1, name, text, problem }
    }
}
