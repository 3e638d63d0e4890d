//! What the line has carried lately: the values of its registers, and its responses until they were passed on.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

use modlens_protocol::register_type::Space;
use modlens_protocol::Ns;

use super::exchange::{Block, Exchange};

/// Registers whose latest value is remembered; with more, the memory starts again.
const MAX_REGISTERS: usize = 1 << 18;

/// Requests whose latest response is remembered; with more, the memory starts again.
const MAX_REQUESTS: usize = 1 << 14;

/// The client whose request made the gateway ask on the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Owner {
    pub number: u64,
    pub client: Option<Arc<str>>,
    pub connection: Option<u64>,
}

/// A response of the line.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    /// The transaction on the line.
    pub number: u64,
    pub end: Ns,
    pub unit: u8,
    pub request: Box<[u8]>,
    pub response: Box<[u8]>,
    pub owner: Option<Owner>,
    /// Whether its owner has received it.
    pub is_delivered: bool,
}

/// The value of a register, and when the line had it first and last without another one between.
#[derive(Clone, Copy, Debug)]
struct Known {
    value: i32,
    first: Ns,
    last: Ns,
}

/// Unit and PDU of a request.
type Question = (u8, Box<[u8]>);

/// The memory of the line.
#[derive(Debug, Default)]
pub(super) struct LineMemory {
    registers: HashMap<(u8, Space, u16), Known>,
    /// The latest response to each request, and when it was complete.
    responses: HashMap<Question, (Box<[u8]>, Ns)>,
    answers: VecDeque<Answer>,
    /// Requests without a response, whose response may still come.
    unanswered: VecDeque<Answer>,
}

impl LineMemory {
    /// Remembers a transaction of the line and who caused it.
    pub fn add(&mut self, one: &Exchange, owner: Option<Owner>) {
        if one.is_answered() {
            if self.responses.len() > MAX_REQUESTS {
                self.responses.clear();
            }
            let response = (one.response.clone(), one.end.unwrap_or(one.start));
            self.responses.insert((one.unit, one.request.clone()), response);
        }
        for block in [&one.read, &one.written].into_iter().flatten() {
            self.remember(one.unit, block, one.end.unwrap_or(one.start));
        }
        let answer = Answer {
            number: one.number,
            end: one.end.unwrap_or(one.start),
            unit: one.unit,
            request: one.request.clone(),
            response: one.response.clone(),
            owner,
            is_delivered: false,
        };
        match (one.late_response_to, one.is_answered()) {
            (Some(number), _) => {
                if let Some(asked) = self.unanswered.iter().find(|asked| asked.number == number) {
                    let (owner, request) = (asked.owner.clone(), asked.request.clone());
                    self.answers.push_back(Answer { request, owner, ..answer });
                }
            }
            (None, true) => self.answers.push_back(answer),
            (None, false) => self.unanswered.push_back(answer),
        }
    }

    fn remember(&mut self, unit: u8, (space, first, values): &Block, time: Ns) {
        if self.registers.len() > MAX_REGISTERS {
            self.registers.clear();
        }
        for (at, value) in values.iter().enumerate() {
            let register = (unit, *space, first.wrapping_add(at as u16));
            let known = self.registers.entry(register).or_insert(Known { value: *value, first: time, last: time });
            *known = Known { value: *value, first: if known.value == *value { known.first } else { time }, last: time };
        }
    }

    /// Since when a gateway can have known this response at a time: that of the line to the same request, or values that were
    /// on the line one by one; `None` if the line had not had them by then.
    pub fn since(&self, unit: u8, one: &Exchange, until: Ns) -> Option<Ns> {
        let lately = self.equal(&one.response, until).find(|answer| answer.unit == unit && answer.request == one.request);
        let before = || {
            let (response, time) = self.responses.get(&(unit, one.request.clone()))?;
            (*response == one.response && *time <= until).then_some(*time)
        };
        lately.map(|answer| answer.end).or_else(before).or_else(|| self.values_since(unit, one.read.as_ref()?, until))
    }

    fn values_since(&self, unit: u8, (space, first, values): &Block, until: Ns) -> Option<Ns> {
        let known = values.iter().enumerate().map(|(at, value)| {
            let known = self.registers.get(&(unit, *space, first.wrapping_add(at as u16)))?;
            let time = if known.last <= until { known.last } else { known.first };
            (known.value == *value && time <= until).then_some(time)
        });
        known.collect::<Option<Vec<Ns>>>()?.into_iter().min()
    }

    /// Whether the line has answered the same request again by then.
    pub fn is_replaced(&self, old: &Answer, until: Ns) -> bool {
        let is_newer = |answer: &Answer| answer.unit == old.unit && answer.request == old.request && answer.end <= until;
        self.answers.iter().rev().take_while(|answer| answer.number != old.number).any(is_newer)
    }

    /// The responses that equal this one and were complete by `until`, the latest first.
    pub fn equal<'a>(&'a self, response: &'a [u8], until: Ns) -> impl Iterator<Item = &'a Answer> + 'a {
        self.answers.iter().rev().filter(move |answer| answer.end <= until && *answer.response == *response)
    }

    /// Notes that a client has received the response to its own request.
    pub fn delivered(&mut self, number: u64) {
        if let Some(answer) = self.answers.iter_mut().rev().find(|answer| answer.number == number) {
            answer.is_delivered = true;
        }
    }

    /// Forgets responses older than this.
    pub fn forget(&mut self, before: Ns) {
        while self.answers.front().is_some_and(|answer| answer.end < before) {
            self.answers.pop_front();
        }
        while self.unanswered.front().is_some_and(|answer| answer.end < before) {
            self.unanswered.pop_front();
        }
    }
}
