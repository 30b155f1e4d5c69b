//! Headings as NMEA 0183 for programs that do not ask: over UDP, TCP, or what looks like a serial line. All are off unless
//! the configuration says where they go.

pub mod pty;
mod sentences;
pub mod tcp;
pub mod udp;

use std::fmt::Display;
use std::net::SocketAddr;

use tokio::task::JoinSet;

use super::feed::Publisher;
use crate::check::Fault;
use sentences::Sentences;

/// The outputs at work. They end when this is dropped.
#[derive(Debug, Default)]
pub struct Outputs {
    tasks: JoinSet<()>,
}

impl Outputs {
    /// Opens those that are on. One that cannot be had is logged, and headings go out without it. Needs a runtime.
    pub fn open(
        udp: &udp::Settings,
        tcp: &tcp::Settings,
        pty: &pty::Settings,
        publisher: &Publisher,
    ) -> Self {
        let mut tasks = JoinSet::new();
        let sentences = || Sentences::new(publisher.feed());
        if let Some(to) = udp.to() {
            match udp::Sender::open(to) {
                Ok(sender) => {
                    tracing::info!("sending NMEA 0183 over UDP to {to}");
                    tasks.spawn(sender.run(sentences()));
                }
                Err(error) => complain("udp.to", to, &error),
            }
        }
        if let Some(listen) = tcp.listen() {
            match tcp::Server::open(listen) {
                Ok(server) => {
                    tracing::info!("serving NMEA 0183 over TCP on {listen}");
                    tasks.spawn(server.run(publisher.feed()));
                }
                Err(error) => complain("tcp.listen", listen, &error),
            }
        }
        if let Some(path) = pty.path() {
            match pty::Pty::open(path) {
                Ok(pty) => {
                    tracing::info!("writing NMEA 0183 to {}", path.display());
                    tasks.spawn(pty.run(sentences()));
                }
                Err(error) => complain("pty.path", path.display(), &error),
            }
        }
        Self { tasks }
    }

    /// Ends them all, with nothing left behind.
    pub async fn close(mut self) {
        self.tasks.shutdown().await;
    }
}

fn complain(key: &str, place: impl Display, error: &std::io::Error) {
    tracing::error!("cannot use {key} = \"{place}\": {error}; headings go out without it");
}

/// The address in a setting; `None` where it is empty. A fault is one of the settings' checks.
fn address(text: &str) -> Option<SocketAddr> {
    text.parse().ok()
}

/// Finds what is wrong with an address.
fn check_address(key: &str, text: &str) -> Vec<Fault> {
    if text.is_empty() || address(text).is_some_and(|address| address.port() > 0) {
        return Vec::new();
    }
    vec![Fault {
        key: key.to_owned(),
        found: format!("{text:?}"),
        right: "an address in numbers with a port, as \"127.0.0.1:10110\", or empty".to_owned(),
    }]
}
