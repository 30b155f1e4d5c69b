//! How exact calibrations are, what they refuse, and that they never end in a trap.

mod bound;
mod cases;
mod precision;
mod survey;
mod trap;
