//! What registers mean: device profiles, their compilation to a plan that converts registers to values, and what can be
//! learnt about registers from their values alone.
//!
//! - `profile` parses and checks profiles: which point (named value) stands at which address, with type, order and scale.
//! - `points` compiles a profile to a plan. The plan splits a block of registers into points and converts them; this is
//!   the only place where registers become values. It also follows `SunSpec` models.
//! - `order_check` watches whether values make sense in the order that a profile gives.
//! - `find` holds every reading of every register against what is known of a value, such as what a display showed.
//! - `fit` scores how well a profile fits what a unit was asked for and answered.
//! - `learn` ranks the types and orders that some registers may have, by how their values move over time.
//!
//! Scale factors and `SunSpec` models may come later than the first read, so a transaction keeps the plan of its unit as
//! it was then. What it reads is a slice of the plan's layout; a value is converted when somebody asks for it.

pub mod find;
pub mod fit;
pub mod learn;
pub mod order_check;
pub mod points;
pub mod profile;
