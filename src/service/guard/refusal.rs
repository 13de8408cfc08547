//! Requests that are refused before their body was read.

use std::time::Duration;

use axum::body::BodyDataStream;
use axum::extract::Request;
use axum::http::header;
use futures_util::StreamExt;

/// For how long the rest of a refused body is read and thrown away, so that the answer reaches a client that is still
/// sending: closing at once would reset the connection, and the answer with it.
const LINGER: Duration = Duration::from_secs(2);

/// Lets go of a request that is refused before anything of its body was read.
pub fn refuse(request: Request) {
    if !request.headers().contains_key(header::EXPECT) {
        throw_away(request.into_body().into_data_stream());
    }
}

/// Reads the rest of a body for a while.
pub fn throw_away(mut body: BodyDataStream) {
    let Ok(runtime) = tokio::runtime::Handle::try_current() else {
        return;
    };
    runtime.spawn(async move {
        let rest = async { while let Some(Ok(_)) = body.next().await {} };
        let _ = tokio::time::timeout(LINGER, rest).await;
    });
}
