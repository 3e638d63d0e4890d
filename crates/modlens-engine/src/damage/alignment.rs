//! How well bytes fit an expected frame when flipped bits, missing bytes, a doubled byte and collisions are allowed for.
//!
//! Each kind of damage has a cost in bits, each byte that agrees gains the information content of its value. The kind
//! with the highest total is the alignment. Example: the expected request is `11 03 00 6B 00 03 76 87`, the bytes are
//! `11 03 6B 00 03 76 87`. The first two bytes agree; with one byte missing behind them the other five agree, too, and
//! are worth far more than `MISSING_INSIDE_BITS`. So one byte is missing at index 2.

use crate::damage::expected_frame::ExpectedFrame;
use crate::damage::kind::DamageKind;
use crate::framer::rtu::prefilter::DamageCosts;
use crate::framer::rtu::prefix_index::MAX_LOST_BYTES;
use crate::framer::rtu::traffic_model::TrafficModel;
use crate::weights::{
    COLLISION_BITS, COLLISION_MISFIT_BITS, CRC_CORRECTABLE_BITS, CRC_MATCH_BITS, DOUBLED_BYTE_BITS, MAX_HEADER_FLIPS,
    MAX_SCORE_DROP_BITS, MISSING_HEAD_BITS, MISSING_INSIDE_BITS, ONE_FLIP_BITS, ROUNDING_BITS, RUN_BYTE_BITS, THREE_FLIPS_BITS,
    TWO_FLIPS_BITS,
};
use modlens_protocol::checksum::{correctable_bit, crc16, update};

/// Cost of a byte by the number of its flipped bits.
const FLIPPED_BITS: [f32; 4] = [0.0, ONE_FLIP_BITS, TWO_FLIPS_BITS, THREE_FLIPS_BITS];

/// The best explanation of some bytes as an expected frame.
#[derive(Clone, Debug)]
pub struct Alignment {
    /// Bits in favour of the expected frame.
    pub score: f32,
    /// Bytes from the first one to behind the last one that agrees: another frame may begin behind them.
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
    // If all known bytes are missing, only the CRC is left to recognise the frame by, and that takes a known length.
    let known = expected.bytes.len() - usize::from(expected.length.is_none());
    let max_missing = MAX_LOST_BYTES.min(known);
    let alignments = (0..=max_missing).filter_map(|missing| align_without_head(model, expected, bytes, missing, need));
    alignments.max_by(|a, b| a.score.total_cmp(&b.score))
}

/// The best alignment of `bytes` with the expected frame without its first `missing` bytes; `None` if none is worth more than
/// 0 and at least `need` bits. `bytes` begin where the frame would and may reach beyond its end.
///
/// Flipped bits are always allowed for. One break behind the leading bytes that agree (up to three bytes missing, the last
/// one doubled, or a collision) is tried as well, but only with nothing missing in front, where some known bytes agree and
/// some do not, and where even the cheapest break leaves enough bits. A score is that of the bytes less what it costs to
/// select this frame, plus what the CRC adds. Where the bytes stand in their region is not judged here.
fn align_without_head(
    model: &TrafficModel,
    expected: &ExpectedFrame<'_>,
    bytes: &[u8],
    missing: usize,
    need: f32,
) -> Option<Alignment> {
    let known = &expected.bytes[missing..];
    let agreeing = known.iter().zip(bytes).take_while(|(a, b)| a == b).count();
    // At nearly all places nothing fits, which has to be noticed with as little work as possible. With bytes missing in
    // front, two have to agree, and not as a run of one value; else the first byte, or nearly all bits of the header.
    let is_run = agreeing > 1 && bytes[..agreeing].iter().all(|&byte| byte == bytes[0]);
    let is_hopeless =
        if missing > 0 { is_run || agreeing < 2.min(known.len()) } else { agreeing == 0 && !header_nearly_agrees(known, bytes) };
    if is_hopeless {
        return None;
    }
    // An upper bound: no damage makes the bytes that agree worth more than this. One more byte than is known may count, for
    // a doubled one.
    let bytes_compared = bytes.len().min(known.len() + 1);
    let max_score: f32 = model.bits_of(&bytes[..bytes_compared]) - expected.selection_cost + expected.max_crc_bits();
    if max_score < need - ROUNDING_BITS {
        return None;
    }
    let may_have_break = agreeing > 0 && agreeing < known.len() && missing == 0 && max_score - COLLISION_BITS >= need;
    let agreeing_score = if may_have_break { score_with_flips(model, &known[..agreeing], bytes, 0).0 } else { 0.0 };
    let prefix = Prefix { length: agreeing, score: agreeing_score };
    let losses =
        (1..=MAX_LOST_BYTES).filter(|_| may_have_break).filter_map(|count| missing_inside(model, known, bytes, prefix, count));
    let breaks = [doubled_byte, collision].into_iter().filter(|_| may_have_break);
    let others = breaks.filter_map(|explain| explain(model, known, bytes, prefix));
    let unbroken = std::iter::once(without_break(model, known, bytes, missing));
    let alignments = unbroken.chain(losses).chain(others).map(|explanation| {
        // Bytes of the expected frame that are not there; -1 if one is there twice.
        let shortfall = match explanation.damage {
            Some(DamageKind::LostBytes { count, .. }) => count as isize,
            Some(DamageKind::DoubledByte { .. }) => -1,
            _ => 0,
        };
        let length = expected.length.map(|length| length.saturating_add_signed(-shortfall));
        let crc_score = crc_score(expected, bytes, length, shortfall);
        let is_corrected = crc_score > 0.0;
        // A valid CRC confirms all bytes of the frame, those that were not known among them.
        let core_bytes = if is_corrected { explanation.core_bytes.max(length.unwrap_or(0)) } else { explanation.core_bytes };
        Alignment {
            score: explanation.score - expected.selection_cost + crc_score,
            core_bytes,
            missing_head_bytes: missing,
            agreeing_bytes: agreeing,
            length,
            damage: explanation.damage,
            is_corrected,
            is_exact: crc_score == 0.0 && missing == 0 && agreeing == known.len(),
        }
    });
    alignments.filter(|alignment| alignment.score > 0.0 && alignment.score >= need).max_by(|a, b| a.score.total_cmp(&b.score))
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
    score: f32,
    core_bytes: usize,
    damage: Option<DamageKind>,
}

/// Explains the bytes by flipped bits only, with or without bytes missing in front.
fn without_break(model: &TrafficModel, known: &[u8], bytes: &[u8], missing: usize) -> Explanation {
    let (score, core_bytes) = score_with_flips(model, known, bytes, 0);
    let damage = (missing > 0).then_some(DamageKind::LostBytes { at: 0, count: missing });
    Explanation { score: if missing > 0 { score - MISSING_HEAD_BITS } else { score }, core_bytes, damage }
}

/// Compares bytes one by one and allows for flipped bits. Returns the highest score that any number of leading bytes
/// reaches, and the index behind those bytes, where the first byte has the index `from`.
fn score_with_flips(model: &TrafficModel, known: &[u8], bytes: &[u8], from: usize) -> (f32, usize) {
    let (mut score, mut best) = (0.0, (0.0, 0));
    for (at, (&wanted, &byte)) in known.iter().zip(bytes).enumerate() {
        let flips = (wanted ^ byte).count_ones() as usize;
        let Some(&cost) = FLIPPED_BITS.get(flips) else { break };
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

/// Explains the bytes by `count` bytes that are missing behind the prefix.
fn missing_inside(model: &TrafficModel, known: &[u8], bytes: &[u8], prefix: Prefix, count: usize) -> Option<Explanation> {
    let rest = known.get(prefix.length + count..)?;
    let (score, core_bytes) = score_with_flips(model, rest, &bytes[prefix.length..], prefix.length);
    let score = prefix.score + score - MISSING_INSIDE_BITS;
    let damage = Some(DamageKind::LostBytes { at: prefix.length, count });
    // If no known byte is left behind the loss, only the CRC can confirm it.
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

/// Explains the bytes by a second transmitter behind the prefix. On RS-485 the driver that pulls to 0 wins: bits that
/// were sent as 1 may arrive as 0, but no bit that was sent as 0 arrives as 1.
fn collision(model: &TrafficModel, known: &[u8], bytes: &[u8], prefix: Prefix) -> Option<Explanation> {
    let mut score = prefix.score - COLLISION_BITS;
    let mut core_bytes = prefix.length;
    let mut wrong_bytes = 0;
    for (&wanted, &byte) in known.iter().zip(bytes).skip(prefix.length) {
        if byte & !wanted == 0 {
            // A byte pays for each of its ones, because each might have been pulled to 0.
            score += model.bits(byte) - wanted.count_ones() as f32 - 0.5;
            wrong_bytes += usize::from(byte != wanted);
        } else {
            score -= COLLISION_MISFIT_BITS;
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
    match correctable_bit(&bytes[..length]) {
        Some(_) if shortfall == 0 => (CRC_CORRECTABLE_BITS - (8.0 * length as f32).log2()).max(0.0),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::damage::expected_frame::poll_request;
    use crate::framer::rtu::prefilter::RequestPrefilter;
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
            body in proptest::collection::vec(0u8..5, 3..7),
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
            let kept = sift.likely(1 << 5, &bytes, |byte| model.bits(byte), need, &DAMAGE_COSTS);
            prop_assert_eq!(kept, 1 << 5, "{:02x?} in {:02x?}: {:?}", frame, bytes, alignment);
        }
    }

    #[test]
    fn a_frame_with_wrong_unit_and_wrong_function_is_not_recognised() {
        // One bit is lost in each of the two; the prefilter needs one of them to be right.
        let alignment = align(&TrafficModel::default(), &poll_request(&[3, 3, 2, 0, 0xF1]), &[2, 2, 2, 0, 0x70], 0.0);
        assert!(alignment.is_none(), "{alignment:?}");
    }
}
