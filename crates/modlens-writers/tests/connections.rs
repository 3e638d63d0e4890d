//! The table of TCP connections: packets without data tell who opened, refused and ended a connection.

use std::sync::Arc;

use etherparse::PacketBuilder;
use modlens_engine::records::{Connection, End};
use modlens_engine::session::{CaptureOptions, Session};
use modlens_protocol::finding::Finding;
use modlens_protocol::status::Status;
use modlens_readers::pcap::Ports;
use modlens_tables::columns::{Table, TableKind};

const SERVER: [u8; 4] = [10, 0, 0, 2];
const CLIENT: [u8; 4] = [10, 0, 0, 1];
/// Nanoseconds of a millisecond.
const MS: i64 = 1_000_000;
/// Seconds since 1970 of the first packet.
const START_S: i64 = 1_700_000_000;

/// The flags of a segment.
#[derive(Clone, Copy, PartialEq)]
enum Flags {
    Syn,
    SynAck,
    Ack,
    Fin,
    Rst,
}
use Flags::{Ack, Fin, Rst, Syn, SynAck};

/// A recording that is made packet by packet, each with its time in ms.
#[derive(Default)]
struct Recording {
    packets: Vec<(i64, Vec<u8>)>,
    ident: u16,
}

/// One TCP connection of it: the port of the client, that of the server, and the next sequence numbers.
struct Tcp {
    ports: [u16; 2],
    next: [u32; 2],
}

impl Tcp {
    fn new(client: u16, server: u16) -> Self {
        Self { ports: [client, server], next: [1000, 500_000] }
    }

    /// Adds a segment of one side, 0 for the client.
    fn send(&mut self, to: &mut Recording, at: i64, side: usize, flags: Flags, bytes: &[u8]) -> &mut Self {
        let ends = if side == 0 { [CLIENT, SERVER] } else { [SERVER, CLIENT] };
        to.ident += 1;
        let ip = etherparse::Ipv4Header {
            identification: to.ident,
            ..etherparse::Ipv4Header::new(0, 64, etherparse::ip_number::TCP, ends[0], ends[1]).unwrap()
        };
        let builder = PacketBuilder::ethernet2([2; 6], [4; 6])
            .ip(etherparse::IpHeaders::Ipv4(ip, etherparse::Ipv4Extensions::default()))
            .tcp(self.ports[side], self.ports[1 - side], self.next[side], 8192);
        let acknowledged = self.next[1 - side];
        let builder = match flags {
            Syn => builder.syn(),
            SynAck => builder.syn().ack(acknowledged),
            Ack => builder.ack(acknowledged),
            Fin => builder.fin().ack(acknowledged),
            Rst => builder.rst().ack(acknowledged),
        };
        let mut packet = Vec::new();
        builder.write(&mut packet, bytes).unwrap();
        to.packets.push((at, packet));
        let taken = u32::from(matches!(flags, Syn | SynAck | Fin)) + bytes.len() as u32;
        self.next[side] = self.next[side].wrapping_add(taken);
        self
    }

    /// The three segments that open a connection.
    fn open(&mut self, to: &mut Recording, at: i64) -> &mut Self {
        self.send(to, at, 0, Syn, &[]).send(to, at, 1, SynAck, &[]).send(to, at, 0, Ack, &[])
    }

    /// A read of a register, and its answer 5 ms later.
    fn poll(&mut self, to: &mut Recording, at: i64, id: u8) -> &mut Self {
        self.ask(to, at, id).answer(to, at + 5, id)
    }

    fn ask(&mut self, to: &mut Recording, at: i64, id: u8) -> &mut Self {
        self.send(to, at, 0, Ack, &[0, id, 0, 0, 0, 6, 1, 3, 0, id, 0, 1])
    }

    fn answer(&mut self, to: &mut Recording, at: i64, id: u8) -> &mut Self {
        self.send(to, at, 1, Ack, &[0, id, 0, 0, 0, 5, 1, 3, 2, 0, id])
    }
}

impl Recording {
    fn pcap(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for word in [0xA1B2_C3D4, 0x0004_0002, 0, 0, 262_144, 1] {
            out.extend(u32::to_le_bytes(word));
        }
        for (at, packet) in &self.packets {
            let seconds = START_S + at / 1000;
            for word in [seconds as u32, (at % 1000 * 1000) as u32, packet.len() as u32, packet.len() as u32] {
                out.extend(u32::to_le_bytes(word));
            }
            out.extend(packet);
        }
        out
    }

    fn connections(&self, ports: Ports) -> Vec<Connection> {
        let mut session = Session::default();
        let options = CaptureOptions { source: String::from("file"), ports, mode: None, line: None, rule: None };
        let capture = session.add_capture(options);
        let mut rows = Vec::new();
        for block in self.pcap().chunks(1000) {
            session.feed_capture(capture, block, false);
            rows.append(&mut session.take().connections);
        }
        session.feed_capture(capture, &[], true);
        session.flush();
        rows.append(&mut session.take().connections);
        rows
    }
}

fn only(recording: &Recording) -> Connection {
    let mut rows = recording.connections(Ports::default());
    assert_eq!(rows.len(), 1, "{rows:#?}");
    rows.remove(0)
}

fn at(ms: i64) -> i64 {
    START_S * 1000 * MS + ms * MS
}

#[test]
fn a_connection_tells_who_opened_and_ended_it_and_what_was_asked() {
    let mut of = Recording::default();
    Tcp::new(50_000, 502)
        .open(&mut of, 0)
        .poll(&mut of, 10, 1)
        .poll(&mut of, 1010, 2)
        .send(&mut of, 1015, 0, Ack, &[])
        .send(&mut of, 11_015, 1, Fin, &[])
        .send(&mut of, 11_016, 0, Fin, &[])
        .send(&mut of, 11_016, 1, Ack, &[]);
    let row = only(&of);
    assert_eq!((row.number, row.client.as_str(), row.client_port, row.server.as_str()), (1, "10.0.0.1", 50_000, "10.0.0.2:502"));
    assert_eq!((row.opened, row.closed, row.closed_by), (Some(at(0)), Some(at(11_015)), Some(End::Server)));
    // The last byte came at 1015 ms.
    assert_eq!((row.idle, row.is_refused, row.is_reset, row.is_accepted), (Some(10_000 * MS), false, false, true));
    assert_eq!((row.requests, row.answered, row.first_status, row.in_flight_max, row.lockstep), (2, 2, Some(Status::Ok), 1, 0));
    assert_eq!((row.client_framing, row.server_framing), (Some("tcp"), Some("tcp")));
    assert_eq!((row.retransmitted_segments, row.lost_bytes, row.findings.len(), row.origin), (0, 0, 0, 1));
}

#[test]
fn a_refused_connection_is_a_row_though_it_carried_no_byte() {
    let mut of = Recording::default();
    Tcp::new(50_000, 502).send(&mut of, 0, 0, Syn, &[]).send(&mut of, 1, 1, Rst, &[]);
    let row = only(&of);
    assert_eq!((row.is_refused, row.is_reset, row.is_accepted), (true, false, false));
    assert_eq!((row.opened, row.closed, row.closed_by, row.idle), (Some(at(0)), Some(at(1)), Some(End::Server), Some(MS)));
    assert_eq!((row.requests, row.first_status, row.client_framing, row.server_framing), (0, None, None, None));
}

#[test]
fn a_reset_right_after_the_opening_is_no_refusal() {
    let mut of = Recording::default();
    Tcp::new(50_000, 502).open(&mut of, 0).send(&mut of, 3, 1, Rst, &[]);
    let row = only(&of);
    assert_eq!((row.is_refused, row.is_reset, row.closed_by, row.requests), (false, true, Some(End::Server), 0));
}

#[test]
fn a_request_that_a_reset_answers_is_asked_and_not_answered() {
    let mut of = Recording::default();
    Tcp::new(50_000, 502).open(&mut of, 0).poll(&mut of, 10, 1).ask(&mut of, 20, 2).send(&mut of, 21, 1, Rst, &[]);
    let row = only(&of);
    assert_eq!((row.requests, row.answered, row.is_reset, row.closed_by), (2, 1, true, Some(End::Server)));
    assert_eq!((row.first_status, row.idle), (Some(Status::Ok), Some(MS)));
}

#[test]
fn a_syn_that_nobody_answers_is_transmitted_again() {
    let mut of = Recording::default();
    for again in 0..3 {
        Tcp::new(50_000, 502).send(&mut of, again * 1000, 0, Syn, &[]);
    }
    let row = only(&of);
    assert_eq!((row.opened, row.closed, row.is_accepted, row.retransmitted_segments), (Some(at(0)), None, false, 2));
    assert_eq!(row.findings, [Finding::Retransmission]);
}

#[test]
fn a_connection_older_than_the_recording_has_no_opening() {
    let mut of = Recording::default();
    Tcp::new(50_000, 502).poll(&mut of, 10, 1);
    let row = only(&of);
    assert_eq!((row.opened, row.closed, row.requests, row.idle), (None, None, 1, None));
}

#[test]
fn rows_come_in_the_order_of_opening_whichever_ends_first() {
    let mut of = Recording::default();
    let (mut first, mut second) = (Tcp::new(50_000, 502), Tcp::new(50_001, 502));
    first.open(&mut of, 0);
    second.open(&mut of, 10).poll(&mut of, 20, 1).send(&mut of, 30, 0, Fin, &[]).send(&mut of, 31, 1, Fin, &[]);
    first.poll(&mut of, 40, 1).send(&mut of, 50, 0, Fin, &[]).send(&mut of, 51, 1, Fin, &[]);
    let rows = of.connections(Ports::default());
    assert_eq!(rows.iter().map(|row| (row.number, row.client_port)).collect::<Vec<_>>(), [(1, 50_000), (2, 50_001)]);
    assert!(rows.iter().all(|row| row.closed_by == Some(End::Client) && row.answered == 1));
}

#[test]
fn ports_that_are_used_again_are_another_connection() {
    let mut of = Recording::default();
    for turn in 0..3 {
        let mut tcp = Tcp::new(50_000, 502);
        tcp.next = [1000 + 70_000 * turn as u32, 9000 * turn as u32];
        tcp.open(&mut of, turn * 100).poll(&mut of, turn * 100 + 10, 1);
        tcp.send(&mut of, turn * 100 + 20, 0, Fin, &[]).send(&mut of, turn * 100 + 21, 1, Fin, &[]);
        tcp.send(&mut of, turn * 100 + 21, 0, Ack, &[]);
    }
    let rows = of.connections(Ports::default());
    assert_eq!(rows.iter().map(|row| (row.opened, row.requests)).collect::<Vec<_>>(), [0, 100, 200].map(|ms| (Some(at(ms)), 1)));
}

#[test]
fn a_syn_may_carry_the_first_request() {
    let mut of = Recording::default();
    let mut tcp = Tcp::new(50_000, 502);
    // TCP Fast Open (RFC 7413).
    tcp.send(&mut of, 0, 0, Syn, &[0, 1, 0, 0, 0, 6, 1, 3, 0, 1, 0, 1]).send(&mut of, 1, 1, SynAck, &[]);
    tcp.send(&mut of, 1, 0, Ack, &[]).answer(&mut of, 5, 1).poll(&mut of, 20, 2);
    let row = only(&of);
    assert_eq!((row.requests, row.answered, row.lost_bytes), (2, 2, 0));
}

#[test]
fn a_request_with_data_that_its_function_has_not_may_come_in_two_segments() {
    // Report Server ID has no data in its request (application protocol, 6.13); some masters send some.
    let request = [0, 1, 0, 0, 0, 6, 1, 17, 0xAA, 0xBB, 0xCC, 0xDD];
    let response = [0, 1, 0, 0, 0, 6, 1, 17, 3, 7, 8, 0xFF];
    for cut in 8..request.len() {
        let mut of = Recording::default();
        let mut tcp = Tcp::new(50_000, 502);
        tcp.open(&mut of, 0).send(&mut of, 10, 0, Ack, &request[..cut]).send(&mut of, 11, 0, Ack, &request[cut..]);
        tcp.send(&mut of, 15, 1, Ack, &response).poll(&mut of, 20, 2);
        let row = only(&of);
        assert_eq!((row.requests, row.answered), (2, 2), "cut after {cut} bytes");
    }
}

#[test]
fn the_framing_of_each_side_is_told() {
    // 01 03 00 00 00 01 with its CRC: RTU on the port of MBAP.
    let request = [1, 3, 0, 0, 0, 1, 0x84, 0x0A];
    // 01 03 02 00 07 with its CRC.
    let response = [1, 3, 2, 0, 7, 0xF9, 0x86];
    let mbap = [0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0, 1];
    for (ask, answer, framing) in [
        (&request[..], &response[..], (Some("rtu"), Some("rtu"))),
        (&request[..], &[][..], (Some("rtu"), None)),
        (&mbap[..], &response[..], (Some("tcp"), Some("rtu"))),
        (&mbap[..], &b"HTTP/1.1 400 Bad Request\r\n\r\n"[..], (Some("tcp"), Some("other"))),
        (&b":010300000001FB\r\n"[..], &b":0103020007F3\r\n"[..], (Some("ascii"), Some("ascii"))),
        (&b"GET / HTTP/1.1\r\nHost: meter\r\n\r\n"[..], &b"HTTP/1.1 400 Bad Request\r\n\r\n"[..], (Some("other"), Some("other"))),
    ] {
        let mut of = Recording::default();
        let mut tcp = Tcp::new(50_000, 502);
        tcp.open(&mut of, 0).send(&mut of, 10, 0, Ack, ask);
        if !answer.is_empty() {
            tcp.send(&mut of, 20, 1, Ack, answer);
        }
        tcp.send(&mut of, 30, 0, Fin, &[]).send(&mut of, 31, 1, Fin, &[]);
        let row = only(&of);
        assert_eq!((row.client_framing, row.server_framing), framing);
    }
}

#[test]
fn requests_in_flight_and_answers_that_are_a_step_behind_are_counted() {
    let mut window = Recording::default();
    let mut tcp = Tcp::new(50_000, 502);
    tcp.open(&mut window, 0).ask(&mut window, 10, 1).ask(&mut window, 10, 2).ask(&mut window, 11, 3);
    for id in 1..=3 {
        tcp.answer(&mut window, 20 + i64::from(id), id);
    }
    let row = only(&window);
    assert_eq!((row.in_flight_max, row.lockstep, row.answered), (3, 0, 3));

    // The client gives up request 2 after 300 ms, and takes every answer from then on for that of the request after it.
    let mut behind = Recording::default();
    let mut tcp = Tcp::new(50_000, 502);
    tcp.open(&mut behind, 0).poll(&mut behind, 10, 1).ask(&mut behind, 100, 2).ask(&mut behind, 400, 3);
    for id in 2..=6 {
        let ms = 300 + 50 * i64::from(id);
        tcp.answer(&mut behind, ms, id).ask(&mut behind, ms + 1, id + 2);
    }
    let row = only(&behind);
    assert_eq!((row.in_flight_max, row.lockstep), (1, 5));
    // The last of the six answers came 200 ms after the first late one.
    let (last, answers) = row.lockstep_until;
    assert_eq!((last.zip(row.lockstep_since).map(|(last, first)| last - first), answers), (Some(200_000_000), 6));
}

#[test]
fn what_was_sent_again_and_what_is_missing_is_counted() {
    let mut of = Recording::default();
    let mut tcp = Tcp::new(50_000, 502);
    tcp.open(&mut of, 0).poll(&mut of, 10, 1);
    let sent = tcp.next[0];
    tcp.ask(&mut of, 1000, 2);
    tcp.next[0] = sent;
    tcp.ask(&mut of, 1300, 2);
    // Eleven bytes of the server are not in the recording.
    tcp.next[1] += 11;
    tcp.poll(&mut of, 9000, 3).poll(&mut of, 20_000, 4);
    let row = only(&of);
    assert_eq!((row.retransmitted_segments, row.lost_bytes), (1, 11));
    assert!(row.findings.contains(&Finding::Retransmission) && row.findings.contains(&Finding::MissingSegment));
}

#[test]
fn on_any_port_only_servers_of_modbus_have_rows() {
    let mut of = Recording::default();
    // Not Modbus, and refused before Modbus was seen there.
    Tcp::new(50_000, 443).open(&mut of, 0).send(&mut of, 1, 0, Ack, b"GET /").send(&mut of, 2, 0, Rst, &[]);
    Tcp::new(50_001, 1502).send(&mut of, 3, 0, Syn, &[]).send(&mut of, 4, 1, Rst, &[]);
    Tcp::new(50_002, 1502).open(&mut of, 10).poll(&mut of, 20, 1).send(&mut of, 30, 1, Rst, &[]);
    // And refused after it.
    Tcp::new(50_003, 1502).send(&mut of, 40, 0, Syn, &[]).send(&mut of, 41, 1, Rst, &[]);
    let rows = of.connections(Ports::Any);
    let told: Vec<_> = rows.iter().map(|row| (row.number, row.client_port, row.is_refused)).collect();
    assert_eq!(told, [(1, 50_002, false), (2, 50_003, true)]);
    assert_eq!(rows[0].opened, Some(at(10)));
}

#[test]
fn a_scan_of_many_ports_needs_little_memory_and_keeps_the_order() {
    let mut session = Session::default();
    let options = CaptureOptions { source: String::from("file"), ports: Ports::default(), mode: None, line: None, rule: None };
    let capture = session.add_capture(options);
    let mut of = Recording::default();
    // A poll that stays open all the time, and 100,000 attempts after it.
    Tcp::new(1, 502).open(&mut of, 0).poll(&mut of, 1, 1);
    session.feed_capture(capture, &of.pcap(), false);
    let (mut rows, mut most_waiting) = (0, 0);
    for round in 0..100u32 {
        let mut of = Recording::default();
        for port in 0..1000u32 {
            let mut tcp = Tcp::new(2000 + (port + 1000 * (round % 60)) as u16, 502);
            tcp.next[0] = (round + 1) << 25;
            let ms = i64::from(round * 1000 + port);
            tcp.send(&mut of, ms, 0, Syn, &[]).send(&mut of, ms, 1, Rst, &[]);
        }
        let file = of.pcap();
        session.feed_capture(capture, &file[24..], false);
        let batch = session.take();
        rows += batch.connections.len();
        most_waiting = most_waiting.max(1000 * (round as usize + 1) - rows.min(1000 * (round as usize + 1)));
        assert!(batch.connections.is_sorted_by_key(|row| row.number));
    }
    session.feed_capture(capture, &[], true);
    rows += session.take().connections.len();
    assert_eq!(rows, 100_001);
    assert!(most_waiting <= 18_000, "{most_waiting} rows waited");
}

#[test]
fn every_column_of_a_connection_is_written() {
    let mut of = Recording::default();
    Tcp::new(50_000, 502).open(&mut of, 0).poll(&mut of, 10, 1).send(&mut of, 1015, 1, Rst, &[]);
    let mut session = Session::default();
    let options = CaptureOptions { source: String::from("x.pcap"), ports: Ports::default(), mode: None, line: None, rule: None };
    let capture = session.add_capture(options);
    session.feed_capture(capture, &of.pcap(), true);
    session.flush();
    let kind = TableKind::Connections;
    let columns: Vec<usize> = (0..kind.columns().len()).collect();
    let mut csv = Vec::new();
    modlens_writers::csv::rows(&Table::new(Arc::new(session.take()), kind), &columns, &mut csv);
    assert_eq!(
        String::from_utf8(csv).unwrap().trim_end(),
        "1,10.0.0.2:502,10.0.0.1,50000,10.0.0.2:502,2023-11-14T22:13:20.000000Z,2023-11-14T22:13:21.015000Z,server,\
         false,true,1,0,1,ok,1,0,tcp,tcp,0,0,1000000,,x.pcap#1"
    );
}
