//! An MPU-6050 beside the magnetometer.

use super::*;

#[test]
fn a_magnetometer_behind_an_mpu_6050_answers_after_its_bypass_is_on() {
    let bus = FakeBus::default();
    bus.set(GYRO, 0x75, &[0x68]);
    let bypass = |world: &mut World, chip, register, value| {
        if chip == GYRO && register == 0x37 && value == 0x02 {
            world.set(MAG, 0x0A, b"H43");
        }
    };
    bus.world.borrow_mut().on_write = Some(bypass);
    let settings = Settings {
        board: Board::Custom,
        ..settings()
    };
    let (said, chips) = play(&settings, &bus, 0.001, vec![], 0.9);
    assert!(codes(&said).is_empty());
    assert!(field_times(&said).len() > 20);
    // No accelerometer is looked for beside it.
    assert_eq!(chips.troubles().count(), 0);
    assert!(!bus.transfers().contains(&Transfer::Read(ACCEL, 0, 1)));
}

/// It is a variant of the MPU-6050, and has nothing in common with an ITG-3200.
#[test]
fn an_mpu_9250_is_told_as_a_wrong_mpu_6050() {
    let bus = FakeBus::default();
    bus.set(GYRO, 0x75, &[0x71]);
    let settings = Settings {
        board: Board::Custom,
        ..settings()
    };
    let (_, chips) = play(&settings, &bus, 0.001, vec![], 0.5);
    let gyro = chips
        .troubles()
        .find(|fault| fault.message.contains("gyro"));
    let message = &gyro.unwrap().message;
    assert!(message.contains("MPU-6050"), "{message}");
}

#[test]
fn an_mpu_6050_that_fails_is_not_set_up_as_an_itg_3200() {
    let bus = FakeBus::default();
    bus.set(GYRO, 0x75, &[0x68]);
    // Its factory trim is an ITG-3200's identity.
    bus.set(GYRO, 0x00, &[0x68]);
    bus.world.borrow_mut().on_write = Some(|world, chip, _, _| {
        if world.transfers.len() == 2 {
            world.faults.insert(chip, [Cause::Timeout].into());
        }
    });
    let settings = Settings {
        board: Board::Custom,
        ..settings()
    };
    play(&settings, &bus, 0.001, vec![], 0.5);
    assert!(written(&bus, GYRO, 0x3E).is_empty());
}
