//! Findings on the times of a frame: the silences before and inside it, and the clock.

use crate::findings::{words, Found};
use crate::framer::silence::SilenceRule;
use crate::input::Input;
use crate::transactions::transaction::ObservedFrame;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// With single-byte reads and a rule, silences are compared only if t1.5 is at least this many steps of the clock.
const MIN_STEPS_PER_T15: Ns = 4;

/// t1.5 at the slowest rate in use, 1200 baud: where the line settings are not known, a longer silence inside a frame is too long
/// at every rate.
const LONGEST_T15_NS: Ns = 13_750_000;

/// Times of reads of several bytes that lie closer together than this may be in any order.
const MIN_READ_STEPS: Ns = 3;

/// Compares the silences of a good RTU frame, with or without checksum, with those of the specification (serial line, 2.5.1.1)
/// or of the user. The frame is at the head of the input; `resolution` is the step of the clock in ns.
///
/// If every read of the line had one byte and there is a `rule`, two findings are possible: the silence before the frame is
/// shorter than t3.5, or the longest silence inside the frame is longer than t1.5. Nothing is compared if t1.5 is less than
/// `MIN_STEPS_PER_T15` steps of the clock.
///
/// If any read had several bytes, the times of single bytes are not known. Without a `rule`, the line settings are not known, and
/// t1.5 is `LONGEST_T15_NS`. In both cases the silence before the frame is not compared, and of a silence inside it only the part
/// counts that its sender must have made. It is a finding if it is longer than t1.5. It is the larger of two lengths:
///
/// - `proven`, in ns, by the habit of the sender (`InnerPauses`);
/// - the longest silence that neither adapter nor host can have made (`longest_sent_pause`), if it is longer than
///   `MIN_READ_STEPS` steps of the clock.
pub(crate) fn silences(
    input: &Input,
    rule: Option<SilenceRule>,
    (resolution, proven): (Ns, Option<Ns>),
    frame: &ObservedFrame<'_>,
    found: &mut Found,
) {
    if frame.mode != Mode::Rtu || !frame.verdict.is_good() || !input.has_times {
        return;
    }
    let t15 = rule.map_or(LONGEST_T15_NS, |rule| rule.t15_ns);
    if input.has_multibyte_reads || rule.is_none() {
        let sent = input.longest_sent_pause(frame.wire.len()).filter(|&silence| silence > MIN_READ_STEPS * resolution);
        let silence = sent.max(proven).filter(|&silence| silence > t15);
        found.extend(silence.map(|silence| (Finding::GapInFrame, words::gap_inside_at_least(silence, t15, frame))));
        return;
    }
    if MIN_STEPS_PER_T15 * resolution > t15 {
        return;
    }
    let is_short = |rule: SilenceRule| input.pause_before(0).filter(|&silence| silence < rule.t35_ns).zip(Some(rule.t35_ns));
    if let Some((silence, t35)) = rule.and_then(is_short) {
        found.push((Finding::ShortSilence, words::short_silence(silence, t35)));
    }
    if let Some(silence) = input.longest_pause(0, frame.wire.len()).filter(|&silence| silence > t15) {
        found.push((Finding::GapInFrame, words::gap_in_frame(silence, t15, frame)));
    }
}

/// Whether one of these findings is a silence before the frame that is too short to stand between two frames.
pub(crate) fn has_short_silence(codes: &[Finding]) -> bool {
    codes.contains(&Finding::ShortSilence)
}

/// Finds a clock that went back with the reads of a frame.
#[inline]
pub(crate) fn clock(jumped: bool, found: &mut Found) {
    if jumped {
        found.push((Finding::ClockJumped, words::clock_jumped()));
    }
}
