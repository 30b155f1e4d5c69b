//! A client's connection. Room to write is waited for only while there is none: tokio's own streams always wait for it,
//! and so wake the daemon each time that a client has read.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream as StdStream;
use std::time::Duration;

use rustix::net::sockopt::set_socket_send_buffer_size;
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::net::UnixStream;
use tokio::time::timeout;

/// What the system keeps for a client that does not read, bytes; it doubles that. With its default of three times as much, a
/// thousand clients that have stalled would take more than the unit's MemoryMax=.
const SEND_BUFFER: usize = 32 << 10;

pub(super) struct Connection {
    stream: AsyncFd<StdStream>,
}

impl Connection {
    pub(super) fn new(stream: UnixStream) -> io::Result<Self> {
        let stream = stream.into_std()?;
        set_socket_send_buffer_size(&stream, SEND_BUFFER)?;
        let stream = watched(stream, Interest::READABLE)?;
        Ok(Self { stream })
    }

    /// Waits for bytes, and returns how many came; 0 means that the client has left.
    pub(super) async fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self
            .stream
            .async_io(Interest::READABLE, |mut stream| stream.read(bytes))
            .await;
        match read {
            // It died instead of leaving.
            Err(error) if error.kind() == ErrorKind::ConnectionReset => Ok(0),
            read => read,
        }
    }

    /// Writes all of this. The error is `TimedOut` where the other end has taken nothing for this long.
    pub(super) async fn write_all(&self, mut bytes: &[u8], patience: Duration) -> io::Result<()> {
        // Linux wakes a writer only when most of the buffer is free. A slow reader may have read something although the wait
        // timed out: one more write tells.
        let mut waited_in_vain = false;
        while !bytes.is_empty() {
            match self.stream.get_ref().write(bytes) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => (bytes, waited_in_vain) = (&bytes[count..], false),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    if waited_in_vain {
                        return Err(ErrorKind::TimedOut.into());
                    }
                    match timeout(patience, self.room()).await {
                        Ok(room) => room?,
                        Err(_) => waited_in_vain = true,
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Waits for room, on a duplicate of the descriptor: one descriptor can be watched for one thing only.
    async fn room(&self) -> io::Result<()> {
        let other = self.stream.get_ref().try_clone()?;
        let other = watched(other, Interest::WRITABLE)?;
        other.writable().await.map(|_| ())
    }
}

/// The call is deprecated since it cannot know that the descriptor stays what it is, and its successors are `unsafe`;
/// a stream of the standard library keeps its own.
#[expect(deprecated)]
fn watched(stream: StdStream, interest: Interest) -> io::Result<AsyncFd<StdStream>> {
    AsyncFd::with_interest(stream, interest)
}
