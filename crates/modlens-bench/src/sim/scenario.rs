//! The table of scenarios: the probabilities of faults on the bus and at the tap.

use crate::model::{Direction, Framing};
use crate::sim::look_alike::LookAlike;
use crate::sim::repeated::{Repeated, MIXED, WRITE};

/// One scenario. Probabilities are per frame unless another unit is given.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Its name.
    pub name: &'static str,
    /// The default number of frames.
    pub frames: usize,
    /// RTU or ASCII.
    pub framing: Framing,
    /// Requests are on line A and responses on line B, instead of all on one line.
    pub two_lines: bool,
    /// The silence before a frame has only U[0, 2.5] characters.
    pub nogap: f64,
    /// The silence before a frame contains 1 to 4 random bytes.
    pub noise_gap: f64,
    /// 1 to 3 stray bytes directly in front of the frame.
    pub turn_lead: f64,
    /// 1 to 3 stray bytes directly after the frame.
    pub turn_trail: f64,
    /// 1-3 flipped bits.
    pub flip: f64,
    /// 1-3 consecutive bytes lost in the tap.
    pub drop: f64,
    /// One byte delivered twice.
    pub dup: f64,
    /// The transmission stops early.
    pub trunc: f64,
    /// Another sender transmits during the frame.
    pub collide: f64,
    /// 1-4 gaps of U[1.5, 3.4] characters inside.
    pub slow15: f64,
    /// 1-2 gaps of U[3.6, 25] characters inside.
    pub slow35: f64,
    /// Per transaction: 60-600 noise bytes after it.
    pub storm: f64,
    /// Per transaction: a place where up to 400 bytes vanish.
    pub cuts: f64,
    /// Per write payload of 8 bytes and more: it contains a complete frame.
    pub nested: f64,
    /// Per timeout: the response arrives after the retry.
    pub late: f64,
    /// The request appears twice.
    pub echo: f64,
    /// Share of slaves that return 4 bytes per register.
    pub enron: f64,
    /// Share of slaves that violate the specification.
    pub quirk: f64,
    /// The capture begins in the middle of a frame.
    pub midstart: bool,
    /// Share of transactions outside the poll cycle.
    pub adhoc: f64,
    /// Weight of proprietary functions among the ad-hoc ones.
    pub custom_weight: u32,
    /// Per request: no response.
    pub timeout: f64,
    /// Per response: an exception.
    pub exceptions: f64,
    /// Registers and payloads are mostly zero.
    pub zero_heavy: bool,
    /// Per response: it carries another unit than the one addressed.
    pub wrong_unit: f64,
    /// Per response: it is sent twice.
    pub dup_reply: f64,
    /// Per transaction: a second master sends a request before the response.
    pub two_masters: f64,
    /// ASCII: the colon is damaged or lost.
    pub bad_colon: f64,
    /// ASCII: CR, LF or both are missing.
    pub no_crlf: f64,
    /// ASCII: share of slaves that write lower-case hex digits.
    pub lower_case: f64,
    /// ASCII: one pause of U[0.05, 0.95] s inside (up to 1 s is legal, 2.5.2).
    pub pause: f64,
    /// Per response: it comes after `slow_ns`, and the master waits for it.
    pub slow: f64,
    /// How long a slow response takes.
    pub slow_ns: f64,
    /// The tap hears only the frames of this direction.
    pub only: Option<Direction>,
    /// What is put between the transactions, or in front of them.
    pub look_alike: Option<LookAlike>,
    /// A fixed cycle of requests instead of random traffic.
    pub repeated: Option<Repeated>,
}

/// The defaults of all scenarios.
pub(crate) const BASE: Scenario = Scenario {
    name: "",
    frames: 3000,
    framing: Framing::Rtu,
    two_lines: false,
    nogap: 0.0,
    noise_gap: 0.0,
    turn_lead: 0.0,
    turn_trail: 0.0,
    flip: 0.0,
    drop: 0.0,
    dup: 0.0,
    trunc: 0.0,
    collide: 0.0,
    slow15: 0.0,
    slow35: 0.0,
    storm: 0.0,
    cuts: 0.0,
    nested: 0.0,
    late: 0.0,
    echo: 0.0,
    enron: 0.0,
    quirk: 0.0,
    midstart: true,
    adhoc: 0.30,
    custom_weight: 6,
    timeout: 0.02,
    exceptions: 0.04,
    zero_heavy: false,
    wrong_unit: 0.0,
    dup_reply: 0.0,
    two_masters: 0.0,
    bad_colon: 0.0,
    no_crlf: 0.0,
    lower_case: 0.0,
    pause: 0.0,
    slow: 0.0,
    slow_ns: 0.0,
    only: None,
    look_alike: None,
    repeated: None,
};

/// The defaults of ASCII scenarios.
const ASCII: Scenario = Scenario { framing: Framing::Ascii, ..BASE };

/// An average installation.
const FIELD: Scenario = Scenario {
    name: "field",
    noise_gap: 0.05,
    turn_lead: 0.15,
    turn_trail: 0.10,
    flip: 0.015,
    drop: 0.01,
    trunc: 0.01,
    collide: 0.01,
    late: 0.2,
    slow15: 0.10,
    slow35: 0.04,
    nogap: 0.15,
    storm: 0.004,
    timeout: 0.04,
    custom_weight: 12,
    nested: 0.02,
    ..BASE
};

/// All faults at once.
const HOSTILE: Scenario = Scenario {
    name: "hostile",
    noise_gap: 0.25,
    turn_lead: 0.4,
    turn_trail: 0.4,
    flip: 0.06,
    drop: 0.04,
    trunc: 0.03,
    collide: 0.03,
    late: 0.3,
    slow15: 0.2,
    slow35: 0.1,
    nogap: 0.5,
    storm: 0.03,
    timeout: 0.08,
    custom_weight: 40,
    adhoc: 0.6,
    zero_heavy: true,
    nested: 0.1,
    ..BASE
};

/// The twenty scenarios whose mean is the headline.
pub const HEADLINE: [Scenario; 20] = [
    Scenario { name: "clean", midstart: false, ..BASE },
    Scenario { name: "overrun", cuts: 0.05, ..BASE },
    Scenario { name: "nogap", nogap: 1.0, ..BASE },
    Scenario { name: "noise", noise_gap: 0.25, ..BASE },
    Scenario { name: "turnaround", turn_lead: 0.35, turn_trail: 0.35, ..BASE },
    Scenario { name: "bitflip", flip: 0.06, ..BASE },
    Scenario { name: "drop", drop: 0.04, dup: 0.01, ..BASE },
    Scenario { name: "truncate", trunc: 0.04, ..BASE },
    Scenario { name: "collide", collide: 0.04, late: 0.4, timeout: 0.05, ..BASE },
    Scenario { name: "slowchar", slow15: 0.30, slow35: 0.15, ..BASE },
    Scenario { name: "custom", adhoc: 0.75, custom_weight: 90, ..BASE },
    Scenario { name: "zeros", zero_heavy: true, turn_trail: 0.4, turn_lead: 0.2, custom_weight: 20, ..BASE },
    Scenario { name: "nested", nested: 0.5, adhoc: 0.6, ..BASE },
    Scenario { name: "timeouts", timeout: 0.25, adhoc: 0.6, ..BASE },
    Scenario { name: "storm", storm: 0.06, frames: 2500, ..BASE },
    Scenario { name: "enron", enron: 0.5, ..BASE },
    Scenario { name: "echo", echo: 1.0, frames: 2000, ..BASE },
    Scenario { name: "quirk", quirk: 0.8, adhoc: 0.5, exceptions: 0.08, ..BASE },
    FIELD,
    HOSTILE,
];

/// Scenarios of labels, two-line taps and ASCII, which are not part of the headline.
pub const FURTHER: [Scenario; 15] = [
    Scenario { name: "wrong_unit", wrong_unit: 0.04, ..BASE },
    Scenario { name: "dup_reply", dup_reply: 0.05, ..BASE },
    Scenario { name: "two_masters", two_masters: 0.05, ..BASE },
    Scenario { name: "late", timeout: 0.10, late: 0.5, ..BASE },
    Scenario {
        name: "faults",
        wrong_unit: 0.01,
        dup_reply: 0.02,
        two_masters: 0.02,
        late: 0.4,
        timeout: 0.06,
        drop: 0.01,
        flip: 0.01,
        noise_gap: 0.05,
        ..BASE
    },
    Scenario { name: "lines", two_lines: true, ..BASE },
    Scenario { name: "lines_field", two_lines: true, ..FIELD },
    Scenario { name: "lines_hostile", two_lines: true, ..HOSTILE },
    Scenario { name: "lines_cuts", two_lines: true, cuts: 0.05, timeout: 0.06, late: 0.4, ..BASE },
    Scenario { name: "ascii", midstart: false, ..ASCII },
    Scenario { name: "ascii_noise", noise_gap: 0.25, turn_lead: 0.2, turn_trail: 0.2, ..ASCII },
    Scenario { name: "ascii_colon", bad_colon: 0.05, no_crlf: 0.0, ..ASCII },
    Scenario { name: "ascii_crlf", no_crlf: 0.05, ..ASCII },
    Scenario { name: "ascii_slow", slow15: 0.3, slow35: 0.15, pause: 0.03, lower_case: 0.5, ..ASCII },
    Scenario {
        name: "ascii_field",
        bad_colon: 0.01,
        no_crlf: 0.01,
        lower_case: 0.2,
        pause: 0.005,
        ..Scenario { framing: Framing::Ascii, nested: 0.0, ..FIELD }
    },
];

/// Masters that wait for slow units and gateways, and taps that hear one side only.
pub const WAITING: [Scenario; 5] = [
    Scenario { name: "slow_1200", slow: 1.0, slow_ns: 1.2e9, frames: 1000, ..BASE },
    Scenario { name: "slow_3000", slow: 1.0, slow_ns: 3.0e9, frames: 1000, ..BASE },
    Scenario { name: "slow_mixed", slow: 0.2, slow_ns: 1.2e9, frames: 1000, timeout: 0.05, ..BASE },
    Scenario { name: "only_requests", only: Some(Direction::Request), frames: 2000, ..BASE },
    Scenario { name: "only_responses", only: Some(Direction::Response), frames: 2000, ..BASE },
];

/// The defaults of scenarios with look-alikes.
const ALIKE: Scenario = Scenario { midstart: false, frames: 2000, ..BASE };

/// Lines that carry more than their own frames.
pub const LOOK_ALIKES: [Scenario; 13] = [
    Scenario { name: "alike_file", look_alike: Some(LookAlike::FileWrite), ..ALIKE },
    Scenario { name: "alike_write", look_alike: Some(LookAlike::RegisterWrite), ..ALIKE },
    Scenario { name: "alike_loopback", look_alike: Some(LookAlike::Loopback), ..ALIKE },
    Scenario { name: "alike_vendor", look_alike: Some(LookAlike::Vendor), ..ALIKE },
    Scenario { name: "alike_read", look_alike: Some(LookAlike::Read), ..ALIKE },
    Scenario { name: "alike_runs", look_alike: Some(LookAlike::Runs), ..ALIKE },
    Scenario { name: "alike_squares", look_alike: Some(LookAlike::Squares), ..ALIKE },
    Scenario { name: "alike_baud", look_alike: Some(LookAlike::WrongBaud), ..ALIKE },
    Scenario { name: "alike_foreign", look_alike: Some(LookAlike::Foreign), ..ALIKE },
    Scenario { name: "auto_ascii", look_alike: Some(LookAlike::AsciiInFront), ..ALIKE },
    Scenario { name: "auto_mbap", look_alike: Some(LookAlike::MbapInFront), ..ALIKE },
    Scenario { name: "auto_field", look_alike: Some(LookAlike::Nothing), ..FIELD },
    Scenario { name: "auto_hostile", look_alike: Some(LookAlike::Nothing), ..HOSTILE },
];

/// The defaults of these scenarios.
const QUIET: Scenario = Scenario { frames: 800, midstart: false, timeout: 0.0, exceptions: 0.0, ..BASE };

/// Lines with constant writes, dead units and damaged responses.
pub const REPEATED: [Scenario; 17] = [
    Scenario { name: "writes_25ms", repeated: Some(Repeated { pause_ms: 25.0, ..WRITE }), ..QUIET },
    Scenario { name: "writes_100ms", repeated: Some(WRITE), ..QUIET },
    Scenario { name: "writes_1s", repeated: Some(Repeated { pause_ms: 1000.0, ..WRITE }), ..QUIET },
    Scenario { name: "echo_25ms", repeated: Some(Repeated { pause_ms: 25.0, ..WRITE }), echo: 1.0, ..QUIET },
    Scenario { name: "echo_100ms", repeated: Some(WRITE), echo: 1.0, ..QUIET },
    Scenario { name: "echo_1s", repeated: Some(Repeated { pause_ms: 1000.0, ..WRITE }), echo: 1.0, ..QUIET },
    Scenario { name: "writes_polls", repeated: Some(MIXED), timeout: 0.02, ..QUIET },
    Scenario { name: "writes_twice", repeated: Some(Repeated { writes: 1, are_doubled: true, ..MIXED }), ..QUIET },
    Scenario { name: "echo_polls", repeated: Some(MIXED), timeout: 0.02, echo: 1.0, ..QUIET },
    Scenario { name: "heart_dies", repeated: Some(Repeated { writes_die_at: 0.5, ..WRITE }), ..QUIET },
    Scenario { name: "heart_dies_1s", repeated: Some(Repeated { writes_die_at: 0.5, pause_ms: 1000.0, ..WRITE }), ..QUIET },
    Scenario { name: "heart_polls", repeated: Some(Repeated { writes_die_at: 0.5, retries: 1, ..MIXED }), ..QUIET },
    Scenario { name: "heart_dead", repeated: Some(Repeated { writes_die_at: 0.0, pause_ms: 1000.0, ..WRITE }), ..QUIET },
    Scenario {
        name: "dead_unit",
        repeated: Some(Repeated { writes: 1, polls: 6, writes_die_at: 0.0, poll_dies_at: 0.0, ..MIXED }),
        ..QUIET
    },
    Scenario { name: "dead_two", repeated: Some(Repeated { polls: 1, writes_die_at: 0.0, ..WRITE }), ..QUIET },
    Scenario { name: "damaged_25", repeated: Some(Repeated { writes: 0, polls: 1, damaged: 0.25, ..WRITE }), ..QUIET },
    Scenario { name: "damaged_75", repeated: Some(Repeated { writes: 0, polls: 1, damaged: 0.75, ..WRITE }), ..QUIET },
];

impl Scenario {
    /// All scenarios, those of the headline first.
    pub fn all() -> impl Iterator<Item = &'static Scenario> {
        static HEADLINES: [Scenario; 20] = HEADLINE;
        static OTHERS: [&[Scenario]; 4] = [&FURTHER, &LOOK_ALIKES, &WAITING, &REPEATED];
        HEADLINES.iter().chain(OTHERS.into_iter().flatten())
    }

    /// The group whose figures are printed together; empty for the twenty of the headline and the further ones.
    pub fn group(&self) -> &'static str {
        if self.repeated.is_some() {
            "repeated requests"
        } else if self.look_alike.is_some() {
            "look-alikes"
        } else {
            ""
        }
    }

    /// The scenario of this name.
    pub fn named(name: &str) -> Option<&'static Scenario> {
        Self::all().find(|scenario| scenario.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_found() {
        let names: Vec<&str> = Scenario::all().map(|scenario| scenario.name).collect();
        assert_eq!(names.len(), 35 + LOOK_ALIKES.len() + WAITING.len() + REPEATED.len());
        for (at, name) in names.iter().enumerate() {
            assert_eq!(names.iter().position(|other| other == name), Some(at));
            assert!(Scenario::named(name).is_some());
        }
        assert!(Scenario::named("nonsense").is_none());
    }

    #[test]
    fn only_clean_ones_begin_at_a_frame() {
        let whole: Vec<&str> = Scenario::all().filter(|s| !s.midstart && s.group().is_empty()).map(|s| s.name).collect();
        assert_eq!(whole, ["clean", "ascii"]);
    }
}
