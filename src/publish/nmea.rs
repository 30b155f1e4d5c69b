//! Headings as NMEA 0183. Pure: no I/O and no clock.
//!
//! What is not known is an empty field, or a sentence less. A heading that nobody may steer by is no sentence at all.

use std::fmt::{Arguments, Write};

use crate::check::{Fault, settings};
use crate::frame::{rounded, to_tenths};
use crate::heading::Heading;

/// No sensor gives a larger number.
const LARGEST: f64 = 1e6;

settings! {
    /// Settings of the sentences.
    pub struct Settings {
        /// The talker, two capital letters: `"HC"` is a magnetic compass.
        talker: String = "HC".into() => |key, talker| check_talker(key, talker);
        /// How many headings a second go out as sentences, to clients that do not ask for another rate. There are never
        /// more than readings.
        rate_hz: f64 = 10.0, 0.1..=1000.0, "a second";
    }
}

fn check_talker(key: &str, talker: &str) -> Option<Fault> {
    let right = matches!(talker.as_bytes(), [b'A'..=b'Z', b'A'..=b'Z']);
    (!right).then(|| Fault::new(key, format!("{talker:?}"), "two capital letters, as \"HC\""))
}

/// The sentences of a heading, each with its CR LF; none where there is no heading to steer by.
///
/// `HDM` is the magnetic heading; `HDG` the same with the variation, where that is known, and without a deviation: it has
/// been taken out. `HDT` is the true heading, `ROT` the rate of turn in degrees a minute. `XDR` has the names that
/// OpenCPN, gpsd and Signal K's plugins know pitch and roll by.
pub fn sentences(talker: &str, heading: &Heading) -> String {
    let mut out = String::new();
    let angle = |degrees: Option<f64>| known(degrees).map(to_tenths);
    let Some(magnetic) = angle(heading.magnetic_deg()) else {
        return out;
    };
    let mut put = |body: Arguments<'_>| put(&mut out, talker, body);
    put(format_args!("HDM,{magnetic:.1},M"));
    match known(heading.declination_deg) {
        Some(east) if east < 0.0 => put(format_args!("HDG,{magnetic:.1},,,{:.1},W", -east)),
        Some(east) => put(format_args!("HDG,{magnetic:.1},,,{east:.1},E")),
        None => put(format_args!("HDG,{magnetic:.1},,,,")),
    }
    if let Some(heading) = angle(heading.true_deg()) {
        put(format_args!("HDT,{heading:.1},T"));
    }
    if let Some(turn) = known(heading.turn_deg_min) {
        put(format_args!("ROT,{turn:.1},A"));
    }
    if let (Some(pitch), Some(roll)) = (known(heading.pitch_deg), known(heading.roll_deg)) {
        put(format_args!("XDR,A,{pitch:.1},D,PTCH,A,{roll:.1},D,ROLL"));
    }
    out
}

/// Rounded to tenths; `None` if unknown, not finite or absurdly large.
fn known(number: Option<f64>) -> Option<f64> {
    let tenths = rounded(number?, 1);
    (tenths.abs() < LARGEST).then_some(tenths)
}

/// Appends a sentence with its checksum, the XOR of all that lies between `$` and `*`.
fn put(out: &mut String, talker: &str, body: Arguments<'_>) {
    let start = out.len() + 1;
    // Writing into a String cannot fail.
    let _ = write!(out, "${talker}{body}");
    let sum = out.as_bytes()[start..]
        .iter()
        .fold(0, |sum, byte| sum ^ byte);
    let _ = write!(out, "*{sum:02X}\r\n");
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::check::Check;
    use crate::condition::Condition;

    fn heading() -> Heading {
        Heading {
            condition: Condition::Good,
            fused_deg: Some(98.3),
            instantaneous_deg: Some(99.0),
            raw_deg: Some(12.0),
            sd_deg: Some(1.0),
            ..Heading::default()
        }
    }

    /// Checksums by other programs: `HDM`'s and `HDT`'s are from gpsd's documentation of NMEA, the rest was computed with
    /// Python.
    #[test]
    fn sentences_have_their_fields_and_checksums() {
        let mut one = heading();
        one.fused_deg = Some(238.0);
        assert_eq!(
            sentences("HC", &one),
            "$HCHDM,238.0,M*20\r\n$HCHDG,238.0,,,,*4B\r\n"
        );
        one.declination_deg = Some(-12.6);
        one.turn_deg_min = Some(-0.04);
        one.pitch_deg = Some(0.135);
        one.roll_deg = Some(-12.25);
        assert_eq!(
            sentences("HC", &one),
            "$HCHDM,238.0,M*20\r\n$HCHDG,238.0,,,12.6,W*07\r\n$HCHDT,225.4,T*28\r\n$HCROT,0.0,A*2D\r\n\
             $HCXDR,A,0.1,D,PTCH,A,-12.3,D,ROLL*4B\r\n"
        );
        one.fused_deg = Some(359.97);
        one.declination_deg = Some(13.304);
        let found = sentences("II", &one);
        assert!(found.starts_with("$IIHDM,0.0,M*"), "{found}");
        assert!(found.contains("HDG,0.0,,,13.3,E*"), "{found}");
        assert!(found.contains("HDT,13.3,T*"), "{found}");
    }

    #[test]
    fn there_is_no_sentence_without_a_heading_to_steer_by() {
        let stale = Heading {
            condition: Condition::Stale,
            turn_deg_min: Some(1.0),
            pitch_deg: Some(1.0),
            roll_deg: Some(1.0),
            ..heading()
        };
        assert_eq!(sentences("HC", &stale), "");
        let none = Heading {
            fused_deg: None,
            instantaneous_deg: Some(f64::NAN),
            ..heading()
        };
        assert_eq!(sentences("HC", &none), "");
    }

    #[test]
    fn a_talker_is_two_capital_letters() {
        assert_eq!(Settings::default().check(), []);
        for talker in ["", "H", "HCX", "hc", "H1", "H,", "É"] {
            let settings = Settings {
                talker: talker.into(),
                rate_hz: 0.0,
            };
            let keys: Vec<_> = settings
                .check()
                .into_iter()
                .map(|fault| fault.key)
                .collect();
            assert_eq!(keys, ["talker", "rate_hz"], "{talker:?}");
        }
    }

    proptest! {
        #[test]
        fn whatever_the_numbers_sentences_are_short_and_sound(
            numbers in prop::array::uniform5(prop_oneof![prop::num::f64::ANY, -400.0..400.0]),
            known in prop::array::uniform5(any::<bool>()),
        ) {
            let number = |at: usize| known[at].then_some(numbers[at]);
            let one = Heading {
                fused_deg: number(0),
                declination_deg: number(1),
                pitch_deg: number(2),
                roll_deg: number(3),
                turn_deg_min: number(4),
                ..heading()
            };
            let text = sentences("HC", &one);
            for line in text.split_inclusive('\n') {
                prop_assert!(line.len() <= 82, "{}", line);
                let inside = line.strip_prefix('$').and_then(|line| line.strip_suffix("\r\n"));
                let (body, sum) = inside.unwrap().split_once('*').unwrap();
                let right = body.bytes().fold(0, |sum, byte| sum ^ byte);
                prop_assert_eq!(sum, format!("{right:02X}"));
                prop_assert!(!body.contains("-0.0,"), "{}", body);
                // A board may turn by 360° a minute, but no heading is 360.
                prop_assert!(body.starts_with("HCROT") || !body.contains("360.0"), "{}", body);
            }
        }
    }
}
