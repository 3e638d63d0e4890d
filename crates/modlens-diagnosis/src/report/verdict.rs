//! One sentence first: healthy, works but has problems, broken, or cannot be judged, and why.

use modlens_engine::records::DiagnosisRow;
use modlens_protocol::decimal::thousands;
use modlens_protocol::finding::Severity;
use modlens_protocol::framing::Verdict as FrameVerdict;

use crate::claim::{percent, were, Certainty, ACCIDENT, FEW};
use crate::contrast::gaps::without_lone;
use crate::contrast::told::{Told, REQUEST};
use crate::contrast::{BusContrast, Contrast, Symptom};
use crate::statistics::{at_least, least_rate, Share};
use crate::table::{diagnosis, Diagnosis};
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

/// How the sentence begins where there is no verdict.
pub(super) const UNJUDGED: &str = "Cannot be judged";

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
    fn of(buses: &[(&str, BusContrast)], contrast: &Contrast) -> Self {
        let what = match buses {
            _ if contrast.is_part() => "What was counted of this recording",
            [(_, bus)] if bus.facts.is_network => "This network",
            [_] => "This line",
            _ => "What was recorded",
        };
        Self { what, is_selection: contrast.is_selection(), is_part: contrast.is_part() }
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
    buses: &[(&str, BusContrast)],
    contrast: &Contrast,
    rows: &[DiagnosisRow],
    open: Option<&DiagnosisRow>,
) -> (Verdict, String) {
    let share: Share = buses.iter().map(|(_, bus)| bus.requests_seen.share()).sum();
    let bytes = |verdict: FrameVerdict| -> u64 { buses.iter().map(|(_, bus)| bus.frames.bytes_of(verdict)).sum() };
    let is_diagnosed = |row: &&DiagnosisRow| row.certainty == Certainty::Diagnosed.text();
    let worst = rows.iter().find(is_diagnosed).filter(|row| row.severity != Severity::Info);
    let suspected = rows.iter().find(|row| !is_diagnosed(row)).map(|row| format!("{}: {}", word(row.certainty), row.sentence));
    let refused = Share { failed: buses.iter().map(|(_, bus)| refused(bus)).sum(), total: share.total };
    let refusals = |link: &str| match refused.failed {
        0 => String::new(),
        count => format!("{link} {} refused (exception)", were(count)),
    };
    let numbers = if share.failed == 0 && refused.failed > 0 {
        format!("{} of {} requests were refused (exception)", thousands(refused.failed), thousands(refused.total))
    } else {
        format!("{} of {} requests failed{}", thousands(share.failed), thousands(share.total), refusals(" and"))
    };
    let judged = Judged::of(buses, contrast);
    if let Some(lists) = buses.iter().find_map(|(_, bus)| bus.lists.as_ref()) {
        return (Verdict::Unknown, suspected.unwrap_or_else(|| format!("{UNJUDGED}: {}.", lists.words())));
    }
    if let Some(worst) = worst {
        // Where nothing but refusals came, a cause that explains none is not the cause.
        let is_of_refusals = diagnosis(worst.code).is_some_and(Diagnosis::explains_refusals);
        let is_aside = share.failed == 0 && refused.failed > 0 && !is_of_refusals;
        let cause = format!("{}: {}", if is_aside { "What else was found" } else { rest(rows) }, worst.sentence);
        if share.total == 0 {
            // Requests to all units have no outcome.
            let is_empty = buses.iter().all(|(_, bus)| bus.broadcasts == 0);
            let text = if is_empty { format!("No valid request was found. {cause}") } else { worst.sentence.clone() };
            return (Verdict::Broken, text);
        }
        if least_rate(share) > 0.3 {
            return (Verdict::Broken, format!("{}. {cause}", judged.state("is broken", &numbers)));
        }
        if share.failed == 0 && refused.failed == 0 {
            return (Verdict::Trouble, all_answered(share.total, rows, worst));
        }
        return (Verdict::Trouble, format!("{}. {cause}", judged.problems(&numbers)));
    }
    if let Some(suspected) = suspected {
        return suspicion(share, &judged.problems(&numbers), &suspected);
    }
    if share.total == 0 && bytes(FrameVerdict::Noise) > bytes(FrameVerdict::Ok) {
        let count = thousands(bytes(FrameVerdict::Noise));
        return (Verdict::Unknown, format!("{UNJUDGED}: {count} bytes, and no request among them."));
    }
    let alone: u64 = buses.iter().map(|(_, bus)| bus.answers_alone()).sum();
    let is_whole =
        buses.iter().all(|(_, bus)| (bytes_of_frames(bus), bus.symptoms.all().count()) == (bus.frames.good_bytes(), 0));
    let is_heard = buses.iter().any(|(_, bus)| bus.heard.is_some());
    let whole = told(buses).filter(|told| is_whole && !is_heard && share.total == 0 && told.is_plain);
    if let Some(sentence) = whole.and_then(without_other_half) {
        return (Verdict::Unknown, sentence);
    }
    if share.total == 0 && alone > 1 {
        let count = thousands(alone);
        return (
            Verdict::Unknown,
            format!("{UNJUDGED}: {count} answers, and no request among them: the recording hears one direction."),
        );
    }
    if let Some(count) = broadcasts_only(buses) {
        let writes =
            if count == 1 { String::from("the only request is") } else { format!("all {} requests are", thousands(count)) };
        let what = format!("{writes} to unit 0, that is to all units, and none answers that: a master does not wait there");
        return (Verdict::Unknown, format!("{UNJUDGED}: {what}."));
    }
    if let [(_, BusContrast { heard: Some(unit), .. })] = buses {
        let what = format!("What was received is a request to unit {unit}, not an answer. That is right in the log of a unit");
        return (Verdict::Unknown, format!("{what}; in that of a master, another master is on the line, or it hears itself."));
    }
    if share.total < FEW {
        let open =
            buses.iter().flat_map(|(_, bus)| bus.units.values()).map(|unit| unit.not_seen.failed - unit.silent.failed).sum();
        let troubles: u64 = buses.iter().map(|(_, bus)| bus.troubles).sum();
        if is_whole && share.total > 0 && refused.failed == 0 && troubles == 0 {
            return (Verdict::Unknown, format!("{}{}.", nothing_wrong(share.total, told(buses), open > 0), beside(share, open)));
        }
        let why = too_few(share, refused, is_whole, bytes(FrameVerdict::Noise));
        return (Verdict::Unknown, format!("{UNJUDGED}: {why}{}.", beside(share, open)));
    }
    if let Some(open) = open.filter(|open| open.severity != Severity::Info) {
        return (Verdict::Trouble, format!("{}. {}", judged.problems(&numbers), open.sentence));
    }
    // What the master has searched for once is no failure of the line.
    let is_over = |row: &&DiagnosisRow| row.severity == Severity::Info && row.until.is_some() && row.failed == row.total;
    let searched: u64 = rows.iter().filter(is_over).map(|row| row.failed).sum();
    let failing = Share { failed: share.failed.saturating_sub(searched), total: share.total };
    if failing.failed > 0 && at_least(failing, ACCIDENT) < MAX_CHANCE {
        let most = rows.iter().find(|row| is_diagnosed(row) && row.failed * 2 > share.failed);
        let why = most.map_or(String::from("No known cause explains it."), |row| row.sentence.clone());
        let text = format!("{}. {why}", judged.problems(&numbers));
        return (Verdict::Trouble, text);
    }
    if least_rate(refused) > MANY_REFUSED {
        let text = format!("{}. There is no single reason; each transaction names its own.", judged.problems(&numbers));
        return (Verdict::Trouble, text);
    }
    let answered = format!(
        "{} of {} requests were answered ({}){}",
        thousands(share.total - share.failed),
        thousands(share.total),
        percent(1.0 - share.rate()),
        refusals(", but")
    );
    if let Some((unit, stretch)) = buses.iter().find_map(|(_, bus)| refused_for_a_while(bus)) {
        let (some, all) = (thousands(stretch.failed), thousands(stretch.total));
        let text = judged.problems(&answered);
        return (Verdict::Trouble, format!("{text}. In one stretch of time, unit {unit} refused {some} of {all} requests."));
    }
    let of_no_frame =
        Share { failed: bytes(FrameVerdict::Noise), total: buses.iter().map(|(_, bus)| bytes_of_frames(bus)).sum() };
    if least_rate(of_no_frame) > MUCH_OF_NO_FRAME {
        let (some, all) = (thousands(of_no_frame.failed), thousands(of_no_frame.total));
        let text = judged.problems(&answered);
        return (
            Verdict::Trouble,
            format!("{text}, and {some} of {all} bytes belong to no frame. No known cause explains them."),
        );
    }
    let runs = runs_of_no_frame(buses);
    if least_rate(Share { failed: runs, total: share.total + runs }) > MANY_RUNS {
        let text = judged.problems(&answered);
        return (
            Verdict::Trouble,
            format!("{text}, and {} runs of bytes belong to no frame. No known cause explains them.", thousands(runs)),
        );
    }
    let others =
        if judged.is_part { " More servers and units are in it than are counted, and those are not judged." } else { "" };
    (Verdict::Healthy, judged.state("is healthy", &format!("{answered}.{others}")))
}

/// Runs of bytes between frames that are neither a frame nor what a driver leaves when it is switched.
fn runs_of_no_frame(buses: &[(&str, BusContrast)]) -> u64 {
    let is_run = |symptom| matches!(symptom, Symptom::Noise | Symptom::Text);
    let of_bus = |bus: &BusContrast| -> u64 {
        bus.symptoms.all().filter(|(symptom, _, _)| is_run(*symptom)).map(|(_, _, seen)| seen.all.failed).sum()
    };
    buses.iter().map(|(_, bus)| of_bus(bus)).sum()
}

/// The requests of a recording that has no others than those to all units.
pub(super) fn broadcasts_only(buses: &[(&str, BusContrast)]) -> Option<u64> {
    let count = buses.iter().map(|(_, bus)| bus.broadcasts).sum();
    let has_others = |bus: &BusContrast| bus.units.values().any(|unit| unit.failures.total + unit.not_seen.failed > 0);
    (count > 0 && !buses.iter().any(|(_, bus)| has_others(bus))).then_some(count)
}

/// The verdict where examples suggest a cause.
fn suspicion(share: Share, problems: &str, suspected: &str) -> (Verdict, String) {
    if share.total < FEW {
        return (Verdict::Unknown, suspected.to_owned());
    }
    (Verdict::Trouble, format!("{problems}. {suspected}"))
}

fn word(certainty: &str) -> &'static str {
    if certainty == Certainty::Likely.text() {
        "Likely"
    } else {
        "Suspected"
    }
}

/// The requests whose outcome the recording does not show, beside others.
fn beside(share: Share, open: u64) -> String {
    match open {
        _ if share.total == 0 || open == 0 => String::new(),
        1 => String::from("; no answer to another one is in the recording"),
        count => format!("; no answer to {count} others is in the recording"),
    }
}

/// What the frames of a short recording of one bus say.
pub(super) fn told<'a>(buses: &'a [(&str, BusContrast)]) -> Option<&'a Told> {
    match buses {
        [(_, bus)] => bus.told.as_ref(),
        _ => None,
    }
}

/// What is said of a few requests with whole frames that were all answered: what they say, and, unless others are `open`, where to
/// look.
fn nothing_wrong(requests: u64, told: Option<&Told>, is_open: bool) -> String {
    let first = told.and_then(|told| told.answered.as_ref());
    let answered = match requests {
        1 => format!("1 request was answered{}", first.map_or(String::new(), |what| format!(": {what}"))),
        count => {
            format!("all {count} requests were answered{}", first.map_or(String::new(), |what| format!("; the first: {what}")))
        }
    };
    let few = if requests == 1 { "1 request is" } else { "they are" };
    let rest = if is_open { format!("; {few}") } else { format!(". {OUTSIDE}; {few}") };
    format!("Nothing is wrong in these frames: {answered}{rest} too few to judge the line")
}

/// Where to look if the frames are right.
const OUTSIDE: &str =
    "If something fails, it is not in these bytes: look at what the program makes of them (address, data type, word order), and \
                       at what is not printed here";

/// What is said of whole frames of which each is a request, or an answer, without the other half.
fn without_other_half(told: &Told) -> Option<String> {
    let (what, rest) = told.alone.split_first()?;
    let what = if rest.is_empty() { format!("it is {what}") } else { format!("the first is {what}") };
    let has_answers = told.alone.iter().any(|one| !one.starts_with(REQUEST));
    let missing = if has_answers { "what was asked for" } else { "whether an answer came" };
    let frames = if rest.is_empty() { "this frame" } else { "these frames" };
    Some(format!("Nothing is wrong in {frames}: {what}. The recording does not show {missing}."))
}

/// Why so few requests are no ground for a verdict, and what came of them all the same: who pastes three lines of a log into a
/// file wants to hear that they were read.
fn too_few(share: Share, refused: Share, is_whole: bool, of_no_frame: u64) -> String {
    let requests = match share.total {
        0 if is_whole => {
            return "the recording does not show the outcome of any request; what it holds are whole frames".to_owned()
        }
        0 => return "the recording does not show the outcome of any request".to_owned(),
        1 => "1 request is too few".to_owned(),
        count => format!("{count} requests are too few"),
    };
    let failed = match share.failed {
        0 if refused.failed == 0 && of_no_frame > 1 => {
            format!("; what was asked was answered, and {} bytes are of no frame", thousands(of_no_frame))
        }
        0 if refused.failed == 0 => String::from("; what was asked was answered"),
        0 => String::new(),
        count => format!("; {count} of {} failed", share.total),
    };
    let refusals = match refused.failed {
        0 => String::new(),
        count => format!("; {} refused (exception)", were(count)),
    };
    format!("{requests}{failed}{refusals}")
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
