//! The command line of the bench.

use crate::accuracy::{NoisePlan, RunPlan};
use crate::sim::noise::Pattern;
use crate::sim::scenario::{Scenario, HEADLINE};
use crate::sim::tap::TapMode;
use crate::speed::MeasuredLayer;

/// The text of `--help`.
pub const HELP: &str = "\
modlens-bench accuracy [options]   scenarios x tap modes, for the rivals and for modlens
modlens-bench noise [options]      false frames per MB of noise only
modlens-bench calibration [options]  stated odds of frames against counted errors
modlens-bench beyond [options]     lines beyond the scenarios: accuracy, and stated odds against counted errors
modlens-bench differences [options]  the bytes around every missed, false or mislabelled frame
modlens-bench odds [options]       how often transactions are wrong, by the odds that they state
modlens-bench damaged [options]    the bytes around every damaged frame missed or invented
modlens-bench speed [options]      MB a CPU second, and memory over noise
modlens-bench write [options]      one case as chunk log and truth (JSON lines)
modlens-bench bulk [options]       clean mixed traffic as raw bytes
modlens-bench family [options]     one kind of the family of workloads as a recording; without --out, names of the kinds
modlens-bench scenarios            names of the scenarios

  --scenarios a,b|all|further  default: the twenty of the headline
  --modes a,b                  exact ms1 ftdi1 ftdi16 ch340 fifo tcp none; default: all
  --algorithms a,b             gap length scan colon modlens modlens-live modlens-silence; default: all
  --seeds N                    seeds N0+1 .. N0+N; default 3
  --first-seed N0              default 0
  --frames N                   per case, default 3000
  --noise-mb N                 MB of each noise, 0 for none; default 1
  --noise-mode MODE            how noise is tapped; default none
  --patterns a,b               uniform 00_ff bus13 single_bit wrong_baud inverted runs slow_squares floating
                               repeating_poll foreign; default: all
  --threads N                  default 1
  --out PATH                   write: PATH.jsonl and PATH.truth.jsonl; bulk, family: the file
  --bytes N                    bulk, family: default 64000000; speed: of each load
  --only TEXT                  speed, beyond: loads or lines whose names have this in them; family: the kind
  --folder PATH                beyond: recordings NAME.jsonl with their frames in NAME.expected.jsonl
  --layer NAME                 speed: framing, transactions or everything; default: all
  --dirty                      bulk: with flipped bits and stray bytes
";

/// The parsed options.
#[derive(Clone, Debug)]
pub struct Options {
    /// The runs on simulated traffic.
    pub plan: RunPlan,
    /// The runs on noise.
    pub noise: NoisePlan,
    /// The path or the stem of the files to write.
    pub out: Option<String>,
    /// The folder of recordings that are scored in place of the lines beyond the scenarios.
    pub folder: Option<String>,
    /// The number of bytes of bulk traffic, or of each load of a speed measurement.
    pub bytes: usize,
    /// Only loads with this text in their name are measured; `None` for all.
    pub only: Option<String>,
    /// The layer to measure; `None` for all.
    pub layer: Option<MeasuredLayer>,
    /// Bulk traffic contains damage.
    pub dirty: bool,
}

impl Options {
    /// Reads the options after the command.
    pub fn parse(arguments: &[String]) -> Result<Self, String> {
        let mut this = Self::default();
        let (mut count, mut first) = (3, 0);
        let mut rest = arguments.iter();
        while let Some(key) = rest.next() {
            if key == "--dirty" {
                this.dirty = true;
                continue;
            }
            let value = rest.next().ok_or_else(|| format!("{key} needs a value; see --help"))?;
            match key.as_str() {
                "--scenarios" => this.plan.scenarios = scenarios(value)?,
                "--modes" => this.plan.modes = list(value, "tap mode", TapMode::named)?,
                "--algorithms" => this.plan.algorithms = value.split(',').map(String::from).collect(),
                "--seeds" => count = number(key, value)?,
                "--first-seed" => first = number(key, value)?,
                "--frames" => this.plan.frames = number(key, value)?,
                "--noise-mb" => this.noise.bytes = 1_000_000 * number(key, value)?,
                "--noise-mode" => this.noise.mode = list(value, "tap mode", TapMode::named)?[0],
                "--patterns" => this.noise.patterns = list(value, "pattern", Pattern::named)?,
                "--threads" => this.plan.threads = number(key, value)?,
                "--folder" => this.folder = Some(value.clone()),
                "--out" => this.out = Some(value.clone()),
                "--only" => this.only = Some(value.clone()),
                "--layer" => this.layer = Some(MeasuredLayer::named(value).ok_or_else(|| format!("{value} is no layer"))?),
                "--bytes" => this.bytes = number(key, value)?,
                other => return Err(format!("{other} is no option; see --help")),
            }
        }
        let seeds: Vec<u64> = (1..=count as u64).map(|seed| first as u64 + seed).collect();
        this.plan.seeds.clone_from(&seeds);
        this.noise.seeds = seeds;
        Ok(this)
    }
}

impl Default for Options {
    fn default() -> Self {
        let headline = Scenario::all().take(HEADLINE.len()).collect();
        Self {
            plan: RunPlan {
                scenarios: headline,
                modes: TapMode::ALL.to_vec(),
                seeds: vec![1, 2, 3],
                frames: 3000,
                algorithms: Vec::new(),
                threads: 1,
            },
            noise: NoisePlan { patterns: Pattern::ALL.to_vec(), bytes: 1_000_000, seeds: vec![1, 2, 3], mode: TapMode::None },
            out: None,
            folder: None,
            bytes: 64_000_000,
            only: None,
            layer: None,
            dirty: false,
        }
    }
}

fn scenarios(value: &str) -> Result<Vec<&'static Scenario>, String> {
    match value {
        "all" => Ok(Scenario::all().collect()),
        "further" => Ok(Scenario::all().skip(HEADLINE.len()).collect()),
        names => list(names, "scenario", Scenario::named),
    }
}

fn list<T>(value: &str, what: &str, named: impl Fn(&str) -> Option<T>) -> Result<Vec<T>, String> {
    value.split(',').map(|name| named(name).ok_or_else(|| format!("{name} is no {what}; see --help"))).collect()
}

fn number(key: &str, value: &str) -> Result<usize, String> {
    value.parse().map_err(|_| format!("{key} takes a number, not {value}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Options, String> {
        Options::parse(&text.split_whitespace().map(String::from).collect::<Vec<_>>())
    }

    #[test]
    fn options() {
        let options = parse("--scenarios clean,field --modes none --seeds 2 --first-seed 10 --frames 100").unwrap();
        assert_eq!(options.plan.seeds, [11, 12]);
        assert_eq!((options.plan.scenarios.len(), options.plan.modes[0], options.plan.frames), (2, TapMode::None, 100));
        assert_eq!(parse("").unwrap().plan.scenarios.len(), 20);
        assert_eq!(parse("--scenarios all").unwrap().plan.scenarios.len(), Scenario::all().count());
    }

    #[test]
    fn mistakes_are_named() {
        assert!(parse("--scenarios nonsense").unwrap_err().contains("nonsense is no scenario"));
        assert!(parse("--frames many").unwrap_err().contains("takes a number"));
        assert!(parse("--nothing 1").unwrap_err().contains("no option"));
        assert!(parse("--seeds").unwrap_err().contains("needs a value"));
    }
}
