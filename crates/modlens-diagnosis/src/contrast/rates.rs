//! How fast bytes come inside frames, against the rate of the line that was given.

use std::collections::BTreeMap;

use modlens_engine::records::InnerPauses;
use modlens_protocol::direction::Direction;
use modlens_protocol::Ns;

/// Bytes that take less than this share of their time came too fast: clocks, stop bits and tolerances of rates (serial line
/// specification, 3.2) explain the rest.
const FASTER: f64 = 0.85;

/// Bytes that take more than this multiple of their time came too slowly.
const SLOWER: f64 = 1.5;

/// Shorter times tell nothing where reads come a millisecond late.
const LEAST_NS: f64 = 2e6;

/// What was counted of the frames of one sender.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SenderRate {
    /// Frames long enough to tell.
    pub timed: u64,
    /// Those of them whose bytes came faster than the rate allows.
    pub faster: Paced,
    /// Frames read byte by byte.
    pub by_bytes: u64,
    /// Those of them whose bytes came more slowly than the rate says.
    pub slower: Paced,
}

/// Frames with the bytes after their first reads, and the time within which these came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Paced {
    /// How many frames.
    pub frames: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Their time.
    pub lasted: Ns,
}

/// The senders of a line: `None` for the master, else the unit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rates(BTreeMap<Option<u8>, SenderRate>);

impl Paced {
    fn add(&mut self, bytes: u32, lasted: Ns) {
        self.merge(Self { frames: 1, bytes: bytes.into(), lasted });
    }

    /// Adds others.
    pub fn merge(&mut self, more: Self) {
        self.frames += more.frames;
        self.bytes += more.bytes;
        self.lasted += more.lasted;
    }
}

impl Rates {
    /// Counts a good frame whose bytes take so long at the rate of the line.
    #[inline]
    pub(super) fn count(&mut self, direction: Direction, unit: Option<u8>, reads: InnerPauses, char_ns: Option<Ns>) {
        if reads.bytes == 0 {
            return;
        }
        let sender = match direction {
            Direction::Request => None,
            Direction::Response if unit.is_some() => unit,
            _ => return,
        };
        let Some(char_ns) = char_ns else { return };
        let needed = f64::from(reads.bytes) * char_ns as f64;
        if needed < LEAST_NS {
            return;
        }
        let own = self.0.entry(sender).or_default();
        let lasted = reads.lasted as f64;
        own.timed += 1;
        if lasted < needed * FASTER && needed - lasted > LEAST_NS / 2.0 {
            own.faster.add(reads.bytes, reads.lasted);
        }
        // Blocks of bytes come at the pace of the adapter.
        if reads.reads > reads.bytes {
            own.by_bytes += 1;
            if lasted > needed * SLOWER {
                own.slower.add(reads.bytes, reads.lasted);
            }
        }
    }

    /// Adds those of a later part.
    pub(super) fn merge(&mut self, later: &Self) {
        for (sender, more) in &later.0 {
            let own = self.0.entry(*sender).or_default();
            own.timed += more.timed;
            own.faster.merge(more.faster);
            own.by_bytes += more.by_bytes;
            own.slower.merge(more.slower);
        }
    }

    /// Returns what was counted of each sender.
    pub fn senders(&self) -> impl Iterator<Item = &SenderRate> {
        self.0.values()
    }
}
