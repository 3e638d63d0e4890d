//! The first estimate: by how much the clocks differ, which server the gateway is, and which units it renames.
//!
//! Each pair of equal exchanges (same request and response, whatever the unit) votes for a difference of the clocks, the more
//! the rarer they are. Polls vote for every multiple of their period as well, so the best differences are tried: the right one
//! matches most, and with delays that vary least.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use modlens_protocol::Ns;

use super::clock::LATENESS;
use super::exchange::Exchange;

/// Exchanges of each side that are compared with each other.
pub(super) const SAMPLE: usize = 4000;

/// Width of the bins in which differences are counted.
const BIN: Ns = 20_000_000;

/// Differences that are tried.
const TRIED: usize = 48;

/// Fewer matches than this show nothing.
const MIN_MATCHES: usize = 3;

/// Matches from which the first difference is taken: few enough that clocks do not drift meanwhile.
const FIRST: usize = 64;

/// A trial that matches this share of what the best one does is as good; the spread of its delays decides.
const AS_GOOD: f64 = 0.97;

/// What the first exchanges show.
#[derive(Clone, Debug)]
pub(super) struct Alignment {
    /// Bus of the gateway on the network.
    pub server: Arc<str>,
    /// Line's clock minus network's clock.
    pub offset: Ns,
    /// Unit on the network -> unit on the line.
    pub units: BTreeMap<u8, u8>,
    /// Another difference that matches as well: the traffic does not tell them apart.
    pub rival: Option<Ns>,
}

struct Trial {
    server: Arc<str>,
    offset: Ns,
    matches: Vec<(u8, u8)>,
    spread: Ns,
}

/// Aligns samples of both sides; `None` where they have nothing in common. Differences are at most `reach`, if that is known.
pub(super) fn align(network: &[&Exchange], line: &[&Exchange], reach: Option<Ns>) -> Option<Alignment> {
    let mut servers: Vec<&Arc<str>> = network.iter().map(|one| &one.bus).collect();
    servers.sort_unstable();
    servers.dedup();
    let mut trials = Vec::new();
    for server in servers {
        let upstream: Vec<&Exchange> = network.iter().copied().filter(|one| one.bus == *server).collect();
        for offset in candidates(&upstream, line, reach) {
            trials.push(trial(server, &upstream, line, offset));
        }
    }
    let most = trials.iter().map(|trial| trial.matches.len()).max().filter(|most| *most >= MIN_MATCHES)?;
    trials.retain(|trial| trial.matches.len() as f64 >= AS_GOOD * most as f64);
    trials.sort_by_key(|trial| (trial.spread, trial.offset.abs()));
    let best = &trials[0];
    let is_rival = |trial: &&Trial| {
        (trial.offset - best.offset).abs() > 10 * BIN && trial.spread < 2 * best.spread + 1_000_000 && trial.server == best.server
    };
    let rival = trials[1..].iter().find(is_rival).map(|trial| trial.offset);
    Some(Alignment { server: Arc::clone(&best.server), offset: best.offset, units: units(&best.matches), rival })
}

type Content<'a> = (&'a [u8], &'a [u8]);

fn by_content<'a>(exchanges: &[&'a Exchange]) -> HashMap<Content<'a>, Vec<Ns>> {
    let mut found: HashMap<Content<'a>, Vec<Ns>> = HashMap::new();
    for one in exchanges.iter().filter(|one| one.is_answered() && !one.request.is_empty()) {
        found.entry((&one.request, &one.response)).or_default().push(one.start);
    }
    found
}

/// The differences with most votes.
fn candidates(network: &[&Exchange], line: &[&Exchange], reach: Option<Ns>) -> Vec<Ns> {
    let (above, below) = (by_content(network), by_content(line));
    let mut votes: HashMap<Ns, f32> = HashMap::new();
    for (content, times) in &above {
        let Some(others) = below.get(content) else { continue };
        let weight = 1.0 / times.len().max(others.len()) as f32;
        for time in times {
            for other in others {
                let difference = other - time;
                if reach.is_none_or(|reach| difference.abs() <= reach) {
                    *votes.entry(difference.div_euclid(BIN)).or_default() += weight;
                }
            }
        }
    }
    // Delays spread over neighbours; the bin itself counts twice, so that it is the middle one.
    let total = |bin: Ns| [bin - 1, bin, bin, bin + 1].iter().filter_map(|bin| votes.get(bin)).sum::<f32>();
    let mut bins: Vec<(f32, Ns)> = votes.keys().map(|bin| (total(*bin), *bin)).collect();
    bins.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
    let mut found: Vec<Ns> = Vec::new();
    for (_, bin) in bins {
        if found.iter().all(|other| (other - bin).abs() > 2) {
            found.push(bin);
            if found.len() == TRIED {
                break;
            }
        }
    }
    found.into_iter().map(|bin| bin * BIN + BIN / 2).collect()
}

/// Matches both samples in order with a difference, one to one: the response that was returned first after that of the line.
fn trial(server: &Arc<str>, network: &[&Exchange], line: &[&Exchange], offset: Ns) -> Trial {
    let mut waiting: HashMap<Content<'_>, Vec<(Ns, Ns, u8)>> = HashMap::new();
    for one in network.iter().filter(|one| one.is_answered()) {
        let row = (one.start + offset, one.end.unwrap_or(one.start) + offset, one.unit);
        waiting.entry((&one.request, &one.response)).or_default().push(row);
    }
    let slack = LATENESS + BIN;
    let (mut matches, mut delays, mut returns) = (Vec::new(), Vec::new(), Vec::new());
    for one in line.iter().filter(|one| one.is_answered()) {
        let (Some(rows), end) = (waiting.get_mut(&(&*one.request, &*one.response)), one.end.unwrap_or(one.start)) else {
            continue;
        };
        let begin = rows.partition_point(|row| row.1 + slack < end);
        let fits = |row: &(Ns, Ns, u8)| row.0 - slack <= one.start && row.1 + slack >= end;
        if let Some(at) = (begin..rows.len().min(begin + 64)).find(|at| fits(&rows[*at])) {
            let (start, upstream_end, unit) = rows.remove(at);
            delays.push(one.start - start);
            returns.push(end - upstream_end);
            matches.push((unit, one.unit));
        }
    }
    let offset = offset + first_difference(&delays, &returns);
    delays.sort_unstable();
    let spread = eighth(&delays, 6) - eighth(&delays, 2);
    Trial { server: Arc::clone(server), offset, matches, spread }
}

/// By how much the difference is off at the beginning: between nearly all delays of requests and of responses there.
fn first_difference(delays: &[Ns], returns: &[Ns]) -> Ns {
    let sorted = |all: &[Ns]| {
        let mut first = all[..all.len().min(FIRST)].to_vec();
        first.sort_unstable();
        first
    };
    let (most, least) = (eighth(&sorted(delays), 1), eighth(&sorted(returns), 7));
    least + (most - least) / 2
}

/// An eighth of sorted numbers; 0 without any.
fn eighth(sorted: &[Ns], share: usize) -> Ns {
    sorted.get(sorted.len() * share / 8).copied().unwrap_or(0)
}

/// Which unit of the line most exchanges of a unit on the network were matched with.
fn units(matches: &[(u8, u8)]) -> BTreeMap<u8, u8> {
    let mut counts: BTreeMap<u8, BTreeMap<u8, usize>> = BTreeMap::new();
    for (above, below) in matches {
        *counts.entry(*above).or_default().entry(*below).or_default() += 1;
    }
    let most =
        |below: BTreeMap<u8, usize>| below.into_iter().max_by_key(|(unit, count)| (*count, 255 - *unit)).map(|best| best.0);
    counts.into_iter().filter_map(|(above, below)| Some((above, most(below)?))).collect()
}
