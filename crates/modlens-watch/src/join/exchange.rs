//! Transactions as joining needs them: bytes of both PDUs, times, and the cells that a joined row copies.

use std::sync::Arc;

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::line::LineSettings;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_tables::columns::{blocks, Cell, Items, Table, TableKind};
use serde_json::{json, Map, Value as Json};

/// The columns of transactions that a joined row has as well.
const COPIED: [&str; 9] = [
    "function",
    "function_name",
    "operation",
    "register_type",
    "address",
    "quantity",
    "write_address",
    "write_quantity",
    "write_data",
];

/// Registers or bits: their table, the first address, and the values.
pub(super) type Block = (Space, u16, Vec<i32>);

/// A transaction of either side.
#[derive(Clone, Debug)]
pub(super) struct Exchange {
    pub number: u64,
    /// Name of the bus: the server's endpoint on the network.
    pub bus: Arc<str>,
    pub client: Option<Arc<str>>,
    pub connection: Option<u64>,
    /// Start of the request; of the response where there is no request.
    pub start: Ns,
    /// End of the request.
    pub request_end: Ns,
    /// End of the response.
    pub end: Option<Ns>,
    pub unit: u8,
    /// PDU of the request; empty where there is none.
    pub request: Box<[u8]>,
    /// PDU of the response; empty where there is none.
    pub response: Box<[u8]>,
    pub status: Status,
    pub exception: Option<u8>,
    /// From the end of an unanswered request to the next one.
    pub waited: Option<Ns>,
    pub retry_of: Option<u64>,
    pub late_response_to: Option<u64>,
    pub read: Option<Block>,
    pub written: Option<Block>,
    /// Whether the filter keeps it.
    pub is_wanted: bool,
    /// The copied columns.
    pub cells: Map<String, Json>,
}

impl Exchange {
    /// Reads a row of the table of transactions; `None` without a time.
    pub fn new(table: &Table, row: usize, is_wanted: bool) -> Option<Self> {
        let batch = &*table.batch;
        let t = table.transaction(row)?;
        let bus = &batch.buses[t.bus as usize];
        let char_ns = bus.line.as_ref().filter(|_| bus.network.is_none()).map_or(0, LineSettings::char_ns);
        // Times of frames are on the clock of `start`; where that has no date, both are counted from the first byte.
        let start = t.start.or(t.elapsed)?;
        let shift = t.request.start.or(t.response.start).map_or(0, |frame| start - frame);
        let end_of = |frame: &modlens_engine::records::FrameRef| {
            frame.start.map(|time| time + shift + char_ns * Ns::from(frame.wire.length))
        };
        let end = if t.response.frame > 0 { end_of(&t.response) } else { None };
        let (read, written) = values(batch, t);
        Some(Self {
            number: t.number,
            bus: bus.name.as_str().into(),
            client: bus.network.as_ref().map(|network| network.client.as_str().into()),
            connection: bus.network.as_ref().map(|network| network.connection),
            start,
            request_end: end_of(&t.request).unwrap_or(start),
            end,
            unit: t.unit,
            request: t.request.pdu.of(&batch.arena).into(),
            response: t.response.pdu.of(&batch.arena).into(),
            status: t.status,
            exception: t.exception,
            waited: t.waited,
            retry_of: t.retry_of,
            late_response_to: t.late_response_to,
            read,
            written,
            is_wanted,
            cells: cells(table, row),
        })
    }

    /// Whether a response came that can be compared.
    pub fn is_answered(&self) -> bool {
        matches!(self.status, Status::Ok | Status::Exception) && self.end.is_some()
    }

    /// Whether the response is one that a gateway gives itself: path unavailable, or no response from the target.
    pub fn is_gateway_exception(&self) -> bool {
        self.status == Status::Exception && matches!(self.exception, Some(10 | 11))
    }
}

fn values(batch: &Batch, t: &Transaction) -> (Option<Block>, Option<Block>) {
    let Some(found) = blocks(batch, t).filter(|_| t.status == Status::Ok) else { return (None, None) };
    let block = |(first, items): (u16, Items<'_>)| (found.space, first, numbers(&items));
    (found.read.map(block), found.written.map(block))
}

fn numbers(items: &Items<'_>) -> Vec<i32> {
    (0..items.len()).map(|at| items.get(at)).collect()
}

fn cells(table: &Table, row: usize) -> Map<String, Json> {
    let mut found = Map::new();
    for key in COPIED {
        let column = TableKind::Transactions.column(key).expect("a column of transactions");
        let value = match table.cell(row, column) {
            Cell::Int(number) => json!(number),
            Cell::Word(text) | Cell::Text(text) => json!(text),
            Cell::Ints(items) => json!(numbers(&items)),
            _ => Json::Null,
        };
        found.insert(key.to_owned(), value);
    }
    found
}

/// A request on the network with what the line did for it.
#[derive(Debug)]
pub(super) struct Request {
    pub exchange: Exchange,
    pub attempts: Vec<Exchange>,
}
