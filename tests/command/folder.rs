//! A folder of its own for every test, and the program run in it.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

/// A folder that goes when the test does.
pub struct Folder(tempfile::TempDir);

/// What the program answered.
pub struct Answer {
    /// Exit code; -1 if a signal ended it.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Folder {
    pub fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub fn make(&self, name: &str) {
        std::fs::create_dir(self.path(name)).unwrap();
    }

    /// The names in it, the hidden ones too.
    pub fn names(&self, below: &str) -> BTreeSet<String> {
        let entries = std::fs::read_dir(self.path(below)).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    /// The program with the words of `line` as arguments, not yet started.
    pub fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_asra-stream"));
        command.args(line.split_whitespace()).current_dir(self.0.path()).env_remove("TMPDIR");
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn run(&self, line: &str) -> Answer {
        Answer::of(self.command(line).output().unwrap())
    }

    /// Runs it; it must succeed.
    pub fn ok(&self, line: &str) -> Answer {
        let answer = self.run(line);
        assert_eq!(answer.code, 0, "{line}\n{}{}", answer.out, answer.err);
        answer
    }

    /// Runs it; it must fail with `code`, say all of `parts`, and leave no file behind.
    pub fn fails(&self, line: &str, code: i32, parts: &[&str]) -> Answer {
        let before = self.names("");
        let answer = self.run(line);
        assert_eq!(answer.code, code, "{line}\n{}{}", answer.out, answer.err);
        for part in parts {
            assert!(answer.err.contains(part), "{line}: {part:?} is not in\n{}", answer.err);
        }
        assert!(!answer.err.contains("panicked"), "{}", answer.err);
        assert_eq!(self.names(""), before, "{line}: files");
        answer
    }

    /// A small knot as `k.ply`, and its points.
    pub fn knot(&self, points: usize) -> Vec<[f32; 3]> {
        self.ok(&format!("generate knot {points} -o k.ply"));
        let bytes = self.read("k.ply");
        bytes[bytes.len() - points * 12..].chunks_exact(12).map(bytemuck::pod_read_unaligned).collect()
    }
}

impl Answer {
    pub fn of(output: Output) -> Answer {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Answer { code: output.status.code().unwrap_or(-1), out: text(output.stdout), err: text(output.stderr) }
    }
}

/// A binary PLY file.
pub fn ply(points: &[[f32; 3]]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    )
    .into_bytes();
    bytes.extend_from_slice(bytemuck::cast_slice(points));
    bytes
}

/// The points with a number after each, as many sensors write them.
pub fn with_intensity(points: &[[f32; 3]]) -> Vec<u8> {
    let records: Vec<[f32; 4]> = points.iter().map(|&[x, y, z]| [x, y, z, 0.5]).collect();
    bytemuck::cast_slice(&records).to_vec()
}

/// The points in another order, the same every time.
pub fn shuffled(points: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut out = points.to_vec();
    let mut state = 1u64;
    for i in (1..out.len()).rev() {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        out.swap(i, (state >> 33) as usize % (i + 1));
    }
    out
}
