//! The files of a recording: their names, which of them are old, and who else is writing under the same name.
//!
//! With rotation, or where the file exists, files are named as by dumpcap, `bus_00001_20261121101500.pcapng`. Numbers grow
//! by one from file to file and decide what is old, because the wall clock may be set. Nothing is ever overwritten.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use modlens_protocol::amount::{count, duration, size};
use modlens_protocol::line::LineSettings;
use modlens_protocol::timestamp::push_time;

use crate::clock::Moment;

const SUFFIX: &str = ".pcapng";

/// The header of a segment names its session within so many bytes.
const HEADER_BYTES: usize = 1024;

/// When a segment ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rotation {
    /// Never: there is one file.
    #[default]
    Never,
    /// After this time.
    After(Duration),
    /// Before it would have more bytes than these.
    Bytes(u64),
}

/// How much is kept when a further segment begins, the new one included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Retention {
    /// All segments.
    #[default]
    All,
    /// So many segments.
    Segments(usize),
    /// Segments of so many bytes.
    Bytes(u64),
}

/// A time such as `1h30m`, or a size such as `64MB`; a bare number is neither.
impl FromStr for Rotation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(bytes) = size(text) {
            return Ok(Self::Bytes(bytes));
        }
        let seconds = duration(text).map_or(0, |ns| (ns as f64 / 1e9).round_ties_even() as u64);
        if seconds == 0 || text.trim().ends_with(|one: char| one.is_ascii_digit()) {
            return Err("write a time such as 10min or 1h30m, or a size such as 64MB".into());
        }
        Ok(Self::After(Duration::from_secs(seconds)))
    }
}

/// A number of segments, or a size such as `2GB`.
impl FromStr for Retention {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let segments = count(text).and_then(|count| usize::try_from(count).ok()).map(Self::Segments);
        segments.or_else(|| size(text).map(Self::Bytes)).ok_or_else(|| "give a number of files, or a size such as 2GB".into())
    }
}

/// A recorded port.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordedPort {
    /// The name of the port.
    pub name: String,
    /// The name of its bus.
    pub bus: String,
    /// The letter of its line, if the bus is tapped on two lines.
    pub line: Option<String>,
    /// Its line settings, if they are known.
    pub settings: Option<LineSettings>,
}

/// The names under which one start of a tap records.
#[derive(Debug)]
pub struct Names {
    /// The name that was asked for.
    path: PathBuf,
    /// What the headers of its segments have, and those of no other start.
    pub session: String,
    is_numbered: bool,
}

impl Names {
    /// Names after `path`; with `is_numbered` or where the file exists, they have a number and a time.
    pub fn new(path: &Path, is_numbered: bool) -> Self {
        let mut path = path.to_owned();
        if path.extension().is_none_or(|suffix| suffix != "pcapng") {
            path.as_mut_os_string().push(SUFFIX);
        }
        Self { path, session: new_session(), is_numbered }
    }

    /// Creates the next file and locks it, so that other taps see that its session is going on.
    pub fn create(&mut self) -> io::Result<(PathBuf, File)> {
        self.is_numbered = self.is_numbered || std::fs::symlink_metadata(&self.path).is_ok();
        loop {
            let name = if self.is_numbered { self.next_name() } else { self.path.clone() };
            match OpenOptions::new().append(true).create_new(true).open(&name) {
                // Another tap has taken the name in the meantime.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => self.is_numbered = true,
                Err(error) => return Err(error),
                Ok(file) => {
                    lock(&file);
                    return Ok((name, file));
                }
            }
        }
    }

    /// The name of the file that could not be created.
    pub fn wanted(&self) -> &Path {
        &self.path
    }

    /// Deletes the oldest segments beyond the retention, but never `current` nor those of another tap that is running.
    pub fn delete_old(&self, retention: Retention, rotation: Rotation, current: &Path) {
        let listed = self.listed();
        let others: Vec<_> = listed.into_iter().map(|(_, path)| path).filter(|path| path != current).collect();
        let others = self.own_or_ended(others);
        let kept = match retention {
            Retention::All => return,
            Retention::Segments(count) => count.saturating_sub(1),
            Retention::Bytes(bytes) => kept_by_size(&others, bytes, rotation),
        };
        for path in &others[..others.len().saturating_sub(kept)] {
            let _ = std::fs::remove_file(path);
        }
    }

    fn next_name(&self) -> PathBuf {
        let last = self.listed().last().map_or(0, |(number, _)| *number);
        let mut time = Vec::new();
        push_time(Moment::now().wall, &mut time);
        let digits = time.iter().filter(|byte| byte.is_ascii_digit()).take(14).map(|&byte| char::from(byte));
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        self.path.with_file_name(format!("{stem}_{:05}_{}{SUFFIX}", last + 1, digits.collect::<String>()))
    }

    /// Number and path of every segment of this name, the oldest first.
    fn listed(&self) -> Vec<(u64, PathBuf)> {
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let number = |name: &str| segment_number(name, &stem);
        let found = entries.flatten().filter_map(|entry| Some((number(entry.file_name().to_str()?)?, entry.file_name())));
        let mut found: Vec<_> = found.map(|(number, name)| (number, self.path.with_file_name(name))).collect();
        found.sort();
        found
    }

    /// Without the segments of taps that are still running: the newest segment of such a session is locked.
    fn own_or_ended(&self, segments: Vec<PathBuf>) -> Vec<PathBuf> {
        let sessions: Vec<_> = segments.iter().map(|path| session_of(path)).collect();
        let running: Vec<_> = segments.iter().zip(&sessions).filter(|(path, _)| is_locked(path)).map(|(_, one)| one).collect();
        let is_ours = |session: &Option<String>| session.as_deref() == Some(&*self.session);
        let stays = |session: &Option<String>| is_ours(session) || (CAN_LOCK && !running.contains(&session));
        segments.into_iter().zip(&sessions).filter(|(_, session)| stays(session)).map(|(path, _)| path).collect()
    }
}

/// How many of these segments, from the newest on, fit into `bytes` beside one that is growing.
fn kept_by_size(segments: &[PathBuf], bytes: u64, rotation: Rotation) -> usize {
    let growing = if let Rotation::Bytes(bytes) = rotation { bytes } else { 0 };
    let mut room = bytes.saturating_sub(growing);
    let fits = |path: &&PathBuf| {
        let size = std::fs::metadata(path).map_or(0, |found| found.len());
        let fits = size <= room;
        room = room.saturating_sub(size);
        fits
    };
    segments.iter().rev().take_while(fits).count()
}

/// The number in `STEM_00001_20261121101500.pcapng`.
fn segment_number(name: &str, stem: &str) -> Option<u64> {
    let (number, time) = name.strip_prefix(stem)?.strip_prefix('_')?.strip_suffix(SUFFIX)?.split_once('_')?;
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    (number.len() >= 5 && time.len() == 14 && digits(number) && digits(time)).then(|| number.parse().ok())?
}

/// The session that the header of a segment names.
fn session_of(path: &Path) -> Option<String> {
    let mut header = Vec::new();
    File::open(path).ok()?.take(HEADER_BYTES as u64).read_to_end(&mut header).ok()?;
    let text = String::from_utf8_lossy(&header);
    Some(text.split_once("recording session=")?.1.split(' ').next()?.to_owned())
}

/// Sixteen hex digits that no other start has: the keys of Rust's hash tables are random.
pub fn new_session() -> String {
    use std::hash::{BuildHasher, Hasher, RandomState};
    let mut hasher = RandomState::new().build_hasher();
    let now = Moment::now();
    hasher.write_u64(now.wall as u64 ^ now.monotonic as u64);
    hasher.write_u32(std::process::id());
    format!("{:016x}", hasher.finish())
}

/// Whether files can be locked here without keeping others from reading them. Where they cannot, a tap deletes its own
/// segments only.
const CAN_LOCK: bool = cfg!(unix);

#[cfg(unix)]
fn lock(file: &File) {
    // A file system without locks is no reason not to record.
    let _ = rustix::fs::flock(file, rustix::fs::FlockOperation::NonBlockingLockExclusive);
}

#[cfg(unix)]
fn is_locked(path: &Path) -> bool {
    let Ok(file) = File::open(path) else { return false };
    rustix::fs::flock(&file, rustix::fs::FlockOperation::NonBlockingLockShared) == Err(rustix::io::Errno::WOULDBLOCK)
}

#[cfg(not(unix))]
fn lock(_: &File) {}

#[cfg(not(unix))]
fn is_locked(_: &Path) -> bool {
    false
}
