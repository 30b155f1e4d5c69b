//! The line of column names.

use super::{ACCEL, COLUMNS, GYRO, MAG, shown};

/// Whether a line is one of column names. A remark may name them, too.
pub(crate) fn names_columns(line: &[u8]) -> bool {
    let mut cells = line.split(|byte| *byte == b',');
    !line.starts_with(b"#") && cells.any(|cell| cell.trim_ascii() == b"t_s")
}

/// Which of [`COLUMNS`] each column is.
pub(super) fn columns(text: &str) -> Result<Vec<Option<usize>>, String> {
    let columns: Vec<Option<usize>> = text
        .split(',')
        .map(|name| COLUMNS.iter().position(|known| *known == name.trim()))
        .collect();
    let has = |index| columns.contains(&Some(index));
    for (index, name) in COLUMNS.iter().enumerate() {
        if columns.iter().filter(|c| **c == Some(index)).count() > 1 {
            return Err(format!("column {name} is named more than once"));
        }
    }
    if !has(0) {
        return Err(format!(
            "found {}, but the line of column names must follow the # lines: names with commas between them, t_s among them",
            shown(text.as_bytes())
        ));
    }
    for first in [MAG, GYRO, ACCEL] {
        let three = first..first + 3;
        let missing = three.clone().find(|index| !has(*index));
        if let (Some(missing), true) = (missing, three.clone().any(has)) {
            return Err(format!(
                "column {} is missing, but {} must come together",
                COLUMNS[missing],
                COLUMNS[three].join(", ")
            ));
        }
    }
    for (first, sensor, words) in [
        (MAG, "magnetometer", "m mag magn magnetometer"),
        (GYRO, "gyro", "g gyr gyro gyroscope"),
        (ACCEL, "accelerometer", "a acc accel accelerometer"),
    ] {
        let like = |name: &&str| words.split(' ').any(|word| is_axis_of(word, name));
        if let (false, Some(found)) = (has(first), text.split(',').find(like)) {
            return Err(format!(
                "found {}, but the {sensor}'s columns must be {}",
                shown(found.trim().as_bytes()),
                COLUMNS[first..first + 3].join(", ")
            ));
        }
    }
    Ok(columns)
}

/// Whether a column is likely an axis of the sensor with this name: `mag_x`, `MagX (uT)`, `m_x`, `Mx`. To ignore such a
/// column would silently lose the sensor. Any other name is allowed.
fn is_axis_of(sensor: &str, name: &str) -> bool {
    let name = name.trim().to_lowercase();
    let axis = name
        .strip_prefix(sensor)
        .map(|rest| rest.trim_start_matches(['_', '-', '.', ' ']))
        .and_then(|rest| rest.strip_prefix(['x', 'y', 'z']));
    axis.is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
}
