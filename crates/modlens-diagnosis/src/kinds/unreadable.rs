//! Lines on which nothing can be read.

use modlens_engine::line_search::is_slower;

use crate::claim::View;
use crate::contrast::{Seen, Symptom, UnitCounts};
use crate::observation::DamagedPart;
use crate::statistics::Share;

/// Fewer bytes of noise say nothing.
pub(super) const LEAST_BYTES: u64 = 50;

/// Bytes of the recording by frame: those of good frames, and those of all others. A frame that may be an accident of noise is
/// none of the good ones: among bytes that are no Modbus there is one now and then, and it may be long.
pub(super) fn bytes(view: &View<'_>) -> (u64, u64) {
    let frames = &view.bus.frames;
    let all = frames.bytes.iter().sum::<u64>();
    // Noise makes a short frame now and then, but no long one out of most of its bytes.
    let is_accident = frames.unconfirmed_bytes * 2 <= all || frames.longest_unconfirmed < BEYOND_ACCIDENT;
    let good = frames.good_bytes() - if is_accident { frames.unconfirmed_bytes } else { 0 };
    (good, all - good)
}

/// A frame of so many bytes, with its length and its checksum, is no coincidence.
const BEYOND_ACCIDENT: u64 = 16;

/// Whether nothing on the line can be read.
pub(super) fn is_unreadable(view: &View<'_>) -> bool {
    let (good, other) = bytes(view);
    let is_lost = good * 20 < other && !fit_but_for_their_edge(view);
    view.bus.facts.is_line() && other >= LEAST_BYTES && (is_lost || only_requests_are_valid(view))
}

/// Whether every request was sent well and none was answered in bytes that make sense: the log of a client.
pub(super) fn only_requests_are_valid(view: &View<'_>) -> bool {
    let requests = view.bus.requests_seen.share();
    let came = view.bus.noise.ends_in_zero.total + view.bus.noise.strays.total;
    let echoes: u64 = view.bus.units.values().map(|counts| counts.echoes.failed).sum();
    requests.total >= 5
        && requests.failed * 10 >= requests.total * 9
        && came * 10 > requests.total * 8
        && echoes * 2 < came
        && !fit_but_for_their_edge(view)
}

/// Whether most bad answers fit their checksum but for the first or the last byte, or are whole but for the checksum: whoever
/// recorded them reads the line well.
fn fit_but_for_their_edge(view: &View<'_>) -> bool {
    let edges = |counts: &UnitCounts| Share {
        failed: counts.damaged(DamagedPart::Start) + counts.damaged(DamagedPart::End),
        total: counts.garbled.failed,
    };
    let sum: Share = view.units().map(|(_, counts)| edges(counts)).sum();
    let is_bare = |(symptom, _, _): &(Symptom, Option<u8>, &Seen)| *symptom == Symptom::AnswerBare;
    let bare: u64 = view.bus.symptoms.all().filter(is_bare).map(|(_, _, seen)| seen.all.failed).sum();
    (sum.failed + bare) * 2 > sum.total
}

/// Whether nothing can be read, and the bytes look like those of a line that is slower than the receiver.
pub(super) fn is_of_slower_line(view: &View<'_>) -> bool {
    let bytes: Vec<u8> = view.bus.noise.bursts.kept.iter().flatten().copied().collect();
    is_unreadable(view) && !only_requests_are_valid(view) && is_slower(&bytes)
}
