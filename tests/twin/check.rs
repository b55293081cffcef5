//! Is a mesh a closed, consistently oriented 2-manifold? By brute force.

use std::collections::{BTreeMap, BTreeSet};

/// `Ok` if the link of every vertex is one directed simple cycle of at least three vertices.
pub fn check(vertices: usize, faces: &[[u32; 3]]) -> Result<(), String> {
    let mut links: Vec<BTreeMap<u32, u32>> = vec![BTreeMap::new(); vertices];
    for &[a, b, c] in faces {
        if a == b || b == c || c == a {
            return Err(format!("triangle {a} {b} {c} is degenerate"));
        }
        for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            let link = links.get_mut(v as usize).ok_or_else(|| format!("vertex {v} does not exist"))?;
            if link.insert(from, to).is_some() {
                return Err(format!("edge {v} {from} has two triangles on its left"));
            }
        }
    }
    for (v, link) in links.iter().enumerate() {
        let Some((&start, _)) = link.first_key_value() else {
            return Err(format!("vertex {v} has no triangle"));
        };
        let mut seen = BTreeSet::new();
        let mut at = start;
        while seen.insert(at) {
            at = *link.get(&at).ok_or_else(|| format!("edge {v} {at} is open"))?;
        }
        if at != start || seen.len() != link.len() || seen.len() < 3 {
            return Err(format!("the link of vertex {v} is not one simple cycle: {link:?}"));
        }
    }
    Ok(())
}

/// `Ok` if the link of every vertex is one directed simple path or cycle: an oriented manifold, which may have a boundary. Gives the number of the
/// boundary's loops.
pub fn check_open(vertices: usize, faces: &[[u32; 3]]) -> Result<usize, String> {
    let mut links: Vec<BTreeMap<u32, u32>> = vec![BTreeMap::new(); vertices];
    let mut sides = BTreeSet::new();
    for &[a, b, c] in faces {
        if a == b || b == c || c == a {
            return Err(format!("triangle {a} {b} {c} is degenerate"));
        }
        for [v, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
            if links[v as usize].insert(from, to).is_some() {
                return Err(format!("edge {v} {from} has two triangles on its left"));
            }
            sides.insert((v, from));
        }
    }
    for (v, link) in links.iter().enumerate() {
        let ends: BTreeSet<u32> = link.values().copied().collect();
        let start = link.keys().copied().find(|from| !ends.contains(from)).or(link.keys().copied().next());
        let mut at = start.ok_or_else(|| format!("vertex {v} has no triangle"))?;
        let mut seen = 0;
        while let Some(next) = link.get(&at) {
            at = *next;
            seen += 1;
            if seen == link.len() {
                break;
            }
        }
        if seen != link.len() || ends.len() != link.len() {
            return Err(format!("the link of vertex {v} is not one simple path or cycle: {link:?}"));
        }
    }
    // Of each vertex on the boundary, the next.
    let mut rim: BTreeMap<u32, u32> =
        sides.iter().filter(|(a, b)| !sides.contains(&(*b, *a))).map(|(a, b)| (*a, *b)).collect();
    let mut loops = 0;
    while let Some((&start, _)) = rim.first_key_value() {
        let mut at = start;
        while let Some(next) = rim.remove(&at) {
            at = next;
        }
        if at != start {
            return Err(format!("the boundary from vertex {start} does not close"));
        }
        loops += 1;
    }
    Ok(loops)
}

/// Six times the enclosed volume; positive if normals point out.
pub fn six_volumes(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> f64 {
    let mut sum = 0.0;
    for face in faces {
        let [a, b, c] = face.map(|v| vertices[v as usize]);
        sum += a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    sum
}
