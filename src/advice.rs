//! What to do, by the reason of a condition or of a calibration's verdict.

/// What helps where this is the reason, if its message does not say so, as `docs/socket.md`, `docs/calibration.md` and
/// `docs/serial.md` do.
#[rustfmt::skip]
pub fn next_step(reason: &str) -> Option<&'static str> {
    Some(match reason {
        "no_accelerometer" => "keep the board level",
        "no_gyro" => "check the gyro and its wires",
        "field_strength" | "field_changed" =>
            "look for iron, magnets or currents nearby; if they are there to stay, move the board: in mode on it learns them; if this happens \
             everywhere, compare the chips' axes with headingd align LOG",
        "nose_vertical" => "hold the board more level",
        "accel_unit" => "set accel_unit in the log's header, or the range of the chip",
        "field_unit" => "set mag_unit in the log's header, or the gain or range of the chip",
        "no_samples" => "check the magnetometer: it is silent",
        "no_bus" | "permission" | "claimed" | "no_answer" | "clone" | "fake_hmc5883l" | "wrong_identity" =>
            "see the message, and headingd check",
        "timeout" | "arbitration_lost" | "short_read" | "bus_error" | "unsupported" =>
            "check wiring, pull-ups and bus clock",
        "configuration_lost" | "not_ready" | "frozen" =>
            "check the power; switch the board off and on",
        "no_device" | "unplugged" => "plug it in; set port to a path in /dev/serial/by-id",
        "busy" => "stop the program that holds the port",
        "silent" => "check the board's power and wires",
        "noise" => "set baud to the board's",
        "not_understood" | "long_line" => "see the message; correct the header, or set protocol",
        "other_mode" => "check that the port is the board's, and the wire to the board: commands do not reach it",
        "sensors" => "check the wires between the board and its sensors",
        "too_few_samples" => "turn more slowly, or read the magnetometer more often",
        "no_plane" =>
            "turn while the gyro runs; for a log without a gyro, or with an empty axis, name the plane (calibrate --plane xy)",
        "no_motion" => "turn the board; if you did, the magnetometer is stuck, or its unit or the gyro's is wrong",
        "no_fit" =>
            "make a full turn, away from iron: the samples lie on no ellipse; if this happens everywhere, compare the \
             chips' axes with headingd align LOG",
        "coverage" => "turn further round, or about a second axis too",
        "outliers" => "turn again: something magnetic came or went",
        "residual" =>
            "turn on the spot, away from iron: the field was not the same all the way round; if this happens everywhere, compare \
             the chips' axes with headingd align LOG",
        "axis_ratio" => "turn fully and on the spot; check the unit in the log and the chip",
        "scale" => "check the reference field, and the gain or unit of the magnetometer",
        "centre" => "make a full turn: too small a part of the curve was seen",
        "heading_uncertainty" =>
            "turn more fully or more slowly, for more samples; without a full turn, move as the message says",
        "gyro_angle" => "check the gyro's unit; compare the chips' axes and signs with headingd align LOG",
        "reversed_field" =>
            "compare the chips' axes and signs with headingd align LOG; check the sign of true_north.latitude_deg",
        "gyro_sign" | "mag_axes" | "accel_axes" =>
            "compare the chips' axes and signs with headingd align LOG",
        "gyro" => "check both mountings; turn more slowly; keep iron away from the board's path",
        "dip" => "check the mountings of magnetometer and accelerometer; keep iron away",
        "jump" => "turn again, level: a magnet was attached or taken away in mid-turn, or the board tilted",
        "rest" =>
            "turn again where the board has rested, with motors and currents as they will be: the field came with the turn",
        "stuck_axis" => "check the chip and its range: an axis reads the same number, or none, over an arc of the turn",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_exchanged_axes_look_like_leads_to_align() {
        for reason in [
            "no_fit",
            "residual",
            "field_strength",
            "field_changed",
            "gyro_angle",
            "gyro_sign",
            "mag_axes",
            "accel_axes",
        ] {
            let advice = next_step(reason).unwrap();
            assert!(advice.ends_with("headingd align LOG"), "{reason}: {advice}");
        }
    }
}
