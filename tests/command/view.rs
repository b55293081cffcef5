//! `view`: what it serves, to whom, and that nothing else is to be had.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Shutdown, SocketAddr, TcpStream, UdpSocket};
use std::process::Child;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use super::folder::Folder;
use crate::let_children_hear_signals;

/// A viewer that runs; dropping it ends it.
struct Viewer {
    child: Child,
    port: u16,
    out: BufReader<std::process::ChildStdout>,
}

impl Viewer {
    fn of(f: &Folder, line: &str) -> Viewer {
        let_children_hear_signals();
        let mut child = f.command(&format!("view {line} --no-open")).spawn().unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut address = String::new();
        out.read_line(&mut address).unwrap();
        if address.is_empty() {
            let mut err = String::new();
            child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
            panic!("view {line}: {err}");
        }
        let port = address.trim().strip_prefix("http://127.0.0.1:").unwrap().strip_suffix('/').unwrap();
        Viewer { port: port.parse().unwrap(), child, out }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// What comes back for these bytes.
    fn raw(&self, request: &[u8]) -> Vec<u8> {
        let mut stream = self.connect();
        stream.write_all(request).unwrap();
        let mut out = Vec::new();
        stream.read_to_end(&mut out).unwrap();
        out
    }

    /// Status, head and body of an answer to a request for a target, with more lines.
    fn asked(&self, method: &str, target: &str, lines: &str) -> (u16, String, Vec<u8>) {
        let out =
            self.raw(format!("{method} {target} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{lines}\r\n", self.port).as_bytes());
        let end = out.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let head = String::from_utf8(out[..end].to_vec()).unwrap();
        (head.split(' ').nth(1).unwrap().parse().unwrap(), head, out[end + 4..].to_vec())
    }

    fn get(&self, target: &str) -> (u16, String, Vec<u8>) {
        self.asked("GET", target, "")
    }

    /// Ends it as Ctrl-C does; gives its exit code and what it said.
    fn end(mut self) -> (Option<i32>, String) {
        kill_process(Pid::from_child(&self.child), Signal::INT).unwrap();
        let code = self.child.wait().unwrap().code();
        let (mut out, mut err) = (String::new(), String::new());
        self.out.read_to_string(&mut out).unwrap();
        assert_eq!(out, "");
        self.child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
        (code, err)
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn status(answer: &[u8]) -> &str {
    std::str::from_utf8(answer.get(9..12).unwrap_or_default()).unwrap()
}

#[test]
fn a_tileset_is_served_until_ctrl_c() {
    let f = Folder::new();
    f.ok("generate knot 20k -o k.ply");
    f.ok("k.ply -o city/tileset.json -q");
    let tile = f.read("city/0-0.glb");
    for path in ["city", "city/tileset.json"] {
        let viewer = Viewer::of(&f, path);
        let (status, head, page) = viewer.get("/");
        assert!(status == 200 && head.contains("Content-Type: text/html; charset=utf-8"), "{head}");
        assert!(head.contains("connect-src 'self'") && !head.contains("Access-Control"), "{head}");
        let page = String::from_utf8(page).unwrap();
        assert!(page.starts_with("<!doctype html>") && page.contains("webgl2"));
        // Nothing of it is elsewhere.
        let elsewhere = ["http:", "https:"].iter().flat_map(|scheme| page.match_indices(scheme));
        assert!(elsewhere.map(|(at, _)| &page[at..at + 26]).all(|url| url == "http://www.w3.org/2000/svg"));
        assert!(!page.contains(" src=") && !page.contains("@import") && !page.contains("url("));
        let (status, head, body) = viewer.get("/tileset.json");
        assert!(status == 200 && head.contains("Content-Type: application/json"), "{head}");
        assert_eq!(body, f.read("city/tileset.json"));
        let (status, head, body) = viewer.get("/0-0.glb?x=1");
        assert!(status == 200 && head.contains("Content-Type: model/gltf-binary"), "{head}");
        assert_eq!(body, tile);
        let (status, head, body) = viewer.asked("GET", "/0-0.glb", "Range: bytes=4-11\r\n");
        assert!(status == 206 && head.contains(&format!("Content-Range: bytes 4-11/{}", tile.len())), "{head}");
        assert_eq!(body, tile[4..12]);
        assert_eq!(viewer.asked("GET", "/0-0.glb", "Range: bytes=999999999-\r\n").0, 416);
        let (status, head, body) = viewer.asked("HEAD", "/0-0.glb", "");
        assert!(
            status == 200 && body.is_empty() && head.contains(&format!("Content-Length: {}", tile.len())),
            "{head}"
        );
        assert_eq!(viewer.get("/1-7.glb").0, 404);
        for method in ["POST", "PUT", "DELETE", "OPTIONS", "TRACE"] {
            assert_eq!(viewer.asked(method, "/", "Content-Length: 3\r\n").0, 405);
        }
        let (port, (code, err)) = (viewer.port, viewer.end());
        assert_eq!(code, Some(0), "{err}");
        assert!(err.contains(&format!("ssh -L {port}:127.0.0.1:{port} ")), "{err}");
    }
}

#[test]
fn what_is_no_tileset_is_refused_before_anything_is_served() {
    let f = Folder::new();
    for (text, found) in [("{\"asset\":", "EOF"), ("{\"asset\":{}}", "root"), ("[]", "tileset"), ("", "EOF")] {
        f.write("tileset.json", text);
        f.fails("view tileset.json --no-open", 65, &["tileset.json: line 1", "JSON with `asset` and `root`", found]);
        f.fails("view . --no-open", 65, &["JSON with `asset` and `root`"]);
    }
}

#[test]
fn meshes_and_clouds_become_tilesets_in_a_folder_that_goes() {
    let f = Folder::new();
    f.ok("generate knot 20k -o k.ply");
    f.ok("k.ply -o m.ply -q");
    f.write("<script>alert(1)<.ply", f.read("m.ply"));
    let before = f.names("");
    for path in ["m.ply", "k.ply", "<script>alert(1)<.ply"] {
        let viewer = Viewer::of(&f, path);
        let (status, _, tree) = viewer.get("/tileset.json");
        assert_eq!(status, 200);
        let tree: serde_json::Value = serde_json::from_slice(&tree).unwrap();
        let name = tree["root"]["content"]["uri"].as_str().unwrap();
        assert!(viewer.get(&format!("/{name}")).2.starts_with(b"glTF"));
        let page = String::from_utf8(viewer.get("/").2).unwrap();
        assert!(!page.contains("<script>alert"), "{page}");
        assert_eq!(viewer.end().0, Some(0));
        assert_eq!(f.names(""), before);
    }
    f.make("empty");
    f.fails("view empty --no-open", 2, &["is no tileset", "tileset.json"]);
    f.fails("view missing.json --no-open", 66, &["missing.json"]);
    f.fails("view missing.ply --no-open", 66, &["missing.ply"]);
}

#[test]
fn nothing_outside_the_folder_is_served() {
    let f = Folder::new();
    f.make("city");
    f.make("city/near");
    f.write("city/tileset.json", "{\"asset\":{},\"root\":{}}");
    f.write("city/near/a b.glb", "own");
    f.write("secret.json", "SECRET");
    f.write("secret.glb", "SECRET");
    f.write("city/notes.txt", "SECRET");
    f.write("city/.secret.json", "SECRET");
    std::os::unix::fs::symlink("../secret.glb", f.path("city/link.glb")).unwrap();
    std::os::unix::fs::symlink("..", f.path("city/up")).unwrap();
    let viewer = Viewer::of(&f, "city");
    assert_eq!(viewer.get("/near/a%20b.glb").2, b"own");
    let absolute = f.path("secret.json").display().to_string();
    let encoded = absolute.replace('/', "%2F");
    for target in [
        "/../secret.json",
        "/%2e%2e/secret.json",
        "/%2E%2E/secret.json",
        "/..%2fsecret.json",
        "/%2e%2e%2fsecret.json",
        "/near/../../secret.json",
        "/near/%2e%2e/%2e%2e/secret.json",
        "/..\\secret.json",
        "/..%5csecret.json",
        "/%5c..%5csecret.json",
        "/link.glb",
        "/up/secret.glb",
        "/up/secret.json",
        "/notes.txt",
        "/.secret.json",
        "/%2esecret.json",
        "/near",
        "/near/",
        "//secret.json",
        "/./tileset.json",
        "/tileset.json%00",
        "/secret.json%00.glb",
        "/%00",
        "/%ff%fe.glb",
        "/%252e%252e/secret.json",
        "/....//secret.json",
        "/..;/secret.json",
        "/~root/secret.json",
        "/proc/self/environ",
        "/etc/passwd",
        &absolute,
        &format!("/{absolute}"),
        &format!("/{encoded}"),
        "../secret.json",
        "secret.json",
        "*",
        "http://127.0.0.1/tileset.json",
        &format!("file://{absolute}"),
    ] {
        let (status, _, body) = viewer.get(target);
        assert!([400, 403, 404].contains(&status), "{target}: {status}");
        assert!(!String::from_utf8_lossy(&body).contains("SECRET"), "{target}");
    }
    // What no browser sends.
    for (request, expected) in [
        (&b"GET /tileset.json\0 HTTP/1.1\r\nHost: localhost\r\n\r\n"[..], "400"),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03 nonsense\r\n\r\n", "400"),
        (b"GET /tileset.json HTTP/1.1\r\nHost: evil.example\r\n\r\n", "403"),
        (b"GET /tileset.json HTTP/1.1\r\nHost: 127.0.0.1.evil.example:80\r\n\r\n", "403"),
        (b"GET /tileset.json HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n", "400"),
        (b"GET /tileset.json HTTP/1.1\r\n\r\n", "400"),
        (b"GET /tileset.json HTTP/1.1\r\nHost: localhost:1234\r\n\r\n", "200"),
    ] {
        assert_eq!(status(&viewer.raw(request)), expected, "{}", String::from_utf8_lossy(request));
    }
}

#[test]
fn whoever_is_slow_or_hostile_keeps_nobody_else_waiting() {
    let f = Folder::new();
    f.make("city");
    f.write("city/tileset.json", "{\"asset\":{},\"root\":{}}");
    f.write("city/big.glb", vec![7u8; 8 << 20]);
    let viewer = Viewer::of(&f, "city");
    // A head without end, and one that claims a body.
    let mut long = b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ".to_vec();
    long.resize(64 << 10, b'x');
    let mut stream = viewer.connect();
    // It may hang up before it has heard all.
    let _ = stream.write_all(&long);
    let mut heard = Vec::new();
    match stream.read_to_end(&mut heard) {
        Ok(_) => assert_eq!(status(&heard), "431"),
        Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset),
    }
    assert_eq!(viewer.asked("GET", "/tileset.json", "Content-Length: 99999999999999\r\n").0, 200);
    // Many that say nothing, many that take nothing.
    let silent: Vec<TcpStream> = (0..100).map(|_| viewer.connect()).collect();
    let mut deaf = Vec::new();
    for _ in 0..40 {
        let mut stream = viewer.connect();
        stream.write_all(b"GET /big.glb HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        deaf.push(stream);
    }
    let start = Instant::now();
    assert_eq!(viewer.get("/tileset.json").2, f.read("city/tileset.json"));
    assert!(start.elapsed() < Duration::from_secs(8), "{:?}", start.elapsed());
    let status = std::fs::read_to_string(format!("/proc/{}/status", viewer.child.id())).unwrap();
    let threads: usize = status.lines().find_map(|line| line.strip_prefix("Threads:")).unwrap().trim().parse().unwrap();
    assert!(threads < 64, "{threads}");
    // One that says half of it and hangs up.
    let mut half = viewer.connect();
    half.write_all(b"GET /tiles").unwrap();
    half.shutdown(Shutdown::Both).unwrap();
    assert_eq!(viewer.get("/tileset.json").2, f.read("city/tileset.json"));
    drop((silent, deaf));
    assert_eq!(viewer.end().0, Some(0));
}

#[test]
fn only_this_machine_reaches_it() {
    let f = Folder::new();
    f.make("city");
    f.write("city/tileset.json", "{\"asset\":{},\"root\":{}}");
    let viewer = Viewer::of(&f, "city");
    // Of the addresses of this machine, only one is listened to.
    let ask = UdpSocket::bind("0.0.0.0:0").and_then(|socket| {
        socket.connect("192.0.2.1:9")?;
        socket.local_addr()
    });
    let own = ask.map(|address| address.ip()).ok().filter(|ip| !ip.is_loopback() && !ip.is_unspecified());
    for ip in own.into_iter().chain([IpAddr::V4(Ipv4Addr::new(127, 0, 0, 2))]) {
        let found = TcpStream::connect_timeout(&SocketAddr::new(ip, viewer.port), Duration::from_secs(2));
        assert!(found.is_err(), "{ip}");
    }
    // The port is taken, which is told before any work.
    let answer = f.run(&format!("view missing.ply --no-open --port {}", viewer.port));
    assert!(answer.code == 2 && answer.err.contains(&format!("--port {}", viewer.port)), "{}", answer.err);
}
