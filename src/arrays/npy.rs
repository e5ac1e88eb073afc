//! Arrays as NumPy's `.npy` format keeps them: a header in the form of a Python dictionary, then the numbers.

use anyhow::{Context as _, bail, ensure};

use super::{Array, Dtype};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Reads an array.
///
/// # Errors
/// The bytes are no array of numbers in row-major order.
pub(super) fn read(bytes: &[u8]) -> anyhow::Result<Array> {
    let version = bytes.strip_prefix(MAGIC).and_then(|rest| rest.first()).context("no array of NumPy")?;
    let (length, at) = match version {
        1 => (usize::from(u16::from_le_bytes(bytes.get(8..10).context("too short")?.try_into()?)), 10),
        2 | 3 => (u32::from_le_bytes(bytes.get(8..12).context("too short")?.try_into()?) as usize, 12),
        other => bail!("the format of NumPy has version {other}"),
    };
    let header = bytes.get(at..).and_then(|rest| rest.get(..length)).context("too short")?;
    let header = std::str::from_utf8(header).context("its header is no text")?;
    let descr = value(header, "descr").context("its header has no `descr`")?;
    let dtype = dtype(descr)?;
    let shape = value(header, "shape").and_then(shape).context("its header has no `shape`")?;
    ensure!(
        value(header, "fortran_order").is_some_and(|order| order.starts_with("False")) || shape.len() < 2,
        "its numbers are in column-major order; write numpy.ascontiguousarray(it)"
    );
    Array::new(dtype, shape, bytes[at + length..].to_vec())
}

/// What follows a key of the header.
fn value<'h>(header: &'h str, key: &str) -> Option<&'h str> {
    let at = [format!("'{key}':"), format!("\"{key}\":")].iter().find_map(|key| Some(header.find(key)? + key.len()))?;
    Some(header[at..].trim_start())
}

fn dtype(descr: &str) -> anyhow::Result<Dtype> {
    let word = descr.trim_start_matches(['\'', '"']).split(['\'', '"']).next().unwrap_or_default();
    Ok(match word {
        "|b1" | "?" => Dtype::Bool,
        "|u1" | "<u1" => Dtype::U8,
        "|i1" => Dtype::Signed(1),
        "<i2" => Dtype::Signed(2),
        "<i4" => Dtype::Signed(4),
        "<i8" => Dtype::Signed(8),
        "<u2" => Dtype::Unsigned(2),
        "<u4" => Dtype::Unsigned(4),
        "<u8" => Dtype::Unsigned(8),
        "<f4" => Dtype::F32,
        "<f8" => Dtype::F64,
        "|O" => bail!("it holds Python objects, not numbers of one type"),
        other => bail!("its type `{other}` is none of bool, int, uint, float32 and float64 in little-endian order"),
    })
}

/// `(2, 3)`, `(2,)` or `()`.
fn shape(text: &str) -> Option<Vec<usize>> {
    let (inside, _) = text.strip_prefix('(')?.split_once(')')?;
    inside.split(',').map(str::trim).filter(|word| !word.is_empty()).map(|word| word.parse().ok()).collect()
}

/// The header of an array.
pub(super) fn header(dtype: Dtype, shape: &[usize]) -> Vec<u8> {
    let letter = match dtype {
        Dtype::Bool => "|b1".to_owned(),
        Dtype::U8 => "|u1".to_owned(),
        Dtype::F32 => "<f4".to_owned(),
        Dtype::F64 => "<f8".to_owned(),
        Dtype::Signed(1) => "|i1".to_owned(),
        Dtype::Signed(size) => format!("<i{size}"),
        Dtype::Unsigned(size) => format!("<u{size}"),
    };
    let lengths: String = shape.iter().map(|length| format!("{length}, ")).collect();
    let mut text = format!("{{'descr': '{letter}', 'fortran_order': False, 'shape': ({}), }}", lengths.trim_end());
    // The numbers begin at a multiple of 64, and the header ends with a line break.
    let padding = 64 - (MAGIC.len() + 4 + text.len() + 1) % 64;
    text.extend(std::iter::repeat_n(' ', padding % 64));
    text.push('\n');
    [MAGIC, &[1, 0], &(text.len() as u16).to_le_bytes(), text.as_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_survives_its_bytes() {
        for (dtype, shape) in [
            (Dtype::F32, vec![2, 3]),
            (Dtype::U8, vec![5]),
            (Dtype::Signed(8), vec![]),
            (Dtype::Unsigned(2), vec![0, 4]),
        ] {
            let count: usize = shape.iter().product::<usize>() * dtype.size();
            let array = Array::new(dtype, shape, (0..count).map(|at| at as u8).collect()).unwrap();
            let header = header(dtype, &array.shape);
            assert_eq!(header.len() % 64, 0);
            assert_eq!(read(&[header, array.bytes.clone()].concat()).unwrap(), array);
        }
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let said = |text: &str| {
            let text = format!("{text}\n");
            let bytes = [MAGIC, &[1, 0], &(text.len() as u16).to_le_bytes(), text.as_bytes(), &[0; 8]].concat();
            read(&bytes).unwrap_err().to_string()
        };
        assert!(said("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }").contains("Python objects"));
        assert!(said("{'descr': '<c8', 'fortran_order': False, 'shape': (1,), }").contains("`<c8`"));
        assert!(said("{'descr': '<f4', 'fortran_order': True, 'shape': (1, 2), }").contains("column-major"));
        assert!(said("{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }").contains("8 bytes are no float32"));
        assert!(
            said("{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,), }").contains("`shape`")
        );
        assert!(read(b"\x93NUMPY\x09").is_err() && read(b"").is_err());
    }

    #[test]
    fn whole_numbers_keep_their_sign() {
        let numbers = |dtype, bytes: &[u8]| {
            Array::new(dtype, vec![bytes.len() / dtype.size()], bytes.to_vec()).unwrap().numbers().collect::<Vec<_>>()
        };
        assert_eq!(numbers(Dtype::Signed(2), &[0xff, 0xff, 2, 0]), [-1.0, 2.0]);
        assert_eq!(numbers(Dtype::Unsigned(2), &[0xff, 0xff, 2, 0]), [65_535.0, 2.0]);
        assert_eq!(numbers(Dtype::Signed(1), &[0x80]), [-128.0]);
        assert_eq!(numbers(Dtype::F32, &1.5_f32.to_le_bytes()), [1.5]);
    }
}
