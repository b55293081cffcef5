//! The surface at rest.
mod twin;
use asra_stream::mesh::intersect::intersect;
use twin::{Diagonals, mesh_of_solid};
#[test]
fn rest() {
    let mut h = 12345u64;
    let mut rnd = move || {
        h = h.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        h >> 33
    };
    let mut bad = 0;
    let mut mids = 0;
    for round in 0..4000 {
        let share = 10 + rnd() % 81;
        let n = 3 + (round % 3) as u32;
        let solid: Vec<bool> = (0..n * n * n).map(|_| rnd() % 100 < share).collect();
        let noise = std::env::var("NOISE").map_or(0.0, |v| v.parse::<f64>().unwrap());
        for d in [Diagonals::Delaunay, Diagonals::First, Diagonals::Random] {
            let s = mesh_of_solid(&solid, [n, n, n], 1, d);
            mids += s.middle.iter().filter(|m| **m).count();
            let pos: Vec<[f64; 3]> =
                s.positions.iter().map(|p| p.map(|x| x + noise * ((rnd() % 2001) as f64 / 1000.0 - 1.0))).collect();
            let p = |t: [u32; 3]| t.map(|v| pos[v as usize]);
            for i in 0..s.triangles.len() {
                for j in 0..i {
                    let (a, b) = (s.triangles[i], s.triangles[j]);
                    let (pa, pb) = (p(a), p(b));
                    if (0..3).any(|m| {
                        pa.iter().all(|q| pb.iter().all(|r| q[m] > r[m]))
                            || pa.iter().all(|q| pb.iter().all(|r| q[m] < r[m]))
                    }) {
                        continue;
                    }
                    if intersect(a, pa, b, pb) {
                        bad += 1;
                        if bad < 4 {
                            println!("round {round} {n} {d:?} {a:?} {pa:?} {b:?} {pb:?}");
                        }
                    }
                }
            }
        }
    }
    println!("bad {bad} middles {mids}");
}
