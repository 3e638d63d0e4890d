//! Makes the traffic of a scenario: what the line itself carries, and what else the scenario puts there.

use crate::sim::case::Traffic;
use crate::sim::look_alikes;
use crate::sim::scenario::Scenario;

impl Traffic {
    /// Simulates a scenario until `frames` frames were sent.
    pub fn new(scenario: &Scenario, seed: u64, frames: usize) -> Self {
        match scenario.look_alike {
            None => Self::simulate(scenario, seed, frames),
            Some(kind) => {
                let mut mixed = look_alikes::traffic(kind, scenario, seed, frames);
                mixed.hides_framing = kind.hides_framing();
                mixed
            }
        }
    }
}
