//! What registers mean: profiles of devices, compiled to a plan that converts, and what values alone suggest.

pub mod learn;
pub mod points;
pub mod profile;
