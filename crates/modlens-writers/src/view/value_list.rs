//! Lists of values in a cell, shown as far as they fit.

use crate::view::safe_text::{named, width};
use modlens_tables::columns::Items;

/// A list of values, of which as many are shown as fit: `555 0 100 … +12`.
pub enum ValueList<'a> {
    /// Registers or bits, still encoded as on the wire.
    Numbers(Items<'a>),
    /// Bytes, as pairs of hex digits.
    Bytes(&'a [u8]),
    /// Texts, each with the number of values that it represents.
    Texts(Vec<(String, usize)>),
    /// Names with their values, as `name=value`.
    Named(Vec<(String, String)>),
}

impl ValueList<'_> {
    /// The number of texts.
    pub fn len(&self) -> usize {
        match self {
            Self::Numbers(items) => items.len(),
            Self::Bytes(bytes) => bytes.len(),
            Self::Texts(texts) => texts.len(),
            Self::Named(pairs) => pairs.len(),
        }
    }

    /// Whether the list is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends the text at an index.
    fn push(&self, index: usize, out: &mut String) {
        match self {
            Self::Numbers(items) => out.push_str(itoa::Buffer::new().format(items.get(index))),
            Self::Bytes(bytes) => {
                for digit in [bytes[index] >> 4, bytes[index] & 15] {
                    out.push(char::from_digit(digit.into(), 16).unwrap_or('?'));
                }
            }
            Self::Texts(texts) => out.push_str(&texts[index].0),
            Self::Named(pairs) => out.push_str(&named(&pairs[index].0, "=", &pairs[index].1, usize::MAX)),
        }
    }

    /// The number of values that a text represents.
    fn stands_for(&self, index: usize) -> usize {
        match self {
            Self::Texts(texts) => texts[index].1,
            _ => 1,
        }
    }

    /// All values.
    pub fn full_text(&self) -> String {
        let mut out = String::new();
        for index in 0..self.len() {
            if index > 0 {
                out.push(' ');
            }
            self.push(index, &mut out);
        }
        out
    }

    /// As many values as fit into `room` columns, and the number of the remaining ones.
    ///
    /// Where not even the first fits, its name is cut, so that its value is seen.
    pub fn fitting_text(&self, room: usize) -> String {
        let first = self.len().min(room / 2 + 1); // each takes at least two columns
        let mut text_ends = Vec::with_capacity(first);
        let mut out = String::new();
        for index in 0..first {
            self.push(index, &mut out);
            text_ends.push(out.len());
            out.push(' ');
        }
        if first == self.len() && width(&out[..out.len().saturating_sub(1)]) <= room {
            out.pop();
            return out;
        }
        let mut hidden_values: usize = (0..self.len()).map(|index| self.stands_for(index)).sum();
        let widest_suffix = more_width(hidden_values); // the number only decreases, so its text never gets wider
        let (mut columns_used, mut values_left, mut kept, mut text_start) = (0, hidden_values, 0, 0);
        for (index, &end) in text_ends.iter().enumerate() {
            columns_used += width(&out[text_start..end]) + 1;
            values_left -= self.stands_for(index);
            if columns_used + widest_suffix > room && columns_used + more_width(values_left) > room {
                break;
            }
            (hidden_values, kept, text_start) = (values_left, end + 1, end + 1);
        }
        out.truncate(kept);
        if let (0, Self::Named(pairs)) = (kept, self) {
            let more = if pairs.len() > 1 { 1 + more_width(pairs.len() - 1) } else { 0 };
            let first = named(&pairs[0].0, "=", &pairs[0].1, room.saturating_sub(more));
            if width(&first) + more <= room {
                out.push_str(&first);
                if pairs.len() == 1 {
                    return out;
                }
                out.push(' ');
                hidden_values -= 1;
            }
        }
        out.push_str("… +");
        out.push_str(itoa::Buffer::new().format(hidden_values));
        out
    }
}

/// The width of `… +12`.
fn more_width(count: usize) -> usize {
    3 + itoa::Buffer::new().format(count).len()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use modlens_tables::columns::Items;

    fn texts(values: &[(&str, usize)]) -> ValueList<'static> {
        ValueList::Texts(values.iter().map(|(text, count)| ((*text).to_owned(), *count)).collect())
    }

    fn readings(pairs: &[(&str, &str)]) -> ValueList<'static> {
        ValueList::Named(pairs.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect())
    }

    #[test]
    fn as_many_values_are_shown_as_fit() {
        assert_eq!(texts(&[("555", 1), ("0", 1), ("100", 1), ("7", 1)]).fitting_text(10), "555 0 … +2");
        assert_eq!(texts(&[("555", 1), ("0", 1), ("100", 1)]).fitting_text(9), "555 0 100");
        assert_eq!(ValueList::Numbers(Items::Words(&[0, 1, 255, 255])).fitting_text(7), "1 65535");
        assert_eq!(ValueList::Bytes(&[1, 0xAB]).fitting_text(80), "01 ab");
        assert_eq!(ValueList::Bytes(&[]).fitting_text(0), "");
    }

    #[test]
    fn groups_of_bits_count_as_bits() {
        assert_eq!(texts(&[("10110011", 8), ("10110011", 8), ("1", 1)]).fitting_text(14), "10110011 … +9");
    }

    #[test]
    fn a_name_is_cut_before_its_value_is_left_out() {
        let both = readings(&[("supply temperature", "23.5"), ("pump", "on")]);
        assert_eq!(both.fitting_text(40), "supply temperature=23.5 pump=on");
        assert_eq!(both.fitting_text(28), "supply temperature=23.5 … +1");
        assert_eq!(both.fitting_text(20), "supply te…=23.5 … +1");
        assert_eq!(readings(&[("supply temperature", "23.5")]).fitting_text(12), "supply…=23.5");
        assert_eq!(readings(&[("supply temperature", "23.5")]).fitting_text(4), "23.5", "the value alone");
        assert_eq!(readings(&[("supply temperature", "23.5")]).fitting_text(3), "… +1", "never a part of a value");
    }

    proptest! {
        #[test]
        fn all_values_or_some_and_the_number_of_the_others(numbers: Vec<u16>, room in 1usize..60) {
            let spelled: Vec<String> = numbers.iter().map(u16::to_string).collect();
            let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_be_bytes()).collect();
            let shown = ValueList::Numbers(Items::Words(&bytes)).fitting_text(room);
            match shown.split_once('…') {
                None => prop_assert_eq!(&shown, &spelled.join(" ")),
                Some((begun, more)) => {
                    let begun: Vec<&str> = begun.split_whitespace().collect();
                    prop_assert_eq!(&begun[..], &spelled[..begun.len()]);
                    let more: usize = more.trim_start_matches(" +").parse().unwrap();
                    prop_assert_eq!(begun.len() + more, spelled.len());
                    prop_assert!(width(&shown) <= room || begun.is_empty());
                }
            }
        }
    }
}
