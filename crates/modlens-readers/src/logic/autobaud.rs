//! What line is it? Baud rate, parity and polarity of a channel, from its edges.
//!
//! The shortest pulses are one bit; which settings are right is what the checksums of the frames say, and where there
//! are none, which settings leave the fewest characters marked.

use crate::logic::edges::Edge;
use crate::logic::uart::{Character, UartReceiver};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::{Line, Parity};
use modlens_protocol::recognize::evidence_bytes;

/// Rates that devices are set to.
const RATES: [u32; 18] = [
    300, 600, 1200, 2400, 4800, 9600, 14_400, 19_200, 28_800, 38_400, 56_000, 57_600, 76_800, 115_200, 128_000, 230_400, 460_800,
    921_600,
];

/// What a receiver tolerates, sender and receiver together.
const TOLERANCE: f64 = 0.045;

/// Pulses longer than this many bits are silence, not data.
const LONGEST: f64 = 11.0;

/// Character formats, the most common first.
const FORMATS: [(u8, Parity, u8); 7] = [
    (8, Parity::None, 2),
    (8, Parity::Even, 2),
    (8, Parity::Odd, 2),
    (8, Parity::None, 4),
    (7, Parity::Even, 2),
    (7, Parity::Odd, 2),
    (7, Parity::None, 4),
];

/// ChannelSettings of a channel, and what speaks for them.
#[derive(Clone, Copy, Debug)]
pub struct ChannelSettings {
    /// Line settings.
    pub line: Line,
    /// The idle level is low.
    pub inverted: bool,
    /// Bytes in frames with a right checksum.
    pub good: usize,
    /// Characters.
    pub characters: usize,
    /// Characters with a wrong parity or stop bit.
    pub marked: usize,
}

impl ChannelSettings {
    /// More is better: checksums first, then clean characters.
    fn rank(&self) -> (usize, isize) {
        (self.good, self.characters as isize - 4 * self.marked as isize)
    }
}

/// The best settings for a channel with these edges, `now` samples into it. What is known is not guessed.
pub fn guess(
    functions: &Functions,
    edges: &[Edge],
    now: u64,
    rate: f64,
    line: Option<Line>,
    inverted: Option<bool>,
) -> Option<ChannelSettings> {
    let all = |baud: u32| FORMATS.map(|(data_bits, parity, stop_halves)| Line { baud, data_bits, parity, stop_halves });
    let lines = line.map_or_else(|| baud_rates(edges, rate).into_iter().flat_map(all).collect(), |line| vec![line]);
    let polarities = inverted.map_or_else(|| vec![idle_low(edges, now), !idle_low(edges, now)], |it| vec![it]);
    let mut best: Option<ChannelSettings> = None;
    for &line in &lines {
        for &inverted in &polarities {
            let found = attempt(functions, edges, now, rate, line, inverted);
            // Of equals the first one: 8N1 before 8N2, the line's idle level as it looks.
            if best.is_none_or(|best| found.rank() > best.rank()) {
                best = Some(found);
            }
        }
    }
    best.filter(|best| best.characters > 0)
}

fn attempt(functions: &Functions, edges: &[Edge], now: u64, rate: f64, line: Line, inverted: bool) -> ChannelSettings {
    let mut uart = UartReceiver::new(line, rate, inverted);
    for &edge in edges {
        uart.edge(edge);
    }
    let found: Vec<Character> = std::iter::from_fn(|| uart.next(now)).collect();
    let bytes: Vec<u8> = found.iter().map(|it| it.byte).collect();
    let marked = found.iter().filter(|it| it.marked()).count();
    ChannelSettings { line, inverted, good: evidence_bytes(functions, &bytes), characters: found.len(), marked }
}

/// Whether the line is low for most of the time: silence is longer than talk.
fn idle_low(edges: &[Edge], now: u64) -> bool {
    let ends = edges.iter().skip(1).map(|edge| edge.sample).chain([now]);
    let mut times = [0u64; 2];
    for (edge, end) in edges.iter().zip(ends) {
        times[usize::from(edge.high)] += end - edge.sample;
    }
    times[0] > times[1]
}

/// The rates that fit the pulses, best first, three at most.
fn baud_rates(edges: &[Edge], rate: f64) -> Vec<u32> {
    let pulses: Vec<f64> = edges.windows(2).map(|two| (two[1].sample - two[0].sample) as f64).collect();
    let mut sorted = pulses.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    // A few glitches are shorter than any bit.
    let Some(&shortest) = sorted.get(sorted.len() / 50) else { return Vec::new() };
    let misfit = |baud: u32| {
        let bit = rate / f64::from(baud);
        let bits = pulses.iter().map(|pulse| pulse / bit).filter(|bits| *bits < LONGEST);
        let (count, sum) = bits.fold((0.0, 0.0), |(count, sum), bits| (count + 1.0, sum + (bits - bits.round().max(1.0)).abs()));
        if count > 0.0 {
            sum / count
        } else {
            f64::INFINITY
        }
    };
    let near = |baud: &u32| {
        let bits = shortest * f64::from(*baud) / rate;
        // The shortest pulse is one bit, two where no single bit stands alone.
        (bits - 1.0).abs() < 8.0 * TOLERANCE || (bits - 2.0).abs() < 4.0 * TOLERANCE
    };
    let mut fitting: Vec<(f64, u32)> = RATES.iter().copied().filter(near).map(|baud| (misfit(baud), baud)).collect();
    let measured = (rate / shortest).round() as u32;
    if !fitting.iter().any(|(misfit, _)| *misfit < 2.0 * TOLERANCE) && measured > 0 {
        fitting.push((misfit(measured), measured));
    }
    fitting.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    fitting.into_iter().take(3).map(|(_, baud)| baud).collect()
}
