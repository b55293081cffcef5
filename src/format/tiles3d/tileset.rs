//! The tree of a tileset as JSON.

use serde_json::{Map, Value, json};

/// A tile of the tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Smallest and largest coordinates of what it and the tiles below it hold.
    pub bounds: [[f64; 3]; 2],
    /// No place of its surface, or of the mesh's, is farther than this from the other, in metres or the mesh's units.
    pub error: f64,
    /// The name of its content; none of a root that only joins others.
    pub content: Option<String>,
    /// The numbers of the tiles that take its place.
    pub children: Vec<usize>,
}

/// The tree below tile `root`, as `tileset.json` has it. `transform` is the root's, column by column; `extras` go into `asset`.
pub fn json(nodes: &[Node], root: usize, transform: Option<[f64; 16]>, extras: Value) -> Value {
    let asset =
        json!({ "version": "1.1", "generator": concat!("asra-stream ", env!("CARGO_PKG_VERSION")), "extras": extras });
    // If nothing is shown, as much is missing as the whole is large.
    let [low, high] = nodes[root].bounds;
    let size = libm::sqrt((0..3).map(|a| (high[a] - low[a]) * (high[a] - low[a])).sum());
    let mut tree = tile(nodes, root);
    tree["refine"] = json!("REPLACE");
    if let Some(transform) = transform {
        tree["transform"] = json!(transform);
    }
    json!({ "asset": asset, "geometricError": size.max(nodes[root].error), "root": tree })
}

/// A tile and those below it. There are as many levels as errors double, some dozens.
fn tile(nodes: &[Node], number: usize) -> Value {
    let Node { bounds: [low, high], error, content, children } = &nodes[number];
    let middle: [f64; 3] = std::array::from_fn(|a| low[a].midpoint(high[a]));
    // Rounded outwards, so that what lies on the border lies within.
    let half: [f64; 3] =
        std::array::from_fn(|a| (high[a] - middle[a]).max(middle[a] - low[a]).next_up() + 1e-9 * middle[a].abs());
    let [x, y, z] = middle;
    let mut out = Map::new();
    let volume = [x, y, z, half[0], 0.0, 0.0, 0.0, half[1], 0.0, 0.0, 0.0, half[2]];
    out.insert("boundingVolume".into(), json!({ "box": volume }));
    out.insert("geometricError".into(), json!(error));
    if let Some(uri) = content {
        out.insert("content".into(), json!({ "uri": uri }));
    }
    if !children.is_empty() {
        out.insert("children".into(), children.iter().map(|child| tile(nodes, *child)).collect());
    }
    Value::Object(out)
}
