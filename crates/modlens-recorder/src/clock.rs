//! UTC for moments of the monotonic clock.
//!
//! Reads are timed by the monotonic clock, which is never set. Here its times are mapped to UTC.

use std::time::{SystemTime, UNIX_EPOCH};

use modlens_protocol::Ns;

/// A smaller difference between the clocks is a correction (NTP), which is not followed.
const MIN_STEP_NS: Ns = 1_000_000_000;

/// A shorter difference between the clocks is not a suspension: the process had to wait.
const MIN_SUSPENSION_NS: Ns = 100_000_000;

/// A line that does not pause for so long after the wall clock was set forward is followed in the middle of its traffic.
pub const MAX_DELAY_NS: Ns = 10_000_000_000;

/// What the clocks of the machine show at one moment, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moment {
    /// The monotonic clock, which is never set.
    pub monotonic: Ns,
    /// The wall clock: time since 1970.
    pub wall: Ns,
    /// For how long the machine has been suspended.
    pub suspended: Ns,
}

impl Moment {
    /// The present moment.
    pub fn now() -> Self {
        let wall = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as Ns);
        Self { monotonic: monotonic_ns(), wall, suspended: suspended_ns() }
    }
}

/// The monotonic clock. On POSIX it is `CLOCK_MONOTONIC`.
pub fn monotonic_ns() -> Ns {
    #[cfg(unix)]
    return nanoseconds(rustix::time::ClockId::Monotonic);
    #[cfg(not(unix))]
    return since_start();
}

/// The clock of Rust's library, since this function was first called.
#[cfg(any(not(unix), target_os = "macos"))]
fn since_start() -> Ns {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_nanos() as Ns
}

/// For how long the machine has been suspended since some moment; always 0 where it cannot tell.
///
/// On Linux, `CLOCK_MONOTONIC` stands still in suspension and `CLOCK_BOOTTIME` does not (`clock_gettime(2)`). On macOS
/// `CLOCK_MONOTONIC` runs on, and the clock of Rust's library stands still.
pub fn suspended_ns() -> Ns {
    #[cfg(target_os = "linux")]
    return nanoseconds(rustix::time::ClockId::Boottime) - monotonic_ns();
    #[cfg(target_os = "macos")]
    return monotonic_ns() - since_start();
    #[cfg(not(any(target_os = "linux", target_os = "macos")))]
    return 0;
}

#[cfg(unix)]
fn nanoseconds(clock: rustix::time::ClockId) -> Ns {
    let time = rustix::time::clock_gettime(clock);
    time.tv_sec as Ns * 1_000_000_000 + time.tv_nsec as Ns
}

/// What has happened to the clocks since the last check; each step is reported once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClockChange {
    /// By how much the wall clock was set.
    pub step_ns: Ns,
    /// For how long the machine was suspended.
    pub suspended_ns: Ns,
    /// By how much the times of reads jump from now on.
    pub followed_ns: Ns,
    /// The times jump in the middle of traffic, because the line did not pause.
    pub cuts_traffic: bool,
}

/// UTC that never runs back: the monotonic clock plus a shift.
///
/// The shift stays constant, so that small corrections of the wall clock do not change measured response times. It follows
/// the wall clock only when that is ahead by more than a second: at once after a suspension; otherwise at a pause of the
/// line, when no transaction is in progress, or after `MAX_DELAY_NS`. A wall clock that is set back is not followed.
#[derive(Clone, Debug)]
pub struct Clock {
    shift: Ns,
    suspended: Ns,
    reported: Ns,
    /// Since when the wall clock is ahead, on the monotonic clock.
    ahead_since: Option<Ns>,
}

impl Clock {
    /// A clock that shows the wall clock's time.
    pub fn new(now: Moment) -> Self {
        Self { shift: now.wall - now.monotonic, suspended: now.suspended, reported: 0, ahead_since: None }
    }

    /// Converts a moment of the monotonic clock to nanoseconds since 1970.
    pub fn utc(&self, monotonic: Ns) -> Ns {
        monotonic + self.shift
    }

    /// Compares the clocks, and follows the wall clock if it is time to. `is_idle`: no transaction is in progress.
    pub fn check(&mut self, now: Moment, is_idle: bool) -> ClockChange {
        let suspended_ns = self.suspension(now);
        let ahead = now.wall - self.utc(now.monotonic);
        let step_ns = self.step(ahead, suspended_ns);
        let waits = self.waiting_ns(now, ahead);
        let cuts_traffic = !is_idle && suspended_ns == 0 && waits.is_some_and(|waits| waits >= MAX_DELAY_NS);
        let follows = suspended_ns > 0 && ahead > 0 || waits.is_some() && (is_idle || cuts_traffic);
        let followed_ns = if follows { ahead } else { 0 };
        if follows {
            self.shift += ahead;
            (self.reported, self.ahead_since) = (0, None);
        }
        ClockChange { step_ns, suspended_ns, followed_ns, cuts_traffic }
    }

    /// For how long the machine was suspended since the last check.
    fn suspension(&mut self, now: Moment) -> Ns {
        let found = now.suspended - self.suspended;
        if found < MIN_SUSPENSION_NS {
            return 0;
        }
        self.suspended = now.suspended;
        found
    }

    /// By how much the wall clock was set since the last check.
    fn step(&mut self, ahead: Ns, suspended: Ns) -> Ns {
        let step = ahead - self.reported - suspended;
        if step.abs() <= MIN_STEP_NS {
            return 0;
        }
        self.reported = ahead - suspended;
        step
    }

    /// For how long the wall clock has been ahead by so much that it is to be followed; `None` if it is not.
    fn waiting_ns(&mut self, now: Moment, ahead: Ns) -> Option<Ns> {
        let since = self.ahead_since.unwrap_or(now.monotonic);
        self.ahead_since = (ahead > MIN_STEP_NS).then_some(since);
        self.ahead_since.map(|since| now.monotonic - since)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: Ns = 1_000_000_000;

    /// Three clocks in a test's hand.
    struct Machine {
        now: Moment,
        clock: Clock,
    }

    impl Machine {
        fn new() -> Self {
            let now = Moment { monotonic: 5 * S, wall: 1000 * S, suspended: 0 };
            Self { now, clock: Clock::new(now) }
        }

        fn go_on(&mut self, ns: Ns) {
            self.now.monotonic += ns;
            self.now.wall += ns;
        }

        fn sleep(&mut self, ns: Ns) {
            self.now.wall += ns;
            self.now.suspended += ns;
        }

        fn check(&mut self, is_idle: bool) -> ClockChange {
            self.clock.check(self.now, is_idle)
        }

        fn utc(&self) -> Ns {
            self.clock.utc(self.now.monotonic)
        }
    }

    #[test]
    fn a_correction_of_less_than_a_second_does_not_show() {
        let mut machine = Machine::new();
        for correction in [400_000_000, -900_000_000, 990_000_000] {
            machine.go_on(S);
            machine.now.wall += correction;
            let before = machine.utc();
            assert_eq!(machine.check(true), ClockChange::default());
            machine.go_on(S);
            assert_eq!(machine.utc(), before + S);
        }
    }

    #[test]
    fn a_clock_that_is_set_forward_is_followed_at_a_pause() {
        let mut machine = Machine::new();
        machine.now.wall += 3600 * S;
        assert_eq!(machine.check(false), ClockChange { step_ns: 3600 * S, ..ClockChange::default() });
        machine.go_on(9 * S);
        assert_eq!(machine.check(false), ClockChange::default());
        assert_eq!(machine.utc(), 1009 * S);
        assert_eq!(machine.check(true), ClockChange { followed_ns: 3600 * S, ..ClockChange::default() });
        assert_eq!(machine.utc(), 4609 * S);
        assert_eq!(machine.check(true), ClockChange::default());
    }

    #[test]
    fn a_line_without_a_pause_is_followed_after_ten_seconds() {
        let mut machine = Machine::new();
        machine.now.wall += 3600 * S;
        machine.check(false);
        for _ in 0..9 {
            machine.go_on(S);
            assert_eq!(machine.check(false), ClockChange::default());
        }
        machine.go_on(S);
        assert_eq!(machine.check(false), ClockChange { followed_ns: 3600 * S, cuts_traffic: true, ..ClockChange::default() });
        assert_eq!(machine.utc(), machine.now.wall);
    }

    #[test]
    fn a_clock_that_is_set_back_is_not_followed() {
        let mut machine = Machine::new();
        machine.now.wall -= 3600 * S;
        assert_eq!(machine.check(true), ClockChange { step_ns: -3600 * S, ..ClockChange::default() });
        machine.go_on(20 * S);
        assert_eq!(machine.check(true), ClockChange::default());
        assert_eq!(machine.utc(), 1020 * S);
        machine.now.wall += 3600 * S;
        assert_eq!(machine.check(true), ClockChange { step_ns: 3600 * S, ..ClockChange::default() });
        assert_eq!(machine.utc(), 1020 * S);
    }

    #[test]
    fn a_suspension_is_no_step_and_is_followed_at_once() {
        for nap in [200_000_000, 3600 * S] {
            let mut machine = Machine::new();
            machine.go_on(7 * S);
            machine.sleep(nap);
            machine.go_on(S);
            let found = machine.check(false);
            assert_eq!(found, ClockChange { suspended_ns: nap, followed_ns: nap, ..ClockChange::default() });
            assert_eq!(machine.utc(), machine.now.wall);
            assert_eq!(machine.check(false), ClockChange::default());
        }
    }

    #[test]
    fn a_clock_may_be_set_during_a_suspension() {
        let mut machine = Machine::new();
        machine.sleep(100 * S);
        machine.now.wall += 50 * S;
        let found = machine.check(false);
        assert_eq!((found.step_ns, found.suspended_ns), (50 * S, 100 * S));
        assert_eq!(machine.utc(), machine.now.wall);
        machine.sleep(100 * S);
        machine.now.wall -= 50 * S;
        let found = machine.check(false);
        assert_eq!((found.step_ns, found.suspended_ns), (-50 * S, 100 * S));
        assert_eq!(machine.check(false), ClockChange::default());
    }

    #[test]
    fn this_machine_is_awake() {
        let before = Moment::now();
        std::thread::sleep(std::time::Duration::from_millis(20));
        let after = Moment::now();
        assert!(after.monotonic > before.monotonic);
        assert!((after.suspended - before.suspended).abs() < S / 100);
    }
}
