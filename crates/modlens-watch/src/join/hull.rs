//! Bounds of a drift that hold whatever the delays are: straight lines between two hulls.

/// Corners of a hull that are kept; more would be a clock that does not run evenly.
const MAX_CORNERS: usize = 512;

/// The lower hull of one series and the upper hull of another one, as corners of time and difference in seconds.
#[derive(Debug, Default)]
pub(super) struct Hulls {
    upper: Vec<(f64, f64)>,
    lower: Vec<(f64, f64)>,
}

impl Hulls {
    /// Adds what lies above the line and what lies below it; times do not fall.
    pub fn add(&mut self, at: f64, above: f64, below: f64) {
        push(&mut self.upper, (at, above), 1.0);
        push(&mut self.lower, (at, below), -1.0);
    }

    /// The least and the greatest slope of a line that stays between the hulls, each of which may be wrong by `slack`. Where
    /// there is no such line, the least is above the greatest.
    pub fn slopes(&self, slack: f64) -> (f64, f64) {
        let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
        for (at, low) in &self.lower {
            for (other, high) in &self.upper {
                let rise = high - low + 2.0 * slack;
                if other > at {
                    most = most.min(rise / (other - at));
                } else if other < at {
                    least = least.max(rise / (other - at));
                } else if rise < 0.0 {
                    return (f64::INFINITY, f64::NEG_INFINITY);
                }
            }
        }
        (least, most)
    }
}

/// Appends a corner to the lower hull, or with sign -1 to the upper one.
fn push(hull: &mut Vec<(f64, f64)>, corner: (f64, f64), sign: f64) {
    if let Some(last) = hull.last().copied().filter(|last| last.0 >= corner.0) {
        if sign * (last.1 - corner.1) <= 0.0 {
            return;
        }
        hull.pop();
    }
    while let [.., a, b] = hull[..] {
        if sign * ((b.1 - a.1) * (corner.0 - a.0) - (corner.1 - a.1) * (b.0 - a.0)) < 0.0 {
            break;
        }
        hull.pop();
    }
    if hull.len() < MAX_CORNERS {
        hull.push(corner);
    }
}
