//! The calibrations of one sensor: in memory for everybody, and on disk where they are to be kept.

use std::sync::{Arc, Weak};
use std::time::Duration;

use super::DaemonError;
use super::disk::{Disk, OnSaved};
use crate::publish::control::status::FolderSummary;
use crate::store::{CalibrationRecord, History, Identity, Settings};

/// What a session that is to follow has to know of the one that is running. Holds nothing open.
#[derive(Default)]
pub(super) struct RunningStore {
    disk: Weak<Disk>,
    identity: Option<Identity>,
}

/// The history of one sensor's calibrations, and the disk that keeps it, if any does.
pub(super) struct SensorStore {
    history: History,
    most: usize,
    changed: bool,
    disk: Option<Arc<Disk>>,
}

impl SensorStore {
    /// Loads what the folder has of this sensor, unless `running` has it in memory. Whatever is wrong with the folder is
    /// logged. Waits for the disk.
    pub(super) fn open(
        settings: &Settings,
        identity: Identity,
        running: &RunningStore,
    ) -> Result<Self, DaemonError> {
        let mut in_memory = false;
        let disk = match (settings.directory(), running.disk.upgrade()) {
            (None, _) => {
                tracing::info!("no store: calibrations are neither read nor kept");
                None
            }
            (Some(directory), Some(disk)) if disk.directory == directory => {
                in_memory = running.identity.as_ref() == Some(&identity);
                Some(disk)
            }
            (Some(directory), running) => {
                // Drop our reference first: only whoever holds the last one waits for the disk at shutdown.
                drop(running);
                Some(Arc::new(Disk::open(directory)?))
            }
        };
        let loading = disk.as_ref().filter(|_| !in_memory);
        let loaded = loading.and_then(|disk| disk.load(identity.clone()));
        Ok(Self {
            history: loaded.unwrap_or_else(|| History::new(identity)),
            most: settings.history,
            changed: false,
            disk,
        })
    }

    pub(super) fn running(&self) -> RunningStore {
        RunningStore {
            disk: self.disk.as_ref().map(Arc::downgrade).unwrap_or_default(),
            identity: Some(self.history.identity.clone()),
        }
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

    /// Goes on from the history of the session before a reload, unless another folder has one of its own, or the sensor is another. Returns
    /// whether it does.
    pub(super) fn take_over(&mut self, last: &Self) -> bool {
        let (here, there) = (self.disk.as_ref(), last.disk.as_ref());
        let same = here.map(Arc::as_ptr) == there.map(Arc::as_ptr);
        let new = self.history == History::new(self.history.identity.clone());
        let goes_on = last.history.identity == self.history.identity && (same || new);
        if goes_on {
            self.history = last.history.clone();
            if !same {
                self.save(Box::new(|_| ()));
            }
        }
        goes_on
    }

    /// Makes a calibration the active one, in memory until [`SensorStore::save`]; returns its number.
    pub(super) fn keep(&mut self, record: CalibrationRecord) -> u64 {
        let most = self.most;
        self.history_mut().keep(record, most);
        self.history.last_number
    }

    /// Saves the history as it is now; `then` gets the result, at once if there is no disk.
    pub(super) fn save(&self, then: OnSaved) {
        match &self.disk {
            Some(disk) => disk.save(self.history.clone(), then),
            None => then(Ok(())),
        }
    }

    pub(super) fn summary(&self) -> FolderSummary {
        let disk = self.disk.as_ref();
        disk.map_or_else(FolderSummary::off, |disk| disk.summary())
    }

    /// Whether another session has the same disk.
    pub(super) fn is_shared(&self) -> bool {
        let disk = self.disk.as_ref();
        disk.is_some_and(|disk| Arc::strong_count(disk) > 1)
    }

    /// Waits until everything is on disk, unless that takes longer than `patience`, or another session goes on writing
    /// there. An error says what could not be kept.
    pub(super) async fn close(self, patience: Duration) -> Result<(), DaemonError> {
        match self.disk.and_then(Arc::into_inner) {
            Some(disk) => disk.close(patience).await,
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::policy::Policy;
    use crate::frame::Mounting;

    #[tokio::test]
    async fn a_reload_takes_calibrations_along_and_replaces_nothing_of_another_folder() {
        let folder = tempfile::tempdir().unwrap();
        let open = |name, running: &RunningStore| {
            let settings = Settings {
                directory: folder.path().join(name),
                ..Settings::default()
            };
            let identity = Identity::new("hmc5843", Mounting::default());
            SensorStore::open(&settings, identity, running).unwrap()
        };
        for (name, policy, last_number) in [("backup", Policy::On, 3), ("off", Policy::Off, 0)] {
            let mut other = open(name, &RunningStore::default());
            other.history_mut().policy = policy;
            other.history_mut().last_number = last_number;
            other.save(Box::new(|_| ()));
            other.close(Duration::from_secs(30)).await.unwrap();
        }
        let mut here = open("here", &RunningStore::default());
        here.history_mut().last_number = 5;
        for (name, right) in [("here", 5), ("backup", 3), ("off", 0), ("new", 5)] {
            let mut next = open(name, &here.running());
            next.take_over(&here);
            assert_eq!(next.history().last_number, right, "{name}");
            let is_off = next.history().policy == Policy::Off;
            assert_eq!(is_off, name == "off", "{name}");
        }
    }
}
