//! How exact calibrations are, what they refuse, and that they never end in a trap.

use std::sync::atomic::{AtomicUsize, Ordering};

mod bound;
mod cases;
mod disturbed;
mod hostile;
mod judgement;
mod precision;
mod soft_iron;
mod survey;

/// What comes of each of these jobs, in any order.
fn on_two_threads<J: Sync, R: Send>(jobs: &[J], work: impl Fn(&J) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let take = || jobs.get(next.fetch_add(1, Ordering::Relaxed));
    let run = || std::iter::from_fn(take).map(&work).collect::<Vec<R>>();
    std::thread::scope(|scope| {
        let other = scope.spawn(run);
        let mut all = run();
        all.extend(other.join().unwrap());
        all
    })
}
