//! What one operating system has and another has not. Everything else in the library is the same everywhere.
//!
//! | | Linux | another Unix | Windows |
//! |---|---|---|---|
//! | output in the making | has no name (`O_TMPFILE`) | has a hidden name, locked | has a hidden name |
//! | input files | are mapped, and a cut one is survived (`bus`) | the same | are read |
//! | memory of the machine | and of its control groups | physical | physical |
//! | standard input | waited for a tenth of a second at a time | the same | waited for by a thread |
//! | a stack that is used up | is an error in the data (`stack`) | the same | ends the process |
//!
//! Both sides have the same functions, `unix` and `windows`; tests run on Linux, and `tools/wine.py` runs the command for Windows under Wine.

mod answers;
#[cfg(unix)]
pub mod bus;
#[cfg(unix)]
pub mod folder;
#[cfg(unix)]
mod last_words;
#[cfg(unix)]
pub mod stack;
#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

pub use answers::{Entry, EntryKind, Farewell, Lock, Naming};
#[cfg(unix)]
pub use last_words::LastWords;
#[cfg(unix)]
pub use unix::*;
#[cfg(windows)]
pub use windows::*;

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::path::Path;

    use super::*;

    #[test]
    fn a_file_is_read_and_written_at_places() {
        let file = tempfile::tempfile().unwrap();
        file.write_all_at(b"abcdef", 3).unwrap();
        file.write_all_at(b"XY", 5).unwrap();
        let mut found = [0; 4];
        file.read_exact_at(&mut found, 4).unwrap();
        assert_eq!(&found, b"bXYe");
        assert_eq!(file.read_exact_at(&mut found, 6).unwrap_err().kind(), std::io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn the_machine_has_memory_and_a_disk() {
        assert!(physical_memory() > 1 << 24);
        let held = vec![1u8; 1 << 20];
        assert!(peak_resident().unwrap() > held.iter().map(|byte| u64::from(*byte)).sum());
        let space = space(&std::env::temp_dir()).unwrap();
        assert!(space.available <= space.capacity && space.capacity > 0);
        assert!(super::space(Path::new("no/such/folder")).is_err());
    }

    #[test]
    fn two_names_of_a_file_have_its_number_and_others_have_not() {
        let folder = tempfile::tempdir().unwrap();
        let [one, same, other] = ["one", "same", "other"].map(|name| folder.path().join(name));
        std::fs::write(&one, "").unwrap();
        std::fs::hard_link(&one, &same).unwrap();
        std::fs::write(&other, "").unwrap();
        let number = |path: &Path| file_number(path, &path.metadata().unwrap());
        assert!(number(&one).is_some());
        assert_eq!(number(&one), number(&same));
        assert_ne!(number(&one), number(&other));
    }

    #[test]
    fn names_change_places_or_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, c] = ["a", "b", "c"].map(|name| folder.path().join(name));
        std::fs::create_dir(&a).unwrap();
        std::fs::write(&b, "b").unwrap();
        match exchange(&a, &b) {
            Ok(()) => assert!(a.is_file() && b.is_dir()),
            Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::Unsupported),
        }
        let (file, directory) = if a.is_file() { (a, b) } else { (b, a) };
        assert_eq!(rename_new(&directory, &file).unwrap_err().kind(), std::io::ErrorKind::AlreadyExists);
        rename_new(&directory, &c).unwrap();
        assert!(c.is_dir() && !directory.exists());
    }

    #[test]
    fn a_lock_is_held_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("locked");
        let [first, second] = [File::create(&path).unwrap(), File::create(&path).unwrap()];
        if lock(&first) == Lock::Held {
            assert_eq!(lock(&second), Lock::Taken);
            drop(first);
            assert_eq!(lock(&second), Lock::Held);
        }
    }
}
