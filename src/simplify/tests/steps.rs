//! Why collapses are kept to less than the tolerance at first.

use super::super::soup::Record;
use super::*;

/// The triangles that are left of a mesh within a tolerance, if all is taken to have gone that could within `tried`.
fn left(mesh: &Mesh, tolerance: f64, tried: f64) -> u64 {
    let dir = tempfile::tempdir().unwrap();
    let (workspace, workers) = (Workspace::new(dir.path()).unwrap(), Workers::new(2).unwrap());
    let spool = mesh.spool(Precision::Double, &workspace);
    let options = Options { tolerance: Some(tolerance), ..WITHIN };
    let (options, budget) = (&options, 1 << 30);
    let given = Given { mesh: &spool, options, budget, workers: &workers, workspace: &workspace, kept: None };
    let from = Triangles::<f64, ()>::Mesh(&spool, given.wanted::<()>().unwrap());
    let within = Limits { tried, ..limits(options, None) };
    let soup = given.passes::<f64, ()>().unwrap().simplified(&from, within, &mut |_| ()).unwrap();
    let mut count = 0;
    let mut add = |records: &[Record<f64, ()>]| {
        count += records.len() as u64;
        Ok(())
    };
    soup.each_block(&mut add).unwrap();
    count
}

/// On closed and open surfaces, smooth and rough, turned: in steps, fewer triangles are left of each, and a twelfth fewer of rough tubes and sheets.
#[test]
fn in_steps_fewer_triangles_are_left() {
    let mut rough = [0, 0];
    for (seed, closed) in [[true, true], [true, false], [false, false]].into_iter().enumerate() {
        for (noise, tolerance) in [(0.0, 0.02), (0.5, 0.02), (0.0, 0.04), (0.5, 0.04)] {
            let (turn, seed) = (0.3 * seed as f64, seed as u64);
            let mesh = Shape { cells: [100, 100], closed, waves: 0.5, noise, turn, seed }.mesh();
            let [steps, once] = [0.0, tolerance].map(|tried| left(&mesh, tolerance, tried));
            assert!(steps < once, "{closed:?}, noise {noise}, {tolerance}: {steps} in steps, {once} at once");
            if noise > 0.0 && closed != [true, true] {
                rough = [rough[0] + steps, rough[1] + once];
            }
        }
    }
    assert!(12 * rough[0] < 11 * rough[1], "{rough:?}");
}
