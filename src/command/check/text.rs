//! An examination as text for people.

use std::fmt::Write;

use super::examine::CheckReport;

/// The report, line by line.
pub(super) fn written(report: &CheckReport) -> String {
    let mut text = String::new();
    // Writing to a String never fails.
    let _ = write(report, &mut text);
    text
}

fn write(report: &CheckReport, out: &mut String) -> std::fmt::Result {
    writeln!(out, "{}", report.bus)?;
    for found in &report.chips {
        writeln!(out, "  0x{:02x}  {}", found.address, found.chip)?;
    }
    if let Some(found) = &report.magnetometer {
        let probably = if found.sure { "" } else { "probably " };
        writeln!(
            out,
            "magnetometer: {probably}{} ({})",
            found.kind, found.why
        )?;
    }
    for axis in &report.self_test {
        let measured = axis
            .measured
            .map_or("overflow".to_owned(), |counts| format!("{counts:.0}"));
        let passed = if axis.passed { "good" } else { "NOT GOOD" };
        let (low, high) = axis.limits;
        writeln!(
            out,
            "  self-test {}: {measured} counts, expected {:.0} ({low:.0} to {high:.0}): {passed}",
            axis.axis, axis.expected
        )?;
    }
    if let (Some(field), Some(rate_hz)) = (report.field_mgauss, report.mag_rate_hz) {
        writeln!(
            out,
            "  field: {field:.0} mG, {rate_hz:.1} readings a second (the Earth's: 220 to 670 mG)"
        )?;
    }
    if let (Some([x, y, z]), Some(noise), Some(rate_hz)) = (
        report.gyro_deg_s,
        report.gyro_noise_deg_s,
        report.gyro_rate_hz,
    ) {
        writeln!(
            out,
            "gyro at rest: {x:+.2} {y:+.2} {z:+.2} deg/s on body X, Y, Z, noise {noise:.2} deg/s, {rate_hz:.1} readings a second"
        )?;
    }
    if let Some([x, y, z]) = report.accel_m_s2 {
        writeln!(
            out,
            "accelerometer at rest: {x:+.2} {y:+.2} {z:+.2} m/s2 on body X, Y, Z (level: 0 0 -9.8)"
        )?;
    }
    for problem in &report.problems {
        writeln!(out, "PROBLEM ({}): {}", problem.code, problem.message)?;
    }
    if report.problems.is_empty() {
        writeln!(out, "all is well")?;
    }
    Ok(())
}
