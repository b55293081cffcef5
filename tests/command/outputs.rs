//! Nothing that is not meant is replaced, and what cannot be written is refused before any work.

use std::os::unix::fs::symlink;

use super::folder::Folder;

#[test]
fn no_output_replaces_what_is_read_or_another_output() {
    let f = Folder::new();
    f.ok("generate sphere 3k -o s.bin");
    f.ok("s.bin -o m.ply");
    f.write("plain.bin", f.read("s.bin"));
    std::fs::hard_link(f.path("s.bin"), f.path("hard.bin")).unwrap();
    let kept = ["s.bin", "s.bin.json", "m.ply"].map(|name| (name, f.read(name)));
    for (line, words) in [
        ("s.bin -o a.ply --report a.ply", "a.ply: cannot be both the mesh and the report"),
        ("s.bin -o a.ply --report ./a.ply", "cannot be both"),
        ("s.bin -o a.ply --report s.bin", "s.bin: is an input, which the report would replace"),
        ("s.bin -o a.ply --report hard.bin", "s.bin: is an input, which the report would replace"),
        ("s.bin -o a.ply --report s.bin.json", "s.bin.json: is an input"),
        ("plain.bin --layout xyz -o a.ply --report plain.bin.json", "plain.bin.json: is an input"),
        ("s.bin -o a.ply --preview=s.bin --overwrite", "s.bin: is an input, which the preview would replace"),
        ("s.bin -o a.ply --preview=p.png --report p.png", "cannot be both the preview and the report"),
        ("s.bin -o a.obj --report a.prj", "cannot be both the mesh's side-car and the report"),
        ("s.bin -o a.ply --report m.ply", "m.ply: exists and is no report"),
        ("s.bin -o a.ply --report .", "is a folder"),
        ("check m.ply --report m.ply", "m.ply: is an input, which the report would replace"),
        ("compare m.ply s.bin --report s.bin.json", "s.bin.json: is an input"),
        ("compare m.ply s.bin --heatmap m.ply --overwrite", "m.ply: is an input, which the heat map would replace"),
        ("compare m.ply s.bin --heatmap h.ply --report h.ply", "cannot be both the heat map and the report"),
        ("render m.ply -o m.ply --overwrite", "m.ply: is an input, which the picture would replace"),
        ("densify m.ply s.bin -o s.bin --overwrite", "s.bin: is an input, which the cloud would replace"),
        ("densify m.ply s.bin -o m.ply --overwrite", "m.ply: is an input, which the cloud would replace"),
    ] {
        f.fails(line, 2, &[words]);
    }
    for (name, bytes) in kept {
        assert_eq!(f.read(name), bytes, "{name}");
    }
    // An older report is replaced, and so is an empty file.
    f.write("r.json", "");
    f.ok("s.bin -o a.ply --report r.json");
    f.ok("check a.ply --report r.json");
    assert!(f.read("r.json").starts_with(b"{"));
}

#[test]
fn links_devices_pipes_and_folders_stay_what_they_are() {
    let f = Folder::new();
    f.ok("generate sphere 3k -o s.bin");
    symlink("real.json", f.path("report.json")).unwrap();
    f.write("real.json", "{}");
    f.ok("s.bin -o a.ply --report report.json");
    assert!(f.path("report.json").is_symlink() && f.read("real.json").len() > 2);

    f.write("real.ply", "old");
    symlink("real.ply", f.path("link.ply")).unwrap();
    f.ok("s.bin -o link.ply --overwrite");
    assert!(f.path("link.ply").is_symlink());
    assert_eq!(f.read("real.ply"), f.read("a.ply"));

    f.make("folder.ply");
    symlink("gone/x.ply", f.path("dangling.ply")).unwrap();
    let pipe = f.path("pipe.ply");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::from_raw_mode(0o600)).unwrap();
    for (name, words) in [
        ("folder.ply", "folder.ply: is a folder"),
        ("dangling.ply", "dangling.ply: is a link that leads to no file"),
        ("pipe.ply", "pipe.ply: is no regular file"),
    ] {
        f.fails(&format!("s.bin -o {name} --overwrite"), 2, &[words]);
    }
    f.ok("s.bin -o b.ply --report /dev/null");
    assert!(!std::path::Path::new("/dev/null").is_file());
    let told = f.ok("s.bin -o c.ply --quiet --report /dev/stdout");
    assert!(told.out.contains("\"version\""), "{}", told.out);

    // A folder that holds something else is no folder of tiles.
    f.make("city.tiles");
    f.write("city.tiles/notes.txt", "mine");
    f.fails("s.bin -o city.ply --tile 1 --overwrite", 2, &["city.tiles: is no folder of tiles"]);
    assert_eq!(f.read("city.tiles/notes.txt"), b"mine");
    f.ok("s.bin -o town.ply --tile 1");
    f.ok("s.bin -o town.ply --tile 1 --overwrite");
    f.ok("generate sphere 3k -o town.tiles/s.bin");
    f.fails("town.tiles/s.bin -o town.ply --tile 1 --overwrite", 2, &["in the folder that the tiles would replace"]);
}

#[test]
fn a_pipe_where_a_mesh_or_a_side_car_should_be_is_refused_at_once() {
    let f = Folder::new();
    f.ok("generate sphere 3k -o s.bin");
    f.ok("s.bin -o m.ply");
    let pipe = |name: &str| {
        rustix::fs::mkfifoat(rustix::fs::CWD, f.path(name), rustix::fs::Mode::from_raw_mode(0o600)).unwrap();
    };
    pipe("f.ply");
    for line in [
        "check f.ply",
        "render f.ply -o f.png",
        "compare f.ply s.bin",
        "compare m.ply f.ply",
        "densify f.ply s.bin -o f.bin",
    ] {
        f.fails(line, 66, &["f.ply: cannot read", "it is not a regular file"]);
    }
    f.write("p.bin", f.read("s.bin"));
    pipe("p.bin.json");
    f.fails("info p.bin", 66, &["p.bin.json: cannot read", "it is not a regular file"]);
    f.fails("s.bin -o j.ply -j 10000", 2, &["10000", "threads"]);
}

/// The header of a PLY file.
fn header(f: &Folder, name: &str) -> String {
    let bytes = f.read(name);
    let end = bytes.windows(10).position(|w| w == b"end_header").unwrap();
    String::from_utf8(bytes[..end].to_vec()).unwrap()
}

#[test]
fn coordinates_are_the_inputs_own_unless_the_summary_says_so() {
    let f = Folder::new();
    f.ok("generate torus 5000 -o t.ply --size 10 --offset 500000,5400000,200");
    let own = f.ok("t.ply -o own.ply");
    assert!(!own.err.contains("taken off"), "{}", own.err);
    assert!(!header(&f, "own.ply").contains("origin") && header(&f, "own.ply").contains("property double x"));
    for (line, words) in [
        ("t.ply -o local.ply --coordinates local", "taken off the coordinates: --coordinates input leaves them"),
        ("t.ply -o m.obj", "taken off the coordinates: --coordinates input leaves them"),
        ("t.ply -o m.glb", "taken off the coordinates: 32 bits would not hold them"),
    ] {
        let told = f.ok(line).err;
        assert!(told.contains(words) && told.contains("origin 499"), "{told}");
    }
    assert!(header(&f, "local.ply").contains("comment origin 499"));
    assert!(f.path("m_offset.xyz").exists());
    let compared = f.ok("compare local.ply own.ply");
    assert!(compared.out.contains("closed"), "{}", compared.out);
    f.ok("t.ply -o m.obj --coordinates input --overwrite");
    assert!(!f.path("m_offset.xyz").exists(), "the older mesh's origin");
    f.fails("t.ply -o x.stl --coordinates input", 2, &["x.stl has coordinates of 32 bits"]);
}

#[test]
fn a_reference_system_that_contradicts_the_coordinates_is_an_error_until_one_is_given() {
    let f = Folder::new();
    f.ok("generate torus 5000 -o t.bin --size 10 --offset 500000,5400000,200");
    for (crs, expected) in [("EPSG:4326", "degrees of longitude"), ("EPSG:4978", "metres from the centre of the Earth")]
    {
        for command in ["t.bin -o a.ply", "plan t.bin"] {
            let line = format!("{command} --crs {crs}");
            f.fails(&line, 2, &["t.bin: the reference system", crs, expected, "coordinates go from 499", "--crs none"]);
        }
    }
    f.fails("t.bin -o a.ply --crs nowhere", 2, &["--crs nowhere: expected EPSG: and a code"]);
    f.ok("t.bin -o a.ply --crs EPSG:25832");
    assert!(header(&f, "a.ply").contains("comment crs EPSG:25832\n"));
    f.ok("t.bin -o b.ply --crs none");
    assert!(!header(&f, "b.ply").contains("crs"));
}

#[test]
fn attributes_that_never_change_are_left_out_unless_they_are_named() {
    let f = Folder::new();
    let points = f.knot(3000);
    let rows = points.iter().enumerate().map(|(i, [x, y, z])| format!("{x},{y},{z},2,{}\n", i % 9));
    f.write("k.csv", format!("Easting,Northing,Height,classification,intensity\n{}", rows.collect::<String>()));
    f.ok("k.csv -o all.ply");
    let all = header(&f, "all.ply");
    assert!(all.contains("uchar intensity") && !all.contains("property uchar classification"), "{all}");
    assert!(all.contains("comment constant classification 2\n"), "{all}");
    f.ok("k.csv -o named.ply --attributes classification");
    assert!(header(&f, "named.ply").contains("property uchar classification"));
}

#[test]
fn a_format_names_what_nobody_has() {
    let f = Folder::new();
    f.ok("generate sphere 3k -o s.bin");
    for (line, there) in [
        ("s.bin --format glb", "s.mesh.glb"),
        ("s.bin --format stl -o m", "m.stl"),
        ("s.bin --format obj -o m.OBJ", "m.OBJ"),
        ("s.bin --format 3dtiles", "s.3dtiles/tileset.json"),
        ("s.bin --format 3dtiles -o city", "city/tileset.json"),
        ("s.bin --format 3dtiles -o town/tileset.json", "town/tileset.json"),
    ] {
        f.ok(line);
        assert!(!f.read(there).is_empty(), "{line}");
    }
    f.ok("s.bin -o b.glb");
    assert_eq!(f.read("b.glb"), f.read("s.mesh.glb"));
    f.ok("s.bin -o t/tileset.json");
    for other in ["s.3dtiles", "city", "town"] {
        assert_eq!(f.read("t/0-0.glb"), f.read(&format!("{other}/0-0.glb")));
    }
    f.fails("s.bin --format glb", 2, &["s.mesh.glb", "exists already"]);
    f.fails("s.bin --format glb -o m.ply", 2, &["--format glb: m.ply names another format"]);
    f.fails("s.bin --format 3dtiles -o m.ply", 2, &["--format 3dtiles: m.ply names another format"]);
    f.fails("s.bin --format ply -o t/tileset.json", 2, &["--format ply: t/tileset.json names another format"]);
    f.fails("s.bin --format 3dtiles --report s.3dtiles --overwrite", 2, &["s.3dtiles"]);
}
