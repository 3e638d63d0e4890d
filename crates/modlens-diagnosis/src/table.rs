//! The table of diagnoses, `dissectors/diagnoses.toml`, embedded and read once.

use std::sync::OnceLock;

use modlens_protocol::finding::{Finding, Severity};
use serde_json::Value as Json;

/// The embedded table.
pub const DIAGNOSES: &str = include_str!("../../../dissectors/diagnoses.toml");

/// A kind of trouble that it may be taken for.
#[derive(Clone, Debug)]
pub struct Confusion {
    /// Its code.
    pub code: String,
    /// What tells the two apart.
    pub difference: String,
}

/// A row of the table.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// Its code.
    pub code: String,
    /// A short description.
    pub title: String,
    /// How severe it is at most.
    pub severity: Severity,
    /// The contrast that it needs.
    pub contrast: String,
    /// What must not be there.
    pub absent: String,
    /// The findings that it brings forth.
    pub findings: Vec<Finding>,
    /// What it may be taken for.
    pub confusions: Vec<Confusion>,
    /// The sentence, with places in braces.
    pub sentence: String,
    /// What to check.
    pub advice: String,
    /// The experiment that would prove it.
    pub proof: String,
    /// What a recording must have to show it.
    pub needs: String,
}

/// All rows, in the order of the file.
pub fn diagnoses() -> &'static [Diagnosis] {
    static ALL: OnceLock<Vec<Diagnosis>> = OnceLock::new();
    ALL.get_or_init(|| parse(DIAGNOSES).expect("the embedded table is tested"))
}

/// The row of a code.
pub fn diagnosis(code: &str) -> Option<&'static Diagnosis> {
    diagnoses().iter().find(|row| row.code == code)
}

fn parse(text: &str) -> Result<Vec<Diagnosis>, String> {
    let file: Json = toml::from_str(text).map_err(|error| error.to_string())?;
    let rows = file["diagnosis"].as_array().ok_or("no rows")?;
    rows.iter().map(row).collect()
}

fn row(row: &Json) -> Result<Diagnosis, String> {
    let code = row["code"].as_str().ok_or("a row without code")?;
    let text = |key: &str| row[key].as_str().map(str::to_owned).ok_or(format!("{code}: no {key}"));
    let severity = match row["severity"].as_str() {
        Some("info") => Severity::Info,
        Some("warning") => Severity::Warning,
        Some("error") => Severity::Error,
        other => return Err(format!("{code}: severity {other:?}")),
    };
    let confusion = |one: &Json| {
        Some(Confusion { code: one["code"].as_str()?.to_owned(), difference: one["difference"].as_str()?.to_owned() })
    };
    let confusions: Option<Vec<Confusion>> =
        row["confusions"].as_array().map_or(Some(Vec::new()), |all| all.iter().map(confusion).collect());
    let finding = |one: &Json| one.as_str().and_then(Finding::from_code);
    let findings: Option<Vec<Finding>> = row["findings"].as_array().and_then(|all| all.iter().map(finding).collect());
    Ok(Diagnosis {
        findings: findings.ok_or(format!("{code}: findings"))?,
        code: code.to_owned(),
        title: text("title")?,
        severity,
        contrast: text("contrast")?,
        absent: text("absent")?,
        confusions: confusions.ok_or(format!("{code}: confusions"))?,
        sentence: text("sentence")?,
        advice: text("advice")?,
        proof: text("proof")?,
        needs: text("needs")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_whole_and_names_known_kinds() {
        let all = diagnoses();
        for row in all {
            assert!(row.confusions.iter().all(|one| one.code != row.code && diagnosis(&one.code).is_some()), "{}", row.code);
            // What a recognizer fills in whole is a sentence by itself.
            assert!([&row.advice, &row.proof, &row.sentence].iter().all(|text| text.ends_with(['.', '}'])), "{}", row.code);
            assert_eq!(all.iter().filter(|other| other.code == row.code).count(), 1, "{}", row.code);
        }
    }
}
