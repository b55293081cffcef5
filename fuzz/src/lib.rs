//! What all targets do: a file of the given bytes is opened as a cloud and read to its end, in little memory.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::RefCell;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use asra_stream::internals::input::{Carried, Cloud, InputOptions, Opening};
use asra_stream::internals::points::Batch;
use asra_stream::internals::storage::spool::Workspace;

/// The most memory that reading may take, whatever a file claims.
const LIMIT: usize = 64 << 20;

/// The budget that opening is told.
const BUDGET: u64 = 32 << 20;

/// Counts what is allocated, and ends the process where that is more than the limit: a finding like a panic.
struct Counted;

static ALLOCATED: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is passed on to the system's allocator as it comes.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if ALLOCATED.fetch_add(layout.size(), Ordering::Relaxed) + layout.size() > LIMIT {
            std::process::abort();
        }
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        ALLOCATED.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

/// A folder of the process's own, in memory where the system has that.
struct Place {
    folder: tempfile::TempDir,
    workspace: Workspace,
}

thread_local! {
    static PLACE: RefCell<Option<Place>> = const { RefCell::new(None) };
}

/// Reads a cloud of the files, each a name and its content; the first one is opened.
pub fn read(files: &[(&str, &[u8])]) {
    PLACE.with_borrow_mut(|place| {
        let Place { folder, workspace } = place.get_or_insert_with(|| {
            let memory = PathBuf::from("/dev/shm");
            let parent = if memory.is_dir() { memory } else { std::env::temp_dir() };
            let folder = tempfile::tempdir_in(parent).expect("a temporary folder");
            let workspace = Workspace::new(folder.path()).expect("a temporary file");
            Place { folder, workspace }
        });
        for (name, content) in files {
            std::fs::write(folder.path().join(name), content).expect("a temporary file");
        }
        let opening = Opening { workspace, memory: BUDGET, decompress: None, watch: &mut |_| Ok(()) };
        let path = folder.path().join(files[0].0);
        // An error is an answer, too.
        let Ok(cloud) = Cloud::open_in(&[path], &InputOptions::default(), opening) else { return };
        let mut blocks = cloud.blocks(Carried::Attributes);
        let mut batch = Batch::new(cloud.precision());
        while let Ok(Some(block)) = blocks.next_block() {
            if block.decode(&mut batch).is_err() {
                return;
            }
            assert_eq!(batch.attributes.len(), batch.points.len() * cloud.schema().stride());
        }
    });
}
