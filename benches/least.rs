//! How long work takes.

use std::time::{Duration, Instant};

use criterion::Criterion;

/// Measures each piece of work 20 times, as the command line asks for.
pub fn criterion() -> Criterion {
    Criterion::default()
        .sample_size(20)
        .measurement_time(Duration::from_secs(3))
        .without_plots()
        .configure_from_args()
}

/// The least time of the work, seconds: other work on the machine only ever adds time. Infinite if this benchmark was not asked for.
pub fn least(criterion: &mut Criterion, name: &str, mut work: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    criterion.bench_function(name, |bencher| {
        bencher.iter_custom(|count| {
            let start = Instant::now();
            (0..count).for_each(|_| work());
            let elapsed = start.elapsed();
            least = least.min(elapsed.as_secs_f64() / count as f64);
            elapsed
        });
    });
    least
}

/// Whether the times say something: `cargo test` runs every benchmark once.
pub fn is_measured() -> bool {
    std::env::args().any(|argument| argument == "--bench")
}
