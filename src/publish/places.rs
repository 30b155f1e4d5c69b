//! The places for clients: one user cannot take them all. Pure.

/// Places that one user leaves to others; half of all where there are few.
const KEPT: usize = 4;

/// The superuser.
const ROOT: u32 = 0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Full {
    #[error("headingd serves {0} clients already")]
    All(usize),
    #[error(
        "user {uid} has {most} clients connected, which is the most for one user; close some of them"
    )]
    User { uid: u32, most: usize },
}

/// Whether a user may have one of `most` places, beside the users who hold some. Root and the daemon's own user may hold
/// all: they could end the daemon as well.
pub(super) fn admit(
    most: usize,
    own: u32,
    held: impl ExactSizeIterator<Item = u32>,
    uid: u32,
) -> Result<(), Full> {
    if held.len() >= most {
        return Err(Full::All(most));
    }
    // The most for one user.
    let most = most - KEPT.min(most / 2);
    let count = held.filter(|holder| *holder == uid).count();
    if count < most || uid == ROOT || uid == own {
        Ok(())
    } else {
        Err(Full::User { uid, most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: u32 = 990;

    /// The places, and who holds them.
    struct Places {
        most: usize,
        held: Vec<u32>,
    }

    impl Places {
        fn new(most: usize) -> Self {
            let held = Vec::new();
            Self { most, held }
        }

        fn take(&mut self, uid: u32) -> Result<(), Full> {
            let held = self.held.iter().copied();
            admit(self.most, OWN, held, uid)?;
            self.held.push(uid);
            Ok(())
        }

        /// How many this user gets.
        fn fill(&mut self, uid: u32) -> usize {
            let before = self.held.len();
            while self.take(uid).is_ok() {}
            self.held.len() - before
        }
    }

    #[test]
    fn one_user_leaves_four_places_to_others() {
        let mut places = Places::new(32);
        assert_eq!(places.fill(1000), 28);
        let full = Full::User {
            uid: 1000,
            most: 28,
        };
        assert_eq!(places.take(1000), Err(full));
        assert_eq!(
            full.to_string(),
            "user 1000 has 28 clients connected, which is the most for one user; close some of them"
        );
        for uid in [1001, ROOT, OWN, 1002] {
            assert_eq!(places.take(uid), Ok(()));
        }
        assert_eq!(places.take(ROOT), Err(Full::All(32)));
        places.held.pop();
        assert_eq!(places.take(1000), Err(full));
        places.held.retain(|uid| *uid != 1000);
        assert_eq!(places.fill(1000), 28);
    }

    #[test]
    fn root_and_the_daemons_own_user_may_hold_all() {
        for uid in [ROOT, OWN] {
            assert_eq!(Places::new(32).fill(uid), 32);
        }
    }

    #[test]
    fn of_few_places_half_are_kept_and_one_is_there_for_anybody() {
        for (most, of_one) in [(1, 1), (2, 1), (3, 2), (7, 4), (8, 4), (9, 5), (1024, 1020)] {
            assert_eq!(Places::new(most).fill(1000), of_one, "of {most}");
        }
    }
}
