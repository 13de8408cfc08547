//! What a job gives: labels, the hierarchy, outputs that are made of the mesh, other outputs of the table; its upload.

use axum::http::{HeaderMap, Uri};
use serde::Deserialize;
use tesserae_mesh::artifacts::{
    Artifact, Choices, CutKind, Form, HIERARCHY, HIERARCHY_JSON, LABELS, LABELS_BIN, LABELS_NPY, Need,
};
use tesserae_mesh::error::{Error, Kind, Quoted};
use tesserae_mesh::hierarchy::json::Limits;
use tesserae_mesh::remesh::Placement;
use utoipa::{IntoParams, ToSchema};

use super::create::Binary;
use crate::files::{self, kept_mesh};
use crate::guard::problem::Answer;
use crate::guard::query;
use crate::http::conditional::Content;
use crate::http::negotiate;
use crate::http::results::DoneJob;
use crate::http::results::made::{self, WhichLabels};
use crate::http::results::stored::{attachment, of_upload, stored};
use crate::http::state::Found;
use crate::store::Job;

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct LabelsQuery {
    /// Cut a hierarchy at this number of clusters; 409 for a flat clustering, and outside what the hierarchy has
    #[param(minimum = 1)]
    clusters: Option<u64>,
    /// The labels after this iteration of a flat clustering, where `snapshots` keeps them: `snapshots` of the
    /// report lists them; 404 for others
    #[param(minimum = 0)]
    iteration: Option<u32>,
    /// The format, `json`, `npy`, `bin`, `txt` or `csv`; by `Accept` when left out
    format: Option<String>,
}

/// Get the labels
///
/// One cluster number a face, in upload order; the format is chosen by `format` or `Accept`. `clusters` cuts a
/// hierarchy, and headers and JSON then say what kind of cut it is and what its energy. 409 before the job has
/// succeeded, and for a whole hierarchy without `clusters`.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/labels", tag = "results", operation_id = "getLabels",
    params(LabelsQuery),
    responses(
        (status = 200, description = "The labels", headers(
            ("Tesserae-Cut" = CutKind, description = "Of labels cut from a hierarchy: what kind of cut it is"),
            ("Tesserae-Energy" = f64, description = "Of labels cut from a hierarchy: their energy, source units"),
        )),
    ),
)]
pub(crate) async fn labels(Found { shared, job }: Found, uri: Uri, headers: HeaderMap) -> Answer {
    let LabelsQuery { clusters, iteration, format } = query::read(&uri)?;
    let done = DoneJob::of(shared, job)?;
    let parameters = &done.job.spec.parameters;
    if let Some(iteration) = iteration.filter(|_| HIERARCHY.is_made(parameters)) {
        return Err(Error::conflict(format_args!(
            "this job made a hierarchy, which keeps the labels of no iteration: give clusters instead of iteration, \
             {iteration}"
        ))
        .into());
    }
    done.check_clusters(clusters)?;
    if LABELS.lacks(parameters) == Some(Need::Faces) {
        let message = "this job divided the faces of the mesh before it clustered them (subdivide): there are no \
                       labels of its faces, only the named outputs";
        return Err(Error::conflict(message).into());
    }
    let form = negotiate::form(&headers, format.as_deref(), &LABELS)?;
    let which = match (clusters, iteration) {
        (Some(clusters), _) => WhichLabels::Cut(clusters),
        (None, Some(iteration)) => WhichLabels::After(iteration),
        (None, None) => WhichLabels::Last,
    };
    let mut response = match (which, form.file) {
        (WhichLabels::Last, file) if file == LABELS_NPY.file => stored(&done, file, 0, form.media_type)?,
        (WhichLabels::Last, file) if file == LABELS_BIN.file => {
            // the raw numbers are what follows the header of the .npy file
            let bytes = done.summary.blobs.get(LABELS_NPY.file).map_or(0, |contents| contents.bytes);
            stored(&done, LABELS_NPY.file, bytes.saturating_sub(4 * done.summary.faces), form.media_type)?
        }
        _ => made::labels(&done, which, form).await?,
    };
    if let (WhichLabels::Last, Some(digest)) = (which, &done.summary.labels_sha256) {
        response.extensions_mut().insert(Content(digest.clone()));
    }
    let name = iteration.map_or_else(|| "labels".to_owned(), |iteration| format!("labels.iteration-{iteration}"));
    attachment(&mut response, &done.job, &format!("{name}.{}", form.extension()));
    Ok(response)
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct HierarchyQuery {
    /// JSON: leave out what comes after fewer clusters than this are left
    #[param(minimum = 0)]
    min_clusters: Option<u64>,
    /// JSON: leave out what comes before as few clusters as this are left
    #[param(minimum = 0)]
    max_clusters: Option<u64>,
    /// JSON: add the clusters of this cut as nodes, in the order of their labels
    #[param(minimum = 1)]
    clusters: Option<u64>,
    /// The format, `json`, `npy` or `tsr`; by `Accept` when left out
    format: Option<String>,
}

/// Get the hierarchy
///
/// As JSON, as scipy's linkage matrix (`application/x-npy`: float64, a row a merge, for nested trees with one root:
/// other trees are 409), or as the file that `tesserae cut` reads (`application/octet-stream`); the format is chosen by
/// `format` or `Accept`. 404 for jobs of flat algorithms, 409 before the job has succeeded.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/hierarchy", tag = "results", operation_id = "getHierarchy",
    params(HierarchyQuery),
    responses((status = 200, description = "The hierarchy")),
)]
pub(crate) async fn hierarchy(Found { shared, job }: Found, uri: Uri, headers: HeaderMap) -> Answer {
    let parameters = &job.spec.parameters;
    if !HIERARCHY.is_made(parameters) {
        let algorithm = parameters.algorithm.name();
        let message = format!("the job has no hierarchy, because its algorithm makes a flat clustering: {algorithm}");
        return Err(Error::not_found(message).into());
    }
    let HierarchyQuery { min_clusters, max_clusters, clusters, format } = query::read(&uri)?;
    let limits = Limits { min_clusters, max_clusters, clusters };
    limits.check()?;
    let done = DoneJob::of(shared, job)?;
    let form = negotiate::form(&headers, format.as_deref(), &HIERARCHY)?;
    if limits.are_given() && form.file != HIERARCHY_JSON.file {
        return Err(Error::parameter("clusters, min_clusters and max_clusters go with application/json only").into());
    }
    let mut response = match form.is_stored {
        true => stored(&done, form.file, 0, form.media_type)?,
        false => made::hierarchy(&done, form, limits).await?,
    };
    attachment(&mut response, &done.job, form.file);
    Ok(response)
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
pub(crate) struct DerivedQuery {
    /// The format; by `Accept` when left out, one that was made first
    format: Option<String>,
    /// Cut a hierarchy at this number of clusters; 409 for a flat clustering
    #[param(minimum = 1)]
    clusters: Option<u64>,
    /// Where vertices are placed
    #[param(value_type = Placement, inline, required = false)]
    placement: Option<Placement>,
    /// PLY: colour vertices instead of faces, split where clusters meet
    ply_vertex_colours: Option<bool>,
    /// Make what takes readers long
    force: Option<bool>,
    /// Colours and ids of clusters, or a GLB of the mesh alone, whose triangles are in upload order
    #[param(value_type = Colours, inline, required = false)]
    colours: Option<Colours>,
}

/// Colours of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum Colours {
    Clusters,
    None,
}

/// An output that is made of the mesh: stored where the request for the job named it, or made of a kept mesh.
pub(crate) async fn derived(artifact: &'static Artifact, found: Found, uri: Uri, headers: HeaderMap) -> Answer {
    let Found { shared, job } = found;
    let given = query::pairs(&uri)?;
    let DerivedQuery { clusters, format, placement, ply_vertex_colours, force, colours } = query::parse(&given)?;
    if let Some((name, _)) = given.iter().find(|(name, _)| !has_parameter(artifact, name)) {
        let message = format_args!("{} has nothing to choose by {name}: leave it out", artifact.name);
        return Err(Error::parameter(message).into());
    }
    let choices = Choices {
        placement: placement.unwrap_or_default(),
        ply_vertex_colours: ply_vertex_colours.unwrap_or_default(),
        force: force.unwrap_or_default(),
        is_plain: colours == Some(Colours::None),
    };
    let kept = &job.spec.kept;
    let form = match &format {
        Some(_) => negotiate::form(&headers, format.as_deref(), artifact)?,
        // what was made before what a kept mesh would give; where the client takes neither, what it prefers of all
        None => {
            let made = artifact.forms.iter().filter(|form| kept.has(form));
            let others = artifact.forms.iter().filter(|form| kept.mesh && !kept.has(form));
            negotiate::choose(&headers, artifact, made.chain(others))
                .or_else(|_| negotiate::form(&headers, None, artifact))?
        }
    };
    if let Some(what) = job.spec.format.lacks(artifact) {
        return Err(Error::conflict(format_args!("{} is made of {what}", form.file)).into());
    }
    let is_stored = clusters.is_none() && choices == Choices::default() && kept.has(form);
    let done = DoneJob::of(shared, job)?;
    done.check_clusters(clusters)?;
    let mut response = match stored(&done, form.file, 0, form.media_type) {
        Ok(response) if is_stored => response,
        // one that could not be written is not there either: making it again says why
        _ if done.job.spec.kept.mesh => made::of_input(&done, clusters, choices, form).await?,
        _ if is_stored => {
            let message = format!("{} could not be written: the warnings of the report say why", form.file);
            return Err(Error::not_found(message).into());
        }
        _ => return Err(not_made(&done.job, form).into()),
    };
    // other releases may write other bytes
    let what = uri.path_and_query().map_or("", |path| path.as_str());
    response.extensions_mut().insert(Content(format!("{what} {}", env!("CARGO_PKG_VERSION"))));
    attachment(&mut response, &done.job, form.file);
    Ok(response)
}

/// Whether a parameter of [`DerivedQuery`] goes with an output.
pub(crate) fn has_parameter(artifact: &Artifact, name: &str) -> bool {
    ["format", "clusters"].contains(&name) || artifact.choices.iter().any(|choice| choice.name() == name)
}

fn not_made(job: &Job, form: &Form) -> Error {
    let (format, file) = (job.spec.format, form.file);
    let is_whole = LABELS.lacks(&job.spec.parameters) == Some(Need::Labels);
    let with = match (format.is_image(), is_whole) {
        _ if !format.is_of_points() => {
            let message = format_args!(
                "the mesh of this job was not kept: submit it again with keep_mesh=true, which keeps it with the \
                 result, or name what to make of it with outputs={file}"
            );
            return Error::new(Kind::MeshNotKept, message);
        }
        (true, true) => "keep_mesh=true, which keeps the image".to_owned(),
        (true, false) => format!("keep_mesh=true, which keeps the image, or outputs={file}"),
        (false, true) => format!("clusters and outputs={file}: a whole hierarchy has no labels of its own"),
        (false, false) => format!("outputs={file}"),
    };
    Error::new(Kind::MeshNotKept, format_args!("it was not made of the points: submit them again with {with}"))
}

/// An output whose route has no query.
pub(crate) async fn output(artifact: &'static Artifact, Found { shared, job }: Found, headers: HeaderMap) -> Answer {
    if !artifact.is_made(&job.spec.parameters) {
        let message = format!("jobs with these parameters have no such output: {}", artifact.name);
        return Err(Error::not_found(message).into());
    }
    let done = DoneJob::of(shared, job)?;
    if let [form] = artifact.forms {
        return Ok(stored(&done, form.file, 0, form.media_type)?);
    }
    let form = negotiate::form(&headers, None, artifact)?;
    let mut response = stored(&done, form.file, 0, form.media_type)?;
    attachment(&mut response, &done.job, form.file);
    Ok(response)
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(crate) struct UploadQuery {
    /// The buffer of this name, one of the job's `mesh.buffers`, in place of the mesh
    buffer: Option<String>,
}

/// Get the upload
///
/// The mesh as it was uploaded, in the format that `mesh.format` of the job names, or one of its buffers. It is there
/// while the job waits and runs, and of a failed job that can be run again, but for one that was named by a `mesh_url`.
/// An image that is kept is there with the result. 404 otherwise.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/upload", tag = "jobs", operation_id = "getUpload",
    params(UploadQuery),
    responses(
        (status = 200, description = "The bytes", body = Binary, content_type = "application/octet-stream"),
    ),
)]
pub(crate) async fn upload(Found { shared, job }: Found, uri: Uri) -> Answer {
    let UploadQuery { buffer } = query::read(&uri)?;
    let (blob, file) = match buffer {
        None => (files::MESH.to_owned(), format!("upload.{}", job.spec.format.name())),
        Some(name) => {
            let index = job.spec.buffers.iter().position(|buffer| *buffer == name).ok_or_else(|| {
                let known = job.spec.buffers.join(", ");
                Error::parameter(format_args!("buffer must be one of the job's ({known}), not {}", Quoted(&name)))
            })?;
            (files::buffer(index), format!("buffer-{index}.bin"))
        }
    };
    let mut response = if job.has_image() {
        stored(&DoneJob::of(shared, job.clone())?, kept_mesh::IMAGE, 0, "application/octet-stream")?
    } else if job.has_upload() {
        of_upload(&shared, &job, blob).await?
    } else {
        return Err(Error::not_found(format_args!(
            "an upload is kept until its job ends, and what a mesh_url names is read at its place; keep_mesh=true \
             keeps an image with the result. The job is {}",
            job.state.name()
        ))
        .into());
    };
    attachment(&mut response, &job, &file);
    Ok(response)
}
