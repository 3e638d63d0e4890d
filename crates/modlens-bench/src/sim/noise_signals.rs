//! Noise that repeats itself: runs of one byte, square waves, floating lines, a poll at a wrong baud rate, another protocol.
//!
//! In uniform noise every accident of the checksum happens once. Here the same accident comes again and again.

use crate::checksum::{crc, crc_fits};
use crate::model::Settings;
use crate::rng::Rng;
use crate::sim::uart::{receive_signal, receive_with_wrong_settings};

/// Runs of one byte: a line that is held, a wedged sender, a cleared buffer. Half of the runs are of 00 or FF.
pub(crate) fn runs(rng: &mut Rng, count: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(count);
    while bytes.len() < count {
        let value = match rng.below(4) {
            0 => 0x00,
            1 => 0xFF,
            _ => rng.byte(),
        };
        let length = rng.range(3, 300);
        bytes.resize(bytes.len() + length, value);
    }
    bytes.truncate(count);
    bytes
}

/// What a receiver makes of a square wave whose period and duty drift slowly: values with one run of zero bits, each of
/// them many times.
pub(crate) fn slow_squares(rng: &mut Rng, count: usize) -> Vec<u8> {
    let mut received = Vec::with_capacity(count);
    while received.len() < count {
        let (mut low, mut high) = (rng.uniform(0.6, 12.0), rng.uniform(0.6, 30.0));
        let waves = rng.range(50, 2000);
        let drift = [rng.uniform(-0.004, 0.004), rng.uniform(-0.004, 0.004)];
        let mut levels = Vec::with_capacity(2 * waves);
        for _ in 0..waves {
            levels.extend([(low, false), (high, true)]);
            low = (low + drift[0]).clamp(0.6, 12.0);
            high = (high + drift[1]).clamp(0.6, 30.0);
        }
        received.extend(receive_signal(&levels));
    }
    received.truncate(count);
    received
}

/// What a receiver makes of a line that nobody drives: levels of random lengths, in spells of slow and fast changes.
pub(crate) fn floating(rng: &mut Rng, count: usize) -> Vec<u8> {
    let mut received = Vec::with_capacity(count);
    while received.len() < count {
        let (low, high) = (rng.uniform(0.5, 20.0), rng.uniform(0.5, 20.0));
        let levels: Vec<(f64, bool)> = (0..rng.range(100, 2000))
            .flat_map(|_| [(0.2 + rng.exponential(low), false), (0.2 + rng.exponential(high), true)])
            .collect();
        received.extend(receive_signal(&levels));
    }
    received.truncate(count);
    received
}

/// A few exchanges again and again, received with a wrong baud rate, until there are so many bytes.
pub(crate) fn repeating_poll(exchanges: &[(u8, i64)], sender: Settings, baud: u32, count: usize) -> Vec<(u8, i64)> {
    let period = exchanges.last().map_or(0, |last| last.1) + 20_000_000;
    let mut received: Vec<(u8, i64)> = Vec::with_capacity(count);
    for round in 0.. {
        if received.len() >= count {
            break;
        }
        // The sender's clock and the receiver's are not the same, so that the samples drift by a fraction of a bit.
        let from = period * round + (round % 97) * 1_300;
        let chars: Vec<(u8, i64)> = exchanges.iter().map(|&(byte, time)| (byte, time + from)).collect();
        let heard = receive_with_wrong_settings(&chars, sender, baud, false);
        if heard.is_empty() {
            break;
        }
        received.extend(heard);
    }
    received.truncate(count);
    received
}

/// A telegram of another protocol in which a substring has a valid CRC by chance: such telegrams are rare, but where one is
/// repeated with the same payload, the accident is as well. It looks like a frame of `unit`, with a function code of Modbus.
pub(crate) fn foreign_telegram(unit: u8, rng: &mut Rng) -> Vec<u8> {
    let (function, length) = (rng.pick(&[1, 2, 3, 4, 6, 16, 0x83]), rng.range(2, 9));
    let mut accident = vec![unit, function];
    accident.extend((0..length).map(|_| rng.byte()));
    accident.extend(crc(&accident).to_le_bytes());
    debug_assert!(crc_fits(&accident));
    let mut telegram = vec![0x68, 0x10, 0xAA];
    telegram.extend((0..rng.range(3, 8)).map(|_| rng.byte()));
    telegram.extend(accident);
    telegram.extend((0..rng.range(2, 8)).map(|_| rng.byte()));
    telegram.push(0x16);
    telegram
}

/// One to three telegrams of another protocol again and again, in spells with and without a counter between them.
pub(crate) fn foreign(rng: &mut Rng, count: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(count);
    let telegrams: Vec<Vec<u8>> = (0..rng.range(1, 3)).map(|_| foreign_telegram(rng.range(1, 30) as u8, rng)).collect();
    while bytes.len() < count {
        let has_counter = rng.chance(0.5);
        for round in 0..rng.range(20, 300) {
            for telegram in &telegrams {
                bytes.extend(telegram);
                if has_counter {
                    bytes.extend([0x68, 0x04, round as u8, 0x16]);
                }
            }
        }
    }
    bytes.truncate(count);
    bytes
}
