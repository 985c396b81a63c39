//! netCDF classic: a variable over latitude and longitude, read by bands of rows.

use super::blocks::{Block, BlockLayout, BlockReader};
use super::netcdf_header::{Header, Kind, Variable};
use super::samples::{Conditions, SampleKind, block_of, block_of_i16};
use crate::prepare::PrepareError;
use crate::prepare::crs::Affine;
use crate::prepare::source::{ReadSeek, SourceFile};
use std::io::{Read, SeekFrom};

/// One two-dimensional variable of a file.
#[derive(Debug)]
pub struct NetCdf {
    file: SourceFile,
    conditions: Conditions,
    variable: Variable,
    layout: BlockLayout,
    /// height = sample · scale + offset (CF conventions §8.1).
    scale: f64,
    offset: f64,
    pub affine: Affine,
}

/// Blocks are bands of about this many samples.
const BLOCK_SAMPLES: u32 = 1 << 18;

impl NetCdf {
    /// `layer` names the variable; without it, the first over two axes.
    pub fn open(file: &SourceFile, layer: Option<&str>, mut conditions: Conditions) -> Result<Self, PrepareError> {
        let bytes = file.bytes()?;
        let mut reader = file.open()?;
        let mut header = Header::read(&mut *reader, bytes).map_err(|e| PrepareError::damaged(file, "header", e))?;
        let index = pick(file, &header, layer)?;
        let (lat0, lat_step, rows) = axis(file, &header, &mut *reader, header.variables[index].dimensions[0], bytes)?;
        let (lon0, lon_step, cols) = axis(file, &header, &mut *reader, header.variables[index].dimensions[1], bytes)?;
        let variable = header.variables.swap_remove(index);
        let place = format!("variable {}", variable.name);
        if u64::from(rows) * u64::from(cols) * variable.kind.bytes() + variable.begin > bytes {
            return Err(PrepareError::damaged(
                file,
                place,
                format!("{bytes} bytes are too few for {rows} × {cols} samples"),
            ));
        }
        let last_lat = lat0 + lat_step * f64::from(rows - 1);
        if lat0.abs().max(last_lat.abs()) > 90.0 + 1e-3 {
            let what = format!("its first axis runs from {lat0} to {last_lat}: that is no latitude");
            return Err(PrepareError::value(file, place, what, "give `layer`, a variable over (lat, lon)"));
        }
        sample_kind(variable.kind).check_nodata(conditions.nodata, &file.to_string())?;
        let attribute = |name: &str| variable.attributes.iter().find(|a| a.0 == name).map(|a| a.1);
        conditions.nodata = conditions.nodata.or(attribute("_FillValue")).or(attribute("missing_value"));
        let (scale, offset) = (attribute("scale_factor").unwrap_or(1.0), attribute("add_offset").unwrap_or(0.0));
        let affine = Affine { a: lon_step, b: 0.0, c: lon0, d: 0.0, e: lat_step, f: lat0 };
        let block_rows = (BLOCK_SAMPLES / cols).clamp(1, rows);
        let layout = BlockLayout { rows, cols, block_rows, block_cols: cols };
        Ok(Self { file: file.clone(), conditions, variable, layout, scale, offset, affine })
    }
}

impl BlockReader for NetCdf {
    fn layout(&self) -> BlockLayout {
        self.layout
    }

    fn read(&self, block: u32) -> Result<Block, PrepareError> {
        let extent = self.layout.extent(block);
        let kind = self.variable.kind;
        let begin = self.variable.begin + u64::from(extent.row) * u64::from(extent.cols) * kind.bytes();
        let count = u64::from(extent.rows) * u64::from(extent.cols);
        let bytes = read_at(&mut *self.file.open()?, begin, count * kind.bytes()).map_err(|e| {
            PrepareError::damaged(&self.file, format!("variable {}, row {}", self.variable.name, extent.row), e)
        })?;
        let samples = bytes.chunks_exact(kind.bytes() as usize).map(|b| kind.sample(b));
        let plain = self.scale == 1.0 && self.offset == 0.0;
        let made = if plain && kind == Kind::I16 {
            block_of_i16(samples.map(|v| v as i16).collect(), &self.conditions)
        } else {
            // The file's nodata is a raw value, heights are scaled.
            let nodata = self.conditions.nodata.map(|v| v as f32);
            let height = |v: f64| if nodata == Some(v as f32) { f64::NAN } else { v * self.scale + self.offset };
            block_of(samples.map(height), &Conditions { nodata: None, ..self.conditions })
        };
        made.map_err(|bad| {
            let (row, col) = (bad.index as u32 / extent.cols, bad.index as u32 % extent.cols);
            bad.into_error(&self.file.to_string(), extent.row + row, col)
        })
    }
}

fn read_at(reader: &mut dyn ReadSeek, begin: u64, count: u64) -> std::io::Result<Vec<u8>> {
    reader.seek(SeekFrom::Start(begin))?;
    let mut bytes = Vec::new();
    if reader.take(count).read_to_end(&mut bytes)? as u64 != count {
        return Err(std::io::ErrorKind::UnexpectedEof.into());
    }
    Ok(bytes)
}

fn pick(file: &SourceFile, header: &Header, layer: Option<&str>) -> Result<usize, PrepareError> {
    let plane = |v: &Variable| v.dimensions.len() == 2 && v.kind != Kind::Char;
    let placed = |v: &Variable| v.dimensions.iter().all(|&d| header.axis(d).is_some());
    let found = match layer {
        Some(name) => header.variables.iter().position(|v| v.name == name && plane(v) && placed(v)),
        None => header.variables.iter().position(|v| plane(v) && placed(v)),
    };
    found.ok_or_else(|| {
        let names = header.variables.iter().map(|v| v.name.as_str()).collect::<Vec<_>>().join(", ");
        let wanted = layer.map_or("no variable".to_owned(), |name| format!("no variable {name:?}"));
        let what = format!("it has {wanted} over (latitude, longitude); it has {names}");
        PrepareError::value(file, "header", what, "give `layer`, the name of the variable with heights")
    })
}

fn sample_kind(kind: Kind) -> SampleKind {
    match kind {
        Kind::I8 | Kind::Char => SampleKind::I8,
        Kind::I16 => SampleKind::I16,
        Kind::I32 => SampleKind::I32,
        Kind::F32 => SampleKind::F32,
        Kind::F64 => SampleKind::F64,
    }
}

/// Coordinates may be off by this part of a step, by rounding.
const EVEN: f64 = 0.05;

/// First coordinate, step and count of a dimension's axis, which must be even.
fn axis(
    file: &SourceFile,
    header: &Header,
    reader: &mut dyn ReadSeek,
    dimension: usize,
    file_bytes: u64,
) -> Result<(f64, f64, u32), PrepareError> {
    let count = header.dimensions[dimension].length;
    let place = format!("axis {}", header.dimensions[dimension].name);
    let missing = || PrepareError::damaged(file, &place, "it has no coordinates");
    let variable = header.axis(dimension).ok_or_else(missing)?;
    if !(2..=1 << 24).contains(&count) || count * variable.kind.bytes() > file_bytes {
        let what = format!("{count} coordinates (records are not read)");
        return Err(PrepareError::damaged(file, place, what));
    }
    let bytes = read_at(reader, variable.begin, count * variable.kind.bytes())
        .map_err(|e| PrepareError::damaged(file, &place, e))?;
    let values: Vec<f64> =
        bytes.chunks_exact(variable.kind.bytes() as usize).map(|b| variable.kind.sample(b)).collect();
    let (first, last) = (values[0], values[values.len() - 1]);
    let mut step = (last - first) / (count - 1) as f64;
    // Rounded coordinates (ETOPO5 ends at 359.92) are off by a little: where the count of steps goes round, it is meant.
    let round = (360.0 / step.abs()).round();
    if (count as f64 == round || count as f64 == round + 1.0) && (round * step.abs() - 360.0).abs() < step.abs() * EVEN
    {
        step = 360.0 / round * step.signum();
    }
    let even = |(i, v): (usize, &f64)| (first + i as f64 * step - v).abs() <= step.abs() * EVEN;
    if step == 0.0 || !step.is_finite() || !values.iter().enumerate().all(even) {
        let what = format!("coordinates that are not even (a step of {step} was expected)");
        return Err(PrepareError::unsupported(file, place, what, "resample it with gdalwarp"));
    }
    Ok((first, step, count as u32))
}
