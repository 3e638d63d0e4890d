//! What is known of the bytes in the current line.

/// The reason reported for bytes that are beside a frame in a line.
pub(super) const BESIDE: &str = "hex beside a frame that no checksum proves";

/// Bytes of the current line that were read or are listed.
#[derive(Debug, Default)]
pub(super) struct LineBytes {
    pub all: Vec<Vec<u8>>,
}

impl LineBytes {
    pub fn add(&mut self, bytes: &[u8]) {
        self.all.push(bytes.to_vec());
    }
}
