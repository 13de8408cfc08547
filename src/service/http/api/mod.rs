//! The handlers, one resource a file. Nothing but the description of the interface imports them.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

pub(crate) mod create;
pub(crate) mod events;
mod jobs;
pub(crate) mod outputs;
mod service;

use std::sync::Arc;

use axum::middleware::from_fn;
use axum::routing::get;
use tesserae_mesh::artifacts::{self, HIERARCHY, LABELS};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::http::conditional;
use crate::http::state::Shared;
use crate::work::urls;

/// All routes with what the description says about them; around those of results, ETag and Range.
pub(crate) fn routes() -> OpenApiRouter<Arc<Shared>> {
    let results = OpenApiRouter::default()
        .routes(routes!(outputs::upload))
        .routes(routes!(outputs::labels))
        .routes(routes!(outputs::hierarchy));
    let others = artifacts::ALL
        .into_iter()
        .filter(|artifact| artifact.is_served && ![LABELS.name, HIERARCHY.name].contains(&artifact.name));
    let results = others.fold(results, |routes, artifact| {
        let handler = match artifact.is_made_of_input() {
            true => get(move |found, uri, headers| outputs::derived(artifact, found, uri, headers)),
            false => get(move |found, headers| outputs::output(artifact, found, headers)),
        };
        routes.route(&urls::route(artifact), handler)
    });
    OpenApiRouter::default()
        .routes(routes!(create::create, jobs::list))
        .routes(routes!(jobs::show, jobs::remove))
        .routes(routes!(jobs::retry))
        .routes(routes!(events::stream))
        .merge(results.layer(from_fn(conditional::results)))
        .routes(routes!(service::workers))
        .routes(routes!(service::device))
        .routes(routes!(service::formats))
        .routes(routes!(service::limits))
        .routes(routes!(service::version))
        .routes(routes!(service::healthz))
        .routes(routes!(service::readyz))
        .routes(routes!(service::metrics))
}
