//! Which clusters gained or lost a face since somebody last asked; for pieces, which may be in several.

/// Those who act on changes, each in its own time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reader {
    /// The fitting of proxies.
    Proxies,
    /// Boundary-based optimisation.
    Boundary,
    /// Refinement.
    Refinement,
    /// The search for pieces that were cut off. Who lets a face move says which clusters that may leave in pieces.
    Pieces,
    /// The search for the cheapest dual edge.
    DualEdges,
}

const READERS: usize = 5;

/// One bit for each reader.
const ALL: u8 = (1 << READERS) - 1;

/// The changed clusters that each reader has not yet seen.
#[derive(Debug)]
pub struct Changes {
    unseen: [Vec<u32>; READERS],
    /// One bit a reader: whether the cluster is in its list.
    is_unseen: Vec<u8>,
    /// One bit a reader: whether it has never asked. To it all is news, and its list stays empty.
    never_asked: u8,
}

impl Changes {
    /// For `clusters` clusters, all of them changed.
    pub fn all(clusters: usize) -> Self {
        Self { unseen: Default::default(), is_unseen: vec![0; clusters], never_asked: ALL }
    }

    /// A cluster gained or lost a face.
    pub fn changed(&mut self, cluster: u32) {
        self.add(cluster, ALL);
    }

    /// A cluster became part of another. Pieces that nobody has looked for yet go with it. What ended needs no proxy.
    pub fn merged(&mut self, into: u32, from: u32) {
        let (pieces, proxies) = (1 << Reader::Pieces as usize, 1 << Reader::Proxies as usize);
        let unseen = self.is_unseen[from as usize] & pieces;
        self.add(from, ALL & !(pieces | proxies));
        self.add(into, ALL & !pieces | unseen);
    }

    fn add(&mut self, cluster: u32, readers: u8) {
        let mut seen_by = readers & !self.never_asked & !self.is_unseen[cluster as usize];
        self.is_unseen[cluster as usize] |= seen_by;
        while seen_by != 0 {
            self.unseen[seen_by.trailing_zeros() as usize].push(cluster);
            seen_by &= seen_by - 1;
        }
    }

    /// The changed clusters that a reader has not seen, in ascending order: clusters with close numbers lie close
    /// together, so who visits them finds them in memory order. From now on it has seen them.
    pub fn take(&mut self, reader: Reader) -> Vec<u32> {
        if self.never_asked & 1 << reader as usize != 0 {
            self.never_asked &= !(1 << reader as usize);
            return (0..self.is_unseen.len() as u32).collect();
        }
        let mut unseen = std::mem::take(&mut self.unseen[reader as usize]);
        unseen.sort_unstable();
        for &cluster in &unseen {
            self.is_unseen[cluster as usize] &= !(1 << reader as usize);
        }
        unseen
    }
}
