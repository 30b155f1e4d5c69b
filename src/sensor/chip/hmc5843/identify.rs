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
const LOOK_S: f64 = 0.001;
/// Changes of the data that are timed, and the longest that this may take.
const CHANGES: u32 = 6;
const PATIENCE_S: f64 = 0.3;

#[derive(Clone, Copy, PartialEq, Eq)]
enum ObservedRate {
    /// 50 Hz.
    Slow,
    /// 75 Hz.
    Fast,
    /// The data changed, but not often enough to tell.
    Unclear,
    /// The data were never ready, or never changed.
    NoData,
}

/// Identifies the chip at 0x1E by its registers "H43". Unless the configuration names it, it is then written to: it
/// keeps the averaging bits of CRA or does not, and measures at 50 or at 75 Hz.
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
            "it has no averaging, nor has an HMC5883, and its rate did not show; if it is another, set i2c.magnetometer",
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
            "it has averaging, but its rate did not show as 75 Hz; if it is another, set i2c.magnetometer",
        ),
    };
    Ok(Identified { chip, sure, why })
}

/// What rate code 6 is.
///
/// RDY need not fall when the data are read, so a new measurement is known from its noise. Measurements that look
/// the same only make the mean period longer: the shortest of the periods decides.
fn rate(bus: &mut dyn Bus, clock: &mut dyn Clock) -> Result<ObservedRate, ChipError> {
    bus.write(ADDRESS, CRA, cra(FASTEST, NO_BIAS))?;
    bus.write(ADDRESS, MODE, CONTINUOUS)?;
    let begun_s = clock.now_s();
    let mut last = None;
    let mut changes_s = Vec::new();
    while changes_s.len() <= CHANGES as usize {
        pause(clock, LOOK_S)?;
        if clock.now_s() - begun_s > PATIENCE_S {
            return Ok(if changes_s.len() < 2 {
                ObservedRate::NoData
            } else {
                ObservedRate::Unclear
            });
        }
        let t_s = clock.now_s();
        if read_byte(bus, ADDRESS, STATUS)? & RDY == 0 {
            continue;
        }
        let mut data = [0; 6];
        bus.read(ADDRESS, DATA, &mut data)?;
        if last != Some(data) {
            last = Some(data);
            changes_s.push(t_s);
        }
    }
    // The first may have been waiting since long before.
    let periods = changes_s[1..].windows(2).map(|two| two[1] - two[0]);
    let mut periods: Vec<f64> = periods.collect();
    periods.sort_by(f64::total_cmp);
    Ok(if periods[periods.len() / 2] > PERIOD_LIMIT_S {
        ObservedRate::Slow
    } else {
        ObservedRate::Fast
    })
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
    }

    impl Clock for Measuring {
        fn now_s(&self) -> f64 {
            self.clock.now_s()
        }

        fn wait_until(&mut self, t_s: f64) -> bool {
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
                (found.chip.sheet().word, found.sure),
                (variant.data_sheet().word, sure),
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
    fn a_named_chip_is_not_written_to() {
        let (mut bus, mut clock) = chip(true, 1.0);
        let found = identify(&mut bus, &mut clock, Some(&Variant::Hmc5843)).unwrap();
        assert!(found.chip.sheet().word == "hmc5843" && found.sure);
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
        bus.set(ADDRESS, IDENTITY, b"abc");
        assert_eq!(code(&bus), Some("wrong_identity"));
    }
}
