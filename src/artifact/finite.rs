//! Refuses files of artifacts that hold a number that is not finite: whatever reads such a number gives a wrong result.

use anyhow::{Context as _, bail};
use safetensors::Dtype;
use serde_json::Value;

use super::{Files, tensors::TensorFile};
use crate::store::Content;

/// Refuses files in which a tensor holds NaN or an infinity, or a JSON value is `null`, which is how JSON writes such a
/// number. Values of the keys `may_be_missing` may be `null`.
///
/// # Errors
/// Names the first such number by file and place.
pub fn must_be_finite(files: &Files, may_be_missing: &[&str]) -> anyhow::Result<()> {
    for (name, content) in files.iter() {
        let checked = match name.rsplit_once('.') {
            Some((_, "safetensors")) => tensors(content),
            Some((_, "json")) => json(&content.bytes()?, may_be_missing),
            _ => Ok(()),
        };
        checked.with_context(|| format!("`{name}`"))?;
    }
    Ok(())
}

fn tensors(content: &Content) -> anyhow::Result<()> {
    let file = TensorFile::read(content)?;
    for name in file.names() {
        let dtype = file.dtype(&name)?;
        if !matches!(dtype, Dtype::F64 | Dtype::F32 | Dtype::F16 | Dtype::BF16) {
            continue;
        }
        let mut before = 0;
        file.pieces(&name, |piece| {
            let (bad, count) = match dtype {
                Dtype::F64 => first(piece.as_chunks::<8>().0, f64::from_le_bytes),
                Dtype::F32 => first(piece.as_chunks::<4>().0, |number| f32::from_le_bytes(number).into()),
                // Half precision in its two forms: the exponent of a number that is not finite has ones only.
                Dtype::F16 => first(piece.as_chunks::<2>().0, |number| half(number, 0x7c00)),
                _ => first(piece.as_chunks::<2>().0, |number| half(number, 0x7f80)),
            };
            if let Some((at, number)) = bad {
                bail!("tensor `{name}` is {number} at index {}", before + at);
            }
            before += count;
            Ok(())
        })?;
    }
    Ok(())
}

/// The first number that is not finite with its index, and the count of all numbers.
fn first<const BYTES: usize>(
    numbers: &[[u8; BYTES]],
    read: impl Fn([u8; BYTES]) -> f64,
) -> (Option<(usize, f64)>, usize) {
    let mut all = numbers.iter().map(|&number| read(number)).enumerate();
    (all.find(|(_, number)| !number.is_finite()), numbers.len())
}

/// 0 for a finite number in half precision, and NaN otherwise.
fn half(number: [u8; 2], exponent: u16) -> f64 {
    if u16::from_le_bytes(number) & exponent == exponent { f64::NAN } else { 0.0 }
}

fn json(bytes: &[u8], may_be_missing: &[&str]) -> anyhow::Result<()> {
    // Most files hold no `null` and need not be read.
    if !bytes.windows(4).any(|word| word == b"null") {
        return Ok(());
    }
    let value: Value = serde_json::from_slice(bytes)?;
    match null(&value, "", may_be_missing) {
        Some(place) if place.is_empty() => bail!("a number is not finite, or missing"),
        Some(place) => bail!("`{}` is not finite, or missing", &place[1..]),
        None => Ok(()),
    }
}

/// The place of the first `null`, such as `/episodes/0/path`.
fn null(value: &Value, place: &str, may_be_missing: &[&str]) -> Option<String> {
    let mut below = |(key, value): (String, &Value)| null(value, &format!("{place}/{key}"), may_be_missing);
    match value {
        Value::Null => Some(place.to_owned()),
        Value::Array(items) => items.iter().enumerate().map(|(at, item)| (at.to_string(), item)).find_map(below),
        Value::Object(table) => {
            let checked =
                table.iter().filter(|(key, value)| !(value.is_null() && may_be_missing.contains(&key.as_str())));
            checked.map(|(key, value)| (key.clone(), value)).find_map(&mut below)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use safetensors::tensor::TensorView;
    use serde_json::json;

    use super::*;

    fn refusal(name: &str, bytes: Vec<u8>) -> Option<String> {
        must_be_finite(&Files::from([(name, bytes)]), &["may"]).err().map(|error| format!("{error:#}"))
    }

    #[test]
    fn a_tensor_of_any_precision_is_refused_by_name_and_index() {
        let cases: [(Dtype, Vec<u8>, Vec<u8>); 4] = [
            (Dtype::F64, f64::MAX.to_le_bytes().to_vec(), f64::NAN.to_le_bytes().to_vec()),
            (Dtype::F32, f32::MIN_POSITIVE.to_le_bytes().to_vec(), f32::NEG_INFINITY.to_le_bytes().to_vec()),
            (Dtype::F16, 0x7bff_u16.to_le_bytes().to_vec(), 0xfc00_u16.to_le_bytes().to_vec()),
            (Dtype::BF16, 0x7f7f_u16.to_le_bytes().to_vec(), 0x7fc0_u16.to_le_bytes().to_vec()),
        ];
        for (dtype, finite, bad) in cases {
            let file = |numbers: [&[u8]; 3]| {
                let bytes = numbers.concat();
                let view = TensorView::new(dtype, vec![3], &bytes).unwrap();
                safetensors::serialize([("w", view)], None).unwrap()
            };
            assert_eq!(refusal("a.safetensors", file([&finite; 3])), None, "{dtype:?}");
            let refused = refusal("a.safetensors", file([&finite, &finite, &bad])).unwrap();
            assert!(
                refused.starts_with("`a.safetensors`: tensor `w` is ") && refused.ends_with(" at index 2"),
                "{refused}"
            );
        }
    }

    #[test]
    fn a_null_is_refused_by_its_place_unless_its_key_may_be_missing() {
        let refusal = |value: Value| refusal("a.json", value.to_string().into_bytes());
        assert_eq!(refusal(json!({ "may": null, "name": "null", "below": [{ "may": null }] })), None);
        let said = |value| refusal(value).unwrap();
        assert_eq!(said(json!({ "may": [1.0, null] })), "`a.json`: `may/1` is not finite, or missing");
        assert_eq!(said(json!([{ "path": [[0, null]] }])), "`a.json`: `0/path/0/1` is not finite, or missing");
        assert_eq!(said(json!(f64::NAN)), "`a.json`: a number is not finite, or missing");
    }
}
