//! Samples over time, some of which follow each other directly.

/// The samples that are kept of a block: all of them, or of a long recording pairs of consecutive samples spread over
/// the whole of it.
#[derive(Clone, Copy, Debug)]
pub struct Sequence<'a, T> {
    /// The samples in the order of time.
    pub values: &'a [T],
    /// Whether each sample directly follows the one before it.
    pub follows: &'a [bool],
}

impl<'a, T: Copy> Sequence<'a, T> {
    /// The pairs of samples that follow each other directly.
    pub fn steps(&self) -> impl Iterator<Item = (T, T)> + use<'a, T> {
        let (values, follows) = (self.values, self.follows);
        (1..values.len()).filter(|&i| follows[i]).map(|i| (values[i - 1], values[i]))
    }

    /// The pairs of consecutive samples between which others were left out.
    pub fn gaps(&self) -> impl Iterator<Item = (T, T)> + use<'a, T> {
        let (values, follows) = (self.values, self.follows);
        (1..values.len()).filter(|&i| !follows[i]).map(|i| (values[i - 1], values[i]))
    }
}
