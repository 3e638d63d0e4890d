//! Reads that came before, matched in their packets one after the other (`messages`): most exchanges of a master that polls.
//!
//! All that follows from such a request is known by its bytes, so that little is left to do for each; the rest is done once for all
//! of them.

use std::mem::size_of;

use crate::fast_path::request_memo::{MemoEntry, RequestMemo};
use crate::fast_path::rtu_exchange::LastExchange;
use crate::records::{PacketPair, NOT_REFUSED};
use crate::session::bus::{learn_sides, BusState};
use crate::session::decoder::Decoder;
use crate::session::exchanges::matching::confidence_by_id;
use crate::session::exchanges::message_run::MessageRun;
use crate::session::exchanges::run::ExchangeEnd;
use crate::session::held_exchanges::ExchangeStart;
use crate::session::in_flight::AnswerShape;
use crate::stats::RequestPlace;
use crate::weights::CERTAIN_DIRECTION_BITS;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::Ns;
use modlens_readers::pcap::PacketInTurn;

/// Bytes of the identifier and of the protocol, which both packets of an exchange have in common.
const COMMON_BYTES: usize = 4;

/// Bytes of a read, with its MBAP header.
const READ_WITH_HEADER_BYTES: usize = COMMON_BYTES + size_of::<u64>();

/// Exchanges of known reads, one after the other, and what is noted of them as a whole.
#[derive(Default)]
struct PairTotals {
    exchanges: u64,
    /// Bytes of requests and of responses, and those of the longest of each.
    bytes: [usize; 2],
    longest: [usize; 2],
    /// The longest time to a response.
    longest_wait: Ns,
    /// When the first one began.
    first: Option<Ns>,
    /// When the packets of the last one came, and what it is.
    times: [Ns; 2],
    last: Option<MemoEntry>,
}

impl Decoder {
    /// Emits the pairs at the head of these packets of which the request is a read that came before, and which are exchanges
    /// unambiguously. Returns the packets after them. `current` holds at least one exchange already.
    pub(super) fn match_known_reads<'a, 'b>(
        &mut self,
        current: &mut MessageRun,
        mut packets: &'b [PacketInTurn<'a>],
        belongs: impl Fn(&PacketInTurn<'_>) -> bool,
    ) -> &'b [PacketInTurn<'a>] {
        let BusState { memo, pairing, connection, counts, side_votes, .. } = &mut self.buses[current.bus];
        let Some(newest) = current.newest.filter(|_| self.wanted.transactions && connection.in_flight.is_idle()) else {
            return packets;
        };
        let mut counters = self.stats.exchange_counts(*counts);
        let client_before = current.sides[0].last.unwrap_or(newest);
        let mut pairs = PairTotals { times: [client_before, newest], ..PairTotals::default() };
        loop {
            let mut rest = packets.iter();
            let Some(request) = next_with_bytes(&mut rest, &belongs) else { break };
            let Some(response) = next_with_bytes(&mut rest, &belongs) else { break };
            let times = [request.time, response.time];
            let is_recorded = pairing.response_side_recorded;
            if !(is_pair(request, response, is_recorded) && times[0] > pairs.times[1] && current.takes_response_at(times)) {
                break;
            }
            let Some((known, place, id)) = match_known(memo, request.bytes, response.bytes) else { break };
            if !current.open.stay_open_across(id, times) {
                break;
            }
            let gap = current.run.measurable_gap(times[0] - pairs.times[0]);
            let response_time = pairing.measurable_interval(Some(times[0]), Some(times[1]), true);
            pairing.learn_times(None, response_time, false);
            let response_time = response_time.filter(|&ns| ns >= current.run.min_measurable_ns);
            counters.count_timed(place, times, response_time);
            let lengths = [request.bytes.len(), response.bytes.len()];
            let start = self.batch.store(request.bytes).start;
            self.batch.store(response.bytes);
            let exchange = known.expected.compact(start, lengths, confidence_by_id(), NOT_REFUSED);
            let pair = PacketPair {
                starts: times,
                gap: gap.into(),
                response_time: response_time.into(),
                packet: request.number,
                mbap_id: id,
            };
            if pairs.exchanges > 0 {
                self.held.exchanges.push_next(exchange, pair);
            } else {
                let (number, frame, recording_start) = (self.next_txn, self.next_frame, self.origin);
                let start = ExchangeStart { bus: current.bus as u32, number, frame, recording_start, mode: Mode::Tcp };
                self.held.exchanges.push(exchange, pair, &start);
            }
            pairs.add(lengths, times);
            pairs.last = Some(*known);
            packets = rest.as_slice();
        }
        if let Some(MemoEntry { expected, .. }) = pairs.last {
            counters.note_last(expected.key());
            connection.note_lone_exchanges(pairs.exchanges, pairs.longest_wait, AnswerShape::of(&expected), pairs.times[1]);
            learn_sides(side_votes, pairs.exchanges);
            pairing.record_exchanges_by_id(pairs.exchanges as u32);
            self.stats.record_run_times(*counts, pairs.first.unwrap_or(newest), pairs.times[1]);
            self.next_txn += pairs.exchanges;
            self.next_frame += 2 * pairs.exchanges;
            current.run.totals.exchanges += pairs.exchanges;
            current.run.totals.bytes += pairs.bytes[0] + pairs.bytes[1];
            for (at, side) in current.sides.iter_mut().enumerate() {
                side.add(pairs.bytes[at], pairs.longest[at], pairs.times[at]);
            }
            current.newest = Some(pairs.times[1]);
            current.end = ExchangeEnd::newest(&self.batch, self.next_txn);
            current.rtu.last_exchange = Some(LastExchange { expected, odds: CERTAIN_DIRECTION_BITS });
        }
        packets
    }
}

impl PairTotals {
    #[inline]
    fn add(&mut self, lengths: [usize; 2], times: [Ns; 2]) {
        self.exchanges += 1;
        self.first = self.first.or(Some(times[0]));
        for (at, length) in lengths.into_iter().enumerate() {
            self.bytes[at] += length;
            self.longest[at] = self.longest[at].max(length);
        }
        self.longest_wait = self.longest_wait.max(times[1] - times[0]);
        self.times = times;
    }
}

/// Returns the next packet that has brought bytes. Those in front of it acknowledge others, which shows nothing; `None` at the
/// first one that does not belong to the connection.
#[inline]
pub(super) fn next_with_bytes<'a, 'b>(
    packets: &mut std::slice::Iter<'b, PacketInTurn<'a>>,
    belongs: impl Fn(&PacketInTurn<'_>) -> bool,
) -> Option<&'b PacketInTurn<'a>> {
    packets.take_while(|packet| belongs(packet)).find(|packet| !packet.bytes.is_empty())
}

/// Returns whether two packets are one of the client and one of the server, of a connection whose server is recorded or not.
#[inline]
fn is_pair(request: &PacketInTurn<'_>, response: &PacketInTurn<'_>, is_recorded: bool) -> bool {
    let are_recorded = request.server_side_recorded == is_recorded && response.server_side_recorded == is_recorded;
    request.from_client && !response.from_client && are_recorded
}

/// Returns the read that came before of which these are the request and its response, the place of its counters, and the identifier
/// of both; `None` if they are no such pair, or if the statistics have no room for the request.
#[inline(always)]
#[allow(clippy::inline_always)] // Called once.
fn match_known<'a>(reads: &'a RequestMemo, asked: &[u8], answered: &[u8]) -> Option<(&'a MemoEntry, RequestPlace, u16)> {
    let asked: &[u8; READ_WITH_HEADER_BYTES] = asked.try_into().ok()?;
    let (common, read) = asked.split_first_chunk::<COMMON_BYTES>()?;
    let known = reads.get(read)?;
    let (header, response) = answered.split_first_chunk::<MBAP_PREFIX_BYTES>()?;
    let [high, low, 0, 0] = *common else { return None };
    let [length_high, length_low] = (known.expected.response_bytes as u16).to_be_bytes();
    let is_framed = *header == [high, low, 0, 0, length_high, length_low] && response.len() == known.expected.response_bytes;
    let is_answered = is_framed && known.expected.is_answered_by(&asked[MBAP_PREFIX_BYTES..], response);
    Some((known, known.counters.filter(|_| is_answered)?, u16::from_be_bytes([high, low])))
}
