//! Finds out from the words around bytes who sent them.

use crate::chunk::Side;

/// How many characters in front of the bytes are searched.
const MAX_CHARS: usize = 120;

/// Verbs and their abbreviations; the one nearest to the bytes counts.
const VERBS: &[(&str, Side)] = &[
    ("tx", Side::Sent),
    ("txd", Side::Sent),
    ("send", Side::Sent),
    ("sends", Side::Sent),
    ("sent", Side::Sent),
    ("sending", Side::Sent),
    ("transmit", Side::Sent),
    ("transmitted", Side::Sent),
    ("transmitting", Side::Sent),
    ("writing", Side::Sent),
    ("wrote", Side::Sent),
    ("written", Side::Sent),
    ("outgoing", Side::Sent),
    ("rx", Side::Received),
    ("rxd", Side::Received),
    ("recv", Side::Received),
    ("rcvd", Side::Received),
    ("recd", Side::Received),
    ("receive", Side::Received),
    ("receives", Side::Received),
    ("received", Side::Received),
    ("receiving", Side::Received),
    ("incoming", Side::Received),
    ("answered", Side::Received),
    ("answers", Side::Received),
    ("replied", Side::Received),
    ("replies", Side::Received),
    ("returned", Side::Received),
    ("returns", Side::Received),
    ("got", Side::Received),
    ("gets", Side::Received),
];

/// Nouns, for lines without a verb: a request is what the program sends.
const NOUNS: &[(&str, Side)] = &[
    ("request", Side::Sent),
    ("requests", Side::Sent),
    ("req", Side::Sent),
    ("query", Side::Sent),
    ("command", Side::Sent),
    ("cmd", Side::Sent),
    ("response", Side::Received),
    ("responses", Side::Received),
    ("resp", Side::Received),
    ("rsp", Side::Received),
    ("reply", Side::Received),
    ("answer", Side::Received),
];

/// Words that tell who sent the bytes only if they are next to them.
const NEXT_TO_BYTES: &[(&str, Side)] = &[
    ("write", Side::Sent),
    ("read", Side::Received),
    ("out", Side::Sent),
    ("in", Side::Received),
    ("master", Side::Sent),
    ("client", Side::Sent),
    ("slave", Side::Received),
    ("device", Side::Received),
];

/// Words for the bytes themselves, which may be between them and the word that shows who sent them.
const CONTAINERS: &[&str] = &["buffer", "bytes", "data", "hex", "array", "raw", "frame", "packet", "payload", "message", "adu"];

/// Arrows, which are next to the bytes, longer ones first.
const ARROWS: &[(&str, Side)] = &[
    ("\u{2192}", Side::Sent),
    ("\u{2190}", Side::Received),
    ("<--", Side::Received),
    ("<==", Side::Received),
    ("->", Side::Sent),
    ("=>", Side::Sent),
    ("<-", Side::Received),
    ("<=", Side::Received),
    (">", Side::Sent),
    ("<", Side::Received),
];

/// Who sent the bytes that follow this text; `None` if it does not say.
pub(in crate::text) fn sender(front: &[u8]) -> Option<Side> {
    let front = &front[front.len().saturating_sub(MAX_CHARS)..];
    let words = words(front);
    let nearest = |list: &[(&str, Side)]| words.iter().rev().find_map(|word| look_up(list, word));
    nearest(VERBS).or_else(|| arrow(front)).or_else(|| nearest(NOUNS)).or_else(|| {
        // A number after the word counts bytes or names a port.
        let names_bytes = |word: &&Vec<u8>| CONTAINERS.iter().any(|known| known.as_bytes() == word.as_slice());
        words.iter().rev().find(|word| !names_bytes(word)).and_then(|word| look_up(NEXT_TO_BYTES, word))
    })
}

/// The words of a text in lower case. A word ends at a change from lower to upper case, as in `onRxData`.
fn words(text: &[u8]) -> Vec<Vec<u8>> {
    let mut words: Vec<Vec<u8>> = vec![Vec::new()];
    let mut before = b' ';
    for &b in text {
        if b.is_ascii_uppercase() && before.is_ascii_lowercase() {
            words.push(Vec::new());
        }
        match words.last_mut() {
            Some(word) if b.is_ascii_alphabetic() => word.push(b.to_ascii_lowercase()),
            Some(word) if !word.is_empty() => words.push(Vec::new()),
            _ => {}
        }
        before = b;
    }
    words.retain(|word| !word.is_empty());
    words
}

fn look_up(list: &[(&str, Side)], word: &[u8]) -> Option<Side> {
    list.iter().find(|(known, _)| known.as_bytes() == word).map(|(_, side)| *side)
}

/// The arrow at the end of the text, with blanks and quotes after it.
fn arrow(front: &[u8]) -> Option<Side> {
    let end = front.iter().rposition(|b| {
        !matches!(b, b' ' | b'\t' | b':' | b'"' | b'\'' | b'`' | b'[' | b'(' | b'{' | b'*' | b'\\' | b'%' | b'$' | b'#')
    })?;
    let end = end + 1;
    let text = &front[..end];
    // A bracket around the bytes is next to the arrow, as in `-> < 01 03 >`.
    let before = text.strip_suffix(b"<").map(<[u8]>::trim_ascii_end).filter(|before| before.len() + 1 < text.len());
    let text = before.filter(|before| ARROWS.iter().any(|(sign, _)| before.ends_with(sign.as_bytes()))).unwrap_or(text);
    // A bracket that closes something, as in `<Buffer>`, is no arrow.
    let closes =
        text.ends_with(b">") && text.iter().rposition(|&b| b == b'<').is_some_and(|at| text[at + 1].is_ascii_alphabetic());
    ARROWS.iter().find(|(sign, _)| !closes && text.ends_with(sign.as_bytes())).map(|(_, side)| *side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_arrows_tell_the_sender() {
        for (front, side) in [
            ("RTU recv (44 bytes): ", Some(Side::Received)),
            ("Sending request: ", Some(Side::Sent)),
            ("Received response: ", Some(Side::Received)),
            ("Sending response: ", Some(Side::Sent)),
            ("which is answered by ", Some(Side::Received)),
            ("onRxData(8) ", Some(Side::Received)),
            ("tx_buf = [", Some(Side::Sent)),
            ("12:00 \u{2192} ", Some(Side::Sent)),
            ("bus1 <- ", Some(Side::Received)),
            ("Request frame ", Some(Side::Sent)),
            ("Read: ", Some(Side::Received)),
            ("write <Buffer ", Some(Side::Sent)),
            ("resp <Buffer ", Some(Side::Received)),
            ("\u{2192} < ", Some(Side::Sent)),
            ("\u{2190} < ", Some(Side::Received)),
            ("Read holding registers: ", None),
            ("Parsing RTU frame: ", None),
            ("<Buffer ", None),
            ("", None),
        ] {
            assert_eq!(sender(front.as_bytes()), side, "{front}");
        }
    }
}
