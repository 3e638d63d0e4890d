//! PDUs in words for a sentence: what is asked for, and what an answer holds.

use crate::annotate::exception_name;
use crate::direction::possible_directions;
use crate::functions::{Functions, Operation, EXCEPTION_BIT};
use crate::register_type::Space;

/// A float of this size is one by intention; others are two numbers.
const LIKELY_FLOATS: std::ops::Range<f32> = 0.01..1e7;

/// What a request of one of the public functions asks for.
///
/// ```
/// use modlens_protocol::in_words::request;
/// assert_eq!(request(3, 0, 2).as_deref(), Some("the read of holding registers 0 to 1 (function 3)"));
/// assert_eq!(request(5, 172, 1).as_deref(), Some("the write of coil 172 (function 5)"));
/// ```
pub fn request(function: u8, address: u16, quantity: u16) -> Option<String> {
    let row = Functions::embedded().row(function, &[])?;
    let (one, many) = match row.space? {
        Space::Coil => ("coil", "coils"),
        Space::Discrete => ("discrete input", "discrete inputs"),
        Space::Holding => ("holding register", "holding registers"),
        Space::Input => ("input register", "input registers"),
    };
    let what = if row.operation == Operation::Write { "write" } else { "read" };
    let last = u32::from(address) + u32::from(quantity.max(1)) - 1;
    let which = match quantity {
        0 => format!("no {many} from {address} on"),
        1 => format!("{one} {address}"),
        _ => format!("{many} {address} to {last}"),
    };
    Some(format!("the {what} of {which} (function {function})"))
}

/// Registers in words by the first two and the bytes of all; of two registers, the number with a decimal point that they may be.
///
/// ```
/// use modlens_protocol::in_words::registers;
/// // 230.5 is 43668000 by IEEE 754.
/// assert_eq!(registers([0x4366, 0x8000], 4), "17254 and 32768 (as a float: 230.5)");
/// assert_eq!(registers([0x8000, 0x4366], 4), "32768 and 17254 (as a float with the low word first: 230.5)");
/// assert_eq!([registers([10, 20], 4), registers([10, 20], 8), registers([7, 0], 2)], ["10 and 20", "10, 20 and 2 more", "7"]);
/// ```
pub fn registers([first, second]: [u16; 2], bytes: usize) -> String {
    match bytes / 2 {
        1 => format!("{first}"),
        2 => format!("{first} and {second}{}", float(first, second)),
        count => format!("{first}, {second} and {} more", count.saturating_sub(2)),
    }
}

/// Two registers as a number with a decimal point, in the order in which they make sense, if only one does.
fn float(first: u16, second: u16) -> String {
    let read = |high: u16, low: u16| f32::from_bits(u32::from(high) << 16 | u32::from(low));
    let likely = |value: f32| Some(value).filter(|value| LIKELY_FLOATS.contains(&value.abs()));
    match [likely(read(first, second)), likely(read(second, first))] {
        [Some(value), None] => format!(" (as a float: {})", short(value)),
        [None, Some(value)] => format!(" (as a float with the low word first: {})", short(value)),
        _ => String::new(),
    }
}

/// A float with no more digits than it holds.
fn short(value: f32) -> String {
    let (value, is_large) = (f64::from(value), value.abs() >= 1000.0);
    let text = if is_large { format!("{value:.1}") } else { format!("{value:.3}") };
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A PDU in words, by its layout alone; `None` where it has none of a function.
///
/// ```
/// use modlens_protocol::in_words::pdu;
/// assert_eq!(pdu(&[3, 0, 0x6B, 0, 3]).as_deref(), Some("the read of holding registers 107 to 109 (function 3)"));
/// assert_eq!(pdu(&[4, 2, 0, 10]).as_deref(), Some("1 input register: 10 (function 4)"));
/// assert_eq!(pdu(&[0x83, 2]).as_deref(), Some("function 3 is refused with exception 2 (illegal data address)"));
/// assert_eq!([pdu(&[0x55, 1, 2, 3, 4, 5]), pdu(&[3, 3, 0, 1, 2])], [None, None]);
/// ```
pub fn pdu(pdu: &[u8]) -> Option<String> {
    let word = |at: usize| Some(u16::from_be_bytes([*pdu.get(at)?, *pdu.get(at + 1)?]));
    let (may_ask, may_answer) = possible_directions(Functions::embedded(), pdu);
    match *pdu {
        [code, ..] if code & EXCEPTION_BIT == 0 && !may_ask => answer(pdu).filter(|_| may_answer),
        [1..=4, first, ..] if first > 0 && may_answer => answer(pdu),
        [function @ (5 | 6), ..] => request(function, word(1)?, 1),
        [function @ (1..=4 | 15 | 16), ..] if may_ask => request(function, word(1)?, word(3)?),
        _ => answer(pdu),
    }
}

/// The PDU of an answer in words; bytes after it do not matter. `None` where it is none of a function.
///
/// ```
/// use modlens_protocol::in_words::answer;
/// assert_eq!(answer(&[3, 4, 0, 10, 0, 20, 0xAA, 0xBB]).as_deref(), Some("2 holding registers: 10 and 20 (function 3)"));
/// assert_eq!(answer(&[1, 1, 5]).as_deref(), Some("1 byte of coils (function 1)"));
/// assert_eq!(answer(&[3, 3, 0, 1, 2]), None);
/// ```
pub fn answer(pdu: &[u8]) -> Option<String> {
    let word = |at: usize| Some(u16::from_be_bytes([*pdu.get(at)?, *pdu.get(at + 1)?]));
    match *pdu {
        [code, exception, ..] if code & EXCEPTION_BIT != 0 => {
            let name = exception_name(exception)?;
            Some(format!("function {} is refused with exception {exception} ({name})", code & !EXCEPTION_BIT))
        }
        [function @ 1..=4, count, ref data @ ..] if count > 0 && data.len() >= usize::from(count) => {
            let kind = ["coils", "discrete inputs", "holding register", "input register"][usize::from(function) - 1];
            if function < 3 {
                return Some(format!("{count} byte{} of {kind} (function {function})", if count == 1 { "" } else { "s" }));
            }
            let values = registers([word(2)?, word(4).unwrap_or_default()], count.into());
            let many = if count == 2 { "" } else { "s" };
            (count % 2 == 0).then(|| format!("{} {kind}{many}: {values} (function {function})", count / 2))
        }
        [1..=4, ..] | [] => None,
        [function @ (5 | 6), ..] => request(function, word(1)?, 1),
        [function @ (15 | 16), ..] => request(function, word(1)?, word(3)?),
        [function, ..] => Some(format!("\u{ab}{}\u{bb} (function {function})", Functions::embedded().name(function)?)),
    }
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn a_float_has_no_more_digits_than_it_holds() {
        assert_eq!([25.0, 230.5, 0.1, 123_456.7, 1_000_000.0].map(short), ["25", "230.5", "0.1", "123456.7", "1000000"]);
    }
}
