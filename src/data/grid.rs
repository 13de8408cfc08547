//! Grids of 2 or 3 dimensions: neighbours by place, and the order along a Morton curve.

use super::members::Members;

/// A grid whose members are neighbours by their places.
#[derive(Debug)]
pub struct Grid<'a> {
    /// The length of each dimension; the first is 1 in a grid of 2 dimensions.
    shape: [u32; 3],
    /// Ways to the neighbours, in the order of their numbers.
    ways: Vec<[i32; 3]>,
    members: &'a Members,
}

impl<'a> Grid<'a> {
    /// A grid of 2 or 3 dimensions; in a full one corners count, too.
    pub fn new(shape: &[usize], full: bool, members: &'a Members) -> Self {
        let mut three = [1; 3];
        three.iter_mut().rev().zip(shape.iter().rev()).for_each(|(length, &given)| *length = given as u32);
        let is_flat = shape.len() < 3;
        let each = |way: i32| [way / 9 - 1, way / 3 % 3 - 1, way % 3 - 1];
        let ways = (0..27).map(each).filter(|way| {
            let steps: i32 = way.iter().map(|step| step.abs()).sum();
            steps > 0 && (full || steps == 1) && !(is_flat && way[0] != 0)
        });
        Self { shape: three, ways: ways.collect(), members }
    }

    /// Puts the neighbours of a member into a list, in ascending order.
    pub fn list(&self, member: u32, into: &mut Vec<u32>) {
        let [_, rows, columns] = self.shape;
        let item = self.members.item(member);
        let place = [item / columns / rows, item / columns % rows, item % columns];
        into.extend(self.ways.iter().filter_map(|way| {
            let mut other = 0;
            for axis in 0..3 {
                let at = place[axis].checked_add_signed(way[axis]).filter(|&at| at < self.shape[axis])?;
                other = other * self.shape[axis] + at;
            }
            self.members.member(other)
        }));
    }

    /// The members along a Morton curve through their places, the last dimension fastest.
    pub fn along_curve(&self) -> Vec<u32> {
        let longest = self.shape.into_iter().max().unwrap_or(1);
        let mut order = Vec::with_capacity(self.members.len());
        self.walk([0; 3], longest.next_power_of_two(), &mut order);
        order
    }

    /// Takes the part of the grid in a cube, half by half. A cube outside the grid is not entered, so that there are at
    /// most some 2 cubes an item.
    fn walk(&self, corner: [u32; 3], size: u32, order: &mut Vec<u32>) {
        if size == 1 {
            let [_, rows, columns] = self.shape;
            order.extend(self.members.member((corner[0] * rows + corner[1]) * columns + corner[2]));
            return;
        }
        let half = size / 2;
        for part in 0..8 {
            let inner =
                [corner[0] + (part >> 2) * half, corner[1] + (part >> 1 & 1) * half, corner[2] + (part & 1) * half];
            if (0..3).all(|axis| inner[axis] < self.shape[axis]) {
                self.walk(inner, half, order);
            }
        }
    }
}
