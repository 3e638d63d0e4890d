//! `modlens-bench`: prints tables of accuracy and speed, and writes simulated recordings.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::process::ExitCode;

use modlens_bench::accuracy::{Makers, RunPlan};
use modlens_bench::adapter::Modlens;
use modlens_bench::differences::{damaged_differences, differences};
use modlens_bench::family::{kinds, written};
use modlens_bench::options::{Options, HELP};
use modlens_bench::reported::{Algorithm, ReportedFrame};
use modlens_bench::score::{odds, Score};
use modlens_bench::sim::bulk::{Bulk, Mixed};
use modlens_bench::sim::case::{Case, Traffic};
use modlens_bench::sim::output::{write_chunk_log, write_truth};
use modlens_bench::sim::scenario::Scenario;
use modlens_bench::speed::{self, Load, MeasuredLayer};
use modlens_bench::{baselines, beyond, tables};

/// Bulk traffic is written in blocks of this size.
const BLOCK_BYTES: usize = 1 << 20;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("modlens-bench: {why}");
            ExitCode::from(2)
        }
    }
}

/// Runs a command; the error message is for the user.
fn run(arguments: &[String]) -> Result<(), String> {
    let Some((command, rest)) = arguments.split_first().filter(|(first, _)| *first != "--help") else {
        print(HELP);
        return Ok(());
    };
    let options = Options::parse(rest)?;
    match command.as_str() {
        "accuracy" => accuracy(&options),
        "noise" => noise(&options),
        "calibration" => print(&tables::calibration(&options.plan.run(MAKERS))),
        "beyond" => beyond(&options)?,
        "differences" => show_differences(&options, differences),
        "odds" => odds(&options),
        "damaged" => show_differences(&options, damaged_differences),
        "speed" => show_speed(&options),
        "write" => write(&options).map_err(|why| why.to_string())?,
        "bulk" => bulk(&options).map_err(|why| why.to_string())?,
        "family" => family(&options).map_err(|why| why.to_string())?,
        "scenarios" => Scenario::all().for_each(|scenario| print(&format!("{}\n", scenario.name))),
        other => return Err(format!("{other} is no command; see --help")),
    }
    Ok(())
}

/// Prints a text. If the output is closed, as by `head`, the program ends without an error.
fn print(text: &str) {
    if io::stdout().write_all(text.as_bytes()).is_err() {
        std::process::exit(0);
    }
}

fn algorithms() -> Vec<Box<dyn Algorithm>> {
    let mut all = baselines::all();
    all.push(Box::new(Modlens::offline()));
    all.push(Box::new(Modlens::live()));
    all.push(Box::new(Modlens::textbook()));
    all
}

const MAKERS: Makers = algorithms;

/// Prints the tables of accuracy, and that of noise if it is wanted.
fn accuracy(options: &Options) {
    for plan in options.plan.groups() {
        accuracy_of_group(&plan);
    }
    if options.noise.bytes > 0 {
        noise(options);
    }
}

/// Prints the tables of accuracy of scenarios that belong together.
fn accuracy_of_group(plan: &RunPlan) {
    let outcome = plan.run(MAKERS);
    if let Some(group) = plan.scenarios.first().map(|scenario| scenario.group()).filter(|group| !group.is_empty()) {
        print(&format!("\n== {group}\n"));
    }
    for algorithm in 0..outcome.names.len() {
        print(&tables::by_mode(plan, &outcome, algorithm, "F1 of start, end and direction", |s: &Score| {
            s.frames_with_direction().f1()
        }));
        print(&tables::by_mode(plan, &outcome, algorithm, "pair F1", |s: &Score| s.pairs.f1()));
        if outcome.gives_labels[algorithm] {
            let title = "damaged frames located";
            print(&tables::by_mode(plan, &outcome, algorithm, title, |s: &Score| s.damaged.recall()));
            let title = "wrong direction at stated odds of 1000 to 1 or better";
            print(&tables::by_mode(plan, &outcome, algorithm, title, Score::wrong_of_sure));
        }
    }
    print(&tables::totals(&outcome));
    print(&tables::labels(plan, &outcome));
    print(&tables::latencies(&outcome));
}

fn noise(options: &Options) {
    let names: Vec<&str> = options.plan.chosen_algorithms(MAKERS).iter().map(|algorithm| algorithm.name()).collect();
    let rows = options.noise.run(&options.plan, MAKERS);
    print(&tables::noise(&names, &rows));
}

/// Prints the figures of lines beyond the scenarios.
fn beyond(options: &Options) -> Result<(), String> {
    let cases = beyond::cases(&options.plan, options.folder.as_deref(), options.only.as_deref())?;
    print(&beyond::table(&options.plan, MAKERS, &cases));
    Ok(())
}

/// Prints how often transactions are wrong, by the odds that they state.
fn odds(options: &Options) {
    let plan = &options.plan;
    let mut odds = odds::Odds::default();
    for scenario in &plan.scenarios {
        for &seed in &plan.seeds {
            let traffic = Traffic::new(scenario, seed, plan.frames);
            for &mode in &plan.modes {
                let case = traffic.tap(mode);
                for mut algorithm in plan.chosen_algorithms(MAKERS) {
                    odds::count(&case, &algorithm.run(&case), &mut odds);
                }
            }
        }
    }
    print(&odds::table(&odds));
}

/// Prints the differences of every case and algorithm of the plan.
fn show_differences(options: &Options, differences: fn(&Case, &[ReportedFrame]) -> String) {
    let plan = &options.plan;
    for scenario in &plan.scenarios {
        for &seed in &plan.seeds {
            let traffic = Traffic::new(scenario, seed, plan.frames);
            for &mode in &plan.modes {
                let case = traffic.tap(mode);
                for mut algorithm in plan.chosen_algorithms(MAKERS) {
                    if algorithm.reads(&case) {
                        let what = differences(&case, &algorithm.run(&case));
                        print(&format!("== {} {} seed {seed}, {}\n{what}", scenario.name, mode.text(), algorithm.name()));
                    }
                }
            }
        }
    }
}

/// Prints the speed of every load and layer in MB per CPU second, then the memory that a long noise takes.
fn show_speed(options: &Options) {
    let seed = options.plan.seeds[0];
    print("MB a CPU second, one thread; * where four times the bytes took more than six times as long\n");
    let layers: Vec<MeasuredLayer> =
        MeasuredLayer::ALL.into_iter().filter(|layer| options.layer.is_none_or(|only| *layer == only)).collect();
    let row =
        |name: &str, cells: Vec<String>| cells.iter().fold(format!("{name:<18}"), |row, cell| format!("{row}{cell:>13}")) + "\n";
    print(&row("", layers.iter().map(|layer| layer.name().to_owned()).collect()));
    for (name, load) in Load::ALL.into_iter().filter(|(name, _)| options.only.as_ref().is_none_or(|only| name.contains(only))) {
        let bytes = load.bytes(options.bytes, seed);
        let cells = layers.iter().map(|&layer| speed::rate(layer, load.mode(), &bytes));
        print(&row(name, cells.map(|(rate, linear)| format!("{rate:.0}{}", if linear { " " } else { "*" })).collect()));
    }
    if options.noise.bytes > 0 {
        let bytes = options.noise.bytes as u64;
        if let Some((early, late)) = speed::memory(bytes, seed) {
            print(&format!(
                "peak memory {early:.1} MB after {} MB of noise, {late:.1} MB after {}\n",
                bytes / 16_000_000,
                bytes / 1_000_000
            ));
        }
    }
}

/// Writes one chunk log and one file of the truth per scenario, mode and seed.
fn write(options: &Options) -> io::Result<()> {
    let plan = &options.plan;
    let many = plan.scenarios.len() * plan.modes.len() * plan.seeds.len() > 1;
    let stem = options.out.as_deref().unwrap_or("case");
    for scenario in &plan.scenarios {
        for &seed in &plan.seeds {
            let traffic = Traffic::new(scenario, seed, plan.frames);
            for &mode in &plan.modes {
                let name = if many { format!("{stem}-{}-{}-{seed}", scenario.name, mode.text()) } else { stem.into() };
                let case = traffic.tap(mode);
                let mut log = BufWriter::new(File::create(format!("{name}.jsonl"))?);
                write_chunk_log(&case, &mut log)?;
                log.flush()?;
                let mut truth = BufWriter::new(File::create(format!("{name}.truth.jsonl"))?);
                write_truth(&case, &mut truth)?;
                truth.flush()?;
                print(&format!("{name}.jsonl: --line {} ({} frames)\n", case.settings.text(), case.truth.len()));
            }
        }
    }
    Ok(())
}

fn bulk(options: &Options) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(options.out.as_deref().unwrap_or("bulk.bin"))?);
    let mut mixed = Mixed::new(options.plan.seeds[0], options.dirty);
    let (mut bulk, mut left) = (Bulk::default(), options.bytes);
    while left > 0 {
        bulk.bytes.clear();
        bulk.frames.clear();
        mixed.more(left.min(BLOCK_BYTES), &mut bulk);
        left = left.saturating_sub(bulk.bytes.len());
        file.write_all(&bulk.bytes)?;
    }
    file.flush()
}

/// Writes a recording of one kind of the family, and prints the truth about it as JSON; without a file, the kinds.
fn family(options: &Options) -> io::Result<()> {
    let Some(path) = options.out.as_deref() else {
        for kind in kinds::KINDS {
            print(&format!("{}.{}\n", kind.name, kind.form.extension()));
        }
        return Ok(());
    };
    let kind = options.only.as_deref().and_then(kinds::named).ok_or_else(|| io::Error::other("--only is the name of a kind"))?;
    let mut file = BufWriter::new(File::create(path)?);
    let truth = written::write(kind, options.plan.seeds[0], options.bytes, &mut file)?;
    file.flush()?;
    print(&format!("{}\n", truth.json()));
    Ok(())
}
