//! One row of the table of functions, and what is derived from it once when the table is loaded: offsets, echoes,
//! limits.

use serde_json::Value as Json;

use crate::framing::Direction;
use crate::functions::shape::{number, Layout};
use crate::register_type::Space;

/// Whether a function reads or writes registers or bits.
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
    /// The value of the `operation` column.
    pub fn text(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::ReadWrite => "read_write",
            Self::Other => "other",
        }
    }
}

/// Offsets in the PDU bodies of the fields that become columns of a transaction. Computed once when the table is
/// loaded; `None` where the function has no such field.
#[derive(Clone, Debug, Default)]
pub struct FieldOffsets {
    /// Request: address of the first register or bit.
    pub address: Option<usize>,
    /// Request: number of registers or bits.
    pub quantity: Option<usize>,
    /// Request of function 23: address of the first register written.
    pub write_address: Option<usize>,
    /// Request of function 23: number of registers written.
    pub write_quantity: Option<usize>,
    /// Request: the value of a single write.
    pub value: Option<usize>,
    /// Request: the data written (offset, whether it is packed bits).
    pub request_block: Option<(usize, bool)>,
    /// Response: the data read (offset, whether it is packed bits).
    pub response_block: Option<(usize, bool)>,
}

/// A field of the request that the response must repeat with the same value.
#[derive(Clone, Debug)]
pub struct Echo {
    /// Name of the field.
    pub name: String,
    /// Its offset in the body of the request.
    pub request_offset: usize,
    /// Its offset in the body of the response.
    pub response_offset: usize,
    /// Its size in bytes.
    pub width: usize,
}

/// The request and response layouts of the standard functions 1 to 6, 15, 16 and 23. Vendor functions with one of these
/// layouts are handled the same way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StandardLayout {
    /// Functions 1 and 2: the request has address and quantity, the response a byte count and packed bits.
    ReadBits,
    /// Functions 3 and 4: the request has address and quantity, the response a byte count and registers.
    ReadRegisters,
    /// Function 15: the request has address, quantity, byte count and packed bits; the response repeats address and
    /// quantity.
    WriteBits,
    /// Function 16: the request has address, quantity, byte count and registers; the response repeats address and
    /// quantity.
    WriteRegisters,
    /// Functions 5 and 6: the request has address and value, and the response repeats both.
    WriteOne,
    /// Function 23: the request has address and quantity of what is read, then address, quantity, byte count and registers of
    /// what is written; the response a byte count and registers.
    ReadWriteRegisters,
}

/// What the fast path has to know of a standard read or write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StandardRequest {
    /// The request and response layout.
    pub kind: StandardLayout,
    /// Whether request and response have the same layout.
    pub has_equal_layouts: bool,
}

impl StandardRequest {
    /// Returns the request of a row; `None` if the row is not a standard read or write.
    pub(super) fn of(row: &FunctionRow) -> Option<Self> {
        Some(Self { kind: row.standard_layout?, has_equal_layouts: row.has_equal_layouts })
    }
}

/// The values that the specification permits for one numeric field.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldLimits {
    /// Name of the field.
    pub name: String,
    /// Its offset in the body.
    pub offset: usize,
    /// Its size in bytes.
    pub width: usize,
    /// Permitted ranges, both ends included. A single permitted value is a range of one.
    pub ranges: Vec<(u32, u32)>,
}

impl FieldLimits {
    /// The field's value, if the body contains the field and the value is not permitted; `None` otherwise.
    #[inline]
    pub fn violated_by(&self, body: &[u8]) -> Option<u32> {
        let value = number(body, self.offset, self.width)? as u32;
        (!self.ranges.iter().any(|&(low, high)| (low..=high).contains(&value))).then_some(value)
    }
}

/// One row of the table of functions.
#[derive(Clone, Debug)]
pub struct FunctionRow {
    /// Function code.
    pub code: u8,
    /// Name in the specification.
    pub name: String,
    /// Whether the name needs no quoting or escaping in any output format, so that writers can copy it.
    pub needs_no_quoting: bool,
    /// The row applies only to bodies whose first field has this value (a sub-function or MEI type).
    pub when: Option<u16>,
    /// Layout of the request.
    pub request: Layout,
    /// Layout of the response.
    pub response: Layout,
    /// Whether the function reads or writes.
    pub operation: Operation,
    /// The table it accesses: `coil`, `discrete_input`, `holding_register` or `input_register`.
    pub register_type: Option<String>,
    /// `register_type` as an enum, parsed once.
    pub space: Option<Space>,
    /// The standard layout that request and response have, if any.
    pub standard_layout: Option<StandardLayout>,
    /// Whether request and response have the same layout, so that the two cannot be distinguished by their bytes alone.
    pub has_equal_layouts: bool,
    /// The leading part of a body, in bytes, that contains all fields with limits, byte counts and quantities. The
    /// bytes after it are data and cannot prove a frame wrong.
    pub checked_bytes: usize,
    /// Names of the fields that the response repeats.
    pub echo: Vec<String>,
    /// The numeric ones of `echo` with their offsets, computed once.
    pub echoes: Vec<Echo>,
    /// Permitted values: `[request, response]`.
    pub field_limits: [Vec<FieldLimits>; 2],
    /// The row as it is in the file, with the name of the vendor it comes from.
    pub source: Json,
    /// Offsets of the fields that become columns.
    pub offsets: FieldOffsets,
}

impl FunctionRow {
    /// The layout of the PDU in one direction; `Layout::Unknown` for an unknown direction.
    pub fn layout(&self, direction: Direction) -> &Layout {
        match direction {
            Direction::Request => &self.request,
            Direction::Response => &self.response,
            Direction::Unknown => &Layout::Unknown,
        }
    }

    /// The vendor whose table it is from.
    pub fn vendor(&self) -> Option<&str> {
        self.source["vendor"].as_str()
    }

    /// A name that no other row has: that of a row with `when` is the text before the colon of its summary.
    pub fn label(&self) -> String {
        let Some(value) = self.when else { return self.name.clone() };
        let summary = self.source["summary"].as_str().unwrap_or_default();
        summary.split_once(':').map_or_else(|| format!("{} {value}", self.name), |(own, _)| own.to_owned())
    }

    /// The lowest and the highest value that a field may have, wherever in the body it is.
    pub fn limits(&self, field: &str) -> Option<(u32, u32)> {
        let list = numbers(&self.source["limits"][field])?;
        Some((*list.first()?, *list.get(1)?))
    }

    /// The only values that a field may have, wherever in the body it is.
    pub fn allowed(&self, field: &str) -> Option<Vec<u32>> {
        numbers(&self.source["allowed"][field])
    }
}

fn numbers(list: &Json) -> Option<Vec<u32>> {
    Some(list.as_array()?.iter().filter_map(|number| u32::try_from(number.as_u64()?).ok()).collect())
}
