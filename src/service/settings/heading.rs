//! Headings of the settings, in the help and in the guide.

pub const PLACES: &str = "Places";
pub const ACCESS: &str = "Access";
pub const WORK: &str = "Work";
pub const LIMITS: &str = "Limits";
pub const ROOM: &str = "Room";
pub const STOP: &str = "Stop";
pub const WEBHOOKS: &str = "Webhooks";
pub const LOG: &str = "Log";
