//! What a master asks again for, and what was left of what it had asked before.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{answer, read, session, MS};

/// A character at 19200 baud, 8E1.
const CHAR: i64 = 572_917;

/// Time from a request to the next one, if no answer comes.
const TIMEOUT: i64 = 250 * MS;

/// Six exchanges, of which every third one needs a second attempt: the master's time-out is known.
fn polls() -> Vec<(i64, Vec<u8>)> {
    let exchange = |unit: u8| [(20 * MS, read(unit, 7, 2)), (8 * MS, answer(unit, &[0x1234, 0x5678]))];
    let lost = || [(20 * MS, read(3, 7, 1)), (TIMEOUT, read(3, 7, 1)), (8 * MS, answer(3, &[9]))];
    (0..6).flat_map(|_| [&exchange(1)[..], &exchange(2), &lost()].concat()).collect()
}

/// The traffic with these bursts behind the polls, and once more the polls; one byte a read.
fn heard(bursts: &[(i64, Vec<u8>)], live: bool) -> Batch {
    let (mut session, bus) = session(live, Clock::Utc);
    let mut now = 1_700_000_000_000_000_000;
    for (pause, bytes) in [&polls()[..], bursts, &polls()].concat() {
        now += pause;
        for byte in bytes {
            now += CHAR;
            session.feed(bus, &Chunk { bytes: &[byte], times: Times::Read(now), ..Chunk::default() });
        }
    }
    session.flush();
    session.take()
}

/// The requests of these bytes that are said to be sent again, with what they repeat.
fn retries<'a>(batch: &'a Batch, of: &'a [u8]) -> Vec<Option<Status>> {
    let rows = batch.transactions.iter().filter(|row| row.request.wire.of(&batch.arena) == of && row.status == Status::Ok);
    let before = |txn: u64| batch.transactions.iter().find(|row| row.number == txn).map(|row| row.status);
    rows.map(|row| row.retry_of.and_then(before)).collect()
}

#[test]
fn a_request_again_after_a_damaged_one_is_a_retry() {
    let spoil: [fn(&mut Vec<u8>); 5] = [
        |bytes| bytes[3] ^= 0x41,
        |bytes| bytes[1] ^= 0x40,
        |bytes| bytes[4..].copy_from_slice(&[0, 0, 0x02, 0]),
        |bytes| bytes.truncate(5),
        |bytes| drop(bytes.splice(6.., [0xFE])),
    ];
    for (how, spoil) in spoil.iter().enumerate() {
        let ask = read(2, 0x0B3C, 2);
        let mut damaged = ask.clone();
        spoil(&mut damaged);
        let bursts = [(20 * MS, damaged), (TIMEOUT, ask.clone()), (8 * MS, answer(2, &[5, 6]))];
        // Before it comes again, nobody can know what function it had.
        for live in [false, true].into_iter().filter(|live| !live || how != 1) {
            let batch = heard(&bursts, live);
            assert_eq!(retries(&batch, &ask), [Some(Status::BadRequest)], "{how}, live: {live}");
        }
    }
}

#[test]
fn another_request_after_a_damaged_one_is_none() {
    let mut damaged = read(2, 0x0B3C, 2);
    damaged[3] ^= 0x41;
    let ask = read(2, 0x0B50, 2);
    let batch = heard(&[(20 * MS, damaged), (TIMEOUT, ask.clone()), (8 * MS, answer(2, &[5, 6]))], false);
    assert_eq!(retries(&batch, &ask), [None]);
}

#[test]
fn whatever_is_left_of_an_answer_was_one() {
    // Cut short anywhere, and with a flipped bit in unit and function each, so that neither is known.
    let (ask, tell) = (read(2, 0x0B3C, 2), answer(2, &[0x4711, 0x0815]));
    let mut strange = tell.clone();
    (strange[0], strange[1]) = (strange[0] ^ 0x80, strange[1] ^ 0x04);
    for rest in (1..tell.len()).map(|length| tell[..length].to_vec()).chain([strange]) {
        let bursts = [(20 * MS, ask.clone()), (8 * MS, rest.clone()), (TIMEOUT, ask.clone()), (8 * MS, tell.clone())];
        let batch = heard(&bursts, false);
        assert_eq!(retries(&batch, &ask), [Some(Status::BadResponse)], "{rest:02x?}");
        let damaged = batch.frames.iter().filter(|row| matches!(row.verdict, Verdict::Incomplete | Verdict::BadChecksum));
        assert_eq!(damaged.map(|row| row.wire.length as usize).collect::<Vec<_>>(), [rest.len()]);
    }
}

#[test]
fn strays_behind_a_request_are_no_answer() {
    let ask = read(2, 0x0B3C, 2);
    for strays in [&[0u8][..], &[0x55], &[0xFF, 0xFF]] {
        let bursts = [(20 * MS, ask.clone()), (8 * MS, strays.to_vec()), (TIMEOUT, ask.clone()), (8 * MS, answer(2, &[5, 6]))];
        assert_eq!(retries(&heard(&bursts, false), &ask), [Some(Status::NoResponse)], "{strays:02x?}");
    }
}

#[test]
fn live_an_answer_without_its_end_is_the_taps_loss_where_masters_do_not_ask_again() {
    let (ask, short) = (read(1, 7, 2), answer(1, &[0x1234, 0x5678])[..6].to_vec());
    let bursts = |again: bool| -> Vec<(i64, Vec<u8>)> {
        let behind = if again { (TIMEOUT, ask.clone()) } else { (130 * MS, read(2, 7, 2)) };
        let tell = answer(if again { 1 } else { 2 }, &[1, 2]);
        (0..5).flat_map(|_| [(20 * MS, ask.clone()), (8 * MS, short.clone()), behind.clone(), (8 * MS, tell.clone())]).collect()
    };
    let lost = |again| {
        let batch = heard(&bursts(again), true);
        batch.findings.iter().filter(|row| row.finding == Finding::LostBytes).count()
    };
    assert_eq!(lost(true), 0);
    assert_eq!(lost(false), 3, "all but the two that have to show it");
}

#[test]
fn the_second_of_two_masters_exchanges_says_so_in_its_own_row() {
    let meeting = [(20 * MS, read(1, 0, 1)), (8 * MS, read(2, 0, 2)), (8 * MS, answer(1, &[1])), (12 * MS, answer(2, &[1, 2]))];
    let batch = heard(&vec![meeting; 3].concat(), false);
    let rows = batch.transactions.iter().filter(|row| row.findings.of(&batch.codes).contains(&Finding::TwoMasters));
    let units: Vec<u8> = rows.filter_map(|row| row.request.wire.of(&batch.arena).first().copied()).collect();
    // Of the first meeting, which nobody was sure of yet, the findings table tells.
    assert_eq!(units, [2, 2]);
    assert_eq!(batch.findings.iter().filter(|row| row.finding == Finding::TwoMasters).count(), 3);
}
