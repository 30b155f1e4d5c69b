//! What is kept of one sensor: in memory for everybody, and on disk by a thread of its own, so that a slow disk delays
//! no heading.

use std::path::PathBuf;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::{DaemonError, spawn};
use crate::store::{History, Identity, Loaded, Settings, Store, StoreError};

/// Pauses before a save that failed is tried again: the first, doubled each time up to the last.
const PAUSES: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

/// Told when something is on disk, or why it is not.
pub(super) type Then = Box<dyn FnOnce(Result<(), String>) + Send>;

/// What keeps the calibrations of one sensor.
pub(super) struct Keeper {
    history: History,
    most: usize,
    disk: Option<Disk>,
}

struct Disk {
    /// Unbounded, but a calibration takes a turn of the board and has a few hundred bytes, and whoever asks for a
    /// change waits for it.
    queue: mpsc::Sender<Order>,
    thread: JoinHandle<()>,
    directory: PathBuf,
    trouble: Trouble,
}

struct Order {
    history: History,
    then: Then,
}

/// What is wrong with the store now, for people.
#[derive(Clone, Default)]
struct Trouble(Arc<Mutex<Option<String>>>);

impl Trouble {
    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How the store does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum StoreState {
    /// Nothing is to be kept.
    Off,
    /// What is to be kept is in this folder.
    Good(PathBuf),
    /// Something is wrong with this folder, for people.
    Failing(PathBuf, String),
}

impl Keeper {
    /// Looks into the folder for what is kept of this sensor. Whatever is wrong with it is logged.
    pub(super) fn open(settings: &Settings, identity: Identity) -> Result<Self, DaemonError> {
        let most = settings.history;
        let Some(directory) = settings.directory() else {
            tracing::info!("store.directory is empty: calibrations are not kept");
            return Ok(Self {
                history: History::new(identity),
                most,
                disk: None,
            });
        };
        let trouble = Trouble::default();
        let opened = match Store::open(directory) {
            // Each would take the other's calibrations for a mistake.
            Err(error @ StoreError::InUse { .. }) => return Err(DaemonError::Store(error)),
            opened => opened,
        };
        if let Err(error) = &opened {
            let message = with_remedy(error);
            tracing::error!("{message}; until then headings are served, but calibrations are lost");
            *trouble.lock() = Some(message);
        }
        // What cannot be written may still be read.
        let store = Store::unchecked(directory);
        let known = load(&store, &identity).unwrap_or_else(|error| {
            // A folder that cannot be used has been complained of.
            if opened.is_ok() || !matches!(error, StoreError::Read { .. }) {
                tracing::error!(
                    "{error}; starting without a calibration: turn the board once, or bring back a good file; \
                     this one is set aside when there is a new calibration"
                );
                trouble.lock().get_or_insert(error.to_string());
            }
            None
        });
        let (queue, orders) = mpsc::channel();
        let writer = Writer {
            directory: directory.to_owned(),
            store: opened.ok(),
            known: known.clone(),
            unsaved: None,
            pause: PAUSES.0,
            trouble: trouble.clone(),
        };
        Ok(Self {
            history: known.unwrap_or_else(|| History::new(identity)),
            most,
            disk: Some(Disk {
                queue,
                thread: spawn("store", "store", move || writer.run(&orders))?,
                directory: directory.to_owned(),
                trouble,
            }),
        })
    }

    /// What is kept.
    pub(super) fn history(&self) -> &History {
        &self.history
    }

    /// What is kept, to be changed; [`Keeper::save`] makes it last.
    pub(super) fn history_mut(&mut self) -> &mut History {
        &mut self.history
    }

    /// Goes on from what was kept before a reload, unless the folder knows better.
    pub(super) fn take_over(&mut self, known: History) {
        let (here, there) = (self.history.last_number, known.last_number);
        let told = there == here && known.mounting != self.history.mounting;
        if known.identity == self.history.identity && (there > here || told) {
            self.history = known;
            self.save(Box::new(|_| ()));
        }
    }

    /// How many calibrations are kept.
    pub(super) fn most(&self) -> usize {
        self.most
    }

    /// Has everything saved as it is now, and says so to `then`: at once, if nothing is to be kept.
    pub(super) fn save(&self, then: Then) {
        let Some(disk) = &self.disk else {
            return then(Ok(()));
        };
        let order = Order {
            history: self.history.clone(),
            then,
        };
        if let Err(mpsc::SendError(order)) = disk.queue.send(order) {
            let message = "the thread of the store has failed".to_owned();
            tracing::error!("cannot keep calibrations: {message}");
            *disk.trouble.lock() = Some(message.clone());
            (order.then)(Err(message));
        }
    }

    /// How the store does.
    pub(super) fn state(&self) -> StoreState {
        let Some(disk) = &self.disk else {
            return StoreState::Off;
        };
        let directory = disk.directory.clone();
        match disk.trouble.lock().clone() {
            None => StoreState::Good(directory),
            Some(message) => StoreState::Failing(directory, message),
        }
    }

    /// Waits until everything is on disk.
    pub(super) fn close(self) {
        if let Some(Disk { queue, thread, .. }) = self.disk {
            drop(queue);
            if thread.join().is_err() {
                tracing::error!("the thread of the store panicked");
            }
        }
    }
}

/// The error, and what helps if it is the folder.
fn with_remedy(error: &StoreError) -> String {
    match error {
        StoreError::Directory { .. } => format!(
            "{error}; make room on the disk, set store.directory to a folder that this user may write, or start the \
             daemon with StateDirectory=headingd in its systemd unit"
        ),
        other => other.to_string(),
    }
}

fn load(store: &Store, identity: &Identity) -> Result<Option<History>, StoreError> {
    let path = store.path();
    let path = path.display();
    match store.load(identity)? {
        Loaded::Found(history) => {
            match history.in_force() {
                Some(entry) => tracing::info!(
                    number = entry.number,
                    saved_unix_s = entry.made.saved_unix_s,
                    mode = history.mode.word(),
                    "using the {} calibration of {path}",
                    entry.made.calibration.parameters.mode().word()
                ),
                None => tracing::info!(
                    "no calibration of {path} is in force: {}",
                    history.mode.remedy()
                ),
            }
            return Ok(Some(history));
        }
        Loaded::None => tracing::info!("no calibration in {path} yet: turn the board once"),
        Loaded::Others(others) => {
            let others: Vec<String> = others
                .iter()
                .map(|other| format!("of {} mounted \"{}\"", other.sensor, other.mag_axes))
                .collect();
            tracing::warn!(
                "not using the calibration of {path}: it is {}, and this is {} mounted \"{}\"; it stays there",
                others.join(" and "),
                identity.sensor,
                identity.mag_axes
            );
        }
    }
    Ok(None)
}

/// Saves what comes. What could not be saved is tried again, and complained of once.
struct Writer {
    directory: PathBuf,
    store: Option<Store>,
    /// What the file holds of this sensor.
    known: Option<History>,
    unsaved: Option<History>,
    pause: Duration,
    trouble: Trouble,
}

impl Writer {
    fn run(mut self, orders: &mpsc::Receiver<Order>) {
        loop {
            let failing = self.unsaved.is_some() || self.store.is_none();
            let order = if failing {
                orders.recv_timeout(self.pause)
            } else {
                orders.recv().map_err(|_| RecvTimeoutError::Disconnected)
            };
            match order {
                Ok(Order { history, then }) => {
                    self.unsaved = Some(history);
                    then(self.attempt());
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.pause = (2 * self.pause).min(PAUSES.1);
                    // It has been told.
                    let _ = self.attempt();
                }
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        if self.unsaved.is_some() && self.attempt().is_err() {
            tracing::error!("the last calibration or setting could not be kept, and is lost");
        }
    }

    /// Saves what is unsaved; where nothing is, sees whether the folder works now.
    fn attempt(&mut self) -> Result<(), String> {
        let told = self.trouble.lock().is_some();
        match self.save() {
            Ok(()) => {
                if told {
                    tracing::info!(
                        "calibrations are kept in {} again",
                        self.directory.display()
                    );
                }
                self.pause = PAUSES.0;
                *self.trouble.lock() = None;
                Ok(())
            }
            Err(error) => {
                self.store = None;
                let message = with_remedy(&error);
                if !told {
                    tracing::error!(
                        "{message}; what is in force stays in force, but is lost when the daemon stops: make room \
                         on the disk, or see to the folder's permissions; it is tried again"
                    );
                }
                *self.trouble.lock() = Some(message.clone());
                Err(message)
            }
        }
    }

    fn save(&mut self) -> Result<(), StoreError> {
        let store = match &mut self.store {
            Some(store) => store,
            none => none.insert(Store::open(&self.directory)?),
        };
        if let Some(history) = &self.unsaved {
            if let Some(aside) = store.save(history, self.known.as_ref())? {
                tracing::warn!("set aside the file that was there: {}", aside.display());
            }
            tracing::info!("kept the calibrations in {}", self.directory.display());
            self.known = self.unsaved.take();
        }
        Ok(())
    }
}
