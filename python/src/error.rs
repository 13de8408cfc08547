//! Errors and panics as `tesserae_mesh.Error`.

use std::any::Any;

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use tesserae_mesh::{Error, Kind};

/// The exception of an error.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let class = CLASS.import(py, "tesserae_mesh._errors", "Error");
    match class.and_then(|class| class.call1((error.kind.slug(), error.message.as_str()))) {
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
    Error::new(Kind::Internal, format_args!("a defect of tesserae: {}", text.unwrap_or("a panic without a message")))
}
