//! The table of diagnoses, `dissectors/diagnoses.toml`, embedded and read once.

use std::sync::OnceLock;

use modlens_protocol::finding::{Finding, Severity};
use serde_json::Value as Json;

use crate::contrast::Symptom;

/// The embedded table.
pub const DIAGNOSES: &str = include_str!("../../../dissectors/diagnoses.toml");

/// How often a cause shows a symptom that its row does not name.
pub const UNNAMED: f64 = 0.005;

/// A kind of trouble that it may be taken for.
#[derive(Clone, Debug)]
pub struct Confusion {
    /// Its code.
    pub code: String,
    /// What distinguishes the two.
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
    /// In how many public threads it was met.
    pub met: f64,
    /// The share of its failures with each symptom.
    pub symptoms: Vec<(Symptom, f64)>,
    /// What is said of a few examples of a symptom.
    pub sight: Vec<(Symptom, String)>,
    /// What to check, and the experiment, where a few examples are all; else those of the row.
    pub sight_advice: Option<String>,
    /// As above.
    pub sight_proof: Option<String>,
    /// The advice and the proof of a symptom that needs others.
    pub sight_instead: Vec<(Symptom, (String, String))>,
}

impl Diagnosis {
    /// The share of its failures with this symptom.
    pub fn rate(&self, symptom: Symptom) -> f64 {
        self.symptoms.iter().find(|(one, _)| *one == symptom).map_or(UNNAMED, |(_, rate)| *rate)
    }

    /// Whether refusals by an exception are among its symptoms.
    pub fn explains_refusals(&self) -> bool {
        self.symptoms.iter().any(|(symptom, _)| symptom.is_refusal())
    }

    /// What is said of a few examples of a symptom.
    pub fn sight(&self, symptom: Symptom) -> Option<&str> {
        self.sight.iter().find(|(one, _)| *one == symptom).map(|(_, words)| words.as_str())
    }

    /// What to check and the experiment where a few examples of a symptom are all.
    pub fn at_sight(&self, symptom: Symptom) -> (&str, &str) {
        let usual = (self.sight_advice.as_ref().unwrap_or(&self.advice), self.sight_proof.as_ref().unwrap_or(&self.proof));
        let instead = self.sight_instead.iter().find(|(one, _)| *one == symptom).map(|(_, (advice, proof))| (advice, proof));
        let (advice, proof) = instead.unwrap_or(usual);
        (advice, proof)
    }
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
        met: row["met"].as_f64().ok_or(format!("{code}: no number of threads"))?,
        symptoms: by_symptom(&row["symptoms"], Json::as_f64).ok_or(format!("{code}: symptoms"))?,
        sight: by_symptom(&row["sight"], |words| words.as_str().map(str::to_owned)).ok_or(format!("{code}: sight"))?,
        sight_advice: row["sight"]["advice"].as_str().map(str::to_owned),
        sight_proof: row["sight"]["proof"].as_str().map(str::to_owned),
        sight_instead: by_symptom(&row["sight"]["instead"], both).ok_or(format!("{code}: instead"))?,
    })
}

/// Advice and proof of one symptom.
fn both(table: &Json) -> Option<(String, String)> {
    Some((table["advice"].as_str()?.to_owned(), table["proof"].as_str()?.to_owned()))
}

/// A table of the row by symptom; empty where there is none, `None` where a symptom is not known.
fn by_symptom<T>(table: &Json, value: impl Fn(&Json) -> Option<T>) -> Option<Vec<(Symptom, T)>> {
    let symptom = |word: &str| Symptom::ALL.iter().copied().find(|one| one.word() == word);
    table.as_object().map_or(Some(Vec::new()), |all| {
        all.iter()
            .filter(|(word, _)| !matches!(word.as_str(), "advice" | "proof" | "instead"))
            .map(|(word, one)| Some((symptom(word)?, value(one)?)))
            .collect()
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
