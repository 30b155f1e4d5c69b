//! The calibrations of one sensor: in memory for everybody, and on disk where they are to be kept.

use std::sync::{Arc, Weak};
use std::time::Duration;

use super::DaemonError;
use super::store_writer::{OnSaved, StoreWriter};
use crate::publish::control::status::FolderSummary;
use crate::store::{CalibrationRecord, History, Identity, Settings};

/// What the next session needs to know of the running one; keeps nothing open.
#[derive(Default)]
pub(super) struct RunningStore {
    writer: Weak<StoreWriter>,
    identity: Option<Identity>,
}

/// The history of one sensor's calibrations, and the writer that keeps it, if one does.
pub(super) struct SensorStore {
    history: History,
    most: usize,
    changed: bool,
    writer: Option<Arc<StoreWriter>>,
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
        let writer = match (settings.directory(), running.writer.upgrade()) {
            (None, _) => {
                tracing::info!("no store: calibrations are neither read nor kept");
                None
            }
            (Some(directory), Some(writer)) if writer.directory == directory => {
                in_memory = running.identity.as_ref() == Some(&identity);
                Some(writer)
            }
            (Some(directory), running) => {
                // Drop our reference first: only whoever holds the last one waits for the disk at shutdown.
                drop(running);
                Some(Arc::new(StoreWriter::open(directory)?))
            }
        };
        let loading = writer.as_ref().filter(|_| !in_memory);
        let loaded = loading.and_then(|writer| writer.load(identity.clone()));
        Ok(Self {
            history: loaded.unwrap_or_else(|| History::new(identity)),
            most: settings.history,
            changed: false,
            writer,
        })
    }

    pub(super) fn running(&self) -> RunningStore {
        RunningStore {
            writer: self.writer.as_ref().map(Arc::downgrade).unwrap_or_default(),
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

    /// Takes over the history of the session before a reload, unless the sensor has changed or the new folder has a history of its own.
    /// Returns whether it did.
    pub(super) fn take_over(&mut self, last: &Self) -> bool {
        let (here, there) = (self.writer.as_ref(), last.writer.as_ref());
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

    /// Saves the history as it is now; `then` gets the result, at once if there is no writer.
    pub(super) fn save(&self, then: OnSaved) {
        match &self.writer {
            Some(writer) => writer.save(self.history.clone(), then),
            None => then(Ok(())),
        }
    }

    pub(super) fn summary(&self) -> FolderSummary {
        let writer = self.writer.as_ref();
        writer.map_or_else(FolderSummary::off, |writer| writer.summary())
    }

    /// Whether another session has the same writer.
    pub(super) fn is_shared(&self) -> bool {
        let writer = self.writer.as_ref();
        writer.is_some_and(|writer| Arc::strong_count(writer) > 1)
    }

    /// Waits until everything is on disk, unless that takes longer than `patience`, or another session goes on writing
    /// there. An error says what could not be kept.
    pub(super) async fn close(self, patience: Duration) -> Result<(), DaemonError> {
        match self.writer.and_then(Arc::into_inner) {
            Some(writer) => writer.close(patience).await,
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
