//! When a frame becomes final: the one state machine that commits results of the search.
//!
//! The first frame of the best path is committed once no competing hypothesis is within the required margin, and no frame
//! that has started but is not complete yet could still come within it. A committed frame is never revised.
//!
//! ```text
//!               bytes are scanned; hypotheses are added to the lattice and pruned
//!                                          |
//!                                          v
//!     +----------------------------->  UNFRAMED  --- 4096 bytes and a candidate's length --> commit the bytes
//!     |              the best path has no frame      after them, or closed                  as unframed --+
//!     |                                    |                                                               |
//!     |                        a frame leads the best path                                                 |
//!     |                                    v                                                               |
//!  commit the frame:   +---------------------------------------------------------------+                   |
//!  it becomes the      | CONTESTED          a complete rival is within the margin      |                   |
//!  root of the lattice | NESTED             it may be inside a frame begun before   |<-- a hypothesis   |
//!  and teaches the     | AWAITS_SUCCESSOR   only the next frame shows its direction,   |    was added      |
//!  model               |                    or that it was damaged                     |                   |
//!     |                | OVERTAKABLE        an unfinished frame may outscore it        |                   |
//!     |                +---------------------------------------------------------------+                   |
//!     |                                    | none of these applies any more; or closed,                    |
//!     |                                    | patience is over, too many hypotheses                         |
//!     |                                    v                                                               |
//!     +-------------------------------- FINAL                                UNFRAMED  <-------------------+
//! ```
//!
//! *Closed* means that no byte after the last one scanned can belong to a frame before it (`advance` passes it):
//! - a record of a recording starts there, or a silence of `break_ns` ended (`Input::is_boundary`);
//! - the recording is over, or silence has lasted so long that no adapter holds bytes back (`Input::is_closed`);
//! - the line is silent (`Input::is_paused`) and a frame leads. Where none does, the adapter may still hold back the end of one.
//!
//! Each waiting state knows a stream offset before which it does not change unless a hypothesis is added. So nothing is
//! decided byte by byte: see `SkipAhead`.
//!
//! In a recording nobody waits. Margins are wider there, and whether an unfinished frame will be complete is looked up
//! (`lookahead`) instead of guessed from its header. The framer also holds unframed bytes back there until the frame after them
//! is known (`is_held_back`).

mod decide;
mod emit;
mod frame_ahead;
mod lookahead;
mod one_side;
mod rival;
mod state;

pub use emit::is_held_back;
pub use state::{Decision, SkipAhead};
