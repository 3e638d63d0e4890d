//! Columns: how a row is read. One line a column; `analyzer/columns.toml` has their types and words.
//!
//! Writers, filters and the border see rows only through `Table::cell`.

use std::sync::{Arc, OnceLock};

use serde_json::Value as Json;

use crate::finding::Finding;
use crate::functions::{Functions, Layout, Operation, Row, EXCEPTION_BIT};
use crate::pdu::{self, u16_at};
use crate::records::{Batch, Bus, Clock, FindingRow, Frame, Half, Place, Status, Transaction};
use crate::Ns;

/// The embedded columns.
pub const COLUMNS: &str = include_str!("../../../analyzer/columns.toml");

/// Names of the tables, as options spell them.
pub const TABLES: [&str; 4] = ["frames", "transactions", "readings", "findings"];

/// A list of numbers that still stands on the wire.
#[derive(Clone, Copy, Debug)]
pub enum Items<'a> {
    /// Two bytes each.
    Words(&'a [u8]),
    /// So many bits, lowest first.
    Bits(&'a [u8], usize),
    /// One number.
    One(i32),
}

impl Items<'_> {
    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::Words(bytes) => bytes.len() / 2,
            Self::Bits(bytes, count) => (*count).min(bytes.len() * 8),
            Self::One(_) => 1,
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of them.
    #[inline]
    pub fn get(&self, index: usize) -> i32 {
        match self {
            Self::Words(bytes) => i32::from(u16::from_be_bytes([bytes[2 * index], bytes[2 * index + 1]])),
            Self::Bits(bytes, _) => i32::from(bytes[index / 8] >> (index % 8) & 1),
            Self::One(value) => *value,
        }
    }
}

/// One value of a row.
#[derive(Clone, Debug)]
pub enum Cell<'a> {
    /// Nothing.
    Null,
    /// A number.
    Int(i64),
    /// A duration; columns show microseconds.
    Us(Ns),
    /// A time: ns since 1970.
    Time(Ns),
    /// Yes or no.
    Bool(bool),
    /// A word of ours: it needs no escaping.
    Word(&'a str),
    /// Text from outside.
    Text(&'a str),
    /// Bytes as hex.
    Hex(&'a [u8]),
    /// Numbers.
    Ints(Items<'a>),
    /// Codes of findings.
    Codes(&'a [Finding]),
    /// Decoded fields.
    Map(Json),
    /// Where it stands: file, kind of place, number.
    Source(&'a str, Place, u64),
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// int64.
    Int,
    /// Microseconds, float64.
    Us,
    /// timestamp[ns, UTC].
    Time,
    /// float64.
    Float,
    /// bool.
    Bool,
    /// utf8, bytes as hex among them.
    Text,
    /// list of int32.
    Ints,
    /// list of utf8.
    Texts,
    /// JSON text.
    Map,
}

/// A column as `columns.toml` has it.
#[derive(Clone, Debug)]
pub struct Column {
    /// Name.
    pub key: String,
    /// Type.
    pub kind: Kind,
}

/// Which table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableKind {
    /// One row a frame.
    Frames,
    /// One row a transaction.
    Transactions,
    /// One row a register or bit.
    Readings,
    /// One row a finding.
    Findings,
}

impl TableKind {
    /// The table of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let kinds = [Self::Frames, Self::Transactions, Self::Readings, Self::Findings];
        TABLES.iter().position(|table| *table == name).map(|i| kinds[i])
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        TABLES[self as usize]
    }

    /// Its columns, in order.
    pub fn columns(self) -> &'static [Column] {
        static ALL: OnceLock<Vec<Vec<Column>>> = OnceLock::new();
        let all = ALL.get_or_init(|| {
            let file: Json = toml::from_str(COLUMNS).expect("the embedded columns are tested");
            TABLES.iter().map(|table| file[*table].as_array().expect("a list").iter().map(column).collect()).collect()
        });
        &all[self as usize]
    }

    /// The place of a column, or all known names in the error.
    pub fn column(self, key: &str) -> Result<usize, String> {
        let columns = self.columns();
        columns.iter().position(|column| column.key == key).ok_or_else(|| {
            let known: Vec<&str> = columns.iter().map(|column| column.key.as_str()).collect();
            format!("{} has no column {key:?}; it has {}", self.name(), known.join(", "))
        })
    }
}

fn column(row: &Json) -> Column {
    let kind = match row["type"].as_str() {
        Some("int") => Kind::Int,
        Some("us") => Kind::Us,
        Some("time") => Kind::Time,
        Some("float") => Kind::Float,
        Some("bool") => Kind::Bool,
        Some("ints") => Kind::Ints,
        Some("texts") => Kind::Texts,
        Some("map") => Kind::Map,
        Some("text" | "hex") => Kind::Text,
        other => panic!("columns.toml: unknown type {other:?}"),
    };
    Column { key: row["key"].as_str().expect("a key").to_owned(), kind }
}

/// A view on rows of a batch.
#[derive(Clone, Debug)]
pub struct Table {
    /// The batch.
    pub batch: Arc<Batch>,
    /// Which table.
    pub kind: TableKind,
    rows: Rows,
}

#[derive(Clone, Debug)]
enum Rows {
    All(usize),
    Some(Arc<Vec<u32>>),
    /// Transaction, item, whether it was written.
    Readings(Arc<Vec<(u32, u16, bool)>>),
}

impl Table {
    /// All rows of this kind.
    pub fn new(batch: Arc<Batch>, kind: TableKind) -> Self {
        let rows = match kind {
            TableKind::Frames => Rows::All(batch.frames.len()),
            TableKind::Transactions => Rows::All(batch.transactions.len()),
            TableKind::Findings => Rows::All(batch.findings.len()),
            TableKind::Readings => Rows::Readings(Arc::new(readings(&batch))),
        };
        Self { batch, kind, rows }
    }

    /// The rows for which `keep` says yes.
    #[must_use]
    pub fn filter(&self, mut keep: impl FnMut(&Self, usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.len()).filter(|&row| keep(self, row)).collect();
        let rows = match &self.rows {
            Rows::Readings(items) => Rows::Readings(Arc::new(kept.into_iter().map(|row| items[row]).collect())),
            _ => Rows::Some(Arc::new(kept.into_iter().map(|row| self.index(row) as u32).collect())),
        };
        Self { batch: Arc::clone(&self.batch), kind: self.kind, rows }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        match &self.rows {
            Rows::All(count) => *count,
            Rows::Some(rows) => rows.len(),
            Rows::Readings(rows) => rows.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn index(&self, row: usize) -> usize {
        match &self.rows {
            Rows::Some(rows) => rows[row] as usize,
            _ => row,
        }
    }

    /// One value.
    #[inline]
    pub fn cell(&self, row: usize, column: usize) -> Cell<'_> {
        let batch = &*self.batch;
        match (&self.rows, self.kind) {
            (Rows::Readings(rows), _) => READINGS[column].1(batch, rows[row]),
            (_, TableKind::Frames) => FRAMES[column].1(batch, &batch.frames[self.index(row)]),
            (_, TableKind::Findings) => FINDINGS[column].1(batch, &batch.findings[self.index(row)]),
            _ => TRANSACTIONS[column].1(batch, &batch.transactions[self.index(row)]),
        }
    }

    /// The transaction behind a row, where rows are transactions.
    pub fn transaction(&self, row: usize) -> Option<&Transaction> {
        (self.kind == TableKind::Transactions).then(|| &self.batch.transactions[self.index(row)])
    }
}

type Read<R> = for<'a> fn(&'a Batch, &'a R) -> Cell<'a>;

fn bus(batch: &Batch, index: u32) -> &Bus {
    &batch.buses[index as usize]
}

fn functions(batch: &Batch) -> &Functions {
    batch.functions.as_deref().unwrap_or_else(|| Functions::embedded())
}

fn time<'a>(batch: &Batch, index: u32, start: Option<Ns>) -> Cell<'a> {
    match start {
        Some(ns) if bus(batch, index).clock == Clock::Utc => Cell::Time(ns),
        _ => Cell::Null,
    }
}

fn us<'a>(ns: Option<Ns>) -> Cell<'a> {
    ns.map_or(Cell::Null, Cell::Us)
}

fn int<'a, T: Into<i64>>(value: Option<T>) -> Cell<'a> {
    value.map_or(Cell::Null, |value| Cell::Int(value.into()))
}

fn number<'a>(value: Option<u64>) -> Cell<'a> {
    value.map_or(Cell::Null, |value| Cell::Int(value as i64))
}

fn name(batch: &Batch, code: Option<u8>) -> Cell<'_> {
    code.and_then(|code| functions(batch).name(code & !EXCEPTION_BIT)).map_or(Cell::Null, Cell::Text)
}

fn source(batch: &Batch, index: u32, origin: u64) -> Cell<'_> {
    let bus = bus(batch, index);
    Cell::Source(&bus.source, bus.place, origin)
}

const FRAMES: &[(&str, Read<Frame>)] = &[
    ("frame", |_, f| Cell::Int(f.number as i64)),
    ("time", |b, f| time(b, f.bus, f.start)),
    ("elapsed_us", |_, f| us(f.elapsed)),
    ("bus", |b, f| Cell::Text(&bus(b, f.bus).name)),
    ("line", |_, f| match f.line {
        0 => Cell::Null,
        1 => Cell::Word("A"),
        _ => Cell::Word("B"),
    }),
    ("client", |_, _| Cell::Null),
    ("server", |_, _| Cell::Null),
    ("connection", |_, _| Cell::Null),
    ("byte_offset", |_, f| Cell::Int(f.offset as i64)),
    ("byte_length", |_, f| Cell::Int(i64::from(f.wire.length))),
    ("mode", |_, f| Cell::Word(f.mode.text())),
    ("direction", |_, f| Cell::Word(f.direction.text())),
    ("unit", |_, f| int(f.unit)),
    ("function", |_, f| int(f.code.map(|code| code & !EXCEPTION_BIT))),
    ("function_name", |b, f| name(b, f.code)),
    ("exception", |_, f| int(f.exception)),
    ("verdict", |_, f| Cell::Word(f.verdict.text())),
    ("tentative", |_, f| Cell::Bool(f.tentative)),
    ("confidence", |_, f| Cell::Int(i64::from(f.confidence))),
    ("gap_us", |_, f| us(f.gap)),
    ("cut_by", |_, f| Cell::Word(f.cut_by.text())),
    ("txn", |_, f| number(f.txn)),
    ("mbap_id", |_, f| int(f.mbap_id)),
    ("findings", |b, f| Cell::Codes(f.findings.of(&b.codes))),
    ("source", |b, f| source(b, f.bus, f.origin)),
    ("hex", |b, f| Cell::Hex(f.wire.of(&b.arena))),
];

const TRANSACTIONS: &[(&str, Read<Transaction>)] = &[
    ("txn", |_, t| Cell::Int(t.number as i64)),
    ("time", |b, t| time(b, t.bus, t.start)),
    ("elapsed_us", |_, t| us(t.elapsed)),
    ("bus", |b, t| Cell::Text(&bus(b, t.bus).name)),
    ("client", |_, _| Cell::Null),
    ("server", |_, _| Cell::Null),
    ("connection", |_, _| Cell::Null),
    ("mode", |_, t| Cell::Word(t.mode.text())),
    ("unit", |_, t| Cell::Int(i64::from(t.unit))),
    ("function", |_, t| Cell::Int(i64::from(t.function))),
    ("function_name", |b, t| name(b, Some(t.function))),
    ("operation", |b, t| row_of(b, t).map_or(Cell::Word("other"), |row| Cell::Word(row.operation.text()))),
    ("register_type", |b, t| row_of(b, t).and_then(|row| row.register_type.as_deref()).map_or(Cell::Null, Cell::Text)),
    ("address", |b, t| int(read_range(b, t).map(|range| range.0))),
    ("quantity", |b, t| int(read_range(b, t).map(|range| range.1))),
    ("data", |b, t| read_data(b, t).map_or(Cell::Null, Cell::Ints)),
    ("write_address", |b, t| int(write_range(b, t).map(|range| range.0))),
    ("write_quantity", |b, t| int(write_range(b, t).map(|range| range.1))),
    ("write_data", |b, t| write_data(b, t).map_or(Cell::Null, Cell::Ints)),
    ("fields", fields),
    ("readings", |_, _| Cell::Null),
    ("status", |_, t| Cell::Word(t.status.text())),
    ("exception", |_, t| int(t.exception)),
    ("exception_name", |_, t| t.exception.and_then(exception_name).map_or(Cell::Null, Cell::Word)),
    ("response_time_us", |_, t| us(t.response_time)),
    ("waited_us", |_, t| us(t.waited)),
    ("late_response_us", |_, t| us(t.late_response)),
    ("retry_of", |_, t| number(t.retry_of)),
    ("late_for", |_, t| number(t.late_for)),
    ("gap_us", |_, t| us(t.gap)),
    ("mbap_id", |_, t| int(t.mbap_id)),
    ("request_hex", |b, t| half_hex(b, &t.request)),
    ("response_hex", |b, t| half_hex(b, &t.response)),
    ("request_frame", |_, t| number(Some(t.request.frame).filter(|&n| n > 0))),
    ("response_frame", |_, t| number(Some(t.response.frame).filter(|&n| n > 0))),
    ("findings", |b, t| Cell::Codes(t.findings.of(&b.codes))),
    ("source", |b, t| source(b, t.bus, t.origin)),
];

type ReadItem = for<'a> fn(&'a Batch, (u32, u16, bool)) -> Cell<'a>;

const READINGS: &[(&str, ReadItem)] = &[
    ("txn", |b, r| Cell::Int(txn(b, r).number as i64)),
    ("frame", |b, r| Cell::Int(half(b, r).frame as i64)),
    ("time", |b, r| time(b, txn(b, r).bus, half(b, r).start)),
    ("elapsed_us", |b, r| {
        let shift = txn(b, r).start.zip(txn(b, r).elapsed).map(|(start, elapsed)| start - elapsed);
        us(half(b, r).start.zip(shift).map(|(start, shift)| start - shift))
    }),
    ("bus", |b, r| Cell::Text(&bus(b, txn(b, r).bus).name)),
    ("client", |_, _| Cell::Null),
    ("unit", |b, r| Cell::Int(i64::from(txn(b, r).unit))),
    ("function", |b, r| Cell::Int(i64::from(txn(b, r).function))),
    ("register_type", |b, r| row_of(b, txn(b, r)).and_then(|row| row.register_type.as_deref()).map_or(Cell::Null, Cell::Text)),
    ("address", |b, r| {
        let range = if r.2 { write_range(b, txn(b, r)) } else { read_range(b, txn(b, r)) };
        int(range.map(|range| (i64::from(range.0) + i64::from(r.1)) & 0xFFFF))
    }),
    ("operation", |_, r| Cell::Word(if r.2 { "write" } else { "read" })),
    ("status", |b, r| Cell::Word(txn(b, r).status.text())),
    ("raw", |b, r| item(b, r).map_or(Cell::Null, |value| Cell::Ints(Items::One(value)))),
    ("name", |_, _| Cell::Null),
    ("value", |b, r| int(item(b, r))),
    ("value_text", |b, r| int(item(b, r))),
    ("unit_of_measure", |_, _| Cell::Null),
];

const FINDINGS: &[(&str, Read<FindingRow>)] = &[
    ("frame", |_, f| number(f.frame)),
    ("txn", |_, f| number(f.txn)),
    ("time", |b, f| time(b, f.bus, f.start)),
    ("elapsed_us", |_, f| us(f.elapsed)),
    ("bus", |b, f| Cell::Text(&bus(b, f.bus).name)),
    ("unit", |_, f| int(f.unit)),
    ("code", |_, f| Cell::Word(f.finding.doc().code)),
    ("severity", |_, f| Cell::Word(f.finding.doc().severity.text())),
    ("detail", |_, f| Cell::Text(&f.detail)),
    ("evidence", |_, f| Cell::Text(f.finding.doc().why)),
    ("advice", |_, f| Cell::Text(f.finding.doc().advice)),
    ("source", |b, f| source(b, f.bus, f.origin)),
];

fn half_hex<'a>(batch: &'a Batch, half: &Half) -> Cell<'a> {
    if half.frame == 0 {
        Cell::Null
    } else {
        Cell::Hex(half.wire.of(&batch.arena))
    }
}

fn request<'a>(batch: &'a Batch, t: &Transaction) -> &'a [u8] {
    t.request.pdu.of(&batch.arena)
}

fn response<'a>(batch: &'a Batch, t: &Transaction) -> &'a [u8] {
    t.response.pdu.of(&batch.arena)
}

/// The table's row for a transaction; the request tells the variant, or else the response.
pub fn row_of<'a>(batch: &'a Batch, t: &Transaction) -> Option<&'a Row> {
    let pdu = if t.request.pdu.length > 0 { request(batch, t) } else { response(batch, t) };
    functions(batch).row(t.function, pdu.get(1..).unwrap_or(&[]))
}

/// Whether the request can be believed.
fn asked<'a>(batch: &'a Batch, t: &Transaction) -> Option<&'a [u8]> {
    let pdu = request(batch, t);
    (!pdu.is_empty() && t.status != Status::BadRequest).then(|| &pdu[1..])
}

/// Address and quantity of what was read.
pub fn read_range(batch: &Batch, t: &Transaction) -> Option<(u16, u16)> {
    let row = row_of(batch, t)?;
    let body = asked(batch, t)?;
    if !matches!(row.operation, Operation::Read | Operation::ReadWrite) {
        return None;
    }
    Some((u16_at(body, row.roles.address?)?, u16_at(body, row.roles.quantity?)?))
}

/// Address and quantity of what was written.
pub fn write_range(batch: &Batch, t: &Transaction) -> Option<(u16, u16)> {
    let row = row_of(batch, t)?;
    let (roles, body) = (&row.roles, asked(batch, t)?);
    let (address, quantity) = match row.operation {
        Operation::Write => (roles.address, roles.quantity),
        Operation::ReadWrite => (roles.write_address, roles.write_quantity),
        _ => return None,
    };
    // Single writes have no quantity: it is one.
    Some((u16_at(body, address?)?, quantity.map_or(Some(1), |at| u16_at(body, at))?))
}

/// What was read.
pub fn read_data<'a>(batch: &'a Batch, t: &Transaction) -> Option<Items<'a>> {
    let row = row_of(batch, t)?;
    let pdu = response(batch, t);
    if !matches!(t.status, Status::Ok | Status::Unrequested) || t.exception.is_some() {
        return None;
    }
    let (at, bits) = row.roles.response_block?;
    let block = pdu.get(1 + at..)?;
    Some(if bits {
        let quantity = read_range(batch, t).map_or(block.len() * 8, |range| usize::from(range.1));
        Items::Bits(block, quantity)
    } else {
        Items::Words(block)
    })
}

/// What was written.
pub fn write_data<'a>(batch: &'a Batch, t: &Transaction) -> Option<Items<'a>> {
    let row = row_of(batch, t)?;
    let body = asked(batch, t)?;
    if !matches!(row.operation, Operation::Write | Operation::ReadWrite) {
        return None;
    }
    if let Some(value) = row.roles.value.and_then(|at| u16_at(body, at)) {
        // A single coil is FF00 for on, 0000 for off (6.5); anything else is shown as it is.
        let coil = row.register_type.as_deref() == Some("coil");
        return Some(Items::One(if coil && value == 0xFF00 { 1 } else { i32::from(value) }));
    }
    let (at, bits) = row.roles.request_block?;
    let block = body.get(at..)?;
    Some(if bits { Items::Bits(block, usize::from(write_range(batch, t)?.1)) } else { Items::Words(block) })
}

/// Decoded fields where the content is not one block: both sides, those of the response last.
fn fields<'a>(batch: &'a Batch, t: &'a Transaction) -> Cell<'a> {
    let Some(row) = row_of(batch, t) else {
        return raw_fields(batch, t);
    };
    let blocks = row.roles.request_block.is_some() || row.roles.response_block.is_some();
    if row.operation != Operation::Other && (blocks || row.roles.value.is_some()) {
        return Cell::Null;
    }
    if row.request == Layout::Unknown {
        return raw_fields(batch, t);
    }
    let mut map = serde_json::Map::new();
    let sides =
        [(asked(batch, t), &row.request), (Some(response(batch, t)).filter(|p| p.len() > 1).map(|p| &p[1..]), &row.response)];
    let answered = t.exception.is_none() && !matches!(t.status, Status::BadResponse | Status::BadRequest);
    for (body, layout) in sides.into_iter().take(if answered { 2 } else { 1 }) {
        let (Some(body), Some(shape)) = (body, layout.shape()) else { continue };
        map.extend(pdu::object(&pdu::decode(shape, body).nodes));
    }
    if row.operation != Operation::Other {
        map.remove("address");
    }
    if map.is_empty() {
        Cell::Null
    } else {
        Cell::Map(Json::Object(map))
    }
}

fn raw_fields<'a>(batch: &'a Batch, t: &Transaction) -> Cell<'a> {
    let mut map = serde_json::Map::new();
    for (key, pdu) in [("request", request(batch, t)), ("response", response(batch, t))] {
        if let Some(body) = pdu.get(1..) {
            map.insert(key.into(), Json::from(pdu::hex(body)));
        }
    }
    if map.is_empty() {
        Cell::Null
    } else {
        Cell::Map(Json::Object(map))
    }
}

fn readings(batch: &Batch) -> Vec<(u32, u16, bool)> {
    let mut rows = Vec::new();
    for (i, t) in batch.transactions.iter().enumerate() {
        // Refused and unanswered writes are listed too, with their status.
        let blocks = [(write_data(batch, t), true), (read_data(batch, t).filter(|_| read_range(batch, t).is_some()), false)];
        for (items, write) in blocks {
            rows.extend((0..items.map_or(0, |items| items.len())).map(|n| (i as u32, n as u16, write)));
        }
    }
    rows
}

fn txn(batch: &Batch, reading: (u32, u16, bool)) -> &Transaction {
    &batch.transactions[reading.0 as usize]
}

fn half(batch: &Batch, reading: (u32, u16, bool)) -> &Half {
    let t = txn(batch, reading);
    if reading.2 {
        &t.request
    } else {
        &t.response
    }
}

fn item(batch: &Batch, reading: (u32, u16, bool)) -> Option<i32> {
    let t = txn(batch, reading);
    let items = if reading.2 { write_data(batch, t) } else { read_data(batch, t) };
    items.filter(|items| usize::from(reading.1) < items.len()).map(|items| items.get(usize::from(reading.1)))
}

/// Names of exception codes (application protocol, 7), from the embedded vocabulary.
pub fn exception_name(code: u8) -> Option<&'static str> {
    static NAMES: OnceLock<Vec<(u8, String)>> = OnceLock::new();
    let names = NAMES.get_or_init(|| {
        let file: Json = toml::from_str(crate::functions::VOCABULARY).expect("the embedded vocabulary is tested");
        let rows = file["exception"].as_array().cloned().unwrap_or_default();
        rows.iter().filter_map(|row| Some((row["code"].as_u64()? as u8, row["name"].as_str()?.to_owned()))).collect()
    });
    names.iter().find(|(known, _)| *known == code).map(|(_, name)| name.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_of_the_file_has_its_line_here() {
        let here: [Vec<&str>; 4] = [
            FRAMES.iter().map(|c| c.0).collect(),
            TRANSACTIONS.iter().map(|c| c.0).collect(),
            READINGS.iter().map(|c| c.0).collect(),
            FINDINGS.iter().map(|c| c.0).collect(),
        ];
        for (kind, here) in
            [TableKind::Frames, TableKind::Transactions, TableKind::Readings, TableKind::Findings].iter().zip(here)
        {
            let there: Vec<&str> = kind.columns().iter().map(|column| column.key.as_str()).collect();
            assert_eq!(here, there, "{}", kind.name());
        }
    }
}
