//! How well bytes fit an expected frame when flipped bits, missing bytes, a doubled byte and collisions are allowed for.
//!
//! Each kind of damage has a cost in bits, each byte that agrees gains the information content of its value. The kind
//! with the highest total is the alignment. Example: the expected request is `11 03 00 6B 00 03 76 87`, the bytes are
//! `11 03 6B 00 03 76 87`. The first two bytes agree; with one byte missing after them the other five agree as well, and
//! are worth far more than `MISSING_INSIDE_BITS`. So one byte is missing at index 2.

use crate::damage::crc_correction::doubled_byte as doubled_byte_by_crc;
use crate::damage::expected_frame::ExpectedFrame;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::prefilter::DamageCosts;
use crate::rtu_model::prefix_index::MAX_LOST_BYTES;
use crate::rtu_model::traffic_model::TrafficModel;
use crate::weights::{
    COLLISION_BITS, COLLISION_BYTE_BITS, COLLISION_MISFIT_BITS, CRC_CORRECTABLE_BITS, CRC_MATCH_BITS, DOUBLED_BYTE_BITS,
    MAX_HEADER_FLIPS, MAX_SCORE_DROP_BITS, MISSING_HEAD_BITS, MISSING_INSIDE_BITS, ONE_FLIP_BITS, ROUNDING_BITS, RUN_BYTE_BITS,
    THREE_FLIPS_BITS, TWO_FLIPS_BITS,
};
use modlens_protocol::checksum::{correctable_bit, crc16, crc_valid, update};

/// Cost of a byte by the number of its flipped bits.
const FLIPPED_BITS: [f32; 4] = [0.0, ONE_FLIP_BITS, TWO_FLIPS_BITS, THREE_FLIPS_BITS];

/// Cost of a byte by its flipped bits themselves; infinite if there are more than `FLIPPED_BITS` has. Not every processor counts
/// bits in one step.
const COST_OF_FLIPS: [f32; 256] = {
    let mut costs = [f32::INFINITY; 256];
    let mut flips = 0;
    while flips < costs.len() {
        let count = flips.count_ones() as usize;
        if count < FLIPPED_BITS.len() {
            costs[flips] = FLIPPED_BITS[count];
        }
        flips += 1;
    }
    costs
};

/// The one bits of a byte.
const ONES: [f32; 256] = {
    let mut ones = [0.0; 256];
    let mut byte = 0;
    while byte < ones.len() {
        ones[byte] = byte.count_ones() as f32;
        byte += 1;
    }
    ones
};

/// The best explanation of some bytes as an expected frame.
#[derive(Clone, Debug)]
pub struct Alignment {
    /// Bits in favour of the expected frame.
    pub score: f32,
    /// Bytes from the first one on that the damage explains, to after the last of them: another frame may begin after them.
    pub core_bytes: usize,
    /// Bytes of the expected frame that are missing in front.
    pub missing_head_bytes: usize,
    /// Number of leading bytes that agree without any change.
    pub agreeing_bytes: usize,
    /// Number of bytes that are left of the frame, where its length is known.
    pub length: Option<usize>,
    /// What happened to the frame.
    pub damage: Option<DamageKind>,
    /// The CRC is valid once the damage is corrected.
    pub is_corrected: bool,
    /// All bytes with a known value agree, but the CRC does not.
    pub is_exact: bool,
}

/// What each kind of damage costs, for the prefilter that selects the requests worth an alignment.
pub const DAMAGE_COSTS: DamageCosts =
    DamageCosts { lost_head: MISSING_HEAD_BITS, inside: MISSING_INSIDE_BITS, collision: COLLISION_BITS };

/// The best alignment of an expected frame with bytes that begin where it may begin, if it is worth `need` bits.
pub fn align(model: &TrafficModel, expected: &ExpectedFrame<'_>, bytes: &[u8], need: f32) -> Option<Alignment> {
    // Nearly always the first byte already shows that this many are not missing.
    let may_lack =
        |missing: &usize| *missing == 0 || expected.bytes.get(*missing).is_none_or(|known| bytes.first() == Some(known));
    let counts = (0..=expected.most_missing(bytes.len())).filter(may_lack);
    let alignments = counts.filter_map(|missing| align_without_head(model, expected, bytes, missing, need));
    alignments.max_by(|a, b| a.score.total_cmp(&b.score))
}

/// The best alignment of `bytes` with the expected frame without its first `missing` bytes; `None` if none is worth more than
/// 0 and at least `need` bits. `bytes` begin where the rest of the frame would and may reach beyond its end. If two
/// alignments are worth the same, the one that is tried later is taken (see `Comparison::explain` for the order).
///
/// Where the bytes are in their region is not judged here.
fn align_without_head(
    model: &TrafficModel,
    expected: &ExpectedFrame<'_>,
    bytes: &[u8],
    missing: usize,
    need: f32,
) -> Option<Alignment> {
    let comparison = Comparison::new(model, expected, bytes, missing);
    if comparison.is_hopeless() {
        return None;
    }
    let max_score = comparison.max_score();
    if max_score < need - ROUNDING_BITS {
        return None;
    }
    let mut best: Option<Alignment> = None;
    // Most explanations are worth too little, whatever the CRC adds: it is not computed for these.
    let least = need + expected.selection_cost - comparison.max_crc_bits();
    comparison.explain(least - ROUNDING_BITS, |explanation| {
        let max_score = explanation.score - expected.selection_cost + comparison.max_crc_bits();
        if max_score < need || max_score <= 0.0 {
            return;
        }
        let alignment = comparison.alignment(&explanation);
        let is_enough = alignment.score > 0.0 && alignment.score >= need;
        if is_enough && best.as_ref().is_none_or(|best| alignment.score >= best.score) {
            best = Some(alignment);
        }
    });
    let doubled = comparison.doubled_unknown_byte().filter(|doubled| doubled.score >= need);
    best.into_iter().chain(doubled).max_by(|one, other| one.score.total_cmp(&other.score))
}

/// The rest of an expected frame beside the bytes that it is compared with: the first of `bytes` is compared with the first
/// of `known`.
struct Comparison<'a> {
    model: &'a TrafficModel,
    expected: &'a ExpectedFrame<'a>,
    /// How many bytes the expected frame has in front of `known`: they are not among `bytes`.
    missing: usize,
    /// The known bytes of the expected frame without the first `missing` ones.
    known: &'a [u8],
    /// The bytes of the region, from where the rest of the frame may begin to the region's end.
    bytes: &'a [u8],
    /// How many of `bytes` equal those of `known`, from the first one up to the first difference.
    agreeing: usize,
}

impl<'a> Comparison<'a> {
    fn new(model: &'a TrafficModel, expected: &'a ExpectedFrame<'_>, bytes: &'a [u8], missing: usize) -> Self {
        let known = &expected.bytes[missing..];
        let agreeing = known.iter().zip(bytes).take_while(|(a, b)| a == b).count();
        Self { model, expected, missing, known, bytes, agreeing }
    }

    /// Whether the first bytes agree too little to go on. At nearly all places nothing fits, which has to be noticed with as
    /// little work as possible.
    ///
    /// With bytes missing in front, at least two have to agree (or the one that is known), and not as a run of one value. With
    /// none missing, at least the first has to agree, or nearly all bits of the header.
    fn is_hopeless(&self) -> bool {
        if self.missing == 0 {
            return self.agreeing == 0 && !header_nearly_agrees(self.known, self.bytes);
        }
        let is_run = self.agreeing > 1 && self.bytes[..self.agreeing].iter().all(|&byte| byte == self.bytes[0]);
        is_run || self.agreeing < 2.min(self.known.len())
    }

    /// No alignment has a higher score in bits: no damage makes the compared bytes worth more than their information content.
    fn max_score(&self) -> f32 {
        self.content() - self.expected.selection_cost + self.max_crc_bits()
    }

    /// The information content in bits of the bytes that are compared: one more than is known, since one may be doubled.
    fn content(&self) -> f32 {
        let compared = self.bytes.len().min(self.known.len() + 1);
        self.model.bits_of(&self.bytes[..compared])
    }

    /// The most bits that the CRC can add to those of the known bytes: none where the frame is too long to be there, however
    /// many of its bytes are missing.
    fn max_crc_bits(&self) -> f32 {
        let is_there = self.expected.length.is_some_and(|length| length <= self.bytes.len() + MAX_LOST_BYTES);
        if is_there {
            self.expected.max_crc_bits()
        } else {
            0.0
        }
    }

    /// Emits the ways in which the bytes can be explained, with their scores, in this order: flipped bits alone; then one
    /// break right after the bytes that agree: one, two or three bytes missing, the last one doubled, a collision.
    ///
    /// A break is tried only if no bytes are missing in front, some known bytes agree, and some do not; and only if it may be
    /// worth `least` bits. What it is worth less may be left out.
    fn explain(&self, least: f32, mut give: impl FnMut(Explanation)) {
        let (model, known, bytes, agreeing) = (self.model, self.known, self.bytes, self.agreeing);
        give(without_break(model, known, bytes, self.missing));
        if agreeing == 0 || agreeing == known.len() || self.missing > 0 {
            return;
        }
        let prefix = Prefix { length: agreeing, score: score_with_flips(model, &known[..agreeing], bytes, 0).0 };
        // However many of the other bytes agree, they are worth no more than their information content.
        let most = prefix.score + self.content() - model.bits_of(&bytes[..agreeing]);
        if most - MISSING_INSIDE_BITS >= least {
            for count in 1..=MAX_LOST_BYTES {
                missing_inside(model, known, bytes, prefix, count).into_iter().for_each(&mut give);
            }
        }
        if most - DOUBLED_BYTE_BITS >= least {
            doubled_byte(model, known, bytes, prefix).into_iter().for_each(&mut give);
        }
        if most - COLLISION_BITS >= least {
            collision(model, known, bytes, prefix, most - least).into_iter().for_each(&mut give);
        }
    }

    /// The alignment of a frame whose known bytes all agree and that has one of the others twice: the checksum is right without the
    /// copy.
    fn doubled_unknown_byte(&self) -> Option<Alignment> {
        let whole = self.expected.length.filter(|&whole| self.known.len() < whole && whole < self.bytes.len())?;
        if self.missing > 0 || self.agreeing < self.known.len() || crc_valid(&self.bytes[..whole]) {
            return None;
        }
        let at = doubled_byte_by_crc(&self.bytes[..=whole])?;
        let (score, _) = score_with_flips(self.model, self.known, self.bytes, 0);
        Some(Alignment {
            score: score - self.expected.selection_cost - DOUBLED_BYTE_BITS + CRC_MATCH_BITS,
            core_bytes: whole + 1,
            missing_head_bytes: 0,
            agreeing_bytes: self.agreeing,
            length: Some(whole + 1),
            damage: Some(DamageKind::DoubledByte { at }),
            is_corrected: true,
            is_exact: false,
        })
    }

    /// The alignment of one explanation. Its score is that of the explanation, less what it costs to select this frame, plus
    /// what the CRC adds. A CRC that adds something counts as valid, and confirms all bytes of a frame of known length, those
    /// with unknown values among them.
    fn alignment(&self, explanation: &Explanation) -> Alignment {
        let shortfall = explanation.shortfall();
        let length = self.expected.length.map(|length| length.saturating_add_signed(-shortfall));
        let crc_score = crc_score(self.expected, self.bytes, length, shortfall);
        let is_corrected = crc_score > 0.0;
        Alignment {
            score: explanation.score - self.expected.selection_cost + crc_score,
            core_bytes: explanation.core_bytes.max(if is_corrected { length.unwrap_or(0) } else { 0 }),
            missing_head_bytes: self.missing,
            agreeing_bytes: self.agreeing,
            length,
            damage: explanation.damage,
            is_corrected,
            is_exact: crc_score == 0.0 && self.missing == 0 && self.agreeing == self.known.len(),
        }
    }
}

/// Whether one of unit and function code agrees, and the other differs in a few bits only.
fn header_nearly_agrees(known: &[u8], bytes: &[u8]) -> bool {
    let flips = || known.iter().zip(bytes).take(2).map(|(a, b)| (a ^ b).count_ones());
    bytes.len() >= 3 && flips().any(|flips| flips == 0) && flips().sum::<u32>() <= MAX_HEADER_FLIPS
}

/// The leading bytes that agree without any change, and the bits they are worth.
#[derive(Clone, Copy)]
struct Prefix {
    length: usize,
    score: f32,
}

/// One kind of damage that would explain how the bytes differ from the known ones.
struct Explanation {
    /// Bits of the bytes that agree, less what the damage costs.
    score: f32,
    /// Bytes from the first one on that it explains, to after the last of them.
    core_bytes: usize,
    /// What happened; `None` for flipped bits alone.
    damage: Option<DamageKind>,
}

impl Explanation {
    /// How many bytes of the expected frame are not there: -1 if one of them is there twice.
    fn shortfall(&self) -> isize {
        match self.damage {
            Some(DamageKind::LostBytes { count, .. }) => count as isize,
            Some(DamageKind::DoubledByte { .. }) => -1,
            _ => 0,
        }
    }
}

/// Explains the bytes by flipped bits only, with or without bytes missing in front.
fn without_break(model: &TrafficModel, known: &[u8], bytes: &[u8], missing: usize) -> Explanation {
    let (score, core_bytes) = score_with_flips(model, known, bytes, 0);
    let damage = (missing > 0).then_some(DamageKind::LostBytes { at: 0, count: missing });
    Explanation { score: if missing > 0 { score - MISSING_HEAD_BITS } else { score }, core_bytes, damage }
}

/// Compares bytes one by one and allows for flipped bits. Returns the highest score that any number of leading bytes
/// reaches, and the index after those bytes, where the first byte has the index `from`.
fn score_with_flips(model: &TrafficModel, known: &[u8], bytes: &[u8], from: usize) -> (f32, usize) {
    let (mut score, mut best) = (0.0, (0.0, 0));
    for (at, (&wanted, &byte)) in known.iter().zip(bytes).enumerate() {
        let flips = wanted ^ byte;
        let cost = COST_OF_FLIPS[usize::from(flips)];
        if cost.is_infinite() {
            break;
        }
        // In a run of one value, each byte but the first was to be expected and proves little.
        let continues_run = at > 0 && known[at - 1] == wanted && flips == 0;
        score += if continues_run { RUN_BYTE_BITS } else { model.bits(byte) - cost };
        if score > best.0 && flips == 0 {
            best = (score, from + at + 1);
        }
        if score < best.0 - MAX_SCORE_DROP_BITS {
            break;
        }
    }
    best
}

/// Explains the bytes by `count` bytes that are missing after the prefix.
fn missing_inside(model: &TrafficModel, known: &[u8], bytes: &[u8], prefix: Prefix, count: usize) -> Option<Explanation> {
    let rest = known.get(prefix.length + count..)?;
    let (score, core_bytes) = score_with_flips(model, rest, &bytes[prefix.length..], prefix.length);
    let score = prefix.score + score - MISSING_INSIDE_BITS;
    let damage = Some(DamageKind::LostBytes { at: prefix.length, count });
    // If no known byte is left after the loss, only the CRC can confirm it.
    (core_bytes > prefix.length || rest.is_empty()).then_some(Explanation { score, core_bytes, damage })
}

/// Explains the bytes by a repetition of the last byte of the prefix.
fn doubled_byte(model: &TrafficModel, known: &[u8], bytes: &[u8], prefix: Prefix) -> Option<Explanation> {
    let at = prefix.length;
    if bytes.get(at) != bytes.get(at - 1) {
        return None;
    }
    let (score, core_bytes) = score_with_flips(model, &known[at..], bytes.get(at + 1..)?, at + 1);
    let score = prefix.score + score - DOUBLED_BYTE_BITS;
    (core_bytes > at + 1).then_some(Explanation { score, core_bytes, damage: Some(DamageKind::DoubledByte { at }) })
}

/// Explains the bytes by a second transmitter after the prefix. On RS-485 the driver that pulls to 0 wins: bits that
/// were sent as 1 may arrive as 0, but no bit that was sent as 0 arrives as 1.
///
/// Also `None` as soon as more than `bits_to_lose` of the bytes' information content are lost: the score would be too low.
fn collision(model: &TrafficModel, known: &[u8], bytes: &[u8], prefix: Prefix, bits_to_lose: f32) -> Option<Explanation> {
    let mut score = prefix.score - COLLISION_BITS;
    let mut spare = bits_to_lose - COLLISION_BITS;
    let mut core_bytes = prefix.length;
    let mut wrong_bytes = 0;
    for (&wanted, &byte) in known.iter().zip(bytes).skip(prefix.length) {
        let content = model.bits(byte);
        if byte & !wanted == 0 {
            // A byte pays for each of its ones, because each might have been pulled to 0.
            let ones = ONES[usize::from(wanted)];
            score += content - ones - COLLISION_BYTE_BITS;
            spare -= ones + COLLISION_BYTE_BITS;
            wrong_bytes += usize::from(byte != wanted);
        } else {
            score -= COLLISION_MISFIT_BITS;
            spare -= content + COLLISION_MISFIT_BITS;
        }
        if spare < -ROUNDING_BITS {
            return None;
        }
        core_bytes += 1;
    }
    (wrong_bytes > 1).then_some(Explanation { score, core_bytes, damage: Some(DamageKind::Collision { at: prefix.length }) })
}

/// Bits that the CRC adds once the damage of the known bytes is corrected.
///
/// `length`: bytes that are left of the frame. `shortfall`: bytes of the known part that are missing, -1 if one is there
/// twice. Nothing is added if the CRC is itself among the known bytes, because `score_with_flips` has counted it.
fn crc_score(expected: &ExpectedFrame<'_>, bytes: &[u8], length: Option<usize>, shortfall: isize) -> f32 {
    let known = expected.bytes.len();
    let known_end = known.saturating_add_signed(-shortfall);
    let is_there = |&length: &usize| length >= 4 && length <= bytes.len() && known_end <= length;
    let Some(length) = length.filter(is_there) else { return 0.0 };
    if expected.length.is_some_and(|whole| whole <= known) {
        return 0.0;
    }
    // The CRC over the known bytes as they were sent and the unknown bytes as they came.
    if update(crc16(&expected.bytes), &bytes[known_end..length]) == 0 {
        return CRC_MATCH_BITS;
    }
    if shortfall == 0 && correctable_bit(&bytes[..length]).is_some() {
        (CRC_CORRECTABLE_BITS - (8.0 * length as f32).log2()).max(0.0)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::damage::expected_frame::poll_request;
    use crate::rtu_model::prefilter::{Need, RequestPrefilter};
    use crate::weights::POLL_REQUEST_BITS;
    use proptest::prelude::*;

    /// A frame damaged in one of five ways: bytes removed, one doubled, bits flipped, bits pulled to 0, or not at all.
    fn damaged(frame: &[u8], how: u8, at: usize, bits: u8) -> Vec<u8> {
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
        fn the_prefilter_keeps_every_request_that_aligns(
            body in proptest::collection::vec(prop_oneof![4 => 0u8..5, 1 => any::<u8>()], 3..7),
            how in 0u8..5,
            at in any::<usize>(),
            bits in any::<u8>(),
            behind in proptest::collection::vec(0u8..5, 0..6),
        ) {
            let frame = [&body[..], &crc16(&body).to_le_bytes()].concat();
            let bytes = [damaged(&frame, how, at, bits), behind].concat();
            let model = TrafficModel::default();
            let Some(alignment) = align(&model, &poll_request(&frame), &bytes, 0.0) else { return Ok(()) };
            let mut sift = RequestPrefilter::default();
            sift.add(5, &frame);
            let need = alignment.score + POLL_REQUEST_BITS;
            let bits_needed = need;
            let need = Need { less: bits_needed, of_these: 1 << 5, more: f32::MAX };
            let kept = sift.likely(1 << 5, &bytes, |byte| model.bits(byte), need, &DAMAGE_COSTS);
            prop_assert_eq!(kept, 1 << 5, "{:02x?} in {:02x?}: {:?}", frame, bytes, alignment);
            let other = Need { less: bits_needed - 4.0, of_these: 1 << 3, more: bits_needed };
            let kept = sift.likely(1 << 5, &bytes, |byte| model.bits(byte), other, &DAMAGE_COSTS);
            prop_assert_eq!(kept, 1 << 5, "as one of the others");
        }
    }

    proptest! {
        #[test]
        fn what_is_not_enough_is_left_out_and_all_else_is_the_same(
            body in proptest::collection::vec(prop_oneof![4 => 0u8..5, 1 => any::<u8>()], 3..20),
            how in 0u8..5,
            at in any::<usize>(),
            bits in any::<u8>(),
            behind in proptest::collection::vec(0u8..5, 0..6),
            known in 2usize..24,
            need in -5.0f32..60.0,
        ) {
            let frame = [&body[..], &crc16(&body).to_le_bytes()].concat();
            let bytes = [damaged(&frame, how, at, bits), behind].concat();
            let model = TrafficModel::default();
            let request = poll_request(&frame[..known.min(frame.len())]);
            let expected = ExpectedFrame { length: Some(frame.len()), ..request };
            // The oracle: everything is tried, whatever it is worth.
            let best = align(&model, &expected, &bytes, -1000.0).filter(|best| best.score >= need);
            prop_assert_eq!(format!("{:?}", align(&model, &expected, &bytes, need)), format!("{best:?}"));
        }
    }

    #[test]
    fn a_frame_with_wrong_unit_and_wrong_function_is_not_recognised() {
        // One bit is lost in each of the two; the prefilter needs one of them to be right.
        let alignment = align(&TrafficModel::default(), &poll_request(&[3, 3, 2, 0, 0xF1]), &[2, 2, 2, 0, 0x70], 0.0);
        assert!(alignment.is_none(), "{alignment:?}");
    }
}
