//! The verdict, the diagnoses in words, how near the units are to their limits, and what could not be judged.

mod course;
mod episodes;
mod reserves;
mod sentences;
mod unexplained;
mod unjudged;
mod verdict;

pub use course::Course;
pub use unexplained::UNEXPLAINED;

use modlens_engine::records::DiagnosisRow;
use modlens_protocol::framing::{Mode, Verdict as FrameVerdict};
use modlens_protocol::oddity::{Printed, Reported};
use modlens_protocol::timestamp::time_text;
use serde_json::{json, Value as Json};

use crate::attribution::{attribute, Rest};
use crate::claim::{Certainty, Claim, View, FEW};
use crate::contrast::{BusContrast, Contrast};
use crate::kinds;
use crate::odd::Odd;
use crate::statistics::Share;
use verdict::{Verdict, UNJUDGED};

/// The judgement of the doctor on a recording.
#[derive(Clone)]
pub struct Report {
    rows: Vec<DiagnosisRow>,
    courses: Vec<Course>,
    verdict: &'static str,
    sentence: String,
    /// Those that tell how the line works, and which of them failed.
    requests: Share,
    /// All requests are for all units, which do not answer: that no answer came says nothing.
    has_broadcasts_only: bool,
    /// What the frames show, beside the words of a text.
    printed: Printed,
    /// What the frames of a short recording say.
    told: Option<String>,
    unexplained: Vec<Json>,
    /// Units that fail without a known cause.
    without_cause: Vec<(DiagnosisRow, Course)>,
    reserves: Vec<Json>,
    not_judged: Vec<Json>,
}

impl Report {
    /// Judges what has been counted.
    pub fn of(contrast: Contrast) -> Self {
        let extent = contrast.extent();
        let buses: Vec<_> = contrast.into_buses().collect();
        let mut rows = Vec::new();
        let (mut reserves, mut unjudged) = (Vec::new(), Vec::new());
        let (mut rest, mut without_cause) = (Vec::new(), Vec::new());
        for (name, bus) in &buses {
            let view = View::new(bus);
            let (claims, odd) = claims(&view);
            rows.extend(
                claims.iter().map(|claim| (loss(claim), sentences::row(name, bus, claim, odd), Course::of(bus, claim, odd))),
            );
            rest.push((name, odd));
            without_cause.extend(unexplained::of_bus(name, &view, &claims, odd));
            reserves.extend(reserves::of_bus(name, bus, &claims));
            unjudged.extend(unjudged::of_bus(name, bus));
        }
        if extent.has_overflowed {
            unjudged.push(json!({
                "bus": buses.first().map_or("", |(name, _)| name),
                "what": "everything: there are more buses, units or requests than are counted, and a part of them was left out",
                "needs": "a recording of a part of the network, or --between for less time",
            }));
        }
        rows.sort_by_key(|(loss, row, _)| std::cmp::Reverse(harm(*loss, row)));
        let (rows, courses): (Vec<DiagnosisRow>, Vec<Course>) = rows.into_iter().map(|(_, row, course)| (row, course)).unzip();
        let (word, sentence) = verdict::verdict(&buses, extent, &rows, without_cause.first().map(|(row, _)| row));
        let requests: Share = buses.iter().map(|(_, bus)| bus.requests_seen.share()).sum();
        let has_broadcasts_only = verdict::broadcasts_only(&buses).is_some();
        let printed = printed(&buses, requests);
        let told = verdict::told(&buses).and_then(|told| told.answered.clone().or_else(|| told.alone.first().cloned()));
        let unexplained =
            rest.iter().filter(|(_, rest)| rest.odd.total() > 0).map(|(bus, rest)| unexplained_json(bus, rest)).collect();
        Self {
            rows,
            courses,
            verdict: word.text(),
            sentence,
            requests,
            has_broadcasts_only,
            printed,
            told: told.filter(|_| printed.is_whole),
            unexplained,
            without_cause,
            reserves,
            not_judged: unjudged,
        }
    }

    /// The same with what the unread lines of a text show, where its frames say nothing; `said` gets what the frames show.
    #[must_use]
    pub fn with_unread(mut self, said: impl FnOnce(Printed) -> Option<Reported>) -> Self {
        if self.verdict != Verdict::Unknown.text() || self.has_broadcasts_only {
            return self;
        }
        let Some(said) = said(self.printed) else { return self };
        if let Some(first) = self.rows.first() {
            // What is not read may be the answer that is missing.
            if first.code == "dead_unit_cost" && said.has_bytes {
                self.sentence = format!("{} But {}.", self.sentence, said.words);
            }
        } else if said.is_unknown {
            let read = [("in these frames", "in the frames that were read"), ("in this frame", "in the frame that was read")];
            let sentence = read.iter().fold(self.sentence, |sentence, (all, some)| sentence.replacen(all, some, 1));
            self.sentence = format!("{sentence} But {}.", said.words);
        } else {
            let rest =
                self.sentence.strip_prefix(UNJUDGED).map_or(String::new(), |why| format!(" The rest cannot be judged{why}"));
            let told = self
                .told
                .as_ref()
                .filter(|_| !said.has_bytes)
                .map_or(String::new(), |told| format!(" What is printed as bytes is right: {told}."));
            self.sentence = format!("Suspected: {}.{}", said.words, if told.is_empty() { rest } else { told });
        }
        self
    }

    /// The diagnoses, by harm.
    pub fn rows(&self) -> &[DiagnosisRow] {
        &self.rows
    }

    /// The diagnoses, and the units that fail without a known cause (code `unexplained`), with their times.
    pub fn troubles(&self) -> impl Iterator<Item = (&DiagnosisRow, &Course)> {
        let without_cause = self.without_cause.iter().map(|(row, course)| (row, course));
        self.rows.iter().zip(&self.courses).chain(without_cause)
    }

    /// The numbers of the transactions that the diagnoses name as examples.
    pub fn examples(&self) -> Vec<u64> {
        self.rows.iter().flat_map(|row| row.examples.iter().copied()).collect()
    }

    /// The whole as JSON; `docs/doctor.schema.json` describes it.
    pub fn json(&self) -> Json {
        self.with(self.rows.iter().zip(&self.courses))
    }

    /// The same with the worst diagnosis of each kind alone: a line may have a thousand of one.
    pub fn brief(&self) -> Json {
        let is_first = |at: usize, code: &str| self.rows[..at].iter().all(|row| row.code != code);
        let rows = self.rows.iter().zip(&self.courses).enumerate();
        self.with(rows.filter(|(at, (row, _))| is_first(*at, row.code)).map(|(_, both)| both))
    }

    fn with<'a>(&'a self, rows: impl Iterator<Item = (&'a DiagnosisRow, &'a Course)>) -> Json {
        json!({
            "verdict": self.verdict, "sentence": self.sentence, "requests": self.requests.total, "failed": self.requests.failed,
            "diagnoses": rows.map(|(row, course)| row_json(row, course)).collect::<Vec<_>>(),
            "unexplained": self.unexplained, "reserves": self.reserves, "not_judged": self.not_judged,
        })
    }
}

/// What the frames of all buses show, with the requests among them.
fn printed(buses: &[(String, BusContrast)], requests: Share) -> Printed {
    let is_checked = |bus: &BusContrast| {
        let has_checksums = bus.frames.of(FrameVerdict::NoChecksum) == 0;
        let is_all_of_frames = bus.frames.of(FrameVerdict::Noise) == 0;
        has_checksums && is_all_of_frames && bus.received_damage == 0 && bus.facts.mode != Some(Mode::Tcp)
    };
    let is_whole = buses.iter().all(|(_, bus)| is_checked(bus));
    let answers: u64 = buses.iter().map(|(_, bus)| bus.answers_alone()).sum::<u64>() + requests.total - requests.failed;
    let good: u64 = buses.iter().map(|(_, bus)| bus.frames.of(FrameVerdict::Ok)).sum();
    let all: u64 = buses.iter().flat_map(|(_, bus)| bus.frames.frames).sum();
    let open: u64 = buses.iter().flat_map(|(_, bus)| bus.units.values()).map(|unit| unit.not_seen.failed).sum();
    Printed {
        has_answered: requests.failed < requests.total,
        has_all_answered: requests.failed == 0 && answers > 0 && open == 0,
        has_whole_answers: answers > 0 && is_whole,
        is_whole: is_whole && good > 0 && good == all,
    }
}

/// The claims of a bus, weighed, and how much of what is odd none explains.
fn claims(view: &View<'_>) -> (Vec<Claim>, Rest) {
    if let Some(lists) = &view.bus.lists {
        let mut claims = crate::sight::suspected_in_lists(view, lists);
        let rest = attribute(view, &mut claims, &[]);
        return (claims, rest);
    }
    let (mut claims, all) = kinds::claims(view);
    for claim in &mut claims {
        claim.certainty = certainty(view.bus, claim);
    }
    if claims.iter().all(|claim| claim.harm == 0 || claim.certainty != Certainty::Diagnosed) && verdict::is_open(view.bus) {
        let others = crate::sight::suspected(view, &claims);
        claims.extend(others);
    }
    let rest = attribute(view, &mut claims, &all);
    (claims, rest)
}

/// How certain a contrast is: a few requests suggest a cause, however clear they are.
fn certainty(bus: &BusContrast, claim: &Claim) -> Certainty {
    // Where there is no Modbus, accident makes a request or two of bytes; of these, a hundred are many.
    let is_small = (1..FEW).contains(&bus.requests_seen.total) && claim.share.failed < 10 * FEW;
    match claim.share.failed {
        _ if !is_small => claim.certainty,
        0..crate::sight::LIKELY_EXAMPLES => Certainty::Suspected,
        _ => Certainty::Likely,
    }
}

/// Requests that a cause spoils: those whose symptoms it explains, else what it has counted itself, as a suspicion does, which
/// is of a few examples.
fn spoiled(claim: &Claim) -> u64 {
    let explains = claim.explains.filter(|_| claim.certainty == Certainty::Diagnosed);
    explains.map_or(claim.harm, |explains| explains.failed + explains.refused)
}

/// Whether a cause loses anything that the master asked for, and how many requests it spoils. Bytes between frames lose nothing, be
/// they ever so many.
fn loss(claim: &Claim) -> (bool, u64) {
    let spoiled = spoiled(claim);
    let loses = match claim.sight {
        Some(symptom) => !symptom.is_between_frames(),
        None => claim.explains.is_none_or(|explains| explains.failed + explains.refused > 0),
    };
    (loses && spoiled > 0, spoiled)
}

/// The order of diagnoses: by severity, then by what is lost and how many failures they explain, then by how sure they are.
fn harm(loss: (bool, u64), row: &DiagnosisRow) -> (u8, (bool, u64), u64, std::cmp::Reverse<String>) {
    let sureness = row.chance.map_or(0, |chance| (-chance.max(1e-300).log10() * 10.0) as u64);
    // Without a chance, it is what a first sight suspects: of as many examples, the best explanation is first.
    let code = if row.chance.is_some() { row.code } else { "" };
    let sureness = if row.certainty == Certainty::Likely.text() { sureness.max(1) } else { sureness };
    (sentences::rank(row.severity), loss, sureness, std::cmp::Reverse(code.to_owned()))
}

/// What is odd on a bus, and how much of it no cause explains.
fn unexplained_json(bus: &str, rest: &Rest) -> Json {
    let words = course::in_words(rest.unexplained, rest.odd);
    json!({
        "bus": bus, "odd": rest.odd.total(), "unexplained": rest.unexplained.total(),
        "sentence": Some(words).filter(|words| !words.is_empty()).map(|words| format!("no cause above explains {words}.")),
    })
}

fn row_json(row: &DiagnosisRow, course: &Course) -> Json {
    json!({
        "code": row.code, "title": crate::table::diagnosis(row.code).map(|known| known.title.as_str()),
        "severity": row.severity.text(), "bus": row.bus, "unit": row.unit, "function": row.function, "address": row.address,
        "client": row.client, "failed": row.failed, "total": row.total,
        "since": row.since.map(time_text), "until": row.until.map(time_text), "episodes": course.episodes,
        "certainty": row.certainty, "explains": course.explains.map(Odd::total),
        "explains_failed": course.explains.map(|explains| explains.failed), "share": row.share, "odds": row.odds, "rival": course.rival,
        "chance": row.chance, "sentence": row.sentence, "evidence": course.evidence(), "advice": row.advice, "proof": row.proof, "examples": row.examples,
    })
}
