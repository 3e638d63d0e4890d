//! What other tools get wrong, a test each. Expected values are built here, from the layouts of the specification.
//!
//! Where each pitfall of segmentation is tested (paths from the root of the repository; no path: this file):
//!
//! | | pitfall | tests |
//! | --- | --- | --- |
//! | 1 | frames in one read, one frame in many, every split | `frames_glued_into_one_read_are_told_apart`; `taps.rs`: `every_split_of_a_pair_in_two_reads` |
//! | 2 | blocks of 32 and 62 bytes, stalls | `taps.rs`: `packets_of_32_and_62_bytes_with_long_waits_between_them`, `a_read_that_comes_late_inside_a_frame_live_and_not` |
//! | 3 | checksums that end in 00 | `a_frame_whose_checksum_ends_in_zero_is_whole`; `taps.rs`: `a_frame_whose_checksum_ends_in_zero_byte_by_byte_and_live` |
//! | 4 | strays of 00 and FF | `stray_zeros_and_ones_around_frames_belong_to_none`, `a_second_response_with_a_stray_zero_behind_it_is_no_request`, `published_frames_with_glitches_on_both_sides` |
//! | 5 | runs and collisions in linear time | `runs_of_one_value_are_no_frames_and_take_linear_time` |
//! | 6 | coils that look like a request, addresses like a count | `eight_bytes_of_function_1_are_coils_where_coils_were_asked_for`; `look_alikes.rs`: `an_address_that_looks_like_a_byte_count` |
//! | 7 | echoes, retries, local echo | `look_alikes.rs`: `of_several_copies_of_a_mirrored_request_the_last_is_the_response_with_a_clock`, `copies_of_a_mirrored_request_are_exchanges_without_a_clock`; `equal_writes.rs`; `a_local_echo_is_no_transaction_of_its_own` |
//! | 8 | unanswered, broadcast, late, another unit | `unanswered_broadcast_and_late`, `an_answer_after_the_time_out_is_late_and_no_second_master`, `another_unit_answers_and_the_master_asks_again` |
//! | 9 | exceptions of every function, strange codes | `exceptions_of_every_function_and_strange_codes` |
//! | 10 | functions of any length | `look_alikes.rs`: `functions_without_layout_of_every_length_filled_with_zeros_and_with_strays_behind`, `canopen_references_of_every_length_end_where_their_checksum_says` |
//! | 11 | lengths that are in the frame | `look_alikes.rs`: `functions_whose_length_stands_in_the_frame` |
//! | 12 | a file record of one register | `a_file_record_response_of_one_register_is_legal` |
//! | 13 | answers against the rules | `quantities_over_the_limit_are_frames_with_a_finding`, `a_response_with_four_bytes_a_register_is_a_frame_with_a_finding`; `look_alikes.rs`: `answers_that_do_not_keep_to_their_requests_are_frames_with_findings` |
//! | 14 | frames inside payloads | `a_frame_inside_a_payload_is_payload`; `look_alikes.rs`: `frames_inside_payloads_of_files_and_tunnels_live_too`, `a_file_or_a_loopback_that_holds_a_whole_exchange_live_too`, `a_loopback_that_holds_a_frame_live_too` |
//! | 15 | a request after a truncated response | `a_request_behind_a_truncated_response_is_found` |
//! | 16 | one flipped bit | `one_flipped_bit_spoils_one_frame_only`; `damage.rs`: `a_flipped_bit_is_found_and_named_in_every_byte_of_a_response` |
//! | 17 | collisions, captures cut at both ends | `damage.rs`: `a_collision_is_one_where_only_ones_are_missing`; `capture_starts_and_ends_in_the_middle` |
//! | 18 | pauses inside, none between | `pauses_inside_frames_and_none_between_them` |
//! | 19 | character times | `crates/modlens-protocol/src/line.rs`: `times_of_the_specification` |
//! | 20 | marks of the receiver | `tests/border/test_marks.py`; `crates/modlens-engine/src/input.rs`: `marks_and_holes_stay_with_their_bytes` |
//! | 21 | noise, cold and warm; a noisy start | `random_noise_is_noise`; `taps.rs`: `a_noisy_start_teaches_no_units`; `crates/modlens-bench/tests/engine.rs`: `noise_gives_no_frames_that_are_sold_as_facts` |
//! | 22 | units and baud rates that change | `taps.rs`: `units_change_after_hours_and_are_believed_at_once`, `the_baud_rate_changes_in_the_middle_of_a_recording` |
//! | 23 | live is as offline, and soon | `taps.rs`: `live_frames_come_with_their_last_byte_and_are_those_of_the_recording`, `silence_bounds_the_wait_of_a_live_tap` |
//! | 24 | blocks change nothing, the fast path gives the rows of the slow path | `properties.rs`: `untimed_bytes_tile_and_chunk_sizes_change_nothing`, `the_fast_path_gives_the_rows_of_the_slow_path` |
//! | 25 | ASCII | `streams.rs`: `ascii_is_found_again_behind_every_kind_of_damage`, `lower_case_digits_and_another_delimiter`, `ascii_characters_may_come_a_second_apart`, `rtu_data_that_holds_colons_stays_rtu` |
//! | 26 | clocks that stand still, step or fail | `taps.rs`: `clocks_that_stand_still_step_back_or_fail_lose_no_frame` |
//! | 27 | offsets beyond 4 GiB, memory | `crates/modlens-engine/src/session/bus.rs`: `offsets_beyond_four_gib_are_told_whole`; `make speed` (memory over 1 GB of noise) |

mod wire;

use std::time::Instant;

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

const CHAR: i64 = 572_916;

fn options() -> BusOptions {
    let mut options = BusOptions::named("bus");
    options.mode = Some(Mode::Rtu);
    options
}

/// Traffic that makes units 1 and 2 familiar.
fn warm_up() -> Vec<u8> {
    (0..6u16)
        .flat_map(|i| [read_request(1 + (i % 2) as u8, 100 * i, 2), read_response(1 + (i % 2) as u8, &[i, 0])].concat())
        .collect()
}

fn untimed(bytes: &[u8]) -> Batch {
    let mut session = Session::default();
    let bus = session.add_bus(options());
    session.feed(bus, &Chunk { bytes, ..Chunk::default() });
    session.flush();
    session.take()
}

/// Reads with the pause before each, at 19200 baud, 8E1, one byte a read.
fn timed(bursts: &[(i64, Vec<u8>)]) -> Batch {
    let mut session = Session::default();
    let mut options = options();
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    let mut now = 1_700_000_000_000_000_000;
    for (pause, bytes) in bursts {
        now += pause;
        let times: Vec<i64> = (1..=bytes.len() as i64).map(|i| now + i * CHAR).collect();
        now += bytes.len() as i64 * CHAR;
        session.feed(bus, &Chunk { bytes, times: Times::Bytes(&times), ..Chunk::default() });
    }
    session.flush();
    session.take()
}

fn statuses(batch: &Batch) -> Vec<Status> {
    batch.transactions.iter().map(|txn| txn.status).collect()
}

fn expect(batch: &Batch, skip: usize, frames: &[(Vec<u8>, Direction)]) {
    assert_eq!(&good(batch)[skip..], frames);
}

use Direction::{Request, Response};

use wire::{frame, good, read_request, read_response, MS};

#[test]
fn frames_glued_into_one_read_are_told_apart() {
    let frames = [
        (read_request(1, 0, 2), Request),
        (read_response(1, &[7, 8]), Response),
        (read_request(2, 5, 1), Request),
        (read_response(2, &[9]), Response),
    ];
    expect(&untimed(&frames.iter().flat_map(|(bytes, _)| bytes.clone()).collect::<Vec<_>>()), 0, &frames);
}

#[test]
fn a_frame_whose_checksum_ends_in_zero_is_whole() {
    // 01 04 02 03 01 has the CRC 78 00: without its last byte the frame is CRC-valid as well.
    let whole = vec![0x01, 0x04, 0x02, 0x03, 0x01, 0x78, 0x00];
    assert_eq!(frame(1, &[4, 2, 3, 1]), whole);
    let request = frame(1, &[4, 0, 0, 0, 1]);
    expect(&untimed(&[request.clone(), whole.clone()].concat()), 0, &[(request, Request), (whole, Response)]);
}

// A response of seven bytes and a zero have the length and the checksum of a request.
#[test]
fn a_second_response_with_a_stray_zero_behind_it_is_no_request() {
    for value in [0, 1, 5, 0x1122] {
        let (request, response) = (read_request(1, 0, 1), read_response(1, &[value]));
        let exchange = [request.clone(), response.clone()].concat();
        let behind = [&response[..], &[0], &exchange].concat();
        let batch = untimed(&[exchange.repeat(6), behind].concat());
        let (response, request) = ((response, Response), (request, Request));
        expect(&batch, 10, &[request.clone(), response.clone(), response.clone(), request, response]);
    }
}

#[test]
fn stray_zeros_and_ones_around_frames_belong_to_none() {
    for strays in [&[0u8][..], &[0, 0], &[0xFF], &[0xFF, 0xFE], &[0, 0, 0, 0, 0]] {
        let (ask, tell) = (read_request(1, 0, 2), read_response(1, &[7, 8]));
        let bytes = [&warm_up()[..], strays, &ask, strays, &tell, strays, &read_request(2, 0, 1)].concat();
        expect(&untimed(&bytes), 12, &[(ask, Request), (tell, Response), (read_request(2, 0, 1), Request)]);
    }
}

#[test]
fn published_frames_with_glitches_on_both_sides() {
    // minimalmodbus #61 and modbus-cli #41: CRC-valid with the trailing 00 as well.
    for text in ["00 04 83 02 D0 F0 00", "00 2E 03 02 04 80 6E E2 00"] {
        let bytes = modlens_protocol::hex::parse_hex(text).unwrap();
        let request = read_request(bytes[1], 0, 1);
        let batch = untimed(&[request.clone(), bytes.clone()].concat());
        expect(&batch, 0, &[(request, Request), (bytes[1..bytes.len() - 1].to_vec(), Response)]);
    }
}

#[test]
fn runs_of_one_value_are_no_frames_and_take_linear_time() {
    let patterns: [&[u8]; 5] = [&[0], &[0xFF], &[0xFF, 0xFF, 0, 0, 0], &[1, 3], &[0xA8, 0xEA]];
    for pattern in patterns {
        let bytes: Vec<u8> = pattern.iter().copied().cycle().take(1 << 20).collect();
        let start = Instant::now();
        assert_eq!(good(&untimed(&bytes)), [], "{pattern:02x?}");
        // Quadratic, a megabyte would take hours.
        assert!(start.elapsed().as_secs() < 60, "{pattern:02x?}");
    }
}

#[test]
fn eight_bytes_of_function_1_are_coils_where_coils_were_asked_for() {
    let ask = frame(1, &[1, 0, 0, 0, 24]);
    let tell = frame(1, &[1, 3, 0, 0, 8]);
    expect(&untimed(&[ask.clone(), tell.clone()].concat()), 0, &[(ask, Request), (tell, Response)]);
}

#[test]
fn an_echoed_write_is_an_answer_and_three_copies_are_a_retry() {
    let write = frame(1, &[6, 0, 1, 0, 3]);
    let next = read_request(2, 0, 1);
    let two = [warm_up(), write.clone(), write.clone(), next.clone(), read_response(2, &[1])].concat();
    expect(
        &untimed(&two),
        12,
        &[(write.clone(), Request), (write.clone(), Response), (next.clone(), Request), (read_response(2, &[1]), Response)],
    );
    let three = [warm_up(), write.clone(), write.clone(), write.clone(), next.clone(), read_response(2, &[1])].concat();
    let batch = untimed(&three);
    assert_eq!(good(&batch)[12..15].iter().map(|f| f.1).collect::<Vec<_>>(), [Request, Request, Response]);
    assert_eq!(batch.transactions[7].retry_of, Some(batch.transactions[6].number));
}

#[test]
fn the_pause_tells_a_retry_from_an_echo() {
    let write = frame(1, &[6, 0, 1, 0, 3]);
    let mut bursts = vec![];
    for i in 0..6 {
        bursts.extend([(20 * MS, read_request(1, i, 1)), (8 * MS, read_response(1, &[i]))]);
    }
    bursts.extend([
        (20 * MS, read_request(9, 0, 1)),
        (300 * MS, read_request(9, 0, 1)),
        (300 * MS, read_request(1, 0, 1)),
        (8 * MS, read_response(1, &[1])),
    ]);
    bursts.extend([(20 * MS, write.clone()), (300 * MS, write.clone()), (8 * MS, write.clone())]);
    let batch = timed(&bursts);
    let last: Vec<Direction> = good(&batch).iter().rev().take(3).map(|f| f.1).collect();
    assert_eq!(last, [Response, Request, Request]);
}

#[test]
fn a_local_echo_is_no_transaction_of_its_own() {
    let mut bursts = vec![];
    for i in 0..8 {
        bursts.extend([(20 * MS, [read_request(1, i, 1), read_request(1, i, 1)].concat()), (8 * MS, read_response(1, &[i]))]);
    }
    let batch = timed(&bursts);
    assert_eq!(statuses(&batch), [Status::Ok; 8]);
    assert!(batch.transactions.iter().all(|txn| txn.findings.of(&batch.codes).contains(&Finding::LocalEcho)));
}

#[test]
fn unanswered_broadcast_and_late() {
    let bursts = vec![
        (20 * MS, read_request(1, 0, 1)),
        (8 * MS, read_response(1, &[1])),
        (20 * MS, frame(0, &[6, 0, 1, 0, 3])),
        (100 * MS, read_request(1, 0, 1)),
        (8 * MS, read_response(1, &[1])),
        (20 * MS, read_request(2, 0, 2)),
        (300 * MS, read_request(1, 9, 1)),
        (8 * MS, read_response(1, &[1])),
        (8 * MS, read_response(2, &[4, 5])),
    ];
    let batch = timed(&bursts);
    let (ok, none) = (Status::Ok, Status::NoResponse);
    assert_eq!(statuses(&batch), [ok, Status::Broadcast, ok, none, ok, Status::Unsolicited]);
    assert_eq!(batch.transactions[5].late_response_to, Some(batch.transactions[3].number));
    assert!(batch.transactions[3].waited.is_some_and(|ns| (ns - 300 * MS).abs() < MS));
}

#[test]
fn a_request_again_after_a_damaged_answer_is_a_retry() {
    let mut damaged = read_response(1, &[7, 8]);
    damaged[4] ^= 1;
    let bytes = [warm_up(), read_request(1, 0, 2), damaged, read_request(1, 0, 2), read_response(1, &[7, 8])].concat();
    let batch = untimed(&bytes);
    assert_eq!(statuses(&batch)[6..], [Status::BadResponse, Status::Ok]);
    assert_eq!(batch.transactions[7].retry_of, Some(7));
}

#[test]
fn exceptions_of_every_function_and_strange_codes() {
    for code in [1u8, 6, 16, 23, 43, 65, 100] {
        for exception in [0u8, 1, 2, 7, 12, 0x80, 0xFF] {
            let ask = frame(1, &[code, 0, 0, 0, 1]);
            let tell = frame(1, &[code | 0x80, exception]);
            let bytes = [warm_up(), ask, tell.clone(), read_request(1, 0, 1)].concat();
            assert!(good(&untimed(&bytes)).contains(&(tell, Response)), "{code} {exception}");
        }
    }
}

#[test]
fn functions_without_public_layout_end_where_their_checksum_and_the_next_frame_say() {
    for length in [0usize, 1, 7, 40, 200] {
        let body: Vec<u8> = (0..length).map(|i| (i * 37 + 11) as u8).collect();
        let ask = frame(1, &[&[102], &body[..]].concat());
        let bytes = [&warm_up()[..], &ask, &read_request(2, 0, 1), &read_response(2, &[5])].concat();
        assert!(good(&untimed(&bytes)).contains(&(ask, Request)), "{length}");
    }
}

#[test]
fn a_frame_inside_a_payload_is_payload() {
    let inner = read_request(2, 0, 1);
    let mut pdu = vec![16, 0, 0, 0, 5, 10];
    pdu.extend(&inner);
    pdu.extend([0, 0]);
    let outer = frame(1, &pdu);
    let done = frame(1, &[16, 0, 0, 0, 5]);
    let bytes = [warm_up(), outer.clone(), done.clone(), read_request(1, 0, 1), read_response(1, &[1])].concat();
    expect(
        &untimed(&bytes),
        12,
        &[(outer, Request), (done, Response), (read_request(1, 0, 1), Request), (read_response(1, &[1]), Response)],
    );
}

#[test]
fn a_request_behind_a_truncated_response_is_found() {
    let cut = &read_response(1, &[1; 60])[..50];
    let bytes = [
        &warm_up()[..],
        &read_request(1, 0, 60),
        cut,
        &read_request(2, 7, 1),
        &read_response(2, &[3]),
        &read_request(1, 0, 1),
        &read_response(1, &[1]),
    ]
    .concat();
    let rest = [
        (read_request(2, 7, 1), Request),
        (read_response(2, &[3]), Response),
        (read_request(1, 0, 1), Request),
        (read_response(1, &[1]), Response),
    ];
    expect(&untimed(&bytes), 13, &rest);
}

#[test]
fn one_flipped_bit_spoils_one_frame_only() {
    let victims = [read_request(1, 0, 2), read_response(1, &[7, 8])];
    for victim in 0..2 {
        for at in 2..victims[victim].len() {
            let mut pair = victims.clone();
            pair[victim][at] ^= 0x10;
            let bytes = [warm_up(), pair[0].clone(), pair[1].clone(), read_request(2, 0, 1), read_response(2, &[5])].concat();
            let batch = untimed(&bytes);
            let found = good(&batch);
            assert!(
                found.contains(&(victims[1 - victim].clone(), if victim == 0 { Response } else { Request })),
                "{victim} {at}"
            );
            assert_eq!(
                found[found.len() - 2..],
                [(read_request(2, 0, 1), Request), (read_response(2, &[5]), Response)],
                "{victim} {at}"
            );
            let damaged =
                batch.frames.iter().any(|f| f.verdict != Verdict::Ok && f.wire.of(&batch.arena).contains(&pair[victim][at]));
            assert!(damaged, "{victim} {at}");
        }
    }
}

#[test]
fn pauses_inside_frames_and_none_between_them() {
    let (ask, tell) = (read_request(1, 0, 2), read_response(1, &[7, 8]));
    let bursts = vec![
        (20 * MS, ask[..3].to_vec()),
        (12 * MS, ask[3..].to_vec()),
        (0, tell.clone()),
        (20 * MS, ask.clone()),
        (5 * MS, tell[..4].to_vec()),
        (2 * CHAR, tell[4..].to_vec()),
    ];
    expect(&timed(&bursts), 0, &[(ask.clone(), Request), (tell.clone(), Response), (ask, Request), (tell, Response)]);
}

#[test]
fn quantities_over_the_limit_are_frames_with_a_finding() {
    for quantity in [126u8, 127] {
        let ask = read_request(1, 0, quantity);
        let tell = read_response(1, &vec![3; usize::from(quantity)]);
        let batch = untimed(&[warm_up(), ask.clone(), tell.clone(), read_request(1, 0, 1)].concat());
        assert!(good(&batch).contains(&(ask, Request)) && good(&batch).contains(&(tell, Response)), "{quantity}");
        assert!(batch.findings.iter().any(|row| row.finding == Finding::QuantityLimit));
    }
}

#[test]
fn a_response_with_four_bytes_a_register_is_a_frame_with_a_finding() {
    let (ask, tell) = (read_request(1, 0, 2), read_response(1, &[1, 2, 3, 4]));
    let batch = untimed(&[warm_up(), ask, tell.clone(), read_request(1, 0, 1), read_response(1, &[1])].concat());
    assert!(good(&batch).contains(&(tell, Response)));
    assert!(batch.findings.iter().any(|row| row.finding == Finding::ResponseLength));
}

#[test]
fn a_file_record_response_of_one_register_is_legal() {
    // Data length 4, below the minimum of 7 that the specification states (6.14).
    let ask = frame(1, &[20, 7, 6, 0, 4, 0, 1, 0, 1]);
    let tell = frame(1, &[20, 4, 3, 6, 0x0D, 0xFE]);
    let batch = untimed(&[ask.clone(), tell.clone()].concat());
    expect(&batch, 0, &[(ask, Request), (tell, Response)]);
    assert!(batch.findings.is_empty());
}

#[test]
fn random_noise_is_noise() {
    // A linear congruential generator (Numerical Recipes): the same noise everywhere.
    let mut state = 12345u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let bytes: Vec<u8> = (0..1 << 20).map(|_| noise()).collect();
    let batch = untimed(&bytes);
    let sure = batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok && !frame.unconfirmed).count();
    assert!(sure <= 2, "{sure} frames in a megabyte of noise");
}

#[test]
fn capture_starts_and_ends_in_the_middle() {
    let bytes =
        [&read_response(1, &[1; 20])[17..], &warm_up()[..], &read_request(1, 0, 20), &read_response(1, &[1; 20])[..9]].concat();
    let batch = untimed(&bytes);
    assert_eq!(good(&batch).len(), 13);
    assert_eq!(batch.frames.last().unwrap().verdict, Verdict::Incomplete);
    // The end of the recording is no damage.
    assert_eq!(*statuses(&batch).last().unwrap(), Status::NotObserved);
}

/// What one request's exchange looks like, 20 ms from frame to frame.
fn polls(rounds: u16) -> Vec<(i64, Vec<u8>)> {
    let round = |i| {
        [read_request(1, i, 1), read_response(1, &[i]), read_request(2, i, 2), read_response(2, &[i, i])]
            .map(|frame| (20 * MS, frame))
    };
    (0..rounds).flat_map(round).collect()
}

fn frames_with(batch: &Batch, finding: Finding) -> Vec<u64> {
    let rows = batch.findings.iter().filter(|row| row.finding == finding);
    let mut frames: Vec<u64> = rows.filter_map(|row| row.frame).collect();
    frames.sort_unstable();
    frames
}

#[test]
fn two_masters_are_told_with_hindsight_and_not_after_one_meeting() {
    let meeting = [
        (20 * MS, read_request(1, 0, 1)),
        (8 * MS, read_request(2, 0, 2)),
        (8 * MS, read_response(1, &[1])),
        (12 * MS, read_response(2, &[1, 2])),
    ];
    let once = timed(&[polls(4), meeting.to_vec()].concat());
    assert_eq!(statuses(&once), [Status::Ok; 10]);
    assert!(frames_with(&once, Finding::TwoMasters).is_empty());
    // The second time the younger request is answered first.
    let other = [
        (20 * MS, read_request(2, 7, 1)),
        (8 * MS, read_request(1, 7, 2)),
        (8 * MS, read_response(1, &[1, 2])),
        (12 * MS, read_response(2, &[9])),
    ];
    let twice = timed(&[polls(4), meeting.to_vec(), polls(2), other.to_vec()].concat());
    assert_eq!(statuses(&twice), [Status::Ok; 16]);
    assert_eq!(frames_with(&twice, Finding::TwoMasters), [19, 32]);
}

#[test]
fn an_answer_after_the_time_out_is_late_and_no_second_master() {
    let mut bursts = polls(4);
    for i in 0..5 {
        bursts.extend([
            (20 * MS, read_request(1, i, 1)),
            (250 * MS, read_request(1, i, 1)),
            (20 * MS, read_response(1, &[i])),
            (20 * MS, read_response(1, &[i + 9])),
        ]);
    }
    let batch = timed(&bursts);
    assert!(frames_with(&batch, Finding::TwoMasters).is_empty());
    assert_eq!((frames_with(&batch, Finding::Retry).len(), frames_with(&batch, Finding::LateResponse).len()), (5, 5));
    assert_eq!(frames_with(&batch, Finding::NoResponse).len(), 5);
}

#[test]
fn answers_to_requests_that_are_missing_are_not_late() {
    let gone = [(20 * MS, read_request(1, 5, 2)), (250 * MS, read_request(1, 5, 2)), (10 * MS, read_response(1, &[4, 4]))];
    // The tap loses the requests of a while: the first answer belongs to none that is known.
    let unasked =
        [(800 * MS, read_response(2, &[1])), (20 * MS, read_response(1, &[5, 5])), (20 * MS, read_response(1, &[5, 6]))];
    let silent = [(20 * MS, read_request(1, 5, 2))];
    let batch = timed(&[polls(4), vec![gone.to_vec(); 3].concat(), silent.to_vec(), unasked.to_vec()].concat());
    assert!(frames_with(&batch, Finding::LateResponse).is_empty());
    assert_eq!(frames_with(&batch, Finding::Unsolicited).len(), 3);
    // Without it, the first that fits is late, and a second one is not.
    let fits = [(800 * MS, read_response(1, &[5, 5])), (20 * MS, read_response(1, &[5, 6]))];
    let batch = timed(&[polls(4), vec![gone.to_vec(); 3].concat(), polls(4), silent.to_vec(), fits.to_vec()].concat());
    assert_eq!(frames_with(&batch, Finding::LateResponse), [batch.frames.len() as u64 - 1]);
}

#[test]
fn another_unit_answers_and_the_master_asks_again() {
    let wrong = [
        (20 * MS, read_request(1, 5, 2)),
        (10 * MS, read_response(2, &[4, 4])),
        (250 * MS, read_request(1, 5, 2)),
        (10 * MS, read_response(1, &[4, 4])),
    ];
    let batch = timed(&[polls(4), wrong.to_vec()].concat());
    assert_eq!(frames_with(&batch, Finding::WrongUnit), [18]);
    assert_eq!(frames_with(&batch, Finding::Retry), [19]);
    // Where the master goes on at once, it had its answer: the tap lost that, and the request of the other unit.
    let lost = [
        (20 * MS, read_request(1, 5, 2)),
        (10 * MS, read_response(2, &[4, 4])),
        (20 * MS, read_request(2, 9, 1)),
        (10 * MS, read_response(2, &[4])),
    ];
    let batch = timed(&[polls(4), lost.to_vec()].concat());
    assert!(frames_with(&batch, Finding::WrongUnit).is_empty() && frames_with(&batch, Finding::NoResponse).is_empty());
    assert!(statuses(&batch).contains(&Status::NotObserved));
}

#[test]
fn the_time_out_is_learned_and_a_unit_that_is_not_there_is_named_at_once() {
    // Nobody answers as unit 9, and the master goes on after 30 ms: too soon for most, but nobody is there.
    let absent = [(20 * MS, read_request(9, 5, 2)), (30 * MS, read_request(1, 1, 1)), (10 * MS, read_response(1, &[4]))];
    let batch = timed(&[polls(4), absent.to_vec(), polls(1)].concat());
    assert_eq!(frames_with(&batch, Finding::NoResponse).len(), 1);
}

#[test]
fn a_broadcast_is_heard_twice_where_everything_is() {
    let write = frame(0, &[6, 0, 1, 0, 3]);
    let mut bursts = Vec::new();
    for i in 0..4 {
        bursts.extend([(20 * MS, read_request(1, i, 1)), (MS / 10, read_request(1, i, 1)), (10 * MS, read_response(1, &[i]))]);
    }
    bursts.extend([
        (20 * MS, write.clone()),
        (MS / 10, write),
        (50 * MS, read_request(1, 0, 1)),
        (MS / 10, read_request(1, 0, 1)),
    ]);
    let batch = timed(&bursts);
    assert_eq!(frames_with(&batch, Finding::LocalEcho), [2, 5, 8, 11, 14, 16]);
    assert_eq!(statuses(&batch)[4], Status::Broadcast);
}

#[test]
fn two_lines_read_in_blocks_prove_no_second_master() {
    let mut session = Session::default();
    let mut options = options();
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    for i in 0..8 {
        let now = 1_700_000_000_000_000_000 + i64::from(i) * 100 * MS;
        // Two whole exchanges within what an adapter holds back: the order of the four frames is not known.
        let requests = [read_request(1, i, 1), read_request(2, i, 2)].concat();
        let answers = [read_response(1, &[i]), read_response(2, &[i, i])].concat();
        session.feed(bus, &Chunk { line: 1, bytes: &requests, times: Times::Read(now), ..Chunk::default() });
        session.feed(bus, &Chunk { line: 2, bytes: &answers, times: Times::Read(now + MS), ..Chunk::default() });
    }
    session.flush();
    let batch = session.take();
    assert_eq!(good(&batch).len(), 32);
    assert!(frames_with(&batch, Finding::TwoMasters).is_empty());
}
