use proptest::prelude::*;

use super::super::testing::{read, refused};
use super::*;

const TEXT: &str = "solid a thing\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   VERTEX 1 0 0.5\n   vertex 0 1 0\n  endloop\n endfacet\nendsolid a thing\n";

fn binary(facets: u32) -> Vec<u8> {
    let mut out = b"solid, as some begin".to_vec();
    out.resize(80, 0);
    out.extend(facets.to_le_bytes());
    for i in 0..facets {
        [[0.0; 3], [i as f32, 0.0, 0.0], [1.0, i as f32, 0.0], [0.0, 1.0, i as f32]]
            .iter()
            .flatten()
            .for_each(|v: &f32| out.extend(v.to_le_bytes()));
        out.extend([1, 2]);
    }
    out
}

#[test]
fn corners_of_text_and_binary_are_points() {
    for name in ["a.stl", "a.txt"] {
        let found = read(name, TEXT.as_bytes()).unwrap();
        assert_eq!(found.points, [[0.0; 3], [1.0, 0.0, 0.5], [0.0, 1.0, 0.0]]);
        assert_eq!(found.description, "STL ASCII, the corners of its facets");
    }
    for name in ["a.stl", "a.bin"] {
        let found = read(name, &binary(30_000)).unwrap();
        let corners = |i: u32| [[f64::from(i), 0.0, 0.0], [1.0, f64::from(i), 0.0], [0.0, 1.0, f64::from(i)]];
        assert!(found.points == (0..30_000).flat_map(corners).collect::<Vec<_>>());
        assert_eq!(found.precision, Precision::Single);
        assert_eq!(found.description, "STL binary, the corners of 30000 facets");
    }
}

#[test]
fn corners_have_zeros_where_other_files_have_attributes() {
    let dir = tempfile::tempdir().unwrap();
    let (stl, pcd) = (dir.path().join("a.stl"), dir.path().join("b.pcd"));
    std::fs::write(&stl, binary(1)).unwrap();
    std::fs::write(&pcd, "FIELDS x y z i\nWIDTH 1\nDATA ascii\n1 2 3 4\n").unwrap();
    let cloud = crate::input::Cloud::open(&[stl, pcd], &crate::input::InputOptions::default()).unwrap();
    let mut blocks = cloud.blocks(crate::input::Carried::Attributes);
    let mut batch = Batch::new(Precision::Single);
    blocks.next_block().unwrap().unwrap().decode(&mut batch).unwrap();
    assert_eq!((batch.points.len(), batch.attributes), (3, vec![0; 12]));
}

#[test]
fn no_prefix_is_a_file() {
    for end in 1..TEXT.len() - b"endsolid a thing\n".len() {
        assert!(read("a.stl", &TEXT.as_bytes()[..end]).is_err(), "prefix of {end} bytes");
    }
    let whole = binary(2);
    for end in 1..whole.len() {
        assert!(read("a.stl", &whole[..end]).is_err(), "prefix of {end} bytes");
    }
    assert!(refused("a.stl", &whole[..100]).contains("length: expected 184 bytes for its 2 facets, found 100 bytes"));
    assert!(refused("a.stl", &[0; 9]).contains("a header of 84 bytes, or text that begins with \"solid\""));
    assert!(
        refused("a.stl", TEXT.replace("0.5", "half").as_bytes()).contains("line 5: expected a number, found \"half\"")
    );
}

proptest! {
    #[test]
    fn no_content_makes_it_panic(
        text: bool,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        end in any::<prop::sample::Index>(),
    ) {
        let mut content = if text { TEXT.as_bytes().to_vec() } else { binary(3) };
        for (at, byte) in changes {
            let at = at.index(content.len());
            content[at] = byte;
        }
        drop(read("a.stl", &content[..end.index(content.len())]));
    }
}
