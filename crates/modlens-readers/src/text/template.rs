//! Patterns for log lines with placeholders for what varies, such as `Tx:{n}-{hex}`. The placeholders are explained in
//! analyzer/sources/dialects.toml.
//!
//! A template may match anywhere in a line, so that whatever a logger puts in front (times, hosts, levels, quote marks)
//! does not matter. The fixed text at its beginning is searched first, so lines without it cost next to nothing.

use memchr::memchr;
use memchr::memmem::Finder;

use crate::chunk::Side;
use crate::text::notation::{Notation, NotationFlags};
use crate::text::prefix;
use crate::text::timestamps::TimestampParser;
use modlens_protocol::Ns;

/// The most characters that `{any}` may stand for.
const MAX_ANY_CHARS: usize = 400;

/// The most characters of a word, a number or a gap. After `{any}` they are counted again from each place.
const MAX_RUN_CHARS: usize = 1024;

/// The most characters of a device's name (`{key}`).
const MAX_KEY_CHARS: usize = 64;

/// A match is given up after so many elements were tried, because several `{any}` in one template could otherwise try a
/// long line in a quadratic number of ways.
const MAX_STEPS: u32 = 4000;

/// One element of a template: fixed text or a placeholder.
#[derive(Clone, Debug)]
enum Element {
    Text(Vec<u8>),
    /// Spaces and tabs, at least so many of them.
    Blank(usize),
    Any,
    Digits,
    HexDigits,
    Word,
    Time,
    /// A number of such parts of a second, in ns and in decimals.
    Count(Ns, u32),
    /// The offset at the start of a dump line, in this radix.
    Offset(u32),
    /// The name of a device, up to this character or else to the next space.
    Key(Option<u8>),
    /// An optional timestamp and an optional word that says who sent the bytes, in either order.
    Prefix,
    /// Bytes in one of these notations; strings end at this character.
    Bytes(Vec<Notation>, Option<u8>),
    /// A whole line of a chunk log, modlens' own or somebody else's.
    ChunkLog,
    /// Bytes anywhere in the line that a checksum proves; `reader::proved_lines` reads them.
    Proved,
}

/// What a template found in a line, except for the bytes, which go to `MatchContext::out`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LineMatch {
    /// Position of the match in the line.
    pub start: usize,
    pub end: usize,
    /// Where its first bytes begin, and where its last ones end; 0 without bytes.
    pub bytes_start: usize,
    pub bytes_end: usize,
    pub time: Option<Ns>,
    pub side: Option<Side>,
    /// Position of the device's name in the line; once the name is known, its number takes the place of the first.
    pub key: Option<(usize, usize)>,
    pub offset: Option<u64>,
    /// Which line of a two-line tap: 0 for the only one, 1 for A, 2 for B.
    pub line: u8,
    pub flags: NotationFlags,
    /// The bytes are 16-bit words, of which the last may hold only one byte.
    pub may_end_with_half_word: bool,
}

/// A compiled template.
#[derive(Clone, Debug)]
pub(super) struct Template {
    /// Searches for the fixed text that a match begins with; `None` if a match begins at the start of the text.
    anchor: Option<Finder<'static>>,
    elements: Vec<Element>,
    /// Nothing but punctuation may follow the match.
    pub must_reach_line_end: bool,
    /// A match has to begin at the start of the line (`^`).
    is_at_line_start: bool,
    /// A match has to end at the end of the line (`$`).
    is_at_line_end: bool,
}

/// What a match writes its results to, and what it learns from the line.
pub(super) struct MatchContext<'a> {
    pub timestamps: &'a mut TimestampParser,
    pub out: &'a mut Vec<u8>,
    /// Of a template with several notations, the one that gave the last valid checksum; it is tried first.
    pub preferred: &'a mut Option<Notation>,
    /// Elements tried so far for this match.
    steps: u32,
}

impl<'a> MatchContext<'a> {
    pub fn new(timestamps: &'a mut TimestampParser, out: &'a mut Vec<u8>, preferred: &'a mut Option<Notation>) -> Self {
        Self { timestamps, out, preferred, steps: 0 }
    }
}

impl Template {
    /// Compiles a template; the error message names an unknown placeholder.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (is_at_line_start, body) = text.strip_prefix('^').map_or((false, text), |rest| (true, rest));
        let (is_at_line_end, body) = body.strip_suffix('$').map_or((false, body), |rest| (true, rest));
        let mut elements = Vec::new();
        let mut rest = body;
        while !rest.is_empty() {
            rest = match rest.strip_prefix('{') {
                Some(inner) if inner.starts_with('{') => {
                    elements.push(Element::Text(b"{".to_vec()));
                    &inner[1..]
                }
                Some(inner) => {
                    let (word, behind) = inner.split_once('}').ok_or_else(|| format!("{text:?}: a {{ without }}"))?;
                    elements.push(
                        parse_element(word)
                            .ok_or_else(|| format!("{text:?}: unknown {{{word}}}; known are {}", placeholders()))?,
                    );
                    behind
                }
                None => parse_fixed_text(rest, &mut elements),
            };
        }
        if elements.is_empty() {
            return Err(String::from("an empty template"));
        }
        link_elements(&mut elements);
        let must_reach_line_end = matches!(elements.first(), Some(Element::Prefix));
        let anchor = match elements.first() {
            Some(Element::Text(text)) if !is_at_line_start => Some(Finder::new(text).into_owned()),
            Some(Element::Bytes(notations, _)) if !is_at_line_start => {
                notations[0].opening().map(|b| Finder::new(&[b]).into_owned())
            }
            _ => None,
        };
        if anchor.is_none() && !is_at_line_start && !matches!(elements.first(), Some(Element::Prefix | Element::ChunkLog)) {
            return Err(format!("{text:?}: does not begin with fixed text; put ^ in front if it begins the line"));
        }
        Ok(Self { anchor, elements, must_reach_line_end, is_at_line_start, is_at_line_end })
    }

    /// The number of characters of fixed text, a measure of how specific the template is.
    pub fn fixed_chars(&self) -> usize {
        self.elements.iter().map(|element| if let Element::Text(text) = element { text.len() } else { 0 }).sum()
    }

    /// The fixed text that a match begins with; empty for a template that is tried at the start of the text only.
    pub fn anchor_text(&self) -> &[u8] {
        self.anchor.as_ref().map_or(&[], |anchor| anchor.needle())
    }

    /// Whether `text` contains the fixed text that a match begins with, so that a match is possible.
    pub fn may_match(&self, text: &[u8]) -> bool {
        self.anchor.as_ref().is_none_or(|anchor| anchor.find(text).is_some())
    }

    /// Whether a match yields bytes.
    pub fn takes_bytes(&self) -> bool {
        self.elements.iter().any(|element| matches!(element, Element::Bytes(..) | Element::ChunkLog | Element::Proved))
    }

    /// Whether it stands for bytes that a checksum proves, wherever they are.
    pub fn is_proved(&self) -> bool {
        matches!(self.elements[..], [Element::Proved])
    }

    /// Whether its bytes may be in this notation.
    pub fn reads(&self, notation: Notation) -> bool {
        self.elements.iter().any(|element| matches!(element, Element::Bytes(notations, _) if notations.contains(&notation)))
    }

    /// Whether it is an optional time and sender, and hex after them.
    pub fn is_plain_hex(&self) -> bool {
        let has_edges = self.is_at_line_start || self.is_at_line_end;
        let elements = &self.elements[..];
        !has_edges && matches!(elements, [Element::Prefix, Element::Bytes(one, None)] if one[..] == [Notation::Hex])
    }

    /// Whether a match may begin at `start`: its fixed text is there, and not inside a word.
    pub fn may_begin(&self, line: &[u8], start: usize) -> bool {
        let stands_here = |anchor: &Finder<'static>| line[start..].starts_with(anchor.needle());
        self.anchor.as_ref().is_some_and(stands_here) && !inside_word(line, start)
    }

    /// The first match that begins at or after `from`; its bytes go to `scratch.out`.
    pub fn find(&self, line: &[u8], from: usize, scratch: &mut MatchContext<'_>) -> Option<LineMatch> {
        if self.is_at_line_start && from > 0 {
            return None;
        }
        let Some(anchor) = &self.anchor else {
            let start = from + line[from..].iter().take_while(|b| matches!(b, b' ' | b'\t')).count();
            return self.match_at(line, start, scratch);
        };
        let mut at = from;
        while let Some(hit) = anchor.find(&line[at..]) {
            let start = at + hit;
            if !inside_word(line, start) {
                if let Some(found) = self.match_at(line, start, scratch) {
                    return Some(found);
                }
            }
            at = start + 1;
        }
        None
    }

    /// The match that begins at `start`, if there is one; its bytes go to `scratch.out`.
    pub fn match_at(&self, line: &[u8], start: usize, scratch: &mut MatchContext<'_>) -> Option<LineMatch> {
        scratch.out.clear();
        let mut found = LineMatch { start, ..LineMatch::default() };
        found.end = match_elements(&self.elements, line, start, &mut found, scratch)?;
        (!self.is_at_line_end || line[found.end..].trim_ascii().is_empty()).then_some(found)
    }
}

/// Whether `start` is inside a word, where no match may begin.
fn inside_word(line: &[u8], start: usize) -> bool {
    start > 0 && line[start].is_ascii_alphanumeric() && line[start - 1].is_ascii_alphanumeric()
}

/// All placeholders, for the error message about an unknown one.
fn placeholders() -> String {
    let plain = ["any", "n", "x", "word", "time", "ms", "us", "offset", "octal offset", "key", "front", "chunk", "proved"];
    plain.into_iter().chain(Notation::PLACEHOLDERS.iter().map(|(word, _)| *word)).collect::<Vec<_>>().join(" ")
}

/// The element for the text between two braces; `None` for an unknown placeholder.
fn parse_element(word: &str) -> Option<Element> {
    Some(match word {
        "any" => Element::Any,
        "n" => Element::Digits,
        "x" => Element::HexDigits,
        "word" => Element::Word,
        "time" => Element::Time,
        "ms" => Element::Count(1_000_000, 3),
        "us" => Element::Count(1000, 6),
        "offset" => Element::Offset(16),
        "octal offset" => Element::Offset(8),
        "key" => Element::Key(None),
        "front" => Element::Prefix,
        "chunk" => Element::ChunkLog,
        "proved" => Element::Proved,
        notations => {
            let list: Option<Vec<Notation>> = notations
                .split('|')
                .map(|name| Notation::PLACEHOLDERS.iter().find(|(word, _)| *word == name).map(|(_, notation)| *notation))
                .collect();
            Element::Bytes(list?, None)
        }
    })
}

/// Parses fixed text up to the next brace into elements and returns the rest. A run of spaces matches any number of them.
fn parse_fixed_text<'a>(text: &'a str, elements: &mut Vec<Element>) -> &'a str {
    let end = text.find('{').unwrap_or(text.len());
    let mut rest = &text[..end];
    while !rest.is_empty() {
        let blanks = rest.len() - rest.trim_start_matches([' ', '\t']).len();
        if blanks > 0 {
            elements.push(Element::Blank(1));
            rest = &rest[blanks..];
        }
        let length = rest.find([' ', '\t']).unwrap_or(rest.len());
        if length > 0 {
            elements.push(Element::Text(rest.as_bytes()[..length].to_vec()));
        }
        rest = &rest[length..];
    }
    &text[end..]
}

/// Completes each element with what its successor demands: spaces in front of bytes or at the end may be missing, and an
/// escaped string or a device's name ends where the fixed text after it begins.
fn link_elements(elements: &mut [Element]) {
    for i in 0..elements.len() {
        let bytes_behind = matches!(elements.get(i + 1), Some(Element::Bytes(..)) | None);
        let stop = match elements.get(i + 1) {
            Some(Element::Text(text)) => text.first().copied(),
            _ => None,
        };
        match &mut elements[i] {
            Element::Blank(least) if bytes_behind => *least = 0,
            Element::Bytes(_, end) | Element::Key(end) => *end = stop,
            _ => {}
        }
    }
}

/// Matches the elements one after the other from `start` on. Returns the end of the match; what it finds goes to `found`
/// and `scratch`.
fn match_elements(
    elements: &[Element],
    line: &[u8],
    start: usize,
    found: &mut LineMatch,
    scratch: &mut MatchContext<'_>,
) -> Option<usize> {
    let mut at = start;
    for (i, element) in elements.iter().enumerate() {
        scratch.steps += 1;
        if scratch.steps > MAX_STEPS {
            return None;
        }
        let rest = line.get(at..)?;
        at += match element {
            Element::Text(text) => rest.starts_with(text).then_some(text.len())?,
            Element::Blank(least) => Some(count_prefix(rest, |b| matches!(b, b' ' | b'\t'))).filter(|blanks| blanks >= least)?,
            Element::Any => return match_any(&elements[i + 1..], line, at, found, scratch),
            Element::Digits => count_some(rest, |b| b.is_ascii_digit())?,
            Element::HexDigits => count_some(rest, |b| b.is_ascii_hexdigit())?,
            Element::Word => count_some(rest, |b| !b.is_ascii_whitespace() && b != b',')?,
            Element::Key(stop) => {
                let most = &rest[..rest.len().min(MAX_KEY_CHARS)];
                let length = match stop {
                    Some(stop) => Some(memchr(*stop, most).unwrap_or(most.len())).filter(|&length| length > 0)?,
                    None => count_some(most, |b| !b.is_ascii_whitespace())?,
                };
                found.key = Some((at, at + length));
                length
            }
            Element::Time => {
                let (time, behind) = if rest.first() == Some(&b'-') {
                    scratch.timestamps.before_start(rest)
                } else {
                    scratch.timestamps.take_leading(rest)
                };
                found.time = Some(time?);
                rest.len() - behind.len()
            }
            Element::Count(unit, decimals) => {
                let length = count_some(rest, |b| b.is_ascii_digit())?;
                found.time = Some(scratch.timestamps.count(&rest[..length], *unit, *decimals)?);
                length
            }
            Element::Offset(radix) => parse_offset(rest, *radix, found)?,
            Element::Prefix => {
                let (time, side, behind) = prefix::parse_prefix(rest, scratch.timestamps);
                (found.time, found.side) = (time, side);
                rest.len() - behind.len()
            }
            Element::Bytes(notations, stop) => {
                let length = match_bytes(notations, *stop, rest, found, scratch)?;
                if found.bytes_end == 0 {
                    found.bytes_start = at;
                }
                found.bytes_end = at + length;
                length
            }
            Element::Proved => return None,
            Element::ChunkLog => {
                let read = super::chunk_log::parse(rest, scratch.timestamps, scratch.out)?;
                (found.time, found.line) = (read.0, read.1);
                rest.len()
            }
        };
    }
    Some(at)
}

/// Matches `{any}`: tries the elements behind it at each place from `from` on, nearest first.
fn match_any(
    behind: &[Element],
    line: &[u8],
    from: usize,
    found: &mut LineMatch,
    scratch: &mut MatchContext<'_>,
) -> Option<usize> {
    let Some(next) = behind.first() else { return Some(line.len()) };
    let before = (*found, scratch.out.len());
    let limit = line.len().min(from + MAX_ANY_CHARS);
    let first = if let Element::Text(text) = next { text.first() } else { None };
    let mut at = from;
    while at <= limit {
        if let Some(&first) = first {
            match memchr(first, &line[at..line.len().min(limit + 1)]) {
                Some(hit) => at += hit,
                None => break,
            }
        }
        if let Some(end) = match_elements(behind, line, at, found, scratch) {
            return Some(end);
        }
        if scratch.steps > MAX_STEPS {
            return None;
        }
        *found = before.0;
        scratch.out.truncate(before.1);
        at += 1;
    }
    None
}

/// Reads bytes in the notation of the template. Of several notations the first counts whose bytes are a whole frame, or
/// else the first that reads anything. Returns the length of the text.
fn match_bytes(
    notations: &[Notation],
    stop: Option<u8>,
    text: &[u8],
    found: &mut LineMatch,
    scratch: &mut MatchContext<'_>,
) -> Option<usize> {
    let start = scratch.out.len();
    if let [only] = notations {
        found.may_end_with_half_word = only.has_words();
        return only.read(text, stop, scratch.out, &mut found.flags);
    }
    let preferred = scratch.preferred.filter(|one| notations.contains(one));
    let mut first = None;
    for &notation in preferred.iter().chain(notations) {
        scratch.out.truncate(start);
        let mut flags = NotationFlags::default();
        let Some(length) = notation.read(text, stop, scratch.out, &mut flags) else { continue };
        if crate::text::frame_evidence::is_whole_frame(&scratch.out[start..]) {
            *scratch.preferred = Some(notation);
            found.flags = flags;
            return Some(length);
        }
        first = first.or(Some(notation));
    }
    scratch.out.truncate(start);
    first?.read(text, stop, scratch.out, &mut found.flags)
}

/// Parses the 4 to 16 digits of a dump's offset; returns the length of the text.
fn parse_offset(text: &[u8], radix: u32, found: &mut LineMatch) -> Option<usize> {
    let length = count_prefix(text, |b| (b as char).is_digit(radix));
    let digits = std::str::from_utf8(&text[..length]).ok().filter(|digits| (4..=16).contains(&digits.len()))?;
    found.offset = Some(u64::from_str_radix(digits, radix).ok()?);
    Some(length)
}

/// The number of leading characters that `takes` accepts, at most `MAX_RUN_CHARS`.
fn count_prefix(text: &[u8], takes: impl Fn(u8) -> bool) -> usize {
    text.iter().take(MAX_RUN_CHARS).take_while(|b| takes(**b)).count()
}

/// The number of leading characters that `takes` accepts; `None` if there is none.
fn count_some(text: &[u8], takes: impl Fn(u8) -> bool) -> Option<usize> {
    Some(count_prefix(text, takes)).filter(|&length| length > 0)
}
