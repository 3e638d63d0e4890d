//! Retries: of requests that arrived damaged, and of requests whose response did.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{read_request, read_response, session, MS};

/// A character at 19200 baud, 8E1.
const CHAR: i64 = 572_917;

/// The master's timeout: from the end of a request to its retry.
const TIMEOUT: i64 = 250 * MS;

/// Six rounds of three transactions, the third of which needs a retry, so that the master's timeout is known.
fn polls() -> Vec<(i64, Vec<u8>)> {
    let exchange = |unit: u8| [(20 * MS, read_request(unit, 7, 2)), (8 * MS, read_response(unit, &[0x1234, 0x5678]))];
    let retried = || [(20 * MS, read_request(3, 7, 1)), (TIMEOUT, read_request(3, 7, 1)), (8 * MS, read_response(3, &[9]))];
    (0..6).flat_map(|_| [&exchange(1)[..], &exchange(2), &retried()].concat()).collect()
}

/// The rows of these bursts with polls before and after them, in reads of one byte. A burst is a pause and bytes.
fn decode(bursts: &[(i64, Vec<u8>)], live: bool) -> Batch {
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

/// For each answered request of these bytes: the status of the transaction that it is reported to repeat, if any.
fn retries<'a>(batch: &'a Batch, of: &'a [u8]) -> Vec<Option<Status>> {
    let rows = batch.transactions.iter().filter(|row| row.request.wire.of(&batch.arena) == of && row.status == Status::Ok);
    let before = |txn: u64| batch.transactions.iter().find(|row| row.number == txn).map(|row| row.status);
    rows.map(|row| row.retry_of.and_then(before)).collect()
}

#[test]
fn the_same_request_after_a_damaged_one_is_its_retry() {
    let kinds_of_damage: [fn(&mut Vec<u8>); 5] = [
        |bytes| bytes[3] ^= 0x41,
        |bytes| bytes[1] ^= 0x40,
        |bytes| bytes[4..].copy_from_slice(&[0, 0, 0x02, 0]),
        |bytes| bytes.truncate(5),
        |bytes| drop(bytes.splice(6.., [0xFE])),
    ];
    for (index, damage) in kinds_of_damage.iter().enumerate() {
        let request = read_request(2, 0x0B3C, 2);
        let mut damaged = request.clone();
        damage(&mut damaged);
        let bursts = [(20 * MS, damaged), (TIMEOUT, request.clone()), (8 * MS, read_response(2, &[5, 6]))];
        // With a wrong function code, a live tap cannot recognise the request before its retry has come.
        for live in [false, true].into_iter().filter(|live| !live || index != 1) {
            let batch = decode(&bursts, live);
            assert_eq!(retries(&batch, &request), [Some(Status::BadRequest)], "damage {index}, live: {live}");
        }
    }
}

#[test]
fn another_request_after_a_damaged_one_is_not_a_retry() {
    let mut damaged = read_request(2, 0x0B3C, 2);
    damaged[3] ^= 0x41;
    let request = read_request(2, 0x0B50, 2);
    let batch = decode(&[(20 * MS, damaged), (TIMEOUT, request.clone()), (8 * MS, read_response(2, &[5, 6]))], false);
    assert_eq!(retries(&batch, &request), [None]);
}

#[test]
fn the_rest_of_a_damaged_response_is_paired_with_its_request() {
    // Cut short at every length, and with a flipped bit in both unit and function code, so that neither is known.
    let (request, response) = (read_request(2, 0x0B3C, 2), read_response(2, &[0x4711, 0x0815]));
    let mut wrong_header = response.clone();
    (wrong_header[0], wrong_header[1]) = (wrong_header[0] ^ 0x80, wrong_header[1] ^ 0x04);
    for rest in (1..response.len()).map(|length| response[..length].to_vec()).chain([wrong_header]) {
        let bursts = [(20 * MS, request.clone()), (8 * MS, rest.clone()), (TIMEOUT, request.clone()), (8 * MS, response.clone())];
        let batch = decode(&bursts, false);
        assert_eq!(retries(&batch, &request), [Some(Status::BadResponse)], "{rest:02x?}");
        let damaged = batch.frames.iter().filter(|row| matches!(row.verdict, Verdict::Incomplete | Verdict::BadChecksum));
        assert_eq!(damaged.map(|row| row.wire.length as usize).collect::<Vec<_>>(), [rest.len()]);
    }
}

#[test]
fn stray_bytes_behind_a_request_are_not_its_response() {
    let request = read_request(2, 0x0B3C, 2);
    for strays in [&[0u8][..], &[0x55], &[0xFF, 0xFF]] {
        let bursts = [
            (20 * MS, request.clone()),
            (8 * MS, strays.to_vec()),
            (TIMEOUT, request.clone()),
            (8 * MS, read_response(2, &[5, 6])),
        ];
        assert_eq!(retries(&decode(&bursts, false), &request), [Some(Status::NoResponse)], "{strays:02x?}");
    }
}

#[test]
fn live_a_truncated_response_is_lost_by_the_tap_where_the_master_does_not_retry() {
    let (request, short) = (read_request(1, 7, 2), read_response(1, &[0x1234, 0x5678])[..6].to_vec());
    let bursts = |is_retried: bool| -> Vec<(i64, Vec<u8>)> {
        let behind = if is_retried { (TIMEOUT, request.clone()) } else { (130 * MS, read_request(2, 7, 2)) };
        let response = read_response(if is_retried { 1 } else { 2 }, &[1, 2]);
        (0..5)
            .flat_map(|_| [(20 * MS, request.clone()), (8 * MS, short.clone()), behind.clone(), (8 * MS, response.clone())])
            .collect()
    };
    let lost_bytes = |is_retried| {
        let batch = decode(&bursts(is_retried), true);
        batch.findings.iter().filter(|row| row.finding == Finding::LostBytes).count()
    };
    assert_eq!(lost_bytes(true), 0);
    assert_eq!(lost_bytes(false), 3, "all but the first two, which have to show that the master does not retry");
}

#[test]
fn a_transaction_of_the_second_master_has_the_finding_in_its_own_row() {
    let overlap = [
        (20 * MS, read_request(1, 0, 1)),
        (8 * MS, read_request(2, 0, 2)),
        (8 * MS, read_response(1, &[1])),
        (12 * MS, read_response(2, &[1, 2])),
    ];
    let batch = decode(&vec![overlap; 3].concat(), false);
    let rows = batch.transactions.iter().filter(|row| row.findings.of(&batch.codes).contains(&Finding::TwoMasters));
    let units: Vec<u8> = rows.filter_map(|row| row.request.wire.of(&batch.arena).first().copied()).collect();
    // One overlap proves nothing, so that of the first one the finding stands only in the table of findings.
    assert_eq!(units, [2, 2]);
    assert_eq!(batch.findings.iter().filter(|row| row.finding == Finding::TwoMasters).count(), 3);
}

/// Two masters ask two units without a clock; the second request arrives truncated first, then whole, while the first one
/// is still open. The truncated request is closed, not the one that it overlaps: each response keeps its request.
#[test]
fn a_truncated_request_takes_no_response_from_the_one_that_it_overlaps() {
    let rounds = |first: u16| {
        (0..40).flat_map(move |i| {
            let exchange = |unit: u8, values: &[u16]| [read_request(unit, 107, 3), read_response(unit, values)].concat();
            [exchange(1, &[first + i * 77, 555 + i, 4242]), exchange(2, &[first + i * 79, 655 + i, 4242])].concat()
        })
    };
    for first_responds in [true, false] {
        let mut bytes: Vec<u8> = rounds(1000).collect();
        bytes.extend(read_request(1, 107, 3));
        bytes.extend(&read_request(2, 107, 3)[..5]);
        bytes.extend(read_request(2, 107, 3));
        if first_responds {
            bytes.extend(read_response(1, &[900, 901, 4242]));
        }
        bytes.extend(read_response(2, &[800, 801, 4242]));
        bytes.extend(rounds(5000));
        let (mut session, bus) = session(false, Clock::None);
        session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
        session.flush();
        let batch = session.take();
        let rows: Vec<(u8, Status)> = batch.transactions[80..83].iter().map(|row| (row.unit, row.status)).collect();
        let of_first = if first_responds { Status::Ok } else { rows[0].1 };
        assert_eq!(rows, [(1, of_first), (2, Status::BadRequest), (2, Status::Ok)]);
        assert_ne!(of_first, Status::BadResponse);
        assert!(batch.transactions.iter().all(|row| row.status != Status::Unsolicited));
    }
}
