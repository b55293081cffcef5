//! What a run may use: worker threads, memory, the machine they are on.

pub mod allocator;
pub mod machine;
pub mod memory;
pub mod workers;
