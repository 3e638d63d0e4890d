//! Frames that did not arrive whole: where they are reported, and what is said to have happened to them.

mod wire;

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{frame, read_request, read_response, MS};

/// A poll cycle of two units, repeated until the framer is familiar with both.
fn cycle() -> Vec<u8> {
    let once =
        [read_request(1, 0x6B, 2), read_response(1, &[0x1234, 0x5678]), read_request(2, 7, 1), read_response(2, &[0x4321])]
            .concat();
    once.repeat(6)
}

fn decode(bytes: &[u8]) -> Batch {
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions { mode: Some(Mode::Rtu), ..BusOptions::named("bus") });
    session.feed(bus, &Chunk { bytes, ..Chunk::default() });
    session.flush();
    session.take()
}

/// Offset after `before`, verdict and findings of all frames that are neither valid nor noise.
fn damaged_frames(before: &[u8], batch: &Batch) -> Vec<(usize, Verdict, Vec<Finding>)> {
    let rows = batch.frames.iter().filter(|row| !matches!(row.verdict, Verdict::Ok | Verdict::Noise));
    rows.map(|row| (row.offset as usize - before.len(), row.verdict, row.findings.of(&batch.codes).to_vec())).collect()
}

/// Decodes a poll cycle and one more round of it, in which `damage` changes the first request and its response. Returns the
/// bytes of the poll cycle, and all rows.
fn with_damage(damage: impl Fn(&mut Vec<u8>, &mut Vec<u8>)) -> (Vec<u8>, Batch) {
    let (mut request, mut response) = (read_request(1, 0x6B, 2), read_response(1, &[0x1234, 0x5678]));
    damage(&mut request, &mut response);
    let before = cycle();
    let bytes = [&before[..], &request, &response, &read_request(2, 7, 1), &read_response(2, &[0x4321])].concat();
    let batch = decode(&bytes);
    let good = batch.frames.iter().filter(|row| row.verdict == Verdict::Ok).count();
    assert!(good >= 27, "the frames around it stay valid: {good} valid frames");
    (before, batch)
}

// Stray bytes of a line driver take the place of those that the response has lost; after a pause follows a frame that begins
// with the same value.
#[test]
fn the_first_byte_behind_a_pause_is_no_stray_byte() {
    let bursts = [(100, read_request(1, 0, 1)), (6, vec![1, 3, 2, 0, 3, 0, 0]), (90, frame(0, &[3, 0]))];
    for piece in [1, usize::MAX] {
        let (mut session, bus) = wire::session(false, Clock::Utc);
        let mut now = 1_700_000_000_000_000_000;
        for (pause, bytes) in &bursts {
            let start = now + pause * MS;
            let times: Vec<i64> = (1..=bytes.len() as i64).map(|at| start + at * 572_917).collect();
            for (bytes, times) in bytes.chunks(piece).zip(times.chunks(piece)) {
                session.feed(bus, &Chunk { bytes, times: Times::Bytes(times), ..Chunk::default() });
            }
            now = start + bytes.len() as i64 * 572_917;
        }
        session.flush();
        let batch = session.take();
        let rows: Vec<(Verdict, u32)> = batch.frames.iter().map(|row| (row.verdict, row.wire.length)).collect();
        let expected = [(Verdict::Ok, 8), (Verdict::Incomplete, 5), (Verdict::Noise, 2), (Verdict::Ok, 5)];
        assert_eq!(rows, expected, "blocks of {piece}");
    }
}

#[test]
fn a_flipped_bit_is_found_and_named_in_every_byte_of_a_response() {
    for at in 0..9 {
        let (before, batch) = with_damage(|_, response| response[at] ^= 0x04);
        let found = damaged_frames(&before, &batch);
        assert_eq!(found.len(), 1, "byte {at}: {found:?}");
        assert_eq!((found[0].0, found[0].1), (8, Verdict::BadChecksum), "byte {at}");
        assert!(found[0].2.contains(&Finding::BitFlip), "byte {at}: {:?}", found[0].2);
    }
}

#[test]
fn a_damaged_frame_that_is_the_whole_input_starts_at_its_first_byte() {
    // Examples of the specification (V1.1b3, section 6): requests and responses of 1, 3, 4, 15, 16, 43.
    let pdus: [&[u8]; 10] = [
        &[0x01, 0x00, 0x13, 0x00, 0x13],
        &[0x01, 0x03, 0xCD, 0x6B, 0x05],
        &[0x03, 0x06, 0x02, 0x2B, 0x00, 0x00, 0x00, 0x64],
        &[0x04, 0x00, 0x08, 0x00, 0x01],
        &[0x04, 0x02, 0x00, 0x0A],
        &[0x04, 0x04, 0x00, 0x00, 0x00, 0x0A],
        &[0x0F, 0x00, 0x13, 0x00, 0x0A, 0x02, 0xCD, 0x01],
        &[0x0F, 0x00, 0x13, 0x00, 0x0A],
        &[0x10, 0x00, 0x01, 0x00, 0x02, 0x04, 0x00, 0x0A, 0x01, 0x02],
        &[0x2B, 0x0E, 0x01, 0x01, 0x00, 0x00, 0x01, 0x00, 0x04, b'A', b'c', b'm', b'e'],
    ];
    for whole in [1, 4, 16, 17].iter().flat_map(|&unit| pdus.map(|pdu| frame(unit, pdu))) {
        let flipped = (0..8 * whole.len()).map(|bit| {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            bytes
        });
        // A unit that has become 0 may as well be a glitch byte of a line driver.
        for bytes in flipped.filter(|bytes| bytes[0] != 0).chain([whole[..whole.len() - 1].to_vec()]) {
            let batch = decode(&bytes);
            let first = &batch.frames[0];
            assert!(matches!(first.verdict, Verdict::BadChecksum | Verdict::Incomplete), "{bytes:02x?}: {first:?}");
        }
    }
}

#[test]
fn missing_bytes_at_the_start_inside_and_at_the_end_are_counted() {
    for (at, count) in [(0, 1), (0, 2), (1, 1), (4, 1), (5, 2), (6, 3), (8, 1)] {
        let (before, batch) = with_damage(|_, response| drop(response.drain(at..at + count)));
        let found = damaged_frames(&before, &batch);
        assert_eq!((found.len(), found[0].0, found[0].1), (1, 8, Verdict::Incomplete), "{count} at {at}: {found:?}");
        assert!(found[0].2.contains(&Finding::LostBytes), "{count} at {at}: {:?}", found[0].2);
        let detail = &batch.findings.iter().find(|row| row.finding == Finding::LostBytes).expect("found above").detail;
        assert!(detail.starts_with(&count.to_string()), "{detail}");
    }
}

#[test]
fn a_response_that_lost_bytes_does_not_end_where_it_would_as_a_request() {
    // As a request: one register from address 2800h, and a wrong checksum.
    let values: Vec<u16> = [0, 0x0128].into_iter().chain((3..21).map(|value| 0x1111 * (value % 15))).collect();
    let (request, mut response) = (read_request(1, 0x6B, 20), read_response(1, &values));
    response.drain(25..27);
    let before = cycle();
    let batch = decode(&[&before[..], &request, &response, &read_request(2, 7, 1), &read_response(2, &[0x4321])].concat());
    assert_eq!(damaged_frames(&before, &batch), [(8, Verdict::Incomplete, vec![Finding::Incomplete, Finding::LostBytes])]);
    assert_eq!(batch.frames[25].wire.length as usize, response.len());
}

#[test]
fn wrong_bits_in_unit_and_function_behind_stray_bytes_are_no_lost_bytes() {
    let (before, batch) = with_damage(|request, _| {
        (request[0], request[1]) = (request[0] ^ 1, request[1] ^ 0x12);
        request.splice(0..0, [0xFF, 0xFF]);
    });
    let found = damaged_frames(&before, &batch);
    assert_eq!((found.len(), found[0].0, found[0].1), (1, 2, Verdict::BadChecksum), "{found:?}");
    assert!(!found[0].2.contains(&Finding::LostBytes), "{found:?}");
}

#[test]
fn a_function_code_received_twice_makes_one_damaged_response_not_two() {
    let (before, batch) = with_damage(|_, response| response.insert(1, response[1]));
    let found = damaged_frames(&before, &batch);
    assert_eq!((found.len(), found[0].0), (1, 8), "{found:?}");
    assert!(found[0].2.contains(&Finding::DuplicateByte), "{found:?}");
}

#[test]
fn a_request_of_the_poll_cycle_is_recognised_without_its_first_bytes() {
    for count in 1..=3 {
        let (before, batch) = with_damage(|request, _| drop(request.drain(..count)));
        let found = damaged_frames(&before, &batch);
        assert_eq!((found.len(), found[0].0), (1, 0), "{count}: {found:?}");
        assert!(found[0].2.contains(&Finding::LostBytes));
        assert_eq!(batch.frames[24].unit, Some(1), "the poll cycle shows the missing unit");
    }
}

#[test]
fn a_request_without_its_end_is_truncated_and_not_lost_where_the_same_request_follows() {
    let (before, request) = (cycle(), read_request(1, 9, 4));
    let whole = [&request[..], &read_response(1, &[1, 2, 3, 4])].concat();
    for length in 3..7 {
        let bytes = [&before[..], &request[..length], &whole, &read_request(2, 7, 1), &read_response(2, &[0x4321])].concat();
        let found = damaged_frames(&before, &decode(&bytes));
        assert_eq!(found, [(0, Verdict::Incomplete, vec![Finding::Incomplete])], "{length}");
    }
}

#[test]
fn a_frame_in_which_bits_only_changed_from_1_to_0_collided() {
    let (before, batch) = with_damage(|request, _| {
        for (byte, other) in request[3..].iter_mut().zip([0x12, 0x00, 0x41, 0x35, 0x42]) {
            *byte &= other;
        }
    });
    let found = damaged_frames(&before, &batch);
    assert_eq!((found.len(), found[0].0), (1, 0), "{found:?}");
    assert!(found[0].2.contains(&Finding::Collision), "{:?}", found[0].2);
}

#[test]
fn stray_bytes_that_a_switched_line_driver_can_leave_are_glitches_and_others_are_noise() {
    let before = cycle();
    for (strays, glitch) in [(&[0u8][..], true), (&[0xFF, 0xFF], true), (&[0xF8], true), (&[0x37], false), (&[0x00, 0x9C], false)]
    {
        let bytes = [
            &before[..],
            &read_request(1, 0x6B, 2),
            strays,
            &read_response(1, &[1, 2]),
            &read_request(2, 7, 1),
            &read_response(2, &[3]),
        ]
        .concat();
        let batch = decode(&bytes);
        assert_eq!(damaged_frames(&before, &batch), []);
        assert_eq!(batch.findings.iter().any(|row| row.finding == Finding::StrayBytes), glitch, "{strays:02x?}");
    }
}

#[test]
fn noise_between_valid_frames_is_no_damaged_frame() {
    let before = cycle();
    for strays in [&[0x5A, 0x91, 0x3C, 0xE7][..], &[1], &[3, 0, 0], &[0x77; 40]] {
        let bytes = [
            &before[..],
            &read_request(1, 0x6B, 2),
            &read_response(1, &[1, 2]),
            strays,
            &read_request(2, 7, 1),
            &read_response(2, &[3]),
        ]
        .concat();
        assert_eq!(damaged_frames(&before, &decode(&bytes)), [], "{strays:02x?}");
    }
}

#[test]
fn a_request_that_lacks_bytes_and_is_answered_is_a_bad_request_with_its_response() {
    let (request, response) = (read_request(1, 10, 2), read_response(1, &[7, 8]));
    let bytes = [&cycle()[..], &request[..5], &response, &read_request(2, 20, 1), &read_response(2, &[1])].concat();
    let batch = decode(&bytes);
    let bad: Vec<_> = batch.transactions.iter().filter(|row| row.status == Status::BadRequest).collect();
    assert_eq!(bad.len(), 1);
    assert_eq!(bad[0].response.wire.of(&batch.arena), response);
    assert!(bad[0].request.frame > 0);
}

/// Decodes two lines without a clock: requests on the first, responses on the second.
fn two_lines(requests: &[u8], responses: &[u8]) -> Batch {
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions { mode: Some(Mode::Rtu), ..BusOptions::named("bus") });
    session.feed(bus, &Chunk { line: 1, bytes: requests, ..Chunk::default() });
    session.feed(bus, &Chunk { line: 2, bytes: responses, ..Chunk::default() });
    session.flush();
    session.take()
}

#[test]
fn bytes_missing_on_one_of_two_lines_without_a_clock_are_reported_where_they_are_missing() {
    let requests = [read_request(1, 0x6B, 2), read_request(2, 7, 1), read_request(1, 9, 4)].concat().repeat(12);
    let responses =
        [read_response(1, &[0x1234, 0x5678]), read_response(2, &[0x4321]), read_response(1, &[0x1111, 0x2222, 0x3333, 0x4444])];
    let round = responses.concat();
    // Inside a response, at the beginning of one, at the end of one, and from the end of the first into the third.
    for missing in [22..24, 0..2, 16..18, 5..20] {
        let mut damaged_round = round.clone();
        damaged_round.drain(missing.clone());
        let batch = two_lines(&requests, &[round.repeat(8), damaged_round, round.repeat(3)].concat());
        let place = (8 * round.len() + missing.start) as u64;
        let reported = batch.frames.iter().filter(|row| row.findings.of(&batch.codes).contains(&Finding::LostBytes));
        let reported: Vec<(u64, u64)> = reported.map(|row| (row.offset, row.offset + u64::from(row.wire.length))).collect();
        assert_eq!(reported.len(), 1, "{missing:?}: {reported:?}");
        assert!((reported[0].0..=reported[0].1).contains(&place), "{missing:?}: {reported:?}");
    }
}

#[test]
fn a_response_between_two_requests_is_located_although_its_header_is_wrong() {
    let (before, batch) = with_damage(|_, response| {
        response[0] ^= 0x50;
        response[1] ^= 0x64;
        response[4] ^= 0x22;
    });
    let found = damaged_frames(&before, &batch);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].0, 8);
    let row = batch.transactions.iter().filter(|row| row.unit == 1).nth(6).expect("the request has its row");
    assert_eq!(row.status, Status::BadResponse);
}

#[test]
fn a_request_in_front_of_its_response_is_located_although_its_header_is_wrong() {
    let (before, batch) = with_damage(|request, _| {
        request[0] ^= 0x50;
        request[1] ^= 0x64;
        request[4] ^= 0x22;
    });
    let found = damaged_frames(&before, &batch);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].0, 0);
}

/// The rows of these frames, each of which came as a read, so many milliseconds after the one before.
fn decode_timed(frames: &[(i64, Vec<u8>)]) -> Batch {
    let (mut session, bus) = wire::session(false, Clock::Relative);
    let mut time = 0;
    for (wait, bytes) in frames {
        time += wait * MS;
        session.feed(bus, &Chunk { bytes, times: Times::Read(time), ..Chunk::default() });
    }
    session.flush();
    session.take()
}

#[test]
fn the_first_byte_of_a_request_in_front_of_a_time_out_is_that_request_and_noise_is_not() {
    let exchange = [(30, read_request(1, 0x6B, 2)), (8, read_response(1, &[0x1234, 0x5678]))];
    let exchanges = |count| std::iter::repeat_n(exchange.clone(), count).flatten();
    let mut frames: Vec<(i64, Vec<u8>)> = exchanges(12).collect();
    let before = frames.iter().map(|(_, bytes)| bytes.len()).sum::<usize>();
    frames.push((30, vec![1]));
    frames.push((260, read_request(1, 0x6B, 2)));
    frames.push((8, read_response(1, &[0x1234, 0x5678])));
    frames.push((5, vec![0x57]));
    frames.extend(exchanges(2));
    let batch = decode_timed(&frames);
    let found = damaged_frames(&vec![0; before], &batch);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((found[0].0, found[0].1), (0, Verdict::Incomplete));
}
