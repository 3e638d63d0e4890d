//! Recordings with one frame a record, as the lines of a log are: a write that its response repeats, behind a request without
//! response. Which of the two equal frames is the request, only what follows them tells.
//!
//! Expected values follow from how each recording is built here.

mod wire;

use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::lrc;
use modlens_protocol::direction::Direction::{self, Request, Response};
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::text::{Dialects, Reader};

use wire::{frame, read_request, read_response, session, MS};

/// Writes that their response repeats (application protocol, 6.5, 6.6, 6.8, 6.16).
fn writes() -> [Vec<u8>; 4] {
    [&[5, 0, 0x10, 0xFF, 0][..], &[6, 0x17, 0x0C, 0x72, 0xF3], &[8, 0, 0, 0xA5, 0x37], &[22, 0, 4, 0, 0xF2, 0, 0x25]]
        .map(|pdu| frame(5, pdu))
}

/// Requests that get no response, each with its own shape (application protocol, 6.1, 6.3, 6.6, 6.12).
fn unanswered() -> [Vec<u8>; 4] {
    [&[1, 0, 0, 0, 24][..], &[3, 0x12, 0x9D, 0, 4], &[6, 0, 9, 0, 1], &[16, 0, 1, 0, 1, 2, 0, 7]].map(|pdu| frame(4, pdu))
}

/// A poll, a request without response, so many exchanges of a write, and another poll of the unit: frames and directions.
fn recording(silent: &[u8], write: &[u8], exchanges: usize) -> (Vec<Vec<u8>>, Vec<Direction>) {
    let polls = [read_request(2, 0x1C18, 1), read_response(2, &[0xBB1D])];
    let behind = [read_request(5, 0x13A8, 3), read_response(5, &[0x1234, 0x5678, 0x9ABC])];
    let writes = vec![write.to_vec(); 2 * exchanges];
    let frames = [&polls[..], &[silent.to_vec()], &writes, &behind].concat();
    let directions = [&[Request, Response, Request][..], &[Request, Response].repeat(exchanges + 1)].concat();
    (frames, directions)
}

/// The rows of these frames, a record each. With times, responses come after 8 ms and requests after 100 ms, but for the one
/// behind the unanswered request, which comes after 500 ms.
fn decode(frames: &[Vec<u8>], directions: &[Direction], has_times: bool) -> Batch {
    let (mut session, bus) = session(false, if has_times { Clock::Utc } else { Clock::None });
    let (mut now, mut before) = (1_700_000_000_000_000_000, Response);
    for (bytes, &direction) in frames.iter().zip(directions) {
        now += match (before, direction) {
            (Request, Request) => 500 * MS,
            (Response, Request) => 100 * MS,
            _ => 8 * MS,
        };
        before = direction;
        let times = if has_times { Times::Read(now) } else { Times::None };
        session.feed(bus, &Chunk { bytes, times, starts_record: true, ..Chunk::default() });
    }
    session.flush();
    session.take()
}

fn expect(batch: &Batch, directions: &[Direction], what: &str) {
    let found: Vec<Direction> = batch.frames.iter().map(|row| row.direction).collect();
    assert_eq!(found, directions, "{what}");
    let statuses: Vec<Status> = batch.transactions.iter().map(|row| row.status).collect();
    let exchanges = directions.len() / 2 - 2;
    let answered = [Status::Ok].repeat(exchanges + 1);
    let expected = [&[Status::Ok, Status::NoResponse][..], &answered].concat();
    assert_eq!(statuses, expected, "{what}");
}

#[test]
fn a_write_behind_a_request_without_response_is_a_request_and_its_response() {
    for silent in unanswered() {
        for write in writes() {
            for exchanges in 1..4 {
                for has_times in [false, true] {
                    let (frames, directions) = recording(&silent, &write, exchanges);
                    let what = format!("{silent:?} {write:?} {exchanges}, times: {has_times}");
                    expect(&decode(&frames, &directions, has_times), &directions, &what);
                }
            }
        }
    }
}

/// The rows of a log that prints a frame a line.
fn decode_log(lines: &[String], dialect: &str, mode: Option<Mode>) -> Batch {
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions { mode, ..BusOptions::named("bus") });
    let rows = Dialects::embedded().named(dialect).unwrap();
    session.open_text(bus, Reader::new(rows, None, Arc::default()), b"");
    session.feed_text(bus, lines.concat().as_bytes(), false);
    session.feed_text(bus, b"", true);
    session.flush();
    session.take()
}

#[test]
fn so_it_is_in_logs_with_a_frame_a_line() {
    for silent in unanswered() {
        for write in writes() {
            let (frames, directions) = recording(&silent, &write, 1);
            let hex: Vec<String> = frames.iter().map(|frame| modlens_protocol::hex::hex(frame) + "\n").collect();
            expect(&decode_log(&hex, "hex", None), &directions, &format!("{silent:?} {write:?}"));
            let ascii: Vec<String> = frames.iter().map(|frame| in_ascii(frame)).collect();
            expect(&decode_log(&ascii, "ascii-lines", Some(Mode::Ascii)), &directions, &format!("{silent:?} {write:?} ASCII"));
        }
    }
}

/// The same frame in ASCII framing (serial line specification, 2.5.2).
fn in_ascii(frame: &[u8]) -> String {
    let mut adu = frame[..frame.len() - 2].to_vec();
    adu.push(lrc(&adu));
    format!(":{}\n", modlens_protocol::hex::hex(&adu).to_uppercase())
}
