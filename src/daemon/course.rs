//! What a reload makes anew: source, store, pipeline and recording. Clients see nothing of it but their headings.

use super::journey::{Journey, Lasting};
use super::keeper::Keeper;
use super::recorder::Recorder;
use super::source::{Playing, Source};
use super::{DaemonError, SOURCE_PATIENCE, UNNAMED_SENSOR, join_for};
use crate::calibration::model::Calibration;
use crate::config::Config;
use crate::pipeline::Pipeline;
use crate::store::Identity;

/// Everything between the device and the socket, ready to start.
pub(super) struct Parts {
    pub(super) source: Source,
    pub(super) recorder: Option<Recorder>,
    keeper: Keeper,
    identity: Identity,
    pipeline: Pipeline,
}

impl Parts {
    /// Loads the calibration kept for the source's sensor; without one, `in_force` is used if it is of that sensor.
    pub(super) fn open(
        source: Source,
        config: &Config,
        in_force: Option<(Identity, Calibration)>,
    ) -> Result<Self, DaemonError> {
        // A log and the simulated board say themselves how their chips are mounted.
        let header = source.header();
        let identity = Identity {
            sensor: header.sensor.unwrap_or_else(|| UNNAMED_SENSOR.to_owned()),
            mag_axes: header.mountings.mag,
        };
        tracing::info!(
            "{} from {}, {} times real time",
            identity.sensor,
            source.name(),
            config.source.pace()
        );
        let recorder = Recorder::ring(&config.record, source.header())?;
        let (keeper, kept) = Keeper::open(config.store.directory(), identity.clone())?;
        let in_force = in_force.filter(|(of, _)| *of == identity);
        let calibration = kept.or(in_force.map(|(_, calibration)| calibration));
        Ok(Self {
            pipeline: Pipeline::new(config.setup(header.mountings), calibration),
            source,
            recorder,
            keeper,
            identity,
        })
    }
}

/// The parts at work.
pub(super) struct Course {
    pub(super) journey: Journey,
    pub(super) playing: Playing,
    config: Config,
    identity: Identity,
}

impl Course {
    /// Starts the source.
    pub(super) fn start(
        parts: Parts,
        config: Config,
        lasting: Lasting,
    ) -> Result<Self, DaemonError> {
        Ok(Self {
            playing: parts.source.start(config.source.pace())?,
            journey: Journey::new(
                parts.pipeline,
                parts.keeper,
                parts.recorder,
                &config.source,
                lasting,
            ),
            config,
            identity: parts.identity,
        })
    }

    /// Goes on with this configuration, or as before if it cannot be had. What stands in the way is logged.
    pub(super) fn reload(
        mut self,
        wanted: Result<Box<Config>, String>,
    ) -> Result<Self, DaemonError> {
        self.journey.lasting.service.reloading();
        match wanted.and_then(|wanted| self.prepare(&wanted)) {
            Ok(Some((source, config))) => {
                let identity = self.identity.clone();
                let (lasting, calibration) = self.end();
                let in_force = calibration.map(|calibration| (identity, calibration));
                Self::start(Parts::open(source, &config, in_force)?, config, lasting)
            }
            Ok(None) => {
                self.journey.lasting.service.ready();
                Ok(self)
            }
            Err(message) => {
                tracing::error!("not reloaded, all goes on as before: {message}");
                self.journey.lasting.service.ready();
                Ok(self)
            }
        }
    }

    /// Ends it, with everything on disk that the disk takes in time. What outlasts it is given back, and the
    /// calibration in force.
    pub(super) fn end(mut self) -> (Lasting, Option<Calibration>) {
        self.playing.stop();
        join_for("source", self.playing.thread, SOURCE_PATIENCE);
        self.journey.close()
    }

    /// The source that is wanted, and its configuration; `None` if what runs is as wanted.
    fn prepare(&mut self, wanted: &Config) -> Result<Option<(Source, Config)>, String> {
        let change = self
            .config
            .change(wanted)
            .map_err(|error| error.to_string())?;
        if !change.at_start.is_empty() {
            tracing::warn!(
                "changes only with a restart: {}",
                change.at_start.join(", ")
            );
        }
        // The log has its new filter already.
        if change.now.iter().all(|key| key.starts_with("log.")) {
            tracing::info!("reloaded; headings go on as before");
            self.config = change.config;
            return Ok(None);
        }
        let source = Source::open(&change.config).map_err(|error| error.to_string())?;
        tracing::info!("reloaded: {}", change.now.join(", "));
        Ok(Some((source, change.config)))
    }
}
