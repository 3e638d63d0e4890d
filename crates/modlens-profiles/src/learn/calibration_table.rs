//! Claims and wrong ones among them, counted on simulated devices with known registers. Written by
//! `python -m tests.support.learn_calibration`.

use crate::learn::role::Role;

/// A class of evidence: the least bits of layout claims in it, claims, and wrong ones among them.
pub(super) const LAYOUTS: [(f64, u32, u32); 4] = [(12.0, 1184, 11), (8.0, 141, 8), (6.0, 409, 12), (0.0, 30, 0)];

/// Claims of each role, and wrong ones. A register is constant if it was so far.
pub(super) const ROLES: [(Role, u32, u32); 9] = [
    (Role::Measurement, 1857, 0),
    (Role::Constant, 279, 0),
    (Role::Counter, 110, 7),
    (Role::Enum, 15, 0),
    (Role::BitField, 11, 0),
    (Role::Setpoint, 8, 0),
    (Role::Clock, 1, 0),
    (Role::Heartbeat, 3, 0),
    (Role::Text, 12, 0),
];

/// Claims of a scale, and wrong ones.
pub(super) const SCALES: (u32, u32) = (954, 3);

/// Claims of a quantity, and wrong ones.
pub(super) const QUANTITIES: (u32, u32) = (631, 0);
