//! Connections in a packet a message: exchanges that are matched as they come, and compact ones, give the rows, findings and
//! statistics of the general way.

use std::sync::Arc;

use arrow_array::RecordBatch;
use etherparse::PacketBuilder;
use modlens_arrow::batch::{all_columns, BatchBuilder};
use modlens_engine::records::Batch;
use modlens_engine::session::{CaptureOptions, Session, WantedTables};
use modlens_protocol::functions::Functions;
use modlens_readers::pcap::Ports;
use modlens_tables::columns::{Table, TableKind};
use proptest::prelude::*;

/// Less than any packet has, so that each is decided when it comes: a request takes the slow path, without its response.
const SMALL_BLOCK: usize = 60;

/// What becomes of a request.
#[derive(Clone, Copy, Debug)]
enum Outcome {
    Answer,
    /// It is refused, with this code.
    Exception(u8),
    /// An exception comes that is of another function.
    ExceptionOfAnother,
    /// A byte follows the exception.
    LongException,
    Silence,
    /// The answer has the identifier of another request.
    WrongIdentifier,
    /// The answer comes in two packets.
    Split,
    /// The next request comes before the answer does.
    Pipelined,
}

#[derive(Clone, Debug)]
struct Poll {
    connection: u8,
    function: u8,
    address: u16,
    outcome: Outcome,
    /// Microseconds before the request, and from there to the answer.
    times: [u64; 2],
}

fn polls() -> impl Strategy<Value = Vec<Poll>> {
    use Outcome::{Answer, Exception, ExceptionOfAnother, LongException, Pipelined, Silence, Split, WrongIdentifier};
    let outcome = prop_oneof![
        20 => Just(Answer),
        2 => prop::sample::select(vec![1u8, 2, 4, 11, 0, 12, 0x40]).prop_map(Exception),
        1 => prop::sample::select(vec![ExceptionOfAnother, LongException, Silence, Silence, WrongIdentifier, Split, Pipelined]),
    ];
    let pause = prop_oneof![8 => 1u64..30_000, 1 => Just(0), 1 => 900_000u64..2_000_000, 1 => Just(31_000_000)];
    let connection = prop_oneof![2 => Just(0u8), 1 => 0u8..3];
    let function = prop::sample::select(vec![1u8, 3, 3, 4, 6, 16, 23]);
    // So that a request is often asked again right after one without an answer.
    let address = prop_oneof![2 => Just(0u16), 1 => 0u16..4];
    let poll = (connection, function, address, outcome, (pause, 0u64..40_000)).prop_map(
        |(connection, function, address, outcome, times)| Poll { connection, function, address, outcome, times: times.into() },
    );
    prop::collection::vec(poll, 1..160)
}

fn message(id: u16, pdu: &[u8]) -> Vec<u8> {
    let mut out = id.to_be_bytes().to_vec();
    out.extend([0, 0, 0, 1 + pdu.len() as u8, 7]);
    out.extend(pdu);
    out
}

/// The PDUs of a request and of its answer.
fn pdus(function: u8, address: u16) -> [Vec<u8>; 2] {
    let [high, low] = address.to_be_bytes();
    let head = |more: &[u8]| [&[function, high, low], more].concat();
    match function {
        1 => [head(&[0, 9]), vec![1, 2, low, 1]],
        6 => [head(&[1, 2]), head(&[1, 2])],
        16 => [head(&[0, 2, 4, 1, 2, 3, low]), head(&[0, 2])],
        23 => [head(&[0, 2, 0, low, 0, 1, 2, 3, 4]), vec![function, 4, 0, low, 1, high]],
        _ => [head(&[0, 2]), vec![function, 4, 0, low, 1, high]],
    }
}

/// A capture of these polls; the connections are known by the client's port.
struct Network {
    file: Vec<u8>,
    now: u64,
    sequences: [[u32; 2]; 3],
    packets: u16,
}

impl Network {
    fn send(&mut self, connection: u8, from_client: bool, bytes: &[u8]) {
        let (client, server) = (([10, 0, 0, 1], 50_000 + u16::from(connection)), ([10, 0, 0, 2], 502));
        let (from, to) = if from_client { (client, server) } else { (server, client) };
        let side = usize::from(!from_client);
        let numbers = &mut self.sequences[usize::from(connection)];
        self.packets += 1;
        let ip = etherparse::Ipv4Header {
            identification: self.packets,
            ..etherparse::Ipv4Header::new(0, 64, etherparse::ip_number::TCP, from.0, to.0).unwrap()
        };
        let mut packet = Vec::new();
        PacketBuilder::ethernet2([2, 0, 0, 0, 0, 1], [2, 0, 0, 0, 0, 2])
            .ip(etherparse::IpHeaders::Ipv4(ip, etherparse::Ipv4Extensions::default()))
            .tcp(from.1, to.1, numbers[side], 8192)
            .ack(numbers[1 - side])
            .psh()
            .write(&mut packet, bytes)
            .unwrap();
        numbers[side] = numbers[side].wrapping_add(bytes.len() as u32);
        let length = packet.len() as u32;
        for word in [1_700_000_000 + (self.now / 1_000_000) as u32, (self.now % 1_000_000) as u32, length, length] {
            self.file.extend(word.to_le_bytes());
        }
        self.file.extend(packet);
    }
}

/// The capture of these polls; so many of them in a row have different identifiers.
fn capture(polls: &[Poll], identifiers: u16) -> Vec<u8> {
    let head = [0xA1B2_C3D4, 0x0004_0002, 0, 0, 262_144, 1u32].into_iter().flat_map(u32::to_le_bytes).collect();
    let mut network = Network { file: head, now: 0, sequences: [[1000, u32::MAX - 50]; 3], packets: 0 };
    let mut late: Vec<(u8, Vec<u8>)> = Vec::new();
    for (poll, number) in polls.iter().zip(1u16..) {
        let id = number % identifiers;
        let [request, answer] = pdus(poll.function, poll.address);
        network.now += poll.times[0];
        network.send(poll.connection, true, &message(id, &request));
        network.now += poll.times[1];
        for (connection, bytes) in late.drain(..) {
            network.send(connection, false, &bytes);
        }
        let answer = message(id, &answer);
        match poll.outcome {
            Outcome::Answer => network.send(poll.connection, false, &answer),
            Outcome::Exception(code) => network.send(poll.connection, false, &message(id, &[poll.function | 0x80, code])),
            Outcome::ExceptionOfAnother => network.send(poll.connection, false, &message(id, &[0x85, 2])),
            Outcome::LongException => network.send(poll.connection, false, &message(id, &[poll.function | 0x80, 2, 2])),
            Outcome::Silence => {}
            Outcome::WrongIdentifier => network.send(poll.connection, false, &message(id ^ 0x100, &answer[7..])),
            Outcome::Split => answer.chunks(8).for_each(|part| network.send(poll.connection, false, part)),
            Outcome::Pipelined => late.push((poll.connection, answer)),
        }
    }
    network.file
}

/// What a capture is decoded to: texts of rows with all columns, statistics, and the transactions as a record batch; how many of
/// these were compact.
type Decoded = ((Vec<String>, RecordBatch), usize);

/// A capture in blocks of this size, with all frames or none; rows are taken after each block if `takes_each`.
fn decoded(file: &[u8], block: usize, frames: bool, takes_each: bool) -> Decoded {
    let wanted = WantedTables { frames, transactions: true, findings: true };
    let mut session = Session::new(Arc::new(Functions::default()), wanted, false, None);
    let source = String::from("file");
    let capture = session.add_capture(CaptureOptions { source, ports: Ports::default(), mode: None, line: None, rule: None });
    let (mut texts, mut compact) = (vec![Vec::new(); 5], 0);
    let mut arrow = BatchBuilder::new(TableKind::Transactions, &all_columns(TableKind::Transactions));
    let mut add = |batch: Batch| {
        let batch = Arc::new(batch);
        let table = Table::new(Arc::clone(&batch), TableKind::Transactions);
        arrow.add(&table, 0..table.len());
        compact += batch.exchanges.len();
        for (kind, out) in [TableKind::Transactions, TableKind::Findings, TableKind::Connections].into_iter().zip(&mut texts) {
            let columns: Vec<usize> = (0..kind.columns().len()).collect();
            modlens_writers::csv::rows(&Table::new(Arc::clone(&batch), kind), &columns, out);
        }
        // In JSON lines a column without a value has no key, either; so has the first one, and the only one.
        let kind = TableKind::Transactions;
        let may_be_null = ["gap_us", "response_time_us"].map(|key| kind.column(key).unwrap());
        for (columns, out) in [(0..kind.columns().len()).collect(), may_be_null.to_vec()].iter().zip(&mut texts[3..]) {
            modlens_writers::jsonl::rows(&Table::new(Arc::clone(&batch), kind), columns, out);
        }
    };
    for part in file.chunks(block) {
        session.feed_capture(capture, part, false);
        if takes_each {
            add(session.take());
        }
    }
    session.feed_capture(capture, &[], true);
    session.flush();
    add(session.take());
    let statistics = session.stats_json().to_string();
    let texts = texts.into_iter().map(|text| String::from_utf8(text).unwrap()).chain([statistics]).collect();
    ((texts, arrow.finish()), compact)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]

    #[test]
    fn packets_in_pairs_give_the_rows_of_the_general_way(
        polls in polls(),
        // Those of requests that still wait for their answers may come again.
        identifiers in prop_oneof![Just(u16::MAX), 2u16..40],
        block in 61usize..3000,
    ) {
        let file = capture(&polls, identifiers);
        let (general, _) = decoded(&file, SMALL_BLOCK, true, false);
        for (block, frames, takes_each) in [(file.len(), true, false), (file.len(), false, false), (block, false, true), (block, true, true)] {
            let (rows, _) = decoded(&file, block, frames, takes_each);
            prop_assert_eq!(&rows, &general);
        }
    }
}

#[test]
fn a_connection_without_frames_becomes_compact() {
    let poll = |at: u16| Poll {
        connection: 0,
        function: [3, 23, 6][usize::from(at % 3)],
        address: 1 + at % 5,
        outcome: if at % 4 == 3 { Outcome::Exception(2) } else { Outcome::Answer },
        times: [5000, 2000],
    };
    let file = capture(&(0..100).map(poll).collect::<Vec<_>>(), u16::MAX);
    let ((rows, none), (compact_rows, compact)) = (decoded(&file, 1 << 18, true, false), decoded(&file, 1 << 18, false, false));
    assert_eq!((rows, none), (compact_rows, 0));
    assert!(compact > 95, "only {compact} of 100 are compact");
}

/// A request without an answer is sent again after its 30 s, but before anything else has shown that these are over. Its retry
/// has a finding, and so has that silence; which of them comes first must not depend on blocks.
#[test]
fn a_late_retry_has_its_finding_in_the_same_place_in_blocks_of_any_size() {
    let poll = |connection, address, outcome, pause| Poll { connection, function: 3, address, outcome, times: [pause, 2000] };
    for others in [0, 1] {
        let mut polls = vec![poll(0, 1, Outcome::Answer, 1000), poll(0, 9, Outcome::Silence, 1000)];
        // Requests are looked after each second: 0.1 s before the end of the wait for the last time.
        let pause = |at| if at == 0 { 300_000 } else { 398_000 };
        polls.extend((0..75).map(|at| poll(if at < 74 { others } else { 0 }, 2 + at % 3, Outcome::Answer, pause(at))));
        polls.push(poll(0, 9, Outcome::Answer, 150_000));
        let file = capture(&polls, u16::MAX);
        let (general, _) = decoded(&file, SMALL_BLOCK, true, false);
        let (rows, _) = decoded(&file, file.len(), true, false);
        assert_eq!(rows, general, "between them on connection {others}");
    }
}
