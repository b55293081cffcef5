use proptest::prelude::*;

use super::super::testing::{read, refused};
use super::*;

const PLAIN: &str = "# made by hand\nmtllib a.mtl\no thing\nvn 0 0 1\nv 1 2 3\n  v 4 5 6 1.0\nvt 0 0\n\nf 1/1/1 2 1\nV -1e3 0 .5\nl 1 2\n";

#[test]
fn vertices_are_points_whatever_the_name() {
    for name in ["a.obj", "a.txt", "a"] {
        let found = read(name, PLAIN.as_bytes()).unwrap();
        assert_eq!(found.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [-1000.0, 0.0, 0.5]]);
        assert_eq!((found.description.as_str(), found.attributes.len()), ("OBJ, its vertices", 0));
    }
    // What comes first is no vertex: the name decides.
    let late = format!("{}\n{PLAIN}", "# a long comment, ".repeat(500));
    assert_eq!(read("late.OBJ", late.as_bytes()).unwrap().points.len(), 3);
    assert_eq!(read("a.obj", b"# none\n").unwrap().points.len(), 0);
}

#[test]
fn colours_are_attributes_if_all_have_them() {
    let colours = |text: &str| read("a.obj", text.as_bytes()).unwrap().attributes;
    let found = colours("v 1 2 3 255 0 7\nf 1 1 1\nv 1 2 3 0 0 1\n");
    assert_eq!(found[0], ("red".to_string(), Scalar::U8, vec![255.0, 0.0]));
    assert_eq!(found[2], ("blue".to_string(), Scalar::U8, vec![7.0, 1.0]));
    assert_eq!(colours("v 1 2 3 1 0 1\n")[0], ("red".to_string(), Scalar::F32, vec![1.0]));
    assert_eq!(colours("v 1 2 3 0.25 0 1\nv 1 2 3 1 0 1\n")[0].2, [0.25, 1.0]);
    assert_eq!(colours("v 1 2 3 0.25 0 1\nv 1 2 3\n"), []);
    assert_eq!(colours("v 1 2 3 300 0 1\n"), []);
    // Far behind the lines that are looked at, vertices without a colour are black.
    let long = format!("{}v 1 2 3\nv 1 2 3 5\n", "v 1 2 3 255 0 7\n".repeat(10_000));
    let found = colours(&long);
    assert_eq!((found[0].2.len(), &found[0].2[9_999..]), (10_002, &[255.0, 0.0, 0.0][..]));
}

#[test]
fn what_is_no_number_is_located() {
    assert!(refused("a.obj", b"v 1 2 3\nv 1 x 3\n").contains("line 2: expected a number, found \"x\""));
    assert!(
        refused("a.obj", b"v 1 2 3\n\nv 1 2\n").contains("line 3: expected a number, found \"the end of the line\"")
    );
}

proptest! {
    #[test]
    fn no_content_makes_it_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        end in any::<prop::sample::Index>(),
    ) {
        let mut content = PLAIN.as_bytes().to_vec();
        for (at, byte) in changes {
            let at = at.index(content.len());
            content[at] = byte;
        }
        drop(read("a.obj", &content[..end.index(content.len())]));
    }
}
