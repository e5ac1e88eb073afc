//! One axis of a chart: its range and its ticks.

/// The greatest number of ticks of a rounded axis, less one.
const TICKS: usize = 7;

/// A range of values and the round numbers within.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    range: [f64; 2],
    pub(super) ticks: Vec<f64>,
}

impl Axis {
    /// An axis of whole numbers from the least to the greatest value. It has at most `most` + 1 ticks.
    pub(super) fn exact(values: impl Iterator<Item = f64>, most: usize) -> Self {
        let [low, high] = span(values);
        if high <= low {
            return Self { range: [low, high], ticks: vec![low] };
        }
        let step = step(high - low, most).max(1.0);
        Self { range: [low, high], ticks: multiples(step, [low, high]) }
    }

    /// An axis that holds all values and ends in ticks on both sides, within the limits.
    pub(super) fn rounded(values: impl Iterator<Item = f64>, limits: Option<[f64; 2]>) -> Self {
        let [low, high] = span(values);
        // Equal values still need an axis of some length.
        let step = step((high - low).max(0.05 * high.abs()).max(1e-3), TICKS);
        let [least, most] = limits.unwrap_or([f64::MIN, f64::MAX]);
        let room = step / 10.0;
        let ends = [((low - room) / step).floor() * step, ((high + room) / step).ceil() * step];
        let range = ends.map(|end| end.clamp(least, most));
        Self { range, ticks: multiples(step, range) }
    }

    /// The place of a value: 0 at the low end, 1 at the high end.
    pub(super) fn share(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        if high > low { (value - low) / (high - low) } else { 0.5 }
    }
}

/// The least and the greatest value; zeros where there is none.
fn span(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values.fold([f64::MAX, f64::MIN], |[low, high], value| [low.min(value), high.max(value)]);
    if low > high { [0.0; 2] } else { [low, high] }
}

/// The least of 1, 2 and 5 times a power of ten that divides a length into at most `most` parts.
fn step(length: f64, most: usize) -> f64 {
    let powers = [1e-4, 1e-3, 0.01, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9];
    let mut steps = powers.into_iter().flat_map(|power| [1.0, 2.0, 5.0].map(|digit| digit * power));
    steps.find(|step| length / step <= most as f64).unwrap_or(length)
}

/// The multiples of a step within a range.
fn multiples(step: f64, [low, high]: [f64; 2]) -> Vec<f64> {
    let first = (low / step - 1e-9).ceil() as i64;
    (first..).map(|at| at as f64 * step).take_while(|tick| *tick <= high + step * 1e-9).collect()
}

/// A tick as text, without needless digits.
pub(super) fn number(tick: f64) -> String {
    let text = format!("{tick:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_few() {
        let ticks = |ends: [f64; 2]| Axis::exact(ends.into_iter(), 7).ticks;
        assert_eq!(ticks([2048.0, 3072.0]), [2200.0, 2400.0, 2600.0, 2800.0, 3000.0]);
        assert_eq!(ticks([5000.0, 5000.0]), [5000.0]);
        assert_eq!(ticks([500.0, 5000.0]), [1000.0, 2000.0, 3000.0, 4000.0, 5000.0]);
        assert_eq!(ticks([0.0, 2.0]), [0.0, 1.0, 2.0]);
    }

    #[test]
    fn a_rounded_axis_holds_its_values_and_keeps_its_limits() {
        let axis = Axis::rounded([41.0, 99.5].into_iter(), Some([0.0, 100.0]));
        assert_eq!((axis.range, axis.ticks.len()), ([40.0, 100.0], 7));
        let alone = Axis::rounded([75.0].into_iter(), None);
        assert!(alone.share(75.0) > 0.0 && alone.share(75.0) < 1.0 && alone.ticks.len() > 1, "{alone:?}");
        assert_eq!([0.25, 40.0, 2000.0].map(number), ["0.25", "40", "2000"]);
    }
}
