//! The `asra-stream` command: arguments in, exit code out; everything else is the library's.

use std::process::ExitCode;

/// Slabs allocate and free tens of megabytes at a time from several threads. The system's allocator keeps much of that for
/// itself (twice the plan was seen resident); this one gives it back.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    asra_stream::cli::main()
}
