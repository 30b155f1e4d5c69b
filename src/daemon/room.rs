//! Who takes the room on a disk that the store and the ring of logs share: the store goes first, and the ring gives it what it needs.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::ring;
use super::thread::{Shared, lock};

/// What the store's thread and the recorder's both see.
#[derive(Clone, Default)]
pub(super) struct DiskRoom(Shared<RoomState>);

#[derive(Default)]
struct RoomState {
    /// The folder of the ring, if there is one.
    ring: Option<PathBuf>,
    /// The store has something to save, and no room for it.
    claimed: bool,
}

impl DiskRoom {
    /// The folder of the ring that gives room from now on, if one does.
    pub(super) fn set_ring(&self, ring: Option<&Path>) {
        lock(&self.0).ring = ring.map(Path::to_owned);
    }

    /// Whether the store needs the room: until it has saved, the ring takes none.
    pub(super) fn is_claimed(&self) -> bool {
        lock(&self.0).claimed
    }

    /// The store in this folder has no room for what it must save. Removes the ring's oldest log and returns its path; `None` if
    /// that would not help, or nothing is left. The newest log goes too, if it must: a calibration is worth more than a log.
    pub(super) fn claim(&self, store: &Path) -> Option<PathBuf> {
        let mut state = lock(&self.0);
        let ring = (state.ring.clone()).filter(|ring| share_a_disk(store, ring))?;
        // Claim first: otherwise the recorder would take the room that the removed log leaves.
        state.claimed = true;
        drop(state);
        ring::remove_oldest(&ring, 0).ok().flatten()
    }

    /// The store has saved, or what it lacks is something else.
    pub(super) fn release(&self) {
        lock(&self.0).claimed = false;
    }
}

/// Whether room in one folder is room in the other, as far as that can be known.
fn share_a_disk(one: &Path, other: &Path) -> bool {
    match (disk_of(one), disk_of(other)) {
        (Ok(one), Ok(other)) => one == other,
        _ => true,
    }
}

/// The file system that the folder is on, or will be.
fn disk_of(folder: &Path) -> io::Result<u64> {
    match (fs::metadata(folder), folder.parent()) {
        (Err(error), Some(parent)) if error.kind() == io::ErrorKind::NotFound => disk_of(parent),
        (found, _) => Ok(found?.dev()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_ring_on_the_disk_of_the_store_gives_room_and_then_all_it_has() {
        let folder = tempfile::tempdir().unwrap();
        let (store, ring) = (folder.path().join("store"), folder.path().join("ring"));
        let room = DiskRoom::default();
        assert_eq!(room.claim(&store), None);
        room.set_ring(Some("/proc/record".as_ref()));
        assert_eq!(room.claim(&store), None);
        assert!(!room.is_claimed());

        room.set_ring(Some(&ring));
        std::fs::create_dir(&ring).unwrap();
        let logs = [(); 2].map(|()| ring::next(&ring, 2, 1).unwrap().0);
        for log in logs {
            assert_eq!(room.claim(&store), Some(log));
        }
        assert_eq!(room.claim(&store), None);
        assert!(room.is_claimed());
        room.release();
        assert!(!room.is_claimed());
    }
}
