//! Which clusters gained or lost a face, for five readers that each act on it in their own time.

/// The readers of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cursor {
    /// Fits proxies.
    Proxies,
    /// The boundary phase.
    Boundary,
    /// Refinement.
    Refinement,
    /// The search for pieces; only clusters that may be in several are pending.
    Pieces,
    /// The queue of all dual edges.
    DualEdges,
}

const CURSORS: usize = 5;

/// One bit for each cursor.
const ALL: u8 = (1 << CURSORS) - 1;

impl Cursor {
    fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// The changed clusters that each reader has not yet taken.
#[derive(Debug)]
pub struct ChangeLog {
    pending: [Vec<u32>; CURSORS],
    /// One bit a cursor: whether the cluster is pending there.
    is_pending: Vec<u8>,
    /// One bit a cursor: whether it has never taken anything. All clusters are pending there, and its list stays empty.
    is_untouched: u8,
}

impl ChangeLog {
    /// For `clusters` clusters, all of them changed.
    pub fn all(clusters: usize) -> Self {
        Self { pending: Default::default(), is_pending: vec![0; clusters], is_untouched: ALL }
    }

    /// A cluster gained or lost a face. Whether it may be in pieces is noted separately.
    pub fn changed(&mut self, cluster: u32) {
        self.add(cluster, ALL & !Cursor::Pieces.bit());
    }

    /// A cluster may be in pieces.
    pub fn may_be_in_pieces(&mut self, cluster: u32) {
        self.add(cluster, Cursor::Pieces.bit());
    }

    /// Whether a cluster is known to be in one piece.
    pub fn is_connected(&self, cluster: u32) -> bool {
        (self.is_pending[cluster as usize] | self.is_untouched) & Cursor::Pieces.bit() == 0
    }

    /// A cluster was merged into another. If both are in one piece, so is the union; if pieces of either are pending,
    /// they are of the union. A cluster that ended needs no proxy.
    pub fn merged(&mut self, into: u32, from: u32) {
        let pieces = Cursor::Pieces.bit();
        self.add(from, ALL & !(pieces | Cursor::Proxies.bit()));
        self.add(into, ALL & !pieces | self.is_pending[from as usize] & pieces);
    }

    fn add(&mut self, cluster: u32, cursors: u8) {
        let mut new = cursors & !self.is_untouched & !self.is_pending[cluster as usize];
        self.is_pending[cluster as usize] |= new;
        while new != 0 {
            self.pending[new.trailing_zeros() as usize].push(cluster);
            new &= new - 1;
        }
    }

    /// The changed clusters that are pending for a cursor, ascending: clusters with close numbers lie close together,
    /// so that visits go through memory in order.
    pub fn take(&mut self, cursor: Cursor) -> Vec<u32> {
        let bit = cursor.bit();
        if self.is_untouched & bit != 0 {
            self.is_untouched &= !bit;
            return (0..self.is_pending.len() as u32).collect();
        }
        let listed = &mut self.pending[cursor as usize];
        listed.sort_unstable();
        listed.iter().for_each(|&cluster| self.is_pending[cluster as usize] &= !bit);
        // a copy, so that the list keeps its room
        let pending = listed.clone();
        listed.clear();
        pending
    }
}
