//! A publisher by MQTT 3.1.1 (OASIS standard, 29 October 2014): transactions with quality of service 1, the row of the day
//! and the state as retained messages, the latter with a last will. It subscribes to nothing: a listener takes no commands.
//! The topics are those of `modlens_writers::mqtt`.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use modlens_writers::mqtt::level;

use crate::broker::{Broker, Stream};

/// Messages that wait for the broker; beyond it the oldest go.
const MAX_WAITING: usize = 100_000;
/// Messages that are sent before the first of them is confirmed.
const IN_FLIGHT: usize = 50;
const KEEP_ALIVE: Duration = Duration::from_secs(30);
const LAST_DELIVERY: Duration = Duration::from_secs(3);
const RETRIES: [Duration; 4] = [Duration::from_secs(1), Duration::from_secs(2), Duration::from_secs(5), Duration::from_secs(15)];

// Control packet types with their flags (section 2.2).
const CONNECT: u8 = 0x10;
const CONNACK: u8 = 0x20;
const PUBLISH: u8 = 0x30;
const PUBACK: u8 = 0x40;
const PINGREQ: u8 = 0xC0;
const DISCONNECT: u8 = 0xE0;
const QOS_1: u8 = 0x02;
const RETAIN: u8 = 0x01;
const DUPLICATE: u8 = 0x08;

struct Message {
    topic: String,
    payload: Vec<u8>,
    /// The broker keeps it for those who subscribe later.
    is_retained: bool,
    /// The packet identifier under which it was sent; 0 if it was not.
    identifier: u16,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Message>,
    dropped: usize,
    is_closing: bool,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Publishes in a thread of its own; nothing here waits for the network.
pub struct Publisher {
    shared: Arc<Shared>,
    transaction: String,
    day: String,
    thread: JoinHandle<()>,
}

impl Publisher {
    /// Starts the thread, which connects again and again until the end.
    pub fn start(broker: Broker, bus: String) -> io::Result<Self> {
        let [transaction, day] = ["transaction", "day"].map(|what| broker.address.of_bus(&bus, what));
        let shared = Arc::new(Shared::default());
        let client = Client { broker, bus, shared: Arc::clone(&shared), next_identifier: 0 };
        let thread = std::thread::Builder::new().name("modlens mqtt".into()).spawn(move || client.run())?;
        Ok(Self { shared, transaction, day, thread })
    }

    /// Publishes a transaction.
    pub fn transaction(&self, json: &[u8]) {
        self.send(&self.transaction, json, false);
    }

    /// Publishes the row of a day so far.
    pub fn day(&self, json: &[u8]) {
        self.send(&self.day, json, true);
    }

    fn send(&self, topic: &str, json: &[u8], is_retained: bool) {
        let mut state = self.shared.state();
        if state.waiting.len() >= MAX_WAITING {
            state.waiting.pop_front();
            state.dropped += 1;
        }
        state.waiting.push_back(Message { topic: topic.to_owned(), payload: json.to_vec(), is_retained, identifier: 0 });
        self.shared.changed.notify_all();
    }

    /// Ends; gives the number of messages that were not delivered.
    pub fn close(self) -> usize {
        self.shared.state().is_closing = true;
        self.shared.changed.notify_all();
        let _ = self.thread.join();
        let state = self.shared.state();
        state.waiting.len() + state.dropped
    }
}

/// The thread's side.
struct Client {
    broker: Broker,
    bus: String,
    shared: Arc<Shared>,
    next_identifier: u16,
}

impl Client {
    fn run(mut self) {
        let mut failures = 0;
        let mut said = String::new();
        loop {
            match self.session(&mut failures) {
                Ok(()) => return,
                Err(error) => {
                    let text = error.to_string();
                    if failures == 0 || text != said {
                        crate::outlet::say(&format!("{}: {}: {text}", self.bus, self.broker.address));
                    }
                    said = text;
                }
            }
            let pause = RETRIES[failures.min(RETRIES.len() - 1)];
            failures += 1;
            if self.closes_within(pause) {
                return;
            }
        }
    }

    /// Waits; whether the end came meanwhile.
    fn closes_within(&self, pause: Duration) -> bool {
        let until = Instant::now() + pause;
        let mut state = self.shared.state();
        while !state.is_closing {
            let Some(left) = until.checked_duration_since(Instant::now()) else { return false };
            state = self.shared.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    /// One connection, to its loss (an error) or the end of the tap.
    fn session(&mut self, failures: &mut usize) -> io::Result<()> {
        let mut stream = self.broker.connect()?;
        let status = self.broker.address.status();
        stream.write_all(&connect_packet(&self.broker, &self.bus, &status))?;
        stream.flush()?;
        let mut incoming = Incoming::default();
        let answer = incoming.wait_for(CONNACK, stream.as_mut())?;
        if let Some(code @ 1..) = answer.get(1) {
            return Err(io::Error::other(refusal(*code)));
        }
        *failures = 0;
        crate::outlet::say(&format!("{}: {}: connected", self.bus, self.broker.address));
        stream.write_all(&publish(&status, b"online", RETAIN, None))?;
        for message in &mut self.shared.state().waiting {
            // The broker has forgotten what it had not confirmed: the session is a clean one.
            message.identifier = 0;
        }
        self.deliver(stream.as_mut(), &mut incoming, &status)
    }

    fn deliver(&mut self, stream: &mut dyn Stream, incoming: &mut Incoming, status: &str) -> io::Result<()> {
        let mut last_sent = Instant::now();
        let mut end: Option<Instant> = None;
        loop {
            if self.send_waiting(stream)? {
                last_sent = Instant::now();
            }
            if last_sent.elapsed() >= KEEP_ALIVE / 2 {
                stream.write_all(&[PINGREQ, 0])?;
                last_sent = Instant::now();
            }
            stream.flush()?;
            while let Some((kind, body)) = incoming.next(stream)? {
                if kind == PUBACK && body.len() >= 2 {
                    let confirmed = u16::from_be_bytes([body[0], body[1]]);
                    self.shared.state().waiting.retain(|message| message.identifier != confirmed);
                }
            }
            let (is_closing, is_empty) = {
                let state = self.shared.state();
                (state.is_closing, state.waiting.is_empty())
            };
            if is_closing {
                let until = *end.get_or_insert_with(|| Instant::now() + LAST_DELIVERY);
                if is_empty || Instant::now() >= until {
                    stream.write_all(&publish(status, b"offline", RETAIN, None))?;
                    stream.write_all(&[DISCONNECT, 0])?;
                    return stream.flush();
                }
            }
        }
    }

    /// Sends what may be sent; whether that was something.
    fn send_waiting(&mut self, stream: &mut dyn Stream) -> io::Result<bool> {
        let mut packets = Vec::new();
        for message in self.shared.state().waiting.iter_mut().take(IN_FLIGHT) {
            if message.identifier == 0 {
                self.next_identifier = self.next_identifier.checked_add(1).unwrap_or(1);
                message.identifier = self.next_identifier;
                let flags = if message.is_retained { QOS_1 | RETAIN } else { QOS_1 };
                packets.extend(publish(&message.topic, &message.payload, flags, Some(message.identifier)));
            }
        }
        stream.write_all(&packets)?;
        Ok(!packets.is_empty())
    }
}

/// What the broker has sent and nobody has read.
#[derive(Default)]
struct Incoming {
    bytes: Vec<u8>,
}

impl Incoming {
    /// The next packet, if there is a whole one: its type without flags, and what follows its length.
    fn next(&mut self, stream: &mut dyn Stream) -> io::Result<Option<(u8, Vec<u8>)>> {
        if let Some(packet) = self.cut() {
            return Ok(Some(packet));
        }
        let mut buffer = [0; 4096];
        match stream.read(&mut buffer) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(length) => {
                self.bytes.extend_from_slice(&buffer[..length]);
                Ok(self.cut())
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn wait_for(&mut self, wanted: u8, stream: &mut dyn Stream) -> io::Result<Vec<u8>> {
        let until = Instant::now() + KEEP_ALIVE;
        while Instant::now() < until {
            match self.next(stream)? {
                Some((kind, body)) if kind == wanted => return Ok(body),
                _ => {}
            }
        }
        Err(ErrorKind::TimedOut.into())
    }

    /// Cuts off the first packet if it is whole (2.2.3).
    fn cut(&mut self) -> Option<(u8, Vec<u8>)> {
        let mut length = 0usize;
        for at in 1..5 {
            let byte = *self.bytes.get(at)?;
            length |= usize::from(byte & 0x7F) << (7 * (at - 1));
            if byte & 0x80 == 0 {
                let end = at + 1 + length;
                if self.bytes.len() < end {
                    return None;
                }
                let packet: Vec<u8> = self.bytes.drain(..end).collect();
                return Some((packet[0] & 0xF0, packet[at + 1..].to_vec()));
            }
        }
        None
    }
}

/// CONNECT with a clean session and `offline` as the last will (3.1).
fn connect_packet(broker: &Broker, bus: &str, status: &str) -> Vec<u8> {
    let mut flags = 0b0010_0110; // will retained, will, clean session
    let mut body = Vec::new();
    push_text("MQTT", &mut body);
    body.push(4);
    let at = body.len();
    body.extend([0, 0, KEEP_ALIVE.as_secs() as u8]);
    push_text(&format!("modlens-tap-{}-{}", std::process::id(), level(bus)), &mut body);
    push_text(status, &mut body);
    push_text("offline", &mut body);
    for (text, flag) in [(&broker.address.user, 0x80), (&broker.address.password, 0x40)] {
        if let Some(text) = text {
            flags |= flag;
            push_text(text, &mut body);
        }
    }
    body[at] = flags;
    packet(CONNECT, &body)
}

/// PUBLISH (3.3), with an identifier where the broker has to confirm it.
fn publish(topic: &str, payload: &[u8], flags: u8, identifier: Option<u16>) -> Vec<u8> {
    debug_assert_eq!(flags & DUPLICATE, 0, "a new session has no duplicates");
    let mut body = Vec::with_capacity(topic.len() + payload.len() + 4);
    push_text(topic, &mut body);
    if let Some(identifier) = identifier {
        body.extend(identifier.to_be_bytes());
    }
    body.extend_from_slice(payload);
    packet(PUBLISH | flags, &body)
}

/// A packet with its length in groups of seven bits (2.2.3).
fn packet(head: u8, body: &[u8]) -> Vec<u8> {
    let mut out = vec![head];
    let mut length = body.len();
    loop {
        let low = (length & 0x7F) as u8;
        length >>= 7;
        out.push(if length > 0 { low | 0x80 } else { low });
        if length == 0 {
            break;
        }
    }
    out.extend_from_slice(body);
    out
}

/// A string with its length (1.5.3).
fn push_text(text: &str, out: &mut Vec<u8>) {
    let bytes = &text.as_bytes()[..text.len().min(usize::from(u16::MAX))];
    out.extend((bytes.len() as u16).to_be_bytes());
    out.extend_from_slice(bytes);
}

/// Why the broker does not accept the connection (3.2.2.3).
fn refusal(code: u8) -> &'static str {
    match code {
        1 => "it does not speak MQTT 3.1.1",
        2 => "it does not accept the client's name",
        3 => "it is not available",
        4 => "wrong user or password",
        5 => "not authorized",
        _ => "it refuses the connection",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packets_are_laid_out_as_the_standard_says() {
        // Figure 3.11: topic a/b, identifier 10.
        assert_eq!(publish("a/b", b"x", QOS_1, Some(10)), [0x32, 8, 0, 3, b'a', b'/', b'b', 0, 10, b'x']);
        // Table 2.4: 321 bytes are C1 02.
        assert_eq!(packet(PUBLISH, &[0; 321])[..3], [0x30, 0xC1, 0x02]);
    }

    #[test]
    fn packets_are_cut_where_they_end() {
        let mut incoming = Incoming { bytes: vec![0x20, 2, 0, 0, 0x40, 2, 0] };
        assert_eq!(incoming.cut(), Some((CONNACK, vec![0, 0])));
        assert_eq!(incoming.cut(), None);
        incoming.bytes.push(10);
        assert_eq!(incoming.cut(), Some((PUBACK, vec![0, 10])));
    }
}
