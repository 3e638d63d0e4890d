//! Checks the rows of a table of dialects against their samples.

use std::sync::Arc;

use crate::chunk::Side;
use crate::text::dialect::{Dialect, Dialects, Strings};
use crate::text::reader::Reader;

impl Dialects {
    /// Adds the rows of a TOML text in front of the others; they replace rows of the same name. `origin` is the file's name
    /// for messages. The sample of each row is read, to show that the row finds the bytes that it claims to find.
    ///
    /// # Errors
    /// Names the wrong row and key, and the known words.
    pub fn load(&mut self, text: &str, origin: &str) -> Result<(), String> {
        self.load_with(text, origin, check_sample)
    }
}

/// The byte strings that a row finds in its own sample. Entries that continue a frame are joined to the one before.
fn strings_of_sample(row: &Arc<Dialect>) -> Strings {
    let mut reader = Reader::new(vec![Arc::clone(row)], None, Arc::default());
    reader.push(row.sample.trim_matches('\n').as_bytes());
    let mut strings: Strings = Vec::new();
    while let Some((record, bytes)) = reader.next(true) {
        match strings.last_mut() {
            Some((_, string)) if !record.starts_record => string.extend_from_slice(bytes),
            _ => strings.push((record.side, bytes.to_vec())),
        }
    }
    strings
}

/// Compares what the row finds in its sample with what it claims; the error message shows what was found. Senders are
/// compared only if the sample is split in the same places, because a claim may join what the log prints in parts.
fn check_sample(row: &Arc<Dialect>) -> Result<(), String> {
    let found = strings_of_sample(row);
    let is_joined = |strings: &Strings| strings.iter().flat_map(|(_, bytes)| bytes.clone()).collect::<Vec<u8>>();
    let sides = |strings: &Strings| strings.iter().map(|(side, _)| *side).collect::<Vec<_>>();
    if is_joined(&found) == is_joined(&row.bytes) && (found.len() != row.bytes.len() || sides(&found) == sides(&row.bytes)) {
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
