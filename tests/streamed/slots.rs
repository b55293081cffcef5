//! Slots and fins of two to three sampling distances: open from their mouths to their floors, without rungs, whichever way they lie to the grid.

use asra_stream::Reconstruction;

/// A comb, whose sampling distance is 1: slots as deep between fins as high, on a block.
struct Comb {
    slot: f64,
    fin: f64,
    deep: f64,
    /// Angles round x, y and z.
    turn: [f64; 3],
}

const SLOTS: u32 = 4;

impl Comb {
    /// Turns a place of the comb, which lies along x, its slots along y and open towards z.
    fn turned(&self, place: [f64; 3]) -> [f64; 3] {
        (0..3).fold(place, |mut p, a| {
            let (sin, cos) = self.turn[a].sin_cos();
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            (p[b], p[c]) = (cos * p[b] - sin * p[c], sin * p[b] + cos * p[c]);
            p
        })
    }

    /// One sample to a unit of area, at random.
    fn samples(&self, seed: u64) -> Vec<[f32; 3]> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let [wide, long, base] = [self.start_of(SLOTS) + self.fin, 40.0, 8.0];
        // The outline across y: corners in order, from the block's lower ones over the fins.
        let mut outline = vec![[0.0, 0.0], [0.0, base + self.deep]];
        for slot in 0..SLOTS {
            let from = self.start_of(slot) + self.fin;
            outline.extend([self.deep, 0.0].map(|z| [from, base + z]));
            outline.extend([0.0, self.deep].map(|z| [from + self.slot, base + z]));
        }
        outline.extend([[wide, base + self.deep], [wide, 0.0], [0.0, 0.0]]);
        let mut out = Vec::new();
        for (a, b) in outline.iter().zip(&outline[1..]) {
            let count = ((b[0] - a[0]).hypot(b[1] - a[1]) * long).round() as u32;
            for _ in 0..count {
                let (t, y) = (next(), long * next());
                out.push([a[0] + t * (b[0] - a[0]), y, a[1] + t * (b[1] - a[1])]);
            }
        }
        // The two ends: the outline's box without the slots.
        for _ in 0..(2.0 * wide * (base + self.deep)) as u32 {
            let [x, z] = [wide * next(), (base + self.deep) * next()];
            let y = long * (next() * 2.0).floor();
            let along = x % (self.fin + self.slot);
            if z < base || along < self.fin {
                out.push([x, y, z]);
            }
        }
        out.into_iter().map(|place| self.turned(place).map(|c| c as f32)).collect()
    }

    /// Where a slot and the fin before it begin.
    fn start_of(&self, slot: u32) -> f64 {
        f64::from(slot) * (self.fin + self.slot)
    }
}

#[test]
fn slots_of_combs_are_open_and_have_no_rungs() {
    for (number, (slot, fin, turn)) in
        (1..).zip([(2.5, 2.8, [0.3, 0.1, 0.5]), (2.8, 2.8, [0.0, 0.3, 0.0]), (2.5, 3.5, [0.6, 0.4, 0.2])])
    {
        let points = Comb { slot, fin, deep: 16.0, turn }.samples(number);
        let made = |threads| Reconstruction::of(&points[..]).threads(threads).run().unwrap();
        let mesh = made(2);
        let check = mesh.check().unwrap();
        assert_eq!((check.components, check.genus), (1, Some(0)), "slots of {slot}, fins of {fin}: {check}");
        let area = check.area / points.len() as f64 - 1.0;
        assert!(area.abs() < 0.06, "slots of {slot}, fins of {fin}: {area} of the area too much");
        assert!(mesh.triangles().unwrap() == made(1).triangles().unwrap());
    }
}
