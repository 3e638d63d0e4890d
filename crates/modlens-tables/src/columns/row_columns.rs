//! The columns of frames, transactions, findings, connections and diagnoses, one line each.
//!
//! The readers are compiled into their callers, so that a `Cell` which a writer matches at once is never built in
//! memory.
#![allow(clippy::inline_always)]

use std::mem::ManuallyDrop;

use crate::columns::bus_cells::{bus, network, utc_time};
use crate::columns::cell::{Cell, Items};
use crate::columns::column_value::{Codes, ColumnValue, FunctionName, Hex, Ints, Source, Text, Time, Us, Word};
use crate::columns::exchange_ref::ExchangeRef;
use crate::columns::function_rows::functions;
use crate::columns::reading_columns::named;
use crate::columns::sink::CellSink;
use crate::columns::transaction_view::{exception_text, TransactionView};
use modlens_engine::records::{Batch, Connection, DiagnosisRow, End, FindingRow, Frame, FrameRef};
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;

/// Columns that have the same value in every row of a bus. Writers format these once per bus.
pub(super) const BUS_COLUMNS: [&str; 4] = ["bus", "client", "server", "connection"];

/// Columns that have the same value in the rows of all compact exchanges of a bus and a kind (`Exchange::kind`).
pub(super) const EXCHANGE_KIND_COLUMNS: [&str; 9] =
    ["mode", "function", "function_name", "operation", "register_type", "status", "exception", "exception_name", "findings"];

/// Reads the value of a column from a row.
pub(super) type Read<R> = for<'a> fn(&'a Batch, &'a R) -> Cell<'a>;

/// Reads the value of a column from a transaction.
pub(super) type ReadTransaction = for<'a> fn(&'a Batch, TransactionView<'a>) -> Cell<'a>;

/// Reads the value of a column from a row and passes it to a writer.
pub(super) type Emit<R, S> = for<'a> fn(&'a Batch, &'a R, &mut S);

/// Reads the value of a column from a transaction and passes it to a writer.
pub(super) type EmitTransaction<S> = for<'a> fn(&'a Batch, TransactionView<'a>, &mut S);

/// Reads the value of a column from compact exchanges and passes them to a writer.
pub(super) type EmitExchanges<S> = for<'a> fn(&[ExchangeRef<'a>], &mut S);

/// Defines the columns of a table. `READ` returns a value as a `Cell`; `pass` is compiled for each writer, so that the
/// writer's code for other kinds of values than the column's is removed.
macro_rules! columns {
    ($table:ident: $read:ident, $emit:ident<>, $exchanges:ident; $(($key:literal, |$batch:pat_param, $of:pat_param| $value:expr),)*) => {
        columns! { $table: $read, $emit<>; $(($key, |$batch, $of| $value),)* }

        impl $table {
            /// Compiled for each column: of the row of an exchange only what the column shows is made.
            pub(super) fn emit_exchanges<S: CellSink>(column: usize) -> $exchanges<S> {
                const COUNT: usize = $table::KEYS.len();
                let all = const {
                    let all: [$exchanges<S>; COUNT] = [$(|exchanges, to| {
                        for exchange in exchanges {
                            // There is nothing to drop, and who drops it needs all of it in memory.
                            let row = ManuallyDrop::new(exchange.transaction());
                            let ($batch, $of) = (exchange.batch, exchange.view(&row));
                            $value.emit(to);
                        }
                    }),*];
                    all
                };
                all[column]
            }
        }
    };
    ($table:ident: $read:ident, $emit:ident<$($row:ident)?>; $(($key:literal, |$batch:pat_param, $of:pat_param| $value:expr),)*) => {
        pub(super) struct $table;

        impl $table {
            pub(super) const KEYS: &[&str] = &[$($key),*];
            pub(super) const READ: &[$read$(<$row>)?] = &[$(|$batch, $of| $value.cell()),*];

            pub(super) fn emit<S: CellSink>(column: usize) -> $emit<$($row,)? S> {
                const COUNT: usize = $table::KEYS.len();
                let all = const {
                    let all: [$emit<$($row,)? S>; COUNT] = [$(|$batch, $of, to| $value.emit(to)),*];
                    all
                };
                all[column]
            }
        }
    };
}

/// The name of a function code, with or without the exception bit.
#[inline(always)]
fn name(batch: &Batch, code: Option<u8>) -> Option<FunctionName<'_>> {
    functions(batch).first_variant(code? & !EXCEPTION_BIT).map(FunctionName)
}

/// The position in the input.
#[inline(always)]
fn source(batch: &Batch, index: u32, origin: u64) -> Source<'_> {
    let bus = bus(batch, index);
    Source(&bus.source, bus.place, origin)
}

/// The letter of the line on a two-line tap; none on other buses.
fn line(batch: &Batch, frame: &Frame) -> Option<Word<'static>> {
    match frame.line {
        0 => None,
        _ if bus(batch, frame.bus).network.is_some() => None,
        1 => Some(Word("A")),
        _ => Some(Word("B")),
    }
}

columns! {
    Frames: Read, Emit<Frame>;
    ("frame", |_, f| f.number),
    ("time", |b, f| utc_time(b, f.bus, f.start)),
    ("elapsed_us", |_, f| f.elapsed.map(Us)),
    ("bus", |b, f| Text(&bus(b, f.bus).name)),
    ("line", |b, f| line(b, f)),
    ("client", |b, f| network(b, f.bus, |net| Cell::Text(&net.client))),
    ("server", |b, f| network(b, f.bus, |net| Cell::Text(&net.server))),
    ("connection", |b, f| network(b, f.bus, |net| Cell::Int(net.connection as i64))),
    ("byte_offset", |_, f| f.offset),
    ("byte_length", |_, f| f.wire.length),
    ("mode", |_, f| Word(f.mode.text())),
    ("direction", |_, f| Word(f.direction.text())),
    ("unit", |_, f| f.unit),
    ("function", |_, f| f.code.map(|code| code & !EXCEPTION_BIT)),
    ("function_name", |b, f| name(b, f.code)),
    ("exception", |_, f| f.exception),
    ("verdict", |_, f| Word(f.verdict.text())),
    ("unconfirmed", |_, f| f.unconfirmed),
    ("confidence", |_, f| f.confidence),
    ("gap_us", |_, f| f.gap.map(Us)),
    ("delimited_by", |_, f| Word(f.delimited_by.text())),
    ("txn", |_, f| f.txn),
    ("mbap_id", |_, f| f.mbap_id),
    ("findings", |b, f| Codes(f.findings.of(&b.codes))),
    ("source", |b, f| source(b, f.bus, f.origin)),
    ("hex", |b, f| Hex(f.wire.of(&b.arena))),
}

columns! {
    Transactions: ReadTransaction, EmitTransaction<>, EmitExchanges;
    ("txn", |_, t| t.number),
    ("time", |b, t| utc_time(b, t.bus, t.start)),
    ("elapsed_us", |_, t| t.elapsed.map(Us)),
    ("bus", |b, t| Text(&bus(b, t.bus).name)),
    ("client", |b, t| network(b, t.bus, |net| Cell::Text(&net.client))),
    ("server", |b, t| network(b, t.bus, |net| Cell::Text(&net.server))),
    ("connection", |b, t| network(b, t.bus, |net| Cell::Int(net.connection as i64))),
    ("mode", |_, t| Word(t.mode.text())),
    ("unit", |_, t| t.unit),
    ("function", |_, t| t.function),
    ("function_name", |b, t| name(b, Some(t.function))),
    ("operation", |_, t| Word(t.operation().text())),
    ("register_type", |_, t| t.register_type().map(Word)),
    ("address", |b, t| t.read_range(b).map(|range| range.0)),
    ("quantity", |b, t| t.read_range(b).map(|range| range.1)),
    ("data", |b, t| t.read_data(b).map(Ints)),
    ("write_address", |b, t| t.write_range(b).map(|range| range.0)),
    ("write_quantity", |b, t| t.write_range(b).map(|range| range.1)),
    ("write_data", |b, t| t.write_data(b).map(Ints)),
    ("fields", |b, t| t.fields(b)),
    ("readings", |b, t| t.points.map(|points| named(b, t, points))),
    ("status", |_, t| Word(t.status.text())),
    ("confidence", |_, t| t.confidence),
    ("unconfirmed", |_, t| t.unconfirmed),
    ("exception", |_, t| t.exception),
    ("exception_name", |_, t| t.exception.is_some().then(|| exception_text(t.t))),
    ("response_time_us", |_, t| t.response_time.map(Us)),
    ("waited_us", |_, t| t.waited.map(Us)),
    ("late_response_us", |_, t| t.late_response.map(Us)),
    ("retry_of", |_, t| t.retry_of),
    ("late_response_to", |_, t| t.late_response_to),
    ("gap_us", |_, t| t.gap.map(Us)),
    ("mbap_id", |_, t| t.mbap_id),
    ("request_hex", |b, t| half_hex(b, &t.request)),
    ("response_hex", |b, t| half_hex(b, &t.response)),
    ("request_frame", |_, t| Some(t.request.frame).filter(|&n| n > 0)),
    ("response_frame", |_, t| Some(t.response.frame).filter(|&n| n > 0)),
    ("findings", |b, t| Codes(t.findings.of(&b.codes))),
    ("source", |b, t| source(b, t.bus, t.origin)),
}

columns! {
    Findings: Read, Emit<FindingRow>;
    ("frame", |_, f| f.frame),
    ("txn", |_, f| f.txn),
    ("time", |b, f| utc_time(b, f.bus, f.start)),
    ("elapsed_us", |_, f| f.elapsed.map(Us)),
    ("bus", |b, f| Text(&bus(b, f.bus).name)),
    ("unit", |_, f| f.unit),
    ("code", |_, f| Word(f.finding.doc().code)),
    ("severity", |_, f| Word(f.finding.doc().severity.text())),
    ("detail", |_, f| Text(&f.detail)),
    ("impact", |_, f| Text(f.finding.doc().why)),
    ("advice", |_, f| Text(f.finding.doc().advice)),
    ("source", |b, f| source(b, f.bus, f.origin)),
}

columns! {
    Connections: Read, Emit<Connection>;
    ("connection", |_, c| c.number),
    ("bus", |_, c| Text(&c.server)),
    ("client", |_, c| Text(&c.client)),
    ("client_port", |_, c| c.client_port),
    ("server", |_, c| Text(&c.server)),
    ("opened", |_, c| utc(c, c.opened)),
    ("closed", |_, c| utc(c, c.closed)),
    ("closed_by", |_, c| c.closed_by.map(End::text).map(Word)),
    ("refused", |_, c| c.is_refused),
    ("reset", |_, c| c.is_reset),
    ("requests", |_, c| c.requests),
    ("writes", |_, c| c.writes),
    ("answered", |_, c| c.answered),
    ("first_status", |_, c| c.first_status.map(|status| Word(status.text()))),
    ("in_flight_max", |_, c| c.in_flight_max),
    ("lockstep", |_, c| c.lockstep),
    ("client_framing", |_, c| c.client_framing.map(Word)),
    ("server_framing", |_, c| c.server_framing.map(Word)),
    ("retransmitted_segments", |_, c| c.retransmitted_segments),
    ("lost_bytes", |_, c| c.lost_bytes),
    ("idle_us", |_, c| c.idle.map(Us)),
    ("findings", |_, c| Codes(&c.findings)),
    ("source", |_, c| Source(&c.source, Place::Packet, c.origin)),
}

columns! {
    Diagnoses: Read, Emit<DiagnosisRow>;
    ("code", |_, d| Word(d.code)),
    ("severity", |_, d| Word(d.severity.text())),
    ("bus", |_, d| Text(&d.bus)),
    ("unit", |_, d| d.unit),
    ("function", |_, d| d.function),
    ("address", |_, d| d.address),
    ("client", |_, d| d.client.as_deref().map(Text)),
    ("failed", |_, d| d.failed),
    ("total", |_, d| d.total),
    ("since", |_, d| d.since.map(Time)),
    ("until", |_, d| d.until.map(Time)),
    ("episodes", |_, d| Some(Text(&d.episodes)).filter(|_| !d.episodes.is_empty())),
    ("certainty", |_, d| Word(d.certainty)),
    ("chance", |_, d| d.chance.map(Cell::Float)),
    ("share", |_, d| d.share.map(Cell::Float)),
    ("odds", |_, d| d.odds.map(Cell::Float)),
    ("sentence", |_, d| Text(&d.sentence)),
    ("advice", |_, d| Text(&d.advice)),
    ("proof", |_, d| Text(&d.proof)),
    ("examples", |_, d| Ints(Items::Numbers(&d.examples))),
}

/// A time of a connection, if the clock of its capture is set to UTC.
fn utc(connection: &Connection, time: Option<Ns>) -> Option<Time> {
    time.filter(|_| connection.clock == Clock::Utc).map(Time)
}

/// The bytes of a transaction's request or response frame.
#[inline(always)]
fn half_hex<'a>(batch: &'a Batch, half: &FrameRef) -> Option<Hex<'a>> {
    (half.frame > 0).then(|| Hex(half.wire.of(&batch.arena)))
}
