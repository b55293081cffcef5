//! Which input a place belongs to, of inputs that are meshed together and written apart.
//!
//! ```text
//!   +-----+ . +-----+      A place belongs to the input whose box is nearest, seen from above: the one that it lies in, if there is one. Of boxes that
//!   |  a  | . |  b  |      are as near, as where they overlap, to the one whose middle is nearest; of these, to the first by name. So the whole plane
//!   +-----+ . +-----+      is dealt out, and the order of the inputs makes no difference.
//! ```

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::format::unpack::{Packing, STANDARD_INPUT};
use crate::points::bounds::Bounds;

/// An input, and where its points lie.
#[derive(Debug, Clone, PartialEq)]
pub struct Territory {
    /// The file.
    pub path: PathBuf,
    /// Its name without folders and extension.
    pub stem: String,
    /// The box of its points that count, seen from above; none if it has no such points.
    bounds: Option<[[f64; 2]; 2]>,
}

/// The inputs.
#[derive(Debug, Clone, Default)]
pub struct Territories(Vec<Territory>);

/// Places that are looked at together: they lie side by side mostly, so that few inputs are near them.
const TOGETHER: usize = 1 << 10;

impl Territories {
    /// The territories of inputs, in the order of their names. Nothing is known of their points.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if two would have the same name, or one has none.
    pub fn of(files: &[PathBuf]) -> Result<Territories> {
        let mut inputs = Vec::with_capacity(files.len());
        for path in files {
            if path == Path::new(STANDARD_INPUT) {
                let words = "`batch`: standard input has no name that its mesh could have";
                return Err(Error::setting("batch", words.into()));
            }
            let bare = Packing::named(path).map_or_else(|| path.clone(), |(_, bare)| bare);
            let stem = bare.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            inputs.push(Territory { path: path.clone(), stem, bounds: None });
        }
        inputs.sort_by(|a, b| (&a.stem, &a.path).cmp(&(&b.stem, &b.path)));
        match inputs.windows(2).find(|pair| pair[0].stem == pair[1].stem) {
            None => Ok(Territories(inputs)),
            Some([a, b, ..]) => Err(Error::setting(
                "batch",
                format!(
                    "`batch`: the meshes of {} and {} would have the same name, {}; rename one of them",
                    a.path.display(),
                    b.path.display(),
                    a.stem
                ),
            )),
            Some(_) => unreachable!("a pair has two"),
        }
    }

    /// Takes note of where the points of an input lie.
    pub fn put(&mut self, path: &Path, bounds: &Bounds) {
        let Bounds { min, max } = bounds;
        if min[0] <= max[0] && min[1] <= max[1] {
            let at = self.0.iter_mut().filter(|input| input.path == path);
            at.for_each(|input| input.bounds = Some([[min[0], min[1]], [max[0], max[1]]]));
        }
    }

    /// An input.
    pub fn of_number(&self, number: usize) -> &Territory {
        &self.0[number]
    }

    /// The inputs that have no points.
    pub fn without_points(&self) -> impl Iterator<Item = &Territory> {
        self.0.iter().filter(|input| input.bounds.is_none())
    }

    /// The number of the input that each place belongs to. There is one with points.
    pub fn nearest(&self, places: &[[f64; 2]]) -> Vec<usize> {
        let known: Vec<(usize, [[f64; 2]; 2])> =
            self.0.iter().enumerate().filter_map(|(number, input)| Some((number, input.bounds?))).collect();
        let mut out = Vec::with_capacity(places.len());
        for places in places.chunks(TOGETHER) {
            let held = places.iter().fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], place| {
                [[0, 1].map(|a| low[a].min(place[a])), [0, 1].map(|a| high[a].max(place[a]))]
            });
            // No place in the box of them is farther from some input than this.
            let reach = known.iter().map(|(_, input)| farthest(&held, input)).fold(f64::INFINITY, f64::min);
            let near: Vec<_> = known.iter().filter(|(_, input)| apart(&held, input) <= reach).collect();
            out.extend(places.iter().map(|place| {
                let key = |input: &[[f64; 2]; 2]| {
                    let middle = [0, 1].map(|a| input[0][a].midpoint(input[1][a]));
                    [apart(&[*place; 2], input), apart(&[*place; 2], &[middle; 2])]
                };
                let first = near.iter().map(|(number, input)| (key(input), *number));
                // Ties go to the least number.
                let best =
                    first.min_by(|(a, i), (b, j)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(i.cmp(j)));
                best.map_or(0, |(_, number)| number)
            }));
        }
        out
    }
}

/// The squared distance of two boxes.
fn apart(a: &[[f64; 2]; 2], b: &[[f64; 2]; 2]) -> f64 {
    let [x, y] = [0, 1].map(|axis| (a[0][axis] - b[1][axis]).max(b[0][axis] - a[1][axis]).max(0.0));
    x * x + y * y
}

/// At least the squared distance of any place in `from` to box `to`.
fn farthest(from: &[[f64; 2]; 2], to: &[[f64; 2]; 2]) -> f64 {
    let [x, y] = [0, 1].map(|axis| (to[0][axis] - from[0][axis]).max(from[1][axis] - to[1][axis]).max(0.0));
    x * x + y * y
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn territories(boxes: &[[f64; 4]]) -> Territories {
        let files: Vec<PathBuf> = (0..boxes.len()).map(|i| PathBuf::from(format!("{i:03}.laz"))).collect();
        let mut inputs = Territories::of(&files).unwrap();
        for (file, [x, y, width, height]) in files.iter().zip(boxes) {
            inputs.put(file, &Bounds { min: [*x, *y, 0.0], max: [x + width, y + height, 9.0] });
        }
        inputs
    }

    /// The definition, input by input.
    fn twin(boxes: &[[f64; 4]], place: [f64; 2]) -> usize {
        let mut best = (f64::INFINITY, f64::INFINITY, 0);
        for (number, [x, y, width, height]) in boxes.iter().enumerate() {
            let (left, low, right, high) = (*x, *y, x + width, y + height);
            let dx = if place[0] < left {
                left - place[0]
            } else if place[0] > right {
                place[0] - right
            } else {
                0.0
            };
            let dy = if place[1] < low {
                low - place[1]
            } else if place[1] > high {
                place[1] - high
            } else {
                0.0
            };
            let to_middle = (place[0] - left.midpoint(right)).powi(2) + (place[1] - low.midpoint(high)).powi(2);
            let found = (dx * dx + dy * dy, to_middle, number);
            if found.0 < best.0 || found.0 == best.0 && found.1 < best.1 {
                best = found;
            }
        }
        best.2
    }

    proptest! {
        #[test]
        fn places_belong_to_the_nearest_input(
            boxes in prop::collection::vec([-50.0f64..50.0, -50.0f64..50.0, 0.0f64..20.0, 0.0f64..20.0], 1..30),
            places in prop::collection::vec(prop::array::uniform2(-80.0f64..80.0), 1..3000),
        ) {
            let found = territories(&boxes).nearest(&places);
            prop_assert_eq!(found, places.iter().map(|place| twin(&boxes, *place)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn names_tell_inputs_apart() {
        let files = ["b/x.copc.laz", "a/y.xyz.gz", "a/z"].map(PathBuf::from);
        let names: Vec<String> = Territories::of(&files).unwrap().0.into_iter().map(|input| input.stem).collect();
        assert_eq!(names, ["x.copc", "y", "z"]);
        let same = Territories::of(&["a/x.laz", "b/x.las"].map(PathBuf::from)).unwrap_err().to_string();
        assert!(same.contains("a/x.laz and b/x.las would have the same name, x"), "{same}");
        assert!(Territories::of(&[PathBuf::from("-")]).is_err());
    }
}
