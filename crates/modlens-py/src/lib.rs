//! The border: the extension module `_modlens`, through which Python uses the core. It has no logic of its own, and its
//! classes and functions are documented in `_modlens.pyi`.

mod arguments;
mod batch;
mod capsule;
mod capture;
mod days;
mod dialects;
#[cfg(feature = "files")]
mod files;
mod filters;
mod finder;
mod functions;
mod inbox;
mod line_encoder;
mod line_search;
mod lines;
mod live;
mod output_file;
mod profile;
mod read_ahead;
mod recorder;
mod report;
mod server;
mod session;
mod stream;
mod table;
mod view;
mod watch;
mod words;

use modlens_diagnosis::table::Diagnosis;
use modlens_protocol::checksum;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::{Functions, VENDORS, VOCABULARY};
use modlens_protocol::renamed::{Renamed, RENAMED};
use modlens_protocol::status::Status;
use modlens_tables::columns;
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::arguments::{line_settings, value_error};

/// One of the tables that the core embeds (functions, columns, findings, names of codes ...), as JSON.
#[pyfunction]
fn vocabulary(part: &str) -> PyResult<String> {
    let found: Json = match part {
        "exceptions" => names("exception")?,
        "diagnostics" => names("diagnostic")?,
        "mei_types" => names("mei_type")?,
        "object_ids" => names("object_id")?,
        "read_device_id_codes" => names("read_device_id_code")?,
        "conformity_levels" => names("conformity_level")?,
        "functions" => Functions::embedded().rows().map(|row| row.source.clone()).collect(),
        "columns" => columns::TABLES.iter().map(|table| ((*table).to_owned(), columns::definition()[*table].clone())).collect(),
        "findings" => Finding::ALL.iter().map(|finding| finding_json(*finding)).collect(),
        "diagnoses" => modlens_diagnosis::table::diagnoses().iter().map(diagnosis_json).collect(),
        "statuses" => Status::ALL.iter().map(|one| json!({"code": one.text(), "meaning": one.meaning()})).collect(),
        "verdicts" => Verdict::ALL.iter().map(|one| json!({"code": one.text(), "meaning": one.meaning()})).collect(),
        "renamed" => RENAMED.iter().map(renamed_json).collect(),
        "vendors" => VENDORS.iter().map(|(name, _)| *name).collect(),
        "version" => columns::version().into(),
        _ => return Err(value_error(format!("no part {part:?} of the vocabulary"))),
    };
    Ok(found.to_string())
}

/// The rows of this name in vocabulary.toml.
fn names(of: &str) -> PyResult<Json> {
    let mut file = modlens_protocol::functions::parse_toml(VOCABULARY).map_err(value_error)?;
    Ok(file.get_mut(of).map_or_else(|| json!([]), Json::take))
}

fn finding_json(finding: Finding) -> Json {
    let doc = finding.doc();
    json!({
        "code": doc.code, "severity": doc.severity.text(), "title": doc.title, "why": doc.why, "advice": doc.advice,
        "section": doc.section,
    })
}

fn diagnosis_json(row: &Diagnosis) -> Json {
    let confusions: Json = row.confusions.iter().map(|one| json!({"code": one.code, "difference": one.difference})).collect();
    let findings: Vec<&str> = row.findings.iter().map(|finding| finding.doc().code).collect();
    json!({
        "code": row.code, "severity": row.severity.text(), "title": row.title, "contrast": row.contrast, "absent": row.absent,
        "confusions": confusions, "findings": findings, "advice": row.advice, "proof": row.proof, "needs": row.needs,
    })
}

fn renamed_json(entry: &Renamed) -> Json {
    json!({"vocabulary": entry.vocabulary.text(), "former": entry.former, "current": entry.current})
}

/// The CRC-16/MODBUS of these bytes, which is transmitted low byte first.
#[pyfunction]
fn crc16(data: &[u8]) -> u16 {
    checksum::crc16(data)
}

/// The LRC of the binary bytes of an ASCII frame.
#[pyfunction]
fn lrc(data: &[u8]) -> u8 {
    checksum::lrc(data)
}

/// Character time, t1.5 and t3.5 of a serial line, in nanoseconds.
#[pyfunction]
fn line_timing(baud: u32, data_bits: u8, parity: &str, stop_bits: f64) -> PyResult<(i64, i64, i64)> {
    let line = line_settings((baud, data_bits, parity.to_owned(), stop_bits))?;
    Ok((line.char_ns(), line.t15_ns(), line.t35_ns()))
}

/// Whether these bytes can be text.
#[pyfunction]
fn is_text(sample: &[u8]) -> bool {
    modlens_recording::format::is_text(sample)
}

#[pymodule]
fn _modlens(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_function(wrap_pyfunction!(vocabulary, module)?)?;
    module.add_function(wrap_pyfunction!(crc16, module)?)?;
    module.add_function(wrap_pyfunction!(lrc, module)?)?;
    module.add_function(wrap_pyfunction!(line_timing, module)?)?;
    module.add_function(wrap_pyfunction!(is_text, module)?)?;
    module.add_function(wrap_pyfunction!(profile::profile_schema, module)?)?;
    module.add_function(wrap_pyfunction!(profile::shipped_profiles, module)?)?;
    module.add_function(wrap_pyfunction!(profile::convert, module)?)?;
    module.add_class::<capture::Capture>()?;
    module.add_class::<days::Days>()?;
    module.add_function(wrap_pyfunction!(days::bus_day_columns, module)?)?;
    module.add_function(wrap_pyfunction!(days::bus_day_row, module)?)?;
    module.add_class::<dialects::Dialects>()?;
    #[cfg(feature = "files")]
    module.add_class::<files::RowFile>()?;
    module.add_class::<functions::Functions>()?;
    module.add_function(wrap_pyfunction!(functions::pdu_of, module)?)?;
    module.add_function(wrap_pyfunction!(functions::has_checksum, module)?)?;
    module.add_function(wrap_pyfunction!(profile::judge, module)?)?;
    module.add_function(wrap_pyfunction!(profile::sunspec_models, module)?)?;
    module.add_class::<profile::Profile>()?;
    module.add_class::<finder::Finder>()?;
    module.add_class::<profile::RegisterMap>()?;
    module.add_class::<profile::Survey>()?;
    module.add_class::<table::Predicate>()?;
    module.add_class::<table::Row>()?;
    module.add_class::<table::Table>()?;
    module.add_class::<output_file::OutputFile>()?;
    module.add_class::<line_encoder::LineEncoder>()?;
    module.add_class::<lines::Pieces>()?;
    module.add_class::<stream::ArrowStream>()?;
    module.add_class::<inbox::Inbox>()?;
    module.add_class::<live::LiveRun>()?;
    module.add_class::<live::CorePort>()?;
    module.add_class::<live::Tty>()?;
    module.add_class::<live::Remote>()?;
    module.add_function(wrap_pyfunction!(live::port_advice, module)?)?;
    module.add_function(wrap_pyfunction!(live::latency_timer, module)?)?;
    module.add_class::<line_search::LineSearch>()?;
    module.add_function(wrap_pyfunction!(line_search::usual_rates, module)?)?;
    module.add_function(wrap_pyfunction!(line_search::likely_rates, module)?)?;
    module.add_function(wrap_pyfunction!(line_search::proof_in, module)?)?;
    module.add_function(wrap_pyfunction!(filters::parse_filter, module)?)?;
    module.add_function(wrap_pyfunction!(filters::similar_name, module)?)?;
    module.add_function(wrap_pyfunction!(words::parse_duration, module)?)?;
    module.add_function(wrap_pyfunction!(words::parse_rotation, module)?)?;
    module.add_function(wrap_pyfunction!(words::parse_retention, module)?)?;
    module.add_function(wrap_pyfunction!(words::parse_line, module)?)?;
    module.add_function(wrap_pyfunction!(words::parse_broker, module)?)?;
    module.add_function(wrap_pyfunction!(words::topic_level, module)?)?;
    module.add_class::<recorder::Recorder>()?;
    module.add_class::<server::Server>()?;
    module.add_function(wrap_pyfunction!(report::report_document, module)?)?;
    module.add_function(wrap_pyfunction!(report::report_html, module)?)?;
    module.add_function(wrap_pyfunction!(report::report_layout, module)?)?;
    module.add_class::<view::Lines>()?;
    module.add_class::<watch::Join>()?;
    module.add_class::<watch::Watch>()?;
    module.add_function(wrap_pyfunction!(view::carried, module)?)?;
    module.add_function(wrap_pyfunction!(view::register_number, module)?)?;
    module.add_class::<batch::Batch>()?;
    module.add_class::<read_ahead::Reader>()?;
    module.add_class::<read_ahead::ReadBlock>()?;
    module.add_class::<session::Session>()?;
    Ok(())
}
