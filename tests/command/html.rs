//! `--html`: reports in one file.

use super::folder::Folder;

fn page(f: &Folder, name: &str) -> String {
    String::from_utf8(f.read(name)).unwrap()
}

/// What stands between two texts.
fn between<'a>(text: &'a str, start: &str, end: &str) -> &'a str {
    text.split_once(start).unwrap().1.split_once(end).unwrap().0
}

#[test]
fn a_run_a_check_and_a_comparison_are_reported_in_one_file() {
    let f = Folder::new();
    f.knot(20_000);
    f.ok("k.ply -o m.ply --html run.html --report run.json");
    f.ok("check m.ply --html check.html");
    f.ok("compare m.ply k.ply --html compare.html --report compare.json");
    // The same mesh as without.
    f.ok("k.ply -o n.ply");
    assert_eq!(f.read("m.ply"), f.read("n.ply"));
    let names = ["m.ply", "n.ply", "k.ply", "run.html", "run.json", "check.html", "compare.html", "compare.json"];
    assert_eq!(f.names(""), names.map(String::from).into());
    let report: serde_json::Value = serde_json::from_slice(&f.read("run.json")).unwrap();
    for name in ["run.html", "check.html", "compare.html"] {
        let text = page(&f, name);
        assert!(text.starts_with("<!doctype html>") && text.ends_with("</html>\n"), "{name}");
        assert!(text.contains("data:image/png;base64,iVBORw0KGgo"), "{name}");
        // Nothing is fetched, and nothing may be.
        assert!(
            text.contains("default-src 'none'") && !text.contains(" src=\"http") && !text.contains("href=\"http"),
            "{name}"
        );
        let source = between(&text, "getElementById(\"viewer\"), ", ");</script>");
        let source: serde_json::Value = serde_json::from_str(source).unwrap();
        assert_eq!(source["triangles"], report["output"]["triangles"], "{name}");
        assert!(between(&text, "id=\"mesh\">", "</script>").len() > 10_000, "{name}");
        let channels: Vec<&str> =
            source["channels"].as_array().unwrap().iter().map(|c| c["name"].as_str().unwrap()).collect();
        let compared: &[&str] = &["x", "y", "z", "red", "green", "blue", "distance"];
        let expected = if name == "compare.html" { compared } else { &compared[..3] };
        assert_eq!(channels, expected, "{name}");
    }
    let run = page(&f, "run.html");
    assert!(run.contains("<h2>Settings</h2>") && run.contains("does not measure how far points lie"), "{run}");
    // A histogram counts all that was measured.
    let found: serde_json::Value = serde_json::from_slice(&f.read("compare.json")).unwrap();
    let compared = page(&f, "compare.html");
    let chart = between(
        &compared,
        "<figcaption>Distances from the reference&#39;s points to the mesh</figcaption>",
        "</figure>",
    );
    let counts = chart
        .split("<title>")
        .skip(1)
        .map(|bar| between(bar, ": ", "</title>").replace(',', "").parse::<u64>().unwrap());
    let beyond: u64 = between(chart, " in all, ", " (").replace(',', "").parse().unwrap();
    assert_eq!(counts.sum::<u64>() + beyond, found["reference_to_mesh"]["points"]["count"].as_u64().unwrap());
}

#[test]
fn names_of_files_are_text_on_a_page() {
    let f = Folder::new();
    f.knot(5_000);
    f.ok("k.ply -o m.ply");
    f.write("<script>alert(1)<\\.ply", f.read("m.ply"));
    f.write("<img\tsrc=x>.ply", f.read("m.ply"));
    for name in ["<script>alert(1)<\\.ply", "<img\tsrc=x>.ply"] {
        let mut command = f.command("check --html r.html -q");
        assert!(command.arg(name).status().unwrap().success(), "{name}");
        let text = page(&f, "r.html");
        assert!(!text.contains("<script>alert") && !text.contains("<img\t"), "{name}");
        assert!(text.contains("&lt;script&gt;alert") || text.contains("&lt;img\tsrc=x&gt;"), "{name}");
    }
}

#[test]
fn a_page_takes_the_place_of_a_page_only() {
    let f = Folder::new();
    f.knot(5_000);
    f.ok("k.ply -o m.ply");
    f.write("mine.html", "<!doctype html>\n<title>Mine</title>\n");
    f.fails("check m.ply --html mine.html", 2, &["mine.html: exists and is no page of a report"]);
    f.fails("k.ply -o n.ply --html mine.html", 2, &["mine.html"]);
    f.fails("check m.ply --html m.ply", 2, &["m.ply: is an input, which the page would replace"]);
    f.fails("compare m.ply k.ply --html k.ply", 2, &["k.ply: is an input"]);
    f.fails("k.ply -o n.ply --html n.ply", 2, &["cannot be both the mesh and the page"]);
    f.fails("check m.ply --html r.html --max-memory 30M", 71, &["the page needs"]);
    f.ok("check m.ply --html r.html");
    let first = f.read("r.html");
    f.ok("check m.ply --html r.html");
    assert_eq!(f.read("r.html"), first);
    // A run that fails leaves the older page.
    f.write("broken.ply", &f.read("k.ply")[..1000]);
    let answer = f.run("broken.ply -o n.ply --html r.html");
    assert_ne!(answer.code, 0);
    assert_eq!(f.read("r.html"), first);
}
