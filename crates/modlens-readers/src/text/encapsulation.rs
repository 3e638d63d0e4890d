//! Finds Modbus frames inside the protocols that some programs print around them: Solarman V5, and network headers.

use std::ops::Range;

use modlens_protocol::checksum::crc_valid;

/// The first byte of a Solarman V5 frame; length and control code follow. The protocol is described in the documentation
/// of pysolarmanv5.
pub(super) const V5_START: u8 = 0xA5;
/// The last byte of a Solarman V5 frame.
const V5_END: u8 = 0x15;
/// Control code of a frame that carries a Modbus request.
const V5_REQUEST: u16 = 0x4510;
/// Control code of a frame that carries a Modbus response.
const V5_RESPONSE: u16 = 0x1510;

/// The reason for leaving out what a data logger answers by itself.
pub(super) const LOGGER_REFUSES: &str = "Solarman V5 answer without Modbus";

/// The position of the RTU frame inside a Solarman V5 frame; the error says why there is none.
///
/// Some programs print a request before they put its checksum in. There the CRC of the RTU frame is the proof.
pub(super) fn solarman_rtu_frame(bytes: &[u8]) -> Result<Range<usize>, &'static str> {
    let [V5_START, low, high, control_low, control_high, ..] = *bytes else { return Err("not a Solarman V5 frame") };
    let length = usize::from(u16::from_le_bytes([low, high])) + 13;
    if bytes.len() != length || bytes.last() != Some(&V5_END) {
        return Err("Solarman V5 frame with a wrong length");
    }
    let start = match u16::from_le_bytes([control_low, control_high]) {
        V5_REQUEST => 26,
        V5_RESPONSE => 25,
        _ => length,
    };
    let inner = start..length - 2;
    let has_inner = inner.len() >= 4;
    let is_proved = solarman_sum_fits(bytes) || (has_inner && crc_valid(&bytes[inner.clone()]));
    if !is_proved {
        return Err("Solarman V5 frame with a wrong checksum");
    }
    if !has_inner {
        return Err(if start == 25 { LOGGER_REFUSES } else { "Solarman V5 frame without Modbus" });
    }
    Ok(inner)
}

/// Whether the checksum of a Solarman V5 frame fits: the sum of the bytes between its first one and the last two.
pub(super) fn solarman_sum_fits(frame: &[u8]) -> bool {
    let [_, summed @ .., sum, _] = frame else { return false };
    summed.iter().fold(0u8, |sum, &b| sum.wrapping_add(b)) == *sum
}

/// The place of the type of what is in an Ethernet frame, after the two addresses.
const ETHERNET_TYPE: usize = 12;

/// The position of the payload of TCP or UDP in a packet that begins with an Ethernet, IPv4 or IPv6 header; the error says
/// why there is none.
pub(super) fn network_payload(packet: &[u8]) -> Result<Range<usize>, &'static str> {
    // An address of Ethernet may begin as an IP header does.
    let ip = match (packet.get(ETHERNET_TYPE..), packet) {
        (Some([8, 0, 0x45..=0x4F, ..] | [0x86, 0xDD, 0x60..=0x6F, ..]), _) => ETHERNET_TYPE + 2,
        (_, [0x45..=0x4F | 0x60..=0x6F, ..]) => 0,
        _ => return Err("packet without an IP header"),
    };
    let inside = &packet[ip..];
    let (protocol, header, end) = match inside.first().map(|b| b >> 4) {
        Some(4) if inside.len() >= 20 => {
            (inside[9], usize::from(inside[0] & 15) * 4, usize::from(u16::from_be_bytes([inside[2], inside[3]])))
        }
        Some(6) if inside.len() >= 40 => (inside[6], 40, 40 + usize::from(u16::from_be_bytes([inside[4], inside[5]]))),
        _ => return Err("packet without an IP header"),
    };
    let end = ip + end.min(inside.len());
    let start = match protocol {
        6 => ip + header + usize::from(inside.get(header + 12).ok_or("packet without data")? >> 4) * 4,
        17 => ip + header + 8,
        _ => return Err("packet of another protocol"),
    };
    if start >= end {
        return Err("packet without data");
    }
    Ok(start..end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_v5_frame_gives_its_rtu_frame() {
        let inner = [5, 3, 0, 0x10, 0, 2, 0xC4, 0x4A];
        let mut frame = vec![0xA5, 23, 0, 0x10, 0x45];
        frame.extend([1; 6]);
        frame.extend([2; 15]);
        frame.extend(inner);
        let sum = frame[1..].iter().fold(0u8, |sum, &b| sum.wrapping_add(b));
        frame.extend([sum, 0x15]);
        assert_eq!(solarman_rtu_frame(&frame).map(|range| frame[range].to_vec()), Ok(inner.to_vec()));
        // Printed before the checksum was put in.
        frame[34] = 0;
        assert!(!solarman_sum_fits(&frame));
        assert_eq!(solarman_rtu_frame(&frame).map(|range| frame[range].to_vec()), Ok(inner.to_vec()));
        frame[30] ^= 1;
        assert_eq!(solarman_rtu_frame(&frame), Err("Solarman V5 frame with a wrong checksum"));
        assert!(solarman_rtu_frame(&frame[..20]).is_err());
    }

    #[test]
    fn a_packet_gives_its_data() {
        let mut packet = vec![0x45, 0, 0, 42, 0, 0, 0, 0, 64, 6, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2];
        packet.extend([0xC3, 0x50, 1, 0xF6, 0, 0, 0, 1, 0, 0, 0, 1, 0x50, 0x18, 0, 0, 0, 0, 0, 0]);
        packet.extend([9, 9]);
        assert_eq!(network_payload(&packet), Ok(40..42));
        for first in [0, 0x45, 0x66] {
            assert_eq!(network_payload(&[&[first; 12][..], &[8, 0], &packet[..]].concat()), Ok(54..56));
        }
        assert_eq!(network_payload(&packet[..40]), Err("packet without data"));
        assert!((0..40).all(|length| network_payload(&packet[..length]).is_err()));
    }
}
