//! Lines of compact exchanges: of each bus and kind, the text between the values that differ is made once.

use std::slice;

use modlens_protocol::timestamp::TimeFormatter;
use modlens_tables::columns::{ColumnReader, ExchangeDuration, ExchangeNumber, ExchangeRef, ExchangeValue, Table};

use crate::line_format::LineFormat;
use crate::line_room::{FixedText, HighDigits, Line, LineRoom, DURATION_BYTES, LINE_BYTES, NUMBER_BYTES, TIME_BYTES};

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
    /// The text between it and the next one, with what stands before that one.
    behind: FixedText,
}

/// How the value is written.
enum StepValue<F> {
    /// As it stands in the exchange.
    Direct(ExchangeValue),
    /// A duration, and how long the text before it is, which is taken off where it is unknown.
    Duration(ExchangeDuration, usize),
    /// By the reader of the column with this index.
    Cell(usize, ColumnReader<F>),
}

impl<F> StepValue<F> {
    /// The most bytes that it takes in the room of a line.
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

/// What was written before, from which the next text differs little.
struct Memory {
    stamp: TimeFormatter,
    high_digits: [HighDigits; ExchangeNumber::COUNT],
}

impl Memory {
    /// Appends a value as it stands in the exchange.
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
            ExchangeValue::Number(number) => line.number(numbers[number as usize], &mut self.high_digits[number as usize]),
            // Its text stands around the number.
            ExchangeValue::Source => {
                let origin = ExchangeNumber::Origin as usize;
                line.number(numbers[origin], &mut self.high_digits[origin])
            }
            ExchangeValue::RequestWord(at) | ExchangeValue::ListOfRequestWord(at) => line.word(exchange.request_word(at)),
            ExchangeValue::Time => match exchange.start() {
                Some(ns) => line.time(ns, &mut self.stamp),
                None => line,
            },
            ExchangeValue::Duration(duration) => match exchange.duration(duration) {
                Some(ns) => line.duration(ns),
                None => line,
            },
            ExchangeValue::Unconfirmed => line.truth(exchange.is_unconfirmed()),
            ExchangeValue::Frame(half) => line.hex(exchange.frame(half)),
            ExchangeValue::Registers(half, at) => line.registers(exchange.block(half, at), F::SEPARATOR),
            ExchangeValue::Bits(half, at) => line.bits(exchange.block(half, at), exchange.quantity(), F::SEPARATOR),
        }
    }
}

/// The numbers of an exchange.
type Numbers = [u64; ExchangeNumber::COUNT];

/// Writes compact exchanges of one table as lines.
pub(crate) struct ExchangeLines<F> {
    columns: Vec<usize>,
    room: LineRoom,
    memory: Memory,
    /// The bus to which the lines belong.
    bus: Option<u32>,
    /// By kind (`Exchange::kind`).
    lines: Vec<Option<ExchangeLine<F>>>,
}

impl<F: LineFormat> ExchangeLines<F> {
    pub(crate) fn new(columns: &[usize]) -> Self {
        let memory = Memory { stamp: TimeFormatter::default(), high_digits: Default::default() };
        Self { columns: columns.to_vec(), room: LineRoom::new(), memory, bus: None, lines: Vec::new() }
    }

    /// Appends the line of an exchange. False if that may be too long; nothing is written then.
    #[inline]
    pub(crate) fn push(&mut self, table: &Table, exchange: &ExchangeRef<'_>, format: &mut F) -> bool {
        let kind = exchange.kind();
        if self.bus != Some(exchange.bus()) {
            (self.bus, self.lines) = (Some(exchange.bus()), Vec::new());
        }
        if self.lines.get(kind).is_none_or(Option::is_none) {
            self.add_line(kind, table, exchange, format);
        }
        let Some(Some(line)) = self.lines.get(kind) else { return false };
        if !line.has_room || exchange.byte_count() > EXCHANGE_BYTES {
            return false;
        }
        format.begin();
        let numbers = exchange.numbers();
        let mut text = self.room.line().text(&line.head);
        for Step { value, behind } in &line.steps {
            text = match value {
                StepValue::Direct(value) => self.memory.push::<F>(*value, exchange, &numbers, text),
                StepValue::Duration(duration, before) => match exchange.duration(*duration) {
                    Some(ns) => text.duration(ns),
                    None => text.without_last(*before),
                },
                StepValue::Cell(at, reader) => {
                    let text = text.move_to(format.out());
                    format.column_behind_key(*at);
                    reader.pass_exchanges(slice::from_ref(exchange), format);
                    text
                }
            }
            .text(behind);
        }
        text.move_to(format.out());
        format.end();
        true
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
            if table.is_exchange_constant(column, exchange) {
                format.column(at);
                reader.pass_exchanges(slice::from_ref(exchange), format);
            } else {
                let before = format.out().len();
                format.push_key(at);
                let key_bytes = format.out().len() - before;
                let value = exchange.value_of(&table.kind.columns()[column].key);
                let [opening, closing] = match value {
                    Some(ExchangeValue::Source) => around_number(at, &reader, exchange, format),
                    value => value.map_or([Vec::new(), Vec::new()], around_value::<F>),
                };
                format.out().extend(opening);
                texts.push(take_text(format));
                values.push(match value {
                    Some(ExchangeValue::Duration(duration)) => StepValue::Duration(duration, key_bytes),
                    Some(value) => StepValue::Direct(value),
                    None => StepValue::Cell(at, reader),
                });
                format.out().extend(closing);
            }
            format.end_value();
        }
        texts.push(take_text(format));
        let most_bytes = texts.iter().map(FixedText::len).chain(values.iter().map(StepValue::most_bytes)).sum::<usize>();
        let mut texts = texts.into_iter();
        let head = texts.next().expect("at least one text");
        let steps = values.into_iter().zip(texts).map(|(value, behind)| Step { value, behind }).collect();
        ExchangeLine { head, steps, has_room: most_bytes <= LINE_BYTES }
    }
}

/// What the format puts before a value and behind it.
fn around_value<F: LineFormat>(value: ExchangeValue) -> [Vec<u8>; 2] {
    match value {
        ExchangeValue::Time | ExchangeValue::Frame(_) => [F::QUOTE, F::QUOTE],
        ExchangeValue::Registers(..) | ExchangeValue::Bits(..) | ExchangeValue::ListOfRequestWord(_) => F::LIST_MARKS,
        _ => ["", ""],
    }
    .map(|mark| mark.as_bytes().to_vec())
}

/// What the text of a column has before the number of the position in the input, and behind it.
fn around_number<F: LineFormat>(at: usize, reader: &ColumnReader<F>, exchange: &ExchangeRef<'_>, format: &mut F) -> [Vec<u8>; 2] {
    let start = format.out().len();
    format.column_behind_key(at);
    reader.pass_exchanges(slice::from_ref(exchange), format);
    let text = format.out().split_off(start);
    let number = exchange.numbers()[ExchangeNumber::Origin as usize].to_string();
    // It is the last thing in it, but for a quote.
    let begin = memchr::memmem::rfind(&text, number.as_bytes()).expect("the column shows it");
    [text[..begin].to_vec(), text[begin + number.len()..].to_vec()]
}
