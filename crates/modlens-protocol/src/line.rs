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
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
            Parity::Mark => 'M',
            Parity::Space => 'S',
        };
        let stop = f64::from(self.half_stop_bits) / 2.0;
        write!(f, "{}-{}{parity}{stop}", self.baud, self.data_bits)
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

impl FromStr for LineSettings {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("line settings {text:?} are not like 19200-8E1 (baud-data bits, parity, stop bits)");
        let (baud, format) = text.split_once('-').ok_or_else(wrong)?;
        let baud = baud.parse().ok().filter(|&b| b > 0).ok_or_else(wrong)?;
        let data_bits = format.get(0..1).and_then(|d| d.parse().ok()).filter(|d| (5..=8).contains(d)).ok_or_else(wrong)?;
        let parity = format.get(1..2).ok_or_else(wrong)?.parse()?;
        let half_stop_bits = match format.get(2..) {
            Some("1") => 2,
            Some("1.5") => 3,
            Some("2") => 4,
            _ => return Err(wrong()),
        };
        Ok(Self { baud, data_bits, parity, half_stop_bits })
    }
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
        // 3.1.1 prints 05 as 0 1 0 1 0 0 0 0 0 1 1: two ones, so the bit behind the data is odd parity
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
    fn wrong_settings_are_refused() {
        for text in ["", "9600", "9600-8X1", "9600-9N1", "0-8N1", "9600-8N3", "x-8N1", "9600-8"] {
            assert!(text.parse::<LineSettings>().is_err(), "{text}");
        }
    }
}
