//! Answers of units, gateways and taps that keep to no rule, and recordings that lack one side, their beginning or their end.
//!
//! Expected values follow from how each line is built here.

mod wire;

use modlens_engine::records::{Batch, Frame};
use modlens_engine::session::Session;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::Functions;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Side, Times};

use wire::tcp::{answer, ask, mbap, Packets};
use wire::{frame, read_request, read_response, session, MS};

/// A character at 19200 baud, 8E1.
const CHAR: i64 = 572_917;

/// A tap that times every character, or none.
struct Tap {
    session: Session,
    bus: usize,
    now: i64,
    is_timed: bool,
}

impl Tap {
    fn new(live: bool, is_timed: bool) -> Self {
        let (session, bus) = session(live, if is_timed { Clock::Utc } else { Clock::None });
        Self { session, bus, now: 1_700_000_000_000_000_000, is_timed }
    }

    /// One with a clock and one without, each offline and live.
    fn all() -> impl Iterator<Item = Self> {
        [(false, true), (true, true), (false, false), (true, false)].into_iter().map(|(live, timed)| Self::new(live, timed))
    }

    /// Bytes after so many milliseconds of silence.
    fn send(&mut self, silence_ms: i64, bytes: &[u8]) {
        self.now += silence_ms * MS;
        let times: Vec<i64> = (1..=bytes.len() as i64).map(|at| self.now + at * CHAR).collect();
        self.now += bytes.len() as i64 * CHAR;
        let times = if self.is_timed { Times::Bytes(&times) } else { Times::None };
        self.session.feed(self.bus, &Chunk { bytes, times, ..Chunk::default() });
    }

    fn exchanges(&mut self, count: u16) {
        for i in 0..count {
            self.send(30, &read_request(1, 10 * (i % 3), 2));
            self.send(12, &read_response(1, &[300 + i, 7]));
        }
    }

    fn finish(mut self) -> Batch {
        self.session.flush();
        self.session.take()
    }
}

fn statuses(batch: &Batch) -> Vec<Status> {
    batch.transactions.iter().map(|row| row.status).collect()
}

fn directions(batch: &Batch) -> Vec<Direction> {
    batch.frames.iter().map(|row| row.direction).collect()
}

fn findings(batch: &Batch) -> Vec<Finding> {
    batch.findings.iter().map(|row| row.finding).collect()
}

fn count(batch: &Batch, finding: Finding) -> usize {
    findings(batch).iter().filter(|found| **found == finding).count()
}

fn write(unit: u8, value: u8) -> Vec<u8> {
    frame(unit, &[6, 0, 1, 0, value])
}

#[test]
fn where_only_responses_are_heard_a_write_is_no_request_and_the_next_not_its_answer() {
    for (live, is_timed) in [(false, true), (true, true), (false, false), (true, false)] {
        let mut tap = Tap::new(live, is_timed);
        (0..30).for_each(|i| tap.send(60, &read_response(1, &[300 + i, 7])));
        for value in [3, 3, 4] {
            tap.send(60, &write(1, value));
        }
        tap.send(60, &write(2, 4));
        (0..3).for_each(|i| tap.send(60, &read_response(1, &[300 + i, 7])));
        let batch = tap.finish();
        assert_eq!(directions(&batch), [Direction::Response; 37]);
        // Before the first response its request may have been sent before the tap began.
        let (status, count) = (Status::Unsolicited, if live { 36 } else { 37 });
        assert_eq!(statuses(&batch), vec![status; count]);
    }
}

#[test]
fn where_only_requests_are_heard_a_lone_write_is_one() {
    for mut tap in Tap::all() {
        for i in 0..90u16 {
            tap.send(
                35,
                &if i > 20 && i % 9 == 8 { write(3, i as u8) } else { read_request(1 + (i % 3) as u8, 10 * (i % 5), 2) },
            );
        }
        let batch = tap.finish();
        assert_eq!(directions(&batch), [Direction::Request; 90]);
        assert!(batch.transactions.iter().all(|row| row.unconfirmed || row.status == Status::NotObserved));
    }
}

#[test]
fn a_read_to_unit_0_that_a_unit_answers_is_paired() {
    for mut tap in Tap::all() {
        tap.exchanges(3);
        for i in 0..3u16 {
            tap.send(30, &read_request(0, 5, 2));
            tap.send(12, &read_response(1, &[300 + i, 9]));
        }
        // Nobody answers this one, and nobody has to.
        tap.send(30, &read_request(0, 5, 2));
        tap.exchanges(2);
        let batch = tap.finish();
        let expected = [[Status::Ok; 6].as_slice(), &[Status::Broadcast], &[Status::Ok; 2]].concat();
        assert_eq!(statuses(&batch), expected);
        assert_eq!((batch.transactions[3].unit, count(&batch, Finding::BroadcastRead)), (0, 4));
        assert_eq!(batch.findings.len(), 4, "{:?}", findings(&batch));
    }
}

#[test]
fn the_first_frame_of_a_recording_is_no_silent_request_if_the_next_one_comes_at_once() {
    for live in [false, true] {
        // The response to a write, whose request the tap has missed.
        let mut tap = Tap::new(live, true);
        tap.send(0, &write(1, 3));
        tap.send(3, &read_request(1, 0, 2));
        tap.send(12, &read_response(1, &[300, 7]));
        tap.exchanges(2);
        let batch = tap.finish();
        assert_eq!(count(&batch, Finding::NoResponse) + count(&batch, Finding::Retry), 0, "{:?}", findings(&batch));
        assert_ne!(statuses(&batch)[0], Status::NoResponse);
    }
}

#[test]
fn a_late_response_whose_checksum_ends_in_00_is_not_cut_to_a_request_for_thousands_of_registers() {
    let response = (1_800..u16::MAX).map(|value| read_response(2, &[7, value])).find(|response| response[8] == 0).unwrap();
    for live in [false, true] {
        let mut tap = Tap::new(live, true);
        tap.exchanges(3);
        for _ in 0..3 {
            tap.send(30, &read_request(2, 40, 2));
            tap.send(300, &read_request(1, 0, 2));
            tap.send(12, &read_response(1, &[300, 9]));
            tap.send(12, &response);
        }
        tap.exchanges(2);
        let batch = tap.finish();
        assert_eq!(count(&batch, Finding::QuantityLimit) + count(&batch, Finding::StrayBytes), 0);
        assert_eq!(count(&batch, Finding::LateResponse), 3);
    }
}

#[test]
fn a_response_whose_byte_count_counts_registers_answers_its_request() {
    for is_timed in [true, false] {
        let mut tap = Tap::new(false, is_timed);
        for i in 0..6u8 {
            tap.send(30, &read_request(1, u16::from(i), 3));
            tap.send(12, &frame(1, &[3, 3, 1, 2, 3, 4, i, 6]));
        }
        let batch = tap.finish();
        assert_eq!(statuses(&batch), [Status::Ok; 6]);
        assert_eq!((count(&batch, Finding::LengthMismatch), batch.findings.len()), (6, 6), "{:?}", findings(&batch));
    }
}

#[test]
fn a_request_repeated_behind_its_late_response_is_a_retry() {
    for live in [false, true] {
        let mut tap = Tap::new(live, true);
        tap.exchanges(3);
        for i in 0..3u16 {
            tap.send(30, &read_request(2, 40, 2));
            tap.send(300, &read_request(2, 40, 2));
            tap.send(12, &read_response(2, &[300 + i, 9]));
        }
        // This line gives up after 300 ms.
        tap.send(30, &read_request(2, 40, 2));
        tap.send(700, &read_response(2, &[888, 9]));
        tap.send(20, &read_request(2, 40, 2));
        tap.send(12, &read_response(2, &[888, 9]));
        let batch = tap.finish();
        let silent = batch.transactions.iter().find(|row| row.number == 10).unwrap();
        let last = batch.transactions.iter().max_by_key(|row| row.number).unwrap();
        assert_eq!((silent.status, last.status, last.retry_of), (Status::NoResponse, Status::Ok, Some(10)));
        assert_eq!(batch.transactions.iter().filter(|row| row.late_response_to == Some(10)).count(), 1);
    }
}

#[test]
fn whole_damaged_exceptions_have_a_bad_checksum() {
    for mut tap in Tap::all() {
        tap.exchanges(3);
        for (at, bit) in [(0, 0x20), (1, 4), (2, 0x20), (3, 0x20), (4, 0x81)] {
            tap.send(30, &read_request(1, 100, 2));
            let mut exception = frame(1, &[0x83, 2]);
            exception[at] ^= bit;
            tap.send(12, &exception);
        }
        tap.exchanges(2);
        let batch = tap.finish();
        let damaged: Vec<_> = batch.frames.iter().filter(|row| !row.verdict.is_good()).map(|row| row.verdict).collect();
        assert_eq!(damaged, [Verdict::BadChecksum; 5]);
        assert_eq!(count(&batch, Finding::LostBytes) + count(&batch, Finding::Incomplete), 0);
    }
}

#[test]
fn what_the_beginning_or_the_end_of_a_recording_cuts_is_no_error() {
    for mut tap in Tap::all() {
        tap.send(0, &read_response(1, &[1, 2, 3, 4])[5..]);
        tap.exchanges(4);
        tap.send(30, &read_request(1, 0, 2));
        tap.send(12, &read_response(1, &[1, 2])[..6]);
        tap.session.flush();
        let batch = tap.session.take();
        assert_eq!(statuses(&batch), [[Status::Ok; 4].as_slice(), &[Status::NotObserved]].concat());
        let cut: Vec<_> = batch.frames.iter().filter(|row| !row.verdict.is_good()).map(|row| row.verdict).collect();
        assert_eq!(cut, [Verdict::Incomplete; 2]);
        let errors = findings(&batch).into_iter().filter(|found| *found != Finding::Unconfirmed);
        assert_eq!(errors.count(), 0, "{:?}", findings(&batch));
        assert_eq!(tap.session.stats().json(&Functions::default())["buses"][0]["cut"], 2);
    }
}

#[test]
fn a_frame_that_stops_before_the_end_of_the_recording_is_incomplete() {
    let mut tap = Tap::new(false, true);
    tap.exchanges(4);
    tap.send(30, &read_request(1, 0, 2));
    tap.send(12, &read_response(1, &[1, 2])[..6]);
    // An empty read: time has passed, and nothing came.
    tap.now += 500 * MS;
    tap.session.feed(tap.bus, &Chunk { times: Times::Read(tap.now), ..Chunk::default() });
    let batch = tap.finish();
    assert_eq!((statuses(&batch)[4], count(&batch, Finding::Incomplete)), (Status::BadResponse, 1));
}

#[test]
fn a_program_that_receives_what_it_sent_has_an_echo_whenever_it_prints_that() {
    for live in [false, true] {
        let (mut session, bus) = session(live, Clock::Utc);
        let mut now = 1_700_000_000_000_000_000;
        let mut print = |side, pause_ms: i64, bytes: &[u8]| {
            now += pause_ms * MS;
            let times = Times::Read(now);
            session.feed(bus, &Chunk { bytes, times, side: Some(side), starts_record: true, ..Chunk::default() });
        };
        for i in 0..20u16 {
            let request = read_request(1, 10 * (i % 3), 2);
            print(Side::Sent, 1000, &request);
            print(Side::Received, 60, &[request, read_response(1, &[i, 7])].concat());
        }
        session.flush();
        let batch = session.take();
        assert_eq!(statuses(&batch), [Status::Ok; 20], "live {live}");
        assert_eq!((count(&batch, Finding::LocalEcho), count(&batch, Finding::Retry)), (20, 0));
    }
}

#[test]
fn a_pause_inside_responses_shows_through_a_latency_timer() {
    // One unit pauses for 30 ms in every second response; the adapter delivers what has come every 16 ms.
    let (mut session, bus) = session(false, Clock::Utc);
    let mut now = 1_700_000_000_000_000_000;
    let (mut due, mut waiting) = (now, Vec::new());
    let mut send = |now: i64, byte: Option<u8>| {
        while now > due {
            if !waiting.is_empty() {
                session.feed(bus, &Chunk { bytes: &waiting, times: Times::Read(due), ..Chunk::default() });
                waiting.clear();
            }
            due += 16 * MS;
        }
        waiting.extend(byte);
    };
    for i in 0..200u16 {
        let unit = 1 + (i % 2) as u8;
        now += 40 * MS;
        for byte in read_request(unit, 10 * (i % 3), 6) {
            now += CHAR;
            send(now, Some(byte));
        }
        now += 12 * MS;
        for (at, byte) in read_response(unit, &[i, 1, 2, 3, 4, 5]).into_iter().enumerate() {
            now += CHAR + if at == 9 && i % 4 == 1 { 30 * MS } else { 0 };
            send(now, Some(byte));
        }
    }
    send(now + 100 * MS, None);
    session.flush();
    let batch = session.take();
    assert_eq!(statuses(&batch), [Status::Ok; 200]);
    // Of 50 such pauses the first four are needed to learn that it is the unit's, and some are hidden.
    let units: Vec<_> = batch.findings.iter().map(|row| (row.finding, row.unit)).collect();
    assert!(units.len() >= 30, "{}", units.len());
    assert!(units.iter().all(|found| *found == (Finding::GapInFrame, Some(2))), "{units:?}");
}

#[test]
fn a_gateway_that_answers_as_255_is_paired_by_identifier_and_told() {
    for live in [false, true] {
        let mut packets = Packets::new();
        for i in 0..4u16 {
            let at = i64::from(i) * 100;
            packets.data(at, 50_000, true, &mbap(i, 5, &[3, 0, 0, 0, 1]));
            packets.data(at + 10, 50_000, false, &mbap(i, 255, &[3, 2, 1, i as u8]));
        }
        let (batch, _) = packets.decode(live);
        assert_eq!(statuses(&batch), [Status::Ok; 4]);
        assert!(batch.transactions.iter().all(|row| row.unit == 5));
        assert_eq!(findings(&batch), [Finding::WrongUnit; 4]);
    }
}

#[test]
fn requests_in_mbap_and_answers_in_rtu_on_one_connection_are_paired() {
    for live in [false, true] {
        let mut packets = Packets::new();
        for i in 0..40u16 {
            let at = i64::from(i) * 100;
            packets.data(at, 50_000, true, &mbap(i, 5, &[3, 0, 0, 0, 1]));
            packets.data(at + 10, 50_000, false, &frame(5, &[3, 2, 1, i as u8]));
        }
        let (batch, _) = packets.decode(live);
        assert_eq!(statuses(&batch), [Status::Ok; 40], "live {live}");
        for row in &batch.transactions {
            assert_eq!(u16::from(row.response.pdu.of(&batch.arena)[3]), row.mbap_id.unwrap());
        }
        assert!(batch.findings.is_empty(), "{:?}", findings(&batch));
    }
}

#[test]
fn lost_segments_teach_no_habit_of_the_server_and_make_no_retry() {
    for live in [false, true] {
        let mut packets = Packets::new();
        let mut at = 0;
        for id in (0..16u16).step_by(4) {
            for id in [id, id + 1] {
                packets.data(at, 50_000, true, &ask(id, 10, 2));
                packets.data(at + 10, 50_000, false, &answer(id, &[id, 7]));
                at += 100;
            }
            // The answer to this one is lost, and so is the request after it.
            packets.data(at, 50_000, true, &ask(id + 2, 10, 2));
            packets.lose(50_000, false, &answer(id + 2, &[id + 2, 7]));
            packets.lose(50_000, true, &ask(id + 3, 20, 2));
            packets.data(at + 110, 50_000, false, &answer(id + 3, &[id + 3, 7]));
            at += 200;
        }
        let (batch, _) = packets.decode(live);
        let mut rows: Vec<_> = batch.transactions.iter().map(|row| (row.mbap_id.unwrap(), row.status)).collect();
        rows.sort_by_key(|row| row.0);
        let expected = [Status::Ok, Status::Ok, Status::NotObserved, Status::Unsolicited].repeat(4);
        assert_eq!(rows.iter().map(|row| row.1).collect::<Vec<_>>(), expected, "live {live}");
        assert_eq!(count(&batch, Finding::Retry) + count(&batch, Finding::TransactionId), 0);
    }
}

#[test]
fn a_dead_unit_that_is_polled_in_turn_with_another_is_not_retried() {
    for mut tap in Tap::all() {
        for i in 0..20u16 {
            tap.send(30, &frame(11, &[8, 0, 0, 0xD6, 0xC0]));
            tap.send(400, &read_request(1, 0, 2));
            tap.send(12, &read_response(1, &[300 + i, 7]));
        }
        let batch = tap.finish();
        assert_eq!((count(&batch, Finding::Retry), count(&batch, Finding::LateResponse)), (0, 0));
        assert_eq!(statuses(&batch).iter().filter(|status| **status == Status::Ok).count(), 20);
    }
}

#[test]
fn a_gateway_that_answers_as_255_answers_the_units_asked() {
    for mut tap in Tap::all() {
        for i in 0..12u16 {
            tap.send(30, &read_request(1 + (i % 3) as u8, 10, 2));
            tap.send(12, &read_response(255, &[300 + i, 7]));
        }
        let batch = tap.finish();
        assert_eq!(statuses(&batch), [Status::Ok; 12]);
        assert_eq!(count(&batch, Finding::WrongUnit), 12);
        let units: Vec<u8> = batch.transactions.iter().map(|row| row.unit).collect();
        assert_eq!(units[..3], [1, 2, 3]);
    }
}

#[test]
fn where_only_answers_to_writes_are_heard_no_side_is_claimed() {
    for mut tap in Tap::all() {
        let register = |number: u64| (number - 1) % 7;
        for i in 0..40u16 {
            tap.send(60, &frame(1, &[6, 0, (i % 7) as u8, 0, (i % 5) as u8]));
        }
        let batch = tap.finish();
        for row in batch.transactions.iter().filter(|row| row.status == Status::Ok) {
            assert_eq!(register(row.request.frame), register(row.response.frame), "register 0 does not answer register 1");
            assert!(row.confidence <= 5, "{}", row.confidence);
        }
        assert!(!statuses(&batch).contains(&Status::NoResponse), "nobody knows whether there was a request");
        let requests: Vec<&Frame> = batch.frames.iter().filter(|row| row.direction == Direction::Request).collect();
        assert!(requests.len() <= 1, "each may be a request or a response, but {} are requests", requests.len());
        assert!(requests.iter().all(|row| row.confidence < 10));
    }
}

#[test]
fn a_response_that_two_requests_may_have_is_less_certain() {
    let mut tap = Tap::new(false, true);
    tap.exchanges(6);
    tap.send(30, &read_request(1, 50, 2));
    tap.send(300, &read_request(1, 60, 2));
    tap.send(12, &read_response(1, &[300, 7]));
    tap.exchanges(2);
    let batch = tap.finish();
    let bits: Vec<u8> = batch.transactions[6..9].iter().map(|row| row.confidence).collect();
    assert!(bits[1] < bits[2] && bits[1] <= 7, "{bits:?}");
}

#[test]
fn a_frame_with_a_long_pause_inside_is_a_valid_frame_that_says_so() {
    for pause_ms in [2, 20, 80, 100, 400] {
        let mut tap = Tap::new(false, true);
        tap.exchanges(3);
        let request = read_request(1, 10, 2);
        tap.send(30, &request[..3]);
        tap.send(pause_ms, &request[3..]);
        tap.send(12, &read_response(1, &[300, 7]));
        tap.exchanges(3);
        let batch = tap.finish();
        assert_eq!(statuses(&batch), [Status::Ok; 7], "{pause_ms}");
        let found: Vec<&str> = batch.findings.iter().map(|row| row.detail.as_str()).collect();
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].starts_with(&format!("{pause_ms}000 us of silence inside")), "{found:?}");
        assert!(found[0].ends_with("the master paused"), "{found:?}");
    }
}

#[test]
fn a_long_pause_in_front_of_the_last_read_is_the_senders_where_bytes_come_one_by_one() {
    for (pause_ms, expected) in [(15, 0), (60, 1), (130, 1)] {
        let (mut session, bus) = session(false, Clock::Utc);
        let mut now = 1_700_000_000_000_000_000;
        let mut read = |silence: i64, bytes: &[u8]| {
            now += silence + bytes.len() as i64 * CHAR;
            session.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
        };
        for at in 0..6 {
            let (request, response) = (read_request(1, 10, 2), read_response(1, &[300 + at, 7]));
            let whole = if at == 3 { 6 } else { request.len() };
            request[..whole].iter().enumerate().for_each(|(i, &byte)| read(if i == 0 { 30 * MS } else { 0 }, &[byte]));
            if at == 3 {
                read(pause_ms * MS, &request[whole..]);
            }
            response.iter().enumerate().for_each(|(i, &byte)| read(if i == 0 { 12 * MS } else { 0 }, &[byte]));
        }
        session.flush();
        let batch = session.take();
        assert_eq!(statuses(&batch), [Status::Ok; 6]);
        assert_eq!(count(&batch, Finding::GapInFrame), expected, "{pause_ms}");
    }
}
