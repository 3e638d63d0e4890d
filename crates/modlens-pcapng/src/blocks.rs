//! Writes blocks of pcapng (draft-ietf-opsawg-pcapng) and records of classic pcap. Knows nothing about Modbus.

use modlens_readers::pcap::metadata::ENTERPRISE;

/// Link type of exported PDUs: the name of a Wireshark dissector and addresses, then the bytes for the dissector.
pub const LINK_UPPER_PDU: u16 = 252;

/// Link type of Ethernet.
pub const LINK_ETHERNET: u16 = 1;

const SNAP_LENGTH: u32 = 262_144;
const COMMENT: u16 = 1;
const CUSTOM_OPTION: u16 = 2988;
const FLAGS: u16 = 2;
/// The maximum length of an option's value in bytes. The format has a length field of 16 bits.
const MAX_OPTION_BYTES: usize = 60_000;

/// Begins a block and returns its start; `end_block` fills in its length.
pub fn begin_block(kind: u32, out: &mut Vec<u8>) -> usize {
    let start = out.len();
    out.extend_from_slice(&kind.to_le_bytes());
    out.extend_from_slice(&[0; 4]);
    start
}

/// Ends the block that began at `start`.
pub fn end_block(start: usize, out: &mut Vec<u8>) {
    let length = ((out.len() - start + 4) as u32).to_le_bytes();
    out[start + 4..start + 8].copy_from_slice(&length);
    out.extend_from_slice(&length);
}

/// Pads with zeros to a multiple of four bytes, counted from the start of a block or option.
fn pad(start: usize, out: &mut Vec<u8>) {
    let missing = (start.wrapping_sub(out.len())) % 4;
    out.extend_from_slice(&[0; 3][..missing]);
}

/// Appends an option.
pub fn option(code: u16, value: &[u8], out: &mut Vec<u8>) {
    let value = &value[..value.len().min(MAX_OPTION_BYTES)];
    let start = out.len();
    out.extend_from_slice(&code.to_le_bytes());
    out.extend_from_slice(&(value.len() as u16).to_le_bytes());
    out.extend_from_slice(value);
    pad(start, out);
}

/// Appends a text option. Text that is too long is cut at a character boundary.
pub fn text(code: u16, value: &str, out: &mut Vec<u8>) {
    let mut end = value.len().min(MAX_OPTION_BYTES);
    while !value.is_char_boundary(end) {
        end -= 1;
    }
    option(code, &value.as_bytes()[..end], out);
}

/// Appends our custom option with the text that `fill` writes. tshark and editcap keep it when they save the file.
pub fn custom(out: &mut Vec<u8>, fill: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    let mut head = [0; 8];
    head[..2].copy_from_slice(&CUSTOM_OPTION.to_le_bytes());
    head[4..].copy_from_slice(&ENTERPRISE.to_le_bytes());
    out.extend_from_slice(&head);
    fill(out);
    out.truncate(start + 4 + MAX_OPTION_BYTES);
    let length = (out.len() - start - 4) as u16;
    out[start + 2..start + 4].copy_from_slice(&length.to_le_bytes());
    pad(start, out);
}

/// Appends the end of a block's options.
pub fn end_options(out: &mut Vec<u8>) {
    out.extend_from_slice(&[0; 4]);
}

/// Appends a section header with the name of the program and a comment for the reader.
pub fn section(application: &str, comment: &str, out: &mut Vec<u8>) {
    section_with(application, comment, "", out);
}

/// Appends a section header that also has our custom option with these words.
pub fn section_with(application: &str, comment: &str, words: &str, out: &mut Vec<u8>) {
    let start = begin_block(0x0A0D_0D0A, out);
    out.extend_from_slice(&0x1A2B_3C4D_u32.to_le_bytes());
    out.extend_from_slice(&[1, 0, 0, 0]); // version 1.0
    out.extend_from_slice(&u64::MAX.to_le_bytes()); // length not known
    if !comment.is_empty() {
        text(COMMENT, comment, out);
    }
    text(4, application, out);
    if !words.is_empty() {
        custom(out, |out| out.extend_from_slice(words.as_bytes()));
    }
    end_options(out);
    end_block(start, out);
}

/// The content of an interface block.
#[derive(Clone, Debug, Default)]
pub struct Interface<'a> {
    /// The link type.
    pub link: u16,
    /// The name of the port.
    pub name: &'a str,
    /// A description for the user.
    pub description: &'a str,
    /// The speed in bits per second, if known.
    pub speed: Option<u64>,
    /// The resolution of the times, as a number of decimal digits of a second.
    pub digits: u8,
    /// The text of our custom option; none if empty.
    pub custom: &'a str,
}

/// Appends an interface block.
pub fn interface(interface: &Interface<'_>, out: &mut Vec<u8>) {
    let start = begin_block(1, out);
    out.extend_from_slice(&interface.link.to_le_bytes());
    out.extend_from_slice(&[0; 2]);
    out.extend_from_slice(&SNAP_LENGTH.to_le_bytes());
    text(2, interface.name, out);
    text(3, interface.description, out);
    if let Some(speed) = interface.speed {
        option(8, &speed.to_le_bytes(), out);
    }
    option(9, &[interface.digits], out);
    if !interface.custom.is_empty() {
        custom(out, |out| out.extend_from_slice(interface.custom.as_bytes()));
    }
    end_options(out);
    end_block(start, out);
}

/// Begins an enhanced packet block and returns its start. The caller appends the data of the packet, then calls
/// `end_bytes`.
pub fn begin_packet(interface: u32, time: u64, out: &mut Vec<u8>) -> usize {
    let start = out.len();
    // The lengths are filled in later. The header is appended in one block, because small packets consist mostly of
    // headers.
    let mut head = [0; 28];
    head[0] = 6;
    head[8..12].copy_from_slice(&interface.to_le_bytes());
    head[12..16].copy_from_slice(&((time >> 32) as u32).to_le_bytes());
    head[16..20].copy_from_slice(&(time as u32).to_le_bytes());
    out.extend_from_slice(&head);
    start
}

/// Ends the data of a packet. Options may follow, then `end_options` and `end_block`.
pub fn end_bytes(start: usize, out: &mut Vec<u8>) {
    let length = ((out.len() - start - 28) as u32).to_le_bytes();
    out[start + 20..start + 24].copy_from_slice(&length);
    out[start + 24..start + 28].copy_from_slice(&length);
    pad(start, out);
}

/// Appends the flags of a packet, unless they are zero.
pub fn flags(value: u32, out: &mut Vec<u8>) {
    if value != 0 {
        option(FLAGS, &value.to_le_bytes(), out);
    }
}

/// Appends a comment to a packet.
pub fn comment(value: &str, out: &mut Vec<u8>) {
    text(COMMENT, value, out);
}

/// Appends an interface statistics block with a comment about frames that are not in the file.
pub fn statistics(interface: u32, time: u64, words: &str, out: &mut Vec<u8>) {
    let start = begin_block(5, out);
    out.extend_from_slice(&interface.to_le_bytes());
    out.extend_from_slice(&((time >> 32) as u32).to_le_bytes());
    out.extend_from_slice(&(time as u32).to_le_bytes());
    text(COMMENT, words, out);
    end_options(out);
    end_block(start, out);
}

/// Appends the header of a classic pcap file with times in ns.
pub fn classic_head(link: u16, out: &mut Vec<u8>) {
    out.extend_from_slice(&0xA1B2_3C4D_u32.to_le_bytes());
    out.extend_from_slice(&[2, 0, 4, 0]);
    out.extend_from_slice(&[0; 8]);
    out.extend_from_slice(&SNAP_LENGTH.to_le_bytes());
    out.extend_from_slice(&u32::from(link).to_le_bytes());
}

/// Begins a record of classic pcap and returns its start.
pub fn begin_classic(time: u64, out: &mut Vec<u8>) -> usize {
    let start = out.len();
    out.extend_from_slice(&((time / 1_000_000_000) as u32).to_le_bytes());
    out.extend_from_slice(&((time % 1_000_000_000) as u32).to_le_bytes());
    out.extend_from_slice(&[0; 8]);
    start
}

/// Ends a record of classic pcap.
pub fn end_classic(start: usize, out: &mut [u8]) {
    let length = ((out.len() - start - 16) as u32).to_le_bytes();
    out[start + 8..start + 12].copy_from_slice(&length);
    out[start + 12..start + 16].copy_from_slice(&length);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The smallest complete file: section, interface and one packet, byte by byte as the draft defines them.
    #[test]
    fn blocks_have_the_layout_of_the_draft() {
        let mut out = Vec::new();
        section("modlens", "", &mut out);
        let head = "0a0d0d0a2c0000004d3c2b1a01000000ffffffffffffffff040007006d6f646c656e7300000000002c000000";
        assert_eq!(modlens_protocol::hex::hex(&out), head);
        out.clear();
        let port = Interface {
            link: LINK_UPPER_PDU,
            name: "/dev/ttyUSB0",
            description: "RS-485 bus A, 19200 8E1",
            speed: Some(19_200),
            digits: 9,
            custom: "",
        };
        interface(&port, &mut out);
        let block = "01000000 58000000 fc000000 00000400 02000c00 2f6465762f74747955534230 \
                     03001700 52532d34383520627573 20412c203139323030203845 3100 08000800 004b000000000000 \
                     09000100 09000000 00000000 58000000";
        assert_eq!(modlens_protocol::hex::hex(&out), block.split_whitespace().collect::<String>());
        out.clear();
        let start = begin_packet(0, 0x1797_9CFE_362A_0000, &mut out);
        out.extend_from_slice(&[1, 2, 3]);
        end_bytes(start, &mut out);
        comment("hello", &mut out);
        flags(2, &mut out);
        custom(&mut out, |out| out.extend_from_slice(b"gap_us=1234"));
        end_options(&mut out);
        end_block(start, &mut out);
        let packet = "06000000 50000000 00000000 fe9c9717 00002a36 03000000 03000000 01020300 \
                      01000500 68656c6c6f000000 0200040002000000 \
                      ac0b0f00 d97e0000 6761705f75733d3132333400 00000000 50000000";
        assert_eq!(modlens_protocol::hex::hex(&out), packet.split_whitespace().collect::<String>());
    }
}
