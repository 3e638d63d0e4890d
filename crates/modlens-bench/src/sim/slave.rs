//! The devices on a bus, their proprietary functions, and the entries of the poll list.

use crate::sim::registers::Registers;

/// One device.
#[derive(Debug)]
pub(crate) struct Slave {
    pub(crate) unit: u8,
    /// Typical time to answer, in ns.
    pub(crate) answer_ns: f64,
    /// Answers 4 bytes per register.
    pub(crate) enron: bool,
    /// Does not keep to the specification.
    pub(crate) quirk: bool,
    /// ASCII: writes lower-case hex.
    pub(crate) lower_case: bool,
    pub(crate) registers: Registers,
}

/// How long the bodies of a vendor's function are.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Style {
    /// Always the same.
    Fixed { request: usize, response: usize },
    /// The first byte counts the rest.
    Counted,
    /// Nobody knows.
    Random,
}

/// A vendor's function.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Custom {
    pub(crate) code: u8,
    pub(crate) style: Style,
}

/// One entry of the poll list.
#[derive(Clone, Debug)]
pub(crate) struct PollItem {
    pub(crate) slave: usize,
    pub(crate) pdu: Vec<u8>,
}
