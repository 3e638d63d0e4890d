//! How certain the direction of a write is where its response repeats it byte by byte.
//!
//! In a row of equal frames the search finds the likeliest directions, but each of them hangs on the one before: if one is
//! wrong, all after it are. So the odds are handed on from frame to frame. They fall with each frame that another direction
//! explains nearly as well, and rise where the clock shows a response time from a pause of the master. Any other frame begins
//! again.

use crate::framer::rtu::context_score::mirrors_request;
use crate::framer::rtu::search::state::Search;
use crate::framer::{FramerContext, PauseEvidence};
use crate::rtu_model::answerable::{fingerprint, AnswerableRequest, Fingerprint};
use crate::rtu_model::side::RESPONSE;
use crate::rtu_model::traffic_model::{EchoCosts, FramePosition, SilenceCosts};
use crate::weights;
use modlens_protocol::checksum::CRC_BYTES;

/// What a frame is in a row of equal frames.
#[derive(Clone, Copy, PartialEq, Eq)]
enum PlaceInRun {
    /// The response to the outstanding request.
    Response,
    /// The request that was just answered.
    Again,
    /// The request whose response came damaged, or a response after the damaged retry of its request.
    AfterDamaged,
    /// The outstanding request, for the first time.
    SecondCopy,
    /// The outstanding request, which was heard twice already.
    LaterCopy,
    /// The response to no outstanding request: one that is late, or of which the request is missing.
    Unasked,
}

impl Search {
    /// Log2 of the odds of this frame's direction, at most `CERTAIN_DIRECTION_BITS`, given what was committed before it; kept
    /// for the frame after it. `frame` has its CRC; `pause` is what the silence before it says.
    pub(super) fn next_run_odds(
        &mut self,
        context: &FramerContext<'_>,
        frame: &[u8],
        (direction, answers_outstanding): (usize, bool),
        pause: PauseEvidence,
    ) -> f32 {
        let place = if context.is_multi_line { None } else { self.place_in_run(context, frame, direction, answers_outstanding) };
        let odds = place.map_or(MAX_ODDS, |place| {
            self.odds_at(place, self.silence_costs(frame[0]), pause).min(self.odds_without_echo(pause))
        });
        self.run_odds = odds.clamp(MIN_ODDS, MAX_ODDS);
        self.run_odds.min(self.odds_of_two_sides(context, frame))
    }

    /// Log2 of the odds that a frame of a row of equal frames is no echo and follows none. With a clock the silences tell.
    fn odds_without_echo(&self, pause: PauseEvidence) -> f32 {
        let EchoCosts { twice, once } = self.model.echo_costs();
        if pause.timeout == 0.0 {
            (twice - once).abs()
        } else {
            MAX_ODDS
        }
    }

    /// Log2 of the odds that both sides of the line are heard, as far as the direction of this frame hangs on that: where it may
    /// be a request or a response, and so may all requests before it.
    fn odds_of_two_sides(&self, context: &FramerContext<'_>, frame: &[u8]) -> f32 {
        let may_be_either = !context.is_multi_line && mirrors_request(context, &frame[1..frame.len() - CRC_BYTES]);
        if may_be_either && !self.model.has_plain_requests(context.functions) {
            self.model.odds_of_two_sides()
        } else {
            MAX_ODDS
        }
    }

    /// Begins again: the frame committed last is no doubtful one.
    pub fn begin_run(&mut self) {
        self.run_odds = MAX_ODDS;
    }

    /// The same for a response that equals its request and that the fast path found. `is_last`: no third copy follows.
    pub fn mirrored_response_odds(&self, unit: u8, pause: PauseEvidence, is_last: bool) -> f32 {
        self.odds_of_mirrored_response(self.silence_share(unit), pause, is_last)
    }

    /// The same of a unit that does not answer this share of requests.
    pub fn odds_of_mirrored_response(&self, silence_share: f32, pause: PauseEvidence, is_last: bool) -> f32 {
        let costs = SilenceCosts::of_share(silence_share);
        let odds = self.odds_at(PlaceInRun::Response, costs, pause);
        // Else the retry would have had no response either.
        let no_response = if is_last { costs.silent } else { 0.0 };
        (odds + no_response).clamp(MIN_ODDS, MAX_ODDS)
    }

    /// The share of requests that a unit does not answer, with no unframed bytes between.
    #[inline]
    pub fn silence_share(&self, unit: u8) -> f32 {
        self.model.silence_share(unit, BEHIND_REQUEST)
    }

    /// What a frame is in a row of equal frames, given what was committed before it; `None` for any other frame. `frame` has its
    /// CRC; `direction` is `REQUEST` or `RESPONSE`.
    fn place_in_run(
        &self,
        context: &FramerContext<'_>,
        frame: &[u8],
        direction: usize,
        answers_outstanding: bool,
    ) -> Option<PlaceInRun> {
        let requests = self.answerable();
        let is_unasked = direction == RESPONSE && !answers_outstanding && !self.model.hears_responses_only();
        if is_unasked && mirrors_request(context, &frame[1..frame.len() - CRC_BYTES]) {
            return Some(PlaceInRun::Unasked);
        }
        let equals = |request: &AnswerableRequest| request.unit == frame[0] && request.pdu == frame[1..frame.len() - CRC_BYTES];
        let Some(outstanding) = requests.outstanding else {
            let (answered, last) = requests.last_answered.filter(|_| direction != RESPONSE)?;
            let is_as_long = last >> u16::BITS == frame.len() as Fingerprint;
            return match equals(answered) {
                true if last == fingerprint(frame) => Some(PlaceInRun::Again),
                true if is_as_long && mirrors_request(context, &answered.pdu) => Some(PlaceInRun::AfterDamaged),
                _ => None,
            };
        };
        match direction {
            _ if !equals(outstanding) || !mirrors_request(context, &outstanding.pdu) => None,
            RESPONSE => answers_outstanding.then_some(PlaceInRun::Response),
            _ if outstanding.is_repeated => Some(PlaceInRun::LaterCopy),
            _ => Some(PlaceInRun::SecondCopy),
        }
    }

    /// What silence and response of a unit cost after a request to it, in bits, with no unframed bytes between.
    fn silence_costs(&self, unit: u8) -> SilenceCosts {
        self.model.silence_costs(unit, BEHIND_REQUEST)
    }

    /// The odds of a frame at this place: against what else it may be, and against an error before it. The costs are those of its
    /// unit.
    fn odds_at(&self, place: PlaceInRun, SilenceCosts { silent, answered }: SilenceCosts, pause: PauseEvidence) -> f32 {
        // The frame as the response, against the frame as the next request.
        let response_bits = || self.model.same_again_cost() - answered - pause.poll;
        let retry_cost = silent + weights::RETRY_CHOICE_BITS;
        match place {
            PlaceInRun::Response if self.run_odds >= MAX_ODDS => retry_cost - answered - pause.timeout,
            PlaceInRun::Response => both(retry_cost - answered - pause.timeout, self.run_odds + response_bits()),
            PlaceInRun::Again => both(weights::COPIED_RESPONSE_BITS - response_bits(), self.run_odds - response_bits()),
            // Without a clock nothing speaks against a request.
            PlaceInRun::Unasked | PlaceInRun::AfterDamaged if pause.timeout == 0.0 => MIN_ODDS,
            PlaceInRun::AfterDamaged => MAX_ODDS,
            PlaceInRun::Unasked => weights::UNASKED_MIRROR_ODDS_BITS,
            PlaceInRun::LaterCopy => pause.timeout - retry_cost + answered,
            PlaceInRun::SecondCopy => {
                let EchoCosts { twice, once } = self.model.echo_costs();
                (pause.timeout - retry_cost + answered).max(once - twice + pause.too_soon_bits[0])
            }
        }
    }
}

/// Right after a request.
const BEHIND_REQUEST: FramePosition = FramePosition { request_outstanding: true, unframed_bytes: 0 };

/// Of a unit that does not answer so few requests, or fewer, the odds of a response that equals its request are beyond those that
/// limit a confidence, without times (`confidence::of_direction`).
pub const SURE_SILENCE_SHARE: f32 = 1.0 / 64.0;

const MAX_ODDS: f32 = weights::CERTAIN_DIRECTION_BITS;

/// The search has found nothing likelier.
const MIN_ODDS: f32 = 1.0;

/// The odds that neither of two errors was made, given the odds against each.
fn both(first: f32, second: f32) -> f32 {
    -((-first).exp2() + (-second).exp2()).log2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::confidence::{self, Likeness};

    #[test]
    fn a_small_share_of_silence_limits_no_confidence() {
        let (search, most) = (Search::default(), confidence::of_unambiguous(Likeness::EqualLayouts));
        for share in (1..=1000).map(|part| SURE_SILENCE_SHARE * part as f32 / 1000.0) {
            let odds = search.odds_of_mirrored_response(share, PauseEvidence::default(), true);
            assert!(confidence::of_direction(odds) >= most, "{share}");
        }
    }
}
