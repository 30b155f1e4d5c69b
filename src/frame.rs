//! The body frame (X forward, Y right, Z down), how a chip is mounted in it, and angles.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Unit, Vector3};
use serde::{Deserialize, Serialize};

/// How a chip's axes lie in the body frame: `body = matrix · chip`.
///
/// Written as three signed chip axes, those that point along body X, Y and Z (`"+x -y -z"`), or as nine numbers, the matrix row by row. A
/// mirrored mounting (determinant −1) is allowed: some parts count one axis the other way round, or report gravity in place of specific force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Mounting {
    /// As it is written.
    matrix: Matrix3<f64>,
    /// The orthogonal matrix nearest to it.
    rotation: Matrix3<f64>,
}

impl Default for Mounting {
    fn default() -> Self {
        Self::of(Matrix3::identity())
    }
}

impl Mounting {
    /// The mounting with this matrix (`body = matrix · chip`), if it is orthogonal within 0.01: people write two decimals.
    pub fn from_matrix(matrix: Matrix3<f64>) -> Option<Self> {
        let error = (matrix * matrix.transpose() - Matrix3::identity()).norm();
        (error < 0.01).then(|| Self::of(matrix))
    }

    fn of(matrix: Matrix3<f64>) -> Self {
        // Newton's iteration for the polar factor: each step squares the error, and none changes a bit of signed axes.
        let nearer = |near: Matrix3<f64>, _| {
            let inverse = near.try_inverse().unwrap_or_else(|| near.transpose());
            0.5 * (near + inverse.transpose())
        };
        Self {
            matrix,
            rotation: (0..4).fold(matrix, nearer),
        }
    }

    /// A vector in chip axes, seen in the body frame.
    pub fn to_body(&self, chip: Vector3<f64>) -> Vector3<f64> {
        self.rotation * chip
    }

    /// The matrix, orthogonal: `body = rotation · chip`.
    pub fn rotation(&self) -> Matrix3<f64> {
        self.rotation
    }

    /// First `inner`, then this one.
    pub fn after(&self, inner: &Self) -> Self {
        Self::of(self.matrix * inner.matrix)
    }

    /// Whether the mounting is mirrored (determinant −1).
    pub fn is_mirrored(&self) -> bool {
        self.matrix.determinant() < 0.0
    }

    /// The rotation about body Z that adds this to every heading, degrees.
    pub fn adding_to_heading(offset_deg: f64) -> Self {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -offset_deg.to_radians());
        Self::of(turn.into_inner())
    }

    /// The rotation that makes this direction of body axes body Z, and turns no heading. `None` where body X is within 10° of the
    /// vertical.
    pub fn levelling(down: &Vector3<f64>) -> Option<Self> {
        let (forward, right) = horizontal(down)?;
        let rows = [forward.transpose(), right.transpose(), down.transpose()];
        Self::from_matrix(Matrix3::from_rows(&rows))
    }

    /// The nearest rotation whose nine numbers have six decimal places, so that people can read and copy them.
    pub fn rounded(&self) -> Self {
        Self::of(self.rotation.map(|n| rounded(n, 6)))
    }

    /// A vector in the body frame, seen in chip axes.
    pub fn to_chip(&self, body: Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(&body)
    }
}

impl FromStr for Mounting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let fail = |why: &str| {
            format!(
                "mounting {text:?} is not understood: {why}; write the chip axes along body X, Y, Z as in \"+x -y -z\", or a rotation \
                 matrix as nine numbers, row by row"
            )
        };
        let words: Vec<&str> = text
            .split([' ', ',', '\t'])
            .filter(|word| !word.is_empty())
            .collect();
        let matrix = match words.len() {
            3 => {
                let mut matrix = Matrix3::zeros();
                for (row, word) in words.iter().enumerate() {
                    let axis = word.strip_prefix(['+', '-']).unwrap_or(word);
                    let column = ["x", "y", "z"]
                        .iter()
                        .position(|name| name.eq_ignore_ascii_case(axis))
                        .ok_or_else(|| fail(&format!("{word:?} is no axis")))?;
                    matrix[(row, column)] = if word.starts_with('-') { -1.0 } else { 1.0 };
                }
                matrix
            }
            9 => {
                let number = |word: &&str| {
                    let number = word.parse::<f64>().ok().filter(|n| n.is_finite());
                    number.ok_or_else(|| fail(&format!("{word:?} is no number")))
                };
                let numbers: Result<Vec<f64>, String> = words.iter().map(number).collect();
                Matrix3::from_row_slice(&numbers?)
            }
            n => return Err(fail(&format!("found {n} of the three or nine words"))),
        };
        Self::from_matrix(matrix).ok_or_else(|| {
            fail(if words.len() == 3 {
                "each of x, y and z must occur once"
            } else {
                "its rows are not perpendicular unit vectors"
            })
        })
    }
}

impl fmt::Display for Mounting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Only an exact axis has a name, so that reading gives back what was written.
        let name = |row: usize| {
            let row = self.matrix.row(row).transpose();
            (0..3).find_map(|axis| match Vector3::ith(axis, 1.0) {
                unit if row == unit => Some(["+x", "+y", "+z"][axis]),
                unit if row == -unit => Some(["-x", "-y", "-z"][axis]),
                _ => None,
            })
        };
        if let (Some(x), Some(y), Some(z)) = (name(0), name(1), name(2)) {
            return write!(f, "{x} {y} {z}");
        }
        let numbers: Vec<String> = self.matrix.transpose().iter().map(f64::to_string).collect();
        f.write_str(&numbers.join(" "))
    }
}

impl TryFrom<String> for Mounting {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Mounting> for String {
    fn from(mounting: Mounting) -> String {
        mounting.to_string()
    }
}

/// The mountings of a board's three sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mountings {
    /// Magnetometer chip axes along body X, Y, Z.
    pub mag: Mounting,
    /// Gyro chip axes along body X, Y, Z.
    pub gyro: Mounting,
    /// Accelerometer chip axes along body X, Y, Z.
    pub accel: Mounting,
}

impl Mountings {
    /// The same chips on a board that is itself mounted so.
    pub fn on(&self, board: &Mounting) -> Self {
        let [mag, gyro, accel] = [self.mag, self.gyro, self.accel].map(|chip| board.after(&chip));
        Self { mag, gyro, accel }
    }
}

/// An angle in radians brought into (−π, π].
pub fn wrap_pi(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    // For an angle just above π, rem_euclid rounds up to TAU itself.
    PI - (PI - angle_rad).rem_euclid(TAU) % TAU
}

/// A matrix's entries, row by row.
pub fn rows(matrix: &Matrix3<f64>) -> SVector<f64, 9> {
    SVector::from_column_slice(matrix.transpose().as_slice())
}

/// All 48 ways to take each axis to one, or to its opposite. Each has the column and the sign of the entry in each row of its matrix; the
/// first is the identity.
pub fn signed_axes() -> impl Iterator<Item = [(usize, f64); 3]> {
    let orders = [
        [0, 1, 2],
        [1, 2, 0],
        [2, 0, 1],
        [0, 2, 1],
        [2, 1, 0],
        [1, 0, 2],
    ];
    let sign = |signs: u8, row: usize| if signs & (1 << row) == 0 { 1.0 } else { -1.0 };
    let signed = move |order: [usize; 3]| {
        (0..8).map(move |signs| [0, 1, 2].map(|row| (order[row], sign(signs, row))))
    };
    orders.into_iter().flat_map(signed)
}

/// Adds this variance to that of each of these states.
pub fn add_variance<const N: usize>(
    covariance: &mut SMatrix<f64, N, N>,
    states: Range<usize>,
    variance: f64,
) {
    for state in states {
        covariance[(state, state)] += variance;
    }
}

/// Gives each of these states this variance, without correlations.
pub fn reset_variance<const N: usize>(
    covariance: &mut SMatrix<f64, N, N>,
    states: Range<usize>,
    variance: f64,
) {
    for state in states {
        covariance.row_mut(state).fill(0.0);
        covariance.column_mut(state).fill(0.0);
        covariance[(state, state)] = variance;
    }
}

/// vᵀ P v: the variance of the sum of states with this covariance, each times its weight.
pub fn variance_along<const N: usize>(
    covariance: &SMatrix<f64, N, N>,
    weights: &SVector<f64, N>,
) -> f64 {
    weights.dot(&(covariance * weights))
}

/// Puts a block into a matrix, its first entry at this row and column.
pub fn put<const N: usize, const M: usize, const R: usize, const C: usize>(
    matrix: &mut SMatrix<f64, N, M>,
    (row, column): (usize, usize),
    block: &SMatrix<f64, R, C>,
) {
    matrix.fixed_view_mut::<R, C>(row, column).copy_from(block);
}

/// Length of (x, y). The C library's `hypot` rounds differently from one processor to another, and a replay shall give the same
/// bytes on all of them.
pub fn hypot(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// Angle between two orientations, radians, 0 to π.
pub fn angle_between_rad(before: &Matrix3<f64>, now: &Matrix3<f64>) -> f64 {
    let cosine = 0.5 * (before.component_mul(now).sum() - 1.0);
    cosine.clamp(-1.0, 1.0).acos()
}

/// An angle in degrees brought into [0, 360).
pub fn wrap_360(angle_deg: f64) -> f64 {
    let wrapped = angle_deg.rem_euclid(360.0);
    // A tiny negative angle rounds up to 360 itself.
    if wrapped >= 360.0 { 0.0 } else { wrapped }
}

/// A heading to a tenth of a degree, [0, 360), as people read it.
pub fn to_tenths(heading_deg: f64) -> f64 {
    wrap_360(rounded(heading_deg, 1))
}

/// Heading of body X, degrees clockwise from magnetic north, of a field in body axes over a horizontal
/// plane with this `down`. `None` where the field is vertical, or body X within 10° of it.
pub fn heading_deg(field_body: &Vector3<f64>, down: &Vector3<f64>) -> Option<f64> {
    let (forward, right) = horizontal(down)?;
    let (north, east) = (field_body.dot(&forward), -field_body.dot(&right));
    (hypot(north, east) > 1e-9).then(|| wrap_360(east.atan2(north).to_degrees()))
}

/// Body X this near the vertical (sine of 10°) has no heading.
pub const NO_HEADING: f64 = 0.17;

/// Unit vectors over a horizontal plane with this `down`: where body X points, and right of it. `None` within 10° of the
/// vertical.
fn horizontal(down: &Vector3<f64>) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let forward = Unit::try_new(Vector3::x() - down * down.x, NO_HEADING)?;
    Some((*forward, down.cross(&forward)))
}

/// Pitch (nose up, −90 to 90) and roll (right wing down, −180 to 180) of a board that sees down along this unit vector of body axes,
/// degrees.
pub fn pitch_and_roll_deg(down: &Vector3<f64>) -> (f64, f64) {
    let pitch_rad = (-down.x).clamp(-1.0, 1.0).asin();
    (pitch_rad.to_degrees(), down.y.atan2(down.z).to_degrees())
}

/// How far a field in body axes points below the horizontal plane with this `down`, degrees. NaN for no field.
pub fn dip_deg(field_body: &Vector3<f64>, down: &Vector3<f64>) -> f64 {
    let sine = field_body.dot(down) / field_body.norm();
    // Rounding may bring it above 1, where asin knows no answer.
    sine.clamp(-1.0, 1.0).asin().to_degrees()
}

/// The value with so many decimals; what rounds to 0 has no sign.
pub fn rounded(value: f64, decimals: i32) -> f64 {
    let power = 10f64.powi(decimals);
    (value * power).round() / power + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a board at this attitude sees, body axes: heading, then pitch nose up, then roll right down.
    fn seen(heading_deg: f64, pitch_deg: f64, roll_deg: f64) -> (Vector3<f64>, Vector3<f64>) {
        let attitude = Rotation3::from_euler_angles(
            roll_deg.to_radians(),
            pitch_deg.to_radians(),
            heading_deg.to_radians(),
        );
        let to_body = attitude.inverse();
        (
            to_body * Vector3::new(163.0, 0.0, 527.0),
            to_body * Vector3::z(),
        )
    }

    #[test]
    fn a_level_board_sees_h_cos_and_minus_h_sin() {
        for (field, heading) in [
            (Vector3::new(163.0, 0.0, 527.0), 0.0),
            (Vector3::new(0.0, -163.0, 527.0), 90.0),
            (Vector3::new(-163.0, 0.0, 527.0), 180.0),
            (Vector3::new(0.0, 163.0, 527.0), 270.0),
        ] {
            assert!((heading_deg(&field, &Vector3::z()).unwrap() - heading).abs() < 1e-9);
        }
    }

    #[test]
    fn a_mounting_that_is_written_and_read_is_the_same() {
        for tilt_rad in [0.0, 1e-6, 3e-4, 9e-4, 0.2] {
            let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), tilt_rad);
            let mounting = Mounting::from_matrix(turn.into_inner()).unwrap().rounded();
            assert_eq!(mounting.to_string().parse(), Ok(mounting), "{mounting}");
        }
    }

    #[test]
    fn tilt_is_taken_out() {
        for heading in [0.0, 77.0, 190.0, 300.0] {
            for (pitch, roll) in [(0.0, 0.0), (20.0, -10.0), (-45.0, 30.0), (10.0, 170.0)] {
                let (field, down) = seen(heading, pitch, roll);
                let (found_pitch, found_roll) = pitch_and_roll_deg(&down);
                assert!((found_pitch - pitch).abs() < 1e-9 && (found_roll - roll).abs() < 1e-9);
                let found = heading_deg(&field, &down).unwrap();
                assert!(
                    (found - heading).abs() < 1e-9,
                    "{heading} {pitch} {roll}: {found}"
                );
                let dip = 527f64.atan2(163.0).to_degrees();
                assert!((dip_deg(&field, &down) - dip).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_board_is_levelled_without_turning_its_heading_and_an_offset_is_added_to_it() {
        for (pitch, roll) in [(20.0, -10.0), (-45.0, 30.0), (10.0, 170.0)] {
            let (field, down) = seen(77.0, pitch, roll);
            let level = Mounting::levelling(&down).unwrap();
            assert!((level.to_body(down) - Vector3::z()).norm() < 1e-12);
            assert!(!level.is_mirrored());
            let found = heading_deg(&level.to_body(field), &Vector3::z()).unwrap();
            assert!((found - 77.0).abs() < 1e-9, "{found}");
            let turned = Mounting::adding_to_heading(-100.0).after(&level).rounded();
            let found = heading_deg(&turned.to_body(field), &Vector3::z()).unwrap();
            assert!((found - 337.0).abs() < 2e-4, "{found}");
        }
        let (_, down) = seen(30.0, 89.0, 0.0);
        assert_eq!(Mounting::levelling(&down), None);
    }

    #[test]
    fn a_nose_that_points_up_has_no_heading() {
        let (field, down) = seen(30.0, 89.0, 0.0);
        assert_eq!(heading_deg(&field, &down), None);
    }

    #[test]
    fn signed_axes_say_which_chip_axis_points_along_each_body_axis() {
        let stick: Mounting = "+y -x +z".parse().unwrap();
        let (chip, body) = (Vector3::new(1.0, 2.0, 3.0), Vector3::new(2.0, -1.0, 3.0));
        assert_eq!((stick.to_body(chip), stick.to_chip(body)), (body, chip));
    }

    #[test]
    fn a_mounting_is_read_as_it_is_written_and_is_a_rotation() {
        for text in ["+x -y -z", "-x +y +z", "0.87 0.5 0 -0.5 0.87 0 0 0 1"] {
            let mounting: Mounting = text.parse().unwrap();
            assert_eq!(mounting.to_string(), text);
            let rotation = mounting.rotation();
            assert!((rotation * rotation.transpose() - Matrix3::identity()).norm() < 1e-12);
        }
    }

    #[test]
    fn a_wrong_mounting_says_what_is_wrong() {
        for (text, why) in [
            ("+x +y", "found 2"),
            ("+x +y +w", "no axis"),
            ("+x +x +z", "once"),
            ("1 0 0 0 1 0 0 0 2", "perpendicular"),
            ("1 0 0 0 nan 0 0 0 1", "no number"),
        ] {
            let message = text.parse::<Mounting>().unwrap_err().to_string();
            assert!(message.contains(why) && message.contains(text), "{message}");
        }
    }

    #[test]
    fn angles_wrap_at_their_ends() {
        use std::f64::consts::PI;
        assert_eq!(wrap_pi(PI), PI);
        assert_eq!([-PI, PI.next_up()].map(wrap_pi), [PI, PI]);
        assert!((wrap_pi(7.0) - (7.0 - 2.0 * PI)).abs() < 1e-15);
        assert_eq!(wrap_360(-90.0), 270.0);
        assert_eq!(wrap_360(360.0), 0.0);
        assert_eq!(wrap_360(-1e-20), 0.0);
        assert_eq!([359.96, -0.04].map(to_tenths), [0.0, 0.0]);
    }
}
