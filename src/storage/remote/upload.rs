//! Local files to objects, in parts where they are large.

use std::fs::File;
use std::io;

use object_store::PutPayload;

use super::client::{Place, Room, done};
use super::{BUFFERS, Put};
use crate::system::FileAt;

/// Bytes of a part, and the most parts that stores take, less some.
const PART: u64 = 8 << 20;
const PARTS: u64 = 9_000;

impl Place {
    /// Puts the first `length` bytes of a file there, whole or not at all. Small ones are created in one request, which fails if something is there; with larger ones it is
    /// looked at before the last.
    ///
    /// # Errors
    /// `AlreadyExists` if another object is there, and is not to be replaced; those of reading the file; what the store says.
    pub fn upload(&self, file: &File, length: u64, put: Put) -> io::Result<()> {
        let part = PART.max(length.div_ceil(PARTS));
        let read = |from: u64| -> io::Result<Vec<u8>> {
            let mut bytes = vec![0; (length - from).min(part) as usize];
            file.read_exact_at(&mut bytes, from)?;
            Ok(bytes)
        };
        // What is sent, and a copy of it that the client may make.
        let _room = Room::of((2 * length.min(part)).min(BUFFERS));
        if length <= part {
            return self.put(&read(0)?, put);
        }
        let mut upload = self.parts()?;
        let sent = (|| {
            for number in 0..length.div_ceil(part) {
                done(upload.put_part(PutPayload::from(read(number * part)?)))?;
            }
            let is_free = || match self.look() {
                Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(true),
                looked => looked.map(|_| false),
            };
            if put == Put::Create && !is_free()? {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
            Ok(())
        })();
        match sent {
            Ok(()) => done(async move { upload.complete().await.map(drop) }),
            Err(error) => {
                // What stays of it costs room: stores can be told to remove it after a time.
                let _ = done(async move { upload.abort().await });
                Err(error)
            }
        }
    }
}
