//! What a reload makes anew: source, store, pipeline and recording. Clients see nothing of it but their headings.

use super::journey::{Journey, Lasting};
use super::keeper::Keeper;
use super::recorder::Recorder;
use super::source::{Playing, Source};
use super::{DaemonError, SOURCE_PATIENCE, UNNAMED_SENSOR, join_for};
use crate::config::Config;
use crate::frame::Mounting;
use crate::pipeline::Pipeline;
use crate::store::{History, Identity, Store};

/// Everything between the device and the socket, ready to start.
pub(super) struct Parts {
    pub(super) source: Source,
    pub(super) recorder: Option<Recorder>,
    keeper: Keeper,
    pipeline: Pipeline,
}

impl Parts {
    /// Loads what is kept of the source's sensor; where there is nothing, what was `known` before stays, if it is of that
    /// sensor.
    pub(super) fn open(
        source: Source,
        config: &Config,
        known: Option<History>,
    ) -> Result<Self, DaemonError> {
        // A log and the simulated board say themselves how their chips are mounted.
        let header = source.header();
        let mountings = header.mountings;
        let sensor = header.sensor.as_deref().unwrap_or(UNNAMED_SENSOR);
        let identity = Identity {
            sensor: sensor.to_owned(),
            mag_axes: mountings.mag,
        };
        let name = source.name();
        if config.source.is_live() {
            tracing::info!("{sensor} from {name}");
        } else {
            tracing::info!(
                "{sensor} from {name}, {} times real time",
                config.source.pace()
            );
        }
        let recorder = Recorder::ring(&config.record, header)?;
        let mut keeper = Keeper::open(&config.store, identity)?;
        if let Some(known) = known {
            keeper.take_over(known);
        }
        let history = keeper.history();
        let calibration = history.in_force().map(|entry| entry.made.calibration);
        let configured = config.mounting.board();
        let board = history.board(&configured);
        if board != Mounting::default() {
            tracing::info!("the board is mounted \"{}\"", board.rounded());
        }
        if history
            .mounting
            .as_ref()
            .is_some_and(|told| !told.holds(&configured))
        {
            tracing::warn!(
                "[mounting] has changed: what headingd mounting told of the board before is not used any more"
            );
        }
        let mut setup = config.setup(&mountings);
        setup.mountings = mountings.on(&board);
        Ok(Self {
            pipeline: Pipeline::new(setup, calibration),
            source,
            recorder,
            keeper,
        })
    }
}

/// The parts at work.
pub(super) struct Course {
    pub(super) journey: Journey,
    pub(super) playing: Playing,
    config: Config,
}

impl Course {
    /// Starts the source.
    pub(super) fn start(
        parts: Parts,
        config: Config,
        lasting: Lasting,
    ) -> Result<Self, DaemonError> {
        let header = parts.source.header();
        lasting.publisher.board(&header);
        let source = parts.source.name();
        Ok(Self {
            playing: parts.source.start(config.source.pace())?,
            journey: Journey::new(
                parts.pipeline,
                parts.keeper,
                parts.recorder,
                &config,
                source,
                &header,
                lasting,
            ),
            config,
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
                let (lasting, known) = self.end();
                Self::start(Parts::open(source, &config, Some(known))?, config, lasting)
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

    /// Ends it, with everything on disk that the disk takes in time. What outlasts it is given back, and
    /// what was kept.
    pub(super) fn end(mut self) -> (Lasting, History) {
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
            match &change.now[..] {
                [] => tracing::info!("reloaded: nothing has changed"),
                keys => tracing::info!("reloaded: {}; headings go on as before", keys.join(", ")),
            }
            self.config = change.config;
            return Ok(None);
        }
        if let Some(directory) = change.config.store.directory() {
            Store::check_free(directory).map_err(|error| error.to_string())?;
        }
        let source = Source::open(&change.config).map_err(|error| error.to_string())?;
        tracing::info!("reloaded: {}", change.now.join(", "));
        Ok(Some((source, change.config)))
    }
}
