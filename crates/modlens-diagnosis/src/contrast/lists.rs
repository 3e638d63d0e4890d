//! Texts in which two lists stand one after the other: what was sent, then what was received, or the logs of two programs. Read
//! as one conversation, each request but the last is one without an answer.

use std::collections::{BTreeMap, VecDeque};

use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::Ns;

use super::tally::Tally;
use crate::observation::{answer_length, FrameObservation, Observation, RequestKey};

/// A list that begins again begins in so early a part of the time before.
const EARLY: Ns = 4;

/// Two lists.
#[derive(Clone, Debug, PartialEq)]
pub struct Lists {
    kind: Kind,
    /// By unit, whole answers of a length that no request to it asks for.
    pub other_length: BTreeMap<u8, Tally>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// The times begin again.
    Restarted,
    /// Requests alone and answers alone, without times; and whether each answer fits the request of its place.
    Apart { requests: usize, answers: usize, are_requests_first: bool, fit: bool },
}

/// A whole answer: its unit, its function code, and its length.
type Answer<'a> = (u8, u8, &'a FrameObservation);

impl Lists {
    /// The lists of a recording that is not longer than these frames and transactions; `None` where it is one conversation.
    pub(super) fn of(frames: &VecDeque<FrameObservation>, transactions: &VecDeque<Observation>) -> Option<Self> {
        let asked = |frame: &&FrameObservation| {
            let of_frame = transactions.iter().find(|seen| seen.request_frame != 0 && seen.request_frame == frame.number)?;
            of_frame.key()
        };
        let is = |direction| move |frame: &&FrameObservation| frame.verdict.is_good() && frame.direction == direction;
        let requests: Vec<Option<RequestKey>> = frames.iter().filter(is(Direction::Request)).map(|one| asked(&one)).collect();
        let answers = frames.iter().filter(is(Direction::Response));
        let answers: Vec<Answer<'_>> = answers.filter_map(|one| Some((one.unit?, one.code?, one))).collect();
        let kind = if begins_again(frames) { Kind::Restarted } else { apart(frames, &requests, &answers)? };
        let mut other_length = BTreeMap::<u8, Tally>::new();
        for (unit, code, frame) in answers.iter().filter(|(_, code, frame)| code & EXCEPTION_BIT == 0 && frame.mode == Mode::Rtu)
        {
            let of_unit = requests.iter().flatten().filter(|key| (key.unit, key.function) == (*unit, *code));
            let lengths: Vec<u32> = of_unit.filter_map(|key| answer_length(key.function, key.quantity)).collect();
            if !lengths.is_empty() && !lengths.contains(&frame.length) {
                other_length.entry(*unit).or_default().count(true, frame.place);
            }
        }
        Some(Self { kind, other_length })
    }

    /// What they are, and what they do not show, as the end of a sentence.
    pub fn words(&self) -> String {
        match self.kind {
            Kind::Restarted => String::from(
                "the times begin again, so these are two logs one after the other: which answer belongs to which request, and how \
                 long it took, they do not show",
            ),
            Kind::Apart { requests, answers, are_requests_first, fit } => {
                if requests == 1 {
                    let fit = if fit { ", and each of them fits it" } else { "" };
                    return format!(
                        "1 request comes before {answers} answers to it, as where the answers of several polls are listed{fit}"
                    );
                }
                let (requests, answers) = (format!("{requests} requests"), format!("{answers} answers"));
                let (first, second) = if are_requests_first { (requests, answers) } else { (answers, requests) };
                let fit = if fit { "; in their order, each answer fits its request" } else { "" };
                format!("{first} come before {second}, as in two lists, so that it is not known which belong together{fit}")
            }
        }
    }
}

/// Whether the times go back, once, to near the beginning: another log begins there.
fn begins_again(frames: &VecDeque<FrameObservation>) -> bool {
    let times: Vec<Ns> = frames.iter().filter_map(|frame| frame.place.elapsed).collect();
    let back: Vec<usize> = (1..times.len()).filter(|&at| times[at] < times[at - 1]).collect();
    let [at] = back[..] else { return false };
    at > 1 && times.len() > at + 1 && times[at] <= times[0] + (times[at - 1] - times[0]) / EARLY
}

/// Whether there are more answers of the unit and the function than two devices with one address would give to this request.
fn are_answers_of(key: RequestKey, answers: &[Answer<'_>]) -> bool {
    let is_of = |(unit, code, _): &Answer<'_>| (*unit, code & !EXCEPTION_BIT) == (key.unit, key.function);
    answers.len() > 2 && answers.iter().all(is_of)
}

/// Requests alone and answers alone, several of each, or one request and the answers to it of several polls, without times that would show what belongs together.
fn apart(frames: &VecDeque<FrameObservation>, requests: &[Option<RequestKey>], answers: &[Answer<'_>]) -> Option<Kind> {
    let good = || frames.iter().filter(|frame| frame.verdict.is_good());
    let is_bare = good().all(|one| one.place.elapsed.is_none() && one.mode != Mode::Tcp && one.direction != Direction::Unknown);
    let turns = good().zip(good().skip(1)).filter(|(one, next)| one.direction != next.direction).count();
    let are_requests_first = good().next().is_some_and(|first| first.direction == Direction::Request);
    let are_polls = are_requests_first && matches!(requests, [Some(key)] if are_answers_of(*key, answers));
    if !is_bare || turns != 1 || !(are_polls || (requests.len() > 1 && answers.len() > 1)) {
        return None;
    }
    let fits = |key: &Option<RequestKey>, (unit, code, frame): &Answer<'_>| {
        let is_of = |key: &RequestKey| (key.unit, key.function) == (*unit, code & !EXCEPTION_BIT);
        let has_length =
            |key: &RequestKey| code & EXCEPTION_BIT != 0 || answer_length(key.function, key.quantity) == Some(frame.length);
        key.as_ref().is_some_and(|key| is_of(key) && has_length(key))
    };
    let fit = (are_polls || requests.len() == answers.len())
        && answers.iter().zip(requests.iter().cycle()).all(|(answer, key)| fits(key, answer));
    Some(Kind::Apart { requests: requests.len(), answers: answers.len(), are_requests_first, fit })
}
