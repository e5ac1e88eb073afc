//! Named arrays of numbers as other programs keep them: `.npz` of NumPy, `.safetensors`, a folder of PNG files.
//!
//! A reader survives any bytes, and reads one array after the other.

mod npy;
mod npz;
mod pictures;
mod tensors;
mod zip;

use std::path::Path;

use anyhow::{Context as _, bail, ensure};

use crate::store::Content;
pub use npz::NpzWriter;

/// The type of the numbers of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dtype {
    /// True or false, one byte each.
    Bool,
    /// Bytes.
    U8,
    /// Signed whole numbers of 1, 2, 4 or 8 bytes.
    Signed(usize),
    /// Whole numbers from 0 up of 2, 4 or 8 bytes.
    Unsigned(usize),
    /// Numbers of 4 bytes.
    F32,
    /// Numbers of 8 bytes.
    F64,
}

impl Dtype {
    /// Bytes of a number.
    pub fn size(self) -> usize {
        match self {
            Self::Bool | Self::U8 => 1,
            Self::F32 => 4,
            Self::F64 => 8,
            Self::Signed(size) | Self::Unsigned(size) => size,
        }
    }

    /// Whether the numbers are fractions.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

impl std::fmt::Display for Dtype {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bool => f.write_str("bool"),
            Self::U8 => f.write_str("uint8"),
            Self::F32 => f.write_str("float32"),
            Self::F64 => f.write_str("float64"),
            Self::Signed(size) => write!(f, "int{}", 8 * size),
            Self::Unsigned(size) => write!(f, "uint{}", 8 * size),
        }
    }
}

/// Numbers in row-major order, little-endian.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Array {
    /// Their type.
    pub dtype: Dtype,
    /// The length of each dimension.
    pub shape: Vec<usize>,
    /// Their bytes.
    pub bytes: Vec<u8>,
}

impl Array {
    /// An array whose bytes fit its shape.
    ///
    /// # Errors
    /// They do not.
    pub fn new(dtype: Dtype, shape: Vec<usize>, bytes: Vec<u8>) -> anyhow::Result<Self> {
        let count = shape.iter().try_fold(dtype.size(), |count, &length| count.checked_mul(length));
        ensure!(count == Some(bytes.len()), "{} bytes are no {dtype} of shape {shape:?}", bytes.len());
        Ok(Self { dtype, shape, bytes })
    }

    /// The numbers in double precision.
    pub fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        let dtype = self.dtype;
        self.bytes.chunks_exact(dtype.size()).map(move |bytes| match dtype {
            Dtype::Bool | Dtype::U8 => f64::from(bytes[0]),
            Dtype::F32 => f32::from_le_bytes(bytes.try_into().unwrap_or_default()).into(),
            Dtype::F64 => f64::from_le_bytes(bytes.try_into().unwrap_or_default()),
            Dtype::Unsigned(_) | Dtype::Signed(_) => {
                let is_negative = matches!(dtype, Dtype::Signed(_)) && bytes.last().is_some_and(|last| last >> 7 == 1);
                let mut wide = [if is_negative { 0xff } else { 0 }; 16];
                wide[..bytes.len()].copy_from_slice(bytes);
                i128::from_le_bytes(wide) as f64
            }
        })
    }
}

/// Arrays by name, which are read one by one.
pub trait Arrays {
    /// The names of all arrays.
    fn names(&self) -> Vec<String>;

    /// Reads an array.
    ///
    /// # Errors
    /// There is none of this name, or it cannot be read.
    fn read(&self, name: &str) -> anyhow::Result<Array>;
}

/// Opens a file whose ending is that of `name`, or a folder of PNG files.
///
/// # Errors
/// The ending is unknown, or the file is not what its ending says.
pub fn open(path: &Path, name: &Path) -> anyhow::Result<Box<dyn Arrays>> {
    let shown = name.display();
    let opened: anyhow::Result<Box<dyn Arrays>> = match ending(name).as_deref() {
        _ if path.is_dir() => pictures::Pictures::open(path).map(|it| Box::new(it) as _),
        Some("npz") => npz::Npz::open(path).map(|it| Box::new(it) as _),
        Some("safetensors") => tensors::Safetensors::open(path).map(|it| Box::new(it) as _),
        _ => bail!("{shown} is no `.npz`, no `.safetensors` and no folder"),
    };
    opened.with_context(|| format!("cannot read {shown}"))
}

/// The tensors of a `.safetensors` file.
///
/// # Errors
/// The content is no whole file.
pub fn safetensors(content: &Content) -> anyhow::Result<impl Arrays + use<>> {
    tensors::Safetensors::new(content.clone())
}

/// Whether [`open`] knows files with this path's ending. A folder has none.
pub fn is_known(path: &Path) -> bool {
    matches!(ending(path).as_deref(), Some("npz" | "safetensors") | None)
}

fn ending(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase())
}
