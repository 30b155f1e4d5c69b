//! How much is tried: a little of everything with every `cargo test`, and much of it with `tests/slow`.

/// Whether this is `tests/slow`.
pub fn slow() -> bool {
    std::env::var_os("HEADINGD_SLOW_TESTS").is_some_and(|value| value == "1")
}

/// How often something is tried: so often with every `cargo test`, so often with `tests/slow`.
pub fn times(quick: usize, slowly: usize) -> usize {
    if slow() { slowly } else { quick }
}
