//! Live runs whose ports are in a test's hand.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use modlens_engine::records::{Batch, Bus};
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_recorder::{Counts, Inbox, LiveOptions, LiveRun, Opener, Port, TappedBus};

const S: Ns = 1_000_000_000;
const PATIENCE: Duration = Duration::from_secs(10);

/// A request and its response, with right checksums (Application Protocol V1.1b3, 6.3).
const PAIR: [u8; 15] = [1, 3, 0, 0, 0, 1, 0x84, 0x0A, 1, 3, 2, 0, 7, 0xF9, 0x86];

/// What a test and its port share.
#[derive(Default)]
struct Wire {
    /// Where the port queues its reads, and under which number.
    inbox: Option<(Arc<Inbox>, usize)>,
    /// What the driver has counted, one answer for each question; the last one stays.
    counts: VecDeque<Counts>,
    is_away: bool,
}

/// A port that hears what the test writes.
struct FakePort(Arc<Mutex<Wire>>);

impl Port for FakePort {
    fn listen(&mut self, inbox: &Arc<Inbox>, number: usize) -> Result<(), String> {
        self.0.lock().unwrap().inbox = Some((Arc::clone(inbox), number));
        Ok(())
    }

    fn set_line(&mut self, _: modlens_protocol::line::LineSettings) -> Result<(), String> {
        Ok(())
    }

    fn counters(&self) -> Counts {
        let counts = &mut self.0.lock().unwrap().counts;
        if counts.len() > 1 { counts.pop_front() } else { counts.front().cloned() }.unwrap_or_default()
    }
}

/// A live run of one bus for each wire.
struct Bench {
    wires: Vec<Arc<Mutex<Wire>>>,
    session: Session,
    run: LiveRun,
    said: Vec<String>,
}

impl Bench {
    fn new(wires: usize, options: LiveOptions) -> Self {
        Self::with_counts(wires, options, &[])
    }

    fn with_counts(wires: usize, options: LiveOptions, counts: &[u64]) -> Self {
        let wires: Vec<Arc<Mutex<Wire>>> = (0..wires).map(|_| Arc::default()).collect();
        for &overrun in counts {
            wires[0].lock().unwrap().counts.push_back(Counts::from([("overrun".into(), overrun)]));
        }
        let wanted = WantedTables { frames: true, transactions: true, findings: true };
        let mut session = Session::new(Arc::default(), wanted, true, None);
        let buses = (0..wires.len()).map(|number| tapped(&format!("port{number}"))).collect();
        let run = LiveRun::open(buses, opener(wires.clone()), options, &mut session).unwrap();
        Self { wires, session, run, said: Vec::new() }
    }

    fn arrive(&self, wire: usize, bytes: Option<&[u8]>) {
        let wire = self.wires[wire].lock().unwrap();
        let (inbox, number) = wire.inbox.as_ref().unwrap();
        inbox.put(*number, bytes.map(<[u8]>::to_vec));
    }

    fn step(&mut self) -> Result<Batch, modlens_recorder::PortError> {
        let done = self.run.step(&mut self.session, Duration::from_millis(5));
        self.said.extend(self.run.take_messages());
        done.map(|()| self.session.take())
    }

    /// Steps until the batch or the messages have what is wanted.
    fn until(&mut self, what: &str, mut is_there: impl FnMut(&Batch, &[String]) -> bool) {
        let end = Instant::now() + PATIENCE;
        loop {
            let batch = self.step().unwrap();
            if is_there(&batch, &self.said) {
                return;
            }
            assert!(Instant::now() < end, "{what}: {:?}", self.said);
        }
    }
}

fn tapped(name: &str) -> TappedBus {
    let (name, source) = (name.to_owned(), name.to_owned());
    let bus = Bus { name, source: source.clone(), place: Place::Offset, clock: Clock::Utc, line: None, network: None };
    let line = Some("19200-8E1".parse().unwrap());
    TappedBus { ports: vec![source], options: BusOptions { bus, mode: None, line, resolution: None, rule: None } }
}

fn opener(wires: Vec<Arc<Mutex<Wire>>>) -> Opener {
    Box::new(move |name, _| {
        let wire = &wires[name.trim_start_matches("port").parse::<usize>().unwrap()];
        if wire.lock().unwrap().is_away {
            return Err("no such port".into());
        }
        Ok(Box::new(FakePort(Arc::clone(wire))))
    })
}

fn quick() -> LiveOptions {
    let retries = [Duration::from_millis(1), Duration::from_millis(5)];
    LiveOptions { retries, check_interval: Duration::ZERO, read_interval: Duration::ZERO, ..LiveOptions::default() }
}

fn codes(batch: &Batch) -> Vec<&'static str> {
    batch.findings.iter().map(|finding| finding.finding.doc().code).collect()
}

#[test]
fn a_port_is_lost_and_returns_twenty_times_and_the_other_goes_on() {
    let mut bench = Bench::new(2, quick());
    let mut transactions = 0;
    for turn in 0..20 {
        bench.arrive(0, Some(&PAIR));
        bench.arrive(1, Some(&PAIR));
        let mut seen = 0;
        bench.until("rows of both", |batch, _| {
            seen += batch.transactions.len();
            seen >= 2
        });
        transactions += seen;
        bench.wires[0].lock().unwrap().is_away = true;
        bench.arrive(0, None);
        bench.until("the loss", |_, said| said.iter().filter(|text| text.contains("waiting for it to return")).count() > turn);
        assert!(bench.run.statuses()[0].lost.is_some());
        bench.wires[0].lock().unwrap().is_away = false;
        bench.until("its return", |_, said| said.iter().filter(|text| text.contains("back after")).count() > turn);
        assert!(bench.run.statuses()[0].lost.is_none());
    }
    assert_eq!(transactions, 40);
    // The same reason is reported once for each time that the port was away.
    assert!(bench.said.iter().filter(|text| text.contains("still waiting")).count() <= 20);
}

#[test]
fn what_follows_a_loss_says_so() {
    let mut bench = Bench::new(1, quick());
    bench.arrive(0, Some(&PAIR));
    bench.arrive(0, None);
    bench.until("the loss", |_, said| !said.is_empty());
    bench.until("its return", |_, said| said.iter().any(|text| text.contains("back after")));
    bench.arrive(0, Some(&PAIR));
    bench.until("the finding", |batch, _| codes(batch).contains(&"lost_bytes"));
}

#[test]
fn without_waiting_the_loss_is_an_error_with_the_name_of_the_port() {
    let mut bench = Bench::new(2, LiveOptions { reconnect: false, ..quick() });
    bench.arrive(1, None);
    let error = bench.step().unwrap_err();
    assert_eq!((error.port.as_str(), error.reason.contains("lost")), ("port1", true));
}

#[test]
fn overruns_are_reported_and_marked_but_not_those_before_the_tap() {
    let mut bench = Bench::with_counts(1, quick(), &[7, 7, 9]);
    bench.until("the message", |_, said| !said.is_empty());
    assert_eq!(bench.said, ["port0: the driver lost bytes 2 times (overrun of the chip)"]);
    bench.arrive(0, Some(&PAIR));
    bench.until("the finding", |batch, _| codes(batch).contains(&"lost_bytes"));
    assert_eq!(bench.run.statuses()[0].error_counts["overrun"], 2);
}

#[test]
fn a_sleep_of_the_machine_is_a_loss_and_times_follow_at_once() {
    let mut bench = Bench::new(1, quick());
    let before = modlens_recorder::Clock::new(modlens_recorder::clock::Moment::now());
    bench.run.pretend(3600 * S, 3600 * S);
    bench.until("the message", |_, said| !said.is_empty());
    assert_eq!(bench.said, ["the machine slept for 3600.0 s; traffic in the meantime is lost"]);
    bench.arrive(0, Some(&PAIR));
    let mut time = 0;
    bench.until("the row", |batch, _| {
        time = batch.transactions.first().map_or(time, |row| row.start.unwrap_or_default());
        time != 0
    });
    let shift = time - before.utc(modlens_recorder::clock::monotonic_ns());
    assert!((shift - 3600 * S).abs() < S, "{shift}");
}

#[test]
fn a_clock_that_is_set_forward_is_no_loss_and_is_followed_at_a_pause() {
    let mut bench = Bench::new(1, LiveOptions { idle_ns: S / 5, ..quick() });
    bench.arrive(0, Some(&PAIR));
    bench.until("the row", |batch, _| !batch.transactions.is_empty());
    bench.run.pretend(3600 * S, 0);
    bench.until("the message", |_, said| !said.is_empty());
    assert!(bench.said[0].starts_with("the clock was set forward by 3600.0 s"), "{:?}", bench.said);
    std::thread::sleep(Duration::from_millis(400));
    bench.step().unwrap();
    bench.arrive(0, Some(&PAIR));
    bench.until("a row", |batch, _| {
        assert!(!codes(batch).contains(&"lost_bytes"));
        !batch.transactions.is_empty()
    });
}
