//! `.npz`: a ZIP archive of NumPy's arrays.

use std::{
    cell::RefCell,
    fs::File,
    io::{BufReader, BufWriter, Write},
    path::Path,
};

use anyhow::{Context as _, ensure};

use super::{Array, Arrays, Dtype, npy, zip};

/// An open archive.
pub(super) struct Npz {
    file: RefCell<BufReader<File>>,
    entries: Vec<zip::Entry>,
}

impl Npz {
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let mut file = BufReader::new(File::open(path)?);
        let entries = zip::entries(&mut file)?;
        Ok(Self { file: RefCell::new(file), entries })
    }
}

impl Arrays for Npz {
    fn names(&self) -> Vec<String> {
        self.entries.iter().filter_map(|entry| entry.name.strip_suffix(".npy")).map(str::to_owned).collect()
    }

    fn read(&self, name: &str) -> anyhow::Result<Array> {
        let is_it = |entry: &&zip::Entry| entry.name.strip_suffix(".npy") == Some(name);
        let entry = self.entries.iter().find(is_it).with_context(|| format!("no array `{name}`"))?;
        let bytes = entry.read(&mut *self.file.borrow_mut());
        bytes.and_then(|bytes| npy::read(&bytes)).with_context(|| format!("cannot read the array `{name}`"))
    }
}

/// Writes an archive, one array after the other. Equal arrays give equal bytes.
pub struct NpzWriter<W: Write>(zip::Writer<BufWriter<W>>);

impl<W: Write> NpzWriter<W> {
    /// Begins an archive.
    pub fn new(file: W) -> Self {
        Self(zip::Writer::new(BufWriter::new(file)))
    }

    /// Adds an array.
    ///
    /// # Errors
    /// The bytes do not fit the shape, or the file cannot be written.
    pub fn add(&mut self, name: &str, dtype: Dtype, shape: &[usize], bytes: &[u8]) -> anyhow::Result<()> {
        ensure!(
            shape.iter().product::<usize>() * dtype.size() == bytes.len() && name.len() < 1000,
            "the array `{name}` has other bytes than its shape says"
        );
        Ok(self.0.add(&format!("{name}.npy"), &[&npy::header(dtype, shape), bytes])?)
    }

    /// Ends the archive.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(self) -> anyhow::Result<()> {
        self.0.finish()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_archive_survives_its_bytes_and_any_cut_of_them_is_refused() {
        let mut bytes = Vec::new();
        let mut writer = NpzWriter::new(&mut bytes);
        writer.add("a", Dtype::U8, &[2, 2], &[1, 2, 3, 4]).unwrap();
        writer.add("b", Dtype::F32, &[1], &1.5_f32.to_le_bytes()).unwrap();
        assert!(writer.add("c", Dtype::F32, &[2], &[0; 4]).is_err());
        writer.finish().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.npz");
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let npz = Npz::open(&path)?;
            npz.names().iter().map(|name| npz.read(name)).collect::<anyhow::Result<Vec<Array>>>()
        };
        let whole = read(&bytes).unwrap();
        assert_eq!(
            (&whole[0].shape[..], &whole[0].bytes[..], whole[1].dtype),
            (&[2, 2][..], &[1, 2, 3, 4][..], Dtype::F32)
        );
        for end in 0..bytes.len() {
            assert!(read(&bytes[..end]).is_err(), "cut at {end}");
        }
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 0x55;
            _ = read(&changed);
        }
    }
}
