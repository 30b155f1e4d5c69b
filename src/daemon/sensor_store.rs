//! The calibrations of one sensor: in memory for everybody, and on disk where they are to be kept.

use std::sync::{Arc, Weak};
use std::time::Duration;

use super::DaemonError;
use super::disk::{Disk, Then};
use crate::publish::control::status::StoreSummary;
use crate::store::{History, Identity, Made, Settings};

/// The history of one sensor's calibrations, and the disk that keeps it, if any does.
pub(super) struct SensorStore {
    history: History,
    most: usize,
    changed: bool,
    disk: Option<Arc<Disk>>,
}

impl SensorStore {
    /// Loads what the folder has of this sensor; `running` writes there already, if it is the same folder. Whatever is
    /// wrong with it is logged. Waits for the disk.
    pub(super) fn open(
        settings: &Settings,
        identity: Identity,
        running: &Weak<Disk>,
    ) -> Result<Self, DaemonError> {
        let disk = match (settings.directory(), running.upgrade()) {
            (None, _) => {
                tracing::info!("store.directory is empty: calibrations are not kept");
                None
            }
            (Some(directory), Some(disk)) if disk.directory == directory => Some(disk),
            (Some(directory), running) => {
                // The end of the daemon waits for whoever holds the last reference.
                drop(running);
                Some(Arc::new(Disk::open(directory)?))
            }
        };
        let loaded = disk.as_ref().and_then(|disk| disk.load(identity.clone()));
        Ok(Self {
            history: loaded.unwrap_or_else(|| History::new(identity)),
            most: settings.history,
            changed: false,
            disk,
        })
    }

    pub(super) fn disk(&self) -> Weak<Disk> {
        self.disk.as_ref().map(Arc::downgrade).unwrap_or_default()
    }

    pub(super) fn history(&self) -> &History {
        &self.history
    }

    /// What is kept, to be changed; [`SensorStore::save`] makes it last.
    pub(super) fn history_mut(&mut self) -> &mut History {
        self.changed = true;
        &mut self.history
    }

    /// Whether the history may have been changed since this was last asked.
    pub(super) fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// Goes on from the history of the session before a reload, which was `loaded` when this was opened, unless the
    /// folder knows better.
    pub(super) fn take_over(&mut self, last: &History, loaded: &History) {
        let (here, there) = (self.history.last_number, last.last_number);
        let told = there == here && last.mounting != self.history.mounting;
        let newer = last != loaded || there > here || told;
        if last.identity == self.history.identity && newer {
            self.history = last.clone();
            self.save(Box::new(|_| ()));
        }
    }

    /// Makes a calibration the active one, until [`SensorStore::save`] only in memory; its number.
    pub(super) fn keep(&mut self, made: Made) -> u64 {
        let most = self.most;
        self.history_mut().keep(made, most);
        self.history.last_number
    }

    /// Has everything saved as it is now, and says so to `then`: at once, if nothing is to be kept.
    pub(super) fn save(&self, then: Then) {
        match &self.disk {
            Some(disk) => disk.save(self.history.clone(), then),
            None => then(Ok(())),
        }
    }

    pub(super) fn summary(&self) -> StoreSummary {
        match &self.disk {
            Some(disk) => disk.summary(),
            None => StoreSummary {
                state: "off".to_owned(),
                ..StoreSummary::default()
            },
        }
    }

    /// Waits until everything is on disk, unless that takes longer than `patience`, or another session goes on writing
    /// there.
    pub(super) async fn close(self, patience: Duration) {
        if let Some(disk) = self.disk.and_then(Arc::into_inner) {
            disk.close(patience).await;
        }
    }
}
