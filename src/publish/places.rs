//! The places for clients, and who holds them: one user cannot take them all.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Places that one user leaves to others; half of all where there are few.
const KEPT: usize = 4;

/// The superuser.
const ROOT: u32 = 0;

/// The user of whom the system does not say who it is.
const UNKNOWN: u32 = u32::MAX;

#[derive(Debug)]
pub(super) struct Places {
    most: usize,
    /// The daemon's own user.
    own: u32,
    held: Arc<Mutex<HashMap<u32, usize>>>,
}

/// A place that is held until this is dropped.
#[derive(Debug)]
pub(super) struct Place {
    uid: u32,
    held: Arc<Mutex<HashMap<u32, usize>>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Full {
    #[error("headingd serves {0} clients already")]
    All(usize),
    #[error("{0} clients of users that the system does not name are connected, which is the most")]
    Unnamed(usize),
    #[error(
        "user {uid} has {most} clients connected, which is the most for one user; close some of them"
    )]
    User { uid: u32, most: usize },
}

impl Places {
    pub(super) fn new(most: usize, own: u32) -> Self {
        Self {
            most,
            own,
            held: Arc::default(),
        }
    }

    /// A place for a client of this user. Root and the daemon's own user may hold all: they could end the daemon as well.
    pub(super) fn take(&self, uid: Option<u32>) -> Result<Place, Full> {
        let uid = uid.unwrap_or(UNKNOWN);
        let mut held = lock(&self.held);
        if held.values().sum::<usize>() >= self.most {
            return Err(Full::All(self.most));
        }
        let count = held.entry(uid).or_default();
        let most = most_of_one_user(self.most);
        if *count >= most && uid != ROOT && uid != self.own {
            return Err(match uid {
                UNKNOWN => Full::Unnamed(most),
                uid => Full::User { uid, most },
            });
        }
        *count += 1;
        Ok(Place {
            uid,
            held: self.held.clone(),
        })
    }
}

/// How many of `most` places one user may hold.
pub(super) fn most_of_one_user(most: usize) -> usize {
    most - KEPT.min(most / 2)
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut held = lock(&self.held);
        if let Some(count) = held.get_mut(&self.uid) {
            *count -= 1;
            if *count == 0 {
                held.remove(&self.uid);
            }
        }
    }
}

/// The counts are changed in one step each, so a panic elsewhere cannot have left them half changed.
fn lock(held: &Mutex<HashMap<u32, usize>>) -> MutexGuard<'_, HashMap<u32, usize>> {
    held.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: u32 = 990;

    fn fill(places: &Places, uid: u32) -> Vec<Place> {
        std::iter::from_fn(|| places.take(Some(uid)).ok()).collect()
    }

    #[test]
    fn one_user_leaves_four_places_to_others() {
        let places = Places::new(32, OWN);
        let first = fill(&places, 1000);
        assert_eq!(first.len(), 28);
        assert_eq!(
            places.take(Some(1000)).unwrap_err(),
            Full::User {
                uid: 1000,
                most: 28
            }
        );
        let mut others: Vec<Place> = [1001, ROOT, OWN, 1002]
            .map(|uid| places.take(Some(uid)).unwrap())
            .into();
        assert_eq!(places.take(Some(ROOT)).unwrap_err(), Full::All(32));
        others.pop();
        assert_eq!(
            places.take(Some(1000)).unwrap_err().to_string(),
            "user 1000 has 28 clients connected, which is the most for one user; close some of them"
        );
        assert!(places.take(None).is_ok());
        drop(first);
        assert_eq!(fill(&places, 1000).len(), 28);
    }

    #[test]
    fn root_and_the_daemons_own_user_may_hold_all() {
        let places = Places::new(32, OWN);
        assert_eq!(fill(&places, ROOT).len(), 32);
        assert_eq!(fill(&places, OWN).len(), 32);
    }

    #[test]
    fn of_few_places_half_are_kept_and_one_is_there_for_anybody() {
        for (most, of_one) in [(1, 1), (2, 1), (3, 2), (7, 4), (8, 4), (9, 5), (1024, 1020)] {
            let places = Places::new(most, OWN);
            assert_eq!(fill(&places, 1000).len(), of_one, "of {most}");
        }
    }

    #[test]
    fn those_of_whom_nothing_is_known_count_as_one_user() {
        let places = Places::new(8, OWN);
        let held: Vec<_> = (0..4).map(|_| places.take(None).unwrap()).collect();
        assert!(places.take(None).is_err());
        assert!(places.take(Some(1000)).is_ok());
        drop(held);
        assert!(lock(&places.held).is_empty());
    }
}
