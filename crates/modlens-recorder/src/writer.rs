//! Writes blocks of a recording into segments: whole blocks only, whatever the disk does.

use std::collections::VecDeque;
use std::fs::{File, Metadata};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use modlens_pcapng::recording::{self, PortRead};
use modlens_protocol::Ns;

use crate::segments::{Names, RecordedPort, Retention, Rotation};

/// What is written at once.
const WRITE_BYTES: usize = 1 << 16;

/// What follows in a recording.
#[derive(Debug)]
pub enum Item {
    /// A further port.
    Port(RecordedPort),
    /// Blocks of a port.
    Block(Block),
}

/// Blocks of a recording that are written together or not at all.
#[derive(Debug, Default)]
pub struct Block {
    /// The blocks.
    pub bytes: Vec<u8>,
    /// How many bytes of the line they have.
    pub line_bytes: u64,
    /// Their time.
    pub time: Ns,
}

impl Block {
    /// The blocks of one read of a port.
    pub fn of(port: u32, read: &PortRead<'_>) -> Self {
        let mut bytes = Vec::with_capacity(read.bytes.len() + 96);
        if read.hole && !read.bytes.is_empty() {
            // An empty read closes what came before: the engine learns of the loss first (`modlens-py/src/inbox.rs`).
            recording::read(port, &PortRead { time: read.time, hole: true, ..PortRead::default() }, &mut bytes);
        }
        recording::read(port, read, &mut bytes);
        Self { bytes, line_bytes: read.bytes.len() as u64, time: read.time }
    }

    /// The block of a clock that was set.
    pub fn of_clock_step(port: u32, time: Ns, step: Ns) -> Self {
        let mut bytes = Vec::new();
        recording::clock_step(port, time, step, &mut bytes);
        Self { bytes, line_bytes: 0, time }
    }
}

/// The file that is being written.
struct Segment {
    name: PathBuf,
    file: File,
    /// The length of its whole blocks.
    length: u64,
    header_length: u64,
    began: Instant,
}

/// What has become of the file of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// It stands where it was created.
    Same,
    /// It was moved; what was written to it is there.
    Moved,
    /// It was deleted, and with it what was written to it.
    Deleted,
}

/// The segments of one recording.
pub struct Writer {
    names: Names,
    application: String,
    rotation: Rotation,
    retention: Retention,
    ports: Vec<RecordedPort>,
    segment: Option<Segment>,
    segments: u64,
    /// Sentences about files that have begun.
    pub messages: Vec<String>,
}

impl Writer {
    /// A writer that has not created a file yet.
    pub fn new(names: Names, application: String, rotation: Rotation, retention: Retention) -> Self {
        Self { names, application, rotation, retention, ports: Vec::new(), segment: None, segments: 0, messages: Vec::new() }
    }

    /// The file that is being written, or the one that is wanted.
    pub fn name(&self) -> &Path {
        self.segment.as_ref().map_or(self.names.wanted(), |segment| &segment.name)
    }

    /// Writes the items and takes out what is written. After an error the rest is there to be written again.
    pub fn write(&mut self, items: &mut VecDeque<Item>, written: &mut dyn FnMut(&Item)) -> io::Result<()> {
        while let Some(first) = items.front() {
            let length = self.block(first).len() as u64;
            if self.segment.as_ref().is_none_or(|segment| self.is_full(segment, length)) {
                self.begin_segment()?;
            }
            let Some(mut segment) = self.segment.take() else { continue };
            let (bytes, ends) = self.gather(items, &segment);
            let done = segment.append(&bytes, &ends);
            for item in items.drain(..ends.partition_point(|&end| end as u64 <= segment.length - done.before)) {
                written(&item);
                if let Item::Port(port) = item {
                    self.ports.push(port);
                }
            }
            // A file that may not grow further, as on FAT, is complete.
            let is_complete = done.error.as_ref().is_some_and(|error| error.kind() == io::ErrorKind::FileTooLarge);
            let has_reads = segment.has_reads();
            if !is_complete || !has_reads {
                self.segment = Some(segment);
                done.error.map_or(Ok(()), Err)?;
            }
        }
        Ok(())
    }

    /// Begins the next segment, if there is none.
    pub fn open(&mut self) -> io::Result<()> {
        if self.segment.is_some() {
            return Ok(());
        }
        self.begin_segment()
    }

    /// Looks where the file is, and lets go of one that is not where it was.
    pub fn check_place(&mut self) -> Place {
        let place = self.segment.as_ref().map_or(Place::Same, Segment::place);
        if place != Place::Same {
            self.segment = None;
        }
        place
    }

    /// The bytes of the next items that go into the present segment, and where each ends.
    fn gather(&self, items: &VecDeque<Item>, segment: &Segment) -> (Vec<u8>, Vec<usize>) {
        let (mut bytes, mut ends) = (Vec::new(), Vec::new());
        for item in items {
            let block = self.block(item);
            let length = bytes.len() + block.len();
            let is_full = matches!(self.rotation, Rotation::Bytes(limit) if segment.length + length as u64 > limit);
            if !bytes.is_empty() && (is_full || length > WRITE_BYTES) {
                break;
            }
            bytes.extend_from_slice(&block);
            ends.push(bytes.len());
            // The description of a further port depends on those before it.
            if matches!(item, Item::Port(_)) {
                break;
            }
        }
        (bytes, ends)
    }

    fn block<'a>(&self, item: &'a Item) -> std::borrow::Cow<'a, [u8]> {
        match item {
            Item::Block(block) => (&*block.bytes).into(),
            Item::Port(port) => {
                let mut out = Vec::new();
                describe(port, &self.ports, &mut out);
                out.into()
            }
        }
    }

    /// Whether so many further bytes belong into the next segment; each segment has at least one read.
    fn is_full(&self, segment: &Segment, bytes: u64) -> bool {
        match self.rotation {
            Rotation::Never => false,
            Rotation::After(time) => segment.began.elapsed() >= time,
            Rotation::Bytes(limit) => segment.has_reads() && segment.length + bytes > limit,
        }
    }

    /// Creates the next segment and writes its header, then closes the present one and deletes old ones.
    fn begin_segment(&mut self) -> io::Result<()> {
        let (name, file) = self.names.create()?;
        let mut header = Vec::new();
        recording::head(&self.application, &self.names.session, self.segments + 1, &mut header);
        for (number, port) in self.ports.iter().enumerate() {
            describe(port, &self.ports[..number], &mut header);
        }
        let mut segment = Segment { name, file, length: 0, header_length: header.len() as u64, began: Instant::now() };
        let done = segment.append(&header, &[header.len()]);
        if let Some(error) = done.error {
            let _ = std::fs::remove_file(&segment.name);
            return Err(error);
        }
        self.segments += 1;
        self.messages.push(format!("recording to {}", segment.name.display()));
        self.names.delete_old(self.retention, self.rotation, &segment.name);
        self.segment = Some(segment);
        Ok(())
    }
}

/// What a write has done.
struct Done {
    /// The length of the file before it.
    before: u64,
    error: Option<io::Error>,
}

impl Segment {
    fn has_reads(&self) -> bool {
        self.length > self.header_length
    }

    /// Appends blocks that end at these places. After an error, the file ends after the last whole block.
    fn append(&mut self, bytes: &[u8], ends: &[usize]) -> Done {
        let (before, mut written) = (self.length, 0);
        let mut error = None;
        while written < bytes.len() {
            match self.file.write(&bytes[written..]) {
                Ok(0) => error = Some(io::ErrorKind::WriteZero.into()),
                Ok(more) => written += more,
                Err(one) if one.kind() == io::ErrorKind::Interrupted => {}
                Err(one) => error = Some(one),
            }
            if error.is_some() {
                break;
            }
        }
        let whole = ends.iter().rev().find(|&&end| end <= written).map_or(0, |&end| end as u64);
        if whole < written as u64 {
            let _ = self.file.set_len(before + whole);
        }
        self.length = before + whole;
        Done { before, error }
    }

    fn place(&self) -> Place {
        let Ok(ours) = self.file.metadata() else { return Place::Same };
        match std::fs::metadata(&self.name) {
            Ok(there) if is_same(&ours, &there) => Place::Same,
            // A name that cannot be looked up, as where rights were taken away, says nothing.
            Err(error) if error.kind() != io::ErrorKind::NotFound => Place::Same,
            _ if is_deleted(&ours) => Place::Deleted,
            _ => Place::Moved,
        }
    }
}

/// Appends the description of a port that follows these.
pub fn describe(port: &RecordedPort, before: &[RecordedPort], out: &mut Vec<u8>) {
    let mut buses: Vec<&str> = Vec::new();
    for bus in before.iter().chain([port]).map(|one| &*one.bus) {
        if !buses.contains(&bus) {
            buses.push(bus);
        }
    }
    let number = buses.iter().position(|bus| *bus == port.bus).unwrap_or_default();
    recording::port(&port.name, (number, &port.bus), port.line.as_deref(), port.settings.as_ref(), out);
}

#[cfg(unix)]
fn is_same(one: &Metadata, other: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

#[cfg(unix)]
fn is_deleted(file: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    file.nlink() == 0
}

/// A file that is open cannot be replaced on other systems.
#[cfg(not(unix))]
fn is_same(_: &Metadata, _: &Metadata) -> bool {
    true
}

#[cfg(not(unix))]
fn is_deleted(_: &Metadata) -> bool {
    true
}
