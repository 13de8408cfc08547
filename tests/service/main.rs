//! The service as a client meets it: a real server on a free port of this machine, a real HTTP client, real meshes.

mod access;
mod backup;
mod derived;
mod durable;
mod events;
mod fairness;
mod faults;
mod full_disk;
mod hierarchy;
mod hostile;
mod http;
mod jobs;
mod lifecycle;
mod limits;
mod manners;
mod metrics;
mod openapi;
mod overlap;
mod page;
mod results;
mod storage;
mod support;
mod upload;
mod webhooks;
mod work;
