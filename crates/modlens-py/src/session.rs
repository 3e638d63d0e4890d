//! The session: bytes of any source go in, batches of rows come out.

use std::borrow::Cow;
use std::sync::Arc;

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::events::{Event, Events};
use modlens_diagnosis::report::Report;
use modlens_engine::framer::silence::SilenceRule;
use modlens_engine::records::Bus;
use modlens_engine::session::{open_connections, BusOptions, CaptureOptions, Session as Core, WantedTables};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions as CoreFunctions;
use modlens_protocol::source::{Clock, Place};
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::logic::Wiring;
use modlens_readers::pcap::Ports;
use modlens_readers::text::{day_of, unread_says, ClockSettings, Reader as TextReader, Said};
use modlens_recorder::LiveStatus;
use modlens_tables::columns::TableKind;
use modlens_tables::overview::Overview;
use modlens_tables::selection::Selection;
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use serde_json::json;

use crate::arguments::{hex, line_settings, value_error};
use crate::batch::Batch;
use crate::dialects::Dialects;
use crate::functions::Functions;
use crate::profile::Profile;
use crate::read_ahead::{ReadBlock, Reader};
use crate::table::Predicate;

/// The framing of this name; `None` stands for `auto`, which lets the engine detect it.
pub(crate) fn framing(name: &str) -> PyResult<Option<Mode>> {
    if name == "auto" {
        return Ok(None);
    }
    let unknown = || value_error(format!("mode {name:?} is not one of auto, rtu, ascii, tcp"));
    Mode::from_text(name).map(Some).ok_or_else(unknown)
}

/// The number of a line of a bus.
pub(crate) fn line_number(line: Option<&str>) -> PyResult<u8> {
    Ok(match line {
        None => 0,
        Some("A") => 1,
        Some("B") => 2,
        Some(other) => return Err(value_error(format!("line {other:?} is neither A nor B"))),
    })
}

/// Framer, decoder, pairing and statistics after one `feed`.
#[pyclass(module = "_modlens")]
pub struct Session {
    core: Core,
    /// Which rows are kept and counted; all without it.
    selection: Option<Selection>,
    functions: Arc<CoreFunctions>,
    /// What is counted for diagnoses, if these are wanted.
    contrast: Option<Contrast>,
    /// Troubles that begin, change and end, where a live line is watched for diagnoses.
    events: Option<Events>,
    /// What the doctor has said of that at the end of the recordings.
    report: Option<Report>,
    /// What the unread lines of the first text show of which this is known.
    unread: Option<Said>,
    /// What is collected for reports, if they are wanted.
    overview: Option<Overview>,
    /// The overview has the time series alone.
    shows_text: bool,
    buses: usize,
}

#[pymethods]
impl Session {
    #[new]
    #[pyo3(signature = (functions, *, live=false, timeout_ns=None, tables=None, bus_name=None, overview="none", select=None))]
    fn new(
        functions: &Functions,
        live: bool,
        timeout_ns: Option<i64>,
        tables: Option<Vec<String>>,
        bus_name: Option<String>,
        overview: &str,
        select: Option<Vec<PyRef<'_, Predicate>>>,
    ) -> PyResult<Self> {
        let mut wanted = WantedTables { frames: tables.is_none(), transactions: tables.is_none(), findings: tables.is_none() };
        let mut contrast = None;
        for name in tables.unwrap_or_default() {
            match TableKind::from_name(&name).ok_or_else(|| value_error(format!("no table {name:?}")))? {
                TableKind::Frames => wanted.frames = true,
                TableKind::Transactions | TableKind::Readings => wanted.transactions = true,
                TableKind::Findings => wanted.findings = true,
                // Its rows are always made: they are few.
                TableKind::Connections => {}
                TableKind::Diagnoses if select.is_some() => contrast = Some(Contrast::of_selection()),
                TableKind::Diagnoses => contrast = Some(Contrast::default()),
            }
        }
        let shows_text = overview == "series";
        let overview = match overview {
            "none" => None,
            "series" => Some(Overview::of_courses()),
            "all" => Some(Overview::default()),
            other => return Err(value_error(format!("overview {other:?} is not one of none, series, all"))),
        };
        let conditions = select.map(|all| all.iter().map(|one| one.core.clone()).collect());
        let selection = conditions.map(Selection::new).transpose().map_err(value_error)?;
        if selection.is_some() {
            (wanted.frames, wanted.transactions, wanted.findings) = (true, true, true);
        }
        let shows_frames = wanted.frames;
        if contrast.is_some() || overview.is_some() {
            (wanted.frames, wanted.transactions) = (true, true);
        }
        let mut core = Core::new(Arc::clone(&functions.core), wanted, live, timeout_ns);
        if !shows_frames {
            core.emit_compact();
        }
        if let Some(name) = bus_name {
            core.name_buses(name);
        }
        let events = contrast.as_ref().filter(|_| live).map(|_| Events::default());
        Ok(Self {
            core,
            selection,
            functions: Arc::clone(&functions.core),
            contrast,
            events,
            report: None,
            unread: None,
            overview,
            shows_text,
            buses: 0,
        })
    }

    #[pyo3(signature = (profile, units, *, bus=None))]
    fn bind(&mut self, profile: &Profile, units: Vec<u8>, bus: Option<&str>) {
        self.core.bind(bus, &units, &profile.plan);
    }

    #[allow(clippy::too_many_arguments)] // The keywords of one Python call.
    #[pyo3(signature = (name, *, source, mode="auto", line=None, clock="none", resolution_ns=None, silence_ns=None))]
    fn add_bus(
        &mut self,
        name: String,
        source: String,
        mode: &str,
        line: Option<(u32, u8, String, f64)>,
        clock: &str,
        resolution_ns: Option<i64>,
        silence_ns: Option<(i64, i64)>,
    ) -> PyResult<usize> {
        let mode = framing(mode)?;
        let clock = match clock {
            "utc" => Clock::Utc,
            "relative" => Clock::Relative,
            "none" => Clock::None,
            other => return Err(value_error(format!("clock {other:?} is not one of utc, relative, none"))),
        };
        let rule = silence_ns.map(|(t35_ns, t15_ns)| SilenceRule { t35_ns, t15_ns });
        let bus = Bus { name, source, place: Place::Offset, clock, line: None, network: None };
        let line = line.map(line_settings).transpose()?;
        let number = self.core.add_bus(BusOptions { bus, mode, line, resolution: resolution_ns, rule });
        self.buses = number + 1; // Captures and logs of several devices may have added buses as well.
        Ok(number)
    }

    #[pyo3(signature = (bus, offset, *, line=None))]
    fn begin_at(&mut self, bus: usize, offset: u64, line: Option<&str>) -> PyResult<()> {
        self.check_bus(bus)?;
        self.core.begin_at(bus, line_number(line)?, offset);
        Ok(())
    }

    #[allow(clippy::too_many_arguments)] // The keywords of one Python call.
    #[pyo3(signature = (bus, data, time_ns=None, *, line=None, errors=None, hole=false))]
    fn feed(
        &mut self,
        py: Python<'_>,
        bus: usize,
        data: &[u8],
        time_ns: Option<i64>,
        line: Option<&str>,
        errors: Option<Vec<u32>>,
        hole: bool,
    ) -> PyResult<()> {
        self.check_bus(bus)?;
        let line = line_number(line)?;
        let errors = errors.unwrap_or_default();
        let times = time_ns.map_or(Times::None, Times::Read);
        let chunk = Chunk { bytes: data, line, times, error_positions: &errors, follows_loss: hole, ..Chunk::default() };
        py.detach(|| self.core.feed(bus, &chunk));
        Ok(())
    }

    #[allow(clippy::too_many_arguments)] // The keywords of one Python call.
    #[pyo3(signature = (bus, format, *, dialects=None, ordered=false, sample=None, zone=None, date=None))]
    fn open_text(
        &mut self,
        bus: usize,
        format: &str,
        dialects: Option<&Dialects>,
        ordered: bool,
        sample: Option<&[u8]>,
        zone: Option<Vec<(i64, i64)>>,
        date: Option<&str>,
    ) -> PyResult<()> {
        self.check_bus(bus)?;
        let day = date
            .map(|date| day_of(date).ok_or_else(|| value_error(format!("date {date:?} is not written as 2026-11-21"))))
            .transpose()?;
        let table = Arc::new(dialects.map_or_else(|| modlens_readers::text::Dialects::embedded(), Dialects::core).clone());
        let rows = table.named(format).map_err(value_error)?;
        let clock = Arc::new(ClockSettings { zone: zone.unwrap_or_default(), day });
        let reader = TextReader::new(rows, (!ordered).then_some(table), clock);
        self.core.open_text(bus, reader, sample.unwrap_or_default());
        Ok(())
    }

    #[pyo3(signature = (bus, data, *, r#final=false))]
    fn feed_text(&mut self, py: Python<'_>, bus: usize, data: &[u8], r#final: bool) -> PyResult<()> {
        self.check_bus(bus)?;
        py.detach(|| self.core.feed_text(bus, data, r#final));
        Ok(())
    }

    fn settle_text(&mut self, py: Python<'_>, bus: usize) -> PyResult<()> {
        self.check_bus(bus)?;
        py.detach(|| self.core.settle_text(bus));
        Ok(())
    }

    #[pyo3(signature = (source, *, ports=None, mode="auto", line=None, silence_ns=None))]
    fn add_capture(
        &mut self,
        source: String,
        ports: Option<Vec<u16>>,
        mode: &str,
        line: Option<(u32, u8, String, f64)>,
        silence_ns: Option<(i64, i64)>,
    ) -> PyResult<usize> {
        let ports = match ports {
            None => Ports::default(),
            Some(ports) if ports.is_empty() => Ports::Any,
            Some(ports) => Ports::Listed(ports),
        };
        let line = line.map(line_settings).transpose()?;
        let rule = silence_ns.map(|(t35_ns, t15_ns)| SilenceRule { t35_ns, t15_ns });
        Ok(self.core.add_capture(CaptureOptions { source, ports, mode: framing(mode)?, line, rule }))
    }

    #[pyo3(signature = (capture, data, *, r#final=false))]
    fn feed_capture(&mut self, py: Python<'_>, capture: usize, data: &[u8], r#final: bool) -> PyResult<()> {
        if !self.core.has_capture(capture) {
            return Err(PyIndexError::new_err(format!("capture {capture} was not added")));
        }
        py.detach(|| self.core.feed_capture(capture, data, r#final));
        Ok(())
    }

    fn capture(&self, capture: usize) -> PyResult<String> {
        let found = self.core.capture(capture);
        let report = found.ok_or_else(|| PyIndexError::new_err(format!("capture {capture} was not added")))?;
        let dropped: serde_json::Map<String, serde_json::Value> =
            report.left_out.iter().map(|(reason, count)| (reason.clone(), json!(count))).collect();
        Ok(json!({
            "lines": 0, "records": report.packets, "unparsed": 0, "unparsed_with_hex": 0, "unparsed_hex_bytes": 0, "unparsed_examples": [], "dropped": dropped,
            "clock": report.clock.text(), "resolution_ns": report.resolution, "mode": null,
        })
        .to_string())
    }

    fn lend_reader(&mut self, bus: usize) -> PyResult<Reader> {
        self.check_bus(bus)?;
        Ok(Reader::new(self.core.lend_reader(bus)))
    }

    fn lend_capture_reader(&mut self, capture: usize) -> PyResult<Reader> {
        let lent = self.core.lend_capture_reader(capture);
        lent.map(Reader::new).ok_or_else(|| PyIndexError::new_err(format!("capture {capture} was not added")))
    }

    fn take_back(&mut self, reader: &mut Reader) {
        if let Some(reader) = reader.give_back() {
            self.core.take_back(reader);
        }
    }

    fn take_read(&mut self, py: Python<'_>, block: &ReadBlock) -> Batch {
        Batch::new(py.detach(|| {
            self.core.feed_read(&block.core);
            self.take_counted()
        }))
    }

    #[allow(clippy::too_many_arguments)] // The keywords of one Python call.
    #[pyo3(signature = (source, *, rate, unit, channels=None, inverted=None, mode="auto", line=None))]
    fn add_logic(
        &mut self,
        source: String,
        rate: f64,
        unit: usize,
        channels: Option<Vec<usize>>,
        inverted: Option<bool>,
        mode: &str,
        line: Option<(u32, u8, String, f64)>,
    ) -> PyResult<usize> {
        let line = line.map(line_settings).transpose()?;
        let wiring = Wiring { rate, unit, channels, line, inverted };
        Ok(self.core.add_logic(source, framing(mode)?, wiring))
    }

    #[pyo3(signature = (logic, data, *, r#final=false))]
    fn feed_logic(&mut self, py: Python<'_>, logic: usize, data: &[u8], r#final: bool) -> PyResult<()> {
        if self.core.logic(logic).is_none() {
            return Err(PyIndexError::new_err(format!("logic analyzer {logic} was not added")));
        }
        py.detach(|| self.core.feed_logic(logic, data, r#final));
        Ok(())
    }

    fn logic(&self, logic: usize) -> PyResult<String> {
        let found = self.core.logic(logic);
        let found = found.ok_or_else(|| PyIndexError::new_err(format!("logic analyzer {logic} was not added")))?;
        let lines: Vec<serde_json::Value> = found
            .lines()
            .unwrap_or(&[])
            .iter()
            .map(|it| {
                let settings = &it.settings;
                json!({"channel": it.channel, "line": settings.line.to_string(), "inverted": settings.inverted})
            })
            .collect();
        Ok(json!({"lines": lines, "copies": found.copies(), "surplus": found.surplus()}).to_string())
    }

    fn poll(&mut self, now_ns: i64) {
        self.core.poll(now_ns);
    }

    #[pyo3(signature = (*, file=false))]
    fn flush(&mut self, py: Python<'_>, file: bool) {
        py.detach(|| if file { self.core.flush_file() } else { self.core.flush() });
    }

    fn close(&mut self, bus: usize) -> PyResult<()> {
        self.check_bus(bus)?;
        if self.unread.is_none() && self.contrast.is_some() {
            self.unread = self.core.reader(bus).and_then(unread_says);
        }
        self.core.close_bus(bus);
        Ok(())
    }

    fn close_capture(&mut self, capture: usize) -> PyResult<()> {
        self.capture(capture)?;
        self.core.close_capture(capture);
        Ok(())
    }

    fn close_logic(&mut self, logic: usize) -> PyResult<()> {
        self.logic(logic)?;
        self.core.close_logic(logic);
        Ok(())
    }

    fn take(&mut self, py: Python<'_>) -> Batch {
        Batch::new(py.detach(|| self.take_counted()))
    }

    /// The last rows, and the diagnoses of all.
    fn conclude(&mut self, py: Python<'_>) -> Batch {
        let batch = py.detach(|| {
            let mut batch = self.take_counted();
            self.report = self.contrast.take().map(|contrast| self.report_of(contrast));
            batch.diagnoses = self.report.as_ref().map_or_else(Vec::new, |report| report.rows().to_vec());
            batch
        });
        Batch::new(batch)
    }

    /// What the doctor says so far, as JSON; null where diagnoses are not wanted.
    fn doctor(&self) -> String {
        self.report().map_or(serde_json::Value::Null, |report| report.json()).to_string()
    }

    /// The events of troubles since the last call, each as JSON.
    fn take_events(&mut self) -> Vec<String> {
        let events = self.events.as_mut().map_or_else(Vec::new, Events::take);
        events.iter().map(|event: &Event| event.json().to_string()).collect()
    }

    /// The troubles that are open, as a JSON list.
    fn troubles(&self) -> String {
        let open = self.events.iter().flat_map(Events::open);
        serde_json::Value::from(open.map(modlens_diagnosis::events::Trouble::json).collect::<Vec<_>>()).to_string()
    }

    /// Doctor, statistics and overview in one; null where something is not wanted.
    fn document(&self) -> String {
        let report = self.report();
        let examples: Vec<u64> = report.as_deref().map_or_else(Vec::new, Report::examples);
        // Time series are computed where text is shown, which shows the worst diagnosis of each kind.
        let said = if self.shows_text { Report::brief } else { Report::json };
        json!({
            "doctor": report.as_deref().map(said), "statistics": self.stats_json(),
            "overview": self.overview.as_ref().map(|overview| overview.json(&examples)),
        })
        .to_string()
    }

    fn stats(&self) -> String {
        self.stats_json().to_string()
    }

    /// What the text reader of a bus reports about the recording, as JSON; for a bus without one all counts are 0.
    fn reading(&self, bus: usize) -> PyResult<String> {
        self.check_bus(bus)?;
        let mode = self.core.mode(bus).map(Mode::text);
        let Some(reader) = self.core.reader(bus) else {
            return Ok(json!({
                "lines": 0, "records": 0, "unparsed": 0, "unparsed_with_hex": 0, "unparsed_hex_bytes": 0, "unparsed_examples": [], "dropped": {}, "left_out": [], "clock": null,
                "mode": mode,
            })
            .to_string());
        };
        let dropped: serde_json::Map<String, serde_json::Value> =
            reader.skipped_counts().map(|(reason, count, _)| (reason.to_owned(), count.into())).collect();
        let dropped_bytes: serde_json::Map<String, serde_json::Value> =
            reader.skipped_counts().map(|(reason, _, bytes)| (reason.to_owned(), bytes.into())).collect();
        let left_out: Vec<(u64, String, &str)> =
            reader.skipped().iter().map(|(line, bytes, reason)| (*line, hex(bytes), *reason)).collect();
        let formats: Vec<&str> = reader.dialects().iter().map(|dialect| dialect.name.as_str()).collect();
        let unread = reader.unread_lines();
        Ok(json!({
            "lines": reader.lines(), "records": reader.records(), "unparsed": unread.count,
            "unparsed_with_hex": unread.with_hex, "unparsed_hex_bytes": unread.hex_bytes, "unparsed_examples": unread.examples, "dropped": dropped, "dropped_bytes": dropped_bytes, "left_out": left_out, "formats": formats,
            "clock": reader.clock_kind().text(), "resolution_ns": reader.resolution(), "mode": mode,
        })
        .to_string())
    }
}

impl Session {
    /// The rows of the engine, counted for the doctor.
    fn take_counted(&mut self) -> modlens_engine::records::Batch {
        // The last report stands: what it was made of has been taken.
        self.report = self.report.take().filter(|_| self.contrast.is_none());
        let mut batch = self.core.take();
        if let Some(selection) = &mut self.selection {
            batch = selection.apply(batch);
        }
        if let Some(contrast) = &mut self.contrast {
            contrast.observe(&batch);
        }
        if let Some(events) = &mut self.events {
            events.observe_with(&batch, || open_connections(&self.core));
        }
        if let Some(overview) = &mut self.overview {
            overview.observe(&batch);
        }
        batch
    }

    /// Statistics of the selection, or of all rows.
    fn stats_json(&self) -> serde_json::Value {
        self.selection.as_ref().map_or_else(|| self.core.stats_json(), |selection| selection.stats_json(&self.functions))
    }

    /// What the doctor says so far; `None` where diagnoses are not wanted.
    fn report(&self) -> Option<Cow<'_, Report>> {
        match (&self.report, &self.contrast) {
            (Some(report), _) => Some(Cow::Borrowed(report)),
            (None, contrast) => contrast.clone().map(|contrast| Cow::Owned(self.report_of(contrast))),
        }
    }

    /// What the doctor says, with what the unread lines of texts show.
    fn report_of(&self, contrast: Contrast) -> Report {
        let said = self.unread.clone().or_else(|| (0..self.buses).find_map(|bus| unread_says(self.core.reader(bus)?)));
        Report::of(contrast).with_unread(|printed| Some(said?.beside(printed)))
    }

    /// The engine, for the inbox, which feeds it without the interpreter.
    pub(crate) fn core(&mut self) -> &mut Core {
        &mut self.core
    }

    /// Notes the buses that a live run has added.
    pub(crate) fn note_buses(&mut self, statuses: &[LiveStatus]) {
        let numbers = statuses.iter().filter_map(|status| status.number);
        self.buses = numbers.map(|number| number + 1).chain([self.buses]).max().unwrap_or_default();
    }

    /// Raises `IndexError` for a bus that was not added.
    pub(crate) fn check_bus(&self, bus: usize) -> PyResult<()> {
        if bus < self.buses {
            Ok(())
        } else {
            Err(PyIndexError::new_err(format!("bus {bus}: {} were added", self.buses)))
        }
    }
}
