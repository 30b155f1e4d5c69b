//! The paper's swarm on the turn, by itself and stopped by MPSOT: how its fitness falls.

use super::analysis::Judged;
use super::plot::{AxisScale, Chart, Hue, Series};
use super::thin::some;
use crate::calibration::calibrate;
use crate::calibration::outcome::SwarmReport;
use crate::calibration::settings::{Profile, StopChoice};

/// Points of a line.
const MOST: usize = 1000;

/// What the paper's swarm does on these samples: it begins anywhere, so that MPSOT has something to stop.
pub(super) fn of(judged: &Judged, stop: StopChoice) -> Option<SwarmReport> {
    let mut request = judged.request.clone();
    request.settings.profile = Profile::Paper;
    request.settings.stop = stop;
    calibrate(&request).swarm
}

/// Fitness by iteration (Figures 8 and 10).
pub(super) fn fitness(basic: Option<&SwarmReport>, mpsot: Option<&SwarmReport>) -> String {
    let line = |swarm: Option<&SwarmReport>, hue| {
        let fit_values = swarm.map_or(&[][..], |swarm| &swarm.fit_values);
        // Iterations are counted from 1, and both axes go by powers of ten.
        let points: Vec<(f64, f64)> = (1..)
            .zip(fit_values)
            .filter(|(_, fit)| fit.is_finite() && **fit > 0.0)
            .map(|(iteration, fit)| (f64::from(iteration).log10(), fit.log10()))
            .collect();
        Series::line(hue, some(&points, MOST).into_iter().copied())
    };
    let series = vec![line(basic, Hue::Raw), line(mpsot, Hue::Corrected)];
    let points = series.iter().flat_map(|series| series.points.iter());
    let mut x = AxisScale::over("iteration", points.map(|point| point.0));
    let mut y = AxisScale::over_y("fitness, milligauss squared", &series);
    (x.logarithmic, y.logarithmic) = (true, true);
    Chart::wide(x, y, series).svg()
}
