//! What one line has shown so far, as counts, and what evidence is worth there.
//!
//! Costs are `-log2` of a learned share: of units, functions, turns of requests and responses, and bytes between frames.
//! Every share starts from a prior of the table of weights. Counts are halved from time to time, so the model follows a line
//! that changes.

mod byte_information;
mod frame_costs;
pub mod heard_sides;
mod learning_run;

pub use frame_costs::{EchoCosts, SilenceCosts};
pub use learning_run::{LearningRun, RequestIdentity};

use crate::rtu_model::answerable::{fingerprint, Fingerprint};
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::learned_lengths::LearnedLengths;
use crate::rtu_model::log2::log2;
use crate::rtu_model::poll_cycle::PollCycle;
use crate::rtu_model::score_bounds::ScoreBounds;
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::weights::{self, usual_bits, PRIOR_WEIGHT_FRAMES};
use modlens_protocol::functions::EXCEPTION_BIT;

/// What the line has shown so far.
pub struct TrafficModel {
    /// Frames by unit.
    units: [f32; 256],
    unit_total: f32,
    /// Frames by direction and function code, without the exception bit.
    functions: [[f32; 128]; 2],
    function_totals: [f32; 2],
    /// The requests seen, and those of them that come again and again.
    pub poll_cycle: PollCycle,
    frames: f32,
    /// Frames after bytes that belong to no frame.
    frames_after_unframed: f32,
    /// Frames after so few such bytes that these were no damaged frame.
    frames_after_stray_bytes: f32,
    frames_with_inner_pause: f32,
    /// Damaged frames that lack bytes.
    frames_with_losses: f32,
    /// Unframed bytes since a frame was last found to lack a flow control byte; `usize::MAX` once one of these bytes was
    /// received, because a driver that takes them out delivers none.
    unframed_since_flow_control_loss: usize,
    /// Damaged frames that another sender talked into.
    frames_with_collisions: f32,
    /// Truncated responses after which the master went on: the tap has lost the end.
    truncations_by_tap: f32,
    /// Truncated responses that the master asked for again: the sender has stopped.
    truncations_by_sender: f32,
    /// Requests whose response does not repeat them, heard once.
    requests: f32,
    /// Such requests heard twice before any response.
    repeated_requests: f32,
    /// Cost in bits of a frame right after another one.
    adjacent_cost: f32,
    /// Cost in bits of unframed bytes between two frames, however many.
    separated_cost: f32,
    /// Information content of each byte value, in bits.
    bits: [f32; 256],
    /// Probability of each byte value before any noise was seen.
    usual_shares: Box<[f32; 256]>,
    /// Noise bytes by value.
    noise: Box<[f32; 256]>,
    noise_total: f32,
    /// `noise_total` at which `bits` are computed again.
    noise_due: f32,
    /// Frames while no request is outstanding, without and with unframed bytes before them: responses among all frames.
    unsolicited: [LearnedShare; 2],
    /// Frames while a request is outstanding, without and with unframed bytes before them: requests among all frames.
    unanswered: [LearnedShare; 2],
    /// Which sides of the line are heard.
    heard_sides: HeardSides,
    /// Share of the answered requests that are sent again next.
    same_again: f32,
    /// Length and CRC of the last request.
    last_request: Option<Fingerprint>,
    /// Requests by unit: those without response among all.
    silences: Box<[LearnedShare; 256]>,
    /// Retries that got their response: those after which the late response to the first request came as well.
    late_responses: LearnedShare,
    lengths: LearnedLengths,
    /// Cached upper bounds of header scores.
    pub score_bounds: ScoreBounds,
}

/// XON and XOFF, which a driver with software flow control takes out of what it receives.
pub const FLOW_CONTROL_BYTES: [u8; 2] = [0x11, 0x13];

/// A count below this is 0.
const FORGOTTEN_FRAMES: f32 = 0.05;

/// How often something was seen among all chances of seeing it.
#[derive(Clone, Copy, Default)]
struct LearnedShare {
    hits: f32,
    all: f32,
}

impl LearnedShare {
    /// Counts one chance more. Turns are forgotten early, because timeouts come in bursts.
    fn learn(&mut self, hit: bool) {
        self.hits += f32::from(u8::from(hit));
        self.all += 1.0;
        if self.all > weights::HALVE_TURNS_FRAMES {
            self.hits /= 2.0;
            self.all /= 2.0;
        }
    }

    /// The share, given what it is on other lines.
    fn with_prior(self, prior: f32) -> f32 {
        let share = (self.hits + PRIOR_WEIGHT_FRAMES * prior) / (self.all + PRIOR_WEIGHT_FRAMES);
        share.clamp(weights::MIN_TURN_SHARE, weights::MAX_TURN_SHARE)
    }

    /// The share of the chances without it, relative to half of what that is on other lines; at most 1.
    fn relative_rest(self, prior: f32) -> f32 {
        let missed = self.all - self.hits;
        let rest = (missed + PRIOR_WEIGHT_FRAMES * (1.0 - prior)) / (self.all + PRIOR_WEIGHT_FRAMES);
        (2.0 * rest / (1.0 - prior)).min(1.0)
    }
}

/// What shows which sides of a line are heard.
#[derive(Default)]
struct HeardSides {
    /// Requests without response that were left for another one.
    left: f32,
    /// Responses that did not fit the request that was outstanding.
    unfit_responses: f32,
    /// At least half of the requests had a response, so that both sides of the line are heard.
    are_both: bool,
}

/// Where a frame stands among others.
#[derive(Clone, Copy, Debug)]
pub struct FramePosition {
    /// A request before it has not been answered.
    pub request_outstanding: bool,
    /// Bytes between it and the frame before it that belong to no frame.
    pub unframed_bytes: u64,
}

impl FramePosition {
    /// The index of counts that are kept without and with a possible damaged frame in front.
    fn index(self) -> usize {
        usize::from(self.unframed_bytes >= weights::MAY_HIDE_FRAME_BYTES)
    }
}

/// What a request is to the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestCopy {
    /// Another request.
    First,
    /// The same request again, before any response.
    Repeated,
    /// A response may look the same, so nothing is learned.
    Unclear,
}

impl Default for TrafficModel {
    /// A line that has shown nothing yet: all counts are 0, and every cost follows from the priors of the table of weights.
    fn default() -> Self {
        let mut this = Self {
            units: [0.0; 256],
            unit_total: 0.0,
            functions: [[0.0; 128]; 2],
            function_totals: [0.0; 2],
            poll_cycle: PollCycle::default(),
            frames: 0.0,
            frames_after_unframed: 0.0,
            frames_after_stray_bytes: 0.0,
            frames_with_inner_pause: 0.0,
            frames_with_losses: 0.0,
            unframed_since_flow_control_loss: 0,
            frames_with_collisions: 0.0,
            truncations_by_tap: 0.0,
            truncations_by_sender: 0.0,
            requests: 0.0,
            repeated_requests: 0.0,
            adjacent_cost: 0.0,
            separated_cost: 0.0,
            bits: std::array::from_fn(|byte| usual_bits(byte as u8)),
            usual_shares: Box::new(std::array::from_fn(|byte| (-usual_bits(byte as u8)).exp2())),
            noise: Box::new([0.0; 256]),
            noise_total: 0.0,
            noise_due: weights::NOISE_UPDATE_BYTES,
            unsolicited: [LearnedShare::default(); 2],
            unanswered: [LearnedShare::default(); 2],
            heard_sides: HeardSides::default(),
            same_again: weights::PRIOR_SAME_AGAIN_SHARE,
            last_request: None,
            silences: Box::new([LearnedShare::default(); 256]),
            late_responses: LearnedShare::default(),
            lengths: LearnedLengths::default(),
            score_bounds: ScoreBounds::default(),
        };
        this.update_costs();
        this
    }
}

/// Learning from frames.
impl TrafficModel {
    /// Computes again what depends on all counts. The search calls it whenever it has learned.
    pub fn update_costs(&mut self) {
        let unframed = self.frames_after_unframed + PRIOR_WEIGHT_FRAMES * weights::PRIOR_UNFRAMED_SHARE;
        let share = unframed / (self.frames + PRIOR_WEIGHT_FRAMES);
        let share = share.clamp(weights::MIN_UNFRAMED_SHARE, weights::MAX_UNFRAMED_SHARE);
        (self.adjacent_cost, self.separated_cost) = (-log2(1.0 - share), -log2(share));
        self.score_bounds.refresh(self.frames);
    }

    /// Learns from a committed frame with a valid CRC: whose turn it was, its unit and function, whether unframed bytes stood
    /// before it, whether requests are heard twice (`copy`), and a request for the dictionary. Costs of unframed bytes follow
    /// with `update_costs`. `halve_counts` is due after `HALVE_COUNTS_FRAMES`; counts of turns have their own limit.
    ///
    /// `frame` includes unit and CRC; `direction` is `REQUEST` or `RESPONSE`.
    #[inline]
    pub fn learn(&mut self, frame: &[u8], direction: usize, position: FramePosition, copy: RequestCopy) {
        self.learn_turn(direction, position);
        self.learn_copy(direction, copy);
        self.units[frame[0] as usize] += 1.0;
        self.unit_total += 1.0;
        self.functions[direction][(frame[1] & !EXCEPTION_BIT) as usize] += 1.0;
        self.function_totals[direction] += 1.0;
        self.frames += 1.0;
        self.frames_after_unframed += f32::from(u8::from(position.unframed_bytes > 0));
        self.count_frame_after_stray_bytes(position.unframed_bytes);
        if direction == REQUEST {
            self.poll_cycle.record(frame);
        }
        if self.unit_total > weights::HALVE_COUNTS_FRAMES {
            self.halve_counts();
        }
    }

    /// Counts a request that may have an echo, or the echo of one; a response and an unclear copy count for nothing.
    #[inline]
    fn learn_copy(&mut self, direction: usize, copy: RequestCopy) {
        match copy {
            RequestCopy::First if direction == REQUEST => self.requests += 1.0,
            RequestCopy::Repeated => self.repeated_requests += 1.0,
            RequestCopy::First | RequestCopy::Unclear => {}
        }
    }

    /// Learns whether a frame came out of turn: a request while another one was outstanding, or a response while none was.
    #[inline]
    fn learn_turn(&mut self, direction: usize, position: FramePosition) {
        if position.request_outstanding {
            self.unanswered[position.index()].learn(direction == REQUEST);
        } else {
            self.unsolicited[position.index()].learn(direction == RESPONSE);
        }
    }

    /// Learns from an unambiguous request and its response, right after another frame.
    #[inline]
    pub fn learn_exchange(&mut self, request: &[u8], response: &[u8], copy: RequestCopy) {
        self.learn(request, REQUEST, FramePosition { request_outstanding: false, unframed_bytes: 0 }, copy);
        let position = FramePosition { request_outstanding: true, unframed_bytes: 0 };
        self.learn(response, RESPONSE, position, RequestCopy::Unclear);
        self.learn_silence(request[0], false);
        self.learn_same_again(request, false);
    }

    /// Learns from this request whether the one before it, if that is not outstanding, was sent again.
    #[inline]
    pub fn learn_same_again(&mut self, request: &[u8], is_outstanding: bool) {
        self.learn_same_again_as(fingerprint(request), is_outstanding);
    }

    /// The same of a request with this fingerprint.
    #[inline]
    fn learn_same_again_as(&mut self, request: Fingerprint, is_outstanding: bool) {
        let is_same = self.last_request.replace(request) == Some(request);
        // Nearly always another request follows, and the share is as small as it gets.
        if !is_outstanding && (is_same || self.same_again > weights::MIN_TURN_SHARE) {
            let newest = f32::from(u8::from(is_same));
            let share = self.same_again + (newest - self.same_again) * weights::SAME_AGAIN_NEWEST_SHARE;
            self.same_again = share.max(weights::MIN_TURN_SHARE);
        }
    }

    /// Learns whether a unit has answered a request. Of units that always have, nothing is counted: what the line shows stands
    /// for them.
    #[inline]
    pub fn learn_silence(&mut self, unit: u8, was_silent: bool) {
        if was_silent || self.silences[usize::from(unit)].hits > 0.0 {
            self.count_silence(unit, was_silent);
        }
    }

    #[inline]
    fn count_silence(&mut self, unit: u8, was_silent: bool) {
        let LearnedShare { all, .. } = &mut self.silences[usize::from(unit)];
        // Silences are forgotten where counts are halved only.
        if was_silent || *all + 1.0 > weights::HALVE_SILENCES_FRAMES {
            self.count_silence_or_halve(unit, was_silent);
        } else {
            *all += 1.0;
        }
    }

    #[inline(never)]
    fn count_silence_or_halve(&mut self, unit: u8, was_silent: bool) {
        let LearnedShare { hits, all } = &mut self.silences[usize::from(unit)];
        *hits += f32::from(u8::from(was_silent));
        *all += 1.0;
        if *all > weights::HALVE_SILENCES_FRAMES {
            (*hits, *all) = (*hits / 2.0, *all / 2.0);
        }
        if *hits < FORGOTTEN_FRAMES {
            (*hits, *all) = (0.0, 0.0);
        }
    }

    /// Learns the length of a frame whose layout is not public.
    pub fn learn_length(&mut self, code: u8, direction: usize, body: &[u8]) {
        self.lengths.learn(code, direction, body);
    }

    /// Counts a frame that had so many unframed bytes before it, if they are few.
    pub fn count_frame_after_stray_bytes(&mut self, bytes: u64) {
        self.frames_after_stray_bytes += f32::from(u8::from((1..weights::MAY_HIDE_FRAME_BYTES).contains(&bytes)));
    }

    /// A frame with a valid CRC had a pause inside.
    pub fn learn_inner_pause(&mut self) {
        self.frames_with_inner_pause += 1.0;
    }

    /// What happened to a damaged frame, where its bytes show it.
    pub fn learn_damage(&mut self, damage: Option<DamageKind>) {
        match damage {
            Some(DamageKind::LostBytes { count: 1.., .. }) => self.frames_with_losses += 1.0,
            Some(DamageKind::FlowControl { .. }) => {
                self.frames_with_losses += 1.0;
                self.unframed_since_flow_control_loss = 0;
            }
            Some(DamageKind::Collision { .. }) => self.frames_with_collisions += 1.0,
            _ => {}
        }
    }

    /// Learns from unframed bytes whether the driver delivers XON and XOFF, or takes them out as flow control.
    pub fn learn_flow_control(&mut self, unframed: &[u8]) {
        let [xon, xoff] = FLOW_CONTROL_BYTES;
        let is_delivered = memchr::memchr2(xon, xoff, unframed).is_some();
        let more = if is_delivered { usize::MAX } else { unframed.len() };
        self.unframed_since_flow_control_loss = self.unframed_since_flow_control_loss.saturating_add(more);
    }

    /// After a truncated response the master asked for it again (`true`), or went on.
    pub fn learn_truncation(&mut self, asked_again: bool) {
        *if asked_again { &mut self.truncations_by_sender } else { &mut self.truncations_by_tap } += 1.0;
    }

    /// Halves all counts, so that what a line showed long ago counts for less and less.
    fn halve_counts(&mut self) {
        // The cached bounds were computed from the counts as they are now.
        self.score_bounds.clear();
        for count in self.units.iter_mut().chain(self.functions.iter_mut().flatten()).chain(&mut self.function_totals) {
            *count /= 2.0;
        }
        for count in [
            &mut self.unit_total,
            &mut self.frames_with_losses,
            &mut self.frames_with_collisions,
            &mut self.frames,
            &mut self.frames_after_unframed,
            &mut self.frames_after_stray_bytes,
            &mut self.frames_with_inner_pause,
            &mut self.requests,
            &mut self.repeated_requests,
            &mut self.heard_sides.left,
            &mut self.heard_sides.unfit_responses,
        ] {
            *count /= 2.0;
        }
    }
}

/// Habits of the line.
impl TrafficModel {
    /// Whether bytes of this line go missing, and nearly nobody talks into others' frames.
    pub fn loses_bytes(&self) -> bool {
        let losses = self.frames_with_losses;
        losses >= weights::MIN_LOSSES_FRAMES && losses >= weights::LOSSES_PER_COLLISION_FACTOR * self.frames_with_collisions
    }

    /// Whether the driver seems to deliver XON and XOFF: one was received among the unframed bytes, or no frame has lacked one
    /// for a long time.
    pub fn delivers_flow_control(&self) -> bool {
        self.unframed_since_flow_control_loss > weights::FLOW_CONTROL_SEARCH_BYTES
    }

    /// Whether it is the tap that loses the ends of responses, and not the sender that stops: masters went on.
    pub fn tap_truncates_responses(&self) -> bool {
        let by_tap = self.truncations_by_tap;
        let enough = weights::TAP_TRUNCATIONS_PER_RETRY_FACTOR * self.truncations_by_sender;
        by_tap >= weights::MIN_TAP_TRUNCATIONS_FRAMES && by_tap >= enough
    }

    /// Whether pauses inside frames prove nothing on this line, because valid frames have them as well.
    pub fn has_inner_pauses(&self) -> bool {
        let factor = weights::FRAMES_PER_INNER_PAUSE_FACTOR;
        self.frames_with_inner_pause * factor > self.frames + factor
    }

    /// How many stray bytes usually are in one place of this line, at most.
    pub fn max_stray_bytes(&self) -> usize {
        if self.frames_after_stray_bytes * weights::FRAMES_PER_STRAY_RUN_FACTOR > self.frames {
            weights::MAX_STRAY_NOISY_BYTES
        } else {
            weights::MAX_STRAY_QUIET_BYTES
        }
    }
}
