//! Frames in the layouts of the specification, and sessions to decode them with.

// Each test program uses a part of these.
#![allow(dead_code)]

pub mod tcp;

use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::checksum::crc16;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::Chunk;

/// A millisecond in nanoseconds.
pub const MS: i64 = 1_000_000;

/// An RTU frame with its checksum.
pub fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = vec![unit];
    frame.extend(pdu);
    frame.extend(crc16(&frame).to_le_bytes());
    frame
}

/// A request to read holding registers (application protocol, 6.3).
pub fn read_request(unit: u8, address: u16, quantity: u8) -> Vec<u8> {
    let [high, low] = address.to_be_bytes();
    frame(unit, &[3, high, low, 0, quantity])
}

/// The response to such a request.
pub fn read_response(unit: u8, values: &[u16]) -> Vec<u8> {
    let mut pdu = vec![3, 2 * values.len() as u8];
    pdu.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    frame(unit, &pdu)
}

/// A session with one RTU bus at 19200 baud.
pub fn session(live: bool, clock: Clock) -> (Session, usize) {
    session_at("19200-8E1", live, clock)
}

/// The same with these settings of the line.
pub fn session_at(settings: &str, live: bool, clock: Clock) -> (Session, usize) {
    let wanted = WantedTables { frames: true, transactions: true, findings: true };
    let mut session = Session::new(Arc::new(Functions::default()), wanted, live, None);
    let mut options = BusOptions::named("bus");
    options.mode = Some(Mode::Rtu);
    options.line = Some(settings.parse().unwrap());
    options.bus.clock = clock;
    let bus = session.add_bus(options);
    (session, bus)
}

/// Feeds these bytes to one RTU bus of a session, `piece` bytes at a time, and flushes it.
pub fn in_pieces(session: &mut Session, bytes: &[u8], piece: usize) -> Batch {
    let bus = session.add_bus(BusOptions { mode: Some(Mode::Rtu), ..BusOptions::named("bus") });
    bytes.chunks(piece).for_each(|bytes| session.feed(bus, &Chunk { bytes, ..Chunk::default() }));
    session.flush();
    session.take()
}

/// The frames with a valid checksum, and their directions.
pub fn good(batch: &Batch) -> Vec<(Vec<u8>, Direction)> {
    let good = batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok);
    good.map(|frame| (frame.wire.of(&batch.arena).to_vec(), frame.direction)).collect()
}
