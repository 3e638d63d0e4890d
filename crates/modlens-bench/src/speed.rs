//! Measures how fast the core makes frames and rows of bytes, in CPU seconds of one thread, through its public API.

use std::sync::Arc;
use std::time::{Duration, Instant};

use modlens_engine::framer::fixed::FixedFramer;
use modlens_engine::framer::{Framer, FramerContext};
use modlens_engine::input::Input;
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_readers::chunk::Chunk;

use crate::checksum::rtu;
use crate::family::kinds::{self, Form};
use crate::family::written;
use crate::sim::bulk::{Bulk, Mixed};
use crate::sim::case::Traffic;
use crate::sim::noise::Pattern;
use crate::sim::scenario::Scenario;

/// The size of the blocks in which `analyzer.sources` reads files.
const BLOCK_BYTES: usize = 1 << 18;

/// The approximate mean length of a frame in simulated scenarios.
const MEAN_FRAME_BYTES: usize = 16;

/// The layer of the core up to which bytes are processed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasuredLayer {
    /// Framing: start, end and direction of frames.
    Framing,
    /// Framing, checks, pairing, statistics, and rows of transactions.
    Transactions,
    /// All of it, with rows of frames, transactions and findings.
    Everything,
}

impl MeasuredLayer {
    /// All layers.
    pub const ALL: [Self; 3] = [Self::Framing, Self::Transactions, Self::Everything];

    /// The name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Framing => "framing",
            Self::Transactions => "transactions",
            Self::Everything => "everything",
        }
    }

    /// The layer of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }

    /// Processes the bytes of a line in this mode and returns the number of frames or rows.
    pub fn run(self, mode: Mode, bytes: &[u8]) -> u64 {
        match self {
            Self::Framing => framing(mode, bytes),
            Self::Transactions => rows(mode, bytes, false),
            Self::Everything => rows(mode, bytes, true),
        }
    }
}

/// The kind of bytes whose processing is measured.
#[derive(Clone, Copy, Debug)]
pub enum Load {
    /// The traffic of `sim::bulk`.
    Mixed,
    /// The kind of this name of the family of workloads.
    Family(&'static str),
    /// One request and its response of so many registers, repeated.
    Poll(u16),
    /// The scenario of this name.
    Scenario(&'static str),
    /// Noise.
    Noise(Pattern),
    /// These bytes, repeated; such input makes naive searches quadratic.
    Pattern(&'static [u8]),
    /// Headers of requests to write a hundred registers with a false byte count, repeated.
    FalseByteCounts,
}

impl Load {
    /// All kinds, with their names.
    pub const ALL: [(&'static str, Self); 20] = [
        ("clean mixed", Self::Mixed),
        ("ascii", Self::Family("ascii")),
        ("write-register", Self::Family("write-register")),
        ("write-many", Self::Family("write-many")),
        ("clean 8+7", Self::Poll(1)),
        ("clean 8+255", Self::Poll(125)),
        ("field", Self::Scenario("field")),
        ("hostile", Self::Scenario("hostile")),
        ("noise uniform", Self::Noise(Pattern::Uniform)),
        ("noise 00_ff", Self::Noise(Pattern::ZerosOnes)),
        ("noise bus13", Self::Noise(Pattern::Bus)),
        ("noise single_bit", Self::Noise(Pattern::SingleBit)),
        ("noise wrong_baud", Self::Noise(Pattern::WrongBaud)),
        ("noise inverted", Self::Noise(Pattern::Inverted)),
        ("00", Self::Pattern(&[0])),
        ("ff", Self::Pattern(&[0xFF])),
        ("ff ff 00 00 00", Self::Pattern(&[0xFF, 0xFF, 0, 0, 0])),
        ("01 03", Self::Pattern(&[1, 3])),
        ("a8 ea", Self::Pattern(&[0xA8, 0xEA])),
        ("lying writes", Self::FalseByteCounts),
    ];

    /// The mode of its line.
    pub fn mode(self) -> Mode {
        match self {
            Self::Family(name) if kinds::named(name).is_some_and(|kind| kind.form == Form::Ascii) => Mode::Ascii,
            _ => Mode::Rtu,
        }
    }

    /// About so many bytes of this kind.
    pub fn bytes(self, size: usize, seed: u64) -> Vec<u8> {
        match self {
            Self::Mixed => {
                let mut bulk = Bulk::default();
                Mixed::new(seed, false).more(size, &mut bulk);
                bulk.bytes
            }
            Self::Family(name) => {
                let mut bytes = Vec::new();
                let kind = kinds::named(name).expect("a name of the table");
                written::write(kind, seed, size, &mut bytes).expect("memory takes all");
                bytes
            }
            Self::Poll(quantity) => {
                let [high, low] = quantity.to_be_bytes();
                let data = (0..2 * quantity).map(|i| i as u8);
                let answer: Vec<u8> = [3, 2 * low].into_iter().chain(data).collect();
                repeated(&[rtu(1, &[3, 0, 10, high, low]), rtu(1, &answer)].concat(), size)
            }
            Self::Scenario(name) => {
                let scenario = Scenario::named(name).expect("a name of the table");
                let mut traffic = Traffic::new(scenario, seed, size / MEAN_FRAME_BYTES);
                let mut bytes = std::mem::take(&mut traffic.lines[0].bytes);
                bytes.truncate(size);
                bytes
            }
            Self::Noise(pattern) => pattern.bytes(seed, size),
            Self::Pattern(part) => repeated(part, size),
            Self::FalseByteCounts => repeated(&[0x10, 0x10, 0, 0, 0, 100, 0xFF], size),
        }
    }
}

fn repeated(part: &[u8], size: usize) -> Vec<u8> {
    part.iter().copied().cycle().take(size / part.len() * part.len()).collect()
}

/// The number of frames and noise rows that the framer finds, without a session.
fn framing(mode: Mode, bytes: &[u8]) -> u64 {
    let functions = Functions::embedded();
    let mut framer = FixedFramer::new(mode, None, None);
    let mut input = Input::new(None);
    input.break_ns = framer.break_ns(None);
    let mut known_units = [false; 256];
    let mut adu = Vec::new();
    let mut count = 0;
    let mut drain = |input: &mut Input| loop {
        let context = FramerContext::without_clock(functions, &known_units);
        let Some(cut) = framer.next(input, &context, &mut adu) else { break };
        // Like a session, count a unit as known only after a valid frame.
        if cut.verdict.is_good() && !cut.unconfirmed {
            known_units[adu[0] as usize] = true;
        }
        input.consume(cut.length);
        count += 1;
    };
    for block in bytes.chunks(BLOCK_BYTES) {
        input.push(&Chunk { bytes: block, ..Chunk::default() });
        drain(&mut input);
    }
    (input.is_closed, input.is_ended) = (true, true);
    drain(&mut input);
    count
}

fn session(mode: Mode, everything: bool) -> (Session, usize) {
    let wanted = WantedTables { frames: everything, transactions: true, findings: everything };
    let mut session = Session::new(Arc::new(Functions::default()), wanted, false, None);
    let mut options = BusOptions::named("bus");
    options.mode = Some(mode);
    let bus = session.add_bus(options);
    (session, bus)
}

fn rows(mode: Mode, bytes: &[u8], everything: bool) -> u64 {
    let (mut session, bus) = session(mode, everything);
    let mut count = 0;
    let mut take = |session: &mut Session| {
        let batch = session.take();
        count += (batch.frames.len() + batch.transactions.len() + batch.findings.len()) as u64;
    };
    for block in bytes.chunks(BLOCK_BYTES) {
        session.feed(bus, &Chunk { bytes: block, ..Chunk::default() });
        take(&mut session);
    }
    session.flush();
    take(&mut session);
    count
}

/// The speed in MB per CPU second of this thread, the best of three runs, and whether four times the bytes take at most six
/// times as long, which shows that the time is linear.
pub fn rate(layer: MeasuredLayer, mode: Mode, bytes: &[u8]) -> (f64, bool) {
    let best = |bytes: &[u8]| {
        let seconds = (0..3).map(|_| timed(|| layer.run(mode, bytes)));
        seconds.fold(f64::MAX, f64::min)
    };
    let (whole, quarter) = (best(bytes), best(&bytes[..bytes.len() / 4]));
    (bytes.len() as f64 / whole / 1e6, whole < 6.0 * quarter)
}

fn timed(work: impl FnOnce() -> u64) -> f64 {
    let (start, wall) = (cpu(), Instant::now());
    std::hint::black_box(work());
    start.zip(cpu()).map_or(wall.elapsed(), |(start, end)| end.saturating_sub(start)).as_secs_f64()
}

/// The CPU time of this thread; `None` if the kernel does not report it.
fn cpu() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
}

/// The peak memory in MB after a sixteenth of so many bytes of uniform noise and after all of them; they are made and
/// processed block by block.
pub fn memory(bytes: u64, seed: u64) -> Option<(f64, f64)> {
    let (mut session, bus) = session(Mode::Rtu, true);
    let mut before = None;
    let mut done = 0;
    while done < bytes {
        let block = Pattern::Uniform.bytes(seed + done, BLOCK_BYTES);
        session.feed(bus, &Chunk { bytes: &block, ..Chunk::default() });
        session.take();
        done += BLOCK_BYTES as u64;
        if before.is_none() && done >= bytes / 16 {
            before = Some(peak()?);
        }
    }
    Some((before?, peak()?))
}

fn peak() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kilobytes| kilobytes / 1000.0)
}
