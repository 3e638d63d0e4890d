//! The table of Modbus functions: `dissectors/functions.toml`, parsed into one row per function code (or per
//! sub-function) with the field layout of its request and response.
//!
//! This module knows the format of the table and nothing about any single function. Users and vendors add rows in the
//! same words.

use std::sync::OnceLock;

mod parse;
mod row;
mod shape;

pub use parse::parse_toml;
pub use row::{Echo, FieldLimits, FieldOffsets, FunctionRow, Operation, StandardLayout, StandardRequest};
pub use shape::{Extent, Field, FieldType, Layout, Shape};

use parse::parse;
use shape::number;

/// The embedded table.
pub const TABLE: &str = include_str!("../../../../dissectors/functions.toml");

/// The embedded vocabulary: exceptions, sub-functions, MEI types, objects.
pub const VOCABULARY: &str = include_str!("../../../../dissectors/vocabulary.toml");

/// Function tables of vendors, by vendor name. They are embedded in the library but loaded only on request, because
/// vendors use the same function codes for different purposes.
pub const VENDORS: &[(&str, &str)] = &[
    ("huawei", include_str!("../../../../dissectors/vendor/huawei.toml")),
    ("pace", include_str!("../../../../dissectors/vendor/pace.toml")),
    ("sungrow", include_str!("../../../../dissectors/vendor/sungrow.toml")),
];

/// Set in the function code of an exception response (Modbus Application Protocol V1.1b3, section 7).
pub const EXCEPTION_BIT: u8 = 0x80;

/// The rows of one function code: one row, or one row per value of its first field (sub-function, MEI type).
#[derive(Clone, Debug)]
struct FunctionVariants {
    /// Size in bytes of the leading field whose value selects the variant; 0 if the function has no variants.
    width: usize,
    variants: Vec<FunctionRow>,
}

/// The table of functions: its rows, indexed by function code.
#[derive(Clone, Debug)]
pub struct Functions {
    entries: Vec<Option<Box<FunctionVariants>>>,
    /// For each function code, the request, if the function is a standard read or write (see `StandardLayout`).
    /// Computed once, because the fast path for request and response pairs needs it for every frame.
    standard_requests: Vec<Option<StandardRequest>>,
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
            let mut table = Self { entries: vec![None; 256], standard_requests: vec![None; 256] };
            table.load(TABLE, "functions.toml", None).expect("the embedded table is tested");
            table
        })
    }

    /// Adds the rows of a TOML text. A row replaces an existing row with the same code and the same `when`. `origin` is
    /// the file name for error messages.
    ///
    /// The error names the row and the key that is wrong.
    pub fn load(&mut self, text: &str, origin: &str, vendor: Option<&str>) -> Result<(), String> {
        let rows = parse(text, origin, vendor)?;
        for row in rows {
            let code = row.code as usize;
            let slot = &mut self.entries[code];
            let width = leading_width(&row);
            match slot {
                Some(entry) => {
                    entry.variants.retain(|old| old.when != row.when);
                    if row.when.is_some() {
                        entry.width = width;
                    }
                    entry.variants.push(row);
                    // The row without `when` applies to all values that have no row of their own, so it must be tried
                    // last.
                    entry.variants.sort_by_key(|row| row.when.is_none());
                }
                None => {
                    *slot = Some(Box::new(FunctionVariants {
                        width: if row.when.is_some() { width } else { 0 },
                        variants: vec![row],
                    }));
                }
            }
            let only = slot.as_deref().filter(|entry| entry.width == 0).and_then(|entry| entry.variants.first());
            self.standard_requests[code] = only.and_then(StandardRequest::of);
        }
        Ok(())
    }

    /// Adds the rows of an embedded vendor table; the name is not case-sensitive. The error lists the known names.
    pub fn load_vendor(&mut self, name: &str) -> Result<(), String> {
        let known = || VENDORS.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        let (_, text) = VENDORS
            .iter()
            .find(|(known, _)| known.eq_ignore_ascii_case(name))
            .ok_or_else(|| format!("no functions of vendor {name:?}; known are {}", known()))?;
        self.load(text, name, Some(name))
    }

    /// The row for a function code (without the exception bit) and the body of its request or response, which selects
    /// the variant. `None` if the code is unknown, or if the body is too short to contain the leading field and no
    /// variant is generic.
    #[inline]
    pub fn row(&self, code: u8, body: &[u8]) -> Option<&FunctionRow> {
        let entry = self.entries[code as usize].as_deref()?;
        if entry.width == 0 {
            return entry.variants.first();
        }
        let leading = number(body, 0, entry.width).map(|value| value as u16);
        entry.variants.iter().find(|row| row.when.is_none() || row.when == leading)
    }

    /// Returns the request with this function code, if it is a standard read or write.
    #[inline]
    pub fn standard_request(&self, code: u8) -> Option<StandardRequest> {
        self.standard_requests[usize::from(code)]
    }

    /// The number of body bytes that `row` needs to choose between the variants of a function; 0 if it has none.
    #[inline]
    pub fn leading_bytes(&self, code: u8) -> usize {
        self.entries[code as usize].as_deref().map_or(0, |entry| entry.width)
    }

    /// The name of a function, as the specification spells it.
    pub fn name(&self, code: u8) -> Option<&str> {
        self.first_variant(code).map(|row| row.name.as_str())
    }

    /// The first row of this function code. Use it only for properties that all variants share, such as the name.
    #[inline]
    pub fn first_variant(&self, code: u8) -> Option<&FunctionRow> {
        self.entries[code as usize].as_deref()?.variants.first()
    }

    /// Whether this function writes registers or bits.
    #[inline]
    pub fn writes(&self, code: u8) -> bool {
        self.first_variant(code).is_some_and(|row| matches!(row.operation, Operation::Write | Operation::ReadWrite))
    }

    /// All rows of this function code.
    pub fn variants(&self, code: u8) -> &[FunctionRow] {
        self.entries[code as usize].as_deref().map_or(&[], |entry| &entry.variants)
    }

    /// All rows, by code.
    pub fn rows(&self) -> impl Iterator<Item = &FunctionRow> {
        self.entries.iter().flatten().flat_map(|entry| entry.variants.iter())
    }
}

/// Size in bytes of the first request field, which is the one that `when` compares.
fn leading_width(row: &FunctionRow) -> usize {
    row.request.shape().and_then(|shape| shape.fields.first()).map_or(0, |field| field.field_type.width())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(code: u8, body: &[u8]) -> &'static FunctionRow {
        Functions::embedded().row(code, body).unwrap()
    }

    #[test]
    fn body_lengths_follow_the_specification() {
        // Bodies are PDUs without the function code (Modbus Application Protocol V1.1b3, section 6).
        assert_eq!(row(3, &[]).request.extent(&[]), Extent::Exactly(4));
        assert_eq!(row(3, &[]).response.extent(&[]), Extent::AtLeast(1));
        assert_eq!(row(3, &[]).response.extent(&[6]), Extent::Exactly(7));
        assert_eq!(row(16, &[]).request.extent(&[0, 1, 0, 2, 4]), Extent::Exactly(9));
        assert_eq!(row(24, &[]).response.extent(&[0, 6]), Extent::Exactly(8));
        assert_eq!(row(8, &[0, 0]).request.extent(&[0, 0, 1]), Extent::Open(2));
        assert_eq!(row(8, &[0, 11]).request.extent(&[0, 11]), Extent::Exactly(4));
        assert_eq!(row(8, &[0, 4]).response, Layout::NoResponse);
        let identification = [0x0E, 1, 1, 0, 0, 2, 0, 2, 65, 66, 1];
        assert_eq!(row(43, &[14]).response.extent(&identification), Extent::AtLeast(12));
        assert_eq!(row(43, &[14]).response.extent(&[0x0E, 1, 1, 0, 0, 1, 0, 2, 65, 66]), Extent::Exactly(10));
        assert_eq!(row(90, &[]).request, Layout::Unknown);
    }

    #[test]
    fn a_least_length_is_more_than_the_bytes_that_it_was_read_from() {
        for row in Functions::embedded().rows() {
            for shape in [&row.request, &row.response].into_iter().filter_map(Layout::shape) {
                for value in [0, 1, 2, 5, 14, 43, 0x80, 0xFF] {
                    for length in 0..40 {
                        if let Extent::AtLeast(least) = shape.extent(&vec![value; length]) {
                            assert!(least > length, "{}: {least} of {length} bytes of {value}", row.code);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn table_contains_all_public_functions() {
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
    fn errors_name_the_mistake() {
        let load =
            |row: &str| Functions::default().load(&format!("format = 1\n[[function]]\n{row}"), "my.toml", None).unwrap_err();
        let required_keys = "name = \"X\"\nexample = { request = \"41\" }\n";
        assert!(load(&format!("code = 65\n{required_keys}request = [\"a:u32\"]")).contains("known are u8 u16"));
        assert!(load(&format!("code = 200\n{required_keys}")).contains("1 to 127"));
        assert!(load(&format!("code = 65\n{required_keys}colour = 1")).contains("\"colour\""));
        assert!(load("code = 65\nname = \"X\"").contains("example"));
        assert!(load(&format!("code = 65\n{required_keys}when = {{ b = 1 }}\nrequest = [\"a:u8\"]")).contains("first field"));
        assert!(Functions::default().load("x = 1", "my.toml", None).unwrap_err().contains("format = 1"));
    }
}
