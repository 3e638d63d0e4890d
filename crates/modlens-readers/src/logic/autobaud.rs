//! Detects baud rate, character format and polarity of a channel from its edges.
//!
//! The shortest pulses last one bit, which leaves few baud rates. Among all settings with these the number of bytes in
//! frames with a valid checksum decides, and where there are none, the number of characters without errors.

use crate::logic::edges::Edge;
use crate::logic::uart::{Character, UartReceiver};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::{LineSettings, Parity};
use modlens_protocol::recognize::valid_serial_bytes;

/// Baud rates that devices are commonly set to.
const BAUD_RATES: [u32; 18] = [
    300, 600, 1200, 2400, 4800, 9600, 14_400, 19_200, 28_800, 38_400, 56_000, 57_600, 76_800, 115_200, 128_000, 230_400, 460_800,
    921_600,
];

/// The deviation of the baud rate that sender and receiver together may have, as a share of it.
const BAUD_TOLERANCE: f64 = 0.045;

/// A longer pulse, in bits, is silence and not data.
const MAX_PULSE_BITS: f64 = 11.0;

/// Character formats as data bits, parity and half stop bits, the most common first.
const FORMATS: [(u8, Parity, u8); 7] = [
    (8, Parity::None, 2),
    (8, Parity::Even, 2),
    (8, Parity::Odd, 2),
    (8, Parity::None, 4),
    (7, Parity::Even, 2),
    (7, Parity::Odd, 2),
    (7, Parity::None, 4),
];

/// Possible settings of a channel with the evidence for them.
#[derive(Clone, Copy, Debug)]
pub struct ChannelSettings {
    /// Line settings.
    pub line: LineSettings,
    /// The idle level is low.
    pub inverted: bool,
    /// The number of bytes in frames with a valid checksum.
    pub valid_frame_bytes: usize,
    /// The number of characters.
    pub characters: usize,
    /// The number of characters with a wrong parity or stop bit.
    pub error_characters: usize,
}

impl ChannelSettings {
    /// The order of settings: bytes in valid frames count first, then characters without errors.
    fn rank(&self) -> (usize, isize) {
        (self.valid_frame_bytes, self.characters as isize - 4 * self.error_characters as isize)
    }
}

/// The best settings for a channel with these edges, whose level is known up to the sample `now`. `rate` is the number of
/// samples per second; `line` and `inverted` are not detected where they are known. `None` if no character is decoded.
pub fn detect_settings(
    functions: &Functions,
    edges: &[Edge],
    now: u64,
    rate: f64,
    line: Option<LineSettings>,
    inverted: Option<bool>,
) -> Option<ChannelSettings> {
    let all =
        |baud: u32| FORMATS.map(|(data_bits, parity, half_stop_bits)| LineSettings { baud, data_bits, parity, half_stop_bits });
    let lines = line.map_or_else(|| baud_rates(edges, rate).into_iter().flat_map(all).collect(), |line| vec![line]);
    let polarities = inverted.map_or_else(|| vec![is_idle_low(edges, now), !is_idle_low(edges, now)], |it| vec![it]);
    let mut best: Option<ChannelSettings> = None;
    for &line in &lines {
        for &inverted in &polarities {
            let found = try_settings(functions, edges, now, rate, line, inverted);
            // Of equally good settings the first is kept: 8N1 before 8N2, and the polarity that the idle level suggests.
            if best.is_none_or(|best| found.rank() > best.rank()) {
                best = Some(found);
            }
        }
    }
    best.filter(|best| best.characters > 0)
}

/// Decodes the channel with these settings and counts what speaks for them.
fn try_settings(
    functions: &Functions,
    edges: &[Edge],
    now: u64,
    rate: f64,
    line: LineSettings,
    inverted: bool,
) -> ChannelSettings {
    let mut uart = UartReceiver::new(line, rate, inverted);
    for &edge in edges {
        uart.push_edge(edge);
    }
    let found: Vec<Character> = std::iter::from_fn(|| uart.next(now)).collect();
    let bytes: Vec<u8> = found.iter().map(|it| it.byte).collect();
    let error_characters = found.iter().filter(|it| it.has_error()).count();
    ChannelSettings {
        line,
        inverted,
        valid_frame_bytes: valid_serial_bytes(functions, &bytes),
        characters: found.len(),
        error_characters,
    }
}

/// Whether the channel is low for most of the time, because a bus is silent longer than it carries data.
fn is_idle_low(edges: &[Edge], now: u64) -> bool {
    let ends = edges.iter().skip(1).map(|edge| edge.sample).chain([now]);
    let mut times = [0u64; 2];
    for (edge, end) in edges.iter().zip(ends) {
        times[usize::from(edge.is_high)] += end - edge.sample;
    }
    times[0] > times[1]
}

/// The baud rates that fit the lengths of the pulses, best first, at most three. If no common rate fits, the measured one
/// is among them.
fn baud_rates(edges: &[Edge], rate: f64) -> Vec<u32> {
    let pulses: Vec<f64> = edges.windows(2).map(|two| (two[1].sample - two[0].sample) as f64).collect();
    let mut sorted = pulses.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    // The shortest 2 % of the pulses are ignored, because glitches are shorter than any bit.
    let Some(&shortest) = sorted.get(sorted.len() / 50) else { return Vec::new() };
    // The average distance of the pulses from a whole number of bits.
    let misfit = |baud: u32| {
        let bit = rate / f64::from(baud);
        let bits = pulses.iter().map(|pulse| pulse / bit).filter(|bits| *bits < MAX_PULSE_BITS);
        let (count, sum) = bits.fold((0.0, 0.0), |(count, sum), bits| (count + 1.0, sum + (bits - bits.round().max(1.0)).abs()));
        if count > 0.0 {
            sum / count
        } else {
            f64::INFINITY
        }
    };
    let near = |baud: &u32| {
        let bits = shortest * f64::from(*baud) / rate;
        // The shortest pulse lasts one bit, or two where the data have no single bit between two edges.
        (bits - 1.0).abs() < 8.0 * BAUD_TOLERANCE || (bits - 2.0).abs() < 4.0 * BAUD_TOLERANCE
    };
    let mut fitting: Vec<(f64, u32)> = BAUD_RATES.iter().copied().filter(near).map(|baud| (misfit(baud), baud)).collect();
    let measured = (rate / shortest).round() as u32;
    if !fitting.iter().any(|(misfit, _)| *misfit < 2.0 * BAUD_TOLERANCE) && measured > 0 {
        fitting.push((misfit(measured), measured));
    }
    fitting.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    fitting.into_iter().take(3).map(|(_, baud)| baud).collect()
}
