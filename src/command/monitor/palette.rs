//! How things look: with the terminal's own colours, light or dark, or without any.

use std::env;

use ratatui::style::{Color, Modifier, Style as Cell};

use crate::logging::no_colour;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Palette {
    pub(super) colour: bool,
    /// Characters beyond ASCII.
    pub(super) unicode: bool,
}

impl Palette {
    /// Colour unless NO_COLOR is set, and Unicode where the locale has it.
    pub(super) fn of_terminal() -> Self {
        let set = |name: &str| env::var(name).ok().filter(|value| !value.is_empty());
        let locale = set("LC_ALL").or(set("LC_CTYPE")).or(set("LANG"));
        let locale = locale.unwrap_or_default().to_lowercase();
        Self {
            colour: !no_colour(),
            unicode: locale.contains("utf-8") || locale.contains("utf8"),
        }
    }

    /// What matters most.
    pub(super) fn strong(self) -> Cell {
        Cell::new().add_modifier(Modifier::BOLD)
    }

    /// What matters least.
    pub(super) fn faint(self) -> Cell {
        Cell::new().add_modifier(Modifier::DIM)
    }

    /// A condition's word: black on a colour is legible on any background.
    pub(super) fn badge(self, word: &str) -> Cell {
        let reversed = Cell::new().add_modifier(Modifier::REVERSED | Modifier::BOLD);
        if !self.colour {
            return reversed;
        }
        match word {
            "good" => Cell::new().fg(Color::Black).bg(Color::Green),
            "stale" | "fault" | "lost" => Cell::new().fg(Color::White).bg(Color::Red),
            _ => Cell::new().fg(Color::Black).bg(Color::Yellow),
        }
    }

    /// What has been corrected, against what is raw.
    pub(super) fn corrected(self) -> Cell {
        if self.colour {
            self.strong().fg(Color::Green)
        } else {
            self.strong()
        }
    }

    /// What is raw.
    pub(super) fn raw(self) -> Cell {
        if self.colour {
            Cell::new().fg(Color::Red)
        } else {
            self.faint()
        }
    }
}
