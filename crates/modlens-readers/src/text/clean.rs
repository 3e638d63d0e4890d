//! What stands in lines and means nothing: colours of a terminal, quote marks of mail, typographers' blanks and dashes.

use memchr::memchr;

/// The line without them; `scratch` holds it where something had to go.
pub(super) fn clean<'a>(line: &'a [u8], first: bool, quoted: bool, scratch: &'a mut Vec<u8>) -> &'a [u8] {
    let line = if first { line.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(line) } else { line };
    let line = line.strip_suffix(b"\r").unwrap_or(line);
    let mut line = line.strip_prefix(b"\r").unwrap_or(line);
    if quoted {
        while let Some(rest) = line.strip_prefix(b">") {
            line = rest.strip_prefix(b" ").unwrap_or(rest);
        }
    }
    if memchr(0x1B, line).is_none() && line.is_ascii() {
        return line;
    }
    scratch.clear();
    let mut rest = line;
    while let Some(&b) = rest.first() {
        let (length, instead): (usize, &[u8]) = match rest {
            [0x1B, b'[', ..] => (escape(rest), b""),
            [0xC2, 0xA0, ..] => (2, b" "),
            [0xE2, 0x80, 0x90..=0x95, ..] => (3, b"-"),
            [0xE2, 0x80, 0x80..=0x8A | 0xAF, ..] | [0xE3, 0x80, 0x80, ..] => (3, b" "),
            [0xE2, 0x80, 0x8B, ..] => (3, b""),
            [0xEF, 0xBC, 0x81..=0xBF, ..] | [0xEF, 0xBD, 0x80..=0x9E, ..] => (3, &[]),
            _ => (1, &rest[..1]),
        };
        if length == 3 && b == 0xEF {
            // Full-width forms: U+FF01 is `!`.
            scratch.push(if rest[1] == 0xBC { rest[2] - 0x60 } else { rest[2] - 0x20 });
        } else {
            scratch.extend_from_slice(instead);
        }
        rest = &rest[length..];
    }
    scratch
}

/// The length of a control sequence: parameters, then a letter.
fn escape(text: &[u8]) -> usize {
    text.iter().skip(2).position(|b| (0x40..=0x7E).contains(b)).map_or(text.len(), |at| at + 3)
}

/// Whether most lines are quoted, as in an answer to a mail.
pub(super) fn is_quoted(text: &[u8]) -> bool {
    let lines = || text.split(|&b| b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let quoted = lines().filter(|line| line.starts_with(b">")).count();
    // interceptty's mark of what a device sent has a tab behind it.
    let arrows = lines().any(|line| line.starts_with(b"<") || line.starts_with(b">>") || line.starts_with(b"> \t"));
    quoted >= 3 && !arrows && quoted * 2 > lines().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_means_nothing_goes() {
        for (line, cleaned) in [
            ("\u{feff}01 03\r", "01 03"),
            ("\x1B[0;36m[D] 01 03\x1B[0m", "[D] 01 03"),
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
    fn quotes_are_seen_in_most_lines_only() {
        assert!(is_quoted(b"Hello,\n> 01 03\n> 02 03\n> 03 03\n"));
        assert!(!is_quoted(b"> 0x01\n> 0x02\n> 0x03\n< 0x01\n"));
        assert!(!is_quoted(b"> \t0x01\n> \t0x02\n> \t0x03\n"));
    }
}
