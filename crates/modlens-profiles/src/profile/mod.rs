//! Device profiles: which registers mean what. One model, three spellings: TOML, YAML (as a tree from Python) and CSV.
//!
//! A file is read whatever is wrong with it, and every mistake is told at once, with line and key. `keys` has the keys,
//! `points` turns a profile into a plan that converts.

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

/// The profiles that are shipped: name, TOML text. In `dissectors/profiles/`.
pub const SHIPPED: &[(&str, &str)] = &[
    ("mightyzap", include_str!("../../../../dissectors/profiles/mightyzap.toml")),
    ("grundfos", include_str!("../../../../dissectors/profiles/grundfos.toml")),
];

/// `SunSpec` models by number; their addresses count from the model's ID register. In `dissectors/profiles/sunspec/`.
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

/// Something that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mistake {
    /// The line, from 1; 0 where the file has none.
    pub line: u32,
    /// The key, with the way to it: `registers[3].type`.
    pub key: String,
    /// What is wrong, and what is right.
    pub message: String,
    /// A known word that is near.
    pub hint: Option<String>,
}

impl Mistake {
    /// A mistake without a hint.
    pub fn new(line: u32, key: &str, message: String) -> Self {
        Self { line, key: key.to_owned(), message, hint: None }
    }
}

/// How addresses are counted in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Base {
    /// As on the wire.
    #[default]
    Zero,
    /// "Register 1" is wire address 0.
    One,
    /// 40001 or 400001 is wire address 0 of the holding registers.
    Modicon,
}

/// What is known of the device as a whole.
#[derive(Clone, Debug, Default)]
pub struct Device {
    /// A name of its own.
    pub id: Option<String>,
    /// Who makes it.
    pub vendor: Option<String>,
    /// What it is called.
    pub model: Option<String>,
    /// The document.
    pub source: Option<String>,
    /// Free text.
    pub note: Option<String>,
    /// How the file counts.
    pub address_base: Base,
    /// Order of points that say none.
    pub order: Order,
    /// Function codes that it knows; empty if that is not said.
    pub functions: Vec<u8>,
    /// Its words for exception codes.
    pub exceptions: Vec<(u8, String)>,
    /// Function rows that it needs.
    pub vendor_functions: Vec<String>,
    /// The `SunSpec` model that the addresses are relative to.
    pub sunspec: Option<u16>,
}

/// A raw value that means "no value".
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sentinel {
    /// The bits of the value, or the signed number.
    Whole(i128),
    /// A floating point number.
    Float(f64),
}

/// A named value of the device.
#[derive(Clone, Debug)]
pub struct Point {
    /// Which table.
    pub space: Space,
    /// First register or bit, as on the wire.
    pub address: u16,
    /// First and last bit, where it is a part of a register.
    pub bits: Option<(u8, u8)>,
    /// What it is called.
    pub name: String,
    /// How it is read.
    pub kind: Type,
    /// Registers or bits that it takes.
    pub count: u16,
    /// Order of bytes.
    pub order: Order,
    /// value = raw * scale + offset.
    pub scale: Option<Decimal>,
    /// value = raw * scale + offset.
    pub offset: Option<Decimal>,
    /// The point that holds a power of ten.
    pub sf: Option<String>,
    /// Unit of measure.
    pub unit: Option<String>,
    /// Read or written.
    pub access: Access,
    /// Labels of values.
    pub labels: Vec<(i64, String)>,
    /// Labels of bits.
    pub bit_labels: Vec<(u8, String)>,
    /// Raw values that mean "no value".
    pub nan: Vec<Sentinel>,
    /// Free text to group by.
    pub group: Option<String>,
    /// Free text.
    pub note: Option<String>,
    /// Which of several profiles on one unit it comes from: names are unique in it.
    pub scope: u16,
    /// Where its keys stand in the file.
    pub lines: Lines,
}

/// Where a point's keys stand, for what is found out later; lines are 0 where the file has none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines {
    /// Of `at`.
    pub at: u32,
    /// Of `name`.
    pub name: u32,
    /// Of `sf`.
    pub sf: u32,
    /// The point's number in the file, from 0.
    pub index: usize,
}

impl Point {
    /// Registers or bits of one of its values.
    pub fn step(&self) -> u16 {
        match self.kind.registers() {
            0 => self.count,
            registers => registers,
        }
    }

    /// How many values it has.
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

/// How a profile is spelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// TOML.
    Toml,
    /// CSV.
    Csv,
    /// A JSON tree with lines, see `node::from_tree`; what Python makes of YAML.
    Tree,
    /// Plain JSON.
    Json,
}

impl Form {
    /// By its word.
    pub fn from_word(word: &str) -> Option<Self> {
        let all = [("toml", Self::Toml), ("csv", Self::Csv), ("tree", Self::Tree), ("json", Self::Json)];
        all.into_iter().find(|(name, _)| *name == word).map(|(_, form)| form)
    }
}

impl Profile {
    /// Reads a file; all mistakes at once, by line.
    ///
    /// ```
    /// use modlens_profiles::profile::{Form, Profile};
    /// let mistakes = Profile::parse("profile = 1\n[[registers]]\nat = 'hr:1'\ntyp = 'u23'\n", Form::Toml).unwrap_err();
    /// assert_eq!((mistakes.len(), mistakes[0].line), (2, 2)); // no name, and no key `typ`
    /// ```
    pub fn parse(text: &str, form: Form) -> Result<Self, Vec<Mistake>> {
        let mut mistakes = Vec::new();
        let tree = match form {
            Form::Toml => toml::parse(text, &mut mistakes),
            Form::Csv => csv::parse(text, &mut mistakes),
            Form::Tree | Form::Json => {
                let json: Json =
                    serde_json::from_str(text).map_err(|error| vec![Mistake::new(0, "", format!("no JSON: {error}"))])?;
                let tree = if form == Form::Json { Some(node::from_json(&json)) } else { node::from_tree(&json) };
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

    /// A shipped profile.
    pub fn shipped(name: &str) -> Option<Self> {
        let (_, text) = SHIPPED.iter().find(|(known, _)| *known == name)?;
        Self::parse(text, Form::Toml).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_profiles_have_no_mistakes() {
        for (number, text) in SUNSPEC {
            assert_eq!(Profile::parse(text, Form::Toml).unwrap().device.sunspec, Some(*number));
        }
        for (name, text) in SHIPPED {
            if let Err(mistakes) = Profile::parse(text, Form::Toml) {
                panic!("{name}: {mistakes:?}");
            }
        }
    }
}
