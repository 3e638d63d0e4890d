//! Live runs: the loop of the recorder's crate, with ports that Python opens.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use modlens_engine::framer::silence::SilenceRule;
use modlens_engine::records::Bus;
use modlens_engine::session::BusOptions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};
use modlens_recorder::{
    advice, Counts, Feed, Inbox as Reads, LiveOptions, LiveRun as Core, LiveStatus, Opener, Port, PortError, TappedBus,
};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use crate::arguments::{line_settings, value_error, SettingsTuple};
use crate::inbox::Inbox;
use crate::recorder::Recorder;
use crate::server::Server;
use crate::session::{framing, Session};

/// A bus as Python names it: name, source, ports, framing, line settings, silences of 3.5 and 1.5 characters in ns.
type BusTuple = (String, String, Vec<String>, String, Option<SettingsTuple>, Option<(i64, i64)>);

/// Status of a bus: name, number, line settings, their origin, seconds for which a port has been away, drivers' counts.
type StatusTuple = (String, Option<usize>, Option<String>, &'static str, Option<f64>, Counts);

/// A port that Python has opened (`analyzer.sources.schemes.LivePort`).
struct PythonPort {
    name: String,
    port: Py<PyAny>,
}

impl PythonPort {
    /// Calls something of the port; the reason where that fails.
    fn with<T>(&self, call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>) -> Result<T, String> {
        Python::attach(|py| call(self.port.bind(py)).map_err(|error| reason(py, &error, &self.name)))
    }
}

impl Port for PythonPort {
    fn listen(&mut self, inbox: &Arc<Reads>, number: usize) -> Result<(), String> {
        let inbox = Inbox { reads: Arc::clone(inbox) };
        self.with(|port| port.call_method1("listen", (inbox, number)).map(drop))
    }

    fn set_line(&mut self, line: LineSettings) -> Result<(), String> {
        self.with(|port| port.call_method1("set_line", (line.to_string(),)).map(drop))
    }

    fn takes_line_settings(&self) -> bool {
        self.with(|port| port.getattr("takes_line_settings")?.is_truthy()).unwrap_or(false)
    }

    fn marks_errors(&self) -> bool {
        self.with(|port| port.getattr("marks_errors")?.is_truthy()).unwrap_or(false)
    }

    fn counters(&self) -> Counts {
        self.with(|port| port.call_method0("counters")?.extract()).unwrap_or_default()
    }

    fn advice(&self) -> String {
        self.with(|port| port.getattr("advice")?.extract()).unwrap_or_default()
    }

    fn line(&self) -> Option<LineSettings> {
        let line: Option<String> = self.with(|port| port.getattr("line")?.extract()).ok()?;
        line?.parse().ok()
    }

    fn has_two_lines(&self) -> bool {
        self.with(|port| port.getattr("has_two_lines")?.is_truthy()).unwrap_or(false)
    }

    fn stop(&mut self) {
        let _ = self.with(|port| port.call_method0("stop").map(drop));
    }
}

impl Drop for PythonPort {
    fn drop(&mut self) {
        let _ = self.with(|port| port.call_method0("close").map(drop));
    }
}

/// What an error of Python says, without the name of the port before it.
fn reason(py: Python<'_>, error: &PyErr, port: &str) -> String {
    let text = error.value(py).to_string();
    text.strip_prefix(&format!("{port}: ")).unwrap_or(&text).to_owned()
}

/// An opener that calls a function of Python.
fn opener(open_port: Py<PyAny>) -> Opener {
    Box::new(move |name, line| {
        Python::attach(|py| {
            let port = open_port.call1(py, (name, line.map(|line| line.to_string())));
            let port = port.map_err(|error| reason(py, &error, name))?;
            Ok(Box::new(PythonPort { name: name.to_owned(), port }) as Box<dyn Port>)
        })
    })
}

/// Listens to ports; its rows are in the session.
#[pyclass(frozen, module = "_modlens")]
pub struct LiveRun {
    core: Mutex<Core>,
}

#[pymethods]
impl LiveRun {
    #[new]
    #[pyo3(signature = (session, buses, open_port, *, reconnect=true, detect=false, idle_ns=0))]
    fn new(
        py: Python<'_>,
        session: &mut Session,
        buses: Vec<BusTuple>,
        open_port: Py<PyAny>,
        reconnect: bool,
        detect: bool,
        idle_ns: i64,
    ) -> PyResult<Self> {
        let buses = buses.into_iter().map(tapped_bus).collect::<PyResult<Vec<_>>>()?;
        let idle_ns = idle_ns.saturating_add(modlens_recorder::IDLE_NS);
        let options = LiveOptions { reconnect, detect, idle_ns, ..LiveOptions::default() };
        let core = py.detach(|| Core::open(buses, opener(open_port), options, session.core())).map_err(port_error)?;
        session.note_buses(&core.statuses());
        Ok(Self { core: Mutex::new(core) })
    }

    fn step(&self, py: Python<'_>, session: &mut Session, timeout: f64) -> PyResult<()> {
        let timeout = Duration::from_secs_f64(timeout.clamp(0.0, 3600.0));
        let engine = session.core();
        let (done, statuses) = self.with(py, |core| (core.step(engine, timeout), core.statuses()));
        session.note_buses(&statuses);
        done.map_err(port_error)
    }

    fn finish(&self, py: Python<'_>, session: &mut Session) {
        let engine = session.core();
        let statuses = self.with(py, |core| {
            core.finish(engine);
            core.statuses()
        });
        session.note_buses(&statuses);
    }

    #[pyo3(signature = (recorder=None, servers=None))]
    fn record(&self, py: Python<'_>, recorder: Option<&Recorder>, servers: Option<Vec<PyRef<'_, Server>>>) {
        let feeds = recorder.map(Recorder::feed).into_iter().chain(servers.iter().flatten().map(|server| server.feed()));
        let feed = Feed::join(feeds);
        self.with(py, |core| core.record(feed));
    }

    fn take_messages(&self, py: Python<'_>) -> Vec<String> {
        self.with(py, Core::take_messages)
    }

    fn statuses(&self, py: Python<'_>) -> Vec<StatusTuple> {
        self.with(py, |core| core.statuses()).into_iter().map(status_tuple).collect()
    }

    fn pretend(&self, py: Python<'_>, wall_ns: i64, suspended_ns: i64) {
        self.with(py, |core| core.pretend(wall_ns, suspended_ns));
    }

    fn close(&self, py: Python<'_>) {
        self.with(py, Core::close);
    }
}

impl LiveRun {
    /// Uses the loop without Python's lock: its thread may need that to call a port.
    fn with<T: Send>(&self, py: Python<'_>, use_core: impl FnOnce(&mut Core) -> T + Send) -> T {
        py.detach(|| use_core(&mut self.core.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

fn tapped_bus((name, source, ports, mode, line, silence_ns): BusTuple) -> PyResult<TappedBus> {
    let line = line.map(line_settings).transpose()?;
    let bus = Bus { name, source, place: Place::Offset, clock: Clock::Utc, line: None, network: None };
    let rule = silence_ns.map(|(t35_ns, t15_ns)| SilenceRule { t35_ns, t15_ns });
    Ok(TappedBus { ports, options: BusOptions { bus, mode: framing(&mode)?, line, resolution: None, rule } })
}

fn status_tuple(status: LiveStatus) -> StatusTuple {
    let line = status.line.map(|line| line.to_string());
    let lost = status.lost.map(|lost| lost.as_secs_f64());
    (status.bus, status.number, line, status.origin.text(), lost, status.error_counts)
}

/// An `OSError` whose two arguments are the port and the reason.
fn port_error(error: PortError) -> PyErr {
    PyOSError::new_err((error.port, error.reason))
}

/// A port that the core has opened (`analyzer.sources.schemes.LivePort`).
#[pyclass(subclass, module = "_modlens")]
pub struct CorePort {
    port: Mutex<Option<Box<dyn Port>>>,
}

#[pymethods]
impl CorePort {
    fn listen(&self, inbox: &Inbox, number: usize) -> PyResult<()> {
        self.with(|port| port.listen(&inbox.reads, number))?.map_err(PyOSError::new_err)
    }

    fn set_line(&self, line: &str) -> PyResult<()> {
        let line = line.parse().map_err(value_error)?;
        self.with(|port| port.set_line(line))?.map_err(PyOSError::new_err)
    }

    #[getter]
    fn line(&self) -> Option<String> {
        Some(self.with(|port| port.line()).ok()??.to_string())
    }

    #[getter]
    fn has_two_lines(&self) -> bool {
        self.with(|port| port.has_two_lines()).unwrap_or_default()
    }

    #[getter]
    fn takes_line_settings(&self) -> bool {
        self.with(|port| port.takes_line_settings()).unwrap_or_default()
    }

    #[getter]
    fn marks_errors(&self) -> bool {
        self.with(|port| port.marks_errors()).unwrap_or_default()
    }

    #[getter]
    fn advice(&self) -> String {
        self.with(|port| port.advice()).unwrap_or_default()
    }

    fn counters(&self) -> Counts {
        self.with(|port| port.counters()).unwrap_or_default()
    }

    fn stop(&self, py: Python<'_>) {
        py.detach(|| self.with(|port| port.stop()).unwrap_or_default());
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| *self.port.lock().unwrap_or_else(PoisonError::into_inner) = None);
    }
}

impl CorePort {
    fn new(port: impl Port + 'static) -> Self {
        Self { port: Mutex::new(Some(Box::new(port))) }
    }

    /// Uses the port; an error if it is closed.
    fn with<T>(&self, use_port: impl FnOnce(&mut dyn Port) -> T) -> PyResult<T> {
        let mut port = self.port.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(use_port(port.as_deref_mut().ok_or_else(|| PyOSError::new_err("the port is closed"))?))
    }
}

/// A serial port of this machine, for reading only. Linux only; elsewhere Python opens them.
#[pyclass(extends = CorePort, module = "_modlens")]
pub struct Tty;

#[pymethods]
impl Tty {
    #[cfg(target_os = "linux")]
    #[new]
    #[pyo3(signature = (name, line=None))]
    fn new(py: Python<'_>, name: &str, line: Option<&str>) -> PyResult<PyClassInitializer<Self>> {
        let line = line.map(str::parse).transpose().map_err(value_error)?;
        let port = py.detach(|| modlens_recorder::Tty::open(name, line)).map_err(PyOSError::new_err)?;
        Ok(PyClassInitializer::from(CorePort::new(port)).add_subclass(Self))
    }
}

/// A line that another tap serves.
#[pyclass(extends = CorePort, module = "_modlens")]
pub struct Remote;

#[pymethods]
impl Remote {
    #[new]
    #[pyo3(signature = (name, token=None))]
    fn new(py: Python<'_>, name: &str, token: Option<&str>) -> PyResult<PyClassInitializer<Self>> {
        let port = py.detach(|| modlens_recorder::Remote::open(name, token)).map_err(PyOSError::new_err)?;
        Ok(PyClassInitializer::from(CorePort::new(port)).add_subclass(Self))
    }
}

/// What the user can do about an error of the system, by its number; `None` where there is nothing to say.
#[pyfunction]
#[pyo3(signature = (number, line=None))]
pub fn port_advice(number: i32, line: Option<&str>) -> Option<String> {
    advice(number, line.and_then(|line| line.parse().ok()))
}

/// Milliseconds for which an adapter may hold bytes back; `None` where it has no such timer.
#[pyfunction]
pub fn latency_timer(name: &str) -> Option<u32> {
    #[cfg(target_os = "linux")]
    return modlens_recorder::latency_timer(name);
    #[cfg(not(target_os = "linux"))]
    return name.is_empty().then_some(0).filter(|_| false);
}
