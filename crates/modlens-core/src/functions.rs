//! The table of functions: `dissectors/functions.toml` compiled to shapes.
//!
//! What is not here: any knowledge of a single function. It stands in the table, and users add rows in the same words.

use std::sync::OnceLock;

use serde_json::Value as Json;

use crate::direction::Direction;

/// The embedded table.
pub const TABLE: &str = include_str!("../../../dissectors/functions.toml");

/// The embedded vocabulary: exceptions, sub-functions, MEI types, objects.
pub const VOCABULARY: &str = include_str!("../../../dissectors/vocabulary.toml");

/// The embedded vendors' rows, by name; loaded only when asked for.
pub const VENDORS: &[(&str, &str)] = &[
    ("huawei", include_str!("../../../dissectors/vendor/huawei.toml")),
    ("pace", include_str!("../../../dissectors/vendor/pace.toml")),
    ("sungrow", include_str!("../../../dissectors/vendor/sungrow.toml")),
];

/// The bit that marks an exception response (application protocol, 7).
pub const EXCEPTION_BIT: u8 = 0x80;

/// The words of the table, as the messages name them.
pub const WORDS: &str = "u8 u16 len8 len16 count8 count16 bits u8[] u16[] bytes group{...}";

/// What one field of a body is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Word {
    /// One byte.
    U8,
    /// Two bytes, high byte first.
    U16,
    /// One byte: how many bytes follow.
    Len8,
    /// Two bytes: how many bytes follow.
    Len16,
    /// One byte: how many items the next list has.
    Count8,
    /// Two bytes: how many items the next list has.
    Count16,
    /// Packed bits, lowest first.
    Bits,
    /// Numbers of one byte.
    U8List,
    /// Numbers of two bytes.
    U16List,
    /// Text or binary.
    Bytes,
    /// Groups of fields.
    Group(Vec<Field>),
}

impl Word {
    /// Bytes of a number or length; 0 for lists.
    pub fn width(&self) -> usize {
        match self {
            Self::U8 | Self::Len8 | Self::Count8 => 1,
            Self::U16 | Self::Len16 | Self::Count16 => 2,
            _ => 0,
        }
    }

    /// The word as the table spells it.
    pub fn spelling(&self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::Len8 => "len8",
            Self::Len16 => "len16",
            Self::Count8 => "count8",
            Self::Count16 => "count16",
            Self::Bits => "bits",
            Self::U8List => "u8[]",
            Self::U16List => "u16[]",
            Self::Bytes => "bytes",
            Self::Group(_) => "group",
        }
    }
}

/// One field: its name and word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name, as columns and `show` print it.
    pub name: String,
    /// What stands on the wire.
    pub word: Word,
}

/// How long a body is, as far as its first bytes tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// So many bytes.
    Exactly(usize),
    /// At least so many; more bytes will tell.
    AtLeast(usize),
    /// At least so many; the layout does not say how many. Only checksum or silence end it.
    Open(usize),
}

/// The shortcut that `Shape::extent` takes for nearly every function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plan {
    Fixed(usize),
    LengthAt(usize),
    Walk,
}

/// The fields of a body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Fields in wire order.
    pub fields: Vec<Field>,
    plan: Plan,
}

impl Shape {
    fn new(fields: Vec<Field>) -> Self {
        let mut fixed = 0;
        let mut plan = None;
        for field in &fields {
            match field.word {
                Word::U8 | Word::U16 => fixed += field.word.width(),
                Word::Len8 => {
                    plan = Some(Plan::LengthAt(fixed));
                    break;
                }
                _ => {
                    plan = Some(Plan::Walk);
                    break;
                }
            }
        }
        Self { plan: plan.unwrap_or(Plan::Fixed(fixed)), fields }
    }

    /// The length of a body that starts with these bytes.
    #[inline]
    pub fn extent(&self, body: &[u8]) -> Extent {
        match self.plan {
            Plan::Fixed(length) => Extent::Exactly(length),
            Plan::LengthAt(at) => match body.get(at) {
                Some(&length) => Extent::Exactly(at + 1 + length as usize),
                None => Extent::AtLeast(at + 1),
            },
            Plan::Walk => walk(&self.fields, body),
        }
    }

    /// Whether a body of exactly these bytes can have this shape.
    pub fn fits(&self, body: &[u8]) -> bool {
        match self.extent(body) {
            Extent::Exactly(length) => length == body.len(),
            Extent::Open(least) => body.len() >= least,
            Extent::AtLeast(_) => false,
        }
    }

    /// Whether the groups of a body, if it has any, fill it without rest.
    pub fn groups_fit(&self, body: &[u8]) -> bool {
        let Some(Field { word: Word::Group(inner), .. }) = self.fields.last() else { return true };
        let mut rest = self.fields[..self.fields.len() - 1].iter().map(|field| field.word.width()).sum::<usize>();
        while rest < body.len() {
            match walk(inner, &body[rest..]) {
                Extent::Exactly(length) if length > 0 => rest += length,
                _ => return false,
            }
        }
        rest == body.len()
    }

    /// The body offset of a number that stands before everything of variable length.
    pub fn offset_of(&self, name: &str) -> Option<usize> {
        let mut offset = 0;
        for field in &self.fields {
            let width = field.word.width();
            if width == 0 {
                return None;
            }
            if field.name == name {
                return Some(offset);
            }
            offset += width;
        }
        None
    }

    /// The list that holds registers or bits: (body offset, whether it is bits).
    pub fn block(&self) -> Option<(usize, bool)> {
        let mut offset = 0;
        for field in &self.fields {
            match field.word {
                Word::Bits => return Some((offset, true)),
                Word::U16List => return Some((offset, false)),
                _ => {}
            }
            let width = field.word.width();
            if width == 0 {
                return None;
            }
            offset += width;
        }
        None
    }
}

fn number(body: &[u8], at: usize, width: usize) -> Option<usize> {
    match width {
        1 => body.get(at).map(|&b| b as usize),
        _ => Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]) as usize),
    }
}

fn walk(fields: &[Field], body: &[u8]) -> Extent {
    let mut at = 0;
    let mut count = None;
    for field in fields {
        let width = field.word.width();
        if width > 0 {
            let Some(value) = number(body, at, width) else {
                return Extent::AtLeast(at + width);
            };
            at += width;
            match field.word {
                Word::Len8 | Word::Len16 => return Extent::Exactly(at + value),
                Word::Count8 | Word::Count16 => count = Some(value),
                _ => {}
            }
            continue;
        }
        let Some(items) = count.take() else {
            return Extent::Open(at);
        };
        match &field.word {
            Word::U16List => at += 2 * items,
            Word::Bits => at += items.div_ceil(8),
            Word::Group(inner) => {
                for _ in 0..items {
                    match walk(inner, body.get(at..).unwrap_or(&[])) {
                        Extent::Exactly(length) => at += length,
                        Extent::AtLeast(length) => return Extent::AtLeast(at + length),
                        Extent::Open(length) => return Extent::Open(at + length),
                    }
                }
            }
            _ => at += items,
        }
    }
    Extent::Exactly(at)
}

/// What is known of one direction of a function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Layout {
    /// The layout is not public.
    Unknown,
    /// There is none: the request is not answered.
    Silent,
    /// The fields.
    Body(Shape),
}

impl Layout {
    /// The shape, where there is one.
    pub fn shape(&self) -> Option<&Shape> {
        match self {
            Self::Body(shape) => Some(shape),
            _ => None,
        }
    }

    /// The length of a body that starts with these bytes.
    pub fn extent(&self, body: &[u8]) -> Extent {
        match self {
            Self::Body(shape) => shape.extent(body),
            _ => Extent::Open(0),
        }
    }

    /// Whether a body of exactly these bytes can have this layout; an unknown one takes any.
    pub fn fits(&self, body: &[u8]) -> bool {
        match self {
            Self::Body(shape) => shape.fits(body),
            Self::Unknown => true,
            Self::Silent => false,
        }
    }
}

/// What a transaction does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Reads registers or bits.
    Read,
    /// Writes them.
    Write,
    /// Does both.
    ReadWrite,
    /// Anything else.
    Other,
}

impl Operation {
    /// As the `operation` column spells it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::ReadWrite => "read_write",
            Self::Other => "other",
        }
    }
}

/// Where the columns of a transaction stand in the bodies; worked out once.
#[derive(Clone, Debug, Default)]
pub struct Roles {
    /// Request: first register or bit.
    pub address: Option<usize>,
    /// Request: how many.
    pub quantity: Option<usize>,
    /// Request of a read-and-write: first register written.
    pub write_address: Option<usize>,
    /// Request of a read-and-write: how many are written.
    pub write_quantity: Option<usize>,
    /// Request: the value of a single write.
    pub value: Option<usize>,
    /// Request: the block written (offset, bits).
    pub request_block: Option<(usize, bool)>,
    /// Response: the block read (offset, bits).
    pub response_block: Option<(usize, bool)>,
}

/// What the specification permits for one number of a body.
#[derive(Clone, Debug)]
pub struct Permit {
    /// The field.
    pub name: String,
    /// Where it stands in the body.
    pub offset: usize,
    /// Its bytes.
    pub width: usize,
    /// Inclusive ranges; a permitted value is a range of one.
    pub ranges: Vec<(u32, u32)>,
}

impl Permit {
    /// The value, if it is in the body and outside of what is permitted.
    pub fn violated_by(&self, body: &[u8]) -> Option<u32> {
        let value = number(body, self.offset, self.width)? as u32;
        (!self.ranges.iter().any(|&(low, high)| (low..=high).contains(&value))).then_some(value)
    }
}

/// One row of the table.
#[derive(Clone, Debug)]
pub struct Row {
    /// Function code.
    pub code: u8,
    /// Name in the specification.
    pub name: String,
    /// Value of the leading field that this row is for.
    pub when: Option<u16>,
    /// Layout of the request.
    pub request: Layout,
    /// Layout of the response.
    pub response: Layout,
    /// What it does.
    pub operation: Operation,
    /// To what: `coil`, `discrete_input`, `holding_register`, `input_register`.
    pub register_type: Option<String>,
    /// Fields that the response repeats.
    pub echo: Vec<String>,
    /// What the specification permits, of the request and of the response.
    pub permits: [Vec<Permit>; 2],
    /// The row as the file has it, and the vendor it comes from.
    pub source: Json,
    /// Where the columns stand.
    pub roles: Roles,
}

impl Row {
    /// The layout of one direction; an unknown direction has none.
    pub fn layout(&self, direction: Direction) -> &Layout {
        match direction {
            Direction::Request => &self.request,
            Direction::Response => &self.response,
            Direction::Unknown => &Layout::Unknown,
        }
    }
}

/// The rows of one function code.
#[derive(Clone, Debug)]
struct Entry {
    /// Width of the leading field that tells the variants apart; 0 where there are none.
    width: usize,
    variants: Vec<Row>,
}

/// The table: rows by function code.
#[derive(Clone, Debug)]
pub struct Functions {
    entries: Vec<Option<Box<Entry>>>,
}

impl Default for Functions {
    fn default() -> Self {
        Self::embedded().clone()
    }
}

impl Functions {
    /// The embedded table.
    pub fn embedded() -> &'static Self {
        static EMBEDDED: OnceLock<Functions> = OnceLock::new();
        EMBEDDED.get_or_init(|| {
            let mut table = Self { entries: vec![None; 256] };
            table.load(TABLE, "functions.toml", None).expect("the embedded table is tested");
            table
        })
    }

    /// Adds the rows of a text; a row replaces the one with the same code and `when`.
    ///
    /// The error says which row and key is wrong.
    pub fn load(&mut self, text: &str, origin: &str, vendor: Option<&str>) -> Result<(), String> {
        let rows = parse(text, origin, vendor)?;
        for row in rows {
            let slot = &mut self.entries[row.code as usize];
            let width = leading_width(&row);
            match slot {
                Some(entry) => {
                    entry.variants.retain(|old| old.when != row.when);
                    if row.when.is_some() {
                        entry.width = width;
                    }
                    entry.variants.push(row);
                    // Rows for one value come first: the row without `when` is for all others.
                    entry.variants.sort_by_key(|row| row.when.is_none());
                }
                None => *slot = Some(Box::new(Entry { width: if row.when.is_some() { width } else { 0 }, variants: vec![row] })),
            }
        }
        Ok(())
    }

    /// Adds an embedded vendor's rows.
    pub fn load_vendor(&mut self, name: &str) -> Result<(), String> {
        let known = || VENDORS.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        let (_, text) = VENDORS
            .iter()
            .find(|(known, _)| known.eq_ignore_ascii_case(name))
            .ok_or_else(|| format!("no functions of a vendor {name:?}: known are {}", known()))?;
        self.load(text, name, Some(name))
    }

    /// The row for this function code and body, the exception bit taken off before. The body may be cut short.
    #[inline]
    pub fn row(&self, code: u8, body: &[u8]) -> Option<&Row> {
        let entry = self.entries[code as usize].as_deref()?;
        if entry.width == 0 {
            return entry.variants.first();
        }
        let leading = number(body, 0, entry.width).map(|value| value as u16);
        entry.variants.iter().find(|row| row.when.is_none() || row.when == leading)
    }

    /// Whether the body is too short to tell which row it belongs to, and how many bytes that takes.
    #[inline]
    pub fn leading_bytes(&self, code: u8) -> usize {
        self.entries[code as usize].as_deref().map_or(0, |entry| entry.width)
    }

    /// The name of a function.
    pub fn name(&self, code: u8) -> Option<&str> {
        Some(self.entries[code as usize].as_deref()?.variants.first()?.name.as_str())
    }

    /// All rows, by code.
    pub fn rows(&self) -> impl Iterator<Item = &Row> {
        self.entries.iter().flatten().flat_map(|entry| entry.variants.iter())
    }
}

fn leading_width(row: &Row) -> usize {
    row.request.shape().and_then(|shape| shape.fields.first()).map_or(0, |field| field.word.width())
}

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

/// A TOML text as JSON.
pub fn parse_toml(text: &str) -> Result<Json, String> {
    toml::from_str(text).map_err(|e| e.to_string().trim_end().replace('\n', " "))
}

fn parse(text: &str, origin: &str, vendor: Option<&str>) -> Result<Vec<Row>, String> {
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

fn parse_row(row: &Json, vendor: Option<&str>) -> Result<Row, String> {
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
        Some(word) => return Err(format!("operation {word:?} is none of read, write, read_write, other")),
    };
    let register_type = row.get("register_type").and_then(Json::as_str).map(str::to_owned);
    if let Some(word) = &register_type {
        if !REGISTER_TYPES.contains(&word.as_str()) {
            return Err(format!("register_type {word:?} is none of {}", REGISTER_TYPES.join(", ")));
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
    let roles = roles(&request, &response, operation);
    Ok(Row {
        code,
        name,
        when,
        operation,
        register_type,
        echo: strings(row.get("echo"))?,
        permits: [permits(row, &request)?, permits(row, &response)?],
        request,
        response,
        source,
        roles,
    })
}

fn parse_when(row: &Json, request: &Layout) -> Result<Option<u16>, String> {
    let Some(when) = row.get("when") else { return Ok(None) };
    let (key, value) = when.as_object().filter(|o| o.len() == 1).and_then(|o| o.iter().next()).ok_or("when takes one field")?;
    let leading = request.shape().and_then(|shape| shape.fields.first());
    if leading.is_none_or(|field| field.name != *key || field.word.width() == 0) {
        return Err(format!("when = {{ {key} = .. }}: {key:?} must be the first field of the request"));
    }
    let value = value.as_u64().and_then(|v| u16::try_from(v).ok()).ok_or("when takes a number")?;
    Ok(Some(value))
}

fn strings(list: Option<&Json>) -> Result<Vec<String>, String> {
    let Some(list) = list else { return Ok(Vec::new()) };
    list.as_array()
        .and_then(|items| items.iter().map(|item| item.as_str().map(str::to_owned)).collect())
        .ok_or_else(|| "echo takes a list of field names".into())
}

fn permits(row: &Json, layout: &Layout) -> Result<Vec<Permit>, String> {
    let mut all = Vec::new();
    for (key, wrong) in [("limits", "field = [lowest, highest]"), ("allowed", "field = [values]")] {
        let Some(table) = row.get(key) else { continue };
        let wrong = || format!("{key} takes a table of {wrong}");
        for (name, list) in table.as_object().ok_or_else(wrong)? {
            let list: Option<Vec<u32>> =
                list.as_array().and_then(|list| list.iter().map(|v| v.as_u64().and_then(|v| u32::try_from(v).ok())).collect());
            let ranges = match (key, list.as_deref()) {
                ("limits", Some(&[low, high])) if low <= high => vec![(low, high)],
                ("allowed", Some(values)) if !values.is_empty() => values.iter().map(|&v| (v, v)).collect(),
                _ => return Err(wrong()),
            };
            // Fields behind a list, or of the other direction, have no fixed place: nothing to check there.
            let shape = layout.shape();
            let place = shape.and_then(|shape| shape.offset_of(name).zip(shape.fields.iter().find(|f| f.name == *name)));
            if let Some((offset, field)) = place.filter(|(_, field)| field.word.width() > 0) {
                all.push(Permit { name: name.clone(), offset, width: field.word.width(), ranges });
            }
        }
    }
    Ok(all)
}

fn parse_layout(layout: Option<&Json>) -> Result<Layout, String> {
    match layout {
        None => Ok(Layout::Unknown),
        Some(Json::String(word)) if word == "none" => Ok(Layout::Silent),
        Some(Json::Array(fields)) => {
            let fields: Vec<&str> =
                fields.iter().map(|f| f.as_str().ok_or("a field is \"name:word\"")).collect::<Result<_, _>>()?;
            Ok(Layout::Body(Shape::new(fields.iter().map(|f| parse_field(f)).collect::<Result<_, _>>()?)))
        }
        Some(_) => Err("request and response take a list of \"name:word\", or \"none\"".into()),
    }
}

fn parse_field(text: &str) -> Result<Field, String> {
    let (name, word) = text.trim().split_once(':').ok_or_else(|| format!("field {text:?} is not \"name:word\""))?;
    if name.is_empty() || !name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_') {
        return Err(format!("field name {name:?}: lower-case letters, digits and _ only"));
    }
    let word = match word {
        "u8" => Word::U8,
        "u16" => Word::U16,
        "len8" => Word::Len8,
        "len16" => Word::Len16,
        "count8" => Word::Count8,
        "count16" => Word::Count16,
        "bits" => Word::Bits,
        "u8[]" => Word::U8List,
        "u16[]" => Word::U16List,
        "bytes" => Word::Bytes,
        group => {
            let inner = group.strip_prefix("group{").and_then(|rest| rest.strip_suffix('}'));
            let inner = inner.ok_or_else(|| format!("unknown word {word:?} of field {name:?}; known are {WORDS}"))?;
            let fields: Vec<Field> = inner.split_whitespace().map(parse_field).collect::<Result<_, _>>()?;
            if fields.is_empty() || fields.iter().any(|field| matches!(field.word, Word::Group(_))) {
                return Err(format!("field {name:?}: a group holds one or more fields, no further groups"));
            }
            Word::Group(fields)
        }
    };
    Ok(Field { name: name.to_owned(), word })
}

fn roles(request: &Layout, response: &Layout, operation: Operation) -> Roles {
    if operation == Operation::Other {
        return Roles::default();
    }
    let at = |name: &str| request.shape().and_then(|shape| shape.offset_of(name));
    let response_block = response.shape().and_then(Shape::block).filter(|_| operation != Operation::Write);
    Roles {
        address: at("address"),
        quantity: at("quantity"),
        write_address: at("write_address"),
        write_quantity: at("write_quantity"),
        value: at("value"),
        request_block: request.shape().and_then(Shape::block),
        response_block,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(code: u8, body: &[u8]) -> &'static Row {
        Functions::embedded().row(code, body).unwrap()
    }

    #[test]
    fn lengths_of_the_specification() {
        // Bodies, so without unit, function code and checksum; application protocol, section 6.
        assert_eq!(row(3, &[]).request.extent(&[]), Extent::Exactly(4));
        assert_eq!(row(3, &[]).response.extent(&[]), Extent::AtLeast(1));
        assert_eq!(row(3, &[]).response.extent(&[6]), Extent::Exactly(7));
        assert_eq!(row(16, &[]).request.extent(&[0, 1, 0, 2, 4]), Extent::Exactly(9));
        assert_eq!(row(24, &[]).response.extent(&[0, 6]), Extent::Exactly(8));
        assert_eq!(row(8, &[0, 0]).request.extent(&[0, 0, 1]), Extent::Open(2));
        assert_eq!(row(8, &[0, 11]).request.extent(&[0, 11]), Extent::Exactly(4));
        assert_eq!(row(8, &[0, 4]).response, Layout::Silent);
        let identification = [0x0E, 1, 1, 0, 0, 2, 0, 2, 65, 66, 1];
        assert_eq!(row(43, &[14]).response.extent(&identification), Extent::AtLeast(12));
        assert_eq!(row(43, &[14]).response.extent(&[0x0E, 1, 1, 0, 0, 1, 0, 2, 65, 66]), Extent::Exactly(10));
        assert_eq!(row(90, &[]).request, Layout::Unknown);
    }

    #[test]
    fn all_public_functions_are_there() {
        let codes: std::collections::BTreeSet<u8> = Functions::embedded().rows().map(|row| row.code).collect();
        for code in [1, 2, 3, 4, 5, 6, 7, 8, 11, 12, 15, 16, 17, 20, 21, 22, 23, 24, 43] {
            assert!(codes.contains(&code), "{code}");
        }
    }

    #[test]
    fn vendors_are_loaded_only_when_asked_for() {
        for (name, _) in VENDORS {
            let mut table = Functions::default();
            let before = table.rows().count();
            table.load_vendor(name).unwrap();
            assert!(table.rows().count() > before, "{name}");
        }
        assert!(Functions::default().load_vendor("nobody").unwrap_err().contains("huawei"));
    }

    #[test]
    fn mistakes_are_named() {
        let load =
            |row: &str| Functions::default().load(&format!("format = 1\n[[function]]\n{row}"), "my.toml", None).unwrap_err();
        let rest = "name = \"X\"\nexample = { request = \"41\" }\n";
        assert!(load(&format!("code = 65\n{rest}request = [\"a:u32\"]")).contains("known are u8 u16"));
        assert!(load(&format!("code = 200\n{rest}")).contains("1 to 127"));
        assert!(load(&format!("code = 65\n{rest}colour = 1")).contains("\"colour\""));
        assert!(load("code = 65\nname = \"X\"").contains("example"));
        assert!(load(&format!("code = 65\n{rest}when = {{ b = 1 }}\nrequest = [\"a:u8\"]")).contains("first field"));
        assert!(Functions::default().load("x = 1", "my.toml", None).unwrap_err().contains("format = 1"));
    }
}
