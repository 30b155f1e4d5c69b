//! The codecs: exact bytes, any cut of them, and any bytes at all.

use headingd::frame::Mountings;
use headingd::reading::Reading;
use headingd::sensor::serial::{Item, LogRows, RazorBinary, RazorText};
use nalgebra::Vector3;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

use super::device::{binary, text};

const GAIN: f64 = 1300.0;

fn of_text(pieces: &[&[u8]]) -> Vec<Item> {
    let mut codec = RazorText::new(GAIN);
    items(pieces, |piece, found| codec.feed(piece, found))
}

fn of_binary(pieces: &[&[u8]]) -> Vec<Item> {
    let mut codec = RazorBinary::new(GAIN);
    items(pieces, |piece, found| codec.feed(piece, found))
}

fn of_rows(pieces: &[&[u8]]) -> Vec<Item> {
    of_rows_on(Mountings::default(), pieces)
}

fn of_rows_on(board: Mountings, pieces: &[&[u8]]) -> Vec<Item> {
    let mut codec = LogRows::new(board);
    items(pieces, |piece, found| codec.feed(piece, found))
}

/// What a codec hands over when it is fed with these pieces.
fn items(pieces: &[&[u8]], mut feed: impl FnMut(&[u8], &mut dyn FnMut(Item))) -> Vec<Item> {
    let mut items = Vec::new();
    for piece in pieces {
        feed(piece, &mut |item| items.push(item));
    }
    items
}

fn readings(items: &[Item]) -> Vec<Reading> {
    let reading = |item: &Item| match item {
        Item::Frame(reading) | Item::Timed(reading) => Some(*reading),
        _ => None,
    };
    items.iter().filter_map(reading).collect()
}

fn bad(items: &[Item]) -> Vec<&str> {
    let bad = items.iter().filter_map(|item| match item {
        Item::Bad(why) | Item::BadHeader(why) => Some(why.as_str()),
        _ => None,
    });
    bad.collect()
}

/// The field's X, which tells frames apart.
fn first_mgauss(reading: &Reading) -> Option<f64> {
    reading.field_mgauss?[0]
}

#[test]
fn a_frame_of_three_lines_is_one_reading() {
    let items = of_text(&[
        b"#A-R=0.00,-128.00,256.00\r\n#M-R=130.00,-13.00,0.00\r\n#G-R=14.00,0.00,-1.00\r\n",
    ]);
    let [Item::Frame(reading)] = items[..] else {
        panic!("{items:?}");
    };
    assert_eq!(
        reading.field_mgauss,
        Some([Some(100.0), Some(-10.0), Some(0.0)])
    );
    assert_eq!(reading.specific_force_m_s2.unwrap().z, -9.80665);
    let rate_deg_s = reading.rate_rad_s.unwrap().map(f64::to_degrees);
    assert!((rate_deg_s - Vector3::new(14.0 / 14.375, 0.0, -1.0 / 14.375)).norm() < 1e-12);
}

#[test]
fn what_is_no_number_is_unknown_and_never_0() {
    for (numbers, field) in [
        ("nan,2,3", [None, Some(2.0), Some(3.0)]),
        ("1,inf,-inf", [Some(1.0), None, None]),
        ("ovf,-ovf,3.00", [None, None, Some(3.0)]),
        (",2,", [None, Some(2.0), None]),
        (",,", [None; 3]),
        ("65535.00,-1,-4096", [Some(-1.0), Some(-1.0), None]),
    ] {
        let items = of_text(&[format!("#M-R={numbers}\r\n#G-R=0,nan,0\r\n").as_bytes()]);
        let reading = readings(&items)[0];
        let right = field.map(|axis: Option<f64>| axis.map(|count| count * 1000.0 / GAIN));
        assert_eq!(reading.field_mgauss, Some(right), "{numbers}");
        assert_eq!(reading.rate_rad_s, None);
        assert_eq!(reading.specific_force_m_s2, None);
    }
}

#[test]
fn numbers_that_cannot_be_raw_counts_are_refused_with_their_line() {
    for (line, why) in [
        ("#M-R=1,2", "three numbers"),
        ("#M-R=1,2,3,4", "three numbers"),
        ("#M-R=1,2x,3", "garbled"),
        ("#M-R=0.25,1,2", "another firmware"),
        ("hello", "no line of the Razor"),
    ] {
        let items = of_text(&[format!("{line}\r\n#G-R=1,2,3\r\n").as_bytes()]);
        let bad = bad(&items);
        assert!(bad[0].contains(why) && bad[0].contains(line), "{bad:?}");
        // The other sensors of the frame count.
        let reading = readings(&items)[0];
        assert!(reading.field_mgauss.is_none() && reading.rate_rad_s.is_some());
    }
}

#[test]
fn old_values_after_a_failed_read_are_not_fresh() {
    let frame = "#A-R=0,0,256\r\n#M-R=13,0,0\r\n#G-R=0,0,0\r\n";
    let stream = format!(
        "{frame}!ERR: reading magnetometer\r\n{frame}!ERR: reading gyroscope\r\n!ERR: reading accelerometer\r\n\
         {frame}{frame}!ERR: reading gy\r\n{frame}"
    );
    let spoke = |reading: &Reading| {
        (
            reading.specific_force_m_s2.is_some(),
            reading.field_mgauss.is_some(),
            reading.rate_rad_s.is_some(),
        )
    };
    let all: Vec<_> = readings(&of_text(&[stream.as_bytes()]))
        .iter()
        .map(spoke)
        .collect();
    let right = [
        (true, true, true),
        (true, false, true),
        (false, true, false),
        (true, true, true),
        // Which one it was cannot be told.
        (false, false, false),
    ];
    assert_eq!(all, right);
}

#[test]
fn a_lost_line_costs_its_sensor_and_no_frame() {
    let [a, m, g] = ["#A-R=0,0,256\r\n", "#M-R=13,0,0\r\n", "#G-R=0,0,0\r\n"];
    for (stream, count) in [
        (format!("{a}{m}{a}{m}{g}"), 2),
        (format!("{m}{g}{a}{m}{g}"), 2),
        (format!("{a}{g}{a}{m}{g}"), 2),
        (format!("{m}{m}{g}"), 2),
        (format!("{g}{g}"), 2),
        (format!("{a}!ERR: reading magnetometer\r\n{a}{m}{g}"), 2),
    ] {
        assert_eq!(
            readings(&of_text(&[stream.as_bytes()])).len(),
            count,
            "{stream}"
        );
    }
}

#[test]
fn other_modes_are_named() {
    for (line, name) in [
        ("#YPR=1.00,2.00,3.00", "angles"),
        ("#YPRAG=1,2,3,4,5,6,7,8,9", "angles"),
        ("#YPRAMG=1,2,3", "angles"),
        ("#A-C=1,2,3", "calibrated"),
        ("accel x,y,z (min/max) = 1/2  3/4  5/6", "calibration"),
        (
            "gyro x,y,z (current/average) = 1/2  3/4  5/6",
            "calibration",
        ),
        ("$1,2,3,4,5,6,7,8,9#", "stock firmware"),
        ("$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8", "GPS"),
    ] {
        // Some modes end their lines with LF CR.
        let items = of_text(&[line.as_bytes(), b"\n\r", line.as_bytes(), b"\r\n"]);
        assert!(
            matches!(items[..], [Item::OtherMode(a), Item::OtherMode(b)] if a == b && a.contains(name)),
            "{items:?}"
        );
    }
    let garbled = [&b"\x00\xff\x80#SYNCH01\r\n"[..]];
    assert_eq!(of_text(&garbled), [Item::Synch(*b"01")]);
}

#[test]
fn binary_frames_are_counted_from_the_synchronisation() {
    let frame = binary([[0, 0, 256], [13, 0, -26], [0, 0, 0]]);
    let stream = [
        &b"\x12\x34#YPR=1,2"[..],
        b"#SYNCH01\r\n",
        &frame,
        b"#SYNCH01\r\n",
        &frame,
    ]
    .concat();
    let items = of_binary(&[&stream]);
    let all = readings(&items);
    assert_eq!(all.len(), 2, "{items:?}");
    assert_eq!(
        all[1].field_mgauss,
        Some([Some(10.0), Some(0.0), Some(-20.0)])
    );
    assert!(items.contains(&Item::OtherMode("angles (#ot)")));
}

#[test]
fn a_lost_byte_is_noticed_and_waited_out() {
    let frame = |i: i32| binary([[3, -7, 256], [100 + i, -200, 300], [5, -5, i]]);
    let good: Vec<u8> = (0..4).flat_map(frame).collect();
    for lost in 0..36 {
        let mut spoilt = frame(9);
        spoilt.remove(lost);
        let stream = [
            b"#SYNCH01\r\n",
            &good[..],
            &spoilt,
            &good,
            b"#SYNCH01\r\n",
            &good,
        ]
        .concat();
        let items = of_binary(&[&stream]);
        assert!(!bad(&items).is_empty());
        let all = readings(&items);
        assert!(all.len() >= 8, "{lost}: {}", all.len());
        let right = readings(&of_binary(&[b"#SYNCH01\r\n", &good]));
        assert_eq!(all[..4], right);
        assert_eq!(all[all.len() - 4..], right);
    }
}

#[test]
fn binary_numbers_that_stand_still_are_not_fresh() {
    let mut stream = b"#SYNCH01\r\n".to_vec();
    for i in 0..40 {
        stream.extend(binary([[i, 0, 256], [7, 7, 7], [i, 0, 0]]));
    }
    let all = readings(&of_binary(&[&stream]));
    assert_eq!(all.len(), 40);
    assert!(all[18].field_mgauss.is_some());
    assert!(all[19].field_mgauss.is_none() && all[19].rate_rad_s.is_some());
}

const HEADER: &str = "# headingd-log 1\n# sensor = qmc5883l\n# mag_unit = uT\nt_s,mx,my,mz\n";

#[test]
fn rows_with_a_header_are_those_of_a_log() {
    let stream = format!("t,5\n{HEADER}0.5,1,2,3\n0.6,1,,3\n# a remark\n{HEADER}0,4,5,6\n");
    let all = readings(&of_rows(&[stream.as_bytes()]));
    assert_eq!(all.len(), 3);
    assert_eq!(
        all[0].field_mgauss,
        Some([Some(10.0), Some(20.0), Some(30.0)])
    );
    assert_eq!(all[1].field_mgauss.unwrap()[1], None);
    // After a reset its clock begins again.
    assert_eq!((all[2].t_s, first_mgauss(&all[2])), (0.0, Some(40.0)));
}

#[test]
fn the_sketch_of_the_manual_is_understood() {
    let manual = include_str!("../../../docs/serial.md");
    let sketch = manual.split_once("Serial.print(F(\"").unwrap().1;
    let header = sketch.split_once("\"))").unwrap().0.replace("\\n", "\n");
    let stream = format!("{header}0.0200,130.000,,13.000,14.375,0.000,-1.000\n");
    let reading = readings(&of_rows(&[stream.as_bytes()]))[0];
    assert_eq!(reading.field_mgauss, Some([Some(100.0), None, Some(10.0)]));
    assert_eq!(reading.rate_rad_s.unwrap().x, 14.375f64.to_radians());
}

/// Rows of seven cells, 45 a second, from a time on.
fn sketch_rows(from_s: f64, count: u32) -> String {
    let row = |i| format!("{:.4},130,0,13,14.375,0,0\n", from_s + f64::from(i) / 45.0);
    (0..count).map(row).collect()
}

#[test]
fn rows_without_a_header_count_when_two_agree_and_none_has_come_for_15_s() {
    let stream = format!("5,6\n{}3,1,2,3\n", sketch_rows(7.0, 900));
    let all = readings(&of_rows(&[stream.as_bytes()]));
    assert!((22.0..22.1).contains(&all[0].t_s), "{:?}", all[0]);
    assert_eq!(all[0].rate_rad_s, Some(Vector3::new(14.375, 0.0, 0.0)));
    assert_eq!(all.last().unwrap().t_s, 26.9778);
    // A lost point, and a clock that stands still.
    let leap = format!(
        "x\n{}10000.2,1,2,3,4,5,6\n{}",
        sketch_rows(0.0, 9),
        sketch_rows(0.2, 9)
    );
    assert!(readings(&of_rows(&[leap.as_bytes()])).is_empty());
    let still = "x\n".to_owned() + &"0,1,2,3\n0,1,2,4\n".repeat(10_000);
    assert!(!readings(&of_rows(&[still.as_bytes()])).is_empty());
    let items = of_rows(&[b"1\n1,2\n1,2\n"]);
    assert!(bad(&items)[1].contains("4, 7, 10 or 11"), "{items:?}");
}

/// The sketch of the manual, heard from the middle: nothing is taken in the wrong units.
#[test]
fn a_header_that_comes_late_is_waited_for() {
    let header = "# headingd-log 1\n# mag_unit = counts\n# counts_per_gauss = 1300\n# gyro_unit = deg/s\n\
                  t_s,mx,my,mz,gx,gy,gz\n";
    for missed in [0, 250, 499] {
        let stream = sketch_rows(5.0, 500 - missed) + header + &sketch_rows(16.2, 500);
        let items = of_rows(&[stream.as_bytes()]);
        let all = readings(&items);
        assert_eq!(all.len(), 500);
        let right = |reading| first_mgauss(reading) == Some(100.0);
        assert!(all.iter().all(right));
        assert!(!items.contains(&Item::NewUnits));
    }
    // One that comes still later changes what its rows say, and a lost line of it ends the rows in the wrong units.
    let stream = sketch_rows(5.0, 1000) + header + &sketch_rows(28.0, 1);
    let items = of_rows(&[stream.as_bytes()]);
    let [.., Item::Timed(before), Item::NewUnits, Item::Timed(after)] = &items[..] else {
        panic!("{:?}", items.last());
    };
    let said = [before, after].map(first_mgauss);
    assert_eq!(said, [Some(130.0), Some(100.0)]);
    let half = header.replace("t_s", "t_");
    let stream =
        sketch_rows(5.0, 1000) + &half + &sketch_rows(28.0, 500) + header + "40,130,0,0,0,0,0\n";
    let items = of_rows(&[stream.as_bytes()]);
    let mut late = readings(&items);
    late.retain(|reading| reading.t_s > 28.0);
    assert_eq!((late.len(), first_mgauss(&late[0])), (1, Some(100.0)));
    assert!(items.contains(&Item::NewUnits));
}

#[test]
fn a_header_that_says_what_was_assumed_or_known_changes_nothing() {
    let late = |header: &str| {
        let stream = sketch_rows(5.0, 1000) + header + &sketch_rows(28.0, 1);
        of_rows(&[stream.as_bytes()]).contains(&Item::NewUnits)
    };
    assert!(!late("# headingd-log 1\nt_s,mx,my,mz,gx,gy,gz\n"));
    assert!(late(
        "# headingd-log 1\n# gyro_unit = deg/s\nt_s,mx,my,mz,gx,gy,gz\n"
    ));
    let second = |header: &str| {
        let stream = format!("{HEADER}0,1,2,3\n{header}1,1,2,3\n");
        of_rows(&[stream.as_bytes()]).contains(&Item::NewUnits)
    };
    assert!(!second(HEADER));
    let other = HEADER.replace("\nt_s", "\n# mag_axes = +y -x +z\nt_s");
    assert!(second(&other));
    assert!(second(&HEADER.replace("uT", "mgauss")));
}

/// Silence, after which the port is opened anew: the board may not have been reset, or have been changed for another.
#[test]
fn rows_after_a_silence_mean_what_they_did_and_those_of_another_device_need_a_header() {
    let mut codec = LogRows::new(Mountings::default());
    codec.feed(format!("\u{feff}{HEADER}0,1,2,3\n1,2,").as_bytes(), |_| ());
    let mut items = Vec::new();
    codec.reopen(true);
    codec.feed(b"2,3\n20,4,5,6\n", |item| items.push(item));
    let all = readings(&items);
    assert_eq!((all.len(), first_mgauss(&all[0])), (1, Some(40.0)));
    items.clear();
    codec.reopen(false);
    codec.feed((sketch_rows(0.0, 2000)).as_bytes(), |item| items.push(item));
    assert!(readings(&items).is_empty());
    assert!(bad(&items)[0].contains("its header was lost"), "{items:?}");
    items.clear();
    codec.feed(format!("{HEADER}50,1,2,3\n").as_bytes(), |item| {
        items.push(item)
    });
    assert_eq!(readings(&items).len(), 1);
}

#[test]
fn rows_whose_header_was_half_heard_wait_for_the_next_one() {
    let half = "nit = uT\n# gyro_unit = deg/s\nt_s,mx,my,mz\n1,2,3,4\n2,2,3,4\n";
    let items = of_rows(&[half.as_bytes()]);
    assert!(readings(&items).is_empty(), "{items:?}");
    assert!(
        bad(&items)[0].contains("waiting for the next one"),
        "{items:?}"
    );
    let whole = format!("{half}{HEADER}3,2,3,4\n");
    assert_eq!(readings(&of_rows(&[whole.as_bytes()])).len(), 1);
}

#[test]
fn rows_after_a_wrong_header_say_what_is_wrong_with_it_and_remarks_are_no_header() {
    let wrong = "x\n# headingd-log 1\n# mag_uint = gauss\nt_s,mx,my,mz\n1,2,3,4\n2,2,3,4\n";
    let items = of_rows(&[wrong.as_bytes()]);
    assert!(readings(&items).is_empty(), "{items:?}");
    assert!(
        bad(&items)
            .last()
            .unwrap()
            .contains("mag_uint is no key; mag_unit is one"),
        "{items:?}"
    );
    // Another device has not sent that header.
    let mut codec = LogRows::new(Mountings::default());
    codec.feed(wrong.as_bytes(), |_| ());
    codec.reopen(false);
    let mut items = Vec::new();
    codec.feed(b"x\n1,2,3,4\n", |item| items.push(item));
    assert!(bad(&items)[0].contains("its header was lost"), "{items:?}");
    let rows: String = (0..400)
        .map(|row| format!("{row}.1,2,3,4\n# battery = 3.7\n# mx, my, mz, t_s\n"))
        .collect();
    let items = of_rows(&[b"x\n", rows.as_bytes()]);
    assert!(readings(&items).len() > 300, "{}", readings(&items).len());
}

#[test]
fn rows_after_the_header_of_a_newer_version_say_so() {
    let newer = HEADER.replace("log 1", "log 2");
    let items = of_rows(&[format!("x\n{newer}1,2,3,4\n2,2,3,4\n").as_bytes()]);
    assert!(readings(&items).is_empty(), "{items:?}");
    for why in bad(&items) {
        assert!(why.contains("format version 2"), "{items:?}");
    }
    assert_eq!(bad(&items).len(), 3);
    let known = format!("{newer}{HEADER}3,2,3,4\n");
    assert_eq!(readings(&of_rows(&[known.as_bytes()])).len(), 1);
    // A greeting is no header.
    let rows = sketch_rows(7.0, 900);
    let greeting = format!("# headingd-log, a sketch\n{rows}");
    assert!(!readings(&of_rows(&[greeting.as_bytes()])).is_empty());
}

/// One bit of a byte, as on a bad cable. Without its unit, a field would be ten times too weak.
#[test]
fn a_header_line_that_is_no_text_is_wrong_and_a_remark_in_latin_1_is_none() {
    let stream = format!("{HEADER}1,2,3,4\n");
    let at = stream.find("unit").unwrap();
    let mut damaged = stream.clone().into_bytes();
    damaged[at] |= 0x80;
    let items = of_rows(&[&damaged]);
    assert!(readings(&items).is_empty(), "{items:?}");
    assert!(bad(&items)[0].contains("mag_unit is one"), "{items:?}");
    let (first, rest) = stream.split_once('\n').unwrap();
    let items = of_rows(&[first.as_bytes(), b"\n# by M\xfcller\n", rest.as_bytes()]);
    assert_eq!(readings(&items).len(), 1, "{items:?}");
}

#[test]
fn mountings_in_a_header_are_turned_into_the_boards() {
    let header = "# headingd-log 1\n# mag_axes = +y -x +z\n# gyro_axes = +x -y -z\nt_s,mx,my,mz,gx,gy,gz,ax,ay,az\n";
    let stream = format!("x\n{header}0,1,,3,1,2,3,1,2,3\n");
    let board = Mountings {
        mag: "-z +y +x".parse().unwrap(),
        accel: "+y +x -z".parse().unwrap(),
        ..Mountings::default()
    };
    let reading = readings(&of_rows_on(board, &[stream.as_bytes()]))[0];
    // Body (my, -mx, mz) = (?, -1, 3); on our chip X is body Z, Y is Y, Z is -X.
    assert_eq!(reading.field_mgauss, Some([Some(3.0), Some(-1.0), None]));
    assert_eq!(reading.rate_rad_s, Some(Vector3::new(1.0, -2.0, -3.0)));
    // The header does not name the accelerometer's.
    assert_eq!(
        reading.specific_force_m_s2,
        Some(Vector3::new(1.0, 2.0, 3.0))
    );
}

/// The items of a stream that is split anywhere are those of the whole stream.
fn assert_splits(stream: &[u8], decode: impl Fn(&[&[u8]]) -> Vec<Item>) {
    let whole = decode(&[stream]);
    for at in 0..=stream.len() {
        let (before, after) = stream.split_at(at);
        assert_eq!(decode(&[before, after]), whole, "{at}");
    }
}

#[test]
fn a_stream_may_be_split_at_every_position() {
    let counts = [[-3, 7, 256], [100, -200, 4095], [5, -5, 0]];
    let lines = [
        b"!ERR: reading gyroscope\r\n",
        &text(counts)[..],
        &text(counts),
    ]
    .concat();
    let frames = [b"#SYNCH01\r\n", &binary(counts)[..], &binary(counts)].concat();
    let rows = format!("{HEADER}0.5,1,2,3\r\n0.6,1,,3\r\n");
    assert_splits(&lines, of_text);
    assert_splits(&frames, of_binary);
    assert_splits(rows.as_bytes(), of_rows);
}

proptest! {
    #[test]
    fn no_bytes_make_a_codec_panic(bytes in prop::collection::vec(any::<u8>(), 0..3000), at in any::<usize>()) {
        for head in [&b""[..], b"#SYNCH01\r\n", b"#A-R=", b"#M-R=1,", HEADER.as_bytes()] {
            let stream = [head, &bytes].concat();
            let cut = at % (stream.len() + 1);
            let pieces = [&stream[..cut], &stream[cut..]];
            // What comes out is bounded by what went in.
            prop_assert!(of_text(&pieces).len() <= stream.len());
            prop_assert!(of_binary(&pieces).len() <= stream.len());
            prop_assert!(of_rows(&pieces).len() <= stream.len());
        }
    }

    #[test]
    fn no_near_line_makes_a_codec_panic(text in "[#AMGR=0-9eE+.,\r\nNnaifovt_sSYCH!:-]{0,300}") {
        of_text(&[text.as_bytes()]);
        of_binary(&[b"#SYNCH01\r\n", text.as_bytes()]);
        of_rows(&[HEADER.as_bytes(), text.as_bytes()]);
    }
}

/// What stands before the checksum may look like another one.
#[test]
fn a_checksum_is_taken_off_once() {
    let row = "1,2,3,4,note*00";
    let sum = row.bytes().fold(0, |sum, byte| sum ^ byte);
    let stream = format!("# headingd-log 1\nt_s,mx,my,mz,text\n{row}*{sum:02X}\n");
    let items = of_rows(&[stream.as_bytes()]);
    assert_eq!(readings(&items).len(), 1, "{items:?}");
}

/// A board that sends checksums, over a line that loses 3 bytes in 1,000: whatever gets through is right.
#[test]
fn rows_with_checksums_lose_rows_to_lost_bytes_and_nothing_else() {
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(3);
    let (mut sent, mut bytes) = (Vec::new(), Vec::new());
    for i in 0..3000 {
        let row = format!(
            "{:.3},{},{},-480.5",
            f64::from(i) * 0.01,
            100 + i,
            7 * i % 333
        );
        let sum = row.bytes().fold(0, |sum, byte| sum ^ byte);
        sent.push(row.clone());
        bytes.extend(format!("{row}*{sum:02X}\r\n").into_bytes());
    }
    bytes.retain(|_| !random.random_bool(0.003));
    bytes.splice(..0, *b"# headingd-log 1\nt_s,mx,my,mz\n");
    let mut codec = LogRows::new(Mountings::default());
    let (mut good, mut wrong) = (0, 0);
    codec.feed(&bytes, |item| {
        if let Item::Timed(reading) = item {
            let [Some(x), Some(y), Some(z)] = reading.field_mgauss.unwrap() else {
                panic!("{reading:?}");
            };
            good += 1;
            wrong += usize::from(!sent.contains(&format!("{:.3},{x},{y},{z}", reading.t_s)));
        }
    });
    assert!(good > 2600 && wrong <= 1, "{wrong} of {good}");
}
