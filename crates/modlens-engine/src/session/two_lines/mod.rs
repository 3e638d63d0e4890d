//! The order of frames on the two lines of a bus.
//!
//! A tap of a four-wire RS-485 bus, or of RS-232, has two lines: the master speaks on one, the units speak on the other.
//! Each line has an `Input` and a framer of its own; both feed one `Pairing`, which needs the frames in the order in which
//! they were on the wire: a request, its response, the next request. How that order is found depends on the clock.
//!
//! | times of the reads | order | where |
//! |--|--|--|
//! | of every byte, or of the packets of a connection | the older first byte is first | `turn` |
//! | of reads that adapters hold back | by time as far as it goes, then by content | `turn`, `peek` |
//! | none | by content alone: an alignment of two sequences | `unmerged`, `alignment` |
//!
//! **Who speaks where** (`speaker`). Frames that only a master or only a unit can send vote for the side that speaks on
//! their line. Nothing is emitted before the lead is three votes, 4096 bytes have come, or, live, a second is over: until
//! then the first frames could be paired the wrong way round. ASCII and connections need no survey.
//!
//! **Coarse clocks** (`turn`). Adapters hold bytes back on each line by itself, so that a response may be seen before its
//! request. Two reads less than `max_reordering` apart may have been on the wire in any order. That time is learned from
//! pairs (`TimingModel::max_skew`): it starts at 60 ms, is twice the greatest skew observed, and decays. Within it,
//!
//! - if both lines have bytes, the response goes to the request that it fits best: to the outstanding one (the line of the
//!   responses is next), or to the first one that is not emitted yet (the line of the requests is next);
//! - if only one line has bytes, a frame that is not due waits for the other line: a request while another one is
//!   outstanding, a response without an outstanding request that it fits.
//!
//! For example, with request `A`, response `a` and a latency timer of 16 ms on the line of the requests:
//!
//! ```text
//! on the wire     A 10 ms   a 14 ms
//! as read         a 15 ms   A 26 ms     `a` is not due, as nothing is outstanding: it waits for up to `max_reordering`
//! emitted         A a                   `a` fits `A` fully, so the line of the requests is next
//! ```
//!
//! **No clock** (`unmerged`, `alignment`). Each line is framed ahead, up to a window of 192 frames. Then the two sequences
//! are merged by an alignment in which pairs of request and response score and single frames cost, and the first half of
//! the window is emitted. What is inferred in this way proves little: a missing response may as well be missing bytes
//! (`Pairing::order_is_inferred`), and overlaps are no evidence of two masters.

pub(super) mod alignment;
mod peek;
mod speaker;
mod turn;
pub(super) mod unmerged;
