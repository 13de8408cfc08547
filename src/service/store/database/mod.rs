//! The databases: statements in one dialect, in transactions.
//!
//! The store is written once, as functions that run statements on [`Rows`](rows::Rows). A statement keeps to what
//! SQLite and PostgreSQL both know: `$1` for a value, `RETURNING`, `ON CONFLICT`, and four types of
//! [values](rows::Value). `FOR UPDATE` at its end locks the rows where transactions run side by side.

#[cfg(feature = "postgres")]
pub mod postgres;
pub mod rows;
pub mod sqlite;
