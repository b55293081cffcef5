//! Text, in all its dialects.

use proptest::prelude::*;

use crate::error::Result;
use crate::format::testing::collect;
use crate::input::InputOptions;

fn read(content: &[u8]) -> Result<(Vec<[f64; 3]>, u64)> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.xyz");
    std::fs::write(&path, content).unwrap();
    collect(&path, &InputOptions::default())
}

#[test]
fn dialects_are_recognised() {
    let expected = vec![[1.0, -2.5, 300.0], [4.0, 5.0, 6.0]];
    for text in [
        "1 -2.5 3e2\n4 5 6",
        "1\t-2.5\t3E+2\r\n\r\n4\t5\t6\r\n",
        "  1   -2.5 300 0.1 0.2 0.3\n 4 5 6 nx ny nz\n",
        "1,-2.5,300\n4, 5, 6\n",
        "1;-2.5;300\n4;5;6\n",
        "1,0;-2,5;300\n4,0;5;6\n",
        "1,0 -2,5 300,0\n4 5 6\n",
        "# comment\n// comment\n; comment\n1 -2.5 300\n# between\n4 5 6\n",
        "x,y,z\n1,-2.5,300\n4,5,6\n",
        "\"Y\",\"Z\",\"X\",i\n-2.5,300,1,9\n5,6,4,9\n",
        "//X,Y,Z,Scalar field\n1,-2.5,300,7\n4,5,6,7\n",
        "# z y x\n300 -2.5 1\n6 5 4\n",
        "//X Y Z\n2\n1,-2.5,300\n4,5,6\n",
        "label,x,y,z\ntree,1,-2.5,300\n,4,5,6\n",
        "2\n1 -2.5 300 128\n4 5 6 128\n",
        "1\n1 -2.5 300 128\n1\n4 5 6 128\n",
        "\u{feff}x y z\n1 -2.5 300\n4 5 6",
        "A survey by J. Müller\n1 -2.5 300\n4 5 6\n",
    ] {
        assert_eq!(read(text.as_bytes()).unwrap().0, expected, "{text}");
    }
}

#[test]
fn usual_names_of_coordinates_are_known() {
    let expected = vec![[10.5, 20.5, 30.5], [11.5, 20.75, 30.25]];
    let rows = ["1,10.5,20.5,30.5,7", "2,11.5,20.75,30.25,8"];
    for header in [
        "id,x,y,height,i",
        "id,x [m],y [m],z [m],i",
        "id,easting,northing,z,i",
        "id,POINT_X,POINT_Y,POINT_Z,i",
        "id,X_m,Y_m,Z_m,i",
        "id,lon,lat,alt,i",
        "ID,Longitude,Latitude,Altitude,i",
        "\"Id\",\"Easting (m)\",\"Northing (m)\",\"Elevation (m)\",i",
        "P,E,N,H,i",
        "id,X,Y,Z_ellipsoid,i",
        "id,x-coordinate,y-coordinate,Elev_ft,i",
        "height_ref,X,Y,Z,height",
        "lat,x,y,z,lon",
        "survey of the 3rd of May\nid,x,y,z,i\n-,m,m,m,-",
        "# id x y z i",
        "//id,Easting,Northing,Height,i",
    ] {
        for (separator, name) in [(",", "commas"), (";", "semicolons"), ("\t", "tabs")] {
            let text = format!("{header}\n{}\n{}\n", rows[0], rows[1]).replace(',', separator);
            assert_eq!(read(text.as_bytes()).unwrap().0, expected, "{header} with {name}");
        }
    }
    let swapped = b"Northing Easting Height\n20.5 10.5 30.5\n20.75 11.5 30.25\n";
    assert_eq!(read(swapped).unwrap().0, expected);
    let units = b"x [m] y [m] z [m] t\n10.5 20.5 30.5 1\n11.5 20.75 30.25 2\n";
    assert_eq!(read(units).unwrap().0, expected);
}

#[test]
fn a_header_that_does_not_tell_the_coordinates_is_refused_and_quoted() {
    for header in [
        "id,a,b,c",
        "id,x,y,value",
        "id,lat,z,c",
        "id,x_left,x_right,z",
        "id,z_ortho,z_ellipsoid,y",
        "id,easting,lat,height",
        "# id a b c",
        // One name short, as R writes row names.
        "x,y,z",
    ] {
        let error = read(format!("{header}\n1,10.5,20.5,30.5\n2,11.5,20.7,30.1\n").as_bytes()).unwrap_err().to_string();
        let bare = header.trim_start_matches('#');
        assert!(error.contains(&format!("{bare:?}")) && error.contains("line 2"), "{header}: {error}");
    }
    // Names with blanks do not tell where their columns are.
    let error = read(b"Point ID x y z Scalar field\n1 10 20 30 5\n").unwrap_err().to_string();
    assert!(error.contains("Point ID"), "{error}");
}

#[test]
fn thousands_of_columns_are_read_and_a_header_too_long_is_named() {
    let table = |columns: usize| {
        let names: String = (0..columns).map(|i| format!(",a{i}")).collect();
        let row: String = (0..columns).map(|i| format!(",{}", i % 9)).collect();
        format!("x,y,z{names}\n1,2,3{row}\n4,5,6{row}\n")
    };
    assert_eq!(read(table(3000).as_bytes()).unwrap().0, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    let error = read(table(20_000).as_bytes()).unwrap_err().to_string();
    assert!(error.contains("line 1") && error.contains("65536"), "{error}");
}

#[test]
fn missing_and_infinite_coordinates_are_counted() {
    assert_eq!(read(b"1 2 3\nnan 0 0\n1 inf 1\n4 5 6\n").unwrap(), (vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 2));
}

#[test]
fn what_is_no_number_is_located() {
    for (text, parts) in [
        ("1 2 3\n\n4 5 six\n", ["line 3", "z in column 3", "\"six\""]),
        ("a,z,y,x\n0,1,2,3\n0,1,2\n", ["line 3", "x in column 4", "the end of the line"]),
        ("x y intensity\n1 2 3\n", ["line 2", "x, y and z", "x y intensity"]),
        ("hello\nworld\n", ["line 1", "three numbers", "hello"]),
        ("1 2\n3 4 5\n", ["line 1", "three numbers", "\"1 2\""]),
        ("id,x,y,z\n1,2,3,\n4,5,6,7\n", ["line 2", "column 4", "\"\""]),
        ("1 2 3\n7\n4 5 6\n", ["line 2", "y in column 2", "the end of the line"]),
        ("\"1\",\"2\",\"3\"\n\"4\",\"5\",\"6\"\n", ["line 1", "without quotes", r#"\"1\",\"2\""#]),
        ("id,x,y,z\na,\"1\",\"2\",3\n", ["line 2", "without quotes", "a,"]),
    ] {
        let error = read(text.as_bytes()).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{text}: {error}");
    }
    assert!(read(b"2\n3\n0 0 0\n1 0 0\n").unwrap_err().to_string().contains("PTX"));
}

#[test]
fn every_prefix_gives_fewer_points_or_an_error() {
    let text = b"//X,Y,Z\n10.5,20.5,30.5\r\n# c\n1,2,3\n4,5,6";
    for end in 1..text.len() {
        if let Ok((points, _)) = read(&text[..end]) {
            assert!(points.len() <= 3);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn what_is_written_is_read(points in prop::collection::vec(prop::array::uniform3(-1e300f64..1e300), 1..50),
                               way in 0usize..4, crlf: bool) {
        let end = if crlf { "\r\n" } else { "\n" };
        let text: String = points.iter().map(|[x, y, z]| match way {
            0 => format!("{x} {y}\t{z}{end}"),
            1 => format!("{x:e},{y},{z}{end}"),
            2 => format!("{x};{y};{z};9{end}"),
            _ => format!("{x:e};{y:e};{z:e}{end}").replace('.', ","),
        }).collect();
        prop_assert_eq!(read(text.as_bytes()).unwrap().0, points);
    }

    #[test]
    fn no_text_makes_it_panic(text in "[-0-9., ;x#\n]{0,200}") {
        drop(read(text.as_bytes()));
    }
}
