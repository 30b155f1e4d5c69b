//! A client's connection. Watches for room to write only while the buffer is full. tokio's streams always watch for it,
//! which wakes the daemon whenever a client reads.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream as StdStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rustix::net::sockopt::set_socket_send_buffer_size;
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::net::UnixStream;
use tokio::time::timeout;

/// What the system keeps for a client that does not read, bytes; it doubles that. With its default of three times as much, a
/// thousand clients that have stalled would take more than the unit's MemoryMax=.
const SEND_BUFFER: usize = 32 << 10;

/// What is written at a time to a client that has once let its buffer run full, bytes. The system makes room again for
/// each part that has been read whole: of larger ones a slow reader might not finish any in time.
const PART: usize = 512;

pub(super) struct Connection {
    stream: AsyncFd<StdStream>,
    /// The buffer has been full.
    slow: AtomicBool,
}

impl Connection {
    pub(super) fn new(stream: UnixStream) -> io::Result<Self> {
        let stream = stream.into_std()?;
        set_socket_send_buffer_size(&stream, SEND_BUFFER)?;
        let stream = watched(stream, Interest::READABLE)?;
        let slow = AtomicBool::new(false);
        Ok(Self { stream, slow })
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

    /// Writes all of this. The error is `TimedOut` where the other end has not read enough for another part within this time.
    pub(super) async fn write_all(&self, mut bytes: &[u8], patience: Duration) -> io::Result<()> {
        // Linux wakes a writer only when most of the buffer is free. A slow reader may have read something although the wait
        // timed out: one more write tells.
        let mut waited_in_vain = false;
        while !bytes.is_empty() {
            let most = match self.slow.load(Ordering::Relaxed) {
                true => PART,
                false => usize::MAX,
            };
            match self.stream.get_ref().write(&bytes[..bytes.len().min(most)]) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => (bytes, waited_in_vain) = (&bytes[count..], false),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    self.slow.store(true, Ordering::Relaxed);
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

#[cfg(test)]
mod tests {
    use rustix::io::ioctl_fionread;
    use tokio::io::AsyncReadExt;

    use super::*;

    /// Patience with a client of which it is known whether it reads.
    const NONE: Duration = Duration::from_millis(1);

    #[tokio::test]
    async fn whoever_reads_a_little_at_a_time_gets_more() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        let connection = Connection::new(ours).unwrap();
        let line = [b'x'; 500];
        while connection.write_all(&line, NONE).await.is_ok() {}
        let unread = |theirs: &UnixStream| ioctl_fionread(theirs).unwrap();
        // Until nothing is left of what was written while there was room.
        let mut before = unread(&theirs);
        let mut read = 0;
        while read < before {
            read += theirs.read_exact(&mut [0; 2048]).await.unwrap() as u64;
            let left = unread(&theirs);
            let error = connection.write_all(&[b'x'; 1 << 16], NONE).await;
            assert_eq!(error.unwrap_err().kind(), ErrorKind::TimedOut);
            assert!(unread(&theirs) > left, "after {read} bytes");
        }
        // Whoever reads nothing gets nothing.
        before = unread(&theirs);
        connection.write_all(&line, NONE).await.unwrap_err();
        assert_eq!(unread(&theirs), before);
    }
}
