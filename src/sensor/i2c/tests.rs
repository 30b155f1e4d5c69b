//! The live source over a bus of simulated chips, by a clock that jumps.

mod companions;
mod magnetometers;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::super::board::Board;
use super::super::bus::Cause;
use super::super::bus::fake::{FakeBus, Transfer, World};
use super::settings::MagnetometerChoice;
use super::*;

const MAG: u8 = 0x1E;
const GYRO: u8 = 0x68;
const ACCEL: u8 = 0x53;
const QMC: u8 = 0x0D;
/// Where a test notes that a magnet is near, beyond the range of ±2 gauss, that an HMC58xx is frozen, or what is to come.
const NOTE: u8 = 0x20;

/// A stick with an HMC5843, an ITG-3200 and an ADXL345, all alive.
fn stick() -> FakeBus {
    let bus = FakeBus::default();
    bus.set(MAG, 0x0A, b"H43");
    bus.set(GYRO, 0x00, &[0x68]);
    bus.set(ACCEL, 0x00, &[0xE5]);
    bus
}

fn settings() -> Settings {
    Settings {
        board: Board::Sparkfun9dofStick,
        magnetometer: MagnetometerChoice::Hmc5843,
        ..Settings::default()
    }
}

/// The magnetometer alone.
fn alone() -> Settings {
    Settings {
        companions: Companions::None,
        ..settings()
    }
}

/// Something that happens at a time.
type Deed = (f64, fn(&mut World));

/// A clock under which the chips measure and things happen.
struct Theatre {
    bus: FakeBus,
    now_s: f64,
    until_s: f64,
    /// Of the magnetometer's own measurements.
    period_s: f64,
    alive: bool,
    deeds: Vec<Deed>,
    /// A busy board wakes up late: in this share of all cases, and by up to this, seconds.
    late: (f64, f64),
    rng: Xoshiro256PlusPlus,
}

impl Clock for Theatre {
    fn now_s(&self) -> f64 {
        self.now_s
    }

    fn wait_until(&mut self, t_s: f64) -> bool {
        self.now_s = self.now_s.max(t_s);
        if self.rng.random_bool(self.late.0) {
            self.now_s += self.late.1 * self.rng.random::<f64>();
        }
        let world = &mut *self.bus.world.borrow_mut();
        while self.deeds.first().is_some_and(|deed| deed.0 <= self.now_s) {
            self.deeds.remove(0).1(world);
        }
        let noise = (self.now_s * 1e4) as u64 as u8;
        // The third is that of an MPU-6050.
        for (chip, register) in [(GYRO, 0x1D), (ACCEL, 0x32), (GYRO, 0x3B)] {
            if self.alive && world.chips.contains_key(&chip) {
                world.set(chip, register, &[0, noise]);
            }
        }
        if self.alive && world.chips.contains_key(&MAG) && world.get(MAG, NOTE) == 0 {
            let count = (self.now_s / self.period_s) as u64;
            let [.., high, low] = (count % 1000).to_be_bytes();
            // RDY never falls: the worst that the data sheet allows.
            world.set(MAG, 0x03, &[high, low, 0, 100, 1, 0, 0x01]);
        }
        // In standby it does not measure; the low byte comes first.
        if world.chips.contains_key(&QMC) && world.get(QMC, 0x09) & 1 == 1 {
            if world.get(QMC, NOTE) == 1 && world.get(QMC, 0x09) >> 4 == 0 {
                world.set(QMC, 0x00, &[0xFF, 0x7F, 0, 0, 0, 0, 0x03]);
                return self.now_s < self.until_s;
            }
            let count = (self.now_s / self.period_s) as u64;
            let [low, high, ..] = (count % 1000).to_le_bytes();
            world.set(QMC, 0x00, &[low, high, 100, 0, 0, 1, 0x01]);
        }
        self.now_s < self.until_s
    }
}

/// Chips that measure, the magnetometer with this period.
fn theatre(bus: &FakeBus, period_s: f64, until_s: f64) -> Theatre {
    Theatre {
        bus: bus.clone(),
        now_s: 0.0,
        until_s,
        period_s,
        alive: true,
        deeds: Vec::new(),
        late: (0.0, 0.0),
        rng: Xoshiro256PlusPlus::seed_from_u64(1),
    }
}

/// What the chips say until then, and the chips.
fn play(
    settings: &Settings,
    bus: &FakeBus,
    period_s: f64,
    deeds: Vec<Deed>,
    until_s: f64,
) -> (Vec<SourceEvent>, Chips) {
    let theatre = theatre(bus, period_s, until_s);
    act(settings, Theatre { deeds, ..theatre })
}

/// The same with chips whose registers stay as they are.
fn play_dead(settings: &Settings, bus: &FakeBus, until_s: f64) -> (Vec<SourceEvent>, Chips) {
    let theatre = theatre(bus, 1.0, until_s);
    let alive = false;
    act(settings, Theatre { alive, ..theatre })
}

fn act(settings: &Settings, mut theatre: Theatre) -> (Vec<SourceEvent>, Chips) {
    let mut bus = theatre.bus.clone();
    let mut chips = Chips::new(settings);
    let mut said = Vec::new();
    chips.run(&mut bus, &mut theatre, &mut |new| {
        said.push(new);
        true
    });
    (said, chips)
}

/// What was written to a register.
fn written(bus: &FakeBus, chip: u8, register: u8) -> Vec<u8> {
    let value = |transfer| match transfer {
        Transfer::Write(to, at, value) if (to, at) == (chip, register) => Some(value),
        _ => None,
    };
    bus.transfers().into_iter().filter_map(value).collect()
}

fn readings(said: &[SourceEvent]) -> impl Iterator<Item = &Reading> {
    said.iter().filter_map(|said| match said {
        SourceEvent::Reading(reading, _) => Some(reading),
        _ => None,
    })
}

fn field_times(said: &[SourceEvent]) -> Vec<f64> {
    let fields = readings(said).filter(|reading| reading.field_mgauss.is_some());
    fields.map(|reading| reading.t_s).collect()
}

/// The codes of the troubles with the times of the readings before them; `""` is the end of one.
fn troubles(said: &[SourceEvent]) -> Vec<(f64, &'static str)> {
    let mut t_s = 0.0;
    let mut found = Vec::new();
    for said in said {
        match said {
            SourceEvent::Reading(reading, _) => t_s = reading.t_s,
            SourceEvent::Fault(Some(fault)) => found.push((t_s, fault.code)),
            SourceEvent::Fault(None) => found.push((t_s, "")),
            other => panic!("{other:?}"),
        }
    }
    found
}

fn codes(said: &[SourceEvent]) -> Vec<&'static str> {
    troubles(said).into_iter().map(|(_, code)| code).collect()
}

#[test]
fn the_magnetometer_keeps_40_hz_and_the_gyro_100_each_with_its_time() {
    let bus = stick();
    let (said, chips) = play(&settings(), &bus, 0.001, vec![], 10.0);
    let fields = field_times(&said);
    assert!((394..=400).contains(&fields.len()), "{}", fields.len());
    // Until it has learnt how long a measurement takes, each is looked for a bit earlier.
    for two in fields[200..].windows(2) {
        assert!((two[1] - two[0] - 0.025).abs() < 1e-6, "{two:?}");
    }
    let motions: Vec<_> = readings(&said).filter(|r| r.rate_rad_s.is_some()).collect();
    // 100 Hz or more: a reading of the magnetometer takes a tick along.
    assert!((1000..=1250).contains(&motions.len()), "{}", motions.len());
    let longest_s = motions.windows(2).map(|two| two[1].t_s - two[0].t_s);
    assert!(longest_s.fold(0.0, f64::max) < 0.0141);
    assert!(motions.iter().all(|r| r.specific_force_m_s2.is_some()));
    // In order of time, as the pipeline wants them.
    assert!(readings(&said).is_sorted_by(|a, b| a.t_s <= b.t_s));
    assert!(codes(&said).is_empty() && chips.troubles().count() == 0);
    // A measurement: told to, looked at, and read.
    let transfers: Vec<_> = bus.transfers();
    let of_mag =
        |t: &&Transfer| matches!(t, Transfer::Read(MAG, 3.., _) | Transfer::Write(MAG, 2, _));
    let all: Vec<_> = transfers.iter().filter(of_mag).collect();
    let last = &all[all.len() - 6..];
    let round = [
        Transfer::Write(MAG, 0x02, 0x01),
        Transfer::Read(MAG, 0x09, 1),
        Transfer::Read(MAG, 0x03, 6),
    ];
    let at = last.iter().position(|t| **t == round[0]).unwrap();
    assert!(
        (0..6).all(|i| *last[(at + i) % 6] == round[i % 3]),
        "{last:?}"
    );
}

#[test]
fn in_continuous_measurement_each_sample_comes_once_and_soon() {
    let settings = Settings {
        rate_hz: 50.0,
        ..settings()
    };
    // The chip's own clock is some percent off, either way, and the board may be busy.
    for (period_s, late) in [0.0188, 0.0197, 0.02, 0.0204, 0.0212]
        .into_iter()
        .flat_map(|period_s| [(0.0, 0.0), (1.0, 0.002), (0.05, 0.015)].map(|late| (period_s, late)))
    {
        let bus = stick();
        let theatre = theatre(&bus, period_s, 20.0);
        let (said, _) = act(&settings, Theatre { late, ..theatre });
        let fields = field_times(&said);
        let case = format!("{period_s} s, late {late:?}");
        let share = fields.len() as f64 * period_s / 20.0;
        assert!((0.99..=1.0).contains(&share), "{case}: {share}");
        let ages = fields.iter().map(|t_s| t_s % period_s);
        let mean_s = ages.sum::<f64>() / fields.len() as f64;
        assert!(
            mean_s < 0.0015 + late.0 * late.1 / 2.0,
            "{case}: {mean_s} s late"
        );
        let look = |t: &&Transfer| matches!(t, Transfer::Read(MAG, 0x09, 1));
        let looks = bus.transfers().iter().filter(look).count();
        let in_vain = (looks - fields.len()) as f64 / 20.0;
        assert!(in_vain < 4.0, "{case}: {in_vain} looks a second in vain");
        assert!(codes(&said).is_empty());
    }
}

#[test]
fn one_lost_transfer_is_no_trouble_and_three_in_a_row_are() {
    let once: Deed = (2.0, |world| {
        world
            .faults
            .entry(MAG)
            .or_default()
            .push_back(Cause::ArbitrationLost);
    });
    let (said, _) = play(&settings(), &stick(), 0.001, vec![once], 6.0);
    assert!(codes(&said).is_empty());
    assert!(field_times(&said).len() > 230);
    for (cause, code) in [
        (Cause::NoAnswer, "no_answer"),
        (Cause::Timeout, "timeout"),
        (Cause::ArbitrationLost, "arbitration_lost"),
        (Cause::ShortRead { found: 2 }, "short_read"),
        (Cause::Other("Input/output error".to_owned()), "bus_error"),
    ] {
        let bus = stick();
        bus.world
            .borrow_mut()
            .faults
            .insert(MAG, [(); 10].map(|()| cause.clone()).into());
        let (said, chips) = play(&settings(), &bus, 0.001, vec![], 30.0);
        assert_eq!(codes(&said), [code, ""]);
        assert_eq!(chips.troubles().count(), 0);
    }
}

#[test]
fn a_bus_that_goes_is_told_once_and_comes_back_by_itself() {
    let gone: Deed = (2.0, |world| world.broken = Some(Cause::NoBus));
    let back: Deed = (8.0, |world| world.broken = None);
    let bus = stick();
    let (said, chips) = play(&settings(), &bus, 0.001, vec![gone, back], 20.0);
    let told = troubles(&said);
    assert_eq!(codes(&said), ["no_bus", ""]);
    assert!(told[0].0 < 2.1, "{told:?}");
    let fields = field_times(&said);
    // Nothing in between, and back-off is no more than five seconds.
    assert!(!fields.iter().any(|t_s| (2.05..8.0).contains(t_s)));
    assert!(fields.iter().any(|t_s| (8.0..13.1).contains(t_s)));
    let rates = readings(&said).filter(|r| r.rate_rad_s.is_some() && r.t_s > 14.0);
    assert!(rates.count() > 550);
    assert_eq!(chips.troubles().count(), 0);
    // While it was away, it was tried a few times, not thousands.
    assert!(bus.transfers().len() < 6 * 1400);
}

#[test]
fn frozen_registers_stop_the_readings_within_half_a_second() {
    let bus = stick();
    bus.set(MAG, 0x03, &[0, 1, 0, 2, 0, 3, 1]);
    let (said, chips) = play_dead(&settings(), &bus, 3.0);
    assert_eq!(codes(&said), ["frozen"]);
    let found: Vec<_> = chips.troubles().map(|trouble| trouble.code).collect();
    assert_eq!(found, ["frozen"; 3]);
    // Setting them up anew does not make them any better.
    assert_eq!(readings(&said).count(), 2 * 19);
    let (said, _) = play_dead(&alone(), &bus, 3.0);
    let fields = field_times(&said);
    assert!(
        fields.len() == 19 && fields[18] - fields[0] < 0.5,
        "{fields:?}"
    );
}

#[test]
fn a_brown_out_is_seen_within_a_second_and_set_right() {
    for chip in [MAG, GYRO, ACCEL] {
        let dip: Deed = match chip {
            MAG => (2.0, |world| world.set(MAG, 0x00, &[0x10, 0x20])),
            GYRO => (2.0, |world| world.set(GYRO, 0x15, &[0, 0])),
            _ => (2.0, |world| world.set(ACCEL, 0x2C, &[0x0A, 0])),
        };
        let bus = stick();
        let (said, chips) = play(&settings(), &bus, 0.001, vec![dip], 8.0);
        assert_eq!(chips.troubles().count(), 0);
        let world = bus.world.borrow();
        assert_eq!([world.get(MAG, 0), world.get(MAG, 1)], [0x18, 0x20]);
        assert_eq!([world.get(GYRO, 0x15), world.get(GYRO, 0x16)], [4, 0x1B]);
        assert_eq!([world.get(ACCEL, 0x2C), world.get(ACCEL, 0x2D)], [0x0B, 8]);
        let right: &[&str] = if chip == MAG {
            &["configuration_lost", ""]
        } else {
            &[]
        };
        assert_eq!(codes(&said), right);
        let fields = field_times(&said);
        let gap_s = fields
            .windows(2)
            .map(|two| two[1] - two[0])
            .fold(0.0, f64::max);
        assert!(gap_s < 0.3, "{gap_s}");
    }
}

#[test]
fn a_silent_rdy_is_a_trouble_too() {
    let (said, _) = play_dead(&settings(), &stick(), 1.0);
    assert_eq!(codes(&said), ["not_ready"]);
}

#[test]
fn an_overflow_steps_the_range_up_and_is_never_published() {
    let magnet = |world: &mut World, chip, register, value| {
        // The chip takes gain code 3, but the transfer fails, once.
        if world.get(chip, NOTE) == 1 && (chip, register, value) == (MAG, 0x01, 3 << 5) {
            world.set(MAG, NOTE, &[0]);
            world.faults.insert(MAG, [Cause::Timeout].into());
        }
        // An overflow at gain codes 1 and 2, a measurement at 3.
        if chip == MAG && register == 0x02 {
            let x = if world.get(MAG, 1) >> 5 < 3 {
                [0xF0, 0x00]
            } else {
                [0x04, 0x00]
            };
            let noise = world.transfers.len() as u8;
            world.set(MAG, 0x03, &[x[0], x[1], 0, noise, 0, 0, 1]);
        }
    };
    for (fails, gains) in [(0, &[1, 2, 3][..]), (1, &[1, 2, 3, 1, 2, 3])] {
        let bus = stick();
        bus.set(MAG, NOTE, &[fails]);
        bus.world.borrow_mut().on_write = Some(magnet);
        let (said, _) = play_dead(&alone(), &bus, 4.0);
        assert!(field_times(&said).len() > 100);
        for reading in readings(&said) {
            // 1024 counts at 780 a gauss.
            let x = reading.whole_field_mgauss().expect("no overflow").x;
            assert!((x - 1024.0 / 0.78).abs() < 1e-9);
        }
        let gains: Vec<u8> = gains.iter().map(|gain| gain << 5).collect();
        assert_eq!(written(&bus, MAG, 0x01), gains);
    }
}

#[test]
fn with_a_fixed_gain_an_overflow_is_said_so() {
    let bus = stick();
    bus.set(MAG, 0x03, &[0, 5, 0xF0, 0x00, 0, 5, 1]);
    let settings = Settings {
        gain: Some(3),
        ..alone()
    };
    let (said, _) = play_dead(&settings, &bus, 1.0);
    let first = readings(&said).next().unwrap().field_mgauss.unwrap();
    assert!(first[0].is_some() && first[1].is_none() && first[2].is_some());
    assert!(codes(&said).is_empty());
    assert_eq!(bus.world.borrow().get(MAG, 0x01) >> 5, 3);
}

#[test]
fn without_its_gyro_the_magnetometer_goes_on() {
    let off: Deed = (2.0, |world| {
        world.chips.remove(&GYRO);
    });
    let (said, chips) = play(&settings(), &stick(), 0.001, vec![off], 5.0);
    assert!(codes(&said).is_empty());
    assert!(field_times(&said).len() > 190);
    assert_eq!(chips.troubles().next().unwrap().code, "no_answer");
    let forces = readings(&said).filter(|r| r.specific_force_m_s2.is_some() && r.t_s > 2.5);
    assert!(forces.count() > 200);
}
