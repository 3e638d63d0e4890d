//! A tap whose port has software flow control switched on: its driver takes 0x11 (XON) and 0x13 (XOFF) out of what it reads.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};

use wire::{read_request, read_response, session, MS};

/// What the driver delivers of these bytes.
fn through_driver(bytes: &[u8]) -> Vec<u8> {
    bytes.iter().copied().filter(|byte| ![0x11, 0x13].contains(byte)).collect()
}

/// Frames 10 ms apart, each received whole at one time.
fn recorded(frames: &[Vec<u8>]) -> Batch {
    let (mut session, bus) = session(false, Clock::Utc);
    for (at, bytes) in frames.iter().enumerate() {
        let times = vec![1_700_000_000_000_000_000 + at as i64 * 10 * MS; bytes.len()];
        session.feed(bus, &Chunk { bytes, times: Times::Bytes(&times), ..Chunk::default() });
    }
    session.flush();
    session.take()
}

fn details(batch: &Batch, finding: Finding) -> Vec<&str> {
    batch.findings.iter().filter(|row| row.finding == finding).map(|row| &row.detail[..]).collect()
}

/// Polls of units 1 and 17 by turns; the example of unit 17 is that of the serial line specification.
fn polls_of_units_1_and_17() -> Vec<Vec<u8>> {
    let exchange = |unit| [read_request(unit, 0x6B, 3), read_response(unit, &[0x022B, 0, 0x64])];
    (0..6).flat_map(|turn| exchange([1, 17][turn % 2])).collect()
}

#[test]
fn frames_of_unit_17_are_seen_though_their_first_byte_is_not() {
    let frames: Vec<Vec<u8>> = polls_of_units_1_and_17().iter().map(|frame| through_driver(frame)).collect();
    let batch = recorded(&frames);
    let found: Vec<_> = batch.frames.iter().map(|row| (row.unit, row.verdict, row.direction)).collect();
    let exchange = |unit, verdict| [(Some(unit), verdict, Direction::Request), (Some(unit), verdict, Direction::Response)];
    let expected: Vec<_> = (0..3).flat_map(|_| [exchange(1, Verdict::Ok), exchange(17, Verdict::Incomplete)].concat()).collect();
    assert_eq!(found, expected);
    assert_eq!(details(&batch, Finding::FlowControl), vec!["1 byte missing at the start: 0x11 (XON) makes the CRC valid"; 6]);
    assert_eq!(details(&batch, Finding::LostBytes), Vec::<&str>::new());
}

#[test]
fn a_byte_that_the_driver_took_out_of_the_values_is_named() {
    let mut frames: Vec<Vec<u8>> = (0..4).flat_map(|_| [read_request(1, 0, 8), read_response(1, &[7; 8])]).collect();
    frames.push(read_request(1, 0, 8));
    frames.push(through_driver(&read_response(1, &[7, 7, 7, 7, 7, 7, 0x0213, 7])));
    let batch = recorded(&frames);
    assert_eq!(details(&batch, Finding::FlowControl), ["1 byte missing after byte 15: 0x13 (XOFF) makes the CRC valid"]);
}

#[test]
fn where_such_bytes_arrive_no_driver_takes_them_out() {
    let mut frames = polls_of_units_1_and_17();
    // A damaged response with an XON in it, and later one that has lost its first byte.
    let damaged: Vec<u8> = read_response(1, &[0x1111, 0x1111, 9]).iter().map(|byte| byte ^ u8::from(*byte == 9)).collect();
    frames.extend([read_request(1, 0x6B, 3), damaged]);
    frames.extend([read_request(17, 0x6B, 3), read_response(17, &[1, 2, 3])[1..].to_vec()]);
    let batch = recorded(&frames);
    assert_eq!(details(&batch, Finding::FlowControl), Vec::<&str>::new());
    assert_eq!(details(&batch, Finding::LostBytes), ["1 byte missing at the start"]);
}

#[test]
fn other_lost_bytes_are_not_put_down_to_flow_control() {
    let mut frames: Vec<Vec<u8>> = (0..4).flat_map(|_| [read_request(1, 0, 2), read_response(1, &[7, 8])]).collect();
    for at in 2..8 {
        let mut cut = read_response(1, &[0x2345, 0x6789]);
        cut.remove(at);
        frames.extend([read_request(1, 0, 2), cut]);
    }
    let batch = recorded(&frames);
    assert_eq!(details(&batch, Finding::FlowControl), Vec::<&str>::new());
}
