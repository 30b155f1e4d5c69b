//! The self-test: the chip makes a field of its own, and measures it.
//!
//! With measurement bias on, the chip measures with and without a current through its straps and gives the
//! difference, so the field outside does not matter as long as the sum does not overflow. Positive less negative
//! bias, halved, is free of the amplifier's offset as well.

use super::registers::*;
use super::variants::Variant;
use crate::sensor::bus::Bus;
use crate::sensor::chip::magnetometer::{
    AxisTest, ChipSetup, Magnetometer, Measurement, MeasuringMode,
};
use crate::sensor::chip::{ChipError, pause};
use crate::sensor::clock::Clock;

/// Measurements that are discarded after the bias has changed, and those that are used.
const DISCARDED: usize = 2;
const USED: usize = 5;
/// A measurement with bias is two in one.
const MEASUREMENT_S: f64 = 0.05;

/// Runs the self-test, about 0.7 s. The chip must be set up anew after it.
pub(super) fn self_test(
    bus: &mut dyn Bus,
    clock: &mut dyn Clock,
    chip: Variant,
) -> Result<[AxisTest; 3], ChipError> {
    let straps = chip.straps();
    let setup = ChipSetup {
        mode: MeasuringMode::Single,
        gain: straps.gain,
    };
    chip.start(bus, setup)?;
    let positive = mean_counts(chip, bus, clock, POSITIVE_BIAS)?;
    let negative = mean_counts(chip, bus, clock, NEGATIVE_BIAS)?;
    bus.write(ADDRESS, CRA, cra(FASTEST, NO_BIAS))?;
    let counts_per_gauss = chip.sheet().gain(straps.gain);
    let test = |axis: usize| {
        let expected = straps.field_gauss[axis] * counts_per_gauss;
        // The limits of all axes are those of X; Z may have the other sign.
        let of_x = straps.field_gauss[0].copysign(expected) * counts_per_gauss;
        let (one, other) = (of_x * straps.share.0, of_x * straps.share.1);
        let (least, most) = (one.min(other), one.max(other));
        let measured = positive[axis]
            .zip(negative[axis])
            .map(|(positive, negative)| 0.5 * (positive - negative));
        AxisTest {
            axis: ["X", "Y", "Z"][axis],
            expected,
            limits: (least, most),
            measured,
            passed: measured.is_some_and(|measured| (least..=most).contains(&measured)),
        }
    };
    Ok([test(0), test(1), test(2)])
}

/// The mean of some measurements with this bias, counts; `None` for an axis that overflowed in one.
fn mean_counts(
    chip: Variant,
    bus: &mut dyn Bus,
    clock: &mut dyn Clock,
    bias: u8,
) -> Result<[Option<f64>; 3], ChipError> {
    bus.write(ADDRESS, CRA, cra(FASTEST, bias))?;
    let mut sums = [Some(0.0); 3];
    for round in 0..DISCARDED + USED {
        chip.trigger(bus)?;
        pause(clock, MEASUREMENT_S)?;
        let raw = chip.poll(bus)?.ok_or(ChipError::NotReady {
            chip: chip.sheet().name,
            waited_s: MEASUREMENT_S,
        })?;
        if round < DISCARDED {
            continue;
        }
        let sample = Measurement::new(chip.sheet(), chip.straps().gain, raw);
        for (axis, sum) in sums.iter_mut().enumerate() {
            let count = sample.field_mgauss[axis].map(|_| f64::from(sample.raw[axis]));
            *sum = sum.zip(count).map(|(sum, count)| sum + count);
        }
    }
    Ok(sums.map(|sum| Some(sum? / USED as f64)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::bus::fake::{FakeBus, Transfer::*, World};
    use crate::sensor::chip::tests::JumpingClock;

    /// A chip with an offset of 10 counts that measures `counts` with positive bias.
    fn strapped(world: &mut World, address: u8, register: u8, value: u8, counts: i16) {
        if register == MODE && value == SINGLE {
            let sign = match world.get(address, CRA) & 3 {
                POSITIVE_BIAS => 1,
                NEGATIVE_BIAS => -1,
                _ => 0,
            };
            let [high, low] = (sign * counts + 10).to_be_bytes();
            world.set(address, DATA, &[high, low, high, low, high, low, RDY]);
        }
    }

    fn tested(variant: Variant, chip: fn(&mut World, u8, u8, u8)) -> ([AxisTest; 3], FakeBus) {
        let mut bus = FakeBus::default();
        bus.set(ADDRESS, IDENTITY, &H43);
        bus.world.borrow_mut().on_write = Some(chip);
        let test = self_test(&mut bus, &mut JumpingClock::default(), variant).unwrap();
        (test, bus)
    }

    #[test]
    fn a_good_chip_measures_its_own_field_free_of_its_offset() {
        let (test, bus) = tested(Variant::Hmc5843, |w, a, r, v| strapped(w, a, r, v, 430));
        for axis in test {
            assert!(axis.passed);
            // 0.55 gauss at 780 counts a gauss.
            assert!((axis.expected - 429.0).abs() < 1e-9);
            assert_eq!(axis.measured, Some(430.0));
        }
        let once = [
            Write(0x1E, 0x02, 0x01),
            Read(0x1E, 0x09, 1),
            Read(0x1E, 0x03, 6),
        ];
        let mut right = vec![Write(0x1E, 0x00, 0x18), Write(0x1E, 0x01, 0x60)];
        for cra in [0x19, 0x1A] {
            right.push(Write(0x1E, 0x00, cra));
            right.extend(once.repeat(7));
        }
        right.push(Write(0x1E, 0x00, 0x18));
        assert_eq!(bus.transfers(), right);
    }

    #[test]
    fn dead_turned_and_overflowing_axes_do_not_pass() {
        for chip in [
            (|w, a, r, v| strapped(w, a, r, v, 0)) as fn(&mut World, u8, u8, u8),
            |w, a, r, v| strapped(w, a, r, v, -430),
            |w, a, r, v| strapped(w, a, r, v, 700),
        ] {
            let (test, _) = tested(Variant::Hmc5843, chip);
            assert!(!test[0].passed && !test[2].passed);
        }
        let (test, _) = tested(Variant::Hmc5843, |w, a, r, v| strapped(w, a, r, v, -4106));
        assert!(test[0].measured.is_none() && !test[0].passed);
    }

    #[test]
    fn an_hmc5883l_has_the_limits_of_its_data_sheet_and_an_hmc5883_a_turned_z() {
        let (test, _) = tested(Variant::Hmc5883l, |w, a, r, v| strapped(w, a, r, v, 430));
        for axis in &test {
            let (low, high) = axis.limits;
            assert!((low - 243.0).abs() < 1e-9 && (high - 575.0).abs() < 1e-9);
        }
        assert!(test.iter().all(|axis| axis.passed));
        let (test, _) = tested(Variant::Hmc5883, |w, a, r, v| strapped(w, a, r, v, 430));
        assert!(test[0].passed && !test[2].passed);
        assert!(test[2].expected < 0.0);
    }
}
