//! What lies near a part's border in a pass that others follow: it leaves them tolerance.
//!
//! Vertices at a border have to stay until a later pass. If the triangles beside them had used the tolerance up by then, they would have to stay for good, and a seam
//! would show.
//!
//! ```text
//!    border
//!      |/\/\  /\    /         nearer than its longest edge, a triangle may use up the same share of the tolerance as
//!      |\/\/\/  \  /          its distance is of that edge: triangles become larger as they lie farther off
//!      |/\/\/\  / \/
//! ```

use glam::DVec3;

fn longest([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a)).sqrt()
}

/// Whether a triangle that lies so far from the border is near it.
pub(super) fn is_near(depth: f64, corners: [DVec3; 3]) -> bool {
    depth < longest(corners)
}

/// The share of the tolerance that a triangle may use up that lies so far from the border.
pub(super) fn share(depth: f64, corners: [DVec3; 3]) -> f64 {
    (depth / longest(corners)).min(1.0)
}
