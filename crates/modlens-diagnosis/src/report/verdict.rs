//! One sentence first: healthy, works with trouble, broken, or not to be judged, and why.

use modlens_engine::records::DiagnosisRow;
use modlens_protocol::finding::Severity;
use modlens_protocol::framing::Verdict as FrameVerdict;

use super::sentences::thousands;
use crate::claim::{percent, ACCIDENT};
use crate::contrast::BusContrast;
use crate::statistics::{at_least, least_rate, Share};
use crate::MAX_CHANCE;

/// The verdict on a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Healthy,
    Trouble,
    Broken,
    Unknown,
}

impl Verdict {
    /// The word in JSON.
    pub(super) fn text(self) -> &'static str {
        match self {
            Self::Healthy => "healthy",
            Self::Trouble => "trouble",
            Self::Broken => "broken",
            Self::Unknown => "unknown",
        }
    }
}

/// Fewer requests than these make no line healthy.
const FEW: u64 = 10;

/// The verdict and its sentence; `rows` are the diagnoses, the worst first.
pub(super) fn verdict(buses: &[(&str, BusContrast)], rows: &[DiagnosisRow]) -> (Verdict, String) {
    let share = buses.iter().fold(Share::default(), |sum, (_, bus)| sum.with(bus.requests_seen.share()));
    let bytes = |verdict: FrameVerdict| -> u64 { buses.iter().map(|(_, bus)| bus.frames.bytes[verdict as usize]).sum() };
    let worst = rows.first().filter(|row| row.severity != Severity::Info);
    let numbers = format!("{} of {} requests failed", thousands(share.failed), thousands(share.total));
    let what = if buses.len() == 1 { "This line" } else { "What was recorded" };
    if let Some(worst) = worst {
        let cause = format!("{}: {}", rest(rows), worst.sentence);
        if share.total == 0 || least_rate(share) > 0.3 {
            return (Verdict::Broken, format!("{what} is broken: {numbers}. {cause}"));
        }
        return (Verdict::Trouble, format!("{what} works with trouble: {numbers}. {cause}"));
    }
    if share.total == 0 && bytes(FrameVerdict::Noise) > bytes(FrameVerdict::Ok) {
        let count = thousands(bytes(FrameVerdict::Noise));
        return (Verdict::Unknown, format!("This recording cannot be judged: {count} bytes, and no request among them."));
    }
    if share.total < FEW {
        let count = thousands(share.total);
        return (Verdict::Unknown, format!("This recording cannot be judged: {count} requests are too few."));
    }
    if share.failed > 0 && at_least(share, ACCIDENT) < MAX_CHANCE {
        let text = format!("{what} works with trouble: {numbers}, and nothing that was looked for explains it.");
        return (Verdict::Trouble, text);
    }
    let answered = share.total - share.failed;
    let text = format!(
        "{what} is healthy: {} of {} requests were answered ({}).",
        thousands(answered),
        thousands(share.total),
        percent(1.0 - share.rate())
    );
    (Verdict::Healthy, text)
}

fn rest(rows: &[DiagnosisRow]) -> &'static str {
    match rows.iter().filter(|row| row.severity != Severity::Info).count() {
        1 => "The cause",
        _ => "The first of several causes",
    }
}
