//! netCDF classic (NetCDF users' guide, "File Format Specifications", CDF-1 and CDF-2): a variable over latitude and
//! longitude. Decoded whole: one block.

use super::blocks::{Block, BlockLayout, BlockReader};
use super::samples::{Conditions, SampleKind, block_of, block_of_i16};
use crate::prepare::PrepareError;
use crate::prepare::crs::Affine;
use crate::prepare::source::SourceFile;
use netcdf3::{DataSet, DataType, DataVector, FileReader, Variable};

/// One two-dimensional variable of a file.
#[derive(Debug)]
pub struct NetCdf {
    file: SourceFile,
    conditions: Conditions,
    variable: String,
    rows: u32,
    cols: u32,
    /// height = sample · scale + offset (CF conventions §8.1).
    scale: f64,
    offset: f64,
    pub affine: Affine,
}

impl NetCdf {
    /// `layer` names the variable; without it, the first over two axes.
    pub fn open(file: &SourceFile, layer: Option<&str>, mut conditions: Conditions) -> Result<Self, PrepareError> {
        let mut reader = reader(file)?;
        let variable = pick(file, reader.data_set(), layer)?;
        let axes = variable.dim_names();
        let (name, kind) = (variable.name().to_owned(), sample_kind(&variable.data_type()));
        kind.check_nodata(conditions.nodata, &file.to_string())?;
        let fill = attribute(variable, "_FillValue").or_else(|| attribute(variable, "missing_value"));
        conditions.nodata = conditions.nodata.or(fill);
        let scale = attribute(variable, "scale_factor").unwrap_or(1.0);
        let offset = attribute(variable, "add_offset").unwrap_or(0.0);
        let (lat0, lat_step, rows) = axis(file, &mut reader, &axes[0])?;
        let (lon0, lon_step, cols) = axis(file, &mut reader, &axes[1])?;
        if lat0.abs() > 90.0 + 1e-6 {
            let what = format!("axis {} starts at {lat0}: it is no latitude", axes[0]);
            return Err(PrepareError::value(
                file,
                format!("variable {name}"),
                what,
                "give `layer`, a variable over (lat, lon)",
            ));
        }
        let affine = Affine { a: lon_step, b: 0.0, c: lon0, d: 0.0, e: lat_step, f: lat0 };
        Ok(Self { file: file.clone(), conditions, variable: name, rows, cols, scale, offset, affine })
    }
}

impl BlockReader for NetCdf {
    fn layout(&self) -> BlockLayout {
        BlockLayout { rows: self.rows, cols: self.cols, block_rows: self.rows, block_cols: self.cols }
    }

    fn read(&self, _block: u32) -> Result<Block, PrepareError> {
        let place = format!("variable {}", self.variable);
        let samples =
            reader(&self.file)?.read_var(&self.variable).map_err(|e| PrepareError::damaged(&self.file, &place, e))?;
        let plain = self.scale == 1.0 && self.offset == 0.0;
        let nodata = self.conditions.nodata;
        // nodata is a raw value, heights are scaled.
        let scaled = |v: f64| if nodata == Some(v) { f64::NAN } else { v * self.scale + self.offset };
        let unmarked = Conditions { nodata: nodata.filter(|_| plain), ..self.conditions };
        let block = match samples {
            DataVector::I16(s) if plain => block_of_i16(s, &self.conditions),
            DataVector::I8(s) => block_of(s.into_iter().map(|v| scaled(v.into())), &unmarked),
            DataVector::U8(s) => block_of(s.into_iter().map(|v| scaled(v.into())), &unmarked),
            DataVector::I16(s) => block_of(s.into_iter().map(|v| scaled(v.into())), &unmarked),
            DataVector::I32(s) => block_of(s.into_iter().map(|v| scaled(v.into())), &unmarked),
            DataVector::F32(s) => block_of(s.into_iter().map(|v| scaled(v.into())), &unmarked),
            DataVector::F64(s) => block_of(s.into_iter().map(scaled), &unmarked),
        };
        let block = block.map_err(|bad| {
            bad.into_error(&self.file.to_string(), bad.index as u32 / self.cols, bad.index as u32 % self.cols)
        })?;
        if block.len() != (self.rows * self.cols) as usize {
            return Err(PrepareError::damaged(&self.file, place, format!("{} samples", block.len())));
        }
        Ok(block)
    }
}

fn reader(file: &SourceFile) -> Result<FileReader, PrepareError> {
    let bytes = file.open()?;
    FileReader::open_seek_read(&file.name(), Box::new(bytes)).map_err(|e| {
        let what = format!("no netCDF classic header ({e}); netCDF-4 is converted with `nccopy -k classic`");
        PrepareError::damaged(file, "header", what)
    })
}

fn pick<'a>(file: &SourceFile, data: &'a DataSet, layer: Option<&str>) -> Result<&'a Variable, PrepareError> {
    let found = match layer {
        Some(name) => data.get_var(name).filter(|v| v.num_dims() == 2),
        None => {
            data.get_vars().into_iter().find(|v| v.num_dims() == 2 && v.dim_names().iter().all(|d| data.has_var(d)))
        }
    };
    found.ok_or_else(|| {
        let names = data.get_var_names().join(", ");
        let what = match layer {
            Some(name) => format!("no variable {name:?} over (latitude, longitude); it has {names}"),
            None => format!("no variable over (latitude, longitude); it has {names}"),
        };
        PrepareError::value(file, "header", what, "give `layer`, the name of the variable with heights")
    })
}

fn sample_kind(kind: &DataType) -> SampleKind {
    match kind {
        DataType::I8 => SampleKind::I8,
        DataType::U8 => SampleKind::U8,
        DataType::I16 => SampleKind::I16,
        DataType::I32 => SampleKind::I32,
        DataType::F32 => SampleKind::F32,
        DataType::F64 => SampleKind::F64,
    }
}

fn attribute(variable: &Variable, name: &str) -> Option<f64> {
    let first = |found: Option<f64>| found;
    first(variable.get_attr_f64(name).and_then(|v| v.first().copied()))
        .or_else(|| variable.get_attr_f32(name).and_then(|v| v.first().map(|&v| v.into())))
        .or_else(|| variable.get_attr_i32(name).and_then(|v| v.first().map(|&v| v.into())))
        .or_else(|| variable.get_attr_i16(name).and_then(|v| v.first().map(|&v| v.into())))
}

/// First coordinate, step and count of an axis, which must be even.
fn axis(file: &SourceFile, reader: &mut FileReader, name: &str) -> Result<(f64, f64, u32), PrepareError> {
    let place = format!("axis {name}");
    let values = match reader.read_var(name).map_err(|e| PrepareError::damaged(file, &place, e))? {
        DataVector::F64(v) => v,
        DataVector::F32(v) => v.into_iter().map(f64::from).collect(),
        DataVector::I32(v) => v.into_iter().map(f64::from).collect(),
        DataVector::I16(v) => v.into_iter().map(f64::from).collect(),
        DataVector::I8(v) => v.into_iter().map(f64::from).collect(),
        DataVector::U8(v) => v.into_iter().map(f64::from).collect(),
    };
    let (Some(&first), Some(&last)) = (values.first(), values.last()) else {
        return Err(PrepareError::damaged(file, place, "it is empty"));
    };
    let mut steps = (values.len() - 1) as f64;
    let mut span = last - first;
    // Single-precision coordinates are off by a little: whole spans (360° less a step, 180°) are meant.
    let step = span / steps;
    let round = (360.0 / step.abs()).round();
    if (round * step.abs() - 360.0).abs() < 1e-3 {
        (span, steps) = (360.0 * step.signum(), round);
    }
    let step = span / steps;
    let uneven = values.iter().enumerate().find(|(i, v)| (first + *i as f64 * step - **v).abs() > step.abs() * 0.01);
    match uneven {
        Some((i, v)) => {
            let what = format!("its value {v} at {i} breaks the even step of {step}");
            Err(PrepareError::unsupported(file, place, what, "resample it with gdalwarp"))
        }
        None if step == 0.0 || !step.is_finite() => Err(PrepareError::damaged(file, place, "it has no step")),
        None => Ok((first, step, values.len() as u32)),
    }
}
