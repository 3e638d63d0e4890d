//! A line that another tap serves (`serve`): `modlens://host:port/BUS`.
//!
//! Reads keep the times, marks and losses that the other tap has given them, so that both decode the same rows. Where the
//! clocks of the two computers differ by more than [`MAX_SKEW_NS`], all times are shifted by the difference.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use modlens_pcapng::recording::PortRead;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;
use modlens_readers::pcap::metadata::PortMetadata;
use modlens_readers::pcap::{Capture, Event, Ports};

use crate::clock::Moment;
use crate::inbox::Inbox;
use crate::port::{reason, Port};
use crate::serve::request::{MAX_REQUEST_BYTES, TIMED_PATH};

/// The second line of a bus that is tapped on two, as in [`PortMetadata::line`].
const LINE_B: u8 = 2;

/// What the name of such a port begins with.
pub const SCHEME: &str = "modlens://";

/// Clocks that differ by less are taken for the same: the difference may be the way through the network.
const MAX_SKEW_NS: Ns = 2_000_000_000;
const CONNECT: Duration = Duration::from_secs(5);
/// A tap that serves a line sends its time twice a second. One that is silent for so long is gone.
const SILENCE: Duration = Duration::from_secs(20);
/// How long it takes until the ports of a tap are known that has found its line settings.
const DESCRIBE: Duration = Duration::from_millis(1500);

/// A port of another tap.
pub struct Remote {
    stream: TcpStream,
    decoder: Option<Decoder>,
    thread: Option<JoinHandle<()>>,
    line: Option<LineSettings>,
    has_two_lines: bool,
    advice: String,
}

impl Remote {
    /// Connects, and waits for the description of the ports.
    pub fn open(name: &str, token: Option<&str>) -> Result<Self, String> {
        let place = name.strip_prefix(SCHEME).unwrap_or(name);
        let (host, bus) = place.split_once('/').unwrap_or((place, ""));
        let mut stream = connect(host)?;
        let rest = request(&mut stream, host, token)?;
        let mut decoder = Decoder::new(bus);
        let mut heard = decoder.push(&rest);
        let until = Instant::now() + DESCRIBE;
        stream.set_read_timeout(Some(Duration::from_millis(100))).map_err(|error| reason(&error, None))?;
        while !decoder.knows_its_lines() && Instant::now() < until {
            heard.append(&mut decoder.read(&mut stream)?);
        }
        decoder.check()?;
        decoder.early = heard;
        stream.set_read_timeout(Some(SILENCE)).map_err(|error| reason(&error, None))?;
        let line = decoder.ours().next().and_then(|port| port.settings);
        let advice = skew_advice(decoder.shift.unwrap_or_default());
        let has_two_lines = decoder.has_two_lines();
        decoder.serves_two_lines = has_two_lines;
        Ok(Self { stream, decoder: Some(decoder), thread: None, line, has_two_lines, advice })
    }
}

impl Port for Remote {
    fn listen(&mut self, inbox: &Arc<Inbox>, number: usize) -> Result<(), String> {
        let Some(decoder) = self.decoder.take() else { return Err("it is read already".into()) };
        let stream = self.stream.try_clone().map_err(|error| reason(&error, None))?;
        let inbox = Arc::clone(inbox);
        let run = move || pass_on(decoder, stream, &inbox, number);
        let thread = std::thread::Builder::new().name("modlens remote".into()).spawn(run);
        self.thread = Some(thread.map_err(|error| reason(&error, None))?);
        Ok(())
    }

    fn set_line(&mut self, _: LineSettings) -> Result<(), String> {
        Ok(())
    }

    fn takes_line_settings(&self) -> bool {
        false
    }

    fn line(&self) -> Option<LineSettings> {
        self.line
    }

    fn has_two_lines(&self) -> bool {
        self.has_two_lines
    }

    fn advice(&self) -> String {
        self.advice.clone()
    }

    fn stop(&mut self) {
        let _ = self.stream.shutdown(Shutdown::Both);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Remote {
    fn drop(&mut self) {
        self.stop();
    }
}

/// The thread: passes reads to the inbox until the stream ends.
fn pass_on(mut decoder: Decoder, mut stream: TcpStream, inbox: &Inbox, number: usize) {
    let mut heard = Ok(std::mem::take(&mut decoder.early));
    while let Ok(reads) = heard {
        for read in reads {
            let Heard { line, time, bytes, errors, hole } = read;
            let number = number + usize::from(line == LINE_B);
            inbox.put_dated(number, &PortRead { time, bytes: &bytes, errors: &errors, hole });
        }
        if let Some(time) = decoder.time {
            inbox.tell(number, time);
        }
        heard = decoder.read(&mut stream);
        if heard.is_ok() && (decoder.check().is_err() || decoder.has_two_lines() != decoder.serves_two_lines) {
            break;
        }
    }
    if let Some(time) = decoder.time.filter(|_| decoder.serves_two_lines) {
        inbox.put_dated(number + 1, &PortRead { time, hole: true, ..PortRead::default() });
    }
    inbox.put(number, None);
}

fn connect(host: &str) -> Result<TcpStream, String> {
    let addresses = host.to_socket_addrs().map_err(|_| "write host and port: modlens://192.168.1.50:4010".to_owned())?;
    let mut why = "the name has no address".to_owned();
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => {
                stream.set_read_timeout(Some(SILENCE)).map_err(|error| reason(&error, None))?;
                return Ok(stream);
            }
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {
                why = "the connection was refused; is modlens tap --serve running there?".into();
            }
            Err(error) => why = format!("cannot be reached: {error}"),
        }
    }
    Err(why)
}

/// Asks for the stream; returns what has come of it.
fn request(stream: &mut TcpStream, host: &str, token: Option<&str>) -> Result<Vec<u8>, String> {
    let secret = token.map_or(String::new(), |token| format!("Authorization: Bearer {token}\r\n"));
    let asked = format!("GET {TIMED_PATH} HTTP/1.1\r\nHost: {host}\r\n{secret}\r\n");
    stream.write_all(asked.as_bytes()).map_err(|error| reason(&error, None))?;
    let mut answer = Vec::new();
    let end = loop {
        let mut block = [0; 1024];
        let length = stream.read(&mut block).map_err(|error| format!("no answer: {error}"))?;
        answer.extend_from_slice(&block[..length]);
        if let Some(at) = answer.windows(4).position(|four| four == b"\r\n\r\n") {
            break at + 4;
        }
        if length == 0 || answer.len() > MAX_REQUEST_BYTES {
            return Err("there is no modlens tap --serve at this address".into());
        }
    };
    let head = String::from_utf8_lossy(&answer[..end]).into_owned();
    let status = head.split_once(' ').map_or("", |(_, status)| status.lines().next().unwrap_or_default());
    match (head.starts_with("HTTP/1."), status.get(..3)) {
        (true, Some("200")) => Ok(answer.split_off(end)),
        (true, Some("401")) => Err("the token is missing or wrong: put that of the other tap into MODLENS_SERVE_TOKEN".into()),
        (true, Some("503")) => Err("it serves as many clients as it may".into()),
        _ => Err("there is no modlens tap --serve at this address".into()),
    }
}

/// What the user should know of clocks that differ.
fn skew_advice(shift: Ns) -> String {
    if shift == 0 {
        return String::new();
    }
    let seconds = shift as f64 / 1e9;
    format!("its clock differs from this computer's by {seconds:.1} s; times are those of this computer")
}

/// One read of the other tap.
struct Heard {
    line: u8,
    time: Ns,
    bytes: Vec<u8>,
    errors: Vec<u32>,
    hole: bool,
}

/// Takes the reads of one bus out of the stream.
struct Decoder {
    capture: Capture,
    functions: &'static Functions,
    /// The bus that is wanted; empty for the only one.
    wanted: String,
    /// The ports of that bus which have been heard of: the first, and what differs from it in bus or line.
    known: Vec<PortMetadata>,
    /// What the port said of its lines when it was opened.
    serves_two_lines: bool,
    /// What is added to all times.
    shift: Option<Ns>,
    /// The newest time that the other tap has sent.
    time: Option<Ns>,
    /// Reads that came before the port was listened to.
    early: Vec<Heard>,
}

impl Decoder {
    fn new(wanted: &str) -> Self {
        let capture = Capture::new(Ports::default());
        let (functions, wanted) = (Functions::embedded(), wanted.to_owned());
        Self {
            capture,
            functions,
            wanted,
            known: Vec::new(),
            serves_two_lines: false,
            shift: None,
            time: None,
            early: Vec::new(),
        }
    }

    /// Reads what has come; an empty list after a timeout of the stream.
    fn read(&mut self, stream: &mut TcpStream) -> Result<Vec<Heard>, String> {
        let mut block = [0; 1 << 14];
        match stream.read(&mut block) {
            Ok(0) => Err("the other tap has ended the connection".into()),
            Ok(length) => Ok(self.push(&block[..length])),
            Err(error) if stream.read_timeout().is_ok_and(|most| most < Some(SILENCE)) && is_timeout(&error) => Ok(Vec::new()),
            Err(error) => Err(reason(&error, None)),
        }
    }

    /// Takes a block of the stream; the reads of the bus in it.
    fn push(&mut self, block: &[u8]) -> Vec<Heard> {
        let Self { capture, functions, wanted, known, shift, time, .. } = self;
        let mut heard = Vec::new();
        let now = Moment::now().wall;
        capture.push(functions, block, &mut |event| {
            let (by, at) = match &event {
                Event::Time(at, by) | Event::Line { by, time: Some(at), .. } => (*by, *at),
                _ => return,
            };
            let Some(port) = by.written_by_modlens.as_ref() else { return };
            if !known.iter().any(|one| one.name == port.name && one.line == port.line) {
                known.push(port.clone());
            }
            let shift = *shift.get_or_insert_with(|| Some(now - at).filter(|by| by.abs() > MAX_SKEW_NS).unwrap_or_default());
            *time = (*time).max(Some(at + shift));
            if let Event::Line { content, errors, .. } = event {
                if wanted.is_empty() || *wanted == port.name {
                    let (bytes, hole) = (content.bytes.to_vec(), content.follows_loss);
                    heard.push(Heard { line: port.line, time: at + shift, bytes, errors, hole });
                }
            }
        });
        heard
    }

    /// The ports of the bus.
    fn ours(&self) -> impl Iterator<Item = &PortMetadata> {
        self.known.iter().filter(|port| self.wanted.is_empty() || port.name == self.wanted)
    }

    /// Whether the bus is tapped on two lines, as far as is known.
    fn has_two_lines(&self) -> bool {
        self.ours().any(|port| port.line == LINE_B)
    }

    /// Whether all lines of the bus are known.
    fn knows_its_lines(&self) -> bool {
        self.ours().any(|port| port.line == 0) || self.ours().any(|port| port.line == LINE_B)
    }

    /// Checks that the reads are those of one bus.
    fn check(&self) -> Result<(), String> {
        let buses: std::collections::BTreeSet<&str> = self.known.iter().map(|port| port.name.as_str()).collect();
        let names = buses.iter().copied().collect::<Vec<_>>().join(", ");
        if self.wanted.is_empty() && buses.len() > 1 {
            return Err(format!("it serves several buses; add the name of one to the address: {names}"));
        }
        if self.ours().next().is_none() && !buses.is_empty() {
            return Err(format!("it serves no bus {}; there are {names}", self.wanted));
        }
        Ok(())
    }
}

fn is_timeout(error: &std::io::Error) -> bool {
    matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut | std::io::ErrorKind::Interrupted)
}
