//! A report on a log: one page with figures, which needs neither network nor scripts.
//!
//! [`Analysis`] takes the readings through the same pipeline as the daemon, and [`page`] shows what came of them.

mod analysis;
mod deviation;
mod field;
mod html;
mod page;
mod plot;
mod swarm;
mod thin;
mod timeline;
mod turn;

pub use analysis::Analysis;
pub use page::page;
