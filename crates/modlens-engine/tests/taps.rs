//! Good traffic as taps deliver it, live and recorded: cut into reads, delayed, with stray bytes, with clocks that step.

mod wire;

use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{frame, good, read_request, session, MS};

const START: i64 = 1_700_000_000_000_000_000;

/// A response with register bytes that count up from `first`.
fn counting_response(unit: u8, quantity: u8, first: u8) -> Vec<u8> {
    let mut pdu = vec![3, 2 * quantity];
    pdu.extend((0..2 * quantity).map(|i| i.wrapping_mul(31).wrapping_add(first)));
    frame(unit, &pdu)
}

/// The frames with their directions; all bytes must be in good frames.
fn all_good(batch: &Batch) -> Vec<(Vec<u8>, Direction)> {
    assert!(batch.frames.iter().all(|frame| frame.verdict == Verdict::Ok && !frame.unconfirmed));
    good(batch)
}

fn pair(request: Vec<u8>, response: Vec<u8>) -> [(Vec<u8>, Direction); 2] {
    [(request, Direction::Request), (response, Direction::Response)]
}

#[test]
fn a_pair_is_found_however_it_is_split_into_two_reads() {
    let (request, response) = (read_request(1, 10, 2), counting_response(1, 2, 5));
    let bytes = [request.clone(), response.clone()].concat();
    for live in [false, true] {
        for split in 1..bytes.len() {
            let (mut session, bus) = session(live, Clock::Utc);
            for (bytes, time) in [(&bytes[..split], START), (&bytes[split..], START + 20 * MS)] {
                session.feed(bus, &Chunk { bytes, times: Times::Read(time), ..Chunk::default() });
            }
            session.flush();
            assert_eq!(all_good(&session.take()), pair(request.clone(), response.clone()), "{live} {split}");
        }
    }
}

#[test]
fn frames_are_found_across_packets_of_32_and_62_bytes_with_long_waits_between_them() {
    let exchanges: Vec<_> = (0..8u8).map(|i| pair(read_request(1, 10, 120), counting_response(1, 120, i))).collect();
    for (size, wait) in [(32, 16 * MS), (32, 33 * MS), (62, 16 * MS), (62, 33 * MS), (31, 16 * MS)] {
        let (mut session, bus) = session(false, Clock::Utc);
        let mut now = START;
        for (bytes, _) in exchanges.iter().flatten() {
            for bytes in bytes.chunks(size) {
                now += wait;
                session.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
            }
            now += 40 * MS;
        }
        session.flush();
        assert_eq!(all_good(&session.take()), exchanges.concat(), "{size} {wait}");
    }
}

#[test]
fn a_frame_whose_checksum_ends_in_zero_keeps_its_last_byte() {
    // Responses with one register whose checksum has the high byte 00: they are valid without their last byte, too.
    let ending = (0..=u16::MAX).map(|value| frame(1, &[&[3, 2][..], &value.to_be_bytes()].concat()));
    for response in ending.filter(|frame| frame[frame.len() - 1] == 0).take(40) {
        for live in [false, true] {
            let (mut session, bus) = session(live, Clock::Utc);
            let mut now = START;
            for byte in [read_request(1, 10, 1), response.clone(), read_request(1, 11, 1), response.clone()].concat() {
                now += MS;
                session.feed(bus, &Chunk { bytes: &[byte], times: Times::Read(now), ..Chunk::default() });
            }
            session.flush();
            let both = [pair(read_request(1, 10, 1), response.clone()), pair(read_request(1, 11, 1), response.clone())].concat();
            assert_eq!(all_good(&session.take()), both, "{response:02x?}");
        }
    }
}

#[test]
fn a_stray_byte_at_every_turnaround_costs_no_frame() {
    for stray in [0x00u8, 0xFE, 0xFF, 0x80] {
        for clock in [Clock::None, Clock::Utc] {
            let (mut session, bus) = session(false, clock);
            let mut expected = Vec::new();
            let mut now = START;
            for i in 0..200u16 {
                let unit = 1 + (i % 3) as u8;
                let frames = pair(read_request(unit, 10 * (i % 7), 4), counting_response(unit, 4, i as u8));
                for (bytes, _) in &frames {
                    let bytes = [&[stray][..], bytes].concat();
                    now += 8 * MS;
                    let times = if clock == Clock::None { Times::None } else { Times::Read(now) };
                    session.feed(bus, &Chunk { bytes: &bytes, times, ..Chunk::default() });
                }
                expected.extend(frames);
            }
            session.flush();
            let batch = session.take();
            assert_eq!(good(&batch), expected, "{stray:02x} {clock:?}");
            // Each unit's first response is unconfirmed, since the unit was in no paired transaction before.
            let unconfirmed = batch.frames.iter().filter(|row| row.unconfirmed).count();
            assert!(unconfirmed <= 3, "{unconfirmed} unconfirmed frames at {stray:02x} {clock:?}");
        }
    }
}

#[test]
fn new_units_after_hours_are_accepted_at_once() {
    let (mut session, bus) = session(false, Clock::None);
    let traffic = |units: [u8; 2], count: u16| -> Vec<(Vec<u8>, Direction)> {
        (0..count)
            .flat_map(|i| {
                pair(read_request(units[usize::from(i % 2)], i % 50, 3), counting_response(units[usize::from(i % 2)], 3, i as u8))
            })
            .collect()
    };
    let expected = [traffic([1, 2], 6000), traffic([201, 77], 50)].concat();
    let bytes: Vec<u8> = expected.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
    for bytes in bytes.chunks(1000) {
        session.feed(bus, &Chunk { bytes, ..Chunk::default() });
    }
    session.flush();
    assert_eq!(all_good(&session.take()), expected);
}

#[test]
fn a_noisy_start_teaches_no_units() {
    let mut state = 99u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let (mut session, bus) = session(false, Clock::None);
    let mut bytes: Vec<u8> = (0..200_000).map(|_| noise()).collect();
    let traffic: Vec<_> = (0..20u16).flat_map(|i| pair(read_request(9, i, 2), counting_response(9, 2, i as u8))).collect();
    bytes.extend(traffic.iter().flat_map(|(bytes, _)| bytes.clone()));
    session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
    session.flush();
    let batch = session.take();
    let behind: Vec<_> = batch.frames.iter().filter(|frame| frame.offset >= 200_000 && frame.verdict == Verdict::Ok).collect();
    assert_eq!(behind.len(), 40);
    assert!(behind.iter().all(|frame| frame.unit == Some(9)));
}

#[test]
fn clocks_that_stand_still_step_back_or_fail_cost_no_frame() {
    let expected: Vec<_> = (0..12u16).flat_map(|i| pair(read_request(1, i, 2), counting_response(1, 2, i as u8))).collect();
    let steps: [&dyn Fn(i64) -> Option<i64>; 4] = [
        &|_| Some(START),
        &|i| Some(START + i * 8 * MS - if i % 5 == 4 { 300_000 } else { 0 }),
        &|i| Some(START + i * 8 * MS - if i > 12 { 3_600_000 * MS } else { 0 }),
        &|i| (i % 3 != 1).then_some(START + i * 8 * MS),
    ];
    for (which, time) in steps.iter().enumerate() {
        for live in [false, true] {
            let (mut session, bus) = session(live, Clock::Utc);
            for (i, (bytes, _)) in expected.iter().enumerate() {
                let times = time(i as i64).map_or(Times::None, Times::Read);
                session.feed(bus, &Chunk { bytes, times, ..Chunk::default() });
            }
            session.flush();
            assert_eq!(all_good(&session.take()), expected, "{which} {live}");
        }
    }
}

#[test]
fn live_frames_are_emitted_with_their_last_byte_and_equal_those_of_the_recording() {
    let expected: Vec<_> = (0..30u16).flat_map(|i| pair(read_request(1, i % 4, 2), counting_response(1, 2, i as u8))).collect();
    let (mut live, bus) = session(true, Clock::Utc);
    let (mut now, mut at_once, mut all) = (START, 0, Vec::new());
    for (i, (bytes, _)) in expected.iter().enumerate() {
        now += 8 * MS;
        live.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
        let found = good(&live.take());
        // Once the units are known, no frame has to wait for the next one.
        at_once += usize::from(i >= 12 && found.len() == 1);
        all.extend(found);
    }
    live.poll(now + 150 * MS);
    all.extend(good(&live.take()));
    assert_eq!(at_once, expected.len() - 12);
    assert_eq!(all, expected);
}

#[test]
fn silence_bounds_the_wait_of_a_live_tap() {
    let (mut live, bus) = session(true, Clock::Utc);
    live.feed(bus, &Chunk { bytes: &read_request(1, 10, 2)[..5], times: Times::Read(START), ..Chunk::default() });
    assert!(live.take().frames.is_empty());
    live.poll(START + 100 * MS);
    assert_eq!(live.take().frames.len(), 1, "a part of a frame is emitted after 100 ms of silence");
    live.feed(bus, &Chunk { bytes: &read_request(1, 10, 2), times: Times::Read(START + 200 * MS), ..Chunk::default() });
    live.poll(START + 10_300 * MS);
    let statuses: Vec<Status> = live.take().transactions.iter().map(|row| row.status).collect();
    assert_eq!(statuses, [Status::NoResponse]);
}

/// Ten transactions, then a response that stops for `stall` ms in its middle, then one more transaction.
fn stalled(live: bool, stall: i64) -> Batch {
    let (mut session, bus) = session(live, Clock::Utc);
    let mut now = START;
    let mut feed = |session: &mut Session, pause: i64, bytes: &[u8]| {
        now += pause * MS;
        session.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
    };
    for i in 0..10u8 {
        feed(&mut session, 20, &read_request(1, 10, 20));
        feed(&mut session, 20, &counting_response(1, 20, i));
    }
    feed(&mut session, 20, &read_request(1, 10, 20));
    feed(&mut session, 20, &counting_response(1, 20, 77)[..21]);
    feed(&mut session, stall, &counting_response(1, 20, 77)[21..]);
    feed(&mut session, 30, &read_request(1, 10, 20));
    feed(&mut session, 20, &counting_response(1, 20, 99));
    session.flush();
    session.take()
}

#[test]
fn a_late_read_inside_a_frame_costs_at_most_that_frame() {
    for live in [false, true] {
        // Adapters and schedulers hold bytes back for up to 80 ms.
        assert_eq!(all_good(&stalled(live, 80)).len(), 24, "live {live}");
        // Live, nobody waits any longer: it costs this frame, and no other one. In a recording its end is there to see.
        let batch = stalled(live, 120);
        let found = good(&batch);
        if !live {
            assert_eq!(found.len(), 24);
            continue;
        }
        assert_eq!(found.len(), 23, "live {live}");
        assert_eq!(found[21..], pair(read_request(1, 10, 20), counting_response(1, 20, 99)), "live {live}");
        let bad: Vec<Verdict> = batch.frames.iter().map(|frame| frame.verdict).filter(|verdict| !verdict.is_good()).collect();
        assert!(bad.iter().any(|verdict| *verdict != Verdict::Noise), "live {live}: {bad:?}");
    }
}

#[test]
fn frames_are_found_on_both_sides_of_a_change_of_the_baud_rate() {
    let (mut session, bus) = session(false, Clock::Utc);
    let mut now = START;
    let mut feed = |bytes: &[u8], char_ns: i64, pause: i64| {
        now += pause;
        let times: Vec<i64> = (1..=bytes.len() as i64).map(|at| now + at * char_ns).collect();
        now = times[times.len() - 1];
        session.feed(bus, &Chunk { bytes, times: Times::Bytes(&times), ..Chunk::default() });
    };
    let pairs: Vec<_> = (0..40u16).flat_map(|at| pair(read_request(1, at % 4, 2), counting_response(1, 2, at as u8))).collect();
    let (before, after) = pairs.split_at(40);
    for (bytes, _) in before {
        feed(bytes, 572_916, 8 * MS);
    }
    // A receiver that is still set to the old rate gets nonsense.
    feed(&[0xF8, 0x00, 0xE6, 0x80, 0x00, 0x66, 0xFE, 0x98, 0xE0, 0x00, 0x1E, 0x80, 0xF8, 0x06], 572_916, 8 * MS);
    for (bytes, _) in after {
        feed(bytes, 95_486, 3 * MS);
    }
    session.flush();
    assert_eq!(good(&session.take()), pairs);
}

/// Transactions on two lines whose adapters hold bytes back: in each round the request is read at START + 100 ms, and the
/// response `early(round)` ms before it.
fn two_lines(live: bool, early: impl Fn(i64) -> i64) -> (Batch, Vec<(Vec<u8>, Direction)>) {
    let (mut session, bus) = session(live, Clock::Utc);
    let (mut reads, mut expected) = (Vec::new(), Vec::new());
    for round in 0..60i64 {
        let unit = 1 + (round % 3) as u8;
        let both = pair(read_request(unit, round as u16 % 7, 2), counting_response(unit, 2, round as u8));
        let asked = START + 100 * round * MS;
        reads.push((asked, 1, both[0].0.clone()));
        reads.push((asked - early(round) * MS, 2, both[1].0.clone()));
        expected.extend(both);
    }
    reads.sort();
    for (time, line, bytes) in reads {
        session.feed(bus, &Chunk { line, bytes: &bytes, times: Times::Read(time), ..Chunk::default() });
    }
    session.flush();
    (session.take(), expected)
}

#[test]
fn a_response_read_before_its_request_on_the_other_line_is_paired_with_it() {
    for live in [false, true] {
        // A latency timer of 16 ms on each line: every third response is read first.
        let (batch, expected) = two_lines(live, |round| if round % 3 == 0 { 11 } else { -9 });
        assert_eq!(all_good(&batch), expected, "live {live}");
        let statuses: Vec<Status> = batch.transactions.iter().map(|row| row.status).collect();
        assert_eq!(statuses, [Status::Ok; 60], "live {live}");
    }
}

#[test]
fn two_lines_of_which_only_one_has_times_keep_all_bytes() {
    for timed in [0, 1] {
        let (mut session, bus) = session(false, Clock::Utc);
        let mut sent = Vec::new();
        for i in 0..20u8 {
            let time = START + i64::from(i) * 100 * MS;
            for (side, (bytes, _)) in pair(read_request(1, 10, 2), counting_response(1, 2, i)).into_iter().enumerate() {
                let times = if side == timed { Times::Read(time + side as i64 * 20 * MS) } else { Times::None };
                session.feed(bus, &Chunk { bytes: &bytes, line: side as u8 + 1, times, ..Chunk::default() });
                sent.push(bytes);
            }
        }
        session.flush();
        let mut found: Vec<Vec<u8>> = all_good(&session.take()).into_iter().map(|(bytes, _)| bytes).collect();
        found.sort();
        sent.sort();
        assert_eq!(found, sent, "times on line {}", timed + 1);
    }
}

#[test]
fn the_skew_of_two_lines_is_learned_from_the_first_request_that_is_too_late() {
    for live in [false, true] {
        // 70 ms are longer than the skew assumed at first, which is 60 ms.
        let (batch, expected) = two_lines(live, |round| if round % 6 == 5 { 70 } else { -9 });
        assert_eq!(good(&batch).len(), expected.len());
        let statuses: Vec<Status> = batch.transactions.iter().map(|row| row.status).collect();
        let unpaired = statuses.iter().filter(|status| **status != Status::Ok).count();
        assert!(unpaired <= 2, "live {live}: {statuses:?}");
    }
}

#[test]
fn the_second_of_two_equal_responses_behind_a_retry_is_not_paired_with_the_next_request() {
    // Latency timers of 16 ms on both lines; the next request reads as many registers of the same unit.
    let (first_request, next) = (read_request(1, 10, 2), read_request(1, 40, 2));
    let (same, own) = (counting_response(1, 2, 5), counting_response(1, 2, 99));
    for live in [false, true] {
        let (mut session, bus) = session(live, Clock::Utc);
        let mut now = START;
        let mut feed = |line: u8, pause: i64, bytes: &[u8]| {
            now += pause * MS;
            session.feed(bus, &Chunk { line, bytes, times: Times::Read(now), ..Chunk::default() });
        };
        for round in 0..30u8 {
            // Every other response is read at the same time as its request.
            feed(1, 60, &read_request(2, 7, 3));
            feed(2, if round % 2 == 0 { 0 } else { 16 }, &counting_response(2, 3, round));
            feed(1, 40, &read_request(3, 7, 1));
            feed(2, 16, &counting_response(3, 1, round)[..3]);
            feed(2, 16, &counting_response(3, 1, round)[3..]);
        }
        feed(1, 60, &first_request);
        feed(1, 250, &first_request);
        feed(2, 16, &same);
        feed(2, 16, &same);
        feed(1, 15, &next);
        feed(2, 1, &own);
        feed(1, 60, &read_request(2, 7, 3));
        feed(2, 16, &counting_response(2, 3, 1));
        session.flush();
        let batch = session.take();
        let answered = |row: &modlens_engine::records::Transaction| row.status == Status::Ok && row.response.frame != 0;
        let last_two: Vec<Vec<u8>> = batch
            .transactions
            .iter()
            .filter(|row| answered(row))
            .rev()
            .take(2)
            .map(|row| {
                let frame = batch.frames.iter().find(|frame| frame.number == row.response.frame).unwrap();
                frame.wire.of(&batch.arena).to_vec()
            })
            .collect();
        assert_eq!(last_two, [counting_response(2, 3, 1), own.clone()], "live {live}");
    }
}

#[test]
fn wrong_bytes_that_are_repeated_do_not_confirm_each_other() {
    // Eight bytes like those of a write, and of a vendor's function: noise that is repeated looks like a request and its
    // identical response.
    let noise = [0xE1, 0x5C, 0x3D, 0xC7, 0x91, 0x2B, 0x6E];
    for once in [frame(2, &[6, 0x16, 6, 0xE3, 3]), frame(2, &[102])] {
        let (mut session, bus) = session(false, Clock::None);
        let bytes = [&noise.repeat(40)[..], &once, &once, &noise.repeat(40)].concat();
        session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
        session.flush();
        let batch = session.take();
        assert!(batch.frames.iter().filter(|row| row.verdict == Verdict::Ok).all(|row| row.unconfirmed), "{once:02x?}");
    }
}

#[test]
fn frames_of_a_vendors_function_are_accepted_behind_stray_bytes() {
    let exchanges: Vec<Vec<u8>> = (0..12u8).flat_map(|at| [frame(9, &[70, at]), frame(9, &[70, at, 7, at * 3])]).collect();
    let (mut session, bus) = session(false, Clock::None);
    let bytes = [&[0x13, 0x55, 0xA9, 0x70][..], &exchanges.concat()].concat();
    session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
    session.flush();
    let batch = session.take();
    let whole: Vec<bool> = batch.frames.iter().filter(|row| row.verdict == Verdict::Ok).map(|row| row.unconfirmed).collect();
    assert_eq!(whole.len(), 24);
    assert!(whole[5..].iter().all(|unconfirmed| !unconfirmed), "{whole:?}");
}

#[test]
fn a_live_tap_waits_for_bytes_that_an_adapter_holds_back() {
    // A serial server sends 200 bytes at once: at 19200 baud they take 115 ms, longer than the silence that ends a frame.
    let (mut live, bus) = session(true, Clock::Utc);
    let expected: Vec<_> = (0..40u8).flat_map(|i| pair(read_request(1, 10, 20), counting_response(1, 20, i))).collect();
    let bytes: Vec<u8> = expected.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
    let mut now = START;
    for bytes in bytes.chunks(200) {
        let until = now + 115 * MS;
        while now < until {
            now += 5 * MS;
            live.poll(now);
        }
        live.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
    }
    live.poll(now + 1000 * MS);
    assert_eq!(all_good(&live.take()), expected);
}

#[test]
fn a_tap_that_starts_inside_an_exchange_reports_nothing_about_it() {
    const CHAR: i64 = 572_916;
    let exchanges: Vec<_> = (0..8u8).map(|i| pair(read_request(1, 10, 4), counting_response(1, 4, i))).collect();
    let first_two: usize = exchanges[..2].iter().flatten().map(|(bytes, _)| bytes.len()).sum();
    for heard_from in 0..first_two {
        let (mut session, bus) = session(true, Clock::Utc);
        let (mut now, mut sent) = (START, 0);
        for (bytes, _) in exchanges.iter().flatten() {
            now += 6 * MS;
            for byte in bytes.chunks(1) {
                now += CHAR;
                sent += 1;
                if sent > heard_from {
                    session.feed(bus, &Chunk { bytes: byte, times: Times::Read(now), ..Chunk::default() });
                }
            }
        }
        session.flush();
        let batch = session.take();
        assert!(batch.findings.is_empty(), "from {heard_from}: {:?}", batch.findings);
        assert!(batch.transactions.iter().all(|row| row.status == Status::Ok), "from {heard_from}");
        assert!((6..=8).contains(&batch.transactions.len()), "from {heard_from}");
    }
}

/// Exchanges of an ASCII line are taken whole, without the slow path.
#[test]
fn a_tap_that_starts_between_exchanges_reports_the_first_damage() {
    let mut session = Session::new(
        Arc::new(Functions::default()),
        WantedTables { frames: true, transactions: true, findings: true },
        true,
        None,
    );
    let mut options = BusOptions { mode: Some(Mode::Ascii), ..BusOptions::named("bus") };
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    // Read one register, value 7; then half of a request.
    let exchange = [":010300000001FB\r\n", ":0103020007F3\r\n"];
    for (at, text) in exchange.iter().cycle().take(8).chain(&[":0103000", ":010300000001FB\r\n"]).enumerate() {
        let times = Times::Read(START + 200 * MS * at as i64);
        session.feed(bus, &Chunk { bytes: text.as_bytes(), times, ..Chunk::default() });
    }
    session.flush();
    let batch = session.take();
    assert!(batch.transactions[..4].iter().all(|row| row.status == Status::Ok));
    assert!(batch.findings.iter().any(|row| row.finding == Finding::Incomplete), "{:?}", batch.findings);
}
