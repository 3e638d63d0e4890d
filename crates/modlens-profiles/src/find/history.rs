//! How well a reading explains a history from another source: the best affine fit, with the lag that fits best.

use crate::find::query::History;
use crate::find::series::Column;
use crate::find::shown::power_of_ten;

/// How a reading fits a history.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// The factor.
    pub scale: f64,
    /// What is added after scaling.
    pub offset: f64,
    /// How much later the history is than the reading, in nanoseconds.
    pub lag: i64,
    /// The share of the variance that is explained.
    pub r2: f64,
    /// The evidence in bits, priors of scale and offset included.
    pub bits: f64,
}

/// Lags from minus to plus five minutes are searched.
const LAGS: std::ops::RangeInclusive<i64> = -30..=30;
const LAG_STEP: i64 = 10_000_000_000;

/// The least number of points at which both must be known.
const LEAST_POINTS: usize = 6;

/// Points beyond this number add no evidence: consecutive values are not independent.
const INDEPENDENT: f64 = 48.0;

/// A history that is compared with many readings.
#[derive(Debug)]
pub struct Comparison<'a> {
    history: &'a History,
    /// The step between values that were written, which bounds how well a fit can be.
    step: f64,
    /// The lags that are tried.
    lags: Vec<i64>,
}

impl<'a> Comparison<'a> {
    /// Prepares a comparison.
    pub fn new(history: &'a History) -> Self {
        let step = (0..7).map(|digits| power_of_ten(-digits)).find(|unit| {
            history.values.iter().all(|value| {
                let units = value / unit;
                (units - units.round()).abs() < 1e-6 * units.abs().max(1.0)
            })
        });
        let zones: Vec<i64> = if history.has_zone { vec![0] } else { (-28..=28).collect() };
        let lags = zones.into_iter().flat_map(|zone| LAGS.map(move |lag| zone * 1_800_000_000_000 + lag * LAG_STEP)).collect();
        Self { history, step: step.unwrap_or(0.0), lags }
    }

    /// The largest share of explained variance over all lags, from a few points: a first choice among many readings.
    pub fn rough(&self, column: &Column<'_>, points: usize) -> f64 {
        self.best_lag(column, points, &self.lags).map_or(0.0, |best| best.1)
    }

    /// The best fit of a reading.
    pub fn fit(&self, column: &Column<'_>) -> Option<Fit> {
        let (mut lag, _) = self.best_lag(column, 200, &self.lags)?;
        let mut step = LAG_STEP / 2;
        while step >= 500_000_000 {
            let near: Vec<i64> = (-2..=2).map(|n| lag + n * step).collect();
            (lag, _) = self.best_lag(column, 400, &near)?;
            step /= 2;
        }
        let pairs = self.pairs(column, lag, 2000);
        let moments = Moments::new(&pairs);
        let floor = self.step * self.step / 12.0;
        Self::models(column, &moments, floor)
            .into_iter()
            .filter_map(|(scale, offset, prior)| {
                let residual = moments.residual(scale, offset) + floor;
                let total = moments.total() + floor;
                let independent = (pairs.len() as f64 / 2.0).min(INDEPENDENT);
                let bits = independent * (total / residual).log2() + prior;
                (residual < total).then_some(Fit { scale, offset, lag, r2: 1.0 - residual / total, bits })
            })
            .max_by(|a, b| a.bits.total_cmp(&b.bits))
    }

    /// Scales and offsets to try, with their priors in bits.
    fn models(column: &Column<'_>, moments: &Moments, floor: f64) -> Vec<(f64, f64, f64)> {
        let (slope, intercept) = moments.line();
        let through_zero = moments.xy / moments.xx;
        let mut all = vec![(through_zero, 0.0, -20.0), (slope, intercept, -26.0)];
        for scale in [through_zero, slope] {
            let exponent = scale.abs().log10().round() as i32;
            let power = power_of_ten(exponent.clamp(-9, 9));
            all.push((power, 0.0, if column.is_float() && exponent == 0 { 1.0 } else { 0.0 }));
            all.push((-power, 0.0, -6.0));
            for nice in [2.0, 5.0, 2.5, 0.2, 0.5, 0.25] {
                all.push((nice * power, 0.0, -8.0));
            }
            let fahrenheit = power_of_ten(((scale / 1.8).abs().log10().round() as i32).clamp(-9, 9)) * 1.8;
            all.push((fahrenheit, 32.0, -6.0));
            let offset = moments.mean_y - power * moments.mean_x;
            let rounded = offset.round();
            if (offset - rounded).abs() < 3.0 * floor.sqrt().max(1e-9) {
                all.push((power, rounded, -12.0));
            }
        }
        all
    }

    /// The lag with the largest share of explained variance, and that share.
    fn best_lag(&self, column: &Column<'_>, points: usize, lags: &[i64]) -> Option<(i64, f64)> {
        let mut best: Option<(i64, f64)> = None;
        for &lag in lags {
            let pairs = self.pairs(column, lag, points);
            if pairs.len() < LEAST_POINTS.max(self.history.values.len().min(points) / 2) {
                continue;
            }
            let r2 = Moments::new(&pairs).r2();
            // Of two lags that fit alike, the smaller one is right.
            let is_better = |other: (i64, f64)| r2 > other.1 + 1e-9 || (r2 >= other.1 - 1e-9 && lag.abs() < other.0.abs());
            if best.is_none_or(is_better) {
                best = Some((lag, r2));
            }
        }
        best
    }

    /// Numbers of the reading with values of the history at the same moments, at most `most`, spread evenly.
    fn pairs(&self, column: &Column<'_>, lag: i64, most: usize) -> Vec<(f64, f64)> {
        let len = self.history.values.len();
        let count = len.min(most);
        let mut found = Vec::with_capacity(count);
        for i in 0..count {
            let i = i * len / count;
            let time = self.history.times[i] - lag;
            let inside = column.block.times[0] <= time && time <= column.block.times[column.block.len() - 1];
            if inside {
                let number = column.interpolated(time);
                if !number.is_nan() {
                    found.push((number, self.history.values[i]));
                }
            }
        }
        found
    }
}

/// Means and mean products of pairs.
#[derive(Debug)]
struct Moments {
    mean_x: f64,
    mean_y: f64,
    /// Variances and covariance.
    var_x: f64,
    var_y: f64,
    cov: f64,
    /// Mean products around zero.
    xx: f64,
    xy: f64,
}

impl Moments {
    fn new(pairs: &[(f64, f64)]) -> Self {
        let count = pairs.len().max(1) as f64;
        let mean_x = pairs.iter().map(|pair| pair.0).sum::<f64>() / count;
        let mean_y = pairs.iter().map(|pair| pair.1).sum::<f64>() / count;
        let (mut var_x, mut var_y, mut cov) = (0.0, 0.0, 0.0);
        for (x, y) in pairs {
            var_x += (x - mean_x) * (x - mean_x);
            var_y += (y - mean_y) * (y - mean_y);
            cov += (x - mean_x) * (y - mean_y);
        }
        (var_x, var_y, cov) = (var_x / count, var_y / count, cov / count);
        Self { mean_x, mean_y, var_x, var_y, cov, xx: var_x + mean_x * mean_x, xy: cov + mean_x * mean_y }
    }

    fn r2(&self) -> f64 {
        if self.var_x > 0.0 && self.var_y > 0.0 {
            self.cov * self.cov / (self.var_x * self.var_y)
        } else {
            0.0
        }
    }

    /// Slope and intercept of the best line.
    fn line(&self) -> (f64, f64) {
        let slope = if self.var_x > 0.0 { self.cov / self.var_x } else { 0.0 };
        (slope, self.mean_y - slope * self.mean_x)
    }

    /// The mean square of what a scale and an offset leave.
    fn residual(&self, scale: f64, offset: f64) -> f64 {
        let bias = self.mean_y - scale * self.mean_x - offset;
        (self.var_y - 2.0 * scale * self.cov + scale * scale * self.var_x + bias * bias).max(0.0)
    }

    fn total(&self) -> f64 {
        self.var_y
    }
}
