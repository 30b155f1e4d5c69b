//! What comes from the daemon: two threads, one a socket.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, SyncSender};
use std::thread;
use std::time::Duration;

use serde_json::Value;

use super::super::control::{daemon_status, exchange};
use super::super::headings::{DaemonSockets, Headings};
use super::super::{Failure, text};
use crate::publish::control::ControlRequest;
use crate::publish::control::status::DaemonStatus;

/// Everything that the screen shows.
const WATCH: &str =
    r#"{"enable":true,"json":true,"state":true,"calibration":true,"readings":true}"#;

/// How often the daemon is asked how it does, and how soon a lost connection is tried again.
const LOOK: Duration = Duration::from_secs(1);

/// How many messages wait for the screen; then the daemon's wait, and it leaves some out.
const WAITING: usize = 2048;

#[derive(Clone, Debug)]
pub(super) enum News {
    /// An object of the socket for headings.
    Object(Value),
    /// That socket is lost, and why; it is tried again.
    Lost(String),
    /// The answer to `status`, or why there is none.
    Status(Result<Box<DaemonStatus>, String>),
    /// The answer to what the user has ordered.
    Answer(String),
}

/// The threads' other end.
pub(super) struct Feeds {
    news: Receiver<News>,
    orders: Sender<ControlRequest>,
}

impl Feeds {
    /// Connects to both sockets. Without the control socket, which is not for everybody, headings are shown all the same.
    pub(super) fn open(sockets: &DaemonSockets) -> Result<Self, Failure> {
        let (sender, news) = mpsc::sync_channel(WAITING);
        let (orders, ordered) = mpsc::channel();
        let first = Headings::open(&sockets.headings, WATCH)?;
        let (these, to_screen) = (sockets.clone(), sender.clone());
        thread::spawn(move || listen(&these, first, &to_screen));
        let these = sockets.clone();
        thread::spawn(move || look_after(&these, &ordered, &sender));
        Ok(Self { news, orders })
    }

    pub(super) fn drain(&self, mut take: impl FnMut(News)) {
        for news in self.news.try_iter().take(WAITING) {
            take(news);
        }
    }

    /// Sends a request to the daemon; its answer is among the news.
    pub(super) fn ask(&self, request: ControlRequest) {
        // The thread goes on for as long as this lives.
        let _ = self.orders.send(request);
    }
}

/// An error means that the screen is gone, and ends the thread.
fn listen(sockets: &DaemonSockets, first: Headings, screen: &SyncSender<News>) {
    let mut headings = Ok(first);
    loop {
        let why = match headings {
            Ok(mut open) => loop {
                match open.object() {
                    Ok(object) => {
                        if screen.send(News::Object(object)).is_err() {
                            return;
                        }
                    }
                    Err(failure) => break failure,
                }
            },
            Err(failure) => failure,
        };
        if screen.send(News::Lost(why.message)).is_err() {
            return;
        }
        thread::sleep(LOOK);
        headings = Headings::open(&sockets.headings, WATCH);
    }
}

fn look_after(
    sockets: &DaemonSockets,
    ordered: &Receiver<ControlRequest>,
    screen: &SyncSender<News>,
) {
    let mut said = None;
    loop {
        let status = daemon_status(&sockets.control).map_err(|failure| failure.message);
        // An answer is sent after the new status, on which the effect of the next key depends.
        let news = [Some(News::Status(status.map(Box::new))), said.take()];
        if news
            .into_iter()
            .flatten()
            .any(|news| screen.send(news).is_err())
        {
            return;
        }
        match ordered.recv_timeout(LOOK) {
            Ok(request) => {
                said = Some(News::Answer(
                    match exchange(&sockets.control, &request, false) {
                        Ok(answer) => text(&answer, "message").to_owned(),
                        Err(failure) => failure.message,
                    },
                ));
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}
