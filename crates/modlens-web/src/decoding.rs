//! One recording: what it is read for, and the rows that were kept.

use std::sync::Arc;

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::report::Report;
use modlens_engine::folding::Folder;
use modlens_engine::records::Batch;
use modlens_engine::session::{Session, WantedTables};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_recording::format::Refusal;
use modlens_recording::{Options, Recording};
use modlens_report::Parts;
use modlens_tables::overview::Overview;
use modlens_writers::capture::{Capture, CaptureOptions, Encapsulation};
use modlens_writers::BLOCK_BYTES;
use serde_json::{json, Value as Json};

use crate::export::Export;
use crate::port::Port;
use crate::registers::plan;
use crate::view::Views;

/// What a recording is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// All: rows of every table are kept, causes are sought.
    All,
    /// The same of a large recording: rows are kept in little memory, those of frames are not.
    Large,
    /// A capture is written, no row is kept.
    Capture,
    /// A line that is listened to: the newest rows of every table are kept, causes are sought.
    Live,
}

/// Transactions that are kept of a line that is listened to.
const LIVE_ROWS: usize = 200_000;

/// A recording that is being read, or has been.
pub struct Decoding {
    purpose: Purpose,
    pub(crate) functions: Arc<Functions>,
    session: Session,
    recording: Recording,
    contrast: Option<Contrast>,
    overview: Option<Overview>,
    report: Option<Report>,
    pub(crate) views: Views,
    rows: usize,
    /// Transactions that are kept, and whole batches beside them; `None` for all.
    most_rows: Option<usize>,
    folder: Folder,
    capture: Option<Capture>,
    pub(crate) captured: Vec<u8>,
    pub(crate) mode: Option<Mode>,
    pub(crate) port: Option<Port>,
    pub(crate) export: Option<Export>,
}

impl Decoding {
    /// Opens a recording. Settings: `name`; `purpose` (all, large, capture, live); `format`, `mode`, `line`, `ports` where
    /// the user knows them; `profiles` (text, form, units or null for all). The message says what is wrong with them.
    pub fn open(settings: &Json) -> Result<Self, String> {
        let purpose = match settings["purpose"].as_str().unwrap_or("all") {
            "all" => Purpose::All,
            "large" => Purpose::Large,
            "capture" => Purpose::Capture,
            "live" => Purpose::Live,
            other => return Err(format!("purpose {other:?} is not one of all, large, capture, live")),
        };
        let seeks_causes = purpose != Purpose::Capture;
        let wanted = WantedTables { frames: true, transactions: true, findings: true };
        let functions = Arc::new(Functions::default());
        let mut session = Session::new(Arc::clone(&functions), wanted, purpose == Purpose::Live, None);
        if purpose == Purpose::Large {
            session.emit_compact();
        }
        for profile in settings["profiles"].as_array().into_iter().flatten() {
            let named =
                profile["units"].as_array().map(|units| units.iter().filter_map(|unit| u8::try_from(unit.as_u64()?).ok()));
            let units = named.map_or_else(|| (0..=u8::MAX).collect::<Vec<u8>>(), Iterator::collect);
            session.bind(None, &units, &plan(profile)?);
        }
        let options = options(settings)?;
        Ok(Self {
            purpose,
            functions,
            session,
            mode: options.mode,
            port: None,
            recording: Recording::new(Options { is_live: purpose == Purpose::Live, ..options }),
            contrast: seeks_causes.then(Contrast::default),
            overview: seeks_causes.then(Overview::default),
            report: None,
            views: Views::default(),
            rows: 0,
            most_rows: (purpose == Purpose::Live).then_some(LIVE_ROWS),
            folder: Folder::default(),
            capture: (purpose == Purpose::Capture).then(capture_writer),
            captured: Vec::new(),
            export: None,
        })
    }

    /// Decodes the next bytes, and returns how many transactions have been decided so far.
    pub fn feed(&mut self, block: &[u8]) -> Result<usize, String> {
        self.recording.feed(&mut self.session, block).map_err(message)?;
        self.take();
        Ok(self.rows)
    }

    /// Keeps the newest transactions only from now on: three of four of those that there are now.
    pub fn keep_newest(&mut self) {
        self.most_rows = Some(self.rows / 4 * 3);
    }

    /// Ends the recording, and returns how many transactions it has.
    pub fn finish(&mut self) -> Result<usize, String> {
        self.recording.finish(&mut self.session).map_err(message)?;
        // The recording of a tap may go on in another file, but not here.
        self.session.flush();
        self.take();
        self.report = self.contrast.take().map(|contrast| self.report_of(contrast));
        if let Some(report) = &self.report {
            let mut batch = self.session.take();
            batch.diagnoses = report.rows().to_vec();
            self.views.add(Arc::new(batch));
        }
        if let Some(capture) = &mut self.capture {
            capture.finish(&mut self.captured);
        }
        Ok(self.rows)
    }

    /// What the doctor says, with what the unread lines of a text show.
    fn report_of(&self, contrast: Contrast) -> Report {
        let said = self.recording.unread(&self.session);
        Report::of(contrast).with_unread(|printed| Some(said?.beside(printed)))
    }

    /// The document of the recording so far.
    pub fn document(&self) -> Json {
        let made;
        let report = match (&self.report, &self.contrast) {
            (None, Some(contrast)) => {
                made = self.report_of(contrast.clone());
                Some(&made)
            }
            (report, _) => report.as_ref(),
        };
        let examples = report.map_or_else(Vec::new, Report::examples);
        let mut core = json!({});
        core["doctor"] = report.map(Report::json).into();
        core["statistics"] = self.session.stats_json();
        core["overview"] = self.overview.as_ref().map(|overview| overview.json(&examples)).into();
        let statuses = [self.recording.status(&self.session)];
        let known = if statuses[0].is_null() { &[][..] } else { &statuses[..] };
        modlens_report::document(Parts { core, statuses: known, functions: &self.functions, title: None })
    }

    /// Appends the next bytes of the capture or recording that is being written, or of the export of rows.
    pub fn export_more(&mut self, out: &mut Vec<u8>) {
        if self.capture.is_some() || !self.captured.is_empty() {
            out.append(&mut self.captured);
        } else if let Some(export) = &mut self.export {
            export.more(out);
        }
    }

    /// Takes the rows that were decided.
    fn take(&mut self) {
        let mut batch = self.session.take();
        self.rows += batch.transaction_count();
        if let Some(contrast) = &mut self.contrast {
            contrast.observe(&batch);
        }
        if let Some(overview) = &mut self.overview {
            overview.observe(&batch);
        }
        if self.purpose == Purpose::Large {
            batch.forget_frames();
            self.folder.fold(&mut batch);
        }
        let is_kept = self.purpose != Purpose::Capture && !is_empty(&batch);
        if is_kept {
            batch.shrink();
        }
        let batch = Arc::new(batch);
        if let Some(capture) = &mut self.capture {
            capture.add_batch(&batch, None);
            capture.append_ready(BLOCK_BYTES, &mut self.captured);
        }
        if is_kept {
            self.views.add(batch);
        }
        if let Some(most) = self.most_rows {
            self.views.forget_all_but(most, self.purpose != Purpose::Live);
        }
    }
}

fn is_empty(batch: &Batch) -> bool {
    let counts = [batch.frames.len(), batch.transaction_count(), batch.findings.len(), batch.connections.len()];
    counts.iter().all(|&count| count == 0)
}

fn capture_writer() -> Capture {
    Capture::new(CaptureOptions {
        style: Encapsulation::Udp,
        classic: false,
        live: false,
        context: 0,
        application: format!("modlens {}", env!("CARGO_PKG_VERSION")),
    })
}

fn message(refusal: Refusal) -> String {
    match refusal {
        Refusal::NoSuchFormat(name) => format!("{name}: no such format"),
        Refusal::Unfit(why) => why,
    }
}

fn options(settings: &Json) -> Result<Options, String> {
    let mode = match settings["mode"].as_str() {
        None | Some("" | "auto") => None,
        Some(name) => Some(Mode::from_text(name).ok_or_else(|| format!("mode {name:?} is not one of auto, rtu, ascii, tcp"))?),
    };
    let line = settings["line"].as_str().filter(|text| !text.is_empty()).map(str::parse).transpose()?;
    let ports = settings["ports"].as_array();
    let ports = ports.map(|ports| ports.iter().filter_map(|port| u16::try_from(port.as_u64()?).ok()).collect());
    Ok(Options {
        name: settings["name"].as_str().unwrap_or("recording").to_owned(),
        format: settings["format"].as_str().filter(|format| !format.is_empty()).map(ToOwned::to_owned),
        mode,
        line,
        ports,
        ..Options::default()
    })
}
