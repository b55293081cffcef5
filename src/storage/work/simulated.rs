//! A store in memory, for tests: it fails at any operation, and comes back as after a kill or a power cut.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Mutex};

use super::store::{Store, StoredFile};

/// How a run ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Crash {
    /// The process is killed: what it wrote is the system's.
    Kill,
    /// The power is cut: what was not synced is there, torn, or gone, as chance (of this seed) has it.
    PowerCut(u64),
}

/// What fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// From this operation on, nothing works any more, as if the process had ended; of the write under way, a part is written.
    CrashAt(u64),
    /// This operation fails with an error of the disk; later ones work.
    BrokenAt(u64),
    /// From this operation on, nothing can be written, as the disk is full.
    FullFrom(u64),
}

/// A store in memory. Clones are the same store.
#[derive(Debug, Clone, Default)]
pub struct Simulated(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    names: BTreeMap<String, Arc<Mutex<Content>>>,
    /// The names that are durable.
    durable: BTreeMap<String, Arc<Mutex<Content>>>,
    operations: u64,
    fault: Option<Fault>,
}

#[derive(Debug, Default)]
struct Content {
    bytes: Vec<u8>,
    /// What is durable.
    synced: Vec<u8>,
}

#[derive(Debug)]
struct OpenFile {
    store: Simulated,
    content: Arc<Mutex<Content>>,
}

/// What becomes of an operation.
enum Outcome {
    Done,
    /// A write is done in part, and then it fails.
    Torn(io::Error),
    Failed(io::Error),
}

impl Simulated {
    /// Operations so far.
    pub fn operations(&self) -> u64 {
        self.state().operations
    }

    /// Has it fail.
    pub fn plant(&self, fault: Fault) {
        self.state().fault = Some(fault);
    }

    /// The store as the next run finds it.
    pub fn after(&self, crash: Crash) -> Simulated {
        let state = self.state();
        let mut chance = match crash {
            Crash::Kill => 0,
            Crash::PowerCut(seed) => seed | 1,
        };
        let mut roll = |of: u64| {
            chance = chance.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (chance >> 33) % of
        };
        let mut names = BTreeMap::new();
        let all: BTreeMap<&String, &Arc<Mutex<Content>>> = state.durable.iter().chain(&state.names).collect();
        // Two names of one file stay that.
        let mut files: Vec<(*const Mutex<Content>, Arc<Mutex<Content>>)> = Vec::new();
        for (name, content) in all {
            let stays = match crash {
                Crash::Kill => state.names.contains_key(name),
                // A change of names that was not synced has happened, or it has not.
                Crash::PowerCut(_) => {
                    let durable = state.durable.contains_key(name);
                    if durable == state.names.contains_key(name) { true } else { roll(2) == 0 }
                }
            };
            if !stays {
                continue;
            }
            let known =
                files.iter().find(|(file, _)| *file == Arc::as_ptr(content)).map(|(_, known)| Arc::clone(known));
            let file = known.unwrap_or_else(|| {
                let content = content.lock().unwrap();
                let bytes = match crash {
                    Crash::Kill => content.bytes.clone(),
                    Crash::PowerCut(_) => torn(&content, &mut roll),
                };
                Arc::new(Mutex::new(Content { synced: bytes.clone(), bytes }))
            });
            files.push((Arc::as_ptr(content), Arc::clone(&file)));
            names.insert(name.clone(), file);
        }
        Simulated(Arc::new(Mutex::new(State { durable: names.clone(), names, operations: 0, fault: None })))
    }

    /// Changes a bit of a file.
    pub fn damage(&self, name: &str, place: usize) {
        let state = self.state();
        let mut content = state.names[name].lock().unwrap();
        let place = place % content.bytes.len();
        content.bytes[place] ^= 4;
    }

    /// The names of all files, with their lengths.
    pub fn files(&self) -> Vec<(String, usize)> {
        self.state().names.iter().map(|(name, content)| (name.clone(), content.lock().unwrap().bytes.len())).collect()
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.0.lock().unwrap()
    }

    fn step(&self, writes: bool) -> Outcome {
        let mut state = self.state();
        let number = state.operations;
        state.operations += 1;
        match state.fault {
            Some(Fault::CrashAt(at)) if number == at => Outcome::Torn(io::Error::other("the process has ended")),
            Some(Fault::CrashAt(at)) if number > at => Outcome::Failed(io::Error::other("the process has ended")),
            Some(Fault::BrokenAt(at)) if number == at => Outcome::Torn(io::Error::other("the disk is broken")),
            Some(Fault::FullFrom(at)) if number >= at && writes => Outcome::Torn(io::ErrorKind::StorageFull.into()),
            _ => Outcome::Done,
        }
    }

    fn done(&self, writes: bool) -> io::Result<()> {
        match self.step(writes) {
            Outcome::Done => Ok(()),
            Outcome::Torn(error) | Outcome::Failed(error) => Err(error),
        }
    }
}

/// What a power cut leaves of a file: what was synced, with any of the pages that were written since.
fn torn(content: &Content, roll: &mut impl FnMut(u64) -> u64) -> Vec<u8> {
    const PAGE: usize = 512;
    let mut bytes = content.synced.clone();
    if content.bytes == content.synced {
        return bytes;
    }
    // The length is a change of its own.
    if roll(2) == 0 {
        bytes.resize(content.bytes.len(), 0);
    }
    for (number, page) in content.bytes.chunks(PAGE).enumerate() {
        let at = number * PAGE;
        if at < bytes.len() && roll(2) == 0 {
            let here = page.len().min(bytes.len() - at);
            bytes[at..at + here].copy_from_slice(&page[..here]);
        }
    }
    bytes
}

impl Store for Simulated {
    fn create(&self, name: &str) -> io::Result<Arc<dyn StoredFile>> {
        self.done(true)?;
        let mut state = self.state();
        if state.names.contains_key(name) {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        let content = Arc::default();
        state.names.insert(name.to_owned(), Arc::clone(&content));
        Ok(Arc::new(OpenFile { store: self.clone(), content }))
    }

    fn open(&self, name: &str) -> io::Result<Arc<dyn StoredFile>> {
        self.done(false)?;
        match self.state().names.get(name) {
            Some(content) => Ok(Arc::new(OpenFile { store: self.clone(), content: Arc::clone(content) })),
            None => Err(io::ErrorKind::NotFound.into()),
        }
    }

    fn link(&self, name: &str, second: &str) -> io::Result<()> {
        self.done(true)?;
        let mut state = self.state();
        if state.names.contains_key(second) {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        let content = state.names.get(name).cloned().ok_or(io::ErrorKind::NotFound)?;
        state.names.insert(second.to_owned(), content);
        Ok(())
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        self.done(false)?;
        self.state().names.remove(name).map(drop).ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    fn list(&self, folder: &str) -> io::Result<Vec<String>> {
        self.done(false)?;
        let state = self.state();
        let names = state.names.keys().filter_map(|name| name.strip_prefix(folder)?.strip_prefix('/'));
        Ok(names.map(str::to_owned).collect())
    }

    fn sync_names(&self, folder: &str) -> io::Result<()> {
        self.done(false)?;
        let mut state = self.state();
        let within = |name: &String| name.rsplit_once('/').map_or("", |(folder, _)| folder) == folder;
        let State { names, durable, .. } = &mut *state;
        durable.retain(|name, _| !within(name));
        durable
            .extend(names.iter().filter(|(name, _)| within(name)).map(|(name, file)| (name.clone(), Arc::clone(file))));
        Ok(())
    }
}

impl StoredFile for OpenFile {
    fn write_at(&self, bytes: &[u8], at: u64) -> io::Result<()> {
        let (bytes, outcome) = match self.store.step(true) {
            Outcome::Done => (bytes, Ok(())),
            Outcome::Torn(error) => (&bytes[..bytes.len() / 2], Err(error)),
            Outcome::Failed(error) => return Err(error),
        };
        let mut content = self.content.lock().unwrap();
        let end = at as usize + bytes.len();
        if content.bytes.len() < end {
            content.bytes.resize(end, 0);
        }
        content.bytes[at as usize..end].copy_from_slice(bytes);
        outcome
    }

    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        self.store.done(false)?;
        let content = self.content.lock().unwrap();
        let there = content.bytes.get(at as usize..at as usize + out.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
        out.copy_from_slice(there);
        Ok(())
    }

    fn length(&self) -> io::Result<u64> {
        self.store.done(false)?;
        Ok(self.content.lock().unwrap().bytes.len() as u64)
    }

    fn cut(&self, length: u64) -> io::Result<()> {
        self.store.done(true)?;
        self.content.lock().unwrap().bytes.resize(length as usize, 0);
        Ok(())
    }

    fn sync(&self) -> io::Result<()> {
        self.store.done(false)?;
        let mut content = self.content.lock().unwrap();
        content.synced = content.bytes.clone();
        Ok(())
    }

    fn will_need(&self, _: u64, _: u64) {}
}
