//! What stands in front of the bytes of a line, without the numbers in it: lines of one statement of a program have it in
//! common.

use crate::text::proved::runs::Style;

/// The most shapes that are remembered.
const MAX_SHAPES: usize = 64;

/// How many characters in front of the bytes make up the shape.
const MAX_CHARS: usize = 200;

/// The hash of what stands in front of bytes, and of their notation.
pub(super) type Shape = u64;

/// The shapes whose bytes were proved to be frames. In further lines of such a shape damaged frames and parts of frames
/// are read, too.
#[derive(Clone, Debug, Default)]
pub(super) struct Shapes {
    known: Vec<Shape>,
}

impl Shapes {
    pub fn add(&mut self, shape: Option<Shape>) {
        if let Some(shape) = shape.filter(|_| self.known.len() < MAX_SHAPES) {
            if !self.known.contains(&shape) {
                self.known.push(shape);
            }
        }
    }

    pub fn contains(&self, shape: Option<Shape>) -> bool {
        shape.is_some_and(|shape| self.known.contains(&shape))
    }
}

/// The shape of a text in front of bytes in this notation; `None` if there are no words or arrows to know it by.
pub(super) fn shape(front: &[u8], style: Style) -> Option<Shape> {
    let front = &front[front.len().saturating_sub(MAX_CHARS)..];
    let mut hash = Fnv::new(style as u8);
    let mut is_known_by = false;
    for word in front.chunk_by(|one, other| one.is_ascii_alphanumeric() == other.is_ascii_alphanumeric()) {
        if word.iter().any(u8::is_ascii_digit) {
            hash.add(b'#');
        } else if word[0].is_ascii_alphabetic() {
            is_known_by |= word.len() > 1;
            hash.add_all(word.iter().map(u8::to_ascii_lowercase));
        } else {
            is_known_by |= word.iter().any(|b| matches!(b, b'<' | b'>') || !b.is_ascii());
            hash.add_all(word.iter().copied().filter(|b| !matches!(b, b' ' | b'\t')));
        }
    }
    is_known_by.then_some(hash.state)
}

/// The hash function FNV-1a.
struct Fnv {
    state: u64,
}

impl Fnv {
    fn new(first: u8) -> Self {
        let mut hash = Self { state: 0xCBF2_9CE4_8422_2325 };
        hash.add(first);
        hash
    }

    fn add_all(&mut self, bytes: impl Iterator<Item = u8>) {
        for byte in bytes {
            self.add(byte);
        }
    }

    fn add(&mut self, byte: u8) {
        self.state = (self.state ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3);
    }
}
