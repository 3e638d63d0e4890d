//! The words by which a person says that bytes should have come, or that they did.

use crate::chunk::Side;
use crate::text::direction_words::{meaning, words, Rank};
use crate::text::proved::{hex_bytes, hex_front};

/// After so many lines a text is a log.
pub(super) const LAST_LINE: u64 = 500;

/// Prose in one line is not longer.
const MAX_CHARS: usize = 400;

/// What announces bytes that should have come, or that a manual has as an example; in some languages of those who ask.
const SHOULD: &[&str] = &[
    "should be",
    "should have been",
    "should look",
    "should return",
    "should answer",
    "should respond",
    "should send",
    "should receive",
    "should get",
    "supposed to be",
    "supposed to look",
    "i expect",
    "would expect",
    "was expecting",
    "were expecting",
    "answer would be",
    "reply would be",
    "response would be",
    "frame would be",
    "one would be",
    "correct response",
    "correct answer",
    "correct frame",
    "correct one",
    "correct reply",
    "expected answer",
    "expected reply",
    "expected response",
    "ideal answer",
    "ideal reply",
    "ideal response",
    "example answer",
    "example response",
    "example reply",
    "from the datasheet",
    "from the data sheet",
    "from the manual",
    "from the documentation",
    "in the manual",
    "sollte ",
    "sollten ",
    "m\u{fc}sste",
    "muesste",
    "erwartet",
    "richtig w\u{e4}re",
    "devrait",
    "devraient",
    "attendu",
    "deber\u{ed}a",
    "esperad",
    "esperaba",
    "deveria",
    "dovrebbe",
    "zou moeten",
    "verwacht",
    "powinn",
    "\u{434}\u{43e}\u{43b}\u{436}\u{43d}",
    "\u{43e}\u{436}\u{438}\u{434}\u{430}",
    "\u{5e94}\u{8be5}",
    "\u{5e94}\u{4e3a}",
    "\u{6b63}\u{786e}\u{7684}",
];

/// What announces bytes that did come, beside the words for what was received.
const DID: &[&str] = &[
    "but",
    "i get",
    "we get",
    "actual",
    "wrong",
    "sends",
    "however",
    "instead i",
    "i see",
    "here is",
    "here's",
    "here are",
    " log",
    "kommt",
    "\u{5b9e}\u{9645}",
];

/// Lines that are nothing but such a word.
const SHOULD_ALONE: &[&str] = &["true", "right", "correct", "expected", "good", "should be", "expectation", "ideal", "soll"];

/// Such a word right in front of bytes, perhaps as the name of an array.
const SHOULD_LAST: &[&str] = &["expected", "expect", "expectation", "ideal", "soll"];

/// Such a word for bytes that did come.
const CAME_LAST: &[&str] = &["actual", "got", "received", "wrong", "real"];

/// Whether the words of a text announce bytes that should have come (`Some(true)`), or that did; `None` without any.
pub(super) fn announces(text: &[u8]) -> Option<bool> {
    if text.len() > MAX_CHARS {
        return None;
    }
    let text = String::from_utf8_lossy(text).to_lowercase();
    let alone = text.trim_matches(|c: char| !c.is_alphabetic());
    if SHOULD_ALONE.contains(&alone) {
        return Some(true);
    }
    let last = |words: &[&str]| words.iter().filter_map(|word| text.rfind(word)).max();
    let is_received = |word: &str| meaning(word) == Some((Side::Received, Rank::Verb));
    let received = words(&text).into_iter().filter(|(_, word)| is_received(word)).map(|(at, _)| at).max();
    match (last(SHOULD), last(DID).max(received)) {
        (None, None) => None,
        (should, did) => Some(should > did),
    }
}

/// Whether a text has bytes of which its words say that they did come, perhaps as the name of a variable. What a test of a
/// program expects is else the only print of a frame.
fn tells_what_came(line: &[u8]) -> bool {
    line.len() <= MAX_CHARS
        && hex_front(line).is_some_and(|front| {
            let text = String::from_utf8_lossy(front).to_lowercase();
            hex_bytes(line) > 0 && !names_expected(&text) && (announces(front) == Some(false) || names(&text, CAME_LAST))
        })
}

/// Whether the last word of this text in lower case is one of these.
fn names(text: &str, known: &[&str]) -> bool {
    let mut words = text.split(|c: char| !c.is_alphanumeric()).filter(|word| word.chars().any(char::is_alphabetic));
    words.next_back().is_some_and(|word| known.contains(&word))
}

fn names_expected(text: &str) -> bool {
    names(text, SHOULD_LAST)
}

/// Whether this text right in front of bytes is that of a variable in a program, which has what they should be.
fn is_variable(front: &[u8]) -> bool {
    let text = String::from_utf8_lossy(front).to_lowercase();
    text.contains('=') && names_expected(&text)
}

/// Whether this text right in front of bytes, or right after the last ones, says that they should have come.
fn are_expected(front: &[u8], behind: Option<&[u8]>) -> bool {
    let front_text = String::from_utf8_lossy(front).to_lowercase();
    let says_instead = || front_text.trim_end().ends_with("instead of");
    announces(front) == Some(true)
        || says_instead()
        || names_expected(&front_text)
        || behind.is_some_and(|text| announces(text) == Some(true))
}

/// What the lines so far announce.
#[derive(Debug, Default)]
pub(super) struct Expectation {
    /// The last line of prose says that the bytes below should have come, not that they did.
    pub of_what_follows: bool,
    /// A line of the text has bytes of which its words say that they came.
    tells_what_came: bool,
}

impl Expectation {
    /// Learns from the beginning of a text whether a line of it has bytes that came.
    pub fn look_ahead(&mut self, sample: &[u8]) {
        self.tells_what_came = sample.split(|&b| b == b'\n').take(LAST_LINE as usize).any(tells_what_came);
    }

    /// Notes what line `number`, without bytes, announces.
    pub fn note(&mut self, number: u64, text: &[u8]) {
        if number <= LAST_LINE && !text.first().is_some_and(|byte| byte.is_ascii_digit() || *byte == b'[') {
            self.of_what_follows = announces(text) == Some(true);
        }
    }

    /// Whether prose announces the bytes of the lines after this one, so that they are left out.
    pub fn leaves_out(&self, number: u64) -> bool {
        self.of_what_follows && number < LAST_LINE
    }

    /// Whether the text in front of bytes, or right after the last ones, says that they should have come. The variable for what
    /// a test expects is else the only print of a frame.
    pub fn says(&self, front: &[u8], behind: Option<&[u8]>) -> bool {
        let is_only_print = !self.tells_what_came && is_variable(front);
        self.of_what_follows || (are_expected(front, behind) && !is_only_print)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_words_decide() {
        assert_eq!(announces(b"The Rx should be this, I think"), Some(true));
        assert_eq!(announces(b"it should be 9, but the device sends"), Some(false));
        assert_eq!(announces(b"**True**:"), Some(true));
        assert_eq!(announces(b"Incomplete message received, Expected 6 bytes"), Some(false));
        assert_eq!(announces(b"Tx: "), None);
        for text in [
            "Die Antwort sollte so aussehen:",
            "La r\u{e9}ponse attendue est:",
            "La respuesta esperada:",
            "\u{6b63}\u{786e}\u{7684}\u{5e94}\u{8be5}\u{662f}: ",
            "\u{414}\u{43e}\u{43b}\u{436}\u{43d}\u{43e} \u{431}\u{44b}\u{442}\u{44c}: ",
            "From the datasheet, an example:",
            "The ideal answer would be ",
        ] {
            assert_eq!(announces(text.as_bytes()), Some(true), "{text}");
        }
        assert_eq!(announces(b"The settings should be right. Here is the log:"), Some(false));
        assert!(are_expected(b"uint8_t expected[] = {", None) && are_expected(b"Expected: ", None));
        assert!(!are_expected(b"Will write (expecting 7 bytes back): ", None));
        assert!(are_expected(b"and not 01 instead of ", None) && !are_expected(b"Rx ", Some(b"instead of that")));
    }
}
