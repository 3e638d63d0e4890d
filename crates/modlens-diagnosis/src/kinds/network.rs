//! Trouble of networks: connections, framings, unit numbers, mixed-up answers.

use super::answers::usual_silence;
use crate::claim::{Claim, View};
use crate::contrast::gaps::without_lone;
use crate::contrast::tally::Tally;
use crate::contrast::{LockedOut, UnitCounts};
use crate::observation::RequestKey;
use crate::statistics::{at_least, fisher, Share};
use modlens_protocol::finding::Severity;

/// Connections that are turned away, or not served, while others are served.
pub(super) fn connection_limit(view: &View<'_>) -> Vec<Claim> {
    let counts = &view.bus.connections;
    if counts.answered == 0 {
        return Vec::new();
    }
    let mut turned_away = counts.turned_away.clone();
    let serves_all = serves_all_that_is_asked(view);
    let has_unserved = is_in_runs(&counts.unserved) && serves_all;
    if has_unserved {
        turned_away.merge(&counts.unserved);
        turned_away.total = counts.turned_away.total.max(counts.unserved.total);
    }
    let in_vain = Some(&counts.in_vain.requests).filter(|in_vain| serves_all && in_vain.failed >= LEAST_IN_VAIN);
    let chance = view.beyond_accident(turned_away.share()).filter(|_| turned_away.failed >= 2);
    let mut claim = if let Some(chance) = chance {
        let claim = Claim::new("connection_limit", &turned_away, chance).fact("what", "attempts");
        claim.fact("how", "refused, closed at once or not served, while others were")
    } else {
        let of_connections = |in_vain: &Tally| view.significant(by_connection(view, in_vain.failed));
        let Some((in_vain, chance)) = in_vain.and_then(|in_vain| Some((in_vain, of_connections(in_vain)?))) else {
            return displaced(view).into_iter().collect();
        };
        let claim = Claim::new("connection_limit", in_vain, chance).fact("what", "requests");
        claim.fact("how", "sent on connections that it had accepted and did not serve, while it served others")
    };
    claim.harm = claim.harm.max(in_vain.map_or(0, |in_vain| in_vain.failed));
    if has_unserved || in_vain.is_some() || counts.unserved.failed == 0 {
        claim = in_spells(claim, &counts.kept_out);
    }
    let clients = counts.clients.sorted();
    let mut turned_away = clients.iter().filter(|(_, client)| client.turned_away.failed > 0);
    if let (Some((name, _)), None) = (turned_away.next(), turned_away.next()) {
        claim.client = Some((*name).clone());
    }
    vec![claim.fact("limit", "takes no more connections")]
}

/// Connections that the server ends when another client connects, as one does that serves one at a time.
fn displaced(view: &View<'_>) -> Option<Claim> {
    let counts = &view.bus.connections;
    let tally = &counts.displaced.beginnings;
    let is_usual = tally.failed >= 3 && tally.failed * 2 > counts.closed_by_server.failed;
    let chance = view.beyond_accident(tally.share()).filter(|_| is_usual)?;
    let claim = Claim::new("connection_limit", tally, chance).fact("what", "connections");
    Some(claim.fact("limit", "serves one client only, the newest").fact("how", "followed by the end of another one within 50 ms"))
}

/// So few requests that are not served may be those of a slow server.
const LEAST_IN_VAIN: u64 = 5;

/// How probable it is that all requests of some connections fail by chance, and so many others do not.
fn by_connection(view: &View<'_>, in_vain: u64) -> f64 {
    let all = view.bus.requests_seen.share();
    let own = Share { failed: in_vain, total: in_vain };
    let others = Share { failed: all.failed.saturating_sub(in_vain), total: all.total.saturating_sub(in_vain) };
    let connections = view.bus.connections.unserved.total.max(1);
    fisher(own, others) * connections as f64
}

/// The claim with the spells in which clients were kept out: one that is let in ends a spell, though it is one connection only.
fn in_spells(mut claim: Claim, kept_out: &LockedOut) -> Claim {
    let (spells, is_over) = kept_out.spells();
    if let (Some(first), Some(last)) = (spells.first(), spells.last()) {
        (claim.first, claim.last, claim.has_ended) = (Some(first.first), Some(last.last), is_over);
        claim.episodes = spells.to_vec();
    }
    claim
}

/// Whether nearly all failures are in runs of nothing else: who is not let in stays outside while others are there, and a slow
/// server fails now and then.
fn is_in_runs(tally: &Tally) -> bool {
    let runs = without_lone(tally.episodes());
    let failed: u64 = runs.iter().map(|run| run.failed).sum();
    let total: u64 = runs.iter().map(|run| run.total).sum();
    failed >= 3 && failed * 10 >= tally.failed * 8 && failed * 10 >= total * 9
}

/// Whether the server answers each unit and function that it is asked for, on some connection: what is not answered on another
/// one is no unit that is away, and no request that makes the server close the connection.
fn serves_all_that_is_asked(view: &View<'_>) -> bool {
    let all = &view.requests;
    let is_served = |key: &RequestKey| {
        all.iter().any(|(other, counts)| {
            (other.unit, other.function) == (key.unit, key.function) && counts.good + counts.refusals() > 0
        })
    };
    // A client may have one request only, which its server does not know and drops. What it has answered to others, it knows.
    let is_answered = |key: &RequestKey| {
        let end = |key: &RequestKey| u32::from(key.address) + u32::from(key.quantity);
        all.iter().any(|(other, counts)| {
            let holds = other.address <= key.address && end(key) <= end(other);
            (other.unit, other.function) == (key.unit, key.function) && holds && counts.good > 0
        })
    };
    let lost: Vec<_> = all.iter().filter(|(_, counts)| counts.silent > 0).collect();
    let are_known = lost.is_empty() || lost.len() >= MANY_LOST || lost.iter().any(|(key, _)| is_answered(key));
    are_known && all.iter().all(|(key, _)| is_served(key))
}

/// Of so many different requests to units and functions that are served, some are known to the server.
const MANY_LOST: usize = 4;

/// Up to this share of short connections, of those that the server closes and of other framings is normal, where somebody tries
/// something out.
const SOME: f64 = 0.2;

/// Connections that do not last: at most one claim, of those that begin without an answer, are closed by the server, or are
/// short, in this order.
pub(super) fn connection_churn(view: &View<'_>) -> Vec<Claim> {
    let counts = &view.bus.connections;
    let lost = view.significant(at_least(counts.first_lost.share(), 0.05)).map(|chance| {
        let claim = Claim::new("connection_churn", &counts.first_lost, chance);
        claim
            .fact("what", "begin with a request that is not answered")
            .fact(
                "what_to_check",
                "A pause of one or two seconds in the client after it has connected; the device is not ready at once.",
            )
            .fact("experiment", "Wait two seconds after connecting: the first request is answered.")
    });
    let closed = view.significant(at_least(counts.closed_by_server.share(), SOME)).map(|chance| {
        let after = counts.idle.percentile(0.5).filter(|idle| *idle > 100_000_000);
        let after = after.map_or(String::new(), |idle| format!(", after {} of silence", crate::claim::duration(idle)));
        let mut claim = Claim::new("connection_churn", &counts.closed_by_server, chance);
        if let Some((unit, function)) = fatal_function(view) {
            (claim.unit, claim.function) = (Some(unit), Some(function));
            let words = format!("are closed by the server at a request with function {function}, without an answer");
            return claim
                .fact("what", words)
                .fact("what_to_check", "Whether the server knows this function, with these addresses: one that does not has to refuse it with exception 1, and this one closes the connection instead.")
                .fact("experiment", "Leave this request out: the connection stays open.");
        }
        claim
            .fact("what", format!("are closed by the server{after}"))
            .fact("what_to_check", "The server's idle timeout, and a client that asks more often than that, or opens a new connection before it asks.")
            .fact("experiment", "Ask twice as often: connections stay open.")
    });
    let short = view.significant(at_least(counts.short.share(), SOME)).map(|chance| {
        let mut claim = Claim::new("connection_churn", &counts.short, chance);
        if view.bus.requests_seen.failed == 0 {
            // Some clients open a connection for each cycle by intention.
            (claim.harm, claim.at_most) = (0, Severity::Info);
        }
        claim
            .fact("what", "carry one or two requests and are closed again")
            .fact("what_to_check", "The client's setting for keeping connections open: a connection for each request takes time, and small devices run out of sockets.")
            .fact("experiment", "Keep one connection open: the cycle gets shorter.")
    });
    lost.or(closed).or(short).into_iter().collect()
}

/// The unit and function of all requests that fail, where none of these was ever answered and the server closes about as many
/// connections.
fn fatal_function(view: &View<'_>) -> Option<(u8, u8)> {
    let requests = &view.requests;
    let mut failing = requests.iter().filter(|(_, counts)| counts.failures().failed > 0).map(|(key, _)| (key.unit, key.function));
    let one = failing.next().filter(|one| failing.all(|other| other == *one))?;
    let of_it = requests.iter().filter(|(key, _)| (key.unit, key.function) == one);
    let (failed, total) = of_it.fold((0, 0), |(failed, total), (_, counts)| {
        let share = counts.failures();
        (failed + share.failed, total + share.total)
    });
    let closed = view.bus.connections.closed_by_server.failed;
    (failed == total && closed * 10 <= failed * 12 && failed * 10 <= closed * 12).then_some(one)
}

/// Two sides that speak in different framings.
pub(super) fn framing_mismatch(view: &View<'_>) -> Vec<Claim> {
    let clients = view.bus.connections.clients.sorted();
    let claims = clients.into_iter().filter_map(|(name, client)| {
        let share = Share { failed: client.mismatched_requests, total: client.requests };
        // A client may have other connections that are right.
        let alone = SOME.powf(client.mismatched_requests as f64);
        let chance = view.significant(at_least(share, SOME).min(alone))?;
        let word = |framing: Option<&'static str>| match framing {
            Some("tcp") => "Modbus/TCP",
            Some("rtu") => "RTU over TCP",
            Some("ascii") => "ASCII over TCP",
            _ => "something else",
        };
        let answers = match client.other_framing {
            Some(_) => format!("answers as {}", word(client.other_framing)),
            None => String::from("no answer comes"),
        };
        let mut claim = Claim::new("framing_mismatch", &client.mismatched, chance)
            .with_share(share)
            .fact("client_framing", word(client.framing))
            .fact("answers", answers);
        claim.client = Some(name.clone());
        Some(claim)
    });
    claims.collect()
}

/// What to check where the server does not answer for a unit.
const UNIT_NUMBER: &str = "The unit number in the client: devices with their own network port mostly want 1, 0 or 255; behind a gateway it is the address on the serial line.";

/// What to check where a gateway says that the unit does not answer.
const BEHIND_GATEWAY: &str = "Power, wires and address of the device behind the gateway, which says that it gets no answer from it; or the unit number in the client.";

/// A unit number that nobody answers to.
pub(super) fn gateway_unit_id(view: &View<'_>) -> Vec<Claim> {
    let answers = |counts: &UnitCounts| counts.answered() - unreachable(counts);
    let best = view.units().filter(|(_, counts)| answers(counts) > 0).max_by_key(|(_, counts)| answers(counts));
    let claims = view.units().filter_map(|(unit, counts)| {
        if !view.bus.facts.is_network {
            return None;
        }
        let share = Share { failed: counts.silent.failed + unreachable(counts), total: counts.failures.total };
        let (other, _) = best.filter(|(other, _)| *other != unit)?;
        if answers(counts) > 0 {
            return None;
        }
        let chance = view.significant(at_least(share, usual_silence(view, unit)))?;
        let check = if unreachable(counts) * 2 > share.failed { BEHIND_GATEWAY } else { UNIT_NUMBER };
        Some(
            Claim::new("gateway_unit_id", &counts.failures, chance)
                .of_unit(unit)
                .with_share(share)
                .fact("what_to_check", check)
                .fact("others", format!(", while unit {other} is answered"))
                .fact("try_unit", other.to_string()),
        )
    });
    claims.chain(reads_from_unit_0(view)).collect()
}

/// Reads from unit 0 on a serial line: that is for writing to all units, and whoever answers does it against the rules.
fn reads_from_unit_0(view: &View<'_>) -> Option<Claim> {
    let reads = &view.bus.units.get(&0)?.reads_from_unit_0;
    let chance = view.beyond_accident(reads.share())?;
    let answers = |counts: &UnitCounts| counts.answers_for.get(&0).map_or(0, |tally| tally.failed);
    let best = view.bus.units.iter().max_by_key(|(_, counts)| answers(counts)).filter(|(_, counts)| answers(counts) > 0);
    let unit = best.or_else(|| view.bus.units.iter().find(|(unit, _)| **unit != 0)).map_or(1, |(unit, _)| *unit);
    let others = best.map_or(String::new(), |(unit, counts)| format!("; unit {unit} answers {} of them", answers(counts)));
    let mut claim =
        Claim::new("gateway_unit_id", reads, chance).of_unit(0).fact("others", others).fact("what_to_check", UNIT_NUMBER);
    // Where unit 0 itself answers, nothing is lost by it.
    let failing = view.bus.units.get(&0)?.failures.share();
    if failing.total > 0 && view.beyond_accident(failing).is_none() {
        claim = claim.at_most(Severity::Warning);
    }
    Some(claim.fact("try_unit", unit.to_string()))
}

/// Refusals of a gateway that cannot reach the unit: some say so with exception 4.
fn unreachable(counts: &UnitCounts) -> u64 {
    counts.exceptions[4].failed + counts.exceptions[10].failed + counts.exceptions[11].failed
}

/// Whether several clients ask at the same time, of one address or more.
pub(super) fn has_several_clients(view: &View<'_>) -> bool {
    let connections = &view.bus.connections;
    connections.clients.sorted().len() > 1 || connections.side_by_side > 0
}

/// Answers with identifier, unit or function of another request.
pub(super) fn gateway_mixup(view: &View<'_>) -> Vec<Claim> {
    let units = || view.bus.units.values();
    let kinds: [(&str, Tally); 4] = [
        ("the transaction identifier", units().map(|counts| &counts.other_ids).sum()),
        ("the unit", units().flat_map(|counts| counts.answered_by.values()).sum()),
        ("the function", units().map(|counts| &counts.other_functions).sum()),
        ("the unit", units().flat_map(|counts| counts.answers_for.values()).sum()),
    ];
    // Answers that nobody on this connection has asked for, while another client waits for one.
    let second = has_several_clients(view).then(|| ("the data", units().map(|counts| &counts.second_answers).sum()));
    let kinds = kinds.into_iter().chain(second);
    // Only messages of Modbus/TCP have an identifier, in a log as well; all else has other causes on a line.
    let kinds = kinds.take(if view.bus.facts.is_network { usize::MAX } else { 1 });
    let (what, mut tally) = kinds.max_by_key(|(_, tally)| tally.failed).expect("one at least");
    let share = Share { failed: tally.failed, total: view.bus.requests_seen.total.max(tally.failed) };
    let Some(chance) = view.beyond_accident(share) else { return Vec::new() };
    (tally.total, tally.before, tally.after) = (share.total, 0, 0);
    vec![Claim::new("gateway_mixup", &tally, chance).fact("what", what)]
}
