//! JSON members appended to a line. What is not known, or not finite, is left out.

fn push_key(out: &mut String, key: &str) {
    out.push_str(",\"");
    out.push_str(key);
    out.push_str("\":");
}

/// Appends `,"key":"text"`. Text that needs no escape, as a path hardly ever does, is copied.
pub(super) fn push_string(out: &mut String, key: &str, text: &str) {
    push_key(out, key);
    let is_plain = |byte| (b' '..0x7f).contains(&byte) && byte != b'"' && byte != b'\\';
    if text.bytes().all(is_plain) {
        out.push('"');
        out.push_str(text);
        out.push('"');
    } else {
        out.push_str(&serde_json::Value::from(text).to_string());
    }
}

/// Appends `,"key":value`.
pub(super) fn push_integer(out: &mut String, key: &str, value: u64) {
    push_key(out, key);
    push_digits(out, value, 1);
}

/// Appends `,"key":value` to 0.01°, [0, 360), or nothing where the angle is not known.
pub(super) fn push_angle(out: &mut String, key: &str, degrees: Option<f64>) {
    if let Some(hundredths) = degrees.and_then(|value| scaled(value, 2)) {
        // After the rounding, so that 359.996 becomes 0.00 and not 360.00.
        push_decimal(out, key, hundredths.rem_euclid(36_000), 2);
    }
}

/// Appends `,"key":value` with `decimals` decimal places, or nothing where the value is not known. A large value has
/// only the places that mean something.
pub(super) fn push_number(out: &mut String, key: &str, value: Option<f64>, decimals: u32) {
    let Some(value) = value else { return };
    let form = |decimals| scaled(value, decimals).map(|units| (units, decimals));
    if let Some((units, decimals)) = (0..=decimals).rev().find_map(form) {
        push_decimal(out, key, units, decimals);
    }
}

/// `value` in units of its last decimal place, or `None` where it has no honest decimal form: not finite, or
/// so large that the last place means nothing.
fn scaled(value: f64, decimals: u32) -> Option<i64> {
    const LARGEST: f64 = 9e15; // below 2^53
    let units = (value * 10f64.powi(decimals as i32)).round();
    (units.abs() <= LARGEST).then_some(units as i64)
}

/// Integer arithmetic: there is no "-0.00".
fn push_decimal(out: &mut String, key: &str, units: i64, decimals: u32) {
    push_key(out, key);
    if units < 0 {
        out.push('-');
    }
    let one = 10u64.pow(decimals);
    let units = units.unsigned_abs();
    push_digits(out, units / one, 1);
    if decimals > 0 {
        out.push('.');
        push_digits(out, units % one, decimals as usize);
    }
}

/// Appends a number with at least so many digits. Through `core::fmt` these were more than half of the instructions
/// that it takes to publish a heading.
fn push_digits(out: &mut String, mut number: u64, least: usize) {
    let mut digits = [0; 20];
    let mut count = 0;
    while number > 0 || count < least {
        digits[count] = b'0' + (number % 10) as u8;
        number /= 10;
        count += 1;
    }
    out.extend(digits[..count].iter().rev().map(|digit| char::from(*digit)));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(value: f64) -> String {
        let mut out = String::new();
        push_number(&mut out, "t_s", Some(value), 6);
        out
    }

    #[test]
    fn a_large_number_loses_decimals_and_is_never_left_out() {
        for (value, right) in [
            (-0.0000001, r#","t_s":0.000000"#),
            (9e9, r#","t_s":9000000000.000000"#),
            (9_000_000_001.25, r#","t_s":9000000001.25000"#),
            (-999_999_999_999.5, r#","t_s":-999999999999.500"#),
            (9e15, r#","t_s":9000000000000000"#),
        ] {
            assert_eq!(number(value), right, "{value}");
        }
    }

    #[test]
    fn what_has_no_honest_decimal_form_is_left_out() {
        for value in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300] {
            assert_eq!(number(value), "", "{value}");
        }
    }
}
