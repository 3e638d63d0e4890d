//! What a text format with one row per line has to say: how a line and its values begin and end.

use modlens_tables::columns::CellSink;

use crate::text_block::Separator;

/// A text format: writes the values of a line.
pub trait LineFormat: CellSink + Default + 'static {
    /// What is before and after times and hex digits.
    const QUOTE: &str;

    /// What is before and after a list.
    const LIST_MARKS: [&str; 2];

    /// What is between the numbers of a list.
    const SEPARATOR: Separator;

    /// Reports the format the names of the columns, before the first line.
    fn columns(&mut self, keys: &[&str]);

    /// The line that is being made.
    fn out(&mut self) -> &mut Vec<u8>;

    /// Announces the column (by index) of the next value.
    fn column(&mut self, at: usize);

    /// Appends what is before a value of a column.
    fn push_key(&mut self, at: usize);

    /// Ends a value.
    fn end_value(&mut self);

    /// Makes a line of values a whole one. These are its texts, at least one: what differs from line to line is between them.
    fn complete(texts: &mut [Vec<u8>]);
}

/// Remembers whether the name of the input file needs quoting or escaping. It is mostly the same as in the row before.
#[derive(Default)]
pub struct FileNameCheck {
    /// Address and length of the name last checked, and whether it needs neither quotes nor escapes.
    known: Option<(usize, usize, bool)>,
}

impl FileNameCheck {
    /// Whether the name contains nothing that `special` reports.
    #[inline]
    pub fn plain(&mut self, file: &str, special: fn(&[u8]) -> bool) -> bool {
        let (at, length) = (file.as_ptr() as usize, file.len());
        match self.known {
            Some((known, size, is_plain)) if (known, size) == (at, length) => is_plain,
            _ => {
                let is_plain = !special(file.as_bytes());
                self.known = Some((at, length, is_plain));
                is_plain
            }
        }
    }
}
