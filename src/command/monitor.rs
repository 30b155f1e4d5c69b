//! `headingd monitor`: the running daemon on a terminal.

mod directions;
mod feeds;
mod palette;
mod rose;
mod scatter;
mod screen;
mod view;

use std::env;
use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

use super::headings::HeadingTarget;
use super::{Failure, OrFail, tell, watch};
use crate::publish::control::ControlRequest;
use feeds::Feeds;
use palette::Palette;
use view::View;

/// Redraw interval. Only changed cells are sent, so slow links keep up.
const REDRAW: Duration = Duration::from_millis(200);

/// Watch the running daemon on the terminal
///
/// Shows the heading with its uncertainty, the condition and what to do next, the field before and after its
/// correction, and how good the calibration is. Made for 80 columns and 24 lines: a smaller terminal has the heading, the
/// condition, and what else there is room for; one that knows no escape sequences (TERM=dumb) has the lines of headingd
/// watch. It works without colour (NO_COLOR) and over ssh. Keys: c calibrates on the next turn, x gives that up, l locks and unlocks the calibration,
/// r rolls back to the one before, v tells that the board is level now, q ends.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub target: HeadingTarget,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if !io::stdout().is_terminal() || !io::stdin().is_terminal() {
        let message = "monitor needs a terminal: for programs there is headingd watch";
        return Err(Failure::new(Failure::USAGE, message));
    }
    if env::var_os("TERM").is_some_and(|term| term == "dumb") {
        tell("TERM=dumb has no screen to draw on: headings come as headingd watch prints them");
        return watch::run(&watch::Args {
            target: args.target.clone(),
            ..watch::Args::default()
        });
    }
    let sockets = args.target.sockets()?;
    let feeds = Feeds::open(&sockets)?;
    let stop = stop_signals()?;
    let mut view = View::new(sockets.headings.display().to_string());
    let mut terminal = ratatui::try_init().or_fail(Failure::IO, NO_TERMINAL)?;
    let ended = show(&mut terminal, &mut view, &feeds, &stop);
    // A terminal that is gone cannot be given back: ratatui would say so on it, and panic.
    if ratatui::try_restore().is_err() {
        std::mem::forget(terminal);
    }
    ended.or_fail(Failure::IO, NO_TERMINAL)
}

const NO_TERMINAL: &str = "cannot use the terminal";

/// Becomes true on a signal that ends the command, so that the terminal is restored first.
fn stop_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT, SIGHUP] {
        let registered = flag::register(signal, stop.clone());
        registered.or_fail(Failure::SYSTEM, "cannot catch signals")?;
    }
    Ok(stop)
}

fn show(
    terminal: &mut ratatui::DefaultTerminal,
    view: &mut View,
    feeds: &Feeds,
    stop: &AtomicBool,
) -> io::Result<()> {
    let style = Palette::of_terminal();
    while !stop.load(Ordering::Relaxed) {
        feeds.drain(|news| view.take(news, Instant::now()));
        terminal.draw(|frame| screen::draw(view, &style, Instant::now(), frame))?;
        let until = Instant::now() + REDRAW;
        while let Some(event) = next_event(until)? {
            if let Event::Key(key) = event
                && key.kind != KeyEventKind::Release
                && press(key, view, feeds)
            {
                return Ok(());
            }
            // Another size: drawn at once.
            if let Event::Resize(..) = event {
                break;
            }
        }
    }
    Ok(())
}

/// The next key press or resize; `None` if there is none before `until`.
fn next_event(until: Instant) -> io::Result<Option<Event>> {
    // What Crossterm has read before comes first.
    let mut patience = Duration::ZERO;
    loop {
        wait_for_input(patience)?;
        if event::poll(Duration::ZERO)? {
            return event::read().map(Some);
        }
        patience = until.saturating_duration_since(Instant::now());
        if patience.is_zero() {
            return Ok(None);
        }
    }
}

/// Waits for input or a signal: a resize is one. A terminal that has hung up is an error: Crossterm would read its
/// end-of-file again and again.
fn wait_for_input(patience: Duration) -> io::Result<()> {
    let stdin = io::stdin();
    let mut waiting = [PollFd::new(&stdin, PollFlags::IN)];
    let patience = patience.try_into().map_err(io::Error::other)?;
    match rustix::event::poll(&mut waiting, Some(&patience)) {
        Ok(_) if waiting[0].revents().intersects(HANGUP) => Err(io::Error::other("it has hung up")),
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

const HANGUP: PollFlags = PollFlags::HUP.union(PollFlags::ERR);

/// Does what a key is for; whether that is to end.
fn press(key: KeyEvent, view: &mut View, feeds: &Feeds) -> bool {
    if key.modifiers.contains(KeyModifiers::CONTROL) && key.code == KeyCode::Char('c') {
        return true;
    }
    // Other programs redraw the screen at Ctrl-L: it must not lock the calibration here.
    if key
        .modifiers
        .intersects(KeyModifiers::CONTROL | KeyModifiers::ALT)
    {
        return false;
    }
    if let Some((_, request)) = view.asking.take() {
        if key.code == KeyCode::Char('y') {
            feeds.ask(request);
        }
        return false;
    }
    match key.code {
        KeyCode::Char('q') | KeyCode::Esc => return true,
        KeyCode::Char('c') => feeds.ask(ControlRequest::Start {}),
        KeyCode::Char('x') => feeds.ask(ControlRequest::Cancel {}),
        KeyCode::Char('l') if view.is_locked() => feeds.ask(ControlRequest::Unlock {}),
        KeyCode::Char('l') => feeds.ask(ControlRequest::Lock {}),
        KeyCode::Char('r') => {
            let question = "roll back to the calibration before?";
            view.asking = Some((question, ControlRequest::Rollback { number: None }));
        }
        KeyCode::Char('v') => {
            let question = "is the board level now?";
            let request = ControlRequest::Mounting {
                level: true,
                heading_deg: None,
                reset: false,
            };
            view.asking = Some((question, request));
        }
        _ => {}
    }
    false
}

#[cfg(test)]
mod tests;
