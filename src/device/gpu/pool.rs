//! Buffers that surfaces left, for the next ones: each new one is an allocation of the driver's, and wgpu clears it. On
//! llvmpipe, whose memory is the host's, bringing small surfaces there takes the same with and without; no card was at hand.
//!
//! A job opens several surfaces, coarse ones before its own, and the next job the like: so what one has no use for is kept for a
//! while. What was brought ahead of its turn (`ahead.rs`) waits here, too; its buffers and those of the surface that is open
//! take turns.
//!
//! What is in them is from another job. A buffer is read only where it was written for this surface, or cleared (see
//! [`Buffers::new`](super::buffers::Buffers::new)); a test fills them with garbage in between. No client can read them.

use super::fixed::Fixed;

/// Bytes that are kept at most: the buffers of a flat clustering of nearly 4 million faces, or of a hierarchy of a million. Of a
/// surface that needed more, nothing is kept.
const MOST_KEPT: u64 = 256 << 20;

/// Surfaces that wait at most: that of the job at the device, which may be at coarser ones still, and that of the next.
const MOST_AHEAD: usize = 2;

/// How many surfaces may be opened without a use for a buffer before it is freed: those of a few jobs.
const KEPT_FOR: u64 = 32;

/// A buffer.
#[derive(Debug)]
struct Pooled {
    /// What it is for.
    what: &'static str,
    buffer: wgpu::Buffer,
    /// Surfaces that had been opened when it was last used.
    used: u64,
}

/// Buffers by what they are for.
#[derive(Debug, Default)]
pub(super) struct Pool {
    /// Those that nobody uses; what came back last is last.
    spare: Vec<Pooled>,
    /// Those of the surface that is open.
    lent: Vec<Pooled>,
    /// Surfaces that have been opened.
    opened: u64,
    /// What the host reads through, unless it is reading. Grows with what is read.
    for_host: Option<wgpu::Buffer>,
    /// What was brought of surfaces that are not open yet, and their numbers, ascending.
    ahead: Vec<(u64, Fixed)>,
    /// Number of what was brought last.
    last: u64,
}

/// Whether a buffer of `size` bytes may serve for `needed` bytes: not if more than half of it would lie idle.
fn suits(size: u64, needed: u64) -> bool {
    (needed..=2 * needed).contains(&size)
}

impl Pool {
    /// A buffer for something, if one was left that suits: the smallest.
    pub fn take(&mut self, what: &'static str, needed: u64) -> Option<wgpu::Buffer> {
        let suit = self.spare.iter().enumerate().filter(|(_, spare)| {
            let size = spare.buffer.size();
            spare.what == what && suits(size, needed)
        });
        let (at, _) = suit.min_by_key(|(_, spare)| spare.buffer.size())?;
        Some(self.spare.remove(at).buffer)
    }

    /// Notes that a surface uses a buffer.
    pub fn lend(&mut self, what: &'static str, buffer: &wgpu::Buffer) {
        self.lent.push(Pooled { what, buffer: buffer.clone(), used: self.opened });
    }

    /// Notes that a surface was opened; frees what none had a use for in a long time.
    pub fn surface_opened(&mut self) {
        self.opened += 1;
        self.spare.retain(|spare| spare.used + KEPT_FOR > self.opened);
    }

    /// Frees everything. Only while no surface is open.
    pub fn free_all(&mut self) {
        *self = Self { opened: self.opened, last: self.last, ..Self::default() };
    }

    /// Frees what nobody uses, and what was brought ahead.
    pub fn free_unused(&mut self) {
        self.spare.clear();
        self.ahead.clear();
        self.for_host = None;
    }

    /// Keeps what was brought of a surface ahead of its turn, instead of the oldest where that makes too many; gives its number.
    pub fn keep_ahead(&mut self, fixed: Fixed) -> u64 {
        if self.ahead.len() == MOST_AHEAD {
            self.ahead.remove(0);
        }
        self.last += 1;
        self.ahead.push((self.last, fixed));
        self.last
    }

    /// What was brought ahead under a number, if it is still here.
    pub fn take_ahead(&mut self, number: u64) -> Option<Fixed> {
        let at = self.ahead.iter().position(|(kept, _)| *kept == number)?;
        Some(self.ahead.remove(at).1)
    }

    /// Takes back what the surface used that is being closed. What came back longest ago is freed where that makes too much.
    pub fn take_back(&mut self) {
        let mut returned = std::mem::take(&mut self.lent);
        let mut for_host = self.for_host.as_ref().map_or(0, wgpu::Buffer::size);
        if bytes(&returned) + for_host > MOST_KEPT {
            (returned, self.for_host, for_host) = Default::default();
        }
        self.spare.append(&mut returned);
        let mut surplus = (bytes(&self.spare) + for_host).saturating_sub(MOST_KEPT);
        let freed = self.spare.iter().take_while(|spare| {
            let is_surplus = surplus > 0;
            surplus = surplus.saturating_sub(spare.buffer.size());
            is_surplus
        });
        let freed = freed.count();
        self.spare.drain(..freed);
    }

    /// The buffer that the host reads through, if it is there and large enough. It comes back by
    /// [`keep_for_host`](Self::keep_for_host), unmapped.
    pub fn take_for_host(&mut self, needed: u64) -> Option<wgpu::Buffer> {
        self.for_host.take().filter(|buffer| buffer.size() >= needed)
    }

    /// Keeps the buffer that the host has read through.
    pub fn keep_for_host(&mut self, buffer: wgpu::Buffer) {
        self.for_host = Some(buffer);
    }

    /// What was brought ahead last.
    #[cfg(test)]
    pub fn ahead(&self) -> Option<&Fixed> {
        self.ahead.last().map(|(_, fixed)| fixed)
    }

    /// Whether a surface that is open uses a buffer.
    #[cfg(test)]
    pub fn lends(&self, buffer: &wgpu::Buffer) -> bool {
        self.lent.iter().any(|lent| lent.buffer == *buffer)
    }

    /// The buffer that the host reads through, unless it is reading.
    #[cfg(test)]
    pub fn for_host(&self) -> Option<&wgpu::Buffer> {
        self.for_host.as_ref()
    }

    /// Those that nobody uses.
    pub fn spare(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.spare.iter().map(|spare| &spare.buffer).chain(&self.for_host)
    }
}

fn bytes(buffers: &[Pooled]) -> u64 {
    buffers.iter().map(|pooled| pooled.buffer.size()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_serves_again_unless_most_of_it_would_lie_idle() {
        for (size, needed, expected) in [(99, 100, false), (100, 100, true), (200, 100, true), (201, 100, false)] {
            assert_eq!(suits(size, needed), expected, "{size} for {needed}");
        }
    }
}
