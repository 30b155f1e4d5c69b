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

    fn ask(most: usize, held: &[u32], uid: u32) -> Result<(), Full> {
        admit(most, OWN, held.iter().copied(), uid)
    }

    /// Takes all places that this user gets; how many these are.
    fn fill(most: usize, held: &mut Vec<u32>, uid: u32) -> usize {
        let before = held.len();
        while ask(most, held, uid).is_ok() {
            held.push(uid);
        }
        held.len() - before
    }

    #[test]
    fn one_user_leaves_four_places_to_others() {
        let mut held = Vec::new();
        assert_eq!(fill(32, &mut held, 1000), 28);
        let full = Full::User {
            uid: 1000,
            most: 28,
        };
        assert_eq!(ask(32, &held, 1000), Err(full));
        assert_eq!(
            full.to_string(),
            "user 1000 has 28 clients connected, which is the most for one user; close some of them"
        );
        for uid in [1001, ROOT, OWN, 1002] {
            assert_eq!(ask(32, &held, uid), Ok(()));
            held.push(uid);
        }
        assert_eq!(ask(32, &held, ROOT), Err(Full::All(32)));
        held.pop();
        assert_eq!(ask(32, &held, 1000), Err(full));
        held.retain(|uid| *uid != 1000);
        assert_eq!(fill(32, &mut held, 1000), 28);
    }

    #[test]
    fn root_and_the_daemons_own_user_may_hold_all() {
        for uid in [ROOT, OWN] {
            assert_eq!(fill(32, &mut Vec::new(), uid), 32);
        }
    }

    #[test]
    fn of_few_places_half_are_kept_and_one_is_there_for_anybody() {
        for (most, of_one) in [(1, 1), (2, 1), (3, 2), (7, 4), (8, 4), (9, 5), (1024, 1020)] {
            assert_eq!(fill(most, &mut Vec::new(), 1000), of_one, "of {most}");
        }
    }
}
