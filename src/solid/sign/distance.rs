//! Squared Euclidean distances to the nearest of some cells, exact, in a box (A. Meijster, J. Roerdink, W. Hesselink, *A general algorithm for computing
//! distance transforms in linear time*, 2000): along rows by two sweeps, then across by lower envelopes of parabolas.

/// What is farther than any cell.
pub const FAR: i32 = i32::MAX / 4;

/// The squared distance of each cell to the nearest of `cells`; [`FAR`] if there is none. `size`: cells along the three axes, the first varying fastest.
pub fn squared(cells: &[bool], size: [usize; 3]) -> Vec<i32> {
    let mut out: Vec<i32> = cells.iter().map(|&cell| if cell { 0 } else { FAR }).collect();
    let strides = [1, size[0], size[0] * size[1]];
    let longest = size.into_iter().max().unwrap_or(0);
    let mut line = vec![0i32; longest];
    let mut envelope = Envelope { at: vec![0; longest], from: vec![0; longest] };
    for axis in 0..3 {
        let (n, stride) = (size[axis], strides[axis]);
        for outer in 0..out.len() / (n * stride) {
            for inner in 0..stride {
                let first = outer * n * stride + inner;
                for (i, value) in line[..n].iter_mut().enumerate() {
                    *value = out[first + i * stride];
                }
                if line[..n].iter().any(|value| *value < FAR) {
                    envelope.lower(&line[..n], |i, value| out[first + i * stride] = value);
                }
            }
        }
    }
    out
}

struct Envelope {
    /// Where the parabolas of the envelope have their lowest place.
    at: Vec<i32>,
    /// From where on each is the lowest.
    from: Vec<i32>,
}

impl Envelope {
    /// min_j (i − j)² + line[j] for every i.
    fn lower(&mut self, line: &[i32], mut out: impl FnMut(usize, i32)) {
        let n = line.len() as i32;
        let value = |i: i32, j: i32| (i - j) * (i - j) + line[j as usize];
        let mut count = 0usize;
        for j in (0..n).filter(|j| line[*j as usize] < FAR) {
            loop {
                if count == 0 {
                    (self.at[0], self.from[0], count) = (j, 0, 1);
                    break;
                }
                let (last, from) = (self.at[count - 1], self.from[count - 1]);
                if value(from, last) > value(from, j) {
                    count -= 1;
                    continue;
                }
                // The first place where j's parabola is lower than the last one's.
                let meet =
                    (j * j - last * last + line[j as usize] - line[last as usize]).div_euclid(2 * (j - last)) + 1;
                if meet < n {
                    (self.at[count], self.from[count]) = (j, meet);
                    count += 1;
                }
                break;
            }
        }
        let mut piece = count;
        for i in (0..n).rev() {
            while self.from[piece - 1] > i {
                piece -= 1;
            }
            out(i as usize, value(i, self.at[piece - 1]));
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn distances_are_those_of_the_nearest_cell(
            size in [1usize..9, 1usize..9, 1usize..9],
            share in 0usize..12,
            seed in any::<u64>(),
        ) {
            let count = size.iter().product::<usize>();
            let mut state = seed | 1;
            let cells: Vec<bool> = (0..count).map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                ((state >> 33) as usize % 24) < share
            }).collect();
            let place = |i: usize| [i % size[0], i / size[0] % size[1], i / size[0] / size[1]].map(|c| c as i32);
            let found = squared(&cells, size);
            for (i, found) in found.into_iter().enumerate() {
                let near = (0..count).filter(|j| cells[*j]).map(|j| {
                    (0..3).map(|a| (place(i)[a] - place(j)[a]).pow(2)).sum::<i32>()
                });
                prop_assert_eq!(found, near.min().unwrap_or(FAR));
            }
        }
    }
}
