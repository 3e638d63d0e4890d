//! Feeds a session with a recording whose bytes come block by block.

use std::sync::Arc;

use modlens_engine::records::Bus;
use modlens_engine::session::{BusOptions, CaptureOptions, Session};
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};
use modlens_readers::chunk::Chunk;
use modlens_readers::pcap::Ports;
use modlens_readers::text::{unread_says, ClockSettings, Dialects, Reader, Said};
use serde_json::{json, Value as Json};

use crate::format::{decide, Detection, Refusal, SAMPLE_BYTES};

/// What is known of a recording before it is read.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Its name, which its bus is named after.
    pub name: String,
    /// The format that the user named.
    pub format: Option<String>,
    /// How it is framed; `None` lets the engine find out.
    pub mode: Option<Mode>,
    /// The settings of its line.
    pub line: Option<LineSettings>,
    /// The ports on which a capture is searched for Modbus.
    pub ports: Option<Vec<u16>>,
    /// What its times mean.
    pub clock: ClockSettings,
    /// It is still being made: its first bytes are not waited for until they are a whole sample.
    pub is_live: bool,
}

/// Where the bytes of a recording go.
enum Target {
    Bus(usize),
    Text(usize),
    Capture(usize),
}

/// A recording that is being read: its first bytes are held until they show which format it has.
pub struct Recording {
    options: Options,
    sample: Vec<u8>,
    open: Option<(Target, Detection)>,
}

impl Recording {
    /// A recording of which nothing has been read.
    pub fn new(options: Options) -> Self {
        Self { options, sample: Vec::new(), open: None }
    }

    /// Feeds the next bytes. `Refusal` where the first ones show that the recording cannot be read.
    pub fn feed(&mut self, session: &mut Session, block: &[u8]) -> Result<(), Refusal> {
        if let Some((target, _)) = &self.open {
            target.feed(session, block, false);
            return Ok(());
        }
        self.sample.extend_from_slice(block);
        if self.sample.len() < SAMPLE_BYTES && (!self.options.is_live || self.sample.is_empty()) {
            return Ok(());
        }
        self.begin(session)
    }

    /// Ends the recording: decides what is still open. `Refusal` for an empty one, or a text of which no line was read.
    pub fn finish(&mut self, session: &mut Session) -> Result<(), Refusal> {
        if self.open.is_none() {
            self.begin(session)?;
        }
        let Some((target, detection)) = &self.open else { return Ok(()) };
        target.feed(session, &[], true);
        match target {
            Target::Capture(_) => session.flush_file(),
            Target::Bus(_) => session.flush(),
            Target::Text(bus) => {
                session.flush();
                if session.reader(*bus).is_some_and(|reader| reader.records() == 0) {
                    let format = &detection.format;
                    return Err(Refusal::Unfit(format!("no line could be read as {format}; see `modlens formats`")));
                }
            }
        }
        Ok(())
    }

    /// What the lines of a text show that nothing could read; `None` if that is nothing.
    pub fn unread(&self, session: &Session) -> Option<Said> {
        self.open.as_ref().and_then(|(target, _)| target.unread(session))
    }

    /// What is known of the reading so far: format, how sure, and what was left out. `null` before the format is known.
    pub fn status(&self, session: &Session) -> Json {
        let Some((target, detection)) = &self.open else { return Json::Null };
        json!({
            "name": self.options.name, "format": detection.format, "confidence": detection.confidence,
            "reason": detection.reason, "forced": detection.forced, "details": target.reading(session),
        })
    }

    fn begin(&mut self, session: &mut Session) -> Result<(), Refusal> {
        if self.sample.is_empty() {
            return Err(Refusal::Unfit(String::from("empty")));
        }
        let (name, format) = (&self.options.name, self.options.format.as_deref());
        let detection = decide(self.first_bytes(), name, format, || Dialects::embedded())?;
        let target = self.target(session, &detection)?;
        target.feed(session, &std::mem::take(&mut self.sample), false);
        self.open = Some((target, detection));
        Ok(())
    }

    /// What the format is decided by: the same bytes whatever the size of the blocks.
    fn first_bytes(&self) -> &[u8] {
        &self.sample[..self.sample.len().min(SAMPLE_BYTES)]
    }

    fn target(&self, session: &mut Session, detection: &Detection) -> Result<Target, Refusal> {
        match detection.format.as_str() {
            "pcap" | "pcapng" => Ok(Target::Capture(session.add_capture(CaptureOptions {
                source: self.options.name.clone(),
                ports: self.ports(),
                mode: self.options.mode,
                line: self.options.line,
                rule: None,
            }))),
            "raw" => Ok(Target::Bus(self.add_bus(session))),
            "sigrok" | "saleae-digital" => {
                Err(Refusal::Unfit(String::from("samples of a logic analyzer; the command `modlens decode` reads them")))
            }
            format => {
                let bus = self.add_bus(session);
                let rows = Dialects::embedded().named(format).map_err(Refusal::Unfit)?;
                let others = (!detection.forced).then(|| Arc::new(Dialects::embedded().clone()));
                let reader = Reader::new(rows, others, Arc::new(self.options.clock.clone()));
                session.open_text(bus, reader, self.first_bytes());
                Ok(Target::Text(bus))
            }
        }
    }

    fn add_bus(&self, session: &mut Session) -> usize {
        let name = self.options.name.clone();
        let bus = Bus { name: name.clone(), source: name, place: Place::Offset, clock: Clock::None, line: None, network: None };
        session.add_bus(BusOptions { bus, mode: self.options.mode, line: self.options.line, resolution: None, rule: None })
    }

    fn ports(&self) -> Ports {
        match &self.options.ports {
            None => Ports::default(),
            Some(ports) if ports.is_empty() => Ports::Any,
            Some(ports) => Ports::Listed(ports.clone()),
        }
    }
}

impl Target {
    fn feed(&self, session: &mut Session, block: &[u8], last: bool) {
        match *self {
            Self::Bus(bus) if !block.is_empty() => session.feed(bus, &Chunk { bytes: block, ..Chunk::default() }),
            Self::Bus(_) => {}
            Self::Text(bus) => session.feed_text(bus, block, last),
            Self::Capture(capture) => session.feed_capture(capture, block, last),
        }
    }

    /// What the lines of a text show that nothing could read.
    fn unread(&self, session: &Session) -> Option<Said> {
        match *self {
            Self::Text(bus) => unread_says(session.reader(bus)?),
            _ => None,
        }
    }

    /// What its reader reports: lines and records, what was not read and why.
    fn reading(&self, session: &Session) -> Json {
        match *self {
            Self::Bus(_) => json!({"unparsed": 0, "dropped": {}}),
            Self::Text(bus) => session.reader(bus).map_or(Json::Null, |reader| {
                let unread = reader.unread_lines();
                let dropped: serde_json::Map<String, Json> =
                    reader.skipped_counts().map(|(reason, count, _)| (reason.to_owned(), count.into())).collect();
                json!({
                    "lines": reader.lines(), "records": reader.records(), "unparsed": unread.count,
                    "unparsed_with_hex": unread.with_hex, "unparsed_examples": unread.examples, "dropped": dropped,
                    "clock": reader.clock_kind().text(), "resolution_ns": reader.resolution(),
                })
            }),
            Self::Capture(capture) => session.capture(capture).map_or(Json::Null, |report| {
                let dropped: serde_json::Map<String, Json> =
                    report.left_out.iter().map(|(reason, count)| (reason.clone(), json!(count))).collect();
                json!({
                    "records": report.packets, "unparsed": 0, "dropped": dropped, "clock": report.clock.text(),
                    "resolution_ns": report.resolution,
                })
            }),
        }
    }
}
