//! Other protocols of serial lines that are known by more than their first bytes: a checksum, or a header that says twice how
//! long the frame is.
//!
//! Each is a row of [`PROTOCOLS`]: its name, and a function that gives whether bytes begin with one of its frames.

/// A protocol.
pub(crate) struct Protocol {
    /// What people call it.
    pub name: &'static str,
    /// Whether bytes begin with one of its frames. Of a long frame only the beginning may be there.
    begins: fn(&[u8]) -> bool,
}

/// The protocols that are met on RS-485 and RS-232 lines.
pub(crate) const PROTOCOLS: &[Protocol] = &[
    Protocol { name: "BACnet MS/TP", begins: mstp },
    Protocol { name: "M-Bus, PROFIBUS or IEC 60870-5 (FT1.2)", begins: ft12 },
    Protocol { name: "DL/T 645", begins: dlt645 },
    Protocol { name: "HDLC, as of DLMS meters", begins: hdlc },
    Protocol { name: "NMEA 0183", begins: nmea },
    Protocol { name: "Pelco-D", begins: pelco },
    Protocol { name: "DF1", begins: df1 },
    Protocol { name: "the protocol of Daly batteries", begins: daly },
    Protocol { name: "the protocol of JBD batteries", begins: jbd },
];

/// The place in the table of the protocol whose frame bytes begin with.
pub(crate) fn known(bytes: &[u8]) -> Option<usize> {
    PROTOCOLS.iter().position(|protocol| (protocol.begins)(bytes))
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// ANSI/ASHRAE 135, clause 9.3 and annex G: 55 FF, type, destination, source, length, and the CRC of these five bytes.
fn mstp(bytes: &[u8]) -> bool {
    let &[0x55, 0xFF, ref header @ ..] = bytes else { return false };
    header.get(..6).is_some_and(|header| header.iter().fold(0xFF, |crc, byte| mstp_crc(crc, *byte)) == 0x55)
}

/// One step of the header's CRC, x^8 + x^7 + 1 with the lowest bit first.
fn mstp_crc(crc: u8, byte: u8) -> u8 {
    (0..8).fold(crc ^ byte, |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x81 } else { crc >> 1 })
}

/// IEC 60870-5-1, FT1.2: 68, the length twice, 68, and a sum in front of 16; or a frame of five bytes, 10 to 16.
fn ft12(bytes: &[u8]) -> bool {
    match *bytes {
        [0x10, control, address, check, 0x16, ..] => control.wrapping_add(address) == check,
        [0x68, length, again, 0x68, ref rest @ ..] if length == again && length > 2 => {
            let length = usize::from(length);
            match (rest.get(..length), rest.get(length..length + 2)) {
                (Some(data), Some(&[check, end])) => sum(data) == check && end == 0x16,
                // The rest is not there.
                _ => true,
            }
        }
        _ => false,
    }
}

/// DL/T 645: FE several times, 68, an address of six bytes, 68, a control code, a length, data, and a sum in front of 16.
fn dlt645(bytes: &[u8]) -> bool {
    let begin = bytes.iter().position(|byte| *byte != 0xFE).unwrap_or(0);
    let frame = &bytes[begin..];
    let (Some(0x68), Some(0x68), Some(length)) = (frame.first(), frame.get(7), frame.get(9)) else { return false };
    let end = 10 + usize::from(*length);
    matches!(frame.get(end..end + 2), Some(&[check, 0x16]) if sum(&frame[..end]) == check)
}

/// ISO/IEC 13239 with frame type 3: 7E, A and eleven bits of length, and a CRC in front of 7E.
fn hdlc(bytes: &[u8]) -> bool {
    let &[0x7E, high, low, ..] = bytes else { return false };
    let length = usize::from(high & 7) << 8 | usize::from(low);
    let frame = bytes.get(1..=length);
    high >> 4 == 0xA && bytes.get(length + 1) == Some(&0x7E) && frame.is_some_and(|frame| crc_x25(frame) == 0xF0B8)
}

fn crc_x25(bytes: &[u8]) -> u16 {
    let step = |crc: u16| if crc & 1 == 1 { crc >> 1 ^ 0x8408 } else { crc >> 1 };
    bytes.iter().fold(0xFFFF, |crc, byte| (0..8).fold(crc ^ u16::from(*byte), |crc, _| step(crc)))
}

/// NMEA 0183: $ or !, five letters or digits, and a comma.
fn nmea(bytes: &[u8]) -> bool {
    let &[b'$' | b'!', ref name @ .., b','] = bytes.get(..7).unwrap_or(&[]) else { return false };
    name.iter().all(|byte| byte.is_ascii_uppercase() || byte.is_ascii_digit())
}

/// Cameras: FF, five bytes, and their sum.
fn pelco(bytes: &[u8]) -> bool {
    matches!(bytes, [0xFF, data @ .., check] if data.len() == 5 && data[0] > 0 && data[0] < 0xFF && sum(data) == *check)
}

/// Allen-Bradley: 10 02, bytes among which 10 is doubled, 10 03, and a sum that makes 0, or a CRC.
fn df1(bytes: &[u8]) -> bool {
    let &[0x10, 0x02, ref rest @ ..] = bytes else { return false };
    let (mut data, mut at) = (Vec::new(), 0);
    loop {
        match (rest.get(at), rest.get(at + 1)) {
            (Some(0x10), Some(0x03)) => break,
            (Some(0x10), Some(0x10)) => at += 1,
            (Some(0x10) | None, _) => return false,
            (Some(_), _) => {}
        }
        data.push(rest[at]);
        at += 1;
    }
    let check = &rest[at + 2..];
    let block = check.first().is_some_and(|check| sum(&data).wrapping_add(*check) == 0) && check.len() == 1;
    data.push(0x03);
    // The same CRC as that of Modbus, begun with 0.
    let step = |crc: u16| if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 };
    let crc = data.iter().fold(0u16, |crc, byte| (0..8).fold(crc ^ u16::from(*byte), |crc, _| step(crc)));
    data.len() > 6 && (block || check.get(..2) == Some(&crc.to_le_bytes()[..]))
}

/// A5, the sender, a command, 08, eight bytes, and the sum of all.
fn daly(bytes: &[u8]) -> bool {
    matches!(bytes, [0xA5, _, _, 8, ..] if bytes.len() >= 13 && sum(&bytes[..12]) == bytes[12])
}

/// DD, A5 or 5A, a register, a length, data, and what makes their sum 0, in front of 77; an answer has a status instead of A5.
fn jbd(bytes: &[u8]) -> bool {
    let &[0xDD, _, _, length, ..] = bytes else { return false };
    let length = usize::from(length);
    let Some(&[high, low, 0x77]) = bytes.get(4 + length..7 + length) else { return false };
    // Of a request, the register counts as well; of an answer, its status: both have the same place.
    let all = bytes[2..4 + length].iter().fold(0u16, |sum, byte| sum.wrapping_add(u16::from(*byte)));
    u16::from_be_bytes([high, low]) == all.wrapping_neg()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(bytes: &[u8]) -> Option<&'static str> {
        known(bytes).map(|at| PROTOCOLS[at].name)
    }

    #[test]
    fn frames_of_their_documents_are_known() {
        // ANSI/ASHRAE 135, annex G: the header 00 10 05 00 00 has the CRC 8C.
        assert_eq!(name(&[0x55, 0xFF, 0x00, 0x10, 0x05, 0x00, 0x00, 0x8C]), Some("BACnet MS/TP"));
        assert_eq!(name(&[0x55, 0xFF, 0x00, 0x10, 0x05, 0x00, 0x00, 0x8D]), None);
        // EN 13757-3: SND_NKE to address 1, and REQ_UD2.
        assert_eq!(name(&[0x10, 0x40, 0x01, 0x41, 0x16]), Some("M-Bus, PROFIBUS or IEC 60870-5 (FT1.2)"));
        assert_eq!(name(&[0x68, 3, 3, 0x68, 0x53, 1, 0xB1, 5, 0x16]), Some("M-Bus, PROFIBUS or IEC 60870-5 (FT1.2)"));
        assert_eq!(name(&[0x68, 3, 3, 0x68, 0x53, 1, 0xB1, 6, 0x16]), None);
        // DL/T 645-2007: read the address, 68 AA.. 68 13 00 DF 16.
        let address = [0xFE, 0xFE, 0x68, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0x68, 0x13, 0, 0xDF, 0x16];
        assert_eq!(name(&address), Some("DL/T 645"));
        // DLMS: SNRM of client 16 to server 1.
        assert_eq!(name(&[0x7E, 0xA0, 7, 3, 0x21, 0x93, 0x0F, 1, 0x7E]), Some("HDLC, as of DLMS meters"));
        assert_eq!(name(b"$GPGGA,123519,4807.038,N"), Some("NMEA 0183"));
        // Pelco: stop of camera 1, and pan right.
        assert_eq!(name(&[0xFF, 1, 0, 0, 0, 0, 1]), Some("Pelco-D"));
        assert_eq!(name(&[0xFF, 1, 0, 2, 0x20, 0, 0x23]), Some("Pelco-D"));
        assert_eq!(name(&[0xA5, 0x40, 0x90, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0x7D]), Some("the protocol of Daly batteries"));
        assert_eq!(name(&[0xDD, 0xA5, 3, 0, 0xFF, 0xFD, 0x77]), Some("the protocol of JBD batteries"));
    }

    #[test]
    fn requests_of_modbus_are_none_of_them() {
        let requests: [&[u8]; 3] =
            [&[1, 3, 0, 0, 0, 10, 0xC5, 0xCD], &[0x10, 3, 0, 0, 0, 1, 0x87, 0x4B], &[0x68, 3, 3, 0x67, 0, 1, 0x7E, 0x8C]];
        assert_eq!(requests.map(name), [None; 3]);
    }
}
