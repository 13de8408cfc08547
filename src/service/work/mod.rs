//! What happens to jobs that wait: they are claimed and run, and their webhooks are sent.

pub mod pipeline;
pub mod urls;
pub mod webhooks;
