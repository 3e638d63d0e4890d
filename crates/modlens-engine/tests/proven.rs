//! Frames that need no search in a recording without times, whatever stands before them (`framer::rtu::proven`): what was sent whole is
//! found whole, with its direction, and nothing hides in what is skipped.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use proptest::prelude::*;

use wire::{frame, in_pieces, read_request, read_response, session};

/// The requests of the poll cycle, with their responses.
fn polls() -> [(Vec<u8>, Vec<u8>); 4] {
    [
        (read_request(1, 0x6B, 2), read_response(1, &[0x1234, 0x5678])),
        (read_request(1, 0x20, 1), read_response(1, &[0x0102])),
        (read_request(2, 0x100, 3), read_response(2, &[7, 8, 9])),
        (frame(3, &[4, 0, 9, 0, 1]), frame(3, &[4, 2, 0x11, 0x22])),
    ]
}

/// A request and a response of a function that the specification does not have.
fn vendor(value: u8) -> (Vec<u8>, Vec<u8>) {
    (frame(2, &[0x42, value, 1, 2, 3]), frame(2, &[0x42, 5, value, 0x77, 0x31, 0x90, value, 0x3C]))
}

/// What the line has shown before.
fn warm_up() -> Vec<u8> {
    let exchanges = (0..20).flat_map(|round| {
        let polls = polls().map(|(request, response)| [request, response].concat());
        let (request, response) = vendor(round + 1);
        [polls.concat(), request, response].concat()
    });
    exchanges.collect()
}

/// All rows of frames: where each begins, how long it is, who sent it and whether it is sound.
fn frames(batch: &Batch) -> Vec<(u64, usize, Direction, Verdict)> {
    batch.frames.iter().map(|row| (row.offset, row.wire.of(&batch.arena).len(), row.direction, row.verdict)).collect()
}

fn decode(bytes: &[u8], piece: usize) -> Vec<(u64, usize, Direction, Verdict)> {
    let (mut session, _) = session(false, Clock::None);
    frames(&in_pieces(&mut session, bytes, piece))
}

/// A turn of the line: stray bytes or what is left of a damaged frame, then a poll, and stray bytes before its response, if it has one.
#[derive(Clone, Debug)]
struct Turn {
    before: Vec<u8>,
    poll: usize,
    response: Option<Vec<u8>>,
}

/// Stray bytes. None of them is a unit of the line or a function of the specification.
fn strays() -> impl Strategy<Value = Vec<u8>> {
    proptest::collection::vec(0xE1u8..=0xFF, 0..50)
}

fn turns() -> impl Strategy<Value = Vec<Turn>> {
    let truncated = (0usize..4, 3usize..6).prop_map(|(poll, length)| polls()[poll].1[..length].to_vec());
    let before = prop_oneof![3 => strays(), 1 => truncated];
    let response = proptest::option::weighted(0.9, strays());
    let turn = (before, 0usize..4, response).prop_map(|(before, poll, response)| Turn { before, poll, response });
    proptest::collection::vec(turn, 1..12)
}

proptest! {
    #[test]
    fn polls_are_found_whatever_stands_before_them(turns in turns(), piece in 1usize..90) {
        let mut bytes = warm_up();
        let mut sent = Vec::new();
        for turn in &turns {
            let (request, response) = &polls()[turn.poll];
            bytes.extend(&turn.before);
            sent.push((bytes.len() as u64, request.len(), Direction::Request, Verdict::Ok));
            bytes.extend(request);
            if let Some(strays) = &turn.response {
                bytes.extend(strays);
                sent.push((bytes.len() as u64, response.len(), Direction::Response, Verdict::Ok));
                bytes.extend(response);
            }
        }
        let found = decode(&bytes, bytes.len());
        for frame in &sent {
            prop_assert!(found.contains(frame), "{frame:?} is not among {found:?}");
        }
        prop_assert_eq!(found, decode(&bytes, piece));
    }
}

/// The rows behind the traffic that the line has shown, with offsets that count from there; a poll and its response end it.
fn behind_traffic(bytes: &[u8]) -> Vec<(u64, usize, Direction, Verdict)> {
    let before = warm_up();
    let (request, response) = &polls()[0];
    let all = decode(&[&before, bytes, request, response].concat(), 4096);
    let behind = all.into_iter().filter(|row| row.0 >= before.len() as u64);
    behind.map(|(offset, length, direction, verdict)| (offset - before.len() as u64, length, direction, verdict)).collect()
}

#[test]
fn frames_of_open_length_are_told_by_what_follows_them() {
    let (request, response) = vendor(0x5A);
    let found = behind_traffic(&[&request[..], &response].concat());
    assert_eq!(found[0], (0, request.len(), Direction::Request, Verdict::Ok));
    assert_eq!(found[1], (request.len() as u64, response.len(), Direction::Response, Verdict::Ok));
}

#[test]
fn a_frame_of_open_length_may_end_in_zero() {
    // The shorter frame has a valid CRC, and so has the one with the zero behind it.
    let (request, _) = vendor(0x21);
    let response = (0..=u16::MAX).map(|value| {
        let [high, low] = value.to_be_bytes();
        frame(2, &[0x42, 5, 0x21, 0x77, high, low])
    });
    let response = response.into_iter().find(|frame| frame.ends_with(&[0])).expect("one of 256 does");
    let found = behind_traffic(&[&request[..], &response].concat());
    assert_eq!(found[1], (request.len() as u64, response.len(), Direction::Response, Verdict::Ok));
}

#[test]
fn an_exchange_of_a_new_unit_is_no_stray_bytes() {
    let (request, response) = (read_request(9, 0x6B, 2), read_response(9, &[0x4321, 0x8765]));
    let found = behind_traffic(&[&[0xF0; 5][..], &request, &response].concat());
    assert!(found.contains(&(5, request.len(), Direction::Request, Verdict::Ok)), "{found:?}");
    assert!(found.contains(&(13, response.len(), Direction::Response, Verdict::Ok)), "{found:?}");
}

#[test]
fn a_damaged_frame_of_its_announced_length_is_a_row_before_the_next_request() {
    let (request, mut response) = polls()[2].clone();
    response[5] ^= 0x7E;
    let found = behind_traffic(&[&request[..], &response].concat());
    assert_eq!(found[1], (request.len() as u64, response.len(), Direction::Response, Verdict::BadChecksum));
    assert_eq!(found[2].3, Verdict::Ok);
}

#[test]
fn a_response_once_more_with_a_zero_behind_it_is_no_request() {
    // Without the zero it is the response to the second poll; with it, it has the length of a request.
    let (request, response) = &polls()[1];
    let found = behind_traffic(&[&request[..], &[0xF1; 6], response, response, &[0]].concat());
    assert_eq!(found[2], (14, response.len(), Direction::Response, Verdict::Ok));
    assert_eq!(found[3], (14 + response.len() as u64, response.len(), Direction::Response, Verdict::Ok), "{found:?}");
}
