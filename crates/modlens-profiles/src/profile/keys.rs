//! The keys of a profile, one row each. The checks, the JSON Schema and the CSV reader are all driven by these rows.

/// The kind of value that a key takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ValueKind {
    /// A text.
    Text,
    /// `hr:0x00CD`, `hr:10.3`.
    At,
    /// The name of a `Type`.
    Type,
    /// The name of an `Order`.
    Order,
    /// The name of an `Access`.
    Access,
    /// An integer from 1 on.
    Whole,
    /// A number.
    Number,
    /// A number or a list of numbers.
    Numbers,
    /// A table of number -> label.
    Labels,
    /// A table of exception code -> name.
    Wording,
    /// A list of function codes.
    Codes,
    /// A list of names.
    Names,
    /// 0, 1 or `modicon`.
    Base,
}

/// A key with its kind of value and its help text.
#[derive(Clone, Copy, Debug)]
pub struct ProfileKey {
    /// Its name.
    pub key: &'static str,
    /// The kind of value that it takes.
    pub value_kind: ValueKind,
    /// Help for the user.
    pub help: &'static str,
}

const fn key(key: &'static str, value_kind: ValueKind, help: &'static str) -> ProfileKey {
    ProfileKey { key, value_kind, help }
}

/// Keys at the top of the file.
pub const FILE: &[&str] = &["profile", "device", "registers"];

/// Keys of `[device]`.
pub const DEVICE: &[ProfileKey] = &[
    key("id", ValueKind::Text, "a name of its own, such as vendor.model"),
    key("vendor", ValueKind::Text, "manufacturer"),
    key("model", ValueKind::Text, "name"),
    key("source", ValueKind::Text, "document from which the profile was written"),
    key("note", ValueKind::Text, "free text"),
    key(
        "address_base",
        ValueKind::Base,
        "0: addresses as on the wire; 1: register 1 is wire address 0; modicon: 40001 or 400001",
    ),
    key("order", ValueKind::Order, "byte order of all points without their own"),
    key("functions", ValueKind::Codes, "function codes that the device supports"),
    key("exceptions", ValueKind::Wording, "the device's own words for exception codes"),
    key("vendor_functions", ValueKind::Names, "vendors whose function rows are needed, as --functions names them"),
    key("sunspec", ValueKind::Whole, "number of a SunSpec model; its addresses count from the model's ID register"),
];

/// Keys of a point in `[[registers]]`.
pub const POINT: &[ProfileKey] = &[
    key("at", ValueKind::At, "location: hr, ir, co or di, a colon, the address, and .bit or .bit-bit for a part of a register"),
    key("name", ValueKind::Text, "name"),
    key("type", ValueKind::Type, "data type; default: u16, or bool for single bits"),
    key("count", ValueKind::Whole, "number of registers or bits; required for text and raw; several values make an array"),
    key("order", ValueKind::Order, "byte order"),
    key("scale", ValueKind::Number, "value = raw * scale + offset"),
    key("offset", ValueKind::Number, "value = raw * scale + offset"),
    key("sf", ValueKind::Text, "name of the point that holds the exponent n of a further scale 10^n"),
    key("unit", ValueKind::Text, "unit of measure"),
    key("access", ValueKind::Access, "r, w or rw"),
    key("enum", ValueKind::Labels, "labels of values"),
    key("bits", ValueKind::Labels, "labels of bits, counted from the lowest"),
    key("nan", ValueKind::Numbers, "raw values that mean: no value"),
    key("group", ValueKind::Text, "free text to group points by"),
    key("note", ValueKind::Text, "free text"),
];

/// The known word with the most similar spelling, if at most a third of the letters differ.
pub fn similar_word<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let word: Vec<char> = word.to_lowercase().chars().take(64).collect();
    let best =
        known.into_iter().map(|candidate| (edit_distance(&word, &candidate.chars().collect::<Vec<_>>()), candidate)).min()?;
    (best.0 * 3 <= word.len().max(best.1.len())).then_some(best.1)
}

/// The edit distance of two words: letters to change, add or drop, or to swap with their neighbour.
fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for (i, row) in rows.iter_mut().enumerate() {
        row[0] = i;
    }
    for (j, cell) in rows[0].iter_mut().enumerate() {
        *cell = j;
    }
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let change = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            rows[i][j] = change.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                rows[i][j] = rows[i][j].min(rows[i - 2][j - 2] + 1);
            }
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_keys_are_recognised() {
        let known = || POINT.iter().map(|key| key.key);
        assert_eq!(similar_word("typ", known()), Some("type"));
        assert_eq!(similar_word("sacle", known()), Some("scale"));
        assert_eq!(similar_word("units", known()), Some("unit"));
        assert_eq!(similar_word("zzz", known()), None);
    }
}
