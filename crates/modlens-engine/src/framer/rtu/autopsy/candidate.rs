//! What a gap may hold: damaged frames by the templates that they fit, and strangers by their header.

use crate::framer::harm::Harm;
use crate::framer::rtu::autopsy::align::{self, align, Fit};
use crate::framer::rtu::autopsy::template::{self, Template};
use crate::framer::rtu::autopsy::{Scene, ENDS_WELL, ENOUGH, MOST_STRAYS, ROUNDING, STRAY};
use crate::framer::rtu::costs;
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::index::{may_be, possible, Set};
use crate::framer::rtu::AROUND;
use modlens_protocol::framing::RTU_LIMIT;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

pub(super) struct Candidate {
    pub(super) start: usize,
    /// The next one may begin here.
    pub(super) core: usize,
    /// Where it should end.
    pub(super) end: Option<usize>,
    pub(super) score: f32,
    pub(super) direction: usize,
    /// Unit and function code.
    pub(super) header: [u8; 2],
    /// What unit and function cost: nothing where the request before says them.
    pub(super) novelty: f32,
    pub(super) head: Vec<u8>,
    pub(super) harm: Option<Harm>,
    /// With what is known of it, the checksum is right.
    pub(super) mended: bool,
    /// What is known of it agrees, but the checksum is wrong.
    pub(super) exact: bool,
    /// All of it is known, and it agrees up to here.
    pub(super) open_at: Option<usize>,
}

impl Scene<'_, '_> {
    /// What the frames around let one expect.
    pub(super) fn expected(&self, around: &[Template<'_>], start: usize, candidates: &mut Vec<Candidate>) {
        let bytes = &self.bytes()[start..];
        let has = |place: usize, byte: u8| {
            let of = around.iter().enumerate();
            of.fold(0, |set: Set, (at, template)| set | Set::from(may_be(&template.bytes, place, byte)) << at)
        };
        for at in members(possible(bytes, has)) {
            candidates.extend(self.candidate(&around[at], start));
        }
    }

    /// What the poll cycle, and the units and functions of the line let one expect.
    pub(super) fn candidates(&self, start: usize, candidates: &mut Vec<Candidate>) {
        let bytes = &self.bytes()[start..];
        let polls = &self.model.polls;
        let mut likely = if polls.is_empty() { 0 } else { polls.possible(bytes) };
        if likely != 0 {
            let need = ENOUGH + self.place(start) - ENDS_WELL + template::POLL;
            likely = polls.likely(likely, bytes, |byte| self.model.bits(byte), need, &align::COSTS);
        }
        for at in members(likely) {
            candidates.extend(self.candidate(&template::poll(polls.get(at)), start));
        }
        if self.context.known_units[usize::from(bytes[0])] || self.input.offset() == 0 {
            candidates.extend([REQUEST, RESPONSE].into_iter().filter_map(|direction| self.stranger(start, direction)));
        }
    }

    /// The frame of this template that may begin here.
    pub(super) fn candidate(&self, template: &Template<'_>, start: usize) -> Option<Candidate> {
        let place = self.place(start);
        let least = enough(template.direction, 0.0);
        let fit = align(self.model, template, &self.bytes()[start..], least + place - ENDS_WELL - ROUNDING)?;
        let end = fit.length.map(|length| start + length);
        let score = fit.score - place + self.ends_well(end);
        (score > 0.0 && score >= least).then(|| Candidate::new(template, &fit, start, end, score))
    }

    /// A frame that nothing lets one expect, from a unit and with a function that the line has shown.
    pub(super) fn stranger(&self, start: usize, direction: usize) -> Option<Candidate> {
        let &[unit, code, ref body @ ..] = &self.bytes()[start..] else { return None };
        let function = code & !EXCEPTION_BIT;
        let other_line = self.context.speaker.is_some_and(|speaker| speaker != gain::direction(direction));
        if function == 0 || other_line || (code != function && direction == REQUEST) {
            return None;
        }
        let novelty = self.model.unit(unit) + self.model.function(self.context.functions, code, direction);
        let mut score = self.model.bits(unit) + self.model.bits(code) - novelty - self.place(start);
        if direction == RESPONSE && !self.is_by_itself() {
            score -= costs::ORPHAN;
        }
        let row = self.context.functions.row(function, body);
        let length = if code == function {
            let extent = row.map(|row| if direction == REQUEST { row.request.extent(body) } else { row.response.extent(body) });
            match extent {
                Some(Extent::Exactly(length)) => Some(length + AROUND),
                _ => None,
            }
        } else {
            score -= costs::EXCEPTION;
            Some(5)
        };
        if let Some(row) = row.filter(|_| code == function) {
            score += row.permits[direction].iter().map(|permit| gain::permitted(self.model, permit, body)).sum::<f32>();
        }
        let end = length.filter(|&length| length <= RTU_LIMIT).map(|length| start + length);
        score += self.ends_well(end);
        let header = [unit, code];
        (score > 0.0 && score >= enough(direction, novelty)).then_some(Candidate {
            start,
            core: (start + 3).min(self.length),
            end,
            score,
            direction,
            header,
            novelty,
            head: Vec::new(),
            harm: None,
            mended: false,
            exact: true,
            open_at: None,
        })
    }

    /// What it costs to begin here.
    pub(super) fn place(&self, start: usize) -> f32 {
        if start == 0 {
            let alone = self.context.speaker.is_some() && self.stops(0);
            return if alone { -costs::PAUSE_BEFORE } else { 0.0 };
        }
        let strays = (STRAY * start as f32).min(MOST_STRAYS);
        let paused = self.input.pause_before(start).is_some_and(|pause| pause >= self.silence);
        if paused {
            strays - costs::PAUSE_BEFORE
        } else {
            strays
        }
    }

    pub(super) fn ends_well(&self, end: Option<usize>) -> f32 {
        let well = end.is_some_and(|end| {
            (end == self.length && !self.announced)
                || (end <= self.length && self.input.pause_before(end).is_some_and(|pause| pause >= self.silence))
        });
        if well {
            ENDS_WELL
        } else {
            0.0
        }
    }
}

/// What a candidate has to be worth to change anything. An answer counts for more behind its request.
fn enough(direction: usize, novelty: f32) -> f32 {
    if direction == RESPONSE {
        ENOUGH - novelty - costs::ORPHAN - ROUNDING
    } else {
        ENOUGH
    }
}

/// The numbers in a set, the lowest first.
fn members(mut set: Set) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let at = (set != 0).then(|| set.trailing_zeros() as usize);
        set &= set.wrapping_sub(1);
        at
    })
}

impl Candidate {
    fn new(template: &Template<'_>, fit: &Fit, start: usize, end: Option<usize>, score: f32) -> Self {
        Self {
            start,
            core: start + fit.core,
            end,
            score,
            direction: template.direction,
            header: [template.bytes[0], template.bytes[1]],
            novelty: 0.0,
            head: template.bytes[..fit.head].to_vec(),
            harm: fit.harm,
            mended: fit.mended,
            exact: fit.exact,
            open_at: fit.length.filter(|&length| fit.head == 0 && length == template.bytes.len()).map(|_| fit.same),
        }
    }
}
