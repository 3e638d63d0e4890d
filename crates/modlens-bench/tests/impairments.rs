//! Every key of the table of impairments does what it says, within statistical bounds.

use modlens_bench::model::{Direction, Framing, Label};
use modlens_bench::sim::case::{Traffic, TrafficLine};
use modlens_bench::sim::scenario::Scenario;
use modlens_bench::sim::truth::TruthFrame;

const FRAMES: usize = 6000;

/// A clean bus.
fn clean() -> Scenario {
    Scenario::named("clean").unwrap().clone()
}

/// A clean ASCII bus.
fn ascii() -> Scenario {
    Scenario::named("ascii").unwrap().clone()
}

fn play(scenario: &Scenario) -> Traffic {
    Traffic::new(scenario, 11, FRAMES)
}

fn share(traffic: &Traffic, of: impl Fn(&TruthFrame) -> bool) -> f64 {
    traffic.truth.iter().filter(|frame| of(frame)).count() as f64 / traffic.truth.len() as f64
}

#[track_caller]
fn near(value: f64, wanted: f64) {
    assert!((value / wanted - 1.0).abs() < 0.2, "{value}, not {wanted}");
}

/// Bytes between frames, run by run.
fn strays(traffic: &Traffic) -> Vec<Vec<u8>> {
    let line = &traffic.lines[0];
    let mut runs = Vec::new();
    let mut end = 0;
    for frame in &traffic.truth {
        if frame.start > end {
            runs.push(line.bytes[end as usize..frame.start as usize].to_vec());
        }
        end = frame.end;
    }
    runs
}

/// Silence before each byte, in characters.
fn silences(traffic: &Traffic, line: &TrafficLine) -> Vec<f64> {
    let char_ns = traffic.settings.char_ns();
    let mut silences = vec![f64::MAX];
    silences.extend(line.times.windows(2).map(|pair| (pair[1] - pair[0]) as f64 / char_ns - 1.0));
    silences
}

#[test]
fn a_clean_bus_is_clean() {
    let traffic = play(&clean());
    assert!(traffic.truth.iter().all(|frame| frame.valid) && traffic.losses.is_empty() && strays(&traffic).is_empty());
    assert_eq!(traffic.truth[0].start, 0);
    let silences = silences(&traffic, &traffic.lines[0]);
    let t35 = traffic.settings.t35_ns() / traffic.settings.char_ns();
    for frame in &traffic.truth {
        assert!(silences[frame.start as usize] > 1.01 * t35);
        assert!(silences[frame.start as usize + 1..frame.end as usize].iter().all(|gap| gap.abs() < 0.01));
    }
    near(share(&traffic, |frame| frame.exception), 0.04 / 2.0);
    near(share(&traffic, |frame| frame.unit == 0), 0.01 / 2.0);
    near(share(&traffic, |frame| frame.labels.contains(Label::NoResponse)), 0.02 / 2.0);
}

#[test]
fn functions_have_their_weights() {
    let traffic = play(&Scenario { adhoc: 1.0, ..clean() });
    let requests = |function: u8| {
        let asked = |frame: &TruthFrame| frame.direction == Direction::Request && frame.function == function;
        traffic.truth.iter().filter(|frame| asked(frame)).count() as f64
    };
    near(requests(16) / requests(3), 0.5);
    near(requests(4) / requests(3), 0.6);
    assert!([1, 2, 5, 6, 7, 8, 11, 12, 15, 17, 20, 21, 22, 23, 24, 43].iter().all(|&code| requests(code) > 10.0));
}

#[test]
fn flipped_bits() {
    let traffic = play(&Scenario { flip: 0.06, ..clean() });
    near(share(&traffic, |frame| frame.damage.flip), 0.06);
    assert!(traffic.truth.iter().all(|frame| frame.valid != frame.damage.flip));
    // Half of the damaged requests were damaged on the wire, so nobody answered.
    let answered = |frame: &TruthFrame| traffic.truth.iter().any(|other| other.txn == frame.txn && other.start != frame.start);
    let damaged: Vec<_> = traffic.truth.iter().filter(|f| f.damage.flip && f.direction == Direction::Request).collect();
    near(damaged.iter().filter(|frame| answered(frame)).count() as f64 / damaged.len() as f64, 0.49);
}

#[test]
fn lost_and_doubled_bytes() {
    let traffic = play(&Scenario { drop: 0.04, ..clean() });
    near(share(&traffic, |frame| frame.damage.lost), 0.04);
    assert!(traffic.truth.iter().all(|frame| frame.valid != frame.damage.lost));
    near(traffic.losses.len() as f64 / traffic.truth.len() as f64, 0.04);
    let doubled = play(&Scenario { dup: 0.05, ..clean() });
    near(share(&doubled, |frame| frame.damage.dup), 0.05);
    // A copied first byte is in front of a whole frame, a copied last one after it.
    let whole = doubled.truth.iter().filter(|frame| frame.damage.dup && frame.valid).count();
    assert!(whole > 10 && whole < FRAMES / 50, "{whole}");
}

#[test]
fn truncated_and_collided_frames() {
    let traffic = play(&Scenario { trunc: 0.04, ..clean() });
    near(share(&traffic, |frame| frame.damage.trunc), 0.04);
    assert!(traffic.truth.iter().all(|frame| frame.valid != frame.damage.trunc));
    let collided = play(&Scenario { collide: 0.04, ..clean() });
    near(share(&collided, |frame| frame.damage.collide), 0.04);
    let unharmed = collided.truth.iter().filter(|frame| frame.damage.collide && frame.valid).count();
    assert!(unharmed < 15 && !strays(&collided).is_empty(), "{unharmed}");
}

#[test]
fn silences_too_short_and_gaps_inside() {
    let traffic = play(&Scenario { nogap: 1.0, timeout: 0.0, ..clean() });
    let before = silences(&traffic, &traffic.lines[0]);
    let short = traffic.truth.iter().filter(|frame| before[frame.start as usize] < 2.51).count();
    assert!(short as f64 / traffic.truth.len() as f64 > 0.98);
    let slow = play(&Scenario { slow15: 0.3, slow35: 0.15, ..clean() });
    let before = silences(&slow, &slow.lines[0]);
    let inside = |frame: &TruthFrame, low: f64, high: f64| {
        before[frame.start as usize + 1..frame.end as usize].iter().any(|gap| (low..high).contains(gap))
    };
    near(share(&slow, |frame| inside(frame, 1.4, 3.5)), 0.3);
    near(share(&slow, |frame| inside(frame, 3.5, 26.0)), 0.15);
}

#[test]
fn stray_bytes() {
    let noise = play(&Scenario { noise_gap: 0.25, ..clean() });
    let runs = strays(&noise);
    near(runs.len() as f64 / FRAMES as f64, 0.25);
    near(runs.iter().map(Vec::len).sum::<usize>() as f64 / runs.len() as f64, 2.5);
    let glitches = strays(&play(&Scenario { turn_lead: 0.3, ..clean() }));
    near(glitches.len() as f64 / FRAMES as f64, 0.3);
    assert!(glitches.iter().all(|run| (1..=3).contains(&run.len()) && run.iter().all(|byte| *byte == run[0])));
    near(glitches.iter().filter(|run| run[0] == 0).count() as f64 / glitches.len() as f64, 0.6);
    near(strays(&play(&Scenario { turn_trail: 0.3, ..clean() })).len() as f64 / FRAMES as f64, 0.3);
}

#[test]
fn storms_and_cuts() {
    let storms = strays(&play(&Scenario { storm: 0.06, ..clean() }));
    near(storms.len() as f64 / (FRAMES as f64 / 2.0), 0.06);
    assert!(storms.iter().all(|run| run.len() >= 60));
    let cut = play(&Scenario { cuts: 0.05, ..clean() });
    near(cut.losses.len() as f64, 0.05 * FRAMES as f64 / 1.97);
    assert!(cut.truth.iter().any(|frame| frame.labels.contains(Label::LostBytes)));
    assert!(cut.truth.iter().all(|frame| frame.valid != frame.damage.lost));
}

#[test]
fn frames_inside_frames() {
    let nested = |p: f64| {
        let traffic = play(&Scenario { nested: p, adhoc: 1.0, ..clean() });
        let bytes = &traffic.lines[0].bytes;
        let writes = traffic.truth.iter().filter(|f| matches!(f.function, 15 | 16 | 21 | 23) && f.end - f.start > 24);
        let inner = writes.filter(|frame| {
            let body = &bytes[frame.start as usize + 7..frame.end as usize - 2];
            body.windows(8).any(modlens_bench::checksum::crc_fits)
        });
        inner.count()
    };
    // FF FF and zeros have a fitting CRC by themselves, so there are always some.
    let (without, with) = (nested(0.0), nested(0.5));
    assert!(with > 5 * without && with > 60, "{without} {with}");
}

#[test]
fn late_wrong_and_repeated_answers() {
    let late = play(&Scenario { timeout: 0.10, late: 0.5, ..clean() });
    // Late: half of the timeouts of the first or second try; to be said where the retry's own answer came as well.
    near(share(&late, |frame| frame.labels.contains(Label::Late)), 0.05 * 0.9 / 2.0);
    assert!(late.truth.iter().filter(|frame| frame.labels.contains(Label::Late)).all(|frame| frame.alternative_txn.is_some()));
    let wrong = play(&Scenario { wrong_unit: 0.04, ..clean() });
    let labelled = |traffic: &Traffic, label| share(traffic, |f| f.labels.contains(label) || f.allowed_labels.contains(label));
    near(labelled(&wrong, Label::WrongUnit), 0.04 / 2.0);
    let repeated = play(&Scenario { dup_reply: 0.05, ..clean() });
    near(labelled(&repeated, Label::Duplicate), 0.05 / 2.05);
    let meetings = play(&Scenario { two_masters: 0.05, ..clean() });
    near(share(&meetings, |frame| frame.labels.contains(Label::TwoMasters)), 0.05 / 2.1);
    for label in [Label::Late, Label::WrongUnit, Label::Duplicate, Label::TwoMasters, Label::Echo] {
        assert!(labelled(&play(&clean()), label) < 1e-9);
    }
}

#[test]
fn local_echo() {
    let traffic = play(&Scenario { echo: 1.0, ..clean() });
    let bytes = |frame: &TruthFrame| &traffic.lines[0].bytes[frame.start as usize..frame.end as usize];
    for pair in traffic.truth.windows(2).filter(|pair| pair[1].echo) {
        assert_eq!((bytes(&pair[0]), pair[0].end, pair[0].txn), (bytes(&pair[1]), pair[1].start, pair[1].txn));
        assert!(pair[1].labels.contains(Label::Echo));
    }
    near(share(&traffic, |frame| frame.echo), 1.0 / 2.97);
}

#[test]
fn devices_that_do_not_keep_to_the_specification() {
    let enron = play(&Scenario { enron: 1.0, adhoc: 0.0, exceptions: 0.0, ..clean() });
    let bytes = &enron.lines[0].bytes;
    for pair in enron.truth.windows(2).filter(|pair| pair[0].txn == pair[1].txn && matches!(pair[0].function, 3 | 4)) {
        let asked = &bytes[pair[0].start as usize..];
        assert_eq!(pair[1].end - pair[1].start, 5 + 4 * u64::from(u16::from_be_bytes([asked[4], asked[5]])));
    }
    let quirk = Scenario::named("quirk").unwrap();
    let reserved: f64 = (0..20).map(|seed| share(&Traffic::new(quirk, seed, 300), |frame| frame.unit >= 247)).sum();
    near(reserved / 20.0, 0.2);
}

#[test]
fn captures_begin_in_the_middle() {
    for seed in 0..20 {
        let traffic = Traffic::new(&Scenario { midstart: true, ..clean() }, seed, 100);
        let first = &traffic.truth[0];
        assert!(!first.valid && first.start == 0 && first.damage.midstart && traffic.truth[1].valid);
    }
}

#[test]
fn damaged_ascii() {
    let colon = play(&Scenario { bad_colon: 0.05, ..ascii() });
    near(share(&colon, |frame| frame.damage.colon), 0.05);
    assert!(colon.truth.iter().all(|frame| frame.valid != frame.damage.colon && !frame.is_unscored));
    let end = play(&Scenario { no_crlf: 0.05, ..ascii() });
    near(share(&end, |frame| frame.damage.no_end), 0.05);
    assert!(end.truth.iter().all(|frame| frame.valid != frame.damage.no_end && frame.is_unscored == frame.damage.no_end));
    let lower = play(&Scenario { lower_case: 1.0, ..ascii() });
    assert!(lower.lines[0].bytes.iter().any(u8::is_ascii_lowercase));
    let noise = play(&Scenario { noise_gap: 0.25, ..ascii() });
    assert!(noise.lines[0].bytes.iter().any(|byte| *byte > 0x7F));
    assert_eq!((noise.framing, noise.settings.bits()), (Framing::Ascii, 10));
    let paused = play(&Scenario { pause: 0.05, ..ascii() });
    let before = silences(&paused, &paused.lines[0]);
    let slow = |frame: &TruthFrame| {
        let seconds =
            before[frame.start as usize + 1..frame.end as usize].iter().map(|gap| gap * paused.settings.char_ns() / 1e9);
        seconds.fold(0.0, f64::max)
    };
    near(share(&paused, |frame| slow(frame) > 0.04), 0.05);
    assert!(paused.truth.iter().all(|frame| slow(frame) < 1.0));
}

#[test]
fn two_lines_share_a_clock() {
    let traffic = play(&Scenario { two_lines: true, ..clean() });
    assert_eq!(traffic.lines.iter().map(|line| line.id).collect::<Vec<_>>(), [1, 2]);
    for frame in &traffic.truth {
        assert_eq!(frame.line, if frame.direction == Direction::Request { 1 } else { 2 });
    }
    let time = |frame: &TruthFrame| traffic.lines[usize::from(frame.line) - 1].times[frame.start as usize];
    assert!(traffic.truth.windows(2).all(|pair| time(&pair[0]) < time(&pair[1])));
}
