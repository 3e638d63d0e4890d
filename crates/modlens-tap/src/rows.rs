//! Where decoded rows go: transactions as JSON lines, to standard output or a file that grows, and to the broker; there the
//! row of the day as well. [`Rows::put`] gets every batch: a further consumer is called there.

use std::fs::{File, OpenOptions};
use std::io;
use std::sync::atomic::AtomicBool;
use std::sync::Arc;
use std::time::{Duration, Instant};

use modlens_diagnosis::days::Days;
use modlens_engine::records::Batch;
use modlens_tables::columns::{Table, TableKind};
use modlens_writers::jsonl::rows;

use crate::mqtt::Publisher;
use crate::options::Options;
use crate::outlet::{say, Outlet};

/// The row of the day is published at most so often.
const DAY_INTERVAL: Duration = Duration::from_secs(60);
/// Days that are counted: yesterday's row is sent again.
const KEPT_DAYS: usize = 2;

/// A publisher, and the rows of the days.
struct Feed {
    publisher: Publisher,
    days: Days,
    due: Instant,
}

impl Feed {
    fn new(publisher: Publisher) -> Self {
        Self { publisher, days: Days::new(Some(KEPT_DAYS)), due: Instant::now() + DAY_INTERVAL }
    }

    /// Counts the rows of a batch, which has frames and transactions.
    fn observe(&mut self, batch: &Batch) {
        self.days.observe(batch);
        if Instant::now() >= self.due {
            self.due = Instant::now() + DAY_INTERVAL;
            self.publish_days();
        }
    }

    fn publish_days(&mut self) {
        for (_, row) in self.days.changed() {
            self.publisher.day(row.as_bytes());
        }
    }
}

/// Where rows go.
pub struct Rows {
    out: Option<Outlet>,
    /// The name of the output, for messages.
    name: String,
    /// Its reader has gone: there is nobody to listen for.
    reader_has_gone: bool,
    out_has_failed: bool,
    feed: Option<Feed>,
    text: Vec<u8>,
    /// Transactions so far.
    pub count: usize,
    limit: Option<usize>,
}

impl Rows {
    /// Opens the outputs. A file is appended to, so that a restart loses nothing.
    pub fn open(options: &Options) -> io::Result<Self> {
        let publisher = match &options.broker {
            Some(broker) => Some(Publisher::start(broker.clone(), options.bus.clone())?),
            None => None,
        };
        let name = options.output.as_ref().map_or("standard output".into(), |path| path.display().to_string());
        let out = match &options.output {
            Some(path) => Some(open_file(path.clone())?),
            None if options.quiet => None,
            None => Some(Outlet::start(|| Ok(File::from(rustix::io::dup(rustix::stdio::stdout())?)))?),
        };
        let (feed, limit) = (publisher.map(Feed::new), options.count);
        Ok(Self { out, name, reader_has_gone: false, out_has_failed: false, feed, text: Vec::new(), count: 0, limit })
    }

    /// Whether the tap has what `--count` asks for, or nobody to give it to.
    pub fn is_done(&self) -> bool {
        self.limit.is_some_and(|limit| self.count >= limit) || self.reader_has_gone
    }

    /// Hands on the transactions of a batch. An output that fails gets no more, and everything else goes on.
    pub fn put(&mut self, batch: Batch) {
        if let Some(feed) = &mut self.feed {
            feed.observe(&batch);
        }
        let table = Table::new(Arc::new(batch), TableKind::Transactions);
        let columns: Vec<usize> = (0..TableKind::Transactions.columns().len()).collect();
        self.text.clear();
        rows(&table, &columns, &mut self.text);
        let room = self.limit.map_or(usize::MAX, |limit| limit - self.count.min(limit));
        let mut length = 0;
        for line in self.text.split_inclusive(|byte| *byte == b'\n').take(room) {
            self.count += 1;
            length += line.len();
            if let Some(feed) = &self.feed {
                feed.publisher.transaction(line.trim_ascii_end());
            }
        }
        let done = self.out.as_ref().map_or(Ok(()), |out| out.write(&self.text[..length]));
        self.fail(done);
    }

    /// Notes an error of the output.
    fn fail(&mut self, done: io::Result<()>) {
        let Err(error) = done else { return };
        self.out = None;
        if error.kind() == io::ErrorKind::BrokenPipe {
            self.reader_has_gone = true;
        } else {
            self.out_has_failed = true;
            say(&format!("{}: cannot be written: {error}", self.name));
        }
    }

    /// Delivers what waits, for a moment where nobody takes it; whether everything was delivered.
    pub fn close(mut self, stop: &AtomicBool) -> bool {
        if let Some(out) = self.out.take() {
            match out.drain(stop) {
                Ok(0) => {}
                Ok(dropped) => say(&format!("{}: {dropped} bytes dropped: nobody read them", self.name)),
                Err(error) => self.fail(Err(error)),
            }
        }
        let undelivered = self.feed.take().map_or(0, |mut feed| {
            feed.publish_days();
            feed.publisher.close()
        });
        if undelivered > 0 {
            say(&format!("modlens-tap: {undelivered} messages were not delivered to the broker"));
        }
        undelivered == 0 && !self.out_has_failed
    }
}

/// Opens a file at once, so that an error is reported before anything is listened to; a FIFO waits for its reader.
fn open_file(path: std::path::PathBuf) -> io::Result<Outlet> {
    use std::os::unix::fs::FileTypeExt;
    let append = |path| OpenOptions::new().create(true).append(true).open(path);
    if std::fs::metadata(&path).is_ok_and(|found| found.file_type().is_fifo()) {
        return Outlet::start(move || append(path));
    }
    let file = append(path)?;
    Outlet::start(move || Ok(file))
}
