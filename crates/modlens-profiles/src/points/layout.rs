//! The layout of a device's tables, computed once per plan, so that the points of a block of registers are a slice of
//! it.
//!
//! The slice is correct between *clean* addresses, which no value spans: every value that begins before such an address
//! ends before it, too. Where a block begins or ends inside a value, the few registers up to the next clean address are
//! examined one by one.

use std::ops::Range;

/// An entry of a layout: a value that begins at an address, or a bare register or bit that belongs to no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayoutEntry {
    /// The address of its first register or bit.
    pub address: u16,
    /// Index of its fast decoder in `Plan::decoders`.
    pub(super) decoder: u16,
    compiled: u32,
}

impl LayoutEntry {
    pub(super) fn value(address: u16, decoder: u16, compiled: u32) -> Self {
        Self { address, decoder, compiled }
    }

    /// The entry of a register or bit that belongs to no value.
    pub fn bare(address: u16) -> Self {
        Self { address, decoder: 0, compiled: u32::MAX }
    }

    /// Index of its value in the plan; `None` for a bare register or bit.
    #[inline]
    pub fn compiled_index(self) -> Option<u32> {
        (self.compiled != u32::MAX).then_some(self.compiled)
    }
}

/// A part of a block. Addresses may exceed 65535 here if a block does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LayoutPart {
    /// Addresses without any point of the plan nearby.
    Bare(Range<usize>),
    /// A range of the layout's entries, all of them complete values or bare registers.
    Entries(Range<usize>),
    /// Registers in which a value may be cut off by the end of the block.
    PartialBlock(PartialBlock),
}

/// The registers at one end of a block, up to the next clean address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartialBlock {
    /// The addresses of the registers.
    pub addresses: Range<usize>,
    /// The range of the layout's entries that begin in them.
    pub entries: Range<usize>,
}

/// Finds the steps of one table of a device by address.
#[derive(Debug, Default)]
pub struct Layout {
    regions: Vec<Region>,
}

/// A range of addresses without large gaps between the points.
#[derive(Debug)]
struct Region {
    first: usize,
    /// For each address, and for the end: the index of its first entry, and whether the address is clean.
    borders: Vec<(u32, bool)>,
}

/// A gap of this many registers without a point ends a region, so that sparse tables need little memory.
const MAX_GAP_REGISTERS: usize = 64;

impl Layout {
    /// Lays out values `(address, width, entry)`, sorted by address, and appends their entries and those of the bare
    /// registers between them.
    pub fn new(values: &[(u16, u16, LayoutEntry)], entries: &mut Vec<LayoutEntry>) -> Self {
        let mut regions: Vec<Region> = Vec::new();
        let mut values_end = 0;
        let mut next = values.iter().peekable();
        while let Some((address, ..)) = next.peek() {
            let first = usize::from(*address);
            let mut region = Region { first, borders: Vec::new() };
            for at in first.. {
                region.borders.push((entries.len() as u32, values_end <= at));
                if values_end <= at && next.peek().is_none_or(|(address, ..)| usize::from(*address) > at + MAX_GAP_REGISTERS) {
                    break;
                }
                while let Some((_, width, entry)) = next.next_if(|(address, ..)| usize::from(*address) == at) {
                    values_end = values_end.max(at + usize::from(*width));
                    entries.push(*entry);
                }
                if values_end <= at {
                    entries.push(LayoutEntry::bare(at as u16));
                }
            }
            regions.push(region);
        }
        Self { regions }
    }

    /// Whether a block of `count` registers or bits from address `first` on touches a region.
    #[inline]
    pub fn has_region_in(&self, first: u16, count: usize) -> bool {
        let (first, end) = (usize::from(first), usize::from(first) + count);
        let behind = self.regions.partition_point(|region| region.end() <= first);
        self.regions.get(behind).is_some_and(|region| region.first < end)
    }

    /// Splits a block of `count` registers or bits from address `first` into parts.
    pub fn split_block(&self, first: u16, count: usize, mut part: impl FnMut(LayoutPart)) {
        let (mut at, end) = (usize::from(first), usize::from(first) + count);
        for region in &self.regions[self.regions.partition_point(|region| region.end() <= at)..] {
            if region.first >= end {
                break;
            }
            if at < region.first {
                part(LayoutPart::Bare(at..region.first));
                at = region.first;
            }
            let block_end = end.min(region.end());
            region.split_block(at..block_end, &mut part);
            at = block_end;
        }
        if at < end {
            part(LayoutPart::Bare(at..end));
        }
    }
}

impl Region {
    #[inline]
    fn end(&self) -> usize {
        self.first + self.borders.len() - 1
    }

    /// Splits the part of a block that lies inside this region: the clean middle, and an edge before and after it.
    #[inline]
    fn split_block(&self, block: Range<usize>, part: &mut impl FnMut(LayoutPart)) {
        let clean = |at: &usize| self.borders[at - self.first].1;
        let entry_index = |at: usize| self.borders[at - self.first].0 as usize;
        let partial_block = |addresses: Range<usize>| {
            LayoutPart::PartialBlock(PartialBlock {
                entries: entry_index(addresses.start)..entry_index(addresses.end),
                addresses,
            })
        };
        let Some(from) = (block.start..=block.end).find(clean) else { return part(partial_block(block)) };
        let to = (from..=block.end).rev().find(clean).unwrap_or(from);
        if block.start < from {
            part(partial_block(block.start..from));
        }
        if from < to {
            part(LayoutPart::Entries(entry_index(from)..entry_index(to)));
        }
        if to < block.end {
            part(partial_block(to..block.end));
        }
    }
}
