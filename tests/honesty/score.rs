//! What one run is worth: when headings came, how far off they were, and whether that was admitted.

use std::fs::File;
use std::io::{BufWriter, Write};

use headingd::frame::wrap_pi;
use headingd::recording::Entry;

use crate::daemon::Shown;

/// From when on errors count.
#[derive(Clone, Copy, Default, PartialEq)]
pub enum From {
    #[default]
    FirstHeading,
    FirstGood,
    Time(f64),
}

/// Something that has to be said, and when it was.
pub struct Watch {
    /// From when on it is true, seconds.
    from_s: f64,
    wanted: fn(&Shown) -> bool,
    /// How long it took.
    pub after_s: Option<f64>,
    /// Whether headings were good just before.
    pub ready: bool,
}

/// An error is counted in bins of this size, degrees.
const BIN_DEG: f64 = 0.05;
/// Samples further apart than this do not stand for all the time between them, seconds.
const LONGEST_S: f64 = 0.5;

/// One run's score.
#[derive(Default)]
pub struct Score {
    /// When motion starts, seconds.
    pub starts_s: f64,
    pub errors_from: From,
    /// Nothing counts in these.
    pub excluded: Vec<(f64, f64)>,
    /// Headings need not be good in these.
    pub faults: Vec<(f64, f64)>,
    /// By then it must have been learnt: the time that is to be good begins, if it has not with the first good heading.
    pub learnt_by_s: f64,
    /// Good time, and what of it was false, counts from here.
    pub good_from_s: f64,
    pub watch: Option<Watch>,
    /// How far the board has turned in turns, degrees.
    pub turned_deg: f64,
    /// The run starts with the true calibration: what is left are the errors of motion, place and simulation.
    pub given_truth: bool,
    /// The daemon is told the place, with a dip that is off by so much.
    pub place_off_deg: Option<f64>,
    /// The readings, if they are to be kept.
    pub readings: Option<Vec<Entry>>,
    trace: Option<BufWriter<File>>,

    last_s: Option<f64>,
    pub first_s: Option<f64>,
    pub first_turned_deg: Option<f64>,
    first_good_s: Option<f64>,
    /// Samples since the first heading, and those with one.
    pub since: u64,
    pub with: u64,
    /// Errors: how many, squares, squares over variance.
    pub errors: u64,
    pub squares: f64,
    pub normalised: u64,
    pub normalised_squares: f64,
    bins: Vec<u32>,
    /// Seconds.
    pub time_s: f64,
    pub false_s: f64,
    pub should_be_good_s: f64,
    pub is_good_s: f64,
    pub good_s: f64,
    pub false_good_s: f64,
    first_error_deg: Option<f64>,
    /// How far the error moved from what it was at first, degrees.
    pub drift_deg: f64,
    /// Of an accepted calibration: what it claims, and its true error, degrees.
    pub accepted: Vec<(f64, f64)>,
    /// Figures of one family alone.
    pub other: Vec<f64>,
}

impl Score {
    pub fn new(trace: Option<BufWriter<File>>, given_truth: bool) -> Self {
        let mut score = Self {
            learnt_by_s: f64::INFINITY,
            given_truth,
            trace,
            ..Self::default()
        };
        if let Some(trace) = &mut score.trace {
            writeln!(
                trace,
                "t,truth,mheading,heading_sd,inst_heading,state,reason,error"
            )
            .expect("the trace");
        }
        score
    }

    /// Takes what is shown for a magnetometer reading at `t_s`; `None` truth is not known.
    pub fn take(&mut self, t_s: f64, truth_deg: Option<f64>, shown: &Shown) {
        let error = truth_deg
            .zip(shown.heading_deg)
            .map(|(truth, heading)| apart_deg(heading, truth));
        self.write_trace(t_s, truth_deg, shown, error);
        let last_s = self.last_s.replace(t_s);
        let dt = last_s.map_or(0.0, |last_s| (t_s - last_s).clamp(0.0, LONGEST_S));
        self.look(t_s, shown);
        if shown.heading_deg.is_some() && self.first_s.is_none() {
            self.first_s = Some(t_s - self.starts_s);
            self.first_turned_deg = Some(self.turned_deg);
        }
        if shown.good() && self.first_good_s.is_none() {
            self.first_good_s = Some(t_s);
        }
        if within(&self.excluded, t_s) {
            return;
        }
        self.time_s += dt;
        let learnt = self
            .first_good_s
            .is_some_and(|first| first <= self.learnt_by_s)
            || t_s >= self.learnt_by_s;
        if learnt && !within(&self.faults, t_s) {
            self.should_be_good_s += dt;
            self.is_good_s += if shown.good() { dt } else { 0.0 };
        }
        if self.first_s.is_some() && truth_deg.is_some() {
            self.since += 1;
            self.with += u64::from(shown.heading_deg.is_some());
        }
        if shown.good() && t_s >= self.good_from_s {
            self.good_s += dt;
        }
        let Some(error) = error else { return };
        // A heading without a deviation claims to have none.
        let sd = shown.sd_deg.unwrap_or(0.0).max(0.01);
        let size = error.abs();
        let false_good = shown.good() && size > 5.0 && size > 3.0 * sd;
        if false_good || (size > 10.0 && size > 4.0 * sd) {
            self.false_s += dt;
        }
        if false_good && t_s >= self.good_from_s {
            self.false_good_s += dt;
        }
        self.normalised += 1;
        self.normalised_squares += (error / sd).powi(2);
        let counts = match self.errors_from {
            From::FirstHeading => true,
            From::FirstGood => self.first_good_s.is_some(),
            From::Time(from_s) => t_s >= from_s,
        };
        if counts {
            self.errors += 1;
            self.squares += error * error;
            let first = *self.first_error_deg.get_or_insert(error);
            self.drift_deg = self.drift_deg.max(apart_deg(error, first).abs());
            let bin = (size / BIN_DEG) as usize;
            if self.bins.len() <= bin {
                self.bins.resize(bin + 1, 0);
            }
            self.bins[bin] += 1;
        }
    }

    fn look(&mut self, t_s: f64, shown: &Shown) {
        let Some(watch) = &mut self.watch else { return };
        if t_s < watch.from_s {
            watch.ready = shown.good();
        } else if watch.after_s.is_none() && (watch.wanted)(shown) {
            watch.after_s = Some(t_s - watch.from_s);
        }
    }

    /// Watches for what must be said from `from_s` on.
    pub fn watch(&mut self, from_s: f64, wanted: fn(&Shown) -> bool) {
        self.watch = Some(Watch {
            from_s,
            wanted,
            after_s: None,
            ready: false,
        });
    }

    fn write_trace(&mut self, t_s: f64, truth: Option<f64>, shown: &Shown, error: Option<f64>) {
        let Some(trace) = &mut self.trace else { return };
        let cell = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.3}"));
        writeln!(
            trace,
            "{t_s:.3},{},{},{},{},{},{},{}",
            cell(truth.map(|truth| truth.rem_euclid(360.0))),
            cell(shown.heading_deg),
            cell(shown.sd_deg),
            cell(shown.instantaneous_deg),
            shown.condition.word(),
            shown.reason,
            cell(error)
        )
        .expect("the trace");
    }

    pub fn nerr(&self) -> Option<f64> {
        (self.normalised > 0).then(|| (self.normalised_squares / self.normalised as f64).sqrt())
    }
}

/// One line about each run.
pub fn each(seeds: &[u64], scores: &[Score]) {
    for (seed, score) in seeds.iter().zip(scores) {
        let square = score.squares / score.errors.max(1) as f64;
        eprintln!(
            "  seed {seed}: first {:.1?} s, RMS {:.2}, nerr {:.2?}, false-sure {:.1} s, good {:.0} of {:.0} s, told {:.1?}, drift {:.1}",
            score.first_s,
            square.sqrt(),
            score.nerr(),
            score.false_s,
            score.is_good_s,
            score.should_be_good_s,
            score.watch.as_ref().and_then(|watch| watch.after_s),
            score.drift_deg,
        );
    }
}

/// The error that `share` of all the scores' errors do not exceed, degrees.
pub fn percentile_deg(scores: &[Score], share: f64) -> Option<f64> {
    let total: u64 = scores.iter().map(|score| score.errors).sum();
    let bins = scores.iter().map(|score| score.bins.len()).max()?;
    let mut below = 0;
    for bin in 0..bins {
        let here = scores.iter().filter_map(|score| score.bins.get(bin));
        below += here.map(|count| u64::from(*count)).sum::<u64>();
        if below as f64 >= share * total as f64 {
            return Some((bin + 1) as f64 * BIN_DEG);
        }
    }
    None
}

fn within(windows: &[(f64, f64)], t_s: f64) -> bool {
    windows.iter().any(|(from, to)| (*from..*to).contains(&t_s))
}

/// The difference of two headings, degrees, -180 to 180.
pub fn apart_deg(a: f64, b: f64) -> f64 {
    wrap_pi((a - b).to_radians()).to_degrees()
}
