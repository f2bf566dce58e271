//! Reads the points of VTK's XML files: UnstructuredGrid (`.vtu`) and PolyData (`.vtp`), their arrays as text,
//! base64 or raw bytes, inline or appended, compressed with zlib or not, in either byte order.
//!
//! Format: "VTK XML Formats", <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.

use std::io::Read;

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::read::ZlibDecoder;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Points and what is known of each.
#[derive(Debug, Default)]
pub(crate) struct Points {
    /// Coordinates.
    pub position: Vec<[f64; 3]>,
    /// Arrays of the names that were wanted.
    pub arrays: Vec<Array>,
    /// Names of the others.
    pub others: Vec<String>,
}

/// Numbers of one name, so many for each point.
#[derive(Debug)]
pub(crate) struct Array {
    pub name: String,
    pub components: usize,
    pub values: Vec<f64>,
}

/// What is wrong with a file, and where.
#[derive(Debug)]
pub(crate) struct Fault {
    /// Line, from 1.
    pub line: usize,
    pub what: String,
}

/// Reads the points of all pieces and their arrays that are `wanted`.
pub(crate) fn read(bytes: &[u8], wanted: impl Fn(&str) -> bool) -> Result<Points, Fault> {
    // Raw appended data are no XML, and nothing that is needed follows them.
    const APPENDED: &[u8] = b"<AppendedData";
    let end = bytes.windows(APPENDED.len()).position(|w| w == APPENDED);
    let (xml, appended) = bytes.split_at(end.unwrap_or(bytes.len()));
    let text = str::from_utf8(xml).map_err(|e| Fault {
        line: line_at(xml, e.valid_up_to()),
        what: "this is neither text nor where such a file holds other data".to_owned(),
    })?;
    let mut walk = Walk { wanted: &wanted, appended: Stored::appended(appended), ..Walk::new() };
    let mut reader = Reader::from_str(text);
    loop {
        let event = reader.read_event();
        let line = |at: u64| line_at(xml, at as usize);
        let fault =
            |what: String| Fault { line: line(reader.error_position().max(reader.buffer_position())), what };
        match event.map_err(|e| fault(format!("this is not XML: {e}")))? {
            Event::Start(tag) => walk.begin(&tag).map_err(fault)?,
            Event::Empty(tag) => {
                let done = walk.begin(&tag).and_then(|()| walk.end(tag.name().as_ref()));
                done.map_err(fault)?;
            }
            Event::End(tag) => walk.end(tag.name().as_ref()).map_err(fault)?,
            // What elements inside of an array hold, VTK's notes on its range, is not of it.
            Event::Text(text) if walk.inside == 0 => walk.content.push_str(&text),
            Event::Eof => return walk.finish().map_err(fault),
            _ => {}
        }
    }
}

fn line_at(bytes: &[u8], at: usize) -> usize {
    bytes[..at.min(bytes.len())].split(|b| *b == b'\n').count()
}

/// How numbers are stored.
#[derive(Clone, Copy, Debug)]
enum Type {
    Signed(usize),
    Unsigned(usize),
    F32,
    F64,
}

impl Type {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "Int8" => Self::Signed(1),
            "Int16" => Self::Signed(2),
            "Int32" => Self::Signed(4),
            "Int64" => Self::Signed(8),
            "UInt8" => Self::Unsigned(1),
            "UInt16" => Self::Unsigned(2),
            "UInt32" => Self::Unsigned(4),
            "UInt64" => Self::Unsigned(8),
            "Float32" => Self::F32,
            "Float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::Signed(size) | Self::Unsigned(size) => size,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn value(self, bytes: &[u8], big: bool) -> f64 {
        let word = word(bytes, big);
        match self {
            Self::Unsigned(_) => word as f64,
            Self::Signed(size) => {
                let unused = 64 - 8 * size as u32;
                ((word << unused) as i64 >> unused) as f64
            }
            Self::F32 => f64::from(f32::from_bits(word as u32)),
            Self::F64 => f64::from_bits(word),
        }
    }
}

/// The number that at most eight bytes make.
fn word(bytes: &[u8], big: bool) -> u64 {
    let put = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
    if big { bytes.iter().fold(0, put) } else { bytes.iter().rev().fold(0, put) }
}

/// What the file says of itself.
#[derive(Clone, Copy, Debug, Default)]
struct Layout {
    big: bool,
    /// Bytes of the words before data.
    header: usize,
    zipped: bool,
}

/// A `DataArray` that is being read.
#[derive(Debug)]
struct Open {
    name: String,
    kind: Type,
    components: usize,
    format: String,
    offset: usize,
    section: Section,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    Other,
    Points,
    PointData,
}

struct Walk<'a> {
    wanted: &'a dyn Fn(&str) -> bool,
    appended: Option<Stored<'a>>,
    layout: Option<Layout>,
    section: Section,
    /// Points of the piece.
    count: usize,
    open: Option<Open>,
    /// Depth of elements inside of it.
    inside: usize,
    content: String,
    points: Points,
}

impl Walk<'_> {
    fn new() -> Self {
        Self {
            wanted: &|_| false,
            appended: None,
            layout: None,
            section: Section::Other,
            count: 0,
            open: None,
            inside: 0,
            content: String::new(),
            points: Points::default(),
        }
    }

    fn begin(&mut self, tag: &BytesStart) -> Result<(), String> {
        if self.open.is_some() {
            self.inside += 1;
            return Ok(());
        }
        let name = tag.name();
        match name.as_ref() {
            "VTKFile" => self.layout = Some(layout(tag)?),
            "Piece" => {
                let count = attribute(tag, "NumberOfPoints")?.ok_or("this piece has no NumberOfPoints")?;
                self.count =
                    count.parse().map_err(|_| format!("NumberOfPoints is `{count}`, not a count"))?;
            }
            "Points" => self.section = Section::Points,
            "PointData" => self.section = Section::PointData,
            "DataArray" if self.section != Section::Other => {
                self.content.clear();
                self.open = Some(self.data_array(tag)?);
            }
            _ => {}
        }
        Ok(())
    }

    fn data_array(&self, tag: &BytesStart) -> Result<Open, String> {
        let text = |key: &str| Ok::<_, String>(attribute(tag, key)?.unwrap_or_default());
        let number = |key: &str, default: usize| match attribute(tag, key)? {
            Some(value) => value.parse().map_err(|_| format!("{key} is `{value}`, not a number")),
            None => Ok(default),
        };
        let kind = text("type")?;
        Ok(Open {
            name: text("Name")?,
            kind: Type::of(&kind).ok_or_else(|| format!("`{kind}` is not a type of numbers"))?,
            components: number("NumberOfComponents", 1)?,
            format: text("format")?,
            offset: number("offset", 0)?,
            section: self.section,
        })
    }

    fn end(&mut self, name: &str) -> Result<(), String> {
        if self.inside > 0 {
            self.inside -= 1;
            return Ok(());
        }
        match name {
            "DataArray" => {
                if let Some(open) = self.open.take() {
                    let content = std::mem::take(&mut self.content);
                    let name = if open.name.is_empty() {
                        "the array".to_owned()
                    } else {
                        format!("`{}`", open.name)
                    };
                    self.array(open, &content).map_err(|what| format!("{name} {what}"))?;
                }
            }
            "Points" | "PointData" => self.section = Section::Other,
            _ => {}
        }
        Ok(())
    }

    fn array(&mut self, open: Open, content: &str) -> Result<(), String> {
        if open.section == Section::Points {
            if open.components != 3 {
                return Err(format!("has {} coordinates for each point instead of 3", open.components));
            }
            let values = self.values(&open, content)?;
            self.points.position.extend(values.as_chunks().0);
            return Ok(());
        }
        if !(self.wanted)(&open.name) {
            if !self.points.others.contains(&open.name) {
                self.points.others.push(open.name);
            }
            return Ok(());
        }
        let values = self.values(&open, content)?;
        let Open { name, components, .. } = open;
        match self.points.arrays.iter_mut().find(|a| a.name == name) {
            Some(array) if array.components == components => array.values.extend(values),
            Some(_) => return Err("has another number of components than in the piece before".to_owned()),
            None => self.points.arrays.push(Array { name, components, values }),
        }
        Ok(())
    }

    fn values(&self, open: &Open, content: &str) -> Result<Vec<f64>, String> {
        let layout = self.layout.ok_or("stands outside of a VTKFile")?;
        let size = open.kind.size();
        let number = self.count.checked_mul(open.components).filter(|n| n.checked_mul(size).is_some());
        let number = number.ok_or("cannot be that long")?;
        let bytes = match open.format.as_str() {
            "" | "ascii" => return numbers(content, number),
            "binary" => {
                let packed: Vec<u8> = content.bytes().filter(|b| !b.is_ascii_whitespace()).collect();
                Stored { bytes: &packed, base64: true }.read(0, number * size, layout)?
            }
            "appended" => {
                let stored =
                    self.appended.ok_or("is appended, but the file ends before the appended data")?;
                stored.read(open.offset, number * size, layout)?
            }
            other => return Err(format!("has the format `{other}`; known are ascii, binary and appended")),
        };
        Ok(bytes.chunks_exact(size).map(|b| open.kind.value(b, layout.big)).collect())
    }

    fn finish(self) -> Result<Points, String> {
        if self.layout.is_none() {
            return Err("there is no element VTKFile".to_owned());
        }
        if self.open.is_some() {
            return Err("the file is cut short: it ends within an array".to_owned());
        }
        let count = self.points.position.len();
        for Array { name, components, values } in &self.points.arrays {
            if Some(values.len()) != components.checked_mul(count) {
                return Err(format!(
                    "`{name}` has {} values of {components} for {count} points",
                    values.len()
                ));
            }
        }
        Ok(self.points)
    }
}

fn attribute(tag: &BytesStart, key: &str) -> Result<Option<String>, String> {
    let found = tag.try_get_attribute(key).map_err(|e| format!("this is not XML: {e}"))?;
    Ok(found.map(|a| a.value.into_owned()))
}

fn layout(tag: &BytesStart) -> Result<Layout, String> {
    let text = |key: &str| Ok::<_, String>(attribute(tag, key)?.unwrap_or_default());
    let kind = text("type")?;
    if !["UnstructuredGrid", "PolyData"].contains(&kind.as_str()) {
        return Err(format!("this holds `{kind}`; particles are read from UnstructuredGrid and PolyData"));
    }
    let zipped = match text("compressor")?.as_str() {
        "" => false,
        "vtkZLibDataCompressor" => true,
        other => {
            return Err(format!(
                "`{other}` cannot be unpacked: save the file without compression or with ZLib"
            ));
        }
    };
    let header = if text("header_type")? == "UInt64" { 8 } else { 4 };
    Ok(Layout { big: text("byte_order")? == "BigEndian", header, zipped })
}

/// So many numbers, no more and no fewer.
fn numbers(content: &str, number: usize) -> Result<Vec<f64>, String> {
    let mut values = Vec::new();
    for word in content.split_ascii_whitespace() {
        values.push(word.parse().map_err(|_| format!("holds `{word}`, which is not a number"))?);
    }
    if values.len() != number {
        return Err(format!("has {} values where {number} should be", values.len()));
    }
    Ok(values)
}

/// Binary data as the file holds them.
#[derive(Clone, Copy)]
struct Stored<'a> {
    bytes: &'a [u8],
    base64: bool,
}

const CUT_SHORT: &str = "is cut short: the file ends before its data do";

impl<'a> Stored<'a> {
    /// What the element `AppendedData` holds: behind its first underscore.
    fn appended(element: &'a [u8]) -> Option<Self> {
        let tag_end = element.iter().position(|b| *b == b'>')?;
        let start = tag_end + element[tag_end..].iter().position(|b| *b == b'_')? + 1;
        let base64 = element[..tag_end].windows(6).any(|w| w == b"base64");
        Some(Self { bytes: &element[start..], base64 })
    }

    /// The `length` bytes of the array at `offset`.
    fn read(self, offset: usize, length: usize, layout: Layout) -> Result<Vec<u8>, String> {
        let own = Self { bytes: self.bytes.get(offset..).ok_or(CUT_SHORT)?, ..self };
        let size = layout.header;
        let word_at = |head: &[u8], k: usize| {
            let bytes = head.get(k * size..(k + 1) * size).unwrap_or_default();
            usize::try_from(word(bytes, layout.big)).unwrap_or(usize::MAX)
        };
        let other = |found: usize| format!("has {found} bytes where {length} should be");
        if !layout.zipped {
            let found = word_at(&own.head(size)?, 0);
            return if found == length { own.body(size, length) } else { Err(other(found)) };
        }
        // Number of blocks, size of each, size of a last shorter one (0 if there is none), packed sizes.
        let head = own.head(3 * size)?;
        let [blocks, block, last] = [0, 1, 2].map(|k| word_at(&head, k));
        let size_of = |k: usize| if k + 1 == blocks && last > 0 { last } else { block };
        let whole = blocks - usize::from(last > 0 && blocks > 0);
        let found = whole.saturating_mul(block).saturating_add(if blocks > 0 { last } else { 0 });
        if found != length {
            return Err(other(found));
        }
        let head_length = blocks.checked_add(3).and_then(|n| n.checked_mul(size)).ok_or(CUT_SHORT)?;
        let head = own.head(head_length)?;
        let packed: Vec<usize> = (0..blocks).map(|k| word_at(&head, 3 + k)).collect();
        let all = packed.iter().fold(0, |sum: usize, n| sum.saturating_add(*n));
        let body = own.body(head_length, all)?;
        let mut rest = body.as_slice();
        let mut out = Vec::new();
        for (k, n) in packed.into_iter().enumerate() {
            let (one, more) = rest.split_at_checked(n).ok_or(CUT_SHORT)?;
            rest = more;
            let before = out.len();
            // A byte more shows a block that is too long.
            let unpacked = ZlibDecoder::new(one).take(size_of(k) as u64 + 1).read_to_end(&mut out);
            unpacked.map_err(|e| format!("cannot be unpacked: {e}"))?;
            if out.len() - before != size_of(k) {
                return Err(format!("has a block {k} that is not {} bytes long", size_of(k)));
            }
        }
        Ok(out)
    }

    /// The first `length` bytes.
    fn head(self, length: usize) -> Result<Vec<u8>, String> {
        if self.base64 { decode(self.bytes, length) } else { self.body(0, length) }
    }

    /// The `length` bytes behind the first `before`, which may be encoded apart or together with them.
    fn body(self, before: usize, length: usize) -> Result<Vec<u8>, String> {
        let end = before.checked_add(length).ok_or(CUT_SHORT)?;
        if !self.base64 {
            return Ok(self.bytes.get(before..end).ok_or(CUT_SHORT)?.to_vec());
        }
        let apart = self.bytes.get(..encoded(before)).ok_or(CUT_SHORT)?;
        if before.is_multiple_of(3) || apart.ends_with(b"=") {
            return decode(&self.bytes[apart.len()..], length);
        }
        let mut both = decode(self.bytes, end)?;
        Ok(both.split_off(before))
    }
}

/// Characters that so many bytes take in base64.
fn encoded(length: usize) -> usize {
    length.div_ceil(3).saturating_mul(4)
}

/// The first `length` bytes of a text.
fn decode(text: &[u8], length: usize) -> Result<Vec<u8>, String> {
    let text = text.get(..encoded(length)).ok_or(CUT_SHORT)?;
    let mut bytes = STANDARD.decode(text).map_err(|e| format!("is not base64: {e}"))?;
    if bytes.len() < length {
        return Err(CUT_SHORT.to_owned());
    }
    bytes.truncate(length);
    Ok(bytes)
}
