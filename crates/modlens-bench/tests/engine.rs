//! The engine against the simulator's truth, in short: `make accuracy` is the long form.
//!
//! The bars are below what a full run shows, by the scatter of a few hundred frames.

use modlens_bench::adapter::Modlens;
use modlens_bench::reported::Algorithm;
use modlens_bench::score::{false_frames, score};
use modlens_bench::sim::case::Traffic;
use modlens_bench::sim::noise::{NoiseCase, Pattern};
use modlens_bench::sim::scenario::Scenario;
use modlens_bench::sim::tap::TapMode;

const FRAMES: usize = 600;
const MODES: [TapMode; 3] = [TapMode::Exact, TapMode::Ftdi16, TapMode::None];

/// F1 of exact start, end and direction.
fn f1(scenario: &str, seed: u64, mode: TapMode) -> f64 {
    let scenario = Scenario::named(scenario).unwrap_or_else(|| panic!("no scenario {scenario}"));
    let case = Traffic::new(scenario, seed, FRAMES).tap(mode);
    score(&case, &Modlens::offline().run(&case)).frames_with_direction().f1()
}

#[test]
fn frames_and_directions_of_clean_and_bad_lines() {
    for (scenario, bar) in
        [("clean", 0.999), ("nogap", 0.997), ("turnaround", 0.99), ("nested", 0.99), ("field", 0.99), ("hostile", 0.965)]
    {
        for mode in MODES {
            let f1 = f1(scenario, 21, mode);
            assert!(f1 >= bar, "{scenario} {mode:?}: {f1:.4} is below {bar}");
        }
    }
}

#[test]
fn the_rule_of_silence_on_clean_traffic_with_exact_times() {
    let clean = Scenario::named("clean").unwrap();
    for seed in 21..24 {
        let case = Traffic::new(clean, seed, FRAMES).tap(TapMode::Exact);
        let f1 = score(&case, &Modlens::textbook().run(&case)).frames_with_direction().f1();
        assert!(f1 >= 0.999, "{seed}: {f1:.4}");
    }
}

#[test]
fn two_lines_and_ascii() {
    for (scenario, mode, bar) in
        [("lines", TapMode::Exact, 0.995), ("ascii", TapMode::Exact, 0.999), ("ascii_field", TapMode::Ftdi16, 0.985)]
    {
        let f1 = f1(scenario, 21, mode);
        assert!(f1 >= bar, "{scenario} {mode:?}: {f1:.4} is below {bar}");
    }
}

#[test]
fn noise_gives_no_frames_that_are_sold_as_facts() {
    for pattern in Pattern::ALL {
        let case = NoiseCase::new(pattern, 21, 300_000, TapMode::None, false);
        let (sure, _) = false_frames(&Modlens::offline().run(&case.case), case.from);
        assert!(sure <= 1, "{pattern:?}: {sure} in 0.3 MB");
    }
}
