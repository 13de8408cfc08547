//! The handlers: one resource and method a file. They stand on top: nothing but the router and the description of the
//! interface imports them.

pub(super) mod binary;
pub(super) mod create;
pub(super) mod derived;
pub(super) mod events;
pub(super) mod health;
pub(super) mod hierarchy;
pub(super) mod info;
pub(super) mod labels;
pub(super) mod list;
pub(super) mod metrics;
pub(super) mod output;
pub(super) mod remove;
pub(super) mod retry;
pub(super) mod show;
pub(super) mod upload;
mod view;
pub(super) mod workers;
