//! How well bytes fit a template, once flipped bits, missing bytes and collisions are allowed for.

use crate::framer::harm::Harm;
use crate::framer::rtu::autopsy::template::Template;
use crate::framer::rtu::autopsy::ROUNDING;
use crate::framer::rtu::index::MOST_LOST;
use crate::framer::rtu::model::Model;
use crate::framer::rtu::sift::Costs;
use modlens_protocol::checksum::{crc16, mending_bit, update};

/// Flipped bits in unit and function code, where they are to be recognised.
const MOST_FLIPS: u32 = 3;

/// Bits that it takes to say what happened, and where.
const LOST_HEAD: f32 = 5.0;
const LOST_INSIDE: f32 = 6.0;
const DOUBLED: f32 = 8.0;
const FLIPPED: [f32; 4] = [0.0, 9.0, 13.0, 17.0];
const COLLIDED: f32 = 5.0;

/// A byte that does not fit what collided.
const MISFIT: f32 = 4.0;

/// What a flipped bit that mends the checksum is worth; less the bits that say which one it is.
pub const CHECKSUM: f32 = 16.0;
const MENDED: f32 = 13.0;

/// One more byte of a run.
const RUN: f32 = 0.3;

/// Evidence so far behind its best is over.
const DROP: f32 = 12.0;

/// A template found.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Bits.
    pub score: f32,
    /// Bytes that agree with the template: what comes next may begin behind them.
    pub core: usize,
    /// Bytes of the template missing in front.
    pub head: usize,
    /// So many of the first bytes agree without any change.
    pub same: usize,
    /// Bytes that are left of the frame, where its length is known.
    pub length: Option<usize>,
    /// What happened.
    pub harm: Option<Harm>,
    /// The checksum is right, once that is made good.
    pub mended: bool,
    /// All bytes that are known agree, but the checksum does not.
    pub exact: bool,
}

/// What it costs that a template is not there as it should be.
pub const COSTS: Costs = Costs { head: LOST_HEAD, inside: LOST_INSIDE, collided: COLLIDED };

/// The best way to see the template in bytes that begin here, if it is worth `need` bits.
pub fn align(model: &Model, template: &Template<'_>, bytes: &[u8], need: f32) -> Option<Fit> {
    // With a length, the checksum tells what nothing else is known of.
    let known = template.bytes.len() - usize::from(template.length.is_none());
    let most = MOST_LOST.min(known);
    let fits = (0..=most).filter_map(|head| from(model, template, bytes, head, need));
    fits.max_by(|a, b| a.score.total_cmp(&b.score))
}

/// The same, with so many bytes of the template missing in front.
fn from(model: &Model, template: &Template<'_>, bytes: &[u8], head: usize, need: f32) -> Option<Fit> {
    let known = &template.bytes[head..];
    let same = known.iter().zip(bytes).take_while(|(a, b)| a == b).count();
    // Nearly everywhere nearly nothing fits: that has to be seen at once.
    let run = same > 1 && bytes[..same].iter().all(|&byte| byte == bytes[0]);
    let hopeless = if head > 0 { run || same < 2.min(known.len()) } else { same == 0 && !nearly(known, bytes) };
    if hopeless {
        return None;
    }
    // Bytes that agree are worth so much at most, whatever happened between them.
    let most: f32 = model.bits_of(&bytes[..bytes.len().min(known.len() + 1)]) - template.cost + template.checksum_at_most();
    if most < need - ROUNDING {
        return None;
    }
    let broken = same > 0 && same < known.len() && head == 0 && most - COLLIDED >= need;
    let begun = if broken { flipped(model, &known[..same], bytes, 0).0 } else { 0.0 };
    let losses = (1..=MOST_LOST).filter(|_| broken).filter_map(|count| lost(model, known, bytes, (same, begun), count));
    let others = [doubled, collided].into_iter().filter(|_| broken).filter_map(|way| way(model, known, bytes, (same, begun)));
    let ways = std::iter::once(straight(model, known, bytes, head)).chain(losses).chain(others);
    let fits = ways.map(|way| {
        // Bytes of the template that are not there, or there twice.
        let short = match way.harm {
            Some(Harm::Lost { count, .. }) => count as isize,
            Some(Harm::Doubled { .. }) => -1,
            _ => 0,
        };
        let length = template.length.map(|length| length.saturating_add_signed(-short));
        let mended = checksum(template, bytes, length, short);
        let exact = mended == 0.0 && head == 0 && same == known.len();
        let core = if mended > 0.0 { way.core.max(length.unwrap_or(0)) } else { way.core };
        Fit { score: way.score - template.cost + mended, core, head, same, length, harm: way.harm, mended: mended > 0.0, exact }
    });
    fits.filter(|fit| fit.score > 0.0 && fit.score >= need).max_by(|a, b| a.score.total_cmp(&b.score))
}

/// Whether one of unit and function code is right, and the other differs in a few bits only.
fn nearly(known: &[u8], bytes: &[u8]) -> bool {
    let flips = || known.iter().zip(bytes).take(2).map(|(a, b)| (a ^ b).count_ones());
    bytes.len() >= 3 && flips().any(|flips| flips == 0) && flips().sum::<u32>() <= MOST_FLIPS
}

/// One way to read the known bytes.
struct Way {
    score: f32,
    core: usize,
    harm: Option<Harm>,
}

/// Without a loss but in front.
fn straight(model: &Model, known: &[u8], bytes: &[u8], head: usize) -> Way {
    let (score, core) = flipped(model, known, bytes, 0);
    let harm = (head > 0).then_some(Harm::Lost { at: 0, count: head });
    Way { score: if head > 0 { score - LOST_HEAD } else { score }, core, harm }
}

/// The best beginning that agrees but for flipped bits: bits and bytes.
fn flipped(model: &Model, known: &[u8], bytes: &[u8], from: usize) -> (f32, usize) {
    let (mut score, mut best) = (0.0, (0.0, 0));
    for (at, (&wanted, &byte)) in known.iter().zip(bytes).enumerate() {
        let flips = (wanted ^ byte).count_ones() as usize;
        let Some(&cost) = FLIPPED.get(flips) else { break };
        // In a run of one value each byte but the first was to be expected.
        let run = at > 0 && known[at - 1] == wanted && flips == 0;
        score += if run { RUN } else { model.bits(byte) - cost };
        if score > best.0 && flips == 0 {
            best = (score, from + at + 1);
        }
        if score < best.0 - DROP {
            break;
        }
    }
    best
}

/// So many bytes missing behind the first `same` ones, which are worth `begun`.
fn lost(model: &Model, known: &[u8], bytes: &[u8], (same, begun): (usize, f32), count: usize) -> Option<Way> {
    let rest = known.get(same + count..)?;
    let (score, core) = flipped(model, rest, &bytes[same..], same);
    let score = begun + score - LOST_INSIDE;
    // Where nothing that is known is left behind the loss, the checksum has to tell.
    (core > same || rest.is_empty()).then_some(Way { score, core, harm: Some(Harm::Lost { at: same, count }) })
}

/// One byte twice behind the first `same` ones.
fn doubled(model: &Model, known: &[u8], bytes: &[u8], (same, begun): (usize, f32)) -> Option<Way> {
    if bytes.get(same) != bytes.get(same - 1) {
        return None;
    }
    let (score, core) = flipped(model, &known[same..], bytes.get(same + 1..)?, same + 1);
    let score = begun + score - DOUBLED;
    (core > same + 1).then_some(Way { score, core, harm: Some(Harm::Doubled { at: same }) })
}

/// The driver that pulls to 0 wins: from the first wrong byte on, bits of the template are missing, and none is added.
fn collided(model: &Model, known: &[u8], bytes: &[u8], (same, begun): (usize, f32)) -> Option<Way> {
    let mut score = begun - COLLIDED;
    let mut core = same;
    let mut wrong = 0;
    for (&wanted, &byte) in known.iter().zip(bytes).skip(same) {
        if byte & !wanted == 0 {
            score += model.bits(byte) - wanted.count_ones() as f32 - 0.5;
            wrong += usize::from(byte != wanted);
        } else {
            score -= MISFIT;
        }
        core += 1;
    }
    (wrong > 1).then_some(Way { score, core, harm: Some(Harm::Collided { at: same }) })
}

/// What the checksum says of the bytes behind those known, once those are mended.
fn checksum(template: &Template<'_>, bytes: &[u8], length: Option<usize>, short: isize) -> f32 {
    let known = template.bytes.len();
    let behind = known.saturating_add_signed(-short);
    let Some(length) = length.filter(|&length| length >= 4 && length <= bytes.len() && behind <= length) else { return 0.0 };
    if template.length.is_some_and(|whole| whole <= known) {
        return 0.0;
    }
    if update(crc16(&template.bytes), &bytes[behind..length]) == 0 {
        return CHECKSUM;
    }
    match mending_bit(&bytes[..length]) {
        Some(_) if short == 0 => (MENDED - (8.0 * length as f32).log2()).max(0.0),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framer::rtu::autopsy::template::{poll, POLL};
    use crate::framer::rtu::sift::Sift;
    use proptest::prelude::*;

    /// What may happen to a frame: bytes missing, one twice, bits flipped, bits lost.
    fn spoil(frame: &[u8], how: u8, at: usize, bits: u8) -> Vec<u8> {
        let mut bytes = frame.to_vec();
        let at = at % bytes.len();
        match how {
            0 => drop(bytes.drain(at..bytes.len().min(at + 1 + usize::from(bits % 3)))),
            1 => bytes.insert(at, bytes[at]),
            2 => bytes[at] ^= bits,
            3 => bytes[at..].iter_mut().for_each(|byte| *byte &= bits),
            _ => {}
        }
        bytes
    }

    proptest! {
        #[test]
        fn the_sift_keeps_all_that_fit(
            body in proptest::collection::vec(0u8..5, 3..7),
            how in 0u8..5,
            at in any::<usize>(),
            bits in any::<u8>(),
            behind in proptest::collection::vec(0u8..5, 0..6),
        ) {
            let frame = [&body[..], &crc16(&body).to_le_bytes()].concat();
            let bytes = [spoil(&frame, how, at, bits), behind].concat();
            let model = Model::default();
            let Some(fit) = align(&model, &poll(&frame), &bytes, 0.0) else { return Ok(()) };
            let mut sift = Sift::default();
            sift.add(5, &frame);
            let kept = sift.likely(1 << 5, &bytes, |byte| model.bits(byte), fit.score + POLL, &COSTS);
            prop_assert_eq!(kept, 1 << 5, "{:02x?} in {:02x?}: {:?}", frame, bytes, fit);
        }
    }

    #[test]
    fn a_frame_of_which_unit_and_function_are_wrong_is_not_recognised() {
        // One lost bit in each; the sift looks for one of the two.
        let fit = align(&Model::default(), &poll(&[3, 3, 2, 0, 0xF1]), &[2, 2, 2, 0, 0x70], 0.0);
        assert!(fit.is_none(), "{fit:?}");
    }
}
