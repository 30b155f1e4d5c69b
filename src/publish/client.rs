//! One client: its requests are answered, and what it watches for is sent to it.

use std::io::{self, ErrorKind};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use tokio::net::UnixStream;
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::sync::{broadcast, watch};
use tokio::task::yield_now;

use super::connection::Connection;
use super::feed::{Broadcast, EventKind, Feed, NumberedLine, PublishedHeading, Raw};
use super::gpsd::{self, LINE_END, WatchPolicy};
use super::inbox::Inbox;
use super::rate_limit::RateLimit;
use super::raw;
use super::request::{ClientRequest, WatchRequest};

/// Bytes that are sent together.
const MOST_BYTES: usize = 4096;

/// Requests answered in a row before other clients have their turn: some 50 µs.
const MOST_ANSWERS: usize = 16;

#[derive(Debug, Error)]
pub(super) enum ClientError {
    #[error("the connection broke: {0}")]
    Broken(#[from] io::Error),
    #[error(
        "it is {messages} messages behind, and in {patience:?} has not read enough of them to be sent more; let it read faster, \
         ask for fewer (rate_hz in ?WATCH), or raise socket.write_timeout_s"
    )]
    TooSlow { messages: usize, patience: Duration },
    #[error("it has not read its answer within {0:?}")]
    Unread(Duration),
}

/// Serves one client until it leaves, breaks, is too slow, or `stop` says that the server stops.
pub(super) async fn serve(
    stream: UnixStream,
    feed: Arc<Feed>,
    request_limit_bytes: usize,
    write_timeout: Duration,
    mut stop: watch::Receiver<bool>,
) -> Result<(), ClientError> {
    let link = &Connection::new(stream)?;
    let mut client = Client {
        feed,
        link,
        write_timeout,
        policy: WatchPolicy::default(),
        att_pace: RateLimit::default(),
        nmea_pace: RateLimit::default(),
        ring: None,
        readings: None,
        board: Arc::default(),
        seen: [0; 2],
        lines: String::new(),
    };
    let mut inbox = Inbox::new(request_limit_bytes);
    client.put(&gpsd::version());
    client.send_lines().await?;
    let mut stopped = pin!(stop.changed());
    loop {
        tokio::select! {
            // An error means that the server is gone, which is a reason to stop as well.
            _ = &mut stopped => {
                while client.forward_waiting().await? {}
                return Ok(());
            }
            there = inbox.wait(link) => {
                there?;
                client.answer_waiting(&mut inbox).await?;
                if inbox.ended {
                    return Ok(());
                }
                // A client that asks without end takes turns with the others.
                yield_now().await;
            }
            message = next(&mut client.ring) => {
                client.forward(message);
                client.forward_waiting().await?;
            }
            message = next(&mut client.readings) => {
                client.forward_raw(message);
                client.forward_waiting().await?;
            }
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

fn wants(policy: &WatchPolicy, kind: EventKind) -> bool {
    policy.enable
        && match kind {
            EventKind::State => policy.state,
            EventKind::Calibration => policy.calibration,
        }
}

struct Client<'a> {
    feed: Arc<Feed>,
    link: &'a Connection,
    write_timeout: Duration,
    policy: WatchPolicy,
    /// How often headings go out in each format.
    att_pace: RateLimit,
    nmea_pace: RateLimit,
    /// Only while something is watched for: an idle client costs the publisher nothing.
    ring: Option<broadcast::Receiver<Broadcast>>,
    readings: Option<broadcast::Receiver<Raw>>,
    /// The board that the client was told of since it asked for readings; empty before.
    board: Arc<str>,
    /// For each kind of event, the number of the last one sent, or skipped because it was not watched for.
    seen: [u64; 2],
    /// Lines on their way to the client, together.
    lines: String,
}

impl Client<'_> {
    /// Answers waiting requests, up to 16 or about 4 KiB in one write. Nothing more is read until the answers are written.
    async fn answer_waiting(&mut self, inbox: &mut Inbox) -> Result<(), ClientError> {
        let mut count = 0;
        while count < MOST_ANSWERS
            && self.lines.len() < MOST_BYTES
            && let Some(request) = inbox.next()
        {
            self.answer(request);
            count += 1;
        }
        self.send_lines().await
    }

    fn answer(&mut self, request: Result<ClientRequest, String>) {
        match request {
            Err(message) => self.put(&gpsd::error(&message)),
            Ok(ClientRequest::Policy) => self.put_policy(),
            Ok(ClientRequest::Watch(watch)) => self.watch(&watch),
            Ok(ClientRequest::Poll) => self.put(&self.feed.poll()),
            Ok(ClientRequest::Devices) => self.put(&gpsd::devices(&self.feed.device_line())),
            Ok(ClientRequest::Device) => self.put(&self.feed.device_line()),
            Ok(ClientRequest::Version) => self.put(&gpsd::version()),
        }
    }

    /// gpsd answers any `?WATCH` with the devices and then the policy.
    fn put_policy(&mut self) {
        self.put(&gpsd::devices(&self.feed.device_line()));
        self.put(&gpsd::watch(&self.policy));
    }

    fn watch(&mut self, watch: &WatchRequest) {
        let only = &self.feed.path;
        // gpsd's own library from 3.24 on asks for an empty one: all devices.
        if let Some(device) = &watch.device
            && !(device.is_empty() || device == only)
        {
            let message = format!("no such device as {device}: the only one is {only}");
            return self.put(&gpsd::error(&message));
        }
        let before = self.policy;
        watch.apply(&mut self.policy);
        let policy = self.policy;
        self.att_pace = RateLimit::new(policy.rate_hz);
        self.nmea_pace = RateLimit::new(policy.rate_hz.or(Some(self.feed.nmea_rate_hz())));
        // Before the answer: what is published after a client has read the answer must reach it.
        let events = EventKind::ALL.into_iter().any(|kind| wants(&policy, kind));
        if !(events || policy.enable && (policy.json || policy.nmea)) {
            self.ring = None;
        } else if self.ring.is_none() {
            self.ring = Some(self.feed.subscribe());
        }
        if !(policy.enable && policy.readings) {
            (self.readings, self.board) = (None, Arc::default());
        } else if self.readings.is_none() {
            self.readings = Some(self.feed.subscribe_readings());
        }
        self.put_policy();
        if self.readings.is_some() {
            self.put_board(self.feed.board_line());
        }
        if self.ring.is_none() {
            return;
        }
        // A client that turns events on gets the latest at once, even if it has had it before.
        for kind in EventKind::ALL {
            if !wants(&before, kind) {
                self.seen[kind as usize] = 0;
            }
        }
        self.catch_up();
    }

    fn forward(&mut self, message: Result<Broadcast, RecvError>) {
        match message {
            Ok(Broadcast::Heading(heading)) => self.put_heading(&heading),
            Ok(Broadcast::Event(kind, event)) => self.put_event(kind, &event),
            // Missed headings are gone, and their `seq` says so. Missed events are made up for.
            Err(RecvError::Lagged(_)) => self.catch_up(),
            Err(RecvError::Closed) => self.ring = None,
        }
    }

    /// Puts a heading in the formats that are watched for, where it is due.
    fn put_heading(&mut self, heading: &PublishedHeading) {
        let taken = heading.taken;
        if self.feed.is_stale(taken) {
            return;
        }
        if self.policy.json && self.att_pace.admits(taken) {
            self.feed.put_att(&mut self.lines, heading);
            self.lines.push_str(LINE_END);
        }
        if self.policy.nmea && self.nmea_pace.admits(taken) {
            self.lines.push_str(self.feed.nmea(heading));
        }
    }

    fn forward_raw(&mut self, message: Result<Raw, RecvError>) {
        match message {
            Ok(Raw::Board(line)) => self.put_board(line),
            Ok(Raw::Reading(seq, reading)) => self.put(&raw::reading(seq, &reading)),
            // Missed readings are gone, and their `seq` says so. A new board may be among what was missed.
            Err(RecvError::Lagged(_)) => self.put_board(self.feed.board_line()),
            Err(RecvError::Closed) => self.readings = None,
        }
    }

    /// Puts the board whose readings follow, unless the client knows it.
    fn put_board(&mut self, board: Arc<str>) {
        if board != self.board {
            self.put(&board);
            self.board = board;
        }
    }

    /// Sends waiting messages, about 4 KiB in one write, since each write wakes the client. Returns whether more may wait.
    async fn forward_waiting(&mut self) -> Result<bool, ClientError> {
        while self.lines.len() < MOST_BYTES
            && let Some(message) = waiting(&mut self.ring)
        {
            self.forward(message);
        }
        while self.lines.len() < MOST_BYTES
            && let Some(message) = waiting(&mut self.readings)
        {
            self.forward_raw(message);
        }
        let more = self.lines.len() >= MOST_BYTES;
        self.send_lines().await?;
        Ok(more)
    }

    /// Puts the latest events, where they are watched for and have not been sent.
    fn catch_up(&mut self) {
        let events = self.feed.events();
        for (kind, event) in EventKind::ALL.into_iter().zip(events) {
            self.put_event(kind, &event);
        }
    }

    fn put_event(&mut self, kind: EventKind, event: &NumberedLine) {
        let seen = &mut self.seen[kind as usize];
        if event.number > *seen {
            *seen = event.number;
            if wants(&self.policy, kind) {
                self.put(&event.line);
            }
        }
    }

    /// Puts an object with the lines to be sent.
    fn put(&mut self, object: &str) {
        self.lines.push_str(object);
        self.lines.push_str(LINE_END);
    }

    async fn send_lines(&mut self) -> Result<(), ClientError> {
        let patience = self.write_timeout;
        let written = self.link.write_all(self.lines.as_bytes(), patience);
        written.await.map_err(|error| match error.kind() {
            ErrorKind::TimedOut => ClientError::TooSlow {
                messages: self.behind(),
                patience,
            },
            _ => ClientError::Broken(error),
        })?;
        self.lines.clear();
        Ok(())
    }

    /// How many messages wait: those on their way, and those that have been published since, lost ones included.
    fn behind(&self) -> usize {
        let published = self.ring.as_ref().map_or(0, broadcast::Receiver::len);
        let readings = self.readings.as_ref().map_or(0, broadcast::Receiver::len);
        self.lines.matches(LINE_END).count() + published + readings
    }
}
