//! Where the compass is, by a gpsd: a client that reads its `TPV` objects, and connects again whenever it has to.

mod tpv;

use std::convert::Infallible;
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, BufReader};
use tokio::net::{TcpStream, UnixStream};
use tokio::sync::watch;
use tokio::time::error::Elapsed;
use tokio::time::{sleep, timeout};

use crate::true_north::Position;

/// What a gpsd is asked for.
const WATCH: &[u8] = b"?WATCH={\"enable\":true,\"json\":true};\n";

/// Longer lines are passed over, bytes: gpsd's longest have 10 KiB.
const LONGEST: usize = 16 * 1024;

/// A gpsd takes a connection at once, or is not there.
const CONNECT_PATIENCE: Duration = Duration::from_secs(10);

/// Reconnect after this long without data.
const SILENCE: Duration = Duration::from_secs(300);

/// Pauses before it is tried again: the first, doubled each time up to the last.
const PAUSES: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(60));

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Gpsd {
    Tcp(SocketAddr),
    Unix(PathBuf),
}

impl Gpsd {
    /// An address in numbers with a port, or an absolute path.
    pub fn parse(text: &str) -> Option<Self> {
        if text.starts_with('/') {
            return Some(Self::Unix(text.into()));
        }
        let address: SocketAddr = text.parse().ok()?;
        (address.port() != 0).then_some(Self::Tcp(address))
    }
}

impl fmt::Display for Gpsd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(address) => address.fmt(f),
            Self::Unix(path) => path.display().fmt(f),
        }
    }
}

/// Where the compass is, and when that was.
#[derive(Clone, Copy, Debug, PartialEq)]
struct GpsFix {
    position: Position,
    /// The time of day by a receiver, and when it came. Of several receivers one may not know it.
    since_1970: Option<(Duration, Instant)>,
}

/// A client at work until it is dropped.
#[derive(Debug)]
pub struct Follower {
    fixes: watch::Receiver<Option<GpsFix>>,
    task: tokio::task::JoinHandle<()>,
}

impl Follower {
    /// Follows this gpsd. Needs a runtime.
    pub fn start(gpsd: Gpsd) -> Self {
        let (sender, fixes) = watch::channel(None);
        Self {
            fixes,
            task: tokio::spawn(follow(gpsd, sender)),
        }
    }

    /// The latest position, if it is newer than the last one returned.
    pub fn news(&mut self) -> Option<Position> {
        // An error means that the task has failed, and that nothing new comes.
        if !self.fixes.has_changed().unwrap_or(false) {
            return None;
        }
        let fix = *self.fixes.borrow_and_update();
        Some(fix?.position)
    }

    /// Lets [`Self::news`] return the latest position again, to a new reader.
    pub fn renew(&mut self) {
        self.fixes.mark_changed();
    }

    /// Whether there was a position.
    pub fn has_position(&self) -> bool {
        self.fixes.borrow().is_some()
    }

    /// The time of day by the receiver's clock.
    pub fn now(&self) -> Option<Duration> {
        let (since_1970, taken) = (*self.fixes.borrow())?.since_1970?;
        Some(since_1970 + taken.elapsed())
    }
}

impl Drop for Follower {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Reads and reconnects for ever; dropping the `Follower` aborts it.
async fn follow(gpsd: Gpsd, fixes: watch::Sender<Option<GpsFix>>) {
    let mut pause = PAUSES.0;
    // A gpsd may be away for months: a loss is told once, and then nothing until a position comes.
    let mut told = false;
    loop {
        let Err(lost) = read(&gpsd, &fixes, &mut told).await;
        if !std::mem::replace(&mut told, true) {
            pause = PAUSES.0;
            if fixes.borrow().is_some() {
                tracing::warn!(
                    "lost the gpsd at {gpsd}, will try again; its last position stays in use: {lost}"
                );
            } else {
                tracing::warn!("no position from the gpsd at {gpsd}, will try again: {lost}");
            }
        }
        sleep(pause).await;
        pause = (2 * pause).min(PAUSES.1);
    }
}

fn not_accepted(_: Elapsed) -> io::Error {
    let patience_s = CONNECT_PATIENCE.as_secs();
    io::Error::other(format!(
        "it has not taken the connection for {patience_s} s"
    ))
}

/// Connects, and reads to the end.
async fn read(
    gpsd: &Gpsd,
    fixes: &watch::Sender<Option<GpsFix>>,
    told: &mut bool,
) -> io::Result<Infallible> {
    match gpsd {
        Gpsd::Tcp(address) => {
            let stream = timeout(CONNECT_PATIENCE, TcpStream::connect(address));
            read_from(stream.await.map_err(not_accepted)??, gpsd, fixes, told).await
        }
        Gpsd::Unix(path) => {
            let stream = timeout(CONNECT_PATIENCE, UnixStream::connect(path));
            read_from(stream.await.map_err(not_accepted)??, gpsd, fixes, told).await
        }
    }
}

async fn read_from(
    mut stream: impl AsyncRead + AsyncWrite + Unpin,
    gpsd: &Gpsd,
    fixes: &watch::Sender<Option<GpsFix>>,
    told: &mut bool,
) -> io::Result<Infallible> {
    let sent = timeout(CONNECT_PATIENCE, stream.write_all(WATCH));
    sent.await.map_err(not_accepted)??;
    if !*told {
        tracing::info!("connected to the gpsd at {gpsd}: waiting for a position");
    }
    let mut reader = BufReader::new(stream);
    let mut line = Vec::new();
    let mut has_position = false;
    // Of a line that is too long nothing is used, up to its end.
    let mut too_long = false;
    loop {
        line.clear();
        let mut limited = (&mut reader).take(LONGEST as u64);
        let read = timeout(SILENCE, limited.read_until(b'\n', &mut line));
        let silent =
            |_| io::Error::other(format!("it has sent nothing for {} s", SILENCE.as_secs()));
        if read.await.map_err(silent)?? == 0 {
            return Err(io::Error::other("it has closed the connection"));
        }
        let whole = line.ends_with(b"\n");
        if !std::mem::replace(&mut too_long, !whole)
            && whole
            && let Some((position, since_1970)) = tpv::read(&line)
        {
            if !std::mem::replace(&mut has_position, true) {
                *told = false;
                tracing::info!(
                    latitude_deg = position.latitude_deg,
                    longitude_deg = position.longitude_deg,
                    "position from the gpsd at {gpsd}"
                );
            }
            take(position, since_1970, fixes);
        }
    }
}

fn take(position: Position, since_1970: Option<Duration>, fixes: &watch::Sender<Option<GpsFix>>) {
    let before = *fixes.borrow();
    let known = before.and_then(|fix| fix.since_1970);
    fixes.send_replace(Some(GpsFix {
        position,
        since_1970: since_1970.map(|time| (time, Instant::now())).or(known),
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_receiver_that_does_not_know_the_time_leaves_that_of_another() {
        let (sender, fixes) = watch::channel(None);
        let position = Position {
            latitude_deg: 51.0,
            longitude_deg: -114.0,
            altitude_m: 0.0,
        };
        let since_1970 = Duration::from_secs(1_790_000_000);
        take(position, Some(since_1970), &sender);
        take(position, None, &sender);
        let (known, _) = fixes.borrow().unwrap().since_1970.unwrap();
        assert_eq!(known, since_1970);
    }

    #[tokio::test]
    async fn each_connection_that_gives_a_position_is_known_for_it() {
        let gpsd = Gpsd::Unix("/s".into());
        let (sender, _fixes) = watch::channel(None);
        for (text, gives) in [
            ("{\"class\":\"VERSION\"}\n", false),
            (
                "{\"class\":\"TPV\",\"mode\":2,\"lat\":51.5,\"lon\":-0.1}\n",
                true,
            ),
            // At the same place, by a receiver that does not know the time.
            (
                "{\"class\":\"TPV\",\"mode\":2,\"lat\":51.5,\"lon\":-0.1}\n",
                true,
            ),
            ("", false),
        ] {
            let (stream, mut other) = tokio::io::duplex(1024);
            other.write_all(text.as_bytes()).await.unwrap();
            other.shutdown().await.unwrap();
            let mut told = true;
            let Err(lost) = read_from(stream, &gpsd, &sender, &mut told).await;
            assert_eq!(lost.to_string(), "it has closed the connection");
            assert_eq!(told, !gives, "{text}");
        }
    }

    #[test]
    fn a_gpsd_is_named_by_a_number_and_a_port_or_by_a_path() {
        for good in ["127.0.0.1:2947", "[::1]:2947", "/run/gps.sock"] {
            assert_eq!(Gpsd::parse(good).unwrap().to_string(), good);
        }
        for wrong in ["", "localhost:2947", "127.0.0.1", "127.0.0.1:0", "gps.sock"] {
            assert_eq!(Gpsd::parse(wrong), None, "{wrong}");
        }
    }
}
