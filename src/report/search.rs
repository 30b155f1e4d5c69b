//! Figures of the swarm: how its fitness falls, with and without MPSOT, and how many samples it saw.

use super::analysis::Judged;
use super::plot::{AxisScale, Chart, Hue, ReportError, Series};
use super::thin::some;
use crate::calibration::outcome::Outcome;
use crate::calibration::settings::{Profile, StopChoice};
use crate::calibration::{Request, calibrate};

/// Points of a line.
const MOST: usize = 1000;

/// The basic swarm and the one that MPSOT stops, on the same samples.
pub(super) struct Search {
    pub(super) basic: Outcome,
    pub(super) mpsot: Outcome,
}

impl Search {
    pub(super) fn on(judged: &Judged) -> Self {
        let run = |stop: StopChoice| {
            let mut request: Request = judged.request.clone();
            // The paper's swarm: it begins anywhere, and MPSOT has something to stop.
            request.settings.profile = Profile::Paper;
            request.settings.stop = stop;
            calibrate(&request, &|| None)
        };
        Self {
            basic: run(StopChoice::Basic),
            mpsot: run(StopChoice::Mpsot),
        }
    }

    /// Fitness by iteration (Figures 8 and 10).
    pub(super) fn fitness(&self) -> Result<String, ReportError> {
        let line = |outcome: &Outcome, hue| {
            let fitness = outcome.swarm.as_ref().map(|swarm| swarm.fitness.as_slice());
            let points = fitness.unwrap_or_default().iter().enumerate();
            let points = points.filter(|(_, fit)| fit.is_finite() && **fit > 0.0);
            // Iterations are counted from 1, and both axes go by powers of ten.
            let points: Vec<(f64, f64)> = points
                .map(|(index, fit)| ((1.0 + index as f64).log10(), fit.log10()))
                .collect();
            Series::line(hue, some(&points, MOST).into_iter())
        };
        let series = vec![
            line(&self.basic, Hue::Raw),
            line(&self.mpsot, Hue::Corrected),
        ];
        let points = series.iter().flat_map(|series| series.points.iter());
        let mut x = AxisScale::over("iteration", points.map(|point| point.0));
        let mut y = AxisScale::over_y("fitness, milligauss squared", &series);
        (x.logarithmic, y.logarithmic) = (true, true);
        Chart::wide(x, y, series).svg()
    }

    pub(super) fn iterations(&self) -> [Option<usize>; 2] {
        [&self.basic, &self.mpsot]
            .map(|outcome| outcome.swarm.as_ref().map(|swarm| swarm.iterations))
    }
}
