//! Numbers and statistics as text for tables and charts.

use crate::num::stats::Estimate;

/// `77.1 ± 0.1 (5)`: mean, standard error, number of models.
pub fn mean(it: Estimate) -> String {
    let error = it.standard_error.map_or_else(String::new, |error| format!(" ± {}", number(error)));
    format!("{}{error} ({})", number(it.mean), it.n)
}

/// A value with one digit after the point: none from 1000 on, two below 2.
pub fn number(value: f64) -> String {
    match value.abs() {
        size if size >= 1000.0 => format!("{value:.0}"),
        size if size >= 2.0 || value == 0.0 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

/// A count in groups of three digits: `3,072`.
pub fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_as_many_digits_as_its_size_needs() {
        assert_eq!([3072.4, 77.14, 0.0, 1.234].map(number), ["3072", "77.1", "0.0", "1.23"]);
        assert_eq!([7, 999, 3072, 1_234_567].map(thousands), ["7", "999", "3,072", "1,234,567"]);
    }
}
