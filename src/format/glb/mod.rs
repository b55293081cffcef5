//! GLB: binary glTF.

pub(crate) mod mesh;
pub(crate) mod write;
