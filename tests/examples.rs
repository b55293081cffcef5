//! The examples do what they say: each checks its own outcome.

#[path = "../examples/progress.rs"]
mod progress;
#[path = "../examples/sink.rs"]
mod sink;
#[path = "../examples/slice.rs"]
mod slice;
#[path = "../examples/source.rs"]
mod source;

#[test]
fn from_a_slice_to_triangles() {
    slice::main().unwrap();
}

#[test]
fn points_from_a_source_of_ones_own() {
    source::main().unwrap();
}

#[test]
fn a_mesh_piece_by_piece() {
    sink::main().unwrap();
}

#[test]
fn progress_and_cancelling() {
    progress::main().unwrap();
}
