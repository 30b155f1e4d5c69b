//! A log's events, with what they ask for done before the next one.

use super::{Action, Event, Pipeline};

impl Pipeline {
    /// Takes an event of a log. `carry_out` carries an action out; what comes of it, such as the outcome of a calibration, is
    /// the next event. A calibration that ends asks for another now and then, so this goes on until nothing is asked for.
    ///
    /// # Errors
    ///
    /// Those of `carry_out`, which end it.
    pub(crate) fn play<E>(
        &mut self,
        event: Event,
        mut carry_out: impl FnMut(Action) -> Result<Option<Event>, E>,
    ) -> Result<(), E> {
        let mut actions = Vec::new();
        self.handle(event, &mut actions);
        while !actions.is_empty() {
            let mut events = Vec::new();
            for action in actions.drain(..) {
                events.extend(carry_out(action)?);
            }
            for event in events {
                self.handle(event, &mut actions);
            }
        }
        Ok(())
    }
}
