//! Recordings of others: chunk logs with the frames that were sent, `NAME.jsonl` and `NAME.expected.jsonl`.

use std::fs;
use std::path::Path;

use super::line::{recorded_case, RecordedFrame};
use crate::model::{Direction, Settings};
use crate::sim::case::Case;
use crate::sim::tap::TapRead;

/// The cases of a folder, by name. `NAME.md` has the settings of the line after `--line`; without them they are 9600-8N1.
pub fn cases(folder: &Path) -> Result<Vec<Case>, String> {
    let entries = fs::read_dir(folder).map_err(|why| format!("{}: {why}", folder.display()))?;
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter_map(|name| Some(name.strip_suffix(".expected.jsonl")?.to_owned())).collect();
    names.sort();
    names.into_iter().map(|name| case(folder, name)).collect()
}

fn case(folder: &Path, name: String) -> Result<Case, String> {
    let text = |suffix: &str| fs::read_to_string(folder.join(format!("{name}{suffix}"))).map_err(|why| format!("{name}: {why}"));
    let settings = text(".md").ok().and_then(|page| settings(&page)).unwrap_or(Settings {
        baud: 9600,
        data_bits: 8,
        has_even_parity: false,
    });
    let (mut bytes, mut reads) = (Vec::new(), Vec::new());
    for row in text(".jsonl")?.lines() {
        let hex = member(row, "hex").ok_or_else(|| format!("{name}: a row without hex: {row}"))?;
        let read: Option<Vec<u8>> =
            hex.as_bytes().chunks(2).map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()).collect();
        let read = read.ok_or_else(|| format!("{name}: not hex: {hex}"))?;
        let time =
            member(row, "t").and_then(|seconds| seconds.parse::<f64>().ok()).map(|seconds| (seconds * 1e6).round() as i64 * 1000);
        reads.push(TapRead { time, length: read.len() as u32, order: time.unwrap_or(reads.len() as i64) });
        bytes.extend(read);
    }
    let frames: Option<Vec<RecordedFrame>> = text(".expected.jsonl")?.lines().map(|row| frame(row, &bytes)).collect();
    let frames = frames.ok_or_else(|| format!("{name}: a row of the expected frames lacks start, end or dir"))?;
    Ok(recorded_case(name, settings, (bytes, reads), frames))
}

fn frame(row: &str, bytes: &[u8]) -> Option<RecordedFrame> {
    let number = |key| member(row, key)?.parse::<u64>().ok();
    let (start, end) = (number("start")?, number("end")?);
    bytes.get(start as usize..end as usize)?;
    let direction = if member(row, "dir")? == "req" { Direction::Request } else { Direction::Response };
    let is = |key| member(row, key) == Some("true");
    Some(RecordedFrame { start, end, direction, txn: number("tx").unwrap_or(0) as u32, valid: is("valid"), echo: is("echo") })
}

/// The value of a member of a flat JSON object, without quotation marks.
fn member<'a>(row: &'a str, key: &str) -> Option<&'a str> {
    let value = row.split_once(&format!("\"{key}\":"))?.1;
    Some(value.split([',', '}']).next()?.trim().trim_matches('"'))
}

fn settings(page: &str) -> Option<Settings> {
    let line = page.split_once("--line ")?.1.split_whitespace().next()?;
    let (baud, format) = line.split_once('-')?;
    Some(Settings { baud: baud.parse().ok()?, data_bits: 8, has_even_parity: format.contains('E') })
}
