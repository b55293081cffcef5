//! The examples do what they say: each checks its own outcome.

mod slice {
    include!("../examples/slice.rs");

    #[test]
    fn from_a_slice_to_triangles() {
        main().unwrap();
    }
}

mod source {
    include!("../examples/source.rs");

    #[test]
    fn points_from_a_source_of_ones_own() {
        main().unwrap();
    }
}

mod sink {
    include!("../examples/sink.rs");

    #[test]
    fn a_mesh_piece_by_piece() {
        main().unwrap();
    }
}

mod progress {
    include!("../examples/progress.rs");

    #[test]
    fn progress_and_cancelling() {
        main().unwrap();
    }
}
