//! PLY, the Stanford format, as text or binary in either byte order: elements with properties, one after the other.

use std::borrow::Cow;
use std::iter::Enumerate;
use std::str::{Split, SplitAsciiWhitespace};

use thiserror::Error;

use crate::mesh::Place;

/// Elements and properties that a header may name; real ones name a handful.
const MOST_NAMES: usize = 1000;

/// Why a file is not PLY; the words go on where its name ends.
#[derive(Debug, Error)]
pub(crate) enum PlyFault {
    /// It ends too early.
    #[error(" is cut short: it ends at {place}, {what}; copy or export it again")]
    CutShort { place: Place, what: &'static str },
    /// A line that the format does not allow.
    #[error(", line {line}: expected {expected}, found `{found}`")]
    Syntax { line: usize, expected: &'static str, found: String },
}

impl PlyFault {
    pub fn syntax(line: usize, expected: &'static str, found: &str) -> Self {
        Self::Syntax { line, expected, found: found.trim().chars().take(60).collect() }
    }
}

/// Things of one kind.
pub(crate) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Which property has one of these names, in lower case.
    pub fn find(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| names.contains(&p.name.to_ascii_lowercase().as_str()))
    }

    /// A mistake of its properties.
    pub fn missing(&self, expected: &'static str) -> PlyFault {
        PlyFault::syntax(1, expected, &format!("element {}", self.name))
    }

    /// Passes over all of it.
    pub fn skip(&self, body: &mut Body<'_>) -> Result<(), PlyFault> {
        let mut row = Vec::new();
        // Elements without properties take no room, however many they are said to be.
        for property in
            (0..if self.properties.is_empty() { 0 } else { self.count }).flat_map(|_| &self.properties)
        {
            property.read(body, &mut row)?;
        }
        Ok(())
    }
}

/// A number of each thing, or a list of numbers.
pub(crate) struct Property {
    pub name: String,
    /// Type of the length before a list.
    pub list: Option<Type>,
    item: Type,
}

impl Property {
    /// Puts the number, or the numbers of the list, into `row`.
    pub fn read(&self, body: &mut Body<'_>, row: &mut Vec<f64>) -> Result<(), PlyFault> {
        row.clear();
        // Lengths that are no counts have no entries; what follows then does not fit.
        let length = match self.list {
            Some(length) => body.next(length)?,
            None => 1.0,
        };
        for _ in 0..length as u64 {
            row.push(body.next(self.item)?);
        }
        Ok(())
    }
}

/// Gives `read` the elements of a file, and its numbers.
pub(crate) fn read<T, E: From<PlyFault>>(
    bytes: &[u8],
    read: impl FnOnce(&[Element], &mut Body<'_>) -> Result<T, E>,
) -> Result<T, E> {
    let header = header(bytes)?;
    let text: Cow<'_, str>;
    let mut body = match header.encoding {
        Encoding::Ascii => {
            text = String::from_utf8_lossy(&bytes[header.end..]);
            Body::Text(Text {
                lines: text.split('\n').enumerate(),
                words: "".split_ascii_whitespace(),
                line: 0,
                before: header.lines,
            })
        }
        Encoding::Binary { big } => Body::Binary(Binary { bytes, at: header.end, big }),
    };
    read(&header.elements, &mut body)
}

#[derive(Clone, Copy)]
enum Encoding {
    Ascii,
    Binary { big: bool },
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// Its bytes and lines.
    end: usize,
    lines: usize,
}

#[derive(Clone, Copy)]
pub(crate) enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn of(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value of `size()` little-endian bytes, followed by zeros.
    fn value(self, b: [u8; 8]) -> f64 {
        match self {
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Self::I32 => f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F64 => f64::from_le_bytes(b),
        }
    }
}

fn header(bytes: &[u8]) -> Result<Header, PlyFault> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let (mut end, mut names) = (0, 0);
    for (index, raw) in bytes.split_inclusive(|b| *b == b'\n').enumerate() {
        let line = index + 1;
        end += raw.len();
        let text = String::from_utf8_lossy(&raw[..raw.len().min(1000)]);
        let wrong = |expected| {
            // A last line that breaks off is no mistake of whoever wrote it.
            if line > 1 && !raw.ends_with(b"\n") {
                return PlyFault::CutShort { place: Place::Byte(end), what: "before `end_header`" };
            }
            PlyFault::syntax(line, expected, &text)
        };
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        names += 1;
        if names > MOST_NAMES {
            return Err(wrong("`end_header` within a thousand lines"));
        }
        match words[..] {
            ["ply"] if line == 1 => {}
            _ if line == 1 => return Err(wrong("`ply`")),
            [] | ["comment" | "obj_info", ..] => {}
            ["format", word, _] => {
                encoding = Some(match word {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Binary { big: false },
                    "binary_big_endian" => Encoding::Binary { big: true },
                    _ => return Err(wrong("`ascii`, `binary_little_endian` or `binary_big_endian`")),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| wrong("`element`, a name and a count"))?;
                elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
            }
            ["property", ref kind @ .., name] => {
                let (list, item) = match *kind {
                    [item] => (None, Type::of(item)),
                    ["list", length, item] => (Type::of(length), Type::of(item)),
                    _ => (None, None),
                };
                let known = "`property`, a type such as float or list uchar int, and a name";
                let item =
                    item.filter(|_| list.is_some() == (kind.len() == 3)).ok_or_else(|| wrong(known))?;
                let element = elements.last_mut().ok_or_else(|| wrong("`element` before its properties"))?;
                element.properties.push(Property { name: name.to_owned(), list, item });
            }
            ["end_header"] => {
                let encoding =
                    encoding.ok_or_else(|| wrong("a line `format` before the end of the header"))?;
                return Ok(Header { encoding, elements, end, lines: line });
            }
            _ => return Err(wrong("`format`, `element`, `property`, `comment` or `end_header`")),
        }
    }
    Err(PlyFault::CutShort { place: Place::Byte(end), what: "before `end_header`" })
}

/// The numbers behind the header, one after the other.
pub(crate) enum Body<'a> {
    Text(Text<'a>),
    Binary(Binary<'a>),
}

pub(crate) struct Text<'a> {
    lines: Enumerate<Split<'a, char>>,
    words: SplitAsciiWhitespace<'a>,
    line: usize,
    /// Lines of the header.
    before: usize,
}

pub(crate) struct Binary<'a> {
    bytes: &'a [u8],
    /// Of the byte behind the last number.
    at: usize,
    big: bool,
}

impl Body<'_> {
    fn next(&mut self, kind: Type) -> Result<f64, PlyFault> {
        match self {
            Self::Text(text) => text.next(),
            Self::Binary(binary) => binary.next(kind),
        }
    }

    /// Where the last number was.
    pub fn place(&self) -> Place {
        match self {
            Self::Text(text) => Place::Line(text.line),
            Self::Binary(binary) => Place::Byte(binary.at),
        }
    }
}

const MORE: &str = "where more numbers should follow";

impl Text<'_> {
    fn next(&mut self) -> Result<f64, PlyFault> {
        loop {
            if let Some(word) = self.words.next() {
                return word.parse().map_err(|_| PlyFault::syntax(self.line, "a number", word));
            }
            let Some((index, text)) = self.lines.next() else {
                return Err(PlyFault::CutShort { place: Place::Line(self.line), what: MORE });
            };
            (self.line, self.words) = (self.before + index + 1, text.split_ascii_whitespace());
        }
    }
}

impl Binary<'_> {
    fn next(&mut self, kind: Type) -> Result<f64, PlyFault> {
        let size = kind.size();
        let Some(bytes) = self.bytes.get(self.at..self.at + size) else {
            return Err(PlyFault::CutShort { place: Place::Byte(self.bytes.len()), what: MORE });
        };
        self.at += size;
        let mut number = [0; 8];
        number[..size].copy_from_slice(bytes);
        if self.big {
            number[..size].reverse();
        }
        Ok(kind.value(number))
    }
}
