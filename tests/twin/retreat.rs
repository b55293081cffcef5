//! Retreat: vertices of intersecting triangles go back, until no two triangles intersect.

use std::collections::{BTreeMap, BTreeSet};

use super::contract::Contraction;
use super::fit::{Fitting, State};
use super::intersect::pairs_but;

/// Lets vertices retreat until no two of the triangles `among` accepts intersect. Vertices below `settled` must stay: a round that would
/// move one is not done, and is the last.
pub fn retreat(
    fitting: &Fitting,
    contraction: &mut Contraction,
    states: &mut Vec<State>,
    among: &dyn Fn([u32; 3]) -> bool,
    settled: u32,
) {
    loop {
        let triangles: Vec<[u32; 3]> = contraction.triangles().into_iter().filter(|t| among(*t)).collect();
        let places: Vec<[f64; 3]> = (0..states.len() as u32).map(|v| fitting.written(v, states[v as usize])).collect();
        let numbered = contraction.numbered();
        let flipped: BTreeMap<[u32; 3], usize> =
            numbered.into_iter().filter(|(t, _)| contraction.is_flipped(*t)).map(|(t, corners)| (corners, t)).collect();
        // At rest no two triangles intersect, unless they are flipped.
        let still =
            |t: [u32; 3]| !flipped.contains_key(&t) && t.iter().all(|&v| fitting.is_at_rest(v, states[v as usize]));
        let pairs = pairs_but(&triangles, &|v| places[v as usize], &still);
        let back: Vec<usize> = pairs.iter().flat_map(|(a, b)| [a, b]).filter_map(|t| flipped.get(t).copied()).collect();
        let tangled: BTreeSet<u32> = pairs
            .into_iter()
            .filter(|(a, b)| !flipped.contains_key(a) && !flipped.contains_key(b))
            .flat_map(|(a, b)| {
                let all: Vec<u32> = a.into_iter().chain(b).filter(|&v| states[v as usize] != State::Rest).collect();
                let is_creased = |v: &u32| matches!(states[*v as usize], State::Creased(_));
                if all.iter().any(is_creased) { all.into_iter().filter(is_creased).collect() } else { all }
            })
            .collect();
        if tangled.is_empty() && back.is_empty() {
            return;
        }
        let (mut next, mut next_states) = (contraction.clone(), states.clone());
        if !step_back(&mut next, &mut next_states, &tangled, &back, settled) {
            return;
        }
        (*contraction, *states) = (next, next_states);
    }
}

/// One step back for all these vertices, after the flips of some triangles are taken back; false if it concerns a settled one.
fn step_back(
    contraction: &mut Contraction,
    states: &mut [State],
    tangled: &BTreeSet<u32>,
    flipped: &[usize],
    settled: u32,
) -> bool {
    let mut apart = BTreeSet::new();
    contraction.flip_back(flipped);
    for &v in tangled {
        if contraction.cluster(v).iter().any(|&u| u < settled) {
            return false;
        }
        match states[v as usize] {
            State::Fitted | State::Projected | State::Bridged | State::Pulled => states[v as usize] = State::Back(9),
            State::Creased(1) => states[v as usize] = State::Fitted,
            State::Creased(thirds) => states[v as usize] = State::Creased(thirds - 1),
            State::Back(tenths) if tenths > 1 => states[v as usize] = State::Back(tenths - 1),
            _ => {
                apart.insert(v);
            }
        }
    }
    let mut first = !flipped.is_empty();
    while first || !apart.is_empty() {
        first = false;
        for &v in &apart {
            contraction.flip_back(&contraction.at(v));
            for u in contraction.cluster(v) {
                if u < settled {
                    return false;
                }
                states[u as usize] = State::Rest;
            }
            contraction.take_apart(v);
        }
        apart = unsound(contraction);
    }
    true
}

/// The clusters to blame for links that are not one simple cycle of three or more.
fn unsound(contraction: &Contraction) -> BTreeSet<u32> {
    let is_cluster = |v: &u32| contraction.cluster(*v).len() > 1;
    let mut blamed = BTreeSet::new();
    for v in contraction.living() {
        let link = contraction.link(v);
        let mut twice: Vec<u32> = link.iter().map(|edge| edge[0]).collect();
        twice.sort_unstable();
        let all: BTreeSet<u32> = twice.iter().copied().collect();
        let twice: Vec<u32> = all.iter().copied().filter(|u| twice.iter().filter(|w| *w == u).count() > 1).collect();
        let clusters = if link.len() < 3 { all.into_iter().filter(is_cluster).collect() } else { twice.clone() };
        let clusters: Vec<u32> = clusters.into_iter().filter(is_cluster).collect();
        let walk = || {
            let mut at = link[0][0];
            let mut steps = 0;
            while let Some(edge) = link.iter().find(|edge| edge[0] == at) {
                at = edge[1];
                steps += 1;
                if at == link[0][0] {
                    break;
                }
            }
            steps
        };
        if contraction.stretches(v) > 1 && is_cluster(&v) {
            blamed.insert(v);
        }
        if link.len() < 3 || !twice.is_empty() || walk() < link.len() {
            blamed.extend(clusters);
            if is_cluster(&v) {
                blamed.insert(v);
            }
        }
    }
    blamed
}
