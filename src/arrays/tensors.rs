//! `.safetensors` files of other programs.

use std::path::Path;

use anyhow::bail;

use super::{Array, Arrays, Dtype};
use crate::{artifact::tensors::TensorFile, store::Content};

/// A file whose table of contents was read once.
pub(super) struct Safetensors {
    content: Content,
}

impl Safetensors {
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        Self::new(Content::File(path.to_owned()))
    }

    pub(super) fn new(content: Content) -> anyhow::Result<Self> {
        TensorFile::read(&content)?;
        Ok(Self { content })
    }
}

impl Arrays for Safetensors {
    fn names(&self) -> Vec<String> {
        TensorFile::read(&self.content).map(|file| file.names()).unwrap_or_default()
    }

    fn read(&self, name: &str) -> anyhow::Result<Array> {
        let file = TensorFile::read(&self.content)?;
        let dtype = match file.dtype(name)? {
            safetensors::Dtype::BOOL => Dtype::Bool,
            safetensors::Dtype::U8 => Dtype::U8,
            safetensors::Dtype::I8 => Dtype::Signed(1),
            safetensors::Dtype::I16 => Dtype::Signed(2),
            safetensors::Dtype::I32 => Dtype::Signed(4),
            safetensors::Dtype::I64 => Dtype::Signed(8),
            safetensors::Dtype::U16 => Dtype::Unsigned(2),
            safetensors::Dtype::U32 => Dtype::Unsigned(4),
            safetensors::Dtype::U64 => Dtype::Unsigned(8),
            safetensors::Dtype::F32 => Dtype::F32,
            safetensors::Dtype::F64 => Dtype::F64,
            other => bail!("tensor `{name}` holds {other:?}; write whole numbers, F32 or F64"),
        };
        let mut bytes = Vec::new();
        file.pieces(name, |piece| {
            bytes.extend_from_slice(piece);
            Ok(())
        })?;
        Array::new(dtype, file.shape(name)?, bytes)
    }
}
