//! Answers a browser on this machine: a page, and the files of one folder.
//!
//! ```text
//!   accept ─► at most MOST connections, a thread each ─► head, 8 KiB at most, within seconds ─► one answer, and the connection is closed
//!                  the oldest goes when another comes
//! ```
//!
//! It listens on 127.0.0.1 alone, and answers only if it is called by a name of this machine: so no page of another site reads what is served by having its own
//! name lead here. A path is taken apart before it touches the file system, and what it leads to, with all links followed, must lie in the folder.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use percent_encoding::percent_decode_str;

use crate::error::{Error, Result};
use crate::resources::workers::Workers;

/// Connections at a time.
const MOST: usize = 32;
/// Bytes of a request's head.
const HEAD: usize = 8 << 10;
/// Lines of a request's head.
const LINES: usize = 64;
/// How long a head may take to come.
const PATIENCE: Duration = Duration::from_secs(10);
/// Bytes a second with which an answer must be taken, once [`PATIENCE`] is over.
const LEAST_RATE: u64 = 8 << 10;
/// Bytes that are sent at once.
const PIECE: usize = 64 << 10;
/// How often it is looked whether to stop.
const LOOK: Duration = Duration::from_millis(50);
/// What the page may do: run what is in it, and ask this server.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What is served.
#[derive(Debug)]
pub struct Site {
    page: String,
    folder: PathBuf,
}

impl Site {
    /// A page as `/`, and the files of a folder and of those in it, as far as they are of a tileset.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder is not there.
    pub fn new(page: String, folder: &Path) -> Result<Site> {
        Ok(Site { page, folder: folder.canonicalize().map_err(Error::io(folder, "open"))? })
    }

    /// The file that a request's path names.
    fn file(&self, path: &str) -> std::result::Result<(File, &'static str), Status> {
        let decoded = percent_decode_str(path).decode_utf8().map_err(|_| Status::BadRequest)?;
        let names: Vec<&str> = decoded.strip_prefix('/').ok_or(Status::BadRequest)?.split('/').collect();
        // A colon is of a drive or a stream, elsewhere a backslash parts folders.
        let wrong = |c: char| c.is_control() || "\\:".contains(c);
        if names.iter().any(|name| name.is_empty() || name.starts_with('.') || name.contains(wrong)) {
            return Err(Status::BadRequest);
        }
        let named: PathBuf = self.folder.join(names.iter().collect::<PathBuf>());
        let there = named.canonicalize().map_err(|_| Status::NotFound)?;
        let kind = there.extension().and_then(|extension| kind_of(&extension.to_string_lossy()));
        match kind {
            Some(kind) if there.starts_with(&self.folder) && there.is_file() => {
                Ok((File::open(&there).map_err(|_| Status::NotFound)?, kind))
            }
            _ => Err(Status::NotFound),
        }
    }
}

/// The kind of a file of a tileset, by its extension.
fn kind_of(extension: &str) -> Option<&'static str> {
    match &*extension.to_ascii_lowercase() {
        "json" => Some("application/json"),
        "glb" => Some("model/gltf-binary"),
        _ => None,
    }
}

/// How a request went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Status {
    Ok,
    Partial,
    BadRequest,
    Forbidden,
    NotFound,
    NotAllowed,
    NotThere,
    TooLong,
}

impl Status {
    /// As its line has it.
    fn words(self) -> &'static str {
        match self {
            Status::Ok => "200 OK",
            Status::Partial => "206 Partial Content",
            Status::BadRequest => "400 Bad Request",
            Status::Forbidden => "403 Forbidden",
            Status::NotFound => "404 Not Found",
            Status::NotAllowed => "405 Method Not Allowed",
            Status::NotThere => "416 Range Not Satisfiable",
            Status::TooLong => "431 Request Header Fields Too Large",
        }
    }
}

/// A server that has its port.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
}

/// The connections that are open, by the order in which they came.
#[derive(Default)]
struct Open {
    streams: Mutex<BTreeMap<u64, TcpStream>>,
    closed: Condvar,
}

impl Server {
    /// Takes a port of 127.0.0.1: any that is free for 0.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is not to be had.
    pub fn new(port: u16) -> Result<Server> {
        let bound =
            TcpListener::bind((Ipv4Addr::LOCALHOST, port)).and_then(|listener| Ok((listener.local_addr()?, listener)));
        let (address, listener) = bound.map_err(|words| Error::Usage(format!("--port {port}: {words}")))?;
        Ok(Server { listener, address })
    }

    /// The port.
    pub fn port(&self) -> u16 {
        self.address.port()
    }

    /// Answers until the workers are cancelled.
    ///
    /// # Errors
    /// None but that no thread is to be had.
    pub fn serve(self, site: &Site, workers: &Workers) -> Result<()> {
        let (open, stop) = (Open::default(), AtomicBool::new(false));
        let (open, stop) = (&open, &stop);
        thread::scope(|scope| {
            let listener = &self.listener;
            let accepting = move || {
                for number in 0u64.. {
                    let accepted = listener.accept();
                    if stop.load(Ordering::Relaxed) {
                        return;
                    }
                    // Out of file descriptors, or the caller has gone again.
                    let Ok((stream, _)) = accepted else {
                        thread::sleep(LOOK);
                        continue;
                    };
                    let Ok(own) = stream.try_clone() else { continue };
                    open.put(number, own);
                    let answer = move || {
                        // Whoever has gone needs no answer.
                        let _ = answer(&stream, site);
                        open.take(number);
                    };
                    if thread::Builder::new().name("asra-answer".into()).spawn_scoped(scope, answer).is_err() {
                        open.take(number);
                    }
                }
            };
            let acceptor = thread::Builder::new().name("asra-accept".into()).spawn_scoped(scope, accepting);
            let acceptor = acceptor.map_err(Error::io("a thread", "start"))?;
            while workers.check_cancelled().is_ok() && !acceptor.is_finished() {
                thread::sleep(LOOK);
            }
            stop.store(true, Ordering::Relaxed);
            // It waits for somebody to come.
            let _ = TcpStream::connect(self.address);
            open.end();
            Ok(())
        })
    }
}

impl Open {
    fn streams(&self) -> MutexGuard<'_, BTreeMap<u64, TcpStream>> {
        self.streams.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes room for one more, if need be by ending the oldest.
    fn put(&self, number: u64, stream: TcpStream) {
        let mut streams = self.streams();
        while streams.len() >= MOST {
            if let Some((_, oldest)) = streams.first_key_value() {
                let _ = oldest.shutdown(Shutdown::Both);
            }
            let waited = self.closed.wait_timeout(streams, LOOK);
            streams = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        streams.insert(number, stream);
    }

    fn take(&self, number: u64) {
        self.streams().remove(&number);
        self.closed.notify_all();
    }

    fn end(&self) {
        self.streams().values().for_each(|stream| drop(stream.shutdown(Shutdown::Both)));
    }
}

/// What is asked.
#[derive(Debug, PartialEq)]
struct Asked {
    /// Of `GET` and `HEAD`, whether it is the latter.
    head_only: bool,
    /// The path, without what follows `?`.
    path: String,
    /// The value of `Range`.
    range: Option<String>,
}

/// Takes a request's head apart; `None` if more of it is to come.
fn understood(head: &[u8]) -> std::result::Result<Option<Asked>, Status> {
    let mut lines = [httparse::EMPTY_HEADER; LINES];
    let mut request = httparse::Request::new(&mut lines);
    match request.parse(head) {
        Ok(httparse::Status::Complete(_)) => {}
        Ok(httparse::Status::Partial) if head.len() < HEAD => return Ok(None),
        Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => return Err(Status::TooLong),
        Err(_) => return Err(Status::BadRequest),
    }
    let of = |name: &str| -> Vec<&[u8]> {
        let lines = request.headers.iter().filter(|line| line.name.eq_ignore_ascii_case(name));
        lines.map(|line| line.value).collect()
    };
    let hosts = of("host");
    match hosts[..] {
        [host] if is_this_machine(host) => {}
        [_] => return Err(Status::Forbidden),
        _ => return Err(Status::BadRequest),
    }
    let head_only = match request.method {
        Some("GET") => false,
        Some("HEAD") => true,
        _ => return Err(Status::NotAllowed),
    };
    let path = request.path.unwrap_or_default().split('?').next().unwrap_or_default();
    if !path.starts_with('/') {
        return Err(Status::BadRequest);
    }
    let range = of("range").first().and_then(|value| Some(std::str::from_utf8(value).ok()?.to_owned()));
    Ok(Some(Asked { head_only, path: path.to_owned(), range }))
}

/// Whether a `Host` is a name of this machine for itself. The port is another one at a tunnel's other end.
fn is_this_machine(host: &[u8]) -> bool {
    let Ok(host) = std::str::from_utf8(host) else { return false };
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !port.ends_with(']') => (name, port),
        _ => (host, ""),
    };
    let named = ["127.0.0.1", "localhost", "[::1]"].iter().any(|own| name.eq_ignore_ascii_case(own));
    named && port.bytes().all(|digit| digit.is_ascii_digit())
}

/// The bytes of `length` that a range asks for: all, if it is none of one part in bytes.
fn part_of(range: Option<&str>, length: u64) -> std::result::Result<Option<[u64; 2]>, Status> {
    let asked = range.and_then(|range| range.trim().strip_prefix("bytes=")?.split_once('-'));
    let Some((first, last)) = asked.filter(|(_, last)| !last.contains(',')) else { return Ok(None) };
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let [first, end] = match (number(first), number(last)) {
        (Some(first), Some(last)) if first <= last => [first, last.saturating_add(1).min(length)],
        (Some(first), None) if last.trim().is_empty() => [first, length],
        (None, Some(count)) if first.trim().is_empty() && count > 0 => [length.saturating_sub(count), length],
        _ => return Ok(None),
    };
    if first < length { Ok(Some([first, end])) } else { Err(Status::NotThere) }
}

/// Reads one request, and answers it.
fn answer(stream: &TcpStream, site: &Site) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let asked = match heard(stream)? {
        Ok(asked) => asked,
        Err(status) => return refuse(stream, status),
    };
    if asked.path == "/" {
        let mut out = Sending::new(stream, site.page.len() as u64);
        out.head(Status::Ok, "text/html; charset=utf-8", site.page.len() as u64, "")?;
        return if asked.head_only { Ok(()) } else { out.put(site.page.as_bytes()) };
    }
    let (mut file, kind) = match site.file(&asked.path) {
        Ok(found) => found,
        Err(status) => return refuse(stream, status),
    };
    let length = file.metadata()?.len();
    let (status, [first, end], range) = match part_of(asked.range.as_deref(), length) {
        Ok(None) => (Status::Ok, [0, length], String::new()),
        Ok(Some([first, end])) => {
            (Status::Partial, [first, end], format!("Content-Range: bytes {first}-{}/{length}\r\n", end - 1))
        }
        Err(status) => return refuse(stream, status),
    };
    let mut out = Sending::new(stream, end - first);
    out.head(status, kind, end - first, &format!("Accept-Ranges: bytes\r\n{range}"))?;
    if asked.head_only {
        return Ok(());
    }
    file.seek(SeekFrom::Start(first))?;
    let mut rest = file.take(end - first);
    let mut piece = vec![0; PIECE];
    loop {
        match rest.read(&mut piece)? {
            0 => return Ok(()),
            read => out.put(&piece[..read])?,
        }
    }
}

/// Waits for a request's head, no longer than it may take.
fn heard(stream: &TcpStream) -> io::Result<std::result::Result<Asked, Status>> {
    let until = Instant::now() + PATIENCE;
    let mut head = Vec::with_capacity(1 << 10);
    let mut piece = [0; 1 << 10];
    loop {
        stream.set_read_timeout(Some(left(until)?))?;
        let room = piece.len().min(HEAD - head.len());
        let read = (&*stream).read(&mut piece[..room])?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        head.extend_from_slice(&piece[..read]);
        match understood(&head) {
            Ok(None) => {}
            Ok(Some(asked)) => return Ok(Ok(asked)),
            Err(status) => return Ok(Err(status)),
        }
    }
}

/// The time that is left.
fn left(until: Instant) -> io::Result<Duration> {
    let left = until.saturating_duration_since(Instant::now());
    if left.is_zero() { Err(io::ErrorKind::TimedOut.into()) } else { Ok(left) }
}

/// Tells what is wrong.
fn refuse(stream: &TcpStream, status: Status) -> io::Result<()> {
    let words = format!("{}\n", status.words());
    let mut out = Sending::new(stream, words.len() as u64);
    let allow = if status == Status::NotAllowed { "Allow: GET, HEAD\r\n" } else { "" };
    out.head(status, "text/plain; charset=utf-8", words.len() as u64, allow)?;
    out.put(words.as_bytes())?;
    // What still comes is read, a little of it: a connection that is closed over unread bytes is cut off, and the answer with it.
    stream.shutdown(Shutdown::Write)?;
    stream.set_read_timeout(Some(Duration::from_millis(200)))?;
    let mut piece = [0; 1 << 10];
    for _ in 0..64 {
        if (&*stream).read(&mut piece)? == 0 {
            break;
        }
    }
    Ok(())
}

/// An answer on its way, which must be taken in time.
struct Sending<'a> {
    stream: &'a TcpStream,
    until: Instant,
}

impl Sending<'_> {
    fn new(stream: &TcpStream, bytes: u64) -> Sending<'_> {
        Sending { stream, until: Instant::now() + PATIENCE + Duration::from_secs(bytes / LEAST_RATE) }
    }

    fn head(&mut self, status: Status, kind: &str, length: u64, more: &str) -> io::Result<()> {
        let head = format!(
            "HTTP/1.1 {}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n{more}Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
             Cross-Origin-Resource-Policy: same-origin\r\nContent-Security-Policy: {POLICY}\r\nConnection: close\r\n\r\n",
            status.words()
        );
        self.put(head.as_bytes())
    }

    fn put(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            self.stream.set_write_timeout(Some(left(self.until)?))?;
            match self.stream.write(bytes)? {
                0 => return Err(io::ErrorKind::WriteZero.into()),
                written => bytes = &bytes[written..],
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn site(dir: &Path) -> Site {
        std::fs::create_dir_all(dir.join("city/near")).unwrap();
        std::fs::create_dir(dir.join("city/deep.glb")).unwrap();
        for name in [
            "secret.glb",
            "city/0-0.glb",
            "city/tileset.json",
            "city/near/1 ö.GLB",
            "city/notes.txt",
            "city/.hidden.glb",
        ] {
            std::fs::write(dir.join(name), name).unwrap();
        }
        Site::new(String::new(), &dir.join("city")).unwrap()
    }

    #[test]
    fn what_lies_in_the_folder_is_found_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let site = site(dir.path());
        for name in ["/0-0.glb", "/tileset.json", "/%30-0.glb", "/near/1%20%C3%B6.GLB"] {
            assert!(site.file(name).is_ok(), "{name}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(dir.path().join("secret.glb"), dir.path().join("city/link.glb")).unwrap();
            std::os::unix::fs::symlink(dir.path(), dir.path().join("city/up")).unwrap();
            std::os::unix::fs::symlink("0-0.glb", dir.path().join("city/own.glb")).unwrap();
            std::os::unix::fs::symlink("notes.txt", dir.path().join("city/text.glb")).unwrap();
            assert!(site.file("/own.glb").is_ok());
            assert!(["/link.glb", "/up/secret.glb", "/text.glb"].iter().all(|name| site.file(name).is_err()));
        }
        let absolute = dir.path().join("secret.glb").display().to_string();
        for name in [
            "/../secret.glb",
            "/%2e%2e/secret.glb",
            "/..%2fsecret.glb",
            "/..%2Fsecret.glb",
            "/%2e%2e%2fsecret.glb",
            "/near/../../secret.glb",
            "//secret.glb",
            "/./0-0.glb",
            "/notes.txt",
            "/deep.glb",
            "/near",
            "/near/",
            "/",
            "",
            "0-0.glb",
            "/..\\secret.glb",
            "/..%5csecret.glb",
            "/0-0.glb%00",
            "/%00.glb",
            "/%ff.glb",
            "/.hidden.glb",
            "/C:/secret.glb",
            "/0-0.glb::$DATA",
            "/%252e%252e/secret.glb",
            "/city/0-0.glb",
            &absolute,
            &format!("/{absolute}"),
            &absolute.replace('/', "%2f"),
        ] {
            assert!(site.file(name).is_err(), "{name}");
        }
    }

    #[test]
    fn only_names_of_this_machine_are_answered_to() {
        for host in ["127.0.0.1", "127.0.0.1:8000", "localhost:1", "LOCALHOST", "[::1]:8000", "[::1]"] {
            assert!(is_this_machine(host.as_bytes()), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "127.0.0.1.evil.example:8000",
            "localhost.evil.example",
            "127.0.0.1:80@evil",
            "10.0.0.1",
            "::1",
            "localhost:a",
        ] {
            assert!(!is_this_machine(host.as_bytes()), "{host}");
        }
        let asked = |head: &str| understood(head.as_bytes());
        assert_eq!(asked("GET / HTTP/1.1\r\nHost: evil\r\n\r\n"), Err(Status::Forbidden));
        assert_eq!(asked("GET / HTTP/1.1\r\n\r\n"), Err(Status::BadRequest));
        assert_eq!(asked("GET / HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n"), Err(Status::BadRequest));
        assert_eq!(asked("PUT / HTTP/1.1\r\nHost: localhost\r\n\r\n"), Err(Status::NotAllowed));
        assert_eq!(asked("GET http://localhost/ HTTP/1.1\r\nHost: localhost\r\n\r\n"), Err(Status::BadRequest));
        assert_eq!(asked("GET / HTTP/1.1\r\nHost: loc"), Ok(None));
        let whole = asked("HEAD /a.glb?x=1 HTTP/1.1\r\nhost: localhost:9\r\nRange: bytes=1-\r\n\r\n").unwrap().unwrap();
        assert_eq!(whole, Asked { head_only: true, path: "/a.glb".into(), range: Some("bytes=1-".into()) });
    }

    #[test]
    fn a_range_is_a_part_or_nothing() {
        let part = |range| part_of(Some(range), 10);
        assert_eq!(part("bytes=2-4"), Ok(Some([2, 5])));
        assert_eq!(part("bytes=2-"), Ok(Some([2, 10])));
        assert_eq!(part("bytes=-3"), Ok(Some([7, 10])));
        assert_eq!(part("bytes=-30"), Ok(Some([0, 10])));
        assert_eq!(part("bytes=2-18446744073709551615"), Ok(Some([2, 10])));
        assert_eq!(part("bytes=10-"), Err(Status::NotThere));
        for whole in ["bytes=4-2", "bytes=1-2,4-5", "bytes=x-", "lines=1-2", "bytes=-", "bytes=-0"] {
            assert_eq!(part(whole), Ok(None), "{whole}");
        }
        assert_eq!(part_of(None, 10), Ok(None));
    }

    #[test]
    fn only_this_machine_is_listened_to() {
        assert_eq!(Server::new(0).unwrap().address.ip(), Ipv4Addr::LOCALHOST);
    }
}
