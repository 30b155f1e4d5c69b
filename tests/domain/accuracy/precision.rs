//! Parameters and headings stand at the Cramér–Rao bound, and no swarm ends in the trap.

use headingd::calibration::calibrate;
use headingd::calibration::model::Mode;

use super::bound::Errors;
use super::cases::Case;
use super::survey::{slack, tallies};

/// The largest ratio to the bound that is allowed: its 5 % are sampling error, of many logs, and the biweight's 1 %. Where
/// few samples tell of a parameter and noise is large the bound itself, a first-order one, is not quite
/// reached.
fn allowed(case: &Case) -> f64 {
    let rough = case.mode == Mode::Spatial && case.sigma > 2.0;
    if rough || case.two_circles || case.spikes {
        1.0 + 0.10 * slack()
    } else {
        1.0 + 0.05 * slack()
    }
}

/// Run with `--nocapture` for the table.
#[test]
fn bias_scale_and_heading_stand_at_the_bound() {
    println!("case: bias mG / scale % / heading ° RMS; the bound's; ratios");
    let mut faults = Vec::new();
    for tally in tallies() {
        let text =
            |errors: Errors| format!("{:.3}/{:.3}/{:.3}", errors[0], 100.0 * errors[1], errors[2]);
        let [bias, scale, heading] = tally.ratios().into();
        let line = format!(
            "{:16} {}  {}  {bias:.3} {scale:.3} {heading:.3}",
            tally.case.name(),
            text(tally.rms),
            text(tally.bound),
        );
        println!("{line}");
        if bias.max(scale).max(heading) > allowed(&tally.case) {
            faults.push(line);
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// The whole calibration, with RIST's window and the wobble taken out of a planar turn where there is one,
/// must not cost what the fit has reached.
#[test]
fn the_whole_calibration_is_as_exact_as_its_fit() {
    for case in [
        Case::planar(0.5),
        Case::planar(2.0),
        Case::planar(2.0).spikes(),
        Case::spatial(2.0),
        Case::spatial(2.0).spikes(),
    ] {
        for seed in 0..20 {
            let log = case.log(seed);
            let bias = |request| calibrate(request).bias_mgauss.unwrap();
            let whole = bias(&log.request);
            let alone = bias(&case.log_without_gyro(seed).request);
            for (whole, alone) in whole.iter().zip(&alone) {
                let name = case.name();
                assert!(
                    (whole - alone).abs() < 1e-3,
                    "{name} {seed}: {whole} {alone}"
                );
            }
        }
    }
}

/// The objective falls towards 0 as the scale grows without bound with the centre far outside the data. The box that is taken
/// from the data keeps the swarm out of that trap: in one of ±300 mG, with scale factors of 0.3 to 3, every tenth swarm ended in it.
#[test]
fn swarms_end_where_a_refinement_from_the_truth_ends_in_a_box_that_holds_it() {
    for tally in tallies() {
        let name = tally.case.name();
        assert_eq!((tally.outside, tally.trapped), (0, 0), "{name}");
    }
}
