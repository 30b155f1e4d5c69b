//! The paper's tests, run again, its tables beside ours: `cargo run --release --example paper [SEED]`.
//!
//! A. Ali, S. Siddharth, Z. Syed, N. El-Sheimy, "Swarm Optimization-Based Magnetometer Calibration for
//! Personal Handheld Devices", Sensors 12 (2012). The same seed gives the same numbers, but for the times.

mod log;
mod published;
mod text;
mod trial;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(1), |seed| seed.parse())?;
    print!("{}", text::text(&trial::trials(seed)?, seed));
    Ok(())
}
