//! The paths through the bytes, as a tree of frames: what was told last is the root.

use crate::framer::rtu::gain::RESPONSE;
use crate::framer::rtu::pending::Pending;
use crate::framer::rtu::search::{Search, Told, SHORTEST_DAMAGED};

/// So many readings are kept when they are thinned out.
pub const KEPT: usize = 16;

/// Readings that are so many bits behind are dropped.
const HOPELESS: f32 = 60.0;

/// The same where no frame is better than none: noise makes such readings all the time.
const UNLIKELY: f32 = 30.0;

/// A frame on a path.
pub struct Node {
    /// Stream offset of its first byte.
    pub start: u64,
    /// Stream offset behind it.
    pub end: u64,
    /// Who sent it.
    pub direction: usize,
    /// Of the path up to its end.
    pub score: f32,
    /// Of this frame alone.
    pub gain: f32,
    /// The frame before it.
    pub parent: usize,
    /// The frame behind the root on the way to this one.
    pub first: usize,
    /// Where damaged frames behind this one are to be looked for next.
    pub wake: u64,
    /// Whether it answers the request that waited.
    pub answers: bool,
    /// Whether its checksum is right.
    pub whole: bool,
    /// What may be answered behind it.
    pub pending: Pending,
}

impl Node {
    /// The place before all bytes.
    pub fn root() -> Self {
        Self {
            start: 0,
            end: 0,
            direction: RESPONSE,
            score: 0.0,
            gain: 0.0,
            parent: 0,
            first: 0,
            wake: 0,
            answers: false,
            whole: true,
            pending: Pending::default(),
        }
    }
}

impl Search {
    /// The score of a path that ends with this node, at the next byte.
    pub(super) fn standing(&self, node: &Node) -> f32 {
        node.score - self.model.astray(self.next - node.end)
    }

    /// The path that stands best now.
    pub(super) fn best(&self) -> (usize, f32) {
        let standings = self.nodes.iter().enumerate().map(|(i, node)| (i, self.standing(node)));
        standings.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    }

    /// Readings below this are not kept.
    pub(super) fn floor(&self) -> f32 {
        let (best, standing) = self.best();
        standing - if self.nodes[best].first == 0 { UNLIKELY } else { HOPELESS }
    }

    /// Crafted bytes and some noise make readings without end: the worst of them go.
    pub(super) fn thin(&mut self) {
        let mut order: Vec<usize> = (0..self.nodes.len()).collect();
        let standings: Vec<f32> = self.nodes.iter().map(|node| self.standing(node)).collect();
        order.sort_by(|&a, &b| standings[b].total_cmp(&standings[a]).then(b.cmp(&a)));
        let floor = standings[order[0]] - HOPELESS;
        let mut keep = vec![false; self.nodes.len()];
        for &i in order.iter().take(KEPT) {
            keep[i] = standings[i] >= floor;
        }
        keep[0] = true;
        for i in (1..self.nodes.len()).rev() {
            let parent = self.nodes[i].parent;
            keep[parent] |= keep[i];
        }
        self.retain(&keep);
        self.renumber();
    }

    /// Keeps some of the nodes, and with a node those that it stands on.
    fn retain(&mut self, keep: &[bool]) {
        let mut places = vec![0; self.nodes.len()];
        let mut kept = 0;
        for (place, &keep) in places.iter_mut().zip(keep) {
            *place = kept;
            kept += usize::from(keep);
        }
        let mut i = 0;
        self.nodes.retain_mut(|node| {
            node.parent = places[node.parent];
            i += 1;
            keep[i - 1]
        });
    }

    /// Tells bytes without frames. Readings behind them stay.
    pub(super) fn junk(&mut self, to: u64) -> Told {
        let mut index = 0;
        self.nodes.retain(|node| {
            index += 1;
            index == 1 || (node.parent == 0 && node.start >= to)
        });
        (self.nodes[0].start, self.nodes[0].end) = (to, to);
        if self.next <= to {
            self.running = false;
        }
        self.renumber();
        Told::Junk(to)
    }

    /// What stands on this frame stays.
    pub(super) fn reroot(&mut self, first: usize) {
        let score = self.nodes[first].score;
        self.nodes[first].parent = first;
        if first + 1 == self.nodes.len() {
            // Nothing stands on it yet, as nearly always.
            self.nodes.swap(0, first);
            self.nodes.truncate(1);
            self.nodes[0].parent = 0;
        } else {
            let mut keep = vec![false; self.nodes.len()];
            keep[first] = true;
            for i in first + 1..self.nodes.len() {
                keep[i] = keep[self.nodes[i].parent];
            }
            self.retain(&keep);
        }
        for node in &mut self.nodes {
            node.score -= score;
        }
        self.renumber();
    }

    /// The root is another one: what was worked out from the old one is worked out again.
    fn renumber(&mut self) {
        (self.calm, self.cleared, self.threat) = (0, 0, None);
        let root = self.told();
        self.nodes[0].wake = root + SHORTEST_DAMAGED;
        self.wake = u64::MAX;
        for i in 0..self.nodes.len() {
            let parent = self.nodes[i].parent;
            self.nodes[i].first = if i == 0 || parent != 0 { self.nodes[parent].first } else { i };
            self.wake = self.wake.min(self.nodes[i].wake);
        }
        self.nodes[0].first = 0;
    }
}
