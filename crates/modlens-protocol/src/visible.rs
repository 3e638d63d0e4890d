//! Text from recordings, devices and file names as a person may see it: nothing in it moves a cursor or hides text.

use std::fmt::Write;

/// Appends a text in which every character that could move the cursor or hide text is escaped.
///
/// A device name may contain the escape sequence that clears the screen.
pub fn push_visible(text: &str, out: &mut String) {
    for letter in text.chars() {
        match letter {
            '\t' => out.push_str("\\t"),
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            _ if !is_unsafe(letter) => out.push(letter),
            _ if (letter as u32) < 0x100 => drop(write!(out, "\\x{:02x}", letter as u32)),
            _ if (letter as u32) < 0x1_0000 => drop(write!(out, "\\u{:04x}", letter as u32)),
            _ => drop(write!(out, "\\U{:08x}", letter as u32)),
        }
    }
}

/// A text in which every character that could move the cursor or hide text is escaped.
pub fn visible(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    push_visible(text, &mut out);
    out
}

/// Whether a character is a control character, a soft hyphen, an invisible mark of direction or format, or a tag: the same
/// characters that analyzer/visible.py escapes.
fn is_unsafe(letter: char) -> bool {
    matches!(letter, '\0'..='\x1f' | '\x7f'..='\u{9f}' | '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}')
        || matches!(letter, '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_that_move_the_cursor_are_escaped() {
        assert_eq!(visible("pump\x1b[2J\u{9b}\u{202e}\u{feff}"), "pump\\x1b[2J\\x9b\\u202e\\ufeff");
        assert_eq!(visible("a\tb\r\nc\x7f\u{ad}"), "a\\tb\\r\\nc\\x7f\\xad");
        assert_eq!(visible("a\u{61c}b\u{2060}\u{206f}\u{e0041}"), "a\\u061cb\\u2060\\u206f\\U000e0041");
        assert_eq!(visible("Vorlauf 21.4 °C 温"), "Vorlauf 21.4 °C 温");
    }
}
