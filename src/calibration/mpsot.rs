//! MPSOT, the modified PSO technique (section 4.3, Appendix 2): the swarm's own stopping rule.
//!
//! Three levels: a maximum number of iterations, a minimum fit value, and parameters that have
//! stopped changing. For the last, each parameter of the global best is held against its mean over
//! the L iterations before; when more than half of the parameters differ by no more than a threshold,
//! the swarm has converged.

use super::settings::{Settings, StopChoice};
use crate::check::words;

words! {
    /// What stopped a swarm.
    pub enum Stop {
        /// Level 1: the maximum number of iterations.
        Iterations = "iterations",
        /// Level 2: the fit value reached the minimum error.
        Error = "error",
        /// Level 3: the parameters no longer change.
        Change = "change",
        /// None of the paper's: somebody gave the calibration up.
        Cancelled = "cancelled",
    }
}

/// Watches the global best from iteration to iteration.
#[derive(Clone, Debug)]
pub struct ConvergenceMonitor<'a, const P: usize> {
    settings: &'a Settings,
    /// L.
    window: usize,
    iteration: usize,
    /// The last L values of every parameter, as a ring.
    history: Vec<[f64; P]>,
}

impl<'a, const P: usize> ConvergenceMonitor<'a, P> {
    /// Nothing seen yet.
    pub fn new(settings: &'a Settings) -> Self {
        let window = settings.mean_window();
        Self {
            settings,
            window,
            iteration: 0,
            history: Vec::with_capacity(window),
        }
    }

    /// Takes one iteration's global best; returns the reason to stop, if there is one.
    pub fn iterated(&mut self, parameters: &[f64; P], fit_value: f64) -> Option<Stop> {
        let converged = self.converged(parameters);
        if self.history.len() < self.window {
            self.history.push(*parameters);
        } else {
            self.history[self.iteration % self.window] = *parameters;
        }
        self.iteration += 1;
        if fit_value <= self.settings.min_error_mgauss2 {
            Some(Stop::Error)
        } else if converged {
            Some(Stop::Change)
        } else if self.iteration >= self.settings.max_iterations {
            Some(Stop::Iterations)
        } else {
            None
        }
    }

    /// Appendix 2: level 3, which the basic algorithm leaves out. Until L iterations have gone by there is no mean to compare with.
    fn converged(&self, parameters: &[f64; P]) -> bool {
        if self.settings.stop == StopChoice::Basic || self.history.len() < self.window {
            return false;
        }
        let settled = (0..P).filter(|&i| {
            let sum: f64 = self.history.iter().map(|past| past[i]).sum();
            let average = sum / self.history.len() as f64;
            (parameters[i] - average).abs() <= self.settings.min_change
        });
        2 * settled.count() > P
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings {
            max_iterations: 100,
            min_error_mgauss2: 5.0,
            mean_window: Some(3),
            ..Settings::default()
        }
    }

    #[test]
    fn stops_when_more_than_half_of_the_parameters_have_settled() {
        let settings = settings();
        let mut watch = ConvergenceMonitor::new(&settings);
        // Means over the three before the fourth: 2, 7, 10, 1.0.
        for parameters in [
            [1.0, 7.0, 10.0, 1.0],
            [2.0, 7.0, 10.0, 1.0],
            [3.0, 7.0, 10.0, 1.0],
        ] {
            assert_eq!(watch.iterated(&parameters, 100.0), None);
        }
        // Two of four have settled (7.0 and 10.01 by exactly the threshold or less): not more than half.
        assert_eq!(watch.iterated(&[4.0, 7.0, 10.005, 1.5], 100.0), None);
        // Means now: 3, 7, 10.0017, 1.1667. Differences: 0.005, 0, 0.0067, 0.83: three of four.
        assert_eq!(
            watch.iterated(&[3.005, 7.0, 9.995, 2.0], 100.0),
            Some(Stop::Change)
        );
    }

    #[test]
    fn a_difference_of_exactly_the_threshold_counts() {
        let settings = Settings {
            mean_window: Some(1),
            min_change: 0.5,
            ..settings()
        };
        let mut watch = ConvergenceMonitor::new(&settings);
        assert_eq!(watch.iterated(&[1.0], 100.0), None);
        assert_eq!(watch.iterated(&[1.5], 100.0), Some(Stop::Change));
    }

    #[test]
    fn the_minimum_error_stops_at_once() {
        let settings = settings();
        let mut watch = ConvergenceMonitor::new(&settings);
        assert_eq!(watch.iterated(&[1.0, 1.0], 5.1), None);
        assert_eq!(watch.iterated(&[9.0, 9.0], 5.0), Some(Stop::Error));
    }

    #[test]
    fn the_basic_algorithm_runs_to_the_maximum() {
        let settings = Settings {
            stop: StopChoice::Basic,
            ..settings()
        };
        let mut watch = ConvergenceMonitor::new(&settings);
        for _ in 0..99 {
            assert_eq!(watch.iterated(&[1.0], 100.0), None);
        }
        assert_eq!(watch.iterated(&[1.0], 100.0), Some(Stop::Iterations));
    }
}
