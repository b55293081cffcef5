//! The `asra-stream` command: arguments in, exit code out; everything else is the library's.

use std::process::ExitCode;

fn main() -> ExitCode {
    asra_stream::cli::main()
}
