//! A panic in every part of every pass of every kind of work ends it at once with [`Error::Internal`], and leaves no file behind.

use std::collections::BTreeSet;
use std::path::Path;

use crate::error::{Error, Result};
use crate::resources::workers::Workers;
use crate::run::compare;
use crate::run::generate::densify;
use crate::run::generate::{Options, Shape, generate};
use crate::run::progress::{Progress, Show};
use crate::run::{Job, Resources, run};
use crate::storage::atomic_file::Overwrite;
use crate::storage::spool::Workspace;
use crate::{format, mesh, render};

/// Runs the work with a panic in each part of each pass in turn.
fn each(folder: &Path, what: &str, mut work: impl FnMut(&Workers) -> Result<()>) {
    let names = || -> BTreeSet<_> { folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect() };
    let workers = Workers::new(2).unwrap();
    workers.plant(usize::MAX, 0);
    work(&workers).unwrap_or_else(|e| panic!("{what}: {e}"));
    let (passes, before) = (workers.passes(), names());
    assert!(passes > 0, "{what} has no pass");
    for pass in 0..passes {
        for part in 0..3 {
            workers.plant(pass, part);
            match work(&workers) {
                Err(Error::Internal(words)) => assert!(words.contains("planted"), "{words}"),
                // A pass that has nothing to do asks its source only.
                Ok(()) if part > 0 => {}
                other => panic!("{what}, pass {pass} of {passes}, part {part}: {other:?}"),
            }
            assert_eq!(names(), before, "{what}, pass {pass}, part {part}");
        }
    }
}

#[test]
#[ignore = "exhaustive"]
fn a_panic_in_any_pass_is_an_error_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let quiet = || Progress::new(Show::Nothing);
    let mut options = Options::new(Shape::Sphere, 300, path("s.bin"));
    options.overwrite = Overwrite::Replace;
    each(dir.path(), "generate", |workers| generate(&options, workers, &mut |_| ()).map(drop));

    let mut job = Job::new([path("s.bin")]);
    job.overwrite = Overwrite::Replace;
    job.output = Some(path("m.ply"));
    // On disk, too.
    for (output, tile, max_memory) in
        [("m.ply", None, 1 << 30), ("m.obj", None, 32 << 20), ("m.glb", Some(0.5), 1 << 30)]
    {
        (job.output, job.tile, job.resources.max_memory) = (Some(path(output)), tile, Some(max_memory));
        each(dir.path(), output, |workers| run(&job, workers, &mut quiet()).map(drop));
    }

    let resources = Resources { max_memory: Some(1 << 28), ..Resources::default() };
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = format::read::open(&path("m.ply"), &workspace, 1 << 28).unwrap();
    each(dir.path(), "check", |workers| {
        mesh::check::check(&*mesh, 1 << 28, workers, &workspace, &mut |_| ())?;
        mesh::check::intersections(&*mesh, 1 << 28, workers, &workspace, &mut |_| ()).map(drop)
    });
    each(dir.path(), "render", |workers| {
        render::render(&*mesh, &render::Options::default(), 1 << 28, workers, &workspace, &mut |_| ()).map(drop)
    });
    for reference in ["s.bin", "m.ply"] {
        let job = compare::Job {
            mesh: path("m.ply"),
            reference: path(reference),
            kind: None,
            input: Default::default(),
            heatmap: None,
            resources: resources.clone(),
        };
        each(dir.path(), "compare", |workers| compare::compare(&job, workers, &mut quiet()).map(drop));
    }
    let job = densify::Job {
        mesh: path("m.ply"),
        cloud: path("s.bin"),
        input: Default::default(),
        output: path("d.ply"),
        overwrite: Overwrite::Replace,
        resources,
    };
    each(dir.path(), "densify", |workers| densify::densify(&job, workers, &mut quiet()).map(drop));
}
