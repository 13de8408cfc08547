//! Routes, handlers, results, and their description.

pub mod api;
pub mod conditional;
pub mod negotiate;
pub mod openapi;
pub mod page;
pub mod results;
pub mod router;
pub mod state;
