//! Headings over UDP: a datagram for each heading.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket as StdSocket};

use tokio::net::UdpSocket;

use super::lines::HeadingLines;
use super::{Format, check_address};
use crate::check::settings;

settings! {
    /// Where datagrams go.
    #[derive(Eq)]
    pub struct Settings {
        /// An address in numbers with a port, of one receiver or a broadcast: `"127.0.0.1:10110"`, `"192.168.1.255:10110"`.
        /// Empty: none.
        to: String = String::new() => |key, to| check_address(key, to);
        /// `"nmea"` or `"signalk"`.
        format: Format = Format::Nmea;
    }
}

/// Opens a socket for datagrams to this address.
pub(super) fn open(to: SocketAddr) -> io::Result<UdpSocket> {
    let any = match to {
        SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
        SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
    };
    let socket = StdSocket::bind(any)?;
    socket.set_broadcast(true)?;
    socket.set_nonblocking(true)?;
    UdpSocket::from_std(socket)
}

/// Sends until there are no more. Logs the first failed send, and the first that works again.
pub(super) async fn run(socket: UdpSocket, to: SocketAddr, mut lines: HeadingLines) {
    let mut failed = false;
    while let Some(text) = lines.next().await {
        match socket.send_to(text.as_bytes(), to).await {
            Ok(_) if failed => {
                tracing::info!("UDP to {to} works again");
                failed = false;
            }
            Err(error) if !failed => {
                tracing::warn!("cannot send to {to} over UDP: {error}; trying on");
                failed = true;
            }
            _ => {}
        }
    }
}
