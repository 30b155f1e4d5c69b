//! How the board is mounted, told or changed at the control socket.

use super::Daemon;
use crate::frame::{Mounting, wrap_pi};
use crate::pipeline::Event;
use crate::publish::control::Answer;
use crate::store::BoardMounting;

/// A board that turns faster is not held still, rad/s (6° a second): a boat at its berth rolls more slowly.
const HELD_RAD_S: f64 = 0.1;

impl Daemon {
    /// Tells how the board is mounted, after setting it, if asked to: `level` now, at `heading_deg` now, or as configured (`reset`).
    pub(super) fn mount(
        &mut self,
        level: bool,
        heading_deg: Option<f64>,
        reset: bool,
    ) -> Result<Answer, Answer> {
        if !(level || reset || heading_deg.is_some()) {
            return Ok(self.mounted());
        }
        let session = &self.session;
        let configured = session.config.mounting.board();
        let chips = session.source.header.mountings;
        let before = self.history().board(&configured);
        let board = if reset {
            configured
        } else {
            // Levelling turns no heading, so that the two may come in any order.
            let levelled = if level {
                self.levelling()?.after(&before)
            } else {
                before
            };
            let turn = heading_deg
                .map(|heading_deg| self.turning(heading_deg))
                .transpose()?;
            turn.map_or(levelled, |turn| turn.after(&levelled))
                .rounded()
        };
        let told = BoardMounting {
            board_axes: board,
            configured,
        };
        let changes = board != configured;
        let session = &mut self.session;
        session.store.history_mut().mounting = changes.then(|| Box::new(told));
        session.heading_deg = None;
        self.handle(Event::Mounted(Box::new(chips.on(&board))));
        Ok(self.mounted())
    }

    fn levelling(&self) -> Result<Mounting, Answer> {
        let (down, rate_rad_s) = self.session.pipeline.down().ok_or_else(|| {
            let message = "no accelerometer tells where down is: if there is one, ask again in a second; else set board_axes of [mounting]";
            Answer::refused("no_tilt", message)
        })?;
        if rate_rad_s > HELD_RAD_S {
            return Err(moving());
        }
        Mounting::levelling(&down).ok_or_else(|| {
            let message = "the board's X points up or down, so that nothing tells which way is ahead: set board_axes of \
                           [mounting] roughly right first";
            Answer::refused("ahead_unknown", message)
        })
    }

    /// The rotation that makes the heading this one.
    fn turning(&self, wanted_deg: f64) -> Result<Mounting, Answer> {
        let latest = self.publisher.latest();
        let turning_deg_min = latest.as_ref().and_then(|heading| heading.turn_deg_min);
        if turning_deg_min.is_some_and(|rate| (rate / 60.0).to_radians().abs() > HELD_RAD_S) {
            return Err(moving());
        }
        let fresh = latest.is_some();
        let heading_deg = self.session.heading_deg.filter(|_| fresh).ok_or_else(|| {
            let message =
                "there is no heading now that could be set right: headingd status says why";
            Answer::refused("no_heading", message)
        })?;
        let offset_rad = wrap_pi((wanted_deg - heading_deg).to_radians());
        Ok(Mounting::adding_to_heading(offset_rad.to_degrees()))
    }

    fn mounted(&self) -> Answer {
        let configured = self.session.config.mounting.board();
        let board = self.history().board(&configured);
        let (from, rest) = if board == configured {
            ("configuration", String::new())
        } else {
            let configured = configured.rounded();
            (
                "store",
                format!(", as the daemon was told while it ran; [mounting] says \"{configured}\""),
            )
        };
        let board = board.rounded();
        Answer::done(format!("the board is mounted \"{board}\"{rest}"))
            .with("board_axes", board.to_string())
            .with("from", from)
    }
}

fn moving() -> Answer {
    let message = "the board is turning: hold it still, and ask again";
    Answer::refused("moving", message)
}
