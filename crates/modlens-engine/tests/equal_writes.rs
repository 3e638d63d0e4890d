//! Writes with the same content again and again: heartbeats, watchdogs, set-points. The response has the same bytes as the
//! request, so what the line shows of its responses and its times has to tell them apart; where it does not, the rows say so.
//!
//! Expected values follow from how each line is built here.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::direction::Direction::{self, Request, Response};
use modlens_protocol::finding::Finding;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{frame, read_request, read_response, session, session_at, MS};

/// A character at 19200 baud, 8E1.
const CHAR: i64 = 572_917;

/// One write of each function that its response repeats (application protocol, 6.5, 6.6, 6.8, 6.16).
fn writes() -> [Vec<u8>; 4] {
    [&[5, 0, 0x10, 0xFF, 0][..], &[6, 0, 0x10, 0x12, 0x34], &[8, 0, 0, 0xA5, 0x37], &[22, 0, 4, 0, 0xF2, 0, 0x25]]
        .map(|pdu| frame(7, pdu))
}

/// The rows of these bytes without times.
fn untimed(frames: &[Vec<u8>]) -> Batch {
    let (mut session, bus) = session(false, Clock::None);
    session.feed(bus, &Chunk { bytes: &frames.concat(), ..Chunk::default() });
    session.flush();
    session.take()
}

/// The rows of bursts, each a pause and bytes, in reads of one byte with exact times.
fn exact(live: bool, bursts: &[(i64, Vec<u8>)]) -> Batch {
    let (mut session, bus) = session(live, Clock::Utc);
    let mut now = 1_700_000_000_000_000_000;
    for (pause, bytes) in bursts {
        if live {
            (1..pause / (5 * MS)).for_each(|tick| session.poll(now + tick * 5 * MS));
        }
        now += pause;
        for byte in bytes {
            now += CHAR;
            session.feed(bus, &Chunk { bytes: &[*byte], times: Times::Read(now), ..Chunk::default() });
        }
    }
    session.poll(now + 5_000 * MS);
    session.flush();
    session.take()
}

/// The same through an adapter that delivers what has come every 16 ms.
fn through_latency_timer(bursts: &[(i64, Vec<u8>)]) -> Batch {
    let (mut session, bus) = session(false, Clock::Utc);
    let (mut now, mut due, mut waiting) = (1_700_000_000_000_000_000, 1_700_000_000_000_000_000, Vec::new());
    for (pause, bytes) in bursts {
        now += pause;
        for byte in bytes {
            now += CHAR;
            while due < now {
                if !waiting.is_empty() {
                    session.feed(bus, &Chunk { bytes: &waiting, times: Times::Read(due), ..Chunk::default() });
                    waiting.clear();
                }
                due += 16 * MS;
            }
            waiting.push(*byte);
        }
    }
    session.feed(bus, &Chunk { bytes: &waiting, times: Times::Read(due), ..Chunk::default() });
    session.flush();
    session.take()
}

/// So many exchanges of this write: the pause before the request, then its response after 6 ms.
fn exchanges(write: &[u8], pause: i64, count: usize) -> Vec<(i64, Vec<u8>)> {
    (0..count).flat_map(|_| [(pause, write.to_vec()), (6 * MS, write.to_vec())]).collect()
}

fn count(batch: &Batch, status: Status) -> usize {
    batch.transactions.iter().filter(|row| row.status == status).count()
}

fn has(batch: &Batch, finding: Finding) -> bool {
    batch.findings.iter().any(|row| row.finding == finding)
}

fn directions(batch: &Batch) -> Vec<Direction> {
    batch.frames.iter().map(|row| row.direction).collect()
}

/// The rows of so many exchanges and nothing else.
fn expect_exchanges(batch: &Batch, exchanges: usize, what: &str) {
    assert_eq!(directions(batch), [Request, Response].repeat(exchanges), "{what}");
    assert_eq!((count(batch, Status::Ok), batch.transactions.len()), (exchanges, exchanges), "{what}");
    assert!(!has(batch, Finding::Retry) && !has(batch, Finding::LocalEcho), "{what}");
}

#[test]
fn answered_writes_without_a_clock_are_exchanges_and_not_certain() {
    for write in writes() {
        let batch = untimed(&vec![write.clone(); 80]);
        expect_exchanges(&batch, 40, &format!("function {}", write[1]));
        // A single response that is missing turns all directions after it, so none of them is said to be certain.
        assert!(batch.frames[1..].iter().all(|row| row.confidence < 10), "function {}", write[1]);
    }
}

#[test]
fn answered_writes_with_exact_times_are_exchanges() {
    for write in writes() {
        for pause in [25 * MS, 100 * MS, 1000 * MS] {
            for live in [false, true] {
                let batch = exact(live, &exchanges(&write, pause, 40));
                expect_exchanges(&batch, 40, &format!("function {}, {pause} ns, live: {live}", write[1]));
            }
        }
    }
}

#[test]
fn answered_writes_through_a_latency_timer_are_exchanges() {
    for write in writes() {
        for pause in [25 * MS, 100 * MS, 1000 * MS] {
            let batch = through_latency_timer(&exchanges(&write, pause, 40));
            expect_exchanges(&batch, 40, &format!("function {}, {pause} ns", write[1]));
        }
    }
}

#[test]
fn answered_writes_with_a_local_echo_are_exchanges() {
    for write in writes() {
        for pause in [25 * MS, 100 * MS, 1000 * MS] {
            let cycle = [(pause, [&write[..], &write].concat()), (6 * MS, write.clone())];
            for live in [false, true] {
                let batch = exact(live, &vec![cycle.clone(); 40].concat());
                let what = format!("function {}, {pause} ns, live: {live}", write[1]);
                // The first copy may be undecided: it is the first thing ever heard that looks like an echo.
                assert_eq!(directions(&batch)[3..], [Request, Request, Response].repeat(39), "{what}");
                assert_eq!((count(&batch, Status::Ok), batch.transactions.len()), (40, 40), "{what}");
                assert!(batch.findings.iter().filter(|row| row.finding == Finding::LocalEcho).count() >= 39, "{what}");
            }
        }
    }
}

#[test]
fn an_echo_comes_sooner_than_two_frames_follow_each_other() {
    // The echo begins up to two characters later; the unit waits for more than 3.5, and the master for longer.
    for (line, char_ns) in [("2400-8E1", 4_583_333), ("4800-8N1", 2_083_333), ("9600-8E1", 1_145_833), ("19200-8N1", 520_833)] {
        for (seed, write) in writes().iter().enumerate() {
            for glue in [0, char_ns, 2 * char_ns] {
                let (mut session, bus) = session_at(line, false, Clock::Utc);
                let mut now = 1_700_000_000_000_000_000;
                let waits = |at: i64| [90 * MS + (at * 7 + seed as i64) % 40 * MS, glue, 4 * char_ns + (4 + at % 5) * MS];
                for pause in (0..40).flat_map(waits) {
                    now += pause;
                    let times: Vec<i64> = (1..=write.len() as i64).map(|at| now + at * char_ns).collect();
                    now += write.len() as i64 * char_ns;
                    session.feed(bus, &Chunk { bytes: write, times: Times::Bytes(&times), ..Chunk::default() });
                }
                session.flush();
                let batch = session.take();
                let what = format!("{line}, {glue} ns, {write:02x?}");
                assert_eq!(directions(&batch), [Request, Request, Response].repeat(40), "{what}");
                assert_eq!((batch.transactions.len(), count(&batch, Status::Ok)), (40, 40), "{what}");
                assert_eq!(batch.findings.iter().filter(|row| row.finding == Finding::LocalEcho).count(), 40, "{what}");
            }
        }
    }
}

#[test]
fn two_equal_writes_in_succession_among_polls_are_two_exchanges() {
    let write = writes()[1].clone();
    let polls: Vec<Vec<u8>> = (0..20).flat_map(|at| [read_request(1 + at, 10, 1), read_response(1 + at, &[at.into()])]).collect();
    let cycle = [&vec![write; 4][..], &polls].concat();
    let batch = untimed(&vec![cycle; 29].concat());
    assert_eq!((count(&batch, Status::Ok), batch.transactions.len()), (22 * 29, 22 * 29));
}

#[test]
fn a_unit_that_dies_half_way_has_no_response_from_then_on() {
    for write in writes() {
        for live in [false, true] {
            let dead = (0..40).map(|at| (if at == 0 { 100 * MS } else { 250 * MS }, write.clone()));
            let bursts: Vec<(i64, Vec<u8>)> = exchanges(&write, 100 * MS, 40).into_iter().chain(dead).collect();
            let batch = exact(live, &bursts);
            let what = format!("function {}, live: {live}", write[1]);
            assert_eq!(count(&batch, Status::Ok), 40, "{what}");
            // Of the last one a recording does not show whether there was a response.
            assert!(count(&batch, Status::NoResponse) >= 39, "{what}");
            assert_eq!(batch.transactions.len(), 80, "{what}");
        }
    }
}

#[test]
fn a_heartbeat_to_nobody_is_never_answered() {
    for write in writes() {
        for live in [false, true] {
            let batch = exact(live, &vec![(1000 * MS, write.clone()); 40]);
            assert_eq!(count(&batch, Status::Ok), 0, "function {}, live: {live}", write[1]);
            assert!(count(&batch, Status::NoResponse) >= 39, "function {}, live: {live}", write[1]);
        }
    }
}

#[test]
fn an_exchange_does_not_span_that_of_another_unit() {
    // Unit 7 is dead; unit 2 is polled between the requests to it.
    for write in writes() {
        let cycle = [write.clone(), read_request(2, 0, 1), read_response(2, &[9])];
        let batch = untimed(&vec![cycle; 40].concat());
        assert_eq!(directions(&batch), [Request, Request, Response].repeat(40), "function {}", write[1]);
        let of_dead = || batch.transactions.iter().filter(|row| row.unit == 7);
        assert_eq!(of_dead().count(), 40);
        assert!(of_dead().all(|row| row.status != Status::Ok), "function {}", write[1]);
    }
}

#[test]
fn two_units_get_the_same_write_in_turn_and_one_of_them_is_dead() {
    let write = |unit: u8, value: u16| frame(unit, &[6, 0x20, 1, (value >> 8) as u8, value as u8]);
    let cycle = |value: u16| [write(3, value), write(3, value), write(7, value)];
    let batch = untimed(&(0..30).flat_map(|at| cycle(5000 + 10 * (at / 5))).collect::<Vec<_>>());
    assert_eq!(directions(&batch), [Request, Response, Request].repeat(30));
    let answered = batch.transactions.iter().filter(|row| row.status == Status::Ok);
    assert_eq!(answered.map(|row| row.unit).collect::<Vec<_>>(), [3; 30]);
}

#[test]
fn writes_of_other_values_are_no_sure_responses_to_each_other() {
    let values = [1, 0, 7, 3, 9, 2];
    let writes: Vec<Vec<u8>> = values.iter().map(|&value| frame(1, &[6, 0, 4, 0, value])).collect();
    let batch = untimed(&writes);
    assert!(batch.transactions.iter().all(|row| row.status != Status::Ok || row.confidence <= 5));
}

#[test]
fn a_request_behind_a_damaged_response_is_no_local_echo() {
    // The same poll again and again; of four responses, three arrive damaged.
    let (request, response) = (read_request(3, 7, 2), read_response(3, &[0x1234, 0x5678]));
    let frames: Vec<Vec<u8>> = (0..60)
        .flat_map(|at| {
            let mut answer = response.clone();
            answer[4] ^= if at % 4 == 0 { 0 } else { 0x21 };
            [request.clone(), answer]
        })
        .collect();
    let bursts: Vec<(i64, Vec<u8>)> = frames.iter().map(|bytes| (10 * MS, bytes.clone())).collect();
    for batch in [untimed(&frames), exact(false, &bursts), exact(true, &bursts)] {
        assert!(!has(&batch, Finding::LocalEcho));
        assert_eq!((batch.transactions.len(), count(&batch, Status::Ok)), (60, 15));
        assert_eq!(count(&batch, Status::BadResponse), 45);
    }
}
