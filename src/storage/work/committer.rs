//! Commits, made in their order beside the work: making bytes durable takes seconds, and nobody has to wait for it.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use crossbeam_channel::Sender;

use crate::error::{Error, Result};

/// A commit. It is told whether it has to outlast a power cut; else only the end of the process.
pub type Commit = Box<dyn FnOnce(bool) -> Result<()> + Send>;

/// Commits that may wait for their turn.
const WAITING: usize = 8;

/// Makes commits, one after the other.
#[derive(Debug)]
pub struct Committer {
    /// None if the caller waits for each.
    beside: Mutex<Option<Beside>>,
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Beside {
    commits: Sender<Commit>,
    thread: JoinHandle<()>,
}

#[derive(Debug, Default)]
struct Shared {
    /// The first that failed.
    failed: Mutex<Option<Error>>,
    has_failed: AtomicBool,
    quick: AtomicBool,
    /// Commits that are not made yet.
    given: AtomicUsize,
}

impl Shared {
    fn make(&self, commit: Commit) {
        // What comes after a failed commit may rest on it.
        if self.has_failed.load(Ordering::SeqCst) {
            return;
        }
        let made = commit(!self.quick.load(Ordering::SeqCst));
        self.given.fetch_sub(1, Ordering::SeqCst);
        if let Err(error) = made {
            self.has_failed.store(true, Ordering::SeqCst);
            *self.failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
    }

    fn outcome(&self) -> Result<()> {
        match self.failed.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}

impl Committer {
    /// The caller waits for each commit.
    pub fn waiting() -> Committer {
        Committer { beside: Mutex::new(None), shared: Arc::default() }
    }

    /// Commits are made by a thread; by the caller where the system refuses one.
    pub fn beside() -> Committer {
        let shared: Arc<Shared> = Arc::default();
        let (commits, given) = crossbeam_channel::bounded::<Commit>(WAITING);
        let of_thread = Arc::clone(&shared);
        let work = move || given.into_iter().for_each(|commit| of_thread.make(commit));
        let thread = thread::Builder::new().name("asra-committer".into()).spawn(work).ok();
        let beside = thread.map(|thread| Beside { commits, thread });
        Committer { beside: Mutex::new(beside), shared }
    }

    /// Has a commit made.
    ///
    /// # Errors
    /// That of an earlier commit.
    pub fn give(&self, commit: Commit) -> Result<()> {
        self.shared.given.fetch_add(1, Ordering::SeqCst);
        match &*self.beside.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(Beside { commits, .. }) => drop(commits.send(commit)),
            None => self.shared.make(commit),
        }
        self.shared.outcome()
    }

    /// Whether no commit waits for its turn, or is being made.
    pub fn is_idle(&self) -> bool {
        self.shared.given.load(Ordering::SeqCst) == 0
    }

    /// Waits until all are made; `quick`ly without what only a power cut would take. Later ones are made by the caller.
    ///
    /// # Errors
    /// That of the first that failed.
    pub fn settle(&self, quick: bool) -> Result<()> {
        self.shared.quick.store(quick, Ordering::SeqCst);
        if let Some(Beside { commits, thread }) = self.beside.lock().unwrap_or_else(PoisonError::into_inner).take() {
            drop(commits);
            if thread.join().is_err() {
                return Err(Error::Internal("the thread that commits is gone".into()));
            }
        }
        self.shared.outcome()
    }
}

impl Drop for Committer {
    fn drop(&mut self) {
        // The folder is free for another run then.
        let _ = self.settle(true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::work::WorkFolder;

    #[test]
    fn commits_are_made_in_order_until_one_fails() {
        for committer in [Committer::waiting(), Committer::beside()] {
            let made: Arc<Mutex<Vec<(u32, bool)>>> = Arc::default();
            let commit = |number: u32| -> Commit {
                let made = Arc::clone(&made);
                Box::new(move |durable| {
                    made.lock().unwrap().push((number, durable));
                    if number == 2 { Err(Error::Usage("no".into())) } else { Ok(()) }
                })
            };
            let told: Vec<bool> = (0..5).map(|number| committer.give(commit(number)).is_err()).collect();
            let last = committer.settle(false).is_err();
            assert_eq!(told.iter().filter(|told| **told).count() + usize::from(last), 1, "the error is told once");
            assert_eq!(*made.lock().unwrap(), [(0, true), (1, true), (2, true)]);
        }
    }

    #[test]
    fn a_run_that_fails_before_its_first_commit_is_made_can_be_gone_on_from() {
        let dir = tempfile::tempdir().unwrap();
        let work = WorkFolder::open(dir.path()).unwrap();
        let (go, wait) = crossbeam_channel::bounded::<()>(0);
        let slow = move |_| wait.recv().map_err(|_| Error::Usage("nobody lets it go".into()));
        work.committer().give(Box::new(slow)).unwrap();
        work.begin(&serde_json::json!({ "k": 4 })).unwrap();
        let releasing = thread::spawn(move || {
            thread::sleep(std::time::Duration::from_millis(20));
            go.send(())
        });
        assert!(work.leave(true, "output").unwrap());
        releasing.join().unwrap().unwrap();
        drop(work);
        let work = WorkFolder::open(dir.path()).unwrap();
        assert!(work.begin(&serde_json::json!({ "k": 5 })).unwrap().is_some());
        // One of which nothing is known leaves nothing.
        let empty = dir.path().join("empty");
        assert!(!WorkFolder::open(&empty).unwrap().leave(true, "output").unwrap());
        assert!(!empty.exists());
    }

    #[test]
    fn who_is_in_a_hurry_leaves_durability_out() {
        let committer = Committer::beside();
        let (go, wait) = crossbeam_channel::bounded::<()>(0);
        committer
            .give(Box::new(move |_| {
                let _ = wait.recv();
                Ok(())
            }))
            .unwrap();
        let told: Arc<Mutex<Vec<bool>>> = Arc::default();
        let second = Arc::clone(&told);
        committer
            .give(Box::new(move |durable| {
                second.lock().unwrap().push(durable);
                Ok(())
            }))
            .unwrap();
        assert!(!committer.is_idle());
        let releasing = thread::spawn(move || {
            thread::sleep(std::time::Duration::from_millis(20));
            go.send(())
        });
        committer.settle(true).unwrap();
        releasing.join().unwrap().unwrap();
        assert_eq!(*told.lock().unwrap(), [false]);
    }
}
