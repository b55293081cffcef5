//! Where the files of a work folder lie: the few operations that a run which goes on after a kill rests on.
//!
//! A file is *durable* once it was synced and the folder that holds its name was, too: before that, a power cut may take bytes or the name. [`Folder`] is a folder of
//! the file system; tests have a store in memory that fails at any operation.

use std::fmt;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::system::{self, EntryKind, FileAt, folder};

/// Files by name, in folders of one level: `job.json`, `data/buckets.3f2a91c4`.
pub trait Store: fmt::Debug + Send + Sync {
    /// Creates a file, to read and write.
    ///
    /// # Errors
    /// `AlreadyExists`, and what the system says.
    fn create(&self, name: &str) -> io::Result<Arc<dyn StoredFile>>;

    /// Opens a file, to read and write.
    ///
    /// # Errors
    /// `NotFound`, and what the system says.
    fn open(&self, name: &str) -> io::Result<Arc<dyn StoredFile>>;

    /// Gives a file a second name, unless another has it.
    ///
    /// # Errors
    /// `AlreadyExists`, and what the system says.
    fn link(&self, name: &str, second: &str) -> io::Result<()>;

    /// Takes a name away.
    ///
    /// # Errors
    /// `NotFound`, and what the system says.
    fn remove(&self, name: &str) -> io::Result<()>;

    /// The names of the files in a folder, in order.
    ///
    /// # Errors
    /// What the system says.
    fn list(&self, folder: &str) -> io::Result<Vec<String>>;

    /// Makes the names in a folder durable.
    ///
    /// # Errors
    /// What the system says.
    fn sync_names(&self, folder: &str) -> io::Result<()>;

    /// Whether nobody else sees a file's bytes before they are synced.
    fn is_here_until_synced(&self) -> bool {
        false
    }
}

/// An open file.
pub trait StoredFile: fmt::Debug + Send + Sync {
    /// Writes all bytes at a position.
    ///
    /// # Errors
    /// What the system says.
    fn write_at(&self, bytes: &[u8], at: u64) -> io::Result<()>;

    /// Fills `out` from a position.
    ///
    /// # Errors
    /// `UnexpectedEof`, and what the system says.
    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<()>;

    /// Its length in bytes.
    ///
    /// # Errors
    /// What the system says.
    fn length(&self) -> io::Result<u64>;

    /// Cuts it to a length.
    ///
    /// # Errors
    /// What the system says.
    fn cut(&self, length: u64) -> io::Result<()>;

    /// Makes its bytes durable.
    ///
    /// # Errors
    /// What the system says.
    fn sync(&self) -> io::Result<()>;

    /// Says that a stretch is going to be read.
    fn will_need(&self, at: u64, bytes: u64);
}

/// A store that is a folder.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
}

impl Folder {
    /// The folder at `path`, which is there, with its folders `names`, which are made if they are missing.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(path: &Path, names: &[&str]) -> io::Result<Folder> {
        for name in names {
            fs::create_dir_all(path.join(name))?;
        }
        Ok(Folder { path: path.to_path_buf() })
    }
}

impl Store for Folder {
    fn create(&self, name: &str) -> io::Result<Arc<dyn StoredFile>> {
        Ok(Arc::new(File::options().read(true).write(true).create_new(true).open(self.path.join(name))?))
    }

    fn open(&self, name: &str) -> io::Result<Arc<dyn StoredFile>> {
        Ok(Arc::new(File::options().read(true).write(true).open(self.path.join(name))?))
    }

    fn link(&self, name: &str, second: &str) -> io::Result<()> {
        let [name, second] = [name, second].map(|name| self.path.join(name));
        match fs::hard_link(&name, &second) {
            // Some file systems have one name for a file.
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => system::rename_new(&name, &second),
            done => done,
        }
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        fs::remove_file(self.path.join(name))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<String>> {
        let files = folder::entries(&self.path.join(folder))?.into_iter().filter(|entry| entry.kind == EntryKind::File);
        let mut names: Vec<String> = files.filter_map(|entry| entry.name.into_string().ok()).collect();
        names.sort_unstable();
        Ok(names)
    }

    fn sync_names(&self, folder: &str) -> io::Result<()> {
        system::sync_names(&self.path.join(folder))
    }
}

impl StoredFile for File {
    fn write_at(&self, bytes: &[u8], at: u64) -> io::Result<()> {
        self.write_all_at(bytes, at)
    }

    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        self.read_exact_at(out, at)
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn cut(&self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }

    fn sync(&self) -> io::Result<()> {
        self.sync_data()
    }

    fn will_need(&self, at: u64, bytes: u64) {
        system::will_need(self, at, bytes);
    }
}

/// A file of a work folder, with its name.
#[derive(Debug, Clone)]
pub struct NamedFile {
    /// The file.
    pub file: Arc<dyn StoredFile>,
    /// Its name in the store.
    pub name: Arc<str>,
}
