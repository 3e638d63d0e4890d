//! Findings on the times of a frame: the silences before and inside it, and the clock.

use crate::findings::{words, Found};
use crate::framer::silence::SilenceRule;
use crate::input::Input;
use crate::pairing::transaction::ObservedFrame;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// The clock must be so many times finer than t1.5 before silences are compared with it.
const MIN_STEPS_PER_T15: Ns = 4;

/// Compares the silences of a good RTU frame with those of the specification (serial line, 2.5.1.1), or with those that the
/// user gave. It stands at the head of the input; `resolution` is the step of the clock in ns.
///
/// A silence before it that is shorter than t3.5, and the longest one inside it if that is longer than t1.5, are findings.
/// Nothing is compared without a `rule`, which means that the line settings are unknown, nor where the clock is too coarse: where
/// t1.5 is less than four of its steps. If any read of the line had several bytes, whose own times are not known, neither
/// silence is measured; a finding then is only `proven` (ns), a silence inside the frame that cannot have come about on the
/// way to the tap, if it is longer than t1.5.
pub(crate) fn silences(
    input: &Input,
    rule: Option<SilenceRule>,
    (resolution, proven): (Ns, Option<Ns>),
    frame: &ObservedFrame<'_>,
    found: &mut Found,
) {
    let Some(rule) = rule.filter(|_| frame.mode == Mode::Rtu && frame.verdict.is_good()) else { return };
    if input.has_multibyte_reads {
        let proven = proven.filter(|&silence| silence > rule.t15_ns);
        found.extend(proven.map(|silence| (Finding::GapInFrame, words::gap_inside_at_least(silence, rule.t15_ns))));
        return;
    }
    if MIN_STEPS_PER_T15 * resolution > rule.t15_ns {
        return;
    }
    if let Some(silence) = input.pause_before(0).filter(|&silence| silence < rule.t35_ns) {
        found.push((Finding::ShortSilence, words::short_silence(silence, rule.t35_ns)));
    }
    if let Some(silence) = input.longest_pause(0, frame.wire.len()).filter(|&silence| silence > rule.t15_ns) {
        found.push((Finding::GapInFrame, words::gap_in_frame(silence, rule.t15_ns)));
    }
}

/// Finds a clock that went back with the reads of a frame.
#[inline]
pub(crate) fn clock(jumped: bool, found: &mut Found) {
    if jumped {
        found.push((Finding::ClockJumped, words::clock_jumped()));
    }
}
