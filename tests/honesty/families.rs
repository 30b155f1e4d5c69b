//! All simulated families, with how many seeds each has and what it must hold to.

use crate::random::Rng;
use crate::score::Score;
use crate::table::{Limits, NONE};
use crate::{bad_turns, changes, faults, handled, rest, vehicles};

/// A kind of run.
pub struct Family {
    pub name: &'static str,
    pub seeds: usize,
    pub run: fn(&mut Rng, &mut Score),
    pub limits: Limits,
}

/// Holds the simulation to what it says it does.
const PERFECT: Limits = Limits {
    rms_deg: Some(0.5),
    ..NONE
};
const TUMBLING: Limits = Limits {
    first_s: Some(10.0),
    rms_deg: Some(1.5),
    nerr: Some((0.7, 1.3)),
    false_share: Some(0.001),
    good: Some(0.8),
    ..NONE
};
/// A place is evidence, and a wrong one does no harm.
const PLACE: Limits = Limits {
    rms_deg: Some(2.0),
    nerr: Some((0.5, 1.5)),
    false_share: Some(0.005),
    ..TUMBLING
};
const CAR: Limits = Limits {
    first_deg: Some(180.0),
    rms_deg: Some(2.0),
    nerr: Some((0.7, 1.3)),
    false_share: Some(0.001),
    good: Some(0.8),
    ..NONE
};
const VEHICLE: Limits = Limits {
    nerr: Some((0.7, 1.5)),
    false_share: Some(0.005),
    good: Some(0.8),
    ..NONE
};
const WARMING_AT_REST: Limits = Limits {
    nerr: REST.nerr,
    ..VEHICLE
};
/// Neither a heading that takes a second after each silence nor one in the long curves of a motorway is always `good`.
const NOT_ALWAYS_GOOD: Limits = Limits {
    good: None,
    ..VEHICLE
};
/// There may be no heading at all.
const ONE_AXIS: Limits = Limits {
    false_share: Some(0.001),
    ..NONE
};
const CHANGE: Limits = Limits {
    told: Some((5.0, 0.95)),
    false_share: Some(0.001),
    ..NONE
};
/// Good headings again without motion.
const VISIT: Limits = Limits {
    good: Some(0.8),
    ..CHANGE
};
/// Learnt within 15 s: good headings again.
const LEARNT: Limits = Limits {
    rms_deg: Some(3.0),
    ..CHANGE
};
const LARGE: Limits = Limits {
    good: Some(0.8),
    ..LEARNT
};
const FAULT: Limits = Limits {
    told: Some((10.0, 0.99)),
    false_of_good: Some(0.02),
    ..NONE
};
const WEAK: Limits = Limits {
    told: None,
    ..FAULT
};
const BAD_TURN: Limits = Limits {
    accepted_right: true,
    false_share: Some(0.01),
    ..NONE
};
const CLEAN_TURN: Limits = Limits {
    accepted: Some(0.99),
    ..NONE
};
const REST: Limits = Limits {
    nerr: Some((0.5, 1.5)),
    false_share: Some(0.0),
    other: &[("drift", 3.0)],
    ..NONE
};

const fn family(
    name: &'static str,
    seeds: usize,
    limits: Limits,
    run: fn(&mut Rng, &mut Score),
) -> Family {
    Family {
        name,
        seeds,
        run,
        limits,
    }
}

/// In the order of the table.
#[rustfmt::skip]
pub const ALL: &[Family] = &[
    family("perfect_chips", 20, PERFECT, handled::perfect),
    family("tumbling", 500, TUMBLING, handled::tumbling),
    family("tumbling_untrimmed", 200, TUMBLING, handled::untrimmed),
    family("tumbling_in_bursts", 200, VEHICLE, handled::in_bursts),
    family("one_axis", 200, ONE_AXIS, handled::one_axis),
    family("place_known", 200, PLACE, handled::place_known),
    family("place_wrong", 200, PLACE, handled::place_wrong),
    family("car", 500, CAR, vehicles::car),
    family("car_untrimmed", 200, CAR, vehicles::untrimmed_car),
    family("car_on_hills", 500, CAR, vehicles::car_on_hills),
    family("motorway", 200, NOT_ALWAYS_GOOD, vehicles::motorway),
    family("boat", 500, VEHICLE, vehicles::boat),
    family("anchor", 500, VEHICLE, vehicles::anchor),
    family("drone", 500, VEHICLE, vehicles::drone),
    family("robot", 500, VEHICLE, vehicles::robot),
    family("fast_hand", 500, VEHICLE, handled::fast_hand),
    family("hand_with_silences", 200, NOT_ALWAYS_GOOD, handled::with_silences),
    family("fast_turns", 500, VEHICLE, vehicles::fast_car),
    family("change_magnet_at_rest", 500, CHANGE, changes::magnet_at_rest),
    family("change_magnet_in_motion", 500, LEARNT, changes::magnet_in_motion),
    family("change_large_magnet", 500, LARGE, changes::large_magnet),
    family("change_while_silent", 200, NOT_ALWAYS_GOOD, changes::while_silent),
    family("change_moved_iron", 500, VISIT, changes::moved_iron),
    family("change_gyro_flipped", 500, CHANGE, changes::flipped_gyro),
    family("change_gyro_hangs", 200, NOT_ALWAYS_GOOD, changes::hung_gyro),
    family("change_gyro_scaled", 200, CHANGE, changes::scaled_gyro),
    family("change_gyro_clipped", 500, CHANGE, changes::clipped_gyro),
    family("change_gyro_1_hz", 500, CHANGE, changes::slow_gyro),
    family("no_accelerometer", 500, CHANGE, changes::no_accelerometer),
    family("no_accelerometer_level", 500, VEHICLE, vehicles::blind_robot),
    family("wrong_gyro_misread", 200, CHANGE, handled::misread_gyro),
    family("wrong_gyro_negative", 200, CHANGE, handled::negative_gyro),
    family("wrong_gyro_mismounted", 200, CHANGE, handled::mismounted_gyro),
    family("wrong_gyro_swapped", 200, CHANGE, handled::swapped_gyro),
    family("wrong_gyro_turned", 200, CHANGE, handled::turned_gyro),
    family("wrong_mag_turned", 200, CHANGE, handled::turned_magnetometer),
    family("wrong_accel_turned", 200, CHANGE, handled::turned_accelerometer),
    family("warming_hand", 200, VEHICLE, handled::warming_hand),
    family("warming_at_rest", 200, WARMING_AT_REST, handled::warming_at_rest),
    family("warming_car", 200, VEHICLE, vehicles::warming_car),
    family("warming_robot", 200, VEHICLE, vehicles::warming_robot),
    family("fault_gyro_zero", 200, FAULT, faults::gyro_zero),
    family("fault_gyro_bias", 200, FAULT, faults::gyro_bias),
    family("fault_gyro_constant", 200, FAULT, faults::gyro_constant),
    family("fault_gyro_flipped", 200, FAULT, faults::gyro_flipped),
    family("fault_mag_frozen", 200, FAULT, faults::mag_frozen),
    family("fault_mag_axis_stuck", 200, FAULT, faults::mag_axis_stuck),
    family("fault_magnet_15_45_mG", 200, WEAK, faults::weak_magnet),
    family("fault_magnet_45_300_mG", 200, FAULT, faults::strong_magnet),
    family("turn_radius_beside_iron", 240, BAD_TURN, bad_turns::radius_beside_iron),
    family("turn_motor", 240, BAD_TURN, bad_turns::motor),
    family("turn_creep", 240, BAD_TURN, bad_turns::creep),
    family("turn_hum", 240, BAD_TURN, bad_turns::hum),
    family("turn_silent_clipping", 240, BAD_TURN, bad_turns::silent_clipping),
    family("turn_car_passing", 240, BAD_TURN, bad_turns::car_passing),
    family("turn_magnet_swept", 240, BAD_TURN, bad_turns::magnet_swept),
    family("turn_magnet_attached", 240, BAD_TURN, bad_turns::magnet_attached),
    family("turn_clean_by_hand", 240, CLEAN_TURN, bad_turns::clean_by_hand),
    family("turn_clean_on_stand", 240, CLEAN_TURN, bad_turns::clean_on_stand),
    family("rest_8_h", 20, REST, rest::eight_hours),
];
