//! The folder in which calibrations are kept, and the thread that reads and writes there: a slow disk delays no heading.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError, TrySendError};
use std::time::Duration;

use super::DaemonError;
use super::remedy::with_remedy;
use super::thread::{Shared, Thread, lock};
use crate::publish::control::status::FolderSummary;
use crate::store::{CalibrationFile, History, Identity, Store, StoreError};

/// Pauses before a save that failed is tried again: the first, doubled each time up to the last. They are short, since other
/// programs compete for freed space.
const PAUSES: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(5));

/// How many jobs wait for the disk.
const WAITING_JOBS: usize = 16;

/// Called with the result of a save: an error says why nothing is on disk.
pub(super) type OnSaved = Box<dyn FnOnce(Result<(), String>) + Send>;

/// A folder and the thread that writes there. The sessions before and after a reload share it.
pub(super) struct StoreWriter {
    queue: mpsc::SyncSender<Job>,
    /// The newest history of each sensor, until the thread saves it.
    newest: Shared<CalibrationFile>,
    /// Ends with an error if something could not be saved.
    thread: Thread<Result<(), String>>,
    pub(super) directory: PathBuf,
    /// What is wrong with the store now, for people.
    fault: Shared<Option<String>>,
}

enum Job {
    Load(Identity, mpsc::Sender<Option<History>>),
    /// Saves all that is unsaved; the result told is that of this sensor's history.
    Save(Identity, OnSaved),
}

impl StoreWriter {
    pub(super) fn open(directory: &Path) -> Result<Self, DaemonError> {
        let (newest, fault) = (Shared::default(), Shared::default());
        let (store, error) = match Store::claim(directory) {
            // Each daemon would set aside the other's file as changed by somebody else.
            Err(error @ StoreError::InUse { .. }) => return Err(DaemonError::Store(error)),
            Err(error) => (None, Some(error)),
            Ok(store) => {
                let probed = store.probe();
                (Some(store), probed.err())
            }
        };
        if let Some(error) = &error {
            let message = with_remedy(error);
            tracing::error!(
                "{message}; headings are served, but calibrations are lost until that is done"
            );
            *lock(&fault) = Some(message);
        }
        let (queue, jobs) = mpsc::sync_channel(WAITING_JOBS);
        let writer = WriterThread {
            directory: directory.to_owned(),
            store,
            known: CalibrationFile::default(),
            newest: newest.clone(),
            unsaved: CalibrationFile::default(),
            reopen: error.is_some(),
            pause: PAUSES.0,
            fault: fault.clone(),
        };
        Ok(Self {
            queue,
            newest,
            thread: Thread::start("store", move || writer.run(&jobs))?,
            directory: directory.to_owned(),
            fault,
        })
    }

    /// Loads this sensor's history, including saves that are still queued.
    pub(super) fn load(&self, identity: Identity) -> Option<History> {
        let (sender, loaded) = mpsc::channel();
        // If the thread has failed, the next save reports that.
        self.queue.send(Job::Load(identity, sender)).ok()?;
        loaded.recv().ok()?
    }

    /// Queues this to be saved; `then` gets the result. Never waits.
    pub(super) fn save(&self, history: History, then: OnSaved) {
        let identity = history.identity.clone();
        lock(&self.newest).put(history);
        let (job, why) = match self.queue.try_send(Job::Save(identity, then)) {
            Ok(()) => return,
            // Not lost: any job still in the queue saves the newest histories.
            Err(TrySendError::Full(job)) => (job, "the disk hangs"),
            Err(TrySendError::Disconnected(job)) => (job, "the thread of the store has failed"),
        };
        if lock(&self.fault).replace(why.to_owned()).is_none() {
            tracing::error!("cannot keep calibrations: {why}");
        }
        if let Job::Save(_, then) = job {
            then(Err(why.to_owned()));
        }
    }

    pub(super) fn summary(&self) -> FolderSummary {
        FolderSummary::of(&self.directory, lock(&self.fault).clone())
    }

    /// Waits until everything is written, unless that takes longer than `patience`. An error says what stood in the way.
    pub(super) async fn close(self, patience: Duration) -> Result<(), DaemonError> {
        drop(self.queue);
        let ended = self.thread.end(patience).await;
        let ended = ended.ok_or(DaemonError::Unanswered)?;
        ended.map_err(DaemonError::NotKept)
    }
}

fn load(directory: &Path, identity: &Identity) -> Result<Option<History>, StoreError> {
    let contents = Store::contents(directory)?;
    let path = Store::file_in(directory);
    let path = path.display();
    let found = contents.find(identity);
    match found.map(|history| (history, history.active())) {
        Some((history, Some(entry))) => tracing::info!(
            number = entry.number,
            saved_unix_s = entry.record.saved_unix_s,
            mode = history.policy.word(),
            "using the {} calibration of {path}",
            entry.record.calibration.parameters.mode().word()
        ),
        Some((history, None)) => tracing::info!(
            "no calibration of {path} is active: {}",
            history.policy.remedy()
        ),
        None if contents.sensors.is_empty() => {
            // A folder that cannot be made has been complained of.
            if directory.is_dir() {
                tracing::info!("no calibration in {path} yet: turn the board once");
            }
        }
        None => tracing::warn!(
            "not using the calibration of {path}: it is of {}, but the sensor here is {identity}; the file stays as it is",
            contents.owners()
        ),
    }
    Ok(found.cloned())
}

/// Carries out the jobs. What could not be saved is tried again, and complained of once.
struct WriterThread {
    directory: PathBuf,
    store: Option<Store>,
    /// What the file holds of the sensors that were loaded or saved.
    known: CalibrationFile,
    newest: Shared<CalibrationFile>,
    unsaved: CalibrationFile,
    /// The next attempt opens the folder again, since another disk may be mounted there; the old lock is held until that has succeeded.
    reopen: bool,
    pause: Duration,
    fault: Shared<Option<String>>,
}

impl WriterThread {
    fn run(mut self, jobs: &mpsc::Receiver<Job>) -> Result<(), String> {
        loop {
            let failing = self.reopen || !self.unsaved.sensors.is_empty();
            let job = if failing {
                jobs.recv_timeout(self.pause)
            } else {
                jobs.recv().map_err(|_| RecvTimeoutError::Disconnected)
            };
            match job {
                Ok(Job::Load(identity, sender)) => {
                    // Nobody waits for it any more if the daemon ends.
                    let _ = sender.send(self.load(&identity));
                }
                Ok(Job::Save(identity, then)) => {
                    self.take_newest();
                    let result = self.attempt();
                    let is_saved = self.unsaved.find(&identity).is_none();
                    then(if is_saved { Ok(()) } else { result });
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.pause = (2 * self.pause).min(PAUSES.1);
                    // It has been told.
                    let _ = self.attempt();
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        if self.unsaved.sensors.is_empty() {
            return Ok(());
        }
        self.attempt()
    }

    fn take_newest(&mut self) {
        for history in std::mem::take(&mut *lock(&self.newest)).sensors {
            self.unsaved.put(history);
        }
    }

    fn load(&mut self, identity: &Identity) -> Option<History> {
        self.take_newest();
        if let Some(unsaved) = self.unsaved.find(identity) {
            return Some(unsaved.clone());
        }
        // What cannot be written may still be read.
        match load(&self.directory, identity) {
            Ok(loaded) => {
                if let Some(history) = &loaded {
                    self.known.put(history.clone());
                }
                loaded
            }
            Err(error) => {
                // A folder that cannot be used has been complained of.
                if self.store.is_some() || !matches!(error, StoreError::Read { .. }) {
                    let message = format!(
                        "{}; without it there is no calibration: turn the board once, or bring back a good file and restart; the next \
                         save (of a calibration, mode or mounting) sets this file aside",
                        with_remedy(&error)
                    );
                    tracing::error!("{message}");
                    lock(&self.fault).get_or_insert(message);
                }
                None
            }
        }
    }

    /// Saves what is unsaved; where nothing is, sees whether the folder works now.
    fn attempt(&mut self) -> Result<(), String> {
        let told = lock(&self.fault).is_some();
        match self.save() {
            Ok(()) => {
                if told {
                    tracing::info!(
                        "calibrations are kept in {} again",
                        self.directory.display()
                    );
                }
                self.pause = PAUSES.0;
                *lock(&self.fault) = None;
                Ok(())
            }
            Err(error) => {
                self.reopen = true;
                let message = with_remedy(&error);
                if !told {
                    tracing::error!(
                        "{message}; the active calibration stays active, but is lost if the daemon stops before a later attempt \
                         succeeds"
                    );
                }
                *lock(&self.fault) = Some(message.clone());
                Err(message)
            }
        }
    }

    fn save(&mut self) -> Result<(), StoreError> {
        let store = match &self.store {
            Some(store) if !self.reopen => store,
            // It is open before the last one is dropped: no other daemon gets the folder in between.
            _ => {
                let opened = Store::open(&self.directory)?;
                self.reopen = false;
                self.store.insert(opened)
            }
        };
        // One that cannot be saved is no obstacle to the others.
        let mut failed = None;
        self.unsaved.sensors.retain(|history| {
            let known = self.known.find(&history.identity);
            match store.save(history, known) {
                Ok(Some(aside)) => {
                    let aside = aside.display();
                    tracing::warn!(
                        "set aside the file that was there, since it was unusable or changed by somebody else: {aside}; if it is good, import \
                         its active calibration with headingd calibration import"
                    );
                }
                Ok(None) => {}
                Err(error) => {
                    failed.get_or_insert(error);
                    return true;
                }
            }
            tracing::info!("kept the calibrations in {}", self.directory.display());
            self.known.put(history.clone());
            false
        });
        failed.map_or(Ok(()), Err)
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};

    use super::*;
    use crate::frame::Mounting;

    fn thread(folder: &Path) -> WriterThread {
        WriterThread {
            directory: folder.to_owned(),
            store: Some(Store::open(folder).unwrap()),
            known: CalibrationFile::default(),
            newest: Shared::default(),
            unsaved: CalibrationFile::default(),
            reopen: false,
            pause: PAUSES.0,
            fault: Shared::default(),
        }
    }

    #[test]
    fn a_disk_that_hangs_keeps_the_newest_history_once_it_answers() {
        let folder = tempfile::tempdir().unwrap();
        let (queue, jobs) = mpsc::sync_channel(1);
        let writer = StoreWriter {
            queue,
            newest: Shared::default(),
            thread: Thread::start("test", || Ok(())).unwrap(),
            directory: folder.path().to_owned(),
            fault: Shared::default(),
        };
        let identity = Identity::new("hmc5843", Mounting::default());
        let (sender, answers) = mpsc::channel();
        for last_number in [1, 2] {
            let history = History {
                last_number,
                ..History::new(identity.clone())
            };
            let sender = sender.clone();
            writer.save(history, Box::new(move |kept| sender.send(kept).unwrap()));
        }
        assert_eq!(
            answers.try_recv().unwrap(),
            Err("the disk hangs".to_owned())
        );
        assert_eq!(writer.summary().state, "failing");

        let thread = WriterThread {
            newest: writer.newest.clone(),
            fault: writer.fault.clone(),
            ..thread(folder.path())
        };
        drop(writer.queue);
        thread.run(&jobs).unwrap();
        assert_eq!(answers.try_recv().unwrap(), Ok(()));
        assert_eq!(*lock(&writer.fault), None);
        let kept = Store::contents(folder.path()).unwrap();
        assert_eq!(kept.find(&identity).unwrap().last_number, 2);
    }

    #[test]
    fn a_history_that_cannot_be_saved_hinders_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let mut thread = thread(folder.path());
        let new = |sensor| History::new(Identity::new(sensor, Mounting::default()));
        let good = new("qmc5883l");
        thread.unsaved.put(good.clone());
        thread.unsaved.put(History {
            last_number: u64::MAX,
            ..new("hmc5843")
        });
        let (queue, jobs) = mpsc::sync_channel(1);
        let (sender, answers) = mpsc::channel();
        let then = Box::new(move |saved| sender.send(saved).unwrap());
        let job = Job::Save(good.identity.clone(), then);
        assert!(queue.send(job).is_ok());
        drop(queue);
        let lost = thread.run(&jobs).unwrap_err();
        assert!(lost.contains("last_number"), "{lost}");
        assert_eq!(answers.recv().unwrap(), Ok(()));
        let kept = Store::contents(folder.path()).unwrap();
        assert_eq!(kept.find(&good.identity), Some(&good));
    }

    #[test]
    fn a_folder_without_room_stays_locked() {
        let folder = tempfile::tempdir().unwrap();
        let is_locked = || {
            let lock = File::open(folder.path().join(".lock"));
            lock.unwrap().try_lock().is_err()
        };
        // A folder of this name cannot be removed as a file is, so that no store is opened here.
        let obstacle = folder.path().join(".calibration.json.x.tmp");
        let mut thread = thread(folder.path());
        fs::create_dir(&obstacle).unwrap();
        thread.reopen = true;
        for _ in 0..2 {
            thread.attempt().unwrap_err();
            assert!(is_locked());
        }
        drop(thread);

        let writer = StoreWriter::open(folder.path()).unwrap();
        assert_eq!(writer.summary().state, "failing");
        assert!(is_locked());
        fs::remove_dir(&obstacle).unwrap();
        let (sender, answers) = mpsc::channel();
        let history = History::new(Identity::new("hmc5843", Mounting::default()));
        writer.save(history, Box::new(move |kept| sender.send(kept).unwrap()));
        assert_eq!(answers.recv().unwrap(), Ok(()));
        assert!(is_locked());
    }
}
