//! Noise of several kinds, in which an analyzer must not find frames.

use crate::model::Framing;
use crate::rng::Rng;
use crate::sim::case::{Case, CaseLine, Traffic, TrafficLine};
use crate::sim::noise_signals::{floating, foreign, repeating_poll, runs, slow_squares};
use crate::sim::scenario::Scenario;
use crate::sim::tap::{TapMode, TapRead};
use crate::sim::uart::receive_with_wrong_settings;

/// The number of frames of clean traffic before the noise of a warm run.
pub const WARM_UP_FRAMES: usize = 3000;

/// A kind of noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// All bytes equally likely.
    Uniform,
    /// 60 % 00, 30 % FF, the rest random.
    ZerosOnes,
    /// The 13 values of `BUS_VALUES`.
    Bus,
    /// Bytes with a single bit set.
    SingleBit,
    /// Clean traffic received with a wrong baud rate.
    WrongBaud,
    /// Clean traffic received on swapped wires.
    Inverted,
    /// Runs of one byte.
    Runs,
    /// A square wave whose period drifts slowly.
    SlowSquares,
    /// A line that nobody drives.
    Floating,
    /// A few exchanges again and again, received with a wrong baud rate.
    RepeatingPoll,
    /// Another protocol, whose telegrams with constant payload have a substring with a valid CRC.
    Foreign,
}

/// Values that a floating or badly biased bus yields, and values that are common in the headers of frames.
const BUS_VALUES: [u8; 13] = [0x00, 0xFF, 0xFE, 0xFC, 0xF8, 0xF0, 0xE0, 0xC0, 0x80, 0x01, 0x03, 0x10, 0x55];

/// Baud rates that are set by mistake.
const BAUDS: [u32; 8] = [1200, 2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200];

impl Pattern {
    /// All kinds of noise.
    pub const ALL: [Self; 11] = [
        Self::Uniform,
        Self::ZerosOnes,
        Self::Bus,
        Self::SingleBit,
        Self::WrongBaud,
        Self::Inverted,
        Self::Runs,
        Self::SlowSquares,
        Self::Floating,
        Self::RepeatingPoll,
        Self::Foreign,
    ];

    /// The name in tables and on the command line.
    pub fn text(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::ZerosOnes => "00_ff",
            Self::Bus => "bus13",
            Self::SingleBit => "single_bit",
            Self::WrongBaud => "wrong_baud",
            Self::Inverted => "inverted",
            Self::Runs => "runs",
            Self::SlowSquares => "slow_squares",
            Self::Floating => "floating",
            Self::RepeatingPoll => "repeating_poll",
            Self::Foreign => "foreign",
        }
    }

    /// The pattern of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pattern| pattern.text() == name)
    }

    /// So many bytes of this noise.
    pub fn bytes(self, seed: u64, count: usize) -> Vec<u8> {
        if self.has_own_times() {
            return self.wrongly_received(seed, count).into_iter().map(|(byte, _)| byte).collect();
        }
        let mut rng = Rng::new(seed, self.text());
        match self {
            Self::Runs => runs(&mut rng, count),
            Self::SlowSquares => slow_squares(&mut rng, count),
            Self::Floating => floating(&mut rng, count),
            Self::Foreign => foreign(&mut rng, count),
            _ => (0..count).map(|_| self.byte(&mut rng)).collect(),
        }
    }

    /// Whether the times of the bytes follow from what was sent, and are not made up.
    fn has_own_times(self) -> bool {
        matches!(self, Self::WrongBaud | Self::Inverted | Self::RepeatingPoll)
    }

    fn byte(self, rng: &mut Rng) -> u8 {
        match self {
            Self::ZerosOnes => match rng.below(10) {
                0..=5 => 0x00,
                6..=8 => 0xFF,
                _ => rng.byte(),
            },
            Self::Bus => rng.pick(&BUS_VALUES),
            Self::SingleBit => 1 << rng.below(8),
            _ => rng.byte(),
        }
    }

    /// Clean traffic of several buses one after the other, each received with wrong settings.
    fn wrongly_received(self, seed: u64, count: usize) -> Vec<(u8, i64)> {
        let clean = Scenario::named("clean").expect("the first row of the table");
        let mut rng = Rng::new(seed, self.text());
        let mut received: Vec<(u8, i64)> = Vec::with_capacity(count);
        while received.len() < count {
            let traffic = Traffic::simulate(clean, rng.bits(), WARM_UP_FRAMES);
            let line = &traffic.lines[0];
            let from = received.last().map_or(0, |last| last.1);
            let chars: Vec<(u8, i64)> = line.bytes.iter().zip(&line.times).map(|(&b, &t)| (b, t + from)).collect();
            let baud = match self {
                Self::Inverted => traffic.settings.baud,
                _ => other_baud(traffic.settings.baud, &mut rng),
            };
            if self == Self::RepeatingPoll {
                let exchanges = some_exchanges(&traffic, &mut rng);
                let heard = repeating_poll(&exchanges, traffic.settings, baud, 20_000);
                received.extend(heard.into_iter().map(|(byte, time)| (byte, time + from)));
                continue;
            }
            received.extend(receive_with_wrong_settings(&chars, traffic.settings, baud, self == Self::Inverted));
        }
        received.truncate(count);
        received
    }
}

/// A baud rate that is set by mistake.
pub(crate) fn other_baud(baud: u32, rng: &mut Rng) -> u32 {
    loop {
        let other = rng.pick(&BAUDS);
        if other != baud {
            return other;
        }
    }
}

/// The bytes of two to eight successive frames of some traffic, with times from 0 on.
pub(crate) fn some_exchanges(traffic: &Traffic, rng: &mut Rng) -> Vec<(u8, i64)> {
    let line = &traffic.lines[0];
    let first = rng.below(traffic.truth.len() - 10);
    let (from, to) = (traffic.truth[first].start as usize, traffic.truth[first + rng.range(1, 7)].end as usize);
    // The first character has begun before its time, which is that of its end.
    let begin = line.times[from] - 2 * traffic.settings.char_ns() as i64;
    (from..to).map(|at| (line.bytes[at], line.times[at] - begin)).collect()
}

/// A recording of noise, alone or after clean traffic.
#[derive(Clone, Debug)]
pub struct NoiseCase {
    /// The recording; its truth names the clean frames only.
    pub case: Case,
    /// Where the noise begins.
    pub from: u64,
}

impl NoiseCase {
    /// So many bytes of noise; `warm` puts `WARM_UP_FRAMES` frames of clean traffic in front.
    pub fn new(pattern: Pattern, seed: u64, count: usize, mode: TapMode, warm: bool) -> Self {
        let clean = Scenario::named("clean").expect("the first row of the table");
        let mut traffic = Traffic::simulate(clean, seed, WARM_UP_FRAMES);
        if !warm {
            traffic.lines = vec![TrafficLine { id: 0, bytes: Vec::new(), times: Vec::new() }];
            traffic.truth.clear();
        }
        let from = traffic.lines[0].bytes.len() as u64;
        traffic.name = format!("noise {} {}", pattern.text(), if warm { "warm" } else { "cold" });
        let case = if mode == TapMode::None {
            untimed(traffic, pattern.bytes(seed, count))
        } else {
            timed(&mut traffic, pattern, seed, count);
            traffic.tap(mode)
        };
        Self { case, from }
    }
}

/// A case without times, so that 64 MB of noise do not need half a gigabyte of times.
fn untimed(traffic: Traffic, noise: Vec<u8>) -> Case {
    let mut bytes = traffic.lines.into_iter().next().map_or(Vec::new(), |line| line.bytes);
    bytes.extend(noise);
    let reads = (0..bytes.len()).step_by(4096).map(|at| {
        let length = (bytes.len() - at).min(4096) as u32;
        TapRead { time: None, length, order: at as i64 }
    });
    let reads = reads.collect();
    Case {
        name: traffic.name,
        seed: traffic.seed,
        mode: TapMode::None,
        settings: traffic.settings,
        framing: Framing::Rtu,
        hides_framing: false,
        lines: vec![CaseLine { id: 0, bytes, reads }],
        truth: traffic.truth,
        losses: Vec::new(),
    }
}

/// At the line's pace, with a pause before 10 % of the bytes, as in a storm.
fn timed(traffic: &mut Traffic, pattern: Pattern, seed: u64, count: usize) {
    let char_ns = traffic.settings.char_ns();
    let line = &mut traffic.lines[0];
    let mut now = line.times.last().map_or(1e9, |&last| last as f64 + 50e6);
    if pattern.has_own_times() {
        let received = pattern.wrongly_received(seed, count);
        line.times.extend(received.iter().map(|&(_, time)| time + now as i64));
        line.bytes.extend(received.iter().map(|&(byte, _)| byte));
        return;
    }
    let mut rng = Rng::new(seed, "pauses");
    line.bytes.extend(pattern.bytes(seed, count));
    for _ in 0..count {
        let pause = if rng.chance(0.1) { rng.exponential(5.0) } else { 0.0 };
        now += (1.0 + pause) * char_ns;
        line.times.push(now as i64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares() {
        let share = |bytes: &[u8], value: u8| bytes.split(|&byte| byte == value).skip(1).count() as f64 / bytes.len() as f64;
        let zeros = Pattern::ZerosOnes.bytes(1, 100_000);
        assert!((share(&zeros, 0) - 0.6).abs() < 0.01 && (share(&zeros, 0xFF) - 0.3).abs() < 0.01);
        let bus = Pattern::Bus.bytes(1, 100_000);
        assert!(BUS_VALUES.iter().all(|&value| (share(&bus, value) - 1.0 / 13.0).abs() < 0.005));
        assert!(Pattern::SingleBit.bytes(1, 1000).iter().all(|byte| byte.is_power_of_two()));
        for pattern in Pattern::ALL {
            assert_eq!(pattern.bytes(7, 20_000).len(), 20_000);
            assert_eq!(pattern.bytes(7, 500), pattern.bytes(7, 500));
        }
    }

    #[test]
    fn warm_noise_stands_behind_clean_traffic() {
        let warm = NoiseCase::new(Pattern::Uniform, 3, 10_000, TapMode::None, true);
        assert_eq!(warm.case.lines[0].bytes.len() as u64, warm.from + 10_000);
        assert!(warm.case.truth.len() >= WARM_UP_FRAMES && warm.case.truth.iter().all(|frame| frame.end <= warm.from));
        let cold = NoiseCase::new(Pattern::WrongBaud, 3, 10_000, TapMode::Ftdi1, false);
        assert_eq!((cold.from, cold.case.lines[0].bytes.len()), (0, 10_000));
    }
}
