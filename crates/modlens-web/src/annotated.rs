//! The bytes of a row beside their meaning.

use modlens_protocol::annotate::{annotate, has_checksum, pdu_of, Body, Piece, Wrapping};
use modlens_protocol::framing::{Direction, Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::hex::{hex, parse_hex};
use modlens_protocol::status::Status;
use modlens_tables::cell_text::cell_text;
use modlens_tables::columns::{Table, TableKind};
use serde_json::{json, Value as Json};

use crate::view::Views;

/// The texts of some columns of a row, empty where it has no value.
struct Texts<const N: usize>([String; N]);

impl<const N: usize> Texts<N> {
    fn of(kind: TableKind, (table, row): (&Table, usize), columns: [&str; N]) -> Self {
        Self(columns.map(|key| kind.column(key).map(|at| cell_text(&table.cell(row, at))).unwrap_or_default()))
    }
}

/// A frame and how it is to be read.
struct Frame {
    title: &'static str,
    bytes: Vec<u8>,
    wrapping: Wrapping,
    direction: Direction,
}

impl Frame {
    fn annotated(&self, functions: &Functions, request: Option<&[u8]>) -> Json {
        let body = Body { functions, direction: self.direction, request };
        let blocks: Vec<Json> = annotate(&self.bytes, self.wrapping, body).into_iter().map(block).collect();
        json!({"title": self.title, "blocks": blocks})
    }
}

fn block(piece: Piece) -> Json {
    json!([piece.offset, hex(&piece.bytes), piece.name, piece.value, piece.meaning.text, piece.meaning.is_valid])
}

/// The frames of the row `at` of a view, each with its `title` and `blocks`: offset, bytes in hex, name, value, meaning,
/// whether it is valid. A finding has those of its transaction.
pub(crate) fn annotated(views: &mut Views, functions: &Functions, question: &Json) -> Result<Json, String> {
    let view = views.of(question)?;
    let kind = view.kind();
    let Some(row) = view.window(question["at"].as_u64().unwrap_or_default() as usize, 1).next() else {
        return Ok(json!([]));
    };
    Ok(match kind {
        TableKind::Transactions => transaction(row).map_or_else(|| json!([]), |found| found.annotated(functions)),
        TableKind::Frames => {
            let Texts([mode, bytes, direction, verdict, txn]) =
                Texts::of(kind, row, ["mode", "hex", "direction", "verdict", "txn"]);
            let (Some(mode), Some(bytes)) = (Mode::from_text(&mode), parse_hex(&bytes)) else { return Ok(json!([])) };
            let wrapping = Wrapping::Frame { mode, has_checksum: verdict != Verdict::NoChecksum.text() };
            let direction = Direction::from_text(&direction).unwrap_or(Direction::Unknown);
            let frame = Frame { title: "", bytes, wrapping, direction };
            let asked = if direction == Direction::Response { with_number(views, &txn)? } else { None };
            json!([frame.annotated(functions, asked.and_then(|found| found.asked).as_deref())])
        }
        TableKind::Findings => {
            let Texts([txn]) = Texts::of(kind, row, ["txn"]);
            with_number(views, &txn)?.map_or_else(|| json!([]), |found| found.annotated(functions))
        }
        _ => json!([]),
    })
}

/// The frames of a transaction.
struct Transaction {
    frames: Vec<Frame>,
    /// The PDU of the request.
    asked: Option<Vec<u8>>,
}

impl Transaction {
    fn annotated(&self, functions: &Functions) -> Json {
        self.frames.iter().map(|frame| frame.annotated(functions, self.asked.as_deref())).collect()
    }
}

fn transaction(row: (&Table, usize)) -> Option<Transaction> {
    let Texts([mode, status, request, response]) =
        Texts::of(TableKind::Transactions, row, ["mode", "status", "request_hex", "response_hex"]);
    let mode = Mode::from_text(&mode)?;
    let frame = |title, direction, hex: &str, damaged: Status| {
        let bytes = parse_hex(hex)?;
        let has_checksum = has_checksum(&bytes, mode, status != damaged.text());
        let wrapping = Wrapping::Frame { mode, has_checksum };
        Some(Frame { title, bytes, wrapping, direction })
    };
    let request = frame("request", Direction::Request, &request, Status::BadRequest)?;
    let response = frame("response", Direction::Response, &response, Status::BadResponse)?;
    let Wrapping::Frame { has_checksum, .. } = request.wrapping else { return None };
    let asked = pdu_of(&request.bytes, mode, has_checksum);
    let frames = [request, response].into_iter().filter(|frame| !frame.bytes.is_empty()).collect();
    Some(Transaction { frames, asked })
}

/// The transaction with this number.
fn with_number(views: &mut Views, txn: &str) -> Result<Option<Transaction>, String> {
    if txn.is_empty() {
        return Ok(None);
    }
    let view = views.of(&json!({"table": "transactions"}))?;
    let column = view.kind().column("txn")?;
    let found = view.window(0, view.len()).find(|(table, row)| cell_text(&table.cell(*row, column)) == txn);
    Ok(found.and_then(transaction))
}
