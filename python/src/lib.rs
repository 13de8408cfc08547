//! The extension module `tesserae_mesh._native`: the library, with NumPy's arrays for arguments and results.
//!
//! The Python package around it (`python/tesserae_mesh`) has the interface that users see: it brings arrays into the
//! few layouts that are read here, and turns JSON into objects. `_native.pyi` has the types.
//!
//! | file | what is there |
//! |---|---|
//! | `arrays` | arrays of Python as slices and numbers |
//! | `background` | work on a pool of threads, while Python runs; Ctrl-C; processes that fork |
//! | `job` | parameters; a clustering of a mesh in arrays or in a file |
//! | `points` | a clustering of points with neighbours, or of an image |
//! | `outcome` | what a clustering gives |
//! | `geometry` | a mesh for outputs that are made of one |
//! | `picture` | a picture of a mesh, for notebooks |
//! | `tree` | hierarchies |
//! | `error` | errors and panics as `tesserae_mesh.Error` |

mod arrays;
mod background;
mod error;
mod geometry;
mod job;
mod outcome;
mod picture;
mod points;
mod tree;

use std::ffi::OsString;
use std::io::Write as _;

use numpy::{PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::prelude::*;
use tesserae_mesh::artifacts;
use tesserae_mesh::export::colour;
use tesserae_mesh::parameters::Parameters;

/// The extension module.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<job::Job>()?;
    module.add_class::<outcome::Outcome>()?;
    module.add_class::<geometry::Geometry>()?;
    module.add_class::<tree::Tree>()?;
    module.add_function(wrap_pyfunction!(job::cluster, module)?)?;
    module.add_function(wrap_pyfunction!(job::cluster_file, module)?)?;
    module.add_function(wrap_pyfunction!(job::cluster_vertices, module)?)?;
    module.add_function(wrap_pyfunction!(points::cluster_points, module)?)?;
    module.add_function(wrap_pyfunction!(points::superpixels, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::unpad, module)?)?;
    module.add_function(wrap_pyfunction!(main, module)?)?;
    module.add_function(wrap_pyfunction!(forms, module)?)?;
    module.add_function(wrap_pyfunction!(colours, module)?)?;
    module.add_function(wrap_pyfunction!(parameters, module)?)
}

/// Runs a command of the command line; gives the exit status. The first argument is the name of the program.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| {
        let status = tesserae_cli::main_of(arguments);
        // a buffer that is left is lost: the process is not ended by Rust. That the reader is gone is no failure now
        let _ = std::io::stdout().flush();
        status
    })
}

/// Every output: the name of its file, and what it is.
#[pyfunction]
fn forms() -> Vec<(&'static str, &'static str)> {
    artifacts::ALL.iter().flat_map(|artifact| artifact.forms.iter().map(|form| (form.file, artifact.about))).collect()
}

/// The colours of clusters in outputs: red, green, blue.
#[pyfunction]
fn colours(py: Python<'_>, clusters: u32) -> PyResult<Bound<'_, PyArray2<u8>>> {
    let bytes = (0..clusters).flat_map(colour::of_cluster).collect();
    PyArray1::from_vec(py, bytes).reshape([clusters as usize, 3])
}

/// Every parameter of a job.
#[pyfunction]
fn parameters() -> Vec<String> {
    match serde_json::to_value(Parameters::default()) {
        Ok(serde_json::Value::Object(members)) => members.into_iter().map(|(name, _)| name).collect(),
        _ => Vec::new(),
    }
}
