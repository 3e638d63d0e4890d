//! Bytes and times in, rows out: framing, pairing, findings, statistics. No I/O, no clock, no failure on bytes.
//!
//! ```text
//! Chunk -> Input -> LineFramer -> findings::frame, direction -> Pairing -> findings::transaction -> Batch, Stats
//!                       |  RTU: fast_path | search -> commit | damage    (what is learned flows back to all of them)
//! ```
//!
//! **A framer is pulled, not pushed.** `Framer::next` says what the first unframed bytes are, or that more bytes, a
//! silence or the end are needed. It is asked for one frame at a time, because the next answer depends on what became of
//! this frame: the outstanding request, the units that have been seen, the times of the bus are its context and change
//! with every frame that is paired. A framer that pushed frames out by itself would decide the second of two frames
//! without knowing of the first.
//!
//! **Nothing depends on the boundaries of `feed`.** A file is cut into blocks by chance, a pipe by the scheduler. Framers
//! decide at bytes, at times of bytes, at starts of records and at the end; detection of the framing looks at fixed
//! numbers of bytes; what is learned is learned per frame. Feeding 1, 7 or 64 bytes at a time or all of them gives equal
//! rows (`tests/properties.rs`). A live session first decides what time alone decides up to the new read, on all buses in
//! the order of their deadlines: so the same reads give the same rows again, whenever a tap looked at its clock.
//!
//! **Two lengths of silence.** A pause of t3.5 (5 ms where reads are coarse) is evidence, because USB adapters and
//! schedulers hold bytes back for up to 16 ms. A pause of `break_ns` (90 ms for RTU, 1 s for ASCII and TCP) is a
//! boundary: no frame crosses it, and the framer emits all that it holds.
//!
//! **Where to read on.** `docs/segmentation.md` explains the model as a paper would; `weights` is the table of all
//! weights and thresholds; `framer::rtu::search::commit` draws when a frame becomes final; `damage` decides between noise
//! and a damaged frame; `fast_path` is the way of unambiguous traffic, with the slow path as its oracle; `pairing` lists
//! what closes a transaction; `findings` is where each finding is made, and `findings::words` what it says;
//! `session::decoder` has the buses and makes their rows, and `session` reads the sources; `session::two_lines` orders a four-wire bus.
//! What an RTU line has shown is in `rtu_model`, which the framer and `damage` both score by.
//!
//! **What cannot be decided is not claimed.** Where neither the clock nor the habits of the line tell an echo from a
//! retry, a request is called neither.
//!
//! **Memory is bounded.** A `take` empties the batch, and the vectors of a batch that was dropped are filled again: fresh
//! memory costs more than the rows in it. A noise row ends after 4096 bytes; rows wait for older open ones, 65,536
//! transactions and 16,384 connections at most; statistics are histograms.

pub mod confidence;
pub mod damage;
pub mod durations;
mod fast_path;
pub mod findings;
pub mod folding;
pub mod frame_result;
pub mod framer;
pub mod input;
pub mod line_search;
mod ones;
pub mod pairing;
pub mod records;
mod rtu_model;
pub mod session;
pub mod stats;
mod transactions;
pub mod weights;
