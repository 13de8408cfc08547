//! Arrays of Python as slices and numbers.
//!
//! `tesserae_mesh/_mesh.py` brings arrays into the layouts that are read here; what has another layout is an error.

use numpy::ndarray::Axis;
use numpy::{Element, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::prelude::*;
use tesserae_mesh::mesh::{Faces, Positions};
use tesserae_mesh::{Error, Result};

use crate::error::{exception, raised};

/// The points of an array of shape (N, 3), which is not copied.
pub struct Points {
    /// Keeps the memory.
    _array: Py<PyAny>,
    numbers: Numbers,
}

enum Numbers {
    Double(*const [f64; 3], usize),
    Single(*const [f32; 3], usize),
}

// SAFETY: the pointers are those of an array that `_array` keeps alive, and are only read. A program that writes to the
// array meanwhile, or frees its memory by `resize(refcheck=False)`, breaks a rule of NumPy's: results are then
// undefined there, too.
#[expect(unsafe_code, reason = "work on other threads reads the array")]
unsafe impl Send for Points {}

impl Points {
    /// Takes an array that is contiguous, aligned, and of f32 or f64.
    pub fn of(array: &Bound<'_, PyAny>) -> PyResult<Self> {
        let refused = || exception(array.py(), &Error::mesh("points must be a contiguous array of floats (N, 3)"));
        let numbers = if let Ok(array) = array.cast::<PyArray2<f64>>() {
            rows(array).map(|(first, rows)| Numbers::Double(first, rows))
        } else {
            array.cast::<PyArray2<f32>>().ok().and_then(rows).map(|(first, rows)| Numbers::Single(first, rows))
        };
        Ok(Self { _array: array.clone().unbind(), numbers: numbers.ok_or_else(refused)? })
    }

    /// The points.
    #[expect(unsafe_code, reason = "the array is borrowed for longer than the interpreter's lock is held")]
    pub fn positions(&self) -> Positions<'_> {
        match self.numbers {
            // SAFETY: `rows` checked length, layout and alignment, and `_array` keeps the memory.
            Numbers::Double(first, rows) => Positions::Double(unsafe { std::slice::from_raw_parts(first, rows) }),
            // SAFETY: as above.
            Numbers::Single(first, rows) => Positions::Single(unsafe { std::slice::from_raw_parts(first, rows) }),
        }
    }
}

/// The first row and the number of rows, of a contiguous and aligned array of three columns.
fn rows<T: Element>(array: &Bound<'_, PyArray2<T>>) -> Option<(*const [T; 3], usize)> {
    let first: *const [T; 3] = array.data().cast();
    let fits = array.shape()[1] == 3 && array.is_c_contiguous() && first.is_aligned() && !first.is_null();
    fits.then(|| (first, array.shape()[0]))
}

/// The faces of an array (F, n) of corners, or with offsets, of one dimension. Corners become u32.
pub fn faces(connectivity: &Bound<'_, PyAny>, offsets: Option<&Bound<'_, PyAny>>) -> PyResult<Faces> {
    let py = connectivity.py();
    let numbers = integers(connectivity, "corners")?;
    let Some(offsets) = offsets else {
        let width = match numbers.shape[..] {
            [_, width] if width > 0 => width,
            _ => return Err(exception(py, &Error::mesh("corners must be an array of shape (F, n)"))),
        };
        return Ok(py.detach(|| match width {
            3 => Faces::from_triangles(numbers.values),
            _ => polygons(numbers.values.chunks(width)),
        }));
    };
    let offsets = integers(offsets, "offsets")?.values;
    py.detach(|| {
        let ranges = offsets.windows(2).enumerate();
        for (face, pair) in ranges {
            if pair[0] >= pair[1] || pair[1] as usize > numbers.values.len() {
                return Err(Error::mesh(format_args!(
                    "face {face} has no corners, or more than there are: offsets {} and {}",
                    pair[0], pair[1]
                )));
            }
        }
        Ok(polygons(offsets.windows(2).map(|pair| &numbers.values[pair[0] as usize..pair[1] as usize])))
    })
    .map_err(|error| exception(py, &error))
}

fn polygons<'a>(corners: impl ExactSizeIterator<Item = &'a [u32]>) -> Faces {
    let mut faces = Faces::with_capacity(corners.len());
    corners.for_each(|corners| faces.push(corners));
    faces
}

/// Integers of an array of any shape, as u32.
struct Integers {
    values: Vec<u32>,
    shape: Vec<usize>,
}

fn integers(array: &Bound<'_, PyAny>, what: &str) -> PyResult<Integers> {
    macro_rules! of_type {
        ($($integer:ty),*) => {
            $(if let Ok(array) = array.cast::<PyArrayDyn<$integer>>() {
                return raised(array.py(), converted(array, what));
            })*
        };
    }
    of_type!(i64, i32, u32, u64);
    Err(exception(array.py(), &Error::mesh(format_args!("{what} must be an array of integers"))))
}

/// The numbers of an array in its order. One below 0 or above the largest u32 is refused with its place.
fn converted<T>(array: &Bound<'_, PyArrayDyn<T>>, what: &str) -> Result<Integers>
where
    T: Element + Copy + TryInto<u32> + std::fmt::Display + Sync,
{
    let py = array.py();
    let borrowed = array.try_readonly().map_err(|error| Error::mesh(format_args!("{what} cannot be read: {error}")))?;
    let view = borrowed.as_array();
    let shape = view.shape().to_vec();
    let values = py.detach(|| match view.as_slice() {
        Some(values) => all_u32(values.iter()),
        None => all_u32(view.iter()),
    });
    match values {
        Some(values) => Ok(Integers { values, shape }),
        None => {
            let at = view.iter().position(|&value| TryInto::<u32>::try_into(value).is_err()).unwrap_or_default();
            let width = view.len_of(Axis(view.ndim().saturating_sub(1))).max(1);
            let (row, value) = (at / width, view.iter().nth(at));
            let value = value.map_or(String::new(), T::to_string);
            Err(Error::mesh(match shape.len() {
                2 => format!("face {row} has a corner that is no point: {value}"),
                _ => format!("element {at} of the {what} is no number of a point or corner: {value}"),
            }))
        }
    }
}

/// The numbers as u32, if all are. Two passes without branches take less time than one that ends at a wrong number.
fn all_u32<'a, T: Copy + TryInto<u32> + 'a>(numbers: impl Iterator<Item = &'a T> + Clone) -> Option<Vec<u32>> {
    let number = |&number: &T| number.try_into().ok();
    let are_all = numbers.clone().fold(true, |are_all, value| are_all & number(value).is_some());
    are_all.then(|| numbers.map(|value| number(value).unwrap_or_default()).collect())
}

/// One u32 a face.
pub fn labels(array: &Bound<'_, PyArray1<u32>>) -> PyResult<Vec<u32>> {
    Ok(array.try_readonly()?.as_array().to_vec())
}

/// An array of whole numbers, made here.
type Made<'py> = Bound<'py, PyArray1<i64>>;

/// Offsets and corners of VTK's padded array, `[n, i, j, …, n, …]`.
#[pyfunction]
pub fn unpad<'py>(py: Python<'py>, padded: PyReadonlyArray1<'py, i64>) -> PyResult<(Made<'py>, Made<'py>)> {
    let view = padded.as_array();
    let (connectivity, offsets) = raised(py, py.detach(|| unpadded(view.iter().copied())))?;
    Ok((PyArray1::from_vec(py, connectivity), PyArray1::from_vec(py, offsets)))
}

fn unpadded(mut numbers: impl ExactSizeIterator<Item = i64>) -> Result<(Vec<i64>, Vec<i64>)> {
    let (mut corners, mut offsets) = (Vec::with_capacity(numbers.len()), vec![0]);
    while let Some(count) = numbers.next() {
        let count =
            usize::try_from(count).ok().filter(|count| (1..=numbers.len()).contains(count)).ok_or_else(|| {
                Error::mesh(format_args!(
                    "face {} of the padded array has no corners, or more than are left: {count}",
                    offsets.len() - 1
                ))
            })?;
        corners.extend(numbers.by_ref().take(count));
        offsets.push(corners.len() as i64);
    }
    Ok((corners, offsets))
}
