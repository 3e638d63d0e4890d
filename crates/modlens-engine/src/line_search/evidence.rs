//! Frames with valid checksums: the only evidence for settings.

use std::sync::Arc;

use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};

use crate::findings::UNCONFIRMED;
use crate::session::{BusOptions, Session, WantedTables};

/// The framings that are listened for, and the bits of a character that each looks at.
const FRAMINGS: [(Mode, u8); 2] = [(Mode::Rtu, 0xFF), (Mode::Ascii, 0x7F)];
/// What settles it: answered requests in RTU, valid frames in ASCII, or so many confirmed frames of either.
const MIN_ANSWERED: u64 = 1;
const MIN_ASCII_FRAMES: u64 = 2;
const MIN_FRAMES: u64 = 3;

/// A session that only counts what is valid in one framing.
pub(super) struct Listener {
    pub mode: Mode,
    mask: u8,
    session: Session,
    bus: usize,
}

impl Listener {
    /// One for each framing that is possible.
    pub fn all(line: LineSettings, mode: Option<Mode>) -> Vec<Self> {
        let wanted = FRAMINGS.iter().filter(|framing| mode.is_none_or(|mode| mode == framing.0));
        wanted.map(|&(mode, mask)| Self::new(line, mode, mask)).collect()
    }

    fn new(line: LineSettings, mode: Mode, mask: u8) -> Self {
        let nothing = WantedTables { frames: false, transactions: false, findings: false };
        let mut session = Session::new(Arc::new(Functions::default()), nothing, true, None);
        let mut options = BusOptions { mode: Some(mode), line: Some(line), ..BusOptions::named("search") };
        options.bus.clock = Clock::Utc;
        let bus = session.add_bus(options);
        Self { mode, mask, session, bus }
    }

    /// Takes the bytes of a read.
    pub fn feed(&mut self, line: u8, bytes: &[u8], time: Option<Ns>) {
        let bytes: Vec<u8> = bytes.iter().map(|byte| byte & self.mask).collect();
        let times = time.map_or(Times::None, Times::Read);
        self.session.feed(self.bus, &Chunk { bytes: &bytes, line, times, ..Chunk::default() });
    }

    /// Time goes on without bytes.
    pub fn poll(&mut self, now: Ns) {
        self.session.poll(now);
    }

    /// The evidence so far in words, if it is enough.
    pub fn proof(&self) -> Option<String> {
        let stats = self.session.stats();
        let (frames, answered) = (stats.valid_frames_of(self.bus), stats.answered_on(self.bus));
        let enough = match self.mode {
            Mode::Ascii => frames >= MIN_ASCII_FRAMES,
            _ => answered >= MIN_ANSWERED,
        };
        let confirmed = frames.saturating_sub(stats.findings_of(UNCONFIRMED));
        (enough || confirmed >= MIN_FRAMES).then(|| {
            let ending = |count| if count == 1 { "" } else { "s" };
            format!("{frames} valid frame{} and {answered} answered request{}", ending(frames), ending(answered))
        })
    }
}

/// Whether a whole recording is Modbus at these settings: the framing, and the evidence in words. Each read has its bytes
/// and its time, if that is known.
pub fn proof_in(reads: &[(Vec<u8>, Option<Ns>)], line: LineSettings) -> Option<(Mode, String)> {
    Listener::all(line, None).into_iter().find_map(|mut listener| {
        for (bytes, time) in reads {
            listener.feed(0, bytes, *time);
        }
        listener.session.flush();
        Some((listener.mode, listener.proof()?))
    })
}
