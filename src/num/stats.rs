//! Statistics over models: means, standard errors and bootstrap confidence intervals.
//!
//! The unit is one model (one seed) with its mean over its episodes, because episodes of one model are not independent
//! trials. Results do not depend on the order of the values. Resampling draws from a fixed random stream.

use serde::{Deserialize, Serialize};

use super::{rng::Stream, sampling};

/// The number of resamples of a bootstrap.
pub const RESAMPLES: usize = 10_000;

/// The number of models in "worst five" and "top five".
pub const FIVE: usize = 5;

/// Statistics of one metric over several models.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// The number of models.
    pub n: usize,
    /// Mean over models.
    pub mean: f64,
    /// Standard error of the mean; `None` for a single model.
    pub standard_error: Option<f64>,
    /// 95 % percentile bootstrap interval of the mean; `None` for a single model.
    pub ci95: Option<[f64; 2]>,
    /// The best model.
    pub best: f64,
    /// The worst model.
    pub worst: f64,
    /// The mean of the five best models.
    pub top_five: Mean,
    /// The mean of the five worst models.
    pub worst_five: Mean,
}

/// A mean over some of the models.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// The mean.
    pub mean: f64,
    /// The number of models: five, or all where there are fewer.
    pub of: usize,
}

impl Mean {
    fn of(values: &[f64]) -> Self {
        Self { mean: mean(values), of: values.len() }
    }
}

/// A mean over models and its standard error. Unlike a [`Summary`], it needs no bootstrap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The number of models.
    pub n: usize,
    /// Mean over models.
    pub mean: f64,
    /// Standard error of the mean; `None` for a single model.
    pub standard_error: Option<f64>,
}

impl Estimate {
    /// The estimate from values. There is at least one.
    pub fn of(values: &[f64]) -> Self {
        let sorted = sorted(values);
        let standard_error = (sorted.len() > 1).then(|| standard_error(&sorted));
        Self { n: sorted.len(), mean: mean(&sorted), standard_error }
    }
}

impl Summary {
    /// The statistics of the values; `None` for no values.
    pub fn of(values: &[f64]) -> Option<Self> {
        let sorted = sorted(values);
        let (worst, best) = (*sorted.first()?, *sorted.last()?);
        let five = FIVE.min(sorted.len());
        let Estimate { n, mean, standard_error } = Estimate::of(&sorted);
        Some(Self {
            n,
            mean,
            standard_error,
            ci95: (n > 1).then(|| interval(&sorted)),
            best,
            worst,
            top_five: Mean::of(&sorted[sorted.len() - five..]),
            worst_five: Mean::of(&sorted[..five]),
        })
    }
}

impl From<&Summary> for Estimate {
    fn from(&Summary { n, mean, standard_error, .. }: &Summary) -> Self {
        Self { n, mean, standard_error }
    }
}

/// The difference of two means and its interval.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// The second mean minus the first.
    pub mean: f64,
    /// 95 % percentile bootstrap interval; `None` where a side has a single model.
    pub ci95: Option<[f64; 2]>,
    /// The number of pairs of models with the same seed; `None` where the sides were resampled independently.
    pub pairs: Option<usize>,
}

/// The mean difference over pairs of models (first, second); `None` for no pairs.
pub fn paired(pairs: &[(f64, f64)]) -> Option<Difference> {
    let differences: Vec<f64> = pairs.iter().map(|(first, second)| second - first).collect();
    let summary = Summary::of(&differences)?;
    Some(Difference { mean: summary.mean, ci95: summary.ci95, pairs: Some(pairs.len()) })
}

/// The difference of means between two independent sets of models; `None` if one of them is empty.
pub fn unpaired(first: &[f64], second: &[f64]) -> Option<Difference> {
    if first.is_empty() || second.is_empty() {
        return None;
    }
    let (first, second) = (sorted(first), sorted(second));
    let ci95 = (first.len() > 1 && second.len() > 1).then(|| {
        let (before, after) = (resampled_means(&first, "first"), resampled_means(&second, "second"));
        percentiles(after.iter().zip(&before).map(|(after, before)| after - before).collect())
    });
    Some(Difference { mean: mean(&second) - mean(&first), ci95, pairs: None })
}

/// The mean; NaN for no values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Standard error of the mean; 0 for a single value.
pub fn standard_error(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    let (mean, n) = (mean(values), values.len() as f64);
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (squares / (n - 1.0) / n).sqrt()
}

/// 95 % percentile bootstrap interval of the mean.
pub fn interval(values: &[f64]) -> [f64; 2] {
    percentiles(resampled_means(&sorted(values), "first"))
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// The mean of each resample: as many values as there are, drawn with replacement.
fn resampled_means(values: &[f64], purpose: &'static str) -> Vec<f64> {
    let stream = Stream { seed: 0, kind: "bootstrap".to_owned(), round: 0, stream: None };
    let mut rng = stream.rng(purpose.into());
    let count = values.len();
    let mut draw = || values[sampling::index(&mut rng, count)];
    (0..RESAMPLES).map(|_| (0..count).map(|_| draw()).sum::<f64>() / count as f64).collect()
}

/// The 2.5th and the 97.5th percentile, interpolated linearly.
fn percentiles(values: Vec<f64>) -> [f64; 2] {
    let sorted = sorted(&values);
    [0.025, 0.975].map(|share| {
        let place = share * (sorted.len() - 1) as f64;
        let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
        below + (above - below) * place.fract()
    })
}

#[cfg(test)]
mod tests {
    use rand::RngExt as _;

    use super::*;

    #[test]
    fn a_summary_names_best_worst_and_fives() {
        let summary = Summary::of(&[3.0, 1.0, 2.0, 6.0, 5.0, 4.0]).unwrap();
        assert_eq!((summary.n, summary.mean, summary.best, summary.worst), (6, 3.5, 6.0, 1.0));
        assert_eq!((summary.top_five.mean, summary.worst_five.mean), (4.0, 3.0));
        assert!((summary.standard_error.unwrap() - 0.763_762_615_825_973_4).abs() < 1e-15);
        assert_eq!(Summary::of(&[1.0, 2.0]).unwrap().top_five, Mean { mean: 1.5, of: 2 });
        assert_eq!(Summary::of(&[]), None);
    }

    #[test]
    fn one_model_has_no_error_and_no_interval() {
        let summary = Summary::of(&[7.0]).unwrap();
        assert_eq!((summary.standard_error, summary.ci95, summary.mean), (None, None, 7.0));
    }

    #[test]
    fn the_interval_is_near_two_standard_errors_and_does_not_depend_on_order() {
        let values: Vec<f64> = (0..40).map(|at| f64::from(at * 7 % 40)).collect();
        let mut turned = values.clone();
        turned.reverse();
        let [low, high] = interval(&values);
        assert_eq!([low, high], interval(&turned));
        let half = 1.96 * standard_error(&values);
        assert!(((high - low) / 2.0 - half).abs() < 0.1 * half, "{low} {high} {half}");
        assert!(low < mean(&values) && mean(&values) < high);
    }

    #[test]
    fn the_interval_covers_about_as_often_as_it_says() {
        let stream = Stream { seed: 3, kind: "test".to_owned(), round: 0, stream: None };
        let mut rng = stream.rng("models".into());
        let mut draw = || f64::from(rng.random::<u32>()) / f64::from(u32::MAX);
        let trials = 60;
        let covered = (0..trials).filter(|_| {
            let [low, high] = interval(&(0..25).map(|_| draw()).collect::<Vec<_>>());
            low < 0.5 && 0.5 < high
        });
        let share = covered.count() as f64 / f64::from(trials);
        assert!((0.85..=1.0).contains(&share), "{share}");
    }

    #[test]
    fn pairs_take_away_what_seeds_share() {
        let pairs: Vec<(f64, f64)> =
            (0..8).map(|seed| (f64::from(seed * 10), f64::from(seed * 10 + 2 + seed % 2))).collect();
        let both: (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
        let (paired, unpaired) = (paired(&pairs).unwrap(), unpaired(&both.0, &both.1).unwrap());
        assert_eq!((paired.mean, unpaired.mean, paired.pairs), (2.5, 2.5, Some(8)));
        let width = |it: &Difference| it.ci95.map(|[low, high]| high - low).unwrap();
        assert!(width(&paired) < 1.0 && width(&unpaired) > 20.0);
        assert!(super::unpaired(&[1.0], &[2.0, 3.0]).unwrap().ci95.is_none());
    }
}
