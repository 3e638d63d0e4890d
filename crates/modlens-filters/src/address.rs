//! Addresses of registers as handbooks write them: `40108`, `400108`, `4x006B`.

use modlens_protocol::register_type::{self, Space};

/// The highest wire address.
pub const LAST_ADDRESS: i64 = register_type::LAST_ADDRESS as i64;

/// The register type and wire address of a text, if it is an address of a handbook.
pub fn parse(text: &str) -> Option<(Space, i64)> {
    let first = text.chars().next()?.to_digit(10)?;
    let space = Space::ALL.iter().find(|row| row.3 == first)?.0;
    let rest = &text[1..];
    if let Some(hex) = rest.strip_prefix('x') {
        let is_hex = (1..=4).contains(&hex.len()) && hex.bytes().all(|digit| digit.is_ascii_hexdigit());
        return is_hex.then(|| i64::from_str_radix(hex, 16).ok()).flatten().map(|wire| (space, wire));
    }
    let is_number = matches!(rest.len(), 4 | 5) && rest.bytes().all(|digit| digit.is_ascii_digit());
    // Handbooks count from 1.
    let wire = is_number.then(|| rest.parse::<i64>().ok()).flatten()? - 1;
    (0..=LAST_ADDRESS).contains(&wire).then_some((space, wire))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_literal_says_type_and_address() {
        for (text, space, wire) in [
            ("40108", Space::Holding, 107),
            ("400108", Space::Holding, 107),
            ("465536", Space::Holding, 65535),
            ("4x006B", Space::Holding, 107),
            ("4x6b", Space::Holding, 107),
            ("30001", Space::Input, 0),
            ("10197", Space::Discrete, 196),
            ("00020", Space::Coil, 19),
            ("000020", Space::Coil, 19),
            ("0xFFFF", Space::Coil, 65535),
        ] {
            assert_eq!(parse(text), Some((space, wire)), "{text}");
        }
    }

    /// Zero does not exist where one counts from 1, nor does the type 2.
    #[test]
    fn other_texts_are_no_literals() {
        for text in ["", "107", "40000", "400000", "465537", "20001", "4x", "4xG", "4x12345", "-40001", "4ä001"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }
}
