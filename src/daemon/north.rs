//! True north while the daemon runs: by the configuration, and by a gpsd that says where the compass is.

use std::time::Duration;

use crate::config::Config;
use crate::config::source::Kind;
use crate::position::{Follower, Gpsd};
use crate::true_north::TrueNorth;

pub(super) struct North {
    pub(super) true_north: TrueNorth,
    gpsd: Option<Gpsd>,
    follower: Option<Follower>,
}

impl North {
    /// A replayed log uses no gpsd: a gpsd knows where the log is replayed, not where it was recorded.
    pub(super) fn new(config: &Config) -> Self {
        let gpsd = Gpsd::parse(&config.true_north.gpsd);
        Self {
            true_north: TrueNorth::new(&config.true_north),
            gpsd: gpsd.filter(|_| config.source.kind != Some(Kind::Replay)),
            follower: None,
        }
    }

    /// Begins to ask the gpsd, if there is one that is not asked yet. Needs a runtime.
    pub(super) fn start(&mut self) {
        if self.follower.is_none() {
            self.follower = self.gpsd.clone().map(Follower::start);
        }
    }

    /// Goes on from before a reload with the gpsd, if it is the same one, and from the position that it gave last.
    pub(super) fn take_over(&mut self, last: &mut Self) {
        if self.gpsd == last.gpsd {
            self.follower = last.follower.take();
            if let Some(follower) = &mut self.follower {
                follower.renew();
            }
        }
    }

    /// The declination at this time of day, or else by the receiver's clock. What is new about it is logged.
    pub(super) fn declination_deg(&mut self, since_1970: Option<Duration>) -> Option<f64> {
        if let Some(position) = self.follower.as_mut().and_then(Follower::news) {
            self.true_north.put_position(position);
        }
        let since_1970 = since_1970.or_else(|| self.follower.as_ref()?.now());
        let declination_deg = self.true_north.declination_deg(since_1970);
        if let Some(news) = self.true_north.news() {
            if self.true_north.is_warning() {
                tracing::warn!("{news}");
            } else {
                tracing::info!("{news}");
            }
        }
        declination_deg
    }
}
