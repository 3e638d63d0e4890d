//! Refusals: which requests are refused, and which ones beside them are answered.
#![allow(clippy::trivially_copy_pass_by_ref)] // Keys stay in their map.

use super::blocks::{covered, end, range_in_words, uncovered};
use super::writes::is_of_value;
use crate::claim::{Claim, View, REFUSED_BY_ACCIDENT, SUGGESTED};
use crate::contrast::RequestCounts;
use crate::observation::RequestKey;
use crate::statistics::{at_least, in_runs_at_most, Share};
use crate::MAX_CHANCE;
use modlens_protocol::functions::Functions;

/// A request that has a range, with what came of it.
type Request<'a> = (&'a RequestKey, &'a RequestCounts);

/// Requests that were refused with exception 2 or 3 each time, or from one moment on to another; twice at least. Values that are
/// refused say nothing about addresses.
fn refused<'a>(all: &[Request<'a>]) -> Vec<Request<'a>> {
    let is_refused = |(key, counts): &Request<'a>| {
        is_always_refused(counts) && for_address(all, key, counts) + counts.refused_with(3) >= 2 && !is_of_value(key, counts)
    };
    all.iter().filter(|request| is_refused(request)).copied().collect()
}

/// How often a request was refused for its addresses: exception 1 says so of a function that the unit answers elsewhere, and the
/// function of no other one.
fn for_address(all: &[Request<'_>], key: &RequestKey, counts: &RequestCounts) -> u64 {
    let is_known = counts.refused_with(1) > 0 && !answered(all, key).is_empty();
    counts.refused_with(2) + if is_known { counts.refused_with(1) } else { 0 }
}

/// Whether a request was never answered, or is refused in long runs: what does not come and go is no load.
fn is_always_refused(counts: &RequestCounts) -> bool {
    let (runs, share) = (&counts.refusal_runs, Share { failed: counts.refusals(), total: counts.refusal_runs.total() });
    let in_long = runs.in_long();
    let is_in_runs = || in_runs_at_most(share, runs.count_of_long() + share.failed - in_long) < MAX_CHANCE;
    counts.good == 0 || (in_long * 10 >= share.failed * 9 && runs.longest >= LONG_REFUSAL && is_in_runs())
}

/// A shorter run of refusals may be a busy moment.
const LONG_REFUSAL: u64 = 5;

/// How many of the same request were refused.
fn refused_of((_, counts): &Request<'_>) -> Share {
    Share { failed: counts.refusals(), total: counts.sent() }
}

/// Good answers to requests of the same unit and function as this one.
fn answered<'a>(all: &[Request<'a>], key: &RequestKey) -> Vec<&'a RequestKey> {
    let is_like = |other: &RequestKey, counts: &RequestCounts| {
        other.unit == key.unit && other.function == key.function && counts.good > 0 && !is_always_refused(counts)
    };
    all.iter().filter(|(other, counts)| is_like(other, counts)).map(|(other, _)| *other).collect()
}

fn claim(view: &View<'_>, code: &'static str, request: Request<'_>) -> Option<Claim> {
    let (key, counts) = request;
    let share = Share { failed: counts.refusals() + counts.silent, total: counts.sent() };
    let chance = view.corrected(at_least(share, REFUSED_BY_ACCIDENT));
    // Of a few requests, each is an example; how certain it is, the report says.
    (chance < SUGGESTED || view.is_small()).then(|| {
        Claim::new(code, &counts.bad, chance)
            .of_unit(key.unit)
            .at(key.function, key.address)
            .with_share(share)
            .fact("block", key.block())
    })
}

/// What a refused request is, as far as those beside it tell.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Reason {
    OffByOne(u16),
    /// It begins one after a block that is answered, and its last registers are answered nowhere: it is off by one, or they do not
    /// exist.
    OffByOneOrHole(u16),
    /// Its address is a number of manuals, which stands for this one.
    OfManuals(u16),
    TooLong {
        good: u16,
    },
    Hole,
    Unknown,
}

fn reason(all: &[Request<'_>], request: Request<'_>) -> Reason {
    let key = request.0;
    let good = answered(all, key);
    let shifted = good.iter().find(|other| other.quantity == key.quantity && other.address.abs_diff(key.address) == 1);
    if let Some(neighbour) = request.1.aligned_at.or(shifted.map(|other| other.address)) {
        return Reason::OffByOne(neighbour);
    }
    let longest = good.iter().map(|other| other.quantity).max();
    let shortest_bad = refused(all)
        .iter()
        .filter(|(other, _)| other.unit == key.unit && other.function == key.function)
        .map(|(other, _)| other.quantity)
        .min();
    let is_limit = longest.zip(shortest_bad).is_some_and(|(longest, shortest)| longest < shortest);
    let covered = covered(key, &good);
    // Where each register is answered in some other block, none is missing; where one is, all that are refused have it.
    let is_near = longest.zip(shortest_bad).is_some_and(|(longest, shortest)| shortest > longest && is_sharp(longest, shortest));
    let no_hole = covered == u32::from(key.quantity) || has_no_hole(all, key) || (is_near && several_refused(all, key));
    if let (true, Some(longest)) = (is_limit && (no_hole || request.1.refused_with(3) > request.1.refused_with(2)), longest) {
        return Reason::TooLong { good: longest };
    }
    if let (Some(first), 1) = (key.address.checked_sub(1), key.address % 10) {
        // Who counts from 1 begins at 1, 11 or 101.
        let begins = good.iter().any(|other| other.address == first);
        if begins && uncovered(key, &good).first().is_some_and(|(_, to)| *to == end(key)) {
            return Reason::OffByOneOrHole(first);
        }
    }
    match key.meant_by_manuals() {
        _ if covered > 0 => Reason::Hole,
        Some(meant) if good.iter().all(|other| other.meant_by_manuals().is_none()) => Reason::OfManuals(meant),
        _ => Reason::Unknown,
    }
}

/// Whether one register that is missing cannot explain all refusals of the function: all of those blocks have in common none,
/// or only registers that are answered elsewhere.
fn has_no_hole(all: &[Request<'_>], key: &RequestKey) -> bool {
    let is_like = |other: &&RequestKey| other.unit == key.unit && other.function == key.function;
    let refused = refused(all);
    let blocks: Vec<&RequestKey> = refused.iter().map(|(other, _)| *other).filter(is_like).collect();
    let (Some(first), Some(last)) = (blocks.iter().map(|one| one.address).max(), blocks.iter().map(|one| end(one)).min()) else {
        return false;
    };
    let common = u16::try_from(last.saturating_sub(u32::from(first))).unwrap_or(0);
    let common = RequestKey { address: first, quantity: common, ..*key };
    blocks.len() > 1 && covered(&common, &answered(all, key)) == u32::from(common.quantity)
}

/// Whether several blocks of the function are refused. That one hole is in all of them and in none of the others, and those are all
/// shorter, is much less likely than a limit.
fn several_refused(all: &[Request<'_>], key: &RequestKey) -> bool {
    refused(all).iter().filter(|(other, _)| other.unit == key.unit && other.function == key.function).count() > 1
}

/// An address that is refused while its neighbour is answered.
pub(super) fn address_off_by_one(view: &View<'_>) -> Vec<Claim> {
    let all = &view.requests;
    let few = || all.iter().filter(|(_, counts)| view.is_small() && counts.good == 0 && counts.refused_with(2) > 0).copied();
    let refused = refused(all);
    let claims = if refused.is_empty() { few().collect() } else { refused }.into_iter().filter_map(|request| {
        let shifted = |address| RequestKey { address, ..*request.0 }.block();
        let (neighbour, how, why, rival) = match reason(all, request) {
            Reason::OffByOne(neighbour) => {
                let why = match request.1.aligned_at {
                    Some(_) => format!("values of the profile are at {}", shifted(neighbour)),
                    None => format!("those for {} were answered", shifted(neighbour)),
                };
                (neighbour, "that are off by one", why, None)
            }
            Reason::OffByOneOrHole(neighbour) => {
                let left = uncovered(request.0, &answered(all, request.0));
                let left = left.first().map_or(String::new(), |range| range_in_words(*range));
                let why = format!("blocks from {neighbour} on were answered; or of {left} some do not exist");
                (neighbour, "that are off by one", why, Some("register_hole"))
            }
            // Of a few requests the first sight says it; of many blocks, that none exists.
            Reason::OfManuals(meant) if !view.is_small() && no_address(view, all, request.0.unit).is_none() => {
                let why = format!("{} is how manuals number address {meant} of the wire", request.0.address);
                (meant, "as manuals number them", why, Some("register_hole"))
            }
            _ => return None,
        };
        let claim = claim(view, "address_off_by_one", request)?.fact("neighbour", shifted(neighbour));
        Some(claim.fact("how", how).fact("why", why).undecided_from(rival))
    });
    claims.collect()
}

/// A block of which parts are answered, or blocks that a unit refuses from one moment on.
pub(super) fn register_hole(view: &View<'_>) -> Vec<Claim> {
    let all = &view.requests;
    let of_unit = |unit| lost_addresses(view, all, unit).or_else(|| no_address(view, all, unit));
    let lost: Vec<(u8, Claim)> = view.units().filter_map(|(unit, _)| Some((unit, of_unit(unit)?))).collect();
    let claims = refused(all).into_iter().filter_map(|request| {
        if is_function_refused(all, request.0) || lost.iter().any(|(unit, _)| *unit == request.0.unit) {
            return None;
        }
        let parts = match reason(all, request) {
            Reason::Hole => parts_in_words(all, request.0),
            // Refusals of a value tell nothing about addresses.
            Reason::Unknown if request.1.refused_with(2) > 0 => String::new(),
            Reason::Unknown if for_address(all, request.0, request.1) > 0 => {
                format!(" (exception 1), and others for function {} were answered", request.0.function)
            }
            Reason::OfManuals(_) if view.is_small() => String::new(),
            _ => return None,
        };
        let (missing, what_to_check, experiment) = hole_in_words(request.0);
        let claim = claim(view, "register_hole", request)?.fact("parts", parts).fact("missing", missing);
        Some(claim.fact("what_to_check", what_to_check).fact("experiment", experiment))
    });
    claims.chain(lost.iter().map(|(_, claim)| claim.clone())).collect()
}

/// Which parts of a block were answered: all but a few, where other blocks tell that.
fn parts_in_words(all: &[Request<'_>], key: &RequestKey) -> String {
    let left = uncovered(key, &answered(all, key));
    match left[..] {
        [range] if range.1 - range.0 < u32::from(key.quantity) / 2 => {
            format!(", and all but {} of them were answered in other blocks", range_in_words(range))
        }
        _ => String::from(", and parts of it were answered"),
    }
}

/// A unit that answered several blocks and refuses the addresses of all that it is asked for from then on: one thing has
/// changed, not the map of each block.
fn lost_addresses(view: &View<'_>, all: &[Request<'_>], unit: u8) -> Option<Claim> {
    let of_unit: Vec<Request<'_>> = all.iter().filter(|(key, _)| key.unit == unit).copied().collect();
    let is_lost = |counts: &RequestCounts| counts.good > 0 && counts.refused_with(2) >= 2 && is_always_refused(counts);
    if of_unit.len() < 2 || !of_unit.iter().all(|(_, counts)| is_lost(counts)) {
        return None;
    }
    let share: Share = of_unit.iter().map(refused_of).sum();
    let chance = view.significant(at_least(share, REFUSED_BY_ACCIDENT))?;
    let mut blocks: Vec<String> = of_unit.iter().map(|(key, _)| key.block()).collect();
    blocks.dedup();
    let claim = Claim::new("register_hole", &view.bus.units.get(&unit)?.exceptions[2], chance).of_unit(unit).with_share(share);
    let claim = claim.fact("missing", format!("all that was asked for ({}) no longer exists", blocks.join(", ")));
    let check = "What was changed in the device at that time: its mode, configuration or firmware. Then its register map.";
    let experiment = "Ask for a register that the device's manual names: if it is refused as well, the device is not ready.";
    Some(claim.fact("what_to_check", check).fact("experiment", experiment))
}

/// A unit that refuses the addresses of all blocks that it was ever asked for: the map as a whole is another one.
fn no_address(view: &View<'_>, all: &[Request<'_>], unit: u8) -> Option<Claim> {
    let counts = view.bus.units.get(&unit)?;
    let (refused, total) = (&counts.exceptions[2], counts.failures.total);
    let blocks = all.iter().filter(|(key, counts)| key.unit == unit && counts.refused_with(2) > 0).count();
    let is_answered = all.iter().any(|(key, counts)| key.unit == unit && counts.good > 0);
    if blocks < 2 || is_answered || refused.failed + counts.failures.failed < total {
        return None;
    }
    let share = Share { failed: refused.failed, total };
    let chance = view.significant(at_least(share, REFUSED_BY_ACCIDENT))?;
    let claim = Claim::new("register_hole", refused, chance).of_unit(unit).with_share(share);
    let check = "Whether the addresses count from 0 (40001 in a manual is address 0 on the wire), the function (input registers are function 4, holding registers 3), and whether the device of this unit is the one whose map the master has.";
    let experiment = "Ask for one register that the manual names: at its address, at the one before, and by the other function.";
    let missing = format!("nothing that was asked for ({blocks} blocks) exists");
    Some(claim.fact("missing", missing).fact("what_to_check", check).fact("experiment", experiment))
}

/// What does not exist, what to check and what would prove it; a single register has no halves.
fn hole_in_words(key: &RequestKey) -> (String, &'static str, String) {
    let block = key.block();
    if key.quantity == 1 {
        let check = "The register map of the device, whether its addresses count from 0 or 1, and the function: input registers are function 4, holding registers 3.";
        let experiment = "Ask for the address before, for the one after, and for the same one by the other function.";
        return (format!("{block} does not exist"), check, String::from(experiment));
    }
    (
        format!("some of {block} do not exist"),
        "The register map of the device: split the request, so that it leaves the missing registers out.",
        format!("Ask for the two halves of {block} one by one: one is answered, the other is refused."),
    )
}

/// Blocks that fail above a quantity, or whose quantity the protocol does not allow.
pub(super) fn block_too_long(view: &View<'_>) -> Vec<Claim> {
    let all = &view.requests;
    let mut found: Vec<Claim> = Vec::new();
    for request in failing(all) {
        let key = request.0;
        let Some((beside, greatest)) = limit(all, request) else { continue };
        if found.iter().any(|other| other.unit == Some(key.unit) && other.function.is_some_and(|one| is_akin(one, key.function)))
        {
            continue;
        }
        let is_of_kind = |other: &Request<'_>| is_like(other.0, key) && limit(all, *other).is_some();
        let of_kind = failing(all).into_iter().filter(is_of_kind);
        let least = of_kind.map(|(other, _)| other.quantity).min().unwrap_or(key.quantity);
        let Some(claim) = claim(view, "block_too_long", request) else { continue };
        let blocks = if least == 0 { String::from("blocks of 0") } else { format!("blocks of {least} or more") };
        found.push(claim.fact("blocks", blocks).fact("beside", beside).fact("greatest", greatest));
    }
    found
}

/// What is known beside blocks that are too long, and the greatest block to set; `None` where it is not their length.
fn limit(all: &[Request<'_>], request: Request<'_>) -> Option<(String, String)> {
    let (key, counts) = request;
    if let Reason::TooLong { good } = reason_of_length(all, request) {
        return Some((format!("blocks of up to {good} were answered"), good.to_string()));
    }
    let is_of_quantity = counts.refused_with(3) > counts.refused_with(2) && key.quantity != 1 && !is_of_value(key, counts);
    if !is_of_quantity || !answered(all, key).is_empty() {
        return None;
    }
    let row = Functions::embedded().row(key.function, &[]);
    match row.and_then(|row| row.limits("quantity")) {
        Some((low, high)) if !(low..=high).contains(&u32::from(key.quantity)) => {
            Some((format!("the protocol allows {low} to {high}"), format!("{low} to {high}")))
        }
        _ => Some((String::from("shorter ones were not asked for"), String::from("a smaller one"))),
    }
}

/// Requests that are refused each time, or never answered while shorter ones are.
fn failing<'a>(all: &[Request<'a>]) -> Vec<Request<'a>> {
    let is_failing =
        |counts: &RequestCounts| counts.good == 0 && counts.refused_with(2) + counts.refused_with(3) + counts.silent >= 2;
    all.iter().filter(|(key, counts)| is_failing(counts) && !is_of_value(key, counts)).copied().collect()
}

fn reason_of_length(all: &[Request<'_>], request: Request<'_>) -> Reason {
    if request.1.silent == 0 {
        return reason(all, request);
    }
    let good = answered(all, request.0);
    let of_kind = || all.iter().filter(|(other, _)| is_like(other, request.0));
    let longest = of_kind().filter(|(_, counts)| counts.good > 0).map(|(other, _)| other.quantity).max().unwrap_or(0);
    let silent: Vec<_> = of_kind().filter(|(_, counts)| counts.good == 0 && counts.silent >= 2).collect();
    // A function that is never answered at all is not one of too long blocks.
    if silent.iter().all(|(other, _)| answered(all, other).is_empty()) {
        return Reason::Unknown;
    }
    let shortest = silent.iter().map(|(other, _)| other.quantity).min().unwrap_or(0);
    // Two lengths without any answer, time and again: an address that is missing is refused.
    let is_usual = silent.len() > 1 && silent.iter().all(|(_, counts)| counts.silent >= MANY_SILENT);
    let covers = covered(request.0, &good) == u32::from(request.0.quantity);
    if longest > 0 && longest < shortest && (covers || is_usual || is_sharp(longest, shortest)) {
        Reason::TooLong { good: longest }
    } else {
        Reason::Unknown
    }
}

/// Whether both functions read registers, or both bits: a limit of length is that of the unit's memory.
fn is_akin(one: u8, other: u8) -> bool {
    one == other || counterpart(one) == Some(other)
}

fn is_like(one: &RequestKey, other: &RequestKey) -> bool {
    one.unit == other.unit && is_akin(one.function, other.function)
}

/// So many silences of one request are no accident of the line.
const MANY_SILENT: u64 = 10;

/// Whether the longest block that is answered and the shortest that is not are so near to each other that this is no accident.
fn is_sharp(longest: u16, shortest: u16) -> bool {
    u32::from(shortest - longest) * 16 <= u32::from(longest)
}

/// Whether no request of this function to this unit was answered, and the refusals say that it is the function, or a request of
/// another function was answered.
fn is_function_refused(all: &[Request<'_>], key: &RequestKey) -> bool {
    let of_unit = |other: &&Request<'_>| other.0.unit == key.unit;
    let same = all
        .iter()
        .filter(of_unit)
        .filter(|(other, _)| other.function == key.function)
        .all(|(_, counts)| is_always_refused(counts));
    // A unit that refuses the addresses of all functions from one moment on knows the functions.
    let says_function = all.iter().any(|(other, counts)| *other == key && counts.refused_with(1) > 0);
    if same && says_function {
        return true;
    }
    let is_answered = |counts: &RequestCounts| counts.good > 0 && !is_always_refused(counts);
    let other = all.iter().filter(of_unit).any(|(other, counts)| other.function != key.function && is_answered(counts));
    // Exception 2 means an address, and of one block no more is known; of several, none of which exists, it may mean the function.
    let blocks = all.iter().filter(of_unit).filter(|(other, _)| other.function == key.function).count();
    (same && other && (blocks > 1 || instead(all, key).is_some())) || is_answered_elsewhere(all, key)
}

/// Input registers for holding registers, or the other way round; the same with bits. Others than reads have no counterpart.
fn counterpart(function: u8) -> Option<u8> {
    [(1, 2), (2, 1), (3, 4), (4, 3)].into_iter().find(|(one, _)| *one == function).map(|(_, other)| other)
}

/// Whether no register of the block is answered by this function, and all are by its counterpart: of this unit, or in the same
/// block of another one of its kind.
fn is_answered_elsewhere(all: &[Request<'_>], key: &RequestKey) -> bool {
    let Some(other) = counterpart(key.function) else { return false };
    let good = |wanted: RequestKey| answered(all, &wanted);
    let own = covered(key, &good(RequestKey { function: other, ..*key })) == u32::from(key.quantity);
    let is_twin = |one: &RequestKey, counts: &RequestCounts| {
        (one.function, one.address, one.quantity) == (other, key.address, key.quantity) && counts.good > counts.refusals()
    };
    let none = covered(key, &good(*key)) == 0;
    none && (own || (key.quantity > 1 && all.iter().any(|(one, counts)| is_twin(one, counts))))
}

/// A function that is refused throughout while another one is answered.
pub(super) fn wrong_function(view: &View<'_>) -> Vec<Claim> {
    let all = &view.requests;
    let mut found: Vec<Claim> = Vec::new();
    for (key, counts) in all {
        let refusals = counts.refused_with(1) + counts.refused_with(2);
        let is_new = !found.iter().any(|claim| (claim.unit, claim.function) == (Some(key.unit), Some(key.function)));
        if !is_always_refused(counts) || refusals < 2 || !is_new || !is_function_refused(all, key) {
            continue;
        }
        let same = |other: &&Request<'_>| {
            other.0.unit == key.unit && other.0.function == key.function && is_always_refused(other.1) && other.1.refusals() > 0
        };
        let share: Share = all.iter().filter(same).map(refused_of).sum();
        let chance = view.corrected(at_least(share, REFUSED_BY_ACCIDENT));
        if chance >= SUGGESTED {
            continue;
        }
        let instead = instead(all, key).map_or(String::new(), |other| format!("; function {other} answers there"));
        let claim = Claim::new("wrong_function", &counts.bad, chance).of_unit(key.unit).at(key.function, key.address);
        found.push(claim.with_share(share).fact("function", key.function.to_string()).fact("instead", instead));
    }
    found
}

/// Functions of bits, whose addresses are not those of registers.
const OF_BITS: [u8; 4] = [1, 2, 5, 15];

/// Another function that is answered at an address of this block.
fn instead(all: &[Request<'_>], key: &RequestKey) -> Option<u8> {
    let overlaps = |other: &RequestKey| u32::from(other.address) < end(key) && u32::from(key.address) < end(other);
    let is_alike = |other: &RequestKey| OF_BITS.contains(&other.function) == OF_BITS.contains(&key.function);
    let is_other =
        |other: &RequestKey| other.unit == key.unit && other.function != key.function && is_alike(other) && overlaps(other);
    all.iter().find(|(other, counts)| is_other(other) && counts.good > 0).map(|(other, _)| other.function)
}

/// What the exceptions of a busy device or gateway say, and what to check.
const BUSY: [(u8, &str, &str); 5] = [
    (4, "Server Device Failure", "The device's own state and log; behind a gateway its serial side, since some gateways answer so where the unit does not."),
    (5, "Acknowledge", "What keeps the device busy: it has accepted the request and wants to be asked again later."),
    (6, "Server Device Busy", "How many clients ask, and how often: a longer cycle, or one client instead of several."),
    (10, "Gateway Path Unavailable", "The gateway's table of units, its serial port and its load."),
    (11, "Gateway Target Device Failed to Respond", "The serial side of the gateway: wiring, address and rate of the unit, and the gateway's own timeout, which has to be longer than the unit takes."),
];

/// What proves that load is the reason, and what separates a failure of the device from one of some registers.
const FOR_LOAD: &str = "Ask half as often: refusals become rarer by more than half.";
const NOT_FOR_LOAD: &str =
    "Ask for a single register that the manual names, then for the same one directly at the device, without the gateway.";

/// Refusals that ask for patience.
pub(super) fn device_busy(view: &View<'_>) -> Vec<Claim> {
    let mut found = Vec::new();
    for (unit, counts) in view.units() {
        for (code, name, advice) in BUSY {
            let refused = &counts.exceptions[usize::from(code)];
            let share = Share { failed: refused.failed, total: counts.failures.total };
            let Some(chance) = view.beyond_accident(share) else { continue };
            let claim = Claim::new("device_busy", refused, chance).of_unit(unit).with_share(share);
            let experiment = if code == 4 { NOT_FOR_LOAD } else { FOR_LOAD };
            let claim = claim.fact("exception", code.to_string()).fact("name", name).fact("what_to_check", advice);
            found.push(claim.fact("experiment", experiment));
        }
    }
    found
}
