//! The verdict on a log without a full turn: on what motion has taught.

use super::analysis::Analysis;
use super::html::escaped;
use crate::advice::next_step;
use crate::calibration::outcome::Verdict;
use crate::pipeline::MotionMeasures;

/// The section on calibration by motion, for a log without a full turn.
pub(super) fn section(analysis: &Analysis) -> String {
    let mut out = String::from(
        "<h2>Calibration by a full turn</h2>\n<p>The board made no full turn that was calibrated on.</p>\n",
    );
    let Some((outcome, measures)) = analysis.motion() else {
        return out;
    };
    let rejected = outcome.verdict == Verdict::Rejected;
    let (class, verdict) = if rejected {
        ("bad", "rejected")
    } else {
        ("good", "accepted")
    };
    out += &format!(
        "<h2>Calibration by motion</h2>\n<p><b class={class}>{verdict}</b> ({}): {}</p>\n",
        outcome.reason,
        escaped(&outcome.message)
    );
    if let Some(advice) = next_step(outcome.reason).filter(|_| rejected) {
        out += &format!("<p>What to do: {}.</p>\n", escaped(advice));
    }
    out + &limits(&measures)
}

/// Each limit and what was measured of it.
fn limits(measures: &MotionMeasures) -> String {
    let word = |kept: bool| match kept {
        true => "<b class=good>kept</b>",
        false => "<b class=bad>broken</b>",
    };
    let (found, most) = (measures.heading_sd_deg, measures.most_heading_sd_deg);
    format!(
        "<table><tr><th>criterion</th><th>measured</th><th></th><th>limit</th><th></th></tr>\n\
         <tr><th>gyro turns as the field does</th><td></td><td></td><td></td><td>{}</td></tr>\n\
         <tr><th>field at the end as the motion predicts</th><td></td><td></td><td></td><td>{}</td></tr>\n\
         <tr><th>predicted heading uncertainty</th><td>{found:.2} °</td><td>at most</td><td>{most:.2} °</td><td>{}</td></tr>\n\
         <tr><th>residual</th><td>{:.1} mG</td><td></td><td></td><td></td></tr>\n</table>\n",
        word(measures.gyro_is_right),
        word(measures.field_is_predicted),
        word(found <= most),
        measures.residual_mgauss
    )
}
