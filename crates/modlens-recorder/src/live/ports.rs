//! The ports of a live run: opened, lost and opened again, with the errors that their drivers count.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use modlens_protocol::decimal::thousands;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

use super::options::LiveOptions;
use crate::clock::ClockChange;
use crate::inbox::Inbox;
use crate::port::{loss_reason, Counts, Opener, Port, PortError};
use crate::queue::Read;

/// One port.
struct Slot {
    name: String,
    bus: usize,
    /// 1 or 2 where a bus is tapped on two lines, else 0.
    side: u8,
    line: Option<LineSettings>,
    /// `None` while it is lost.
    port: Option<Box<dyn Port>>,
    /// Its reads come through the port before it, which is tapped on two lines.
    is_second_line: bool,
    lost_at: Instant,
    next_retry: Instant,
    /// The last message about it, so that none is repeated.
    last_message: String,
    /// The driver's counters at the last check, and what they have gained since the beginning.
    last_counts: Counts,
    error_counts: Counts,
}

impl Slot {
    /// Whether it was lost and has not returned.
    fn is_lost(&self) -> bool {
        self.port.is_none() && !self.is_second_line
    }
}

/// The ports of a live run.
pub(super) struct Ports {
    pub(super) inbox: Arc<Inbox>,
    /// Sentences for the user.
    pub(super) messages: Vec<String>,
    slots: Vec<Slot>,
    opener: Opener,
    options: LiveOptions,
    next_check: Instant,
    /// Bytes that did not fit into the inbox at the last check.
    dropped: u64,
}

impl Ports {
    pub(super) fn new(opener: Opener, options: LiveOptions) -> Self {
        let inbox = Arc::new(Inbox::new(options.queue_bytes));
        inbox.set_idle_ns(options.idle_ns);
        let next_check = Instant::now();
        Self { inbox, messages: Vec::new(), slots: Vec::new(), opener, options, next_check, dropped: 0 }
    }

    /// Opens a port of a bus and begins to read it.
    pub(super) fn open(&mut self, name: &str, bus: usize, side: u8, line: Option<LineSettings>) -> Result<(), PortError> {
        let now = Instant::now();
        let error = |reason| PortError { port: name.to_owned(), reason };
        let port = (self.opener)(name, line).map_err(error)?;
        let has_two_lines = port.has_two_lines();
        if has_two_lines && side != 0 {
            return Err(error("it is tapped on two lines already, and is a bus by itself".into()));
        }
        let line = line.or_else(|| port.line());
        let slot = |side: u8, port: Option<Box<dyn Port>>| Slot {
            name: name.to_owned(),
            bus,
            side,
            line,
            is_second_line: port.is_none(),
            port,
            lost_at: now,
            next_retry: now,
            last_message: String::new(),
            last_counts: Counts::new(),
            error_counts: Counts::new(),
        };
        let number = self.slots.len();
        self.slots.push(slot(if has_two_lines { 1 } else { side }, Some(port)));
        if has_two_lines {
            self.slots.push(slot(2, None));
        }
        self.begin(number).map_err(error)
    }

    /// Begins to read a port that was opened.
    fn begin(&mut self, number: usize) -> Result<(), String> {
        let slot = &mut self.slots[number];
        let Some(port) = &mut slot.port else { return Ok(()) };
        slot.last_counts = port.counters();
        let advice = port.advice();
        if !advice.is_empty() && advice != slot.last_message {
            self.messages.push(format!("{}: {advice}", slot.name));
            slot.last_message = advice;
        }
        port.listen(&self.inbox, number)
    }

    pub(super) fn take(&self, timeout: Duration) -> VecDeque<Read> {
        self.inbox.take(timeout, self.options.read_interval)
    }

    /// Ends the readers; what they have read, the ends of ports among it.
    pub(super) fn drain(&mut self) -> VecDeque<Read> {
        self.slots.iter_mut().filter_map(|slot| slot.port.as_mut()).for_each(|port| port.stop());
        self.inbox.close();
        self.inbox.take(Duration::ZERO, Duration::ZERO)
    }

    pub(super) fn close(&mut self) {
        self.drain();
        self.slots.iter_mut().for_each(|slot| slot.port = None);
    }

    /// Closes a port that was lost with this error, and waits for it, or says that it is lost.
    pub(super) fn lose(&mut self, number: usize, error: u32) -> Result<(), PortError> {
        self.inbox.end(number);
        let slot = &mut self.slots[number];
        slot.port = None;
        slot.lost_at = Instant::now();
        slot.next_retry = slot.lost_at + self.options.retries[0];
        let error = PortError { port: slot.name.clone(), reason: loss_reason(error) };
        if !self.options.reconnect {
            return Err(error);
        }
        self.messages.push(format!("{error}; waiting for it to return"));
        Ok(())
    }

    /// Tries to open lost ports again, and looks at clocks and counters when it is time to.
    pub(super) fn maintain(&mut self) {
        let now = Instant::now();
        for number in 0..self.slots.len() {
            if self.slots[number].is_lost() && now >= self.slots[number].next_retry {
                self.reopen(number);
            }
        }
        if now >= self.next_check {
            self.next_check = now + self.options.check_interval;
            self.check_clocks();
            self.check_inbox();
            (0..self.slots.len()).for_each(|number| self.count_errors(number));
        }
    }

    /// Tries to open a lost port again; its next read follows a loss. A message is given only where the error differs from
    /// the last one.
    fn reopen(&mut self, number: usize) {
        let last = number + usize::from(self.has_two_lines(number));
        let opened = (self.opener)(&self.slots[number].name, self.slots[number].line).and_then(|port| {
            if port.has_two_lines() != (last > number) {
                return Err("it is not tapped on as many lines as when this tap began; restart this tap".into());
            }
            self.slots[number].port = Some(port);
            (number..=last).for_each(|number| self.inbox.hole(number));
            self.begin(number)
        });
        let slot = &mut self.slots[number];
        match opened {
            Ok(()) => {
                let away = slot.lost_at.elapsed().as_secs_f64();
                let text = format!("{}: back after {away:.1} s; traffic in the meantime is lost", slot.name);
                self.messages.push(text);
            }
            Err(reason) => {
                slot.port = None;
                slot.next_retry = Instant::now() + self.options.retries[1];
                if reason != slot.last_message {
                    self.messages.push(format!("{}: {reason}; still waiting", slot.name));
                    slot.last_message = reason;
                }
            }
        }
    }

    /// Reports suspensions and steps of the clock, which the inbox has followed or will.
    fn check_clocks(&mut self) {
        let changes = self.inbox.check_clocks();
        self.messages.extend(changes.into_iter().flat_map(clock_messages));
    }

    fn check_inbox(&mut self) {
        let dropped = self.inbox.lost();
        if dropped > self.dropped {
            let more = thousands(dropped - self.dropped);
            self.messages.push(format!("{more} bytes lost: the input queue was full"));
            self.dropped = dropped;
        }
    }

    /// Adds what the driver's counters have gained since the last check; an overrun is a loss.
    fn count_errors(&mut self, number: usize) {
        let slot = &mut self.slots[number];
        let Some(port) = &slot.port else { return };
        let counts: Counts = port.counters();
        for (name, count) in &counts {
            let more = count.saturating_sub(*slot.last_counts.get(name).unwrap_or(count));
            if more == 0 {
                continue;
            }
            *slot.error_counts.entry(name.clone()).or_default() += more;
            if name.contains("overrun") {
                self.inbox.hole(number);
                self.messages.push(format!("{}: the driver lost bytes {more} times ({})", slot.name, overrun(name)));
            }
        }
        slot.last_counts = counts;
    }

    /// Forgets the errors counted so far.
    pub(super) fn reset_error_counts(&mut self, number: usize) {
        let slot = &mut self.slots[number];
        if let Some(port) = &slot.port {
            slot.last_counts = port.counters();
        }
        slot.error_counts.clear();
    }

    /// Changes the line settings of a port; they are also used when it is opened again. A port that does not take them is
    /// still worth listening to.
    pub(super) fn set_line(&mut self, number: usize, line: LineSettings) {
        let slot = &mut self.slots[number];
        slot.line = Some(line);
        if let Some(Err(reason)) = slot.port.as_mut().map(|port| port.set_line(line)) {
            self.messages.push(format!("{}: {reason}", slot.name));
        }
    }

    pub(super) fn takes_line_settings(&self, number: usize) -> bool {
        self.slots[number].port.as_ref().is_some_and(|port| port.takes_line_settings())
    }

    pub(super) fn marks_errors(&self, number: usize) -> bool {
        self.slots[number].port.as_ref().is_some_and(|port| port.marks_errors())
    }

    pub(super) fn count(&self) -> usize {
        self.slots.len()
    }

    /// Whether the reads of the next port come through this one.
    fn has_two_lines(&self, number: usize) -> bool {
        self.slots.get(number + 1).is_some_and(|next| next.is_second_line)
    }

    pub(super) fn name(&self, number: usize) -> &str {
        &self.slots[number].name
    }

    pub(super) fn bus(&self, number: usize) -> usize {
        self.slots[number].bus
    }

    pub(super) fn side(&self, number: usize) -> u8 {
        self.slots[number].side
    }

    pub(super) fn line(&self, number: usize) -> Option<LineSettings> {
        self.slots[number].line
    }

    pub(super) fn error_counts(&self, number: usize) -> &Counts {
        &self.slots[number].error_counts
    }

    /// For how long a port has been away.
    pub(super) fn lost(&self, number: usize) -> Option<Duration> {
        let slot = &self.slots[number];
        slot.is_lost().then(|| slot.lost_at.elapsed())
    }

    /// The time before which all reads have come, where reads take `lag` to the queue; ports with a clock of their
    /// own report it themselves.
    pub(super) fn told_ns(&self, lag: Ns) -> Ns {
        self.inbox.told_ns().into_iter().fold(self.now_ns() - lag, Ns::min)
    }

    /// The present time on the clock of the reads.
    pub(super) fn now_ns(&self) -> Ns {
        self.inbox.now_ns()
    }
}

impl Drop for Ports {
    fn drop(&mut self) {
        self.close();
    }
}

/// Where the bytes of an overrun were lost.
fn overrun(counter: &str) -> &'static str {
    if counter == "buf_overrun" {
        "the kernel's buffer was full"
    } else {
        "overrun of the chip"
    }
}

/// What the user should know of a change of the clocks.
fn clock_messages(change: ClockChange) -> Vec<String> {
    let seconds = |ns: Ns| ns as f64 / 1e9;
    let mut texts = Vec::new();
    if change.suspended_ns > 0 {
        let slept = seconds(change.suspended_ns);
        texts.push(format!("the machine slept for {slept:.1} s; traffic in the meantime is lost"));
    }
    if change.step_ns > 0 {
        let follows = if change.followed_ns > 0 { "" } else { "; timestamps follow at the next pause on the line" };
        texts.push(format!("the clock was set forward by {:.1} s{follows}", seconds(change.step_ns)));
    } else if change.step_ns < 0 {
        let back = seconds(-change.step_ns);
        texts.push(format!("the clock was set back by {back:.1} s; timestamps continue without a step"));
    }
    if change.cuts_traffic {
        let jump = seconds(change.followed_ns);
        texts.push(format!("timestamps jump by {jump:.1} s in the middle of traffic, because the line does not pause"));
    }
    texts
}
