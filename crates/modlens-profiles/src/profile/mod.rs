//! Device profiles (register maps): which registers have which meaning. One data model with three notations: TOML, YAML
//! (parsed by Python and passed as a tree) and CSV.
//!
//! A file is read to its end whatever is wrong with it, and all mistakes are reported together, with line and key.
//! `keys` lists the keys of the format; `points` compiles a profile to a plan that converts registers to values.

mod check;
mod cross;
mod csv;
mod json;
pub mod keys;
mod kinds;
mod node;
mod place;
mod schema;
mod toml;

pub use json::to_json;
pub use kinds::{decimal_text, Access, Decimal, Order, Type};
pub use schema::schema;

use modlens_protocol::register_type::Space;
use serde_json::Value as Json;

/// The profiles that are shipped: name and TOML text, from `dissectors/profiles/`.
pub const SHIPPED: &[(&str, &str)] = &[
    ("mightyzap", include_str!("../../../../dissectors/profiles/mightyzap.toml")),
    ("grundfos", include_str!("../../../../dissectors/profiles/grundfos.toml")),
];

/// `SunSpec` models: number and TOML text, from `dissectors/profiles/sunspec/`. Their addresses count from the ID
/// register of the model.
pub const SUNSPEC: &[(u16, &str)] = &[
    (1, include_str!("../../../../dissectors/profiles/sunspec/model_1.toml")),
    (101, include_str!("../../../../dissectors/profiles/sunspec/model_101.toml")),
    (102, include_str!("../../../../dissectors/profiles/sunspec/model_102.toml")),
    (103, include_str!("../../../../dissectors/profiles/sunspec/model_103.toml")),
    (111, include_str!("../../../../dissectors/profiles/sunspec/model_111.toml")),
    (112, include_str!("../../../../dissectors/profiles/sunspec/model_112.toml")),
    (113, include_str!("../../../../dissectors/profiles/sunspec/model_113.toml")),
    (120, include_str!("../../../../dissectors/profiles/sunspec/model_120.toml")),
    (121, include_str!("../../../../dissectors/profiles/sunspec/model_121.toml")),
    (122, include_str!("../../../../dissectors/profiles/sunspec/model_122.toml")),
    (123, include_str!("../../../../dissectors/profiles/sunspec/model_123.toml")),
];

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
    pub fn step(&self) -> u16 {
        match self.kind.registers() {
            0 => self.count,
            registers => registers,
        }
    }

    /// The number of its values: more than one for an array.
    pub fn length(&self) -> u16 {
        self.count / self.step().max(1)
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

/// The notation of a profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileFormat {
    /// TOML.
    Toml,
    /// CSV.
    Csv,
    /// A JSON tree in which every value has its line (see `node::from_tree`), which Python makes of YAML.
    Tree,
    /// Plain JSON.
    Json,
}

impl ProfileFormat {
    /// The notation with this name.
    pub fn from_word(word: &str) -> Option<Self> {
        let all = [("toml", Self::Toml), ("csv", Self::Csv), ("tree", Self::Tree), ("json", Self::Json)];
        all.into_iter().find(|(name, _)| *name == word).map(|(_, form)| form)
    }
}

impl Profile {
    /// Parses a profile. The error lists all mistakes, sorted by line.
    ///
    /// ```
    /// use modlens_profiles::profile::{Form, Profile};
    /// let mistakes = Profile::parse("profile = 1\n[[registers]]\nat = 'hr:1'\ntyp = 'u23'\n", Form::Toml).unwrap_err();
    /// assert_eq!((mistakes.len(), mistakes[0].line), (2, 2)); // no name, and no key `typ`
    /// ```
    pub fn parse(text: &str, form: ProfileFormat) -> Result<Self, Vec<Mistake>> {
        let mut mistakes = Vec::new();
        let tree = match form {
            ProfileFormat::Toml => toml::parse(text, &mut mistakes),
            ProfileFormat::Csv => csv::parse(text, &mut mistakes),
            ProfileFormat::Tree | ProfileFormat::Json => {
                let json: Json =
                    serde_json::from_str(text).map_err(|error| vec![Mistake::new(0, "", format!("no JSON: {error}"))])?;
                let tree = if form == ProfileFormat::Json { Some(node::from_json(&json)) } else { node::from_tree(&json) };
                tree.ok_or_else(|| vec![Mistake::new(0, "", "no tree of [line, value]".into())])?
            }
        };
        let profile = check::profile(&tree, &mut mistakes);
        cross::check(&profile, &mut mistakes);
        if mistakes.is_empty() {
            return Ok(profile);
        }
        mistakes.sort_by_key(|mistake| mistake.line);
        Err(mistakes)
    }

    /// The shipped profile with this name.
    pub fn shipped(name: &str) -> Option<Self> {
        let (_, text) = SHIPPED.iter().find(|(known, _)| *known == name)?;
        Self::parse(text, ProfileFormat::Toml).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_profiles_have_no_mistakes() {
        for (number, text) in SUNSPEC {
            assert_eq!(Profile::parse(text, ProfileFormat::Toml).unwrap().device.sunspec, Some(*number));
        }
        for (name, text) in SHIPPED {
            if let Err(mistakes) = Profile::parse(text, ProfileFormat::Toml) {
                panic!("{name}: {mistakes:?}");
            }
        }
    }
}
