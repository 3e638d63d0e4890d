//! Lines of compact exchanges: of each bus and kind, the text between the values that differ is made once.

use std::slice;

use modlens_tables::columns::{ColumnReader, ExchangeRef, Table};

use crate::line_format::LineFormat;

/// Text that is short in most cases. A copy of fixed size is faster than one of the right size.
struct FixedText {
    bytes: [u8; FIXED_BYTES],
    length: usize,
    /// The whole text where it is longer.
    long: Vec<u8>,
}

const FIXED_BYTES: usize = 32;

impl FixedText {
    fn new(text: &[u8]) -> Self {
        let mut bytes = [0; FIXED_BYTES];
        let is_long = text.len() > FIXED_BYTES;
        if !is_long {
            bytes[..text.len()].copy_from_slice(text);
        }
        Self { bytes, length: text.len(), long: if is_long { text.to_vec() } else { Vec::new() } }
    }

    #[inline]
    fn push(&self, out: &mut Vec<u8>) {
        if self.length > FIXED_BYTES {
            out.extend_from_slice(&self.long);
            return;
        }
        let end = out.len() + self.length;
        out.extend_from_slice(&self.bytes);
        out.truncate(end);
    }
}

/// How the line of an exchange is made.
struct ExchangeLine<F> {
    /// The text before the first value that differs.
    head: FixedText,
    steps: Vec<Step<F>>,
}

/// A value that differs from line to line.
struct Step<F> {
    /// The index of its column.
    at: usize,
    reader: ColumnReader<F>,
    /// The text between it and the next one.
    behind: FixedText,
}

/// Writes compact exchanges of one table as lines.
pub(crate) struct ExchangeLines<F> {
    columns: Vec<usize>,
    /// The bus to which the lines belong.
    bus: Option<u32>,
    /// By kind (`Exchange::kind`).
    lines: Vec<Option<ExchangeLine<F>>>,
}

impl<F: LineFormat> ExchangeLines<F> {
    pub(crate) fn new(columns: &[usize]) -> Self {
        Self { columns: columns.to_vec(), bus: None, lines: Vec::new() }
    }

    /// Appends the line of an exchange.
    #[inline]
    pub(crate) fn push(&mut self, table: &Table, exchange: &ExchangeRef<'_>, format: &mut F) {
        let kind = exchange.kind();
        if self.bus != Some(exchange.bus()) {
            (self.bus, self.lines) = (Some(exchange.bus()), Vec::new());
        }
        if self.lines.get(kind).is_none_or(Option::is_none) {
            self.add_line(kind, table, exchange, format);
        }
        let Some(Some(line)) = self.lines.get(kind) else { return };
        format.begin();
        line.head.push(format.out());
        for step in &line.steps {
            format.column(step.at);
            step.reader.pass_exchanges(slice::from_ref(exchange), format);
            step.behind.push(format.out());
        }
        format.end();
    }

    /// Keeps how lines of exchanges of this bus and kind are made.
    #[cold]
    fn add_line(&mut self, kind: usize, table: &Table, exchange: &ExchangeRef<'_>, format: &mut F) {
        let line = self.line(table, exchange, format);
        if self.lines.len() <= kind {
            self.lines.resize_with(kind + 1, || None);
        }
        self.lines[kind] = Some(line);
    }

    /// How lines of exchanges of this bus and kind are made.
    fn line(&self, table: &Table, exchange: &ExchangeRef<'_>, format: &mut F) -> ExchangeLine<F> {
        let mut steps: Vec<(usize, ColumnReader<F>)> = Vec::new();
        let mut texts: Vec<FixedText> = Vec::new();
        let start = format.out().len();
        let take_text = |format: &mut F| {
            let text = FixedText::new(&format.out()[start..]);
            format.out().truncate(start);
            text
        };
        for (at, &column) in self.columns.iter().enumerate() {
            let reader = table.kind.reader(column);
            if table.is_exchange_constant(column, exchange) {
                format.column(at);
                reader.pass_exchanges(slice::from_ref(exchange), format);
            } else {
                texts.push(take_text(format));
                steps.push((at, reader));
            }
            format.end_value();
        }
        texts.push(take_text(format));
        let mut texts = texts.into_iter();
        let head = texts.next().expect("at least one text");
        let steps = steps.into_iter().zip(texts).map(|((at, reader), behind)| Step { at, reader, behind }).collect();
        ExchangeLine { head, steps }
    }
}
