//! Simulates a receiver with wrong settings: another baud rate, or swapped wires.

use crate::model::Settings;

/// A change of the line's level.
#[derive(Clone, Copy, Debug)]
struct LevelChange {
    time: f64,
    is_high: bool,
}

/// The characters that a receiver with 8N1 at `baud` decodes from those of a sender. Times are those of the ends of the last
/// stop bits, in ns.
pub(crate) fn receive_with_wrong_settings(chars: &[(u8, i64)], sender: Settings, baud: u32, inverted: bool) -> Vec<(u8, i64)> {
    receive(&edges(chars, sender, inverted), 1e9 / f64::from(baud))
}

/// The values that a receiver decodes from a signal of levels, each with its duration in bits. A break or a wrong stop bit goes
/// unnoticed.
pub(crate) fn receive_signal(levels: &[(f64, bool)]) -> Vec<u8> {
    let mut time = 0.0;
    let mut edges: Vec<LevelChange> = Vec::with_capacity(levels.len());
    for &(bits, is_high) in levels {
        if edges.last().is_none_or(|last| last.is_high != is_high) {
            edges.push(LevelChange { time, is_high });
        }
        time += bits;
    }
    receive(&edges, 1.0).into_iter().map(|(byte, _)| byte).collect()
}

/// The level changes that a sender makes on the line.
fn edges(chars: &[(u8, i64)], sender: Settings, inverted: bool) -> Vec<LevelChange> {
    let bit_ns = 1e9 / f64::from(sender.baud);
    let mut edges: Vec<LevelChange> = Vec::with_capacity(6 * chars.len());
    // The idle line is high.
    let mut is_high = true;
    for &(value, end) in chars {
        let start = end as f64 - sender.char_ns();
        let even = value.count_ones() % 2 == 1;
        for bit in 0..sender.bits() {
            let data = u32::from(sender.data_bits);
            let level = match bit {
                0 => false,
                _ if bit <= data => value >> (bit - 1) & 1 == 1,
                _ if bit == data + 1 && sender.has_even_parity => even,
                _ => true,
            };
            if level != is_high {
                is_high = level;
                edges.push(LevelChange { time: start + f64::from(bit) * bit_ns, is_high: is_high != inverted });
            }
        }
    }
    edges
}

/// Decodes edges like a UART: a falling edge begins a character, each bit is sampled in its middle, and a wrong stop bit is
/// ignored.
fn receive(edges: &[LevelChange], bit_ns: f64) -> Vec<(u8, i64)> {
    let mut received = Vec::new();
    let mut at = 0;
    while at < edges.len() {
        if edges[at].is_high {
            at += 1;
            continue;
        }
        let start = edges[at].time;
        let mut now = at;
        let mut level = |bits: f64| {
            while now + 1 < edges.len() && edges[now + 1].time <= start + bits * bit_ns {
                now += 1;
            }
            (edges[now].is_high, now)
        };
        if level(0.5).0 {
            // A spike, not a start bit.
            at += 1;
            continue;
        }
        let value = (0..8).fold(0u8, |value, bit| value | u8::from(level(1.5 + f64::from(bit)).0) << bit);
        at = level(9.5).1 + 1;
        received.push((value, (start + 10.0 * bit_ns).round() as i64));
    }
    received
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chars(settings: Settings) -> Vec<(u8, i64)> {
        (0..=255u8).map(|at| (at, 1_000_000_000 + ((f64::from(at) + 1.0) * settings.char_ns()) as i64)).collect()
    }

    #[test]
    fn the_right_baud_rate_receives_everything() {
        let settings = Settings { baud: 9600, data_bits: 8, has_even_parity: false };
        let sent = chars(settings);
        let received = receive_with_wrong_settings(&sent, settings, 9600, false);
        assert_eq!(received.iter().map(|(byte, _)| *byte).collect::<Vec<_>>(), (0..=255).collect::<Vec<u8>>());
        assert!(received.iter().zip(&sent).all(|(a, b)| (a.1 - b.1).abs() < 1000));
    }

    #[test]
    fn half_and_double() {
        let settings = Settings { baud: 9600, data_bits: 8, has_even_parity: false };
        // At twice the rate every bit is sampled twice, so a character becomes about two.
        assert!(receive_with_wrong_settings(&chars(settings), settings, 19_200, false).len() > 300);
        assert!(receive_with_wrong_settings(&chars(settings), settings, 4800, false).len() < 200);
        assert!(!receive_with_wrong_settings(&chars(settings), settings, 9600, true).is_empty());
    }
}
