//! Settings of a serial line, and the character and frame times that follow from them (serial line specification, 2.5).

use std::str::FromStr;

use crate::Ns;

/// Parity of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// Even parity, the default of the specification.
    Even,
    /// Odd parity.
    Odd,
    /// Parity bit always 1.
    Mark,
    /// Parity bit always 0.
    Space,
}

/// Settings of a serial line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineSettings {
    /// Bits per second.
    pub baud: u32,
    /// Data bits: 8 for RTU, 7 for ASCII.
    pub data_bits: u8,
    /// Parity bit.
    pub parity: Parity,
    /// Twice the number of stop bits: 2, 3 or 4.
    pub half_stop_bits: u8,
}

/// The rates that can be meant.
const SLOWEST: u32 = 50;
const FASTEST: u32 = 12_000_000;

/// Above this baud rate t1.5 and t3.5 have fixed values (serial line specification, 2.5.1.1).
const MAX_BAUD_WITH_SCALED_TIMES: u32 = 19_200;

impl LineSettings {
    /// The time of one character in ns, with start, data, parity and stop bits.
    ///
    /// ```
    /// let line: modlens_protocol::line::LineSettings = "9600-8E1".parse().unwrap();
    /// assert_eq!(line.char_ns(), 1_145_833); // 11 bits
    /// ```
    pub fn char_ns(&self) -> Ns {
        let parity = i64::from(self.parity != Parity::None);
        let halves = 2 * (1 + i64::from(self.data_bits) + parity) + i64::from(self.half_stop_bits);
        halves * 500_000_000 / i64::from(self.baud.max(1))
    }

    /// t1.5, the longest pause inside a frame, in ns.
    pub fn t15_ns(&self) -> Ns {
        if self.baud > MAX_BAUD_WITH_SCALED_TIMES {
            750_000
        } else {
            self.char_ns() * 3 / 2
        }
    }

    /// t3.5, the shortest silence between frames, in ns.
    pub fn t35_ns(&self) -> Ns {
        if self.baud > MAX_BAUD_WITH_SCALED_TIMES {
            1_750_000
        } else {
            self.char_ns() * 7 / 2
        }
    }

    /// The bits of one character in the order of transmission: start bit, data bits (lowest first), parity bit, stop bits.
    ///
    /// ```
    /// let line: modlens_protocol::line::LineSettings = "19200-8E1".parse().unwrap();
    /// assert_eq!(line.character(0x05), "01010000001");
    /// ```
    pub fn character(&self, byte: u8) -> String {
        let mut bits = String::from("0");
        let mut ones = 0;
        for bit in 0..self.data_bits {
            let one = byte >> bit & 1 == 1;
            ones += u32::from(one);
            bits.push(if one { '1' } else { '0' });
        }
        match self.parity {
            Parity::None => {}
            Parity::Even => bits.push(if ones % 2 == 1 { '1' } else { '0' }),
            Parity::Odd => bits.push(if ones % 2 == 0 { '1' } else { '0' }),
            Parity::Mark => bits.push('1'),
            Parity::Space => bits.push('0'),
        }
        for _ in 0..self.half_stop_bits.div_ceil(2) {
            bits.push('1');
        }
        bits
    }
}

impl std::fmt::Display for LineSettings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let stop = f64::from(self.half_stop_bits) / 2.0;
        write!(f, "{}-{}{}{stop}", self.baud, self.data_bits, self.parity.letter())
    }
}

impl Parity {
    /// The letter by which it is written.
    pub fn letter(self) -> char {
        match self {
            Self::None => 'N',
            Self::Even => 'E',
            Self::Odd => 'O',
            Self::Mark => 'M',
            Self::Space => 'S',
        }
    }
}

impl FromStr for Parity {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "N" | "n" => Ok(Self::None),
            "E" | "e" => Ok(Self::Even),
            "O" | "o" => Ok(Self::Odd),
            "M" | "m" => Ok(Self::Mark),
            "S" | "s" => Ok(Self::Space),
            other => Err(format!("parity {other:?} is not one of N E O M S")),
        }
    }
}

/// As `19200-8E1`, and as other programs write it: `9600,8,N,1`, `9600/7O2`, `9600 8n1`.
impl FromStr for LineSettings {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("line settings {text:?}; give baud rate, data bits, parity and stop bits, as in 19200-8E1");
        let text = text.trim();
        let (baud, rest) = text.split_at(text.find(|one: char| !one.is_ascii_digit()).unwrap_or(text.len()));
        let baud = baud.parse().map_err(|_| wrong())?;
        // Something has to part the rate from the data bits; between the others it is a matter of taste.
        let rest = Some(behind_separator(rest)).filter(|behind| behind.len() < rest.len()).ok_or_else(wrong)?;
        let data_bits =
            rest.get(..1).and_then(|digit| digit.parse().ok()).filter(|bits| (5..=8).contains(bits)).ok_or_else(wrong)?;
        let rest = behind_separator(&rest[1..]);
        let parity = rest.get(..1).and_then(|letter| letter.parse().ok()).ok_or_else(wrong)?;
        let half_stop_bits = match behind_separator(&rest[1..]) {
            "1" => 2,
            "1.5" => 3,
            "2" => 4,
            _ => return Err(wrong()),
        };
        if !(SLOWEST..=FASTEST).contains(&baud) {
            return Err(format!("{baud} baud is out of range; write {SLOWEST} to {FASTEST}"));
        }
        Ok(Self { baud, data_bits, parity, half_stop_bits })
    }
}

/// What follows blanks with at most one comma, slash or dash among them.
fn behind_separator(text: &str) -> &str {
    let text = text.trim_start();
    text.strip_prefix([',', '/', '-']).unwrap_or(text).trim_start()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(text: &str) -> LineSettings {
        text.parse().unwrap()
    }

    #[test]
    fn times_of_the_specification() {
        // 2.5.1.1: 9600 baud, 11 bits: character 1.146 ms, t1.5 1.72 ms, t3.5 4.01 ms.
        assert_eq!(line("9600-8E1").char_ns() / 1000, 1145);
        assert_eq!(line("9600-8E1").t15_ns() / 10_000, 171);
        assert_eq!(line("9600-8E1").t35_ns() / 10_000, 401);
        assert_eq!(line("19200-8E1").t35_ns() / 1000, 2005);
        // Above 19200 baud the times are fixed at 750 us and 1.750 ms.
        assert_eq!((line("115200-8N1").t15_ns(), line("115200-8N1").t35_ns()), (750_000, 1_750_000));
        // 8N1 has ten bits: characters are 9 % shorter.
        assert_eq!(line("9600-8N1").char_ns() / 1000, 1041);
    }

    #[test]
    fn characters_of_seed_document_001() {
        // 3.1.1 prints 05 as 0 1 0 1 0 0 0 0 0 1 1: two ones, so the bit after the data is odd parity
        // (or a second stop bit), not the even parity of the specification's default.
        assert_eq!(line("19200-8O1").character(0x05), "01010000011");
        assert_eq!(line("19200-8N2").character(0x05), "01010000011");
        assert_ne!(line("19200-8E1").character(0x05), "01010000011");
        // 3.2.1 prints '5' (35 hex, 7 bits) as 0 1 0 1 0 1 1 0 1 1.
        assert_eq!(line("19200-7O1").character(0x35), "0101011011");
        assert_eq!(line("19200-7N2").character(0x35), "0101011011");
        assert_ne!(line("19200-7E1").character(0x35), "0101011011");
    }

    #[test]
    fn settings_are_read_as_programs_write_them() {
        for (text, expected) in
            [("9600,8,N,1", "9600-8N1"), ("9600/7o2", "9600-7O2"), (" 115200 8N1.5 ", "115200-8N1.5"), ("300-5M2", "300-5M2")]
        {
            assert_eq!(line(text).to_string(), expected);
        }
    }

    #[test]
    fn wrong_settings_are_refused() {
        for text in ["", "9600", "9600-8X1", "9600-9N1", "0-8N1", "9600-8N3", "x-8N1", "9600-8", "49-8E1", "96008N1", "9600--8N1"]
        {
            assert!(text.parse::<LineSettings>().is_err(), "{text}");
        }
    }
}
