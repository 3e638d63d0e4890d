//! Findings on the times of a frame: the silences before and inside it, and the clock.

use crate::findings::{words, Found};
use crate::framer::silence::SilenceRule;
use crate::input::Input;
use crate::transactions::transaction::ObservedFrame;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// The clock must be so many times finer than t1.5 before silences are compared with it.
const MIN_STEPS_PER_T15: Ns = 4;

/// t1.5 at the slowest rate in use, 1200 baud: where the line settings are not known, a longer silence inside a frame is too long
/// at every rate.
const LONGEST_T15_NS: Ns = 13_750_000;

/// Times of reads of several bytes that lie closer together than this may be in any order.
const MIN_READ_STEPS: Ns = 3;

/// Compares the silences of a good RTU frame with those of the specification (serial line, 2.5.1.1), or with those that the
/// user gave. It is the first in the input; `resolution` is the step of the clock in ns.
///
/// A silence before it that is shorter than t3.5, and the longest one inside it if that is longer than t1.5, are findings.
/// Without a `rule`, the line settings are unknown, and only a silence inside that is too long at every rate is one. Nothing is
/// compared where the clock is too coarse: where t1.5 is less than four of its steps. If any read of the line had several bytes,
/// whose own times are not known, the silence before the frame is not measured; one inside is a finding if it is `proven` (ns) by
/// the habit of its sender, or if later bytes of the frame show that adapter and host cannot have made it.
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

/// Finds a clock that went back with the reads of a frame.
#[inline]
pub(crate) fn clock(jumped: bool, found: &mut Found) {
    if jumped {
        found.push((Finding::ClockJumped, words::clock_jumped()));
    }
}
