//! The data model of a profile: a device and its points, as they are after a file was read.

use modlens_protocol::register_type::Space;

use crate::profile::types::{Access, Decimal, Order, Type};

/// A mistake in a profile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// Its line, counted from 1; 0 if the format has no lines.
    pub line: u32,
    /// The key and the path to it: `registers[3].type`.
    pub key: String,
    /// What is wrong, and what would be right.
    pub message: String,
    /// A known word with a similar spelling.
    pub hint: Option<String>,
}

impl Mistake {
    /// A mistake without a hint.
    pub fn new(line: u32, key: &str, message: String) -> Self {
        Self { line, key: key.to_owned(), message, hint: None }
    }
}

/// How a file counts addresses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AddressBase {
    /// As on the wire.
    #[default]
    Zero,
    /// "Register 1" is wire address 0.
    One,
    /// 40001 or 400001 is wire address 0 of the holding registers.
    Modicon,
}

/// The properties of the device as a whole.
#[derive(Clone, Debug, Default)]
pub struct Device {
    /// A unique name, such as vendor.model.
    pub id: Option<String>,
    /// Its manufacturer.
    pub vendor: Option<String>,

    /// Its model name.
    pub model: Option<String>,
    /// The document that the profile was written from.
    pub source: Option<String>,
    /// Free text.
    pub note: Option<String>,
    /// How the file counts addresses.
    pub address_base: AddressBase,
    /// The order of registers and bytes of points without an order of their own.
    pub order: Order,
    /// The function codes that it supports; empty if the profile does not list them.
    pub functions: Vec<u8>,
    /// Its own names for exception codes.
    pub exceptions: Vec<(u8, String)>,
    /// The vendor tables of functions that it needs.
    pub vendor_functions: Vec<String>,
    /// The `SunSpec` model that the addresses are relative to.
    pub sunspec: Option<u16>,
}

impl Device {
    /// Whether the device supports this function code, as far as the profile says.
    #[inline]
    pub fn lists_function(&self, code: u8) -> bool {
        self.functions.is_empty() || self.functions.contains(&code)
    }
}

/// A raw value that means "no value".
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sentinel {
    /// The bits of the value as an unsigned number, or the signed number.
    Whole(i128),
    /// A floating point number.
    Float(f64),
}

/// A named value of the device, or an array of such values.
#[derive(Clone, Debug)]
pub struct Point {
    /// The table that it belongs to.
    pub space: Space,
    /// The address of its first register or bit, as on the wire.
    pub address: u16,
    /// First and last bit, if it is a part of a register.
    pub bits: Option<(u8, u8)>,
    /// Its name.
    pub name: String,
    /// The type of its values.
    pub kind: Type,
    /// The number of registers or bits that all its values take together.
    pub count: u16,
    /// The order of registers and bytes.
    pub order: Order,
    /// value = raw * scale + offset.
    pub scale: Option<Decimal>,
    /// value = raw * scale + offset.
    pub offset: Option<Decimal>,
    /// The name of the point that holds a scale factor: a power of ten.
    pub sf: Option<String>,
    /// Unit of measure.
    pub unit: Option<String>,
    /// Whether it is read, written or both.
    pub access: Access,
    /// Labels of values (an enumeration).
    pub labels: Vec<(i64, String)>,
    /// Labels of bits (flags).
    pub bit_labels: Vec<(u8, String)>,
    /// Raw values that mean "no value".
    pub nan: Vec<Sentinel>,
    /// The group under which it is listed.
    pub group: Option<String>,
    /// Free text.
    pub note: Option<String>,
    /// The number of the profile, where several apply to one unit (`SunSpec` models). Names are unique within a scope.
    pub scope: u16,
    /// The lines of its keys in the file.
    pub lines: KeyLines,
}

/// The lines of a point's keys, for mistakes that are found later; 0 if the format has no lines.
#[derive(Clone, Copy, Debug, Default)]
pub struct KeyLines {
    /// The line of `at`.
    pub at: u32,
    /// The line of `name`.
    pub name: u32,
    /// The line of `sf`.
    pub sf: u32,
    /// The index of the point in the file, from 0.
    pub index: usize,
}

impl Point {
    /// The number of registers or bits of one of its values.
    pub fn registers_per_value(&self) -> u16 {
        match self.kind.registers() {
            0 => self.count,
            registers => registers,
        }
    }

    /// The number of its values: more than one for an array.
    pub fn value_count(&self) -> u16 {
        self.count / self.registers_per_value().max(1)
    }
}

/// A profile that has been checked.
#[derive(Clone, Debug, Default)]
pub struct Profile {
    /// The device.
    pub device: Device,
    /// Its points, in the order of the file.
    pub points: Vec<Point>,
}
