//! The context of a field: the decoded PDU, its direction, and the request that it responds to.

use super::part::{Part, Pdu};
use super::piece::Meaning;
use crate::functions::{FunctionRow, Layout};
use crate::register_type::Space;

/// User-defined function codes (application protocol, section 5).
const USER_DEFINED: [std::ops::RangeInclusive<u8>; 2] = [65..=72, 100..=110];

/// What is known of the registers or bits that a field belongs to.
#[derive(Clone, Copy, Default)]
pub struct Block {
    /// The register type.
    pub space: Option<Space>,
    /// The first address.
    pub start: Option<u32>,
    /// How many.
    pub quantity: Option<u32>,
}

/// The decoded PDU of a field, and the request that it responds to, if that is known.
pub struct Context<'a> {
    /// The PDU.
    pub pdu: Pdu<'a>,
    /// Its length in bytes.
    pub size: usize,
    /// Whether it is read as a response.
    pub is_response: bool,
    /// The request.
    request: Option<Pdu<'a>>,
}

impl<'a> Context<'a> {
    /// The context of the fields of a PDU.
    pub fn new(pdu: Pdu<'a>, size: usize, is_response: bool, request: Option<Pdu<'a>>) -> Self {
        // A request of another function says nothing about this response.
        let request = request.filter(|request| request.function == pdu.function);
        Self { pdu, size, is_response, request }
    }

    /// The number in a field of the request.
    pub fn requested(&self, path: &str) -> Option<u32> {
        self.request.as_ref()?.number(path)
    }

    /// Whether the layout of the PDU is known.
    pub fn has_layout(&self) -> bool {
        self.pdu.row.is_some_and(|row| self.layout(row).shape().is_some())
    }

    fn layout<'r>(&self, row: &'r FunctionRow) -> &'r Layout {
        if self.is_response {
            &row.response
        } else {
            &row.request
        }
    }

    /// The meaning of the function code; `is_guessed` where the direction was found by layout.
    pub fn title(&self, is_guessed: bool) -> Meaning {
        let code = self.pdu.function;
        let name = match self.pdu.row {
            None => {
                let own = if USER_DEFINED.iter().any(|codes| codes.contains(&code)) { ", user-defined" } else { "" };
                format!("function {code}{own}, not in the table")
            }
            Some(row) => match row.label() {
                label if label == row.name => label,
                label => format!("{} ({label})", row.name),
            },
        };
        if self.pdu.exception.is_some() {
            return Meaning::valid(format!("{name}: exception response"));
        }
        if self.is_response && self.pdu.row.is_some_and(|row| row.response == Layout::NoResponse) {
            return Meaning::wrong(format!("{name}: response, but this function has no response"));
        }
        let direction = if self.is_response { "response" } else { "request" };
        Meaning::valid(format!("{name}, {direction}{}", if is_guessed { " by its layout" } else { "" }))
    }

    /// The number of bytes after a field; `None` for a field of a group.
    pub fn bytes_after(&self, part: &Part<'_>) -> Option<usize> {
        (!part.is_in_group()).then(|| self.size - part.offset - part.bytes.len())
    }

    /// Register type, first address and quantity that a field belongs to, as far as known.
    ///
    /// A prefix of the name such as `write_` chooses between the two blocks of function 23.
    pub fn block(&self, name: &str) -> Block {
        let Some(space) = self.pdu.row.and_then(|row| row.space) else { return Block::default() };
        let prefix = &name[..name.rfind('_').map_or(0, |at| at + 1)];
        let (address, quantity) = (format!("{prefix}address"), format!("{prefix}quantity"));
        let known = if self.is_response { self.request.as_ref() } else { None };
        let known = known.filter(|request| request.number(&address).is_some()).unwrap_or(&self.pdu);
        Block { space: Some(space), start: known.number(&address), quantity: known.number(&quantity) }
    }
}
