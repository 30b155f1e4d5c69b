//! How exact calibrations are, what they refuse, and that they never end in a trap.

mod bound;
mod cases;
mod disturbed;
mod hostile;
mod judgement;
mod precision;
mod soft_iron;
mod survey;
mod trap;
