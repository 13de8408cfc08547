//! Errors and panics as `tesserae_mesh.Error`.

use std::any::Any;
use std::io;
use std::path::Path;

use pyo3::call::PyCallArgs;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use tesserae_mesh::{Error, Kind};

/// The exception of an error.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let message = error.message.as_str();
    match error.kind {
        Kind::Io => of_file(py, (message,)),
        kind => made(CLASS.import(py, "tesserae_mesh._errors", "Error"), (kind.slug(), message)),
    }
}

/// The exception of a file that cannot be read, with its name and the number of the system's error.
pub fn unreadable(py: Python<'_>, path: &Path, error: io::Error) -> PyErr {
    let number = error.raw_os_error();
    let Error { message, .. } = Error::io(format_args!("cannot read {}", path.display()), error);
    of_file(py, (message, number, path))
}

/// An exception of the class that is an `OSError`, too.
fn of_file<'py>(py: Python<'py>, arguments: impl PyCallArgs<'py>) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    made(CLASS.import(py, "tesserae_mesh._errors", "FileError"), arguments)
}

fn made<'py>(class: PyResult<&Bound<'py, PyType>>, arguments: impl PyCallArgs<'py>) -> PyErr {
    match class.and_then(|class| class.call1(arguments)) {
        Ok(exception) => PyErr::from_value(exception),
        Err(failure) => failure,
    }
}

/// The result of the library as one of Python.
pub fn raised<T>(py: Python<'_>, result: tesserae_mesh::Result<T>) -> PyResult<T> {
    result.map_err(|error| exception(py, &error))
}

/// The error of a panic.
pub fn of_panic(payload: &(dyn Any + Send)) -> Error {
    let text = payload.downcast_ref::<&str>().copied().or(payload.downcast_ref::<String>().map(String::as_str));
    Error::internal(format_args!("a defect of tesserae: {}", text.unwrap_or("a panic without a message")))
}
