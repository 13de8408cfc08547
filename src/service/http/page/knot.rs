//! What the page shows before there is a job: a knot and its hierarchy, made once, when the service has started.

use std::sync::OnceLock;
use std::thread;

use axum::Router;
use axum::body::Bytes;
use axum::response::Response;
use axum::routing::get;
use tesserae_mesh::dev::sample::{Sample, generate, write_glb};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::job;
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::{Algorithm, Parameters};

use super::{digest, serve};
use crate::guard::problem::Failure;
use crate::http::conditional::Content;
use crate::ops::blocking::blocking;

const FACES: u64 = 20_000;

#[derive(Debug)]
struct Knot {
    glb: File,
    tsr: File,
}

/// A file and its digest.
type File = (Content, Bytes);

static KNOT: OnceLock<Result<Knot>> = OnceLock::new();

/// Makes them, on a thread of its own.
pub(super) fn start() {
    thread::spawn(|| KNOT.get_or_init(make));
}

pub(super) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    Router::new()
        .route("/knot.glb", get(async || answer(|knot| &knot.glb).await))
        .route("/knot.tsr", get(async || answer(|knot| &knot.tsr).await))
}

async fn answer(file: fn(&Knot) -> &File) -> Result<Response, Failure> {
    // a request may arrive before the knot is made
    let made = blocking(move || KNOT.get_or_init(make).as_ref().map(|knot| file(knot).clone()).map_err(Error::clone));
    let (content, bytes) = made.await??;
    Ok(serve("application/octet-stream", bytes, content))
}

fn make() -> Result<Knot> {
    let failed = |error| Error::new(Kind::Internal, format_args!("the knot of the page: {error}"));
    let (mut glb, mut tsr) = (Vec::new(), Vec::new());
    write_glb(&mut glb, &generate(Sample::Knot, FACES)?).map_err(failed)?;
    let parameters = Parameters { algorithm: Algorithm::Pml, ..Parameters::default() };
    let prepared = job::prepare(&job::Request::new(&glb, Format::Glb, &parameters))?;
    let outcome = job::run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {})?;
    if let Some(hierarchy) = outcome.hierarchy {
        hierarchy.write(&mut tsr).map_err(failed)?;
    }
    let [glb, tsr] = [glb, tsr].map(|bytes| (Content(digest(&bytes)), Bytes::from(bytes)));
    Ok(Knot { glb, tsr })
}
