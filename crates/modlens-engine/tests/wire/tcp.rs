//! Captures of Modbus/TCP: packets of one or several connections to port 502, as raw IPv4 (link type 101).

use std::collections::HashMap;

use modlens_engine::records::{Batch, Transaction};
use modlens_engine::session::{CaptureOptions, Session, WantedTables};
use modlens_readers::pcap::Ports;

use super::MS;

/// The first packet's time: 14 November 2023.
pub const START: i64 = 1_700_000_000_000_000_000;

const FIN: u8 = 0x11;
const RST: u8 = 0x14;
const DATA: u8 = 0x18;

/// A message with its MBAP header (messaging on TCP/IP, 3.1.3).
pub fn mbap(id: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut message = id.to_be_bytes().to_vec();
    message.extend([0, 0]);
    message.extend((pdu.len() as u16 + 1).to_be_bytes());
    message.push(unit);
    message.extend(pdu);
    message
}

/// A request to read holding registers.
pub fn ask(id: u16, address: u16, quantity: u8) -> Vec<u8> {
    let [high, low] = address.to_be_bytes();
    mbap(id, 1, &[3, high, low, 0, quantity])
}

/// The response to it.
pub fn answer(id: u16, values: &[u16]) -> Vec<u8> {
    let mut pdu = vec![3, 2 * values.len() as u8];
    pdu.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    mbap(id, 1, &pdu)
}

/// A capture that grows packet by packet.
pub struct Packets {
    file: Vec<u8>,
    /// The next sequence number of each side, by the client's port.
    sequence: HashMap<(u16, bool), u32>,
}

impl Packets {
    pub fn new() -> Self {
        // The header of a pcap file with microseconds.
        let words: [u32; 6] = [0xA1B2_C3D4, 0x0004_0002, 0, 0, 65535, 101];
        Self { file: words.iter().flat_map(|word| word.to_le_bytes()).collect(), sequence: HashMap::new() }
    }

    /// Data from the client of this port or from the server, so many milliseconds after the start.
    pub fn data(&mut self, ms: i64, port: u16, from_client: bool, bytes: &[u8]) {
        self.packet(ms, port, from_client, DATA, bytes);
    }

    /// Data that the capture lacks.
    pub fn lose(&mut self, port: u16, from_client: bool, bytes: &[u8]) {
        *self.sequence.entry((port, from_client)).or_insert(1000) += bytes.len() as u32;
    }

    pub fn fin(&mut self, ms: i64, port: u16, from_client: bool) {
        self.packet(ms, port, from_client, FIN, &[]);
    }

    pub fn rst(&mut self, ms: i64, port: u16, from_client: bool) {
        self.packet(ms, port, from_client, RST, &[]);
    }

    fn packet(&mut self, ms: i64, port: u16, from_client: bool, flags: u8, bytes: &[u8]) {
        let acknowledged = *self.sequence.entry((port, !from_client)).or_insert(1000);
        let sequence = self.sequence.entry((port, from_client)).or_insert(1000);
        let ports = if from_client { [port, 502] } else { [502, port] };
        let hosts = if from_client { [1, 2] } else { [2, 1] };
        let length = 40 + bytes.len() as u16;
        let mut packet = vec![0x45, 0];
        packet.extend(length.to_be_bytes());
        packet.extend([0, 0, 0, 0, 64, 6, 0, 0, 10, 0, 0, hosts[0], 10, 0, 0, hosts[1]]);
        packet.extend(ports.iter().flat_map(|port| port.to_be_bytes()));
        packet.extend(sequence.to_be_bytes());
        packet.extend(acknowledged.to_be_bytes());
        packet.extend([0x50, flags, 0xFF, 0xFF, 0, 0, 0, 0]);
        packet.extend(bytes);
        *sequence += bytes.len() as u32 + u32::from(flags == FIN);
        let time = START / 1_000_000_000 * 1_000_000 + ms * 1000;
        let record = [(time / 1_000_000) as u32, (time % 1_000_000) as u32, packet.len() as u32, packet.len() as u32];
        self.file.extend(record.iter().flat_map(|word| word.to_le_bytes()));
        self.file.extend(packet);
    }

    /// The rows of this capture, and the transactions that are returned before its end.
    pub fn decode(&self, live: bool) -> (Batch, Vec<Transaction>) {
        self.decode_in_blocks(live, usize::MAX)
    }

    /// The same, read in blocks of so many bytes.
    pub fn decode_in_blocks(&self, live: bool, block: usize) -> (Batch, Vec<Transaction>) {
        let mut session = Self::session(live);
        self.file.chunks(block.min(self.file.len())).for_each(|block| session.feed_capture(0, block, false));
        let early = session.take().transactions.clone();
        let mut session = Self::session(live);
        self.file.chunks(block.min(self.file.len())).for_each(|block| session.feed_capture(0, block, false));
        session.feed_capture(0, &[], true);
        session.flush();
        (session.take(), early)
    }

    /// The rows, where all blocks but the first are read before the session takes what was in them.
    pub fn decode_read_ahead(&self, block: usize) -> Batch {
        let mut session = Self::session(false);
        let mut blocks = self.file.chunks(block);
        session.feed_capture(0, blocks.next().unwrap(), false);
        let mut reader = session.lend_capture_reader(0).unwrap();
        let read: Vec<_> = blocks.map(|block| reader.read(block)).collect();
        for block in &read {
            session.feed_read(block);
        }
        session.take_back(reader);
        session.feed_capture(0, &[], true);
        session.flush();
        session.take()
    }

    fn session(live: bool) -> Session {
        let wanted = WantedTables { frames: true, transactions: true, findings: true };
        let mut session = Session::new(std::sync::Arc::default(), wanted, live, None);
        let options = CaptureOptions { source: "x".into(), ports: Ports::default(), mode: None, line: None, rule: None };
        session.add_capture(options);
        session
    }
}

/// Milliseconds of a time in a row.
pub fn ms(time: Option<i64>) -> Option<i64> {
    time.map(|ns| ns / MS)
}
