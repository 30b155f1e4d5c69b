//! Which variant a chip is: all answer "H43".

use super::registers::*;
use super::variants::Variant;
use crate::sensor::bus::{Bus, read_byte};
use crate::sensor::chip::magnetometer::{Identified, Magnetometer};
use crate::sensor::chip::{ChipError, pause};
use crate::sensor::clock::Clock;

/// What people call the variants.
pub(super) const NAME: &str = "HMC5843 or variant";
/// Averaging and the fastest rate: an HMC5883L keeps the averaging bits, an HMC5843 has none.
const PROBE: u8 = 0x78;
const PROBE_WITHOUT_AVERAGING: u8 = 0x18;
/// At rate code 6 an HMC5843 measures at 50 Hz, all others at 75 Hz. The limit lies between.
const PERIOD_LIMIT_S: f64 = 0.0163;
/// Slightly less than the period at 75 Hz: looks further apart than this may have missed a measurement.
const SHORTEST_PERIOD_S: f64 = 0.013;
const LOOK_S: f64 = 0.001;
/// The rate is that of 8 periods in a row, so that one torn read, which counts as two changes, cannot decide it. Gives up
/// after 0.5 s.
const PERIODS: usize = 8;
const PATIENCE_S: f64 = 0.5;
/// The data of a chip that overflows on all axes: they do not change, since an overflow has no noise.
const OVERFLOWS: [u8; 6] = [0xF0, 0x00, 0xF0, 0x00, 0xF0, 0x00];

#[derive(Clone, Copy, PartialEq, Eq)]
enum ObservedRate {
    /// 50 Hz.
    Slow,
    /// 75 Hz.
    Fast,
    /// The data changed, but not often enough to tell, or overflowed.
    Unclear,
    /// The data were never ready, or never changed.
    NoData,
}

/// Identifies the chip at 0x1E by its registers "H43". Unless the configuration names the variant, CRA is written to find it:
/// it keeps the averaging bits or not, and measures at 50 or at 75 Hz.
pub(super) fn identify(
    bus: &mut dyn Bus,
    clock: &mut dyn Clock,
    named: Option<&'static dyn Magnetometer>,
) -> Result<Identified, ChipError> {
    let mut identity = [0; 3];
    bus.read(ADDRESS, IDENTITY, &mut identity)?;
    if identity != H43 {
        return Err(ChipError::Identity {
            chip: NAME,
            address: ADDRESS,
            register: IDENTITY,
            found: identity.to_vec(),
            right: "48, 34, 33 (\"H43\")",
        });
    }
    if let Some(chip) = named {
        return Ok(Identified {
            chip,
            sure: true,
            why: "the configuration says so",
        });
    }
    bus.write(ADDRESS, CRA, PROBE)?;
    let averages = read_byte(bus, ADDRESS, CRA)? != PROBE_WITHOUT_AVERAGING;
    let (chip, sure, why): (&Variant, _, _) = match (averages, rate(bus, clock)?) {
        (false, ObservedRate::Slow) => (
            &Variant::Hmc5843,
            true,
            "it has no averaging and measures at 50 Hz",
        ),
        (false, ObservedRate::Fast) => (
            &Variant::Hmc5883,
            false,
            "it has no averaging and measures at 75 Hz, as an LSM303DLHC would; if it is another, set i2c.magnetometer",
        ),
        (false, _) => (
            &Variant::Hmc5843,
            false,
            "it has no averaging, like an HMC5883, and its rate could not be measured; if the chip is another one, set i2c.magnetometer",
        ),
        (true, ObservedRate::Fast) => (
            &Variant::Hmc5883l,
            true,
            "it has averaging and measures at 75 Hz; an HMC5983 has the same gains and order",
        ),
        (true, ObservedRate::NoData) => return Err(ChipError::FakeHmc5883l),
        (true, _) => (
            &Variant::Hmc5883l,
            false,
            "it has averaging, but 75 Hz could not be confirmed; if the chip is another one, set i2c.magnetometer",
        ),
    };
    Ok(Identified { chip, sure, why })
}

/// A change of the data: it happened between two looks.
#[derive(Clone, Copy)]
struct DataChange {
    after_s: f64,
    before_s: f64,
    /// How many measurements at 75 Hz the looks since the first change may have missed.
    missed: u32,
}

/// What rate code 6 is.
///
/// RDY need not fall when the data are read, so a new measurement is known from its noise. On a busy machine looks come late.
/// So the looks before and after each change are kept; one rate is reported only if these times exclude the other.
fn rate(bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<ObservedRate, ChipError> {
    bus.write(ADDRESS, CRA, cra(FASTEST, NO_BIAS))?;
    bus.write(ADDRESS, MODE, CONTINUOUS)?;
    let begun_s = clock.now_s();
    let (mut last, mut looked_s, mut missed) = (None, begun_s, 0);
    let mut changes: Vec<DataChange> = Vec::new();
    loop {
        pause(clock, LOOK_S)?;
        let now_s = clock.now_s();
        missed += ((now_s - looked_s) / SHORTEST_PERIOD_S) as u32;
        if now_s - begun_s > PATIENCE_S {
            return Ok(if changes.is_empty() && last != Some(OVERFLOWS) {
                ObservedRate::NoData
            } else {
                ObservedRate::Unclear
            });
        }
        if read_byte(bus, ADDRESS, STATUS)? & RDY != 0 {
            let mut data = [0; 6];
            bus.read(ADDRESS, DATA, &mut data)?;
            // The first may have been waiting since long before.
            if last.replace(data).is_some_and(|last| last != data) {
                changes.push(DataChange {
                    after_s: looked_s,
                    before_s: clock.now_s(),
                    missed,
                });
                if let Some(rate) = told_by(&changes) {
                    return Ok(rate);
                }
            }
        }
        looked_s = now_s;
    }
}

/// The rate, if the last changes tell.
fn told_by(changes: &[DataChange]) -> Option<ObservedRate> {
    let window = &changes[changes.len().checked_sub(PERIODS + 1)?..];
    let (first, last) = (window[0], window[PERIODS]);
    let measured = PERIODS as f64 + f64::from(last.missed - first.missed);
    let short = |pair: &&[DataChange]| pair[1].before_s - pair[0].after_s < PERIOD_LIMIT_S;
    if last.before_s - first.after_s < PERIODS as f64 * PERIOD_LIMIT_S {
        Some(ObservedRate::Fast)
    } else if last.after_s - first.before_s > measured * PERIOD_LIMIT_S
        // Identical measurements make the mean period longer, but leave some periods short.
        && window.windows(2).filter(short).count() <= 1
    {
        Some(ObservedRate::Slow)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*, World};
    use crate::sensor::chip::tests::JumpingClock;

    /// A clock under which the chip measures, every so many seconds.
    struct Measuring {
        bus: FakeBus,
        clock: JumpingClock,
        period_s: f64,
        /// By how much each wait is too long, seconds, again and again.
        late_s: &'static [f64],
        waits: usize,
    }

    impl Clock for Measuring {
        fn now_s(&self) -> f64 {
            self.clock.now_s()
        }

        fn wait_until(&mut self, t_s: f64) -> bool {
            let t_s = t_s + self.late_s[self.waits % self.late_s.len()];
            self.waits += 1;
            let count = (t_s / self.period_s) as u8;
            self.bus.set(ADDRESS, DATA, &[0, count, 0, 1, 0, 2, RDY]);
            self.clock.wait_until(t_s)
        }
    }

    fn chip(averages: bool, period_s: f64) -> (FakeBus, Measuring) {
        let bus = FakeBus::default();
        bus.set(ADDRESS, IDENTITY, &H43);
        if !averages {
            let reserved = |world: &mut World, address, register, value| {
                if register == CRA {
                    world.set(address, CRA, &[value & 0x1F]);
                }
            };
            bus.world.borrow_mut().on_write = Some(reserved);
        }
        let clock = Measuring {
            bus: bus.clone(),
            clock: JumpingClock::default(),
            period_s,
            late_s: &[0.0],
            waits: 0,
        };
        (bus, clock)
    }

    #[test]
    fn averaging_bits_and_rate_tell_the_variants_apart() {
        for (averages, period_s, variant, sure) in [
            (false, 1.0 / 50.0, Variant::Hmc5843, true),
            (false, 1.0 / 75.0, Variant::Hmc5883, false),
            (false, 1e9, Variant::Hmc5843, false),
            (true, 1.0 / 75.0, Variant::Hmc5883l, true),
            (true, 1.0 / 60.0, Variant::Hmc5883l, false),
        ] {
            let (mut bus, mut clock) = chip(averages, period_s);
            let found = identify(&mut bus, &mut clock, None).unwrap();
            assert_eq!(
                (found.chip.sheet().name, found.sure),
                (variant.sheet().name, sure),
                "{averages} {period_s}"
            );
            assert_eq!(found.why.contains("set i2c.magnetometer"), !sure);
            let begin = [
                Read(0x1E, 0x0A, 3),
                Write(0x1E, 0x00, 0x78),
                Read(0x1E, 0x00, 1),
                Write(0x1E, 0x00, 0x18),
                Write(0x1E, 0x02, 0x00),
                Read(0x1E, 0x09, 1),
            ];
            assert_eq!(bus.transfers()[..6], begin);
        }
    }

    #[test]
    fn on_a_busy_machine_no_chip_is_taken_for_another() {
        let busy: [&[f64]; 4] = [
            &[0.0, 0.0, 0.012],
            &[0.018, 0.001],
            &[0.03, 0.0, 0.0, 0.0, 0.007],
            &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.05],
        ];
        for late_s in busy {
            for (period_s, other) in [
                (1.0 / 50.0, Variant::Hmc5883),
                (1.0 / 75.0, Variant::Hmc5843),
            ] {
                let (mut bus, clock) = chip(false, period_s);
                let mut clock = Measuring { late_s, ..clock };
                let found = identify(&mut bus, &mut clock, None).unwrap();
                let wrong = found.chip.sheet().name == other.sheet().name;
                assert!(!(wrong && found.sure), "{period_s} {late_s:?}");
                assert!(!wrong || period_s < 0.015, "{late_s:?}");
            }
        }
    }

    #[test]
    fn a_named_chip_is_not_written_to() {
        let (mut bus, mut clock) = chip(true, 1.0);
        let found = identify(&mut bus, &mut clock, Some(&Variant::Hmc5843)).unwrap();
        assert!(found.chip.sheet().name == "HMC5843" && found.sure);
        assert_eq!(bus.transfers(), [Read(0x1E, 0x0A, 3)]);
    }

    #[test]
    fn an_hmc5883l_whose_data_never_change_or_never_get_ready_is_a_fake() {
        let code = |bus: &FakeBus| {
            let mut clock = JumpingClock::default();
            let error = identify(&mut bus.clone(), &mut clock, None).err();
            error.map(|error| error.code())
        };
        let (bus, _) = chip(true, 1.0);
        assert_eq!(code(&bus), Some("fake_hmc5883l"));
        bus.set(ADDRESS, DATA, &[0, 1, 0, 2, 0, 3, RDY]);
        assert_eq!(code(&bus), Some("fake_hmc5883l"));
        // A magnet nearby does not make it one.
        bus.set(ADDRESS, DATA, &OVERFLOWS);
        assert_eq!(code(&bus), None);
    }
}
