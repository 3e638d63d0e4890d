//! Frames that look like others: echoes and retries, layouts that differ by direction, frames inside frames.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::direction::Direction::{self, Request, Response};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{frame, in_pieces, read_request, read_response, session, MS};

/// Transactions from which units 1 and 2 become known.
fn known() -> Vec<Vec<u8>> {
    (0..8u16).flat_map(|i| [read_request(1 + (i % 2) as u8, 100 * i, 2), read_response(1 + (i % 2) as u8, &[i, 7 * i])]).collect()
}

/// The rows of these frames in one read without times, after those of `known`.
fn untimed(frames: &[Vec<u8>]) -> Batch {
    let (mut session, bus) = session(false, Clock::None);
    let bytes: Vec<u8> = known().iter().chain(frames).flatten().copied().collect();
    session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
    session.flush();
    session.take()
}

/// The rows of these frames, each a read of its own, the given number of ms after the one before.
fn timed(live: bool, frames: &[(i64, Vec<u8>)]) -> Batch {
    let (mut session, bus) = session(live, Clock::Utc);
    let mut now = 1_700_000_000_000_000_000;
    for (pause, bytes) in known().into_iter().map(|frame| (12, frame)).chain(frames.iter().cloned()) {
        now += pause * MS;
        session.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(now), ..Chunk::default() });
    }
    session.poll(now + 5_000 * MS);
    session.flush();
    session.take()
}

/// The good frames after those of `known`.
fn good(batch: &Batch) -> Vec<(Vec<u8>, Direction)> {
    let good = batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok);
    good.map(|frame| (frame.wire.of(&batch.arena).to_vec(), frame.direction)).skip(known().len()).collect()
}

fn pair(request: &[u8], response: &[u8]) -> [(Vec<u8>, Direction); 2] {
    [(request.to_vec(), Request), (response.to_vec(), Response)]
}

/// Requests whose response has the same bytes.
fn mirrored_requests() -> Vec<Vec<u8>> {
    let pdus: [&[u8]; 5] = [
        &[5, 0x12, 0x34, 0xFF, 0],
        &[6, 0x12, 0x34, 0x56, 0x78],
        &[8, 0, 0, 0xA5, 0x37],
        &[21, 11, 6, 0, 4, 0, 7, 0, 2, 6, 0xAF, 4, 0xBE],
        &[22, 0x12, 0x34, 0x7C, 0x58, 0x8A, 0x06],
    ];
    pdus.iter().map(|pdu| frame(1, pdu)).collect()
}

/// On a line whose units answer, two and four copies are exchanges, and of three the first one had no response.
#[test]
fn copies_of_a_mirrored_request_are_exchanges_without_a_clock() {
    let expected = [&[Request, Response][..], &[Request, Request, Response], &[Request, Response, Request, Response]];
    for write in mirrored_requests() {
        for (copies, expected) in (2..).zip(expected) {
            let mut frames = vec![write.clone(); copies];
            frames.extend([read_request(2, 9, 1), read_response(2, &[3])]);
            let batch = untimed(&frames);
            let directions: Vec<Direction> = good(&batch)[..copies].iter().map(|frame| frame.1).collect();
            assert_eq!(directions, expected, "function {} {copies} times", write[1]);
        }
    }
}

#[test]
fn of_several_copies_of_a_mirrored_request_the_last_is_the_response_with_a_clock() {
    // Two timeouts teach how long this master waits.
    let lesson =
        [(30, read_request(9, 0, 1)), (300, read_request(9, 0, 1)), (300, read_request(1, 9, 1)), (10, read_response(1, &[3]))];
    for live in [false, true] {
        for write in mirrored_requests() {
            for copies in 2..=4 {
                let mut frames = lesson.to_vec();
                frames.extend((1..copies).map(|_| (300, write.clone())));
                frames.extend([(10, write.clone()), (30, read_request(2, 9, 1)), (10, read_response(2, &[3]))]);
                let batch = timed(live, &frames);
                let directions: Vec<Direction> = good(&batch)[lesson.len()..][..copies].iter().map(|frame| frame.1).collect();
                assert_eq!(directions[..copies - 1], vec![Request; copies - 1], "function {} {copies} times", write[1]);
                assert_eq!(directions[copies - 1], Response, "function {} {copies} times", write[1]);
            }
        }
    }
}

#[test]
fn an_address_that_looks_like_a_byte_count_is_an_address() {
    // Registers from 0x0401 on: read as a response, four bytes of data.
    let (request, response) = (read_request(1, 0x0401, 2), read_response(1, &[8, 9]));
    assert_eq!(good(&untimed(&[request.clone(), response.clone()])), pair(&request, &response));
    // And where the whole frame could be both: three bytes of coils, or a request for 8 from 0x0300 on.
    let (request, response) = (frame(1, &[1, 3, 0, 0, 8]), frame(1, &[1, 1, 0x55]));
    assert_eq!(good(&untimed(&[request.clone(), response.clone()])), pair(&request, &response));
}

#[test]
fn functions_without_layout_are_found_at_every_length_with_zeros_inside_and_behind() {
    for code in [65u8, 72, 90, 100, 110, 125, 126, 127] {
        for length in [4usize, 5, 8, 9, 33, 256] {
            let body = |value: u8| vec![value; length - 4];
            let once = |value: u8| frame(1, &[&[code][..], &body(value)].concat());
            // A few transactions teach the length; then the frame has only zeros, and a stray zero after it.
            let (request, response) = (once(0), frame(1, &[code, 2, 0, 0]));
            let lesson: Vec<Vec<u8>> = (0x51..0x55).flat_map(|at| [once(at), frame(1, &[code, 2, at, 9])]).collect();
            let strays = vec![vec![0]];
            let frames = [
                &lesson[..],
                std::slice::from_ref(&request),
                &strays,
                std::slice::from_ref(&response),
                &strays,
                &[read_request(2, 0, 1)],
            ]
            .concat();
            let found = good(&untimed(&frames));
            // With the zero after it, such a frame has a valid checksum, too, so that both lengths are accepted.
            let whole =
                |(bytes, way): &(Vec<u8>, Direction)| *way == Request && [&bytes[..], &[0]].concat().starts_with(&request);
            let is_found = found.iter().any(|frame| whole(frame) && frame.0.len().abs_diff(length) <= 1);
            assert!(is_found, "function {code}, {length} bytes: {found:02x?}");
            assert!(found.contains(&(read_request(2, 0, 1), Request)), "function {code}, {length} bytes");
        }
    }
}

#[test]
fn functions_with_a_length_field_end_where_it_says() {
    let long = |count: usize| (0..count).map(|at| (at * 29 + 3) as u8).collect::<Vec<u8>>();
    let mut pairs: Vec<(Vec<u8>, Vec<u8>)> = Vec::new();
    for count in [2usize, 4, 80, 250] {
        let loopback = frame(1, &[&[8, 0, 0][..], &long(count)].concat());
        pairs.push((loopback.clone(), loopback));
    }
    // File records: two groups asked for, two answered; a write of two groups.
    let request = frame(1, &[20, 14, 6, 0, 4, 0, 1, 0, 2, 6, 0, 3, 0, 9, 0, 1]);
    pairs.push((request, frame(1, &[20, 10, 5, 6, 0x0D, 0xFE, 0, 0x20, 3, 6, 0x33, 0xCD])));
    let write = frame(1, &[21, 20, 6, 0, 4, 0, 7, 0, 2, 6, 0xAF, 4, 0xBE, 6, 0, 3, 0, 9, 0, 1, 0x10, 0x0D]);
    pairs.push((write.clone(), write));
    // FIFO queue: a count of two bytes, none and two values.
    pairs.push((frame(1, &[24, 4, 0xDE]), frame(1, &[24, 0, 2, 0, 0])));
    pairs.push((frame(1, &[24, 4, 0xDE]), frame(1, &[24, 0, 6, 0, 2, 1, 0xB8, 0x12, 0x84])));
    // Identification: two objects, and more follows.
    let objects = [&[43, 14, 1, 1, 0xFF, 2, 2, 0, 3][..], b"abc", &[1, 2], b"de"].concat();
    pairs.push((frame(1, &[43, 14, 1, 0]), frame(1, &objects)));
    for (request, response) in pairs {
        let batch = untimed(&[request.clone(), response.clone(), read_request(2, 0, 1), read_response(2, &[1])]);
        assert_eq!(good(&batch)[..2], pair(&request, &response), "function {}", request[1]);
    }
}

#[test]
fn responses_that_contradict_their_requests_are_frames_with_findings() {
    let cases = [
        // Fewer registers than requested, a value that is not repeated, 2001 coils.
        (read_request(1, 0, 5), read_response(1, &[1, 2]), Finding::ResponseLength),
        (frame(1, &[6, 0, 1, 0, 3]), frame(1, &[6, 0, 1, 0, 9]), Finding::EchoMismatch),
        (frame(1, &[1, 0, 0, 0x07, 0xD1]), frame(1, &[&[1, 251][..], &[0x5A; 251]].concat()), Finding::QuantityLimit),
    ];
    for (request, response, finding) in cases {
        let batch = untimed(&[request.clone(), response.clone(), read_request(2, 0, 1), read_response(2, &[1])]);
        assert_eq!(good(&batch)[..2], pair(&request, &response), "{finding:?}");
        assert!(batch.findings.iter().any(|row| row.finding == finding), "{finding:?}");
    }
}

#[test]
fn frames_nested_in_files_and_tunnels_are_payload_live_too() {
    let inner = read_request(2, 0, 1);
    let file = [&[21, 7 + inner.len() as u8, 6, 0, 4, 0, 7, 0, inner.len() as u8 / 2][..], &inner].concat();
    let tunnel = [&[43, 13][..], &inner, &[1, 2, 3]].concat();
    let outer = frame(1, &file);
    let frames = [(12, outer.clone()), (12, outer.clone()), (12, read_request(1, 0, 1)), (12, read_response(1, &[1]))];
    for live in [false, true] {
        assert_eq!(good(&timed(live, &frames))[..2], pair(&outer, &outer));
    }
    let outer = frame(1, &tunnel);
    let frames =
        [(12, outer.clone()), (12, frame(1, &[43, 13, 9, 9])), (12, read_request(1, 0, 1)), (12, read_response(1, &[1]))];
    for live in [false, true] {
        assert_eq!(good(&timed(live, &frames))[0], (outer.clone(), Request));
    }
}

#[test]
fn a_request_and_response_nested_in_a_file_or_loopback_are_payload_live_too() {
    let inner = [read_request(2, 0, 2), read_response(2, &[7, 9])].concat();
    let padded = [&inner[..], &[0][..inner.len() % 2]].concat();
    let file = [&[21, 7 + padded.len() as u8, 6, 0, 4, 0, 7, 0, padded.len() as u8 / 2][..], &padded].concat();
    let loopback = [&[8, 0, 0][..], &padded].concat();
    for pdu in [file, loopback] {
        let outer = frame(1, &pdu);
        let polls = [
            (12, read_request(2, 0, 2)),
            (12, read_response(2, &[7, 8])),
            (12, read_request(1, 0, 1)),
            (12, read_response(1, &[1])),
        ];
        let mut frames = vec![polls.to_vec(); 4].concat();
        frames.extend([(12, outer.clone()), (12, outer.clone())]);
        frames.extend(polls);
        let adjacent: Vec<Vec<u8>> = frames.iter().map(|(_, bytes)| bytes.clone()).collect();
        for batch in [timed(false, &frames), timed(true, &frames), untimed(&adjacent)] {
            let found = good(&batch);
            assert_eq!(found[16..18], pair(&outer, &outer), "function {}", pdu[0]);
            assert_eq!(found.len(), 22, "function {}", pdu[0]);
        }
    }
}

#[test]
fn a_frame_nested_in_a_loopback_is_payload_live_too() {
    // What sub-function 0 of diagnostics returns (6.8): the line has not shown this function before.
    let outer = frame(1, &[&[8, 0, 0][..], &read_request(2, 0, 1)].concat());
    let frames = [(12, outer.clone()), (12, outer.clone()), (12, read_request(1, 0, 1)), (12, read_response(1, &[1]))];
    for live in [false, true] {
        let found = good(&timed(live, &frames));
        assert_eq!(found[..2], pair(&outer, &outer), "live {live}");
        assert_eq!(found[2..], pair(&read_request(1, 0, 1), &read_response(1, &[1])), "live {live}");
    }
}

#[test]
fn a_write_behind_stray_bytes_is_not_given_up_for_the_poll_nested_in_it() {
    // The nested poll scores more than the header of the write, whose function is new on the line.
    let (poll, strays) = (read_request(1, 200, 2), vec![0x42, 0x0B, 0xFF]);
    let values = [&[0x2E; 20][..], &poll, &[0x3D; 18]].concat();
    let outer = frame(2, &[&[16, 0, 0, 0, 23, 46][..], &values].concat());
    let reply = frame(2, &[16, 0, 0, 0, 23]);
    let expected = [pair(&outer, &reply), pair(&read_request(1, 0, 1), &read_response(1, &[1]))].concat();
    let frames = [strays, outer, reply, read_request(1, 0, 1), read_response(1, &[1])];
    assert_eq!(good(&untimed(&frames)), expected);
    let bytes: Vec<u8> = known().iter().chain(&frames).flatten().copied().collect();
    for piece in [1, 7, 64, 300] {
        let (mut session, _) = session(false, Clock::None);
        assert_eq!(good(&in_pieces(&mut session, &bytes, piece)), expected, "in blocks of {piece}");
    }
}

#[test]
fn canopen_references_of_every_length_end_at_their_checksum() {
    // 43/13: its layout is not in the specification (6.19).
    for (request_bytes, response_bytes) in [(4usize, 4usize), (7, 30), (14, 9)] {
        let body = |length: usize, first: usize| (0..length).map(|at| (at * 53 + first) as u8).collect::<Vec<u8>>();
        let once = |at: usize| {
            [
                frame(1, &[&[43, 13][..], &body(request_bytes, at)].concat()),
                frame(1, &[&[43, 13][..], &body(response_bytes, at + 9)].concat()),
            ]
        };
        let exchanges: Vec<Vec<u8>> = (0..4).flat_map(once).collect();
        let batch = untimed(&[&exchanges[..], &[read_request(2, 0, 1), read_response(2, &[1])]].concat());
        let expected: Vec<_> = exchanges.chunks(2).flat_map(|both| pair(&both[0], &both[1])).collect();
        assert_eq!(good(&batch)[..8], expected, "{request_bytes} {response_bytes}");
    }
}

#[test]
fn a_request_that_could_be_its_own_response_is_a_retry_after_a_timeout() {
    // 24 inputs from address 0x03D2 on: as a response, three bytes of inputs.
    let request = frame(8, &[2, 0x03, 0xD2, 0, 24]);
    let response = frame(8, &[2, 3, 0, 0x26, 0xB4]);
    let timeouts: Vec<(i64, Vec<u8>)> = (0..3)
        .flat_map(|_| {
            [
                (20, read_request(9, 0, 1)),
                (250, read_request(9, 0, 1)),
                (250, read_request(1, 0, 1)),
                (12, read_response(1, &[1])),
            ]
        })
        .collect();
    let frames = [&timeouts[..], &[(20, request.clone()), (250, request.clone()), (12, response.clone())]].concat();
    for live in [false, true] {
        let found = good(&timed(live, &frames));
        assert_eq!(
            found[found.len() - 3..],
            [(request.clone(), Request), (request.clone(), Request), (response.clone(), Response)]
        );
    }
}

#[test]
fn a_stray_byte_before_a_retry_does_not_make_it_a_response() {
    let write = frame(1, &[6, 0, 1, 0, 3]);
    let timeouts: Vec<(i64, Vec<u8>)> = (0..3)
        .flat_map(|_| {
            [
                (20, read_request(9, 0, 1)),
                (250, read_request(9, 0, 1)),
                (250, read_request(1, 0, 1)),
                (12, read_response(1, &[1])),
            ]
        })
        .collect();
    let tail = [
        (20, write.clone()),
        (238, vec![0x40]),
        (12, write.clone()),
        (12, write.clone()),
        (20, read_request(2, 0, 1)),
        (12, read_response(2, &[1])),
    ];
    for live in [false, true] {
        let found = good(&timed(live, &[&timeouts[..], &tail].concat()));
        let directions: Vec<Direction> = found[found.len() - 5..].iter().map(|frame| frame.1).collect();
        assert_eq!(directions, [Request, Request, Response, Request, Response], "live {live}");
    }
}

#[test]
fn a_repeated_request_is_neither_echo_nor_retry_before_the_line_has_shown_which() {
    // The recording begins with the same request twice, without a clock.
    let (mut session, bus) = session(false, Clock::None);
    let bytes =
        [read_request(1, 0, 1), read_request(1, 0, 1), read_response(1, &[5]), read_request(2, 0, 1), read_response(2, &[6])]
            .concat();
    session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
    session.flush();
    let batch = session.take();
    let statuses: Vec<Status> = batch.transactions.iter().map(|row| row.status).collect();
    assert_eq!(statuses, [Status::NotObserved, Status::Ok, Status::Ok]);
    assert_eq!(batch.transactions[1].retry_of, None);
}

#[test]
fn a_line_with_echo_is_recognised_by_its_third_request_without_a_clock() {
    let (mut session, bus) = session(false, Clock::None);
    let round = |at: u16| [read_request(1, at, 1), read_request(1, at, 1), read_response(1, &[at])].concat();
    let bytes: Vec<u8> = (0..8).flat_map(round).collect();
    session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
    session.flush();
    let batch = session.take();
    let echoes = batch.findings.iter().filter(|row| row.finding == Finding::LocalEcho).count();
    assert!((6..=8).contains(&echoes), "{echoes}");
    assert!(batch.findings.iter().all(|row| row.finding != Finding::NoResponse && row.finding != Finding::Retry));
}

#[test]
fn the_same_response_to_the_same_request_is_not_a_duplicate() {
    let request = read_request(1, 0, 4);
    let response = read_response(1, &[0xFFF8, 0xD92F, 0x4240, 0]);
    let frames =
        [request.clone(), response.clone(), request.clone(), response.clone(), read_request(2, 0, 1), read_response(2, &[1])];
    let batch = untimed(&frames);
    assert_eq!(good(&batch)[..4], [pair(&request, &response), pair(&request, &response)].concat());
    assert!(batch.findings.iter().all(|row| row.finding != Finding::Duplicate));
}

/// The checksum of the last request ends in 00: without that byte, it is as long as the response that its address announces.
#[test]
fn a_read_with_write_that_may_be_a_response_and_a_zero_is_weighed_on_both_paths() {
    let ask = |number: u8| frame(2, &[23, 11, 0xFF, 0, 8, 0, number, 0, 2, 4, number, 0, 0xFF, 8]);
    let answer = |number: u8| frame(2, &[&[23, 16][..], &(0..16).map(|at| at ^ number).collect::<Vec<u8>>()].concat());
    assert_eq!(ask(28).last(), Some(&0));
    let bytes = [ask(0), ask(0), ask(0), answer(0), ask(28), answer(28), frame(0, &[6, 0, 1, 0, 28])].concat();
    let confidences = |piece: usize| -> Vec<u8> {
        let (mut session, _) = session(false, Clock::None);
        in_pieces(&mut session, &bytes, piece).frames.iter().map(|row| row.confidence).collect()
    };
    assert_eq!(confidences(bytes.len()), confidences(1));
    assert_eq!(confidences(bytes.len()), confidences(40));
}
