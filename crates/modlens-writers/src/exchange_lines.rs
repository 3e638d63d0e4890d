//! Lines of compact exchanges: of each bus and kind, the text between the values that differ is made once.

use std::slice;

use modlens_protocol::decimal::push_int;
use modlens_tables::columns::{ColumnReader, ExchangeNumber, ExchangeRef, Table};

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
    value: StepValue<F>,
    /// The text between it and the next one, with what stands before that one.
    behind: FixedText,
}

/// How the value is written.
enum StepValue<F> {
    /// As digits, in every format.
    Number(ExchangeNumber),
    /// By the reader of the column with this index.
    Cell(usize, ColumnReader<F>),
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
            match &step.value {
                StepValue::Number(number) => push_int(exchange.number(*number), format.out()),
                StepValue::Cell(at, reader) => {
                    format.column_behind_key(*at);
                    reader.pass_exchanges(slice::from_ref(exchange), format);
                }
            }
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
        let mut values: Vec<StepValue<F>> = Vec::new();
        let mut texts: Vec<FixedText> = Vec::new();
        let start = format.out().len();
        let take_text = |format: &mut F| {
            let text = FixedText::new(&format.out()[start..]);
            format.out().truncate(start);
            text
        };
        for (at, &column) in self.columns.iter().enumerate() {
            let reader = table.kind.reader(column);
            let number = ExchangeNumber::of_column(&table.kind.columns()[column].key);
            if table.is_exchange_constant(column, exchange) {
                format.column(at);
                reader.pass_exchanges(slice::from_ref(exchange), format);
            } else {
                format.push_key(at);
                texts.push(take_text(format));
                values.push(number.map_or(StepValue::Cell(at, reader), StepValue::Number));
            }
            format.end_value();
        }
        texts.push(take_text(format));
        let mut texts = texts.into_iter();
        let head = texts.next().expect("at least one text");
        let steps = values.into_iter().zip(texts).map(|(value, behind)| Step { value, behind }).collect();
        ExchangeLine { head, steps }
    }
}
