//! Traffic of a line with all that can come of a request.

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::crc16;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use proptest::prelude::*;

/// Unit, what comes of its request, address, and how many milliseconds after the exchange before it is sent.
pub type Exchange = (u8, Fate, u8, i64);

/// What comes of a request.
#[derive(Clone, Copy, Debug)]
pub enum Fate {
    Answered,
    Refused,
    Silent,
    FirstByteLost,
    BitFlipped,
    Overlaid,
    Stray,
    Late,
    /// Answered with these two registers.
    Says([u8; 4]),
    /// A single register is written; and several are.
    Writes(u8),
    WritesMany(u8),
    /// Eight coils are read.
    Bits(u8),
}

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

/// The reads of an exchange: bytes and the milliseconds before them.
fn reads((unit, fate, address, pause): Exchange) -> Vec<(Vec<u8>, i64)> {
    let request = framed(&[unit, 3, 0, address, 0, 2]);
    let (request, answer) = match fate {
        Fate::Says(data) => (request, framed(&[&[unit, 3, 4], &data[..]].concat())),
        Fate::Writes(value) => (framed(&[unit, 6, 0, address, 0, value]), framed(&[unit, 6, 0, address, 0, value])),
        Fate::WritesMany(value) => (framed(&[unit, 16, 0, address, 0, 1, 2, 0, value]), framed(&[unit, 16, 0, address, 0, 1])),
        Fate::Bits(value) => (framed(&[unit, 1, 0, address, 0, 8]), framed(&[unit, 1, 1, value])),
        _ => (request, framed(&[unit, 3, 4, address, 1, 2, 3])),
    };
    let mut flipped = answer.clone();
    flipped[4] ^= 0x10;
    let answers: Vec<(Vec<u8>, i64)> = match fate {
        Fate::Answered | Fate::Says(_) | Fate::Writes(_) | Fate::WritesMany(_) | Fate::Bits(_) => vec![(answer, 20)],
        Fate::Refused => vec![(framed(&[unit, 0x83, 2]), 20)],
        Fate::Silent => vec![],
        Fate::FirstByteLost => vec![(answer[1..].to_vec(), 20)],
        Fate::BitFlipped => vec![(flipped, 20)],
        Fate::Overlaid => vec![(vec![0, 2, 0, 9, 0, 0, 4], 20)],
        Fate::Stray => vec![(vec![0], 5), (answer, 20)],
        Fate::Late => vec![(answer, 900)],
    };
    [vec![(request, pause)], answers].concat()
}

/// The batches of a recording, one after each exchange.
pub fn batches(exchanges: &[Exchange]) -> Vec<Batch> {
    let mut session = Session::default();
    let mut options = BusOptions::named("line");
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    let mut now = 1_700_000_000_000_000_000;
    let mut all = Vec::new();
    for exchange in exchanges {
        for (bytes, pause_ms) in reads(*exchange) {
            now += pause_ms * 1_000_000 + bytes.len() as i64 * 572_917;
            session.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(now), ..Chunk::default() });
        }
        all.push(session.take());
    }
    session.flush();
    all.push(session.take());
    all
}

/// The batches of the bytes alone, without a clock; exchanges that went well are compact, or rows.
#[allow(dead_code)] // Each test program compiles this file, and not all of them use all of it.
pub fn batches_without_clock(exchanges: &[Exchange], compact: bool) -> Vec<Batch> {
    let mut session = Session::default();
    if compact {
        session.emit_compact();
    }
    let bus = session.add_bus(BusOptions::named("line"));
    let mut all = Vec::new();
    for several in exchanges.chunks(50) {
        let bytes: Vec<u8> = several.iter().flat_map(|exchange| reads(*exchange)).flat_map(|(bytes, _)| bytes).collect();
        session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
        all.push(session.take());
    }
    session.flush();
    all.push(session.take());
    all
}

/// Any of them, most of them good.
pub fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        8 => Just(Fate::Answered),
        1 => Just(Fate::Refused),
        2 => Just(Fate::Silent),
        1 => Just(Fate::FirstByteLost),
        1 => Just(Fate::BitFlipped),
        1 => Just(Fate::Overlaid),
        1 => Just(Fate::Stray),
        1 => Just(Fate::Late),
    ]
}

/// Those of a line on which nearly all goes well: other data, that of other addresses among them, writes and bits.
#[allow(dead_code)] // As above.
pub fn good_fate() -> impl Strategy<Value = Fate> {
    let data = prop_oneof![
        Just([0; 4]),
        Just([0xFF; 4]),
        any::<[u8; 4]>(),
        (0u8..6).prop_map(|address| [address, 1, 2, 3]),
        any::<u8>().prop_map(|low| [0, low, 0xFF, 0xFF]),
    ];
    prop_oneof![
        60 => Just(Fate::Answered),
        30 => data.prop_map(Fate::Says),
        10 => any::<u8>().prop_map(Fate::Writes),
        10 => any::<u8>().prop_map(Fate::WritesMany),
        10 => any::<u8>().prop_map(Fate::Bits),
        1 => Just(Fate::Refused),
        2 => Just(Fate::Silent),
        1 => Just(Fate::Stray),
    ]
}
