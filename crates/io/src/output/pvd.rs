//! ParaView's collection files (`.pvd`): which file shows which part at which time.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;

use super::atomic::{OutputError, write_atomic};

/// One file of a collection.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Simulated time \[s\].
    pub time: f64,
    /// Number of the part; the same at all times.
    pub part: usize,
    /// Name of the part.
    pub name: String,
    /// Path of the file, relative to the collection's folder, with `/`.
    pub file: String,
}

/// How a collection begins.
pub(super) const HEAD: &str = "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" \
                    byte_order=\"LittleEndian\">\n  <Collection>\n";
const TAIL: &str = "  </Collection>\n</VTKFile>\n";

/// Writes a collection, whole or not at all.
///
/// # Errors
/// [`OutputError::Io`].
pub fn write(path: &Path, entries: &[Entry]) -> Result<(), OutputError> {
    write_atomic(path, |out| {
        out.write_all(HEAD.as_bytes())?;
        lines(out, entries)?;
        out.write_all(TAIL.as_bytes())
    })
}

/// Adds files to a collection that [`write()`] made, whole or not at all. What it lists is copied from the disk, so a run
/// need not hold it.
///
/// # Errors
/// [`OutputError::Malformed`] if it is gone, [`OutputError::Io`].
pub fn extend(path: &Path, entries: &[Entry]) -> Result<(), OutputError> {
    let read = |e: io::Error| match e.kind() {
        ErrorKind::NotFound => OutputError::Malformed {
            path: path.to_owned(),
            what:
                "is gone, and with it the list of the frames before: put it back and go on with --resume, or \
                   start again with --force"
                    .to_owned(),
        },
        _ => OutputError::io(path, "read this collection of frames", e),
    };
    let file = File::open(path).map_err(read)?;
    let listed = file.metadata().map_err(read)?.len().saturating_sub(TAIL.len() as u64);
    write_atomic(path, |out| {
        io::copy(&mut file.take(listed), out)?;
        lines(out, entries)?;
        out.write_all(TAIL.as_bytes())
    })
}

fn lines(out: &mut dyn Write, entries: &[Entry]) -> io::Result<()> {
    entries.iter().try_for_each(|e| {
        let (name, file) = (escape(&e.name), escape(&e.file));
        let Entry { time, part, .. } = e;
        writeln!(out, "    <DataSet timestep=\"{time:?}\" part=\"{part}\" name=\"{name}\" file=\"{file}\"/>")
    })
}

/// Reads a collection that [`write()`] made.
///
/// # Errors
/// [`OutputError::Malformed`] for any other file, [`OutputError::Io`].
pub fn read(path: &Path) -> Result<Vec<Entry>, OutputError> {
    let read = |e: io::Error| OutputError::io(path, "read this collection of frames", e);
    let text = fs::read_to_string(path).map_err(read)?;
    let malformed = |line: usize| OutputError::Malformed {
        path: path.to_owned(),
        what: format!("line {line} is not as glebe writes it, so the frames cannot be continued"),
    };
    text.lines()
        .enumerate()
        .filter(|(_, line)| line.trim_start().starts_with("<DataSet "))
        .map(|(k, line)| entry(line).ok_or_else(|| malformed(k + 1)))
        .collect()
}

fn entry(line: &str) -> Option<Entry> {
    let attribute = |name: &str| {
        let (_, rest) = line.split_once(&format!(" {name}=\""))?;
        rest.split_once('"').map(|(value, _)| unescape(value))
    };
    Some(Entry {
        time: attribute("timestep")?.parse().ok()?,
        part: attribute("part")?.parse().ok()?,
        name: attribute("name")?,
        file: attribute("file")?,
    })
}

/// The characters that XML reserves in an attribute; a line break would be read back as a space.
const RESERVED: [(char, &str); 8] = [
    ('&', "&amp;"),
    ('<', "&lt;"),
    ('>', "&gt;"),
    ('"', "&quot;"),
    ('\'', "&apos;"),
    ('\n', "&#10;"),
    ('\r', "&#13;"),
    ('\t', "&#9;"),
];

/// Text as it stands in XML. Control characters, which XML cannot hold at all, become `�`.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match RESERVED.iter().find(|(reserved, _)| *reserved == c) {
            Some((_, entity)) => out.push_str(entity),
            None if c.is_control() => out.push('\u{fffd}'),
            None => out.push(c),
        }
    }
    out
}

fn unescape(text: &str) -> String {
    // `&amp;` last, so that what it yields is not read as the beginning of another entity.
    RESERVED
        .iter()
        .rev()
        .fold(text.to_owned(), |t, (c, entity)| t.replace(entity, c.encode_utf8(&mut [0; 4])))
}
