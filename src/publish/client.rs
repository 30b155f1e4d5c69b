//! One client: its requests are answered, and what it watches for is sent to it.

use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use tokio::net::UnixStream;
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::sync::{broadcast, watch};
use tokio::time::timeout;

use super::feed::{Event, Feed, Message, age_ms};
use super::gpsd::{self, Policy};
use super::link::Link;
use super::raw;
use super::request::{Request, Requests, Watch};
use crate::reading::Reading;

/// gpsd's own. Its Python client passes over every line that ends otherwise, without a word.
pub(super) const LINE_END: &str = "\r\n";

/// Why a client was let go.
#[derive(Debug, Error)]
pub(super) enum ClientError {
    #[error("the connection broke: {0}")]
    Broken(#[from] io::Error),
    #[error("it took nothing for {0:?}")]
    TooSlow(Duration),
}

/// Serves one client until it leaves, breaks, is too slow, or `stop` says that the server stops.
pub(super) async fn serve(
    stream: UnixStream,
    feed: Arc<Feed>,
    request_limit_bytes: usize,
    write_timeout: Duration,
    mut stop: watch::Receiver<bool>,
) -> Result<(), ClientError> {
    let link = &Link::new(stream)?;
    let mut client = Client {
        feed,
        link,
        write_timeout,
        policy: Policy::default(),
        ring: None,
        readings: None,
        state_seen: 0,
        calibration_seen: 0,
        line: String::new(),
    };
    let mut requests = Requests::new(request_limit_bytes);
    let mut bytes = [0; 1024];
    client.send(&gpsd::version()).await?;
    let mut stopped = pin!(stop.changed());
    loop {
        tokio::select! {
            // An error means that the server is gone, which is a reason to stop as well.
            _ = &mut stopped => return client.drain().await,
            read = link.read(&mut bytes) => match read? {
                [] => {
                    if let Some(request) = requests.finish() {
                        client.answer(request).await?;
                    }
                    return Ok(());
                }
                bytes => {
                    for request in requests.feed(bytes) {
                        client.answer(request).await?;
                    }
                }
            },
            message = next(&mut client.ring) => client.forward(message).await?,
            reading = next(&mut client.readings) => client.send_reading(reading).await?,
        }
    }
}

/// The next message; never, for a client that watches for nothing.
async fn next<T: Clone>(ring: &mut Option<broadcast::Receiver<T>>) -> Result<T, RecvError> {
    match ring {
        Some(ring) => ring.recv().await,
        None => std::future::pending().await,
    }
}

/// The next message, if there is one already.
fn waiting<T: Clone>(ring: &mut Option<broadcast::Receiver<T>>) -> Option<Result<T, RecvError>> {
    match ring.as_mut()?.try_recv() {
        Ok(message) => Some(Ok(message)),
        Err(TryRecvError::Lagged(count)) => Some(Err(RecvError::Lagged(count))),
        Err(TryRecvError::Empty | TryRecvError::Closed) => None,
    }
}

struct Client<'a> {
    feed: Arc<Feed>,
    link: &'a Link,
    write_timeout: Duration,
    policy: Policy,
    /// Only while something is watched for: an idle client costs the publisher nothing.
    ring: Option<broadcast::Receiver<Message>>,
    readings: Option<broadcast::Receiver<(u64, Reading)>>,
    /// Numbers of the last events sent, or passed over while they were not watched for.
    state_seen: u64,
    calibration_seen: u64,
    /// Reused for every line.
    line: String,
}

impl Client<'_> {
    async fn answer(&mut self, request: Result<Request, String>) -> Result<(), ClientError> {
        match request {
            Err(message) => self.send(&gpsd::error(&message)).await,
            Ok(Request::Policy) => self.send_policy().await,
            Ok(Request::Watch(watch)) => self.watch(&watch).await,
            Ok(Request::Poll) => self.send(&self.feed.poll()).await,
            Ok(Request::Devices) => self.send(&gpsd::devices(&self.feed.device)).await,
            Ok(Request::Device) => self.send(&gpsd::device(&self.feed.device)).await,
            Ok(Request::Version) => self.send(&gpsd::version()).await,
        }
    }

    /// gpsd answers any `?WATCH` with the devices and then the policy.
    async fn send_policy(&mut self) -> Result<(), ClientError> {
        self.send(&gpsd::devices(&self.feed.device)).await?;
        self.send(&gpsd::watch(&self.policy)).await
    }

    async fn watch(&mut self, watch: &Watch) -> Result<(), ClientError> {
        if let Some(device) = &watch.device
            && *device != self.feed.device.path
        {
            let message = format!(
                "no such device as {device}: the only one is {}",
                self.feed.device.path
            );
            return self.send(&gpsd::error(&message)).await;
        }
        let before = self.policy;
        watch.apply(&mut self.policy);
        let Policy {
            enable,
            json,
            calibration,
            state,
            readings,
        } = self.policy;
        // Before the answer: whatever is published after a client has read it reaches that client.
        if !(enable && (json || calibration || state)) {
            self.ring = None;
        } else if self.ring.is_none() {
            self.ring = Some(self.feed.subscribe());
        }
        let announced = self.readings.is_some();
        if !(enable && readings) {
            self.readings = None;
        } else if !announced {
            self.readings = Some(self.feed.subscribe_readings());
        }
        self.send_policy().await?;
        let board = self.feed.board();
        if self.readings.is_some() && !announced && !board.is_empty() {
            self.send(&board).await?;
        }
        if self.ring.is_none() {
            return Ok(());
        }
        // Whoever turns events on is told at once how things stand, even if it has been told before.
        if state && !(before.enable && before.state) {
            self.state_seen = 0;
        }
        if calibration && !(before.enable && before.calibration) {
            self.calibration_seen = 0;
        }
        self.catch_up().await
    }

    async fn forward(&mut self, message: Result<Message, RecvError>) -> Result<(), ClientError> {
        match message {
            Ok(Message::Att { begun, taken }) => {
                if !self.policy.json || self.feed.is_stale(taken) {
                    return Ok(());
                }
                self.line.clear();
                self.line.push_str(&begun);
                gpsd::att_end(&mut self.line, age_ms(taken));
                self.write_line().await
            }
            Ok(Message::State(event)) => self.send_state(&event).await,
            Ok(Message::Calibration(event)) => self.send_calibration(&event).await,
            // Missed headings are gone, and their `seq` says so. Missed events are made up for.
            Err(RecvError::Lagged(_)) => self.catch_up().await,
            Err(RecvError::Closed) => {
                self.ring = None;
                Ok(())
            }
        }
    }

    async fn send_reading(
        &mut self,
        reading: Result<(u64, Reading), RecvError>,
    ) -> Result<(), ClientError> {
        match reading {
            Ok((seq, reading)) => self.send(&raw::reading(seq, &reading)).await,
            // Missed readings are gone, and their `seq` says so.
            Err(RecvError::Lagged(_)) => Ok(()),
            Err(RecvError::Closed) => {
                self.readings = None;
                Ok(())
            }
        }
    }

    /// Sends the latest state and calibration, where they are watched for and have not been sent.
    async fn catch_up(&mut self) -> Result<(), ClientError> {
        let (state, calibration) = self.feed.events();
        self.send_state(&state).await?;
        self.send_calibration(&calibration).await
    }

    async fn send_state(&mut self, event: &Event) -> Result<(), ClientError> {
        if event.number <= self.state_seen {
            return Ok(());
        }
        self.state_seen = event.number;
        match self.policy.state {
            true => self.send(&event.line).await,
            false => Ok(()),
        }
    }

    async fn send_calibration(&mut self, event: &Event) -> Result<(), ClientError> {
        if event.number <= self.calibration_seen {
            return Ok(());
        }
        self.calibration_seen = event.number;
        match self.policy.calibration {
            true => self.send(&event.line).await,
            false => Ok(()),
        }
    }

    /// Sends what was published before the server was told to stop.
    async fn drain(&mut self) -> Result<(), ClientError> {
        while let Some(message) = waiting(&mut self.ring) {
            self.forward(message).await?;
        }
        while let Some(reading) = waiting(&mut self.readings) {
            self.send_reading(reading).await?;
        }
        Ok(())
    }

    async fn send(&mut self, object: &str) -> Result<(), ClientError> {
        self.line.clear();
        self.line.push_str(object);
        self.write_line().await
    }

    async fn write_line(&mut self) -> Result<(), ClientError> {
        self.line.push_str(LINE_END);
        timeout(
            self.write_timeout,
            self.link.write_all(self.line.as_bytes()),
        )
        .await
        .map_err(|_| ClientError::TooSlow(self.write_timeout))?
        .map_err(ClientError::Broken)
    }
}
