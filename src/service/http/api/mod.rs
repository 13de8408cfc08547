//! The handlers: one resource and method a file. They stand on top: nothing but the description of the interface, with
//! which the router begins, imports them.

#![allow(unused_qualifications, reason = "utoipa's macros write whole paths")]

pub(crate) mod binary;
mod create;
pub(crate) mod derived;
pub(crate) mod events;
mod health;
mod hierarchy;
mod info;
mod labels;
mod list;
mod metrics;
mod output;
mod remove;
mod retry;
mod show;
mod upload;
mod view;
mod workers;

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
        .routes(routes!(upload::upload))
        .routes(routes!(labels::labels))
        .routes(routes!(hierarchy::hierarchy));
    let others = artifacts::ALL
        .into_iter()
        .filter(|artifact| artifact.is_served && ![LABELS.name, HIERARCHY.name].contains(&artifact.name));
    let results = others.fold(results, |routes, artifact| {
        let handler = match artifact.is_made_of_input() {
            true => get(move |shared, caller, id, uri, headers| {
                derived::derived(artifact, shared, caller, id, uri, headers)
            }),
            false => get(move |shared, caller, id, headers| output::output(artifact, shared, caller, id, headers)),
        };
        routes.route(&urls::route(artifact), handler)
    });
    OpenApiRouter::default()
        .routes(routes!(create::create, list::list))
        .routes(routes!(show::show, remove::remove))
        .routes(routes!(retry::retry))
        .routes(routes!(events::stream))
        .merge(results.layer(from_fn(conditional::results)))
        .routes(routes!(workers::list))
        .routes(routes!(info::device))
        .routes(routes!(info::formats))
        .routes(routes!(info::limits))
        .routes(routes!(info::version))
        .routes(routes!(health::healthz))
        .routes(routes!(health::readyz))
        .routes(routes!(metrics::metrics))
}
