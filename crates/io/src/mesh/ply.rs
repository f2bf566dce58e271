//! PLY: the Stanford format, as text or binary in either byte order. Only `vertex` (x, y, z) and `face` (a list
//! of vertex numbers) are read; other elements and properties are passed over.

use std::{path::Path, str::SplitAsciiWhitespace};

use glebe_engine::spec::Vec3;

use super::{
    Corners,
    error::{MeshError, Place},
    polygon,
};

/// Elements and properties that a header may name; real ones name a handful.
const MOST_NAMES: usize = 1000;

/// Reads all faces, cut into triangles.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Corners>, MeshError> {
    let file = File { path, bytes };
    let header = file.header()?;
    let body = &bytes[header.end..];
    match header.encoding {
        Encoding::Ascii => {
            let text = String::from_utf8_lossy(body);
            let lines = text.split('\n').enumerate();
            let words = Text {
                file: &file,
                lines,
                words: "".split_ascii_whitespace(),
                line: 0,
                before: header.lines,
            };
            header.elements.read(&file, words)
        }
        Encoding::Binary { big } => header.elements.read(&file, Binary { file: &file, at: header.end, big }),
    }
}

struct File<'a> {
    path: &'a Path,
    bytes: &'a [u8],
}

#[derive(Clone, Copy)]
enum Encoding {
    Ascii,
    Binary { big: bool },
}

struct Header {
    encoding: Encoding,
    elements: Elements,
    /// Its bytes and lines.
    end: usize,
    lines: usize,
}

struct Elements(Vec<Element>);

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    /// Type of the length before a list.
    list: Option<Type>,
    item: Type,
}

#[derive(Clone, Copy)]
enum Type {
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

impl File<'_> {
    fn syntax(&self, line: usize, expected: &'static str, found: &str) -> MeshError {
        let found = found.trim().chars().take(60).collect();
        MeshError::Syntax { path: self.path.into(), line, expected, found }
    }

    fn cut_short(&self, place: Place, what: &str) -> MeshError {
        MeshError::CutShort { path: self.path.into(), place, what: what.to_owned() }
    }

    fn header(&self) -> Result<Header, MeshError> {
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let (mut end, mut names) = (0, 0);
        for (index, raw) in self.bytes.split_inclusive(|b| *b == b'\n').enumerate() {
            let line = index + 1;
            end += raw.len();
            let text = String::from_utf8_lossy(&raw[..raw.len().min(1000)]);
            let wrong = |expected| {
                // A last line that breaks off is no mistake of whoever wrote it.
                if line > 1 && !raw.ends_with(b"\n") {
                    return self.cut_short(Place::Byte(end), "before `end_header`");
                }
                self.syntax(line, expected, &text)
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
                    let element =
                        elements.last_mut().ok_or_else(|| wrong("`element` before its properties"))?;
                    element.properties.push(Property { name: name.to_owned(), list, item });
                }
                ["end_header"] => {
                    let encoding =
                        encoding.ok_or_else(|| wrong("a line `format` before the end of the header"))?;
                    return Ok(Header { encoding, elements: Elements(elements), end, lines: line });
                }
                _ => return Err(wrong("`format`, `element`, `property`, `comment` or `end_header`")),
            }
        }
        Err(self.cut_short(Place::Byte(end), "before `end_header`"))
    }
}

/// Gives the numbers of a body one after the other.
trait Numbers {
    fn next(&mut self, kind: Type) -> Result<f64, MeshError>;
    /// Where the last number was.
    fn place(&self) -> Place;
}

struct Text<'a, L> {
    file: &'a File<'a>,
    lines: L,
    words: SplitAsciiWhitespace<'a>,
    line: usize,
    /// Lines of the header.
    before: usize,
}

impl<'a, L: Iterator<Item = (usize, &'a str)>> Numbers for Text<'a, L> {
    fn next(&mut self, _: Type) -> Result<f64, MeshError> {
        loop {
            if let Some(word) = self.words.next() {
                let wrong = |_| self.file.syntax(self.line, "a number", word);
                return word.parse().map_err(wrong);
            }
            let Some((index, text)) = self.lines.next() else {
                return Err(self.file.cut_short(Place::Line(self.line), "where more numbers should follow"));
            };
            (self.line, self.words) = (self.before + index + 1, text.split_ascii_whitespace());
        }
    }

    fn place(&self) -> Place {
        Place::Line(self.line)
    }
}

struct Binary<'a> {
    file: &'a File<'a>,
    /// Of the byte behind the last number.
    at: usize,
    big: bool,
}

impl Numbers for Binary<'_> {
    fn next(&mut self, kind: Type) -> Result<f64, MeshError> {
        let size = kind.size();
        let Some(bytes) = self.file.bytes.get(self.at..self.at + size) else {
            let end = Place::Byte(self.file.bytes.len());
            return Err(self.file.cut_short(end, "where more numbers should follow"));
        };
        self.at += size;
        let mut number = [0; 8];
        number[..size].copy_from_slice(bytes);
        if self.big {
            number[..size].reverse();
        }
        Ok(kind.value(number))
    }

    fn place(&self) -> Place {
        Place::Byte(self.at)
    }
}

impl Elements {
    fn read(&self, file: &File, mut numbers: impl Numbers) -> Result<Vec<Corners>, MeshError> {
        let mut vertices: Vec<Vec3> = Vec::new();
        let mut soup = Vec::new();
        let mut row = Vec::new();
        for element in self.0.iter().filter(|e| !e.properties.is_empty()) {
            let find = |names: &[&str]| {
                element.properties.iter().position(|p| names.contains(&p.name.to_ascii_lowercase().as_str()))
            };
            let missing = |what: &'static str| file.syntax(1, what, &format!("element {}", element.name));
            match element.name.as_str() {
                "vertex" => {
                    let at = [find(&["x"]), find(&["y"]), find(&["z"])];
                    let [Some(x), Some(y), Some(z)] = at else {
                        return Err(missing("vertices with the properties x, y and z"));
                    };
                    for _ in 0..element.count {
                        let mut point = [0.0; 3];
                        for (k, property) in element.properties.iter().enumerate() {
                            property.read(&mut numbers, &mut row)?;
                            if let (Some(axis), None) =
                                ([x, y, z].iter().position(|p| *p == k), property.list)
                            {
                                point[axis] = row[0];
                            }
                        }
                        if let Some(&value) = point.iter().find(|c| !c.is_finite()) {
                            let (path, place) = (file.path.into(), numbers.place());
                            return Err(MeshError::NotFinite { path, place, value });
                        }
                        vertices.push(point);
                    }
                }
                "face" => {
                    let corners = find(&["vertex_indices", "vertex_index"])
                        .filter(|k| element.properties[*k].list.is_some())
                        .ok_or_else(|| missing("faces with a list vertex_indices or vertex_index"))?;
                    let mut polygon = Vec::new();
                    for _ in 0..element.count {
                        for (k, property) in element.properties.iter().enumerate() {
                            property.read(&mut numbers, &mut row)?;
                            if k != corners {
                                continue;
                            }
                            polygon.clear();
                            for &index in &row {
                                polygon.push(corner(file, &vertices, index, numbers.place())?);
                            }
                        }
                        if !polygon::triangulate(&polygon, &mut soup) {
                            let (path, place) = (file.path.into(), numbers.place());
                            return Err(MeshError::Polygon { path, place, corners: polygon.len() });
                        }
                    }
                }
                _ => {
                    for property in (0..element.count).flat_map(|_| &element.properties) {
                        property.read(&mut numbers, &mut row)?;
                    }
                }
            }
        }
        Ok(soup)
    }
}

fn corner(file: &File, vertices: &[Vec3], index: f64, place: Place) -> Result<Vec3, MeshError> {
    let vertex = (index >= 0.0 && index.fract() == 0.0).then(|| vertices.get(index as usize)).flatten();
    vertex.copied().ok_or_else(|| MeshError::VertexIndex {
        path: file.path.into(),
        place,
        index,
        vertices: vertices.len(),
    })
}

impl Property {
    /// Puts the number, or the numbers of the list, into `row`.
    fn read(&self, numbers: &mut impl Numbers, row: &mut Vec<f64>) -> Result<(), MeshError> {
        row.clear();
        // Lengths that are no counts have no entries; what follows then does not fit.
        let length = match self.list {
            Some(length) => numbers.next(length)?,
            None => 1.0,
        };
        for _ in 0..length as u64 {
            row.push(numbers.next(self.item)?);
        }
        Ok(())
    }
}
