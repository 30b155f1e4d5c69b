//! What a reload replaces: source, pipeline, store, recording, and what is known of the source.

use std::time::{Duration, Instant};

use super::DaemonError;
use super::calibrator::Calibrator;
use super::north::North;
use super::recorder::Recorder;
use super::sensor_store::{RunningStore, SensorStore};
use super::source_task::SourceTask;
use crate::config::Config;
use crate::config::source::Kind;
use crate::frame::Mounting;
use crate::pipeline::Pipeline;
use crate::recording::TimeOfDay;
use crate::store::Identity;

/// At a stop each of these in turn is waited for this long at most: a reload, the recording, the store.
pub(super) const DISK_PATIENCE: Duration = Duration::from_millis(600);

/// Everything between the device and the clients, under one configuration.
pub(super) struct Session {
    pub(super) config: Config,
    pub(super) source: SourceTask,
    pub(super) pipeline: Pipeline,
    pub(super) calibrator: Calibrator,
    pub(super) store: SensorStore,
    pub(super) recorder: Option<Recorder>,
    /// Gives a log's readings their time of day. `None` for other sources: their readings have the time at which they are handed out.
    pub(super) log_time: Option<TimeOfDay>,
    pub(super) north: North,
    /// The last reading's time on the source's clock, and when it was handed out.
    pub(super) last: (f64, Instant),
    /// The magnetic heading published last with the board mounted as it is now, degrees.
    pub(super) heading_deg: Option<f64>,
    pub(super) state: SourceState,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum SourceState {
    Good,
    /// It has a fault, and keeps trying.
    Faulty,
    Broken,
    /// At its end; and why there was no reading, or most could not be used, if so.
    Over(Option<String>),
}

impl Session {
    /// Loads what is kept of the source's sensor, and begins to record, if that is wanted. `running` is of
    /// the session that this one will follow. Waits for the disk.
    pub(super) fn open(
        source: SourceTask,
        config: Config,
        running: &RunningStore,
    ) -> Result<Box<Self>, DaemonError> {
        // A log and the simulated board say themselves how their chips are mounted.
        let header = &source.header;
        let sensor = header.sensor_name();
        let identity = Identity::new(sensor, header.mountings.mag);
        let name = &source.name;
        if config.source.is_live() {
            tracing::info!("{sensor} from {name}");
        } else {
            let pace = config.source.pace();
            tracing::info!("{sensor} from {name}, {pace} times real time");
        }
        let store = SensorStore::open(&config.store, identity, running)?;
        let recorder = Recorder::ring(&config.record, header.clone())?;
        let is_log = config.source.kind == Some(Kind::Replay);
        // On the heap: on the stack each move of its 28 kB touches as many pages again, and the daemon keeps them.
        Ok(Box::new(Self {
            pipeline: pipeline(&config, &source, &store),
            calibrator: Calibrator::default(),
            log_time: is_log.then(|| TimeOfDay::new(header)),
            north: North::new(&config),
            last: (0.0, Instant::now()),
            heading_deg: None,
            state: SourceState::Good,
            config,
            source,
            store,
            recorder,
        }))
    }

    /// Goes on from the calibrations and the position of the session before, and from what its source knows of its device. Returns
    /// whether the calibrations go on.
    pub(super) fn take_over(&mut self, last: &mut Self) -> bool {
        self.source.take_over(&mut last.source);
        let goes_on = self.store.take_over(&last.store);
        self.north.take_over(&mut last.north);
        self.pipeline = pipeline(&self.config, &self.source, &self.store);
        goes_on
    }

    /// Starts the source and the search for the position, and logs how the board is mounted. Needs a runtime.
    pub(super) fn start(&mut self) -> Result<(), DaemonError> {
        let configured = self.config.mounting.board();
        let history = self.store.history();
        let board = history.board(&configured);
        if board != Mounting::default() {
            tracing::info!("the board is mounted \"{}\"", board.rounded());
        }
        let told = history.mounting.as_ref();
        if told.is_some_and(|told| !told.holds(&configured)) {
            tracing::warn!(
                "[mounting] has changed: the mounting that the daemon was told before is no longer used"
            );
        }
        self.north.start();
        self.last.1 = Instant::now();
        self.source.start(self.config.source.pace())
    }

    /// Whether events of the source are taken. In accelerated time the fraction of a second that a calibration takes
    /// would be half a minute of headings: there the readings wait for it.
    pub(super) fn listens(&self) -> bool {
        matches!(self.state, SourceState::Good | SourceState::Faulty)
            && !(self.config.source.pace() > 1.0 && self.calibrator.is_busy())
    }

    /// Whether the source is at its end, and the last calibration on it has come back. A source that breaks is no end:
    /// clients shall see what is wrong.
    pub(super) fn is_over(&self) -> bool {
        matches!(self.state, SourceState::Over(_)) && !self.calibrator.is_busy()
    }

    /// Stops the session, flushing pending writes up to a deadline. An error says what the store could not keep.
    pub(super) async fn close(mut self: Box<Self>) -> Result<(), DaemonError> {
        self.source.stop().await;
        if let Some(recorder) = self.recorder.take() {
            recorder.close(DISK_PATIENCE).await;
        }
        self.store.close(DISK_PATIENCE).await
    }
}

fn pipeline(config: &Config, source: &SourceTask, store: &SensorStore) -> Pipeline {
    let history = store.history();
    let calibration = history.active().map(|entry| entry.record.calibration);
    let board = history.board(&config.mounting.board());
    Pipeline::new(config.setup(&source.header.mountings, &board), calibration)
}
