//! A board that is moved as a test wants, and a pipeline that reads it.

use headingd::calibration::model::{Calibration, Parameters, Planar, Spatial};
use headingd::calibration::outcome::Outcome;
use headingd::calibration::policy::CalibrationOrigin;
use headingd::calibration::{Request, calibrate};
use headingd::condition::Report;
use headingd::heading::{Heading, MagStatus};
use headingd::pipeline::{Action, Event, Pipeline, Settings, Setup};
use headingd::reading::Reading;
use nalgebra::{Rotation3, Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::common::{BIAS, EARTH, apart_deg};

/// Between two readings, seconds; all chips speak in each.
const STEP_S: f64 = 0.02;

pub struct Board {
    pub pipeline: Pipeline,
    t_s: f64,
    heading_deg: f64,
    pitch_deg: f64,
    /// Iron on the board.
    pub bias_mgauss: Vector3<f64>,
    pub earth_mgauss: Vector3<f64>,
    pub with_field: bool,
    pub with_gyro: bool,
    /// What the gyro makes of the rate.
    pub gyro: fn(Vector3<f64>) -> Vector3<f64>,
    pub with_accel: bool,
    pub accel_bias_m_s2: Vector3<f64>,
    /// What the accelerometer reads of gravity.
    pub gravity_m_s2: f64,
    pub overflow: bool,
    /// What axis X of the magnetometer reads all the time.
    pub stuck_mgauss: Option<f64>,
    /// How many readings have the same field.
    pub repeats: usize,
    held: Option<(usize, Vector3<f64>)>,
    random: Xoshiro256PlusPlus,
    /// Outcomes wait until they are asked for.
    pub late: bool,
    pub under_way: Option<Box<Request>>,
    pub reports: Vec<Report>,
    pub outcomes: Vec<Outcome>,
    /// Why the last of them was asked for.
    pub origin: Option<CalibrationOrigin>,
    pub heading: Option<Heading>,
    /// How many calibrations were asked for.
    pub asked: usize,
}

impl Board {
    pub fn new(calibration: Option<Calibration>) -> Self {
        Self::with(Settings::default(), calibration)
    }

    /// With a pipeline that is set so.
    pub fn with(settings: Settings, calibration: Option<Calibration>) -> Self {
        let setup = Setup {
            pipeline: settings,
            ..Setup::default()
        };
        Self {
            pipeline: Pipeline::new(setup, calibration),
            t_s: 0.0,
            heading_deg: 0.0,
            pitch_deg: 0.0,
            bias_mgauss: BIAS,
            earth_mgauss: EARTH,
            with_field: true,
            with_gyro: true,
            gyro: |rate| rate,
            with_accel: true,
            accel_bias_m_s2: Vector3::zeros(),
            gravity_m_s2: 9.8,
            overflow: false,
            stuck_mgauss: None,
            repeats: 1,
            held: None,
            random: Xoshiro256PlusPlus::seed_from_u64(1),
            late: false,
            under_way: None,
            reports: Vec::new(),
            outcomes: Vec::new(),
            origin: None,
            heading: None,
            asked: 0,
        }
    }

    /// One at rest for long enough to know its gyro's bias.
    pub fn rested(calibration: Option<Calibration>) -> Self {
        let mut board = Self::new(calibration);
        board.rest(4.0);
        board
    }

    /// One that has rested, and whose iron is known from being moved about so often.
    pub fn taught(tumbles: usize) -> Self {
        let mut board = Self::rested(Some(spatial(0.0)));
        for _ in 0..tumbles {
            board.tumble();
        }
        assert_eq!(board.state(), ("good", "good"));
        board
    }

    /// Its times begin again, as in a log whose recorder was switched off and on.
    pub fn restart_clock(&mut self) {
        self.t_s = 0.0;
        self.tell(Event::NewStretch);
    }

    pub fn rest(&mut self, duration_s: f64) {
        self.turn_at(0.0, duration_s);
    }

    /// Turns clockwise at 60 degrees a second.
    pub fn turn(&mut self, angle_deg: f64) {
        self.turn_at(60.0 * angle_deg.signum(), angle_deg.abs() / 60.0);
    }

    pub fn turn_at(&mut self, rate_deg_s: f64, duration_s: f64) {
        for _ in 0..(duration_s / STEP_S).round() as usize {
            self.t_s += STEP_S;
            self.heading_deg += rate_deg_s * STEP_S;
            self.read(Vector3::z() * rate_deg_s);
        }
    }

    /// Lifts or sinks the nose, at 60 degrees a second.
    pub fn pitch_to(&mut self, pitch_deg: f64) {
        let rate_deg_s = 60.0 * (pitch_deg - self.pitch_deg).signum();
        while (pitch_deg - self.pitch_deg) * rate_deg_s > 0.0 {
            self.t_s += STEP_S;
            self.pitch_deg += rate_deg_s * STEP_S;
            // It points east, but for the heading.
            let axis =
                Rotation3::from_axis_angle(&Vector3::z_axis(), self.heading_deg.to_radians());
            self.read(axis * Vector3::y() * rate_deg_s);
        }
    }

    fn read(&mut self, rate_deg_s: Vector3<f64>) {
        let reading = self.reading(rate_deg_s);
        self.tell(Event::Reading(reading));
    }

    /// Is moved about, so that all axes see the field.
    pub fn tumble(&mut self) {
        for pitch_deg in [40.0, -40.0, 0.0] {
            self.turn(200.0);
            self.pitch_to(pitch_deg);
            self.turn(-200.0);
        }
    }

    /// How far the published heading is from the true one, degrees, if there is one.
    pub fn error_deg(&self) -> Option<f64> {
        let fused = self.heading.as_ref()?.fused_deg?;
        Some(apart_deg(fused, self.heading_deg))
    }

    /// Whether the gyro carries a published heading, and whether a sample gives one.
    pub fn shown(&self) -> (bool, bool) {
        let heading = self.heading.as_ref().unwrap();
        (
            heading.fused_deg.is_some(),
            heading.instantaneous_deg.is_some(),
        )
    }

    pub fn mag_status(&self) -> MagStatus {
        self.heading.as_ref().unwrap().mag_status
    }

    /// Makes a full turn of which nothing was made before: part of one is undone, and that takes its time.
    pub fn turn_anew(&mut self) {
        self.turn(-200.0);
        self.rest(5.0);
        self.turn(365.0);
    }

    /// `rate_deg_s` is in the axes of the earth: north, east, down.
    fn reading(&mut self, rate_deg_s: Vector3<f64>) -> Reading {
        let (heading, pitch) = (self.heading_deg.to_radians(), self.pitch_deg.to_radians());
        let to_body = Rotation3::from_euler_angles(0.0, pitch, heading).inverse();
        let noise = Vector3::from_fn(|_, _| self.random.random_range(-2.0..2.0));
        let measured = to_body * self.earth_mgauss + self.bias_mgauss + noise;
        let held = self.held.filter(|(count, _)| *count < self.repeats);
        let (count, field) = held.unwrap_or((0, measured));
        self.held = Some((count + 1, field));
        // No real gyro reads the same twice.
        let shaken = Vector3::from_fn(|_, _| self.random.random_range(-0.002..0.002));
        let axis = |value| Some(value).filter(|_| !self.overflow);
        Reading {
            t_s: self.t_s,
            field_mgauss: self.with_field.then(|| {
                [
                    axis(self.stuck_mgauss.unwrap_or(field.x)),
                    Some(field.y),
                    Some(field.z),
                ]
            }),
            rate_rad_s: self
                .with_gyro
                .then(|| (self.gyro)(to_body * rate_deg_s.map(f64::to_radians) + shaken)),
            specific_force_m_s2: self
                .with_accel
                .then(|| to_body * Vector3::z() * -self.gravity_m_s2 + self.accel_bias_m_s2),
        }
    }

    pub fn tell(&mut self, event: Event) {
        let mut actions = Vec::new();
        self.pipeline.handle(event, &mut actions);
        for action in actions {
            match action {
                Action::Publish(heading) => self.heading = Some(heading),
                Action::Report(report) => self.reports.push(report),
                Action::Turned(_) | Action::Warn(_) => {}
                Action::Calibrate(request) => {
                    assert!(self.under_way.is_none(), "two calibrations at a time");
                    self.asked += 1;
                    self.under_way = Some(request);
                }
                Action::Conclude(outcome, origin) => {
                    self.outcomes.push(*outcome);
                    self.origin = Some(origin);
                }
            }
        }
        if !self.late {
            self.finish();
        }
    }

    /// The calibration under way comes to its end.
    pub fn finish(&mut self) {
        if let Some(request) = self.under_way.take() {
            let outcome = calibrate(&request);
            self.tell(Event::Calibrated(Box::new(outcome)));
        }
    }

    /// The condition and its reason.
    pub fn state(&self) -> (&'static str, &'static str) {
        let report = self.reports.last().expect("nothing was reported");
        (report.condition.word(), report.reason)
    }

    /// The verdict on the last calibration and its reason.
    pub fn verdict(&self) -> (&'static str, &'static str) {
        let outcome = self.outcomes.last().expect("there was no outcome");
        (outcome.verdict.word(), outcome.reason)
    }
}

/// The calibration of a level turn, off by this.
pub fn planar(off_mgauss: f64) -> Calibration {
    let parameters = Parameters::Planar(Planar {
        basis: [Vector3::x(), Vector3::y()],
        bias_mgauss: BIAS.xy() + Vector2::new(off_mgauss, 0.0),
        scale: Vector2::new(1.0, 1.0),
        level: Vector2::zeros(),
    });
    Calibration::of(parameters, EARTH.x, 1.2, 0.05)
}

/// One of all axes, off by this.
pub fn spatial(off_mgauss: f64) -> Calibration {
    let bias = BIAS + Vector3::new(off_mgauss, 0.0, 0.0);
    let diagonal = Spatial::diagonal(bias, Vector3::new(1.0, 1.0, 1.0));
    Calibration::of(Parameters::Spatial(diagonal), EARTH.norm(), 1.2, 0.05)
}
