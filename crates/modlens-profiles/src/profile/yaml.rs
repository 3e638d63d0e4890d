//! Parses YAML 1.2 and keeps the lines. Scalars are read by the core schema: `0107` is 107, `NO` and `12:30` are texts, as
//! they are not in YAML 1.1.

use std::collections::HashMap;

use saphyr_parser::{Event, Parser, ScalarStyle, ScanError, Span, StrInput, Tag};

use crate::profile::model::Mistake;
use crate::profile::source_tree::{SourceEntry, SourceNode, SourceValue};

/// Levels of nesting; what is deeper is no profile.
const MAX_DEPTH: usize = 100;

/// Aliases (`*name`) may make a file this many times as large as it is written, and it may always have so many values: a
/// few lines of them can stand for more values than fit into any memory.
const MAX_GROWTH: usize = 10;
const FREE_VALUES: usize = 10_000;

/// Parses YAML into a tree; fails at the first thing that is no YAML.
pub fn parse(text: &str) -> Result<SourceNode, Mistake> {
    let text = text.trim_start_matches('\u{feff}');
    let mut reader = Reader { parser: Parser::new_from_str(text), anchors: HashMap::new(), written: 0, copied: 0 };
    reader.document()
}

/// A value that an anchor (`&name`) names.
struct Anchored {
    node: SourceNode,
    values: usize,
    depth: usize,
}

struct Reader<'t> {
    parser: Parser<'t, StrInput<'t>>,
    anchors: HashMap<usize, Anchored>,
    /// Values that are written in the text, and those that aliases stand for.
    written: usize,
    copied: usize,
}

impl<'t> Reader<'t> {
    fn event(&mut self) -> Result<(Event<'t>, Span), Mistake> {
        match self.parser.next_event() {
            Some(found) => found.map_err(|error| syntax(&error)),
            None => Ok((Event::StreamEnd, Span::default())),
        }
    }

    /// The only document of the text; an empty table where there is none.
    fn document(&mut self) -> Result<SourceNode, Mistake> {
        let mut root = None;
        loop {
            match self.event()? {
                (Event::StreamEnd, _) => break,
                (Event::StreamStart | Event::DocumentEnd | Event::DocumentStart(_) | Event::Nothing, _) => {}
                (_, span) if root.is_some() => return Err(wrong(&span, "a second document in one file")),
                (event, span) => root = Some(self.node(event, &span, MAX_DEPTH)?.0),
            }
        }
        let root = root.filter(|root| !matches!(root.value, SourceValue::Other(_)));
        Ok(root.unwrap_or(SourceNode { line: 1, value: SourceValue::Map(Vec::new()) }))
    }

    /// The value that an event begins, with the levels below it; at most `room` of them.
    fn node(&mut self, event: Event<'t>, span: &Span, room: usize) -> Result<(SourceNode, usize), Mistake> {
        let line = line_of(span);
        let room = room.checked_sub(1).ok_or_else(|| wrong(span, "nested too deeply"))?;
        let before = self.written + self.copied;
        self.written += 1;
        let (anchor, value, below) = match event {
            Event::Scalar(text, style, anchor, tag) => (anchor, scalar(&text, style, tag.as_deref()), 0),
            Event::SequenceStart(anchor, _) => {
                let (items, below) = self.items(room)?;
                (anchor, SourceValue::List(items), below)
            }
            Event::MappingStart(anchor, _) => {
                let (entries, below) = self.entries(room)?;
                (anchor, SourceValue::Map(entries), below)
            }
            Event::Alias(anchor) => return self.alias(anchor, span, room),
            _ => return Err(wrong(span, "a value is missing")),
        };
        let (node, depth) = (SourceNode { line, value }, below + 1);
        if anchor > 0 {
            let values = self.written + self.copied - before;
            self.anchors.insert(anchor, Anchored { node: node.clone(), values, depth });
        }
        Ok((node, depth))
    }

    fn items(&mut self, room: usize) -> Result<(Vec<SourceNode>, usize), Mistake> {
        let (mut items, mut below) = (Vec::new(), 0);
        loop {
            let (event, span) = self.event()?;
            if event == Event::SequenceEnd {
                return Ok((items, below));
            }
            let (node, depth) = self.node(event, &span, room)?;
            items.push(node);
            below = below.max(depth);
        }
    }

    fn entries(&mut self, room: usize) -> Result<(Vec<SourceEntry>, usize), Mistake> {
        let (mut entries, mut below) = (Vec::<SourceEntry>::new(), 0);
        loop {
            let (event, span) = self.event()?;
            let key = match event {
                Event::MappingEnd => return Ok((entries, below)),
                Event::Scalar(text, ..) => text.into_owned(),
                _ => return Err(wrong(&span, "a key that is not a text")),
            };
            if entries.iter().any(|entry| entry.key == key) {
                return Err(Mistake::new(line_of(&span), &key, "appears twice".into()));
            }
            let (event, value) = self.event()?;
            let (node, depth) = self.node(event, &value, room)?;
            entries.push(SourceEntry { key, line: line_of(&span), node });
            below = below.max(depth);
        }
    }

    fn alias(&mut self, anchor: usize, span: &Span, room: usize) -> Result<(SourceNode, usize), Mistake> {
        let found = self.anchors.get(&anchor).ok_or_else(|| wrong(span, "an anchor that contains itself"))?;
        if found.depth > room + 1 {
            return Err(wrong(span, "nested too deeply"));
        }
        self.copied += found.values;
        if self.copied > MAX_GROWTH * self.written + FREE_VALUES {
            return Err(wrong(span, "aliases (*name) that stand for too many values"));
        }
        Ok((found.node.clone(), found.depth))
    }
}

fn line_of(span: &Span) -> u32 {
    u32::try_from(span.start.line()).unwrap_or(u32::MAX)
}

fn wrong(span: &Span, what: &str) -> Mistake {
    Mistake::new(line_of(span), "", format!("not YAML for a profile: {what}"))
}

fn syntax(error: &ScanError) -> Mistake {
    let line = u32::try_from(error.marker().line()).unwrap_or(u32::MAX);
    Mistake::new(line, "", format!("not YAML: {}", error.info()))
}

/// A scalar by its tag, or by how it looks where it is written without quotation marks.
fn scalar(text: &str, style: ScalarStyle, tag: Option<&Tag>) -> SourceValue {
    if tag.is_some_and(|tag| tag.suffix == "str" || !tag.is_yaml_core_schema()) || style != ScalarStyle::Plain {
        return SourceValue::Text(text.to_owned());
    }
    match text {
        "" | "~" | "null" | "Null" | "NULL" => SourceValue::Other("nothing"),
        "true" | "True" | "TRUE" => SourceValue::Bool(true),
        "false" | "False" | "FALSE" => SourceValue::Bool(false),
        _ => number(text).unwrap_or_else(|| SourceValue::Text(text.to_owned())),
    }
}

/// A number of the core schema. Digits may have `_` between them, as in TOML.
fn number(text: &str) -> Option<SourceValue> {
    let (sign, digits) = match text.strip_prefix(['-', '+']) {
        Some(rest) => (if text.starts_with('-') { "-" } else { "" }, rest),
        None => ("", text),
    };
    match digits {
        ".inf" | ".Inf" | ".INF" => return Some(SourceValue::Float(format!("{sign}inf"))),
        ".nan" | ".NaN" | ".NAN" if digits == text => return Some(SourceValue::Float("nan".into())),
        _ => {}
    }
    if !digits.trim_start_matches('.').starts_with(|first: char| first.is_ascii_digit()) {
        return None;
    }
    let plain = digits.replace('_', "");
    for (prefix, radix) in [("0x", 16), ("0o", 8), ("0b", 2)] {
        if let Some(rest) = plain.strip_prefix(prefix).filter(|rest| !rest.starts_with(['-', '+'])) {
            return i128::from_str_radix(&format!("{sign}{rest}"), radix).ok().map(SourceValue::Integer);
        }
    }
    if plain.bytes().all(|byte| byte.is_ascii_digit()) {
        let written = format!("{sign}{plain}");
        return Some(written.parse().map_or(SourceValue::Float(written), SourceValue::Integer));
    }
    let whole = format!("{sign}{}{plain}", if plain.starts_with('.') { "0" } else { "" });
    let is_float = plain.bytes().all(|byte| byte.is_ascii_digit() || b".eE+-".contains(&byte));
    (is_float && whole.parse::<f64>().is_ok()).then_some(SourceValue::Float(whole))
}
