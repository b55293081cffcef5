//! How a run leaves its folder: whole, given up, or with what the next run needs.

use rayon::prelude::*;

use super::{DATA, DONE, JOB, LOCK, WorkFolder, if_there, manifest_of};
use crate::error::Result;

impl WorkFolder {
    /// Ends a run that failed: commits are made, as by [`Self::settle`]. If what is made here is not known even then, nothing stays, as by [`Self::finish`]. Returns whether a run can go on from here.
    ///
    /// # Errors
    /// [`Error::Io`], of an earlier commit, too.
    pub fn leave(&self, quick: bool, last: &str) -> Result<bool> {
        let (settled, is_known) = (self.settle(quick), !matches!(self.contents(JOB), Ok(None)));
        if is_known { Ok(()) } else { self.finish(last) }.and(settled).map(|()| is_known)
    }

    /// Ends the run: nothing of it is needed any more. The folder goes, too, if it can; the manifest of phase `last` goes when all others are gone.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(&self, last: &str) -> Result<()> {
        self.committer.settle(true)?;
        if self.is_remote() {
            // Others may be at work there, which nothing tells.
            return Ok(());
        }
        // Manifests first: what they name must be there for as long as they are.
        for folder in [DONE, DATA] {
            let names = self.store.list(folder).map_err(self.failed("read the folder"))?;
            // Side by side: of a file that is as long as the points, the system needs a good part of a second to take the name away.
            names
                .into_par_iter()
                .map(|name| format!("{folder}/{name}"))
                .filter(|name| *name != manifest_of(last))
                .try_for_each(|name| self.store.remove(&name).map_err(self.failed("remove")))?;
        }
        for name in [JOB, &manifest_of(last)] {
            if_there(self.store.remove(name)).map_err(self.failed("remove"))?;
        }
        if self.lock.is_some() {
            let folders = [self.path.join(DONE), self.path.join(DATA)];
            let _ = folders.iter().try_for_each(std::fs::remove_dir);
            let _ = std::fs::remove_file(self.path.join(LOCK)).and_then(|()| std::fs::remove_dir(&self.path));
        }
        Ok(())
    }
}
