//! Captures: however the network or the file is cut, the transactions are the same, and no byte panics.

use std::sync::Arc;

use etherparse::PacketBuilder;
use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, CaptureOptions, Session};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::pcap::Ports;
use modlens_tables::columns::{Cell, Table, TableKind};
use proptest::prelude::*;

const CLIENT: ([u8; 4], u16) = ([10, 0, 0, 1], 50_000);
const SERVER: ([u8; 4], u16) = ([10, 0, 0, 2], 502);
const ETHERNET: u32 = 1;

/// A TCP segment as the test thinks of it: who sends, sequence and acknowledgement number, bytes.
#[derive(Clone, Debug)]
struct Sent {
    from_client: bool,
    sequence: u32,
    acknowledged: u32,
    bytes: Vec<u8>,
    ident: u16,
}

fn ethernet(sent: &Sent) -> Vec<u8> {
    let (from, to) = if sent.from_client { (CLIENT, SERVER) } else { (SERVER, CLIENT) };
    let ip = etherparse::Ipv4Header {
        identification: sent.ident,
        ..etherparse::Ipv4Header::new(0, 64, etherparse::ip_number::TCP, from.0, to.0).unwrap()
    };
    let builder = PacketBuilder::ethernet2([2, 0, 0, 0, 0, 1], [2, 0, 0, 0, 0, 2])
        .ip(etherparse::IpHeaders::Ipv4(ip, etherparse::Ipv4Extensions::default()))
        .tcp(from.1, to.1, sent.sequence, 8192)
        .ack(sent.acknowledged)
        .psh();
    let mut out = Vec::new();
    builder.write(&mut out, &sent.bytes).unwrap();
    out
}

/// A pcap file, little-endian, a packet each 10 ms.
fn pcap(link: u32, packets: &[Vec<u8>]) -> Vec<u8> {
    pcap_every(10_000, link, packets)
}

/// The same with a packet each `step` microseconds.
fn pcap_every(step: u64, link: u32, packets: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    for word in [0xA1B2_C3D4, 0x0004_0002, 0, 0, 262_144, link] {
        out.extend(u32::to_le_bytes(word));
    }
    for (number, packet) in (0..).zip(packets) {
        let (seconds, micros) = ((number * step / 1_000_000) as u32, (number * step % 1_000_000) as u32);
        for word in [1_700_000_000 + seconds, micros, packet.len() as u32, packet.len() as u32] {
            out.extend(u32::to_le_bytes(word));
        }
        out.extend(packet);
    }
    out
}

fn decoded_in(file: &[u8], block: usize, ports: Ports) -> (Batch, Vec<(String, u64)>) {
    let mut session = Session::default();
    let capture = session.add_capture(CaptureOptions { source: String::from("file"), ports, mode: None, line: None, rule: None });
    for part in file.chunks(block.max(1)) {
        session.feed_capture(capture, part, false);
    }
    session.feed_capture(capture, &[], true);
    session.flush();
    let left_out = session.capture(capture).unwrap().left_out;
    (session.take(), left_out)
}

/// The transactions in the batches of `take` after each block.
fn taken_in(file: &[u8], block: usize) -> Vec<Essence> {
    let mut session = Session::default();
    let capture = session.add_capture(CaptureOptions {
        source: String::from("file"),
        ports: Ports::default(),
        mode: None,
        line: None,
        rule: None,
    });
    let mut rows = Vec::new();
    for part in file.chunks(block).chain([&[][..]]) {
        session.feed_capture(capture, part, part.is_empty());
        rows.extend(essence(&session.take()));
    }
    session.flush();
    rows.extend(essence(&session.take()));
    rows
}

fn decoded(file: &[u8]) -> Batch {
    decoded_in(file, usize::MAX, Ports::default()).0
}

/// The frames, the transactions, the findings and the connections with all of their columns.
fn csv(batch: Batch) -> String {
    let (mut out, batch) = (Vec::new(), Arc::new(batch));
    for kind in [TableKind::Frames, TableKind::Transactions, TableKind::Findings, TableKind::Connections] {
        let columns: Vec<usize> = (0..kind.columns().len()).collect();
        modlens_writers::csv::rows(&Table::new(Arc::clone(&batch), kind), &columns, &mut out);
    }
    String::from_utf8(out).unwrap()
}

/// What does not depend on packets: status, unit, function, identifier, both PDUs.
type Essence = (Status, u8, u8, Option<u16>, Vec<u8>, Vec<u8>);

fn essence(batch: &Batch) -> Vec<Essence> {
    let pdu = |half: &modlens_engine::records::FrameRef| half.pdu.of(&batch.arena).to_vec();
    let rows = batch.transactions.iter();
    rows.map(|t| (t.status, t.unit, t.function, t.mbap_id, pdu(&t.request), pdu(&t.response))).collect()
}

fn message(id: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = id.to_be_bytes().to_vec();
    out.extend([0, 0]);
    out.extend((1 + pdu.len() as u16).to_be_bytes());
    out.push(unit);
    out.extend(pdu);
    out
}

fn read_registers(id: u16, quantity: u8) -> (Vec<u8>, Vec<u8>) {
    let ask = message(id, 17, &[3, 0, id as u8, 0, quantity]);
    let mut answer = vec![3, 2 * quantity];
    answer.extend((0..2 * quantity).map(|byte| byte ^ id as u8));
    (ask, message(id, 17, &answer))
}

/// The same that writes.
fn write_registers(id: u16, quantity: u8) -> (Vec<u8>, Vec<u8>) {
    let mut ask = vec![16, 0, id as u8, 0, quantity, 2 * quantity];
    ask.extend((0..2 * quantity).map(|byte| byte ^ id as u8));
    (message(id, 17, &ask), message(id, 17, &ask[..5]))
}

/// One that is answered by itself.
fn write_register(id: u16, value: u8) -> (Vec<u8>, Vec<u8>) {
    let ask = message(id, 17, &[6, 0, id as u8, 0, value]);
    (ask.clone(), ask)
}

/// A poll in segments of the given sizes, in order; each answer follows its question. The largest of 30 quantities write.
fn poll(sizes: &[(u8, usize)]) -> Vec<Sent> {
    let (mut numbers, mut sent) = ([1000u32, 4_294_967_000], Vec::new());
    for (id, (quantity, cut)) in (1u16..).zip(sizes) {
        let (ask, answer) = match quantity {
            ..=20 => read_registers(id, *quantity),
            21..=25 => write_registers(id, *quantity),
            26.. => write_register(id, *quantity),
        };
        for (side, bytes) in [(0, ask), (1, answer)] {
            for piece in bytes.chunks((*cut).max(1)) {
                let ident = sent.len() as u16 + 1;
                let (sequence, acknowledged) = (numbers[side], numbers[1 - side]);
                sent.push(Sent { from_client: side == 0, sequence, acknowledged, bytes: piece.to_vec(), ident });
                numbers[side] = numbers[side].wrapping_add(piece.len() as u32);
            }
        }
    }
    sent
}

fn file(sent: &[Sent]) -> Vec<u8> {
    pcap(ETHERNET, &sent.iter().map(ethernet).collect::<Vec<_>>())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn segments_in_any_order_and_twice_give_the_same_transactions(
        sizes in prop::collection::vec((1u8..=20, 1usize..60), 1..12),
        moves in prop::collection::vec((any::<prop::sample::Index>(), 0usize..6), 0..12),
        twice in prop::collection::vec((any::<prop::sample::Index>(), any::<bool>()), 0..6),
    ) {
        let sent = poll(&sizes);
        let plain = poll(&sizes.iter().map(|&(quantity, _)| (quantity, 1000)).collect::<Vec<_>>());
        let mut mixed = sent.clone();
        for (at, again) in twice {
            let at = at.index(mixed.len());
            let mut copy = mixed[at].clone();
            // The same packet captured twice, or the bytes sent again.
            copy.ident = if again { copy.ident + 30_000 } else { copy.ident };
            mixed.insert(at + 1, copy);
        }
        for (from, distance) in moves {
            // The first segment of each side says where the sides begin.
            let from = from.index(mixed.len()).max(sent.len().min(1));
            let first_answer = mixed.iter().position(|it| !it.from_client).unwrap();
            let to = (from + distance).min(mixed.len() - 1);
            if from != first_answer && from > 0 {
                let it = mixed.remove(from);
                mixed.insert(to, it);
            }
        }
        let starts_right = mixed.iter().find(|it| !it.from_client).map(|it| it.sequence) == Some(4_294_967_000);
        prop_assume!(starts_right && mixed[0].sequence == 1000);
        prop_assert_eq!(essence(&decoded(&file(&mixed))), essence(&decoded(&file(&plain))));
    }

    #[test]
    fn blocks_of_any_size_give_the_same_rows(sizes in prop::collection::vec((1u8..=30, 1usize..60), 1..6), block in 1usize..200) {
        let file = file(&poll(&sizes));
        let (whole, parts) = (decoded(&file), decoded_in(&file, block, Ports::default()).0);
        prop_assert_eq!(csv(parts), csv(whole));
    }

    /// Each message in a packet of its own, as on nearly all connections; the answers to some requests do not come, and
    /// requests that wait, for 30 s, are passed by the exchanges after them.
    #[test]
    fn requests_without_answer_change_nothing_of_those_behind_them(
        exchanges in prop::collection::vec((1u8..=30, 0u8..4, 0u16..60), 1..90),
        step in prop::sample::select(vec![10_000u64, 400_000, 2_000_000]),
        block in 1usize..400,
    ) {
        let sizes: Vec<(u8, usize)> = exchanges.iter().map(|(quantity, ..)| (*quantity, 300)).collect();
        let mut sent = poll(&sizes);
        for (pair, (_, _, again)) in sent.chunks_mut(2).zip(&exchanges) {
            if *again < 8 {
                // Identifiers that come again while the first request of that name still waits.
                for message in pair {
                    message.bytes[..2].copy_from_slice(&again.to_be_bytes());
                }
            }
        }
        let is_kept = |at: usize| at.is_multiple_of(2) || exchanges[at / 2].1 > 0;
        let packets: Vec<Vec<u8>> = (0..sent.len()).filter(|&at| is_kept(at)).map(|at| ethernet(&sent[at])).collect();
        let file = pcap_every(step, ETHERNET, &packets);
        let (whole, parts) = (decoded(&file), decoded_in(&file, block, Ports::default()).0);
        prop_assert_eq!(csv(parts), csv(whole));
    }

    #[test]
    fn a_file_that_ends_anywhere_gives_what_is_before(sizes in prop::collection::vec((1u8..=20, 1usize..60), 1..6), end in any::<prop::sample::Index>()) {
        let whole = file(&poll(&sizes));
        let cut = &whole[..end.index(whole.len())];
        let (all, some) = (decoded(&whole), decoded(cut));
        prop_assert!(some.frames.len() <= all.frames.len());
        for (one, other) in some.frames.iter().zip(&all.frames) {
            if one.verdict == other.verdict {
                prop_assert_eq!(one.wire.of(&some.arena), other.wire.of(&all.arena));
            }
        }
    }

    #[test]
    fn damaged_files_never_panic(
        sizes in prop::collection::vec((1u8..=20, 1usize..60), 1..6),
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40),
        link in prop::sample::select(vec![0u32, 1, 101, 113, 147, 228, 250, 252, 276, 7]),
        any_port in any::<bool>(),
    ) {
        let packets: Vec<Vec<u8>> = poll(&sizes).iter().map(ethernet).collect();
        let mut file = pcap(link, &packets);
        for (at, value) in flips {
            let at = 24 + at.index(file.len() - 24);
            file[at] = value;
        }
        let ports = if any_port { Ports::Any } else { Ports::default() };
        decoded_in(&file, 777, ports);
    }
}

/// The first request waits for 30 s, and the rows after it with it: far more than one batch has.
#[test]
fn rows_behind_an_old_request_are_given_once_and_in_order() {
    let sizes: Vec<(u8, usize)> = (0..6000u32).map(|at| (1 + (at % 30) as u8, 300)).collect();
    let mut sent = poll(&sizes);
    sent.remove(1);
    let file = pcap_every(4000, ETHERNET, &sent.iter().map(ethernet).collect::<Vec<_>>());
    let whole = essence(&decoded(&file));
    assert_eq!(whole.len(), 6000);
    for block in [1000, 16_000, 200_000] {
        assert_eq!(taken_in(&file, block), whole);
    }
}

#[test]
fn a_poll_is_read_with_its_ends() {
    let batch = Arc::new(decoded(&file(&poll(&[(2, 1000), (3, 1000)]))));
    let table = Table::new(batch, TableKind::Transactions);
    let text = |row: usize, key: &str| match table.cell(row, TableKind::Transactions.column(key).unwrap()) {
        Cell::Text(text) | Cell::Word(text) => text.to_owned(),
        Cell::Int(number) => number.to_string(),
        Cell::Us(ns) => ns.to_string(),
        Cell::Source(file, _, at) => format!("{file}#{at}"),
        other => format!("{other:?}"),
    };
    assert_eq!(table.len(), 2);
    let row = |at: usize| {
        ["client", "server", "bus", "connection", "status", "mbap_id", "response_time_us", "source"].map(|key| text(at, key))
    };
    assert_eq!(row(0), ["10.0.0.1", "10.0.0.2:502", "10.0.0.2:502", "1", "ok", "1", "10000000", "file#1"]);
    assert_eq!(row(1)[5..], ["2", "10000000", "file#3"]);
}

#[test]
fn bytes_that_are_missing_are_said_and_silence_is_not_blamed_on_the_device() {
    let mut sent = poll(&[(2, 1000), (3, 1000), (4, 1000)]);
    sent.remove(3); // the second answer
    let batch = decoded(&file(&sent));
    let statuses: Vec<Status> = batch.transactions.iter().map(|t| t.status).collect();
    assert_eq!(statuses, [Status::Ok, Status::NotObserved, Status::Ok]);
    assert!(batch.findings.iter().any(|row| row.finding == Finding::MissingSegment && row.detail.starts_with("15 bytes")));
}

#[test]
fn one_side_alone_gives_not_observed() {
    let sent: Vec<Sent> = poll(&[(2, 1000), (3, 1000), (4, 1000)]).into_iter().filter(|it| it.from_client).collect();
    let batch = decoded(&file(&sent));
    assert!(batch.transactions.iter().all(|t| t.status == Status::NotObserved));
    assert_eq!(batch.transactions.len(), 3);
}

#[test]
fn packets_captured_twice_are_one_and_no_retry() {
    let sent: Vec<Sent> = poll(&[(2, 1000), (3, 1000)]).into_iter().flat_map(|it| [it.clone(), it]).collect();
    let (batch, left_out) = decoded_in(&file(&sent), usize::MAX, Ports::default());
    assert_eq!(batch.transactions.len(), 2);
    assert!(left_out.contains(&(String::from("packets captured twice"), 4)), "{left_out:?}");
    let found: Vec<Finding> = batch.findings.iter().map(|row| row.finding).collect();
    assert_eq!(found, [Finding::DuplicatePacket]);
}

#[test]
fn identifiers_that_repeat_pair_by_order() {
    let mut sent = Vec::new();
    let mut numbers = [1u32, 1];
    let asks: Vec<_> = (1..=3).map(|n| read_registers(3, n)).collect();
    // Three questions with the identifier 3 at once, then the answers.
    for (side, pick) in [(0, 0), (1, 1)] {
        for pair in &asks {
            let bytes = if pick == 0 { pair.0.clone() } else { pair.1.clone() };
            let ident = sent.len() as u16 + 1;
            sent.push(Sent {
                from_client: side == 0,
                sequence: numbers[side],
                acknowledged: numbers[1 - side],
                bytes: bytes.clone(),
                ident,
            });
            numbers[side] += bytes.len() as u32;
        }
    }
    let batch = decoded(&file(&sent));
    assert!(batch.transactions.iter().all(|t| t.status == Status::Ok));
    let lengths: Vec<u32> = batch.transactions.iter().map(|t| t.response.pdu.length).collect();
    assert_eq!(lengths, [4, 6, 8]);
}

#[test]
fn what_is_not_modbus_on_the_port_is_left_alone() {
    let mut sent = poll(&[(2, 1000)]);
    sent.truncate(1);
    sent[0].bytes = b"GET / HTTP/1.1\r\nHost: plant\r\n\r\n".to_vec();
    let (batch, left_out) = decoded_in(&file(&sent), usize::MAX, Ports::default());
    assert!(batch.frames.is_empty());
    assert_eq!(left_out, [(String::from("packets on Modbus ports that are not Modbus, in 1 connections"), 1)]);
}

#[test]
fn a_capture_may_begin_inside_a_message() {
    let mut sent = poll(&[(20, 10), (3, 1000), (4, 1000)]);
    sent.drain(..4); // the first question, and the first half of its answer
    let batch = decoded(&file(&sent));
    let statuses: Vec<Status> = batch.transactions.iter().map(|t| t.status).collect();
    assert_eq!(statuses, [Status::Ok, Status::Ok]);
}

#[test]
fn any_port_needs_a_question_and_its_answer() {
    let moved = |sent: Vec<Sent>| -> Vec<u8> {
        let packets = sent.iter().map(|it| {
            let mut packet = ethernet(it);
            let at = if it.from_client { 36 } else { 34 };
            packet[at..at + 2].copy_from_slice(&4711u16.to_be_bytes());
            packet
        });
        pcap(ETHERNET, &packets.collect::<Vec<_>>())
    };
    let both = moved(poll(&[(2, 1000)]));
    assert_eq!(decoded_in(&both, usize::MAX, Ports::Any).0.transactions.len(), 1);
    assert!(decoded(&both).frames.is_empty(), "only port 502 is looked at by default");
    let one = moved(poll(&[(2, 1000)]).into_iter().take(1).collect());
    assert!(decoded_in(&one, usize::MAX, Ports::Any).0.frames.is_empty(), "one message may be chance");
}

/// Connections to one server share their statistics, so a bus after them has another number there than in the session.
#[test]
fn silences_are_counted_on_their_own_bus_behind_connections_to_one_server() {
    let (ask, _) = read_registers(1, 2);
    let sent = Sent { from_client: true, sequence: 1, acknowledged: 1, bytes: ask, ident: 1 };
    let mut other_client = ethernet(&sent);
    // The source port follows 14 bytes of Ethernet and 20 of IPv4.
    other_client[35] ^= 1;
    let file = pcap(1, &[ethernet(&sent), other_client]);
    let mut session = Session::default();
    let options = CaptureOptions { source: String::from("file"), ports: Ports::default(), mode: None, line: None, rule: None };
    let capture = session.add_capture(options);
    session.feed_capture(capture, &file, true);
    let line: LineSettings = "9600-8E1".parse().unwrap();
    let mut options = BusOptions::named("line");
    (options.mode, options.line, options.bus.clock) = (Some(Mode::Rtu), Some(line), Clock::Relative);
    let bus = session.add_bus(options);
    for at in 0..3 {
        let frame = [17, 3, 0, 0x6B, 0, 3, 0x76, 0x87];
        session.feed(bus, &Chunk { bytes: &frame, times: Times::Read(at * 1_000_000_000), ..Chunk::default() });
    }
    session.flush();
    let stats = session.stats_json();
    let buses = stats["buses"].as_array().unwrap();
    let counted: Vec<_> = buses.iter().map(|bus| (bus["bus"].as_str().unwrap(), bus["silence"].is_null())).collect();
    assert_eq!(counted.len(), 2, "{stats}");
    assert_eq!((counted[0].1, counted[1]), (true, ("line", false)), "{stats}");
}
