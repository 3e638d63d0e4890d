//! How well a reading explains values that a display showed.

use crate::find::query::Shown;
use crate::find::series::Column;

/// A scale and an offset that displays use, with their prior in bits.
#[derive(Clone, Copy, Debug)]
pub struct Scaling {
    /// The factor.
    pub scale: f64,
    /// What is added after scaling.
    pub offset: f64,
    /// How usual it is, in bits (0: the most usual one, negative: rarer).
    pub prior: f64,
}

/// The scalings that are tried for integers, or for floats.
pub fn scalings(is_float: bool) -> Vec<Scaling> {
    // How often the power of ten is met in register maps, from 10^-4 to 10^4. Displays show kW and MWh of W and kWh.
    let integers = [-7.0, -2.0, -1.0, 0.0, 0.0, -4.0, -4.5, -5.0, -8.0];
    let floats = [-12.0, -3.5, -9.0, -9.0, 0.0, -9.0, -7.0, -5.0, -12.0];
    let powers = if is_float { floats } else { integers };
    let mut all = Vec::new();
    for (exponent, prior) in (-4..).zip(powers) {
        let power = power_of_ten(exponent);
        all.push(Scaling { scale: power, offset: 0.0, prior });
        if !is_float {
            for (mantissa, cost) in [(2.0, 6.0), (5.0, 6.0), (2.5, 7.0)] {
                all.push(Scaling { scale: mantissa * power, offset: 0.0, prior: prior - cost });
            }
        }
        all.push(Scaling { scale: 1.8 * power, offset: 32.0, prior: prior - 7.0 });
    }
    all
}

/// A power of ten; negative ones are exact to the last digit, which `powi` is not.
pub fn power_of_ten(exponent: i32) -> f64 {
    if exponent < 0 {
        1.0 / 10f64.powi(-exponent)
    } else {
        10f64.powi(exponent)
    }
}

/// The number of moments of the window that are looked at.
const MOMENTS: i64 = 33;

/// The probability that a right reading misses: a misread digit, or a clock that is wrong by more than stated.
const MISS: f64 = 2e-4;

/// The probability that a display shows more digits than the register has.
const FINER: f64 = 0.25;

/// The numbers that a reading had around a time at which a value was shown, with their weights.
#[derive(Debug)]
pub struct Window {
    /// The number held at a moment, the next one, and the weight of the moment.
    moments: Vec<(f64, f64, f64)>,
}

impl Window {
    /// Looks at a column around the time of a value; `None` if it has no samples there.
    pub fn new(column: &Column<'_>, shown: &Shown) -> Option<Self> {
        let block = column.block;
        let (at, within) = shown.at.unwrap_or_else(|| {
            let (first, last) = (block.times[0], block.times[block.len() - 1]);
            (i64::midpoint(first, last), (last - first) / 2)
        });
        if !block.covers(at) {
            return None;
        }
        let mut moments: Vec<(usize, usize, f64)> = Vec::new();
        for step in 0..MOMENTS {
            let share = (2 * step - (MOMENTS - 1)) as f64 / (MOMENTS - 1) as f64;
            let time = at + (within as f64 * share) as i64;
            // Clocks are nearer to the stated time than to the edge of the tolerance.
            let weight = if shown.at.is_some() { 1.5 - share.abs() } else { 1.0 };
            let held = block.at_or_before(time);
            match moments.last_mut() {
                Some(last) if last.0 == held => last.2 += weight,
                _ => moments.push((held, block.after(time), weight)),
            }
        }
        let total: f64 = moments.iter().map(|moment| moment.2).sum();
        let numbers = |(held, next, weight)| (column.get(held), column.get(next), weight / total);
        Some(Self { moments: moments.into_iter().map(numbers).collect() })
    }

    /// The probability that a display which shows this reading shows the value.
    pub fn chance(&self, shown: &Shown, scaling: &Scaling, is_float: bool) -> f64 {
        let (mut exact, mut cut, mut between, mut coarse) = (0.0, 0.0, 0.0, 0.0);
        let unit = shown.unit();
        let step = if is_float { unit } else { scaling.scale };
        for &(held, next, weight) in &self.moments {
            let first = held * scaling.scale + scaling.offset - shown.value;
            let second = next * scaling.scale + scaling.offset - shown.value;
            let nearest = first.abs().min(second.abs());
            if nearest <= 0.5 * unit * (1.0 + 1e-6) {
                exact += weight;
            } else if nearest < unit {
                cut += weight;
            } else if nearest <= 0.5 * step {
                coarse += weight;
            } else if first * second < 0.0 {
                between += weight;
            }
        }
        0.85 * exact + 0.06 * cut + 0.06 * between + FINER * unit / step.max(unit) * coarse + MISS
    }
}

/// The bits by which a display is expected to show fewer digits than the reading has.
pub fn digits_bits(shown: &[Shown], scaling: &Scaling, is_float: bool) -> f64 {
    if is_float {
        return 0.0;
    }
    let own = (0..6).find(|&digits| (scaling.scale * power_of_ten(digits)).fract().abs() < 1e-9).unwrap_or(6);
    let seen = shown.iter().map(|shown| shown.decimals).max().unwrap_or(0);
    -1.2 * f64::from((own - seen).max(0)) - 3.0 * f64::from((seen - own).max(0))
}
