//! Learning from runs of unambiguous exchanges: what is the same of all is learned once a run.
//!
//! Counts are floating-point numbers that are halved at times, so that their additions may be rounded. A run has to leave them
//! as the same exchanges one by one would, to the bit.

use crate::ones::add_ones;
use crate::rtu_model::answerable::{fingerprint, Fingerprint};
use crate::rtu_model::poll_cycle::RequestName;
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::{LearnedShare, RequestCopy, TrafficModel};
use crate::weights;
use modlens_protocol::functions::EXCEPTION_BIT;

/// Frames of an exchange.
const FRAMES: u32 = 2;

/// Exchanges of which the model has not learned yet what is the same of all.
#[derive(Debug, Default)]
pub struct LearningRun {
    exchanges: u32,
    /// Those of them of which it has learned that the request was answered in its turn.
    answered: u32,
    /// Those of them whose response has not the same bytes as the request.
    first_requests: u32,
    /// How many more there may be before counts are halved.
    left: u32,
}

/// What the model knows a request by.
#[derive(Clone, Copy, Debug)]
pub struct RequestIdentity {
    unit: u8,
    code: u8,
    name: RequestName,
    fingerprint: Fingerprint,
}

impl RequestIdentity {
    /// That of a request, which has its CRC.
    #[inline]
    pub fn of(request: &[u8]) -> Self {
        Self { unit: request[0], code: request[1], name: RequestName::of(request), fingerprint: fingerprint(request) }
    }
}

impl LearningRun {
    /// How many exchanges may follow before the next `begin_run`.
    pub fn left(&self) -> u32 {
        self.left
    }

    /// Counts so many exchanges, not more than are left; `first_requests` of them have a response without the same bytes as the
    /// request.
    #[inline]
    pub fn count(&mut self, exchanges: u32, first_requests: u32) {
        self.left -= exchanges;
        self.exchanges += exchanges;
        self.first_requests += first_requests;
    }
}

impl TrafficModel {
    /// Learns from an exchange what `learn_exchange` learns, some of it only with the next `learn_run`: what is the same of all
    /// exchanges of a run. `copy` is `First`, or `Unclear` where the response may have the same bytes as the request.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Of a read that came before, the length is known to the caller.
    pub fn learn_in_run(&mut self, run: &mut LearningRun, request: &[u8], response: &[u8], copy: RequestCopy) {
        if run.left == 0 && !self.begin_run(run) {
            self.learn_exchange(request, response, copy);
            return;
        }
        run.count(1, u32::from(copy == RequestCopy::First));
        self.learn_request(&RequestIdentity::of(request), request);
    }

    /// Learns from an exchange of a run what differs from one to the next.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    pub fn learn_request(&mut self, identity: &RequestIdentity, request: &[u8]) {
        let RequestIdentity { unit, code, name, fingerprint } = *identity;
        let seen = &mut self.units[usize::from(unit)];
        // One frame after the other, since each sum is rounded.
        *seen += 1.0;
        *seen += 1.0;
        for direction in [REQUEST, RESPONSE] {
            self.functions[direction][usize::from(code & !EXCEPTION_BIT)] += 1.0;
        }
        self.poll_cycle.record_as(name, request);
        self.learn_silence(unit, false);
        self.learn_same_again_as(fingerprint, false);
    }

    /// Learns the run so far, and finds how many exchanges may follow before counts are halved; false if none may.
    #[cold]
    pub fn begin_run(&mut self, run: &mut LearningRun) -> bool {
        self.learn_run(run);
        // One is left out, so that no rounding matters.
        run.left = ((weights::HALVE_COUNTS_FRAMES - self.unit_total) / FRAMES as f32 - 1.0) as u32;
        run.left > 0
    }

    /// Learns from the exchanges of a run that their requests were answered.
    #[inline]
    pub fn learn_answers(&mut self, run: &mut LearningRun) {
        self.unanswered[0].learn_misses(run.exchanges - run.answered);
        run.answered = run.exchanges;
    }

    /// Learns from the exchanges of a run what is the same of all of them. The run may go on.
    pub fn learn_run(&mut self, run: &mut LearningRun) {
        self.learn_answers(run);
        run.answered = 0;
        let exchanges = std::mem::take(&mut run.exchanges);
        self.unsolicited[0].learn_misses(exchanges);
        add_ones(&mut self.requests, std::mem::take(&mut run.first_requests));
        self.function_totals.iter_mut().for_each(|total| add_ones(total, exchanges));
        add_ones(&mut self.unit_total, FRAMES * exchanges);
        add_ones(&mut self.frames, FRAMES * exchanges);
    }
}

impl LearnedShare {
    /// Counts as many chances without a hit.
    #[inline]
    fn learn_misses(&mut self, chances: u32) {
        let mut all = self.all;
        add_ones(&mut all, chances);
        if all > weights::HALVE_TURNS_FRAMES {
            self.learn_misses_beyond(chances);
        } else {
            self.all = all;
        }
    }

    /// The same where counts are halved on the way.
    #[cold]
    fn learn_misses_beyond(&mut self, mut chances: u32) {
        while chances > 0 {
            let until_halved = (weights::HALVE_TURNS_FRAMES - self.all) as u32;
            let step = until_halved.clamp(1, chances);
            add_ones(&mut self.all, step - 1);
            self.learn(false);
            chances -= step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn misses_are_learned_as_one_by_one(runs in prop::collection::vec((0u32..3000, any::<bool>()), 1..20)) {
            let (mut at_once, mut one_by_one) = (LearnedShare::default(), LearnedShare::default());
            for (chances, hit) in runs {
                at_once.learn_misses(chances);
                (0..chances).for_each(|_| one_by_one.learn(false));
                at_once.learn(hit);
                one_by_one.learn(hit);
                let bits = |share: LearnedShare| [share.hits.to_bits(), share.all.to_bits()];
                prop_assert_eq!(bits(at_once), bits(one_by_one));
            }
        }

        #[test]
        fn silence_is_counted_as_where_counts_may_be_halved(silences in prop::collection::vec(prop::bool::weighted(0.03), 0..600)) {
            let (mut in_short, mut in_full) = (TrafficModel::default(), TrafficModel::default());
            for was_silent in silences {
                in_short.learn_silence(1, was_silent);
                if was_silent || in_full.silences[1].hits > 0.0 {
                    in_full.count_silence_or_halve(1, was_silent);
                }
                prop_assert_eq!(learned(&in_short), learned(&in_full));
            }
        }

        #[test]
        fn runs_teach_what_single_exchanges_teach(
            runs in prop::collection::vec((prop::collection::vec((1u8..5, 1u8..7, 0u8..9), 0..300), any::<bool>()), 1..60),
        ) {
            let (mut in_runs, mut one_by_one) = (TrafficModel::default(), TrafficModel::default());
            for (exchanges, is_silent) in runs {
                let mut run = LearningRun::default();
                for (unit, code, address) in exchanges {
                    let request = [unit, code, 0, address, 0, 1, unit, address];
                    let copy = if code < 5 { RequestCopy::First } else { RequestCopy::Unclear };
                    one_by_one.learn_exchange(&request, &[unit, code, 2, 0, 0, 1, 2], copy);
                    in_runs.learn_in_run(&mut run, &request, &[unit, code, 2, 0, 0, 1, 2], copy);
                }
                in_runs.learn_run(&mut run);
                in_runs.learn_silence(1, is_silent);
                one_by_one.learn_silence(1, is_silent);
                prop_assert_eq!(learned(&in_runs), learned(&one_by_one));
            }
        }
    }

    /// All that exchanges teach, as bits.
    fn learned(model: &TrafficModel) -> Vec<u32> {
        let shares = [model.unsolicited, model.unanswered].concat();
        let shares = shares.iter().chain(model.silences.iter()).flat_map(|share| [share.hits, share.all]);
        let counts = model.units.iter().chain(model.functions.iter().flatten()).chain(&model.function_totals).copied();
        let others = [model.unit_total, model.frames, model.requests, model.same_again];
        shares.chain(counts).chain(others).map(f32::to_bits).collect()
    }
}
