//! Point clouds as they are found in the wild: several files of several formats, read as one stream of points.
//!
//! ```text
//!  arguments --files.rs--> files --open--> [PointFormat] --cut--> Block, Block, … --decode--> Batch
//!                           detect.rs says which          one thread, cheap        any thread, in parallel
//!                           (format/unpack: what is compressed, and standard input, first)
//! ```
//!
//! A block is a range of whole records, at most [`BLOCK_BYTES`] long (or one record, or one line), or a compressed chunk of them. Blocks come in
//! file order, so the points of a cloud have one order. Nothing here holds more than the blocks in flight, whatever
//! the length of a file or the claims of its header.
//!
//! A new format is a module that implements `PointFormat` and a line in `detect.rs`.

mod blocks;
mod detect;
mod fetch;
mod files;
pub mod ground;
mod headers;
mod memory;
mod objects;
mod places;
mod spooled;
pub mod tally;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::format::e57;
use crate::format::point_format::PointFormat;
use crate::format::unpack::Unpacking;
use crate::points::attribute::{Schema, Wanted};
use crate::points::clip::Clip;
use crate::points::crs::Crs;
use crate::points::filter::{Sieve, Verdict};
use crate::points::seen_from::SeenFrom;
use crate::points::unit::{Measure, Unit, measured};
use crate::points::{Batch, Precision};
use crate::resources::workers::{Spares, Workers};
use crate::storage::mapped::{self, Content};
use crate::storage::spool::Workspace;
use crate::storage::steady::{Stamp, settle};

pub use crate::format::layout::Layout;
pub use crate::format::options::{Depth, InputOptions};
pub use crate::format::point_format::{BLOCK_BYTES, BLOCK_RECORDS, Source};
pub(crate) use crate::format::sidecar::Sidecar;
pub use crate::format::unpack::{Opening, Unpacked};
pub(crate) use crate::format::unpack::{Packing, STANDARD_INPUT};
pub use crate::points::filter::{Filter, Returns, Withheld};
pub use blocks::{Blocks, Segment};
pub use files::{expand, find};
pub(crate) use headers::Headers;
pub(crate) use memory::Arrays;
pub use memory::{PointBuffer, PointSlice, PointSource, Values};
pub use places::Places;
pub use spooled::PointSpool;

/// Memory for opening where nobody names a budget.
const OPENING_MEMORY: u64 = 64 << 20;

/// Several files as one cloud, or points that lie in memory.
#[derive(Debug)]
pub struct Cloud<'a> {
    sources: Vec<Source>,
    /// How each file that is read in every pass was when it was opened.
    stamps: Vec<Option<Stamp>>,
    formats: Vec<Arc<dyn PointFormat + 'a>>,
    precision: Precision,
    schema: Schema,
    filter: Filter,
    verdict: Option<Arc<dyn Verdict>>,
    seen_from: SeenFrom,
    crs: Option<Crs>,
    /// What the first file that tells another system tells, if one was given in its place.
    overruled: Option<(PathBuf, Crs)>,
    unpacked: u64,
    unpacked_later: u64,
    /// Bytes that were fetched from object stores, of so many.
    fetched: (u64, u64),
}

impl<'a> Cloud<'a> {
    /// Looks at the files: their headers, and for raw files without a layout at a sample of their content.
    ///
    /// An argument that is no file is taken as a pattern (`tiles/*.ply`); a folder stands for the point files in it;
    /// neither for meshes that this program made, and a folder not for what holds no points ([`find`] tells what was left out). A file that is named more than once counts once. The order is that of the arguments, by name within an argument.
    /// `-` is standard input, which is read whole, now. That, and what is compressed, lies in a temporary file without a name as long as the cloud
    /// lives: in `TMPDIR`, or the first file's folder. [`Cloud::open_in`] says otherwise.
    ///
    /// # Errors
    /// If an argument or pattern matches nothing, a file cannot be opened, is malformed or of a format that is not
    /// supported, or the layout of a raw file cannot be told; [`Error::Usage`] if files tell different coordinate reference systems.
    pub fn open(inputs: &[PathBuf], options: &InputOptions) -> Result<Cloud<'static>> {
        let files = find(inputs, options.depth)?.files;
        let workspace = Workspace::unchecked(Workspace::folder_beside(&files[0]));
        let opening =
            Opening { workspace: &workspace, memory: OPENING_MEMORY, decompress: None, watch: &mut |_| Ok(()) };
        Cloud::open_in(&files, options, opening)
    }

    /// Looks at files, as [`expand`] gives them, and unpacks what cannot be read in place with the means of `opening`.
    ///
    /// # Errors
    /// The same as [`Cloud::open`]; [`Error::Disk`] before the disk is full; what `opening.watch` says.
    pub fn open_in(files: &[PathBuf], options: &InputOptions, opening: Opening) -> Result<Cloud<'static>> {
        Cloud::opened(files, options, opening, |_| None)
    }

    /// The same, but for files of which it is `known` by their number what they are: these are not opened.
    fn opened(
        files: &[PathBuf],
        options: &InputOptions,
        opening: Opening,
        known: impl Fn(usize) -> Option<(Source, Arc<dyn PointFormat>)>,
    ) -> Result<Cloud<'static>> {
        let mut cloud = Cloud {
            sources: Vec::new(),
            stamps: Vec::new(),
            formats: Vec::new(),
            precision: Precision::Single,
            schema: Schema::default(),
            filter: options.filter.clone(),
            verdict: None,
            seen_from: options.seen_from.clone(),
            crs: None,
            overruled: None,
            unpacked: 0,
            unpacked_later: 0,
            fetched: (0, 0),
        };
        let mut unpacking = Unpacking::new(opening);
        let known: Vec<_> = (0..files.len()).map(known).collect();
        let read: Vec<PathBuf> =
            files.iter().zip(&known).filter(|(_, known)| known.is_none()).map(|(path, _)| path.clone()).collect();
        unpacking.expect(&read);
        for (path, known) in files.iter().zip(known) {
            if let Some((source, format)) = known {
                cloud.precision = cloud.precision.max(format.precision());
                cloud.stamps.push(None);
                cloud.sources.push(source);
                cloud.formats.push(format);
                continue;
            }
            let (stamp, unpacked) = (Stamp::of(path).filter(|_| path != Path::new(STANDARD_INPUT)), unpacking.bytes());
            let opened = detect::open(path, options, &mut unpacking);
            let (source, format) = settle(stamp.iter().map(|stamp| (path.as_path(), *stamp)), opened)?;
            unpacking.finished(path);
            if let Err(missing) = options.filter.check(format.attributes()) {
                let path = path.display();
                return Err(Error::Usage(format!("{path}: its points have no {missing}, which the filter asks for")));
            }
            cloud.precision = cloud.precision.max(format.precision());
            // What is unpacked is not read again.
            cloud.stamps.push(stamp.filter(|_| unpacking.bytes() == unpacked));
            cloud.sources.push(source);
            cloud.formats.push(format);
        }
        if let Some(given) = &options.crs {
            let other = |crs: &&Crs| given.as_ref().is_some_and(|given| !crs.same_as(given));
            cloud.overruled = (cloud.sources.iter())
                .find_map(|source| Some((source.path.clone(), source.crs.as_ref().filter(other)?.clone())));
            cloud.sources.iter_mut().for_each(|source| source.crs.clone_from(given));
        }
        cloud.crs = common_crs(&cloud.sources)?;
        if let Some(clip) = &options.filter.clip {
            clip.check(cloud.crs())?;
        }
        (cloud.unpacked, cloud.unpacked_later) = (unpacking.bytes(), unpacking.later());
        cloud.fetched = unpacking.fetched();
        cloud.schema = options.attributes.of(cloud.formats.iter().map(|format| format.attributes()))?;
        cloud.check_places()?;
        Ok(cloud)
    }

    /// Points that a program holds, or makes. They count as one source, named "memory".
    ///
    /// # Errors
    /// [`Error::Usage`] if an attribute is there twice, or the filter asks for one that is not there.
    pub fn of_source(source: &'a dyn PointSource, options: &InputOptions) -> Result<Cloud<'a>> {
        let format = memory::SourceFormat::new(source)?;
        if let Err(missing) = options.filter.check(format.attributes()) {
            return Err(Error::Usage(format!("the points have no {missing}, which the filter asks for")));
        }
        let schema = options.attributes.of([format.attributes()])?;
        let crs = options.crs.clone().flatten();
        let bytes = source.len() * (3 * format.precision().bytes() as u64);
        let description = "points in memory".to_owned();
        let path = PathBuf::from("memory");
        let cloud = Cloud {
            sources: vec![Source {
                path,
                format: "memory",
                description,
                records: Some(source.len()),
                bytes,
                crs: crs.clone(),
                remark: None,
            }],
            stamps: vec![None],
            precision: format.precision(),
            formats: vec![Arc::new(format)],
            schema,
            filter: options.filter.clone(),
            verdict: None,
            seen_from: options.seen_from.clone(),
            crs,
            overruled: None,
            unpacked: 0,
            unpacked_later: 0,
            fetched: (0, 0),
        };
        cloud.check_places()?;
        Ok(cloud)
    }

    /// The files, in reading order.
    pub fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// Bytes of the heap that a block takes before it is decoded, at the most: none if all files are mapped, and blocks lent from them.
    pub(crate) fn bytes_of_block(&self) -> u64 {
        let are_lent = self.formats.iter().all(|format| format.lent_from().is_some_and(Content::is_mapped));
        if are_lent { 0 } else { BLOCK_BYTES as u64 }
    }

    /// The widest precision of the files, which all decoded points have.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Bytes of temporary disk that unpacked files take.
    pub fn unpacked(&self) -> u64 {
        self.unpacked
    }

    /// Bytes of temporary disk that a whole run takes for decompressed files beyond [`Cloud::unpacked`].
    pub fn unpacked_later(&self) -> u64 {
        self.unpacked_later
    }

    /// Bytes that were fetched from object stores, and those of the objects that were opened.
    pub fn fetched(&self) -> (u64, u64) {
        self.fetched
    }

    /// What its coordinates are, as its reference system tells; without one, those of E57 files are metres, as their standard says.
    pub fn measure(&self) -> Option<Measure> {
        match &self.crs {
            Some(crs) => crs.measure(),
            None => self.sources.iter().all(|source| source.format == "E57").then_some(Measure::Length(Unit::Metre)),
        }
    }

    /// The length of a setting, given in a unit, in that of the coordinates.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if the unit of the coordinates is not known, or not one of length.
    pub(crate) fn length(&self, setting: &'static str, length: f64, unit: Unit) -> Result<f64> {
        measured(setting, length, unit, self.measure())
    }

    /// Where the scans of each file were taken from, in the order of [`Cloud::sources`], as far as files tell.
    pub fn stations(&self) -> impl Iterator<Item = Vec<[f64; 3]>> {
        self.formats.iter().map(|format| format.stations())
    }

    /// The attributes that are carried to the mesh.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// Whether any of the files has an attribute of this name.
    pub fn has_attribute(&self, name: &str) -> bool {
        self.formats.iter().any(|format| format.attributes().iter().any(|attribute| attribute.name == name))
    }

    /// The schema of those of the attributes that files have.
    pub fn schema_of(&self, names: &[&str]) -> Schema {
        let there = names.iter().filter(|name| self.has_attribute(name)).map(|name| (*name).to_owned()).collect();
        // None is missing, and a few take little room.
        Wanted::Named(there).of(self.formats.iter().map(|format| format.attributes())).unwrap_or_default()
    }

    /// The coordinate reference system of all files that tell theirs.
    pub fn crs(&self) -> Option<&Crs> {
        self.crs.as_ref()
    }

    /// The schema of what a pass carries.
    pub(crate) fn carried(&self, carried: Carried) -> Schema {
        match carried {
            Carried::Coordinates => Schema::default(),
            Carried::Attributes => self.schema.clone(),
            Carried::Only(names) => self.schema_of(names),
        }
    }

    /// A line about the coordinate reference system, if any file tells it, and which files do not.
    pub fn crs_line(&self) -> Option<String> {
        const NAMED: usize = 3;
        let crs = self.crs()?;
        let silent: Vec<&Source> = self.sources.iter().filter(|source| source.crs.is_none()).collect();
        let named: Vec<String> = silent.iter().take(NAMED).map(|source| source.path.display().to_string()).collect();
        let more = match silent.len() {
            ..=NAMED => String::new(),
            all => format!(" and {} more", all - NAMED),
        };
        Some(match silent.len() {
            0 => match &self.overruled {
                Some((path, theirs)) => format!("{crs}, as given; {} tells {theirs}", path.display()),
                None => crs.to_string(),
            },
            _ => format!("{crs}; taken to be that of {}{more}, too, which do not tell", named.join(", ")),
        })
    }

    /// Starts a pass over everything; every pass gives the same blocks as long as the files stay as they are. Files are opened when the
    /// pass comes to them.
    pub fn blocks(&self, carried: Carried) -> Blocks<'_> {
        let sieve =
            Sieve::new(&self.filter, self.carried(carried), self.formats.iter().map(|format| format.attributes()));
        let (precision, verdict) = (self.precision, self.verdict.clone());
        Blocks::of(&self.formats, precision, Arc::new(sieve), verdict)
    }

    /// The polygons that points are clipped by.
    pub(crate) fn clip(&self) -> Option<&Clip> {
        self.filter.clip.as_deref()
    }

    /// A pass over all points, whether they count or not.
    pub(crate) fn all_blocks(&self) -> Blocks<'_> {
        let sieve =
            Sieve::new(&Filter::default(), Schema::default(), self.formats.iter().map(|format| format.attributes()));
        Blocks::of(&self.formats, self.precision, Arc::new(sieve), None)
    }

    /// How many blocks each file has.
    ///
    /// # Errors
    /// If a file cannot be read, or is malformed.
    pub(crate) fn block_counts(&self, carried: Carried) -> Result<Vec<u64>> {
        let mut of_source = vec![0u64; self.sources.len()];
        let mut blocks = self.blocks(carried);
        while let Some(block) = blocks.next_block()? {
            of_source[block.source()] += 1;
        }
        Ok(of_source)
    }

    /// Which points count now.
    pub(crate) fn sifting(&self) -> Sifting {
        Sifting { filter: self.filter.clone(), verdict: self.verdict.clone() }
    }

    /// From now on, the points count that counted then.
    pub(crate) fn sift_by(&mut self, sifting: Sifting) {
        (self.filter, self.verdict) = (sifting.filter, sifting.verdict);
    }

    /// From now on, of the points that count, those that `verdict` lets through.
    pub(crate) fn judge_by(&mut self, verdict: Arc<dyn Verdict>) {
        self.verdict = Some(verdict);
    }

    /// From now on, of the points that count, those of these classes.
    ///
    /// # Errors
    /// [`Error::Usage`] if a file's points have no classes.
    pub(crate) fn keep_classes(&mut self, classes: &[u8]) -> Result<()> {
        let asked = |class: &&u8| self.filter.keep_class.is_empty() || self.filter.keep_class.contains(class);
        let kept: Vec<u8> = classes.iter().filter(asked).copied().collect();
        let none = kept.is_empty();
        self.filter = Filter { keep_class: kept, ..self.filter.clone() };
        if none {
            // No class at all would be every class.
            self.filter.drop_class = (0..=u8::MAX).collect();
        }
        for (source, format) in self.sources.iter().zip(&self.formats) {
            if let Err(missing) = self.filter.check(format.attributes()) {
                let path = source.path.display();
                return Err(Error::Usage(format!("{path}: its points have no {missing}, which `classes` asks for")));
            }
        }
        Ok(())
    }

    /// One pass over everything, decoded with what is `carried`: `work` sees each block's points on some worker, `sink` the results in file order. At most
    /// `in_flight` blocks are held.
    ///
    /// # Errors
    /// Errors of reading the files, of `work` and of `sink`; [`Error::Changed`] if a file is no longer as it was when it was opened; [`Error::Interrupted`].
    pub fn for_each_batch<R: Send>(
        &self,
        workers: &Workers,
        in_flight: usize,
        carried: Carried,
        work: impl Fn(&Batch) -> Result<R> + Sync,
        sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        self.for_each_batch_of(None, workers, in_flight, carried, work, sink)
    }

    /// The same of a segment, or of everything if there is none.
    ///
    /// # Errors
    /// The same as [`Cloud::for_each_batch`].
    pub fn for_each_batch_of<R: Send>(
        &self,
        segment: Option<&Segment>,
        workers: &Workers,
        in_flight: usize,
        carried: Carried,
        work: impl Fn(&Batch) -> Result<R> + Sync,
        sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let mut blocks = self.blocks(carried).within(segment);
        let batches = Spares::<Option<Batch>>::default();
        let outcome = workers.in_order(
            in_flight,
            || blocks.next_block(),
            |block| {
                batches.lend(|batch| {
                    let batch = batch.get_or_insert_with(|| Batch::new(self.precision));
                    block.decode(batch)?;
                    work(batch)
                })
            },
            sink,
        );
        let named = self.sources.iter().zip(&self.stamps);
        settle(named.filter_map(|(source, stamp)| Some((source.path.as_path(), (*stamp)?))), outcome)
    }
}

/// Whether any of the files that the arguments stand for, and that need no unpacking, tells where its scans were taken from. What cannot be read does not.
pub fn tells_stations(inputs: &[PathBuf], depth: Depth) -> bool {
    let tells = |path: &PathBuf| {
        let content = mapped::Content::named(path);
        let head = content.unmapped().and_then(|file| file.read(0..file.len().min(8)));
        head.is_ok_and(|head| e57::is_e57(&head))
            && e57::open(&content).is_ok_and(|(_, format)| !format.stations().is_empty())
    };
    find(inputs, depth)
        .is_ok_and(|found| found.files.iter().filter(|file| *file != Path::new(STANDARD_INPUT)).any(tells))
}

/// The system of the files that tell theirs, as the first of them does.
fn common_crs(sources: &[Source]) -> Result<Option<Crs>> {
    let mut telling = sources.iter().filter_map(|source| source.crs.as_ref().map(|crs| (source, crs)));
    let Some((first, crs)) = telling.next() else { return Ok(None) };
    if let Some((other, theirs)) = telling.find(|(_, theirs)| !theirs.same_as(crs)) {
        let (a, b) = (first.path.display(), other.path.display());
        return Err(Error::Usage(format!(
            "the files are in different coordinate reference systems: {a} in {crs}, {b} in {theirs}; reproject one of them"
        )));
    }
    Ok(Some(crs.clone()))
}

/// Which points of a cloud count.
#[derive(Debug)]
pub(crate) struct Sifting {
    filter: Filter,
    verdict: Option<Arc<dyn Verdict>>,
}

/// What a pass over a cloud is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carried {
    /// Coordinates only.
    Coordinates,
    /// Coordinates, and the attributes of the cloud's schema.
    Attributes,
    /// Coordinates, and those of these attributes that files have, whether the cloud's schema has them or not.
    Only(&'static [&'static str]),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::testing::collect_all;
    use crate::points::Points;

    #[test]
    fn files_of_all_formats_are_one_cloud_in_the_widest_precision() {
        let dir = tempfile::tempdir().unwrap();
        let (bin, xyz) = (dir.path().join("a.bin"), dir.path().join("b.xyz"));
        std::fs::write(&bin, bytemuck::cast_slice(&[0.1f32, 2.0, 3.0])).unwrap();
        std::fs::write(&xyz, "0.1 5 6\n").unwrap();
        let options = InputOptions::default();
        let alone = Cloud::open(std::slice::from_ref(&bin), &options).unwrap();
        assert_eq!(alone.precision(), Precision::Single);
        assert_eq!(alone.sources()[0].description, "raw xyz little-endian (detected; pass --layout xyz to fix)");
        let both = Cloud::open(&[bin, xyz], &options).unwrap();
        assert_eq!(both.precision(), Precision::Double);
        assert_eq!(
            both.sources().iter().map(|s| (s.format, s.records)).collect::<Vec<_>>(),
            [("raw", Some(1)), ("text", None)]
        );
        let first = collect_all(&both).unwrap();
        assert_eq!(first.0, [[f64::from(0.1f32), 2.0, 3.0], [0.1, 5.0, 6.0]]);
        assert_eq!(collect_all(&both).unwrap(), first, "every pass gives the same");
    }

    #[test]
    fn blocks_are_bounded_and_a_batch_is_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        let points: Vec<[f32; 3]> = (0..200_000).map(|i| [i as f32, 1.0, 2.0]).collect();
        std::fs::write(&path, bytemuck::cast_slice(&points)).unwrap();
        let layout = Some("xyz".parse().unwrap());
        let cloud = Cloud::open(&[path], &InputOptions { layout, ..InputOptions::default() }).unwrap();
        let mut blocks = cloud.blocks(Carried::Attributes);
        let mut batch = Batch { dropped: 9, ..Batch::new(Precision::Double) };
        let mut read = Vec::new();
        while let Some(block) = blocks.next_block().unwrap() {
            block.decode(&mut batch).unwrap();
            let Points::Single(points) = &batch.points else { panic!("the cloud is single") };
            assert!(points.len() <= BLOCK_RECORDS && batch.dropped == 0);
            read.extend_from_slice(points);
        }
        assert_eq!(read, points);
    }

    #[test]
    fn a_file_that_changes_between_passes_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.xyz");
        std::fs::write(&path, "1 2 3\n").unwrap();
        let cloud = Cloud::open(std::slice::from_ref(&path), &InputOptions::default()).unwrap();
        std::fs::write(&path, "1 2 3\n4 5 6\n").unwrap();
        let error = collect_all(&cloud).unwrap_err().to_string();
        assert!(error.contains("6 bytes as in the first look") && error.contains("12 bytes"), "{error}");
    }

    /// As another program might do it: in place, with as many bytes.
    #[test]
    fn a_file_that_is_written_to_during_a_pass_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        std::fs::write(&path, bytemuck::cast_slice(&[[1f32, 2.0, 3.0]; 200_000])).unwrap();
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        // Long ago, as far as the file system's clock can tell.
        file.set_modified(std::time::SystemTime::UNIX_EPOCH).unwrap();
        let layout = Some("xyz".parse().unwrap());
        let cloud =
            Cloud::open(std::slice::from_ref(&path), &InputOptions { layout, ..InputOptions::default() }).unwrap();
        let workers = Workers::new(2).unwrap();
        let pass = |sink: &mut dyn FnMut() -> Result<()>| {
            cloud.for_each_batch(&workers, 2, Carried::Coordinates, |_| Ok(()), |()| sink())
        };
        pass(&mut || Ok(())).unwrap();
        let mut write = || {
            use crate::system::FileAt;
            file.write_all_at(&[0; 12], 12 * 199_999).map_err(Error::io("a.bin", "write"))
        };
        let error = pass(&mut write).unwrap_err();
        assert!(matches!(&error, Error::Changed { path: named, .. } if *named == path), "{error}");
        let error = pass(&mut || Ok(())).unwrap_err();
        assert!(error.to_string().contains("a.bin: changed while it was read"), "{error}");
    }
}
