//! Is it noise, or a damaged frame?
//!
//! The framers leave bytes that belong to no valid frame: line noise, or a frame that did not arrive as it was sent.
//! Everything that decides between the two is in this module; its thresholds and costs are the group "Noise or a damaged
//! frame" of the table in `weights`.
//!
//! # The decision
//!
//! The unframed bytes between two frames are a *region* (`region`). Each start in a region is a hypothesis test: do these
//! bytes come from a frame that is likely to be here, or from noise? Scores are log2 likelihood ratios in bits, and a
//! damaged frame is reported from `MIN_DAMAGED_FRAME_BITS` (10) on, where noise looks like one in about one of 1000 cases.
//!
//! 1. **Which frames are likely here?** (`expected_frame`, `candidates`) The response to the outstanding request, a retry of
//!    it, the request that the next frame repeats or answers, the requests of the poll cycle, and frames whose header has a
//!    unit and a function of this line. Choosing one of them costs bits: 1 for the response, 5 for a poll.
//! 2. **How well do the bytes fit?** (`alignment`) A byte that agrees gains the information content of its value, about 8
//!    bits or 2 for a zero. Each kind of damage costs bits: bytes missing in front (5) or inside (6), a byte received twice
//!    (8), flipped bits (9 for one), a second transmitter (5). A CRC that is valid after the correction gains 16.
//! 3. **Where does it stand?** Stray bytes in front cost, a pause in front and an end at a pause or at the next frame gain.
//! 4. **Which of the candidates?** (`chain`) The chain of candidates that do not overlap with the highest total; a second
//!    damaged frame in one region costs 8 bits more, because damage is rare. `chain` also decides where each frame ends.
//! 5. **What is left over?** (`fragments`) The beginning or the end of a frame that only its place gives away: at the start
//!    of the recording, or where a response must have been; and a burst of bytes at the place of a frame that is due
//!    (`due_burst`), because line noise seldom comes in a row. All other bytes are noise, `Glitch` if they are the few equal
//!    bytes that a switched line driver leaves (`glitch`).
//!
//! A burst of just the length of the response that is due is that response, whatever its bytes (`whole_answer`).
//!
//! A byte that a serial driver has taken out as software flow control is tried at every place (`flow_control`).
//!
//! # Example
//!
//! Request `11 03 00 6B 00 03 76 87` is outstanding; then come `11 03 02 2B 00 00 00 64 C8 BA` and the next request of the
//! cycle. The expected response has 11 bytes and begins with `11 03 06`. Its first two bytes agree (17 bits). With one byte
//! missing at index 2 (cost 6), the other bytes end where the region ends (gain 4), and the CRC over `11 03 06` and the
//! bytes that follow is valid (gain 16). That is 17 - 1 - 6 + 4 + 16 = 30 bits, so the row is `incomplete` with the finding
//! `lost_bytes` (1 byte missing after byte 1) and not 10 bytes of noise.
//!
//! # Two ways in
//!
//! - `recovery::DamageRecovery::next_frame` analyses a region that the RTU search has left unframed.
//! - `recovery::damaged_hypothesis` explains a frame with a wrong CRC that the search itself has chosen, because it stands
//!   right after another frame and has the length that its header announces. Those hypotheses, and what they are worth,
//!   are part of the search (`framer::rtu::search`), where they compete with valid frames.
//!
//! In ASCII framing a colon begins and CR LF ends a message, so that there is no need to search: `ascii` decides by the
//! number of hex characters and the LRC. `truncation` decides live whether a missing end is the sender's or the tap's.

pub(crate) mod alignment;
mod analysis;
pub(crate) mod ascii;
mod candidates;
mod chain;
mod crc_correction;
mod due_burst;
#[cfg(test)]
mod exhaustive;
mod expected_frame;
mod flow_control;
mod fragments;
pub(crate) mod glitch;
pub(crate) mod recovery;
pub(crate) mod region;
pub(crate) mod truncation;
mod whole_answer;
