//! Recognises other protocols that run on the same kind of wires as Modbus, each by its frame format.
//!
//! The result is a sentence for the operator and has no effect on framing. A protocol is named only if at least half of
//! the bursts have its frame format, with a valid checksum where the protocol has one.

/// A protocol that can be recognised.
struct Protocol {
    name: &'static str,
    /// The frame format, in the words shown to users.
    frame_format: &'static str,
    /// Whether a burst has this frame format.
    matches: fn(&[u8]) -> bool,
}

/// What bytes in letters look like. It is the least specific of all.
pub(super) const PLAIN_TEXT: &str = "plain text";

/// The most specific protocol stands first, because PROFIBUS and M-Bus share a frame format (EN 60870-5-1, FT 1.2).
const PROTOCOLS: &[Protocol] = &[
    Protocol { name: "DL/T 645", frame_format: "68, six bytes of address, 68, sum, 16", matches: is_dlt645 },
    Protocol { name: "PROFIBUS", frame_format: "10, DA, SA, FC, sum, 16 or DC, DA, SA", matches: is_profibus },
    Protocol { name: "M-Bus (EN 13757)", frame_format: "68 L L 68 or 10, sum, 16", matches: is_mbus },
    Protocol { name: "BACnet MS/TP", frame_format: "55 FF and a header with its CRC-8", matches: is_mstp },
    Protocol { name: "SolarEdge", frame_format: "12 34 56 79 and a length with its complement", matches: is_solaredge },
    Protocol {
        name: "HDLC, as Modbus Plus uses it (no UART protocol: an adapter for serial lines cannot record it)",
        frame_format: "7E around each frame, and its CRC-16",
        matches: is_hdlc,
    },
    Protocol { name: PLAIN_TEXT, frame_format: "printable characters only", matches: is_plain_text },
];

/// The names of all protocols that can be recognised.
pub fn names() -> impl Iterator<Item = &'static str> {
    PROTOCOLS.iter().map(|protocol| protocol.name)
}

/// A sentence that names the protocol of at least half of these bursts, with the reason; `None` if there is none.
pub fn name(bursts: &[Vec<u8>]) -> Option<String> {
    let bursts: Vec<&Vec<u8>> = bursts.iter().filter(|burst| burst.len() > 2).collect();
    let least = bursts.len().div_ceil(2).max(1);
    PROTOCOLS.iter().find_map(|protocol| {
        let count = bursts.iter().filter(|burst| (protocol.matches)(burst)).count();
        (count >= least)
            .then(|| format!("it looks like {}: {} in {count} of {}", protocol.name, protocol.frame_format, bursts.len()))
    })
}

/// A sentence that names the protocol of a stream without pauses: wherever a start byte of a protocol stands, a frame may
/// begin. `None` unless at least two of these places hold a frame, and at least half of them one of the same protocol.
pub fn name_of_stream(bytes: &[u8]) -> Option<String> {
    let starts: Vec<Vec<u8>> = [0x68u8, 0x10, 0x55, 0xDC, 0xFE, 0x7E]
        .iter()
        .flat_map(|start| memchr::memchr_iter(*start, bytes).take(64).map(|at| bytes[at..bytes.len().min(at + 300)].to_vec()))
        .filter(|burst| PROTOCOLS.iter().any(|protocol| protocol.name != PLAIN_TEXT && (protocol.matches)(burst)))
        .collect();
    if starts.len() < 2 {
        return None;
    }
    name(&starts)
}

/// The 8-bit sum that several of these protocols use as a checksum.
fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum: u8, &b| sum.wrapping_add(b))
}

/// Whether the bytes begin with a frame of variable length of EN 60870-5-1, FT 1.2: `68 L L 68`, data, sum, `16`.
fn is_long_frame(bytes: &[u8]) -> bool {
    let &[0x68, length, again, 0x68, ..] = bytes else { return false };
    let end = 4 + usize::from(length);
    length == again
        && length >= 3
        && bytes.get(end) == Some(&sum(&bytes[4..end.min(bytes.len())]))
        && bytes.get(end + 1) == Some(&0x16)
}

/// EN 13757-2: short frames, long frames, and the header of a long frame.
fn is_mbus(bytes: &[u8]) -> bool {
    let is_short_frame = matches!(*bytes, [0x10, control, address, check, 0x16, ..] if check == control.wrapping_add(address));
    // Of a long frame that a log cut short the header is left.
    let is_cut_long_frame =
        matches!(*bytes, [0x68, length, again, 0x68, ..] if length == again && bytes.len() < usize::from(length) + 6);
    is_short_frame || is_long_frame(bytes) || (is_cut_long_frame && bytes.len() > 20)
}

/// PROFIBUS FDL (EN 50170): tokens, frames without data, frames of variable length.
fn is_profibus(bytes: &[u8]) -> bool {
    match *bytes {
        [0xDC, to, from] => to < 127 && from < 127,
        [0x10, to, from, control, check, 0x16, ..] => check == sum(&[to, from, control]),
        // Bit 7 of an address announces an address extension; in M-Bus frames the control byte stands here.
        [0x68, _, _, 0x68, to, from, ..] => is_long_frame(bytes) && to & 0x80 != 0 && from & 0x80 != 0,
        _ => false,
    }
}

/// DL/T 645: wake-up bytes FE, `68`, six bytes of address, `68`, control, length, data, sum, `16`.
fn is_dlt645(bytes: &[u8]) -> bool {
    let start = bytes.iter().take_while(|b| **b == 0xFE).count();
    let bytes = &bytes[start..];
    let (Some(0x68), Some(0x68), Some(&length)) = (bytes.first(), bytes.get(7), bytes.get(9)) else { return false };
    let end = 10 + usize::from(length);
    bytes.get(end) == Some(&sum(&bytes[..end.min(bytes.len())])) && bytes.get(end + 1) == Some(&0x16)
}

/// `BACnet` MS/TP (ASHRAE 135, clause 9): preamble `55 FF`, type, destination, source, length, header CRC.
fn is_mstp(bytes: &[u8]) -> bool {
    let [0x55, 0xFF, header @ ..] = bytes else { return false };
    let Some((header, check)) = header.split_at_checked(5).and_then(|(header, rest)| Some((header, *rest.first()?))) else {
        return false;
    };
    let crc = header.iter().fold(0xFFu8, |crc, &b| {
        let crc = u16::from(crc ^ b);
        let crc = crc ^ (crc << 1) ^ (crc << 2) ^ (crc << 3) ^ (crc << 4) ^ (crc << 5) ^ (crc << 6) ^ (crc << 7);
        ((crc & 0xFE) ^ ((crc >> 8) & 1)) as u8
    });
    check == !crc
}

/// `SolarEdge` inverters: a fixed start sequence, and the length followed by its complement.
fn is_solaredge(bytes: &[u8]) -> bool {
    let &[0x12, 0x34, 0x56, 0x79, low, high, low_again, high_again, ..] = bytes else { return false };
    low == !low_again && high == !high_again
}

/// HDLC: flags `7E`, and a valid CRC-16/X-25 (residue F0B8) over the bytes between them.
fn is_hdlc(bytes: &[u8]) -> bool {
    let Some(inside) = bytes.strip_prefix(&[0x7E]) else { return false };
    let end = inside.iter().position(|&b| b == 0x7E).unwrap_or(inside.len());
    let frame = &inside[..end];
    let crc = frame.iter().fold(0xFFFFu16, |crc, &b| {
        (0..8).fold(crc ^ u16::from(b), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x8408 } else { crc >> 1 })
    });
    frame.len() >= 4 && crc == 0xF0B8
}

/// At least four characters, all of them printable.
fn is_plain_text(bytes: &[u8]) -> bool {
    let printable = bytes.iter().filter(|b| b.is_ascii_graphic() || matches!(b, b' ' | b'\t' | b'\r' | b'\n')).count();
    bytes.len() >= 4 && printable == bytes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sentence for one burst.
    fn recognised(hex: &str) -> String {
        name(&[modlens_protocol::hex::parse_hex(hex).unwrap()]).unwrap_or_default()
    }

    #[test]
    fn protocols_are_recognised_by_their_frame_format() {
        for (hex, protocol) in [
            // EN 13757-2: SND_NKE to address 5, and a long frame.
            ("10 40 05 45 16", "M-Bus"),
            ("68 03 03 68 08 05 72 7F 16", "M-Bus"),
            // PROFIBUS FDL status request from 2 to 3, and a token.
            ("10 03 02 49 4E 16", "PROFIBUS"),
            ("DC 03 02", "PROFIBUS"),
            // DL/T 645-2007: read 00010000 of meter 1.
            ("FE FE 68 01 00 00 00 00 00 68 11 04 33 33 34 33 B3 16", "DL/T 645"),
            // ASHRAE 135, annex G.1: the token frame of the example has the header CRC 8C.
            ("55 FF 00 10 05 00 00 8C", "BACnet MS/TP"),
            ("12 34 56 79 02 00 FD FF 01 02", "SolarEdge"),
            ("48 65 6C 6C 6F", "plain text"),
        ] {
            assert!(recognised(hex).starts_with(&format!("it looks like {protocol}")), "{hex}: {}", recognised(hex));
        }
        let mut frame = vec![0x7E, 1, 2, 3];
        let crc = !frame[1..].iter().fold(0xFFFFu16, |crc, &b| {
            (0..8).fold(crc ^ u16::from(b), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x8408 } else { crc >> 1 })
        });
        frame.extend(crc.to_le_bytes());
        frame.push(0x7E);
        assert!(name(&[frame]).unwrap().contains("Modbus Plus"));
    }

    #[test]
    fn modbus_and_damaged_frames_are_recognised_as_nothing() {
        for hex in ["05 03 00 10 00 02 C4 4A", "10 03 00 00 00 16 C7 45", "68 03 03 68 08 05 72 00 16", "55 FF 00 10 05 00 00 8D"]
        {
            assert_eq!(recognised(hex), "", "{hex}");
        }
    }
}
