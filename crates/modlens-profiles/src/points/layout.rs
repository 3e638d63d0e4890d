//! What stands behind which register, laid out once for a plan, so that a block of registers is a slice of it.
//!
//! The slice is right between *clean* borders, which no value crosses. Where a block begins or ends inside a value, the
//! few registers up to the next clean border are looked at one by one.

use std::ops::Range;

/// A value that begins with a register or bit, or a bare one that no value has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Its first register or bit.
    pub address: u16,
    /// In `Plan::shortcuts`.
    pub(super) shortcut: u16,
    compiled: u32,
}

impl Step {
    pub(super) fn value(address: u16, shortcut: u16, compiled: u32) -> Self {
        Self { address, shortcut, compiled }
    }

    /// A register or bit that is in no value.
    pub fn bare(address: u16) -> Self {
        Self { address, shortcut: 0, compiled: u32::MAX }
    }

    /// Its value in the plan; `None` for a bare register or bit.
    #[inline]
    pub fn compiled(self) -> Option<u32> {
        (self.compiled != u32::MAX).then_some(self.compiled)
    }
}

/// A part of a block. Addresses are counted without an end at 65535, as blocks are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// No point of the plan is near.
    Bare(Range<usize>),
    /// These of the layout's steps.
    Steps(Range<usize>),
    /// A value may be cut.
    Edge(Edge),
}

/// Registers at an end of a block, up to a border that no value crosses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edge {
    /// The registers.
    pub place: Range<usize>,
    /// What begins in them.
    pub steps: Range<usize>,
}

/// The steps of one table of a device.
#[derive(Debug, Default)]
pub struct Layout {
    regions: Vec<Region>,
}

/// Registers near each other.
#[derive(Debug)]
struct Region {
    first: usize,
    /// For each register, and for the end: its first step, and whether the border in front of it is clean.
    borders: Vec<(u32, bool)>,
}

/// So many registers without a point part regions.
const APART: usize = 64;

impl Layout {
    /// Lays out values, which are sorted by address (address, width, step); appends their steps.
    pub fn new(values: &[(u16, u16, Step)], steps: &mut Vec<Step>) -> Self {
        let mut regions: Vec<Region> = Vec::new();
        let mut reach = 0;
        let mut next = values.iter().peekable();
        while let Some((address, ..)) = next.peek() {
            let first = usize::from(*address);
            let mut region = Region { first, borders: Vec::new() };
            for at in first.. {
                region.borders.push((steps.len() as u32, reach <= at));
                if reach <= at && next.peek().is_none_or(|(address, ..)| usize::from(*address) > at + APART) {
                    break;
                }
                while let Some((_, width, step)) = next.next_if(|(address, ..)| usize::from(*address) == at) {
                    reach = reach.max(at + usize::from(*width));
                    steps.push(*step);
                }
                if reach <= at {
                    steps.push(Step::bare(at as u16));
                }
            }
            regions.push(region);
        }
        Self { regions }
    }

    /// The parts of a block.
    pub fn pieces(&self, first: u16, count: usize, mut piece: impl FnMut(Piece)) {
        let (mut at, end) = (usize::from(first), usize::from(first) + count);
        for region in &self.regions[self.regions.partition_point(|region| region.end() <= at)..] {
            if region.first >= end {
                break;
            }
            if at < region.first {
                piece(Piece::Bare(at..region.first));
                at = region.first;
            }
            let stop = end.min(region.end());
            region.pieces(at..stop, &mut piece);
            at = stop;
        }
        if at < end {
            piece(Piece::Bare(at..end));
        }
    }
}

impl Region {
    fn end(&self) -> usize {
        self.first + self.borders.len() - 1
    }

    #[inline]
    fn pieces(&self, block: Range<usize>, piece: &mut impl FnMut(Piece)) {
        let clean = |at: &usize| self.borders[at - self.first].1;
        let step = |at: usize| self.borders[at - self.first].0 as usize;
        let edge = |place: Range<usize>| Piece::Edge(Edge { steps: step(place.start)..step(place.end), place });
        let Some(from) = (block.start..=block.end).find(clean) else { return piece(edge(block)) };
        let to = (from..=block.end).rev().find(clean).unwrap_or(from);
        if block.start < from {
            piece(edge(block.start..from));
        }
        if from < to {
            piece(Piece::Steps(step(from)..step(to)));
        }
        if to < block.end {
            piece(edge(to..block.end));
        }
    }
}
