//! The notations in which programs print bytes: hex with many kinds of separators, decimal, escaped strings, 16-bit words
//! and others. A notation reads as much of the text as it can.

mod hex;
mod other;
mod tokens;

use hex::{bracketed, byte, groups, hex, pairs, prefixed, prefixed_value};
use other::{ascii, base64, cell, decimal, decimal_one, escaped, named, words};

pub(super) use hex::spaced_pairs;
pub(super) use tokens::{counts_what_follows, NotationFlags};

/// A way of printing bytes. `PLACEHOLDERS` has the placeholder that names it in templates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Notation {
    /// Pairs of hex digits, with or without `0x` or `h`, with any separators.
    Hex,
    /// Hex numbers of one or two digits with any separators: `1 3 0 6B`.
    Loose,
    /// At most sixteen pairs of hex digits separated by spaces, as in a line of a hex dump.
    Pairs,
    /// Groups of hex digits separated by single spaces, as in a line of xxd, up to two spaces.
    Groups,
    /// Hex numbers of one or two digits, each with `0x` in front.
    Prefixed,
    /// One or two such numbers: a byte, or a 16-bit value.
    PrefixedValue,
    /// Pairs of hex digits in square brackets: `[01][03]`.
    Square,
    /// Pairs of hex digits in angle brackets: `<01><03>`.
    Angle,
    /// Pairs of hex digits in braces: `{01}{03}`.
    Curly,
    /// Decimal numbers.
    Decimal,
    /// A string with escape sequences such as `\x01`, up to its closing quote.
    Escaped,
    /// 16-bit words in hex, low byte first, as hexdump and od -x print them.
    Words,
    /// 16-bit words in octal, low byte first, as od prints them.
    Octal,
    /// Base64.
    Base64,
    /// Names of characters with their value in parentheses, such as `ETX (03)`: two digits are hex, three are decimal.
    Named,
    /// One byte in hex: `0x41`, `41`, `0X4`.
    Byte,
    /// One byte in decimal.
    Number,
    /// One byte in a cell of a logic analyzer's table: a character, a number in quotes, `0x41`.
    Cell,
    /// A frame of Modbus ASCII, colon and hex digits, which yields the characters that were on the line.
    Ascii,
}

impl Notation {
    /// The placeholders of templates, without braces.
    pub const PLACEHOLDERS: &'static [(&'static str, Self)] = &[
        ("hex", Self::Hex),
        ("loose", Self::Loose),
        ("pairs", Self::Pairs),
        ("groups", Self::Groups),
        ("0x", Self::Prefixed),
        ("0x value", Self::PrefixedValue),
        ("[hex]", Self::Square),
        ("<hex>", Self::Angle),
        ("(hex)", Self::Curly),
        ("decimal", Self::Decimal),
        ("escaped", Self::Escaped),
        ("words", Self::Words),
        ("octal", Self::Octal),
        ("base64", Self::Base64),
        ("named", Self::Named),
        ("byte", Self::Byte),
        ("number", Self::Number),
        ("cell", Self::Cell),
        ("ascii", Self::Ascii),
    ];

    /// Appends the bytes at the start of `text` to `out` and returns the length of the text that they took; `None` if there
    /// are no bytes. `stop` is the character that ends a string.
    pub fn read(self, text: &[u8], stop: Option<u8>, out: &mut Vec<u8>, flags: &mut NotationFlags) -> Option<usize> {
        let before = out.len();
        let taken = match self {
            Self::Hex => hex(text, false, out, flags),
            Self::Loose => hex(text, true, out, flags),
            Self::Pairs => pairs(text, out),
            Self::Groups => groups(text, out),
            Self::Prefixed => prefixed(text, out, flags),
            Self::PrefixedValue => prefixed_value(text, out, flags),
            Self::Square => bracketed(text, *b"[]", out),
            Self::Angle => bracketed(text, *b"<>", out),
            Self::Curly => bracketed(text, *b"{}", out),
            Self::Decimal => decimal(text, out),
            Self::Escaped => escaped(text, stop, out),
            Self::Words => words(text, 4, 16, out),
            Self::Octal => words(text, 6, 8, out),
            Self::Base64 => base64(text, out),
            Self::Named => named(text, out),
            Self::Byte => byte(text, out),
            Self::Number => decimal_one(text, out),
            Self::Cell => cell(text, out),
            Self::Ascii => ascii(text, out),
        };
        (out.len() > before).then_some(taken)
    }

    /// The character that bytes in this notation always begin with, if there is one.
    pub fn opening(self) -> Option<u8> {
        match self {
            Self::Square => Some(b'['),
            Self::Angle => Some(b'<'),
            Self::Curly => Some(b'{'),
            Self::Ascii => Some(b':'),
            _ => None,
        }
    }

    /// Whether it prints 16-bit words, so that the last word of a dump may hold only one byte.
    pub fn has_words(self) -> bool {
        matches!(self, Self::Words | Self::Octal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(notation: Notation, text: &str) -> (Vec<u8>, &str, bool) {
        let (mut out, mut flags) = (Vec::new(), NotationFlags::default());
        let end = notation.read(text.as_bytes(), Some(b'"'), &mut out, &mut flags).unwrap_or(0);
        (out, &text[end..], flags.no_checksum)
    }

    const FRAME: [u8; 8] = [5, 3, 0, 0x10, 0, 2, 0xC4, 0x4A];

    #[test]
    fn every_notation_reads_the_same_bytes() {
        for (notation, text) in [
            (Notation::Hex, "05 03 00 10 00 02 C4 4A"),
            (Notation::Hex, "050300100002c44a"),
            (Notation::Hex, "0x05,0x3,0x0,0x10,0x0,0x2,0xc4,0x4a"),
            (Notation::Hex, "05H 03H 00H 10H 00H 02H C4H 4AH"),
            (Notation::Hex, "05 03 **00 10** 00 02 C4 4A"),
            (Notation::Loose, "5 3 0 10 0 2 C4 4A"),
            (Notation::Pairs, "05 03 00 10  00 02 c4 4a"),
            (Notation::Groups, "0503 0010 0002 c44a"),
            (Notation::Prefixed, "0x5 0x3 0x0 0x10 0x0 0x2 0xc4 0x4a"),
            (Notation::Square, "[05][03][00][10][00][02][C4][4A]"),
            (Notation::Angle, "<05><03><00><10><00><02><C4><4A>"),
            (Notation::Curly, "{05}{03}{00}{10}{00}{02}{C4}{4A}"),
            (Notation::Decimal, "5-3-0-16-0-2-196-74"),
            (Notation::Decimal, "[5, 3, 0, 16, 0, 2, 196, 74]"),
            (Notation::Escaped, "\\x05\\x03\\x00\\x10\\x00\\x02\\xc4J"),
            (Notation::Escaped, "\\x05\\x03\\x00\\x10\\x00\\x02\u{c4}J"),
            (Notation::Escaped, "\\5\\3\\0\\20\\0\\2\\304J"),
            (Notation::Words, "0305 1000 0200 4ac4"),
            (Notation::Octal, "001405 010000 001000 045304"),
            (Notation::Base64, "BQMAEAACxEo="),
        ] {
            assert_eq!(read(notation, text), (FRAME.to_vec(), "", false), "{notation:?} {text}");
        }
    }

    #[test]
    fn a_notation_stops_where_bytes_end() {
        assert_eq!(read(Notation::Hex, "05 03 Rx: 01"), (vec![5, 3], " Rx: 01", false));
        assert_eq!(read(Notation::Prefixed, "0x5 0x3 old_data:"), (vec![5, 3], " old_data:", false));
        assert_eq!(read(Notation::PrefixedValue, "0x00 0x10"), (vec![0, 0x10], "", false));
        assert!(read(Notation::PrefixedValue, "0x5 0x3 0x0").0.is_empty());
        assert_eq!(read(Notation::Pairs, "05 03   ad de"), (vec![5, 3], "   ad de", false));
        assert_eq!(read(Notation::Groups, "0503  dead"), (vec![5, 3], "  dead", false));
        assert_eq!(read(Notation::Escaped, "\\x05\\\"\", 2"), (vec![5, b'"'], "\", 2", false));
        assert_eq!(read(Notation::Hex, "05 03\"; [12:30:05.250] 07").0, [5, 3]);
        assert_eq!(read(Notation::Hex, "05 03 12:30:05 07").0, [5, 3]);
        assert_eq!(read(Notation::Hex, "05 03:12:30:05:07").0, [5, 3, 0x12, 0x30, 5, 7]);
        assert_eq!(read(Notation::Decimal, "5, 3, 16 12:30:05").0, [5, 3, 16]);
        assert!(read(Notation::Decimal, "05 03 00 10 C4 4A").0.is_empty());
        assert!(read(Notation::Loose, "[0,1,0,0,0,6,1,3,0,16,0,2]").0.is_empty(), "an array has decimal numbers");
        assert_eq!(read(Notation::Loose, "[0,1,0,0,0,6,1,3,0,A,0,2]").0.len(), 12);
        assert!(read(Notation::Hex, "hello").0.is_empty());
        assert!(read(Notation::Hex, "0010  05 03 00 10").0.is_empty());
        assert!(read(Notation::Hex, "0x0010:  0503 0010").0.is_empty());
        assert_eq!(read(Notation::Hex, "0503 0010 0002 c44a").0, FRAME);
    }

    #[test]
    fn placeholders_stand_for_a_checksum() {
        for text in ["05 03 00 -- --", "05 03 00 CRC", "05 03 00 xx xx", "05 03 00 [CRC]", "05 03 00 CRC Lo CRC Hi"] {
            let (bytes, _, no_checksum) = read(Notation::Hex, text);
            assert_eq!((bytes, no_checksum), (vec![5, 3, 0], true), "{text}");
        }
    }
}
