//! Compiles the table of dialects, `analyzer/sources/dialects.toml`, to templates. Users may add rows in the same format.
//!
//! All knowledge about the log of a particular program is in that table, none of it here.

use std::sync::{Arc, OnceLock};

use serde_json::Value as Json;

use crate::chunk::Side;
use crate::text::anchors::AnchorIndex;
use crate::text::notation::Notation;
use crate::text::role::LineRole;
use crate::text::template::Template;
use modlens_protocol::functions::parse_toml;

/// The embedded table.
pub const TABLE: &str = include_str!("../../../../analyzer/sources/dialects.toml");

/// Byte strings with their sender; `None` where the log does not say who sent them.
pub type Strings = Vec<(Option<Side>, Vec<u8>)>;

/// The protocol that a program prints around the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encapsulation {
    /// Solarman V5 data loggers.
    Solarman,
    /// Ethernet, IP and TCP or UDP headers.
    Network,
}

/// The keys of a row that hold templates, with their meaning. Templates are tried in this order, so those without bytes
/// come first.
const ROLES: &[(&str, LineRole)] = &[
    ("skip", LineRole::Ignored),
    ("repeat", LineRole::RepeatedLines),
    ("copy", LineRole::Duplicate),
    ("head_copy", LineRole::DuplicateHeader),
    ("head_sent", LineRole::Header(Some(Side::Sent))),
    ("head_received", LineRole::Header(Some(Side::Received))),
    ("head", LineRole::Header(None)),
    ("sent", LineRole::Bytes(Some(Side::Sent))),
    ("received", LineRole::Bytes(Some(Side::Received))),
    ("again", LineRole::PossibleDuplicate),
    ("more", LineRole::Continuation),
    ("either", LineRole::Bytes(None)),
];

/// All other keys that a row may have.
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
    /// The name by which `--from` and `modlens formats` know it.
    pub name: String,
    /// The program that writes such logs.
    pub title: String,
    /// The kind of clock that its timestamps show.
    pub clock: String,
    /// Sample lines.
    pub sample: String,
    /// The bytes that the sample holds, with their sender.
    pub bytes: Strings,
    /// The templates and their meaning; those whose lines hold no bytes of frames come first.
    pub(super) rules: Vec<(LineRole, Template)>,
    /// The index of the rules by the characters that they begin with.
    pub(super) anchors: AnchorIndex,
    /// Any program may write it, so more specific rows are preferred.
    pub generic: bool,
    /// It is a dump of an endless stream, so line ends mean nothing.
    pub(super) is_dump: bool,
    /// No other format has its syntax, so it is detected even where no checksum is valid.
    pub(super) has_unique_syntax: bool,
    /// The program prints frames without their checksum.
    pub no_checksum: bool,
    /// All lines up to the next header line are one frame.
    pub(super) is_joined: bool,
    /// The protocol around each frame.
    pub(super) encapsulation: Option<Encapsulation>,
    /// Nine decimals of a second may be microseconds (socat 1.7).
    pub(super) may_have_short_fractions: bool,
    /// The last line of a record says how long after the record before it came, as in `+4ms`.
    pub(super) has_deltas: bool,
    /// It has header lines, which announce the bytes of the lines after them.
    pub(super) has_headers: bool,
    /// A time, a word for the sender and pairs of hex digits are all that its lines may have.
    pub(super) is_plain_hex: bool,
    /// It has no syntax: it stands for all bytes that a checksum proves.
    pub is_proved: bool,
}

impl Dialect {
    /// Whether the text contains the fixed text of any template with bytes.
    pub(super) fn may_match(&self, text: &[u8]) -> bool {
        self.rules.iter().any(|(_, template)| template.takes_bytes() && template.may_match(text))
    }

    /// Whether a frame may be printed over several lines.
    pub(super) fn is_multi_line(&self) -> bool {
        self.has_headers || self.is_dump
    }

    /// Whether it reads a table of a manual, whose words name bytes.
    pub(super) fn is_table(&self) -> bool {
        self.rules.iter().any(|(_, template)| template.reads(Notation::PrefixedValue))
    }

    /// The most characters of fixed text in one of its templates, a measure of how specific the row is.
    pub(super) fn fixed_chars(&self) -> usize {
        self.rules
            .iter()
            .filter(|(role, _)| *role != LineRole::Ignored)
            .map(|(_, template)| template.fixed_chars())
            .max()
            .unwrap_or(0)
    }
}

/// All known rows. Of rows that read a line equally well the first is preferred.
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
            // A test checks the samples of the embedded rows, so that start-up need not.
            table.load_with(TABLE, "dialects.toml", |_| Ok(())).expect("the embedded table is tested");
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

    /// The row that stands for bytes which checksums prove.
    pub(super) fn proved_row(&self) -> Option<&Arc<Dialect>> {
        self.rows.iter().find(|row| row.is_proved)
    }

    /// The rows of several names joined by `+`.
    ///
    /// # Errors
    /// Names the first unknown name and all known ones.
    pub fn named(&self, names: &str) -> Result<Vec<Arc<Dialect>>, String> {
        names
            .split('+')
            .map(|name| {
                let known = || self.rows.iter().map(|row| row.name.as_str()).collect::<Vec<_>>().join(", ");
                self.get(name).cloned().ok_or_else(|| format!("{name:?} is not a text format; known are {}", known()))
            })
            .collect()
    }

    /// Parses the rows of a TOML text and puts them in front of the others; they replace rows of the same name. `origin` is
    /// the file's name for messages. `check` is called with each row before the next one is parsed.
    pub(super) fn load_with(
        &mut self,
        text: &str,
        origin: &str,
        check: impl Fn(&Arc<Dialect>) -> Result<(), String>,
    ) -> Result<(), String> {
        let table = parse_toml(text).map_err(|message| format!("{origin}: {message}"))?;
        if table.get("format").and_then(Json::as_u64) != Some(1) {
            return Err(format!("{origin}: the first line must be `format = 1`"));
        }
        if let Some(key) =
            table.as_object().into_iter().flatten().map(|(key, _)| key).find(|key| !["format", "dialect"].contains(&key.as_str()))
        {
            return Err(format!("{origin}: unknown key {key:?}; rows are [[dialect]]"));
        }
        let mut added = Vec::new();
        for (i, row) in table.get("dialect").and_then(Json::as_array).into_iter().flatten().enumerate() {
            let in_row = |message: String| format!("{origin}: dialect row {}: {message}", i + 1);
            let row = Arc::new(parse_row(row).map_err(in_row)?);
            check(&row).map_err(in_row)?;
            added.push(row);
        }
        self.rows.retain(|row| !added.iter().any(|new| new.name == row.name));
        added.append(&mut self.rows);
        self.rows = added;
        Ok(())
    }
}

/// The text under a key, if there is one.
fn text<'a>(row: &'a Json, key: &str) -> Result<Option<&'a str>, String> {
    match row.get(key) {
        None => Ok(None),
        Some(Json::String(text)) => Ok(Some(text)),
        Some(_) => Err(format!("{key} must be a text")),
    }
}

/// The boolean under a key; false where it is missing.
fn flag(row: &Json, key: &str) -> Result<bool, String> {
    match row.get(key) {
        None => Ok(false),
        Some(Json::Bool(flag)) => Ok(*flag),
        Some(_) => Err(format!("{key} must be true or false")),
    }
}

/// Compiles one row of the table; the error message names the wrong key.
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
        return Err(String::from("no template contains bytes"));
    }
    let no_checksum = match text(row, "checksum")? {
        None => false,
        Some("none") => true,
        Some(other) => return Err(format!("checksum {other:?}; leave it out, or say \"none\"")),
    };
    let encapsulation = match text(row, "wrap")? {
        None => None,
        Some("solarman") => Some(Encapsulation::Solarman),
        Some("network") => Some(Encapsulation::Network),
        Some(other) => return Err(format!("wrap {other:?}; write solarman or network")),
    };
    let (is_dump, has_deltas) = (flag(row, "stream")?, flag(row, "deltas")?);
    let is_plain = matches!(&rules[..], [(LineRole::Bytes(None), template)] if template.is_plain_hex());
    let is_joined = flag(row, "joined")? || has_deltas || no_checksum || encapsulation == Some(Encapsulation::Network);
    Ok(Dialect {
        title: need("title")?,
        clock: text(row, "clock")?.unwrap_or("none").to_owned(),
        sample: need("sample")?,
        bytes: claimed_bytes(row)?,
        name,
        generic: flag(row, "generic")?,
        is_plain_hex: is_plain && flag(row, "generic")? && !is_dump && !is_joined && encapsulation.is_none(),
        is_dump,
        has_unique_syntax: flag(row, "certain")?,
        is_joined,
        no_checksum,
        encapsulation,
        may_have_short_fractions: flag(row, "short_fractions")?,
        has_deltas,
        anchors: AnchorIndex::of(&rules),
        is_proved: rules.iter().any(|(_, template)| template.is_proved()),
        has_headers: rules.iter().any(|(role, _)| matches!(role, LineRole::Header(_))),
        rules,
    })
}

/// Parses the `bytes` of a row, such as `> 05 03` (sent), `< 05 03` (received) or `= 05 03` (the log does not say).
fn claimed_bytes(row: &Json) -> Result<Strings, String> {
    let lines = row.get("bytes").and_then(Json::as_array).filter(|lines| !lines.is_empty());
    let lines = lines.ok_or("bytes is missing: the bytes of the sample, as [\"> 05 03 ..\", \"< 05 03 ..\", \"= 05 03 ..\"]")?;
    lines
        .iter()
        .map(|line| {
            let text = line.as_str().unwrap_or("");
            let side = match text.as_bytes().first() {
                Some(b'>') => Some(Side::Sent),
                Some(b'<') => Some(Side::Received),
                Some(b'=') => None,
                _ => return Err(format!("bytes: {line} does not begin with > < or =")),
            };
            let bytes = modlens_protocol::hex::parse_hex(&text[1..]).filter(|bytes| !bytes.is_empty());
            Ok((side, bytes.ok_or_else(|| format!("bytes: {line} is not hex"))?))
        })
        .collect()
}
