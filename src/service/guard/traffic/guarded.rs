//! A body that holds on to something until it was sent, or given up.

use std::pin::Pin;
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody};
use hyper::body::{Frame, SizeHint};

/// A body with a guard.
#[derive(Debug)]
pub(crate) struct Guarded<G> {
    body: Body,
    guard: G,
    /// Notes bytes that are sent.
    note: fn(&mut G, usize),
}

impl<G> Guarded<G> {
    /// `guard` is dropped with the body.
    pub fn new(body: Body, guard: G) -> Self {
        Self::noting(body, guard, |_, _| {})
    }

    /// The same, with a note of the bytes of each frame.
    pub fn noting(body: Body, guard: G, note: fn(&mut G, usize)) -> Self {
        Self { body, guard, note }
    }
}

impl<G: Unpin> HttpBody for Guarded<G> {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let this = &mut *self;
        let polled = Pin::new(&mut this.body).poll_frame(context);
        if let Poll::Ready(Some(Ok(frame))) = &polled {
            (this.note)(&mut this.guard, frame.data_ref().map_or(0, Bytes::len));
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
