//! From evidence to the confidence that is printed: log2 odds that a row is right.
//!
//! The search measures by how many bits a frame leads its rivals. That is not the odds that it is right: where everything
//! agrees, the bits add up beyond what any simulation can bear out, and some frames have a likeness that no lead shows, such
//! as a write that equals its response. So the odds were counted on simulated lines, by lead and by what the layouts of the
//! function leave open, and the counted odds are what is printed: `modlens-bench calibration` counts them again.

use crate::weights::{self, EQUAL_LAYOUTS_ODDS_BITS, OPEN_LENGTH_ODDS_BITS, SPECIFIED_ODDS_BITS};
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::{FunctionRow, Functions, Layout, EXCEPTION_BIT};

/// What the layouts of a function leave open about one of its frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Likeness {
    /// Nothing: lengths are specified, and requests differ from responses.
    Specified,
    /// Its response may equal its request, so the direction is open.
    EqualLayouts,
    /// Any length would do, so the end is open, and mostly the direction as well.
    OpenLength,
}

impl Likeness {
    /// That of frames which begin like this: unit, function code, and more.
    pub fn of_frame(functions: &Functions, frame: &[u8]) -> Self {
        let code = frame[1];
        if code & EXCEPTION_BIT != 0 {
            return Self::Specified;
        }
        functions.row(code, &frame[2..]).map_or(Self::OpenLength, Self::of_function)
    }

    fn of_function(row: &FunctionRow) -> Self {
        let is_specified = |layout: &Layout| matches!(layout, Layout::Body(_));
        match row.has_equal_layouts {
            _ if !is_specified(&row.request) || !is_specified(&row.response) => Self::OpenLength,
            true => Self::EqualLayouts,
            false => Self::Specified,
        }
    }

    /// That of a request and the response which has to equal it, or not.
    pub fn of_exchange(echoes_request: bool) -> Self {
        if echoes_request {
            Self::EqualLayouts
        } else {
            Self::Specified
        }
    }
}

/// How a frame of RTU stands among other bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Among other frames.
    Among,
    /// After bytes that may hide a damaged frame.
    InNoise,
    /// It stood alone in the same noise before: its valid CRC is no news.
    Recurring,
}

/// The confidence of a frame of RTU that leads all rivals by so many bits.
pub fn of_rtu_frame(lead: f32, likeness: Likeness, standing: Standing) -> u8 {
    let bits = match likeness {
        Likeness::Specified => between(SPECIFIED_ODDS_BITS, lead),
        Likeness::EqualLayouts => between(EQUAL_LAYOUTS_ODDS_BITS, lead),
        Likeness::OpenLength => between(OPEN_LENGTH_ODDS_BITS, lead),
    };
    match standing {
        Standing::Among => bits as u8,
        Standing::InNoise => (bits - weights::NOISE_ODDS_BITS) as u8,
        Standing::Recurring => weights::RECURRING_ODDS_BITS,
    }
}

/// The confidence of a frame that is unambiguous, so that nothing was searched: as with the largest lead.
#[inline]
pub fn of_unambiguous(likeness: Likeness) -> u8 {
    let [.., (_, most)] = match likeness {
        Likeness::Specified => SPECIFIED_ODDS_BITS,
        Likeness::EqualLayouts => EQUAL_LAYOUTS_ODDS_BITS,
        Likeness::OpenLength => OPEN_LENGTH_ODDS_BITS,
    };
    most as u8
}

/// The most that a frame may have by the log2 odds of its direction, as the search states them.
#[inline]
pub fn of_direction(odds: f32) -> u8 {
    if odds >= weights::CERTAIN_DIRECTION_BITS {
        return u8::MAX;
    }
    between(weights::DIRECTION_ODDS_BITS, odds) as u8
}

/// The confidence of a row that is no good frame.
pub fn of_verdict(verdict: Verdict) -> u8 {
    match verdict {
        Verdict::BadChecksum | Verdict::Incomplete => weights::DAMAGED_CONFIDENCE_BITS,
        Verdict::NoChecksum => weights::NO_CHECKSUM_CONFIDENCE_BITS,
        // Noise claims nothing, and the framer of a good frame says how good it is.
        Verdict::Noise | Verdict::Ok => 0,
    }
}

/// The value at `lead` of a line through these points (lead, bits), which is level after the last one.
fn between<const N: usize>(points: [(f32, f32); N], lead: f32) -> f32 {
    let segment = points.windows(2).find(|ends| lead < ends[1].0);
    let Some(&[(from, low), (to, high)]) = segment.and_then(|ends| ends.first_chunk()) else { return points[N - 1].1 };
    low + (high - low) * (lead.max(from) - from) / (to - from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::{MAX_CONFIDENCE_BITS, MIN_FIRM_BITS};

    const KINDS: [Likeness; 3] = [Likeness::Specified, Likeness::EqualLayouts, Likeness::OpenLength];

    #[test]
    fn more_lead_is_more_confidence_up_to_where_the_evidence_ends() {
        for kind in KINDS {
            let bits: Vec<u8> = (0..=100).map(|lead| of_rtu_frame(lead as f32, kind, Standing::Among)).collect();
            assert!(bits.windows(2).all(|pair| pair[0] <= pair[1]), "{kind:?} {bits:?}");
            assert!(bits[0] < MIN_FIRM_BITS, "{kind:?}: no lead is firm");
            assert_eq!((bits[100], of_unambiguous(kind)), (bits[60], bits[60]), "{kind:?}");
            assert!(bits[100] <= MAX_CONFIDENCE_BITS);
        }
    }

    #[test]
    fn points_are_met_and_joined() {
        let points = [(0.0, 2.0), (4.0, 6.0), (10.0, 6.0), (20.0, 8.0), (60.0, 16.0)];
        for (lead, bits) in [(-5.0, 2.0), (0.0, 2.0), (1.0, 3.0), (4.0, 6.0), (9.0, 6.0), (15.0, 7.0), (60.0, 16.0), (99.0, 16.0)]
        {
            assert!((between(points, lead) - bits).abs() < 1e-5, "{lead}");
        }
    }

    #[test]
    fn functions_are_told_by_their_layouts() {
        let functions = Functions::embedded();
        let of = |code: u8| Likeness::of_frame(functions, &[1, code, 0, 0, 0, 1, 0, 0]);
        for (code, likeness) in [
            (3, Likeness::Specified),
            (16, Likeness::Specified),
            (0x83, Likeness::Specified),
            (6, Likeness::EqualLayouts),
            (22, Likeness::EqualLayouts),
            (100, Likeness::OpenLength),
        ] {
            assert_eq!(of(code), likeness, "{code}");
        }
    }
}
