//! The table of dialects: `analyzer/sources/dialects.toml` compiled to templates. Users add rows in the same words.
//!
//! What is not here: any knowledge of a single program's log. It stands in the table.

use std::sync::{Arc, OnceLock};

use serde_json::Value as Json;

use crate::chunk::Side;
use crate::text::starts::Starts;
use crate::text::template::Template;
use crate::text::Reader;
use modlens_protocol::functions::parse_toml;

/// The embedded table.
pub const TABLE: &str = include_str!("../../../../analyzer/sources/dialects.toml");

/// Byte strings, and who sent them.
pub type Strings = Vec<(Option<Side>, Vec<u8>)>;

/// What a line that fits a template is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Bytes that the side sent; `None` where the log does not say who.
    Bytes(Option<Side>),
    /// Announces the bytes of the lines behind it.
    Head(Option<Side>),
    /// Announces bytes that were printed before.
    HeadOfCopies,
    /// Bytes that a head announced.
    More,
    /// Bytes that are new only if they were not just delivered.
    Again,
    /// Bytes that were printed before.
    Copy,
    /// Stands for lines like the one before, as many as the next offset says.
    Repeat,
    /// Belongs to the format, and says nothing.
    Skip,
}

impl Role {
    /// Whether lines of this role are bytes of frames.
    pub fn holds_bytes(self) -> bool {
        matches!(self, Self::Bytes(_) | Self::More | Self::Again)
    }
}

/// What stands around the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wrap {
    /// Solarman V5 data loggers.
    Solarman,
    /// Ethernet, IP and TCP headers.
    Network,
}

/// The keys of a row that hold templates. In this order they are tried.
const ROLES: &[(&str, Role)] = &[
    ("skip", Role::Skip),
    ("repeat", Role::Repeat),
    ("copy", Role::Copy),
    ("head_copy", Role::HeadOfCopies),
    ("head_sent", Role::Head(Some(Side::Sent))),
    ("head_received", Role::Head(Some(Side::Received))),
    ("head", Role::Head(None)),
    ("sent", Role::Bytes(Some(Side::Sent))),
    ("received", Role::Bytes(Some(Side::Received))),
    ("again", Role::Again),
    ("more", Role::More),
    ("either", Role::Bytes(None)),
];

const OTHER_KEYS: &[&str] = &[
    "name",
    "title",
    "clock",
    "sample",
    "bytes",
    "note",
    "generic",
    "stream",
    "checksum",
    "wrap",
    "short_fractions",
    "joined",
    "certain",
    "deltas",
];

/// A row of the table.
#[derive(Clone, Debug)]
pub struct Dialect {
    /// As `--from` and `modlens formats` name it.
    pub name: String,
    /// What writes it.
    pub title: String,
    /// The clock that its times show.
    pub clock: String,
    /// Some lines of it.
    pub sample: String,
    /// What the sample holds: who sent it, and the bytes.
    pub bytes: Strings,
    /// Those whose lines hold no bytes of frames come first.
    pub(super) rules: Vec<(Role, Template)>,
    pub(super) starts: Starts,
    /// Any program may write it: rows that say more are preferred.
    pub generic: bool,
    /// Lines cut an endless stream; their ends mean nothing.
    pub(super) stream: bool,
    /// Its syntax is no other's: it needs no checksum to be detected.
    pub(super) certain: bool,
    /// The program prints frames without their checksum.
    pub no_checksum: bool,
    /// Lines up to the next head are one frame.
    pub(super) joined: bool,
    pub(super) wrap: Option<Wrap>,
    pub(super) short_fractions: bool,
    /// Lines that end a record say how long after the one before it came: `+4ms`.
    pub(super) deltas: bool,
    /// Bytes follow a line that announces them.
    pub(super) has_heads: bool,
}

impl Dialect {
    /// Whether any line with bytes can be in this text.
    pub(super) fn possible(&self, text: &[u8]) -> bool {
        self.rules.iter().any(|(_, template)| template.takes_bytes() && template.may_match(text))
    }

    /// Whether a record of it may take several lines.
    pub(super) fn several_lines(&self) -> bool {
        self.has_heads || self.stream
    }

    /// How much fixed text its templates have: what fits more of it says more.
    pub(super) fn fixed(&self) -> usize {
        self.rules.iter().filter(|(role, _)| *role != Role::Skip).map(|(_, template)| template.fixed_chars()).max().unwrap_or(0)
    }
}

/// The rows that are known, in the order in which ties are decided.
#[derive(Clone, Debug)]
pub struct Dialects {
    rows: Vec<Arc<Dialect>>,
}

impl Default for Dialects {
    fn default() -> Self {
        Self::embedded().clone()
    }
}

impl Dialects {
    /// The embedded table.
    pub fn embedded() -> &'static Self {
        static EMBEDDED: OnceLock<Dialects> = OnceLock::new();
        EMBEDDED.get_or_init(|| {
            let mut table = Self { rows: Vec::new() };
            table.load(TABLE, "dialects.toml").expect("the embedded table is tested");
            table
        })
    }

    /// The rows.
    pub fn rows(&self) -> impl Iterator<Item = &Arc<Dialect>> {
        self.rows.iter()
    }

    /// The row of this name.
    pub fn get(&self, name: &str) -> Option<&Arc<Dialect>> {
        self.rows.iter().find(|row| row.name == name)
    }

    /// The rows of names joined by `+`.
    ///
    /// # Errors
    /// The first name that is not known, and those that are.
    pub fn named(&self, names: &str) -> Result<Vec<Arc<Dialect>>, String> {
        names
            .split('+')
            .map(|name| {
                let known = || self.rows.iter().map(|row| row.name.as_str()).collect::<Vec<_>>().join(", ");
                self.get(name).cloned().ok_or_else(|| format!("format {name:?} is no text format; known are {}", known()))
            })
            .collect()
    }

    /// Adds the rows of a TOML text in front of the others; a row of the same name is replaced.
    ///
    /// # Errors
    /// Which row and key is wrong, and the known words.
    pub fn load(&mut self, text: &str, origin: &str) -> Result<(), String> {
        let table = parse_toml(text).map_err(|message| format!("{origin}: {message}"))?;
        if table.get("format").and_then(Json::as_u64) != Some(1) {
            return Err(format!("{origin}: the first line has to be `format = 1`"));
        }
        if let Some(key) =
            table.as_object().into_iter().flatten().map(|(key, _)| key).find(|key| !["format", "dialect"].contains(&key.as_str()))
        {
            return Err(format!("{origin}: unknown key {key:?}; rows are [[dialect]]"));
        }
        let mut added = Vec::new();
        for (i, row) in table.get("dialect").and_then(Json::as_array).into_iter().flatten().enumerate() {
            let row = parse_row(row).map_err(|message| format!("{origin}: dialect row {}: {message}", i + 1))?;
            added.push(Arc::new(row));
            // The embedded rows are read by a test.
            if text.len() != TABLE.len() {
                check_sample(&added[i]).map_err(|message| format!("{origin}: dialect row {}: {message}", i + 1))?;
            }
        }
        self.rows.retain(|row| !added.iter().any(|new| new.name == row.name));
        added.append(&mut self.rows);
        self.rows = added;
        Ok(())
    }
}

fn text<'a>(row: &'a Json, key: &str) -> Result<Option<&'a str>, String> {
    match row.get(key) {
        None => Ok(None),
        Some(Json::String(text)) => Ok(Some(text)),
        Some(_) => Err(format!("{key} must be a text")),
    }
}

fn flag(row: &Json, key: &str) -> Result<bool, String> {
    match row.get(key) {
        None => Ok(false),
        Some(Json::Bool(flag)) => Ok(*flag),
        Some(_) => Err(format!("{key} must be true or false")),
    }
}

fn parse_row(row: &Json) -> Result<Dialect, String> {
    let known = |key: &str| OTHER_KEYS.contains(&key) || ROLES.iter().any(|(role, _)| *role == key);
    if let Some((key, _)) = row.as_object().into_iter().flatten().find(|(key, _)| !known(key)) {
        let all = OTHER_KEYS.iter().copied().chain(ROLES.iter().map(|(role, _)| *role)).collect::<Vec<_>>();
        return Err(format!("unknown key {key:?}; known are {}", all.join(" ")));
    }
    let need = |key: &str| text(row, key)?.map(str::to_owned).ok_or_else(|| format!("{key} is missing"));
    let name = need("name")?;
    if name.is_empty() || !name.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_' | b'.')) {
        return Err(format!("name {name:?}: letters, digits and dashes only"));
    }
    let mut rules = Vec::new();
    for (key, role) in ROLES {
        for template in row.get(*key).and_then(Json::as_array).into_iter().flatten() {
            let template = template.as_str().ok_or_else(|| format!("{key} must be a list of texts"))?;
            rules.push((*role, Template::parse(template).map_err(|message| format!("{key}: {message}"))?));
        }
    }
    if !rules.iter().any(|(_, template)| template.takes_bytes()) {
        return Err(String::from("no template takes bytes"));
    }
    let no_checksum = match text(row, "checksum")? {
        None => false,
        Some("none") => true,
        Some(other) => return Err(format!("checksum {other:?}; leave it out, or say \"none\"")),
    };
    let wrap = match text(row, "wrap")? {
        None => None,
        Some("solarman") => Some(Wrap::Solarman),
        Some("network") => Some(Wrap::Network),
        Some(other) => return Err(format!("wrap {other:?}; it is solarman or network")),
    };
    Ok(Dialect {
        title: need("title")?,
        clock: text(row, "clock")?.unwrap_or("none").to_owned(),
        sample: need("sample")?,
        bytes: expected(row)?,
        name,
        generic: flag(row, "generic")?,
        stream: flag(row, "stream")?,
        certain: flag(row, "certain")?,
        joined: flag(row, "joined")? || flag(row, "deltas")? || no_checksum || wrap == Some(Wrap::Network),
        no_checksum,
        wrap,
        short_fractions: flag(row, "short_fractions")?,
        deltas: flag(row, "deltas")?,
        starts: Starts::of(&rules),
        has_heads: rules.iter().any(|(role, _)| matches!(role, Role::Head(_))),
        rules,
    })
}

/// The byte strings of a row's sample, pieces of one joined.
pub(super) fn strings_of_sample(row: &Arc<Dialect>) -> Strings {
    let mut reader = Reader::new(vec![Arc::clone(row)], None, Arc::default());
    reader.push(row.sample.trim_matches('\n').as_bytes());
    let mut strings: Strings = Vec::new();
    while let Some((record, bytes)) = reader.next(true) {
        match strings.last_mut() {
            Some((_, string)) if !record.record => string.extend_from_slice(bytes),
            _ => strings.push((record.side, bytes.to_vec())),
        }
    }
    strings
}

fn check_sample(row: &Arc<Dialect>) -> Result<(), String> {
    let found = strings_of_sample(row);
    let joined = |strings: &Strings| strings.iter().flat_map(|(_, bytes)| bytes.clone()).collect::<Vec<u8>>();
    let sides = |strings: &Strings| strings.iter().map(|(side, _)| *side).collect::<Vec<_>>();
    if joined(&found) == joined(&row.bytes) && (found.len() != row.bytes.len() || sides(&found) == sides(&row.bytes)) {
        return Ok(());
    }
    let mark = |side: &Option<Side>| match side {
        Some(Side::Sent) => ">",
        Some(Side::Received) => "<",
        None => "=",
    };
    let line = |(side, bytes): &(Option<Side>, Vec<u8>)| {
        bytes.iter().fold(format!("\"{}", mark(side)), |text, b| text + &format!(" {b:02X}")) + "\""
    };
    let lines: Vec<String> = found.iter().map(line).collect();
    Err(format!("the sample gives bytes = [{}], not what the row names", lines.join(", ")))
}

/// `> 05 03`, `< 05 03` or `= 05 03`: what the sample holds.
fn expected(row: &Json) -> Result<Strings, String> {
    let lines = row.get("bytes").and_then(Json::as_array).filter(|lines| !lines.is_empty());
    let lines = lines.ok_or("bytes is missing: what the sample holds, as [\"> 05 03 ..\", \"< 05 03 ..\", \"= 05 03 ..\"]")?;
    lines
        .iter()
        .map(|line| {
            let text = line.as_str().unwrap_or("");
            let side = match text.as_bytes().first() {
                Some(b'>') => Some(Side::Sent),
                Some(b'<') => Some(Side::Received),
                Some(b'=') => None,
                _ => return Err(format!("bytes: {line} begins with none of > < =")),
            };
            let bytes = modlens_protocol::hex::parse_hex(&text[1..]).filter(|bytes| !bytes.is_empty());
            Ok((side, bytes.ok_or_else(|| format!("bytes: {line} is no hex"))?))
        })
        .collect()
}
