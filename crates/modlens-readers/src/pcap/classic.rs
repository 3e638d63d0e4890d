//! Records of pcap that are whole in a block of input: their headers are read at fixed places.

use modlens_protocol::Ns;

/// A record that announces more bytes is damaged. Wireshark limits packets to 256 KiB.
pub(super) const MAX_RECORD_BYTES: usize = 1 << 26;

/// The header of a packet of pcap: seconds, their fraction, bytes that were kept, and bytes on the wire.
const RECORD_HEADER_BYTES: usize = 16;

/// The numbers of such a header: seconds, their fraction, the bytes that are kept, and those on the wire.
///
/// Each is read by itself: where the next record begins depends on one of them, and must not wait for all.
#[inline]
pub(super) fn numbers_of_header(header: &[u8; RECORD_HEADER_BYTES], is_big_endian: bool) -> [u32; 4] {
    let word = |at: usize| {
        let word = u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        if is_big_endian {
            word.swap_bytes()
        } else {
            word
        }
    };
    [word(0), word(4), word(8), word(12)]
}

/// Packets of pcap that are whole in a block of input, one after the other.
#[derive(Clone, Debug)]
pub struct ClassicPackets<'a> {
    rest: &'a [u8],
    is_big_endian: bool,
    /// Number of the last packet that was taken.
    number: u64,
    resolution: Ns,
}

/// One of them.
#[derive(Clone, Copy, Debug)]
pub struct ClassicPacket<'a> {
    /// Its number in the file, from 1.
    pub number: u64,
    /// When it was captured, in ns since 1970.
    pub time: Ns,
    /// The bytes that the capture kept.
    pub data: &'a [u8],
    /// The length of the packet on the wire.
    pub length: usize,
}

impl<'a> ClassicPackets<'a> {
    /// Those at the head of this block, after the packet of this number; times are in steps of `resolution`.
    pub fn new(block: &'a [u8], is_big_endian: bool, number: u64, resolution: Ns) -> Self {
        Self { rest: block, is_big_endian, number, resolution }
    }

    /// The number of the last packet that was taken.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// What is after it.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

impl<'a> Iterator for ClassicPackets<'a> {
    type Item = ClassicPacket<'a>;

    /// The next packet. What is after the last one is less than a record, or damage.
    #[inline]
    fn next(&mut self) -> Option<ClassicPacket<'a>> {
        let (header, behind) = self.rest.split_first_chunk()?;
        let [seconds, fraction, kept, length] = numbers_of_header(header, self.is_big_endian);
        let kept = kept as usize;
        let (data, rest) = behind.split_at_checked(kept).filter(|_| kept <= MAX_RECORD_BYTES)?;
        self.rest = rest;
        self.number += 1;
        let time = time_of([seconds, fraction], self.resolution);
        Some(ClassicPacket { number: self.number, time, data, length: length as usize })
    }
}

/// The time of a packet of pcap, in ns since 1970.
#[inline]
pub fn time_of([seconds, fraction]: [u32; 2], resolution: Ns) -> Ns {
    Ns::from(seconds) * 1_000_000_000 + Ns::from(fraction) * resolution
}
