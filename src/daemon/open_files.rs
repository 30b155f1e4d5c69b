//! How many files the daemon may have open, held against how many it needs.

use rustix::process::{Resource, getrlimit};

/// What is open besides connections, with room to spare: streams, sockets, locks and timers, the journal, the source and
/// during a reload another one, recordings, and files being saved.
const OTHERS: u64 = 40;

/// The places of the control socket.
const CONTROL: u64 = 8;

/// A client that is slow in taking its headings needs a second one while it is waited for.
const A_CLIENT: u64 = 2;

/// How many files are needed to serve so many clients.
pub fn needed(max_clients: usize) -> u64 {
    OTHERS + CONTROL + A_CLIENT * max_clients as u64
}

/// How many files this process may have open, if there is a limit.
pub fn limit() -> Option<u64> {
    getrlimit(Resource::Nofile).current
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "socket.max_clients = {max_clients} needs {} open files, but the limit is {limit} here, which does for {clients}: raise \
     it (LimitNOFILE= in the unit of the service, or ulimit -n), or lower max_clients",
    needed(*max_clients)
)]
pub struct Shortage {
    max_clients: usize,
    limit: u64,
    pub clients: usize,
}

impl Shortage {
    /// Whether this limit is too low for so many clients.
    pub fn of(max_clients: usize, limit: Option<u64>) -> Option<Self> {
        let limit = limit.filter(|limit| *limit < needed(max_clients))?;
        let clients = limit.saturating_sub(needed(0)) / A_CLIENT;
        Some(Self {
            max_clients,
            limit,
            // Less than the maximum, as the limit is too low for that.
            clients: (clients as usize).max(1),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Check;
    use crate::publish::server::Settings;

    #[test]
    fn the_service_may_open_files_for_as_many_clients_as_can_be_set() {
        let limit = include_str!("../../systemd/headingd.service")
            .lines()
            .find_map(|line| line.strip_prefix("LimitNOFILE="));
        let limit: u64 = limit.expect("a limit").parse().unwrap();
        let settings = |max_clients| Settings {
            max_clients,
            ..Settings::default()
        };
        let most = (1..)
            .take_while(|most| settings(*most).check().is_empty())
            .last();
        assert!(limit >= needed(most.unwrap()));
    }

    #[test]
    fn the_soft_limit_is_that_of_the_system() {
        let limits = std::fs::read_to_string("/proc/self/limits").unwrap();
        let line = limits
            .lines()
            .find_map(|line| line.strip_prefix("Max open files"));
        let soft = line.unwrap().split_whitespace().next().unwrap();
        assert_eq!(limit(), soft.parse().ok());
    }

    #[test]
    fn a_limit_that_is_too_low_does_for_some() {
        for (max_clients, limit, clients) in [
            (32, None, None),
            (32, Some(112), None),
            (32, Some(111), Some(31)),
            (32, Some(64), Some(8)),
            (1024, Some(1024), Some(488)),
            (1024, Some(3), Some(1)),
            (1, Some(49), Some(1)),
        ] {
            let found = Shortage::of(max_clients, limit);
            assert_eq!(
                found.map(|short| short.clients),
                clients,
                "{max_clients} {limit:?}"
            );
        }
        let message = Shortage::of(32, Some(64)).unwrap().to_string();
        assert!(
            message.starts_with("socket.max_clients = 32 needs 112 open files, but the limit is 64 here, which does for 8: "),
            "{message}"
        );
    }
}
