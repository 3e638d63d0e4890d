//! Engine and recording of the bus: what a read goes to once the line's settings are known.

use std::io;
use std::sync::Arc;

use modlens_engine::line_search::SearchRead;
use modlens_engine::records::{Batch, Bus};
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_pcapng::recording::PortRead;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_recorder::{Feed, RecordedPort, Recorder, RecorderOptions, RecorderStatus};
use std::time::Duration;

use crate::options::Options;

const CLOSE: Duration = Duration::from_secs(5);

/// Engine and recording of the bus.
pub struct Decoding<'a> {
    options: &'a Options,
    pub session: Session,
    /// The number of the bus in the engine, and the settings that it knows, once it was begun.
    pub bus: Option<usize>,
    line: Option<LineSettings>,
    recorder: Option<Recorder>,
    /// The number of the port in the recording.
    recorded_as: Option<u32>,
}

impl<'a> Decoding<'a> {
    /// Opens the recording, if there is to be one.
    pub fn open(options: &'a Options) -> io::Result<Self> {
        let recorder = match &options.record {
            Some(path) => {
                let (rotation, retention) = (options.rotation, options.retention);
                Some(Recorder::start(RecorderOptions { rotation, retention, ..RecorderOptions::new(path) })?)
            }
            None => None,
        };
        // The row of the day counts frames, too.
        let wanted = WantedTables { frames: options.broker.is_some(), transactions: true, findings: false };
        let session = Session::new(Arc::new(Functions::default()), wanted, true, None);
        Ok(Self { options, session, bus: None, line: None, recorder, recorded_as: None })
    }

    /// Adds the bus to engine and recording, or the same one with other settings, which a later search has found.
    pub fn begin(&mut self, line: Option<LineSettings>, mode: Option<Mode>) {
        if self.bus.is_some() && self.line == line {
            return;
        }
        let bus = Bus {
            name: self.options.bus.clone(),
            source: self.options.port.clone(),
            place: Place::Offset,
            clock: Clock::Utc,
            line,
            network: None,
        };
        let mode = mode.or(self.options.mode);
        self.bus = Some(self.session.add_bus(BusOptions { bus, mode, line, resolution: None, rule: None }));
        self.line = line;
        self.recorded_as = self.recorder.as_ref().map(|recorder| {
            recorder.add_port(RecordedPort {
                name: self.options.port.clone(),
                bus: self.options.bus.clone(),
                line: None,
                settings: line,
            })
        });
    }

    /// Where reads may go by themselves, and as which port.
    pub fn recording(&self) -> Option<(Feed, u32)> {
        Some((self.recorder.as_ref()?.feed(), self.recorded_as?))
    }

    /// Takes a read. What came before a loss is closed only after all that time alone decides has been decided; an empty read
    /// records that, so that a replay gives the same rows.
    pub fn feed(&mut self, read: &SearchRead) {
        if read.follows_loss && !read.bytes.is_empty() {
            self.put(&SearchRead { bytes: Vec::new(), errors: Vec::new(), ..read.clone() });
        }
        self.put(read);
    }

    /// Bytes may have been lost after this time.
    pub fn lose(&mut self, time: Ns, is_recorded: bool) {
        self.put(&SearchRead { time, follows_loss: true, is_recorded, ..SearchRead::default() });
    }

    fn put(&mut self, read: &SearchRead) {
        let Some(bus) = self.bus else { return };
        if let Some((feed, at)) = self.recording().filter(|_| !read.is_recorded) {
            let (time, bytes, errors) = (read.time, read.bytes.as_slice(), read.errors.as_slice());
            feed.write(at, &PortRead { time, bytes, errors, hole: read.follows_loss });
        }
        let (times, error_positions) = (Times::Read(read.time), read.errors.as_slice());
        let (bytes, follows_loss) = (read.bytes.as_slice(), read.follows_loss);
        self.session.feed(bus, &Chunk { bytes, times, error_positions, follows_loss, ..Chunk::default() });
    }

    /// The rows that were decided since the last call.
    pub fn take(&mut self) -> Batch {
        self.session.take()
    }

    /// What the recorder has to tell.
    pub fn take_messages(&self) -> Vec<String> {
        self.recorder.as_ref().map(Recorder::take_messages).unwrap_or_default()
    }

    /// Decides what is still open and completes the recording; how it went, if there is one.
    pub fn close(&mut self, now: Ns) -> Option<RecorderStatus> {
        self.lose(now, false);
        self.session.flush();
        self.recorder.take().map(|mut recorder| recorder.close(CLOSE))
    }
}
