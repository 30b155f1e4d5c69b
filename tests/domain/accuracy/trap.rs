//! The objective falls towards 0 as the scale grows without bound with the centre far outside the data. The
//! box that is taken from the data keeps the swarm out of that trap.

use std::sync::atomic::AtomicBool;

use headingd::calibration::fit;
use headingd::calibration::objective::{Factored, Normalizer};
use headingd::calibration::settings::Settings;
use headingd::calibration::swarm::{Bounds, search};

use super::cases::Case;
use super::survey::{differ, points, tallies, true_position};
use crate::effort::times;

#[test]
fn the_search_box_holds_the_truth() {
    for tally in tallies() {
        assert_eq!(tally.outside, 0, "{}", tally.case.name());
    }
}

#[test]
fn swarms_end_where_a_refinement_from_the_truth_ends() {
    let logs: usize = tallies().iter().map(|tally| tally.logs).sum();
    assert!(logs >= times(500, 10_000));
    for tally in tallies() {
        assert_eq!(tally.trapped, 0, "{}", tally.case.name());
    }
}

/// Why the box must not be widened to what is handy.
#[test]
fn a_wide_box_is_a_trap() {
    const LOGS: u64 = 200;
    let case = Case::planar(2.0);
    let reference = case.reference_mgauss();
    // Biases within 300 mG of 0 whatever the scale, scale factors of 0.3 to 3.
    let wide = Bounds::<2> {
        low: [-1e4; 2],
        high: [1e4; 2],
        scale_min: [0.3; 2],
        scale_max: [3.0; 2],
        margin_mgauss: 300.0,
        reference_mgauss: reference,
    };
    let wrong = (0..LOGS).filter(|&seed| {
        let log = case.log_without_gyro(seed);
        let points = points::<2>(&log);
        let objective = Factored::<2, 5>::new(
            Normalizer::new(&[-300.0; 2], &[300.0; 2]),
            &points,
            reference,
        );
        let settings = Settings {
            seed,
            ..Settings::default()
        };
        let fit_value = |position: &_| objective.fit_value(position);
        let found = search(&wide, &settings, None, fit_value, &AtomicBool::new(false));
        let truth =
            fit::refine_and_normalize(&points, &true_position(&log), reference, true).unwrap();
        fit::refine_and_normalize(&points, &found.position, reference, true)
            .is_none_or(|end| differ::<2, 4>(&end, &truth))
    });
    let wrong = wrong.count();
    println!("{wrong} of {LOGS} swarms in a wide box ended wrong");
    assert!(wrong as u64 * 10 >= LOGS, "{wrong}");
}
