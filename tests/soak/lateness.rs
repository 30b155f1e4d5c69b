//! How late headings come: each some seconds after its sample's own time, from an unknown origin.

pub fn earliest_s(after_s: &[f64]) -> f64 {
    after_s.iter().copied().fold(f64::INFINITY, f64::min)
}

/// How much later than the earliest each came, sorted.
pub fn sorted(after_s: &[f64], earliest_s: f64) -> Vec<f64> {
    let mut late_s: Vec<f64> = after_s.iter().map(|after_s| after_s - earliest_s).collect();
    late_s.sort_by(f64::total_cmp);
    late_s
}

/// How late this share of them is at most.
pub fn at_most(share: f64, sorted: &[f64]) -> f64 {
    sorted[(share * (sorted.len() - 1) as f64) as usize]
}
