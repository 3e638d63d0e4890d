//! Parses the rows of a table of functions from TOML. Errors name the mistake and list the words that are known.

use serde_json::Value as Json;

use crate::functions::row::{Echo, FieldLimits, FieldOffsets, FunctionRow, Operation, StandardLayout};
use crate::functions::shape::{Extent, Field, FieldType, Layout, Shape};
use crate::register_type::Space;

/// The field types, as error messages list them.
pub const WORDS: &str = "u8 u16 len8 len16 count8 count16 bits u8[] u16[] bytes group{...}";

const KEYS: &[&str] = &[
    "code",
    "name",
    "when",
    "section",
    "summary",
    "request",
    "response",
    "operation",
    "register_type",
    "echo",
    "limits",
    "allowed",
    "serial_only",
    "example",
];

const REGISTER_TYPES: &[&str] = &["coil", "discrete_input", "holding_register", "input_register"];

/// Parses TOML into a JSON value; a syntax error becomes one line of text.
pub fn parse_toml(text: &str) -> Result<Json, String> {
    toml::from_str(text).map_err(|e| e.to_string().trim_end().replace('\n', " "))
}

/// Parses all rows of a file. `origin` is the file name for error messages, `vendor` the vendor whose table it is.
///
/// The file must begin with `format = 1`, so that later versions of the format can be distinguished.
pub(super) fn parse(text: &str, origin: &str, vendor: Option<&str>) -> Result<Vec<FunctionRow>, String> {
    let file: Json = parse_toml(text).map_err(|e| format!("{origin}: {e}"))?;
    if file.get("format").and_then(Json::as_u64) != Some(1) {
        return Err(format!("{origin}: the first line must be format = 1"));
    }
    let rows = file.get("function").and_then(Json::as_array).ok_or(format!("{origin}: no [[function]] row"))?;
    rows.iter()
        .enumerate()
        .map(|(i, row)| parse_row(row, vendor).map_err(|e| format!("{origin}: function row {}: {e}", i + 1)))
        .collect()
}

/// Parses one `[[function]]` row, checks its keys, and derives what the decoder and the framer need from its layouts.
fn parse_row(row: &Json, vendor: Option<&str>) -> Result<FunctionRow, String> {
    let table = row.as_object().ok_or("not a table")?;
    if let Some(key) = table.keys().find(|key| !KEYS.contains(&key.as_str())) {
        return Err(format!("unknown key {key:?}; known are {}", KEYS.join(", ")));
    }
    let code = row["code"].as_u64().filter(|c| (1..128).contains(c)).ok_or("code must be a number from 1 to 127")? as u8;
    let name = row["name"].as_str().ok_or("name is missing")?.to_owned();
    let request = parse_layout(row.get("request"))?;
    let response = parse_layout(row.get("response"))?;
    let operation = match row.get("operation").and_then(Json::as_str) {
        Some("read") => Operation::Read,
        Some("write") => Operation::Write,
        Some("read_write") => Operation::ReadWrite,
        Some("other") | None => Operation::Other,
        Some(word) => return Err(format!("operation {word:?} is not one of read, write, read_write, other")),
    };
    let register_type = row.get("register_type").and_then(Json::as_str).map(str::to_owned);
    if let Some(word) = &register_type {
        if !REGISTER_TYPES.contains(&word.as_str()) {
            return Err(format!("register_type {word:?} is not one of {}", REGISTER_TYPES.join(", ")));
        }
    }
    if operation != Operation::Other && register_type.is_none() {
        return Err("an operation on registers or bits needs register_type".into());
    }
    let when = parse_when(row, &request)?;
    if row.get("example").and_then(|e| e.get("request")).and_then(Json::as_str).is_none() {
        return Err("example = { request = \"hex\", response = \"hex\" } is missing".into());
    }
    let mut source = row.clone();
    source["vendor"] = vendor.map_or(Json::Null, Json::from);
    let offsets = offsets(&request, &response, operation);
    let field_limits = [field_limits(row, &request)?, field_limits(row, &response)?];
    let echo = echo_names(row.get("echo"))?;
    let echoes = echoes(&echo, &request, &response);
    let limits_end = field_limits.iter().flatten().map(|limit| limit.offset + limit.width).max();
    Ok(FunctionRow {
        checked_bytes: limits_end.max(offsets.request_block.map(|(at, _)| at)).unwrap_or(0),
        code,
        needs_no_quoting: name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b" ()/_".contains(&byte)),
        name,
        when,
        operation,
        space: register_type.as_deref().and_then(Space::from_word),
        register_type,
        standard_layout: standard_layout(&request, &response, &offsets, &echoes, &field_limits),
        echoes,
        echo,
        field_limits,
        has_equal_layouts: request == response,
        request,
        response,
        source,
        offsets,
    })
}

/// The value of the first request field that the row applies to (`when = { sub_function = 4 }`); `None` for a row that
/// applies to every value.
fn parse_when(row: &Json, request: &Layout) -> Result<Option<u16>, String> {
    let Some(when) = row.get("when") else { return Ok(None) };
    let (key, value) =
        when.as_object().filter(|o| o.len() == 1).and_then(|o| o.iter().next()).ok_or("when must have one field")?;
    let leading = request.shape().and_then(|shape| shape.fields.first());
    if leading.is_none_or(|field| field.name != *key || field.field_type.width() == 0) {
        return Err(format!("when = {{ {key} = .. }}: {key:?} must be the first field of the request"));
    }
    let value = value.as_u64().and_then(|v| u16::try_from(v).ok()).ok_or("when must be a number")?;
    Ok(Some(value))
}

/// A list of strings, empty if the key is absent.
fn echo_names(list: Option<&Json>) -> Result<Vec<String>, String> {
    let Some(list) = list else { return Ok(Vec::new()) };
    list.as_array()
        .and_then(|items| items.iter().map(|item| item.as_str().map(str::to_owned)).collect())
        .ok_or_else(|| "echo must be a list of field names".into())
}

/// The permitted values of all fields with a fixed offset in this layout, from the keys `limits` and `allowed`.
fn field_limits(row: &Json, layout: &Layout) -> Result<Vec<FieldLimits>, String> {
    let mut all = Vec::new();
    for (key, wrong) in [("limits", "field = [lowest, highest]"), ("allowed", "field = [values]")] {
        let Some(table) = row.get(key) else { continue };
        let wrong = || format!("{key} must be a table of {wrong}");
        for (name, list) in table.as_object().ok_or_else(wrong)? {
            let list: Option<Vec<u32>> =
                list.as_array().and_then(|list| list.iter().map(|v| v.as_u64().and_then(|v| u32::try_from(v).ok())).collect());
            let ranges = match (key, list.as_deref()) {
                ("limits", Some(&[low, high])) if low <= high => vec![(low, high)],
                ("allowed", Some(values)) if !values.is_empty() => values.iter().map(|&v| (v, v)).collect(),
                _ => return Err(wrong()),
            };
            // A field after a list has no fixed offset, and the tables name the fields of both directions: neither is
            // checked here.
            if let Some((offset, width)) = layout.shape().and_then(|shape| shape.place_of(name)) {
                all.push(FieldLimits { name: name.clone(), offset, width, ranges });
            }
        }
    }
    Ok(all)
}

/// A layout from a list of `"name:type"`, from the word `"none"` (the request is not answered), or unknown if the key
/// is absent.
fn parse_layout(layout: Option<&Json>) -> Result<Layout, String> {
    match layout {
        None => Ok(Layout::Unknown),
        Some(Json::String(word)) if word == "none" => Ok(Layout::NoResponse),
        Some(Json::Array(fields)) => {
            let fields: Vec<&str> =
                fields.iter().map(|f| f.as_str().ok_or("a field is \"name:word\"")).collect::<Result<_, _>>()?;
            Ok(Layout::Body(Shape::new(fields.iter().map(|f| parse_field(f)).collect::<Result<_, _>>()?)))
        }
        Some(_) => Err("request and response must be a list of \"name:word\", or \"none\"".into()),
    }
}

/// One field from `"name:type"`; the fields of `group{...}` are separated by blanks.
fn parse_field(text: &str) -> Result<Field, String> {
    let (name, word) = text.trim().split_once(':').ok_or_else(|| format!("field {text:?} is not \"name:word\""))?;
    if name.is_empty() || !name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_') {
        return Err(format!("field name {name:?}: lower-case letters, digits and _ only"));
    }
    let word = match word {
        "u8" => FieldType::U8,
        "u16" => FieldType::U16,
        "len8" => FieldType::Len8,
        "len16" => FieldType::Len16,
        "count8" => FieldType::Count8,
        "count16" => FieldType::Count16,
        "bits" => FieldType::Bits,
        "u8[]" => FieldType::U8List,
        "u16[]" => FieldType::U16List,
        "bytes" => FieldType::Bytes,
        group => {
            let inner = group.strip_prefix("group{").and_then(|rest| rest.strip_suffix('}'));
            let inner = inner.ok_or_else(|| format!("unknown word {word:?} of field {name:?}; known are {WORDS}"))?;
            let fields: Vec<Field> = inner.split_whitespace().map(parse_field).collect::<Result<_, _>>()?;
            if fields.is_empty() || fields.iter().any(|field| matches!(field.field_type, FieldType::Group(_))) {
                return Err(format!("field {name:?}: a group holds one or more fields, no further groups"));
            }
            FieldType::Group(fields)
        }
    };
    Ok(Field { name: name.to_owned(), field_type: word })
}

/// The standard layout that a row has, if the response can be predicted from the request.
///
/// Four layouts qualify: a read (address and quantity, answered by a byte count and that many bytes), a write of a
/// block (answered by its address and quantity), a write of one value (answered by the same bytes), and a read with the
/// write of a block after it, both of registers (answered as the read). The names of the
/// fields are not enough, so the lengths of the layouts are tried with sample bytes.
fn standard_layout(
    request: &Layout,
    response: &Layout,
    offsets: &FieldOffsets,
    echoes: &[Echo],
    field_limits: &[Vec<FieldLimits>; 2],
) -> Option<StandardLayout> {
    let is_four_bytes = |layout: &Layout| layout.extent(&[0; 4]) == Extent::Exactly(4);
    let has_byte_count_at = |layout: &Layout, at: usize| {
        let extent = |count: u8| layout.extent(&[&[0u8; 8][..at], &[count]].concat());
        [1u8, 2, 250].iter().all(|&count| extent(count) == Extent::Exactly(at + 1 + usize::from(count)))
    };
    // The fast path does not look at the values of a response. So its limits may concern only the byte count, or fields
    // that repeat the request and have the same limits there.
    let limits_only_byte_count = field_limits[1].iter().all(|limit| limit.offset + limit.width <= 1);
    let is_echoed_at =
        |at: usize| echoes.iter().any(|echo| (echo.request_offset, echo.response_offset, echo.width) == (at, at, 2));
    let repeats_address_and_number = is_four_bytes(response)
        && is_echoed_at(0)
        && is_echoed_at(2)
        && field_limits[1].iter().all(|limit| field_limits[0].contains(limit));
    if offsets.address != Some(0) {
        return None;
    }
    match (offsets.quantity, offsets.request_block, offsets.response_block) {
        (Some(2), None, Some((1, bits)))
            if is_four_bytes(request) && has_byte_count_at(response, 0) && limits_only_byte_count =>
        {
            Some(if bits { StandardLayout::ReadBits } else { StandardLayout::ReadRegisters })
        }
        (Some(2), Some((9, false)), Some((1, false)))
            if (offsets.write_address, offsets.write_quantity) == (Some(4), Some(6))
                && has_byte_count_at(request, 8)
                && has_byte_count_at(response, 0)
                && limits_only_byte_count =>
        {
            Some(StandardLayout::ReadWriteRegisters)
        }
        (Some(2), Some((5, bits)), None) if has_byte_count_at(request, 4) && repeats_address_and_number => {
            Some(if bits { StandardLayout::WriteBits } else { StandardLayout::WriteRegisters })
        }
        (None, None, None)
            if offsets.value == Some(2) && is_four_bytes(request) && request == response && repeats_address_and_number =>
        {
            Some(StandardLayout::WriteOne)
        }
        _ => None,
    }
}

/// The echoed fields that are numbers with a fixed offset in both bodies.
fn echoes(names: &[String], request: &Layout, response: &Layout) -> Vec<Echo> {
    let (Some(request_shape), Some(response_shape)) = (request.shape(), response.shape()) else { return Vec::new() };
    let echo_of = |name: &String| {
        let width = request_shape.fields.iter().find(|field| field.name == *name)?.field_type.width();
        let (request_offset, response_offset) = (request_shape.offset_of(name)?, response_shape.offset_of(name)?);
        Some(Echo { name: name.clone(), request_offset, response_offset, width })
    };
    names.iter().filter_map(echo_of).collect()
}

/// The offsets of the fields that become columns, found by the names that the tables use for them.
fn offsets(request: &Layout, response: &Layout, operation: Operation) -> FieldOffsets {
    if operation == Operation::Other {
        return FieldOffsets::default();
    }
    let at = |name: &str| request.shape().and_then(|shape| shape.offset_of(name));
    let response_block = response.shape().and_then(Shape::block).filter(|_| operation != Operation::Write);
    FieldOffsets {
        address: at("address"),
        quantity: at("quantity"),
        write_address: at("write_address"),
        write_quantity: at("write_quantity"),
        value: at("value"),
        request_block: request.shape().and_then(Shape::block),
        response_block,
    }
}
