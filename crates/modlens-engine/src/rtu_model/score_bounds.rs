//! Cached upper bounds of header scores, by unit and by function code: nearly no place begins a frame, and one look in a
//! table has to show that.
//!
//! `header_score` fills the cache. A bound is computed for 12.5 % more observations of this value than were counted, and
//! recomputed when the count exceeds that. Observations of other values only lower the score, so the bound stays valid. When
//! all counters are halved, the cache is cleared.

/// Margin factor for the observation count. It decides how often bounds are recomputed, never what is found.
pub const OBSERVATION_HEADROOM: f32 = 1.125;

/// All bounds are recomputed after this factor more frames: they are half a bit too high by then, because the shares of
/// units and functions fell.
const REFRESH_FACTOR: f32 = 1.4;

/// An upper bound in bits, and the observations that it holds for, as a request and as a response.
#[derive(Clone, Copy)]
pub struct CachedBound {
    /// The bound, in bits.
    pub bits: f32,
    /// It holds up to these counts.
    pub observations: [f32; 2],
}

/// A bound that was not computed yet: any number of observations exceeds it.
const UNKNOWN: CachedBound = CachedBound { bits: 0.0, observations: [-1.0; 2] };

/// The cache: one bound for each unit and each function code.
pub struct ScoreBounds {
    /// Bounds of units.
    pub units: Box<[CachedBound; 256]>,
    /// Bounds of function codes, with the fields after them.
    pub codes: Box<[CachedBound; 256]>,
    /// Frames seen when all bounds were last recomputed.
    frames: f32,
}

impl Default for ScoreBounds {
    fn default() -> Self {
        Self { units: Box::new([UNKNOWN; 256]), codes: Box::new([UNKNOWN; 256]), frames: 0.0 }
    }
}

impl ScoreBounds {
    /// Forgets all bounds, because the counts after them have become smaller.
    pub fn clear(&mut self) {
        self.units.fill(UNKNOWN);
        self.codes.fill(UNKNOWN);
    }

    /// Forgets all bounds once they are loose; `frames` is how many frames were counted.
    pub fn refresh(&mut self, frames: f32) {
        if frames > REFRESH_FACTOR * self.frames || frames < self.frames / REFRESH_FACTOR {
            self.clear();
            self.frames = frames;
        }
    }
}
