//! Text from outside, made fit for a terminal: nothing that moves the cursor or hides letters, and a known width.

use unicode_width::UnicodeWidthChar;

use std::fmt::Write;

/// Appends a text with everything that could move the cursor or hide letters spelled out.
///
/// A device name may hold the escape sequence that clears the screen.
pub fn push_visible(text: &str, out: &mut String) {
    for letter in text.chars() {
        match letter {
            '\t' => out.push_str("\\t"),
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            _ if !hides(letter) => out.push(letter),
            _ if (letter as u32) < 0x100 => drop(write!(out, "\\x{:02x}", letter as u32)),
            _ => drop(write!(out, "\\u{:04x}", letter as u32)),
        }
    }
}

/// The same as a text of its own.
pub fn visible(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    push_visible(text, &mut out);
    out
}

/// Control characters, soft hyphens, and the invisible marks of direction.
fn hides(letter: char) -> bool {
    matches!(letter, '\0'..='\x1f' | '\x7f'..='\u{9f}' | '\u{ad}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}')
        || matches!(letter, '\u{2066}'..='\u{2069}' | '\u{feff}')
}

/// Columns of the terminal that a text takes.
pub fn width(text: &str) -> usize {
    if text.is_ascii() {
        text.len()
    } else {
        text.chars().map(columns).sum()
    }
}

fn columns(letter: char) -> usize {
    letter.width().unwrap_or(0)
}

/// Appends a text in exactly `room` columns, cut with an ellipsis or filled with spaces.
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

/// The letters that fit; a space for half a wide one.
fn push_cut(text: &str, room: usize, out: &mut String) {
    let mut left = room;
    for letter in text.chars() {
        let taken = columns(letter);
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
    fn what_moves_the_cursor_is_spelled_out() {
        assert_eq!(visible("pump\x1b[2J\u{9b}\u{202e}\u{feff}"), "pump\\x1b[2J\\x9b\\u202e\\ufeff");
        assert_eq!(visible("a\tb\r\nc\x7f\u{ad}"), "a\\tb\\r\\nc\\x7f\\xad");
        assert_eq!(visible("Vorlauf 21.4 °C 温"), "Vorlauf 21.4 °C 温");
    }

    #[test]
    fn texts_fit_their_room() {
        assert_eq!(fitted("holding", 5, false), "hold…");
        assert_eq!(fitted("ok", 4, false), "ok  ");
        assert_eq!(fitted("ok", 4, true), "  ok");
        assert_eq!(fitted("温度計", 4, false), "温 …", "half of a wide letter is a space");
        assert_eq!(fitted("温度計", 6, false), "温度計");
        assert_eq!(fitted("any", 0, false), "");
    }
}
