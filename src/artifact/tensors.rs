//! Named tensors as safetensors bytes. Their order is fixed and there is no metadata, so equal tensors give equal bytes.

use std::{borrow::Cow, collections::BTreeMap};

use anyhow::{Context as _, ensure};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

/// Tensors to write.
#[derive(Debug, Default)]
pub struct Tensors(BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)>);

impl Tensors {
    /// Adds numbers in row-major order.
    pub fn f32(&mut self, name: impl Into<String>, shape: &[usize], values: &[f32]) -> &mut Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.0.insert(name.into(), (Dtype::F32, shape.to_vec(), bytes));
        self
    }

    /// Adds bytes.
    pub fn u8(&mut self, name: impl Into<String>, shape: &[usize], values: &[u8]) -> &mut Self {
        self.0.insert(name.into(), (Dtype::U8, shape.to_vec(), values.to_vec()));
        self
    }

    /// Adds indices.
    pub fn u32(&mut self, name: impl Into<String>, shape: &[usize], values: &[u32]) -> &mut Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.0.insert(name.into(), (Dtype::U32, shape.to_vec(), bytes));
        self
    }

    /// The file's bytes.
    pub fn bytes(&self) -> anyhow::Result<Vec<u8>> {
        let views = self.0.iter().map(|(name, (dtype, shape, bytes))| {
            TensorView::new(*dtype, shape.clone(), bytes).map(|view| (name.as_str(), view))
        });
        let views: Vec<_> = views.collect::<Result<_, _>>().context("a tensor's shape does not fit its values")?;
        Ok(safetensors::serialize(views, None)?)
    }
}

/// A file of tensors to read.
#[derive(Debug)]
pub struct TensorFile<'a>(SafeTensors<'a>);

impl<'a> TensorFile<'a> {
    /// Reads the table of contents.
    pub fn open(bytes: &'a [u8]) -> anyhow::Result<Self> {
        Ok(Self(SafeTensors::deserialize(bytes).context("not a safetensors file")?))
    }

    fn view(&self, name: &str, dtype: Dtype) -> anyhow::Result<TensorView<'_>> {
        let view = self.0.tensor(name).with_context(|| format!("no tensor `{name}`"))?;
        ensure!(view.dtype() == dtype, "tensor `{name}` holds {:?}, not {dtype:?}", view.dtype());
        Ok(view)
    }

    /// The shape of a tensor.
    pub fn shape(&self, name: &str) -> anyhow::Result<Vec<usize>> {
        Ok(self.0.tensor(name).with_context(|| format!("no tensor `{name}`"))?.shape().to_vec())
    }

    /// Numbers in row-major order.
    pub fn f32(&self, name: &str) -> anyhow::Result<Vec<f32>> {
        let view = self.view(name, Dtype::F32)?;
        Ok(view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    /// Bytes.
    pub fn u8(&self, name: &str) -> anyhow::Result<Vec<u8>> {
        Ok(self.view(name, Dtype::U8)?.data().to_vec())
    }

    /// Indices.
    pub fn u32(&self, name: &str) -> anyhow::Result<Vec<u32>> {
        let view = self.view(name, Dtype::U32)?;
        Ok(view.data().as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect())
    }
}

/// One file of an artifact.
pub fn file<'a>(files: &'a super::Files, name: &str) -> anyhow::Result<Cow<'a, [u8]>> {
    let content = files.get(name).with_context(|| format!("no file `{name}` in the artifact"))?;
    Ok(content.bytes()?)
}
