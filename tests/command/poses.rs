//! E57 scans that tell where they were taken from, and sheets that are seen from there.

use std::io::Cursor;

use e57::{E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation};

use super::folder::Folder;

type Scan = (Vec<[f64; 3]>, Option<[f64; 3]>);

/// An E57 file of scans: their points, and where each was taken from, if that is told.
fn e57(scans: &[Scan]) -> Vec<u8> {
    let double = |name| Record { name, data_type: RecordDataType::F64 };
    let fields = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ].map(double);
    let mut content = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut content, "file").unwrap();
    for (number, (points, place)) in scans.iter().enumerate() {
        let mut scan = writer.add_pointcloud(&format!("scan {number}"), fields.to_vec()).unwrap();
        scan.set_transform(place.map(|[x, y, z]| Transform {
            rotation: Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 },
            translation: Translation { x, y, z },
        }));
        let by = place.unwrap_or_default();
        for point in points {
            scan.add_point([0, 1, 2].map(|a| RecordValue::Double(point[a] - by[a])).to_vec()).unwrap();
        }
        scan.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    content.into_inner()
}

/// Ten units of a wavy wall, which stands in x = 0, from `y` on.
fn wall(y: f64) -> Vec<[f64; 3]> {
    let place = |i: u32| [y + 0.1 * f64::from(i % 100), 0.1 * f64::from(i / 100)];
    (0..10_000).map(place).map(|[y, z]| [0.3 * (y * 0.7).sin() * (z * 0.9).cos(), y, z]).collect()
}

const LEFT: [f64; 3] = [6.0, -2.0, 4.0];
const RIGHT: [f64; 3] = [9.0, 23.0, 6.0];
const SHEET: &str = "--surface sheet --cell-size 0.25";

/// Two scans of a wall, from two places on the same side of it.
fn two_scans() -> [Scan; 2] {
    [(wall(0.0), Some(LEFT)), (wall(10.0), Some(RIGHT))]
}

#[test]
fn each_face_shows_its_front_to_where_the_points_near_it_were_scanned_from() {
    let f = Folder::new();
    f.write("two.e57", e57(&two_scans()));
    f.ok(&format!("two.e57 {SHEET} --facing @poses -o m.stl --report r.json"));
    let stl = f.read("m.stl");
    let facets = stl[84..].chunks_exact(50);
    let (all, mut fronts) = (facets.len(), 0);
    for facet in facets {
        let number = |i: usize| f64::from(f32::from_le_bytes(facet[4 * i..4 * i + 4].try_into().unwrap()));
        let corner = |c: usize| [0, 1, 2].map(|a| number(3 + 3 * c + a));
        let [a, b, c] = [0, 1, 2].map(corner);
        let minus = |p: [f64; 3], q: [f64; 3]| [0, 1, 2].map(|i| p[i] - q[i]);
        let (u, v) = (minus(b, a), minus(c, a));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let dot = |p: [f64; 3], q: [f64; 3]| (0..3).map(|i| p[i] * q[i]).sum::<f64>();
        // Three corners in a line have no front, nor have they one when they are moved by a twentieth of a cell.
        let longest = [u, v, minus(c, b)].map(|side| dot(side, side)).into_iter().fold(0.0, f64::max);
        if dot(normal, normal) > (0.05f64 * 0.25).powi(2) * longest {
            assert!(dot(normal, minus(if a[1] < 10.0 { LEFT } else { RIGHT }, a)) > 0.0, "{a:?} {b:?} {c:?}");
            fronts += 1;
        }
    }
    assert!(all > 3000 && fronts * 100 > all * 99, "{fronts} of {all}");
    // One thing is said in two ways: a run with the direction that the report tells gives the same mesh.
    let report: serde_json::Value = serde_json::from_slice(&f.read("r.json")).unwrap();
    let facing = report["parameters"]["open"]["facing"].as_str().unwrap();
    f.ok(&format!("two.e57 {SHEET} --facing {facing} -o same.stl"));
    assert!(f.read("same.stl") == stl);
}

#[test]
fn the_front_is_the_same_for_any_threads_memory_and_order_of_files() {
    let f = Folder::new();
    let [left, right] = two_scans();
    f.write("two.e57", e57(&[left.clone(), right.clone()]));
    f.write("left.e57", e57(&[left]));
    f.write("right.e57", e57(&[right]));
    f.ok(&format!("two.e57 {SHEET} --facing @poses -o a.ply -j 1"));
    f.ok(&format!("two.e57 {SHEET} --facing @poses -o b.ply -j 4 --max-memory 48M"));
    f.ok(&format!("right.e57 left.e57 {SHEET} --facing @poses -o c.ply --preview"));
    assert!(f.read("b.ply") == f.read("a.ply"));
    assert!(f.read("c.ply") == f.read("a.ply"));
}

#[test]
fn positions_are_listed_and_the_option_is_named_where_it_helps() {
    let f = Folder::new();
    f.write("two.e57", e57(&two_scans()));
    let info = f.ok("info two.e57").out;
    for line in ["scanned from       6  -2  4\n", "scanned from       9  23  6\n"] {
        assert!(info.contains(line), "{line:?} is not in\n{info}");
    }
    f.fails("two.e57 --surface sheet -o m.ply", 2, &["--facing must say", "the input tells: --facing @poses"]);
    let terrain = f.ok("two.e57 --surface terrain --cell-size 0.25 -o t.ply").err;
    assert!(terrain.contains("--surface sheet --facing @poses makes a sheet seen from there"), "{terrain}");

    // A pose that moves nothing counts beside one that does, and not alone: programs without poses write it, too.
    f.write("first.e57", e57(&[(wall(0.0), Some([0.0; 3])), (wall(10.0), Some(RIGHT))]));
    let info = f.ok("info first.e57").out;
    assert_eq!(info.matches("scanned from").count(), 2, "{info}");
    for place in [None, Some([0.0; 3])] {
        f.write("none.e57", e57(&[(wall(0.0), place)]));
        assert!(!f.ok("info none.e57").out.contains("scanned from"));
        f.fails(
            &format!("none.e57 {SHEET} --facing @poses -o m.ply"),
            2,
            &["no file tells where its scans were taken"],
        );
        let answer = f.fails("none.e57 --surface sheet -o m.ply", 2, &["--facing must say"]);
        assert!(!answer.err.contains("@poses"), "{}", answer.err);
        let terrain = f.ok("none.e57 --surface terrain --cell-size 0.25 -o t.ply --overwrite").err;
        assert!(!terrain.contains("@poses"), "{terrain}");
    }
}

#[test]
fn scans_from_both_sides_are_no_sheet() {
    let f = Folder::new();
    f.write("both.e57", e57(&[(wall(0.0), Some(LEFT)), (wall(10.0), Some([-9.0, 23.0, 6.0]))]));
    let found = "of the points scanned from";
    f.fails(&format!("both.e57 {SHEET} --facing @poses -o m.ply"), 2, &["a sheet has one front", found]);
    // A scanner in the middle of what it sees.
    let round = (0..20_000).map(|i| {
        let (turn, up) = (f64::from(i) * 2.399_963, f64::from(i) / 10_000.0 - 1.0);
        let flat = (1.0 - up * up).sqrt();
        [5.0 + 3.0 * flat * turn.cos(), 3.0 * flat * turn.sin(), 3.0 * up]
    });
    f.write("round.e57", e57(&[(round.collect(), Some([5.0, 0.0, 0.0]))]));
    f.fails(&format!("round.e57 {SHEET} --facing @poses -o m.ply"), 2, &["a sheet has one front", "5,0,0"]);
}
