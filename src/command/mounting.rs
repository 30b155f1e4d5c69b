//! `headingd mounting`: how the board of a running daemon is mounted.

use super::control::ControlTarget;
use super::{Failure, number, print, print_json, text};
use crate::publish::control::ControlRequest;

/// Tell the running daemon how the board is mounted, or show it
///
/// The daemon keeps the mounting beside the calibration, which stays as it is. A later change of board_axes or
/// heading_offset_deg in the configuration replaces it.
#[derive(Clone, Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example: headingd mounting --level --heading 270"
)]
pub struct Args {
    #[command(flatten)]
    pub target: ControlTarget,
    /// The board is level now: pitch and roll become 0, and ahead stays ahead
    #[arg(long)]
    pub level: bool,
    /// The magnetic heading is this now, 0 to 360 degrees: a true one less the declination, east positive
    #[arg(long, value_name = "DEGREES", value_parser = number("a number of degrees", 0.0..=360.0))]
    pub heading: Option<f64>,
    /// The board is mounted as the configuration says
    #[arg(long, conflicts_with_all = ["level", "heading"])]
    pub reset: bool,
    /// Print the daemon's answer, one JSON object; a refusal too
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let request = ControlRequest::Mounting {
        level: args.level,
        heading_deg: args.heading,
        reset: args.reset,
    };
    let answer = args.target.ask(&request, args.json)?;
    if args.json {
        return print_json(&answer);
    }
    let [message, axes] = ["message", "board_axes"].map(|key| text(&answer, key));
    print(&format!(
        "{message}\nboard_axes = \"{axes}\"  # for [mounting]; remove heading_offset_deg\n"
    ))
}
