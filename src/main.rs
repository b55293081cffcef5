//! The `asra-stream` command.
fn main() {}
