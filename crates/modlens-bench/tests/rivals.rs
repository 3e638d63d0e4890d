//! The rivals do as well as their kind does: figures of an independent implementation of the same simulator.

use modlens_bench::accuracy::RunPlan;
use modlens_bench::baselines::{self, Colon, Length, Scan};
use modlens_bench::reported::Algorithm;
use modlens_bench::score::{false_frames, score};
use modlens_bench::sim::bulk::Mixed;
use modlens_bench::sim::case::Traffic;
use modlens_bench::sim::noise::{NoiseCase, Pattern};
use modlens_bench::sim::scenario::Scenario;
use modlens_bench::sim::tap::TapMode;

/// F1 of start, end and direction in percent: gap exact, gap ftdi16, length, scan.
const WANTED: [(&str, [f64; 4]); 9] = [
    ("clean", [99.93, 54.1, 98.63, 99.16]),
    ("nogap", [0.2, 0.7, 98.79, 99.60]),
    ("turnaround", [53.4, 25.9, 98.61, 98.60]),
    ("slowchar", [93.8, 56.9, 98.47, 99.42]),
    ("custom", [99.24, 39.2, 79.1, 98.98]),
    ("zeros", [56.3, 29.5, 97.02, 98.26]),
    ("echo", [44.6, 17.3, 97.20, 96.50]),
    ("field", [65.5, 26.6, 97.81, 97.57]),
    ("hostile", [14.0, 7.1, 88.5, 89.9]),
];

#[test]
fn the_rivals_are_as_good_as_elsewhere() {
    let plan = RunPlan {
        scenarios: WANTED.iter().map(|(name, _)| Scenario::named(name).unwrap()).collect(),
        modes: vec![TapMode::Exact, TapMode::Ftdi16],
        seeds: vec![11, 12, 13],
        frames: 2000,
        algorithms: vec![String::from("gap"), String::from("length"), String::from("scan")],
        threads: 1,
    };
    let outcome = plan.run(baselines::all);
    println!("{:<12} {:>16} {:>16} {:>16} {:>16}", "here/elsewhere", "gap exact", "gap ftdi16", "length", "scan");
    for (at, (name, wanted)) in WANTED.iter().enumerate() {
        let cell = |algorithm, mode| outcome.mean(at, algorithm, mode, |score| score.frames_with_direction().f1()).unwrap();
        let here = [cell(0, 0), cell(0, 1), cell(1, 0), cell(2, 0)];
        let cells: Vec<String> = here.iter().zip(wanted).map(|(a, b)| format!("{a:>8.2}/{b:>7.2}")).collect();
        println!("{name:<12} {}", cells.join(" "));
        // Adapters differ most: what a 16 ms timer leaves depends on baud rates and pauses, which the seeds draw.
        for ((mine, theirs), slack) in here.iter().zip(wanted).zip([6.0, 16.0, 4.0, 3.0]) {
            assert!((mine - theirs).abs() < slack, "{name}: {mine}, elsewhere {theirs}");
        }
    }
}

#[test]
fn noise_fools_the_rivals_as_much_as_elsewhere() {
    let per_mb = |algorithm: &mut dyn Algorithm, pattern: Pattern| {
        let noise = NoiseCase::new(pattern, 1, 1_000_000, TapMode::None, false);
        false_frames(&algorithm.run(&noise.case), noise.from).0 as f64
    };
    let uniform = per_mb(&mut Scan, Pattern::Uniform);
    assert!((2568.0 - uniform).abs() < 200.0, "{uniform}");
    let zeros = per_mb(&mut Length, Pattern::ZerosOnes);
    assert!((19_579.0 / zeros - 1.0).abs() < 0.25, "{zeros}");
    let uniform = per_mb(&mut Length, Pattern::Uniform);
    assert!((2.0..25.0).contains(&uniform), "{uniform}");
}

#[test]
fn colons_and_bulk() {
    let ascii = Traffic::new(Scenario::named("ascii").unwrap(), 1, 600).tap(TapMode::Exact);
    assert!(score(&ascii, &Colon.run(&ascii)).frames_with_direction().f1() > 0.99);
    let bulk = Mixed::case(1, 400_000, false);
    assert!(score(&bulk, &Length.run(&bulk)).frames_with_direction().f1() > 0.999);
}

#[test]
fn two_lines_need_no_guess_at_the_direction() {
    let case = Traffic::new(Scenario::named("lines").unwrap(), 1, 1000).tap(TapMode::Exact);
    let score = score(&case, &Scan.run(&case));
    assert_eq!(score.matched, score.matched_with_direction);
    assert!(score.pairs.f1() > 0.95, "{:?}", score.pairs);
}
