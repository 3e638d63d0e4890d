//! Simulates how adapters deliver characters in reads, and how late the host sees them.

use crate::model::Settings;
use crate::rng::Rng;

/// The kind of adapter between the line and the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TapMode {
    /// One byte per read, with times in microseconds.
    Exact,
    /// A receiver that is polled every millisecond.
    Ms1,
    /// FTDI with a latency timer of 1 ms.
    Ftdi1,
    /// FTDI with its default latency timer of 16 ms.
    Ftdi16,
    /// CH340, which delivers packets of 32 bytes.
    Ch340,
    /// A 16550 that interrupts at 8 bytes.
    Fifo,
    /// A serial device server on the network.
    Tcp,
    /// A recording without times.
    None,
}

/// The bytes of one read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TapRead {
    /// When the read returned, in ns, which is never before the stop bit of its last byte; `None` without times.
    pub time: Option<i64>,
    /// The number of bytes.
    pub length: u32,
    /// When it could be read, by which the reads of two lines are ordered.
    pub order: i64,
}

/// The delays that the host adds.
struct HostDelays {
    /// The mean delay in ms.
    jitter: f64,
    /// The probability of a stall.
    stalls: f64,
    /// The shortest and the longest stall in ms.
    stall: (f64, f64),
}

impl TapMode {
    /// All modes, in the order of the tables.
    pub const ALL: [Self; 8] =
        [Self::Exact, Self::Ms1, Self::Ftdi1, Self::Ftdi16, Self::Ch340, Self::Fifo, Self::Tcp, Self::None];

    /// The name on the command line.
    pub fn text(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Ms1 => "ms1",
            Self::Ftdi1 => "ftdi1",
            Self::Ftdi16 => "ftdi16",
            Self::Ch340 => "ch340",
            Self::Fifo => "fifo",
            Self::Tcp => "tcp",
            Self::None => "none",
        }
    }

    /// The mode of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.text() == name)
    }

    /// The reads that deliver characters with these times.
    pub fn reads(self, times: &[i64], settings: Settings, rng: &mut Rng) -> Vec<TapRead> {
        let char_ns = settings.char_ns();
        let idle = |ms: f64, chars: f64| (ms * 1e6).max(chars * char_ns) as i64;
        let host = |jitter, stalls, low, high| HostDelays { jitter, stalls, stall: (low, high) };
        let usb = host(0.3, 0.004, 5.0, 30.0);
        match self {
            Self::Exact => times.iter().map(|&time| read(micros(time), 1)).collect(),
            Self::Ms1 => polled(times, rng),
            Self::Ftdi1 => delayed_by_host(&latency_timer(times, 1_000_000), &usb, rng),
            Self::Ftdi16 => delayed_by_host(&latency_timer(times, 16_000_000), &usb, rng),
            Self::Ch340 => delayed_by_host(&packets(times, 32, idle(1.0, 2.0)), &HostDelays { jitter: 0.4, ..usb }, rng),
            Self::Fifo => delayed_by_host(&packets(times, 8, idle(0.0, 4.0)), &host(0.1, 0.003, 4.0, 20.0), rng),
            Self::Tcp => delayed_by_host(&packets(times, 200, idle(10.0, 6.0)), &host(4.0, 0.05, 10.0, 120.0), rng),
            Self::None => untimed(times),
        }
    }
}

fn read(time: i64, length: usize) -> TapRead {
    TapRead { time: Some(time), length: length as u32, order: time }
}

/// A time rounded up to whole microseconds.
fn micros(time: i64) -> i64 {
    (time + 999) / 1000 * 1000
}

fn untimed(times: &[i64]) -> Vec<TapRead> {
    let blocks = times.chunks(4096);
    blocks.map(|block| TapRead { time: None, length: block.len() as u32, order: block[block.len() - 1] }).collect()
}

/// One read per millisecond with everything since the last one.
fn polled(times: &[i64], rng: &mut Rng) -> Vec<TapRead> {
    let mut reads = Vec::new();
    let mut at = 0;
    while at < times.len() {
        let tick = (times[at] + 999_999) / 1_000_000 * 1_000_000;
        let now = tick + (rng.uniform(0.0, 0.2) * 1e6) as i64;
        let count = times[at..].iter().take_while(|&&time| time <= now).count();
        reads.push(read(micros(now), count));
        at += count;
    }
    reads
}

/// Transfers from the adapter to the host: the time in ns and the number of bytes.
type Transfers = Vec<(i64, usize)>;

/// The transfers of an FTDI chip: one when the timer expires, and one when a packet (64 bytes less 2 of status) is full. Each
/// restarts the timer.
fn latency_timer(times: &[i64], period: i64) -> Transfers {
    const FULL: usize = 62;
    let mut transfers = Vec::new();
    let mut expires = times.first().map_or(0, |first| first - period / 2);
    let mut waiting = 0;
    for &time in times {
        if time > expires && waiting > 0 {
            transfers.push((expires, waiting));
            waiting = 0;
            expires += period;
        }
        if time > expires {
            // Without data the chip sends its status when the timer expires, and the timer restarts.
            expires += (time - expires + period - 1) / period * period;
        }
        waiting += 1;
        if waiting == FULL {
            transfers.push((time, waiting));
            waiting = 0;
            expires = time + period;
        }
    }
    if waiting > 0 {
        transfers.push((expires, waiting));
    }
    transfers
}

/// The transfers of an adapter that sends when `full` bytes wait, or when none has arrived for `idle` ns.
fn packets(times: &[i64], full: usize, idle: i64) -> Transfers {
    let mut transfers = Vec::new();
    let (mut waiting, mut last) = (0, 0);
    for &time in times {
        if waiting > 0 && time - last > idle {
            transfers.push((last + idle, waiting));
            waiting = 0;
        }
        waiting += 1;
        last = time;
        if waiting == full {
            transfers.push((time, waiting));
            waiting = 0;
        }
    }
    if waiting > 0 {
        transfers.push((last + idle, waiting));
    }
    transfers
}

/// The reads of the host, which sees transfers late and sometimes very late. Transfers that it sees at once are one read.
fn delayed_by_host(transfers: &Transfers, host: &HostDelays, rng: &mut Rng) -> Vec<TapRead> {
    let mut reads: Vec<TapRead> = Vec::new();
    for &(time, length) in transfers {
        let mut ms = rng.exponential(host.jitter);
        if rng.chance(host.stalls) {
            ms += rng.uniform(host.stall.0, host.stall.1);
        }
        let now = micros(time + (ms * 1e6) as i64);
        match reads.last_mut() {
            Some(last) if last.order >= now => last.length += length as u32,
            _ => reads.push(read(now, length)),
        }
    }
    reads
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: Settings = Settings { baud: 9600, data_bits: 8, has_even_parity: true };

    fn times(count: usize) -> Vec<i64> {
        let char_ns = LINE.char_ns();
        (0..count).map(|at| 1_000_000_000 + (at as f64 * char_ns) as i64 + (at as i64 / 40) * 50_000_000).collect()
    }

    #[test]
    fn no_byte_is_lost_and_none_is_early() {
        let times = times(3000);
        for mode in TapMode::ALL {
            let reads = mode.reads(&times, LINE, &mut Rng::new(1, "tap"));
            assert_eq!(reads.iter().map(|read| read.length as usize).sum::<usize>(), times.len());
            let mut at = 0;
            let mut before = i64::MIN;
            for read in reads {
                assert!(read.length > 0);
                at += read.length as usize;
                assert!(read.order >= times[at - 1], "{mode:?}");
                if let Some(time) = read.time {
                    assert!(time >= before && mode != TapMode::None, "{mode:?}");
                    before = time;
                }
            }
        }
    }

    #[test]
    fn shapes_of_the_adapters() {
        let times = times(4000);
        let largest = |mode: TapMode| {
            let reads = mode.reads(&times, LINE, &mut Rng::new(2, "tap"));
            reads.iter().map(|read| read.length).max().unwrap()
        };
        assert_eq!((largest(TapMode::Exact), largest(TapMode::None)), (1, 4000));
        assert!(largest(TapMode::Ms1) <= 2);
        // A character takes 1.1 ms: 16 ms hold about 14 of them.
        let ftdi = TapMode::Ftdi16.reads(&times, LINE, &mut Rng::new(2, "tap"));
        let mean = 4000.0 / ftdi.len() as f64;
        assert!((9.0..16.0).contains(&mean), "{mean}");
        // 40 characters come as 32 and 8, or as 5 times 8.
        assert!((32..=80).contains(&largest(TapMode::Ch340)) && largest(TapMode::Fifo) >= 8);
        // The segments of two bursts may be seen at once.
        assert!((40..=400).contains(&largest(TapMode::Tcp)));
    }
}
