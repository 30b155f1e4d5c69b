//! A board's chips: what they make of the true field, rate and force. Numbers are those of the data sheets named.

use nalgebra::{Matrix3, Vector3};

use crate::random::Rng;

/// HMC5843: counts per gauss and range in milligauss of each gain (data sheet, register B).
const GAINS: [(f64, f64); 8] = [
    (1620.0, 700.0),
    (1300.0, 1000.0),
    (970.0, 1500.0),
    (780.0, 2000.0),
    (530.0, 3200.0),
    (460.0, 3800.0),
    (390.0, 4500.0),
    (280.0, 6500.0),
];
/// ITG-3200: 14.375 counts per degree and second, range 2000 °/s.
const GYRO_COUNT: f64 = 1.0 / 14.375 * RAD;
/// ADXL345: 3.9 milli-g a count, whatever the range.
const FORCE_COUNT: f64 = 0.0039 * 9.80665;
const RAD: f64 = std::f64::consts::PI / 180.0;

/// How the board is to be drawn.
#[derive(Clone, Copy)]
pub struct Draw {
    /// Hard iron, most, in strengths of the field.
    pub hard: f64,
    /// Soft iron, most, as a share.
    pub soft: f64,
    /// Rotation between magnetometer and gyro, most, degrees.
    pub apart_deg: f64,
    /// Bias of the gyro, most an axis, degrees a second.
    pub bias_deg_s: f64,
    /// Room that the magnetometer's range leaves beyond iron and field, milligauss.
    pub room: f64,
}

/// The magnetometer.
pub struct Magnetometer {
    pub matrix: Matrix3<f64>,
    pub bias: Vector3<f64>,
    /// Added in body axes: what is attached to the board, or flows in its wires.
    pub attached: Vector3<f64>,
    pub noise: f64,
    pub lag_s: f64,
    pub period_s: f64,
    /// Clips, without saying so, at this strength on each axis.
    pub clip: f64,
    counts_per_mgauss: f64,
    range: f64,
    pub frozen: bool,
    pub stuck: Option<usize>,
    last: Vector3<f64>,
}

impl Magnetometer {
    /// The field without noise, chip axes.
    pub fn ideal(&self, field_body: &Vector3<f64>) -> Vector3<f64> {
        self.matrix * (field_body + self.attached) + self.bias
    }

    pub fn read(&mut self, field_body: &Vector3<f64>, rng: &mut Rng) -> [Option<f64>; 3] {
        if !self.frozen {
            let ideal = self.ideal(field_body) + rng.vector(self.noise);
            let mut counted = ideal
                .map(|b| (b * self.counts_per_mgauss).round() / self.counts_per_mgauss)
                .map(|b| b.clamp(-self.clip, self.clip));
            if let Some(axis) = self.stuck {
                counted[axis] = self.last[axis];
            }
            self.last = counted;
        }
        [0, 1, 2].map(|axis| Some(self.last[axis]).filter(|b| b.abs() <= self.range))
    }
}

/// What is wrong with a gyro.
#[derive(Clone, Copy, PartialEq)]
pub enum GyroFault {
    None,
    Zero,
    Bias,
    Constant(Vector3<f64>),
    /// It repeats its last reading.
    Hangs,
    /// It reads so many times what it should: -1 is a wrong sign.
    Scaled(f64),
}

/// The gyro.
pub struct Gyro {
    /// Scale errors and cross-axis sensitivity.
    pub matrix: Matrix3<f64>,
    pub bias: Vector3<f64>,
    pub noise: f64,
    /// Random walk of the bias, rad/s after a second.
    pub walk: f64,
    /// By how much the bias is still to change as the chip warms up, rad/s, and in which time that falls to 1/e, seconds.
    pub warming: Vector3<f64>,
    pub warms_in_s: f64,
    /// Rate per specific force.
    pub by_force: Matrix3<f64>,
    pub range: f64,
    pub fault: GyroFault,
    last: Vector3<f64>,
    /// Only every so many-th reading comes through.
    pub every: u32,
}

impl Gyro {
    pub fn read(
        &mut self,
        rate: &Vector3<f64>,
        force: &Vector3<f64>,
        dt_s: f64,
        rng: &mut Rng,
    ) -> Vector3<f64> {
        let warmed = self.warming * (dt_s / self.warms_in_s).min(1.0);
        self.warming -= warmed;
        self.bias += warmed + rng.vector(self.walk * dt_s.sqrt());
        let seen = match self.fault {
            GyroFault::Zero => return Vector3::zeros(),
            GyroFault::Constant(rate) => return rate,
            GyroFault::Hangs => return self.last,
            GyroFault::Bias => Vector3::zeros(),
            GyroFault::Scaled(scale) => self.matrix * rate * scale,
            GyroFault::None => self.matrix * rate,
        };
        let all = seen + self.bias + self.by_force * force + rng.vector(self.noise);
        let counted = all.map(|w| (w / GYRO_COUNT).round() * GYRO_COUNT);
        self.last = counted.map(|w| w.clamp(-self.range, self.range));
        self.last
    }
}

/// The accelerometer.
pub struct Accelerometer {
    pub matrix: Matrix3<f64>,
    pub bias: Vector3<f64>,
    pub noise: f64,
    pub silent: bool,
}

impl Accelerometer {
    pub fn read(&mut self, force: &Vector3<f64>, rng: &mut Rng) -> Option<Vector3<f64>> {
        let all = self.matrix * force + self.bias + rng.vector(self.noise);
        (!self.silent).then(|| all.map(|f| (f / FORCE_COUNT).round() * FORCE_COUNT))
    }
}

/// All three, and how the host gets their readings.
pub struct Board {
    pub mag: Magnetometer,
    pub gyro: Gyro,
    pub force: Accelerometer,
    /// Scatter of the times at which readings arrive, seconds.
    pub jitter_s: f64,
    /// Seconds between two pauses of the host, in which readings pile up; infinite if it makes none.
    pub pause_every_s: f64,
    /// Seconds between two polls of the host; 0 if it takes each reading at once.
    pub polls_every_s: f64,
    /// Shortest and longest time between two readings that have piled up, seconds.
    pub apart_s: (f64, f64),
    /// Share of the readings that are lost.
    pub lost: f64,
}

impl Board {
    /// Loses all readings, or none.
    pub fn silence(&mut self, silent: bool) {
        self.lost = f64::from(u8::from(silent));
    }

    /// Without any error but that of counting.
    pub fn perfect() -> Self {
        let (counts, range) = GAINS[1];
        Self {
            mag: Magnetometer {
                matrix: Matrix3::identity(),
                bias: Vector3::zeros(),
                attached: Vector3::zeros(),
                noise: 0.0,
                lag_s: 0.0,
                period_s: 0.02,
                clip: f64::INFINITY,
                counts_per_mgauss: counts / 1000.0,
                range,
                frozen: false,
                stuck: None,
                last: Vector3::zeros(),
            },
            gyro: Gyro {
                matrix: Matrix3::identity(),
                bias: Vector3::zeros(),
                noise: 0.0,
                walk: 0.0,
                warming: Vector3::zeros(),
                warms_in_s: f64::INFINITY,
                by_force: Matrix3::zeros(),
                range: 2000.0 * RAD,
                fault: GyroFault::None,
                last: Vector3::zeros(),
                every: 1,
            },
            force: Accelerometer {
                matrix: Matrix3::identity(),
                bias: Vector3::zeros(),
                noise: 0.0,
                silent: false,
            },
            jitter_s: 0.0,
            pause_every_s: f64::INFINITY,
            polls_every_s: 0.0,
            apart_s: (0.002, 0.004),
            lost: 0.0,
        }
    }

    pub fn draw(rng: &mut Rng, strength: f64, draw: &Draw) -> Self {
        let bias = rng.direction() * rng.uniform(0.0, draw.hard) * strength;
        let most = bias.amax() + strength * (1.0 + draw.soft) * 1.1 + draw.room;
        let (counts, range) = GAINS
            .into_iter()
            .find(|(_, range)| *range > most)
            .unwrap_or(GAINS[7]);
        // HMC5843: gains of the axes differ by some percent (its self-test is there to take that out).
        let gains = Vector3::new(1.0, 1.0, 1.0) + rng.vector(0.02);
        let matrix = Matrix3::from_diagonal(&gains)
            * rng.rotation(draw.apart_deg)
            * rng.soft_iron(draw.soft);
        // ITG-3200: sensitivity ±1 to ±3 % once it is warm, cross-axis 1 to 2 %.
        let scale = rng.uniform(0.01, 0.03);
        let cross = rng.uniform(0.01, 0.02);
        let gyro_matrix = Matrix3::from_fn(|row, column| {
            if row == column {
                1.0 + rng.uniform(-scale, scale)
            } else {
                rng.uniform(-cross, cross)
            }
        });
        let limit = draw.bias_deg_s * RAD;
        let gyro_bias = Vector3::from_fn(|_, _| rng.uniform(-limit, limit));
        let mut board = Self::perfect();
        board.mag.matrix = matrix;
        board.mag.bias = bias;
        board.mag.counts_per_mgauss = counts / 1000.0;
        board.mag.range = range;
        // HMC5843: 2 to 5 mG, its resolution being 7 mG peak to peak.
        board.mag.noise = rng.uniform(2.0, 5.0);
        // 16 and 60 ms were found on recorders.
        board.mag.lag_s = rng.uniform(0.0, 0.06);
        board.mag.period_s = 1.0 / rng.uniform(40.0, 75.0);
        board.gyro.matrix = gyro_matrix;
        board.gyro.bias = gyro_bias;
        // ITG-3200: 0.03 °/s/√Hz, 0.38 °/s RMS at its widest filter; a quieter chip has a tenth.
        board.gyro.noise = rng.log_uniform(0.03, 0.38) * RAD;
        // Some hundredths of a degree a second over minutes.
        board.gyro.walk = 0.002 * RAD;
        // ITG-3200: 0.1 °/s a g.
        board.gyro.by_force = Matrix3::from_fn(|_, _| rng.uniform(-0.1, 0.1) * RAD / 9.80665);
        // 5 milli-g an axis: a chip whose offset was trimmed once.
        board.force.bias = rng.vector(0.05);
        board.force.noise = rng.uniform(0.03, 0.1);
        board.jitter_s = rng.uniform(0.0, 0.002);
        // A third of the hosts poll in bursts, as those of the recorded logs did.
        if rng.chance(0.33) {
            board.pause_every_s = rng.uniform(0.5, 3.0);
        }
        board
    }

    /// The gyro warms up: data sheets allow its bias 0.16 (MPU-6050) to 0.32 °/s (ITG-3200) a kelvin, and a board gets 3 to 10 K warmer in
    /// minutes.
    pub fn warm_up(&mut self, rng: &mut Rng) {
        self.gyro.warming = rng.vector(1.0 * RAD);
        self.gyro.warms_in_s = rng.log_uniform(100.0, 600.0);
    }

    /// The accelerometer is as delivered: offsets are typically up to 35 milli-g (ADXL345) or 50 (MPU-6050), of which 25 is about the RMS.
    pub fn untrim(&mut self, rng: &mut Rng) {
        self.force.bias = rng.vector(0.25);
    }
}
