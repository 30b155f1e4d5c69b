//! The verdict on a log without a full turn: on what motion has taught.

use super::analysis::Analysis;
use super::html::{badge, verdict};
use crate::pipeline::MotionMeasures;

/// The section on calibration by motion, for a log without a full turn.
pub(super) fn section(analysis: &Analysis) -> String {
    let mut out = String::from(
        "<h2>Calibration by a full turn</h2>\n<p>The board made no full turn that was calibrated on.</p>\n",
    );
    let Some((outcome, measures)) = analysis.motion() else {
        return out;
    };
    out += &verdict("Calibration by motion", &outcome);
    out + &limits(&measures)
}

fn limits(measures: &MotionMeasures) -> String {
    let (found, most) = (measures.heading_sd_deg, measures.most_heading_sd_deg);
    format!(
        "<table><tr><th>criterion</th><th>measured</th><th></th><th>limit</th><th></th></tr>\n\
         <tr><th>gyro turns as the field does</th><td></td><td></td><td></td><td>{}</td></tr>\n\
         <tr><th>field at the end as the motion predicts</th><td></td><td></td><td></td><td>{}</td></tr>\n\
         <tr><th>predicted heading uncertainty</th><td>{found:.2} °</td><td>at most</td><td>{most:.2} °</td><td>{}</td></tr>\n\
         <tr><th>residual</th><td>{:.1} mG</td><td></td><td></td><td></td></tr>\n</table>\n",
        badge(measures.gyro_is_right),
        badge(measures.field_is_predicted),
        badge(found <= most),
        measures.residual_mgauss
    )
}
