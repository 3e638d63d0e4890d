//! A large recording is decoded once, in little memory: it has the document and the rows of one of which all is kept, with and
//! without a profile.

use std::fs;
use std::path::{Path, PathBuf};

use modlens_web::{answer, Decoding};
use serde_json::{json, Value as Json};

const BLOCK: usize = 1 << 14;

/// The recordings of the repository.
fn recordings() -> Vec<PathBuf> {
    let captures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../captures");
    let folders = fs::read_dir(captures).expect("captures").filter_map(|one| fs::read_dir(one.ok()?.path()).ok());
    let files = folders.flatten().filter_map(|one| Some(one.ok()?.path()));
    files.filter(|path| path.file_stem().is_some_and(|stem| stem == "recording")).collect()
}

/// A profile of all units, with a scale factor.
const PROFILE: &str =
    "profile: 1\nregisters:\n  - {at: hr:0, name: a, sf: c}\n  - {at: hr:1, name: b, type: s16, scale: 0.1}\n  \
                       - {at: hr:2, name: c, type: s16}\n  - {at: ir:0, name: d}\n";

/// A recording that has been read; `None` where it cannot be.
fn decoded(path: &Path, purpose: &str, profiles: &Json) -> Option<Decoding> {
    let settings = json!({"name": "recording", "purpose": purpose, "profiles": profiles});
    let mut decoding = Decoding::open(&settings).expect("settings");
    for block in fs::read(path).expect("a file").chunks(BLOCK) {
        decoding.feed(block).ok()?;
    }
    decoding.finish().ok()?;
    Some(decoding)
}

/// The rows of a table as CSV.
fn rows(decoding: &mut Decoding, table: &str) -> String {
    answer(decoding, &json!({"call": "export", "table": table, "format": "csv"})).expect("an export");
    let mut text = Vec::new();
    loop {
        let length = text.len();
        decoding.export_more(&mut text);
        if text.len() == length {
            return String::from_utf8(text).expect("text");
        }
    }
}

fn count(decoding: &mut Decoding, table: &str) -> u64 {
    let question = json!({"call": "rows", "table": table, "columns": [], "from": 0, "count": 0});
    answer(decoding, &question).expect("rows")["total"].as_u64().expect("a number")
}

#[test]
fn it_has_the_document_and_the_rows_of_others() {
    let mut compared = 0;
    let profiles = [json!([]), json!([{"text": PROFILE, "form": "yaml"}])];
    for (path, profiles) in recordings().iter().flat_map(|path| profiles.iter().map(move |profiles| (path, profiles))) {
        let Some(mut all) = decoded(path, "all", profiles) else { continue };
        let mut large = decoded(path, "large", profiles).expect("the same");
        let document = |decoding: &mut Decoding| -> Json { answer(decoding, &json!({"call": "report"})).expect("a report") };
        assert!(document(&mut large) == document(&mut all), "{}", path.display());
        for table in ["transactions", "findings", "connections", "diagnoses", "readings"] {
            assert_eq!(rows(&mut large, table), rows(&mut all, table), "{table} of {}", path.display());
        }
        assert_eq!(count(&mut large, "frames"), 0);
        compared += 1;
    }
    assert!(compared > 60, "{compared}");
}

/// A quarter of a million requests that are refused (Application Protocol V1.1b3, 7).
#[test]
fn findings_have_a_bound() {
    let refused: Vec<u8> = vec![0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0a, 0x01, 0x83, 0x02, 0xc0, 0xf1];
    let mut decoding = Decoding::open(&json!({"name": "line", "purpose": "large"})).expect("settings");
    for part in 0..250 {
        decoding.feed(&refused.repeat(1000)).expect("bytes");
        if part == 9 {
            answer(&mut decoding, &json!({"call": "keep_newest"})).expect("an answer");
        }
    }
    assert_eq!(decoding.finish(), Ok(250_000));
    let [transactions, findings] = ["transactions", "findings"].map(|table| count(&mut decoding, table));
    assert!((200_000..203_000).contains(&findings), "{findings}");
    let forgotten = answer(&mut decoding, &json!({"call": "forgotten"})).expect("an answer");
    assert_eq!(forgotten, json!({"transactions": 250_000 - transactions, "findings": 250_000 - findings}));
    let document = answer(&mut decoding, &json!({"call": "report"})).expect("a report");
    assert_eq!(document["document"]["statistics"]["findings"]["exception"], 250_000);
}

/// A hundred thousand exchanges (Application Protocol V1.1b3, 6.3), the first of which is refused.
#[test]
fn the_newest_transactions_and_all_findings_are_kept() {
    let (good, refused) = ("010300000001840a0103020007f986", "010300000001840a018302c0f1");
    let bytes = |hex: &str| -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hex")).collect()
    };
    let mut decoding = Decoding::open(&json!({"name": "line", "purpose": "large"})).expect("settings");
    decoding.feed(&bytes(refused)).expect("bytes");
    for part in 0..100 {
        decoding.feed(&bytes(good).repeat(1000)).expect("bytes");
        if part == 9 {
            answer(&mut decoding, &json!({"call": "keep_newest"})).expect("an answer");
        }
    }
    assert_eq!(decoding.finish(), Ok(100_001));
    let kept = count(&mut decoding, "transactions");
    assert!((7000..10_000).contains(&kept), "{kept}");
    assert_eq!(count(&mut decoding, "findings"), 1);
    assert!(rows(&mut decoding, "transactions").lines().last().expect("a row").contains("100001"));
}
