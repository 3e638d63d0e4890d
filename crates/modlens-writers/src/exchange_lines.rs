//! Lines of compact exchanges: of each bus and kind, the text between the values that differ is made once.

use std::mem::take;
use std::slice;

use modlens_protocol::decimal::decimal_texts;
use modlens_protocol::timestamp::TimeFormatter;
use modlens_tables::columns::{ColumnReader, ExchangeDuration, ExchangeNumber, ExchangeRef, ExchangeValue, Table};

use crate::line_format::LineFormat;
use crate::text_block::{
    FixedText, HighDigits, Line, NumberTexts, TextBlock, DURATION_BYTES, LINE_BYTES, NUMBER_BYTES, TIME_BYTES,
};

/// The most bytes of request and response together of an exchange that is written here: more than any exchange has whose PDUs have
/// 253 bytes each (application protocol, 4.1).
const EXCHANGE_BYTES: usize = 600;

/// How the line of an exchange is made.
struct ExchangeLine<F> {
    /// The text before the first value that differs.
    head: FixedText,
    steps: Vec<Step<F>>,
    /// Whether every such line has room where it is made.
    has_room: bool,
}

/// A value that differs from line to line.
struct Step<F> {
    value: StepValue<F>,
    /// The text between it and the next one, with what is before that one.
    behind: FixedText,
}

/// How the value is written.
enum StepValue<F> {
    /// As it is in the exchange.
    Direct(ExchangeValue),
    /// A duration, and how long the text before it is, which is taken off where it is unknown.
    Duration(ExchangeDuration, usize),
    /// By the reader of the column with this index.
    Cell(usize, ColumnReader<F>),
}

impl<F> StepValue<F> {
    /// The most bytes that it takes in the slot of a line.
    fn most_bytes(&self) -> usize {
        match self {
            Self::Direct(ExchangeValue::Time) => TIME_BYTES,
            Self::Direct(ExchangeValue::Frame(_)) => 2 * EXCHANGE_BYTES,
            Self::Direct(ExchangeValue::Registers(..)) => 3 * EXCHANGE_BYTES,
            Self::Direct(ExchangeValue::Bits(..)) => 16 * EXCHANGE_BYTES,
            Self::Direct(_) => NUMBER_BYTES,
            Self::Duration(..) => DURATION_BYTES,
            Self::Cell(..) => 0,
        }
    }
}

/// What was written before, from which the next text differs little, and the texts of numbers.
struct Memory {
    numbers: &'static NumberTexts,
    /// Each with what is between the numbers of a list after it.
    registers: &'static NumberTexts,
    stamp: TimeFormatter,
    high_digits: [HighDigits; ExchangeNumber::COUNT],
}

impl Memory {
    /// Appends a value as it is in the exchange.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The innermost loop; see `Line`.
    fn push<'a, F: LineFormat>(
        &mut self,
        value: ExchangeValue,
        exchange: &ExchangeRef<'_>,
        numbers: &Numbers,
        line: Line<'a>,
    ) -> Line<'a> {
        match value {
            ExchangeValue::Number(number) => {
                line.number(numbers[number as usize], &mut self.high_digits[number as usize], self.numbers)
            }
            // Its text is around the number.
            ExchangeValue::Source => {
                let origin = ExchangeNumber::Origin as usize;
                line.number(numbers[origin], &mut self.high_digits[origin], self.numbers)
            }
            ExchangeValue::RequestWord(at) | ExchangeValue::ListOfRequestWord(at) => {
                line.word(exchange.request_word(at), self.numbers)
            }
            ExchangeValue::Time => match exchange.start() {
                Some(ns) => line.time(ns, &mut self.stamp),
                None => line,
            },
            ExchangeValue::Duration(duration) => match exchange.duration(duration) {
                Some(ns) => line.duration(ns, self.numbers),
                None => line,
            },
            ExchangeValue::Unconfirmed => line.truth(exchange.is_unconfirmed()),
            ExchangeValue::Frame(half) => line.hex(exchange.frame(half)),
            ExchangeValue::Registers(half, at) => line.registers(exchange.block(half, at), self.registers),
            ExchangeValue::Bits(half, at) => line.bits(exchange.block(half, at), exchange.quantity(), F::SEPARATOR),
        }
    }
}

/// The numbers of an exchange.
type Numbers = [u64; ExchangeNumber::COUNT];

/// The lines of a bus.
struct BusLines<F> {
    /// Its index.
    bus: Option<u32>,
    /// By kind (`Exchange::kind`).
    lines: Vec<Option<ExchangeLine<F>>>,
}

/// Buses whose lines are kept, each in a place that follows from its index: those of a capture take turns.
const KEPT_BUSES: usize = 16;

/// Writes compact exchanges of one table as lines.
pub(crate) struct ExchangeLines<F> {
    columns: Vec<usize>,
    memory: Memory,
    buses: [BusLines<F>; KEPT_BUSES],
}

impl<F: LineFormat> ExchangeLines<F> {
    pub(crate) fn new(columns: &[usize]) -> Self {
        let memory = Memory {
            numbers: decimal_texts(),
            registers: F::SEPARATOR.number_texts(),
            stamp: TimeFormatter::default(),
            high_digits: Default::default(),
        };
        let buses = [const { BusLines { bus: None, lines: Vec::new() } }; KEPT_BUSES];
        Self { columns: columns.to_vec(), memory, buses }
    }

    /// Appends the line of an exchange. `None` if there may be no room for it; nothing is written then.
    #[inline]
    pub(crate) fn push(
        &mut self,
        table: &Table,
        exchange: &ExchangeRef<'_>,
        format: &mut F,
        block: &mut TextBlock,
    ) -> Option<()> {
        let (bus, kind) = (exchange.bus(), exchange.kind());
        let mut of_bus = &self.buses[bus as usize % KEPT_BUSES];
        if of_bus.bus != Some(bus) || of_bus.lines.get(kind).is_none_or(Option::is_none) {
            self.add_line(table, exchange, format);
            of_bus = &self.buses[bus as usize % KEPT_BUSES];
        }
        let line = of_bus.lines.get(kind)?.as_ref()?;
        if !line.has_room || exchange.byte_count() > EXCHANGE_BYTES {
            return None;
        }
        let numbers = exchange.numbers();
        let mut text = block.line()?.text(&line.head);
        for Step { value, behind } in &line.steps {
            text = match value {
                StepValue::Direct(value) => self.memory.push::<F>(*value, exchange, &numbers, text),
                StepValue::Duration(duration, before) => match exchange.duration(*duration) {
                    Some(ns) => text.duration(ns, self.memory.numbers),
                    None => text.without_last(*before),
                },
                StepValue::Cell(at, reader) => text.any_text(cell(*at, reader, exchange, format))?,
            }
            .text(behind);
        }
        let end = text.end();
        block.add(end);
        Some(())
    }

    /// Keeps how lines of exchanges of this bus and kind are made.
    #[cold]
    fn add_line(&mut self, table: &Table, exchange: &ExchangeRef<'_>, format: &mut F) {
        let (bus, kind, line) = (exchange.bus(), exchange.kind(), self.line(table, exchange, format));
        let of_bus = &mut self.buses[bus as usize % KEPT_BUSES];
        if of_bus.bus != Some(bus) {
            *of_bus = BusLines { bus: Some(bus), lines: Vec::new() };
        }
        if of_bus.lines.len() <= kind {
            of_bus.lines.resize_with(kind + 1, || None);
        }
        of_bus.lines[kind] = Some(line);
    }

    /// How lines of exchanges of this bus and kind are made.
    fn line(&self, table: &Table, exchange: &ExchangeRef<'_>, format: &mut F) -> ExchangeLine<F> {
        let mut values: Vec<StepValue<F>> = Vec::new();
        let mut texts: Vec<Vec<u8>> = Vec::new();
        let mut begins_with_value = false;
        format.out().clear();
        for (at, &column) in self.columns.iter().enumerate() {
            let reader = table.kind.reader(column);
            if table.is_exchange_constant(column, exchange) {
                format.column(at);
                reader.pass_exchanges(slice::from_ref(exchange), format);
            } else {
                begins_with_value |= values.is_empty() && format.out().is_empty();
                let (value, closing) = step_value(at, reader, &table.kind.columns()[column].key, exchange, format);
                texts.push(take(format.out()));
                format.out().extend(closing);
                values.push(value);
            }
            format.end_value();
        }
        texts.push(take(format.out()));
        let first = texts[0].clone();
        F::complete(&mut texts);
        let most_bytes = texts.iter().map(Vec::len).chain(values.iter().map(StepValue::most_bytes)).sum::<usize>();
        // Where the format writes the first key in a way of its own and that may be taken off, another one would be the first.
        let first_may_be_null =
            begins_with_value && matches!(values.first(), Some(StepValue::Duration(..) | StepValue::Cell(..)));
        let has_room = most_bytes <= LINE_BYTES && !(first_may_be_null && texts[0] != first);
        let mut texts = texts.iter().map(|text| FixedText::new(text));
        let head = texts.next().expect("at least one text");
        let steps = values.into_iter().zip(texts).map(|(value, behind)| Step { value, behind }).collect();
        ExchangeLine { head, steps, has_room }
    }
}

/// Appends what is before a value to the output of the format; gives how it is written, and what follows it.
fn step_value<F: LineFormat>(
    at: usize,
    reader: ColumnReader<F>,
    key: &str,
    exchange: &ExchangeRef<'_>,
    format: &mut F,
) -> (StepValue<F>, Vec<u8>) {
    let Some(value) = exchange.value_of(key) else { return (StepValue::Cell(at, reader), Vec::new()) };
    if value == ExchangeValue::Source {
        let before = take(format.out());
        let [opening, closing] = around_number(cell(at, &reader, exchange, format), exchange);
        *format.out() = [before, opening].concat();
        return (StepValue::Direct(value), closing);
    }
    let [opening, closing] = around_value::<F>(value);
    let before = format.out().len();
    format.push_key(at);
    let key_bytes = format.out().len() - before;
    format.out().extend(opening);
    match value {
        ExchangeValue::Duration(duration) => (StepValue::Duration(duration, key_bytes), closing),
        value => (StepValue::Direct(value), closing),
    }
}

/// The text of a cell, with what is before it; empty where there is no value.
fn cell<'f, F: LineFormat>(at: usize, reader: &ColumnReader<F>, exchange: &ExchangeRef<'_>, format: &'f mut F) -> &'f [u8] {
    format.out().clear();
    format.column(at);
    reader.pass_exchanges(slice::from_ref(exchange), format);
    format.out()
}

/// What the format puts before a value and after it.
fn around_value<F: LineFormat>(value: ExchangeValue) -> [Vec<u8>; 2] {
    match value {
        ExchangeValue::Time | ExchangeValue::Frame(_) => [F::QUOTE, F::QUOTE],
        ExchangeValue::Registers(..) | ExchangeValue::Bits(..) | ExchangeValue::ListOfRequestWord(_) => F::LIST_MARKS,
        _ => ["", ""],
    }
    .map(|mark| mark.as_bytes().to_vec())
}

/// What a text that shows the position in the input has before the number and after it.
fn around_number(text: &[u8], exchange: &ExchangeRef<'_>) -> [Vec<u8>; 2] {
    let number = exchange.numbers()[ExchangeNumber::Origin as usize].to_string();
    // It is the last thing in it, but for a quote.
    let begin = memchr::memmem::rfind(text, number.as_bytes()).expect("the column shows it");
    [text[..begin].to_vec(), text[begin + number.len()..].to_vec()]
}
