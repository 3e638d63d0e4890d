//! A line of a log with places for what varies: `Tx:{n}-{hex}`. The words are explained in analyzer/sources/dialects.toml.
//!
//! A template is found anywhere in a line, so that whatever a logger puts in front (times, hosts, levels, quote marks)
//! does not matter. The fixed text that it begins with is searched first; lines without it cost next to nothing.

use memchr::memchr;
use memchr::memmem::Finder;

use crate::chunk::Side;
use crate::text::front;
use crate::text::notation::{Marks, Notation};
use crate::text::stamp::Stamps;
use modlens_protocol::Ns;

/// The most characters that `{any}` stands for.
const ANY_LIMIT: usize = 400;

/// The longest name of a device.
const KEY_LIMIT: usize = 64;

/// Steps after which a line is given up: templates are short, and bytes must not make them slow.
const STEPS: u32 = 4000;

/// A piece of a template.
#[derive(Clone, Debug)]
enum Element {
    Text(Vec<u8>),
    /// At least so many blanks or tabs.
    Blank(usize),
    Any,
    Digits,
    HexDigits,
    Word,
    Time,
    Milliseconds,
    /// The offset of a line of a dump, in this radix.
    Offset(u32),
    Key(Option<u8>),
    /// An optional time, words, a time: in front of plain bytes.
    Front,
    Bytes(Vec<Notation>, Option<u8>),
    Chunk,
}

/// What a line said, beside its bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Match {
    /// Where it began and ended in the line.
    pub start: usize,
    pub end: usize,
    pub time: Option<Ns>,
    pub side: Option<Side>,
    pub key: Option<(usize, usize)>,
    pub offset: Option<u64>,
    /// Line of a two-line tap.
    pub line: u8,
    pub marks: Marks,
    /// The last word of the line may hold one byte only.
    pub pads: bool,
}

/// A compiled template.
#[derive(Clone, Debug)]
pub(super) struct Template {
    anchor: Option<Finder<'static>>,
    elements: Vec<Element>,
    /// The line has to be read to its end.
    pub whole: bool,
    /// It begins the line.
    first: bool,
    /// It ends the line.
    last: bool,
}

/// What a match writes to, and learns from.
pub(super) struct Scratch<'a> {
    pub stamps: &'a mut Stamps,
    pub out: &'a mut Vec<u8>,
    /// The notation that closed the last checksum where a template has several.
    pub preferred: &'a mut Option<Notation>,
    steps: u32,
}

impl<'a> Scratch<'a> {
    pub fn new(stamps: &'a mut Stamps, out: &'a mut Vec<u8>, preferred: &'a mut Option<Notation>) -> Self {
        Self { stamps, out, preferred, steps: 0 }
    }
}

impl Template {
    /// Compiles the text; the message says which word is not known.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (anchored, body) = text.strip_prefix('^').map_or((false, text), |rest| (true, rest));
        let (last, body) = body.strip_suffix('$').map_or((false, body), |rest| (true, rest));
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
                    elements.push(element(word).ok_or_else(|| format!("{text:?}: unknown {{{word}}}; known are {}", known()))?);
                    behind
                }
                None => literal(rest, &mut elements),
            };
        }
        if elements.is_empty() {
            return Err(String::from("an empty template"));
        }
        finish(&mut elements);
        let whole = matches!(elements.first(), Some(Element::Front));
        let anchor = match elements.first() {
            Some(Element::Text(text)) if !anchored => Some(Finder::new(text).into_owned()),
            Some(Element::Bytes(notations, _)) if !anchored => notations[0].opening().map(|b| Finder::new(&[b]).into_owned()),
            _ => None,
        };
        if anchor.is_none() && !anchored && !matches!(elements.first(), Some(Element::Front | Element::Chunk)) {
            return Err(format!("{text:?}: begins with no fixed text; put ^ in front if it begins the line"));
        }
        Ok(Self { anchor, elements, whole, first: anchored, last })
    }

    /// How many characters of fixed text it has.
    pub fn fixed(&self) -> usize {
        self.elements.iter().map(|element| if let Element::Text(text) = element { text.len() } else { 0 }).sum()
    }

    /// The characters that a match begins with, where it may begin anywhere.
    pub fn begins(&self) -> &[u8] {
        self.anchor.as_ref().map_or(&[], |anchor| anchor.needle())
    }

    /// Whether `text` can hold a match.
    pub fn possible(&self, text: &[u8]) -> bool {
        self.anchor.as_ref().is_none_or(|anchor| anchor.find(text).is_some())
    }

    /// Whether it takes bytes from the line.
    pub fn takes_bytes(&self) -> bool {
        self.elements.iter().any(|element| matches!(element, Element::Bytes(..) | Element::Chunk))
    }

    /// Whether the fixed text that it begins with stands here, and not inside of a word.
    pub fn may_begin(&self, line: &[u8], start: usize) -> bool {
        let begins = |anchor: &Finder<'static>| line[start..].starts_with(anchor.needle());
        self.anchor.as_ref().is_some_and(begins) && !inside_word(line, start)
    }

    /// The first match from `from` on; its bytes go to the scratch.
    pub fn find(&self, line: &[u8], from: usize, scratch: &mut Scratch<'_>) -> Option<Match> {
        if self.first && from > 0 {
            return None;
        }
        let Some(anchor) = &self.anchor else {
            let start = from + line[from..].iter().take_while(|b| matches!(b, b' ' | b'\t')).count();
            return self.at(line, start, scratch);
        };
        let mut at = from;
        while let Some(hit) = anchor.find(&line[at..]) {
            let start = at + hit;
            if !inside_word(line, start) {
                if let Some(found) = self.at(line, start, scratch) {
                    return Some(found);
                }
            }
            at = start + 1;
        }
        None
    }

    /// The match that begins here; its bytes go to the scratch.
    pub fn at(&self, line: &[u8], start: usize, scratch: &mut Scratch<'_>) -> Option<Match> {
        scratch.out.clear();
        let mut found = Match { start, ..Match::default() };
        found.end = walk(&self.elements, line, start, &mut found, scratch)?;
        (!self.last || line[found.end..].trim_ascii().is_empty()).then_some(found)
    }
}

/// Whether a word goes on here: nothing begins inside of one.
fn inside_word(line: &[u8], start: usize) -> bool {
    start > 0 && line[start].is_ascii_alphanumeric() && line[start - 1].is_ascii_alphanumeric()
}

fn known() -> String {
    let plain = ["any", "n", "x", "word", "time", "ms", "offset", "octal offset", "key", "front", "chunk"].iter().copied();
    plain.chain(Notation::WORDS.iter().map(|(word, _)| *word)).collect::<Vec<_>>().join(" ")
}

fn element(word: &str) -> Option<Element> {
    Some(match word {
        "any" => Element::Any,
        "n" => Element::Digits,
        "x" => Element::HexDigits,
        "word" => Element::Word,
        "time" => Element::Time,
        "ms" => Element::Milliseconds,
        "offset" => Element::Offset(16),
        "octal offset" => Element::Offset(8),
        "key" => Element::Key(None),
        "front" => Element::Front,
        "chunk" => Element::Chunk,
        notations => {
            let list: Option<Vec<Notation>> = notations
                .split('|')
                .map(|name| Notation::WORDS.iter().find(|(word, _)| *word == name).map(|(_, notation)| *notation))
                .collect();
            Element::Bytes(list?, None)
        }
    })
}

/// Fixed text up to the next brace; runs of blanks stand for any number of them.
fn literal<'a>(text: &'a str, elements: &mut Vec<Element>) -> &'a str {
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

/// Blanks around bytes may be missing; a string of escapes ends where the text behind it begins.
fn finish(elements: &mut [Element]) {
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

fn walk(elements: &[Element], line: &[u8], start: usize, found: &mut Match, scratch: &mut Scratch<'_>) -> Option<usize> {
    let mut at = start;
    for (i, element) in elements.iter().enumerate() {
        scratch.steps += 1;
        if scratch.steps > STEPS {
            return None;
        }
        let rest = line.get(at..)?;
        at += match element {
            Element::Text(text) => rest.starts_with(text).then_some(text.len())?,
            Element::Blank(least) => Some(count(rest, |b| matches!(b, b' ' | b'\t'))).filter(|blanks| blanks >= least)?,
            Element::Any => return any(&elements[i + 1..], line, at, found, scratch),
            Element::Digits => some(rest, |b| b.is_ascii_digit())?,
            Element::HexDigits => some(rest, |b| b.is_ascii_hexdigit())?,
            Element::Word => some(rest, |b| !b.is_ascii_whitespace() && b != b',')?,
            Element::Key(stop) => {
                let length =
                    some(&rest[..rest.len().min(KEY_LIMIT)], |b| stop.map_or(!b.is_ascii_whitespace(), |stop| b != stop))?;
                found.key = Some((at, at + length));
                length
            }
            Element::Time => {
                let (time, behind) =
                    if rest.first() == Some(&b'-') { scratch.stamps.before_start(rest) } else { scratch.stamps.take(rest) };
                found.time = Some(time?);
                rest.len() - behind.len()
            }
            Element::Milliseconds => {
                let length = some(rest, |b| b.is_ascii_digit())?;
                found.time = Some(scratch.stamps.milliseconds(&rest[..length])?);
                length
            }
            Element::Offset(radix) => offset(rest, *radix, found)?,
            Element::Front => {
                let (time, side, behind) = front::take(rest, scratch.stamps);
                (found.time, found.side) = (time, side);
                rest.len() - behind.len()
            }
            Element::Bytes(notations, stop) => bytes(notations, *stop, rest, found, scratch)?,
            Element::Chunk => {
                let read = super::chunks::parse(rest, scratch.stamps, scratch.out)?;
                (found.time, found.line) = (read.0, read.1);
                rest.len()
            }
        };
    }
    Some(at)
}

fn any(behind: &[Element], line: &[u8], from: usize, found: &mut Match, scratch: &mut Scratch<'_>) -> Option<usize> {
    let Some(next) = behind.first() else { return Some(line.len()) };
    let before = (*found, scratch.out.len());
    let limit = line.len().min(from + ANY_LIMIT);
    let first = if let Element::Text(text) = next { text.first() } else { None };
    let mut at = from;
    while at <= limit {
        if let Some(&first) = first {
            match memchr(first, &line[at..line.len().min(limit + 1)]) {
                Some(hit) => at += hit,
                None => break,
            }
        }
        if let Some(end) = walk(behind, line, at, found, scratch) {
            return Some(end);
        }
        if scratch.steps > STEPS {
            return None;
        }
        *found = before.0;
        scratch.out.truncate(before.1);
        at += 1;
    }
    None
}

fn bytes(notations: &[Notation], stop: Option<u8>, text: &[u8], found: &mut Match, scratch: &mut Scratch<'_>) -> Option<usize> {
    let start = scratch.out.len();
    if let [only] = notations {
        found.pads = only.pads();
        return only.read(text, stop, scratch.out, &mut found.marks);
    }
    let preferred = scratch.preferred.filter(|one| notations.contains(one));
    let mut first = None;
    for &notation in preferred.iter().chain(notations) {
        scratch.out.truncate(start);
        let mut marks = Marks::default();
        let Some(length) = notation.read(text, stop, scratch.out, &mut marks) else { continue };
        if crate::text::evidence::closes(&scratch.out[start..]) {
            *scratch.preferred = Some(notation);
            found.marks = marks;
            return Some(length);
        }
        first = first.or(Some(notation));
    }
    scratch.out.truncate(start);
    first?.read(text, stop, scratch.out, &mut found.marks)
}

fn offset(text: &[u8], radix: u32, found: &mut Match) -> Option<usize> {
    let length = count(text, |b| (b as char).is_digit(radix));
    let digits = std::str::from_utf8(&text[..length]).ok().filter(|digits| (4..=16).contains(&digits.len()))?;
    found.offset = Some(u64::from_str_radix(digits, radix).ok()?);
    Some(length)
}

fn count(text: &[u8], takes: impl Fn(u8) -> bool) -> usize {
    text.iter().take_while(|b| takes(**b)).count()
}

fn some(text: &[u8], takes: impl Fn(u8) -> bool) -> Option<usize> {
    Some(count(text, takes)).filter(|&length| length > 0)
}
