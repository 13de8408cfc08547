//! Buffers that the last surface left, for the next one: each new one is an allocation of the driver's, and wgpu clears it. On
//! llvmpipe, whose memory is the host's, bringing small surfaces there takes the same with and without; no card was at hand.
//!
//! What was brought ahead of its turn (`ahead.rs`) waits here, too. When its surface is opened, the buffers of the last one that it
//! has made superfluous stay for the next that is brought ahead: two take turns.
//!
//! What is in them is from another job. A buffer is read only where it was written for this surface, or cleared (see
//! [`Buffers::new`](super::buffers::Buffers::new)); a test fills them with garbage in between. No client can read them.

use std::collections::BTreeMap;

use super::fixed::Fixed;

/// Bytes that are kept at most: the buffers of a flat clustering of nearly 4 million faces, or of a hierarchy of a million. Where
/// a surface needed more, nothing is kept.
const MOST_KEPT: u64 = 256 << 20;

/// Buffers by what they are for.
#[derive(Debug, Default)]
pub(super) struct Pool {
    /// Those that nobody uses.
    spare: BTreeMap<&'static str, wgpu::Buffer>,
    /// Those of the surface that is open.
    lent: BTreeMap<&'static str, wgpu::Buffer>,
    /// What the host reads through, unless it is reading. Grows with what is read.
    for_host: Option<wgpu::Buffer>,
    /// What was brought of a surface that is not open yet, and its number.
    ahead: Option<(u64, Fixed)>,
    /// Number of what was brought last.
    last: u64,
}

/// Whether a buffer of `size` bytes may serve for `needed` bytes: not if more than half of it would lie idle.
fn suits(size: u64, needed: u64) -> bool {
    (needed..=2 * needed).contains(&size)
}

impl Pool {
    /// A buffer for something, if the last surface left one that suits. Otherwise that one is freed, before another is made.
    pub fn take(&mut self, what: &'static str, needed: u64) -> Option<wgpu::Buffer> {
        self.spare.remove(what).filter(|buffer| suits(buffer.size(), needed))
    }

    /// Notes that a surface uses a buffer.
    pub fn lend(&mut self, what: &'static str, buffer: &wgpu::Buffer) {
        self.lent.insert(what, buffer.clone());
    }

    /// Frees what the surface that was opened has no use for; not what the next that is brought ahead may have.
    pub fn drop_spare(&mut self) {
        self.spare.retain(|what, _| Fixed::NAMES.contains(what));
    }

    /// Frees everything. Only while no surface is open.
    pub fn free_all(&mut self) {
        *self = Self { last: self.last, ..Self::default() };
    }

    /// Keeps what was brought of a surface ahead of its turn, instead of what was before; gives its number.
    pub fn keep_ahead(&mut self, fixed: Fixed) -> u64 {
        self.last += 1;
        self.ahead = Some((self.last, fixed));
        self.last
    }

    /// Frees what was brought ahead; whether there was anything.
    pub fn give_up_ahead(&mut self) -> bool {
        self.ahead.take().is_some()
    }

    /// What was brought ahead under a number, if it is still here.
    pub fn take_ahead(&mut self, number: u64) -> Option<Fixed> {
        self.ahead.take_if(|(kept, _)| *kept == number).map(|(_, fixed)| fixed)
    }

    /// Takes back what the surface used that is being closed, or could not be opened.
    pub fn take_back(&mut self) {
        if self.lent.is_empty() {
            return;
        }
        let lent = std::mem::take(&mut self.lent);
        let bytes: u64 = lent.values().chain(&self.for_host).map(wgpu::Buffer::size).sum();
        if bytes <= MOST_KEPT {
            self.spare = lent;
        } else {
            (self.spare, self.for_host) = Default::default();
        }
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

    /// What was brought ahead.
    #[cfg(test)]
    pub fn ahead(&self) -> Option<&Fixed> {
        self.ahead.as_ref().map(|(_, fixed)| fixed)
    }

    /// The buffer that the host reads through, unless it is reading.
    #[cfg(test)]
    pub fn for_host(&self) -> Option<&wgpu::Buffer> {
        self.for_host.as_ref()
    }

    /// Those that nobody uses.
    pub fn spare(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.spare.values().chain(&self.for_host)
    }
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
