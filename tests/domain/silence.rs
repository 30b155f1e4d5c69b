//! Readings that come late, after the pipeline has been told of silence.

use headingd::condition::Condition;
use headingd::pipeline::{Action, Event, Pipeline, Setup};
use headingd::reading::Reading;

fn field(t_s: f64) -> Event {
    Event::Reading(Reading {
        t_s,
        field_mgauss: Some([Some(160.0), Some(0.0), Some(500.0)]),
        ..Reading::default()
    })
}

fn rate(t_s: f64) -> Event {
    Event::Reading(Reading {
        t_s,
        rate_rad_s: Some(Default::default()),
        ..Reading::default()
    })
}

/// The conditions reported, and how many headings came with them.
fn handled(events: impl IntoIterator<Item = Event>) -> (Vec<Condition>, usize) {
    let mut pipeline = Pipeline::new(Setup::default(), None);
    let mut actions = Vec::new();
    for event in events {
        pipeline.handle(event, &mut actions);
    }
    let headings = actions.iter().filter(|a| matches!(a, Action::Publish(_)));
    let reported = actions.iter().filter_map(|action| match action {
        Action::Report(report) => Some(report.condition),
        _ => None,
    });
    (reported.collect(), headings.count())
}

#[test]
fn a_reading_that_is_late_still_counts() {
    let (reported, headings) =
        handled([field(0.0), Event::Silence(5.0), field(0.025), field(0.05)]);
    assert_eq!(headings, 3);
    assert_eq!(
        reported,
        [
            Condition::Uncalibrated,
            Condition::Stale,
            Condition::Uncalibrated
        ]
    );
    // Time that goes back is another thing.
    assert_eq!(handled([field(1.0), field(0.5)]).1, 1);
}

#[test]
fn a_magnetometer_is_given_time_to_speak_first() {
    let (reported, _) = handled([rate(7.0), rate(7.1), field(7.2)]);
    assert_eq!(reported, [Condition::Uncalibrated]);
    let (reported, _) = handled([rate(7.0), rate(7.4), rate(7.6)]);
    assert_eq!(reported, [Condition::Stale]);
    // Before the first reading of all, too.
    let (reported, _) = handled([Event::Silence(0.2), rate(0.3), field(0.4)]);
    assert_eq!(reported, [Condition::Uncalibrated]);
    assert_eq!(handled([Event::Silence(0.6)]).0, [Condition::Stale]);
}

#[test]
fn a_magnetometer_is_given_as_much_time_after_the_board_is_mounted_otherwise() {
    let mounted = || Event::Mounted(Box::default());
    let waits = [field(100.0), mounted(), Event::Silence(100.2)];
    let (reported, _) = handled(waits.into_iter().chain([field(100.3)]));
    assert_eq!(reported, [Condition::Uncalibrated; 2]);
    let waits = [field(100.0), mounted(), Event::Silence(100.2)];
    let (reported, _) = handled(waits.into_iter().chain([Event::Silence(100.8)]));
    assert_eq!(reported, [Condition::Uncalibrated, Condition::Stale]);
}

#[test]
fn an_absurd_field_is_forgotten_where_the_clock_was_set_back() {
    let absurd = Event::Reading(Reading {
        t_s: 500.0,
        field_mgauss: Some([Some(1e6), Some(0.0), Some(0.0)]),
        ..Reading::default()
    });
    let mut pipeline = Pipeline::new(Setup::default(), None);
    let mut actions = Vec::new();
    for event in [absurd, Event::NewStretch, rate(0.0), rate(0.3), rate(0.6)] {
        pipeline.handle(event, &mut actions);
    }
    let reason = actions.iter().rev().find_map(|action| match action {
        Action::Report(report) => Some(report.reason),
        _ => None,
    });
    assert_eq!(reason, Some("no_samples"));
}
