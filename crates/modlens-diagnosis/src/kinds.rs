//! The kinds of trouble: each is a function of the contrast of one bus that claims what it sees, or nothing.
//!
//! Thresholds come from statistics (`claim::ACCIDENT`, `MAX_CHANCE`), not from examples. A kind that another one explains
//! better gives way to it: that is `claims`' last step, so that no kind has to know the others.

mod answers;
mod blocks;
mod damage;
mod exceptions;
mod foreign;
mod interleaved;
mod layouts;
mod lockstep;
mod masters;
mod meetings;
mod network;
mod pace;
mod rates;
mod switched;
mod together;
mod unheard;
mod unreadable;
mod values;
mod wires;
mod writes;

use crate::claim::{Claim, View};

/// A kind: its code and what recognizes it.
pub type Kind = (&'static str, fn(&View<'_>) -> Vec<Claim>);

/// All kinds; `dissectors/diagnoses.toml` has a row for each, in the same words.
pub const KINDS: &[Kind] = &[
    ("slow_answers", answers::slow_answers),
    ("lockstep", lockstep::lockstep),
    ("no_bias", damage::no_bias),
    ("polled_too_fast", pace::polled_too_fast),
    ("swapped_wires", wires::swapped_wires),
    ("address_off_by_one", exceptions::address_off_by_one),
    ("word_order", values::word_order),
    ("connection_limit", network::connection_limit),
    ("two_masters", meetings::two_masters),
    ("line_noise", damage::line_noise),
    ("framing_mismatch", network::framing_mismatch),
    ("driver_enable", damage::driver_enable),
    ("dead_unit_cost", answers::dead_unit_cost),
    ("register_hole", exceptions::register_hole),
    ("block_too_long", exceptions::block_too_long),
    ("value_refused", writes::value_refused),
    ("gateway_unit_id", network::gateway_unit_id),
    ("value_spike", values::value_spike),
    ("bystander", masters::bystander),
    ("connection_churn", network::connection_churn),
    ("wrong_line_settings", wires::wrong_line_settings),
    ("gateway_mixup", network::gateway_mixup),
    ("own_echo", masters::own_echo),
    ("device_busy", exceptions::device_busy),
    ("wrong_function", exceptions::wrong_function),
    ("gaps_in_frames", pace::gaps_in_frames),
    ("duplicate_address", damage::duplicate_address),
    ("foreign_protocol", foreign::foreign_protocol),
    ("unexpected_writer", masters::unexpected_writer),
    ("device_absent", answers::device_absent),
    ("bus_saturated", pace::bus_saturated),
    ("wrong_layout", layouts::wrong_layout),
];

/// A kind that explains the failures of another one, of the same unit or of the whole line, where it spoils a request itself.
const EXPLAINS: &[(&str, &[&str])] = &[
    (
        "two_masters",
        &[
            "foreign_protocol",
            "gaps_in_frames",
            "line_noise",
            "duplicate_address",
            "polled_too_fast",
            "slow_answers",
            "bystander",
        ],
    ),
    ("swapped_wires", &["no_bias", "wrong_line_settings", "foreign_protocol", "line_noise", "dead_unit_cost"]),
    ("wrong_line_settings", &["foreign_protocol", "line_noise", "dead_unit_cost", "duplicate_address", "driver_enable"]),
    ("duplicate_address", &["line_noise", "no_bias", "driver_enable", "wrong_function", "register_hole", "polled_too_fast"]),
    ("driver_enable", &["line_noise", "foreign_protocol", "no_bias"]),
    ("connection_churn", &["bystander", "polled_too_fast", "slow_answers"]),
    ("block_too_long", &["register_hole", "bystander", "polled_too_fast"]),
    ("wrong_function", &["register_hole"]),
    ("slow_answers", &["polled_too_fast"]),
    ("gateway_unit_id", &["dead_unit_cost", "device_busy"]),
    ("polled_too_fast", &["bystander"]),
    (
        "own_echo",
        &[
            "polled_too_fast",
            "slow_answers",
            "two_masters",
            "duplicate_address",
            "dead_unit_cost",
            "line_noise",
            "driver_enable",
            "wrong_line_settings",
        ],
    ),
    (
        "framing_mismatch",
        &[
            "dead_unit_cost",
            "polled_too_fast",
            "device_absent",
            "gateway_unit_id",
            "connection_churn",
            "line_noise",
            "foreign_protocol",
            "wrong_line_settings",
        ],
    ),
    ("gateway_mixup", &["slow_answers", "bystander", "device_absent", "polled_too_fast", "dead_unit_cost"]),
    (
        // A client that has waited gets all answers at once when it is served.
        "connection_limit",
        &["connection_churn", "device_absent", "slow_answers", "polled_too_fast", "bystander", "lockstep", "gateway_mixup"],
    ),
    ("foreign_protocol", &["line_noise"]),
    ("bystander", &["duplicate_address"]),
    ("device_absent", &["polled_too_fast", "bystander"]),
    ("lockstep", &["slow_answers", "gateway_mixup", "value_spike"]),
    (
        "wrong_layout",
        &[
            "slow_answers",
            "duplicate_address",
            "own_echo",
            "gateway_mixup",
            "driver_enable",
            "polled_too_fast",
            "dead_unit_cost",
            "device_absent",
            "bystander",
            "line_noise",
            "no_bias",
            "foreign_protocol",
            "wrong_line_settings",
            "two_masters",
            "framing_mismatch",
            "lockstep",
        ],
    ),
];

/// What all kinds claim of a bus, without what another claim explains; and what they claim each by itself.
pub fn claims(view: &View<'_>) -> (Vec<Claim>, Vec<Claim>) {
    let all: Vec<Claim> = KINDS.iter().flat_map(|(code, recognize)| view.once(code, *recognize).to_vec()).collect();
    // What shows itself far more often than its explanation is more than that.
    let is_explained = |claim: &Claim| {
        let of_same = |other: &&Claim| other.unit.is_none() || claim.unit.is_none() || other.unit == claim.unit;
        let explains =
            |by: &str| all.iter().filter(of_same).any(|other| other.code == by && other.harm > 0 && claim.harm < 2 * other.harm);
        EXPLAINS.iter().any(|(by, what)| what.contains(&claim.code) && explains(by))
    };
    let left = all.iter().filter(|claim| !is_explained(claim)).cloned().collect();
    (together::together(view, left), all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::diagnoses;

    #[test]
    fn each_row_has_its_kind_and_each_kind_its_row() {
        let rows: Vec<&str> = diagnoses().iter().map(|row| row.code.as_str()).collect();
        let kinds: Vec<&str> = KINDS.iter().map(|(code, _)| *code).collect();
        assert_eq!(rows, kinds);
        for (by, what) in EXPLAINS {
            assert!(kinds.contains(by) && what.iter().all(|code| kinds.contains(code) && code != by), "{by}");
        }
    }
}
