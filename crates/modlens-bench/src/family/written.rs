//! Writes traffic as a recording, with the truth about it.

use std::io::{self, Write};

use crate::checksum::{ascii, rtu};
use crate::family::kinds::{Form, Kind};
use crate::family::traffic::{Exchange, Outcome, Traffic};
use crate::sim::bulk::LINE;

const START_NS: i64 = 1_700_000_000_000_000_000;
/// Silences before a request and before a response, and how much longer it is after a request without one, in ns.
const SILENCES_NS: [i64; 2] = [5_000_000, 3_000_000];
const TIMEOUT_NS: i64 = 200_000_000;

/// What is in a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Truth {
    /// Frames.
    pub frames: u64,
    /// Requests that were answered, refused and not answered.
    pub requests: [u64; 3],
    /// Registers in the responses to functions 3 and 4.
    pub registers: u64,
    /// The sum of their values.
    pub register_sum: u64,
}

impl Truth {
    /// Returns it as a JSON object.
    pub fn json(&self) -> String {
        let [ok, exception, no_response] = self.requests;
        format!(
            "{{\"frames\": {}, \"ok\": {ok}, \"exception\": {exception}, \"no_response\": {no_response}, \"registers\": {}, \
             \"register_sum\": {}}}",
            self.frames, self.registers, self.register_sum
        )
    }

    fn count(&mut self, exchange: &Exchange) {
        self.frames += 1 + u64::from(exchange.outcome != Outcome::Silent);
        self.requests[exchange.outcome as usize] += 1;
        if exchange.outcome == Outcome::Answered && matches!(exchange.request[1], 3 | 4) {
            let words = exchange.response[3..].chunks_exact(2).map(|word| u64::from(u16::from_be_bytes([word[0], word[1]])));
            self.registers += words.len() as u64;
            self.register_sum += words.sum::<u64>();
        }
    }
}

/// Writes so many bytes of RTU frames of this kind, in its form; returns what they contain.
pub fn write(kind: &Kind, seed: u64, bytes: usize, out: &mut impl Write) -> io::Result<Truth> {
    let mut traffic = Traffic::new(kind, seed);
    let mut writer = Writer::new(kind.form);
    let (mut truth, mut left) = (Truth::default(), bytes as i64);
    out.write_all(&writer.head())?;
    while left > 0 {
        let exchange = traffic.next();
        truth.count(&exchange);
        for (side, body) in [&exchange.request, &exchange.response].into_iter().enumerate() {
            if !body.is_empty() {
                left -= body.len() as i64 + 2;
                out.write_all(writer.message(side, body))?;
            }
        }
        writer.now += if exchange.outcome == Outcome::Silent { TIMEOUT_NS } else { 0 };
    }
    Ok(truth)
}

/// Makes the bytes of a recording.
struct Writer {
    form: Form,
    now: i64,
    /// The number of requests so far.
    number: u32,
    /// Bytes that each side of each connection has sent.
    sent: Vec<[u32; 2]>,
    buffer: Vec<u8>,
}

impl Writer {
    fn new(form: Form) -> Self {
        let connections = if let Form::Capture(connections) = form { connections } else { 0 };
        Self { form, now: START_NS, number: 0, sent: vec![[1, 1]; connections.into()], buffer: Vec::new() }
    }

    /// What the file begins with: that of a classic capture of Ethernet, in microseconds (draft-ietf-opsawg-pcap).
    fn head(&self) -> Vec<u8> {
        let is_capture = matches!(self.form, Form::Capture(_));
        let words: &[u32] = if is_capture { &[0xA1B2_C3D4, 0x0004_0002, 0, 0, 262_144, 1] } else { &[] };
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }

    /// Returns a message as the recording has it; side 0 asks.
    fn message(&mut self, side: usize, body: &[u8]) -> &[u8] {
        let frame = rtu(body[0], &body[1..]);
        self.number += u32::from(side == 0);
        self.now += SILENCES_NS[side] + (frame.len() as f64 * LINE.char_ns()) as i64;
        self.buffer.clear();
        let (seconds, micros) = (self.now / 1_000_000_000, self.now % 1_000_000_000 / 1000);
        match self.form {
            Form::Rtu => self.buffer.extend(frame),
            Form::Ascii => self.buffer.extend(ascii(body[0], &body[1..], false)),
            Form::Log => {
                write!(self.buffer, "{seconds}.{micros:06}").expect("a buffer can grow");
                for byte in frame {
                    write!(self.buffer, " {byte:02x}").expect("a buffer can grow");
                }
                self.buffer.push(b'\n');
            }
            Form::Capture(connections) => self.packet(side, self.number % u32::from(connections), body),
        }
        &self.buffer
    }

    /// Appends a packet with Ethernet, IPv4, TCP and MBAP headers (RFC 894, 791, 9293; messaging on TCP/IP, 3.1.3).
    fn packet(&mut self, side: usize, connection: u32, body: &[u8]) {
        let length = 54 + 6 + body.len();
        let (seconds, micros) = (self.now / 1_000_000_000, self.now % 1_000_000_000 / 1000);
        for word in [seconds as u32, micros as u32, length as u32, length as u32] {
            self.buffer.extend(word.to_le_bytes());
        }
        let sent = &mut self.sent[connection as usize];
        let (mine, other) = (sent[side], sent[1 - side]);
        sent[side] = mine.wrapping_add(6 + body.len() as u32);
        let ends = [([10, 0, 0, 1], 50_000 + connection as u16), ([10, 0, 0, 2], 502)];
        let ((source, port), (target, to)) = (ends[side], ends[1 - side]);
        self.buffer.extend([[0; 6], [0; 6]].concat());
        self.buffer.extend([8, 0, 0x45, 0]);
        self.buffer.extend(((length - 14) as u16).to_be_bytes());
        self.buffer.extend((self.number as u16).to_be_bytes());
        self.buffer.extend([0x40, 0, 64, 6, 0, 0]);
        self.buffer.extend([source, target].concat());
        self.buffer.extend([port, to].iter().flat_map(|port| port.to_be_bytes()));
        self.buffer.extend([mine, other].iter().flat_map(|number| number.to_be_bytes()));
        self.buffer.extend([0x50, 0x18, 0x20, 0, 0, 0, 0, 0]);
        self.buffer.extend((self.number as u16).to_be_bytes());
        self.buffer.extend([0, 0]);
        self.buffer.extend((body.len() as u16).to_be_bytes());
        self.buffer.extend_from_slice(body);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::kinds::{named, KINDS};

    /// Frames are counted, and no megabyte of them is there again.
    #[test]
    fn nothing_repeats() {
        for kind in KINDS {
            let mut bytes = Vec::new();
            let truth = write(kind, 1, 200_000, &mut bytes).unwrap();
            assert!(truth.frames > 1000, "{}: {truth:?}", kind.name);
            let (first, second) = bytes.split_at(bytes.len() / 2);
            let is_new = |block: &[u8]| !first.windows(block.len()).any(|other| other == block);
            assert!(second.chunks_exact(2000).step_by(10).all(is_new), "{}", kind.name);
        }
    }

    /// The first exchange of a capture, by hand: a record header, 14 + 20 + 20 bytes of headers, seven of MBAP.
    #[test]
    fn a_capture_has_a_packet_a_message() {
        let mut bytes = Vec::new();
        write(named("capture").unwrap(), 1, 100, &mut bytes).unwrap();
        let length = u32::from_le_bytes(bytes[32..36].try_into().unwrap()) as usize;
        assert_eq!(length, 14 + 20 + 20 + 6 + 6);
        assert_eq!(bytes[40 + 54..40 + 60], [0, 1, 0, 0, 0, 6]);
    }
}
