//! The work folder: what a run has finished lies there, so that the same command given again goes on where the run was ended.
//!
//! ```text
//!  city.work/
//!    job.json               what decides the bytes of the mesh; made once, never changed
//!    lock                   locked while a run is at work; tells which
//!    done/buckets.json      the manifest of a finished phase: it names files of `data/`, with lengths and checksums
//!    done/cells.json
//!    done/surface.json      names the files that the surface is written to, and the journal
//!    data/buckets.3f2a91c4  written once, under a name with the number of the attempt
//!    data/journal.3f2a91c4  a line for each place where stitching can begin again
//! ```
//!
//! A phase is done when its manifest has its name, and the manifest gets it last: bytes are made durable, then the name of the file, then the manifest's bytes, then its name. What no manifest
//! names is nothing, and goes when the next run opens the folder. A manifest is never written over; one whose files are damaged is set aside under the ending `.bad`.

pub mod committer;
mod ending;
pub mod journal;
pub mod log;
pub mod objects;
mod sealed;
pub mod sections;
#[cfg(any(test, feature = "internals"))]
pub mod simulated;
pub mod store;

use std::collections::BTreeSet;
use std::fs::{File, Metadata};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use self::committer::Committer;
pub use self::sealed::Difference;
use self::sealed::{Sealed, difference};
use self::store::{Folder, NamedFile, Store};
use crate::error::{Error, Result};
use crate::resources::workers::Workers;
use crate::storage::spool::Extent;
use crate::system::{self, Lock, folder};

/// The format of the folder: another number is another format.
const FORMAT: u64 = 1;

/// The folder of manifests, and that of what they name.
pub(crate) const DONE: &str = "done";
pub(crate) const DATA: &str = "data";

/// Bytes that are compared with their checksum at a time.
const PIECE: u64 = 1 << 20;

/// The folder of claims of tasks.
const CLAIMS: &str = "claims";

/// How often a phase that is under way says how far it is.
const INTERVAL: Duration = Duration::from_secs(10);

/// The file that is locked.
const LOCK: &str = "lock";

/// The job's file.
const JOB: &str = "job.json";

/// A work folder, held by this run alone.
#[derive(Debug)]
pub struct WorkFolder {
    store: Arc<dyn Store>,
    /// For messages.
    path: PathBuf,
    /// Part of the names of this run's files; of a folder that several processes share, each file has a number of its own.
    attempt: Option<u32>,
    committer: Committer,
    /// How often a phase that is under way says how far it is.
    interval: Duration,
    /// Holds the lock, where the store is a folder.
    lock: Option<File>,
}

/// A task that is claimed, until this is dropped or the process ends.
#[derive(Debug)]
pub struct Claim {
    /// None where nothing can be locked.
    _file: Option<File>,
}

/// A phase that is finished: files, and what else there is to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Names of files in the store.
    pub files: Vec<String>,
    /// The rest, as the phase has it.
    pub rest: Value,
}

/// The most bytes of a manifest or of the job's file: larger ones are damaged.
const MOST: u64 = 64 << 20;

impl WorkFolder {
    /// The folder at `path`, which is made if there is none, for this process alone. The folder that it is to lie in must be there.
    ///
    /// # Errors
    /// [`Error::WorkTaken`] if another run is at work there; [`Error::Usage`] if something else lies there; [`Error::Io`].
    pub fn open(path: &Path) -> Result<WorkFolder> {
        if path.metadata().is_ok_and(|there| !there.is_dir()) {
            return Err(Error::Usage(format!("{}: is no folder; choose another `work`", path.display())));
        }
        let ours = path.join(JOB).exists() || path.join(LOCK).exists();
        let used = folder::entries(path).is_ok_and(|entries| !entries.is_empty());
        if used && !ours {
            let message = "holds other files, but no run's; choose another `work`, or an empty folder";
            return Err(Error::Usage(format!("{}: {message}", path.display())));
        }
        let mut lock = WorkFolder::locked(path)?;
        let words = format!("process {}\n", std::process::id());
        let told = lock.set_len(0).and_then(|()| lock.rewind()).and_then(|()| lock.write_all(words.as_bytes()));
        told.map_err(Error::io(path.join(LOCK), "write"))?;
        let store = Folder::open(path, &[DONE, DATA]).map_err(Error::io(path, "create the folder"))?;
        WorkFolder::of_store(Arc::new(store), path, (Committer::beside(), INTERVAL), Some(lock))
    }

    /// The folder's lock, held by this process. The run that held it before may have removed it as this one opened it: then another has its name by now.
    fn locked(path: &Path) -> Result<File> {
        let name = path.join(LOCK);
        loop {
            match std::fs::create_dir(path) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                    return Err(Error::io(path, "create the folder")(error));
                }
                _ => {}
            }
            let mut lock = match File::options().read(true).write(true).create(true).truncate(false).open(&name) {
                // The folder went in between.
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                opened => opened.map_err(Error::io(&name, "open"))?,
            };
            if system::lock(&lock) == Lock::Taken {
                let mut holder = String::new();
                let _ = (&mut lock).take(200).read_to_string(&mut holder);
                return Err(Error::WorkTaken { path: path.to_path_buf(), holder: holder.trim().to_owned() });
            }
            let number = |there: io::Result<Metadata>| there.ok().and_then(|there| system::file_number(&name, &there));
            if number(lock.metadata()) == number(name.metadata()) {
                return Ok(lock);
            }
        }
    }

    /// For tests: what lies in a store, for this process alone; manifests are committed while the caller waits, and phases say how far they are whenever they can.
    ///
    /// # Errors
    /// [`Error::Io`].
    #[cfg(any(test, feature = "internals"))]
    pub fn in_store(store: Arc<dyn Store>) -> Result<WorkFolder> {
        WorkFolder::of_store(store, Path::new("work"), (Committer::waiting(), Duration::ZERO), None)
    }

    fn of_store(
        store: Arc<dyn Store>,
        path: &Path,
        (committer, interval): (Committer, Duration),
        lock: Option<File>,
    ) -> Result<WorkFolder> {
        let path = path.to_path_buf();
        let mut folder = WorkFolder { store, path, attempt: None, committer, interval, lock };
        folder.attempt = Some(folder.sweep()?);
        Ok(folder)
    }

    /// A folder of tasks, which lies at `path`, and which any number of processes share.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is none; [`Error::Io`].
    pub fn shared(path: &Path) -> Result<WorkFolder> {
        if !path.join(JOB).is_file() {
            return Err(WorkFolder::no_tasks(path));
        }
        let store = Folder::open(path, &[DONE, DATA, CLAIMS]).map_err(Error::io(path, "create the folder"))?;
        Ok(WorkFolder::shared_store(Arc::new(store), path))
    }

    fn no_tasks(path: &Path) -> Error {
        Error::Usage(format!("{}: is no folder of tasks; `plan` INPUT `work` DIR makes one", path.display()))
    }

    /// The same of any store; in which commits are made while the caller waits.
    pub fn shared_store(store: Arc<dyn Store>, path: &Path) -> WorkFolder {
        let (path, committer, interval) = (path.to_path_buf(), Committer::waiting(), INTERVAL);
        WorkFolder { store, path, attempt: None, committer, interval, lock: None }
    }

    /// Whether the folder is one of tasks.
    pub fn has_tasks(&self) -> Result<bool> {
        Ok(self.job()?.is_some_and(|job| !job["tasks"].is_null()))
    }

    /// What is made here, if it is known.
    ///
    /// # Errors
    /// [`Error::Usage`] if what was written down cannot be read any more; [`Error::Io`].
    pub fn job(&self) -> Result<Option<Value>> {
        let Some(bytes) = self.contents(JOB)? else { return Ok(None) };
        Sealed::open(&bytes).map(|sealed| Some(sealed["job"].clone())).ok_or_else(|| self.job_damaged())
    }

    fn job_damaged(&self) -> Error {
        let (job, folder) = (self.path.join(JOB), &self.path);
        Error::Usage(format!("{}: is damaged; remove {} to begin anew", job.display(), folder.display()))
    }

    /// Claims a task for as long as the claim is held, so that others choose another; None if another process has. It is a courtesy: a task that two processes do is
    /// done once by whoever is first, and where files cannot be locked, anybody may have any claim.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn claim(&self, phase: &str) -> Result<Option<Claim>> {
        if self.is_remote() {
            return Ok(Some(Claim { _file: None }));
        }
        let name = self.path.join(CLAIMS).join(phase);
        let file = File::options().write(true).create(true).truncate(false).open(&name);
        let file = file.map_err(Error::io(&name, "open"))?;
        match system::lock(&file) {
            Lock::Taken => Ok(None),
            Lock::Held | Lock::Unknown => Ok(Some(Claim { _file: Some(file) })),
        }
    }

    /// Takes away the manifest that names a damaged file, so that it is made again; if it was another process's, it may have done so.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn blame(&self, damaged: &Path) -> Result<()> {
        let Ok(name) = damaged.strip_prefix(&self.path) else { return Ok(()) };
        for phase in self.done()? {
            let manifest = self.manifest(&phase)?;
            if manifest.is_some_and(|manifest| manifest.files.iter().any(|file| Path::new(file) == name)) {
                self.set_aside(&phase)?;
            }
        }
        Ok(())
    }

    /// Removes the files that no manifest names, or all of them, if those are not to be `kept`. No other process may be at work here.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn clean(&self, kept: bool) -> Result<()> {
        let mut named = Vec::new();
        let done = if kept { self.done()? } else { BTreeSet::new() };
        for phase in done {
            named.extend(self.manifest(&phase)?.into_iter().flat_map(|manifest| manifest.files));
        }
        for name in self.store.list(DATA).map_err(self.failed("read the folder"))? {
            let name = format!("{DATA}/{name}");
            if !named.contains(&name) {
                if_there(self.store.remove(&name)).map_err(self.failed("remove"))?;
            }
        }
        Ok(())
    }

    /// Removes what no manifest names, and finds an attempt's number that no file has.
    fn sweep(&self) -> Result<u32> {
        let mut attempt = 0u32;
        let mut named = Vec::new();
        for name in self.store.list(DONE).map_err(self.failed("read the folder"))? {
            match name.strip_suffix(".json") {
                Some(phase) => named.extend(self.manifest(phase)?.into_iter().flat_map(|manifest| manifest.files)),
                None => self.store.remove(&format!("{DONE}/{name}")).map_err(self.failed("remove"))?,
            }
        }
        for name in self.store.list(DATA).map_err(self.failed("read the folder"))? {
            let number = name.rsplit_once('.').and_then(|(_, number)| u32::from_str_radix(number, 16).ok());
            attempt = attempt.max(number.map_or(0, |number| number.saturating_add(1)));
            let name = format!("{DATA}/{name}");
            if !named.contains(&name) {
                self.store.remove(&name).map_err(self.failed("remove"))?;
            }
        }
        Ok(attempt)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Says what is to be made here. The first run of a folder writes it down; of a later one it tells the first thing that differs.
    ///
    /// # Errors
    /// [`Error::Usage`] if what was written down cannot be read any more; [`Error::Io`].
    pub fn begin(&self, job: &Value) -> Result<Option<Difference>> {
        let job = serde_json::json!({ "format": FORMAT, "job": job });
        let Some(bytes) = self.contents(JOB)? else {
            let temporary = self.create("job")?;
            if self.attempt.is_some() {
                // Nobody else asks for it, and what rests on it is committed after it.
                let (store, bytes, failed) = (Arc::clone(&self.store), Sealed::bytes(&job), self.failed("write"));
                let commit = move |durable| name_whole(&*store, &temporary, JOB, &bytes, durable).map_err(failed);
                return self.committer.give(Box::new(commit)).map(|()| None);
            }
            match name_whole(&*self.store, &temporary, JOB, &Sealed::bytes(&job), true) {
                // Another may have been first.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                made => return made.map(|()| None).map_err(self.failed("write")),
            }
            if_there(self.store.remove(&temporary.name)).map_err(self.failed("remove"))?;
            let Some(bytes) = self.contents(JOB)? else {
                return Err(self.failed("write")(io::ErrorKind::NotFound.into()));
            };
            return self.differs(&bytes, &job);
        };
        self.differs(&bytes, &job)
    }

    /// Where what was said to be made here differs from what is to be.
    fn differs(&self, bytes: &[u8], job: &Value) -> Result<Option<Difference>> {
        // What was made here may be another job's: nothing of it counts.
        let there = Sealed::open(bytes).ok_or_else(|| self.job_damaged())?;
        let found = difference("", &there, job);
        Ok(found.map(|found| Difference { at: found.at.trim_start_matches("job.").to_owned(), ..found }))
    }

    /// A new file in `data/` for a phase of this run.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(&self, phase: &str) -> Result<NamedFile> {
        loop {
            // Random numbers from what the standard library has: no two of a few files have the same.
            let attempt = self.attempt.unwrap_or_else(|| RandomState::new().build_hasher().finish() as u32);
            let name = format!("{DATA}/{phase}.{attempt:08x}");
            match self.store.create(&name) {
                Ok(file) => return Ok(NamedFile { file, name: name.into() }),
                Err(error) if self.attempt.is_none() && error.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(self.failed("create")(error)),
            }
        }
    }

    /// A file that a manifest names.
    ///
    /// # Errors
    /// [`Error::Damaged`] if there is none.
    pub fn open_file(&self, name: &str) -> Result<NamedFile> {
        match self.store.open(name) {
            Ok(file) => Ok(NamedFile { file, name: name.into() }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Err(self.damaged(name, "it is missing")),
            Err(error) => Err(self.failed("open")(error)),
        }
    }

    /// Whether a stretch of a file, which is as long as that at least, is what was written.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Interrupted`].
    pub(crate) fn is_as_written(&self, file: &NamedFile, extent: Extent, workers: &Workers) -> Result<bool> {
        let Extent { from, to, crc } = extent;
        if file.file.length().map_err(self.failed("read"))? < to || to < from {
            return Ok(false);
        }
        let mut piece = vec![0; PIECE.min(to - from) as usize];
        let (mut hasher, mut at) = (crc32fast::Hasher::new(), from);
        while at < to {
            workers.check_cancelled()?;
            piece.truncate((to - at).min(PIECE) as usize);
            file.file.read_at(&mut piece, at).map_err(self.failed("read"))?;
            hasher.update(&piece);
            at += piece.len() as u64;
        }
        Ok(hasher.finalize() == crc)
    }

    /// A finished phase's manifest, if it is finished. A manifest that is damaged is set aside.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn manifest(&self, phase: &str) -> Result<Option<Manifest>> {
        let Some(bytes) = self.contents(&manifest_of(phase))? else { return Ok(None) };
        let manifest = Sealed::open(&bytes).and_then(|value| serde_json::from_value(value).ok());
        if manifest.is_none() {
            self.set_aside(phase)?;
        }
        Ok(manifest)
    }

    /// The phases that are finished, as far as their manifests' names tell: a hint, since a folder that others write to may be listed as it was a while ago.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn done(&self) -> Result<BTreeSet<String>> {
        let names = self.store.list(DONE).map_err(self.failed("read the folder"))?;
        Ok(names.iter().filter_map(|name| name.strip_suffix(".json")).map(str::to_owned).collect())
    }

    /// Whether a phase is finished, as far as its manifest tells.
    pub fn is_done(&self, phase: &str) -> bool {
        matches!(self.manifest(phase), Ok(Some(_)))
    }

    /// What a finished phase left, if `load` can read it. What is damaged has its manifest set aside, so that it is made again.
    ///
    /// # Errors
    /// [`Error::Damaged`], after the manifest was set aside; those of `load`.
    pub fn load<R>(&self, phase: &str, load: impl FnOnce(&Manifest) -> Result<R>) -> Result<Option<R>> {
        let Some(manifest) = self.manifest(phase)? else { return Ok(None) };
        match load(&manifest) {
            Err(error @ Error::Damaged { .. }) => {
                self.set_aside(phase)?;
                Err(error)
            }
            outcome => outcome.map(Some),
        }
    }

    /// Takes a phase's manifest away, if it has one, so that the phase is done again.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn set_aside(&self, phase: &str) -> Result<()> {
        let (name, aside) = (manifest_of(phase), format!("{DONE}/{phase}.bad"));
        let moved = if_there(self.store.remove(&aside)).and_then(|()| match self.store.link(&name, &aside) {
            // Where nothing was, nothing has to become durable.
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            linked => {
                linked.and_then(|()| if_there(self.store.remove(&name))).and_then(|()| self.store.sync_names(DONE))
            }
        });
        moved.map_err(self.failed("rename"))
    }

    /// Commits a phase: once its files are durable, it has a manifest. That is done beside the work; what fails is told by a later call.
    ///
    /// # Errors
    /// [`Error::Io`], of an earlier commit, too.
    pub fn commit(&self, phase: &str, files: Vec<NamedFile>, rest: Value) -> Result<()> {
        let manifest = Manifest { files: files.iter().map(|file| file.name.to_string()).collect(), rest };
        self.commit_with(phase, &manifest, files)
    }

    /// Commits a phase with this manifest, and files that are its own.
    fn commit_with(&self, phase: &str, manifest: &Manifest, files: Vec<NamedFile>) -> Result<()> {
        let bytes = Sealed::bytes(&serde_json::to_value(manifest).expect("a manifest can be written"));
        let temporary = self.create(&format!("manifest-{phase}"))?;
        let (store, failed) = (Arc::clone(&self.store), self.failed("write"));
        let (manifest, is_shared) = (manifest_of(phase), self.attempt.is_none());
        self.committer.give(Box::new(move |durable| {
            let durable = objects::must_sync(&*store, durable);
            let all = || -> io::Result<()> {
                if durable {
                    files.iter().try_for_each(|file| file.file.sync())?;
                    store.sync_names(DATA)?;
                }
                match name_whole(&*store, &temporary, &manifest, &bytes, durable) {
                    // Another process was first: what this one made is as good, and not needed.
                    Err(error) if is_shared && error.kind() == io::ErrorKind::AlreadyExists => {
                        let mut mine = files.iter().chain([&temporary]);
                        mine.try_for_each(|file| if_there(store.remove(&file.name)))
                    }
                    named => named,
                }
            };
            all().map_err(failed)
        }))
    }

    /// Commits a phase of which another has left what it would: its files are those of that manifest.
    ///
    /// # Errors
    /// [`Error::Io`], of an earlier commit, too.
    pub fn adopt(&self, phase: &str, manifest: &Manifest) -> Result<()> {
        self.commit_with(phase, manifest, Vec::new())
    }

    /// Takes the manifests of phases away, and the files that no other manifest names. No other process may be at work here.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn retire(&self, phases: &BTreeSet<String>) -> Result<()> {
        self.committer.settle(false)?;
        for phase in phases {
            if_there(self.store.remove(&manifest_of(phase))).map_err(self.failed("remove"))?;
        }
        self.store.sync_names(DONE).map_err(self.failed("remove"))?;
        self.clean(true)
    }

    /// Waits until all commits are made; if it has to be quick, without asking the system for what only a power cut would take.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn settle(&self, quick: bool) -> Result<()> {
        self.committer.settle(quick)
    }

    /// All of a small file, if there is one.
    fn contents(&self, name: &str) -> Result<Option<Vec<u8>>> {
        let file = match self.store.open(name) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(self.failed("open")(error)),
        };
        let read = || -> io::Result<Vec<u8>> {
            let mut bytes = vec![0; file.length()?.min(MOST) as usize];
            file.read_at(&mut bytes, 0)?;
            Ok(bytes)
        };
        read().map(Some).map_err(self.failed("read"))
    }

    /// An error of the system, of this folder.
    pub(crate) fn failed(&self, action: &'static str) -> impl FnOnce(io::Error) -> Error + use<> {
        Error::io(self.path.clone(), action)
    }

    /// An error about a damaged file.
    pub(crate) fn damaged(&self, name: &str, found: impl Into<String>) -> Error {
        Error::Damaged { path: self.path.join(name), found: found.into() }
    }

    /// How often a phase that is under way says how far it is.
    pub(crate) fn interval(&self) -> Duration {
        self.interval
    }

    pub(crate) fn committer(&self) -> &Committer {
        &self.committer
    }
}

/// The name of a phase's manifest.
fn manifest_of(phase: &str) -> String {
    format!("{DONE}/{phase}.json")
}

/// Writes a file and gives it its name, which nothing has, once it is whole.
fn name_whole(store: &dyn Store, temporary: &NamedFile, name: &str, bytes: &[u8], durable: bool) -> io::Result<()> {
    temporary.file.write_at(bytes, 0)?;
    if durable {
        temporary.file.sync()?;
    }
    store.link(&temporary.name, name)?;
    if durable {
        store.sync_names(name.rsplit_once('/').map_or("", |(folder, _)| folder))?;
    }
    if_there(store.remove(&temporary.name))
}

/// What became of a change to a name, if there is one; nothing is to be done where there is none.
fn if_there(outcome: io::Result<()>) -> io::Result<()> {
    match outcome {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        outcome => outcome,
    }
}
