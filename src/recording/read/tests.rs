use std::io::{self, BufReader, Read};

use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::reading::Reading;

const HEAD: &str = "# headingd-log 1\nt_s,mx,my,mz,gx,gy,gz,ax,ay,az,heading_deg\n";

fn read(text: &[u8]) -> (Vec<Entry>, Skips) {
    let mut reader = Reader::new("a.csv", text).unwrap();
    let rows = reader.by_ref().map(Result::unwrap).collect();
    (rows, reader.skips)
}

fn first(skips: &Skips) -> String {
    skips.first().unwrap().to_owned()
}

#[test]
fn units_become_ours() {
    let text = "# headingd-log 1\n# mag_unit = uT\n# gyro_unit = deg/s\n# accel_unit = g\n\
                heading_deg,az,ay,ax,gz,gy,gx,mz,my,mx,note,t_s\n\
                -90,-1,0,2,180,0,0,3,2,1,hello,0.5\r\n";
    let entry = read(text.as_bytes()).0[0];
    let reading = entry.reading;
    assert_eq!(reading.t_s, 0.5);
    assert_eq!(
        reading.field_mgauss,
        Some([Some(10.0), Some(20.0), Some(30.0)])
    );
    assert_eq!(
        reading.rate_rad_s,
        Some(Vector3::new(0.0, 0.0, std::f64::consts::PI))
    );
    assert_eq!(
        reading.specific_force_m_s2,
        Some(Vector3::new(19.6133, 0.0, -9.80665))
    );
    assert_eq!(entry.heading_truth_deg, Some(270.0));

    for (unit, first) in [
        ("mgauss", 2.6),
        ("gauss", 2600.0),
        ("nT", 0.026),
        ("counts\n# counts_per_gauss = 1300", 2.0),
    ] {
        let text = format!("# headingd-log 1\n# mag_unit = {unit}\nt_s,mx,my,mz\n0,2.6,0,0\n");
        let field = read(text.as_bytes()).0[0].reading;
        let x = field.whole_field_mgauss().unwrap().x;
        assert!((x - first).abs() < 1e-12, "{unit}: {x}");
    }
}

#[test]
fn an_empty_cell_is_silence_or_an_overflow_but_never_0() {
    let text =
        format!("{HEAD}0,1,,3,,,,,,,\n0,,,,1,2,3,,,,\n\n0,,,,,,,,,,\n0,1,NaN,3,nan,-nan,NAN,,,,\n");
    let (rows, skips) = read(text.as_bytes());
    let reading = |i: usize| rows[i].reading;
    assert_eq!(reading(0).field_mgauss, Some([Some(1.0), None, Some(3.0)]));
    assert_eq!(reading(0).rate_rad_s, None);
    assert_eq!(reading(1).field_mgauss, None);
    assert_eq!(reading(1).rate_rad_s, Some(Vector3::new(1.0, 2.0, 3.0)));
    assert_eq!(reading(2), Reading::default());
    assert_eq!(reading(3), reading(0));
    assert_eq!((rows.len(), skips.count), (4, 0));
}

#[test]
fn a_bad_row_is_named_and_the_next_one_read() {
    let long = "1".repeat(5000);
    let good = "7,,,,,,,,,,";
    for (row, column, why) in [
        ("8,1,inf,3,,,,,,,", "column 3 (my): ", "1000000 mgauss"),
        ("8,1,2,0x3,,,,,,,", "column 4 (mz): ", "found \"0x3\""),
        ("8,1,2,NA,,,,,,,", "column 4 (mz): ", "leave the cell empty"),
        ("8,1,2,1e7,,,,,,,", "column 4 (mz): ", "found \"1e7\""),
        ("2e12,,,,,,,,,,", "column 1 (t_s): ", "1000000000000 s"),
        (",1,2,3,,,,,,,", "column 1 (t_s): ", "empty cell"),
        ("6.9,1,2,3,,,,,,,", "column 1 (t_s): ", "at least 7"),
        ("8,,,,1,,3,,,,", "column 6 (gy): ", "gx, gy, gz must be"),
        ("8,,,,,,,1,2,,", "column 10 (az): ", "ax, ay, az must be"),
        ("8,1,2,3", "", "found 4 cells"),
        (&long, "", "longer than 4 KiB"),
    ] {
        let text = format!("{HEAD}{good}\n{row}\n{good}\n");
        let (rows, skips) = read(text.as_bytes());
        let message = first(&skips);
        assert!(
            message.starts_with(&format!("log a.csv, line 4: {column}")),
            "{message}"
        );
        assert!(message.contains(why), "{message}");
        assert_eq!((rows.len(), skips.count), (2, 1), "{row}");
    }
}

#[test]
fn a_bad_true_value_costs_only_itself() {
    let text = format!("{HEAD}7,1,2,3,,,,,,,90\n8,1,2,3,,,,,,,999\n9,1,2,3,,,,,,,null\n");
    let (kept, skips) = read(text.as_bytes());
    let truths = kept.iter().map(|entry| entry.heading_truth_deg.is_some());
    assert!(truths.eq([true, false, false]) && skips.count == 0);
}

#[test]
fn the_summary_names_the_first_row_that_was_skipped() {
    let (_, skips) = read(format!("{HEAD}7,,,,,,,,,,\n9.1,1,x,3,,,,,,,\n").as_bytes());
    assert_eq!(
        skips.summary().unwrap(),
        "1 row skipped; the first: log a.csv, line 4: column 3 (my): found \"x\", but must be a number from -1000000 to 1000000 \
         mgauss; leave the cell empty if the value is unknown"
    );
}

/// The times that are used, with `|` where a stretch begins; how many are dropped, and which was dropped first.
fn used(times: &str) -> (String, u64, Option<u64>) {
    let text = format!("# headingd-log 1\nt_s\n{}\n", times.replace(' ', "\n"));
    let mut reader = Reader::new("a.csv", text.as_bytes()).unwrap();
    let mut kept = Vec::new();
    while let Some(entry) = reader.next() {
        kept.extend(reader.begins_stretch().then(|| "|".to_owned()));
        kept.push(entry.unwrap().reading.t_s.to_string());
    }
    let line = |why: &str| why.split(&[' ', ':']).nth(3).unwrap().parse::<u64>();
    let first = reader.skips.first().map(|why| line(why).unwrap() - 2);
    (kept.join(" "), reader.skips.count, first)
}

#[test]
fn an_odd_time_is_dropped_and_a_jump_begins_a_stretch() {
    for (times, right, dropped, first) in [
        ("0 1 999999999 2 3", "0 1 2 3", 1, Some(3)),
        ("0 1 999999999 888888888 2 3", "0 1 2 3", 2, Some(3)),
        ("0 1 -500 2 3", "0 1 2 3", 1, Some(3)),
        ("999999999 0 1", "999999999 | 0 1", 0, None),
        ("0 1 5000 5001 5002", "0 1 | 5000 5001 5002", 0, None),
        ("50 51 0 1 2", "50 51 | 0 1 2", 0, None),
        ("50 51 0 nonsense 1 2", "50 51 | 0 1 2", 1, Some(4)),
        ("50 51 0 nonsense 52", "50 51 52", 2, Some(4)),
        ("0 30 90 91", "0 30 90 91", 0, None),
        ("0 1 999999999", "0 1", 1, Some(3)),
        ("0 30", "0 30", 0, None),
        ("0 1 0.98 0.99 1.01", "0 1 1.01", 2, Some(3)),
        ("50 51 0 0 0 52", "50 51 52", 3, Some(3)),
        // The ends of a second, either way, …
        ("7 8 7.5", "7 8", 1, Some(3)),
        ("7 8.1 7.5", "7 7.5", 1, Some(2)),
        ("7 6 6.02", "7", 2, Some(2)),
        ("7 5.9 5.92", "7 | 5.9 5.92", 0, None),
        // … and of a minute.
        ("7 67 500", "7 67", 1, Some(3)),
        ("7 67.1 67.12", "7 | 67.1 67.12", 0, None),
        ("7 67.1 67.1", "7", 2, Some(2)),
    ] {
        let (kept, count, line) = used(times);
        assert_eq!(
            (kept.as_str(), count, line),
            (right, dropped, first),
            "{times}"
        );
    }
}

#[test]
fn a_clock_that_is_set_back_loses_motion_and_a_late_row_does_not() {
    let stretches = |hundredths: &[i32], cells: &str| {
        let row = |t: &i32| format!("{},{cells}\n", f64::from(*t) / 100.0);
        let rows: String = hundredths.iter().map(row).collect();
        let units = "# gyro_unit = rad/s\n# mag_unit = mgauss\n";
        let text = format!("# headingd-log 1\n{units}t_s,gx,gy,gz,mx,my,mz\n{rows}");
        let mut reader = Reader::new("a.csv", text.as_bytes()).unwrap();
        let mut begun = Vec::new();
        while let Some(entry) = reader.next() {
            let t_s = entry.unwrap().reading.t_s;
            begun.extend(reader.begins_stretch().then_some(t_s));
        }
        begun
    };
    let both = "0,0,0.1,200,0,400";
    let set_back: Vec<i32> = (0..50).chain(40..60).collect();
    assert_eq!(stretches(&set_back, both), [0.49]);
    // Rows of one chip alone may be late.
    assert!(stretches(&set_back, ",,,200,0,400").is_empty());
    assert!(stretches(&set_back, "0,0,0.1,,,").is_empty());
    for (late, begun) in [
        (&[0, 30, 10, 11, 12, 13, 14, 15, 31][..], 0),
        (&[0, 30, 10, 11, 12, 13, 14, 15, 16, 31], 1),
        // Not one after the other, …
        (&[0, 30, 10, 31, 18, 32], 0),
        // … in no order, …
        (&[0, 60, 10, 55, 50, 54, 61], 0),
        // … and far off.
        (&[100, 101, 500_000, 900_000, 102], 0),
        (&[102, 90, 500_000, 103], 0),
    ] {
        assert_eq!(stretches(late, both).len(), begun, "{late:?}");
    }
}

#[test]
fn a_header_that_is_repeated_is_no_row_and_rows_after_another_are_refused() {
    let head = "# headingd-log 1\n# mag_unit = uT\n# a remark on headingd-log, mx, my, mz, t_s\nt_s,mx,my,mz\n";
    // A repetition whose first line is damaged has only lines that are known.
    let damaged = head.replace("-log", "-lo");
    let text = format!("{head}0,1,2,3\n{head}0.1,1,2,3\n{damaged}# a remark\n0.2,1,2,3\n");
    let (rows, skips) = read(text.as_bytes());
    assert_eq!((rows.len(), skips.count), (3, 0), "{skips:?}");
    // A header without the unit has the default's.
    let shorter = head.replace("# mag_unit = uT\n", "");
    for other in ["# mag_unit = gauss", "t_s,my,mx,mz", shorter.trim_end()] {
        let (rows, skips) = read(format!("{text}{other}\n0.3,1,2,3\n").as_bytes());
        assert_eq!((rows.len(), skips.count), (3, 2));
        let line = first(&skips);
        assert!(
            line.contains(other.lines().last().unwrap()) && line.contains("split the log"),
            "{line}"
        );
    }
}

#[test]
fn times_that_are_no_seconds_are_refused() {
    let checked = |step: f64, count: usize| {
        // The magnetometer's rows repeat the times: the steps of all rows have the median 0.
        let row = |i: usize| {
            let t = i as f64 * step;
            format!("{t},,,,0,0,{i},,,,\n{t},1,2,3,,,,,,,\n")
        };
        let text = HEAD.to_owned() + &(0..count).map(row).collect::<String>();
        Reader::new("a.csv", text.as_bytes()).unwrap().check_times()
    };
    for (step, apart, unit, divisor) in [
        (5.0, "5", "milliseconds", "1000"),
        (10_000.0, "10000", "microseconds", "1000000"),
        (1e7, "10000000", "nanoseconds", "1000000000"),
    ] {
        assert_eq!(
            checked(step, 60).unwrap_err().to_string(),
            format!(
                "cannot use log a.csv: the gyro's readings are {apart} apart in column 1 (t_s), as in {unit}, but \
                 times must be in seconds: divide them by {divisor}"
            )
        );
    }
    let same = checked(0.0, 60).unwrap_err().to_string();
    assert!(
        same.contains("same time as the one before in column 1 (t_s)"),
        "{same}"
    );
    // A gyro of 1 kHz in milliseconds could be one of 1 Hz; the magnetometer tells.
    let row = |i: usize| {
        let field = if i.is_multiple_of(10) { "1,2,3" } else { ",," };
        format!("{i},{field},0,0,{i},,,,\n")
    };
    let fast = HEAD.to_owned() + &(0..600).map(row).collect::<String>();
    let fast = Reader::new("a.csv", fast.as_bytes()).unwrap().check_times();
    let told = fast.unwrap_err().to_string();
    assert!(
        told.contains(
            "the magnetometer's readings are 10 apart in column 1 (t_s), as in milliseconds"
        ),
        "{told}"
    );
    // A logger of 1 Hz, and a log too short to tell.
    assert!(checked(1.0, 60).is_ok() && checked(10.0, 20).is_ok());
}

#[test]
fn milliseconds_are_suspected_in_a_number_that_is_too_large() {
    for (row, suspected) in [
        ("1764000000000,,,,,,,,,,", true),
        ("x,,,,,,,,,,", false),
        ("nan,,,,,,,,,,", false),
        ("inf,,,,,,,,,,", false),
        ("0,1e13,2,3,,,,,,,", false),
    ] {
        let message = first(&read(format!("{HEAD}{row}\n").as_bytes()).1);
        let advice = "1000000000000 s; if these are milliseconds, divide by 1000";
        assert_eq!(message.ends_with(advice), suspected, "{message}");
        assert_eq!(message.contains("milliseconds"), suspected, "{message}");
    }
}

#[test]
fn bytes_that_are_no_text_spoil_their_line_only() {
    let text = [HEAD.as_bytes(), b"0,\xff\xfe\0,,,,,,,,,\n1,,,,,,,,,,\n"].concat();
    let (rows, skips) = read(&text);
    let message = first(&skips);
    assert!(
        message.contains("line 3: found bytes that are no text"),
        "{message}"
    );
    assert_eq!((rows.len(), skips.count), (1, 1));
}

#[test]
fn a_failing_input_ends_the_rows() {
    struct Broken;
    impl Read for Broken {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(io::Error::other("unplugged"))
        }
    }
    let text = format!("{HEAD}0,,,,,,,,,,\n");
    let mut reader = Reader::new("a.csv", BufReader::new(text.as_bytes().chain(Broken))).unwrap();
    assert!(reader.next().unwrap().is_ok());
    let error = reader.next().unwrap().unwrap_err();
    assert_eq!(
        error.to_string(),
        "cannot read log a.csv after line 3: unplugged"
    );
    assert!(reader.next().is_none());
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        for head in ["", "# headingd-log 1\n", HEAD] {
            if let Ok(reader) = Reader::new("a", &[head.as_bytes(), &bytes].concat()[..]) {
                reader.for_each(drop);
            }
        }
    }

    #[test]
    fn no_near_row_makes_it_panic(text in "[0-9eE+.,\r\nNnaif-]{0,300}") {
        Reader::new("a", format!("{HEAD}{text}").as_bytes()).unwrap().for_each(drop);
    }
}
