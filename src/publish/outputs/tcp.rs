//! Headings over TCP, to whoever connects.

use std::io;
use std::net::{SocketAddr, TcpListener as StdListener};
use std::sync::Arc;
use std::time::Duration;

use rustix::net::sockopt::{
    set_socket_keepalive, set_socket_send_buffer_size, set_tcp_keepcnt, set_tcp_keepidle,
    set_tcp_keepintvl,
};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::lines::HeadingLines;
use super::{Format, check_address};
use crate::check::settings;
use crate::publish::feed::Feed;

/// So many clients are served at a time.
const MOST_CLIENTS: usize = 8;

/// How long a client may take nothing.
const PATIENCE: Duration = Duration::from_secs(5);

/// A client that has been silent for this long is asked whether it is still there, at this interval and so many times.
const KEEP_ALIVE: (Duration, Duration, u32) = (Duration::from_secs(30), Duration::from_secs(10), 3);

/// Pause after an accept that failed: there may be no files left.
const PAUSE: Duration = Duration::from_secs(1);

/// The longest pause before the port is tried again; the first is [`PAUSE`], doubled each time.
const LONGEST_PAUSE: Duration = Duration::from_secs(60);

/// What the system keeps for a client that does not read, bytes; it doubles that. Headings that wait there grow old: this holds some
/// five seconds of NMEA 0183, at ten headings a second.
const SEND_BUFFER: usize = 4 << 10;

settings! {
    /// Where clients connect.
    #[derive(Eq)]
    pub struct Settings {
        /// An address of this machine in numbers, with a port: `"127.0.0.1:10110"` for its own programs, `"0.0.0.0:10110"` for
        /// the whole network. Empty: none.
        listen: String = String::new() => |key, listen| check_address(key, listen);
        /// `"nmea"` or `"signalk"`.
        format: Format = Format::Nmea;
    }
}

/// Opens a port that clients can connect to.
pub(super) fn open(listen: SocketAddr) -> io::Result<TcpListener> {
    let listener = StdListener::bind(listen)?;
    listener.set_nonblocking(true)?;
    TcpListener::from_std(listener)
}

/// Serves clients until it is dropped, and they with it. A port that could not be opened is tried again: at boot its address
/// may not be there yet.
pub(super) async fn run(
    mut opened: Option<TcpListener>,
    listen: SocketAddr,
    feed: Arc<Feed>,
    format: Format,
) {
    let mut pause = PAUSE;
    let listener = loop {
        if let Some(listener) = opened {
            break listener;
        }
        sleep(pause).await;
        pause = (2 * pause).min(LONGEST_PAUSE);
        opened = open(listen).ok();
    };
    tracing::info!("serving {} over TCP on {listen}", format.name());
    let mut clients = JoinSet::new();
    let mut failing = false;
    loop {
        let accepted = listener.accept().await;
        // Clients that have left free their places.
        while clients.try_join_next().is_some() {}
        let told = std::mem::replace(&mut failing, accepted.is_err());
        match accepted {
            Ok((stream, _)) if clients.len() < MOST_CLIENTS => {
                let lines = HeadingLines::new(feed.clone(), format);
                clients.spawn(async move {
                    if let Err(error) = serve(stream, lines).await {
                        tracing::debug!("a client of TCP left: {error}");
                    }
                });
            }
            Ok((_, peer)) => {
                tracing::info!("refused TCP client {peer}: {MOST_CLIENTS} are connected already");
            }
            Err(error) => {
                // The client stays in the queue. Once an episode.
                if !told {
                    tracing::warn!("cannot accept a client of TCP, will try again: {error}");
                }
                sleep(PAUSE).await;
            }
        }
    }
}

/// Serves one client until it leaves, or takes nothing. What it sends is thrown away.
async fn serve(mut stream: TcpStream, mut lines: HeadingLines) -> io::Result<()> {
    stream.set_nodelay(true)?;
    set_socket_send_buffer_size(&stream, SEND_BUFFER)?;
    // Detects a client that has vanished, even while there are no headings to send.
    set_socket_keepalive(&stream, true)?;
    set_tcp_keepidle(&stream, KEEP_ALIVE.0)?;
    set_tcp_keepintvl(&stream, KEEP_ALIVE.1)?;
    set_tcp_keepcnt(&stream, KEEP_ALIVE.2)?;
    let (mut reader, mut writer) = stream.split();
    let mut thrown = [0; 256];
    loop {
        tokio::select! {
            read = reader.read(&mut thrown) => {
                if read? == 0 {
                    return Ok(());
                }
            }
            text = lines.next() => {
                let Some(text) = text else { return Ok(()) };
                timeout(PATIENCE, writer.write_all(text.as_bytes())).await??;
            }
        }
    }
}
