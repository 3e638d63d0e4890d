//! Frames that are printed over several lines of the same shape: a byte a line, or what one read returned a line.

use crate::text::proved::frames::fits_known_function;
use crate::text::proved::shapes::Shape;
use modlens_protocol::checksum::{crc_valid, update};
use modlens_protocol::functions::EXCEPTION_BIT;

/// How many shapes are collected at the same time, such as sent and received bytes.
const MAX_GROUPS: usize = 4;

/// How many other lines may be between two blocks.
const MAX_LINES_BETWEEN: u64 = 8;

/// The most bytes of a group: an RTU frame has up to 256 (serial line specification, 2.5.1).
const MAX_GROUP_BYTES: usize = 256;

/// The register of the CRC before the first byte.
const CRC_START: u16 = 0xFFFF;

/// A frame of so many bytes counts even where bytes that nothing proves are in front of it.
const MIN_BEHIND_OTHERS: usize = 8;

/// The bytes of one line, which may be a part of a frame.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub number: u64,
    pub line: Vec<u8>,
    /// Where the bytes begin in the line.
    pub start: usize,
    pub bytes: Vec<u8>,
}

/// The blocks of one shape.
#[derive(Clone, Debug)]
struct Group {
    shape: Shape,
    pieces: Vec<Piece>,
    /// For each block the register of the CRC over its bytes and all later ones. It is 0 if they end with their CRC.
    registers: Vec<u16>,
    byte_count: usize,
}

/// The blocks of frames that were read last.
#[derive(Clone, Debug, Default)]
pub(super) struct Pieces {
    groups: Vec<Group>,
}

impl Pieces {
    /// Adds a line. Returns the blocks of the frame that is complete with it, if there is one.
    pub fn add(&mut self, shape: Shape, piece: Piece) -> Option<Vec<Piece>> {
        let number = piece.number;
        let is_open = |group: &Group| group.pieces.last().is_some_and(|last| last.number + MAX_LINES_BETWEEN >= number);
        self.groups.retain(is_open);
        let known = self.groups.iter().position(|group| group.shape == shape);
        let index = known.unwrap_or_else(|| self.open_group(shape));
        let group = &mut self.groups[index];
        group.add(piece);
        let start = group.frame_start()?;
        let pieces = group.pieces.split_off(start);
        self.groups.remove(index);
        Some(pieces)
    }

    /// Begins a group of this shape, for which the oldest has to go if there are too many. Returns its index.
    fn open_group(&mut self, shape: Shape) -> usize {
        if self.groups.len() == MAX_GROUPS {
            self.groups.remove(0);
        }
        self.groups.push(Group { shape, pieces: Vec::new(), registers: Vec::new(), byte_count: 0 });
        self.groups.len() - 1
    }
}

impl Group {
    fn add(&mut self, piece: Piece) {
        while !self.pieces.is_empty() && self.byte_count + piece.bytes.len() > MAX_GROUP_BYTES {
            self.byte_count -= self.pieces.remove(0).bytes.len();
            self.registers.remove(0);
        }
        self.registers.push(CRC_START);
        for register in &mut self.registers {
            *register = update(*register, &piece.bytes);
        }
        self.byte_count += piece.bytes.len();
        self.pieces.push(piece);
    }

    /// The block with which a frame begins that ends with the last block; `None` if there is none.
    fn frame_start(&self) -> Option<usize> {
        (0..self.pieces.len()).find(|&start| self.registers[start] == 0 && self.is_frame(start))
    }

    fn is_frame(&self, start: usize) -> bool {
        let bytes: Vec<u8> = self.pieces[start..].iter().flat_map(|piece| piece.bytes.iter().copied()).collect();
        let least = if start == 0 { 5 } else { MIN_BEHIND_OTHERS };
        bytes.len() >= least
            && bytes[1] & !EXCEPTION_BIT != 0
            && crc_valid(&bytes)
            && fits_known_function(&bytes[1..bytes.len() - 2])
    }
}
