//! One sentence first: healthy, works but has problems, broken, or cannot be judged, and why.

mod few;

use modlens_engine::records::DiagnosisRow;
use modlens_protocol::decimal::thousands;
use modlens_protocol::finding::Severity;
use modlens_protocol::framing::Verdict as FrameVerdict;

use crate::claim::{percent, were, Certainty, ACCIDENT, FEW};
use crate::contrast::gaps::without_lone;
use crate::contrast::told::Told;
use crate::contrast::{BusContrast, Extent, Symptom};
use crate::statistics::{at_least, least_rate, Share};
use crate::table::{diagnosis, Diagnosis};
use crate::MAX_CHANCE;
use few::{beside, nothing_wrong, too_few, without_other_half};

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

/// How the sentence begins where there is no verdict.
pub(super) const UNJUDGED: &str = "Cannot be judged";

/// A line is broken where surely more than this share of its requests fails, and a cause is known.
const MANY_FAILED: f64 = 0.3;

/// A line is not healthy where surely more than this share of its requests is refused.
const MANY_REFUSED: f64 = 0.2;

/// A line is not healthy where surely more than this share of its bytes belongs to no frame.
const MUCH_OF_NO_FRAME: f64 = 0.1;

/// A line is not healthy where surely more runs of bytes than this share of its requests belong to no frame: requests may be among
/// them.
const MANY_RUNS: f64 = 0.05;

/// Whether a bus without a diagnosis would not be called healthy: too few requests, or failures that nothing explains.
pub(super) fn is_open(bus: &BusContrast) -> bool {
    let share = bus.requests_seen.share();
    share.total < FEW || at_least(share, ACCIDENT) < MAX_CHANCE
}

/// What is judged, in words.
#[derive(Clone, Copy)]
struct Judged {
    what: &'static str,
    /// A user has chosen the transactions, perhaps those that failed: they say nothing of the line.
    is_selection: bool,
    /// More is in the recording than is counted.
    is_part: bool,
}

impl Judged {
    fn of(buses: &[(String, BusContrast)], extent: Extent) -> Self {
        let what = match buses {
            _ if extent.is_part => "What was counted of this recording",
            [(_, bus)] if bus.facts.is_network => "This network",
            [_] => "This line",
            _ => "What was recorded",
        };
        Self { what, is_selection: extent.is_selection, is_part: extent.is_part }
    }

    /// How it works, with the numbers that show it.
    fn state(self, state: &str, numbers: &str) -> String {
        if self.is_selection {
            return format!("Of what was selected, {numbers}");
        }
        format!("{} {state}: {numbers}", self.what)
    }

    fn problems(self, numbers: &str) -> String {
        self.state("works, but has problems", numbers)
    }
}

/// The verdict and its sentence; `rows` are the diagnoses, the worst first, `open` what a unit bears without a known cause.
pub(super) fn verdict(
    buses: &[(String, BusContrast)],
    extent: Extent,
    rows: &[DiagnosisRow],
    open: Option<&DiagnosisRow>,
) -> (Verdict, String) {
    let case = Case::of(buses, extent, rows);
    case.of_lists()
        .or_else(|| case.of_worst())
        .or_else(|| case.of_suspicion())
        .or_else(|| case.without_requests())
        .or_else(|| case.of_few())
        .or_else(|| case.without_cause(open))
        .unwrap_or_else(|| case.of_answered())
}

/// What a verdict rests on. Each step gives the verdict if it is the one to decide, and they are asked one after the other.
struct Case<'a> {
    buses: &'a [(String, BusContrast)],
    rows: &'a [DiagnosisRow],
    judged: Judged,
    /// Requests that tell how the line works, and which of them failed.
    share: Share,
    /// The same requests, and which of them were refused.
    refused: Share,
}

impl<'a> Case<'a> {
    fn of(buses: &'a [(String, BusContrast)], extent: Extent, rows: &'a [DiagnosisRow]) -> Self {
        let share: Share = buses.iter().map(|(_, bus)| bus.requests_seen.share()).sum();
        let refused = Share { failed: buses.iter().map(|(_, bus)| refused(bus)).sum(), total: share.total };
        Self { buses, rows, judged: Judged::of(buses, extent), share, refused }
    }

    fn bytes(&self, verdict: FrameVerdict) -> u64 {
        self.buses.iter().map(|(_, bus)| bus.frames.bytes_of(verdict)).sum()
    }

    /// The refusals that this word stands for; nothing without any.
    fn refusals(&self, link: &str) -> String {
        match self.refused.failed {
            0 => String::new(),
            count => format!("{link} {} refused (exception)", were(count)),
        }
    }

    /// How many requests failed, or were refused.
    fn numbers(&self) -> String {
        let (share, refused) = (self.share, self.refused);
        if share.failed == 0 && refused.failed > 0 {
            format!("{} of {} requests were refused (exception)", thousands(refused.failed), thousands(refused.total))
        } else {
            format!("{} of {} requests failed{}", thousands(share.failed), thousands(share.total), self.refusals(" and"))
        }
    }

    fn problems(&self) -> String {
        self.judged.problems(&self.numbers())
    }

    /// What a few examples suggest, in words.
    fn suspected(&self) -> Option<String> {
        self.rows.iter().find(|row| !is_diagnosed(row)).map(|row| format!("{}: {}", word(row.certainty), row.sentence))
    }

    /// Whether all bytes are good frames, and nothing is odd.
    fn is_whole(&self) -> bool {
        self.buses.iter().all(|(_, bus)| (bytes_of_frames(bus), bus.symptoms.all().count()) == (bus.frames.good_bytes(), 0))
    }

    /// Two lists one after the other have no pairs to judge.
    fn of_lists(&self) -> Option<(Verdict, String)> {
        let lists = self.buses.iter().find_map(|(_, bus)| bus.lists.as_ref())?;
        Some((Verdict::Unknown, self.suspected().unwrap_or_else(|| format!("{UNJUDGED}: {}.", lists.words()))))
    }

    /// The worst diagnosis decides.
    fn of_worst(&self) -> Option<(Verdict, String)> {
        let (share, refused) = (self.share, self.refused);
        let worst = self.rows.iter().find(|row| is_diagnosed(row)).filter(|row| row.severity != Severity::Info)?;
        // Where nothing but refusals came, a cause that explains none is not the cause.
        let is_of_refusals = diagnosis(worst.code).is_some_and(Diagnosis::explains_refusals);
        let is_aside = share.failed == 0 && refused.failed > 0 && !is_of_refusals;
        let cause = format!("{}: {}", if is_aside { "What else was found" } else { rest(self.rows) }, worst.sentence);
        if share.total == 0 {
            // Requests to all units have no outcome.
            let is_empty = self.buses.iter().all(|(_, bus)| bus.broadcasts == 0);
            let text = if is_empty { format!("No valid request was found. {cause}") } else { worst.sentence.clone() };
            return Some((Verdict::Broken, text));
        }
        if least_rate(share) > MANY_FAILED {
            return Some((Verdict::Broken, format!("{}. {cause}", self.judged.state("is broken", &self.numbers()))));
        }
        if share.failed == 0 && refused.failed == 0 {
            return Some((Verdict::Trouble, all_answered(share.total, self.rows, worst)));
        }
        Some((Verdict::Trouble, format!("{}. {cause}", self.problems())))
    }

    /// Examples suggest a cause.
    fn of_suspicion(&self) -> Option<(Verdict, String)> {
        let suspected = self.suspected()?;
        if self.share.total < FEW {
            return Some((Verdict::Unknown, suspected));
        }
        Some((Verdict::Trouble, format!("{}. {suspected}", self.problems())))
    }

    /// No request shows what came of it: the recording holds something else.
    fn without_requests(&self) -> Option<(Verdict, String)> {
        let (buses, total) = (self.buses, self.share.total);
        let unknown = |text: String| Some((Verdict::Unknown, text));
        let noise = self.bytes(FrameVerdict::Noise);
        if total == 0 && noise > self.bytes(FrameVerdict::Ok) {
            return unknown(format!("{UNJUDGED}: {} bytes, and no request among them.", thousands(noise)));
        }
        let is_heard = buses.iter().any(|(_, bus)| bus.heard.is_some());
        let whole = told(buses).filter(|told| total == 0 && !is_heard && told.is_plain && self.is_whole());
        if let Some(sentence) = whole.and_then(without_other_half) {
            return unknown(sentence);
        }
        if let [(_, bus)] = buses {
            if let Some(sentence) = told(buses).filter(|_| bus.is_quoted()).and_then(without_other_half) {
                return unknown(sentence);
            }
        }
        let alone: u64 = buses.iter().map(|(_, bus)| bus.answers_alone()).sum();
        if total == 0 && alone > 1 {
            let what = format!("{} answers, and no request among them", thousands(alone));
            return unknown(format!("{UNJUDGED}: {what}: the recording hears one direction."));
        }
        if let Some(count) = broadcasts_only(buses) {
            let writes =
                if count == 1 { String::from("the only request is") } else { format!("all {} requests are", thousands(count)) };
            let what = format!("{writes} to unit 0, that is to all units, and none answers that: a master does not wait there");
            return unknown(format!("{UNJUDGED}: {what}."));
        }
        if let [(_, BusContrast { heard: Some(unit), .. })] = buses {
            let what =
                format!("What was received is a request to unit {unit}, not an answer. That is right in the log of a unit");
            return unknown(format!("{what}; in that of a master, another master is on the line, or it hears itself."));
        }
        None
    }

    /// Too few requests for a verdict; what came of them is reported all the same.
    fn of_few(&self) -> Option<(Verdict, String)> {
        let (buses, share, refused) = (self.buses, self.share, self.refused);
        if share.total >= FEW {
            return None;
        }
        let is_whole = self.is_whole();
        let open =
            buses.iter().flat_map(|(_, bus)| bus.units.values()).map(|unit| unit.not_seen.failed - unit.silent.failed).sum();
        let troubles: u64 = buses.iter().map(|(_, bus)| bus.troubles).sum();
        if is_whole && share.total > 0 && refused.failed == 0 && troubles == 0 {
            let overhears = buses.iter().any(|(_, bus)| bus.overhears);
            let text = format!("{}{}.", nothing_wrong(share.total, told(buses), open > 0, overhears), beside(share, open));
            return Some((Verdict::Unknown, text));
        }
        let of_no_frame = buses.iter().map(|(_, bus)| bytes_of_frames(bus) - bus.frames.good_bytes()).sum();
        let odd = buses.iter().find_map(|(_, bus)| bus.odd_run.as_ref());
        let has_none = buses.iter().all(|(_, bus)| bytes_of_frames(bus) == 0);
        let why = too_few(share, refused, (has_none, is_whole), of_no_frame, odd);
        Some((Verdict::Unknown, format!("{UNJUDGED}: {why}{}.", beside(share, open))))
    }

    /// Requests fail, or are refused, and no cause explains it; `open` is what a unit bears.
    fn without_cause(&self, open: Option<&DiagnosisRow>) -> Option<(Verdict, String)> {
        let share = self.share;
        let trouble = |why: &str| Some((Verdict::Trouble, format!("{}. {why}", self.problems())));
        if let Some(open) = open.filter(|open| open.severity != Severity::Info) {
            return trouble(&open.sentence);
        }
        // What the master has searched for once is no failure of the line.
        let is_over = |row: &&DiagnosisRow| row.severity == Severity::Info && row.until.is_some() && row.failed == row.total;
        let searched: u64 = self.rows.iter().filter(is_over).map(|row| row.failed).sum();
        let failing = Share { failed: share.failed.saturating_sub(searched), total: share.total };
        if failing.failed > 0 && at_least(failing, ACCIDENT) < MAX_CHANCE {
            let most = self.rows.iter().find(|row| is_diagnosed(row) && row.failed * 2 > share.failed);
            return trouble(most.map_or("No known cause explains it.", |row| &row.sentence));
        }
        if least_rate(self.refused) > MANY_REFUSED {
            return trouble("There is no single reason; each transaction names its own.");
        }
        None
    }

    /// Hardly a request failed: the line is healthy, unless a unit refused for a while, or much belongs to no frame.
    fn of_answered(&self) -> (Verdict, String) {
        let share = self.share;
        let answered = format!(
            "{} of {} requests were answered ({}){}",
            thousands(share.total - share.failed),
            thousands(share.total),
            percent(1.0 - share.rate()),
            self.refusals(", but")
        );
        let trouble = |what: String| (Verdict::Trouble, format!("{}{what}", self.judged.problems(&answered)));
        if let Some((unit, stretch)) = self.buses.iter().find_map(|(_, bus)| refused_for_a_while(bus)) {
            let (some, all) = (thousands(stretch.failed), thousands(stretch.total));
            return trouble(format!(". In one stretch of time, unit {unit} refused {some} of {all} requests."));
        }
        let all = self.buses.iter().map(|(_, bus)| bytes_of_frames(bus)).sum();
        let of_no_frame = Share { failed: self.bytes(FrameVerdict::Noise), total: all };
        if least_rate(of_no_frame) > MUCH_OF_NO_FRAME {
            let (some, all) = (thousands(of_no_frame.failed), thousands(of_no_frame.total));
            return trouble(format!(", and {some} of {all} bytes belong to no frame. No known cause explains them."));
        }
        let runs = runs_of_no_frame(self.buses);
        if least_rate(Share { failed: runs, total: share.total + runs }) > MANY_RUNS {
            let runs = thousands(runs);
            return trouble(format!(", and {runs} runs of bytes belong to no frame. No known cause explains them."));
        }
        let others = if self.judged.is_part {
            " More servers and units are in it than are counted, and those are not judged."
        } else {
            ""
        };
        (Verdict::Healthy, self.judged.state("is healthy", &format!("{answered}.{others}")))
    }
}

fn is_diagnosed(row: &DiagnosisRow) -> bool {
    row.certainty == Certainty::Diagnosed.text()
}

/// Runs of bytes between frames that are neither a frame nor what a driver leaves when it is switched.
fn runs_of_no_frame(buses: &[(String, BusContrast)]) -> u64 {
    let is_run = |symptom| matches!(symptom, Symptom::Noise | Symptom::Text);
    let of_bus = |bus: &BusContrast| -> u64 {
        bus.symptoms.all().filter(|(symptom, _, _)| is_run(*symptom)).map(|(_, _, seen)| seen.all.failed).sum()
    };
    buses.iter().map(|(_, bus)| of_bus(bus)).sum()
}

/// The requests of a recording that has no others than those to all units.
pub(super) fn broadcasts_only(buses: &[(String, BusContrast)]) -> Option<u64> {
    let count = buses.iter().map(|(_, bus)| bus.broadcasts).sum();
    let has_others = |bus: &BusContrast| bus.units.values().any(|unit| unit.failures.total + unit.not_seen.failed > 0);
    (count > 0 && !buses.iter().any(|(_, bus)| has_others(bus))).then_some(count)
}

fn word(certainty: &str) -> &'static str {
    if certainty == Certainty::Likely.text() {
        "Likely"
    } else {
        "Suspected"
    }
}

/// What the frames of a short recording of one bus say.
pub(super) fn told(buses: &[(String, BusContrast)]) -> Option<&Told> {
    match buses {
        [(_, bus)] => bus.told.as_ref(),
        _ => None,
    }
}

fn bytes_of_frames(bus: &BusContrast) -> u64 {
    bus.frames.bytes.iter().sum()
}

/// Returns the unit that refused more than it answered in some stretch of time: of all its requests, or of one of them.
fn refused_for_a_while(bus: &BusContrast) -> Option<(u8, Share)> {
    let of_units = bus.units.iter().flat_map(|(unit, counts)| counts.exceptions.iter().map(|tally| (*unit, tally)));
    let requests = bus.requests.sorted();
    let of_requests = requests.iter().filter(|(_, counts)| counts.refusals() * 2 > counts.bad.failed);
    let mut all = of_units.chain(of_requests.map(|(key, counts)| (key.unit, &counts.bad)));
    all.find_map(|(unit, tally)| {
        let episodes = without_lone(tally.episodes()).into_iter();
        let stretches = episodes.map(|one| Share { failed: one.failed, total: one.total });
        stretches
            .filter(|one| one.failed >= FEW && one.failed * 2 > one.total)
            .max_by_key(|one| one.failed)
            .map(|one| (unit, one))
    })
}

/// The requests of a bus that were refused by an exception response.
fn refused(bus: &BusContrast) -> u64 {
    bus.units.values().flat_map(|unit| &unit.exceptions).map(|tally| tally.share().failed).sum()
}

/// The sentence where no request failed: "has problems" would be contradicted by its own count.
fn all_answered(total: u64, rows: &[DiagnosisRow], worst: &DiagnosisRow) -> String {
    let answered = match total {
        1 => String::from("The only request was answered"),
        count => format!("All {} requests were answered", thousands(count)),
    };
    let answered = match worst.code {
        "wrong_layout" if total > 1 => format!("{answered}, {} of them wrongly", thousands(worst.failed)),
        _ => answered,
    };
    match rest(rows) {
        ONE_CAUSE => format!("{answered}, but something is wrong: {}", worst.sentence),
        several => format!("{answered}, but something is wrong. {several}: {}", worst.sentence),
    }
}

const ONE_CAUSE: &str = "Cause";

fn rest(rows: &[DiagnosisRow]) -> &'static str {
    match rows.iter().filter(|row| row.severity != Severity::Info).count() {
        1 => ONE_CAUSE,
        _ => "Main cause (of several)",
    }
}
