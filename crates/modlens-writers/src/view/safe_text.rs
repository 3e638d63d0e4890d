//! Fits text from the input into columns of a terminal.

use unicode_width::UnicodeWidthChar;

pub use modlens_protocol::visible::{push_visible, visible};

/// The number of terminal columns that a text takes.
pub fn width(text: &str) -> usize {
    if text.is_ascii() {
        text.len()
    } else {
        text.chars().map(char_width).sum()
    }
}

/// The number of terminal columns that a character takes.
fn char_width(letter: char) -> usize {
    letter.width().unwrap_or(0)
}

/// Appends a text in exactly `room` columns, padded with spaces or cut with an ellipsis. `right` aligns it to the
/// right.
pub fn push_fitted(text: &str, room: usize, right: bool, out: &mut String) {
    let taken = width(text);
    let spaces = room.saturating_sub(taken);
    if right {
        out.extend(std::iter::repeat_n(' ', spaces));
    }
    if taken <= room {
        out.push_str(text);
    } else if room > 0 {
        push_cut(text, room - 1, out);
        out.push('…');
    }
    if !right {
        out.extend(std::iter::repeat_n(' ', spaces));
    }
}

/// A name cut to fewer columns than this is left out, because it would be meaningless.
const MIN_NAME_COLUMNS: usize = 4;

/// A name and its value, with `between` between them, in at most `room` columns: the name is cut or left out, the value
/// is whole even where it is wider.
pub fn named(name: &str, between: &str, value: &str, room: usize) -> String {
    let left = room.saturating_sub(width(between) + width(value));
    let mut out = String::with_capacity(name.len() + between.len() + value.len());
    if width(name) <= left {
        out.push_str(name);
    } else if left >= MIN_NAME_COLUMNS {
        push_fitted(name, left, false, &mut out);
    }
    if !out.is_empty() && !value.is_empty() {
        out.push_str(between);
    }
    out.push_str(value);
    out
}

/// Appends the characters that fit; half of a wide character is replaced by a space.
fn push_cut(text: &str, room: usize, out: &mut String) {
    let mut left = room;
    for letter in text.chars() {
        let taken = char_width(letter);
        if taken > left {
            out.extend(std::iter::repeat_n(' ', left));
            return;
        }
        left -= taken;
        out.push(letter);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(text: &str, room: usize, right: bool) -> String {
        let mut out = String::new();
        push_fitted(text, room, right, &mut out);
        out
    }

    #[test]
    fn texts_are_padded_or_cut_to_their_room() {
        assert_eq!(fitted("holding", 5, false), "hold…");
        assert_eq!(fitted("ok", 4, false), "ok  ");
        assert_eq!(fitted("ok", 4, true), "  ok");
        assert_eq!(fitted("温度計", 4, false), "温 …", "half of a wide letter is a space");
        assert_eq!(fitted("温度計", 6, false), "温度計");
        assert_eq!(fitted("any", 0, false), "");
    }
}
