//! The fast path: frames and whole exchanges that are unambiguous take neither the search nor the general pairing.
//!
//! Nearly all traffic is polling: a request, its response at once, the next request. The speed of the engine is the speed
//! of this module; everything here is an optimisation, and no row depends on it.
//!
//! # What qualifies
//!
//! There are two steps, for one frame and for a request with its response.
//!
//! - **A frame** (RTU, `rtu_frame`, called by the framer before it searches): its CRC is valid, it has the length that its
//!   header announces, no long silence or record boundary lies inside, and it is either the response that the outstanding
//!   request determines, or a request whose unit and function are familiar on this line. A request-like frame that may as
//!   well be a response (a late one, a repeated one, an echoed write) does not qualify.
//! - **An exchange** (RTU, ASCII and TCP, [`Session::emit_exchanges`]): a plain read or write, or both in one
//!   (`expected_exchange`), that keeps the limits of the specification, and right behind it the one response that it determines:
//!   equal header and byte count, padding bits 0, or the echo. Both are in one read without times, in a read each within the
//!   request time-out, or in a TCP packet each. And nothing is open: no request outstanding (on a connection, none that the
//!   exchange touches), no finding due on an earlier frame, the framer's lattice empty, no mark of the receiver, no profile that
//!   has to look at the data.
//!
//! On an RTU line without times of which nobody wants the frames, exchanges are emitted compact (`rtu_compact`): a run of them in
//! one loop (`compact_run`), without rows, and refusals among them. On a connection the exchanges of a recording are emitted
//! compact where nobody wants frames, and packets that come in turn are matched before they reach a line (`packet_pairs`; reads
//! that came before in `known_pairs`), and so are the lines of a log with times (`line_pairs`).
//!
//! Example: `11 03 00 6B 00 03 76 87` and right behind it `11 03 06 02 2B 00 00 00 64 C8 BA` become two frame rows and a
//! transaction row in one step. With exception `11 83 02 C1 34` behind it, that is a compact exchange, or both frames are taken
//! by `rtu_frame` one after the other and paired by `pairing`; with one bit of the response flipped, the search and `damage`
//! decide.
//!
//! # Why the rows are those of the slow path
//!
//! The slow path is the oracle. For what qualifies, its decision is known without executing it: the search would have a
//! single hypothesis without a rival, pairing would have one open request and its full match, and no check would find
//! anything. What remains is what the slow path *learns* from each frame, and every file here records exactly that:
//! `rtu_exchange` in the framer's traffic model (`record_exchange`, or `learn_in_run` and `learn_run`; and `sync_after_batch`
//! once at the end of a run), `pairing` in the pairing's statistics and history, `emit` in the statistics and what is known of
//! units and sides. Whoever lets the slow path learn something new has to add it here, or the tests below fail.
//!
//! # The tests that compare the two
//!
//! A request and its response that arrive in different `feed` calls cannot take the fast path as an exchange. So the same
//! bytes are fed in one piece, byte by byte and in pieces of any size, and all rows and statistics have to be equal:
//!
//! - `tests/properties.rs`: `the_fast_path_gives_the_rows_of_the_slow_path` (RTU and ASCII, with disturbed exchanges),
//!   `the_fast_path_gives_the_rows_of_the_slow_path_for_logs`, `compact_exchanges_give_the_rows_of_full_ones` and the two
//!   `..._chunk_sizes_change_nothing`;
//! - `tests/work.rs`: `pieces_change_nothing` (stray bytes and damage);
//! - `tests/captures.rs` of modlens-writers: `blocks_of_any_size_give_the_same_rows` (TCP), and
//!   `segments_in_any_order_and_twice_give_the_same_transactions`, where a split packet takes the slow path;
//! - `tests/captures/test_decode.py`: `test_blocks_of_any_size_give_equal_frames`, over every recording in `captures/`.

mod ascii_batch;
mod compact_run;
mod emit;
pub mod expected_exchange;
mod known_pairs;
pub(crate) mod known_reads;
mod line_pairs;
pub(crate) mod line_run;
mod packet_pairs;
pub(crate) mod packet_run;
mod pairing;
mod plain_write;
mod rows;
mod rtu_batch;
mod rtu_compact;
pub mod rtu_exchange;
mod run;
mod tcp_batch;

use crate::framer::Framer;
use crate::session::bus::FROM_SERVER;
use crate::session::Session;
use modlens_protocol::framing::Mode;

impl Session {
    /// Emits the exchanges at the heads of the lines of the bus with this index, as long as each of them qualifies for the
    /// fast path. The caller goes on frame by frame behind them.
    ///
    /// Does nothing if the bus's clock went back, if one side of a connection has no bytes, if a request is outstanding (but for
    /// a connection, where each exchange has to leave it alone) or anything else of an earlier frame is undecided, or if the bus
    /// is neither a single RTU or ASCII line nor a TCP connection with a line for each side.
    pub(crate) fn emit_exchanges(&mut self, bus: usize) {
        let state = &self.buses[bus];
        let is_connection = state.options.bus.network.is_some() && state.lines.len() == 2;
        let is_idle = if is_connection { state.pairing.is_idle_but_for_open() } else { state.pairing.is_idle() };
        if is_connection && state.lines.iter().any(|(_, line)| line.input.bytes().is_empty()) {
            return;
        }
        if state.clock_jumped || !is_idle || !state.lines.iter().all(|(_, line)| line.is_settled()) {
            return;
        }
        match &state.lines[..] {
            [(_, line)] if line.framer.mode() == Mode::Rtu => self.emit_rtu_exchanges(bus),
            [(_, line)] if line.framer.mode() == Mode::Ascii => self.emit_ascii_exchanges(bus),
            [(first, line), _] if state.options.bus.network.is_some() && line.framer.mode() == Mode::Tcp => {
                let server_first = *first == FROM_SERVER;
                self.emit_tcp_exchanges(bus, [usize::from(server_first), usize::from(!server_first)]);
            }
            _ => {}
        }
    }
}
