//! The content of a transaction's columns: addresses, values and fields, decoded from its PDUs on demand.

use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use serde_json::Value as Json;

use crate::columns::cell::{Cell, Items};
use crate::columns::fields::Fields;
use crate::columns::function_rows::row_of;
use modlens_engine::records::{Batch, Transaction};
use modlens_profiles::points::{PlanInstance, Value};
use modlens_protocol::functions::{FunctionRow, Layout, Operation};
use modlens_protocol::pdu::{self, u16_at};
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;

/// A transaction with its row of the table of functions, which most columns need.
#[derive(Clone, Copy)]
pub(super) struct TransactionView<'a> {
    pub(super) t: &'a Transaction,
    row: Option<&'a FunctionRow>,
    /// The profile of its unit. The row of a compact exchange has none itself.
    pub(super) points: Option<&'a Arc<PlanInstance>>,
}

impl Deref for TransactionView<'_> {
    type Target = Transaction;

    fn deref(&self) -> &Transaction {
        self.t
    }
}

/// Address and quantity of the registers or bits that were read.
pub fn read_range(batch: &Batch, t: &Transaction) -> Option<(u16, u16)> {
    TransactionView::new(batch, t).read_range(batch)
}

/// Address and quantity of the registers or bits that were written.
pub fn write_range(batch: &Batch, t: &Transaction) -> Option<(u16, u16)> {
    TransactionView::new(batch, t).write_range(batch)
}

/// The registers or bits that were read.
pub fn read_data<'a>(batch: &'a Batch, t: &Transaction) -> Option<Items<'a>> {
    TransactionView::new(batch, t).read_data(batch)
}

/// The registers or bits that were written.
pub fn write_data<'a>(batch: &'a Batch, t: &Transaction) -> Option<Items<'a>> {
    TransactionView::new(batch, t).write_data(batch)
}

/// What a transaction wrote and read of registers or bits.
pub struct Blocks<'a> {
    /// Which of the four tables it is about.
    pub space: Space,
    /// Address and values of the block that was written.
    pub written: Option<(u16, Items<'a>)>,
    /// Address and values of the block that was read.
    pub read: Option<(u16, Items<'a>)>,
}

/// What a transaction wrote and read; `None` if its function is not about registers or bits.
#[inline]
pub fn blocks<'a>(batch: &'a Batch, t: &Transaction) -> Option<Blocks<'a>> {
    let view = TransactionView::new(batch, t);
    Some(Blocks { space: view.space()?, written: view.written(batch), read: view.read(batch) })
}

impl<'a> TransactionView<'a> {
    #[inline]
    pub(super) fn new(batch: &'a Batch, t: &'a Transaction) -> Self {
        Self { t, row: row_of(batch, t), points: t.points.as_ref() }
    }

    /// With the row of the table that somebody has looked up before, and the profile of its unit.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    pub(super) fn of_exchange(t: &'a Transaction, row: Option<&'a FunctionRow>, points: Option<&'a Arc<PlanInstance>>) -> Self {
        Self { t, row, points }
    }

    #[inline]
    pub(super) fn operation(self) -> Operation {
        self.row.map_or(Operation::Other, |row| row.operation)
    }

    #[inline]
    pub(super) fn register_type(self) -> Option<&'a str> {
        self.row?.register_type.as_deref()
    }

    #[inline]
    pub(super) fn space(self) -> Option<Space> {
        self.row?.space
    }

    /// Address and values of the block that was read.
    #[inline]
    pub(super) fn read(self, batch: &Batch) -> Option<(u16, Items<'_>)> {
        Some((self.read_range(batch)?.0, self.read_data(batch)?))
    }

    /// Address and values of the block that was written.
    #[inline]
    pub(super) fn written(self, batch: &Batch) -> Option<(u16, Items<'_>)> {
        Some((self.write_range(batch)?.0, self.write_data(batch)?))
    }

    /// The PDU of the response; empty if there is none.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    fn response(self, batch: &Batch) -> &[u8] {
        self.t.response.pdu.of(&batch.arena)
    }

    /// The body of the request, unless it was not observed or is damaged.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    fn request_body(self, batch: &Batch) -> Option<&[u8]> {
        let pdu = self.t.request.pdu.of(&batch.arena);
        (!pdu.is_empty() && self.status != Status::BadRequest).then(|| &pdu[1..])
    }

    /// The body of a response without request that repeats address and quantity of the request, as those of Write Multiple
    /// Coils and Registers do (application protocol, 6.11 and 6.12).
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    fn echoing_body(self, batch: &Batch) -> Option<&[u8]> {
        let row = self.row.filter(|_| self.status == Status::Unsolicited && self.exception.is_none())?;
        echoing_body(row, self.response(batch).get(1..)?)
    }

    /// Address and quantity in the request; `None` if the function reads nothing.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    pub(super) fn read_range(self, batch: &Batch) -> Option<(u16, u16)> {
        let row = self.row?;
        if !matches!(row.operation, Operation::Read | Operation::ReadWrite) {
            return None;
        }
        let body = self.request_body(batch)?;
        Some((u16_at(body, row.offsets.address?)?, u16_at(body, row.offsets.quantity?)?))
    }

    /// Address and quantity of what the request writes, or of what a response without request says was written; `None` if the
    /// function writes nothing.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    pub(super) fn write_range(self, batch: &Batch) -> Option<(u16, u16)> {
        let row = self.row?;
        let (roles, body) = (&row.offsets, self.request_body(batch).or_else(|| self.echoing_body(batch))?);
        let (address, quantity) = match row.operation {
            Operation::Write => (roles.address, roles.quantity),
            Operation::ReadWrite => (roles.write_address, roles.write_quantity),
            _ => return None,
        };
        // A single write has no quantity field: it writes one.
        Some((u16_at(body, address?)?, quantity.map_or(Some(1), |at| u16_at(body, at))?))
    }

    /// The registers or bits in the response; `None` if it was not observed, is damaged, or is an exception.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    pub(super) fn read_data(self, batch: &Batch) -> Option<Items<'_>> {
        let row = self.row?;
        if !matches!(self.status, Status::Ok | Status::Unsolicited) || self.exception.is_some() {
            return None;
        }
        let (at, bits) = row.offsets.response_block?;
        let block = self.response(batch).get(1 + at..)?;
        Some(if bits {
            let quantity = self.read_range(batch).map_or(block.len() * 8, |range| usize::from(range.1));
            Items::Bits(block, quantity)
        } else {
            Items::Words(block)
        })
    }

    /// The registers or bits in the request; `None` if the function writes none, or the request was not observed or is
    /// damaged.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `ExchangeRef::transaction`.
    pub(super) fn write_data(self, batch: &Batch) -> Option<Items<'_>> {
        let row = self.row?;
        if !matches!(row.operation, Operation::Write | Operation::ReadWrite) {
            return None;
        }
        let body = self.request_body(batch)?;
        if let Some(value) = row.offsets.value.and_then(|at| u16_at(body, at)) {
            // A single coil is written as FF00 for on and 0000 for off (section 6.5); other values are shown as they
            // are.
            let coil = row.register_type.as_deref() == Some("coil");
            return Some(Items::One(if coil && value == 0xFF00 { 1 } else { i32::from(value) }));
        }
        let (at, bits) = row.offsets.request_block?;
        let block = body.get(at..)?;
        Some(if bits { Items::Bits(block, usize::from(self.write_range(batch)?.1)) } else { Items::Words(block) })
    }

    /// The decoded fields of request and response, if the function's content is more than one block of registers or
    /// bits; `None` if other columns show everything.
    #[inline]
    pub(super) fn fields(self, batch: &'a Batch) -> Option<Cell<'a>> {
        let Some(row) = self.row else { return Some(self.undecoded(batch)) };
        let blocks = row.offsets.request_block.is_some() || row.offsets.response_block.is_some();
        let is_shown_by_other_columns = row.operation != Operation::Other && (blocks || row.offsets.value.is_some());
        (!is_shown_by_other_columns).then(|| self.decoded(batch, row))
    }

    /// The decoded fields of request and response. A damaged message, and the response to a refused request, are left
    /// out.
    fn decoded(self, batch: &'a Batch, row: &'a FunctionRow) -> Cell<'a> {
        if row.request == Layout::Unknown {
            return self.undecoded(batch);
        }
        let response_body = self.response(batch).get(1..).filter(|body| !body.is_empty());
        let is_valid_response = self.exception.is_none() && !matches!(self.status, Status::BadResponse | Status::BadRequest);
        let mut fields = Fields::default();
        for (body, layout) in
            [(self.request_body(batch), &row.request), (response_body.filter(|_| is_valid_response), &row.response)]
        {
            let (Some(body), Some(shape)) = (body, layout.shape()) else { continue };
            pdu::decode(shape, body).fields.into_iter().for_each(|node| fields.add(node));
        }
        if row.operation != Operation::Other {
            fields.remove("address");
        }
        fields_cell(fields)
    }

    /// The undecoded bodies of a function without a known layout.
    fn undecoded(self, batch: &'a Batch) -> Cell<'a> {
        let mut fields = Fields::default();
        // What a damaged request says is not known.
        let request = (self.status != Status::BadRequest).then_some(("request", self.t.request.pdu));
        for (key, pdu) in request.into_iter().chain([("response", self.t.response.pdu)]) {
            fields.bodies.extend(pdu.of(&batch.arena).get(1..).map(|body| (key, body)));
        }
        fields_cell(fields)
    }
}

/// The body of a response, if responses of this function repeat address and quantity of the request.
fn echoing_body<'a>(row: &FunctionRow, body: &'a [u8]) -> Option<&'a [u8]> {
    let shape = row.response.shape()?;
    let repeats = |name: &str, at: Option<usize>| at.is_some() && shape.offset_of(name) == at;
    (repeats("address", row.offsets.address) && repeats("quantity", row.offsets.quantity) && shape.fits(body)).then_some(body)
}

/// The fields as a cell; null if there are none.
fn fields_cell(fields: Fields<'_>) -> Cell<'_> {
    if fields.is_empty() {
        Cell::Null
    } else {
        Cell::Fields(fields)
    }
}

/// The name of a transaction's exception code, followed by the name that the device's profile has for it.
pub(super) fn exception_text(t: &Transaction) -> Cell<'_> {
    let Some(code) = t.exception else { return Cell::Null };
    match (exception_name(code), t.points.as_ref().and_then(|instance| instance.exception(code))) {
        (Some(name), Some(words)) => Cell::Value(Value::Text(format!("{name} ({words})"))),
        (None, Some(words)) => Cell::Text(words),
        (name, None) => name.map_or(Cell::Null, Cell::Word),
    }
}

/// The name of an exception code (Modbus Application Protocol V1.1b3, section 7), from the embedded vocabulary.
pub fn exception_name(code: u8) -> Option<&'static str> {
    static NAMES: OnceLock<Vec<(u8, String)>> = OnceLock::new();
    let names = NAMES.get_or_init(|| {
        let file: Json = toml::from_str(modlens_protocol::functions::VOCABULARY).expect("the embedded vocabulary is tested");
        let rows = file["exception"].as_array().cloned().unwrap_or_default();
        rows.iter().filter_map(|row| Some((row["code"].as_u64()? as u8, row["name"].as_str()?.to_owned()))).collect()
    });
    names.iter().find(|(known, _)| *known == code).map(|(_, name)| name.as_str())
}
