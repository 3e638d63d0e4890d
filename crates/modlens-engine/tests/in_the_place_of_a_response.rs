//! What stands where a response is due: a damaged one, of whatever sort, one that the tap has missed, or none.
//!
//! Expected values follow from how each line is built here.

mod wire;

use modlens_engine::records::Batch;
use modlens_engine::session::Session;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{frame, read_request, read_response, session, MS};

/// A character at 9600 baud, 8N1.
const CHAR: i64 = 1_041_667;

/// A tap that times every character.
struct Tap {
    session: Session,
    bus: usize,
    now: i64,
}

impl Tap {
    fn new() -> Self {
        let (session, bus) = session(false, Clock::Utc);
        Self { session, bus, now: 1_700_000_000_000_000_000 }
    }

    /// Bytes after so many milliseconds of silence.
    fn send(&mut self, silence_ms: i64, bytes: &[u8]) {
        let times: Vec<i64> = (1..=bytes.len() as i64).map(|at| self.now + silence_ms * MS + at * CHAR).collect();
        self.unheard(silence_ms, bytes.len());
        self.session.feed(self.bus, &Chunk { bytes, times: Times::Bytes(&times), ..Chunk::default() });
    }

    /// So many bytes that the tap misses.
    fn unheard(&mut self, silence_ms: i64, bytes: usize) {
        self.now += silence_ms * MS + bytes as i64 * CHAR;
    }

    fn finish(mut self) -> Batch {
        self.session.flush();
        self.session.take()
    }
}

fn count(batch: &Batch, status: Status) -> usize {
    batch.transactions.iter().filter(|row| row.status == status).count()
}

#[test]
fn a_damaged_exception_that_looks_like_a_request_without_its_end_has_a_bad_checksum() {
    let mut tap = Tap::new();
    let exchange = |tap: &mut Tap, i: u16| {
        tap.send(20, &read_request(18, 0, 4));
        tap.send(7, &read_response(18, &[i, 700, 3, 9]));
    };
    (0..20).for_each(|i| exchange(&mut tap, i));
    tap.send(20, &read_request(18, 900, 1));
    // The exception bit is lost, and another bit of the checksum.
    let mut exception = frame(18, &[0x83, 1]);
    (exception[1], exception[4]) = (3, exception[4] ^ 0x20);
    tap.send(7, &exception);
    (0..3).for_each(|i| exchange(&mut tap, i));
    let batch = tap.finish();
    assert_eq!((count(&batch, Status::BadResponse), count(&batch, Status::Ok)), (1, 23));
    let damaged: Vec<_> = batch.frames.iter().filter(|row| row.verdict != Verdict::Ok).collect();
    assert_eq!(damaged.len(), 1);
    assert_eq!((damaged[0].verdict, damaged[0].direction), (Verdict::BadChecksum, Direction::Response));
}

#[test]
fn what_comes_as_soon_as_a_response_is_no_damaged_request() {
    // Two units with one address: what arrives are the bits that both have set, of the second one a byte later.
    let mut tap = Tap::new();
    for i in 0..30u16 {
        tap.send(20, &read_request(9, 0, 2));
        let [one, other] = [read_response(9, &[0x1234 + 77 * i, 0x0F00]), read_response(9, &[0xA5C3 ^ (i << 5), 0x7177])];
        let both: Vec<u8> =
            (0..=one.len()).map(|at| one.get(at).unwrap_or(&0xFF) & if at > 0 { other[at - 1] } else { 0xFF }).collect();
        tap.send(6, if i % 3 == 0 { &one } else { &both });
    }
    let batch = tap.finish();
    assert_eq!((count(&batch, Status::Ok), count(&batch, Status::BadResponse)), (10, 20));
    assert_eq!(batch.transactions.len(), 30);
}

/// Bursts of the length of the response to this request, which all are damaged answers: wrong bytes follow each of these heads.
fn whole_answers(request: &[u8], registers: usize, heads: &[Vec<u8>]) {
    for (seed, head) in heads.iter().enumerate() {
        let mut tap = Tap::new();
        let unit = request[0];
        let poll = |tap: &mut Tap, value: usize| {
            tap.send(20, request);
            let values: Vec<u16> = (0..registers).map(|at| (257 * value + 31 * at) as u16).collect();
            tap.send(6, &frame(unit, &[&[request[1]], &read_response(unit, &values)[2..3 + 2 * registers]].concat()));
        };
        (0..10).for_each(|value| poll(&mut tap, value));
        tap.send(20, request);
        let mut bytes = head.clone();
        bytes.extend((head.len()..5 + 2 * registers).map(|at| (0x59 + 0x35 * at + 0x4D * seed) as u8));
        tap.send(6, &bytes);
        (0..5).for_each(|value| poll(&mut tap, value));
        let batch = tap.finish();
        let damaged: Vec<_> = batch.frames.iter().filter(|row| row.verdict != Verdict::Ok).collect();
        let lengths: Vec<_> = damaged.iter().map(|row| row.wire.of(&batch.arena).len()).collect();
        assert_eq!(lengths, [bytes.len()], "{bytes:02x?}");
        assert_eq!((damaged[0].verdict, damaged[0].direction), (Verdict::BadChecksum, Direction::Response), "{bytes:02x?}");
        assert_eq!((count(&batch, Status::BadResponse), count(&batch, Status::Ok)), (1, 15), "{bytes:02x?}");
    }
}

#[test]
fn as_many_bytes_as_are_due_between_two_silences_are_one_response_whatever_they_look_like() {
    // With one byte of the count wrong, the head is that of the poll; by another one, of an exception and strays.
    for (unit, code, address, quantity) in [(0x13, 3, 0x0B3E_u16, 5), (0x69, 3, 100, 2), (0x11, 4, 62, 2), (9, 4, 0x0AEE, 4)] {
        let [high, low] = address.to_be_bytes();
        let request = frame(unit, &[code, high, low, 0, quantity]);
        let mut heads = vec![vec![unit, code | 0x80, 2 * quantity, 0xA8, 0xB4]];
        heads.extend((0..40).map(|other: u8| vec![unit, code, high, low ^ other.wrapping_mul(7), other]));
        heads.extend((0..8).map(|bit| vec![unit, code, (2 * quantity) ^ 1 << bit]));
        heads.extend((0..8).map(|bit| vec![unit ^ 1 << bit, code, 2 * quantity, 0]));
        whole_answers(&request, quantity.into(), &heads);
    }
}

/// Polls of one register every 70 ms, of which those of `is_heard` have a response that the tap hears.
fn cycle(polls: usize, is_heard: impl Fn(usize) -> bool) -> Batch {
    let mut tap = Tap::new();
    for at in 0..polls {
        let response = read_response(1, &[at as u16]);
        tap.send(46, &read_request(1, 0, 1));
        if is_heard(at) {
            tap.send(8, &response);
        } else {
            tap.unheard(8, response.len());
        }
    }
    tap.finish()
}

#[test]
fn a_master_that_never_waits_longer_has_its_responses_whatever_the_tap_misses() {
    let batch = cycle(100, |at| at < 4 || at % 3 != 0);
    assert_eq!(count(&batch, Status::NoResponse), 0);
    assert_eq!(count(&batch, Status::Ok), 100 - 32);
    assert!(!batch.findings.iter().any(|row| row.finding == Finding::Retry));
}

#[test]
fn a_tap_that_has_heard_all_responses_so_far_has_missed_none() {
    let batch = cycle(400, |at| at != 200);
    assert_eq!((count(&batch, Status::NoResponse), count(&batch, Status::NotObserved)), (1, 0));
    assert!(batch.findings.iter().any(|row| row.finding == Finding::Retry));
}

#[test]
fn the_same_wait_as_after_a_response_shows_no_timeout() {
    // Masters of a fixed cycle, and one that asks again so long after each response, heard or not; rows of up to five misses.
    for cycle_ms in [None, Some(60), Some(70), Some(80), Some(100), Some(120), Some(150), Some(190)] {
        for seed in 1..6_usize {
            let is_missed = |at: usize| match at {
                0..5 => false,
                58..71 => (61..66).contains(&at),
                _ => (at * (5 + seed) * 7919 / 13) % 10 < 3,
            };
            let mut tap = Tap::new();
            let mut due = tap.now;
            for at in 0..100 {
                due += cycle_ms.unwrap_or_default() * MS;
                let silence = cycle_ms.map_or(18 + (at * seed % 5) as i64, |_| (due - tap.now) / MS);
                tap.send(silence, &read_request(7, 40, 4));
                let (delay, response) = (4 + (at * 3 % 5) as i64, read_response(7, &[at as u16, 700, 3, 9]));
                if is_missed(at) {
                    tap.unheard(delay, response.len());
                } else {
                    tap.send(delay, &response);
                }
            }
            let missed = (0..100).filter(|&at| is_missed(at)).count();
            let batch = tap.finish();
            let found = [Status::Ok, Status::NotObserved, Status::NoResponse].map(|status| count(&batch, status));
            assert!(missed > 20 && found == [100 - missed, missed, 0], "{cycle_ms:?} {seed}: {found:?}, missed {missed}");
        }
    }
}

#[test]
fn another_wait_than_after_a_response_is_a_timeout() {
    // As long as after a response, but long enough for one: a master whose cycle is slower than its timeout may have had none.
    for (pause_ms, timeout_ms) in [(10, 60), (10, 90), (20, 250), (280, 300)] {
        let mut tap = Tap::new();
        let mut silence = pause_ms;
        for at in 0..60 {
            tap.send(silence, &read_request(7, 40, 4));
            silence = timeout_ms;
            if at % 4 != 3 {
                tap.send(6, &read_response(7, &[at, 700, 3, 9]));
                silence = pause_ms;
            }
        }
        let batch = tap.finish();
        let found = [Status::Ok, Status::NoResponse, Status::NotObserved].map(|status| count(&batch, status));
        // Nothing follows the last request.
        assert_eq!((found[0], found[1] + found[2]), (45, 15));
        assert!(found[1] >= 14, "{timeout_ms}: {found:?}");
    }
}

/// Each of two requests of equal length is answered only after both were sent. The bytes come in blocks of this many.
fn late_by_one(block: usize) -> Batch {
    let bytes: Vec<u8> = (0..20u16)
        .flat_map(|at| {
            let polls = [read_request(1, 10, 2), read_response(1, &[at, 5])];
            let late =
                [read_request(1, 0, 2), read_request(1, 20, 2), read_response(1, &[700, at]), read_response(1, &[at, 800])];
            polls.into_iter().cycle().take(6).chain(late).flatten().collect::<Vec<u8>>()
        })
        .collect();
    let (mut session, bus) = session(false, Clock::None);
    bytes.chunks(block).for_each(|bytes| session.feed(bus, &Chunk { bytes, ..Chunk::default() }));
    session.flush();
    session.take()
}

#[test]
fn of_two_late_responses_the_first_belongs_to_the_first_request() {
    for block in [1, 5, 13, 64, 10_000] {
        let batch = late_by_one(block);
        let late: Vec<_> = batch.all_transactions().iter().filter(|row| row.status == Status::Unsolicited).collect();
        assert_eq!(late.len(), 20, "in blocks of {block}");
        for row in late {
            let all = batch.all_transactions();
            let of = |number: u64| all.iter().find(|row| row.number == number).unwrap();
            let first = of(row.late_response_to.expect("a late response"));
            assert_eq!(first.request.pdu.of(&batch.arena)[..3], [3, 0, 0]);
            assert_eq!(row.response.pdu.of(&batch.arena)[2..4], 700u16.to_be_bytes());
            assert_eq!(of(first.number + 1).response.pdu.of(&batch.arena)[4..6], 800u16.to_be_bytes());
        }
        assert_eq!(batch.findings.iter().filter(|row| row.finding == Finding::LateResponse).count(), 20);
    }
}
