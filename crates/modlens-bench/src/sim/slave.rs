//! The devices on a bus, their proprietary functions, and the entries of the poll list.

use crate::sim::registers::Registers;

/// One device.
#[derive(Debug)]
pub(crate) struct Slave {
    pub(crate) unit: u8,
    /// The typical response time, in ns.
    pub(crate) response_time_ns: f64,
    /// It returns 4 bytes per register, as Enron Modbus does.
    pub(crate) enron: bool,
    /// It violates the specification in several ways.
    pub(crate) quirk: bool,
    /// In ASCII mode it writes lower-case hex digits.
    pub(crate) lower_case: bool,
    pub(crate) registers: Registers,
}

/// How the length of a proprietary function's PDUs is determined; lengths exclude the function code.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LengthStyle {
    /// Constant lengths.
    Fixed { request: usize, response: usize },
    /// The first byte counts the bytes after it.
    Counted,
    /// Random lengths.
    Random,
}

/// A proprietary function.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProprietaryFunction {
    pub(crate) code: u8,
    pub(crate) style: LengthStyle,
}

/// One entry of the poll list.
#[derive(Clone, Debug)]
pub(crate) struct PollItem {
    pub(crate) slave: usize,
    pub(crate) pdu: Vec<u8>,
}
