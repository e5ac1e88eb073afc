//! Named tensors as safetensors files. Their order is fixed and there is no metadata, so equal tensors give equal bytes.
//!
//! Tensors are written and read one by one, so that no file is in memory as a whole.

use std::{
    borrow::Cow,
    cell::RefCell,
    io::{Read as _, SeekFrom},
};

use anyhow::{Context as _, ensure};
use safetensors::{
    Dtype,
    tensor::{Metadata, TensorInfo},
};
use serde::de::DeserializeOwned;

use crate::store::{Content, ReadSeek};

/// The longest header that a file may have, as in the safetensors library.
const LONGEST_HEADER: u64 = 100_000_000;

/// Tensors to write.
#[derive(Debug, Default)]
pub struct Tensors(Vec<Tensor>);

#[derive(Debug)]
struct Tensor {
    name: String,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Tensors {
    /// Adds numbers in row-major order.
    pub fn f32(&mut self, name: impl Into<String>, shape: &[usize], values: &[f32]) -> &mut Self {
        self.add(name, Dtype::F32, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    /// Adds numbers in double precision, in row-major order.
    pub fn f64(&mut self, name: impl Into<String>, shape: &[usize], values: &[f64]) -> &mut Self {
        self.add(name, Dtype::F64, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    /// Adds bytes. A vector becomes a part of the file without a copy.
    pub fn u8(&mut self, name: impl Into<String>, shape: &[usize], values: impl Into<Vec<u8>>) -> &mut Self {
        self.add(name, Dtype::U8, shape, values.into())
    }

    /// Adds indices.
    pub fn u32(&mut self, name: impl Into<String>, shape: &[usize], values: &[u32]) -> &mut Self {
        self.add(name, Dtype::U32, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn add(&mut self, name: impl Into<String>, dtype: Dtype, shape: &[usize], bytes: Vec<u8>) -> &mut Self {
        self.0.push(Tensor { name: name.into(), dtype, shape: shape.to_vec(), bytes });
        self
    }

    /// The file: its header, then the tensors as the safetensors library orders them.
    ///
    /// # Errors
    /// The shape of a tensor does not fit its values.
    pub fn content(mut self) -> anyhow::Result<Content> {
        self.0.sort_by(|a, b| b.dtype.cmp(&a.dtype).then_with(|| a.name.cmp(&b.name)));
        let (mut about, mut end) = (Vec::new(), 0);
        for Tensor { name, dtype, shape, bytes } in &self.0 {
            let begin = end;
            end += bytes.len();
            let info = TensorInfo { dtype: *dtype, shape: shape.clone(), data_offsets: (begin, end) };
            about.push((name.clone(), info));
        }
        let about = Metadata::new(None, about).context("a tensor's shape does not fit its values")?;
        let mut text = serde_json::to_vec(&about)?;
        text.resize(text.len().next_multiple_of(8), b' ');
        let header = [&(text.len() as u64).to_le_bytes()[..], &text].concat();
        Ok(Content::Parts(std::iter::once(header).chain(self.0.into_iter().map(|tensor| tensor.bytes)).collect()))
    }
}

/// A file of tensors to read.
pub struct TensorFile<'a> {
    file: RefCell<Box<dyn ReadSeek + 'a>>,
    about: Metadata,
    /// Where the first tensor begins.
    first: u64,
}

impl<'a> TensorFile<'a> {
    /// Reads the table of contents of a file of an artifact.
    ///
    /// # Errors
    /// There is no such file, or it is not a whole safetensors file.
    pub fn open(files: &'a super::Files, name: &str) -> anyhow::Result<Self> {
        Self::read(known(files, name)?).with_context(|| format!("cannot read {name}"))
    }

    /// Reads the table of contents.
    ///
    /// # Errors
    /// The content is not a whole safetensors file.
    pub fn read(content: &'a Content) -> anyhow::Result<Self> {
        let mut file = content.reader()?;
        let size = file.seek(SeekFrom::End(0))?;
        file.rewind()?;
        let about = header(&mut *file, size).context("not a safetensors file")?;
        let first = file.stream_position()?;
        ensure!(
            about.data_len() as u64 == size - first,
            "not a safetensors file: its length differs from the length in its header"
        );
        Ok(Self { file: RefCell::new(file), about, first })
    }

    /// The names of all tensors, in the order of their bytes.
    pub fn names(&self) -> Vec<String> {
        self.about.offset_keys()
    }

    fn info(&self, name: &str) -> anyhow::Result<&TensorInfo> {
        self.about.info(name).with_context(|| format!("no tensor `{name}`"))
    }

    /// The shape of a tensor.
    pub fn shape(&self, name: &str) -> anyhow::Result<Vec<usize>> {
        Ok(self.info(name)?.shape.clone())
    }

    /// The shape of a tensor of so many dimensions.
    pub fn shape_of(&self, name: &str, dimensions: usize) -> anyhow::Result<Vec<usize>> {
        let shape = self.shape(name)?;
        ensure!(shape.len() == dimensions, "tensor `{name}` has shape {shape:?}");
        Ok(shape)
    }

    /// The type of a tensor's numbers.
    pub fn dtype(&self, name: &str) -> anyhow::Result<Dtype> {
        Ok(self.info(name)?.dtype)
    }

    /// Passes the bytes of a tensor on, in pieces of a whole number of values.
    pub fn pieces(&self, name: &str, mut take: impl FnMut(&[u8]) -> anyhow::Result<()>) -> anyhow::Result<()> {
        let (begin, end) = self.info(name)?.data_offsets;
        let mut file = self.file.borrow_mut();
        file.seek(SeekFrom::Start(self.first + begin as u64))?;
        let mut buffer = vec![0; (end - begin).min(1 << 16)];
        let mut left = end - begin;
        while left > 0 {
            let piece = &mut buffer[..left.min(1 << 16)];
            file.read_exact(piece).with_context(|| format!("cannot read tensor `{name}`"))?;
            take(piece)?;
            left -= piece.len();
        }
        Ok(())
    }

    /// Reads all values of a tensor, `BYTES` bytes each.
    fn values<const BYTES: usize, T>(
        &self,
        name: &str,
        dtype: Dtype,
        value: fn([u8; BYTES]) -> T,
    ) -> anyhow::Result<Vec<T>> {
        let info = self.info(name)?;
        ensure!(info.dtype == dtype, "tensor `{name}` holds {:?}, not {dtype:?}", info.dtype);
        // The file has these bytes, so the capacity is no more than what is read.
        let mut values = Vec::with_capacity((info.data_offsets.1 - info.data_offsets.0) / BYTES);
        self.pieces(name, |piece| {
            values.extend(piece.as_chunks::<BYTES>().0.iter().map(|bytes| value(*bytes)));
            Ok(())
        })?;
        Ok(values)
    }

    /// Numbers in row-major order.
    pub fn f32(&self, name: &str) -> anyhow::Result<Vec<f32>> {
        self.values(name, Dtype::F32, f32::from_le_bytes)
    }

    /// Numbers in double precision, in row-major order.
    pub fn f64(&self, name: &str) -> anyhow::Result<Vec<f64>> {
        self.values(name, Dtype::F64, f64::from_le_bytes)
    }

    /// Bytes.
    pub fn u8(&self, name: &str) -> anyhow::Result<Vec<u8>> {
        self.values(name, Dtype::U8, |[byte]| byte)
    }

    /// Indices.
    pub fn u32(&self, name: &str) -> anyhow::Result<Vec<u32>> {
        self.values(name, Dtype::U32, u32::from_le_bytes)
    }
}

/// Reads the header: the length of its text as eight bytes, then the text.
fn header(file: &mut dyn ReadSeek, size: u64) -> anyhow::Result<Metadata> {
    let mut length = [0; 8];
    file.read_exact(&mut length)?;
    let length = u64::from_le_bytes(length);
    ensure!(length <= LONGEST_HEADER.min(size - 8), "its header of {length} bytes is too long");
    let mut text = vec![0; length as usize];
    file.read_exact(&mut text)?;
    Ok(serde_json::from_slice(&text)?)
}

/// A JSON file of an artifact.
pub fn read_json<T: DeserializeOwned>(files: &super::Files, name: &str) -> anyhow::Result<T> {
    serde_json::from_slice(&file(files, name)?).with_context(|| format!("cannot read {name}"))
}

/// One file of an artifact, as bytes.
pub fn file<'a>(files: &'a super::Files, name: &str) -> anyhow::Result<Cow<'a, [u8]>> {
    Ok(known(files, name)?.bytes()?)
}

fn known<'a>(files: &'a super::Files, name: &str) -> anyhow::Result<&'a Content> {
    files.get(name).with_context(|| format!("no file `{name}` in the artifact"))
}

#[cfg(test)]
mod tests {
    use safetensors::tensor::TensorView;

    use super::*;

    #[test]
    fn files_are_those_of_the_safetensors_library() {
        let (numbers, bytes, indices) = ([1.5_f32, -2.0, 3.0], [7_u8, 8], [1_u32, 70_000]);
        let mut tensors = Tensors::default();
        tensors.u8("b", &[2], &bytes[..]).f32("z", &[3, 1], &numbers).u32("c", &[2], &indices).f32("a", &[0], &[]);
        let content = tensors.content().unwrap();
        let (numbers, indices) = (numbers.map(f32::to_le_bytes), indices.map(u32::to_le_bytes));
        let view = |dtype, shape: &[usize], bytes| TensorView::new(dtype, shape.to_vec(), bytes).unwrap();
        let views = [
            ("b", view(Dtype::U8, &[2], &bytes[..])),
            ("z", view(Dtype::F32, &[3, 1], numbers.as_flattened())),
            ("c", view(Dtype::U32, &[2], indices.as_flattened())),
            ("a", view(Dtype::F32, &[0], &[])),
        ];
        assert_eq!(*content.bytes().unwrap(), safetensors::serialize(views, None).unwrap());
        let file = TensorFile::read(&content).unwrap();
        assert_eq!((file.u8("b").unwrap(), file.u32("c").unwrap()), (vec![7, 8], vec![1, 70_000]));
        assert_eq!((file.f32("z").unwrap(), file.f32("a").unwrap()), (vec![1.5, -2.0, 3.0], vec![]));
    }

    #[test]
    fn large_tensors_are_read_in_pieces_from_memory_and_from_disk() {
        let numbers: Vec<f32> = (0..50_000_u16).map(f32::from).collect();
        let mut tensors = Tensors::default();
        tensors.f32("numbers", &[50_000], &numbers).u8("after", &[1], vec![9]);
        let content = tensors.content().unwrap();
        let disk = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(disk.path(), &*content.bytes().unwrap()).unwrap();
        for content in [content, Content::File(disk.path().to_owned())] {
            let file = TensorFile::read(&content).unwrap();
            assert_eq!((file.f32("numbers").unwrap(), file.u8("after").unwrap()), (numbers.clone(), vec![9]));
        }
    }
}
