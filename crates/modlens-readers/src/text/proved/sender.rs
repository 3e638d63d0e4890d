//! Finds out from the words around bytes who sent them.

use crate::chunk::Side;
use crate::text::direction_words::{meaning, words, Meaning, Rank, ARROWS, CONTAINERS};

/// How many characters in front of the bytes are searched.
const MAX_CHARS: usize = 120;

/// Words after which somebody refers to another message than the one that follows.
const REFERRING: [&str; 9] = ["to", "for", "of", "on", "auf", "zu", "de", "a", "на"];
const ARTICLES: [&str; 10] = ["the", "this", "that", "a", "die", "der", "das", "la", "le", "el"];

/// What is between a sender and the receiver whose name follows.
const TOWARDS: [&str; 8] = ["->", "=>", "\u{2192}", " to", " an", " zu", " vers", " a"];

/// A label without a colon or an arrow at its end has at most so many words.
const MAX_LABEL_WORDS: usize = 5;

/// A label with a remark after it has at most so many words.
const MAX_REMARKED_WORDS: usize = 2;

/// Words by which a line says that nothing was sent or received, or not yet.
const NOT: [&str; 20] = [
    "no",
    "not",
    "without",
    "wait",
    "waiting",
    "timeout",
    "timed",
    "error",
    "failed",
    "fail",
    "invalid",
    "missing",
    "expected",
    "expecting",
    "retry",
    "retries",
    "keine",
    "kein",
    "empty",
    "after",
];

/// Who sent the bytes that follow this text; `None` if it does not say.
pub(in crate::text) fn sender(front: &[u8]) -> Option<Side> {
    let front = &front[front.len().saturating_sub(MAX_CHARS)..];
    let text = String::from_utf8_lossy(front);
    let words = words(&text);
    let known: Vec<Option<Meaning>> = words.iter().map(|(_, word)| meaning(word)).collect();
    let nearest = |rank: Rank| known.iter().rev().flatten().find(|(_, own)| *own == rank).map(|(side, _)| *side);
    // `the answer to the request` is an answer.
    let is_of_other = |at: usize| {
        let mut before = words[..at].iter().rev().map(|(_, word)| word.as_str()).skip_while(|word| ARTICLES.contains(word));
        before.next().is_some_and(|word| REFERRING.contains(&word))
    };
    let noun = (0..words.len()).rev().filter_map(|at| Some((at, known[at]?))).filter(|(_, (_, rank))| *rank == Rank::Noun);
    let noun = noun.filter(|(at, _)| !is_of_other(*at)).map(|(_, (side, _))| side).next().or_else(|| nearest(Rank::Noun));
    let said = nearest(Rank::Verb).or_else(|| arrow(front).filter(|_| !ends_with_index(front))).or(noun);
    let said = said.or_else(|| {
        // A number after the word counts bytes or names a port.
        let last = words.iter().rposition(|(_, word)| !CONTAINERS.contains(&word.as_str()))?;
        let (side, rank) = known[last]?;
        let before = text[..words[last].0].trim_end().to_lowercase();
        let is_receiver = rank == Rank::Party && TOWARDS.iter().any(|sign| before.ends_with(sign) || before == sign.trim_start());
        Some(if is_receiver { side.other() } else { side })
    });
    said.or_else(|| leading_arrow(&text).filter(|_| !ends_with_index(front)))
}

/// The arrow with which the text begins, perhaps after a time.
fn leading_arrow(text: &str) -> Option<Side> {
    let start = text.find(|c: char| matches!(c, '<' | '>' | '-' | '=' | '\u{2190}' | '\u{2192}') || c.is_alphabetic())?;
    let rest = text[start..].trim_start_matches(['-', '=', ' ']);
    let signs = [&text[start..], rest];
    let is_long = |sign: &str| sign.chars().nth(1).is_some() || !sign.is_ascii();
    signs.iter().find_map(|rest| {
        let (_, side) = ARROWS.iter().filter(|(sign, _)| is_long(sign)).find(|(sign, _)| rest.starts_with(sign))?;
        Some(*side)
    })
}

/// Who sent the bytes below this label, by its words.
pub(in crate::text) fn sender_below(text: &[u8]) -> Option<Side> {
    let lossy = String::from_utf8_lossy(text);
    let words = words(&lossy);
    let is_mark = |b: u8| matches!(b, b'*' | b'_' | b'`' | b'"' | b'\'' | b' ' | b'\t');
    let end = text.iter().rposition(|b| !is_mark(*b)).map_or(0, |last| last + 1);
    let text = &text[..end];
    let ends_as_label =
        matches!(text.last(), Some(b':' | b'=' | b'>' | b'<' | b'-' | b'{' | b'(')) || text.ends_with("\u{FF1A}".as_bytes());
    if denies(text) {
        return None;
    }
    if !ends_as_label && words.len() > MAX_LABEL_WORDS {
        return label_of_remark(text).and_then(sender_below);
    }
    // `Polling slave 1...` says who is asked.
    let is_of_party = |(_, word): &(usize, String)| meaning(word).is_none_or(|(_, rank)| rank == Rank::Party);
    let begins_otherwise = words.first().is_some_and(|(_, word)| meaning(word).is_none());
    if !ends_as_label && begins_otherwise && words.iter().all(is_of_party) {
        return None;
    }
    // `Write/Read:` and `Response to the request:` name both.
    let names = |side: Side| {
        let said = words.iter().filter_map(|(_, word)| meaning(word));
        said.filter(|(_, rank)| *rank != Rank::Party).any(|(own, _)| own == side)
    };
    if names(Side::Sent) && names(Side::Received) {
        arrow(text)
    } else if is_sent_by_unit(&words) {
        Some(Side::Received)
    } else {
        sender(text)
    }
}

/// Whether the first word that says anything is one for a unit, and the next one that it sends: `Slave (the meter) sends back:`.
fn is_sent_by_unit(words: &[(usize, String)]) -> bool {
    let mut said = words.iter().filter_map(|(_, word)| Some((word, meaning(word)?)));
    let is_unit = said.next().is_some_and(|(_, known)| known == (Side::Received, Rank::Party));
    is_unit && said.next().is_some_and(|(word, known)| known == (Side::Sent, Rank::Verb) && !word.starts_with("tx"))
}

/// The label with which a line begins that goes on with a remark, as `// Request: reads two registers of the meter`.
pub(in crate::text) fn label_of_remark(text: &[u8]) -> Option<&[u8]> {
    let ends = [&b": "[..], "\u{FF1A}".as_bytes()];
    let end = ends.iter().filter_map(|mark| Some(memchr::memmem::find(text, mark)? + mark.len())).min()?;
    let label = &text[..end];
    (words(&String::from_utf8_lossy(label)).len() <= MAX_REMARKED_WORDS && end < text.len()).then_some(label)
}

/// Whether the words of a line say that nothing was sent or received, or not yet.
pub(in crate::text) fn denies(text: &[u8]) -> bool {
    words(&String::from_utf8_lossy(text)).iter().any(|(_, word)| NOT.contains(&word.as_str()))
}

/// Whether a text is the index of an element as PHP prints it: `1 => '`.
pub(in crate::text) fn ends_with_index(front: &[u8]) -> bool {
    let end = front.iter().rposition(|b| !matches!(b, b' ' | b'\'' | b'"')).map_or(0, |last| last + 1);
    let index = front[..end].strip_suffix(b"=>").map(<[u8]>::trim_ascii);
    index.is_some_and(|index| !index.is_empty() && index.iter().all(u8::is_ascii_digit))
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
            ("  1 => '", None),
            ("Request frame ", Some(Side::Sent)),
            ("Read: ", Some(Side::Received)),
            ("write <Buffer ", Some(Side::Sent)),
            ("resp <Buffer ", Some(Side::Received)),
            ("\u{2192} < ", Some(Side::Sent)),
            ("\u{2190} < ", Some(Side::Received)),
            ("Read holding registers: ", None),
            ("Parsing RTU frame: ", None),
            ("<Buffer ", None),
            ("this is the answer to the request: ", Some(Side::Received)),
            ("master -> slave: ", Some(Side::Sent)),
            ("from slave: ", Some(Side::Received)),
            (">>> bytearray(b'", Some(Side::Sent)),
            ("\u{6536}\u{5230}\u{6570}\u{636e}\u{FF1A}", Some(Side::Received)),
            ("", None),
        ] {
            assert_eq!(sender(front.as_bytes()), side, "{front}");
        }
    }

    #[test]
    fn a_label_says_who_sent_what_is_below() {
        for (text, side) in [
            ("TX:", Some(Side::Sent)),
            ("**Response**:", Some(Side::Received)),
            ("18:39:11.5 - Station5_RTU ->", Some(Side::Sent)),
            ("18:39:11.7 - Station5_RTU <-", Some(Side::Received)),
            ("Sent 8 bytes", Some(Side::Sent)),
            ("Slave -> Master", Some(Side::Received)),
            ("DEVICE (as I have programmed it) sends back:", Some(Side::Received)),
            ("Master sends to the slave:", Some(Side::Sent)),
            ("Antwort vom Gerät:", Some(Side::Received)),
            ("No response", None),
            ("-- Polling slave 1...", None),
            ("Waiting for response:", None),
            ("the values of the meter", None),
            ("TEST WRITE/READ:", None),
            ("// Request: reads two of the registers of the meter", Some(Side::Sent)),
            ("# Response: both of them are zero, as it should be", Some(Side::Received)),
            ("Response: there is none, and nothing else was seen", Some(Side::Received)),
            ("Response: it did not come in the time that was set", None),
            ("# Note: the request reads two of the registers", None),
            ("Response to the request:", None),
        ] {
            assert_eq!(sender_below(text.as_bytes()), side, "{text}");
        }
    }
}
