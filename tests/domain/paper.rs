//! The paper's claims, held against its tests made again: fewer samples, fewer iterations, the same
//! parameters. Times are asserted as the work they stand for: samples, particles and iterations multiplied.

use std::sync::LazyLock;

use headingd::calibration::model::Mode;
use published::{Column, ITERATIONS_SHARE, MPSOT_TIME_SHARE, RIST_TIME_SHARE, TEST1_SAMPLES};
use trial::{Trial, TrialRun, trials};

use crate::effort::times;

#[path = "../../examples/paper/log.rs"]
mod log;
#[path = "../../examples/paper/published.rs"]
mod published;
#[path = "../../examples/paper/trial.rs"]
#[allow(dead_code, reason = "times are for the tables of the example")]
mod trial;

/// All tests with a seed, or with five.
static TRIALS: LazyLock<Vec<Trial>> = LazyLock::new(|| {
    let seeds = 1..=times(1, 5) as u64;
    seeds.flat_map(|seed| trials(seed).unwrap()).collect()
});

fn of(mode: Mode) -> impl Iterator<Item = &'static Trial> {
    TRIALS.iter().filter(move |trial| trial.mode == mode)
}

#[test]
fn rist_takes_about_the_samples_of_figure_7() {
    let [total, window] = TEST1_SAMPLES;
    for trial in of(Mode::Planar) {
        assert_eq!((trial.total, trial.all.samples), (total, total));
        // It ends where noise puts the extreme of a smooth curve.
        assert!(
            trial.rist.samples.abs_diff(window) <= window / 10,
            "{}: {}",
            trial.name,
            trial.rist.samples
        );
    }
}

#[test]
fn rist_costs_at_most_40_percent_of_all_samples() {
    for trial in TRIALS.iter() {
        assert_eq!(trial.all.iterations, trial.rist.iterations);
        let share = trial.rist.residuals as f64 / trial.all.residuals as f64;
        assert!(share <= RIST_TIME_SHARE, "{}: {share}", trial.name);
    }
}

#[test]
fn mpsot_stops_by_itself_within_a_third_of_the_iterations() {
    for trial in TRIALS.iter() {
        assert_eq!(
            (trial.mpsot.stop, trial.mpsot.samples),
            ("change", trial.rist.samples)
        );
        let share = trial.mpsot.iterations as f64 / trial.rist.iterations as f64;
        assert!(
            share <= ITERATIONS_SHARE.min(MPSOT_TIME_SHARE),
            "{}: {share}",
            trial.name
        );
    }
}

/// Largest differences of scale factors and biases among columns of one test.
fn spread(axes: usize, columns: &[(&[f64], &[f64])]) -> [f64; 2] {
    let range = |values: &dyn Fn(usize) -> f64| {
        let all = || (0..columns.len()).map(values);
        all().fold(f64::MIN, f64::max) - all().fold(f64::MAX, f64::min)
    };
    let mut largest = [0.0f64; 2];
    for axis in 0..axes {
        largest[0] = largest[0].max(range(&|k| columns[k].0[axis]));
        largest[1] = largest[1].max(range(&|k| columns[k].1[axis]));
    }
    largest
}

#[test]
fn fewer_samples_and_iterations_cost_less_accuracy_than_in_the_paper() {
    for trial in TRIALS.iter() {
        let paper = trial
            .published
            .columns()
            .map(|c: &Column| (&c.scale[..], &c.bias_mgauss[..]));
        let run = |run: &'static TrialRun| (&run.scale[..], &run.bias_mgauss[..]);
        let truth = &trial.published.all;
        let ours = [
            (&truth.scale[..], &truth.bias_mgauss[..]),
            run(&trial.all),
            run(&trial.rist),
            run(&trial.mpsot),
        ];
        let (theirs, ours) = (spread(trial.axes(), &paper), spread(trial.axes(), &ours));
        assert!(
            ours[0] < theirs[0] && ours[1] < theirs[1],
            "{}: paper {theirs:?}, ours {ours:?}",
            trial.name
        );
        assert!(ours[0] < 0.01 && ours[1] < 1.5, "{}: {ours:?}", trial.name);
    }
}

#[test]
fn profile_standard_comes_nearer_than_profile_paper() {
    let off = |pick: fn(&Trial) -> &TrialRun| {
        let mut squares = 0.0;
        for trial in TRIALS.iter() {
            for axis in 0..trial.axes() {
                let truth = trial.published.all.bias_mgauss[axis];
                squares += (pick(trial).bias_mgauss[axis] - truth).powi(2);
            }
        }
        squares
    };
    assert!(off(|t| &t.standard) < 0.25 * off(|t| &t.mpsot));
}
