//! The fast path: frames and whole exchanges that are unambiguous take neither the search nor the general pairing.
//!
//! Nearly all traffic is polling: a request, its response at once, the next request. The speed of the engine is the speed
//! of this module; everything here is an optimisation, and no row depends on it.
//!
//! What a request determines and what is remembered of it is here; whether two frames are an exchange, and what a session makes of
//! it, is in `session::exchanges`.
//!
//! # What qualifies
//!
//! There are two steps, for one frame and for a request with its response.
//!
//! - **A frame** (RTU, `single_frame` of the framer, which asks it before it searches): its CRC is valid, it has the length its
//!   header announces, no long silence or record boundary lies inside, and it is either the response that the outstanding
//!   request determines, or a request whose unit and function are familiar on this line. A request-like frame that may as
//!   well be a response (a late one, a repeated one, an echoed write) does not qualify.
//! - **An exchange** (RTU, ASCII and TCP, `session::exchanges::matching`): a plain read or write, or both in one
//!   (`expected_exchange`), on which the slow path's own checks report nothing (`findings::frame::is_plain_request`), and right
//!   after it the one response that it determines: equal header and byte count, padding bits 0, or the echo. Where exchanges are
//!   compact, the refusal is a response as well. And nothing is open: no request outstanding (on a connection, none that the
//!   exchange touches), no finding due on an earlier frame, the framer's lattice empty, no mark of the receiver, no profile that
//!   has to look at the data.
//!
//! What follows from the bytes of a read is remembered (`request_memo`), the verdict of those checks included. Writes hardly ever
//! repeat, so that they are asked each time.
//!
//! # Three ways
//!
//! | input | file |
//! |--|--|
//! | blocks of an RTU line without a clock, of which frames are not wanted: a run in one loop over the bytes | `contiguous` (`compact_run`) |
//! | any other block of an RTU or ASCII line: the head of the line, again and again | `heads` |
//! | a packet of a connection or a line of a log with times each: the request is pending until the next one | `messages` (`known_pairs`) |
//!
//! All three end in `emit`, but for the two loops over reads of the memo, which learn by the run.
//!
//! Example: `11 03 00 6B 00 03 76 87` and right after it `11 03 06 02 2B 00 00 00 64 C8 BA` become two frame rows and a
//! transaction row in one step. With exception `11 83 02 C1 34` after it, that is a compact exchange, or both frames are taken
//! by `single_frame` one after the other and paired by `pairing`; with one bit of the response flipped, the search and `damage`
//! decide.
//!
//! # Why the rows are those of the slow path
//!
//! The slow path is the oracle. For what qualifies, its decision is known without executing it: the search would have a
//! single hypothesis without a rival, pairing would have one open request and its full match, and no check would find
//! anything. What remains is what the slow path *learns* from each frame: the traffic model and the search of the framer
//! (`rtu_exchange`), statistics and history of the pairing (`pairing`), counters, units and sides (`emit` for each exchange,
//! `Decoder::end_run` for a run).
//!
//! # What to add where
//!
//! - **The slow path learns something new**: `emit`, and `compact_run` and `known_pairs`, or the tests below fail.
//! - **A finding on a request**: nothing. **On a response**: a condition in `ExpectedExchange::is_answered_by`.
//! - **A column**: its value in `Exchange` or `PacketPair`, and in `ExchangeRun::transaction_of`, from which rows are made as well.
//!
//! # The tests that compare the two
//!
//! A request and its response that arrive in different `feed` calls cannot take the fast path as an exchange. So the same
//! bytes are fed in one block, byte by byte and in blocks of any size, and all rows and statistics have to be equal:
//!
//! - `tests/properties.rs`: `the_fast_path_gives_the_rows_of_the_slow_path` (RTU and ASCII, with disturbed exchanges),
//!   `the_fast_path_gives_the_rows_of_the_slow_path_for_logs`, `compact_exchanges_give_the_rows_of_full_ones` and the two
//!   `..._chunk_sizes_change_nothing`;
//! - `tests/work.rs`: `pieces_change_nothing` (stray bytes and damage);
//! - `tests/captures.rs` of modlens-writers: `blocks_of_any_size_give_the_same_rows` (TCP), and
//!   `segments_in_any_order_and_twice_give_the_same_transactions`, where a split packet takes the slow path;
//! - `tests/conformance/test_ordinary_traffic.py`: an example of each finding between plain exchanges, in four kinds of
//!   recordings, all tables and counters;
//! - `tests/captures/test_decode.py`: `test_blocks_of_any_size_give_equal_frames`, over every recording in `captures/`.

pub(crate) mod expected_exchange;
mod pairing;
pub(crate) mod request_memo;
pub(crate) mod rtu_exchange;

pub(crate) use pairing::OpenRequests;
