//! The header of netCDF classic files (NetCDF users' guide, "File Format Specifications": CDF-1 and CDF-2). Counts in
//! it are believed only as far as the file has bytes for them.

use crate::prepare::source::ReadSeek;
use std::io::{self, Read};

/// What a file has.
#[derive(Debug)]
pub struct Header {
    pub dimensions: Vec<Dimension>,
    pub variables: Vec<Variable>,
}

#[derive(Debug)]
pub struct Dimension {
    pub name: String,
    /// 0 for the one that records grow along.
    pub length: u64,
}

#[derive(Debug)]
pub struct Variable {
    pub name: String,
    /// Indices of dimensions, slowest first.
    pub dimensions: Vec<usize>,
    /// Numeric attributes' first values.
    pub attributes: Vec<(String, f64)>,
    pub kind: Kind,
    /// Offset of its samples in the file, bytes.
    pub begin: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    I8,
    Char,
    I16,
    I32,
    F32,
    F64,
}

impl Kind {
    fn from_code(code: u32) -> io::Result<Self> {
        Ok(match code {
            1 => Self::I8,
            2 => Self::Char,
            3 => Self::I16,
            4 => Self::I32,
            5 => Self::F32,
            6 => Self::F64,
            other => return Err(bad(format!("there is no type {other}"))),
        })
    }

    pub fn bytes(self) -> u64 {
        match self {
            Self::I8 | Self::Char => 1,
            Self::I16 => 2,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The sample in as many big-endian bytes as it has.
    pub fn sample(self, b: &[u8]) -> f64 {
        match (self, b) {
            (Self::I8 | Self::Char, &[a]) => f64::from(i8::from_be_bytes([a])),
            (Self::I16, &[a, b]) => f64::from(i16::from_be_bytes([a, b])),
            (Self::I32, &[a, b, c, d]) => f64::from(i32::from_be_bytes([a, b, c, d])),
            (Self::F32, &[a, b, c, d]) => f64::from(f32::from_be_bytes([a, b, c, d])),
            (Self::F64, &[a, b, c, d, e, f, g, h]) => f64::from_be_bytes([a, b, c, d, e, f, g, h]),
            _ => f64::NAN,
        }
    }
}

impl Header {
    /// Reads the header of a file of `file_bytes`.
    pub fn read(reader: &mut dyn ReadSeek, file_bytes: u64) -> io::Result<Self> {
        let mut cursor = Cursor { reader, left: file_bytes };
        let magic = cursor.bytes(4)?;
        let wide = match magic[..] {
            [b'C', b'D', b'F', 1] => false,
            [b'C', b'D', b'F', 2] => true,
            _ => return Err(bad("no netCDF classic file; netCDF-4 is converted with `nccopy -k classic`".to_owned())),
        };
        let _records = cursor.word()?;
        let dimensions = cursor.list(DIMENSIONS, |c| Ok(Dimension { name: c.name()?, length: c.word()?.into() }))?;
        cursor.attributes()?;
        let variables = cursor.list(VARIABLES, |c| c.variable(wide, dimensions.len()))?;
        Ok(Self { dimensions, variables })
    }

    pub fn variable(&self, name: &str) -> Option<&Variable> {
        self.variables.iter().find(|v| v.name == name)
    }

    /// The variable with the coordinates of a dimension.
    pub fn axis(&self, dimension: usize) -> Option<&Variable> {
        let name = &self.dimensions.get(dimension)?.name;
        self.variables.iter().find(|v| v.name == *name && v.dimensions == [dimension])
    }
}

const DIMENSIONS: u32 = 10;
const VARIABLES: u32 = 11;
const ATTRIBUTES: u32 = 12;

struct Cursor<'a> {
    reader: &'a mut dyn ReadSeek,
    left: u64,
}

impl Cursor<'_> {
    fn bytes(&mut self, count: u64) -> io::Result<Vec<u8>> {
        self.left = self.left.checked_sub(count).ok_or_else(|| bad("the header is cut off".to_owned()))?;
        let mut bytes = Vec::new();
        if (&mut *self.reader).take(count).read_to_end(&mut bytes)? as u64 != count {
            return Err(bad("the header is cut off".to_owned()));
        }
        Ok(bytes)
    }

    fn word(&mut self) -> io::Result<u32> {
        let b = self.bytes(4)?;
        Ok(u32::from_be_bytes([b[0], b[1], b[2], b[3]]))
    }

    /// Bytes, and what fills them up to a multiple of four.
    fn padded(&mut self, count: u64) -> io::Result<Vec<u8>> {
        let mut bytes = self.bytes(count.div_ceil(4) * 4)?;
        bytes.truncate(count as usize);
        Ok(bytes)
    }

    fn name(&mut self) -> io::Result<String> {
        let length = self.word()?;
        Ok(String::from_utf8_lossy(&self.padded(length.into())?).into_owned())
    }

    fn list<T>(&mut self, tag: u32, mut one: impl FnMut(&mut Self) -> io::Result<T>) -> io::Result<Vec<T>> {
        let (found, count) = (self.word()?, self.word()?);
        if found != tag && (found, count) != (0, 0) {
            return Err(bad(format!("a list of kind {found} instead of {tag}")));
        }
        let mut all = Vec::new();
        for _ in 0..count {
            all.push(one(self)?);
        }
        Ok(all)
    }

    fn attributes(&mut self) -> io::Result<Vec<(String, f64)>> {
        let all = self.list(ATTRIBUTES, |c| {
            let (name, kind, count) = (c.name()?, Kind::from_code(c.word()?)?, c.word()?);
            let values = c.padded(kind.bytes() * u64::from(count))?;
            let first = values.get(..kind.bytes() as usize).filter(|_| kind != Kind::Char);
            Ok(first.map(|bytes| (name, kind.sample(bytes))))
        })?;
        Ok(all.into_iter().flatten().collect())
    }

    fn variable(&mut self, wide: bool, dimension_count: usize) -> io::Result<Variable> {
        let name = self.name()?;
        let mut dimensions = Vec::new();
        for _ in 0..self.word()? {
            let index = self.word()? as usize;
            if index >= dimension_count {
                return Err(bad(format!("variable {name} has a dimension {index}, of {dimension_count}")));
            }
            dimensions.push(index);
        }
        let (attributes, kind) = (self.attributes()?, Kind::from_code(self.word()?)?);
        let _bytes = self.word()?;
        let begin = if wide { u64::from(self.word()?) << 32 | u64::from(self.word()?) } else { self.word()?.into() };
        Ok(Variable { name, dimensions, attributes, kind, begin })
    }
}

fn bad(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}
