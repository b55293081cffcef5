//! Tasks that processes do apart, against one simplification.

use super::super::apart::{self, Left, PASSES};
use super::super::passes::with_parts_of;
use super::*;
use crate::storage::spool::Spool;

/// The same bytes, as another process reads them.
fn again(spool: &Spool, workspace: &Workspace) -> Spool {
    let mut bytes = vec![0; spool.len() as usize];
    spool.read_at(0, &mut bytes).unwrap();
    let mut copy = workspace.spool(1 << 30);
    copy.append(&bytes).unwrap();
    copy
}

/// The mesh that tasks leave: so many shares of the mesh, and runs of rows. How many rows the passes had.
fn by_tasks(given: Given<'_>, shares: usize, runs: usize) -> (Mesh, Figures, Vec<usize>) {
    let spool = || given.workspace.spool(1 << 30);
    let copies = |left: &[(Left, Spool)]| -> Vec<(Left, Spool)> {
        left.iter().map(|(left, spool)| (*left, again(spool, given.workspace))).collect()
    };
    let (mut left, mut rows): (Vec<(Left, Spool)>, Vec<usize>) = (Vec::new(), Vec::new());
    let mut before_it = None;
    for pass in 0..PASSES {
        let planes = apart::planes(given, pass, copies(&left)).unwrap();
        let text = serde_json::to_string(&planes).unwrap();
        assert_eq!(planes, serde_json::from_str(&text).unwrap());
        rows.push(planes.rows());
        let deal = |share: (usize, usize), before: Option<(Left, Spool)>| {
            let mut out = spool();
            let extents = apart::deal(given, &planes, share, before, &mut out).unwrap();
            (extents, out)
        };
        let dealt: Vec<_> = match pass {
            0 => (0..shares).map(|share| deal((share, shares), None)).collect(),
            _ => copies(&left).into_iter().map(|before| deal((0, 1), Some(before))).collect(),
        };
        let runs = runs.min(planes.rows());
        left = (0..runs)
            .map(|run| {
                let within = planes.rows() * run / runs..planes.rows() * (run + 1) / runs;
                // The spool of the task's file, which is then read by its name.
                let dir = given.workspace.dir().to_path_buf();
                let store = crate::storage::work::store::Folder::open(&dir, &[]).unwrap();
                let name = format!("left-{pass}-{run}");
                let file = crate::storage::work::store::Store::create(&store, &name).unwrap();
                let named = crate::storage::work::store::NamedFile { file, name: name.into() };
                let out = given.workspace.spool_in(named.clone(), 0);
                let both = (&planes, before_it.as_ref());
                let left = apart::rows(given, both, within, &dealt, out, &mut |_| ()).unwrap();
                (left, given.workspace.spool_in(named, left.extent.to))
            })
            .collect();
        if planes.are_last() {
            break;
        }
        before_it = Some(planes);
    }
    let (mesh, figures) = apart::numbered(given, rows.len(), left, [0; 3].map(|_| given.workspace.spool(0))).unwrap();
    (Mesh::of(&mesh), figures, rows)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever the shares and runs, what is left is what one process leaves, record by record.
    #[test]
    fn tasks_leave_what_one_process_does(
        shape in shapes(40),
        part in 0.05f64..1.0,
        (shares, runs) in (1usize..5, 1usize..5),
        parts in prop_oneof![Just(40u64), Just(150), Just(1 << 15)],
        (borders, moves, colours) in any::<(bool, bool, bool)>(),
        single in any::<bool>(),
    ) {
        let mesh = shape.mesh();
        let edge = 1.0 / shape.cells[0].max(shape.cells[1]) as f64;
        let options = Options {
            tolerance: Some(part * edge),
            most: None,
            borders: borders.then(|| "classification".to_owned()),
            colours: colours.then_some(9),
            moves,
        };
        let precision = if single { Precision::Single } else { Precision::Double };
        let dir = tempfile::tempdir().unwrap();
        let (workspace, workers) = (Workspace::new(dir.path()).unwrap(), Workers::new(2).unwrap());
        let spool = mesh.spool(precision, &workspace);
        let given = Given { mesh: &spool, options: &options, budget: 64 << 20, workers: &workers, workspace: &workspace, kept: None };
        let (expected, found, rows) = with_parts_of(parts, || {
            let (left, figures) = simplify(given, &mut |_| ()).unwrap();
            let (by_tasks, of_tasks, rows) = by_tasks(given, shares, runs);
            ((Mesh::of(&left), figures), (by_tasks, of_tasks), rows)
        });
        prop_assert_eq!(&expected.0, &found.0, "rows {:?}", rows);
        prop_assert_eq!(expected.1, found.1);
    }
}

/// A sample that is read afterwards is the one that would have been taken meanwhile.
#[test]
fn samples_are_the_same() {
    use super::super::soup::{Record, Soup};
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    for count in [0u32, 1, 1000, 300_000, 700_000] {
        let record = |number: u32| {
            let place = [f64::from(number), 0.0, 0.0];
            Record::<f32, ()>::new([number; 3], [0; 3], [place; 3], Drift::NONE, super::super::mark::Marks::default())
        };
        let mut soup = Soup::new(&workspace, 1 << 30);
        let mut spools = [workspace.spool(1 << 30), workspace.spool(1 << 30), workspace.spool(1 << 30)];
        for first in (0..count).step_by(1 << 12) {
            let records: Vec<_> = (first..count.min(first + (1 << 12))).map(record).collect();
            soup.append(&records).unwrap();
            // The second has none.
            let which = if first < count / 3 { 0 } else { 2 };
            spools[which].append(bytemuck::cast_slice(&records)).unwrap();
        }
        let joined = Soup::<f32, ()>::joined(spools.into(), [0.0; 2]);
        assert_eq!((joined.count(), joined.sample().unwrap()), (soup.count(), soup.sample().unwrap()), "{count}");
    }
}
