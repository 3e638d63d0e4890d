//! Readings of recorded bytes that no valid frame is in: what can be tried without the line.
//!
//! Bytes that were received at a wrong rate are lost. Some other wrong settings leave enough to tell which they were, and only
//! frames with valid checksums, or bytes that accident would not bring forth, count.

use modlens_protocol::checksum::{crc16, crc_valid};
use modlens_protocol::functions::{Extent, Functions, EXCEPTION_BIT};
use modlens_protocol::line::Parity;

/// A reading that fits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reading {
    /// What is wrong with the recording, in words.
    pub what: &'static str,
    /// It is that of swapped wires.
    pub is_swapped: bool,
    /// What it rests on.
    pub evidence: String,
}

/// What is said of swapped wires.
const SWAPPED: &str = "A and B are swapped: the line's levels are inverted";
/// Fewer bytes say nothing.
const LEAST_BYTES: usize = 24;
/// So many bursts have to become valid frames.
const LEAST_FRAMES: usize = 3;
/// One burst of so many, of those tried, has to become a valid frame.
const BURSTS_PER_FRAME: usize = 2;
/// As above, of different frames with the lengths that their headers announce: long responses take more steps than are tried.
const BURSTS_PER_ANNOUNCED_FRAME: usize = 4;
/// Bursts that are tried.
const MOST_BURSTS: usize = 64;
/// Steps for one burst and one kind of receiver: a request needs some hundreds.
const MOST_STEPS: u32 = 20_000;
/// Idle bits after the last character that was received: the rest of the frame's last character is among them.
const IDLE_BITS: u32 = 12;
/// The shortest RTU frame, that of most requests, and the longest.
const SHORTEST: usize = 4;
const REQUEST: usize = 8;
const LONGEST: usize = 256;
/// The greatest unit.
const LAST_UNIT: u8 = 247;

/// The readings that fit bursts of bytes, each received between two silences with this parity.
///
/// ```
/// use modlens_engine::line_search::readings;
/// use modlens_protocol::line::Parity;
/// // 01 03 00 00 00 01 84 0A, each bit inverted by software.
/// let burst = vec![0xFE, 0xFC, 0xFF, 0xFF, 0xFF, 0xFE, 0x7B, 0xF5];
/// assert_eq!(readings(&[burst.clone(), burst.clone(), burst], Parity::None)[0].evidence, "3 of 3 bursts become valid frames");
/// ```
pub fn readings(bursts: &[Vec<u8>], parity: Parity) -> Vec<Reading> {
    let bytes: Vec<u8> = bursts.iter().flatten().copied().collect();
    if bytes.len() < LEAST_BYTES {
        return Vec::new();
    }
    let tried: Vec<&[u8]> = bursts.iter().filter(|burst| burst.len() >= SHORTEST).take(MOST_BURSTS).map(Vec::as_slice).collect();
    let reading = |what, is_swapped, count| Reading {
        what,
        is_swapped,
        evidence: format!("{count} of {} bursts become valid frames", tried.len()),
    };
    let frames = |what, fits: &dyn Fn(&[u8]) -> bool| {
        let count = tried.iter().filter(|burst| fits(burst)).count();
        (count >= LEAST_FRAMES.max(tried.len().div_ceil(BURSTS_PER_FRAME))).then(|| reading(what, false, count))
    };
    let swapped = |receiver| {
        let found: Vec<Vec<u8>> = tried.iter().filter_map(|burst| uninverted(burst, parity, receiver)).collect();
        // One accident may come again and again, as the burst does.
        let is_same = found.iter().all(|frame| *frame == found[0]);
        let per_frame = if is_same { BURSTS_PER_FRAME } else { BURSTS_PER_ANNOUNCED_FRAME };
        let least = LEAST_FRAMES.max(tried.len().div_ceil(per_frame));
        (found.len() >= least).then(|| reading(SWAPPED, true, found.len()))
    };
    let found = [
        [Receiver::Resyncs, Receiver::Waits].into_iter().find_map(swapped),
        frames("all bits are inverted", &|burst| crc_valid(&burst.iter().map(|byte| !byte).collect::<Vec<u8>>())),
        frames("the receiver was set to 7 data bits: the highest bit of each byte is lost", &fits_in_seven_bits),
        dropped(&bytes),
    ];
    found.into_iter().flatten().collect()
}

/// Whether bytes begin as a frame with this beginning does on swapped wires, after a break or two of the idle line, or with each bit
/// inverted by software.
///
/// ```
/// use modlens_engine::line_search::is_inverted;
/// // 01 03 at 8N1 is 0 10000000 1 0 11000000 1, lowest bit first. Inverted, a one begins a character: 1 00000001 0 and 1 10000001, of
/// // which each data bit is read as its opposite.
/// assert!(is_inverted(&[0x00, 0x7F, 0x7E, 0xBF, 0x19], &[1, 3, 2]));
/// assert!(!is_inverted(&[0x00, 0x7F, 0x5E, 0xBF, 0x19], &[1, 3, 2]));
/// ```
pub fn is_inverted(burst: &[u8], head: &[u8]) -> bool {
    let breaks = burst.iter().take(MOST_BREAKS).take_while(|byte| **byte == 0).count();
    let parities = [None, Some(0), Some(1)].into_iter();
    let mut ways =
        parities.flat_map(|parity| [Receiver::Resyncs, Receiver::Waits].map(|receiver| on_swapped_wires(head, parity, receiver)));
    let inverted: Vec<u8> = head.iter().map(|byte| !byte).collect();
    let begins = |made: &[u8]| made.len() >= LEAST_HEARD && (0..=breaks).any(|from| burst[from..].starts_with(made));
    begins(&inverted) || ways.any(|made| begins(&made))
}

/// Breaks in front of a frame that are left out.
const MOST_BREAKS: usize = 2;
/// So many bytes are no accident, of the few readings that are tried.
const LEAST_HEARD: usize = 2;

/// What a receiver on swapped wires makes of the beginning of a frame, as far as that settles it; `parity` is that of an even number of
/// ones.
fn on_swapped_wires(head: &[u8], parity: Option<u32>, receiver: Receiver) -> Vec<u8> {
    let mut bits = Vec::new();
    for byte in head {
        bits.push(false);
        bits.extend((0..8).map(|place| byte >> place & 1 == 1));
        bits.extend(parity.map(|even| byte.count_ones() % 2 != even));
        bits.push(true);
    }
    let (mut made, mut at) = (Vec::new(), 0);
    while let Some(data) = bits.get(at + 1..at + 9) {
        if !bits[at] {
            at += 1;
            continue;
        }
        made.push(data.iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(!bit)));
        at += 9 + usize::from(parity.is_some());
        while receiver == Receiver::Waits && bits.get(at) == Some(&true) {
            at += 1;
        }
    }
    made
}

/// Whether a burst is a frame whose bytes have all lost their highest bit, which only those of the checksum had.
fn fits_in_seven_bits(burst: &[u8]) -> bool {
    let (body, checksum) = burst.split_at(burst.len() - 2);
    let of_seven = |byte: &u8| *byte < 0x80;
    burst.iter().all(of_seven) && crc16(body).to_le_bytes().map(|byte| byte & 0x7F) == checksum
}

/// A receiver without parity takes the parity bit for the stop bit. A driver that drops characters without a stop bit keeps those
/// whose parity bit is 1: with even parity, those of an odd number of ones.
fn dropped(bytes: &[u8]) -> Option<Reading> {
    let odd = bytes.iter().filter(|byte| byte.count_ones() % 2 == 1).count();
    let what = match odd {
        0 => "the line has odd parity, the receiver none, and characters were dropped as errors",
        all if all == bytes.len() => "the line has even parity, the receiver none, and characters were dropped as errors",
        _ => return None,
    };
    let number = if odd == 0 { "even" } else { "odd" };
    Some(Reading { what, is_swapped: false, evidence: format!("each of {} bytes has an {number} number of ones", bytes.len()) })
}

/// What a receiver does after a character without a stop bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Receiver {
    /// It takes the missing stop bit for the start bit of the next character.
    Resyncs,
    /// It waits until the line is high, and then for the next start bit.
    Waits,
}

/// The frame that was sent, if such a receiver on swapped wires made this of it.
///
/// To that receiver the idle line is low. It sees a start bit where the level falls, that is: where a bit of the frame is 1, and
/// waits while bits are 0. How many those were is not in its bytes, nor how many bits of 1 it waited for. Start, parity and stop
/// bits of the frame, which have to be where they belong, leave few possibilities, and the checksum one.
fn uninverted(burst: &[u8], parity: Parity, receiver: Receiver) -> Option<Vec<u8>> {
    // Short frames first: after a wrong beginning, a long one has many possible ends.
    [(REQUEST, true), (REQUEST, false), (LONGEST, true)].into_iter().find_map(|(longest, is_whole)| {
        let mut search = Reinversion { burst, parity, receiver, longest, is_whole, steps: MOST_STEPS };
        search.zeros_then_character(0, Sent::default(), 1)
    })
}

/// The frame so far, bit by bit.
#[derive(Clone, Debug, Default)]
struct Sent {
    bytes: Vec<u8>,
    /// Bits of the character that has begun, its start bit among them.
    bits: u32,
    byte: u8,
    is_over: bool,
}

impl Sent {
    /// Adds a bit; whether a frame can go on like this.
    fn push(&mut self, bit: bool, parity: Parity) -> bool {
        let stop = if parity == Parity::None { 9 } else { 10 };
        match self.bits {
            _ if self.is_over => return bit,
            0 if bit => {
                self.is_over = true;
                return !self.bytes.is_empty();
            }
            0 => {}
            1..=8 => self.byte |= u8::from(bit) << (self.bits - 1),
            at if at == stop => {
                self.bytes.push(self.byte);
                (self.bits, self.byte) = (0, 0);
                return bit;
            }
            _ => {
                let is_odd = self.byte.count_ones() % 2 == 1;
                if bit != (is_odd == (parity == Parity::Even)) {
                    return false;
                }
            }
        }
        self.bits += 1;
        true
    }
}

/// Whether a frame has the length that its header announces: among thousands of possibilities one has a valid checksum by chance.
fn is_announced(frame: &[u8]) -> bool {
    let length = frame.len() - SHORTEST;
    if frame[1] & EXCEPTION_BIT != 0 {
        return length == 1;
    }
    let row = Functions::embedded().row(frame[1], &frame[2..]);
    row.is_some_and(|row| {
        [&row.request, &row.response].iter().any(|layout| layout.extent(&frame[2..]) == Extent::Exactly(length))
    })
}

struct Reinversion<'a> {
    burst: &'a [u8],
    parity: Parity,
    receiver: Receiver,
    longest: usize,
    /// Nothing comes after it in the burst.
    is_whole: bool,
    steps: u32,
}

impl Reinversion<'_> {
    /// `least` or more bits of 0, then the received character at `index`.
    fn zeros_then_character(&mut self, index: usize, mut sent: Sent, least: u32) -> Option<Vec<u8>> {
        let mut zeros = 0;
        loop {
            if zeros >= least {
                if let Some(found) = self.character(index, sent.clone()) {
                    return Some(found);
                }
            }
            zeros += 1;
            if self.steps == 0 || !sent.push(false, self.parity) {
                return None;
            }
        }
    }

    /// Whether a frame may begin like this, if it is no longer than it may be.
    fn is_plausible(&self, sent: &Sent) -> bool {
        match sent.bytes[..] {
            [] => true,
            [unit] => unit <= LAST_UNIT,
            [unit, code] => unit <= LAST_UNIT && Functions::embedded().row(code & !EXCEPTION_BIT, &[]).is_some(),
            _ => sent.bytes.len() < self.longest || (sent.bytes.len() == self.longest && sent.bits == 0),
        }
    }

    /// The received character at `index`: its start bit was a 1, its data bits are inverted, its parity bit is not known.
    fn character(&mut self, index: usize, mut sent: Sent) -> Option<Vec<u8>> {
        self.steps = self.steps.checked_sub(1)?;
        let byte = self.burst.get(index).filter(|_| self.is_plausible(&sent))?;
        let bits = (0..8).map(|place| byte >> place & 1 == 0);
        if !sent.push(true, self.parity) || !bits.into_iter().all(|bit| sent.push(bit, self.parity)) {
            return None;
        }
        if self.parity == Parity::None {
            return self.stop_bit(index, sent);
        }
        [false, true].into_iter().find_map(|bit| {
            let mut sent = sent.clone();
            sent.push(bit, self.parity).then(|| self.stop_bit(index, sent)).flatten()
        })
    }

    /// The stop bit: high, a 0 of the frame; or low, and then the start bit of the next character, a wait or the idle line. After
    /// that there may be another frame: an answer that followed its request soon.
    fn stop_bit(&mut self, index: usize, sent: Sent) -> Option<Vec<u8>> {
        let is_last = index + 1 == self.burst.len();
        let ended = if is_last || !self.is_whole { self.idle(sent.clone()) } else { None };
        if ended.is_some() || is_last {
            return ended;
        }
        let missing = match self.receiver {
            Receiver::Resyncs => self.character(index + 1, sent.clone()),
            Receiver::Waits => self.ones_then_character(index + 1, sent.clone()),
        };
        missing.or_else(|| self.zeros_then_character(index + 1, sent, 1))
    }

    /// One or more bits of 1, for which the receiver waits, then bits of 0 and the received character at `index`.
    fn ones_then_character(&mut self, index: usize, mut sent: Sent) -> Option<Vec<u8>> {
        while sent.push(true, self.parity) && !sent.is_over {
            let found = self.zeros_then_character(index, sent.clone(), 1);
            if found.is_some() || self.steps == 0 {
                return found;
            }
        }
        None
    }

    /// The idle line after the last character that was received: the frame, if it ends with bits of 1.
    fn idle(&self, mut sent: Sent) -> Option<Vec<u8>> {
        let is_over = (0..IDLE_BITS).all(|_| sent.push(true, self.parity)) && sent.is_over;
        (is_over && sent.bytes.len() >= SHORTEST && crc_valid(&sent.bytes) && is_announced(&sent.bytes)).then_some(sent.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_read_back_from_what_a_receiver_on_swapped_wires_made_of_it() {
        // Made by hand from 01 03 02 00 07 F9 86 at 8N1, a character a line, first bit first:
        // 0 10000000 1 | 0 11000000 1 | 0 01000000 1 | 0 00000000 1 | 0 11100000 1 | 0 10011111 1 | 0 01100001 1, then 1 for ever.
        let frame = [1, 3, 2, 0, 7, 0xF9, 0x86];
        assert!(crc_valid(&frame));
        let bits = "0100000001011000000100100000010000000001011100000101001111110011000011";
        for receiver in [Receiver::Resyncs, Receiver::Waits] {
            let burst = by_hand(bits, receiver);
            assert_eq!(uninverted(&burst, Parity::None, receiver).as_deref(), Some(&frame[..]), "{receiver:?}: {burst:02x?}");
        }
        assert_ne!(by_hand(bits, Receiver::Resyncs), by_hand(bits, Receiver::Waits));
    }

    /// A receiver on swapped wires, straight from the definition: it starts at each 1 after a 0, or at once or after the next 0 where
    /// the stop bit is missing, and takes the eight bits after it, inverted.
    fn by_hand(bits: &str, receiver: Receiver) -> Vec<u8> {
        let bit = |at: usize| bits.as_bytes().get(at).is_none_or(|bit| *bit == b'1');
        let (mut heard, mut at) = (Vec::new(), 0);
        while at < bits.len() {
            if !bit(at) {
                at += 1;
                continue;
            }
            let byte = (0..8).fold(0, |byte, place| byte | u8::from(!bit(at + 1 + place)) << place);
            heard.push(byte);
            at += 9;
            let waits = receiver == Receiver::Waits || byte == 0;
            while waits && at < bits.len() && bit(at) {
                at += 1;
            }
        }
        heard
    }

    #[test]
    fn a_request_is_read_back_whatever_follows_it_at_once() {
        // 01 03 00 00 00 0A C5 CD and the beginning of its answer, on swapped wires to a receiver that waits.
        let burst = [0x7F, 0x7E, 0xFF, 0xFF, 0xEB, 0x75, 0x19, 0x7F, 0x7E, 0x5D, 0x47, 0x7E, 0xC1, 0x6F];
        let frame = uninverted(&burst, Parity::None, Receiver::Waits);
        assert_eq!(frame.as_deref(), Some(&[1, 3, 0, 0, 0, 0x0A, 0xC5, 0xCD][..]));
    }

    #[test]
    fn one_accident_that_comes_again_is_no_evidence() {
        let request = vec![0x7F, 0x7E, 0xFF, 0xFF, 0xEB, 0x75, 0x19];
        let others = (0..30).map(|number| vec![0x41, number, 0x13, 0x57]);
        let of = |count: usize| others.clone().chain(vec![request.clone(); count]).collect::<Vec<_>>();
        let is_swapped = |bursts: &[Vec<u8>]| readings(bursts, Parity::None).iter().any(|one| one.is_swapped);
        assert!(!is_swapped(&of(20)) && is_swapped(&of(32)));
    }

    #[test]
    fn bytes_of_one_parity_tell_what_was_dropped() {
        // 8E1 read at 8N1: the parity bit of 01, 02, 04 and 07 is 1, which passes for a stop bit; 03 and 05 are dropped.
        let odd = vec![vec![1, 2, 4, 7, 8, 0x10]; 4];
        let found = readings(&odd, Parity::None);
        assert!(found.len() == 1 && found[0].what.starts_with("the line has even parity"), "{found:?}");
        assert!(readings(&[(0..64).collect()], Parity::None).is_empty());
    }

    #[test]
    fn seven_bits_are_enough_to_know_a_checksum() {
        // 01 03 00 00 00 01 84 0A without the highest bits.
        let found = readings(&vec![vec![1, 3, 0, 0, 0, 1, 0x04, 0x0A]; 3], Parity::None);
        assert!(found.len() == 1 && found[0].what.contains("7 data bits"), "{found:?}");
    }
}
