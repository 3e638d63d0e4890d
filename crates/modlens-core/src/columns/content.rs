//! What the rows of a transaction say: addresses, values, fields, read off the PDUs.

use std::sync::OnceLock;

use serde_json::Value as Json;

use crate::columns::{functions, Cell, Items};
use crate::functions::{Layout, Operation, Row};
use crate::pdu::{self, u16_at};
use crate::points::Value;
use crate::records::{Batch, Status, Transaction};

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
pub(super) fn fields<'a>(batch: &'a Batch, t: &'a Transaction) -> Cell<'a> {
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

/// The name of an exception, with the device's own words where its profile has some.
pub(super) fn refusal<'a>(_: &'a Batch, t: &'a Transaction) -> Cell<'a> {
    let Some(code) = t.exception else { return Cell::Null };
    match (exception_name(code), t.points.as_ref().and_then(|bound| bound.exception(code))) {
        (Some(name), Some(words)) => Cell::Value(Value::Text(format!("{name} ({words})"))),
        (None, Some(words)) => Cell::Text(words),
        (name, None) => name.map_or(Cell::Null, Cell::Word),
    }
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
