//! Headings of the settings, in the help and in the guide.

/// Address, folder, store.
pub const PLACES: &str = "Places";
/// Tokens and origins.
pub const ACCESS: &str = "Access";
/// Jobs at a time, their time and memory.
pub const WORK: &str = "Work";
/// Sizes of meshes and requests.
pub const LIMITS: &str = "Limits";
/// Disk, and how long results are kept.
pub const ROOM: &str = "Room";
/// The way to the end.
pub const STOP: &str = "Stop";
/// Messages about jobs that ended.
pub const WEBHOOKS: &str = "Webhooks";
/// What is written to standard error.
pub const LOG: &str = "Log";
