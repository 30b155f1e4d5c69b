//! Reads a client's requests, no faster than its allowance permits.

use std::io;
use std::time::Instant;

use tokio::time::sleep;

use super::allowance::{ANSWER, Allowance, ERROR, bytes};
use super::connection::Connection;
use super::framing::Requests;
use super::request::ClientRequest;

/// So much is read at a time.
const CHUNK: usize = 1024;

/// A client's requests, from its connection.
pub(super) struct Inbox {
    requests: Requests,
    bytes: [u8; CHUNK],
    /// `bytes[from..to]` has been read, but not cut into requests yet.
    from: usize,
    to: usize,
    /// Whether the client has sent its last byte.
    pub(super) ended: bool,
    allowance: Allowance,
}

impl Inbox {
    /// Requests of up to `limit_bytes` bytes each.
    pub(super) fn new(limit_bytes: usize) -> Self {
        Self {
            requests: Requests::new(limit_bytes),
            bytes: [0; CHUNK],
            from: 0,
            to: 0,
            ended: false,
            allowance: Allowance::new(Instant::now()),
        }
    }

    /// Waits for bytes, unless some are left. A client over its allowance is not read from until its debt has fallen.
    /// Cancel safe.
    pub(super) async fn wait(&mut self, link: &Connection) -> io::Result<()> {
        if let Some(pause) = self.allowance.pause(Instant::now()) {
            sleep(pause).await;
        }
        if self.from == self.to {
            let count = link.read(&mut self.bytes).await?;
            (self.from, self.to) = (0, count);
            self.ended = count == 0;
            self.allowance.spend(Instant::now(), bytes(count));
        }
        Ok(())
    }

    /// The next complete request; `None` as well while the client is over its allowance.
    pub(super) fn next(&mut self) -> Option<Result<ClientRequest, String>> {
        let now = Instant::now();
        if self.allowance.pause(now).is_some() {
            return None;
        }
        let request = if self.ended {
            self.requests.finish()
        } else {
            let mut left = &self.bytes[self.from..self.to];
            let request = self.requests.next(&mut left);
            self.from = self.to - left.len();
            request
        }?;
        let cost = if request.is_ok() { ANSWER } else { ERROR };
        self.allowance.spend(now, cost);
        Some(request)
    }
}
