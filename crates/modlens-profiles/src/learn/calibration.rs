//! What evidence is worth: claims and mistakes that were counted on simulated devices with known registers (16 kinds,
//! observed for 1 and 10 minutes, 1 and 24 hours; layouts also on 16 random devices). Stated bits are those of this table,
//! never more.

use crate::learn::role::Role;

/// A class of evidence: the least raw bits of layout claims in it, claims, and wrong ones among them.
const LAYOUT: [(f64, u32, u32); 3] = [(12.0, 813, 10), (8.0, 60, 4), (0.0, 131, 0)];

/// Claims of each role, and wrong ones. That a register is constant is said of what was seen.
const ROLES: [(Role, u32, u32); 9] = [
    (Role::Measurement, 875, 1),
    (Role::Constant, 152, 2),
    (Role::Counter, 73, 3),
    (Role::Enum, 8, 0),
    (Role::BitField, 3, 0),
    (Role::Setpoint, 17, 0),
    (Role::Clock, 2, 0),
    (Role::Heartbeat, 4, 0),
    (Role::Text, 44, 0),
];

/// What a class with so many claims and mistakes is worth, in bits: the odds that one more claim is right, with one
/// right and one wrong claim added that nobody saw.
fn worth(claims: u32, wrong: u32) -> f64 {
    (f64::from(claims - wrong + 1) / f64::from(wrong + 1)).log2()
}

/// What the evidence for a layout is worth, in bits.
pub(super) fn layout_bits(raw: f64) -> f64 {
    LAYOUT.iter().find(|class| raw >= class.0).map_or(0.0, |class| worth(class.1, class.2)).min(raw)
}

/// What the evidence for a role is worth, in bits.
pub(super) fn role_bits(role: Role) -> f64 {
    ROLES.iter().find(|row| row.0 == role).map_or(0.0, |row| worth(row.1, row.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_states_more_than_was_counted() {
        assert!((worth(127, 0) - 7.0).abs() < 1e-9 && worth(3, 3) < 0.0);
        assert!(layout_bits(60.0) < 10.0 && layout_bits(60.0) > layout_bits(9.0));
        assert!(role_bits(Role::Measurement) > role_bits(Role::Constant));
    }
}
