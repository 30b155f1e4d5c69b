//! Other magnetometers than the HMC5843, and fakes.

use super::*;

#[test]
fn each_magnetometer_that_has_a_driver_can_be_named() {
    let chips = drivers::MAGNETOMETERS
        .iter()
        .flat_map(|driver| driver.chips);
    let words = chips.map(|chip| chip.sheet().name.to_lowercase());
    let choices = MagnetometerChoice::WORDS.iter().copied();
    assert!(choices.eq(["auto".to_owned()].into_iter().chain(words)));
}

#[test]
fn a_qmc5883l_on_a_gy_271_and_the_gyro_beside_it_are_read() {
    let bus = FakeBus::default();
    bus.set(QMC, 0x0D, &[0xFF]);
    bus.set(GYRO, 0x00, &[0x68]);
    bus.set(ACCEL, 0x00, &[0xE5]);
    let settings = Settings {
        board: Board::Gy271,
        // A gain that the chip does not have is its coarsest.
        gain: Some(5),
        ..Settings::default()
    };
    // It has no single measurements: 40 Hz are 50 of its own.
    let (said, chips) = play(&settings, &bus, 0.02, vec![], 10.0);
    assert!(codes(&said).is_empty() && chips.troubles().count() == 0);
    let fields = field_times(&said);
    assert!((490..=500).contains(&fields.len()), "{}", fields.len());
    let motions = readings(&said).filter(|r| r.rate_rad_s.is_some());
    assert!((990..=1250).contains(&motions.count()));
    let first = readings(&said).find_map(Reading::whole_field_mgauss);
    // 3000 counts are a gauss.
    let [_, y, z] = first.unwrap().into();
    assert!((y - 100.0 / 3.0).abs() < 1e-9 && (z - 256.0 / 3.0).abs() < 1e-9);
    assert_eq!(bus.world.borrow().get(QMC, 0x09), 0x15);
    assert!(settings.sensor() == "hmc58xx" && settings.board.companions() == Companions::Auto);
}

#[test]
fn a_qmc5883l_that_saturates_has_its_coarser_range_and_a_brown_out_is_set_right() {
    let bus = FakeBus::default();
    bus.set(QMC, 0x0D, &[0xFF]);
    let settings = Settings {
        magnetometer: MagnetometerChoice::Qmc5883l,
        ..alone()
    };
    let magnet = |world: &mut World| world.set(QMC, NOTE, &[1]);
    let dip: Deed = (3.0, |world| world.set(QMC, 0x09, &[0, 0, 0]));
    let (said, _) = play(&settings, &bus, 0.02, vec![(1.0, magnet), dip], 6.0);
    assert_eq!(codes(&said), ["configuration_lost", ""]);
    let whole = readings(&said).filter_map(Reading::whole_field_mgauss);
    assert!(whole.count() > 230);
    assert_eq!(written(&bus, QMC, 0x09), [0x05, 0x15, 0x05, 0x15]);
}

#[test]
fn an_hmc5883l_that_has_never_measured_is_a_fake_and_one_that_has_is_frozen() {
    let settings = Settings {
        magnetometer: MagnetometerChoice::Hmc5883l,
        ..alone()
    };
    for rate_hz in [40.0, 75.0] {
        let settings = Settings {
            rate_hz,
            ..settings.clone()
        };
        let bus = stick();
        let (said, _) = play_dead(&settings, &bus, 1.0);
        assert_eq!(codes(&said), ["fake_hmc5883l"], "{rate_hz} Hz, never ready");
        bus.set(MAG, 0x03, &[0, 1, 0, 2, 0, 3, 1]);
        let (said, _) = play_dead(&settings, &bus, 1.0);
        assert_eq!(codes(&said), ["fake_hmc5883l"], "{rate_hz} Hz, frozen");
    }
    // It measures for a second, and then no more.
    let bus = stick();
    bus.world.borrow_mut().on_write = Some(|world, chip, register, _| {
        let count = world.transfers.len();
        if (chip, register) == (MAG, 0x02) && count < 100 {
            world.set(MAG, 0x03, &[0, count as u8, 0, 2, 0, 3, 1]);
        }
    });
    let (said, _) = play_dead(&settings, &bus, 3.0);
    assert_eq!(codes(&said), ["frozen"]);
}

#[test]
fn a_chip_that_has_measured_is_not_identified_again() {
    let settings = Settings {
        magnetometer: MagnetometerChoice::Auto,
        rate_hz: 75.0,
        ..alone()
    };
    let freeze = |world: &mut World| world.set(MAG, NOTE, &[1]);
    let bus = stick();
    let (said, _) = play(&settings, &bus, 1.0 / 75.0, vec![(3.0, freeze)], 9.0);
    assert_eq!(codes(&said), ["frozen"]);
}
