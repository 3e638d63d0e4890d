//! Transactions as JSON lines, to standard output or a file that grows, and to the broker.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_tables::columns::{Table, TableKind};
use modlens_writers::jsonl::rows;

use crate::mqtt::Publisher;
use crate::options::Options;

/// Where rows go.
pub struct Rows {
    out: Option<Box<dyn Write>>,
    publisher: Option<Publisher>,
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
        Ok(Self { out, publisher, text: Vec::new(), count: 0, limit: options.count })
    }

    /// Whether the tap has what `--count` asks for.
    pub fn is_full(&self) -> bool {
        self.limit.is_some_and(|limit| self.count >= limit)
    }

    /// Hands on the transactions of a batch.
    pub fn put(&mut self, batch: Batch) -> io::Result<()> {
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
            if let Some(publisher) = &self.publisher {
                publisher.transaction(line.trim_ascii_end());
            }
        }
        self.out.as_mut().map_or(Ok(()), Write::flush)
    }

    /// Delivers what the broker has not confirmed, for a moment; how many messages were not delivered.
    pub fn close(self) -> usize {
        self.publisher.map_or(0, Publisher::close)
    }
}
