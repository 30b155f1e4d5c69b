//! How the board is mounted, where that was told to the running daemon.

use serde::{Deserialize, Serialize};

use crate::frame::Mounting;

/// Two mountings that differ by less, in any of the nine numbers, are the same: libraries differ in the last digit of a sine.
const SAME: f64 = 1e-9;

/// How the board is mounted, and what the configuration said of that at the time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoardMounting {
    /// Board axes along body X, Y, Z.
    pub board_axes: Mounting,
    /// The same by the configuration, in place of which it was told.
    pub configured: Mounting,
}

impl BoardMounting {
    /// Whether it still holds: a configuration that says something else since then was the last to be changed.
    pub fn holds(&self, configured: &Mounting) -> bool {
        let difference = self.configured.rotation() - configured.rotation();
        difference.amax() < SAME
    }

    /// What is wrong in itself.
    pub(super) fn fault(&self) -> Option<String> {
        let mirrored = self.board_axes.is_mirrored();
        mirrored.then(|| "mounting.board_axes is mirrored, but must be a rotation".to_owned())
    }
}
