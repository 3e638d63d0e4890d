//! How long a request waits for its response: until that comes, until its master asks again, or until the waiting time that
//! the line has shown is over. One second is a first guess and closes nothing.

mod wire;

use modlens_engine::records::{Batch, Transaction};
use modlens_engine::session::Session;
use modlens_protocol::finding::Finding;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::tcp::{answer, ask, mbap, ms, Packets};
use wire::{frame, read_request, read_response, session, MS};

const CHAR: i64 = 572_916;
const START: i64 = 1_700_000_000_000_000_000;

/// A tap of a serial line at 19200-8E1, which times every character.
struct Tap {
    session: Session,
    bus: usize,
    now: i64,
}

impl Tap {
    fn new(live: bool) -> Self {
        let (session, bus) = session(live, Clock::Utc);
        Self { session, bus, now: START }
    }

    /// A frame after so many milliseconds of silence.
    fn send(&mut self, silence_ms: i64, bytes: &[u8]) {
        self.now += silence_ms * MS;
        let times: Vec<i64> = (1..=bytes.len() as i64).map(|at| self.now + at * CHAR).collect();
        self.now += bytes.len() as i64 * CHAR;
        self.session.feed(self.bus, &Chunk { bytes, times: Times::Bytes(&times), ..Chunk::default() });
    }

    fn finish(mut self) -> Batch {
        self.session.flush();
        self.session.take()
    }
}

fn statuses(batch: &Batch) -> Vec<Status> {
    batch.transactions.iter().map(|row| row.status).collect()
}

fn count(batch: &Batch, finding: Finding) -> usize {
    batch.findings.iter().filter(|row| row.finding == finding).count()
}

#[test]
fn thirty_serial_requests_answered_after_1200_and_after_3000_ms_are_thirty_ok() {
    for live in [false, true] {
        for wait in [1_200, 3_000] {
            let mut tap = Tap::new(live);
            for i in 0..30u16 {
                tap.send(50, &read_request(1, 10 * (i % 3), 2));
                tap.send(wait, &read_response(1, &[i, 7]));
            }
            let batch = tap.finish();
            assert_eq!(statuses(&batch), [Status::Ok; 30], "live {live}, {wait} ms");
            assert!(batch.transactions.iter().all(|row| ms(row.response_time) == Some(wait) && row.waited.is_none()));
            assert!(batch.findings.is_empty(), "{:?}", batch.findings);
        }
    }
}

#[test]
fn an_exception_of_the_gateway_after_a_second_answers_its_request() {
    // Exception 11, gateway target device failed to respond (application protocol, 7).
    for live in [false, true] {
        let mut tap = Tap::new(live);
        for i in 0..12u16 {
            tap.send(20, &read_request(1, i, 2));
            tap.send(15, &read_response(1, &[i, 7]));
            tap.send(20, &read_request(9, i, 2));
            tap.send(1_050, &frame(9, &[0x83, 0x0B]));
        }
        let expected = [Status::Ok, Status::Exception].repeat(12);
        assert_eq!(statuses(&tap.finish()), expected, "live {live}");
    }
}

#[test]
fn the_next_request_closes_a_silent_one_and_the_wait_is_that_of_silent_requests_only() {
    for live in [false, true] {
        let mut tap = Tap::new(live);
        for i in 0..4u16 {
            tap.send(30, &read_request(1, i, 2));
            tap.send(1_500, &read_response(1, &[i, 7]));
        }
        tap.send(30, &read_request(2, 0, 2));
        tap.send(2_500, &read_request(1, 0, 2));
        tap.send(1_500, &read_response(1, &[5, 7]));
        let batch = tap.finish();
        let rows: Vec<_> = batch.transactions.iter().map(|row| (row.status, ms(row.waited))).collect();
        let ok = (Status::Ok, None);
        assert_eq!(rows, [ok, ok, ok, ok, (Status::NoResponse, Some(2_500)), ok], "live {live}");
    }
}

#[test]
fn a_live_row_without_response_comes_with_the_next_request_or_after_ten_seconds() {
    let mut tap = Tap::new(true);
    tap.send(0, &read_request(1, 0, 2));
    tap.send(15, &read_response(1, &[1, 2]));
    tap.send(30, &read_request(2, 0, 2));
    tap.session.poll(tap.now + 9_990 * MS);
    assert_eq!(statuses(&tap.session.take()), [Status::Ok], "it may still be answered");
    tap.session.poll(tap.now + 10_010 * MS);
    assert_eq!(statuses(&tap.session.take()), [Status::NoResponse]);
    // What comes later is late, and says so.
    tap.send(12_000, &read_response(2, &[3, 4]));
    tap.session.poll(tap.now + 100 * MS);
    let batch = tap.session.take();
    assert_eq!(batch.transactions[0].late_response_to, Some(2));
}

#[test]
fn a_recording_that_ends_behind_a_request_says_what_it_has_shown() {
    for (silence, status) in [(300, Status::NotObserved), (1_500, Status::NotObserved), (4_000, Status::NoResponse)] {
        let mut tap = Tap::new(false);
        tap.send(0, &read_request(1, 0, 2));
        tap.send(1_200, &read_response(1, &[1, 2]));
        tap.send(30, &read_request(1, 2, 2));
        // An empty read: time has passed, and nothing came. The line has answered after 1.2 s before.
        tap.now += silence * MS;
        tap.session.feed(tap.bus, &Chunk { times: Times::Read(tap.now), ..Chunk::default() });
        assert_eq!(statuses(&tap.finish())[1], status, "{silence}");
    }
}

#[test]
fn thirty_tcp_requests_answered_after_1200_ms_are_thirty_ok() {
    for live in [false, true] {
        // One after the other, and a new one every 100 ms.
        for period in [1_300, 100] {
            let mut packets = Packets::new();
            let mut events: Vec<(i64, bool, Vec<u8>)> = Vec::new();
            for i in 0..30u16 {
                let at = i64::from(i) * period;
                events.push((at, true, ask(i, 10 * (i % 3), 2)));
                events.push((at + 1_200, false, answer(i, &[i, 7])));
            }
            events.sort_by_key(|(at, ..)| *at);
            for (at, from_client, bytes) in &events {
                packets.data(*at, 50_000, *from_client, bytes);
            }
            let (batch, _) = packets.decode(live);
            assert_eq!(statuses(&batch), [Status::Ok; 30], "live {live}, every {period} ms");
            for row in &batch.transactions {
                assert_eq!((ms(row.response_time), row.waited), (Some(1_200), None));
                assert_eq!(row.response.pdu.of(&batch.arena)[2..4], row.mbap_id.unwrap().to_be_bytes());
            }
            assert_eq!(count(&batch, Finding::NoResponse) + count(&batch, Finding::LateResponse), 0);
        }
    }
}

#[test]
fn an_answer_with_another_identifier_never_takes_a_requests_place() {
    for live in [false, true] {
        let mut packets = Packets::new();
        for i in 0..5u16 {
            let at = i64::from(i) * 200;
            packets.data(at, 50_000, true, &ask(100 + i, 10, 2));
            // Somebody else's answer, as a gateway confuses them, in front of the right one.
            packets.data(at + 10, 50_000, false, &answer(900 + 7 * i * i, &[9, 9]));
            packets.data(at + 20, 50_000, false, &answer(100 + i, &[i, 7]));
        }
        let (batch, _) = packets.decode(live);
        let rows: Vec<_> = batch.transactions.iter().map(|row| (row.status, row.mbap_id.unwrap())).collect();
        for i in 0..5u16 {
            assert!(rows.contains(&(Status::Ok, 100 + i)) && rows.contains(&(Status::Unsolicited, 900 + 7 * i * i)), "{rows:?}");
        }
        assert_eq!(rows.len(), 10);
    }
}

#[test]
fn the_answer_to_a_lost_request_is_not_that_of_the_one_before_it() {
    for live in [false, true] {
        let mut packets = Packets::new();
        packets.data(0, 50_000, true, &ask(1, 10, 2));
        packets.data(10, 50_000, false, &answer(1, &[1, 7]));
        // Its answer is lost, and so is the request after it.
        packets.data(500, 50_000, true, &ask(2, 10, 2));
        packets.lose(50_000, false, &answer(2, &[2, 7]));
        packets.lose(50_000, true, &ask(3, 20, 2));
        packets.data(1_010, 50_000, false, &answer(3, &[3, 7]));
        packets.data(1_500, 50_000, true, &ask(4, 10, 2));
        packets.data(1_510, 50_000, false, &answer(4, &[4, 7]));
        let (batch, _) = packets.decode(live);
        let mut rows: Vec<_> = batch.transactions.iter().map(|row| (row.mbap_id.unwrap(), row.status)).collect();
        rows.sort_by_key(|row| row.0);
        assert_eq!(rows, [(1, Status::Ok), (2, Status::NotObserved), (3, Status::Unsolicited), (4, Status::Ok)], "live {live}");
    }
}

#[test]
fn a_server_with_identifiers_of_its_own_is_paired_by_content_once_that_is_shown() {
    // A gateway that answers with the identifier before, as the quantities show: polls of 2 and of 5 registers in turn.
    let mut packets = Packets::new();
    for i in 1..20u16 {
        let values = vec![i; if i % 2 == 0 { 2 } else { 5 }];
        packets.data(i64::from(i) * 100, 50_000, true, &ask(i, 10, values.len() as u8));
        packets.data(i64::from(i) * 100 + 10, 50_000, false, &answer(i - 1, &values));
    }
    let (batch, _) = packets.decode(false);
    let ok: Vec<_> = batch.transactions.iter().filter(|row| row.status == Status::Ok).collect();
    assert!(ok.len() >= 18, "{:?}", statuses(&batch));
    for row in ok {
        // The registers hold the number of the request.
        assert_eq!(row.response.pdu.of(&batch.arena)[2..4], row.mbap_id.unwrap().to_be_bytes());
    }
    assert_eq!(count(&batch, Finding::ResponseLength), 0);
}

#[test]
fn one_lost_answer_holds_up_no_row_beyond_the_bound() {
    let traffic = |ends_ms: i64| {
        let mut packets = Packets::new();
        for i in 0..(ends_ms / 50) as u16 {
            let at = i64::from(i) * 50;
            packets.data(at, 50_000, true, &ask(i, 10, 2));
            if i != 3 {
                packets.data(at + 20, 50_000, false, &answer(i, &[i, 7]));
            }
        }
        packets
    };
    let (batch, early) = traffic(29_000).decode(false);
    assert_eq!(early.len(), 3, "rows are written in the order of requests");
    assert_eq!(statuses(&batch).iter().filter(|status| **status == Status::Ok).count(), 579);
    let (batch, early) = traffic(31_000).decode(false);
    assert!(early.len() > 615, "{}", early.len());
    assert_eq!((early[3].status, ms(early[3].waited)), (Status::NoResponse, Some(50)));
    assert_eq!(batch.transactions.len(), 620);
    // Live, rows come as they are complete, and the unanswered one after ten seconds.
    let numbers: Vec<u64> = traffic(12_000).decode(true).1.iter().map(|row| row.number).collect();
    assert_eq!(numbers.iter().position(|number| *number == 4), Some(202), "{numbers:?}");
}

#[test]
fn a_quiet_connection_with_an_open_request_holds_up_no_other() {
    let mut packets = Packets::new();
    packets.data(0, 50_001, true, &ask(1, 10, 2));
    packets.data(10, 50_001, false, &answer(1, &[1, 7]));
    packets.data(20, 50_001, true, &ask(2, 10, 2));
    for i in 0..800u16 {
        let at = 100 + i64::from(i) * 50;
        packets.data(at, 50_002, true, &ask(i, 10, 2));
        packets.data(at + 20, 50_002, false, &answer(i, &[i, 7]));
    }
    let (_, early) = packets.decode(false);
    assert!(early.len() > 790, "{}", early.len());
    assert_eq!(early[1].status, Status::NoResponse);
    for block in [1, 100, 4096] {
        let rows = |rows: &[Transaction]| rows.iter().map(|row| (row.number, row.status, row.waited)).collect::<Vec<_>>();
        let whole = rows(&packets.decode(false).0.transactions);
        assert_eq!(rows(&packets.decode_in_blocks(false, block).0.transactions), whole);
        assert_eq!(rows(&packets.decode_read_ahead(block).transactions), whole);
    }
}

#[test]
fn an_identifier_that_is_used_again_closes_its_request() {
    // A client that numbers nothing, one request at a time.
    for live in [false, true] {
        let mut packets = Packets::new();
        packets.data(-500, 50_000, true, &ask(0, 10, 2));
        packets.data(-490, 50_000, false, &answer(0, &[1, 2]));
        packets.data(0, 50_000, true, &ask(0, 10, 2));
        packets.data(2_000, 50_000, true, &ask(0, 20, 2));
        packets.data(2_010, 50_000, false, &answer(0, &[1, 2]));
        packets.data(2_500, 50_000, true, &mbap(0, 1, &[6, 0, 1, 0, 2]));
        packets.data(3_700, 50_000, false, &mbap(0, 1, &[6, 0, 1, 0, 2]));
        let (batch, _) = packets.decode(live);
        let rows: Vec<_> = batch.transactions.iter().map(|row| (row.status, ms(row.waited), ms(row.response_time))).collect();
        let ok = |ms| (Status::Ok, None, Some(ms));
        assert_eq!(rows, [ok(10), (Status::NoResponse, Some(2_000), None), ok(10), ok(1_200)], "live {live}");
    }
}

#[test]
fn a_request_answered_by_the_end_of_the_connection_says_so() {
    for is_reset in [false, true] {
        let mut packets = Packets::new();
        packets.data(0, 50_000, true, &ask(1, 10, 2));
        packets.data(10, 50_000, false, &answer(1, &[1, 7]));
        packets.data(100, 50_000, true, &ask(2, 10, 2));
        if is_reset {
            packets.rst(110, 50_000, false);
        } else {
            packets.fin(110, 50_000, false);
            packets.fin(111, 50_000, true);
        }
        let (batch, _) = packets.decode(false);
        assert_eq!(statuses(&batch), [Status::Ok, Status::NoResponse], "reset {is_reset}");
        let details: Vec<&str> =
            batch.findings.iter().filter(|row| row.finding == Finding::ConnectionClosed).map(|row| &row.detail[..]).collect();
        assert_eq!(details, [if is_reset { "the server reset the connection" } else { "the server closed the connection" }]);
    }
    // A capture that ends says nothing.
    let mut packets = Packets::new();
    packets.data(0, 50_000, true, &ask(1, 10, 2));
    packets.data(10, 50_000, false, &answer(1, &[1, 7]));
    packets.data(100, 50_000, true, &ask(2, 10, 2));
    assert_eq!(statuses(&packets.decode(false).0), [Status::Ok, Status::NotObserved]);
}

#[test]
fn a_tap_that_hears_one_side_only_says_so_once() {
    for (live, is_request) in [(false, true), (true, true), (false, false), (true, false)] {
        let mut tap = Tap::new(live);
        for i in 0..200u16 {
            let unit = 1 + (i % 3) as u8;
            tap.send(50, &if is_request { read_request(unit, i % 5, 2) } else { read_response(unit, &[i, 7]) });
        }
        let batch = tap.finish();
        let found: Vec<&str> =
            batch.findings.iter().filter(|row| row.finding == Finding::OneSideOnly).map(|row| &row.detail[..]).collect();
        assert_eq!(found, [format!("200 of 200 frames are {}", if is_request { "requests" } else { "responses" })]);
        // That nothing was heard of the units proves nothing.
        assert!(batch.transactions.iter().all(|row| row.unconfirmed || row.status == Status::NotObserved));
    }
}

#[test]
fn a_response_that_the_tap_missed_is_not_missing_where_the_master_asks_again_as_soon_as_ever() {
    // One poll, every 40 ms after the last one; the tap loses a response here and there.
    for live in [false, true] {
        let mut tap = Tap::new(live);
        for i in 0..40u16 {
            let response = read_response(1, &[i, 7]);
            tap.send(20, &read_request(1, 0, 2));
            let is_lost = i > 5 && i % 4 == 0;
            tap.send(if is_lost { 0 } else { 6 }, if is_lost { &[] } else { &response });
            if is_lost {
                tap.now += 6 * MS + response.len() as i64 * CHAR;
            }
        }
        let batch = tap.finish();
        let lost = statuses(&batch).iter().filter(|status| **status == Status::NotObserved).count();
        assert_eq!((lost, count(&batch, Finding::NoResponse), count(&batch, Finding::Retry)), (8, 0, 0), "live {live}");
    }
}

/// How many of so many polls of a unit that dies after 20 get no response; each comes `pause_ms` after the response, or when it
/// would have ended.
fn silent_polls_of_a_dying_unit(live: bool, polls: u16, pause_ms: i64) -> usize {
    let mut tap = Tap::new(live);
    for i in 0..polls {
        let response = read_response(1, &[i, 7]);
        tap.send(pause_ms, &read_request(1, 0, 2));
        match i {
            0..20 => tap.send(6, &response),
            _ => tap.now += 6 * MS + response.len() as i64 * CHAR,
        }
    }
    statuses(&tap.finish()).iter().filter(|status| **status == Status::NoResponse).count()
}

#[test]
fn a_unit_that_dies_in_a_slow_cycle_does_not_respond() {
    // A master that asks once a second in any case may well have given up by then.
    assert!(silent_polls_of_a_dying_unit(false, 40, 980) >= 19);
}

#[test]
fn a_unit_that_dies_in_a_fast_cycle_does_not_respond_after_a_few_requests() {
    for live in [false, true] {
        assert!(silent_polls_of_a_dying_unit(live, 60, 20) >= 30, "live {live}");
    }
}
