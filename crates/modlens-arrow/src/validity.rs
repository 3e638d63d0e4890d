//! Which rows of a column have a value.

use arrow_buffer::{BooleanBufferBuilder, NullBuffer};

/// A bit for each row, which is set where there is a value. There are none as long as all rows have one.
#[derive(Default)]
pub(super) struct Validity {
    bits: Option<BooleanBufferBuilder>,
    /// Rows, as long as there are no bits.
    rows: usize,
    /// Rows that are to be expected.
    expected: usize,
}

impl Validity {
    pub(super) fn with_capacity(rows: usize) -> Self {
        Self { bits: None, rows: 0, expected: rows }
    }

    /// Appends rows that all have a value.
    #[inline]
    pub(super) fn push_values(&mut self, rows: usize) {
        match &mut self.bits {
            Some(bits) => bits.append_n(rows, true),
            None => self.rows += rows,
        }
    }

    /// Appends rows that all have none.
    pub(super) fn push_nothing(&mut self, rows: usize) {
        self.with_bits().append_n(rows, false);
    }

    /// Appends rows of these kinds; `has_value` is 1 for each kind that has a value, else 0.
    pub(super) fn push_kinds(&mut self, has_value: &[u8], kinds: &[u32]) {
        let bits = self.with_bits();
        for kinds in kinds.chunks(64) {
            let word = kinds.iter().enumerate().fold(0, |word, (at, &kind)| word | u64::from(has_value[kind as usize]) << at);
            bits.append_word(word, kinds.len());
        }
    }

    /// As Arrow has it; `None` where all rows have a value. It is empty then.
    pub(super) fn finish(&mut self) -> Option<NullBuffer> {
        self.rows = 0;
        Some(NullBuffer::new(self.bits.take()?.build()))
    }

    fn with_bits(&mut self) -> &mut BooleanBufferBuilder {
        let (rows, expected) = (self.rows, self.expected);
        self.bits.get_or_insert_with(|| {
            let mut bits = BooleanBufferBuilder::new(rows.max(expected));
            bits.append_n(rows, true);
            bits
        })
    }
}
