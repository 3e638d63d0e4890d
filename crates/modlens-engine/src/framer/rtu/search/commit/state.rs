//! The states of a frame on its way to being final, and what is known in advance about them.

use modlens_protocol::direction::Direction;

/// What the search has decided.
#[derive(Clone, Copy, Debug)]
pub enum Decision {
    /// A frame with a valid CRC.
    Frame {
        /// Stream offset of its first byte.
        start: u64,
        /// Stream offset after its last byte.
        end: u64,
        /// Who sent it.
        direction: Direction,
        /// The log2 odds that it is right.
        confidence: u8,
        /// It is alone in noise, and its unit has not been seen in a paired transaction.
        unconfirmed: bool,
    },
    /// A frame with an invalid CRC.
    Damaged {
        /// Stream offset of its first byte.
        start: u64,
        /// Stream offset after its last byte.
        end: u64,
        /// Who sent it.
        direction: Direction,
    },
    /// No frame begins before this stream offset.
    UnframedTo(u64),
}

impl Decision {
    /// The stream offset before which no frame begins: up to there, bytes that are not returned yet are unframed.
    pub fn unframed_to(self) -> u64 {
        match self {
            Self::UnframedTo(to) => to,
            Self::Frame { start, .. } | Self::Damaged { start, .. } => start,
        }
    }
}

/// Whether the first frame of the best path is final, and why not.
///
/// `until` is the stream offset before which the state does not change unless a hypothesis is added.
#[derive(Clone, Copy)]
pub enum CommitState {
    /// The best path has no frame. More bytes may begin one.
    Unframed { until: u64 },
    /// A complete rival is within the margin. If the distance is constant, no further byte puts that rival further back.
    Contested { until: u64, has_constant_distance: bool },
    /// The frame may be inside a longer one that has begun before it.
    Nested { until: u64 },
    /// Only the next frame shows which direction it has, or whether it was damaged rather than noise.
    AwaitsSuccessor { until: u64 },
    /// An unfinished frame may outscore it.
    Overtakable { until: u64 },
    /// The frame is committed; or, if the best path has none, its bytes are.
    Final,
}

impl CommitState {
    /// Where the state has to be determined again at the latest, and whether nothing but a new hypothesis changes it
    /// before.
    pub fn wait(self) -> Option<(u64, bool)> {
        match self {
            Self::Contested { until, has_constant_distance } => Some((until, has_constant_distance)),
            Self::AwaitsSuccessor { until } => Some((until, true)),
            Self::Unframed { until } | Self::Nested { until } | Self::Overtakable { until } => Some((until, false)),
            Self::Final => None,
        }
    }
}

/// What the search knows in advance: offsets before which a question need not be asked again, so that the search costs what
/// it finds and not what it reads.
///
/// Invariants, as long as the root stays and no hypothesis is added:
/// - `decide` commits nothing while `scanned_to < next_decision_at`. A new hypothesis sets it to 0.
/// - No damaged frame ends before `next_damaged_end_at`: it is the least of the values of all hypotheses.
/// - No frame that begins before `no_rival_before` can outscore the first frame of the best path, except at `open_starts`.
/// - `last_rival` is a guess only. It is checked again before it counts.
///
/// A new root voids them all (`forget_decisions`).
#[derive(Default)]
pub struct SkipAhead {
    /// Nothing can be decided before this stream offset.
    pub next_decision_at: u64,
    /// No damaged frame can end before this stream offset.
    pub next_damaged_end_at: u64,
    /// No frame that begins before this stream offset can become a rival, except at `open_starts`.
    pub no_rival_before: u64,
    /// The starts before it, in ascending order, at which a frame is no rival by the scores of now, but may be by those of later.
    /// Live, there are none.
    pub open_starts: Vec<u64>,
    /// The unfinished frame that was last found to be a possible rival.
    pub last_rival: Option<Rival>,
    /// A look-ahead needs bytes that are not there yet. Until they are, nothing is scanned either.
    pub needs_more_bytes: bool,
    /// Whether a frame of open length that begins after the root is completed: the root's end, and the answer. It is looked
    /// up once per root, because bytes that have been scanned since are in the lattice already.
    pub open_length_completion: Option<(u64, bool)>,
}

impl SkipAhead {
    /// Voids what was known, because the root is another one. Nothing is decided before this stream offset.
    pub fn forget_decisions(&mut self, next_decision_at: u64) {
        (self.next_decision_at, self.no_rival_before, self.last_rival) = (next_decision_at, 0, None);
        self.open_starts.clear();
    }
}

/// An unfinished frame that may outscore the first frame of the best path.
#[derive(Clone, Copy)]
pub struct Rival {
    /// The hypothesis after which it begins.
    pub parent: usize,
    /// Stream offset of its first byte.
    pub start: u64,
    /// Stream offset before which it stays possible.
    pub until: u64,
}

/// Whether an unfinished frame that begins at a certain place is a rival.
pub enum RivalAt {
    /// It is.
    Found(Rival),
    /// Not by the scores of now, but perhaps by those of later.
    NotNow,
    /// Not even if `RivalBar::now` falls to `RivalBar::least`.
    Never,
}

/// What an unfinished frame has to exceed to be a rival, as scores of its path in bits.
#[derive(Clone, Copy)]
pub struct RivalBar {
    /// The score that it must exceed now.
    pub now: f32,
    /// The lowest value that `now` can fall to while the hypotheses stay the same: the best path loses score for unframed
    /// bytes after it, but only up to a maximum. A start that cannot exceed it never has to be checked again.
    pub least: f32,
}

/// Whether an unfinished frame will be complete, as the bytes after it show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Completion {
    /// A frame of a length that its header admits ends there.
    Completes,
    /// None does.
    Never,
    /// More bytes have to be there to tell.
    Unknown,
}

impl Completion {
    /// The answer where all bytes are there to tell.
    pub fn if_found(completes: bool) -> Self {
        if completes {
            Self::Completes
        } else {
            Self::Never
        }
    }
}
