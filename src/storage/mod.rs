//! What lies outside memory: temporary storage, files as memory, files that appear when they are whole.

pub mod atomic_file;
pub(crate) mod mapped;
pub(crate) mod partitions;
pub(crate) mod queue;
pub mod remote;
pub(crate) mod seeds;
pub mod spool;
pub mod steady;
pub mod work;
