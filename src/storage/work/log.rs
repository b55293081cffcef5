//! A phase whose files are appended to, and a journal of how far they are whole.
//!
//! ```text
//!  file 0    |=====|=======|======|===.          an extent for each line of the journal, and what is not in it yet
//!  file 1    |=====|=======|======|===.
//!  journal   line 0  line 1  line 2               a line: the extents with their checksums, and what its reader needs
//! ```
//!
//! A run that goes on takes the last line up to which all extents have their checksums, and cuts what lies behind it.

use std::time::Instant;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::WorkFolder;
use super::journal::Journal;
use super::store::NamedFile;
use crate::error::Result;
use crate::resources::workers::Workers;
use crate::storage::spool::Extent;

/// A line of the journal.
#[derive(Debug, Serialize, Deserialize)]
struct Line<L> {
    /// What was appended since the line before, to each file.
    extents: Vec<Extent>,
    rest: L,
}

/// A phase of `N` files.
#[derive(Debug)]
pub struct Log<'a, const N: usize> {
    work: &'a WorkFolder,
    journal: Journal,
    files: [NamedFile; N],
    told: Instant,
}

/// How far an earlier run was.
#[derive(Debug)]
pub struct Reached<L, const N: usize> {
    /// The files, which end there.
    pub files: [NamedFile; N],
    /// Where.
    pub ends: [u64; N],
    /// What the last line says; none if there is no line.
    pub last: Option<L>,
}

impl<'a, const N: usize> Log<'a, N> {
    /// Begins a phase with files of these names, or goes on with it.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn open<L: DeserializeOwned>(
        work: &'a WorkFolder,
        phase: &str,
        names: [&str; N],
        workers: &Workers,
    ) -> Result<(Log<'a, N>, Reached<L, N>)> {
        let there = work.load(phase, |manifest| {
            let opened = manifest.files.iter().map(|name| work.open_file(name)).collect::<Result<Vec<_>>>()?;
            let mut files = opened.into_iter();
            let all: Vec<NamedFile> = files.by_ref().take(N).collect();
            match (all.try_into(), files.next()) {
                (Ok(files), Some(journal)) => Ok((files, journal)),
                _ => Err(work.damaged(phase, "a file is missing")),
            }
        })?;
        let (files, journal, last): ([NamedFile; N], _, Option<Line<L>>) = match there {
            Some((files, journal)) => {
                let mut good: Option<(Line<L>, u64)> = None;
                for (line, end) in Journal::lines(&journal).map_err(work.failed("read"))? {
                    let Ok(line) = serde_json::from_value::<Line<L>>(line) else { break };
                    let before = good.as_ref().map(|(line, _)| line);
                    if !is_as_written(work, &files, &line, before, workers)? {
                        break;
                    }
                    good = Some((line, end));
                }
                let end = good.as_ref().map_or(0, |(_, end)| *end);
                let journal = Journal::resumed(journal, end).map_err(work.failed("write"))?;
                (files, journal, good.map(|(line, _)| line))
            }
            None => {
                let mut files = Vec::with_capacity(N);
                for name in names {
                    files.push(work.create(&format!("{name}-{phase}"))?);
                }
                let journal = work.create(&format!("journal-{phase}"))?;
                let all = files.iter().chain([&journal]).cloned().collect();
                work.commit(phase, all, serde_json::Value::Null)?;
                let files = files.try_into().map_err(|_| crate::Error::Internal("as many files as names".into()))?;
                (files, Journal::new(journal), None)
            }
        };
        let ends = std::array::from_fn(|i| last.as_ref().map_or(0, |line| line.extents[i].to));
        for (file, end) in files.iter().zip(ends) {
            file.file.cut(end).map_err(work.failed("write"))?;
        }
        let reached = Reached { files: files.clone(), ends, last: last.map(|line| line.rest) };
        Ok((Log { work, journal, files, told: Instant::now() }, reached))
    }

    /// Whether it is time for another line.
    pub fn is_due(&self) -> bool {
        // Making the last line durable takes a while: another one would only wait.
        self.told.elapsed() >= self.work.interval() && self.work.committer().is_idle()
    }

    /// Appends a line: what was appended to each file since the line before, and the rest.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn append(&mut self, extents: [Extent; N], rest: &impl Serialize) -> Result<()> {
        self.put(extents, rest, true)
    }

    /// Appends the last line, without waiting for the disk: a power cut may take it, and what was appended since the line before, but no end of the process does. What a run
    /// does after its last line would wait, too, for bytes that go when it ends.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn end(&mut self, extents: [Extent; N], rest: &impl Serialize) -> Result<()> {
        self.put(extents, rest, false)
    }

    fn put(&mut self, extents: [Extent; N], rest: &impl Serialize, synced: bool) -> Result<()> {
        self.told = Instant::now();
        let line = Line { extents: extents.to_vec(), rest };
        let write = self.journal.line(&serde_json::to_value(line).expect("a line can be written"));
        let (files, failed) = (self.files.clone(), self.work.failed("write"));
        self.work.committer().give(Box::new(move |durable| {
            let durable = durable && synced;
            let synced = if durable { files.iter().try_for_each(|file| file.file.sync()) } else { Ok(()) };
            synced.and_then(|()| write(durable)).map_err(failed)
        }))
    }
}

/// Whether the extents of a line follow those of the line before, and are what was written.
fn is_as_written<L, const N: usize>(
    work: &WorkFolder,
    files: &[NamedFile; N],
    line: &Line<L>,
    before: Option<&Line<L>>,
    workers: &Workers,
) -> Result<bool> {
    if line.extents.len() != N {
        return Ok(false);
    }
    for (number, (file, extent)) in files.iter().zip(&line.extents).enumerate() {
        let from = before.map_or(0, |before| before.extents[number].to);
        let length = file.file.length().map_err(work.failed("read"))?;
        if extent.from != from || extent.to < from || extent.to > length {
            return Ok(false);
        }
        if !work.is_as_written(file, *extent, workers)? {
            return Ok(false);
        }
    }
    Ok(true)
}
