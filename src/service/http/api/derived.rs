//! Outputs that are made of the mesh: stored where the request for the job named them, or made of a kept mesh.

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, Uri};
use serde::Deserialize;
use tesserae_mesh::artifacts::{Artifact, Choice, Choices, Form};
use tesserae_mesh::error::{Error, Kind, Result};
use tesserae_mesh::remesh::Placement;
use utoipa::{IntoParams, ToSchema};

use crate::guard::access::Caller;
use crate::guard::problem::Answer;
use crate::guard::query;
use crate::http::conditional::Content;
use crate::http::negotiate;
use crate::http::results::derived::{made, not_made};
use crate::http::results::stored::{Of, attachment, check_clusters, stored, succeeded};
use crate::http::state::App;
use crate::store::kept::Kept;

/// The query of an output. The table of outputs says which choices each has.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
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

pub(crate) async fn derived(
    artifact: &'static Artifact,
    Extract(shared): App,
    caller: Caller,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Answer {
    let job = shared.job(&caller, &id).await?;
    let DerivedQuery { clusters, format, placement, ply_vertex_colours, force, colours } = query::read(&uri)?;
    let given = [
        (Choice::Placement, placement.is_some()),
        (Choice::PlyVertexColours, ply_vertex_colours.is_some()),
        (Choice::Force, force.is_some()),
        (Choice::Colours, colours.is_some()),
    ];
    if let Some((choice, _)) = given.into_iter().find(|(choice, given)| *given && !artifact.choices.contains(choice)) {
        let message = format!("{} has nothing to choose by {}: leave it out", artifact.name, choice.name());
        return Err(Error::new(Kind::InvalidParameter, message).into());
    }
    let choices = Choices {
        placement: placement.unwrap_or_default(),
        ply_vertex_colours: ply_vertex_colours.unwrap_or_default(),
        force: force.unwrap_or_default(),
        is_plain: colours == Some(Colours::None),
    };
    let kept = &job.spec.kept;
    let form = match &format {
        None => preferred(&headers, artifact, kept)?,
        named => negotiate::form(&headers, named.as_deref(), artifact)?,
    };
    if let Some(what) = job.spec.format.lacks(artifact) {
        return Err(Error::new(Kind::Conflict, format_args!("{} is made of {what}", form.file)).into());
    }
    let summary = succeeded(&job)?;
    check_clusters(&job, &summary, clusters)?;
    let is_stored = clusters.is_none() && choices == Choices::default() && kept.has(form);
    let found = match is_stored {
        true => stored(&shared, &job, Of::Result, form.file, 0, form.media_type).await,
        false => Err(not_made(&job, form)),
    };
    let mut response = match found {
        // one that could not be written is not there either: making it again says why
        Err(error) if kept.mesh && matches!(error.kind, Kind::MeshNotKept | Kind::NotFound) => {
            made(&shared, &job, &summary, clusters, choices, form).await?
        }
        Err(error) if is_stored && error.kind == Kind::NotFound => {
            let message = format!("{} could not be written: the warnings of the report say why", form.file);
            return Err(Error::new(Kind::NotFound, message).into());
        }
        found => found?,
    };
    // other releases may write other bytes
    let what = uri.path_and_query().map_or("", |path| path.as_str());
    response.extensions_mut().insert(Content(format!("{what} {}", env!("CARGO_PKG_VERSION"))));
    attachment(&mut response, &job, form.file);
    Ok(response)
}

/// The form that the client prefers of those that the job can give, what was made before what a kept mesh would give.
/// Where it can give none that the client takes: the form that it prefers of all.
fn preferred(headers: &HeaderMap, artifact: &'static Artifact, kept: &Kept) -> Result<&'static Form> {
    let made = artifact.forms.iter().filter(|form| kept.has(form));
    let others = artifact.forms.iter().filter(|form| kept.mesh && !kept.has(form));
    negotiate::choose_among(headers, artifact, made.chain(others)).or_else(|_| negotiate::choose(headers, artifact))
}
