//! The keys of a profile: one row each. The checks, the JSON Schema and the CSV reader go by these rows.

/// What a key takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A text.
    Text,
    /// `hr:0x00CD`, `hr:10.3`.
    At,
    /// A word of `Type::ALL`.
    Type,
    /// A word of `Order::ALL`.
    Order,
    /// A word of `Access::ALL`.
    Access,
    /// A whole number from 1 on.
    Whole,
    /// A number.
    Number,
    /// A number or a list of numbers.
    Numbers,
    /// A table of number -> text.
    Labels,
    /// A table of exception code -> text.
    Wording,
    /// A list of function codes.
    Codes,
    /// A list of texts.
    Names,
    /// 0, 1 or `modicon`.
    Base,
}

/// One key.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// The key.
    pub key: &'static str,
    /// What it takes.
    pub shape: Shape,
    /// What it is for.
    pub help: &'static str,
}

const fn key(key: &'static str, shape: Shape, help: &'static str) -> Key {
    Key { key, shape, help }
}

/// Keys of the file.
pub const FILE: &[&str] = &["profile", "device", "registers"];

/// Keys of `[device]`.
pub const DEVICE: &[Key] = &[
    key("id", Shape::Text, "a name of its own, such as vendor.model"),
    key("vendor", Shape::Text, "who makes it"),
    key("model", Shape::Text, "what it is called"),
    key("source", Shape::Text, "the document that the profile is written from"),
    key("note", Shape::Text, "free text"),
    key("address_base", Shape::Base, "0: addresses as on the wire; 1: register 1 is wire address 0; modicon: 40001 or 400001"),
    key("order", Shape::Order, "order of bytes of all points that say none"),
    key("functions", Shape::Codes, "function codes that the device knows"),
    key("exceptions", Shape::Wording, "the device's own words for exception codes"),
    key("vendor_functions", Shape::Names, "vendors whose function rows are needed, as --functions names them"),
    key("sunspec", Shape::Whole, "number of a SunSpec model; its addresses count from the model's ID register"),
];

/// Keys of a point in `[[registers]]`.
pub const POINT: &[Key] = &[
    key(
        "at",
        Shape::At,
        "where it stands: hr, ir, co or di, a colon, the address, and .bit or .bit-bit for a part of a register",
    ),
    key("name", Shape::Text, "what it is called"),
    key("type", Shape::Type, "how its registers are read; u16 if nothing is said, bool for single bits"),
    key("count", Shape::Whole, "registers or bits that it takes; needed for texts and raw; several values make an array"),
    key("order", Shape::Order, "order of bytes"),
    key("scale", Shape::Number, "value = raw * scale + offset"),
    key("offset", Shape::Number, "value = raw * scale + offset"),
    key("sf", Shape::Text, "name of the point that holds the exponent n of a further scale 10^n"),
    key("unit", Shape::Text, "unit of measure"),
    key("access", Shape::Access, "r, w or rw"),
    key("enum", Shape::Labels, "labels of values"),
    key("bits", Shape::Labels, "labels of bits, counted from the lowest"),
    key("nan", Shape::Numbers, "raw values that mean: no value"),
    key("group", Shape::Text, "free text to group points by"),
    key("note", Shape::Text, "free text"),
];

/// The nearest of the known words, if one is near: at most a third of the letters differ.
pub fn near<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let word: Vec<char> = word.to_lowercase().chars().take(64).collect();
    let best = known.into_iter().map(|candidate| (distance(&word, &candidate.chars().collect::<Vec<_>>()), candidate)).min()?;
    (best.0 * 3 <= word.len().max(best.1.len())).then_some(best.1)
}

/// Letters to change, add, drop, or to swap with their neighbour.
fn distance(a: &[char], b: &[char]) -> usize {
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
    fn near_names() {
        let known = || POINT.iter().map(|key| key.key);
        assert_eq!(near("typ", known()), Some("type"));
        assert_eq!(near("sacle", known()), Some("scale"));
        assert_eq!(near("units", known()), Some("unit"));
        assert_eq!(near("zzz", known()), None);
    }
}
