//! The estimate during a fault of the gyro.

use super::filter::{Filter, Input};
use super::iron_watch::IronWatch;
use super::{Estimate, GyroFault, fresh};

/// A fault of the gyro that clears within this much motion, seconds, was a false alarm: accelerations of a hand, or a magnet.
const FALSE_ALARM_S: f64 = 5.0;

/// The filter that was active when the gyro failed. It goes on, for the check of the gyro.
pub(super) struct Suspended {
    pub(super) filter: Filter,
    moved_s: f64,
    /// The fault was that the gyro did not measure at all.
    dead: bool,
    /// The gyro repeated its reading when the fault began.
    hung: bool,
}

impl Estimate {
    /// Takes a sample during a fault of the gyro, or the first after it. The first sample of a fault suspends the active filter, and the
    /// filter of when the gyro was last shown to be right takes its place. The suspended one follows the samples, and returns if
    /// the fault clears within `FALSE_ALARM_S` of motion. Returns whether a gyro that did not measure does so again.
    pub(super) fn follow_gyro_fault(&mut self, input: &Input, lost: bool) -> bool {
        let recovered = match self.suspended.take() {
            Some(mut suspended) if self.gyro.fault().is_some() => {
                let filter = &mut suspended.filter;
                let known = filter.iron_known_within(filter.strength_mgauss());
                filter.follow(input, lost, self.parameters_fixed || known);
                suspended.dead = self.gyro.fault() == Some(GyroFault::Dead);
                // A dead gyro cannot show that the board is still.
                if suspended.dead || !input.board.still {
                    suspended.moved_s += input.period_s;
                }
                self.suspended = Some(suspended);
                return false;
            }
            Some(suspended) if suspended.moved_s < FALSE_ALARM_S => {
                self.active = suspended.filter;
                suspended.hung
            }
            Some(suspended) => suspended.dead,
            None => {
                let hung = self.forget_hung_gyro();
                let unproven = || fresh(self.kept.as_ref(), &self.mounting);
                let proven = self.proven.clone().unwrap_or_else(unproven);
                self.suspended = Some(Box::new(Suspended {
                    filter: std::mem::replace(&mut self.active, proven),
                    moved_s: 0.0,
                    dead: false,
                    hung,
                }));
                false
            }
        };
        // The active filter was replaced: its iron differs, but nothing has moved.
        self.iron = IronWatch::default();
        self.lose_frame();
        recovered
    }

    /// Whether anything is known, by motion or by a calibration. A suspended filter counts while it may come back.
    pub fn knows(&self) -> bool {
        let may_come_back = (self.suspended.as_ref())
            .is_some_and(|one| one.filter.begun && one.moved_s < FALSE_ALARM_S);
        may_come_back || self.active.begun || self.kept.is_some()
    }
}

/// The filter that follows the samples.
pub(super) fn filter_taking_samples<'a>(
    active: &'a Filter,
    suspended: Option<&'a Suspended>,
) -> &'a Filter {
    suspended.map_or(active, |one| &one.filter)
}
