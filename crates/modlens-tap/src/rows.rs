//! Transactions as JSON lines, to standard output or a file that grows, and to the broker; there the row of the day, too.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::sync::Arc;
use std::time::{Duration, Instant};

use modlens_diagnosis::days::Days;
use modlens_engine::records::Batch;
use modlens_tables::columns::{Table, TableKind};
use modlens_writers::jsonl::rows;

use crate::mqtt::Publisher;
use crate::options::Options;

/// The row of the day is published at most so often.
const DAY_INTERVAL: Duration = Duration::from_secs(60);
/// Days that are counted: yesterday's row is sent once more.
const KEPT_DAYS: usize = 2;

/// A publisher, and what it tells of each day.
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
    out: Option<Box<dyn Write>>,
    feed: Option<Feed>,
    text: Vec<u8>,
    /// Transactions so far.
    pub count: usize,
    limit: Option<usize>,
}

impl Rows {
    /// Opens the outputs. A file is appended to, so that a restart loses nothing.
    pub fn open(options: &Options, publisher: Option<Publisher>) -> io::Result<Self> {
        let out: Option<Box<dyn Write>> = match &options.output {
            Some(path) => Some(Box::new(OpenOptions::new().create(true).append(true).open(path)?) as Box<File>),
            None if options.quiet => None,
            None => Some(Box::new(io::stdout())),
        };
        Ok(Self { out, feed: publisher.map(Feed::new), text: Vec::new(), count: 0, limit: options.count })
    }

    /// Whether the tap has what `--count` asks for.
    pub fn is_full(&self) -> bool {
        self.limit.is_some_and(|limit| self.count >= limit)
    }

    /// Hands on the transactions of a batch.
    pub fn put(&mut self, batch: Batch) -> io::Result<()> {
        if let Some(feed) = &mut self.feed {
            feed.observe(&batch);
        }
        let table = Table::new(Arc::new(batch), TableKind::Transactions);
        let columns: Vec<usize> = (0..TableKind::Transactions.columns().len()).collect();
        self.text.clear();
        rows(&table, &columns, &mut self.text);
        let room = self.limit.map_or(usize::MAX, |limit| limit - self.count.min(limit));
        for line in self.text.split_inclusive(|byte| *byte == b'\n').take(room) {
            self.count += 1;
            if let Some(out) = &mut self.out {
                out.write_all(line)?;
            }
            if let Some(feed) = &self.feed {
                feed.publisher.transaction(line.trim_ascii_end());
            }
        }
        self.out.as_mut().map_or(Ok(()), Write::flush)
    }

    /// Delivers what the broker has not confirmed, for a moment; how many messages were not delivered.
    pub fn close(mut self) -> usize {
        let Some(mut feed) = self.feed.take() else { return 0 };
        feed.publish_days();
        feed.publisher.close()
    }
}
