//! headingd
fn main() {}
