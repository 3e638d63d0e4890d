//! CRC-16/MODBUS and LRC (serial line specification, 6.2). The bench has its own implementation, because a mistake shared
//! with the core would not be noticed.

/// The effect of each value of the low byte on the register.
static TABLE: [u16; 256] = table();

const fn table() -> [u16; 256] {
    let mut all = [0u16; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut state = byte as u16;
        let mut bit = 0;
        while bit < 8 {
            state = (state >> 1) ^ (0xA001 * (state & 1));
            bit += 1;
        }
        all[byte] = state;
        byte += 1;
    }
    all
}

/// The CRC register after one more byte. Its initial value is FFFF.
#[inline]
pub fn step(state: u16, byte: u8) -> u16 {
    (state >> 8) ^ TABLE[usize::from(state as u8 ^ byte)]
}

/// The CRC of these bytes.
pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |state, &byte| step(state, byte))
}

/// Whether the last two bytes are the CRC of those before.
pub fn crc_fits(frame: &[u8]) -> bool {
    frame.len() > 2 && crc(frame) == 0
}

/// The two's complement of the sum of these bytes.
pub fn lrc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0u8, |sum, &byte| sum.wrapping_add(byte)).wrapping_neg()
}

/// An RTU frame: unit, PDU, CRC with the low byte first.
pub fn rtu(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(pdu.len() + 3);
    frame.push(unit);
    frame.extend_from_slice(pdu);
    let crc = crc(&frame);
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

/// An ASCII frame: colon, hex of unit, PDU and LRC, CR LF (serial line specification, 2.5.2).
pub fn ascii(unit: u8, pdu: &[u8], lower_case: bool) -> Vec<u8> {
    let mut body = Vec::with_capacity(pdu.len() + 2);
    body.push(unit);
    body.extend_from_slice(pdu);
    body.push(lrc(&body));
    let digits = if lower_case { b"0123456789abcdef" } else { b"0123456789ABCDEF" };
    let mut frame = Vec::with_capacity(2 * body.len() + 3);
    frame.push(b':');
    for byte in body {
        frame.extend([digits[usize::from(byte >> 4)], digits[usize::from(byte & 15)]]);
    }
    frame.extend_from_slice(b"\r\n");
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The specification's bit by bit version (6.2.2).
    fn naive(bytes: &[u8]) -> u16 {
        let mut crc = 0xFFFFu16;
        for &byte in bytes {
            crc ^= u16::from(byte);
            for _ in 0..8 {
                crc = if crc & 1 == 1 { (crc >> 1) ^ 0xA001 } else { crc >> 1 };
            }
        }
        crc
    }

    #[test]
    fn examples_of_the_specification() {
        // 6.2.2: unit 2, function 7 has the CRC 1241 hex, sent as 41 12.
        assert_eq!(rtu(2, &[7]), [2, 7, 0x41, 0x12]);
        assert!(crc_fits(&[2, 7, 0x41, 0x12]) && !crc_fits(&[2, 7, 0x41, 0x13]));
        assert_eq!(ascii(0xF7, &[0x03, 0x13, 0x89, 0x00, 0x0A], false), b":F7031389000A60\r\n");
    }

    #[test]
    fn table_and_bits_agree() {
        let mut rng = crate::rng::Rng::new(1, "crc");
        for length in 0..300 {
            let bytes: Vec<u8> = (0..length).map(|_| rng.byte()).collect();
            assert_eq!(crc(&bytes), naive(&bytes));
        }
    }
}
