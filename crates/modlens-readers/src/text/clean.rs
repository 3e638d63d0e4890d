//! Removes decoration from lines: terminal colours, the quote marks of mail, typographic spaces and dashes.

use memchr::{memchr, memchr3_iter};

/// Returns `line` without decoration. `is_first` is set for the first line of the file, which may begin with a byte order
/// mark; `strip_quotes` says that leading `>` are mail quotes. The result borrows from `scratch` if something had to be
/// replaced, otherwise from `line`.
pub(super) fn clean<'a>(line: &'a [u8], is_first: bool, strip_quotes: bool, scratch: &'a mut Vec<u8>) -> &'a [u8] {
    let line = if is_first { line.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(line) } else { line };
    let line = line.strip_suffix(b"\r").unwrap_or(line);
    let mut line = line.strip_prefix(b"\r").unwrap_or(line);
    if strip_quotes {
        while let Some(rest) = line.strip_prefix(b">") {
            line = rest.strip_prefix(b" ").unwrap_or(rest);
        }
    }
    if memchr(0x1B, line).is_none() && line.is_ascii() && written_colour(line).is_none() {
        return if has_char_list(line) { join_chars(line, scratch) } else { line };
    }
    scratch.clear();
    let mut rest = line;
    while let Some(&b) = rest.first() {
        let written = ESCAPE_STARTS.contains(&b).then(|| written_colour_length(rest)).flatten();
        let (length, replacement): (usize, &[u8]) = match rest {
            _ if written.is_some() => (written.unwrap_or(1), b""),
            [0x1B, b'[', ..] => (escape_length(rest), b""),
            [0xC2, 0xA0, ..] => (2, b" "),
            [0xE2, 0x80, 0x90..=0x95, ..] => (3, b"-"),
            [0xE2, 0x80, 0x80..=0x8A | 0xAF, ..] | [0xE3, 0x80, 0x80, ..] => (3, b" "),
            [0xE2, 0x80, 0x8B, ..] => (3, b""),
            [0xEF, 0xBC, 0x81..=0xBF, ..] | [0xEF, 0xBD, 0x80..=0x9E, ..] => (3, &[]),
            _ => (1, &rest[..1]),
        };
        if length == 3 && b == 0xEF {
            // Full-width forms become ASCII: U+FF01 is `!`.
            scratch.push(if rest[1] == 0xBC { rest[2] - 0x60 } else { rest[2] - 0x20 });
        } else {
            scratch.extend_from_slice(replacement);
        }
        rest = &rest[length..];
    }
    scratch
}

/// The fewest strings of one character in a row that are read as one string.
const MIN_CHARS: usize = 8;

/// The length of a string of one character with its quotes at the start of the text, and the character, which may be an escape
/// sequence: `"3"`, `'\r'`.
fn one_char(text: &[u8]) -> Option<(usize, &[u8])> {
    match *text {
        [quote @ (b'"' | b'\''), b'\\', _, end, ..] if end == quote => Some((4, &text[1..3])),
        [quote @ (b'"' | b'\''), b, end, ..] if end == quote && b != b'\\' && b.is_ascii_graphic() => Some((3, &text[1..2])),
        _ => None,
    }
}

/// The strings of one character at the start of the text, with commas between them: how long they are, and how many.
fn char_list(text: &[u8]) -> (usize, usize) {
    let (mut at, mut end, mut count) = (0, 0, 0);
    while let Some((length, _)) = one_char(&text[at..]) {
        (end, count) = (at + length, count + 1);
        let behind = text[end..].trim_ascii_start();
        let Some(behind) = behind.strip_prefix(b",") else { break };
        at = text.len() - behind.trim_ascii_start().len();
    }
    (end, count)
}

/// Whether the line may have a list of strings of one character each.
fn has_char_list(line: &[u8]) -> bool {
    memchr::memchr2(b'"', b'\'', line).is_some()
        && (0..line.len()).any(|at| one_char(&line[at..]).is_some_and(|_| char_list(&line[at..]).1 >= MIN_CHARS))
}

/// The line with such lists as one string each: `"0", "1"` as `"01"`.
fn join_chars<'a>(line: &[u8], scratch: &'a mut Vec<u8>) -> &'a [u8] {
    scratch.clear();
    let mut at = 0;
    while at < line.len() {
        let (length, count) = char_list(&line[at..]);
        if count < MIN_CHARS {
            scratch.push(line[at]);
            at += 1;
            continue;
        }
        let quote = line[at];
        scratch.push(quote);
        let end = at + length;
        while at < end {
            match one_char(&line[at..end]) {
                Some((length, b)) => {
                    scratch.extend_from_slice(b);
                    at += length;
                }
                None => at += 1,
            }
        }
        scratch.push(quote);
    }
    scratch
}

/// The length of an ANSI control sequence, which ends with the first byte in 40 to 7E hex (ECMA-48, 5.4).
fn escape_length(text: &[u8]) -> usize {
    text.iter().skip(2).position(|b| (0x40..=0x7E).contains(b)).map_or(text.len(), |at| at + 3)
}

/// How programs write the escape character in front of a colour where the text itself may not hold it: syslog in octal, `cat -v`
/// as a caret, programs that print strings as an escape sequence, and what shows control characters as pictures.
const WRITTEN_ESCAPES: [&[u8]; 8] =
    [b"#033", b"^[", b"\\x1b", b"\\x1B", b"\\033", b"\\u001b", "\u{241B}".as_bytes(), "\u{FFFD}".as_bytes()];

/// The first bytes of these.
const ESCAPE_STARTS: [u8; 5] = [b'#', b'^', b'\\', 0xE2, 0xEF];

/// The length of a colour at the start of the text whose escape character is written out; `None` if there is none.
fn written_colour_length(text: &[u8]) -> Option<usize> {
    let escape = WRITTEN_ESCAPES.iter().find(|escape| text.starts_with(escape))?;
    let rest = text[escape.len()..].strip_prefix(b"[")?;
    let numbers = rest.iter().take_while(|b| b.is_ascii_digit() || **b == b';').count();
    (rest.get(numbers) == Some(&b'm')).then_some(escape.len() + 1 + numbers + 1)
}

/// The place of the first colour in the line whose escape character is written out.
fn written_colour(line: &[u8]) -> Option<usize> {
    let starts = memchr3_iter(ESCAPE_STARTS[0], ESCAPE_STARTS[1], ESCAPE_STARTS[2], line);
    starts.into_iter().find(|&at| written_colour_length(&line[at..]).is_some())
}

/// Whether most lines begin with `>` as mail quotes, rather than as a log's mark for transmitted bytes.
pub(super) fn is_quoted(text: &[u8]) -> bool {
    let lines = || text.split(|&b| b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let strip_quotes = lines().filter(|line| line.starts_with(b">")).count();
    // interceptty marks bytes that the device sent with `>` and a tab.
    let arrows = lines().any(|line| line.starts_with(b"<") || line.starts_with(b">>") || line.starts_with(b"> \t"));
    strip_quotes >= 3 && !arrows && strip_quotes * 2 > lines().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decoration_is_removed() {
        for (line, cleaned) in [
            ("\u{feff}01 03\r", "01 03"),
            ("\x1B[0;36m[D] 01 03\x1B[0m", "[D] 01 03"),
            ("#033[36m2026-11-21 01 03#033[0m", "2026-11-21 01 03"),
            ("^[[1;33m[E] 01 03", "[E] 01 03"),
            ("\u{241B}[0m01 03 \\x1b[0m", "01 03 "),
            ("#033 01 \\x1b\\x03", "#033 01 \\x1b\\x03"),
            ("> > 01 03", "01 03"),
            ("01\u{a0}03 \u{2013}\u{2013}", "01 03 --"),
            ("\u{ff21}\u{ff11} \u{ff1a}\u{ff41}", "A1 :a"),
            ("\u{53d1}\u{2192} 01", "\u{53d1}\u{2192} 01"),
        ] {
            assert_eq!(clean(line.as_bytes(), true, line.starts_with('>'), &mut Vec::new()), cleaned.as_bytes(), "{line}");
        }
        assert_eq!(clean(b"\x1B[", true, false, &mut Vec::new()), b"");
    }

    #[test]
    fn strings_of_one_character_are_one_string() {
        for (line, cleaned) in [
            (r#"<<":","1","1","0","3","0","0","E","\r","\n">>"#, r#"<<":110300E\r\n">>"#),
            ("c = {':', '0', '1', '0', '3', '0', '0', '4'};", "c = {':0103004'};"),
            (r#"["a", "b", "c"]"#, r#"["a", "b", "c"]"#),
        ] {
            assert_eq!(clean(line.as_bytes(), false, false, &mut Vec::new()), cleaned.as_bytes(), "{line}");
        }
    }

    #[test]
    fn text_is_quoted_only_if_most_lines_are() {
        assert!(is_quoted(b"Hello,\n> 01 03\n> 02 03\n> 03 03\n"));
        assert!(!is_quoted(b"> 0x01\n> 0x02\n> 0x03\n< 0x01\n"));
        assert!(!is_quoted(b"> \t0x01\n> \t0x02\n> \t0x03\n"));
    }
}
