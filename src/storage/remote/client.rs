//! Requests to object stores, each waited for: nothing else of the program knows of futures.
//!
//! A thread of its own drives all requests. What fails and may pass (5xx, 429, lost connections, no answer in time) is tried again for some three minutes at the most, with pauses that grow.
//! Nothing that an answer claims is believed: what is read has the length that was asked for, and no more is held.

use std::collections::BTreeMap;
use std::future::Future;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use futures_util::StreamExt;
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::azure::{AzureConfigKey, MicrosoftAzureBuilder};
use object_store::gcp::{GoogleCloudStorageBuilder, GoogleConfigKey};
use object_store::http::HttpBuilder;
use object_store::path::Path as Key;
use object_store::{
    ClientConfigKey, GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt, ObjectStoreScheme, PutMode,
    PutPayload, RetryConfig,
};
use tokio::runtime::{Builder, Runtime};
use url::Url;

use super::errors::told;
use super::{BUFFERS, Changed, Meta, Put};
use crate::error::{Error, Result};

/// How long is tried again what fails, and how often.
const PATIENCE: Duration = Duration::from_secs(120);
const TRIES: usize = 20;

/// How long a request may take, as the client reads it: the largest has 8 MiB.
const TIMEOUT: &str = "60 seconds";

/// How often is begun anew what no answer came to, or half of one, beside what the client does by itself; and the pause before the first time.
const ANEW: u32 = 6;
const PAUSE: Duration = Duration::from_millis(200);

/// A bucket.
#[derive(Debug)]
struct Bucket {
    store: Arc<dyn ObjectStore>,
    /// Its address, without a slash at the end.
    root: String,
    /// Whether addresses have odd letters encoded.
    encoded: bool,
}

/// A place in an object store: that of an object, or what objects' names begin with.
#[derive(Debug, Clone)]
pub struct Place {
    bucket: Arc<Bucket>,
    key: Key,
}

fn runtime() -> io::Result<&'static Runtime> {
    static RUNTIME: OnceLock<io::Result<Runtime>> = OnceLock::new();
    let made = RUNTIME.get_or_init(|| {
        Builder::new_multi_thread()
            .worker_threads(1)
            .max_blocking_threads(2)
            .thread_name("asra-objects")
            .enable_all()
            .build()
    });
    made.as_ref().map_err(|error| io::Error::new(error.kind(), error.to_string()))
}

/// Waits for a request. Whoever waits may be a thread of another runtime.
fn wait<T: Send + 'static>(
    request: impl Future<Output = object_store::Result<T>> + Send + 'static,
) -> object_store::Result<T> {
    let failed = |source: Box<dyn std::error::Error + Send + Sync>| object_store::Error::Generic {
        store: "asra-stream",
        source,
    };
    let (tell, hear) = mpsc::sync_channel(1);
    let runtime = runtime().map_err(|error| failed(error.into()))?;
    runtime.spawn(async move { drop(tell.send(request.await)) });
    hear.recv().unwrap_or_else(|_| Err(failed("the request was given up".into())))
}

/// Does again what failed for no reason that stays, for as long as there is patience. It has to be the same how often it is done.
pub(super) fn again<T>(mut work: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    let start = Instant::now();
    let mut tries = 0;
    loop {
        match work() {
            Err(error) if passes(&error) && tries < ANEW && start.elapsed() < PATIENCE / 2 => {
                thread::sleep(PAUSE * 2u32.pow(tries));
                tries += 1;
            }
            done => return done,
        }
    }
}

/// Whether an error is none that the store means.
fn passes(error: &io::Error) -> bool {
    let is_changed = error.get_ref().is_some_and(|inner| inner.is::<Changed>());
    matches!(error.kind(), io::ErrorKind::Other | io::ErrorKind::UnexpectedEof) && !is_changed
}

/// Bytes of buffers that are taken.
static TAKEN: Mutex<u64> = Mutex::new(0);
static GIVEN_BACK: Condvar = Condvar::new();

/// Room for a buffer, until it is dropped.
pub(super) struct Room(u64);

impl Room {
    /// Waits for it; more than there is at all is as much as there is.
    pub(super) fn of(bytes: u64) -> Room {
        let bytes = bytes.min(BUFFERS);
        let mut taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner);
        while *taken + bytes > BUFFERS {
            taken = GIVEN_BACK.wait(taken).unwrap_or_else(PoisonError::into_inner);
        }
        *taken += bytes;
        Room(bytes)
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        *TAKEN.lock().unwrap_or_else(PoisonError::into_inner) -= self.0;
        GIVEN_BACK.notify_all();
    }
}

fn buckets() -> MutexGuard<'static, BTreeMap<String, Arc<Bucket>>> {
    static BUCKETS: Mutex<BTreeMap<String, Arc<Bucket>>> = Mutex::new(BTreeMap::new());
    BUCKETS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// For tests: a store by an address of the scheme `memory`, from now on.
#[cfg(test)]
pub fn in_memory(root: &str, store: Arc<dyn ObjectStore>) {
    let bucket = Bucket { store, root: root.to_owned(), encoded: false };
    buckets().insert(root.to_owned(), Arc::new(bucket));
}

impl Bucket {
    /// The bucket of an address, which is asked nothing yet.
    fn of(root: &str, url: &Url, scheme: &ObjectStoreScheme) -> object_store::Result<Bucket> {
        let retry = RetryConfig { max_retries: TRIES, retry_timeout: PATIENCE, ..RetryConfig::default() };
        let text = url.to_string();
        let store: Arc<dyn ObjectStore> = match scheme {
            ObjectStoreScheme::AmazonS3 => {
                let builder = AmazonS3Builder::from_env()
                    .with_config(AmazonS3ConfigKey::Client(ClientConfigKey::Timeout), TIMEOUT);
                Arc::new(builder.with_retry(retry).with_url(text).build()?)
            }
            ObjectStoreScheme::GoogleCloudStorage => {
                let builder = GoogleCloudStorageBuilder::from_env()
                    .with_config(GoogleConfigKey::Client(ClientConfigKey::Timeout), TIMEOUT);
                Arc::new(builder.with_retry(retry).with_url(text).build()?)
            }
            ObjectStoreScheme::MicrosoftAzure => {
                let builder = MicrosoftAzureBuilder::from_env()
                    .with_config(AzureConfigKey::Client(ClientConfigKey::Timeout), TIMEOUT);
                Arc::new(builder.with_retry(retry).with_url(text).build()?)
            }
            _ => {
                let plain = if url.scheme() == "http" { "true" } else { "false" };
                let builder = HttpBuilder::new()
                    .with_config(ClientConfigKey::Timeout, TIMEOUT)
                    .with_config(ClientConfigKey::AllowHttp, plain);
                Arc::new(builder.with_retry(retry).with_url(text).build()?)
            }
        };
        Ok(Bucket { store, root: root.to_owned(), encoded: matches!(scheme, ObjectStoreScheme::Http) })
    }
}

impl Place {
    /// The place of an address. Nobody is asked yet.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is none, or the store's settings, which stand in the environment, are not in order.
    pub fn of(path: &Path) -> Result<Place> {
        let wrong = |why: &dyn std::fmt::Display| Error::Usage(format!("{}: {why}", path.display()));
        let text = path.to_str().ok_or_else(|| wrong(&"an address of an object store is Unicode text"))?;
        let (scheme, rest) = text.split_once("://").ok_or_else(|| wrong(&"is no address of an object store"))?;
        let (host, mut key) = rest.split_once('/').unwrap_or((rest, ""));
        let mut root = format!("{scheme}://{host}");
        let known = buckets().get(&root).cloned();
        let bucket = match known {
            Some(bucket) => bucket,
            None => {
                // Some addresses have the bucket in the host's place, others behind it.
                let probe = Url::parse(&format!("{root}/x/y")).map_err(|error| wrong(&error))?;
                let (scheme, within) = ObjectStoreScheme::parse(&probe).map_err(|error| wrong(&error))?;
                if within.as_ref() == "y" {
                    let (first, rest) = key.split_once('/').unwrap_or((key, ""));
                    (root, key) = (format!("{root}/{first}"), rest);
                }
                let there = buckets().get(&root).cloned();
                match there {
                    Some(bucket) => bucket,
                    None => {
                        let url = Url::parse(&root).map_err(|error| wrong(&error))?;
                        let bucket = Bucket::of(&root, &url, &scheme).map_err(|error| wrong(&told(&error)))?;
                        Arc::clone(buckets().entry(root).or_insert(Arc::new(bucket)))
                    }
                }
            }
        };
        let key = if bucket.encoded { Key::from_url_path(key) } else { Key::parse(key) };
        Ok(Place { key: key.map_err(|error| wrong(&error))?, bucket })
    }

    /// The place of a name below this one.
    ///
    /// # Errors
    /// `InvalidInput` if that can be no name.
    pub fn within(&self, name: &str) -> io::Result<Place> {
        let whole = if self.key.as_ref().is_empty() { name.to_owned() } else { format!("{}/{name}", self.key) };
        let key = Key::parse(whole).map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error.to_string()))?;
        Ok(Place { bucket: Arc::clone(&self.bucket), key })
    }

    /// Its address.
    pub fn path(&self) -> PathBuf {
        self.path_of(&self.key)
    }

    fn path_of(&self, key: &Key) -> PathBuf {
        let key = if self.bucket.encoded { key.as_ref().replace('%', "%25") } else { key.to_string() };
        format!("{}/{key}", self.bucket.root).into()
    }

    /// What the object is like.
    ///
    /// # Errors
    /// `NotFound`, and what the store says.
    pub fn look(&self) -> io::Result<Meta> {
        again(|| {
            let (bucket, key) = (Arc::clone(&self.bucket), self.key.clone());
            let meta = wait(async move { bucket.store.head(&key).await }).map_err(|error| told(&error))?;
            Ok(meta_of(&meta))
        })
    }

    /// The objects below it, as below a folder, by their names: those in it, or, if it is to be `deep`, those in folders in it, too.
    ///
    /// # Errors
    /// What the store says.
    pub fn below(&self, deep: bool) -> io::Result<Vec<(PathBuf, Meta)>> {
        again(|| self.listed(deep))
    }

    fn listed(&self, deep: bool) -> io::Result<Vec<(PathBuf, Meta)>> {
        let (bucket, key) = (Arc::clone(&self.bucket), self.key.clone());
        let listed = async move {
            let prefix = Some(&key).filter(|key| !key.as_ref().is_empty());
            if !deep {
                return bucket.store.list_with_delimiter(prefix).await.map(|listed| listed.objects);
            }
            let (mut listed, mut found) = (bucket.store.list(prefix), Vec::new());
            while let Some(object) = listed.next().await {
                found.push(object?);
            }
            Ok(found)
        };
        let mut found = wait(listed).map_err(|error| told(&error))?;
        // What makes a folder of itself is an object of the folder's name.
        found.retain(|object| object.location != self.key);
        found.sort_unstable_by(|a, b| a.location.cmp(&b.location));
        Ok(found.iter().map(|object| (self.path_of(&object.location), meta_of(object))).collect())
    }

    /// The bytes of a stretch of the object, of which there is one, and which is as it is `expected`.
    ///
    /// # Errors
    /// [`Changed`] if it is not; `UnexpectedEof`, and what the store says.
    pub fn read(&self, range: Range<u64>, expected: Option<&Meta>) -> io::Result<Vec<u8>> {
        again(|| self.read_once(range.clone(), expected))
    }

    fn read_once(&self, range: Range<u64>, expected: Option<&Meta>) -> io::Result<Vec<u8>> {
        let asked = range.end - range.start;
        if asked == 0 {
            return Ok(Vec::new());
        }
        let _room = Room::of(asked);
        // Tags that are weak match nothing.
        let tag = expected.and_then(|meta| meta.tag.clone()).filter(|tag| !tag.starts_with("W/"));
        let options =
            GetOptions { if_match: tag, range: Some(GetRange::Bounded(range.clone())), ..GetOptions::default() };
        let (meta, bytes) = self.got(options, asked).map_err(|error| match error {
            object_store::Error::Precondition { .. } => io::Error::other(Changed("another object".into())),
            error => told(&error),
        })?;
        if let Some(expected) = expected.filter(|expected| !expected.is_of_same(&meta)) {
            let what = if meta.bytes == expected.bytes { meta.to_string() } else { format!("{} bytes", meta.bytes) };
            return Err(io::Error::other(Changed(what)));
        }
        match bytes.len() as u64 == asked {
            true => Ok(bytes),
            false => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }

    /// All of an object of so many bytes at the most.
    ///
    /// # Errors
    /// `NotFound`, `FileTooLarge`, and what the store says.
    pub fn whole(&self, most: u64) -> io::Result<Vec<u8>> {
        again(|| self.whole_once(most))
    }

    fn whole_once(&self, most: u64) -> io::Result<Vec<u8>> {
        let (meta, bytes) = self.got(GetOptions::default(), most + 1).map_err(|error| told(&error))?;
        match (bytes.len() as u64 > most, bytes.len() as u64 == meta.bytes) {
            (true, _) => Err(io::ErrorKind::FileTooLarge.into()),
            (false, true) => Ok(bytes),
            (false, false) => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }

    /// What a request gives, of which so many bytes are taken at the most.
    fn got(&self, options: GetOptions, most: u64) -> object_store::Result<(Meta, Vec<u8>)> {
        let (bucket, key) = (Arc::clone(&self.bucket), self.key.clone());
        wait(async move {
            let got = bucket.store.get_opts(&key, options).await?;
            let (meta, mut stream) = (meta_of(&got.meta), got.into_stream());
            let mut bytes: Vec<u8> = Vec::new();
            while let Some(piece) = stream.next().await {
                let piece = piece?;
                let room = (most - bytes.len() as u64).min(piece.len() as u64) as usize;
                bytes.extend_from_slice(&piece[..room]);
                if room < piece.len() {
                    break;
                }
            }
            Ok((meta, bytes))
        })
    }

    /// Puts an object of a few bytes there.
    ///
    /// # Errors
    /// `AlreadyExists` if another is there, and is not to be replaced; what the store says.
    pub fn put(&self, bytes: &[u8], put: Put) -> io::Result<()> {
        again(|| {
            let (bucket, key, payload) = (Arc::clone(&self.bucket), self.key.clone(), PutPayload::from(bytes.to_vec()));
            let mode = match put {
                Put::Create => PutMode::Create,
                Put::Replace => PutMode::Overwrite,
            };
            let made = wait(async move { bucket.store.put_opts(&key, payload, mode.into()).await });
            match made.map_err(|error| told(&error)) {
                // It may have been made by a request whose answer was lost: then what is there is this.
                Err(error) if put == Put::Create && error.kind() == io::ErrorKind::AlreadyExists => {
                    match self.whole(bytes.len() as u64) {
                        Ok(there) if there == bytes => Ok(()),
                        Ok(_) => Err(error),
                        Err(larger) if larger.kind() == io::ErrorKind::FileTooLarge => Err(error),
                        Err(other) => Err(other),
                    }
                }
                made => made.map(drop),
            }
        })
    }

    /// Removes the object.
    ///
    /// # Errors
    /// What the store says; some say nothing if there is none.
    pub fn remove(&self) -> io::Result<()> {
        again(|| {
            let (bucket, key) = (Arc::clone(&self.bucket), self.key.clone());
            wait(async move { bucket.store.delete(&key).await }).map_err(|error| told(&error))
        })
    }

    /// A multipart upload, or what was said against it.
    pub(super) fn parts(&self) -> io::Result<Box<dyn object_store::MultipartUpload>> {
        let (bucket, key) = (Arc::clone(&self.bucket), self.key.clone());
        wait(async move { bucket.store.put_multipart(&key).await }).map_err(|error| told(&error))
    }
}

/// Waits for a step of an upload.
pub(super) fn done<T: Send + 'static>(
    step: impl Future<Output = object_store::Result<T>> + Send + 'static,
) -> io::Result<T> {
    wait(step).map_err(|error| told(&error))
}

fn meta_of(object: &ObjectMeta) -> Meta {
    let tag = object.e_tag.clone().or_else(|| object.version.clone());
    Meta { bytes: object.size, changed: object.last_modified.to_rfc3339(), tag }
}
