//! The items that take part.

/// The items that take part, numbered from 0 on in upload order.
#[derive(Debug)]
pub struct Members {
    items: usize,
    /// With a mask: the item of each member, and the member that each item is.
    masked: Option<(Vec<u32>, Vec<u32>)>,
}

/// No member: of an item that takes no part.
const NO_MEMBER: u32 = u32::MAX;

impl Members {
    /// Those of a number of items that a mask names; all where there is none.
    pub fn new(items: usize, mask: Option<&[bool]>) -> Self {
        let masked = mask.filter(|mask| mask.contains(&false)).map(|mask| {
            let mut item_of = Vec::new();
            let member_of = (0..).zip(mask).map(|(item, &takes_part)| {
                if !takes_part {
                    return NO_MEMBER;
                }
                item_of.push(item);
                item_of.len() as u32 - 1
            });
            let member_of = member_of.collect();
            (item_of, member_of)
        });
        Self { items, masked }
    }

    /// Number of items, those that take no part included.
    pub fn items(&self) -> usize {
        self.items
    }

    /// How many there are.
    #[expect(clippy::len_without_is_empty, reason = "a set without members is refused")]
    pub fn len(&self) -> usize {
        self.masked.as_ref().map_or(self.items, |(item_of, _)| item_of.len())
    }

    /// The item that a member is.
    #[inline]
    pub fn item(&self, member: u32) -> u32 {
        self.masked.as_ref().map_or(member, |(item_of, _)| item_of[member as usize])
    }

    /// The member that an item is, if it takes part.
    #[inline]
    pub fn member(&self, item: u32) -> Option<u32> {
        match &self.masked {
            Some((_, member_of)) => Some(member_of[item as usize]).filter(|&member| member != NO_MEMBER),
            None => Some(item),
        }
    }
}
