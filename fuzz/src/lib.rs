//! The properties that have to hold for any bytes, however they are split and timed. The fuzz targets only pass on their
//! input.

mod files;
mod rows;

pub use files::{profile_holds, recorder_holds, recording_holds};
pub use rows::{diagnosis_holds, tables_hold};

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::text::{Dialects, Reader};

/// Pauses between reads, in ns: none, inside frames, between frames, timeouts, and a clock that runs backwards.
const PAUSES_NS: [i64; 8] = [0, 600_000, 2_100_000, 9_000_000, 33_000_000, 120_000_000, 1_500_000_000, -2_000_000];

/// When the first read comes.
const START_NS: i64 = 1_700_000_000_000_000_000;

/// A live or recorded session of one framing, as reads with the pause before each.
struct Script<'a> {
    mode: Option<Mode>,
    live: bool,
    reads: Vec<(i64, &'a [u8])>,
}

/// Decodes the input of a fuzz target: the first byte chooses the framing and whether the session is live; then each read
/// is preceded by a byte with its length (upper five bits) and the pause before it (lower three bits).
fn parse_script(data: &[u8]) -> Script<'_> {
    let (&options, mut rest) = data.split_first().unwrap_or((&0, &[]));
    let mode = [None, Some(Mode::Rtu), Some(Mode::Ascii), Some(Mode::Tcp)][usize::from(options % 4)];
    let mut reads = Vec::new();
    while let Some((&header, after)) = rest.split_first() {
        let (bytes, left) = after.split_at(usize::from(header >> 3).min(after.len()));
        reads.push((PAUSES_NS[usize::from(header % 8)], bytes));
        rest = left;
    }
    Script { mode, live: options & 4 != 0, reads }
}

fn session(mode: Option<Mode>, clock: Clock, live: bool) -> (Session, usize) {
    let functions = std::sync::Arc::new(modlens_protocol::functions::Functions::default());
    let wanted = modlens_engine::session::WantedTables { frames: true, transactions: true, findings: true };
    let mut session = Session::new(functions, wanted, live, None);
    let mut options = BusOptions::named("bus");
    options.mode = mode;
    options.line = Some("19200-8E1".parse().expect("settings"));
    options.bus.clock = clock;
    let bus = session.add_bus(options);
    (session, bus)
}

/// Checks that every byte belongs to exactly one frame: the frames, joined, are the input.
fn assert_tiles(batch: &Batch, data: &[u8]) {
    let joined: Vec<u8> = batch.frames.iter().flat_map(|frame| frame.wire.of(&batch.arena)).copied().collect();
    assert_eq!(joined, data, "frames are not the bytes");
    assert!(batch.frames.iter().all(|frame| frame.wire.length > 0), "an empty frame");
}

/// The frames of a session without times that is fed so many bytes at once.
fn frames_without_times(script: &Script<'_>, bytes: &[u8], block: usize) -> Vec<(u64, u32, Option<u64>, u8)> {
    let (mut session, bus) = session(script.mode, Clock::None, script.live);
    for bytes in bytes.chunks(block) {
        session.feed(bus, &Chunk { bytes, ..Chunk::default() });
    }
    session.flush();
    let batch = session.take();
    assert_tiles(&batch, bytes);
    batch.frames.iter().map(|frame| (frame.offset, frame.wire.length, frame.txn, frame.confidence)).collect()
}

/// Every byte belongs to exactly one frame, with times and without them; without times, the frames do not depend on how the
/// input is split.
pub fn session_holds(data: &[u8]) {
    let script = parse_script(data);
    let bytes: Vec<u8> = script.reads.iter().flat_map(|(_, bytes)| *bytes).copied().collect();
    let (mut session, bus) = session(script.mode, Clock::Utc, script.live);
    let mut now = START_NS;
    for (pause, bytes) in &script.reads {
        now += pause;
        session.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
    }
    session.flush();
    assert_tiles(&session.take(), &bytes);
    let whole = frames_without_times(&script, &bytes, usize::MAX);
    assert_eq!(frames_without_times(&script, &bytes, 1), whole, "single bytes");
    assert_eq!(frames_without_times(&script, &bytes, 7), whole, "blocks of seven");
}

/// Text is read in any dialect without a panic, and the frames do not depend on how the text is split.
pub fn text_holds(data: &[u8]) {
    let (&options, text) = data.split_first().unwrap_or((&0, &[]));
    let rows: Vec<_> = Dialects::embedded().rows().collect();
    let row = rows[usize::from(options) % rows.len()];
    let read = |block: usize| {
        let (mut session, bus) = session(None, Clock::None, false);
        let reader = Reader::new(vec![std::sync::Arc::clone(row)], None, std::sync::Arc::default());
        session.open_text(bus, reader, text);
        for block in text.chunks(block) {
            session.feed_text(bus, block, false);
        }
        session.feed_text(bus, b"", true);
        session.flush();
        let batch = session.take();
        let frames = batch.frames.iter().map(|frame| (frame.offset, frame.origin, frame.wire.of(&batch.arena).to_vec()));
        frames.collect::<Vec<_>>()
    };
    assert_eq!(read(3), read(usize::MAX));
}
