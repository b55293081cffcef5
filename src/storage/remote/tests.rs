use std::path::Path;
use std::sync::Arc;

use object_store::memory::InMemory;
use proptest::prelude::*;

use super::*;
use crate::storage::atomic_file::{AtomicFile, Overwrite};
use crate::storage::work::WorkFolder;
use crate::storage::work::store::{Folder, NamedFile, Store};

/// A store in memory by an address of its own.
fn bucket(name: &str) -> String {
    let root = format!("memory://{name}");
    client::in_memory(&root, Arc::new(InMemory::new()));
    root
}

fn written(path: &str, bytes: &[u8], put: Put) -> io::Result<()> {
    Place::of(Path::new(path)).unwrap().put(bytes, put)
}

/// What a folder of tasks rests on: the same of a folder of the file system and of objects.
#[test]
fn objects_keep_what_folders_keep() {
    let dir = tempfile::tempdir().unwrap();
    let local = dir.path().join("local");
    std::fs::create_dir(&local).unwrap();
    let root = format!("{}/work", bucket("contract"));
    let folder = || -> Arc<dyn Store> { Arc::new(Folder::open(&dir.path().join("work"), &["data", "done"]).unwrap()) };
    std::fs::create_dir(dir.path().join("work")).unwrap();
    let objects = || store(Path::new(&root), &local).unwrap();
    let kinds: [&dyn Fn() -> Arc<dyn Store>; 2] = [&folder, &objects];
    for open in kinds {
        let (store, other) = (open(), open());
        let bytes: Vec<u8> = (0..3_000_000u32).map(|i| (i * 7 % 251) as u8).collect();
        let file = store.create("data/a.1").unwrap();
        assert_eq!(store.create("data/a.1").unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        file.write_at(&bytes[1000..], 1000).unwrap();
        file.write_at(&bytes[..1000], 0).unwrap();
        file.sync().unwrap();
        let opened = other.open("data/a.1").unwrap();
        assert_eq!(opened.length().unwrap(), bytes.len() as u64);
        for (at, length) in [(0, 1), (2_999_999, 1), (1_000_000, 900_000), (5, 0), (0, bytes.len())] {
            let mut out = vec![0; length];
            opened.read_at(&mut out, at as u64).unwrap();
            assert!(out == bytes[at..at + length], "{length} bytes at {at}");
        }
        let behind = opened.read_at(&mut [0; 2], 2_999_999).unwrap_err();
        assert_eq!(behind.kind(), io::ErrorKind::UnexpectedEof);
        let empty = store.create("data/empty.1").unwrap();
        empty.sync().unwrap();
        assert_eq!(other.open("data/empty.1").unwrap().length().unwrap(), 0);

        let small = store.create("data/m.1").unwrap();
        small.write_at(b"one", 0).unwrap();
        small.sync().unwrap();
        store.link("data/m.1", "done/a.json").unwrap();
        let second = other.create("data/m.2").unwrap();
        second.write_at(b"two", 0).unwrap();
        second.sync().unwrap();
        assert_eq!(other.link("data/m.2", "done/a.json").unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        let mut out = [0; 3];
        other.open("done/a.json").unwrap().read_at(&mut out, 0).unwrap();
        assert_eq!(&out, b"one");
        assert_eq!(other.list("done").unwrap(), ["a.json"]);
        assert_eq!(other.list("data").unwrap(), ["a.1", "empty.1", "m.1", "m.2"]);
        store.remove("data/m.1").unwrap();
        assert_eq!(store.list("data").unwrap(), ["a.1", "empty.1", "m.2"]);
        assert_eq!(other.open("data/m.1").unwrap_err().kind(), io::ErrorKind::NotFound);
        assert_eq!(other.list("claims").unwrap_or_default(), [""; 0]);
    }
}

#[test]
fn what_is_not_synced_is_nobody_elses_and_is_linked_all_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let root = bucket("unsynced");
    let store = store(Path::new(&root), dir.path()).unwrap();
    let file = store.create("data/m.1").unwrap();
    file.write_at(b"{}", 0).unwrap();
    assert!(store.list("data").unwrap().is_empty());
    store.link("data/m.1", "done/a.json").unwrap();
    store.remove("data/m.1").unwrap();
    assert_eq!(store.list("done").unwrap(), ["a.json"]);
    drop(file);
    assert!(store.open("data/m.1").is_err());
}

/// A commit in a hurry brings files to where others see them; a second one of the same phase leaves the first as it is.
#[test]
fn commits_are_whole_for_others_and_the_first_stays() {
    let dir = tempfile::tempdir().unwrap();
    let root = format!("{}/work", bucket("commits"));
    let shared = || WorkFolder::shared_store(store(Path::new(&root), dir.path()).unwrap(), Path::new(&root));
    let committed = |value: &[u8]| {
        let work = shared();
        work.settle(true).unwrap();
        let NamedFile { file, name } = work.create("bucket-0").unwrap();
        file.write_at(value, 0).unwrap();
        work.commit("bucket-0", vec![NamedFile { file, name }], serde_json::json!(value.len())).unwrap();
    };
    committed(b"first");
    committed(b"the second");
    let work = shared();
    let manifest = work.manifest("bucket-0").unwrap().unwrap();
    assert_eq!(manifest.rest, 5);
    assert_eq!(work.open_file(&manifest.files[0]).unwrap().file.length().unwrap(), 5);
    let left = Place::of(Path::new(&root)).unwrap().below(true).unwrap();
    assert_eq!(left.len(), 2, "what the second made is gone: {left:?}");
    work.set_aside("bucket-0").unwrap();
    assert!(!work.is_done("bucket-0"));
}

#[test]
fn an_object_is_there_whole_or_not_at_all() {
    let path = format!("{}/out/city.ply", bucket("outputs"));
    let path = Path::new(&path);
    let dir = tempfile::tempdir().unwrap();
    let make = |overwrite, bytes: &[u8]| {
        let made = AtomicFile::create_with(path, overwrite, Some(dir.path()))?;
        std::io::Write::write_all(&mut made.file(), bytes).unwrap();
        Ok::<AtomicFile, Error>(made)
    };
    let length = || look(path).unwrap().map(|meta| meta.bytes);
    drop(make(Overwrite::Refuse, b"one").unwrap());
    assert_eq!(length(), None);
    // Two at once: one is first. The same bytes are no other object.
    let (first, second, same) =
        (make(Overwrite::Refuse, b"one"), make(Overwrite::Refuse, b"two"), make(Overwrite::Refuse, b"one"));
    first.unwrap().finish().unwrap();
    assert!(matches!(second.unwrap().finish(), Err(Error::OutputExists(_))));
    same.unwrap().finish().unwrap();
    assert!(matches!(make(Overwrite::Refuse, b""), Err(Error::OutputExists(_))));
    // In parts.
    let large = vec![5; 20 << 20];
    make(Overwrite::Replace, &large).unwrap().finish().unwrap();
    assert_eq!(length(), Some(20 << 20));
    remove(path).unwrap();
    let late = make(Overwrite::Refuse, &large).unwrap();
    written(path.to_str().unwrap(), b"other", Put::Create).unwrap();
    assert!(matches!(late.finish(), Err(Error::OutputExists(_))));
    assert_eq!(length(), Some(5));
    remove(path).unwrap();
    remove(path).unwrap();
}

#[test]
fn a_change_is_told() {
    let path = format!("{}/a.laz", bucket("changes"));
    let path = Path::new(&path);
    assert!(matches!(known(path), Err(Error::Io { .. })));
    written(path.to_str().unwrap(), b"12345", Put::Replace).unwrap();
    let (place, meta) = (Place::of(path).unwrap(), known(path).unwrap());
    assert_eq!(read(&place, path, 1..4, &meta).unwrap(), b"234");
    written(path.to_str().unwrap(), b"54321", Put::Replace).unwrap();
    assert!(matches!(read(&place, path, 1..4, &meta), Err(Error::Changed { .. })));
}

proptest! {
    // Each that is one makes a client.
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn no_address_makes_it_panic(text in "(s3|gs|az|https?|memory)://[ -~]{0,30}") {
        let path = Path::new(&text);
        prop_assert!(is_remote(path));
        drop(Place::of(path).map(|place| place.path()));
    }
}
