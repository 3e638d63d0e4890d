//! One client of a server: its request, then the stream, as fast as it takes it.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::hub::{Hub, Position};
use super::request::{answer, answer_silence, refuse, Answer, Terms, MAX_REQUEST_BYTES};

/// A client that has sent nothing by then wants the plain stream; with a token, it has to ask until `REQUEST_TIME`.
const SILENCE: Duration = Duration::from_millis(300);
const REQUEST_TIME: Duration = Duration::from_secs(5);
/// A client that takes nothing for so long, though there is something, is disconnected.
const STALL: Duration = Duration::from_secs(60);
/// How often a timed stream says how far time has advanced while the line is silent.
const BEAT: Duration = Duration::from_millis(500);

/// What a client is doing.
enum Phase {
    Asking {
        request: Vec<u8>,
        since: Instant,
    },
    Streaming {
        position: Position,
        is_timed: bool,
    },
    /// It gets the rest of its answer, a page or a refusal, then the end.
    Ending,
}

/// A connected client.
pub struct Client {
    stream: TcpStream,
    /// Its address.
    pub name: String,
    phase: Phase,
    /// What is being written, and how much of it is.
    out: Vec<u8>,
    written: usize,
    last_progress: Instant,
}

/// Why a client has gone.
#[derive(Debug)]
pub enum Gone {
    /// It has its page, was refused, or has asked for nothing.
    Answered,
    /// It has ended the connection.
    Left,
    /// It took nothing for [`STALL`].
    Stalled,
}

impl Client {
    /// A client that has just been accepted.
    pub fn new(stream: TcpStream, name: String) -> io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        let now = Instant::now();
        let phase = Phase::Asking { request: Vec::new(), since: now };
        Ok(Self { stream, name, phase, out: Vec::new(), written: 0, last_progress: now })
    }

    /// Does what can be done at this moment. Whether its stream has just begun.
    pub fn serve(&mut self, hub: &Hub, terms: Terms<'_>, has_room: bool) -> Result<bool, Gone> {
        let mut begins = false;
        if let Phase::Asking { .. } = self.phase {
            self.ask(hub, terms, has_room)?;
            begins = self.is_streaming();
        } else if self.receive()?.is_none() {
            return Err(Gone::Left);
        }
        loop {
            self.fill(hub);
            if self.out.is_empty() {
                return Ok(begins);
            }
            if !self.write()? {
                return if self.last_progress.elapsed() > STALL { Err(Gone::Stalled) } else { Ok(begins) };
            }
            if let Phase::Ending = self.phase {
                return Err(Gone::Answered);
            }
        }
    }

    /// Whether it gets the stream.
    pub fn is_streaming(&self) -> bool {
        matches!(self.phase, Phase::Streaming { .. })
    }

    /// Whether nothing is left to be written.
    pub fn is_served(&self, hub: &Hub) -> bool {
        let Phase::Streaming { position, .. } = &self.phase else { return true };
        self.out.is_empty() && hub.is_at_end(position)
    }

    /// Bytes of the line that it did not get.
    pub fn lost(&self) -> u64 {
        if let Phase::Streaming { position, .. } = &self.phase {
            position.lost
        } else {
            0
        }
    }

    /// Looks at its request, and begins the answer.
    fn ask(&mut self, hub: &Hub, terms: Terms<'_>, has_room: bool) -> Result<(), Gone> {
        let Some(more) = self.receive()? else { return Err(Gone::Answered) };
        let Phase::Asking { request, since } = &mut self.phase else { return Ok(()) };
        request.extend_from_slice(&more);
        let found = if !request.is_empty() {
            answer(request, terms)
        } else if since.elapsed() > SILENCE {
            answer_silence(terms)
        } else {
            None
        };
        match found {
            None if since.elapsed() > REQUEST_TIME => Err(Gone::Answered),
            None => Ok(()),
            Some(Answer::Stream { head, is_timed }) if has_room => {
                self.out.extend_from_slice(head.as_bytes());
                let position = hub.join(&mut self.out);
                if is_timed {
                    hub.beat(&position, &mut self.out);
                }
                self.phase = Phase::Streaming { position, is_timed };
                self.last_progress = Instant::now();
                Ok(())
            }
            Some(Answer::Page { head }) => {
                self.out.extend_from_slice(head.as_bytes());
                self.out.extend_from_slice(terms.page.unwrap_or_default());
                self.phase = Phase::Ending;
                self.last_progress = Instant::now();
                Ok(())
            }
            Some(other) => {
                let busy = refuse("503 Service Unavailable", "");
                if let Answer::Refused(text) = if let Answer::Refused(_) = other { other } else { busy } {
                    self.out.extend_from_slice(text.as_bytes());
                }
                self.phase = Phase::Ending;
                Ok(())
            }
        }
    }

    /// What it has sent; `None` if it has ended the connection.
    fn receive(&mut self) -> Result<Option<Vec<u8>>, Gone> {
        let mut bytes = [0; MAX_REQUEST_BYTES];
        match self.stream.read(&mut bytes) {
            Ok(0) => Ok(None),
            Ok(length) => Ok(Some(bytes[..length].to_vec())),
            Err(error) if is_later(&error) => Ok(Some(Vec::new())),
            Err(_) => Err(Gone::Left),
        }
    }

    /// Takes the next blocks once the ones before are written.
    fn fill(&mut self, hub: &Hub) {
        let Phase::Streaming { position, is_timed } = &mut self.phase else { return };
        if !self.out.is_empty() {
            return;
        }
        hub.read(position, &mut self.out);
        if self.out.is_empty() && *is_timed && self.last_progress.elapsed() > BEAT {
            hub.beat(position, &mut self.out);
        }
        if !self.out.is_empty() && self.last_progress.elapsed() > BEAT {
            // The time before there was something to write is no stall.
            self.last_progress = Instant::now();
        }
    }

    /// Writes what the client takes; whether that is all.
    fn write(&mut self) -> Result<bool, Gone> {
        while self.written < self.out.len() {
            match self.stream.write(&self.out[self.written..]) {
                Ok(0) => return Err(Gone::Left),
                Ok(more) => {
                    self.written += more;
                    self.last_progress = Instant::now();
                }
                Err(error) if is_later(&error) => return Ok(false),
                Err(_) => return Err(Gone::Left),
            }
        }
        self.out.clear();
        self.written = 0;
        Ok(true)
    }
}

fn is_later(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}
