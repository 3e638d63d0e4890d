//! Encodes a PDU from the values of its fields.

use serde_json::{Map, Value as Json};

use crate::functions::{Field, FieldType, FunctionRow, Functions, Layout, EXCEPTION_BIT};
use crate::hex::parse_hex;

/// Encodes the PDU of a function from named values. Lengths and counts may be left out; they are computed. A quantity
/// may be left out if it counts a list whose values are given.
///
/// The error names the field and the values it takes.
pub fn encode(functions: &Functions, function: u8, response: bool, values: &Map<String, Json>) -> Result<Vec<u8>, String> {
    if let Some(exception) = values.get("exception_code") {
        let code = take_number("exception_code", exception, 1)?;
        return Ok(vec![function | EXCEPTION_BIT, code as u8]);
    }
    let row = choose_row(functions, function, values)?;
    let layout = if response { &row.response } else { &row.request };
    let shape = match layout {
        Layout::Body(shape) => shape,
        Layout::NoResponse => return Err(format!("function {function} has no response")),
        Layout::Unknown => return Err(format!("the layout of function {function} is not public: use show or a hex dump")),
    };
    if let Some(name) = values.keys().find(|name| !shape.fields.iter().any(|field| field.name == **name)) {
        let known: Vec<&str> = shape.fields.iter().map(|field| field.name.as_str()).collect();
        return Err(format!(
            "{} has no field {name:?}; it has {}",
            row.name,
            if known.is_empty() { "none".into() } else { known.join(", ") }
        ));
    }
    let mut pdu = vec![function];
    encode_fields(&shape.fields, values, &mut pdu)?;
    Ok(pdu)
}

/// The row of the table for this function; among variants, the one whose first field has the given value.
fn choose_row<'a>(functions: &'a Functions, function: u8, values: &Map<String, Json>) -> Result<&'a FunctionRow, String> {
    let mut rows = functions.rows().filter(|row| row.code == function);
    let chosen = rows.find(|row| match (row.when, row.request.shape().and_then(|shape| shape.fields.first())) {
        (Some(when), Some(field)) => values.get(&field.name).and_then(Json::as_u64) == Some(u64::from(when)),
        _ => true,
    });
    chosen.ok_or_else(|| format!("function {function} is not in the table; --functions loads additional ones"))
}

/// Appends the fields in wire order. Fields inside groups are encoded by the same rules.
fn encode_fields(fields: &[Field], values: &Map<String, Json>, out: &mut Vec<u8>) -> Result<(), String> {
    // A length counts all bytes after it, so those are encoded first and appended after the length.
    for (i, field) in fields.iter().enumerate() {
        let width = field.field_type.width();
        let rest = &fields[i + 1..];
        let value_given = values.get(&field.name);
        match (&field.field_type, value_given) {
            (_, Some(value)) if width > 0 => push_number(out, take_number(&field.name, value, width)?, width),
            (FieldType::Len8 | FieldType::Len16, None) => {
                let mut tail = Vec::new();
                encode_fields(rest, values, &mut tail)?;
                push_number(out, fitting(&field.name, tail.len(), width)?, width);
                out.extend(tail);
                return Ok(());
            }
            (FieldType::Count8 | FieldType::Count16, None) => {
                let count = rest.first().map_or(0, |list| count_items(list, values));
                push_number(out, fitting(&field.name, count, width)?, width);
            }
            (_, None) if width > 0 => {
                let quantity = quantity_field(&field.name).and_then(|prefix| {
                    rest.iter().find(|list| {
                        let is_counted_list = list.name.strip_prefix(prefix).is_some_and(|name| !name.contains('_'));
                        matches!(list.field_type, FieldType::Bits | FieldType::U16List) && is_counted_list
                    })
                });
                let Some(list) = quantity.filter(|list| values.contains_key(&list.name)) else {
                    return Err(format!("{} is missing: a number", field.name));
                };
                push_number(out, fitting(&field.name, count_items(list, values), width)?, width);
            }
            (FieldType::Group(inner), value) => {
                for group in value.and_then(Json::as_array).map_or(&[][..], |groups| groups) {
                    let group = group.as_object().ok_or_else(|| format!("{} takes a list of objects", field.name))?;
                    encode_fields(inner, group, out)?;
                }
            }
            (_, None) => {}
            (word, Some(value)) => push_list(&field.name, word, value, out)?,
        }
    }
    Ok(())
}

/// The prefix of the list that a quantity counts: `quantity` counts `registers` or `coils`, `write_quantity` counts the
/// list whose name starts with `write_`.
fn quantity_field(name: &str) -> Option<&str> {
    name.strip_suffix("quantity")
}

/// The number of items given for a list, as a JSON list or as hex text.
fn count_items(list: &Field, values: &Map<String, Json>) -> usize {
    match values.get(&list.name) {
        Some(Json::Array(items)) => items.len(),
        Some(Json::String(text)) => {
            let bytes = text.bytes().filter(u8::is_ascii_hexdigit).count() / 2;
            match list.field_type {
                FieldType::U16List => bytes / 2,
                FieldType::Bits => bytes * 8,
                _ => bytes,
            }
        }
        _ => 0,
    }
}

/// A computed length or count, if it fits into its field of `width` bytes.
fn fitting(name: &str, value: usize, width: usize) -> Result<u32, String> {
    u32::try_from(value)
        .ok()
        .filter(|&v| v < 1 << (8 * width))
        .ok_or_else(|| format!("{name}: {value} does not fit into {width} byte(s)"))
}

/// The value of a numeric field of `width` bytes, checked against its range.
fn take_number(name: &str, value: &Json, width: usize) -> Result<u32, String> {
    let max = (1u64 << (8 * width)) - 1;
    let number =
        value.as_u64().filter(|&v| v <= max).ok_or_else(|| format!("{name} takes a number from 0 to {max}, not {value}"))?;
    Ok(number as u32)
}

fn push_number(out: &mut Vec<u8>, value: u32, width: usize) {
    out.extend(&value.to_be_bytes()[4 - width..]);
}

/// Appends the items of a list, given as a list of numbers or as hex text.
fn push_list(name: &str, word: &FieldType, value: &Json, out: &mut Vec<u8>) -> Result<(), String> {
    if let Json::String(text) = value {
        out.extend(parse_hex(text).ok_or_else(|| format!("{name} takes a list of numbers or hex text, not {text:?}"))?);
        return Ok(());
    }
    let list = value.as_array().ok_or_else(|| format!("{name} takes a list of numbers or hex text, not {value}"))?;
    let width = if *word == FieldType::U16List { 2 } else { 1 };
    let numbers: Vec<u32> = list.iter().map(|item| take_number(name, item, width)).collect::<Result<_, _>>()?;
    if *word == FieldType::Bits {
        let mut bytes = vec![0u8; numbers.len().div_ceil(8)];
        for (i, &bit) in numbers.iter().enumerate() {
            if bit > 1 {
                return Err(format!("{name} takes bits (0 or 1), not {bit}"));
            }
            bytes[i / 8] |= (bit as u8) << (i % 8);
        }
        out.extend(bytes);
    } else {
        for value in numbers {
            push_number(out, value, width);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::hex::hex;

    #[test]
    fn lengths_and_quantities_are_filled_in() {
        let functions = Functions::embedded();
        let values = json!({"address": 1, "registers": [10, 258]});
        let pdu = encode(functions, 16, false, values.as_object().unwrap()).unwrap();
        assert_eq!(hex(&pdu), "100001000204000a0102");
        let values = json!({"address": 3, "quantity": 6, "write_address": 14, "write_registers": [255, 255, 255]});
        assert_eq!(hex(&encode(functions, 23, false, values.as_object().unwrap()).unwrap()), "1700030006000e00030600ff00ff00ff");
        let unsaid = json!({"address": 3, "write_address": 14, "write_registers": [255]});
        assert!(encode(functions, 23, false, unsaid.as_object().unwrap()).unwrap_err().contains("quantity is missing"));
        let wrong = json!({"address": 70000});
        assert!(encode(functions, 3, false, wrong.as_object().unwrap()).unwrap_err().contains("0 to 65535"));
        let wrong = json!({"adress": 7});
        assert!(encode(functions, 3, false, wrong.as_object().unwrap()).unwrap_err().contains("address, quantity"));
    }
}
