//! The command as a user meets it: what it says, what it writes, how it ends.

#![allow(clippy::disallowed_methods)]

mod command {
    mod batch;
    mod compare;
    pub mod folder;
    mod ground;
    mod html;
    mod outputs;
    mod poses;
    mod simplify;
    mod tasks;
    mod view;
    mod work;
}

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use command::folder::{Answer, Folder, ply, shuffled, with_intensity};

const SHAPES: [&str; 10] = ["sphere", "torus", "knot", "terrain", "plane", "box", "volume", "cluster", "line", "steps"];

// ---- Input that is not what it should be ----

#[test]
fn a_wrong_path_is_named() {
    let f = Folder::new();
    // Whoever finds out, the words begin in the same way.
    for line in ["gone.ply", "--colour red a.ply", "-j many a.ply", "frobnicate --hard", "check --open"] {
        let err = f.run(line).err;
        assert!(err.starts_with("asra-stream: ") && !err.contains("error:"), "{line}: {err}");
    }
    f.fails("gone.ply", 66, &["gone.ply: cannot open: No such file"]);
    f.fails("inof gone.ply", 66, &["inof: cannot open: No such file", "the command is `asra-stream info`"]);
    f.fails("gone*.ply", 66, &["gone*.ply: the pattern matches no file"]);
    f.make("nothing");
    f.fails("nothing", 66, &["nothing: the folder holds no point file"]);
}

#[test]
fn an_empty_file_is_no_cloud() {
    let f = Folder::new();
    f.write("a.ply", "");
    f.fails("a.ply", 65, &["a.ply: length: expected points, found an empty file"]);
}

#[test]
fn a_truncated_file_says_where_it_ends() {
    let f = Folder::new();
    f.knot(1000);
    let whole = f.read("k.ply");
    f.write("cut.ply", &whole[..whole.len() - 5]);
    f.fails("cut.ply", 65, &["cut.ply: vertex 999: expected 1000 vertices of 12 bytes", "found the end of the file"]);
    f.write("head.ply", &whole[..40]);
    f.fails("head.ply", 65, &["head.ply"]);
}

#[test]
fn points_that_are_not_finite_are_dropped_and_counted() {
    let f = Folder::new();
    let mut points = f.knot(5000);
    f.ok("k.ply -o clean.ply");
    points.insert(7, [f32::NAN, 0.0, 0.0]);
    points.insert(2000, [0.0, f32::INFINITY, 9e9]);
    f.write("dirty.ply", ply(&points));
    let answer = f.ok("dirty.ply -o dirty.mesh.ply --report r.json -v");
    assert!(answer.err.contains("points   5,000 (2 dropped: not finite)"), "{}", answer.err);
    assert!(answer.err.contains("warning: 2 points left out: a coordinate is not a number"), "{}", answer.err);
    assert_eq!(report(&f, "r.json")["points"]["dropped"], 2);
    assert_eq!(f.read("dirty.mesh.ply"), f.read("clean.ply"));
    f.write("none.ply", ply(&[[f32::NAN; 3]; 3]));
    f.fails("none.ply", 65, &["the input holds no points (3 records dropped as not finite, 0 left out by filters)"]);
}

#[test]
fn a_raw_file_is_told_by_side_car_flag_or_numbers_or_refused() {
    let f = Folder::new();
    f.ok("generate sphere 20k -o s.bin");
    f.ok("s.bin -o sidecar.ply");
    f.write("bare.bin", f.read("s.bin"));
    f.fails("bare.bin", 2, &["bare.bin: the record layout is ambiguous; name one with --layout", "--layout xyzir"]);
    let answer = f.ok("bare.bin --layout xyz -o given.ply");
    assert!(answer.err.contains("bare.bin: raw xyz little-endian (given)"), "{}", answer.err);
    assert_eq!(f.read("given.ply"), f.read("sidecar.ply"));
    f.fails("bare.bin --layout xy", 2, &["expected one field z, found 0"]);
    f.fails("bare.bin --layout xyz --skip-bytes 5", 65, &["expected a multiple of 12 bytes", "7 left over"]);
}

#[test]
fn foreign_formats_are_refused_by_name() {
    let f = Folder::new();
    f.write("a.bin", [b"CCB2".as_slice(), &[0; 300]].concat());
    f.fails("a.bin", 65, &["a.bin: this is a CloudCompare project", "save the cloud as PLY"]);
    f.write("a.ply", [b"BZh".as_slice(), &[0; 300]].concat());
    f.fails("a.ply", 65, &["a bzip2-compressed file"]);
}

// ---- Compressed files, standard input, other programs' formats ----

fn gzip(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Runs it with these bytes on standard input.
fn fed(f: &Folder, line: &str, bytes: &[u8]) -> Answer {
    use std::io::Write;
    let mut child = f.command(line).stdin(std::process::Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    let bytes = bytes.to_vec();
    // It may refuse to read all of it.
    let feeding = std::thread::spawn(move || drop(input.write_all(&bytes)));
    let answer = Answer::of(child.wait_with_output().unwrap());
    feeding.join().unwrap();
    answer
}

#[test]
fn compressed_files_and_standard_input_give_the_same_mesh() {
    let f = Folder::new();
    let points = f.knot(20_000);
    f.ok("k.ply -o a.ply");
    let expected = f.read("a.ply");
    let plain = f.read("k.ply");
    let zstandard = zstd::bulk::compress(&plain, 3).unwrap();
    f.make("tmp");
    for (name, content) in [("k.ply.gz", gzip(&plain)), ("k.zst", zstandard.clone())] {
        f.write(name, content);
        let answer = f.ok(&format!("{name} -o b.ply --overwrite --report r.json --temp-dir tmp"));
        assert!(answer.err.contains("PLY binary little-endian, 20000 vertices"), "{}", answer.err);
        assert!(f.read("b.ply") == expected, "{name}");
        assert_eq!(report(&f, "r.json")["memory"]["peak_disk"], plain.len());
        assert_eq!(report(&f, "r.json")["inputs"][0]["bytes"], f.read(name).len());
        let info = f.ok(&format!("info {name} --temp-dir tmp")).out;
        assert!(info.contains("points             20,000"), "{info}");
        let plan = f.ok(&format!("plan {name}")).out;
        assert!(plan.contains("unpacked input    234.5 KiB, part of that"), "{plan}");
        assert_eq!(f.names("tmp").len(), 0);
    }
    for bytes in [&plain, &zstandard] {
        let answer = fed(&f, "- -o b.ply --overwrite", bytes);
        assert!(answer.code == 0 && answer.err.contains("standard input: PLY binary"), "{}", answer.err);
        assert!(f.read("b.ply") == expected);
        let info = fed(&f, "info -", bytes);
        assert!(info.code == 0 && info.out.contains("points             20,000"), "{}{}", info.out, info.err);
        assert_eq!(fed(&f, "plan -", bytes).code, 0);
    }
    // Together with a file, and raw.
    f.write("half.ply", ply(&points[..9_000]));
    let half = fed(&f, "half.ply - -o b.ply --overwrite --layout xyz", bytemuck::cast_slice(&points[9_000..]));
    assert_eq!(half.code, 0, "{}", half.err);
    assert!(f.read("b.ply") == expected);
}

#[test]
fn the_default_output_is_named_without_the_compression() {
    let f = Folder::new();
    f.knot(2000);
    f.write("c.ply.gz", gzip(&f.read("k.ply")));
    f.ok("c.ply.gz");
    f.ok("k.ply -o k.mesh.ply");
    assert_eq!(f.read("c.mesh.ply"), f.read("k.mesh.ply"));
    f.make("tiles");
    f.write("tiles/c.ply.gz", f.read("c.ply.gz"));
    f.write("tiles/c.mesh.ply.gz", "no cloud");
    f.ok("tiles");
    assert_eq!(f.read("tiles.mesh.ply"), f.read("k.mesh.ply"));
}

#[test]
fn standard_input_that_is_no_cloud_is_refused() {
    let f = Folder::new();
    let before = f.names("");
    let refused = |line: &str, bytes: &[u8], code: i32, says: &str| {
        let answer = fed(&f, line, bytes);
        assert!(answer.code == code && answer.err.contains(says), "{line}: {}", answer.err);
        assert_eq!(f.names(""), before);
    };
    refused("-", b"1 2 3\n", 2, "standard input has no name that the mesh could have; pass --output");
    refused("- -o m.ply", b"", 65, "standard input: length: expected points, found an empty file");
    refused("- -o m.ply", b"PK\x03\x04", 65, "standard input: this is a ZIP archive");
    refused(
        "- -o m.ply",
        &gzip(b"1 2 3\n")[..20],
        65,
        "standard input: compressed byte 20: expected gzip data, found the end of the file",
    );
    refused("./-", b"", 66, "./-: cannot open");
}

/// The mesh's name is refused, and the folder for temporary files, before anything is read or unpacked.
#[test]
fn what_cannot_be_written_is_refused_before_anything_is_unpacked() {
    let f = Folder::new();
    f.write("m.ply", "precious");
    f.write("k.gz", &gzip(b"1 2 3\n")[..20]);
    f.fails("k.gz -o m.ply", 2, &["m.ply: exists already"]);
    f.fails("k.gz -o n.ply --temp-dir no", 73, &["no: cannot create a temporary file"]);
    f.fails("info k.gz --temp-dir no", 73, &["no: cannot create a temporary file"]);
    f.fails("k.gz -o n.ply", 65, &["k.gz: compressed byte 20: expected gzip data, found the end of the file"]);
}

/// From here on a child hears the signals that end it, even where they were ignored when the tests began (nohup, a script's `&`): what is caught is not passed
/// on, what is ignored is. The tests themselves are ended by them as before.
fn let_children_hear_signals() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    for signal in [SIGHUP, SIGINT, SIGTERM] {
        let always = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(true));
        signal_hook::flag::register_conditional_default(signal, always).unwrap();
    }
}

#[test]
fn ctrl_c_ends_the_wait_for_standard_input() {
    use std::io::Write;
    let_children_hear_signals();
    let f = Folder::new();
    let mut child = f.command("- -o m.ply").stdin(std::process::Stdio::piped()).spawn().unwrap();
    let mut input = child.stdin.take().unwrap();
    // More than a pipe holds: when all is written, some was read.
    input.write_all("1 2 3\n".repeat(200_000).as_bytes()).unwrap();
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    drop(input);
    assert_eq!(f.names("").len(), 0);
}

#[test]
fn a_disk_that_fills_up_while_unpacking_is_reported() {
    let f = Folder::new();
    f.make("tmp");
    f.write("k.xyz.gz", gzip("1 2 3\n".repeat(200_000).as_bytes()));
    let program = f.command("").get_program().to_owned();
    let mut shell = Command::new("sh");
    shell.arg("-c").arg("trap '' XFSZ; ulimit -f 1000; exec \"$0\" k.xyz.gz -o m.ply --temp-dir tmp").arg(program);
    let answer = Answer::of(shell.current_dir(f.path("")).env_remove("TMPDIR").output().unwrap());
    assert!(
        answer.code == 71 && answer.err.contains("tmp: cannot write temporary data: File too large"),
        "{}",
        answer.err
    );
    assert_eq!((f.names("tmp").len(), f.names("").len()), (0, 2));
}

#[test]
fn the_formats_of_other_programs_give_the_same_mesh() {
    let f = Folder::new();
    let points = f.knot(20_000);
    f.ok("k.ply -o a.ply");
    let bytes = f.read("k.ply").split_off(f.read("k.ply").len() - 240_000);
    let pcd = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 20000\nHEIGHT 1\nPOINTS 20000\nDATA binary\n";
    f.write("a.pcd", [pcd.as_bytes(), &bytes].concat());
    let npy = "{'descr': '<f4', 'fortran_order': False, 'shape': (20000, 3), }\n";
    let length = (npy.len() as u16).to_le_bytes();
    f.write("a.npy", [b"\x93NUMPY\x01\x00".as_slice(), &length, npy.as_bytes(), &bytes].concat());
    let mut stl = [[0; 80].as_slice(), &6667u32.to_le_bytes()].concat();
    // The last facet's last corner is the first point once more.
    for facet in points.iter().chain(&points[..1]).collect::<Vec<_>>().chunks(3) {
        stl.extend([0; 12]);
        facet.iter().copied().flatten().for_each(|v| stl.extend(v.to_le_bytes()));
        stl.extend([0; 2]);
    }
    f.write("b.stl", stl);
    for name in ["a.pcd", "a.npy"] {
        f.ok(&format!("{name} -o b.ply --overwrite"));
        assert!(f.read("b.ply") == f.read("a.ply"), "{name}");
    }
    f.write("k.xyz", points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect::<String>());
    f.write("k.obj", points.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect::<String>() + "f 1 2 3\n");
    f.ok("k.xyz -o text.ply");
    f.ok("k.obj -o obj.ply");
    assert!(f.read("obj.ply") == f.read("text.ply"));
    // One point is there twice, so the grid's count may differ, and what amid the points is.
    f.ok("k.ply -o a.ply --overwrite --slices 90 --fit nearest");
    f.ok("b.stl -o b.ply --overwrite --slices 90 --fit nearest");
    assert!(body(&f.read("b.ply")) == body(&f.read("a.ply")));
}

// ---- Output ----

#[test]
fn an_output_that_exists_stays_unless_told() {
    let f = Folder::new();
    f.knot(2000);
    f.write("m.ply", "precious");
    f.fails("k.ply -o m.ply", 2, &["m.ply: exists already; pass --overwrite"]);
    assert_eq!(f.read("m.ply"), b"precious");
    f.ok("k.ply -o m.ply --overwrite");
    assert!(f.read("m.ply").starts_with(b"ply\n"));
    f.fails("k.ply -o k.ply --overwrite", 2, &["k.ply: is an input"]);
    f.fails("generate knot 10 -o k.ply", 2, &["k.ply: exists already"]);
}

#[test]
fn the_default_output_lies_beside_the_input_and_is_no_input_next_time() {
    let f = Folder::new();
    f.knot(2000);
    f.ok("k.ply");
    let first = f.read("k.mesh.ply");
    f.ok("*.ply --overwrite");
    assert_eq!(f.read("k.mesh.ply"), first);
    f.ok(". --overwrite");
    assert_eq!(f.read("k.mesh.ply"), first);
    f.make("tiles");
    f.write("tiles/a.ply", f.read("k.ply"));
    f.ok("tiles/");
    assert_eq!(f.read("tiles.mesh.ply"), first);
}

#[test]
fn an_output_that_cannot_be_is_refused_at_once() {
    let f = Folder::new();
    f.knot(2000);
    f.fails("k.ply -o k.off", 2, &["k.off", ".ply, .stl, .obj or .glb"]);
    f.fails("k.ply -o no/where/k.obj", 73, &["no/where: cannot open the folder: No such file"]);
    f.fails("k.ply --report no/r.json", 73, &["no: cannot open the folder"]);
    f.fails("k.ply --temp-dir no", 73, &["no: cannot create a temporary file: No such file"]);
}

#[test]
fn a_folder_without_write_permission_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let f = Folder::new();
    f.knot(2000);
    f.make("locked");
    std::fs::set_permissions(f.path("locked"), std::fs::Permissions::from_mode(0o555)).unwrap();
    if std::fs::write(f.path("locked/probe"), "").is_ok() {
        return; // The superuser may write anywhere.
    }
    f.fails("k.ply --temp-dir locked", 73, &["locked: cannot create a temporary file: Permission denied"]);
    f.fails("k.ply -o locked/k.ply", 73, &["locked/k.ply: cannot create a file beside: Permission denied"]);
}

/// A limit on the length of files stands in for a disk that is full: the system's answer comes at the same call.
#[test]
fn a_full_disk_is_reported_and_nothing_is_left() {
    let f = Folder::new();
    f.knot(20_000);
    f.make("tmp");
    for (blocks, arguments, says) in [
        (200, "k.ply -o m.ply", "m.ply: cannot"),
        (100, "k.ply -o m.ply --temp-dir tmp --max-memory LEAST", "tmp: cannot write temporary data"),
    ] {
        let arguments = arguments.replace("LEAST", &least_memory(&f, "k.ply"));
        let program = f.command("").get_program().to_owned();
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" {arguments}")).arg(program);
        let before = f.names("");
        let answer = Answer::of(shell.current_dir(f.path("")).env_remove("TMPDIR").output().unwrap());
        assert_eq!(answer.code, 71, "{}", answer.err);
        assert!(answer.err.contains(says) && answer.err.contains("File too large"), "{}", answer.err);
        assert_eq!(f.names(""), before);
        assert_eq!(f.names("tmp").len(), 0);
    }
}

// ---- Arguments ----

#[test]
fn arguments_out_of_range_are_refused_before_the_input_is_read() {
    let f = Folder::new();
    f.knot(2000);
    for (arguments, says) in [
        ("--window 4", "--window 4: the window is an odd number of slices, at least 3"),
        ("--window 1", "--window 1"),
        ("--k 0", "expected a number above 0"),
        ("--k -1", "expected a number above 0"),
        ("--slices 0", "0 is not in 1..=1048575"),
        ("--cell-size -3", "expected a length above 0"),
        ("--k 3 --cell-size 1", "cannot be used with"),
        ("--threads 0", "0 is not in 1..=65535"),
        ("--max-memory much", "expected a size such as 512M or 2G"),
        ("--smooth 1000", "at most 100 steps"),
        ("--min-points 0", "0 is not in 1.."),
        ("--min-points 900", "--min-points 900: none of the"),
        ("--min-component 101%", "a share of the largest such as 1%"),
        ("--min-component -1", "expected a number of cells"),
        ("--min-component 9999999", "--min-component: the largest component has"),
        ("--frobnicate", "--frobnicate"),
    ] {
        f.fails(&format!("k.ply {arguments}"), 2, &[says]);
    }
    f.fails("", 2, &["Usage: asra-stream [OPTIONS] <INPUT>..."]);
    f.fails("generate dragon 10 -o a.ply", 2, &["dragon", "sphere, torus, knot"]);
    f.fails("generate knot 10 -o a.las", 2, &["a.las: expected a name with .bin, .ply, .xyz or .txt"]);
    f.fails("k.ply --cell-size 1e-9", 71, &["cells long along", "--cell-size"]);
}

/// Crumbs and strays beside a knot, in the same box: what is left without them is what would be without their points.
#[test]
fn small_components_and_thin_cells_are_left_out_with_their_points() {
    let f = Folder::new();
    let knot = f.knot(20_000);
    let crumb = |at: [f32; 3], points: usize| (0..points).map(move |i| [at[0] + 1e-6 * i as f32, at[1], at[2]]);
    let corner = |a: usize, end: fn(f32, f32) -> f32| knot.iter().map(|p| p[a]).reduce(end).unwrap();
    let low = [0, 1, 2].map(|a| corner(a, f32::min));
    let high = [0, 1, 2].map(|a| corner(a, f32::max));
    let with = |points: usize| -> Vec<[f32; 3]> {
        knot.iter().copied().chain(crumb(low, points)).chain(crumb(high, points)).collect()
    };
    f.write("clean.ply", ply(&knot));
    f.write("crumbs.ply", ply(&with(5)));
    for fit in ["nearest", "sphere"] {
        f.ok(&format!("clean.ply -o a.ply --slices 60 --fit {fit} --overwrite"));
        let crumbs = |options: &str, says: &str| {
            let answer = f.ok(&format!("crumbs.ply -o b.ply --slices 60 --fit {fit} {options} --overwrite -v"));
            assert!(answer.err.contains(says), "{}", answer.err);
            assert_eq!(body(&f.read("b.ply")), body(&f.read("a.ply")), "{fit} {options}");
        };
        crumbs("", "left out 2 cells of outliers (--keep-outliers keeps them)");
        for least in ["auto", "largest", "50%", "9"] {
            let options = format!("--keep-outliers --min-component {least}");
            crumbs(&options, "left out 2 of 3 components, 2 cells in all");
        }
    }
    let answer =
        f.ok("crumbs.ply -o b.ply --slices 60 --keep-outliers --min-component 1 --overwrite --report r.json -v");
    assert!(!answer.err.contains("left out"), "{}", answer.err);
    assert_eq!(report(&f, "r.json")["closing"]["components"]["found"], 3);
    assert_eq!(report(&f, "r.json")["check"]["components"], 3);
    f.write("strays.ply", ply(&with(1)));
    f.ok("clean.ply -o a.ply --slices 60 --min-points 2 --overwrite");
    let answer = f.ok("strays.ply -o b.ply --slices 60 --min-points 2 --overwrite --report r.json -v");
    assert!(answer.err.contains("cells of too few points"), "{}", answer.err);
    assert!(report(&f, "r.json")["closing"]["sparse_cells"].as_u64().unwrap() >= 2);
    assert_eq!(body(&f.read("b.ply")), body(&f.read("a.ply")));
}

/// A PLY file without its header, which counts the input's points.
fn body(ply: &[u8]) -> &[u8] {
    let end = b"end_header\n";
    &ply[ply.windows(end.len()).position(|w| w == end).unwrap()..]
}

#[test]
fn completions_and_manual_pages_have_every_option() {
    let f = Folder::new();
    let help = f.ok("--help").out;
    let options: Vec<&str> = help.lines().filter_map(|line| line.trim_start().split("--").nth(1)).collect();
    let names: Vec<&str> =
        options.iter().filter_map(|rest| rest.split(|c: char| !(c.is_ascii_lowercase() || c == '-')).next()).collect();
    assert!(names.len() > 30 && names.contains(&"cell-size"), "{names:?}");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let page = f.ok(&format!("completions {shell}")).out;
        let lacking: Vec<&&str> = names.iter().filter(|name| !page.contains(**name)).collect();
        assert!(page.contains("asra-stream") && lacking.is_empty(), "{shell}: {lacking:?}");
    }
    let page = f.ok("man").out;
    let lacking: Vec<&&str> = names.iter().filter(|name| !page.contains(&name.replace('-', "\\-"))).collect();
    assert!(page.contains(".TH asra-stream 1") && lacking.is_empty(), "{lacking:?}");
    let page = f.ok("man check").out;
    assert!(page.contains(".TH asra-stream-check 1") && page.contains("no\\-intersections"), "{page}");
    f.fails("man nothing", 2, &["nothing: no such command; there are: plan, tasks, work, info, check"]);
    f.fails("completions nothing", 2, &["possible values: bash"]);
}

#[test]
fn help_and_version_go_to_standard_output() {
    let f = Folder::new();
    for line in ["--help", "-h", "plan --help", "info --help", "check --help", "render --help", "generate --help"] {
        let answer = f.ok(line);
        assert!(answer.out.contains("Usage:") && answer.err.is_empty(), "{line}");
        assert!(answer.out.contains("\nExamples:\n  asra-stream "), "{line}");
    }
    assert!(f.ok("-h").out.starts_with("Turns point clouds too large for memory into watertight triangle meshes"));
    assert_eq!(f.ok("--version").out, format!("asra-stream {}\n", env!("CARGO_PKG_VERSION")));
}

// ---- Memory, threads, folders: nothing of them shows ----

/// The least budget for `arguments`, found by doing as the refusals say: the first figure is the plan's, made from the survey; what the
/// largest slab needs is known when the solid is, and may be more.
fn least_memory(f: &Folder, arguments: &str) -> String {
    let mut budget = "1M".to_owned();
    for _ in 0..6 {
        let answer = f.run(&format!("{arguments} -o least.ply --overwrite --max-memory {budget}"));
        if answer.code == 0 {
            return budget;
        }
        assert_eq!(answer.code, 71, "{}", answer.err);
        let (_, after) = answer.err.split_once("pass --max-memory ").expect("a figure that would do");
        budget = after.split_whitespace().next().unwrap().to_owned();
    }
    panic!("no figure named for {arguments} was accepted, at last {budget}")
}

#[test]
fn means_do_not_show_in_the_mesh() {
    let f = Folder::new();
    f.knot(60_000);
    f.make("tmp");
    f.ok("k.ply -o a.ply");
    let expected = f.read("a.ply");
    let least = |threads: &str| format!("--max-memory {} {threads}", least_memory(&f, &format!("k.ply {threads}")));
    for means in [
        "--threads 1".to_owned(),
        "-j 7".to_owned(),
        "--temp-dir tmp".to_owned(),
        "--max-memory 64G".to_owned(),
        least("--threads 1"),
        least("--threads 7 --temp-dir tmp"),
    ] {
        f.ok(&format!("k.ply -o b.ply --overwrite {means} --report r.json"));
        assert!(f.read("b.ply") == expected, "{means}");
        let used = report(&f, "r.json")["memory"]["peak_disk"].as_u64().unwrap();
        assert_eq!(used > 0, means.contains("M --threads"), "{means}: {used} bytes on disk");
        assert_eq!(f.names("tmp").len(), 0);
    }
}

#[test]
fn each_output_format_is_the_same_whatever_the_means() {
    let f = Folder::new();
    f.knot(5000);
    let least = least_memory(&f, "k.ply --threads 7");
    let mut topologies = Vec::new();
    for format in ["ply", "stl", "obj", "glb"] {
        f.ok(&format!("k.ply -o a.{format} --threads 1"));
        f.ok(&format!("k.ply -o b.{format} --threads 7 --max-memory {least}"));
        assert!(f.read(&format!("a.{format}")) == f.read(&format!("b.{format}")), "{format}");
        let answer = f.ok(&format!("check a.{format}"));
        assert!(answer.out.contains("closed, consistently oriented, manifold"), "{}", answer.out);
        topologies.push(answer.out.lines().find(|line| line.contains("Euler number")).unwrap().to_owned());
    }
    assert!(topologies.iter().all(|t| *t == topologies[0]), "{topologies:?}");
}

#[test]
fn order_files_and_formats_of_the_points_do_not_show_in_the_mesh() {
    let f = Folder::new();
    let points = f.knot(30_000);
    f.ok("k.ply -o a.ply");
    let mixed = shuffled(&points);
    f.make("parts");
    f.write("parts/a.ply", ply(&mixed[..11_000]));
    f.write("parts/b.bin", bytemuck::cast_slice(&mixed[11_000..25_000]));
    f.write("parts/b.bin.json", r#"{"fields":[["x","f4"],["y","f4"],["z","f4"]],"count":14000}"#);
    f.write("parts/c.bin", with_intensity(&mixed[25_000..]));
    let four = r#"{"fields":[["x","<f4"],["y","<f4"],["z","<f4"],["intensity","<f4"]]}"#;
    f.write("parts/c.bin.json", four);
    f.ok("parts -o b.ply --attributes none");
    f.ok("parts/c.bin parts/b.* parts/a.ply -o c.ply --attributes none");
    let expected = f.read("a.ply");
    assert!(f.read("b.ply") == expected && f.read("c.ply") == expected);
    f.write("k.xyz", points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect::<String>());
    f.ok("k.xyz -o text.ply");
    f.write("reversed.xyz", points.iter().rev().map(|[x, y, z]| format!("{x};{y};{z}\n")).collect::<String>());
    f.ok("reversed.xyz -o reversed.ply");
    assert!(f.read("reversed.ply") == f.read("text.ply"));
}

#[test]
fn points_that_share_a_few_cells_are_told_of() {
    let f = Folder::new();
    let mut points = f.knot(8000);
    let answer = f.ok("k.ply -o even.ply");
    assert!(!answer.err.contains("points to an occupied cell"), "{}", answer.err);
    points.push([1e6; 3]);
    f.write("far.ply", ply(&points));
    let answer = f.ok("far.ply -o far.mesh.ply --report r.json");
    assert!(answer.err.contains("points to an occupied cell, on average: too coarse"), "{}", answer.err);
    assert!(report(&f, "r.json")["points_to_a_cell"].as_f64().unwrap() > 1000.0);
    // As it says: without the stray, it is the cloud it was.
    f.ok("far.ply -o near.ply --bounds -9,-9,-9,9,9,9");
    assert_eq!(f.read("near.ply"), f.read("even.ply"));
}

// ---- Subcommands ----

const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

#[test]
fn check_tells_a_good_mesh_from_a_broken_one() {
    let f = Folder::new();
    f.write("good.obj", TETRAHEDRON);
    let answer = f.ok("check good.obj --report good.json");
    let sound = "closed, consistently oriented, manifold, free of self-intersections\n";
    assert!(answer.out.ends_with(sound), "{}", answer.out);
    assert_eq!(report(&f, "good.json")["closed"], true);
    assert_eq!(report(&f, "good.json")["intersections"]["pairs"], 0);
    let open = TETRAHEDRON.strip_suffix("f 2 3 4\n").unwrap();
    let turned = TETRAHEDRON.replace("f 2 3 4", "f 2 4 3");
    for (name, content, says) in
        [("open.obj", open, "not closed"), ("turned.obj", &turned, "not consistently oriented")]
    {
        f.write(name, content);
        let answer = f.fails(&format!("check {name}"), 4, &[]);
        assert!(answer.out.contains(says), "{}", answer.out);
        assert_eq!(f.fails(&format!("check {name} --quiet"), 4, &[]).out, "");
    }
    // A second tetrahedron, 0.2 further along every axis: its corner lies in the first, and three of its sides pass through.
    let moved = "v 0.2 0.2 0.2\nv 1.2 0.2 0.2\nv 0.2 1.2 0.2\nv 0.2 0.2 1.2\nf 5 7 6\nf 5 6 8\nf 5 8 7\nf 6 7 8\n";
    f.write("two.obj", format!("{TETRAHEDRON}{moved}"));
    let answer = f.ok("check two.obj --no-intersections --report two.json");
    assert!(answer.out.ends_with("manifold\n"), "{}", answer.out);
    assert!(report(&f, "two.json")["intersections"].is_null());
    let answer = f.fails("check two.obj --report two.json", 4, &[]);
    assert!(answer.out.contains("\nintersecting 4 triangles in 3 pairs, such as 3 and 4 near "), "{}", answer.out);
    assert!(answer.out.ends_with("manifold, intersects itself\n"), "{}", answer.out);
    let found = &report(&f, "two.json")["intersections"];
    assert_eq!((&found["pairs"], &found["complete"]), (&3.into(), &true.into()), "{found}");
    assert_eq!(found["first"]["triangles"], serde_json::json!([3, 4]));

    f.fails("check gone.ply", 66, &["gone.ply: cannot open"]);
    f.fails("check good.obj --temp-dir no", 73, &["no: cannot create a temporary file"]);
    f.write("cloud.txt", "1 2 3\n");
    f.fails("check cloud.txt", 2, &["cloud.txt: not a mesh that can be read"]);
    f.knot(10);
    f.fails("check k.ply", 65, &["k.ply: the header: expected one element face (is this a point cloud?)"]);
}

/// Width, height and channels of a PNG file, and its pixels.
fn png(bytes: &[u8]) -> (u32, u32, usize, Vec<u8>) {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, info.color_type.samples(), pixels)
}

#[test]
fn a_mesh_becomes_a_picture_whatever_the_means() {
    let f = Folder::new();
    f.knot(20_000);
    f.ok("k.ply -o m.ply");
    let answer = f.ok("render m.ply --size 320x200 --views iso,35:-20 --max-memory 64M -j 1");
    assert!(
        answer.err.contains("m.png: ") && answer.err.contains(" triangles") && answer.out.is_empty(),
        "{}",
        answer.err
    );
    let first = f.read("m.png");
    let (width, height, channels, pixels) = png(&first);
    assert_eq!((width, height, channels), (320, 200, 3));
    assert!(pixels.iter().filter(|c| **c < 250).count() > pixels.len() / 10);
    f.make("tmp");
    f.ok("render m.ply --size 320x200 --views iso,35:-20 -o b.png --max-memory 1G -j 3 --temp-dir tmp");
    assert!(f.read("b.png") == first);
    assert!(f.names("tmp").is_empty());
    assert_eq!(f.ok("render m.ply -o m.png --size 64x64 --overwrite --quiet").err, "");
    f.ok("render m.ply -o t.PNG --size 30x20 --background transparent --shading flat --up -x --color-by height");
    assert_eq!(png(&f.read("t.PNG")).2, 4);
    // The other formats, in their own precision.
    for format in ["stl", "obj", "glb"] {
        f.ok(&format!("k.ply -o {format}.{format}"));
        f.ok(&format!("render {format}.{format} --size 320x200 --views iso,35:-20 -q"));
        let (_, _, _, other) = png(&f.read(&format!("{format}.png")));
        let apart = pixels.iter().zip(&other).filter(|(a, b)| a.abs_diff(**b) > 8).count();
        assert!(apart < pixels.len() / 200, "{format}: {apart} of {}", pixels.len());
    }
}

#[test]
fn pictures_show_attributes_that_are_there() {
    let f = Folder::new();
    f.write("i.ply", with_intensity(&f.knot(5000)));
    // One value everywhere is left out unless it is named.
    f.ok("i.ply -o m.ply --attributes intensity");
    f.ok("i.ply -o m.glb --attributes intensity");
    f.ok("i.ply -o m.stl");
    f.ok("render m.ply --size 90x90 --color-by Intensity");
    f.ok("render m.glb --size 90x90 --color-by intensity -o g.png");
    assert_eq!(png(&f.read("m.png")), png(&f.read("g.png")));
    f.ok("render m.ply --size 90x90 -o plain.png");
    assert!(f.read("m.png") != f.read("plain.png"));
    for mesh in ["m.ply", "m.glb"] {
        let line = format!("render {mesh} --color-by rgb -o n.png");
        f.fails(&line, 2, &[mesh, "its vertices have no attribute red; there are: intensity"]);
    }
    f.fails("render m.stl --color-by class -o n.png", 2, &["no attribute classification; there are: none"]);
}

#[test]
fn what_cannot_be_drawn_leaves_no_picture() {
    let f = Folder::new();
    f.knot(3000);
    f.ok("k.ply -o m.ply");
    f.fails("render gone.ply", 66, &["gone.ply: cannot open"]);
    f.fails("render k.ply", 65, &["is this a point cloud?"]);
    f.fails("render m.ply -o m.jpg", 2, &["m.jpg: pictures are .png"]);
    f.fails("render m.ply -o no/m.png", 73, &["no: cannot open the folder"]);
    f.fails("render m.ply --max-memory 4M", 71, &["--max-memory 4.0 MiB: a picture of this size needs", "M or more"]);
    f.fails(
        "render m.ply --size 3x3 --views iso,top,left,right,front,back,bottom,1:2,3:4,5:6",
        2,
        &["too small for 10 views"],
    );
    for (line, part) in [
        ("--size 0x5", "expected a width and a height"),
        ("--views above", "AZIMUTH:ELEVATION"),
        ("--views iso,,top", "AZIMUTH:ELEVATION"),
        ("--up w", "expected x, y, z"),
        ("--background mauve", "a colour as in #f0f4f8"),
        ("--shading shiny", "smooth"),
    ] {
        f.fails(&format!("render m.ply {line}"), 2, &[part]);
    }
    f.write("m.png", "theirs");
    f.fails("render m.ply", 2, &["m.png: exists already; pass --overwrite"]);
    assert_eq!(f.read("m.png"), b"theirs");
    let whole = f.read("m.ply");
    f.write("cut.ply", &whole[..whole.len() - 40]);
    f.fails("render cut.ply", 65, &["cut.ply"]);
    let mut wrong = whole.clone();
    let last = wrong.len() - 1;
    wrong[last] = 0x7f;
    f.write("wrong.ply", &wrong);
    f.fails("render wrong.ply", 65, &["wrong.ply: face", "vertex numbers below"]);
    f.write("empty.obj", "v 0 0 0\n");
    let answer = f.ok("render empty.obj --size 20x20");
    assert!(answer.err.contains("the picture is empty"), "{}", answer.err);
    assert!(png(&f.read("empty.png")).3.iter().all(|c| *c == 255));
}

#[test]
fn a_run_draws_a_preview() {
    let f = Folder::new();
    f.knot(20_000);
    let answer = f.ok("k.ply --preview --report r.json");
    assert!(answer.err.contains("\npreview  k.mesh.png"), "{}", answer.err);
    assert!(report(&f, "r.json")["output"]["preview"].as_str().unwrap().ends_with("k.mesh.png"));
    let first = f.read("k.mesh.png");
    assert_eq!(&png(&first).0, &1200);
    f.ok("k.ply -o b.glb --preview=other.png --max-memory 200M -j 3 --no-check");
    assert!(f.read("other.png") == first);
    f.fails("k.ply -o c.ply --preview=other.png", 2, &["other.png: exists already"]);
    f.fails("k.ply -o c.ply --preview=c.jpg", 2, &["c.jpg: pictures are .png"]);
    f.ok("generate terrain 20k -o t.bin");
    f.fails(
        "t.bin --surface terrain --cell-size auto -o c.ply --preview --max-memory 26M",
        71,
        &["the preview needs", "M or more"],
    );
    f.ok("t.bin --surface terrain --cell-size auto --preview --tile 0.5 -o t.ply");
    assert!(f.path("t.png").exists() && f.path("t.tiles").exists());
    f.ok("t.bin --surface sheet --facing 0.2,0.1,1 --cell-size auto --preview -o s.ply");
    assert!(f.read("s.png") != f.read("t.png"));
}

#[test]
fn terrain_is_open_on_purpose_and_a_base_closes_it() {
    let f = Folder::new();
    f.ok("generate terrain 20k --size 100 -o t.bin");
    let answer = f.ok("t.bin --surface terrain --cell-size auto -o t.ply --report r.json -v");
    for words in
        ["surface  terrain, seen from +z: ", "open on purpose, 1 boundary loop, oriented, manifold; 1 component"]
    {
        assert!(answer.err.contains(words), "{words}: {}", answer.err);
    }
    let report = report(&f, "r.json");
    assert_eq!(report["check"]["boundary_loops"], 1);
    assert_eq!(report["parameters"]["open"]["kind"], "terrain");
    assert_eq!(report["parameters"]["open"]["facing"], "+z");
    assert!(report["closing"]["columns"]["data"].as_u64().unwrap() > 1000);
    let answer = f.ok("check t.ply --open");
    let verdict = "not closed (1 boundary loop), consistently oriented, manifold, free of self-intersections\n";
    assert!(answer.out.ends_with(verdict), "{}", answer.out);
    f.fails("check t.ply", 4, &[]);
    f.ok("t.bin --surface sheet --facing +z --cell-size auto -o s.ply");
    f.ok("t.bin --surface terrain --base -60 --cell-size auto -o b.ply");
    f.ok("check b.ply");
    f.ok("plan t.bin --surface terrain");

    f.fails("t.bin --surface terrain --axis z -o x.ply", 2, &["--axis z: a slice must hold whole columns"]);
    f.fails("t.bin --surface terrain --base 60 -o x.ply", 2, &["--base 60: must not lie above the lowest point"]);
    f.fails("t.bin --surface terrain --facing -z -o x.ply", 2, &["terrain is seen from +z"]);
    f.fails("t.bin --surface terrain --min-component 5 -o x.ply", 2, &["--min-component: a surface that is seen"]);
    f.fails("t.bin --surface sheet -o x.ply", 2, &["--facing must say"]);
    f.fails("t.bin --surface sheet --facing up -o x.ply", 2, &["expected +x, -x, +y, -y, +z or -z"]);
    f.fails("t.bin --max-hole 3 -o x.ply", 2, &["--max-hole: is for --surface sheet and terrain"]);
    f.fails("t.bin --base 3 -o x.ply", 2, &["--base: is for --surface terrain"]);
}

#[test]
fn plan_and_info_look_and_write_nothing() {
    let f = Folder::new();
    f.knot(5000);
    let before = f.names("");
    let plan = f.ok("plan k.ply --max-memory 100M").out;
    for row in ["points            5,000", "slices along y", "of 100.0 MiB granted", "least memory", "temporary disk"] {
        assert!(plan.contains(row), "{row:?} is not in\n{plan}");
    }
    let named = plan.lines().find(|l| l.starts_with("least memory")).unwrap();
    let megabytes = named.split_whitespace().nth(2).unwrap().trim_end_matches(".0");
    f.fails("plan k.ply --max-memory 1M", 71, &[&format!("pass --max-memory {megabytes}M or more")]);
    f.fails("k.ply --max-memory 1M", 71, &[&format!("pass --max-memory {megabytes}M or more")]);
    let info = f.ok("info k.ply").out;
    for row in ["k.ply, 58.7 KiB", "PLY binary little-endian, 5000 vertices", "dropped", "extent", "sampling distance"]
    {
        assert!(info.contains(row), "{row:?} is not in\n{info}");
    }
    assert_eq!(f.names(""), before);
}

#[test]
fn every_generated_shape_becomes_a_closed_mesh() {
    let f = Folder::new();
    for shape in SHAPES {
        f.ok(&format!("generate {shape} 3000 -o {shape}.bin --noise 0.001"));
        for window in ["", "--window 3"] {
            f.ok(&format!("{shape}.bin -o m.ply --overwrite {window}"));
            f.ok("check m.ply -q");
        }
    }
}

#[test]
fn cells_of_automatic_size_seal_and_keep_the_genus() {
    let f = Folder::new();
    let area = |shape| match shape {
        "sphere" => std::f64::consts::PI,
        "box" => 6.0,
        _ => 0.0,
    };
    for (shape, genus) in [("sphere", 0), ("box", 0), ("torus", 1), ("knot", 1)] {
        for points in [12_000, 60_000] {
            f.ok(&format!("generate {shape} {points} -o s.xyz --overwrite --seed {points}"));
            // Half of the shape has a tenth of its points.
            let text = f.read("s.xyz");
            let lines = std::str::from_utf8(&text).unwrap().lines().enumerate();
            let kept = lines.filter(|(i, line)| line.starts_with('-') || i % 10 == 0).map(|(_, line)| line);
            f.write("thin.xyz", kept.collect::<Vec<_>>().join("\n"));
            // A tenth of few points, or of those of flat faces, leaves holes as wide as what they are to enclose is thick.
            let thin = if points > 20_000 && shape != "box" { Some("thin") } else { None };
            for cloud in [Some("s"), thin].into_iter().flatten() {
                f.ok(&format!("{cloud}.xyz -o s.ply --overwrite --cell-size auto --report r.json -q"));
                let report = report(&f, "r.json");
                let (check, closing) = (&report["check"], &report["closing"]);
                let what = format!("{points} points of {shape}, {cloud}: {closing}");
                assert_eq!((&check["components"], &check["genus"]), (&1.into(), &genus.into()), "{what}");
                assert_eq!(closing["parted"], true, "{what}");
                if area(shape) > 0.0 {
                    let distance = report["points"]["sampling_distance"].as_f64().unwrap();
                    let expected = (area(shape) / report["points"]["count"].as_f64().unwrap()).sqrt();
                    assert!((0.88..1.12).contains(&(distance / expected)), "{what}: {distance}, not {expected}");
                }
            }
        }
    }
}

#[test]
fn large_coordinates_keep_their_place() {
    let f = Folder::new();
    f.ok("generate torus 5000 -o t.ply --size 10 --offset 500000,5400000,200");
    for format in ["ply", "obj", "glb", "stl"] {
        f.ok(&format!("t.ply -o {format}.{format} --report r.json"));
        let report = report(&f, "r.json");
        let least = report["check"]["bounds"][0][1].as_f64().unwrap() + report["output"]["origin"][1].as_f64().unwrap();
        assert!((least - 5_399_995.0).abs() < 0.1, "{least}");
        f.ok(&format!("check {format}.{format} -q"));
    }
}

#[test]
fn the_scan_in_the_repository_becomes_a_closed_mesh() {
    let f = Folder::new();
    let scan = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/stadium");
    let answer = f.ok(&format!("{} -o m.ply -v", scan.display()));
    assert!(
        answer.err.contains("points   410,866\n") && answer.err.contains("closed, oriented, manifold"),
        "{}",
        answer.err
    );
}

#[test]
fn a_mesh_is_written_in_tiles() {
    let f = Folder::new();
    f.ok("generate torus 8000 -o t.ply --size 10 --offset 500000,5400000,200");
    let answer = f.ok("t.ply -o city.glb --tile 4 --report r.json");
    assert!(answer.err.contains("output   city.tiles, "), "{}", answer.err);
    let index: serde_json::Value = serde_json::from_slice(&f.read("city.tiles/index.json")).unwrap();
    let tiles = index["tiles"].as_array().unwrap();
    assert_eq!(
        tiles.iter().map(|t| t["triangles"].as_u64().unwrap()).sum::<u64>(),
        report(&f, "r.json")["output"]["triangles"]
    );
    assert!(tiles.iter().any(|t| t["file"] == "125000_1349999.glb") && !f.path("city.glb").exists());
    f.fails("t.ply -o city.glb --tile 4", 2, &["city.tiles: exists already"]);
    // What a killed run left goes with the next.
    f.make(".city.tiles.a1B2c3.tmp");
    f.write(".city.tiles.a1B2c3.tmp/1_1.glb", "half a tile");
    f.ok("t.ply -o city.glb --tile 4 --overwrite");
    assert!(!f.names("").iter().any(|name| name.starts_with('.')), "{:?}", f.names(""));
    f.ok("t.ply -o city.glb --tile 4 --overwrite -q");
    f.fails("t.ply -o city.stl --tile 4", 2, &["--tile: city.stl names no PLY or GLB files"]);
}

#[test]
fn tiles_are_counted_beforehand_and_too_many_are_refused() {
    let f = Folder::new();
    f.ok("generate terrain 20k --size 100 -o t.bin");
    let run = f.ok("t.bin --surface terrain --cell-size auto -o t.ply --tile 10 --report r.json");
    let made = report(&f, "r.json")["output"]["tiles"].as_u64().unwrap();
    assert!(run.err.contains(&format!("output   t.tiles, {made} tiles and an index, ")), "{}", run.err);
    assert_eq!(f.names("t.tiles").len() as u64, made + 1);
    let plan = f.ok("plan t.bin --surface terrain --cell-size auto --tile 10 --json");
    let planned: serde_json::Value = serde_json::from_str(&plan.out).unwrap();
    // A triangle's middle may lie beyond the points' box.
    let foretold = planned["tiles"].as_u64().unwrap();
    assert!((100..=144).contains(&made) && foretold.abs_diff(made) <= 44, "{foretold}, {made}");
    assert!(run.err.contains(&format!("about {foretold} tiles in t.tiles")), "{}", run.err);
    assert!(f.ok("plan t.bin --tile 50").out.contains("tiles             about "));
    let absurd = ["--tile 0.01: makes about ", " tiles, and 100,000 is the limit; pass --tile 0."];
    for command in
        ["plan t.bin --cell-size 0.01 --surface terrain", "t.bin -o n.ply --cell-size 0.01 --surface terrain"]
    {
        f.fails(&format!("{command} --max-memory 4G --tile 0.01"), 2, &absurd);
    }
}

/// A LAS file of version 1.4 and point format 6 with points on a square lattice a metre apart, in the reference system of a WKT, if there is one.
fn lattice_las(f: &Folder, name: &str, side: i32, wkt: Option<&str>) {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(6).unwrap();
    builder.transforms.x.scale = 0.01;
    builder.transforms.y.scale = 0.01;
    builder.transforms.z.scale = 0.01;
    if let Some(wkt) = wkt {
        builder.has_wkt_crs = true;
        let vlr = las::Vlr {
            user_id: "LASF_Projection".into(),
            record_id: 2112,
            data: wkt.as_bytes().to_vec(),
            ..Default::default()
        };
        builder.vlrs.push(vlr);
    }
    let mut writer = las::Writer::from_path(f.path(name), builder.into_header().unwrap()).unwrap();
    for i in 0..side * side {
        let (x, y) = (f64::from(i % side), f64::from(i / side));
        let classification = las::point::Classification::new(if i % 4 == 0 { 2 } else { 6 }).unwrap();
        let point = las::Point {
            x: 500_000.0 + x,
            y: 4_600_000.0 + y,
            z: (x / 9.0).sin(),
            classification,
            return_number: 1 + (i % 3 == 0) as u8,
            number_of_returns: 2,
            gps_time: Some(0.0),
            ..Default::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

#[test]
fn info_tells_units_density_classes_and_returns() {
    let f = Folder::new();
    let feet = r#"PROJCS["feet",GEOGCS["g",UNIT["degree",0.0174532925199433]],PROJECTION["p"],UNIT["foot",0.3048],AUTHORITY["EPSG","2992"]]"#;
    lattice_las(&f, "a.las", 120, Some(feet));
    let info = f.ok("info a.las --json").out;
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    let system = &info["reference_system"];
    assert_eq!(
        (&system["unit"], &system["metres_per_unit"], &system["epsg"]),
        (&"ft".into(), &0.3048.into(), &2992.into())
    );
    assert_eq!(
        (&info["points"], &info["classification"]["2"], &info["classification"]["6"]),
        (&14_400.into(), &3600.into(), &10_800.into())
    );
    assert_eq!((&info["return_number"]["1"], &info["return_number"]["2"]), (&9600.into(), &4800.into()));
    assert_eq!(info["number_of_returns"]["2"], 14_400);
    for (key, expected) in [("points_per_square_unit", 1.0), ("spacing", 1.0), ("area", 14_400.0)] {
        let found = info[key].as_f64().unwrap();
        assert!((0.9..1.1).contains(&(found / expected)), "{key}: {found}");
    }
    let words = f.ok("info a.las").out;
    for row in [
        "unit                 ft of 0.3048 m",
        " points/ft² seen from above, one every ",
        "2 (ground) 3,600",
        "6 (building) 10,800",
        "1: 9,600, 2: 4,800",
    ] {
        assert!(words.contains(row), "{row:?} is not in\n{words}");
    }
    // Filters count here, too.
    let ground = f.ok("info a.las --keep-class 2 --json").out;
    let ground: serde_json::Value = serde_json::from_str(&ground).unwrap();
    assert_eq!(ground["classification"], serde_json::json!({ "2": 3600 }));
    // Coordinates that cannot be in the system are told of, and refused only where something would be made of them.
    lattice_las(
        &f,
        "b.las",
        40,
        Some(r#"GEOGCS["WGS 84",DATUM["D",SPHEROID["S",6378137,298.257223563]],UNIT["degree",0.0174532925199433]]"#),
    );
    let answer = f.ok("info b.las --json");
    let info: serde_json::Value = serde_json::from_str(&answer.out).unwrap();
    let contradiction = info["reference_system"]["contradiction"].as_str().unwrap();
    assert!(contradiction.contains("expects degrees of longitude and latitude"), "{contradiction}");
    assert!(info["reference_system"]["unit"].is_null(), "{info}");
    assert!(answer.err.contains("warning: ") && answer.err.contains("--crs none"), "{}", answer.err);
    f.fails("plan b.las", 2, &["expects degrees"]);
    lattice_las(&f, "c.las", 40, None);
    let info: serde_json::Value = serde_json::from_str(&f.ok("info c.las --json").out).unwrap();
    assert!(info["reference_system"].is_null(), "{info}");
}

#[test]
fn plan_and_info_look_where_nothing_can_be_written() {
    let f = Folder::new();
    f.knot(5000);
    // Nobody can create a file beside this one, whatever the rights.
    let open = || std::fs::File::open(f.path("k.ply")).unwrap();
    let info = Answer::of(f.command("info /proc/self/fd/0").stdin(open()).output().unwrap());
    assert!(info.code == 0 && info.out.contains("points             5,000"), "{}{}", info.out, info.err);
    let plan = Answer::of(f.command("plan /proc/self/fd/0").stdin(open()).output().unwrap());
    assert!(plan.code == 0, "{}{}", plan.out, plan.err);
    assert!(
        plan.out.contains("nothing can be written to /proc/self/fd: a run needs --output and --temp-dir"),
        "{}",
        plan.out
    );
    let plan = Answer::of(f.command("plan /proc/self/fd/0 --json").stdin(open()).output().unwrap());
    let found: serde_json::Value = serde_json::from_str(&plan.out).unwrap();
    assert_eq!((&found["points"], &found["unwritable_folder"]), (&5000.into(), &"/proc/self/fd".into()));
    for key in
        ["memory_bytes", "memory_granted_bytes", "memory_least_bytes", "temporary_disk_bytes", "triangles", "threads"]
    {
        assert!(found[key].is_u64(), "{key} is not in {found:#}");
    }
    // A folder that is named must do.
    assert_eq!(
        Answer::of(f.command("plan /proc/self/fd/0 --temp-dir /proc/self/fd").stdin(open()).output().unwrap()).code,
        73
    );
}

// ---- Words ----

#[test]
fn quiet_says_nothing() {
    let f = Folder::new();
    let generated = f.ok("generate box 2000 -o b.ply -q");
    let made = f.ok("b.ply -o m.ply --quiet");
    let checked = f.ok("check m.ply --quiet");
    for answer in [generated, made, checked] {
        assert_eq!((answer.out.as_str(), answer.err.as_str()), ("", ""));
    }
    f.fails("b.ply -o m.ply --quiet", 2, &["exists already"]);
}

#[test]
fn words_go_to_standard_error_and_need_no_terminal() {
    let f = Folder::new();
    f.knot(2000);
    let answer = f.ok("k.ply");
    assert_eq!(answer.out, "");
    let rows = ["k.ply: PLY binary", "survey  2,000 points, ", "surface  ", "output   k.mesh.ply, ", "mesh     "];
    let details =
        ["points   2,000", "grid     ", "closing  sealed: the mesh encloses the inside", "time     ", "memory   "];
    let mut rest = answer.err.as_str();
    for row in rows {
        let at = rest.find(row).unwrap_or_else(|| panic!("{row:?} is not in its place in\n{}", answer.err));
        rest = &rest[at..];
    }
    assert!(!details.iter().any(|row| answer.err.contains(row)), "{}", answer.err);
    // What is said while it works has the time of day.
    let said = answer.err.lines().take_while(|line| !line.starts_with("output ")).collect::<Vec<_>>();
    assert!(said.len() > 5, "{}", answer.err);
    for line in said {
        let (time, _) = line.split_once(' ').unwrap();
        assert!(time.len() == 20 && time.ends_with('Z') && time.as_bytes()[10] == b'T', "{line}");
    }
    assert!(!answer.err.contains('\u{1b}') && !answer.err.contains('\r'), "no bars in a log");
    let answer = f.ok("k.ply -o v.ply -v");
    for row in rows[..3].iter().chain(&details) {
        assert!(answer.err.contains(row), "{row:?} is not in\n{}", answer.err);
    }
}

/// The events of a command whose progress is JSON.
fn events(err: &str) -> Vec<serde_json::Value> {
    err.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"))).collect()
}

#[test]
fn progress_in_json_is_an_object_a_line_to_the_end() {
    let f = Folder::new();
    f.knot(20_000);
    f.write("k.ply.gz", gzip(&f.read("k.ply")));
    f.write("plane.xyz", (0..2000).map(|i| format!("{} {} 0\n", i % 50, i / 50)).collect::<String>());
    for (line, stages) in [
        ("k.ply.gz -o k.mesh.ply --preview", "unpack survey bucket raster seal reopen surface check render write"),
        ("k.ply -o k.tiles.ply --tile 0.3 --no-check", "survey bucket raster seal reopen surface write"),
        ("plane.xyz -o open.ply --surface terrain --cell-size 2", "survey bucket raster seal surface check write"),
        ("plan k.ply.gz", "unpack survey rehearse"),
        ("info k.ply", "survey"),
        ("check k.mesh.ply", "check intersect"),
        ("compare k.mesh.ply k.ply", "check survey compare"),
        ("compare k.mesh.ply k.ply.gz --heatmap h.ply", "unpack check survey compare write"),
        ("compare k.mesh.ply k.mesh.ply", "check survey compare"),
        ("densify k.mesh.ply k.ply -o d.ply", "survey write"),
        ("densify k.mesh.ply k.ply.gz -o e.ply", "unpack survey write"),
        ("render k.mesh.ply -o r.png", "render"),
        ("generate box 2k -o b.bin", "generate"),
    ] {
        let answer = f.ok(&format!("{line} --progress json"));
        let events = events(&answer.err);
        let of = |name: &str| events.iter().filter(|e| e["event"] == name).collect::<Vec<_>>();
        let finished: Vec<&str> = of("stage").iter().map(|e| e["stage"].as_str().unwrap()).collect();
        let mut distinct = finished.clone();
        distinct.dedup();
        assert_eq!(distinct.join(" "), stages, "{line}");
        // It never falls, nor does the time.
        let all = ["progress", "stage"].map(of).concat();
        for key in ["fraction", "elapsed_seconds"] {
            let values: Vec<f64> = events.iter().filter_map(|e| e[key].as_f64()).collect();
            assert!(values.is_sorted() && values.iter().all(|v| *v >= 0.0), "{line}: {key} {values:?}");
            assert!(key != "fraction" || values.iter().all(|v| *v <= 1.0), "{line}: {values:?}");
        }
        for event in all {
            assert!(event["unit"].is_string() && event["done"].is_u64(), "{event}");
            if let (Some(done), Some(total)) = (event["done"].as_u64(), event["total"].as_u64()) {
                assert!(done <= total, "{event}");
            }
        }
        let end = events.last().unwrap();
        assert_eq!((&end["event"], &end["exit_code"], &end["kind"]), (&"end".into(), &0.into(), &"done".into()));
        assert!(of("progress").iter().all(|event| event["fraction"].is_f64()), "{line}: {}", answer.err);
        assert_eq!(of("stage").pop().unwrap()["fraction"].as_f64(), Some(1.0), "{line}: {}", answer.err);
        assert_eq!(end["output"]["bytes"].is_u64(), stages.contains("bucket"), "{line}: {end}");
    }
    let run = f.ok("plane.xyz -o slab.ply --progress json");
    let warnings: Vec<_> = events(&run.err).into_iter().filter(|e| e["event"] == "warning").collect();
    assert!(warnings.iter().any(|w| w["message"].as_str().unwrap().starts_with("not sealed: ")), "{}", run.err);
    assert!(warnings[0]["advice"].as_str().unwrap().contains("--surface terrain"), "{}", run.err);
    let failed = f.fails("gone.ply --progress json", 66, &[]);
    let end = events(&failed.err).pop().unwrap();
    assert_eq!((&end["exit_code"], &end["kind"]), (&66.into(), &"no-input".into()));
    assert!(end["message"].as_str().unwrap().contains("gone.ply"), "{end}");
    assert_eq!(f.ok("k.ply -o q.ply --progress json -q").err, "");
}

/// A pipe is closed over its ends where they are a third of its length wide. Where they are half of it, it stays a pipe.
#[test]
fn a_pipe_is_closed_over_its_ends_and_not_called_sealed() {
    let f = Folder::new();
    let pipe = |length: u32| -> String {
        let place = |i: u32| (f64::from(i) * 2.399963, f64::from(i) / 1500.0);
        let line = |(angle, z): (f64, f64)| format!("{} {} {z}\n", angle.cos(), angle.sin());
        (0..1500 * length).map(|i| line(place(i))).collect()
    };
    f.write("pipe.xyz", pipe(6));
    let answer = f.ok("pipe.xyz -o p.ply --report r.json -v");
    let closing = &report(&f, "r.json")["closing"];
    assert!(closing["bridged"].as_f64().unwrap() > 0.02, "{closing}");
    assert_eq!((&closing["sealed"], &closing["parted"]), (&false.into(), &true.into()), "{closing}");
    assert!(answer.err.contains("\nclosing  closed over holes: "), "{}", answer.err);
    assert!(answer.err.contains(" % of the surface bridges holes"), "{}", answer.err);
    f.write("short.xyz", pipe(4));
    let answer = f.ok("short.xyz -o s.ply --report s.json -v");
    let report = report(&f, "s.json");
    assert_eq!(report["check"]["genus"], 1, "{report:#}");
    assert!(report["closing"]["open"][0]["share"].as_f64().unwrap() > 0.9, "{report:#}");
    assert!(answer.err.contains("\nclosing  not sealed: "), "{}", answer.err);
}

/// Numbers from 0 to 1 that look random.
fn parts() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / f64::from(1u32 << 31)
    }
}

/// Points at random on both sides of a spherical shell, or on a sphere alone.
fn shell(points: usize, thickness: f64) -> String {
    let mut part = parts();
    let mut lines = Vec::new();
    while lines.len() < points {
        let way = [(); 3].map(|()| 2.0 * part() - 1.0);
        let length = way.iter().map(|c| c * c).sum::<f64>().sqrt();
        if (0.1..1.0).contains(&length) {
            let inner = (1.0 - thickness) * (1.0 - thickness);
            let radius = if part() < inner / (1.0 + inner) { 1.0 - thickness } else { 1.0 };
            let [x, y, z] = way.map(|c| c / length * radius);
            lines.push(format!("{x:.6} {y:.6} {z:.6}"));
        }
    }
    lines.join("\n")
}

/// The level's cells take the two walls of a shell that is two sampling distances thick for one, and so its void for the inside.
#[test]
fn a_shell_that_is_too_thin_for_its_void_to_be_seen_is_not_called_sealed() {
    let f = Folder::new();
    f.write("ball.xyz", shell(30_000, 0.0));
    f.write("shell.xyz", shell(150_000, 0.027));
    f.ok("ball.xyz -o ball.ply --report ball.json");
    let ball = &report(&f, "ball.json")["closing"];
    assert_eq!((&ball["sealed"], &ball["too_wide"]), (&true.into(), &serde_json::Value::Null), "{ball}");
    let told = f.ok("shell.xyz -o shell.ply --report shell.json -v").err;
    let report = report(&f, "shell.json");
    let closing = &report["closing"];
    assert_eq!((&closing["sealed"], &closing["parted"]), (&false.into(), &true.into()), "{closing}");
    let [level, cell] = [&closing["too_wide"], &report["grid"]["cell_size"]].map(|side| side.as_f64().unwrap());
    let cells = level / cell;
    assert!(cells >= 0.999 && (cells - cells.round()).abs() < 1e-6, "{cells} cells");
    assert!(
        told.contains("\nclosing  closed, with slots, voids or walls that may be too narrow to be seen\n"),
        "{told}"
    );
    assert!(told.contains("warning: not sealed: some slots, voids or walls are hardly wider than "), "{told}");
}

/// Points at random on boxes within each other, of these half sides.
fn boxes(halves: &[[f64; 3]]) -> String {
    let mut part = parts();
    let mut lines = String::new();
    for half in halves {
        for a in 0..3 {
            let [b, c] = [(a + 1) % 3, (a + 2) % 3];
            for _ in 0..(14.0 * half[b] * half[c]) as usize {
                let mut p = half.map(|half| half * (2.0 * part() - 1.0));
                p[a] = half[a].copysign(p[a]);
                lines += &format!("{:.5} {:.5} {:.5}\n", p[0], p[1], p[2]);
            }
        }
    }
    lines
}

/// A void that is four cells wide needs finer cells, which only shows while cells are closed.
#[test]
fn a_budget_without_room_for_finer_cells_is_refused_with_one_that_does() {
    let f = Folder::new();
    f.write("b.xyz", boxes(&[0.0, 6.0, 10.5].map(|inwards| [65.0, 20.0, 20.0].map(|half: f64| half - inwards))));
    f.ok("b.xyz -o roomy.ply --report r.json");
    let told = report(&f, "r.json");
    assert_eq!((&told["check"]["components"], &told["closing"]["too_wide"]), (&3.into(), &serde_json::Value::Null));
    let refused = f.fails("b.xyz -o b.ply --max-memory 14M", 71, &["narrow slots or shells"]);
    let figure = refused.err.split("pass --max-memory ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
    f.ok(&format!("b.xyz -o b.ply --max-memory {figure}"));
    assert!(f.read("b.ply") == f.read("roomy.ply"), "the budget changes the mesh");
}

/// Makes meshes of knots that differ by their seeds alone, k.bin, until one's report is as asked; gives that and what was told. Which one that is depends on every width.
fn first_knot(
    f: &Folder,
    points: u32,
    options: &str,
    is_asked: impl Fn(&serde_json::Value) -> bool,
) -> (serde_json::Value, String) {
    for seed in 1..=100 {
        f.ok(&format!("generate knot {points} --seed {seed} -o k.bin --overwrite"));
        let answer = f.ok(&format!("k.bin -o k.ply --report r.json -v --overwrite {options}"));
        let report = report(f, "r.json");
        if is_asked(&report) {
            return (report, answer.err);
        }
    }
    panic!("none of a hundred knots of {points} points is as asked");
}

/// Knots have one handle, but so few points leave another one that is a cell wide.
#[test]
fn a_mesh_with_a_handle_that_may_not_be_the_objects_is_not_called_sealed() {
    let f = Folder::new();
    let handles = |report: &serde_json::Value| report["closing"]["narrow_handles"].as_u64().unwrap();
    let reopened = |report: &serde_json::Value| report["closing"]["narrow_reopened"] == true;
    let more = |report: &serde_json::Value| report["check"]["genus"].as_u64().unwrap() > 1;
    let is_asked = |report: &serde_json::Value| handles(report) > 0 && more(report) && !reopened(report);
    let (report, told) = first_knot(&f, 2500, "--k 5 --upsample off", is_asked);
    let closing = &report["closing"];
    assert_eq!((&closing["sealed"], &closing["parted"]), (&false.into(), &true.into()), "{closing}");
    let (cell, bounds) = (report["grid"]["cell_size"].as_f64().unwrap(), &closing["narrow_handle"]);
    let side = |end: &str| bounds[end][0].as_f64().unwrap();
    assert!(side("max") - side("min") > 0.99 * cell, "{closing}");
    assert!(told.contains("\nclosing  closed, with handles that may not be the object's: "), "{told}");
    assert!(told.contains(" two cells wide or less, "), "{told}");
    // Of others, they go when the slots are opened anew.
    let (report, told) = first_knot(&f, 2100, "--upsample off", |report| reopened(report) && !more(report));
    let closing = &report["closing"];
    assert_eq!((&report["check"]["genus"], &closing["sealed"]), (&1.into(), &false.into()), "{closing}");
    let count = handles(&report);
    let line = format!("\nclosing  closed, where slots were opened anew for narrow handles: {count}");
    let place = match count {
        1 => "; its slot was filled and opened anew: in x ",
        _ => "; their slots were filled and opened anew, the widest in x ",
    };
    assert!(told.contains(&line) && told.contains(place), "{told}");
    f.ok("generate sphere 20k -o s.bin");
    f.ok("s.bin -o s.ply --report s.json -q");
    assert_eq!(self::report(&f, "s.json")["closing"]["narrow_handles"], 0);
}

/// Four of these had strands that touch, and were called sealed, if what all points together tell were not asked.
#[test]
fn no_sealed_knot_of_few_points_has_strands_that_touch() {
    let f = Folder::new();
    for seed in 1..=16 {
        f.ok(&format!("generate knot 1700 --seed {seed} -o k.bin --overwrite"));
        f.ok("k.bin -o k.ply --report r.json -q --overwrite");
        let made = report(&f, "r.json");
        let shape = (&made["check"]["genus"], &made["check"]["components"]);
        assert!(made["closing"]["sealed"] == false || shape == (&1.into(), &1.into()), "{seed}: {made:#}");
    }
}

#[test]
fn few_points_of_a_thin_body_are_enough_together() {
    let f = Folder::new();
    let is_asked = |report: &serde_json::Value| report["points"]["added"] != 0;
    let (made, told) = first_knot(&f, 1500, "-j 1 --max-memory 48M", is_asked);
    assert_eq!((&made["check"]["genus"], &made["check"]["components"]), (&1.into(), &1.into()), "{made:#}");
    assert_eq!(made["closing"]["sealed"], true, "{made:#}");
    let (count, added) = (&made["points"]["count"], made["points"]["added"].as_u64().unwrap());
    assert!(*count == 1500 && added > 4 * 1500, "{count} {added}");
    assert!(told.contains(" places of its surface are added"), "{told}");
    // The same bytes with other threads and another budget, by points in another order, in a folder that a run can go on in, and by tasks.
    let expected = f.read("k.ply");
    f.ok("k.bin -o many.ply -q -j 3");
    let mut records: Vec<Vec<u8>> = f.read("k.bin").chunks(12).map(<[u8]>::to_vec).collect();
    records.reverse();
    f.write("backwards.bin", records.concat());
    f.ok("backwards.bin --layout xyz -o backwards.ply -q");
    f.ok("k.bin -o folder.ply -q --work folder.work");
    f.ok("plan k.bin -o tasks.ply -q --work tasks.work --processes 3");
    f.ok("work tasks.work --any -q");
    for made in ["many.ply", "backwards.ply", "folder.ply", "tasks.ply"] {
        assert!(f.read(made) == expected, "{made}");
    }
    // Not where cells are chosen, nor where it is not wanted.
    for without in ["--upsample off", "--k 4", "--bridged"] {
        f.ok(&format!("k.bin -o without.ply --overwrite --report without.json -q {without}"));
        assert_eq!(report(&f, "without.json")["points"]["added"], 0, "{without}");
    }
}

#[test]
fn what_may_be_wrong_with_a_mesh_is_a_warning_with_advice() {
    let f = Folder::new();
    f.write("plane.xyz", (0..2000).map(|i| format!("{} {} 0\n", i % 50, i / 50)).collect::<String>());
    let answer = f.ok("plane.xyz -o slab.ply --report r.json");
    let (before, after) = answer.err.split_once("\nwarning: not sealed: ").unwrap_or_else(|| panic!("{}", answer.err));
    assert!(before.contains("\nmesh     ") && before.contains("output   slab.ply, "), "{before}");
    assert!(after.contains("\n         --surface terrain (seen from above) or "), "{after}");
    let warnings = report(&f, "r.json")["warnings"].clone();
    assert!(warnings[0]["message"].as_str().unwrap().starts_with("not sealed: "), "{warnings}");
    assert!(warnings[0]["advice"].as_str().unwrap().starts_with("--surface terrain"), "{warnings}");
    f.ok("generate sphere 20k -o s.bin");
    let answer = f.ok("s.bin -o s.ply --report s.json");
    assert!(!answer.err.contains("warning"), "{}", answer.err);
    assert_eq!(report(&f, "s.json")["warnings"], serde_json::json!([]));
}

fn report(f: &Folder, name: &str) -> serde_json::Value {
    serde_json::from_slice(&f.read(name)).unwrap()
}

#[test]
fn the_report_holds_what_batch_jobs_ask_for() {
    let f = Folder::new();
    f.knot(3000);
    f.write("r.json", "{\"version\": \"an older report\"}");
    f.ok("k.ply -o m.ply --report r.json --k 3 --window 3 --smooth 2 -q");
    let r = report(&f, "r.json");
    for pointer in [
        "/version",
        "/inputs/0/path",
        "/inputs/0/layout",
        "/parameters/k",
        "/parameters/window",
        "/parameters/surface/smooth",
        "/points/count",
        "/points/bounds/min/0",
        "/grid/axis",
        "/grid/slices",
        "/grid/raster/2",
        "/grid/cell_size",
        "/parameters/keep_outliers",
        "/parameters/min_component",
        "/closing/sealed",
        "/closing/part_nothing",
        "/closing/narrow_handles",
        "/closing/outlier_cells",
        "/closing/components/found",
        "/check/closed",
        "/check/genus",
        "/check/volume",
        "/output/path",
        "/output/bytes",
        "/output/triangles",
        "/output/origin/2",
        "/seconds/0/1",
        "/seconds_total",
        "/memory/plan/budget",
        "/memory/plan/predicted",
        "/memory/peak_resident",
        "/memory/peak_disk",
    ] {
        assert!(r.pointer(pointer).is_some_and(|v| !v.is_null()), "{pointer} is not in {r:#}");
    }
    assert_eq!(r["output"]["bytes"], f.read("m.ply").len());
    assert!(r["closing"]["radius"].is_null(), "{r:#}");
    f.ok("k.ply -o n.ply --report r.json --no-check --seal 2c -q");
    let r = report(&f, "r.json");
    assert!(r["check"].is_null());
    assert_eq!(r["closing"]["radius"], 2);
}

#[test]
fn ctrl_c_leaves_nothing_behind() {
    let_children_hear_signals();
    let f = Folder::new();
    f.ok("generate knot 1M -o k.bin");
    f.make("tmp");
    f.write("m.ply", "precious");
    let before = f.names("");
    let command = "k.bin -o m.ply --overwrite --report r.json --temp-dir tmp --k 12";
    for wait in [0, 150, 600] {
        let mut child = f.command(command).spawn().unwrap();
        let mut words = BufReader::new(child.stderr.take().unwrap());
        let mut err = String::new();
        words.read_line(&mut err).unwrap();
        std::thread::sleep(Duration::from_millis(wait));
        let id = rustix::process::Pid::from_child(&child);
        rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
        std::io::Read::read_to_string(&mut words, &mut err).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{err}");
        assert!(
            err.ends_with("asra-stream: interrupted; temporary files are removed, no output was written\n"),
            "{err}"
        );
        let failure = report(&f, "r.json");
        assert_eq!((&failure["error"]["kind"], &failure["error"]["code"]), (&"signal".into(), &130.into()));
        std::fs::remove_file(f.path("r.json")).unwrap();
        assert_eq!(f.names(""), before);
        assert_eq!(f.names("tmp").len(), 0);
        assert_eq!(f.read("m.ply"), b"precious");
    }
}

/// What ends the process tells so; what was ignored when it began (nohup, a script's `&`) does not.
#[test]
fn signals_end_a_run_as_such_unless_they_were_ignored() {
    use rustix::process::{Pid, Signal, kill_process};
    use std::io::{Read, Write};
    let_children_hear_signals();
    let f = Folder::new();
    let points = f.knot(20_000);
    let text: String = points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let program = f.command("").get_program().to_owned();
    for (signal, name, code) in [(Signal::HUP, "HUP", 129), (Signal::INT, "INT", 130), (Signal::TERM, "TERM", 143)] {
        for ignored in [false, true] {
            let mut shell = Command::new("sh");
            let trap = if ignored { format!("trap '' {name}; ") } else { String::new() };
            shell.arg("-c").arg(format!("{trap}exec \"$0\" - -o m.ply --overwrite --report r.json")).arg(&program);
            let piped = std::process::Stdio::piped;
            shell.current_dir(f.path("")).env_remove("TMPDIR").stdin(piped()).stderr(piped());
            let mut child = shell.spawn().unwrap();
            let mut input = child.stdin.take().unwrap();
            // More than a pipe holds: when all is written, some was read, and signals are seen to.
            input.write_all(text.as_bytes()).unwrap();
            kill_process(Pid::from_child(&child), signal).unwrap();
            if ignored {
                drop(input);
            }
            let mut err = String::new();
            child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
            let expected = if ignored { 0 } else { code };
            assert_eq!(child.wait().unwrap().code(), Some(expected), "{name}, ignored: {ignored}\n{err}");
            let told = &report(&f, "r.json")["error"];
            assert_eq!(told["code"], if ignored { serde_json::Value::Null } else { code.into() }, "{told}");
        }
    }
}

/// A failed run tells a machine why, too.
#[test]
fn a_failure_is_reported_with_what_is_known() {
    let f = Folder::new();
    f.knot(2000);
    let whole = f.read("k.ply");
    f.write("cut.ply", &whole[..whole.len() - 5]);
    f.write("s.bin.json", "{\"layout\": \"xyz\"}");
    let failed = |line: &str, code: i32| {
        assert_eq!(f.run(&format!("{line} --report r.json")).code, code, "{line}");
        let failure = report(&f, "r.json")["error"].clone();
        assert_eq!(failure["code"], code);
        failure
    };
    let data = failed("cut.ply -o m.ply", 65);
    assert_eq!(
        (&data["kind"], &data["path"], &data["place"]),
        (&"data".into(), &"cut.ply".into(), &"vertex 1999".into())
    );
    assert_eq!(failed("gone.ply -o m.ply", 66)["kind"], "no-input");
    assert_eq!(failed("gone*.ply -o m.ply", 66)["path"], "gone*.ply");
    let budget = failed("k.ply -o m.ply --max-memory 1M", 71);
    assert_eq!((&budget["kind"], &budget["given"]), (&"cannot-fit".into(), &(1 << 20).into()));
    assert!(budget["needed"].as_u64().unwrap() > 1 << 20);
    assert_eq!(failed("k.ply -o k.ply", 2)["kind"], "usage");
    assert_eq!(failed("check k.ply", 65)["path"], "k.ply");
    assert_eq!(failed("compare gone.ply k.ply", 66)["path"], "gone.ply");
    // What is no report stays, as long as it is not known whether it is an input.
    let before = f.read("s.bin.json");
    f.fails("gone.ply s.bin --report s.bin.json", 66, &["gone.ply"]);
    assert!(f.read("s.bin.json") == before);
}

#[test]
fn standard_error_that_cannot_be_written_is_no_panic() {
    let f = Folder::new();
    f.knot(2000);
    let full = || std::fs::File::options().write(true).open("/dev/full").unwrap();
    assert_eq!(f.command("gone.ply").stderr(full()).status().unwrap().code(), Some(66));
    assert_eq!(f.command("k.ply -o m.ply").stderr(full()).status().unwrap().code(), Some(0));
    for (number, how) in ["json", "lines"].into_iter().enumerate() {
        let line = format!("k.ply -v -o m{number}.ply --progress {how}");
        assert_eq!(f.command(&line).stderr(full()).status().unwrap().code(), Some(0), "{how}");
        let line = format!("gone.ply --progress {how}");
        assert_eq!(f.command(&line).stderr(full()).status().unwrap().code(), Some(66), "{how}");
    }
}

/// Points that have no surface to be seen are no defect of the program.
#[test]
fn a_sheet_of_nothing_is_an_error_of_its_own() {
    let f = Folder::new();
    f.write("three.xyz", "0 0 0\n1 0 0\n2 1 0\n");
    f.write("line.xyz", (0..10).map(|i| format!("{i} 0 0\n")).collect::<String>());
    f.write("place.xyz", "1 1 1\n".repeat(5));
    for name in ["three", "line", "place"] {
        for surface in ["terrain", "sheet --facing +z"] {
            let line = format!("{name}.xyz --surface {surface} -o m.ply");
            let answer = f.fails(&line, 65, &["the points make no surface"]);
            assert!(!answer.err.contains("report this"), "{}", answer.err);
        }
    }
    let far: Vec<[f32; 3]> = f.knot(2000).iter().map(|p| p.map(|c| c * 3e38)).collect();
    f.write("far.ply", ply(&far));
    f.fails("far.ply --surface sheet --facing @0,0,0 -o m.ply", 2, &["leaves single precision no room"]);
}

#[test]
fn lengths_have_units_where_the_input_has_one() {
    let f = Folder::new();
    f.knot(5000);
    let terrain = "t.bin --surface terrain -o";
    f.ok("generate terrain 20k --size 100 -o t.bin");
    // Metres: 4 cm are .04.
    f.ok("k.ply --cell-size 0.04 --seal 0.1 -o plain.ply --crs EPSG:25832");
    for (cell, seal) in [("4cm", "10cm"), ("40mm", "0.1m"), ("0.04m", "100mm")] {
        f.ok(&format!("k.ply --cell-size {cell} --seal {seal} -o unit.ply --overwrite --crs EPSG:25832"));
        assert!(f.read("unit.ply") == f.read("plain.ply"), "{cell} {seal}");
    }
    // Feet of two kinds.
    f.ok(&format!("{terrain} ft.ply --crs EPSG:2992 --cell-size 1.25 --max-hole 20 --base -60"));
    f.ok(&format!("{terrain} in.ply --crs EPSG:2992 --cell-size 15in --max-hole 20ft --base -720in"));
    assert!(f.read("in.ply") == f.read("ft.ply"));
    let answer = f.ok(&format!("{terrain} us.ply --crs EPSG:2229 --cell-size 0.5m --report us.json"));
    let report = report(&f, "us.json");
    assert!((report["grid"]["cell_size"].as_f64().unwrap() - 0.5 * 3937.0 / 1200.0).abs() < 1e-12, "{}", answer.err);
    let tiles =
        |side: &str, name: &str| f.ok(&format!("{terrain} {name}.ply --crs EPSG:25832 --cell-size 2 --tile {side}"));
    tiles("50", "a");
    tiles("0.05km", "b");
    assert_eq!(f.names("a.tiles"), f.names("b.tiles"));
    f.ok("plan k.ply --cell-size 4cm --crs EPSG:25832");
    assert!(f.ok("info k.ply --cell-size 4cm --crs EPSG:25832").out.contains("cells of 0.04,"));
}

#[test]
fn a_unit_without_one_in_the_input_is_an_error_that_says_so() {
    let f = Folder::new();
    f.knot(5000);
    let unknown = "the unit of the input is not known; give a plain number";
    f.fails("k.ply --cell-size 5cm -o m.ply", 2, &["--cell-size 5cm: ", unknown, "--crs"]);
    f.fails("k.ply --seal 5cm -o m.ply", 2, &["--seal 5cm: ", unknown]);
    f.fails("k.ply --tile 5m -o m.ply", 2, &["--tile 5m: ", unknown]);
    f.fails("k.ply --surface terrain --max-hole 5ft -o m.ply", 2, &["--max-hole 5ft: ", unknown]);
    f.fails("k.ply --surface terrain --base -5usft -o m.ply", 2, &["--base -5usft: ", unknown]);
    f.fails("info k.ply --cell-size 5cm", 2, &[unknown]);
    f.fails("plan k.ply --cell-size 5cm", 2, &[unknown]);
    f.fails("k.ply --cell-size 5cm --crs EPSG:4326 -o m.ply", 2, &["degrees, which have no length"]);
    f.fails("k.ply --cell-size 5ells -o m.ply", 2, &["expected a length above 0, or `auto`, found \"5ells\""]);
    f.fails("k.ply --cell-size=-5cm -o m.ply", 2, &["expected a length above 0, or `auto`, found \"-5cm\""]);
    f.fails("k.ply --seal 8ccm -o m.ply", 2, &["found \"8ccm\""]);
    f.ok("k.ply --cell-size 0.05 -o m.ply");
    f.fails("compare m.ply k.ply --heatmap h.ply --heatmap-max 5cm", 2, &["--heatmap-max 5cm: ", unknown]);
    f.fails("compare m.ply m.ply --heatmap h.ply --heatmap-max 5cm", 2, &["the unit of a mesh is not known"]);
    f.fails("compare m.ply m.ply --heatmap h.ply --heatmap-max 5%m", 2, &["expected a length"]);
}

#[test]
fn a_folder_is_read_without_what_the_program_made_of_it() {
    let f = Folder::new();
    f.make("scans");
    f.make("scans/deep");
    f.ok("generate knot 3000 -o scans/a.ply");
    f.ok("generate knot 3000 --seed 5 -o scans/deep/b.ply");
    f.write("scans/readme.txt", "two scans\n");
    f.write("scans/empty.laz", "");
    let first = f.ok("scans -o scans/all.ply --preview");
    let line = "scans: left out, no point clouds: empty.laz (empty), readme.txt (text without points)";
    assert!(first.err.contains(line), "{}", first.err);
    f.ok("compare scans/all.ply scans/a.ply --heatmap scans/heat.ply");
    let again = f.ok("scans -o again.ply");
    assert!(again.err.contains("scans: left out, meshes of this program: all.ply, heat.ply\n"), "{}", again.err);
    assert!(f.read("again.ply") == f.read("scans/all.ply"));
    f.ok("scans/a.ply scans/deep/b.ply -o both.ply");
    f.ok("scans --recursive -o deep.ply");
    assert!(f.read("deep.ply") == f.read("both.ply"));
    let info = f.ok("info scans");
    assert!(info.err.contains("empty.laz (empty)"), "{}", info.err);
}

#[test]
fn pictures_have_the_vertices_colours_and_a_legend() {
    let f = Folder::new();
    let coloured: Vec<String> = (0u32..3000)
        .map(|i| {
            let (turn, up) = (f64::from(i) * 2.399_963, f64::from(i) / 1500.0 - 1.0);
            let flat = (1.0 - up * up).sqrt();
            format!("{},{},{},{},{},40\n", 5.0 * flat * turn.cos(), 5.0 * flat * turn.sin(), 5.0 * up, i % 250, i / 12)
        })
        .collect();
    f.write("c.csv", format!("x,y,z,red,green,blue\n{}", coloured.concat()));
    f.ok("c.csv -o m.ply --crs EPSG:25832 --preview");
    let draw = |name: &str, more: &str| {
        f.ok(&format!("render m.ply -o {name}.png --size 480x360 {more}"));
        png(&f.read(&format!("{name}.png")))
    };
    let (own, plain) = (draw("own", ""), draw("plain", "--color-by none"));
    assert!(own == draw("rgb", "--color-by rgb") && own != plain, "colours are taken where there are some");
    f.ok("c.csv -o n.ply --attributes none");
    f.ok("render n.ply -o n.png --size 480x360 --no-legend");
    assert!(png(&f.read("n.png")) == draw("none", "--color-by none --no-legend"), "and none where there are none");

    // Below the body, on white: a bar and its length; above them a scale, if colours tell values.
    let ink = |(_, _, _, pixels): &(u32, u32, usize, Vec<u8>), rows: std::ops::Range<usize>| {
        pixels.chunks_exact(3 * 480).skip(rows.start).take(rows.len()).flatten().filter(|c| **c != 255).count()
    };
    let height = draw("height", "--color-by height");
    assert!(ink(&own, 345..360) > 100 && ink(&height, 345..360) > 100);
    assert!(ink(&height, 334..345) > 2000, "{}", ink(&height, 334..345));
    assert!(ink(&own, 334..345) == 0 && ink(&draw("bare", "--no-legend"), 346..360) == 0);
    // The unit is part of it, where the mesh tells its reference system.
    f.ok("c.csv -o u.ply");
    f.ok("render u.ply -o u.png --size 480x360");
    let unknown = png(&f.read("u.png"));
    assert!(ink(&unknown, 345..360) < ink(&own, 345..360) && ink(&unknown, 345..360) > 50);
}
