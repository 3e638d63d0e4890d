//! A tap of one bus: the live run of the recorder's crate, its rows to the outputs, its reads to the recording.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;

use modlens_engine::records::Bus;
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::source::{Clock, Place};
use modlens_recorder::{
    Feed, LiveOptions, LiveRun, Opener, PortError, Recorder, RecorderOptions, Remote, Server, TappedBus, Tty, REMOTE_SCHEME,
};

use crate::options::Options;
use crate::outlet::{drain_messages, say};
use crate::rows::Rows;

const WAIT: Duration = Duration::from_millis(50);
const CLOSE: Duration = Duration::from_secs(5);
/// A gateway has little memory.
const QUEUE_BYTES: usize = 1 << 24;

const OUTPUT_TROUBLE: u8 = 3;
const PORT_TROUBLE: u8 = 4;

/// Listens until a signal or `--count` ends it; returns the exit status.
pub fn run(options: &Options) -> u8 {
    let stop = Arc::new(AtomicBool::new(false));
    let status = match heed_signals(&stop).map_err(|error| failed("signals", &error)).and_then(|()| tap(options, &stop)) {
        Ok(status) => status,
        Err(Trouble { message, status }) => {
            say(&format!("modlens-tap: {message}"));
            status
        }
    };
    drain_messages(&stop);
    status
}

/// What ends the program, and its exit status.
struct Trouble {
    message: String,
    status: u8,
}

fn failed(what: &str, error: &io::Error) -> Trouble {
    Trouble { message: format!("{what}: {error}"), status: OUTPUT_TROUBLE }
}

fn lost(error: PortError) -> Trouble {
    Trouble { message: error.to_string(), status: PORT_TROUBLE }
}

/// The first signal stops the tap, the second one ends the process. A limit of the file size is an error of the write.
fn heed_signals(stop: &Arc<AtomicBool>) -> io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(stop))?;
        signal_hook::flag::register(signal, Arc::clone(stop))?;
    }
    signal_hook::flag::register(SIGXFSZ, Arc::default())?;
    Ok(())
}

fn tap(options: &Options, stop: &AtomicBool) -> Result<u8, Trouble> {
    // The row of the day counts frames, too.
    let wanted = WantedTables { frames: options.broker.is_some(), transactions: true, findings: false };
    let mut session = Session::new(Arc::default(), wanted, true, None);
    let live_options = LiveOptions { queue_bytes: QUEUE_BYTES, ..LiveOptions::default() };
    let mut run = LiveRun::open(vec![tapped(options)], opener(options), live_options, &mut session).map_err(lost)?;
    let mut rows = Rows::open(options).map_err(|error| failed("output", &error))?;
    // The recording begins only when the port is open, so that no empty file is left where that fails.
    let mut recorder = record(options).map_err(|error| failed("--record", &error))?;
    let mut servers = serve(options)?;
    run.record(Feed::join(recorder.iter().map(Recorder::feed).chain(servers.iter().map(Server::feed))));
    let at = options.line.map_or(String::new(), |line| format!(" at {line}"));
    say(&format!("{}: listening to {}{at}; nothing is sent", options.bus, options.port));
    let mut ended = Ok(());
    while ended.is_ok() && !stop.load(Ordering::Relaxed) && !rows.is_done() {
        ended = run.step(&mut session, WAIT);
        rows.put(session.take());
        run.take_messages()
            .iter()
            .chain(&recorder.iter().flat_map(Recorder::take_messages).collect::<Vec<_>>())
            .chain(&servers.iter().flat_map(Server::take_messages).collect::<Vec<_>>())
            .for_each(|text| say(text));
    }
    run.finish(&mut session);
    rows.put(session.take());
    run.take_messages().iter().for_each(|text| say(text));
    servers.iter_mut().for_each(Server::close);
    let is_recorded = recorder.as_mut().is_none_or(|recorder| close_recording(options, recorder));
    say(&format!("{}: {} transactions", options.bus, rows.count));
    let is_delivered = rows.close(stop);
    ended.map_err(lost)?;
    Ok(if is_recorded && is_delivered { 0 } else { OUTPUT_TROUBLE })
}

/// The bus and how it is decoded.
fn tapped(options: &Options) -> TappedBus {
    let (name, source) = (options.bus.clone(), options.port.clone());
    let bus = Bus { name, source, place: Place::Offset, clock: Clock::Utc, line: options.line, network: None };
    let options = BusOptions { bus, mode: options.mode, line: options.line, resolution: None, rule: None };
    TappedBus { ports: vec![options.bus.source.clone()], options }
}

/// Begins the recording, if there is to be one.
fn record(options: &Options) -> io::Result<Option<Recorder>> {
    let Some(path) = &options.record else { return Ok(None) };
    let (rotation, retention) = (options.rotation, options.retention);
    Recorder::start(RecorderOptions { rotation, retention, ..RecorderOptions::new(path) }).map(Some)
}

/// Begins to serve the reads, to programs and to browsers, as far as that is wanted.
fn serve(options: &Options) -> Result<Vec<Server>, Trouble> {
    let mut servers = Vec::new();
    if let Some(wanted) = &options.serve {
        let server = Server::start(wanted.clone()).map_err(|error| failed("--serve", &error))?;
        say(&format!("{}: serving at {}", options.bus, server.address()));
        servers.push(server);
    }
    if let Some(wanted) = &options.web {
        let server = Server::start(wanted.clone()).map_err(|error| failed("--web", &error))?;
        say(&format!("{}: open {} in a browser", options.bus, server.url()));
        servers.push(server);
    }
    Ok(servers)
}

/// Opens a serial port, or a line that another tap serves.
fn opener(options: &Options) -> Opener {
    let token = options.serve_token.clone();
    Box::new(move |name, line| {
        if name.starts_with(REMOTE_SCHEME) {
            return Ok(Box::new(Remote::open(name, token.as_deref())?));
        }
        Ok(Box::new(Tty::open(name, line)?))
    })
}

/// Completes the recording; whether nothing went wrong with it at any time.
fn close_recording(options: &Options, recorder: &mut Recorder) -> bool {
    let status = recorder.close(CLOSE);
    recorder.take_messages().iter().for_each(|text| say(text));
    say(&format!("{}: {} bytes recorded, {} lost", options.bus, status.recorded, status.lost));
    !status.had_trouble && status.lost == 0
}
