//! Keeps accepted calibrations on disk, on a thread of its own: a slow disk delays no heading.

use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::SystemTime;

use super::{DaemonError, spawn};
use crate::calibration::model::Calibration;
use crate::store::{Identity, Loaded, Store, StoreError, Stored};

/// What keeps the calibrations of one sensor.
pub(super) struct Keeper {
    identity: Identity,
    disk: Option<Disk>,
}

struct Disk {
    /// Unbounded, but a calibration takes a turn of the board and has a few hundred bytes.
    queue: mpsc::Sender<Stored>,
    thread: JoinHandle<()>,
}

impl Keeper {
    /// Looks into the folder, and gives back the calibration that it holds for this sensor. Whatever is wrong
    /// with it is logged.
    pub(super) fn open(
        directory: Option<&Path>,
        identity: Identity,
    ) -> Result<(Self, Option<Calibration>), DaemonError> {
        let Some(directory) = directory else {
            tracing::info!("store.directory is empty: calibrations are not kept");
            let disk = None;
            return Ok((Self { identity, disk }, None));
        };
        let opened = Store::open(directory);
        if let Err(error) = &opened {
            tracing::error!("{error}; until then headings are served, but calibrations are lost");
        }
        // What cannot be written may still be read.
        let calibration = match &opened {
            Ok(store) => load(store, &identity),
            Err(_) => load(&Store::unchecked(directory), &identity),
        };
        let (queue, orders) = mpsc::channel();
        let directory = directory.to_owned();
        let store = opened.ok();
        let thread = spawn("store", "store", move || keep(directory, store, &orders))?;
        let disk = Some(Disk { queue, thread });
        Ok((Self { identity, disk }, calibration))
    }

    /// Has the calibration saved.
    pub(super) fn save(&self, calibration: Calibration) {
        let Some(disk) = &self.disk else {
            return;
        };
        // A clock before 1970 has never been set; the file needs some number.
        let saved_unix_s = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .map_or(0, |since| since.as_secs());
        let stored = Stored {
            identity: self.identity.clone(),
            saved_unix_s,
            calibration,
        };
        if disk.queue.send(stored).is_err() {
            tracing::error!("cannot keep the calibration: the thread of the store has failed");
        }
    }

    /// Waits until everything is on disk.
    pub(super) fn close(self) {
        if let Some(Disk { queue, thread }) = self.disk {
            drop(queue);
            if thread.join().is_err() {
                tracing::error!("the thread of the store panicked");
            }
        }
    }
}

fn load(store: &Store, identity: &Identity) -> Option<Calibration> {
    let path = store.path();
    let path = path.display();
    match store.load(identity) {
        Ok(Loaded::Found(stored)) => {
            tracing::info!(
                saved_unix_s = stored.saved_unix_s,
                "using the {:?} calibration of {path}",
                stored.calibration.parameters.mode()
            );
            return Some(stored.calibration);
        }
        Ok(Loaded::None) => tracing::info!("no calibration in {path} yet: turn the board once"),
        Ok(Loaded::OtherSensor(other)) => tracing::warn!(
            "not using the calibration of {path}: it is of {} mounted \"{}\", and this is {} mounted \"{}\"; it \
             is set aside when there is a new one",
            other.identity.sensor,
            other.identity.mag_axes,
            identity.sensor,
            identity.mag_axes
        ),
        Err(error) => tracing::error!(
            "{error}; starting without a calibration: turn the board once, or bring back a good file"
        ),
    }
    None
}

/// Saves what comes. A folder that does not work is tried anew each time, and complained of once.
fn keep(directory: PathBuf, mut store: Option<Store>, orders: &mpsc::Receiver<Stored>) {
    let mut failing = store.is_none();
    for stored in orders {
        match save(&directory, &mut store, &stored) {
            Ok(aside) => {
                if let Some(aside) = aside {
                    tracing::warn!("set aside the file that was there: {}", aside.display());
                }
                tracing::info!("kept the calibration in {}", directory.display());
                failing = false;
            }
            Err(error) => {
                store = None;
                if !failing {
                    tracing::error!(
                        "{error}; the calibration is in force, but is lost when the daemon stops: see to the \
                         disk and the folder's permissions, and turn the board again"
                    );
                }
                failing = true;
            }
        }
    }
}

fn save(
    directory: &Path,
    store: &mut Option<Store>,
    stored: &Stored,
) -> Result<Option<PathBuf>, StoreError> {
    match store {
        Some(store) => store.save(stored),
        None => store.insert(Store::open(directory)?).save(stored),
    }
}
