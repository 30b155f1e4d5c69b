//! Headings for programs that do not ask: as NMEA 0183 or Signal K over UDP and TCP, and on what looks like a serial line.
//! All are off unless the configuration says where they go.

mod lines;
pub mod pty;
pub mod tcp;
pub mod udp;

use std::fmt::Display;
use std::io;
use std::net::SocketAddr;

use serde::{Deserialize, Serialize};
use tokio::task::JoinSet;

use super::feed::Publisher;
use crate::check::Fault;
use lines::HeadingLines;

/// What goes over UDP or TCP.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// NMEA 0183.
    #[default]
    Nmea,
    /// Signal K deltas.
    SignalK,
}

impl Format {
    fn name(self) -> &'static str {
        match self {
            Self::Nmea => "NMEA 0183",
            Self::SignalK => "Signal K",
        }
    }
}

/// Opens the outputs that are on. One that cannot be had is logged, and headings go out without it; TCP is tried again.
/// Needs a runtime. To shut the tasks down ends the outputs, with nothing left behind.
pub fn open(
    udp: &udp::Settings,
    tcp: &tcp::Settings,
    pty: &pty::Settings,
    publisher: &Publisher,
) -> JoinSet<()> {
    let mut tasks = JoinSet::new();
    let lines = |format| HeadingLines::new(publisher.clone(), format);
    if let Some(to) = address(&udp.to)
        && let Some(socket) = opened("udp.to", to, udp::open(to), WITHOUT)
    {
        tracing::info!("sending {} over UDP to {to}", udp.format.name());
        tasks.spawn(udp::run(socket, to, lines(udp.format)));
    }
    if let Some(listen) = address(&tcp.listen) {
        let listener = opened("tcp.listen", listen, tcp::open(listen), "will try again");
        let feed = publisher.clone();
        tasks.spawn(tcp::run(listener, listen, feed, tcp.format));
    }
    let path = pty.path.as_path();
    if !path.as_os_str().is_empty()
        && let Some(pty) = opened("pty.path", path.display(), pty::Pty::open(path), WITHOUT)
    {
        tracing::info!("writing NMEA 0183 to {}", path.display());
        tasks.spawn(pty.run(lines(Format::Nmea)));
    }
    tasks
}

/// What follows from an output that cannot be had.
const WITHOUT: &str = "headings go out without it";

/// What was opened for a setting; an error is logged, with what follows.
fn opened<T>(key: &str, place: impl Display, opened: io::Result<T>, follows: &str) -> Option<T> {
    let complain = |error: &io::Error| {
        tracing::error!("cannot use {key} = \"{place}\": {error}; {follows}");
    };
    opened.inspect_err(complain).ok()
}

/// The address in a setting; `None` where it is empty. A fault is one of the settings' checks.
fn address(text: &str) -> Option<SocketAddr> {
    text.parse().ok()
}

/// What is wrong with an address, if anything is.
fn check_address(key: &str, text: &str) -> Option<Fault> {
    let right = text.is_empty() || address(text).is_some_and(|address| address.port() > 0);
    (!right).then(|| {
        let right = "an address in numbers with a port, as \"127.0.0.1:10110\", or empty";
        Fault::new(key, format!("{text:?}"), right)
    })
}
