//! Noise that comes after writes: what a write switches (a contactor, a pump, a drive) disturbs the line.

use std::rc::Rc;

use crate::claim::{Claim, ShownBy, View};
use crate::contrast::tally::Tally;
use crate::contrast::{AfterWrite, UnitCounts};
use crate::observation::WriteKey;
use crate::statistics::{at_least, fisher, Share};
use modlens_protocol::finding::Severity;
use modlens_protocol::framing::Verdict;

/// So many bursts after writes are no accident.
const LEAST_BURSTS: u64 = 5;

/// Claims that bursts of noise come after writes, whether that costs a request or not. Recognized once for all kinds.
pub(super) fn noise_of_writes_once(view: &View<'_>) -> Rc<[Claim]> {
    view.once("noise of writes", |view| noise_of_writes(view).into_iter().collect())
}

/// Returns the claim that noise comes after writes: of one register or coil where nearly all of it does, else of all that is written.
fn noise_of_writes(view: &View<'_>) -> Option<Claim> {
    let [elsewhere, behind] = view.bus.noise.by_write;
    let frames = &view.bus.frames;
    let good = frames.of(Verdict::Ok) + frames.of(Verdict::NoChecksum);
    let of_one = of_one_write(view);
    let (behind, frames_behind) =
        of_one.map_or((behind, frames.behind_writes), |write| (write.counts.bursts, write.counts.frames));
    let bursts = Share { failed: behind, total: elsewhere + view.bus.noise.by_write[1] };
    if behind < LEAST_BURSTS || behind * 10 < bursts.total * 7 || view.bus.facts.is_network {
        return None;
    }
    let chance = view.significant(at_least(bursts, frames_behind as f64 / good.max(1) as f64))?;
    // In a fixed cycle it may be the request after the write that fails, wherever it stands.
    let written: Share = view.units().map(|(_, counts)| counts.by_write[1]).sum();
    let has_contrast =
        |counts: &UnitCounts| counts.by_write[1].failed > 0 && fisher(counts.by_write[1], counts.by_write[0]) < 0.01;
    let is_told_from_others = of_one.is_some_and(|write| write.is_told_from_others);
    if written.failed > 0 && !is_told_from_others && !view.units().any(|(_, counts)| has_contrast(counts)) {
        return None;
    }
    let tally: Tally = view.units().flat_map(|(_, counts)| [&counts.garbled, &counts.bad_requests]).sum();
    let mut claim = Claim::new("line_noise", &tally, chance).with_share(bursts).shown_by(ShownBy::AllUnits);
    claim = claim.in_the_time_of(&Claim::new("line_noise", &view.bus.requests_seen, 0.0));
    claim.harm = written.failed;
    if let Some(write) = of_one {
        claim = claim.of_unit(write.key.unit).at(write.key.function, write.key.address);
    }
    Some(
        claim
            .at_most(if written.failed > 0 { Severity::Error } else { Severity::Warning })
            .fact("what", format!("{behind} of {} bursts of noise come right after writes{}", bursts.total, of_writes(view)))
            .fact("event_check", "What the write switches (a contactor, a pump, an inverter): a suppressor at its coil, and its cables beside the line. Then: ")
            .fact("event_proof", "Disconnect what the write switches, and write: the noise is gone. Otherwise: "),
    )
}

/// The write after which nearly all noise comes.
#[derive(Clone, Copy)]
struct OneWrite {
    key: WriteKey,
    counts: AfterWrite,
    /// After other writes, it comes more rarely.
    is_told_from_others: bool,
}

/// Returns the write after which nearly all noise comes that comes after writes, if it is the only one or comes more rarely after
/// the others.
fn of_one_write(view: &View<'_>) -> Option<OneWrite> {
    let (key, counts) = view.bus.noise.after_writes.noisiest()?;
    let others = view.bus.noise.after_writes.without(key);
    let share = |counts: AfterWrite| Share { failed: counts.bursts.min(counts.frames), total: counts.frames };
    let is_told_from_others = others.frames > 0 && fisher(share(counts), share(others)) < 0.01;
    let is_nearly_all = counts.bursts * 10 >= view.bus.noise.by_write[1] * 9;
    (is_nearly_all && (others.frames == 0 || is_told_from_others)).then_some(OneWrite { key, counts, is_told_from_others })
}

/// Returns after which writes noise comes, in words: those of one register or coil, or of one unit.
fn of_writes(view: &View<'_>) -> String {
    if let Some(OneWrite { key, .. }) = of_one_write(view) {
        let what = if matches!(key.function, 5 | 15) { "coil" } else { "register" };
        return format!(" of {what} {} to unit {} (function {})", key.address, key.unit, key.function);
    }
    view.bus.noise.after_writes.only_unit().map_or(String::new(), |unit| format!(" to unit {unit}"))
}

/// Returns how often requests fail right after writes, if that is more often than elsewhere.
pub(super) fn failures_after_writes(view: &View<'_>) -> Option<String> {
    let sum = |index: usize| -> Share { view.units().map(|(_, counts)| counts.by_write[index]).sum() };
    let (quiet, written) = (sum(0), sum(1));
    view.significant(fisher(written, quiet))?;
    (written.rate() > 3.0 * quiet.rate()).then(|| {
        format!(
            "; right after writes{} {} of {} requests fail, otherwise {} of {}",
            of_writes(view),
            written.failed,
            written.total,
            quiet.failed,
            quiet.total
        )
    })
}
