//! The pipeline on its own: how readings come, when outcomes arrive, and which calibration stays.

use headingd::calibration::calibrate;
use headingd::calibration::model::{Calibration, Parameters, Planar};
use headingd::calibration::outcome::{Outcome, Verdict};
use headingd::calibration::policy::Policy;
use headingd::condition::Condition;
use headingd::heading::Heading;
use headingd::pipeline::{Action, Event, Pipeline, Setup, Survey};
use headingd::reading::Reading;
use headingd::sensor::simulator::{Scenario, Settings, Simulator};
use nalgebra::{Vector2, Vector3};

use crate::common::{apart_deg, moving, rms, simulated, turn_errors_deg, turning};

fn readings(settings: &Settings) -> Vec<Reading> {
    let (_, entries) = simulated(settings);
    entries.iter().map(|entry| entry.reading).collect()
}

/// What a pipeline did with readings.
#[derive(Default)]
struct Played {
    headings: Vec<Heading>,
    /// Each outcome with the number of the reading after which it arrived.
    outcomes: Vec<(usize, Outcome)>,
    /// For each calibration asked for: the number of the reading, and how many turns it uses.
    asked: Vec<(usize, usize)>,
    /// For each full turn, the number of the reading.
    turned: Vec<usize>,
    /// The reason of the condition after each reading, with its time.
    reasons: Vec<(f64, &'static str)>,
    calibration: Option<Calibration>,
}

/// Feeds readings one by one. An outcome arrives `late` readings after it was asked for,
/// or as many steps after it once the readings have ended.
fn play(readings: &[Reading], start: Option<Calibration>, late: usize) -> Played {
    let mut pipeline = Pipeline::new(Setup::default(), start);
    let mut played = Played::default();
    let mut under_way: Option<(usize, Outcome)> = None;
    let mut reason = None;
    for index in 0..readings.len() + 4 * late {
        let mut actions = Vec::new();
        if let Some(reading) = readings.get(index) {
            pipeline.handle(Event::Reading(*reading), &mut actions);
        }
        loop {
            for action in std::mem::take(&mut actions) {
                match action {
                    Action::Publish(heading) => played.headings.push(heading),
                    Action::Report(report) => reason = Some(report.reason),
                    Action::Warn(_) => {}
                    Action::Turned(_) => played.turned.push(index),
                    Action::Calibrate(request) => {
                        assert!(under_way.is_none(), "two calibrations at a time");
                        played.asked.push((index, request.turns.len()));
                        under_way = Some((index + late, calibrate(&request)));
                    }
                    Action::Conclude(outcome, _) => played.outcomes.push((index, *outcome)),
                }
            }
            match under_way.take_if(|(due, _)| *due <= index) {
                Some((_, outcome)) => {
                    pipeline.handle(Event::Calibrated(Box::new(outcome)), &mut actions);
                }
                None => break,
            }
        }
        if let (Some(reading), Some(reason)) = (readings.get(index), reason) {
            played.reasons.push((reading.t_s, reason));
        }
    }
    played.calibration = pipeline.calibration();
    played
}

impl Played {
    /// When this was the reason, seconds.
    fn when(&self, reason: &str) -> Vec<f64> {
        let such = self.reasons.iter().filter(|(_, now)| *now == reason);
        such.map(|(t_s, _)| *t_s).collect()
    }
}

/// A planar calibration that is off by a shift of its bias.
fn shifted(settings: &Settings, shift_mgauss: f64) -> Calibration {
    let scale = Vector2::new(settings.scale[0], settings.scale[1]);
    let [x, y, _] = settings.bias_mgauss;
    let parameters = Parameters::Planar(Planar {
        basis: [Vector3::x(), Vector3::y()],
        bias_mgauss: Vector2::new(x + shift_mgauss, y),
        scale: scale / scale.mean(),
        level: Vector2::zeros(),
    });
    let strength_mgauss = settings.horizontal_mgauss * scale.mean();
    Calibration::of(parameters, strength_mgauss, 2.0, 0.05)
}

/// Error of a planar calibration's headings in a level turn without noise, with a magnet near, degrees RMS.
fn error_deg(calibration: &Calibration, settings: &Settings, magnet_mgauss: [f64; 3]) -> f64 {
    let iron = Vector3::from(settings.bias_mgauss) + Vector3::from(magnet_mgauss);
    let board = Settings {
        bias_mgauss: iron.into(),
        ..settings.clone()
    };
    let correct = |raw: &Vector3<f64>| calibration.parameters.correct(raw).unwrap();
    rms(&turn_errors_deg(
        &board,
        [Vector3::x(), Vector3::y()],
        correct,
    ))
}

fn steers(heading: &Heading) -> bool {
    heading.condition.may_steer() && heading.instantaneous_deg.is_some()
}

/// The field with a magnet near from `from_s` on.
fn with_magnet(readings: &[Reading], from_s: f64, magnet_mgauss: [f64; 3]) -> Vec<Reading> {
    let mut readings = readings.to_vec();
    for reading in readings.iter_mut().filter(|reading| reading.t_s >= from_s) {
        if let Some(field) = &mut reading.field_mgauss {
            for (value, magnet) in field.iter_mut().zip(magnet_mgauss) {
                *value = value.map(|value| value + magnet);
            }
        }
    }
    readings
}

#[test]
fn readings_may_come_one_by_one_or_merged() {
    // Chips that tick together but for 3 milliseconds, so that their readings can be merged.
    let settings = Settings {
        mag_rate_hz: 50.0,
        gyro_rate_hz: 50.0,
        ..Settings::default()
    };
    let single = readings(&settings);
    let merged: Vec<Reading> = single
        .chunks_exact(2)
        .map(|pair| {
            assert!(pair[0].rate_rad_s.is_some() && pair[1].field_mgauss.is_some());
            Reading {
                t_s: pair[1].t_s,
                field_mgauss: pair[1].field_mgauss,
                ..pair[0]
            }
        })
        .collect();
    let (single, merged) = (play(&single, None, 0), play(&merged, None, 0));
    assert_eq!(single.headings.len(), merged.headings.len());
    assert_eq!(single.outcomes.len(), merged.outcomes.len());
    let (a, b) = (single.calibration.unwrap(), merged.calibration.unwrap());
    for calibration in [a, b] {
        let error = error_deg(&calibration, &settings, [0.0; 3]);
        assert!(error < 2.0, "{error}");
    }
    let last = |played: &Played| played.headings.last().unwrap().instantaneous_deg.unwrap();
    let apart = apart_deg(last(&single), last(&merged));
    assert!(apart.abs() < 1.0, "{apart}");
}

#[test]
fn headings_go_on_while_an_outcome_is_awaited() {
    const LATE: usize = 200;
    let settings = turning(1.0);
    let readings = readings(&settings);
    let magnetometer = readings.iter().filter(|r| r.field_mgauss.is_some()).count();

    // There is a heading for every reading, and one to steer by once it is worth something.
    let played = play(&readings, None, LATE);
    assert_eq!(played.headings.len(), magnetometer);
    let (asked, concluded) = (played.asked[0].0, late_outcome(&played, LATE));
    assert_eq!(concluded, asked + LATE);
    let (from_s, to_s) = (readings[asked].t_s, readings[concluded].t_s);
    let meanwhile = |h: &&Heading| h.t_s > from_s && h.t_s <= to_s;
    assert!(played.headings.iter().filter(meanwhile).count() > 40);
    for heading in &played.headings {
        assert!(heading.raw_deg.is_some());
        let certain = heading.sd_deg.is_some_and(|sd_deg| sd_deg <= 10.0);
        assert_eq!(steers(heading), certain, "{heading:?}");
        assert!(certain || heading.t_s <= to_s, "{heading:?}");
    }

    // With a worn one it steers until the better one comes.
    let worn = shifted(&settings, 30.0);
    let played = play(&readings, Some(worn), LATE);
    assert_eq!(late_outcome(&played, LATE), played.asked[0].0 + LATE);
    let error = error_deg(&played.calibration.unwrap(), &settings, [0.0; 3]);
    assert!(
        error < 2.0 && error_deg(&worn, &settings, [0.0; 3]) > 5.0,
        "{error}"
    );
}

/// After which reading the outcome of the first turn came.
fn late_outcome(played: &Played, late: usize) -> usize {
    let of_turn = played
        .outcomes
        .iter()
        .find(|(_, outcome)| outcome.method == "turn");
    let (index, outcome) = of_turn.expect("no outcome of a turn");
    assert_ne!(outcome.verdict, Verdict::Rejected, "{late}");
    *index
}

#[test]
fn turns_made_meanwhile_wait_and_are_used() {
    let readings = readings(&turning(3.0));
    // 140 readings a second and 7 seconds a turn: the first outcome comes in the third turn.
    let late = 1500;
    let played = play(&readings, None, late);
    assert_eq!(played.turned.len(), 3, "{:?}", played.turned);
    let (first, second) = (played.asked[0], played.asked[1]);
    assert_eq!(first, (played.turned[0], 1));
    // Asked for as soon as the first is done, with the turn that waited.
    let ended: Vec<usize> = played
        .outcomes
        .iter()
        .filter(|(_, outcome)| outcome.method == "turn")
        .map(|(index, _)| *index)
        .collect();
    assert_eq!(ended.len(), 3);
    assert!(played.turned[1] < ended[0] && ended[0] < played.turned[2]);
    assert_eq!(second, (ended[0], 2));
    // The third came while the second was under way.
    assert_eq!(played.asked[2].0, ended[1]);
    assert_eq!(played.asked.len(), 3);
    assert!(
        played
            .outcomes
            .iter()
            .all(|(_, one)| one.verdict != Verdict::Rejected)
    );
}

#[test]
fn turn_after_turn_the_calibration_stays_right() {
    let settings = turning(6.0);
    let played = play(&readings(&settings), Some(shifted(&settings, 0.0)), 0);
    assert_eq!(played.asked.len(), 6);
    for (_, outcome) in &played.outcomes {
        assert_ne!(outcome.verdict, Verdict::Rejected, "{outcome:?}");
    }
    let error = error_deg(&played.calibration.unwrap(), &settings, [0.0; 3]);
    assert!(error < 2.0, "{error}");
}

/// A good turn, and a magnet that comes at `from_s` in the second one: with the first turn just before it, or
/// alone after a good calibration. Nothing that is wrong may be accepted, nor called good.
fn assert_honest(seed: u64, magnet: [f64; 3], from_s: f64, alone: bool) {
    let settings = Settings {
        seed,
        ..Settings::default()
    };
    let clean = readings(&settings);
    let one = readings(&Settings {
        turns: 1.0,
        ..settings.clone()
    });
    let (played, from_s) = if alone {
        let start = Some(shifted(&settings, 0.0));
        let from_s = from_s - 7.0;
        (play(&with_magnet(&one, from_s, magnet), start, 0), from_s)
    } else {
        (play(&with_magnet(&clean, from_s, magnet), None, 0), from_s)
    };
    let what = format!("seed {seed}, {magnet:?} from {from_s} s, alone: {alone}");
    let mut turns = 0;
    for (_, outcome) in &played.outcomes {
        turns += usize::from(outcome.method == "turn");
        if let Some(calibration) = &outcome.calibration {
            // Made before the magnet came, or with it.
            let error = error_deg(calibration, &settings, magnet).min(error_deg(
                calibration,
                &settings,
                [0.0; 3],
            ));
            assert!(
                error < 3.0 * calibration.heading_sd_deg.max(1.0),
                "{what}: {error} degrees RMS, {outcome:?}"
            );
        }
    }
    assert!(turns >= 1, "{what}");
    // At the end the board points north again.
    let last = played.headings.last().unwrap();
    if let (Condition::Good, Some(fused), Some(sd)) = (last.condition, last.fused_deg, last.sd_deg)
    {
        assert!(
            apart_deg(fused, 0.0).abs() < (3.0 * sd).max(5.0),
            "{what}: {last:?}"
        );
    }
}

/// The first turn is done by 10.5 s and the second by 17.5 s.
const COMES_S: [f64; 3] = [12.5, 13.5, 14.5];

#[test]
fn a_magnet_that_comes_during_a_turn_changes_nothing() {
    for seed in 1..=3 {
        for from_s in COMES_S {
            for magnet in [
                [60.0, 0.0, 0.0],
                [-60.0, 0.0, 0.0],
                [100.0, 100.0, 50.0],
                [-250.0, 40.0, 0.0],
            ] {
                assert_honest(seed, magnet, from_s, false);
                assert_honest(seed, magnet, from_s, true);
            }
            assert_honest(seed, [0.0, 60.0, 0.0], from_s, false);
            assert_honest(seed, [0.0, -60.0, 0.0], from_s, false);
        }
    }
}

/// An arc without the magnet and one with it can look like one ellipse: residual 3 to 6 mG, gyro within 4 to 5
/// degrees, and headings wrong by 8 degrees with and without the magnet.
#[test]
fn a_magnet_that_stretches_the_circle_changes_nothing() {
    for from_s in COMES_S {
        assert_honest(1, [0.0, 60.0, 0.0], from_s, true);
        assert_honest(1, [0.0, -60.0, 0.0], from_s, true);
    }
}

#[test]
fn a_magnet_that_stays_is_calibrated_away() {
    let settings = turning(4.0);
    let readings = with_magnet(&readings(&settings), 0.0, [60.0, -30.0, 20.0]);
    let played = play(&readings, Some(shifted(&settings, 0.0)), 0);
    let error = error_deg(&played.calibration.unwrap(), &settings, [60.0, -30.0, 20.0]);
    assert!(error < 2.0, "{error}");
}

/// How far each heading that may steer is from that of sound readings, degrees, and the deviation that it claims.
fn apart_and_sd_deg(
    faulty: &[Reading],
    sound: &[Reading],
    calibration: Calibration,
) -> Vec<(f64, f64)> {
    let headings = |readings: &[Reading]| play(readings, Some(calibration), 0).headings;
    let (faulty, sound) = (headings(faulty), headings(sound));
    assert_eq!(faulty.len(), sound.len());
    let both = faulty.iter().zip(&sound);
    both.filter(|(faulty, _)| steers(faulty))
        .filter_map(|(faulty, sound)| {
            let apart = apart_deg(faulty.fused_deg?, sound.fused_deg?).abs();
            Some((apart, faulty.sd_deg?))
        })
        .collect()
}

/// The largest of these differences, degrees.
fn worst_deg(apart: &[(f64, f64)]) -> f64 {
    apart.iter().map(|(apart, _)| *apart).fold(0.0, f64::max)
}

/// All registers at their limit, as a bus that slips reads them, at rest and in a turn.
#[test]
fn an_absurd_rate_turns_no_heading() {
    let settings = Settings::default();
    let sound = readings(&settings);
    let calibration = shifted(&settings, 0.0);
    for from_s in [2.0, 8.0] {
        let mut faulty = sound.clone();
        let absurd = faulty
            .iter_mut()
            .find(|reading| reading.t_s > from_s && reading.rate_rad_s.is_some());
        absurd.unwrap().rate_rad_s = Some(Vector3::repeat(2279.4_f64.to_radians()));
        let apart = apart_and_sd_deg(&faulty, &sound, calibration);
        let worst_deg = worst_deg(&apart);
        assert!(
            apart.len() > 500 && worst_deg < 0.5,
            "{worst_deg} of {}",
            apart.len()
        );
    }
}

/// The full scale is known by what the gyro has said, and it has not said an absurd rate.
#[test]
fn after_an_absurd_rate_clipping_is_noticed_as_before() {
    let settings = Settings::default();
    let mut readings = readings(&settings);
    for reading in &mut readings {
        match (&mut reading.rate_rad_s, reading.t_s) {
            (Some(rate), 2.0..2.01) => *rate = Vector3::repeat(2279.4_f64.to_radians()),
            (Some(rate), 8.0..8.5) => rate.z = 250_f64.to_radians(),
            _ => {}
        }
    }
    let clipped = play(&readings, Some(shifted(&settings, 0.0)), 0).when("gyro_clipped");
    assert!(clipped.len() > 20 && clipped[0] >= 8.0, "{clipped:?}");
}

/// Degrees a second, read as radians a second. In each of the two rests the bias alone is a turn, slow enough for
/// a board.
#[test]
fn a_gyro_of_another_unit_does_not_calibrate_again_and_again() {
    let mut readings = readings(&moving(Scenario::Demo));
    for rate in readings.iter_mut().filter_map(|r| r.rate_rad_s.as_mut()) {
        *rate *= 1_f64.to_degrees();
    }
    let played = play(&readings, None, 0);
    assert!(played.asked.len() <= 2, "{:?}", played.asked);
    assert!(!played.when("gyro_scale").is_empty());
}

#[test]
fn a_magnetometer_that_hangs_in_a_turn_is_a_fault_until_it_goes_on() {
    let settings = Settings::default();
    let mut stuck = None;
    let mut readings = readings(&settings);
    for reading in &mut readings {
        if let (6.0..9.0, Some(field)) = (reading.t_s, &mut reading.field_mgauss) {
            *field = *stuck.get_or_insert(*field);
        }
    }
    let played = play(&readings, Some(shifted(&settings, 0.0)), 0);
    let frozen = played.when("frozen_magnetometer");
    let (first_s, last_s) = (frozen[0], frozen[frozen.len() - 1]);
    assert!((6.5..7.5).contains(&first_s), "{first_s}");
    assert!((8.9..9.1).contains(&last_s), "{last_s}");
    let meanwhile = |heading: &&Heading| (first_s..=last_s).contains(&heading.t_s);
    let mut meanwhile = played.headings.iter().filter(meanwhile);
    assert!(meanwhile.all(|heading| !heading.condition.may_steer()));
    let (_, last) = played.reasons[played.reasons.len() - 1];
    assert!(["good", "learning"].contains(&last), "{last}");
}

/// A logger that is faster than its magnetometer writes each sample down again and again.
#[test]
fn a_sample_that_is_held_for_a_tenth_of_a_second_turns_no_heading() {
    let settings = Settings::default();
    let sound = readings(&settings);
    let mut held = None;
    let mut faulty = sound.clone();
    let fields = faulty.iter_mut().filter_map(|r| r.field_mgauss.as_mut());
    for (count, field) in fields.enumerate() {
        if count % 5 == 0 {
            held = Some(*field);
        }
        *field = held.unwrap();
    }
    let apart = apart_and_sd_deg(&faulty, &sound, shifted(&settings, 0.0));
    // With a fifth of the samples a heading is less certain, so errors are compared in deviations. Were held samples taken for new
    // ones, the worst would be a whole deviation.
    let worst = apart.iter().map(|(apart, sd)| apart / sd);
    let worst = worst.fold(0.0, f64::max);
    let worst_deg = worst_deg(&apart);
    assert!(
        apart.len() > 500 && worst < 0.5 && worst_deg < 3.0,
        "{worst} deviations, {worst_deg}°, in {}",
        apart.len()
    );
}

/// An axis that clips without saying so is recognised only after some of its samples have been taken.
#[test]
fn what_a_clipped_axis_taught_before_it_was_recognised_is_forgotten() {
    let settings = Settings {
        turn_deg_s: 25.0,
        ..Settings::default()
    };
    let least = settings.bias_mgauss[0] - 0.7 * settings.horizontal_mgauss * settings.scale[0];
    // X clips from 8.5 to 12 s.
    let readings: Vec<_> = (readings(&settings).into_iter())
        .filter(|reading| reading.t_s < 11.0)
        .collect();
    let fields = readings.iter().filter_map(|reading| reading.field_mgauss);
    let clipped = fields.filter(|field| field[0].is_some_and(|x| x < least));
    assert!(clipped.count() > 50);
    let bias_mgauss = |clip: fn(f64, f64) -> Option<f64>| {
        let mut pipeline = Pipeline::new(Setup::default(), None);
        for mut reading in readings.clone() {
            if let Some([x, ..]) = &mut reading.field_mgauss {
                *x = x.and_then(|value| clip(value, least));
            }
            pipeline.handle(Event::Reading(reading), &mut Vec::new());
        }
        let (outcome, _) = pipeline.learnt_by_motion().unwrap();
        outcome.bias_mgauss.unwrap()
    };
    let silent = bias_mgauss(|value, least| Some(value.max(least)));
    let declared = bias_mgauss(|value, least| Some(value).filter(|value| *value > least));
    let apart = (0..3).map(|axis| (silent[axis] - declared[axis]).abs());
    // Noise is 2 mG. Were these samples kept, X would be off by 16 mG.
    assert!(apart.fold(0.0, f64::max) < 2.0, "{silent:?} {declared:?}");
}

/// Level turns and sways that repeat, without a rest that is long enough to be one. Each time a little leaks into what is learnt of the gyro
/// about the vertical, always of the same sign.
#[test]
fn a_motion_that_repeats_for_hours_teaches_no_wrong_gyro() {
    let last = endless(9600.0, f64::INFINITY, 0.0);
    let errors_deg: Vec<f64> = last.iter().map(|heading| heading.unwrap().0).collect();
    let error_deg = rms(&errors_deg);
    assert!(error_deg < 0.25, "{error_deg}");
}

/// Nothing is learnt of it, and nothing forgotten.
#[test]
fn a_locked_calibration_stays_as_certain_as_it_was() {
    for heading in endless(1500.0, 120.0, 0.0) {
        let (off_deg, sd_deg) = heading.unwrap();
        assert!(off_deg < 2.0 && sd_deg < 3.0, "{off_deg} {sd_deg}");
    }
}

#[test]
fn beside_a_locked_calibration_iron_that_comes_makes_headings_uncertain() {
    let headings = endless(900.0, 120.0, 100.0);
    let normalised: Vec<f64> = headings
        .iter()
        .flatten()
        .map(|(off, sd)| off / sd)
        .collect();
    let nerr = rms(&normalised);
    assert!(nerr < 1.5, "{nerr}");
}

/// A board that goes on moving. From `locked_from_s` on its calibration is locked, and a magnet is on it. Returns the error and the deviation
/// of each heading of the last ten minutes, degrees; `None` where there was no heading.
fn endless(lasts_s: f64, locked_from_s: f64, magnet_mgauss: f64) -> Vec<Option<(f64, f64)>> {
    let mut pipeline = Pipeline::new(Setup::default(), None);
    let (mut actions, mut last) = (Vec::new(), Vec::new());
    let entries = Simulator::new(moving(Scenario::Endless));
    for mut entry in entries.take_while(|entry| entry.reading.t_s < lasts_s) {
        if entry.reading.t_s >= locked_from_s {
            if pipeline.wanted().is_some() {
                pipeline.handle(Event::Policy(Policy::Locked), &mut actions);
            }
            if let Some([x, ..]) = &mut entry.reading.field_mgauss {
                *x = x.map(|x| x + magnet_mgauss);
            }
        }
        pipeline.handle(Event::Reading(entry.reading), &mut actions);
        for action in std::mem::take(&mut actions) {
            match action {
                Action::Publish(heading) if heading.t_s > lasts_s - 600.0 => {
                    let truth = entry.heading_truth_deg.unwrap();
                    let off_deg = heading.fused_deg.map(|deg| apart_deg(deg, truth));
                    last.push(off_deg.zip(heading.sd_deg));
                }
                Action::Calibrate(request) => {
                    let outcome = Box::new(calibrate(&request));
                    pipeline.handle(Event::Calibrated(outcome), &mut actions);
                    actions.clear();
                }
                _ => {}
            }
        }
    }
    last
}

/// Of a board that stays nearly level gravity says nothing of the gyro's bias about the vertical. The field does.
#[test]
fn a_bias_that_jumps_does_not_stay_in_the_rate_of_turn() {
    let entries = Simulator::new(moving(Scenario::Endless));
    let steady: Vec<Reading> = entries
        .map(|entry| entry.reading)
        .take_while(|reading| reading.t_s < 300.0)
        .collect();
    let jumped: Vec<Reading> = (steady.iter())
        .map(|reading| Reading {
            rate_rad_s: reading.rate_rad_s.map(|rate| match reading.t_s < 150.0 {
                true => rate,
                false => rate + Vector3::z() * 1.5_f64.to_radians(),
            }),
            ..*reading
        })
        .collect();
    let [steady, jumped] = [steady, jumped].map(|readings| play(&readings, None, 0).headings);
    let turns = |heading: &Heading| heading.turn_deg_min.map(|turn| turn / 60.0);
    let off: Vec<f64> = std::iter::zip(&steady, &jumped)
        .filter(|(heading, _)| heading.t_s > 240.0)
        .filter_map(|(steady, jumped)| Some(turns(jumped)? - turns(steady)?))
        .collect();
    let off_deg_s = rms(&off);
    assert!(off.len() > 1000 && off_deg_s < 0.3, "{off_deg_s}");
}

/// It never learns the vertical field, and its headings need it only as far as the board tilts.
#[test]
fn a_level_board_without_an_accelerometer_gets_headings() {
    for (horizontal_mgauss, vertical_mgauss) in [(310.0, 90.0), (250.0, 430.0)] {
        let settings = Settings {
            with_accel: false,
            horizontal_mgauss,
            vertical_mgauss,
            turns: 12.0,
            gyro_bias_deg_s: [0.0; 3],
            ..Settings::default()
        };
        let played = play(&readings(&settings), None, 0);
        let published = played.headings.iter().filter(|heading| steers(heading));
        let share = published.count() as f64 / played.headings.len() as f64;
        assert!(share > 0.8, "{share} at {horizontal_mgauss} mG");
        assert!(played.when("field_unit").is_empty());
    }
}

#[test]
fn sensors_that_are_read_after_the_magnetometer_are_not_missing() {
    let mut readings = readings(&Settings::default());
    let first = readings
        .iter()
        .position(|reading| reading.rate_rad_s.is_none());
    readings.drain(..first.unwrap());
    let played = play(&readings, None, 0);
    assert_eq!(played.reasons[0].1, "no_calibration");
    assert!(played.when("no_gyro").is_empty());

    // Those that never come are.
    for reading in &mut readings {
        reading.rate_rad_s = None;
    }
    let missing = play(&readings, None, 0).when("no_gyro")[0] - readings[0].t_s;
    assert!((0.5..0.6).contains(&missing), "{missing}");
}

/// How many headings after this time are off by more than so many degrees, and by more than so many of their own deviations.
fn sure(
    headings: &[Heading],
    truth: &[Heading],
    after_s: f64,
    degrees: f64,
    deviations: f64,
) -> usize {
    let both = headings.iter().zip(truth).filter(|(h, _)| h.t_s > after_s);
    let sure = both.filter(|(heading, truth)| {
        let (Some(fused_deg), Some(true_deg)) = (heading.fused_deg, truth.fused_deg) else {
            return false;
        };
        let error = apart_deg(fused_deg, true_deg).abs();
        error > degrees && error > deviations * heading.sd_deg.unwrap_or_default()
    });
    sure.count()
}

/// The heading goes wrong with the gyro, and its deviation says so before the gyro's fault has a name.
#[test]
fn a_heading_is_not_sure_while_the_gyro_contradicts_the_field_or_stops() {
    let settings = Settings::default();
    let sound = readings(&settings);
    let calibration = shifted(&settings, 0.0);
    let truth = play(&sound, Some(calibration), 0).headings;
    for factor in [-1.0, 0.0] {
        let mut faulty = sound.clone();
        for reading in faulty.iter_mut().filter(|reading| reading.t_s > 8.0) {
            reading.rate_rad_s = reading.rate_rad_s.map(|rate| rate.map(|w| w * factor));
        }
        let headings = play(&faulty, Some(calibration), 0).headings;
        // A level board has to turn for a second until its field has changed beyond noise.
        let sure = sure(&headings, &truth, 9.0, 10.0, 4.0);
        assert_eq!(sure, 0, "with rates times {factor}");
    }
}

#[test]
fn a_heading_is_not_sure_from_the_moment_at_which_the_gyro_repeats_itself() {
    // Rows may repeat a slow gyro's reading until there is a new one.
    for (with_accel, rows) in [(true, 1), (true, 5), (false, 1), (false, 5)] {
        let settings = Settings {
            with_accel,
            ..Settings::default()
        };
        let sound = readings(&settings);
        let calibration = shifted(&settings, 0.0);
        let truth = play(&sound, Some(calibration), 0).headings;
        let mut stopped = sound.clone();
        let mut held = None;
        let rates = stopped.iter_mut().filter(|r| r.rate_rad_s.is_some());
        for (count, reading) in rates.enumerate() {
            if count % rows == 0 {
                held = reading.rate_rad_s;
            }
            reading.rate_rad_s = held.map(|rate| if reading.t_s > 8.0 { rate * 0.0 } else { rate });
        }
        let headings = play(&stopped, Some(calibration), 0).headings;
        let before = headings.iter().zip(&truth).filter(|(h, _)| h.t_s < 8.0);
        for (held, sound) in before {
            let doubt_deg = held.sd_deg.unwrap_or(180.0) - sound.sd_deg.unwrap_or(180.0);
            assert!(doubt_deg < 1.0, "{rows} rows: {held:?}");
        }
        let sure = sure(&headings, &truth, 8.0, 2.0, 2.0);
        assert_eq!(sure, 0, "{rows} rows");
    }
}

#[test]
fn a_turn_has_the_sample_at_its_beginning_and_that_at_its_end_live_as_of_a_log() {
    // A sample at each tick of the even clock: one is taken just as the turn is complete.
    let reading = |index: u32| {
        let rate_rad_s = if (200..1000).contains(&index) {
            1.0
        } else {
            0.0
        };
        let turned = 0.01 * f64::from(index.clamp(200, 1000) - 200);
        Reading {
            t_s: 0.01 * f64::from(index),
            field_mgauss: Some([
                Some(180.0 * turned.cos()),
                Some(-180.0 * turned.sin()),
                // No measurement is the same as the one before.
                Some(424.0 + f64::from(index % 2)),
            ]),
            rate_rad_s: Some(Vector3::z() * rate_rad_s),
            specific_force_m_s2: Some(Vector3::z() * -9.81),
        }
    };
    let (mut pipeline, mut survey) = (
        Pipeline::new(Setup::default(), None),
        Survey::new(Setup::default(), None),
    );
    let (mut turn, mut live, mut actions) = (None, None, Vec::new());
    for reading in (0..1200).map(reading) {
        survey.take(&reading, false);
        pipeline.handle(Event::Reading(reading), &mut actions);
        for action in actions.drain(..) {
            match action {
                Action::Turned(found) => turn = Some(found),
                Action::Calibrate(request) => live = Some(request),
                _ => {}
            }
        }
    }
    let (turn, live) = (turn.unwrap(), live.unwrap());
    let mut offline = None;
    survey.conclude(|request| {
        offline = Some(request.clone());
        calibrate(request)
    });
    let offline = offline.expect("the turn was found");
    let rotation = &offline.samples[offline.moving.clone()];
    assert_eq!(rotation.last().unwrap().t_s, 10.0);
    for request in [*live, offline] {
        let samples = &request.samples[request.turns[0].samples.clone()];
        let ends = [samples[0].t_s, samples.last().unwrap().t_s];
        assert_eq!(ends, [turn.start_s, turn.end_s]);
    }
}

/// So slow that what the motion has taught is more certain than the turn.
#[test]
fn a_first_turn_that_knows_less_keeps_what_is_known() {
    let slow = Settings {
        turns: 1.05,
        turn_deg_s: 4.0,
        ..Settings::default()
    };
    let played = play(&readings(&slow), None, 0);
    let [(_, outcome)] = &played.outcomes[..] else {
        panic!("{:?}", played.outcomes);
    };
    assert_eq!(outcome.verdict, Verdict::Accepted, "{outcome:?}");
    assert!(outcome.calibration.is_some() && outcome.method == "motion");
}

/// Gives the pipeline an event, calibrates as it asks, and shows all other actions.
fn step(pipeline: &mut Pipeline, event: Event, mut show: impl FnMut(Action)) {
    let played = pipeline.play(event, |action| {
        Ok::<_, ()>(match action {
            Action::Calibrate(request) => Some(Event::Calibrated(Box::new(calibrate(&request)))),
            other => {
                show(other);
                None
            }
        })
    });
    played.unwrap();
}

/// What is learnt is kept once a minute at most, and at the end.
#[test]
fn the_end_keeps_what_has_been_learnt_since_the_turn() {
    let demo = Settings {
        scenario: Scenario::Demo,
        ..Settings::default()
    };
    let mut pipeline = Pipeline::new(Setup::default(), None);
    let mut methods = Vec::new();
    for event in (readings(&demo).into_iter().map(Event::Reading)).chain([Event::End]) {
        step(&mut pipeline, event, |action| {
            if let Action::Conclude(outcome, _) = action {
                methods.extend(outcome.calibration.map(|_| outcome.method));
            }
        });
    }
    assert_eq!(methods, ["turn", "motion"]);
}

#[test]
fn what_would_help_follows_the_mode_though_the_condition_stays() {
    let mut pipeline = Pipeline::new(Setup::default(), None);
    let mut message = String::new();
    let mut told = |event| {
        step(&mut pipeline, event, |action| {
            if let Action::Report(report) = action {
                message = report.message.into_owned();
            }
        });
        message.clone()
    };
    let readings = readings(&Settings::default()).into_iter();
    let before = readings.map(|reading| told(Event::Reading(reading))).last();
    assert!(before.is_some_and(|message| message.starts_with("the heading is still uncertain")));
    for (mode, unlock) in [(Policy::Locked, true), (Policy::On, false)] {
        let message = told(Event::Policy(mode));
        assert_eq!(message.contains("unlock"), unlock, "{message}");
    }
}
