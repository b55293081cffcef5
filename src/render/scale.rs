//! Scales of colours, for what grows along them.

/// The colour at `t` of a scale, from 0 to 1, between its colours in equal steps; beyond its ends, that of the end. `t` is a number.
pub fn along<const N: usize>(scale: &[[u8; 3]; N], t: f64) -> [u8; 3] {
    let at = t.clamp(0.0, 1.0) * (N - 1) as f64;
    let below = (at as usize).min(N - 2);
    let share = at - below as f64;
    std::array::from_fn(|c| {
        let [low, high] = [scale[below][c], scale[below + 1][c]].map(f64::from);
        (low + (high - low) * share).round() as u8
    })
}
