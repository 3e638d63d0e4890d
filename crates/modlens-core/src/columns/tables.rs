//! How each column is read: one line a column.

use crate::columns::content::{fields, read_data, read_range, refusal, row_of, write_data, write_range};
use crate::columns::readings::named;
use crate::columns::{functions, Cell};
use crate::functions::EXCEPTION_BIT;
use crate::records::{Batch, Bus, Clock, FindingRow, Frame, Half, Network, Transaction};
use crate::Ns;

pub(super) type Read<R> = for<'a> fn(&'a Batch, &'a R) -> Cell<'a>;

pub(super) fn bus(batch: &Batch, index: u32) -> &Bus {
    &batch.buses[index as usize]
}

pub(super) fn network(batch: &Batch, index: u32, read: fn(&Network) -> Cell<'_>) -> Cell<'_> {
    bus(batch, index).network.as_ref().map_or(Cell::Null, read)
}

pub(super) fn time<'a>(batch: &Batch, index: u32, start: Option<Ns>) -> Cell<'a> {
    match start {
        Some(ns) if bus(batch, index).clock == Clock::Utc => Cell::Time(ns),
        _ => Cell::Null,
    }
}

pub(super) fn us<'a>(ns: Option<Ns>) -> Cell<'a> {
    ns.map_or(Cell::Null, Cell::Us)
}

pub(super) fn int<'a, T: Into<i64>>(value: Option<T>) -> Cell<'a> {
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

pub(super) const FRAMES: &[(&str, Read<Frame>)] = &[
    ("frame", |_, f| Cell::Int(f.number as i64)),
    ("time", |b, f| time(b, f.bus, f.start)),
    ("elapsed_us", |_, f| us(f.elapsed)),
    ("bus", |b, f| Cell::Text(&bus(b, f.bus).name)),
    ("line", |b, f| match f.line {
        _ if bus(b, f.bus).network.is_some() => Cell::Null,
        0 => Cell::Null,
        1 => Cell::Word("A"),
        _ => Cell::Word("B"),
    }),
    ("client", |b, f| network(b, f.bus, |net| Cell::Text(&net.client))),
    ("server", |b, f| network(b, f.bus, |net| Cell::Text(&net.server))),
    ("connection", |b, f| network(b, f.bus, |net| Cell::Int(net.connection as i64))),
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

pub(super) const TRANSACTIONS: &[(&str, Read<Transaction>)] = &[
    ("txn", |_, t| Cell::Int(t.number as i64)),
    ("time", |b, t| time(b, t.bus, t.start)),
    ("elapsed_us", |_, t| us(t.elapsed)),
    ("bus", |b, t| Cell::Text(&bus(b, t.bus).name)),
    ("client", |b, t| network(b, t.bus, |net| Cell::Text(&net.client))),
    ("server", |b, t| network(b, t.bus, |net| Cell::Text(&net.server))),
    ("connection", |b, t| network(b, t.bus, |net| Cell::Int(net.connection as i64))),
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
    ("readings", named),
    ("status", |_, t| Cell::Word(t.status.text())),
    ("exception", |_, t| int(t.exception)),
    ("exception_name", refusal),
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

pub(super) const FINDINGS: &[(&str, Read<FindingRow>)] = &[
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
