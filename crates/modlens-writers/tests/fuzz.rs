//! The short form of `make fuzz`: the same checks on cases made of frames, blocks of frames and noise.
//!
//! `FUZZ_CASES` says how many; `FUZZ_SEED` where to begin.

#[path = "../../../fuzz/src/lib.rs"]
mod checks;

use modlens_protocol::checksum::{crc16, lrc};
use modlens_protocol::hex::hex;

/// A linear congruential generator (Knuth's MMIX): the same cases everywhere.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % limit
    }

    fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.below(256) as u8).collect()
    }

    fn pick<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }

    /// A PDU after a unit: a request, an answer, an exception, anything.
    fn adu(&mut self) -> Vec<u8> {
        let unit = self.pick(&[0u8, 1, 1, 2, 17, 255]);
        let code = self.pick(&[1u8, 3, 3, 3, 4, 5, 6, 8, 15, 16, 20, 22, 23, 24, 43, 65, 90, 0x83, 0xFF]);
        let data = self.below(12);
        let body = match self.below(4) {
            0 => vec![0, self.below(4) as u8, 0, 1 + self.below(4) as u8],
            1 => [vec![2 * data as u8], self.bytes(2 * data)].concat(),
            2 => vec![self.pick(&[0u8, 1, 2, 11])],
            _ => self.bytes(data),
        };
        [vec![unit, code], body].concat()
    }

    fn wire(&mut self) -> Vec<u8> {
        let adu = self.adu();
        match self.below(6) {
            0 => self.bytes(8),
            1 => {
                let (byte, count) = (self.pick(&[0u8, 0xFF, 0xFE, b':', 0x0D]), 1 + self.below(30));
                vec![byte; count]
            }
            2 => format!(":{}\r\n", hex(&[&adu[..], &[lrc(&adu)]].concat())).into_bytes(),
            3 => [&[0, 1, 0, 0, 0, adu.len() as u8][..], &adu].concat(),
            _ => [&adu[..], &crc16(&adu).to_le_bytes()].concat(),
        }
    }

    /// A case of the fuzz target: how, then reads of at most 31 bytes with a pause before each.
    fn case(&mut self) -> Vec<u8> {
        let mut bytes: Vec<u8> = Vec::new();
        for _ in 0..=self.below(16) {
            let wire = self.wire();
            for _ in 0..=self.below(2) {
                bytes.extend(&wire);
            }
        }
        for _ in 0..self.below(4) {
            if bytes.is_empty() {
                break;
            }
            let at = self.below(bytes.len());
            match self.below(3) {
                0 => bytes[at] ^= 1 << self.below(8),
                1 => {
                    bytes.remove(at);
                }
                _ => bytes.insert(at, self.below(256) as u8),
            }
        }
        let mut case = vec![self.below(8) as u8];
        let mut rest = &bytes[..];
        while !rest.is_empty() {
            let (read, left) = rest.split_at((1 + self.below(31)).min(rest.len()));
            case.push((read.len() as u8) << 3 | self.below(8) as u8);
            case.extend(read);
            rest = left;
        }
        case
    }
}

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

fn check(seed: u64) {
    let case = Random(seed).case();
    let text = [&[seed as u8][..], &case].concat();
    let holds = std::panic::catch_unwind(|| {
        checks::session_holds(&case);
        checks::text_holds(&text);
        checks::tables_hold(&case);
        checks::recording_holds(&case);
        checks::recorder_holds(&case);
        checks::diagnosis_holds(&case);
        checks::profile_holds(&text);
    });
    assert!(holds.is_ok(), "seed {seed}: {}", hex(&case));
}

#[test]
fn whatever_comes_in_whatever_pieces() {
    for seed in 0..number("FUZZ_CASES", 3000) {
        check(seed + number("FUZZ_SEED", 0));
    }
}

#[test]
fn where_a_lying_mbap_header_ends_does_not_depend_on_pieces() {
    // Once, single bytes gave other frames than all bytes at once.
    check(1_069_269);
}

#[test]
fn records_without_checksum_stand_among_damaged_frames() {
    // Found by libFuzzer: such a record took the beginning of a damaged frame along, which was then looked for.
    let lines = b"\xae.1>--,2-4\n1-4.,--0>--~--,2-4\n1-40>--,2>--,2-4\n1-4.,--0>-->--,2-4\n1-40>-2-4\n1-4.,--0>--~--,2-4\n1-40>--,2>--,2-4\n1-4.,--0>-->--,2\n\n-4\n\n";
    checks::text_holds(lines);
}

#[test]
fn a_damaged_frame_does_not_begin_inside_the_one_before() {
    // Found by libFuzzer: the first bytes that a frame had lost were taken from the frame before it, of which none was left.
    checks::session_holds(&[
        0x3d, 0x5b, 0x13, 0x01, 0x02, 0x95, 0x02, 0x02, 0x02, 0x00, 0x01, 0x02, 0x00, 0x02, 0x95, 0x01, 0x02, 0x02, 0x95, 0x02,
        0x95, 0x02,
    ]);
}

#[test]
fn records_without_checksum_leave_the_frames_behind_them() {
    // Found by libFuzzer: the search went back after such a record, and then stood before the bytes that were left.
    checks::text_holds(b"\xae.1>--4\n14\n1-4.,--04.,--0>-.1>--,2-4\n14\n1-4.,--0>-->--,2-4\n1-40>-77[4]7[7,3=>-,7=,>]63->--,2-4\n1-40>-77[4>-->--,2-4\n1-40>-77[4]3[7,3=>-,7=,>]63->--,2-4\n1-40>-77[4]7[7,3=>-,7=,>]4]7[7,3=>-,7=-,2-4\n1-40>-77[4]3[7,3=>-,7=,>]63->--,2-4\n1-40>-77[4]7[7,3=>-,7=,>]4]7[7,3,>]63[,-7");
}
