//! Rows as lines of CSV or JSON, a block at a time.

use modlens_tables::columns::{Table, TableKind};
use modlens_writers::csv::{self, Csv};
use modlens_writers::jsonl::Jsonl;
use modlens_writers::{LineWriter, TextBlock};

use crate::view::View;

enum Writer {
    Csv(Box<LineWriter<Csv>>),
    Jsonl(Box<LineWriter<Jsonl>>),
}

/// An export that was begun.
pub(crate) struct Export {
    parts: Vec<Table>,
    /// The part and the row that come next.
    next: (usize, usize),
    writer: Writer,
    header: Vec<u8>,
}

impl Export {
    /// All columns of the rows of a view, as `csv` or `jsonl`.
    pub fn new(view: &View, format: &str) -> Result<Self, String> {
        let kind: TableKind = view.kind();
        let columns: Vec<usize> = (0..kind.columns().len()).collect();
        let mut header = Vec::new();
        let writer = match format {
            "csv" => {
                let keys: Vec<&str> = kind.columns().iter().map(|column| column.key.as_str()).collect();
                csv::header(&keys, &mut header);
                Writer::Csv(Box::new(LineWriter::new(kind, &columns)))
            }
            "jsonl" => Writer::Jsonl(Box::new(LineWriter::new(kind, &columns))),
            other => return Err(format!("format {other:?} is neither csv nor jsonl")),
        };
        Ok(Self { parts: view.parts().to_vec(), next: (0, 0), writer, header })
    }

    /// Appends the next lines; nothing at the end.
    pub fn more(&mut self, out: &mut Vec<u8>) {
        let mut block = TextBlock::default();
        block.append(&std::mem::take(&mut self.header));
        while let Some(part) = self.parts.get(self.next.0) {
            let rows = self.next.1..part.len();
            let end = match &mut self.writer {
                Writer::Csv(lines) => lines.rows(part, rows, &mut block),
                Writer::Jsonl(lines) => lines.rows(part, rows, &mut block),
            };
            self.next = if end >= part.len() { (self.next.0 + 1, 0) } else { (self.next.0, end) };
            if block.is_full() {
                break;
            }
        }
        out.extend_from_slice(block.text());
    }
}
