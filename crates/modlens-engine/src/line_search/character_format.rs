//! Finds data bits, parity and stop bits of a line whose rate is known.
//!
//! While the rate is searched, three character formats are tried. 8E1 has eleven bits: 8O1 and 8N2 can be received with it as
//! well, with line errors where the driver checks parity; where it takes such bytes out (`SearchOptions::drops_damaged`), 8O1 is
//! tried, too. 8N1 has ten bits: 7E1, 7O1 and 7N2 can be received with it, with their parity or stop bit in bit 7. 7N1 has nine
//! bits. Once frames are received, the formats are tried that could also have given these bytes, until one is received without
//! line errors.

use modlens_protocol::framing::Mode;
use modlens_protocol::line::{LineSettings, Parity};

use super::options::SearchOptions;
use super::trial::{is_of_ascii_frames, Trial};

/// Data bits, parity and stop bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CharacterFormat {
    data_bits: u8,
    parity: Parity,
    half_stop_bits: u8,
}

impl CharacterFormat {
    const fn with_one_stop_bit(data_bits: u8, parity: Parity) -> Self {
        Self { data_bits, parity, half_stop_bits: 2 }
    }

    /// That of these settings.
    pub fn of(line: LineSettings) -> Self {
        Self { data_bits: line.data_bits, parity: line.parity, half_stop_bits: line.half_stop_bits }
    }

    /// The settings with this rate.
    pub fn at(self, baud: u32) -> LineSettings {
        LineSettings { baud, data_bits: self.data_bits, parity: self.parity, half_stop_bits: self.half_stop_bits }
    }
}

const EVEN: CharacterFormat = CharacterFormat::with_one_stop_bit(8, Parity::Even);
const NONE: CharacterFormat = CharacterFormat::with_one_stop_bit(8, Parity::None);
const SEVEN: CharacterFormat = CharacterFormat::with_one_stop_bit(7, Parity::None);
const ODD: CharacterFormat = CharacterFormat::with_one_stop_bit(8, Parity::Odd);
/// 8M1 is the same on the line as 8N2: the first of two stop bits is a parity bit that is always 1.
const MARK: CharacterFormat = CharacterFormat::with_one_stop_bit(8, Parity::Mark);

/// What is tried at each rate: characters of eleven, ten and nine bits, and odd parity where it cannot be received as even.
pub(super) const FORMATS: [CharacterFormat; 4] = [EVEN, NONE, SEVEN, ODD];

/// Bytes needed to confirm a format.
const CONFIRM_BYTES: usize = 20;
/// Bytes without a frame after which a format is given up, where the driver marks no errors.
const MAX_BYTES_WITHOUT_FRAME: usize = 72;
/// A format fits that has no larger share of line errors.
const MAX_ERROR_SHARE: f64 = 0.03;
/// Bit 7 is a data bit below the first share, a stop bit above the other, and parity between them.
const ALWAYS_0_SHARE: f64 = 0.1;
const ALWAYS_1_SHARE: f64 = 0.9;

/// The search, from a trial at the right rate in which frames were received.
pub(super) struct FormatSearch {
    pub mode: Mode,
    /// The settings, once they are known.
    pub line: Option<LineSettings>,
    /// Until then, those to listen with next.
    pub candidate: LineSettings,
    /// The evidence in words.
    pub error_shares: Vec<String>,
    candidates: Vec<LineSettings>,
    marks_errors: bool,
    /// What bit 7 is in Modbus ASCII, where it is no data.
    bit_7: Option<Parity>,
    fallback: LineSettings,
}

impl FormatSearch {
    /// Begins; `line` may be known at once.
    pub fn new(trial: &Trial, mode: Mode, options: SearchOptions) -> Self {
        let marks_errors = options.marks_errors;
        let format = CharacterFormat::of(trial.line);
        let others: &[CharacterFormat] = match (marks_errors, format) {
            (false, _) => &[NONE],
            (true, EVEN) => &[EVEN, MARK, NONE, ODD],
            (true, _) => &[MARK, NONE],
        };
        let mut candidates: Vec<LineSettings> = others.iter().map(|other| other.at(trial.line.baud)).collect();
        let candidate = candidates.remove(0);
        let bit_7 = if mode == Mode::Ascii { bit_7_of(trial) } else { None };
        let (error_shares, fallback) = (Vec::new(), trial.line);
        let mut search = Self { mode, line: None, candidate, error_shares, candidates, marks_errors, bit_7, fallback };
        let is_clean = format == EVEN && marks_errors && trial.marked_bytes == 0;
        if format == SEVEN || is_clean || (!marks_errors && format == NONE) || options.drops_damaged {
            search.settle(trial.line);
        } else if !marks_errors {
            search.error_shares.push("not reported by the port, so even and odd parity cannot be distinguished".into());
        }
        search
    }

    /// Evaluates a trial of `candidate`; true if `line` is known now or `candidate` has changed, false if the trial has to go
    /// on. `fits` says whether frames with valid checksums were received in it.
    ///
    /// Where the port marks line errors, their share in the trial decides alone, `fits` does not; the last candidate is taken
    /// whatever its share. Where it marks none, there is a single candidate: it is taken if frames were received, and after
    /// `MAX_BYTES_WITHOUT_FRAME` without one the format that the search began with (`fallback`).
    pub fn evaluate(&mut self, trial: &Trial, fits: bool) -> bool {
        if !self.marks_errors {
            if !fits && trial.bytes.len() < MAX_BYTES_WITHOUT_FRAME {
                return false;
            }
            self.settle(if fits { trial.line } else { self.fallback });
            return true;
        }
        if trial.settled_bytes < CONFIRM_BYTES {
            return false;
        }
        let share = trial.settled_errors as f64 / trial.settled_bytes as f64;
        self.error_shares.push(format!("{:.0}% at {}", 100.0 * share, trial.line));
        if share <= MAX_ERROR_SHARE || self.candidates.is_empty() {
            self.settle(trial.line);
        } else {
            self.candidate = self.candidates.remove(0);
        }
        true
    }

    /// Sets `line`: the settings whose characters are received without errors as `clean`.
    fn settle(&mut self, clean: LineSettings) {
        let format = CharacterFormat::of(clean);
        self.line = Some(match self.bit_7 {
            Some(parity) if format.data_bits == 8 => {
                let half_stop_bits = if format == NONE && parity != Parity::None { 2 } else { 4 };
                LineSettings { data_bits: 7, parity, half_stop_bits, ..clean }
            }
            _ if format == MARK => LineSettings { data_bits: 8, parity: Parity::None, half_stop_bits: 4, ..clean },
            _ => clean,
        });
    }
}

/// What bit 7 is in a trial of Modbus ASCII: parity, a stop bit (`Parity::None`), or data (`None`).
fn bit_7_of(trial: &Trial) -> Option<Parity> {
    let sound = match trial.settled_bytes {
        0 => &trial.bytes[..],
        settled => &trial.bytes[trial.bytes.len() - settled..],
    };
    let text: Vec<u8> = sound.iter().copied().filter(|byte| is_of_ascii_frames(*byte)).collect();
    let high = text.iter().filter(|byte| **byte & 0x80 != 0).count() as f64 / text.len().max(1) as f64;
    let odd = text.iter().filter(|byte| byte.count_ones() % 2 == 1).count();
    match high {
        _ if high < ALWAYS_0_SHARE => None,
        _ if high > ALWAYS_1_SHARE => Some(Parity::None),
        _ if 2 * odd > text.len() => Some(Parity::Odd),
        _ => Some(Parity::Even),
    }
}
