//! What is in front of the bytes of a line, without the numbers in it: lines of one statement of a program have it in
//! common.

use crate::text::proved::runs::Style;

/// The most shapes that are remembered.
const MAX_SHAPES: usize = 64;

/// How many characters in front of the bytes make up the shape.
const MAX_CHARS: usize = 200;

/// The hash of what is in front of bytes, and of their notation.
pub(super) type Shape = u64;

/// The shapes whose bytes were proved to be frames. In further lines of such a shape damaged frames and parts of frames
/// are read as well.
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
    let known_by = |word: &[u8]| match word[0] {
        first if first.is_ascii_alphabetic() => word.len() > 1,
        first if first.is_ascii_digit() => false,
        _ => word.iter().any(|b| matches!(b, b'<' | b'>') || !b.is_ascii()),
    };
    let has_name = words(front).any(|word| known_by(word) && !word.iter().any(u8::is_ascii_digit));
    has_name.then(|| any_shape(front, style))
}

/// The shape of a text in front of bytes in this notation, whatever the text.
pub(super) fn any_shape(front: &[u8], style: Style) -> Shape {
    let mut hash = Fnv::new(style as u8);
    for word in words(front) {
        if word.iter().any(u8::is_ascii_digit) {
            hash.add(b'#');
        } else if word[0].is_ascii_alphabetic() {
            hash.add_all(word.iter().map(u8::to_ascii_lowercase));
        } else {
            hash.add_all(word.iter().copied().filter(|b| !matches!(b, b' ' | b'\t')));
        }
    }
    hash.state
}

/// The words in front of bytes, hashed, without numbers.
pub(super) fn label(front: &[u8]) -> Vec<u64> {
    let names = words(front).filter(|word| word[0].is_ascii_alphabetic() && !word.iter().any(u8::is_ascii_digit));
    let hash = |word: &[u8]| {
        let mut hash = Fnv::new(0);
        hash.add_all(word.iter().map(u8::to_ascii_lowercase));
        hash.state
    };
    names.map(hash).collect()
}

/// The words of a text in front of bytes, and what is between them.
fn words(front: &[u8]) -> impl Iterator<Item = &[u8]> {
    front[front.len().saturating_sub(MAX_CHARS)..]
        .chunk_by(|one, other| one.is_ascii_alphanumeric() == other.is_ascii_alphanumeric())
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
