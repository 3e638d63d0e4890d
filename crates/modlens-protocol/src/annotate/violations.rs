//! Checks numbers in a PDU against the specification and the request: limits of single fields, announced lengths, the
//! address range, and fields that a response has to repeat.

use super::context::Context;
use super::part::Part;
use crate::functions::{FieldType, FunctionRow};
use crate::register_type::LAST_ADDRESS;

/// The violations of a number in a PDU, in a few words each; empty if it is valid.
pub fn violations(part: &Part<'_>, value: u32, context: &Context<'_>) -> Vec<String> {
    let Some(row) = context.pdu.row.filter(|_| context.pdu.exception.is_none()) else { return Vec::new() };
    let found =
        [limit(part, value, row), announced(part, value, context), reach(part, value, context), echo(part, value, context, row)];
    found.into_iter().flatten().collect()
}

fn limit(part: &Part<'_>, value: u32, row: &FunctionRow) -> Option<String> {
    if let Some((low, high)) = row.limits(part.name).filter(|(low, high)| !(low..=high).contains(&&value)) {
        return Some(format!("the specification permits {low} to {high}"));
    }
    let allowed = row.allowed(part.name).filter(|allowed| !allowed.contains(&value))?;
    let width = 2 * part.bytes.len();
    let shown: Vec<String> = allowed.iter().map(|item| format!("0x{item:0width$X}")).collect();
    Some(format!("the specification permits {}", shown.join(" or ")))
}

/// A byte count compared with the bytes that follow, and with what the quantity takes.
fn announced(part: &Part<'_>, value: u32, context: &Context<'_>) -> Option<String> {
    if !matches!(part.field_type, FieldType::Len8 | FieldType::Len16) {
        return None;
    }
    let follow = context.bytes_after(part)?;
    let value = value as usize;
    if value != follow {
        return Some(if follow < value { "too few" } else { "too many" }.to_owned());
    }
    let mut lists = context.pdu.parts.iter().filter(|item| item.item_bytes().is_some());
    let (list, None) = (lists.next()?, lists.next()) else { return None };
    let quantity = context.block(list.name).quantity?;
    let needed = match list.field_type {
        FieldType::Bits => quantity.div_ceil(8) as usize,
        _ => quantity as usize * list.item_bytes()?,
    };
    (needed != value).then(|| format!("but a quantity of {quantity} takes {needed}"))
}

fn reach(part: &Part<'_>, value: u32, context: &Context<'_>) -> Option<String> {
    if !part.name.ends_with("quantity") {
        return None;
    }
    let end = context.block(part.name).start? + value;
    (end > LAST_ADDRESS + 1).then(|| format!("reaches beyond address {LAST_ADDRESS}"))
}

fn echo(part: &Part<'_>, value: u32, context: &Context<'_>, row: &FunctionRow) -> Option<String> {
    let expected = context.requested(&part.path).filter(|expected| *expected != value)?;
    (context.is_response && row.echo.iter().any(|name| name == part.name))
        .then(|| format!("should repeat the request's {expected}"))
}
