//! Bytes in blocks, each with a checksum of its own, so that a part of a file can be read and trusted without the rest.
//!
//! A block is 2¹⁶ bytes of content, the last one fewer, and a SHA-256: of the block's number (u64, little-endian), of
//! the sum of the first block (zeros in that one) and of the content. A file that mixes blocks
//! of two files is refused, because their first blocks differ.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek, Take, Write};

use sha2::{Digest, Sha256};

use crate::parallel;

/// Bytes of content in a block.
pub(super) const BLOCK: usize = 1 << 16;

/// Bytes of a checksum.
pub(super) const SUM: usize = 32;

/// Blocks that are read or written, and summed side by side, at once.
const AT_ONCE: usize = 16;

/// Blocks that a thread sums, at least: the calling thread sums fewer than twice as many alone, so that small reads do
/// not wait for threads that cluster meanwhile.
const FEW: usize = 2;

/// Length of a file, from the length of its content.
pub(super) fn framed(content: u128) -> u128 {
    content + content.div_ceil(BLOCK as u128) * SUM as u128
}

/// A checksum.
type Sum = [u8; SUM];

/// The checksum of a block; `first` is that of the first block.
fn sum(number: u64, first: &Sum, content: &[u8]) -> Sum {
    let first = if number == 0 { &[0; SUM] } else { first };
    Sha256::new().chain_update(number.to_le_bytes()).chain_update(first).chain_update(content).finalize().into()
}

/// What hierarchies are read from: front to back, some of it left out.
pub trait Input: Read {
    /// Leaves out the next bytes; by reading them where nothing better is known.
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        match io::copy(&mut self.take(bytes), &mut io::sink())? == bytes {
            true => Ok(()),
            false => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }
}

impl Input for File {
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        self.seek_relative(i64::try_from(bytes).map_err(io::Error::other)?)
    }
}

impl Input for Take<File> {
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        self.set_limit(self.limit().saturating_sub(bytes));
        self.get_mut().skip(bytes)
    }
}

impl<T: AsRef<[u8]>> Input for Cursor<T> {
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        self.seek_relative(i64::try_from(bytes).map_err(io::Error::other)?)
    }
}

impl Input for &[u8] {}

impl<T: Input + ?Sized> Input for Box<T> {
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        (**self).skip(bytes)
    }
}

/// Why content cannot be given.
#[derive(Debug)]
pub(super) enum Unreadable {
    /// It cannot be read.
    Io(io::Error),
    /// It is not what was written.
    Damaged,
}

impl From<io::Error> for Unreadable {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Reads content, block after block, and compares the checksums of all that it gives.
#[derive(Debug)]
pub(super) struct BlockReader<R> {
    from: R,
    /// Bytes of the file, checksums included, that were not read yet.
    left: u64,
    /// The next block of the file.
    next: u64,
    /// The checksum of the first block, once that was read.
    first: Sum,
    raw: Vec<u8>,
    /// Content that was read and checked; of it, so much was given.
    content: Vec<u8>,
    given: usize,
}

impl<R: Input> BlockReader<R> {
    /// For a file of `length` bytes.
    pub fn new(from: R, length: u64) -> Self {
        Self { from, left: length, next: 0, first: [0; SUM], raw: Vec::new(), content: Vec::new(), given: 0 }
    }

    /// The first bytes of the file, before anything is known of it and checked; as many as there are, up to N.
    pub fn peek<const N: usize>(&mut self) -> io::Result<&[u8]> {
        if self.raw.is_empty() {
            let length = self.left.min((BLOCK + SUM) as u64) as usize;
            self.raw.resize(length, 0);
            self.from.read_exact(&mut self.raw)?;
        }
        Ok(&self.raw[..self.raw.len().min(N)])
    }

    /// Reads and checks as many blocks more, what was not given yet in front of them.
    fn load(&mut self, blocks: usize) -> Result<(), Unreadable> {
        self.content.drain(..self.given);
        self.given = 0;
        let length = self.left.min((blocks * (BLOCK + SUM)) as u64) as usize;
        let peeked = self.raw.len();
        self.raw.resize(length.max(peeked), 0);
        self.from.read_exact(&mut self.raw[peeked..])?;
        self.left -= self.raw.len() as u64;
        if self.next == 0 {
            let first = self.raw.chunks(BLOCK + SUM).next().and_then(|block| block.last_chunk());
            self.first = *first.ok_or(Unreadable::Damaged)?;
        }
        let blocks: Vec<&[u8]> = self.raw.chunks(BLOCK + SUM).collect();
        let is_damaged = |nth: usize| {
            let split = blocks[nth].split_last_chunk::<SUM>();
            split.is_none_or(|(content, stated)| sum(self.next + nth as u64, &self.first, content) != *stated)
        };
        if parallel::any(blocks.len(), FEW, &|mut range| range.any(is_damaged)) {
            return Err(Unreadable::Damaged);
        }
        for block in self.raw.chunks(BLOCK + SUM) {
            self.content.extend_from_slice(&block[..block.len() - SUM]);
            self.next += 1;
        }
        self.raw.clear();
        Ok(())
    }

    /// The next bytes: at least `least` of them, which the file has, and at most `most`.
    pub fn some(&mut self, least: usize, most: usize) -> Result<&[u8], Unreadable> {
        while self.content.len() - self.given < least {
            if self.left == 0 {
                return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
            }
            let missing = most - (self.content.len() - self.given);
            self.load(missing.div_ceil(BLOCK).clamp(1, AT_ONCE))?;
        }
        let length = (self.content.len() - self.given).min(most);
        let start = self.given;
        self.given += length;
        Ok(&self.content[start..start + length])
    }

    /// Gives bytes back that [`some`](Self::some) gave last.
    pub fn give_back(&mut self, bytes: usize) {
        self.given -= bytes;
    }

    /// Leaves out the next bytes. Blocks of which nothing is given are not read.
    pub fn skip(&mut self, bytes: u64) -> Result<(), Unreadable> {
        debug_assert!(self.raw.is_empty() || bytes < BLOCK as u64, "what was peeked at would be lost");
        let held = (self.content.len() - self.given) as u64;
        if bytes <= held {
            self.given += bytes as usize;
            return Ok(());
        }
        self.content.clear();
        self.given = 0;
        let beyond = bytes - held;
        let (blocks, within) = (beyond / BLOCK as u64, (beyond % BLOCK as u64) as usize);
        let whole = blocks.saturating_mul((BLOCK + SUM) as u64).min(self.left);
        self.from.skip(whole)?;
        self.left -= whole;
        self.next += blocks;
        if within > 0 {
            self.some(within, within)?;
        }
        Ok(())
    }
}

/// Writes content in blocks.
pub(super) struct BlockWriter<'a> {
    out: &'a mut dyn Write,
    next: u64,
    first: Sum,
    content: Vec<u8>,
}

impl<'a> BlockWriter<'a> {
    pub fn new(out: &'a mut dyn Write) -> Self {
        Self { out, next: 0, first: [0; SUM], content: Vec::with_capacity(AT_ONCE * BLOCK) }
    }

    pub fn put(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while self.content.len() + bytes.len() >= AT_ONCE * BLOCK {
            let (now, later) = bytes.split_at(AT_ONCE * BLOCK - self.content.len());
            self.content.extend_from_slice(now);
            self.pass_on()?;
            bytes = later;
        }
        self.content.extend_from_slice(bytes);
        Ok(())
    }

    fn pass_on(&mut self) -> io::Result<()> {
        if let (0, Some(content)) = (self.next, self.content.chunks(BLOCK).next()) {
            self.first = sum(0, &self.first, content);
        }
        let blocks: Vec<&[u8]> = self.content.chunks(BLOCK).collect();
        let of_block = |nth| sum(self.next + nth as u64, &self.first, blocks[nth]);
        let sums: Vec<Sum> = parallel::map(blocks.len(), 1, of_block);
        for (content, sum) in self.content.chunks(BLOCK).zip(&sums) {
            self.out.write_all(content)?;
            self.out.write_all(sum)?;
        }
        self.next += sums.len() as u64;
        self.content.clear();
        Ok(())
    }

    /// Writes the last block.
    pub fn finish(mut self) -> io::Result<()> {
        self.pass_on()
    }
}
