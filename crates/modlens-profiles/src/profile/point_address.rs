//! Parses the key `at`, the address of a point: `hr:0x00CD`, `hr:40108` with base modicon, `hr:10.3`, `hr:10.4-7`,
//! `co:5`.

use crate::profile::model::AddressBase;
use modlens_protocol::register_type::Space;

/// The address of a point: table, wire address, and the bits of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointAddress {
    /// The table.
    pub space: Space,
    /// The address on the wire, counted from 0.
    pub address: u16,
    /// First and last bit, if only a part of the register is meant.
    pub bits: Option<(u8, u8)>,
}

/// Parses an address; the error says what is wrong and what would be right.
pub fn parse(text: &str, base: AddressBase) -> Result<PointAddress, String> {
    let (word, rest) = text.trim().split_once(':').ok_or("takes hr, ir, co or di, a colon and an address, such as hr:0x00CD")?;
    let space = Space::from_word(&word.trim().to_ascii_lowercase())
        .ok_or_else(|| format!("{word:?} is not a table; write hr (holding), ir (input), co (coil) or di (discrete input)"))?;
    let (number, bits) = match rest.split_once('.') {
        Some((number, bits)) => (number, Some(parse_bits(bits, space)?)),
        None => (rest, None),
    };
    let number = parse_number(number.trim()).ok_or_else(|| format!("{:?} is not an address", number.trim()))?;
    Ok(PointAddress { space, address: to_wire(number, space, base)?, bits })
}

/// A decimal or hexadecimal number without a sign.
fn parse_number(text: &str) -> Option<u64> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u64::from_str_radix(digits, 16).ok(),
        // Checked because `parse` accepts a plus sign.
        None => text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok())?,
    }
}

/// A bit (`3`) or a range of bits (`4-7`) of a register.
fn parse_bits(text: &str, space: Space) -> Result<(u8, u8), String> {
    if space.is_bits() {
        return Err(format!("a {} has no bits of its own", space.long_name().replace('_', " ")));
    }
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let bit =
        |text: &str| text.trim().parse::<u8>().map_err(|_| format!("{:?} is not a bit; bits are 0 (lowest) to 15", text.trim()));
    let (first, last) = (bit(first)?, bit(last)?);
    if first.max(last) > 15 {
        return Err(format!("bit {}; a register has bits 0 (lowest) to 15", first.max(last)));
    }
    if first > last {
        return Err(format!("bits {first}-{last}; the lower bit comes first"));
    }
    Ok((first, last))
}

/// The wire address of a number as the file counts.
fn to_wire(number: u64, space: Space, base: AddressBase) -> Result<u16, String> {
    let wire = match base {
        AddressBase::Zero => Some(number),
        AddressBase::One if number == 0 => return Err("address 0, but address_base = 1 counts from 1".into()),
        AddressBase::One => Some(number - 1),
        AddressBase::Modicon => Some(from_modicon(number, space)?),
    };
    wire.and_then(|wire| u16::try_from(wire).ok())
        .ok_or_else(|| format!("address {number} is beyond the last address, {}", 0xFFFF + u64::from(base == AddressBase::One)))
}

/// The wire address of a Modicon address: 40001 to 49999, or 400001 to 465536 for holding registers. Addresses of coils
/// begin with 0, which a number does not show.
fn from_modicon(number: u64, space: Space) -> Result<u64, String> {
    let digit = u64::from(space.modicon_digit());
    let (five_digits_base, six_digits_base) = (digit * 10_000, digit * 100_000);
    let word = space.short_name();
    if (six_digits_base + 1..=six_digits_base + 65_536).contains(&number) {
        return Ok(number - six_digits_base - 1);
    }
    if (five_digits_base + 1..=five_digits_base + 9_999).contains(&number) {
        return Ok(number - five_digits_base - 1);
    }
    let examples = format!("{:05} or {:06}", five_digits_base + 1, six_digits_base + 1);
    Err(format!("{number} is not a Modicon address of {word}; they begin with {examples}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wire(text: &str, base: AddressBase) -> u16 {
        parse(text, base).unwrap().address
    }

    #[test]
    fn all_notations_of_one_register() {
        assert_eq!(wire("hr:107", AddressBase::Zero), 107);
        assert_eq!(wire("hr:0x6B", AddressBase::Zero), 107);
        assert_eq!(wire("hr:108", AddressBase::One), 107);
        assert_eq!(wire("hr:40108", AddressBase::Modicon), 107);
        assert_eq!(wire("hr:400108", AddressBase::Modicon), 107);
    }

    #[test]
    fn a_bare_40001_is_a_wire_address_unless_the_file_says_otherwise() {
        assert_eq!(wire("hr:40001", AddressBase::Zero), 40_001);
        assert_eq!(wire("hr:40001", AddressBase::One), 40_000);
        assert_eq!(wire("ir:30000", AddressBase::Zero), 30_000);
        assert!(parse("ir:40001", AddressBase::Modicon).is_err());
    }

    #[test]
    fn five_digit_modicon_addresses_end_at_9999() {
        assert_eq!(wire("hr:49999", AddressBase::Modicon), 9_998);
        assert!(parse("hr:50000", AddressBase::Modicon).is_err());
        assert_eq!(wire("hr:410000", AddressBase::Modicon), 9_999);
        assert_eq!(wire("hr:465536", AddressBase::Modicon), 65_535);
        assert_eq!(wire("co:1", AddressBase::Modicon), 0);
    }

    #[test]
    fn errors_explain_the_mistake() {
        for (text, base, part) in [
            ("107", AddressBase::Zero, "colon"),
            ("xr:1", AddressBase::Zero, "is not a table"),
            ("hr:x", AddressBase::Zero, "not an address"),
            ("hr:65536", AddressBase::Zero, "beyond the last address, 65535"),
            ("hr:65537", AddressBase::One, "beyond the last address, 65536"),
            ("hr:0", AddressBase::One, "counts from 1"),
            ("hr:1.16", AddressBase::Zero, "bits 0 (lowest) to 15"),
            ("hr:1.5-3", AddressBase::Zero, "lower bit"),
            ("co:1.0", AddressBase::Zero, "no bits"),
        ] {
            let error = parse(text, base).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
