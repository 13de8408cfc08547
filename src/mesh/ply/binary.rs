//! Rows as bytes, in either byte order.
//!
//! What the header declares is compared with the bytes that are there before anything is allocated: a row takes at
//! least the bytes of its single values and of the lengths of its lists. Rows without lists are found by
//! multiplication, rows with lists one after the other.

use super::header::{Element, Header, Property, shown};
use super::roles::Role;
use super::value::{Integer, Order};
use super::{Contents, fault};
use crate::error::{Error, Result};
use crate::mesh::polygons::Polygons;
use crate::parallel;

/// Vertices that a thread reads at once, at least.
const PIECE: usize = 1 << 14;

/// Fewest bytes that a row takes.
pub fn least_bytes(element: &Element<'_>) -> u64 {
    element.properties.iter().map(|property| property.count.unwrap_or(property.value).size() as u64).sum()
}

/// Refuses a file with fewer bytes than its header needs. Returns the bytes beyond those that it needs.
pub fn check(header: &Header<'_>, data: &[u8]) -> Result<u64> {
    let mut left = data.len() as u64;
    for element in &header.elements {
        let least = least_bytes(element);
        let needed = u128::from(element.rows) * u128::from(least);
        let enough = u64::try_from(needed).ok().and_then(|needed| left.checked_sub(needed));
        left = enough.ok_or_else(|| truncated(element, least, left))?;
    }
    Ok(left)
}

/// Reads all rows.
pub fn read(header: &Header<'_>, order: Order, roles: &[Role], vertices: u64, data: &[u8]) -> Result<Contents> {
    let polygons = header.elements.iter().zip(roles).filter(|(_, role)| matches!(role, Role::Polygons(_)));
    let triangles = polygons.map(|(element, _)| element.rows as usize).sum();
    let mut contents = Contents::new(vertices, triangles);
    let mut rows = Rows { rest: data, order };
    for (element, role) in header.elements.iter().zip(roles) {
        match *role {
            Role::Vertices(axes) => contents.positions = rows.positions(element, axes)?,
            Role::Polygons(list) => rows.lists(element, list, &mut contents.polygons, Polygons::polygon)?,
            Role::Strips(list) => rows.lists(element, list, &mut contents.polygons, Polygons::strip)?,
            Role::Skipped => rows.skip(element)?,
        }
    }
    if !rows.rest.is_empty() {
        contents.warning = Some(format!("bytes after the last row were ignored: {}", rows.rest.len()));
    }
    Ok(contents)
}

/// The rows that are left.
struct Rows<'a> {
    rest: &'a [u8],
    order: Order,
}

/// The values of a list as integers.
type Indices<'a> = std::iter::Map<std::slice::ChunksExact<'a, u8>, Integer>;

/// How the values of a property are found.
struct Column {
    /// Of a list: what reads the number of its values, and the bytes of that number.
    count: Option<(Integer, usize)>,
    /// Bytes of a value.
    size: usize,
}

impl<'a> Rows<'a> {
    /// Reads the positions of vertices, from these three properties.
    fn positions(&mut self, element: &Element<'_>, axes: [usize; 3]) -> Result<Vec<[f64; 3]>> {
        let read = axes.map(|axis| element.properties[axis].value.float(self.order));
        let mut positions = Vec::new();
        if has_lists(element) {
            self.each_row(element, |fields| {
                positions.push(std::array::from_fn(|axis| read[axis](fields[axes[axis]])));
                Ok(())
            })?;
        } else {
            let rows = self.take_rows(element)?;
            let stride = least_bytes(element) as usize;
            let bytes_before =
                |axis: usize| element.properties[..axis].iter().map(|property| property.value.size()).sum();
            let offsets: [usize; 3] = axes.map(bytes_before);
            positions = vec![[0.0; 3]; element.rows as usize];
            parallel::runs_mut(&mut positions, PIECE, &|first, positions| {
                for (position, row) in positions.iter_mut().zip(rows[first * stride..].chunks_exact(stride)) {
                    *position = std::array::from_fn(|axis| read[axis](&row[offsets[axis]..]));
                }
            });
        }
        let is_wrong = |position: &[f64; 3]| !position.iter().all(|coordinate| coordinate.is_finite());
        match parallel::first(positions.len(), PIECE, |row| is_wrong(&positions[row])) {
            None => Ok(positions),
            Some(row) => {
                let wrong = positions[row].into_iter().find(|coordinate| !coordinate.is_finite()).unwrap_or_default();
                Err(fault(element, row as u64, &format!("a coordinate is not finite: {wrong}")))
            }
        }
    }

    /// Reads the faces of an element, each row from the property `list`.
    fn lists(
        &mut self,
        element: &Element<'_>,
        list: usize,
        polygons: &mut Polygons,
        add: impl Fn(&mut Polygons, Indices<'a>) -> Result<(), String>,
    ) -> Result<()> {
        let value = element.properties[list].value;
        let indices = |bytes: &'a [u8], order| bytes.chunks_exact(value.size()).map(value.integer(order));
        let (order, other) = (self.order, self.order.other());
        self.each_row(element, |fields| {
            let bytes = fields[list];
            add(polygons, indices(bytes, order)).map_err(|message| match polygons.have(indices(bytes, other)) {
                true => format!("the bytes are probably in the other order (correct the format line): {message}"),
                false => message,
            })
        })
    }

    /// Leaves out the rows of an element.
    fn skip(&mut self, element: &Element<'_>) -> Result<()> {
        match has_lists(element) {
            true => self.each_row(element, |_| Ok(())),
            false => self.take_rows(element).map(drop),
        }
    }

    /// Takes the rows of an element without lists.
    fn take_rows(&mut self, element: &Element<'_>) -> Result<&'a [u8]> {
        let stride = least_bytes(element);
        let bytes = usize::try_from(element.rows.saturating_mul(stride)).unwrap_or(usize::MAX);
        let Some((rows, rest)) = self.rest.split_at_checked(bytes) else {
            return Err(truncated(element, stride, self.rest.len() as u64));
        };
        self.rest = rest;
        Ok(rows)
    }

    /// Takes the rows of an element one by one. `visit` gets the bytes of the values of each property.
    fn each_row(
        &mut self,
        element: &Element<'_>,
        mut visit: impl FnMut(&[&'a [u8]]) -> Result<(), String>,
    ) -> Result<()> {
        let column = |property: &Property<'_>| Column {
            count: property.count.map(|count| (count.integer(self.order), count.size())),
            size: property.value.size(),
        };
        let columns: Vec<Column> = element.properties.iter().map(column).collect();
        let mut fields = Vec::with_capacity(columns.len());
        for row in 0..element.rows {
            fields.clear();
            let visited = columns.iter().try_for_each(|column| self.take_field(column).map(|field| fields.push(field)));
            visited.and_then(|()| visit(&fields)).map_err(|message| fault(element, row, &message))?;
        }
        Ok(())
    }

    /// Takes the values of a property.
    #[inline]
    fn take_field(&mut self, column: &Column) -> Result<&'a [u8], String> {
        let count = match column.count {
            None => 1,
            Some((read, size)) => {
                let (bytes, rest) = self.rest.split_at_checked(size).ok_or_else(cut_off)?;
                self.rest = rest;
                let count = read(bytes);
                usize::try_from(count).map_err(|_| format!("a list has a negative number of values: {count}"))?
            }
        };
        // neither factor has more than 32 bits
        let Some((field, rest)) = self.rest.split_at_checked(count.saturating_mul(column.size)) else {
            return Err(match column.count {
                None => cut_off(),
                Some(_) => format!(
                    "the file is truncated or damaged: a list has {count} values of {} bytes, the file has {} bytes \
                     for it",
                    column.size,
                    self.rest.len()
                ),
            });
        };
        self.rest = rest;
        Ok(field)
    }
}

fn has_lists(element: &Element<'_>) -> bool {
    element.properties.iter().any(|property| property.count.is_some())
}

#[cold]
fn cut_off() -> String {
    "the file is truncated, so copy or write it again: it ends within this row".to_owned()
}

fn truncated(element: &Element<'_>, least: u64, left: u64) -> Error {
    Error::mesh(format_args!(
        "the PLY file is truncated, so copy or write it again: element {} has {} rows of at least {least} bytes, the \
         file has {left} bytes for it",
        shown(element.name),
        element.rows
    ))
}
