//! One row of the table: a function and what is known of it.

use serde_json::Value as Json;

use crate::direction::Direction;
use crate::functions::shape::{number, Layout};
use crate::functions::Functions;
use crate::register_type::Space;

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

/// A field that the response repeats.
#[derive(Clone, Debug)]
pub struct Echo {
    /// The field.
    pub name: String,
    /// Where it stands in the body of the request.
    pub asked: usize,
    /// Where it stands in the body of the response.
    pub answered: usize,
    /// Its bytes.
    pub width: usize,
}

/// Functions of the plainest kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plain {
    /// Address and quantity are asked, a count and as many bytes are the answer; eight bits to a byte.
    ReadBits,
    /// The same, two bytes each.
    ReadRegisters,
    /// Behind address and quantity a count and as many bytes are sent, address and quantity are the answer; eight bits to
    /// a byte.
    WriteBits,
    /// The same, two bytes each.
    WriteRegisters,
    /// Address and value are sent, and are the answer.
    WriteOne,
}

/// What a request of a plain function may be, in one look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asks {
    /// Of which kind it is.
    pub kind: Plain,
    /// Whether request and response have the same layout.
    pub mirrored: bool,
    /// The least and the greatest number behind the address.
    permitted: (u16, u16),
    /// Whether that is all that is permitted; else the row has to be asked.
    whole: bool,
}

impl Asks {
    /// Where the number behind the address stands in a body, and its bytes.
    const NUMBER: (usize, usize) = (2, 2);

    /// Of a row, if it is plain.
    pub(super) fn of(row: &Row) -> Option<Self> {
        let whole = |permitted| (permitted, true);
        let (permitted, whole) = match &row.permits[0][..] {
            [] => whole((0, u16::MAX)),
            [Permit { offset, width, ranges, .. }] if (*offset, *width) == Self::NUMBER && ranges.len() == 1 => {
                let narrow = |limit: u32| limit.min(u32::from(u16::MAX)) as u16;
                whole((narrow(ranges[0].0), narrow(ranges[0].1)))
            }
            _ => ((0, u16::MAX), false),
        };
        Some(Self { kind: row.plain?, mirrored: row.mirrored, permitted, whole })
    }

    /// Whether a request for so many, or with this value, may be made. `body`: its bytes behind the function code.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A comparison, for nearly all functions.
    pub fn permits(&self, functions: &Functions, code: u8, number: u16, body: &[u8]) -> bool {
        let (least, most) = self.permitted;
        let by_row =
            || functions.row(code, body).is_some_and(|row| row.permits[0].iter().all(|one| one.violated_by(body).is_none()));
        (least..=most).contains(&number) && (self.whole || by_row())
    }
}

/// What the specification permits for one number of a body.
#[derive(Clone, Debug, PartialEq, Eq)]
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
    #[inline]
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
    /// Whether no writer has to quote or escape anything in the name.
    pub unquoted: bool,
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
    /// The same as a table, worked out once.
    pub space: Option<Space>,
    /// Whether it reads or writes in a plain way.
    pub plain: Option<Plain>,
    /// Whether request and response have the same layout: then they can look the same.
    pub mirrored: bool,
    /// Bytes of a body that its limits and counts stand in: behind them nothing tells more of it.
    pub judged: usize,
    /// Fields that the response repeats.
    pub echo: Vec<String>,
    /// Those of them that are numbers, worked out once.
    pub echoes: Vec<Echo>,
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
