//! What units, functions, lengths and turns of frames cost on this line.

use crate::rtu_model::log2::log2;
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::{FramePosition, LearnedShare, TrafficModel};
use crate::weights::{self, function_prior, unit_prior, PRIOR_WEIGHT_FRAMES};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};

impl TrafficModel {
    /// Cost of a unit number, in bits.
    pub fn unit_cost(&self, unit: u8) -> f32 {
        self.unit_cost_if_seen(unit, self.unit_count(unit))
    }

    /// Cost of a unit number, in bits, if it had been seen this often.
    pub fn unit_cost_if_seen(&self, unit: u8, count: f32) -> f32 {
        let count = count + PRIOR_WEIGHT_FRAMES * unit_prior(unit);
        -log2(count / (self.unit_total + PRIOR_WEIGHT_FRAMES))
    }

    /// How often a unit was seen lately.
    pub fn unit_count(&self, unit: u8) -> f32 {
        self.units[usize::from(unit)]
    }

    /// Cost of a function code in a direction, in bits.
    pub fn function_cost(&self, functions: &Functions, code: u8, direction: usize) -> f32 {
        self.function_cost_if_seen(functions, code, direction, self.function_count(code, direction))
    }

    /// Cost of a function code in a direction, in bits, if it had been seen this often.
    pub fn function_cost_if_seen(&self, functions: &Functions, code: u8, direction: usize, count: f32) -> f32 {
        let count = count + PRIOR_WEIGHT_FRAMES * function_prior(functions, code & !EXCEPTION_BIT);
        -log2(count / (self.function_totals[direction] + PRIOR_WEIGHT_FRAMES))
    }

    /// The least that a function code can cost, in bits, in either direction, if it was never seen and the table has no row of it.
    pub fn least_cost_of_new_function(&self) -> f32 {
        let total = self.function_totals[REQUEST].min(self.function_totals[RESPONSE]);
        log2((total + PRIOR_WEIGHT_FRAMES) / (PRIOR_WEIGHT_FRAMES * weights::NAMED_FUNCTION_SHARE))
    }

    /// Whether a function was seen lately in either direction, exceptions included.
    pub fn has_function(&self, code: u8) -> bool {
        [REQUEST, RESPONSE].iter().any(|&direction| self.function_count(code, direction) > 0.0)
    }

    /// How often a function was seen lately in a direction, exceptions included.
    pub fn function_count(&self, code: u8, direction: usize) -> f32 {
        self.functions[direction][usize::from(code & !EXCEPTION_BIT)]
    }

    /// Whether unit and function are both common on this line, so that such a header needs no further proof.
    pub fn is_familiar(&self, unit: u8, code: u8, direction: usize) -> bool {
        self.unit_count(unit) >= weights::FAMILIAR_FRAMES && self.function_count(code, direction) >= weights::FAMILIAR_FRAMES
    }

    /// Whether this unit has been seen.
    pub fn has_unit(&self, unit: u8) -> bool {
        self.unit_count(unit) > 0.0
    }

    /// Whether this unit has been seen, and this function in either direction, together or apart.
    pub fn has_unit_and_function(&self, unit: u8, code: u8) -> bool {
        self.has_unit(unit) && self.has_function(code)
    }

    /// What a request is worth, in bits, for being one that was seen before: its body is known then.
    pub fn polled_request_score(&self, frame: &[u8]) -> f32 {
        if !self.poll_cycle.contains(frame) {
            return 0.0;
        }
        let body = self.bits_of(&frame[2..frame.len() - 2]);
        (body - weights::POLL_CHOICE_BITS).clamp(0.0, weights::MAX_POLLED_REQUEST_BITS)
    }

    /// Cost in bits of the length of a body whose layout is not public.
    pub fn open_length_cost(&self, code: u8, direction: usize, body: &[u8]) -> f32 {
        let count_bits = body.first().map_or(0.0, |&count| self.bits(count));
        self.lengths.cost(code, direction, body, count_bits)
    }
}

/// What it costs in bits that a unit is silent after a request to it, and that it answers.
#[derive(Clone, Copy)]
pub struct SilenceCosts {
    /// No response comes.
    pub silent: f32,
    /// One comes.
    pub answered: f32,
}

impl SilenceCosts {
    /// Of a unit that does not answer this share of requests.
    pub fn of_share(share: f32) -> Self {
        Self { silent: -log2(share), answered: -log2(1.0 - share) }
    }
}

/// What it costs in bits that a request is heard twice, because the tap's adapter echoes it, and once only.
#[derive(Clone, Copy)]
pub struct EchoCosts {
    /// With its echo.
    pub twice: f32,
    /// Without.
    pub once: f32,
}

/// Turns: whose frame is due, and how often nobody keeps to that.
impl TrafficModel {
    /// Cost in bits of a request at this position for the turn that it takes, by how often the line has shown one there: while
    /// another is outstanding, that one stays unanswered. Where requests are hardly heard at all, a lone one is as rare.
    pub fn request_turn_cost(&self, position: FramePosition) -> f32 {
        if position.request_outstanding {
            let (unanswered, prior) = self.unanswered_at(position);
            return -log2(unanswered.with_prior(prior));
        }
        let (unsolicited, prior) = self.unsolicited_at(position);
        -log2(1.0 - unsolicited.with_prior(prior)) - log2(unsolicited.relative_rest(prior))
    }

    /// The same of a response that answers nothing.
    pub fn unsolicited_turn_cost(&self, position: FramePosition) -> f32 {
        if position.request_outstanding {
            let (unanswered, prior) = self.unanswered_at(position);
            return weights::UNSOLICITED_BITS - 2.0 * log2(unanswered.relative_rest(prior));
        }
        let (unsolicited, prior) = self.unsolicited_at(position);
        -log2(unsolicited.with_prior(prior))
    }

    /// Requests among the frames at such a position while one is outstanding, and their share on other lines.
    fn unanswered_at(&self, position: FramePosition) -> (LearnedShare, f32) {
        let index = position.index();
        let prior = [weights::PRIOR_UNANSWERED_SHARE, weights::PRIOR_UNANSWERED_AFTER_UNFRAMED_SHARE][index];
        (self.unanswered[index], prior)
    }

    /// Responses among the frames at such a position while no request is outstanding, and their share on other lines.
    fn unsolicited_at(&self, position: FramePosition) -> (LearnedShare, f32) {
        let index = position.index();
        let prior = [weights::PRIOR_UNSOLICITED_SHARE, weights::PRIOR_UNSOLICITED_AFTER_UNFRAMED_SHARE][index];
        (self.unsolicited[index], prior)
    }

    /// How much the times of responses say at this position: 1 where every other request has one at least, 0 where none has.
    pub fn heard_responses(&self, position: FramePosition) -> f32 {
        self.unanswered[position.index()].relative_rest(weights::PRIOR_UNANSWERED_SHARE)
    }

    /// Whether the line has shown a request that cannot be a response by its layout.
    pub fn has_plain_requests(&self, functions: &Functions) -> bool {
        let is_plain = |code: u8| functions.row(code, &[]).is_some_and(|row| !row.has_equal_layouts);
        (1..EXCEPTION_BIT).any(|code| self.functions[REQUEST][usize::from(code)] > 0.5 && is_plain(code))
    }

    /// Log2 of the odds that both sides of the line are heard, by the share of requests that have a response, where each frame
    /// may be a request or a response by its layout.
    pub fn odds_of_two_sides(&self) -> f32 {
        let unanswered = self.unanswered[0];
        let answered = unanswered.all - unanswered.hits;
        if unanswered.all < PRIOR_WEIGHT_FRAMES {
            // One that is not answered is rare with both sides, and the rule with one.
            let shown =
                unanswered.hits * log2(weights::PRIOR_UNANSWERED_SHARE) - answered * log2(weights::PRIOR_SAME_AGAIN_SHARE);
            (weights::TWO_SIDES_ODDS_BITS + shown).clamp(weights::ONE_SIDE_ODDS_BITS, weights::TWO_SIDES_ODDS_BITS)
        } else if answered < weights::ONE_SIDE_ANSWERED_SHARE * unanswered.all {
            weights::ONE_SIDE_ODDS_BITS
        } else {
            weights::CERTAIN_DIRECTION_BITS
        }
    }

    /// Whether nearly all that is heard are responses, so that two equal frames are two of these.
    pub fn hears_responses_only(&self) -> bool {
        self.unsolicited[0].relative_rest(weights::PRIOR_UNSOLICITED_SHARE) < weights::ONE_SIDE_SHARE
    }

    /// The costs of silence and response of a unit at this position: by what the unit itself has shown and, as long as that is
    /// little, by what the line has.
    pub fn silence_costs(&self, unit: u8, position: FramePosition) -> SilenceCosts {
        SilenceCosts::of_share(self.silence_share(unit, position))
    }

    /// The share of requests to a unit at this position that it does not answer, by which `silence_costs` goes.
    #[inline]
    pub fn silence_share(&self, unit: u8, position: FramePosition) -> f32 {
        let (unanswered, prior) = self.unanswered_at(position);
        self.silences[usize::from(unit)].with_prior(unanswered.with_prior(prior))
    }

    /// Cost in bits of a request that is the last one again, which was answered.
    pub fn same_again_cost(&self) -> f32 {
        -log2(self.same_again)
    }

    /// Cost in bits of the late response to a request that was repeated.
    pub fn late_response_cost(&self) -> f32 {
        -log2(self.late_responses.with_prior(weights::PRIOR_LATE_RESPONSE_SHARE))
    }

    /// A retry got its response (`false`), or the late response to the first request came after that (`true`).
    ///
    /// A late response is one more hit, but no further chance: the retry before it was counted as one.
    pub fn learn_late_response(&mut self, is_late: bool) {
        let LearnedShare { hits, all } = &mut self.late_responses;
        *if is_late { hits } else { all } += 1.0;
        if self.late_responses.all > weights::HALVE_TURNS_FRAMES {
            self.late_responses.hits /= 2.0;
            self.late_responses.all /= 2.0;
        }
    }

    /// Whether requests are rather heard twice than once.
    pub fn has_echo(&self) -> bool {
        let EchoCosts { twice, once } = self.echo_costs();
        twice < once
    }

    /// The costs of hearing a request twice and once: by the learned share of requests heard twice. Where the tap's adapter
    /// echoes what it sends, those are nearly all.
    pub fn echo_costs(&self) -> EchoCosts {
        let prior = PRIOR_WEIGHT_FRAMES * weights::PRIOR_ECHO_SHARE;
        let share = (self.repeated_requests + prior) / (self.requests + PRIOR_WEIGHT_FRAMES);
        let share = share.clamp(weights::MIN_ECHO_SHARE, weights::MAX_ECHO_SHARE);
        EchoCosts { twice: -log2(share), once: -log2(1.0 - share) }
    }
}
