//! The parameters of a job request: those of the query string and of the JSON part, merged.
//!
//! A parameter may stand in either place, or in both with the same value; different values are refused. A path is never
//! a parameter here: files arrive in the request.

use std::fmt;

use axum::http::Uri;
use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, Visitor};
use serde_json::error::Category;
use serde_json::{Map, Value};
use tesserae_mesh::error::{Error, Kind, Result, wrong_json_at};
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::{Parameters, Seeds};

use crate::guard::query;
use crate::store::PRIORITIES;
use crate::store::kept::{self, Kept};

/// Largest JSON part with parameters, in bytes.
pub(crate) const MAX_PARAMETERS_BYTES: u64 = 64 << 10;

/// The parameters so far.
#[derive(Debug, Clone)]
pub(crate) struct Wanted {
    /// Format of the mesh, if the query has it.
    pub format: Option<Format>,
    /// URL of the object of a bucket that is the mesh, if the request does not bring it.
    pub mesh_url: Option<String>,
    /// URL that receives the end of the job.
    webhook: Option<String>,
    priority: Option<i8>,
    /// Files that are made of the mesh.
    outputs: Option<Vec<String>>,
    keep_mesh: Option<bool>,
    parameters: Parameters,
    /// Names of the parameters that were given.
    given: Vec<String>,
}

impl Wanted {
    /// Reads the query string.
    pub fn from_query(uri: &Uri) -> Result<Self> {
        let whole = uri.query().unwrap_or_default();
        query::names(whole)?;
        let (format, rest) = query::take(whole, "format");
        let format = format.as_deref().map(Format::from_name).transpose()?;
        let (mesh_url, rest) = query::take(&rest, "mesh_url");
        let (webhook, rest) = query::take(&rest, "webhook");
        let (priority, rest) = query::take(&rest, "priority");
        let priority = priority.map(|text| priority_of(text.parse().ok(), &text)).transpose()?;
        let (outputs, rest) = query::take(&rest, "outputs");
        let outputs = outputs.map(|text| kept::files(text.split(','))).transpose()?;
        let (keep_mesh, rest) = query::take(&rest, "keep_mesh");
        let keep_mesh = keep_mesh.map(|text| is_true(text.parse().ok(), &text)).transpose()?;
        let given = query::names(&rest)?;
        let rest: Uri = format!("/?{rest}")
            .parse()
            .map_err(|error| Error::new(Kind::BadRequest, format_args!("the query string cannot be read: {error}")))?;
        let parameters: Parameters = query::read(&rest)?;
        refuse_path(&parameters)?;
        Ok(Self { format, mesh_url, webhook, priority, outputs, keep_mesh, parameters, given })
    }

    /// Adds the parameters of the JSON part.
    pub fn add_json(&mut self, json: &[u8]) -> Result<()> {
        // Read twice: as a map, which knows what was given, and as parameters, which know types, names and duplicates.
        let malformed = |error: serde_json::Error| {
            let kind = match error.classify() {
                Category::Data => Kind::InvalidParameter,
                Category::Io | Category::Syntax | Category::Eof => Kind::BadRequest,
            };
            Error::new(kind, format_args!("the part \"parameters\" is not valid: {}", wrong_json_at(&error)))
        };
        let Members(mut object) = serde_json::from_slice(json).map_err(malformed)?;
        let ours = ["webhook", "priority", "outputs", "keep_mesh"].map(|name| object.remove(name));
        let parameters: Parameters = match ours {
            [None, None, None, None] => serde_json::from_slice(json).map_err(malformed)?,
            [webhook, priority, outputs, keep_mesh] => {
                webhook.map(|webhook| self.add_webhook(webhook)).transpose()?;
                priority.map(|priority| self.add_priority(&priority)).transpose()?;
                outputs.map(|outputs| self.add_outputs(&outputs)).transpose()?;
                keep_mesh.map(|keep_mesh| self.add_keep_mesh(&keep_mesh)).transpose()?;
                // no line numbers in messages here: the text is not the client's any more
                serde_json::from_value(Value::Object(object.clone())).map_err(malformed)?
            }
        };
        refuse_path(&parameters)?;
        let mut merged = as_object(&self.parameters)?;
        for (name, value) in as_object(&parameters)? {
            if !object.contains_key(&name) {
                continue;
            }
            if !self.given.contains(&name) {
                self.given.push(name.clone());
            } else if let Some(other) = merged.get(&name).filter(|other| **other != value) {
                return Err(Error::parameter(format_args!(
                    "query string and part \"parameters\" contradict each other about {name}: {other} and {value}"
                )));
            }
            merged.insert(name, value);
        }
        self.parameters = serde_json::from_value(Value::Object(merged)).map_err(internal)?;
        Ok(())
    }

    /// Adds the webhook of the JSON part.
    fn add_webhook(&mut self, webhook: Value) -> Result<()> {
        let Value::String(webhook) = webhook else {
            return Err(Error::parameter(format_args!("webhook must be a text with a URL, not {webhook}")));
        };
        match &self.webhook {
            Some(other) if *other != webhook => {
                Err(Error::parameter("query string and part \"parameters\" contradict each other about webhook"))
            }
            _ => {
                self.webhook = Some(webhook);
                Ok(())
            }
        }
    }

    /// Adds the priority of the JSON part.
    fn add_priority(&mut self, priority: &Value) -> Result<()> {
        let priority = priority_of(priority.as_i64(), priority)?;
        match self.priority.replace(priority) {
            Some(other) if other != priority => Err(Error::parameter(format_args!(
                "query string and part \"parameters\" contradict each other about priority: {other} and {priority}"
            ))),
            _ => Ok(()),
        }
    }

    /// Adds the outputs of the JSON part: a list of names, or a text with commas.
    fn add_outputs(&mut self, outputs: &Value) -> Result<()> {
        let wrong = || Error::parameter(format_args!("outputs must be a list of names, not {outputs}"));
        let files = match outputs {
            Value::String(text) => kept::files(text.split(','))?,
            Value::Array(names) => {
                let names: Option<Vec<&str>> = names.iter().map(Value::as_str).collect();
                kept::files(names.ok_or_else(wrong)?.into_iter())?
            }
            _ => return Err(wrong()),
        };
        match &self.outputs {
            Some(other) if *other != files => {
                Err(Error::parameter("query string and part \"parameters\" contradict each other about outputs"))
            }
            _ => {
                self.outputs = Some(files);
                Ok(())
            }
        }
    }

    /// Adds whether the mesh is kept, of the JSON part.
    fn add_keep_mesh(&mut self, keep_mesh: &Value) -> Result<()> {
        let keep_mesh = is_true(keep_mesh.as_bool(), keep_mesh)?;
        match self.keep_mesh.replace(keep_mesh) {
            Some(other) if other != keep_mesh => Err(Error::parameter(format_args!(
                "query string and part \"parameters\" contradict each other about keep_mesh: {other} and {keep_mesh}"
            ))),
            _ => Ok(()),
        }
    }

    /// What is kept of the mesh.
    pub fn kept(&self) -> Kept {
        Kept { outputs: self.outputs.clone().unwrap_or_default(), mesh: self.keep_mesh.unwrap_or_default() }
    }

    /// The priority, 0 when none was given.
    pub fn priority(&self) -> i8 {
        self.priority.unwrap_or_default()
    }

    /// Checks what can be checked before the body is here: a form may still bring parameters and a list of seeds.
    pub fn check_early(&self, form: bool) -> Result<()> {
        if form { self.parameters.check_values() } else { self.parameters.check(false) }
    }

    /// The parameters, checked as far as they can be without the mesh, and the webhook, which is not checked. `listed`
    /// says whether a list of seeds came.
    pub fn finish(mut self, listed: bool) -> Result<(Parameters, Option<String>)> {
        if listed {
            let given = self.given.iter().any(|name| name == "seeds");
            if given && self.parameters.seeds != Seeds::Listed {
                return Err(Error::parameter(format_args!(
                    "a list of seeds came as a part, so the parameter seeds must be left out or listed, not {}",
                    self.parameters.seeds
                )));
            }
            self.parameters.seeds = Seeds::Listed;
        }
        self.parameters.check(listed)?;
        self.kept().check(&self.parameters)?;
        Ok((self.parameters, self.webhook))
    }
}

/// Whether the mesh is kept, which was given as `text`.
fn is_true(value: Option<bool>, text: impl fmt::Display) -> Result<bool> {
    value.ok_or_else(|| Error::parameter(format_args!("keep_mesh must be true or false, not {text}")))
}

/// A priority that was given as `text`.
fn priority_of(number: Option<i64>, text: impl fmt::Display) -> Result<i8> {
    let priority = number.and_then(|number| i8::try_from(number).ok()).filter(|priority| PRIORITIES.contains(priority));
    priority.ok_or_else(|| {
        let (least, most) = (PRIORITIES.start(), PRIORITIES.end());
        Error::parameter(format_args!("priority must be a whole number from {least} to {most}, not {text}"))
    })
}

/// The members of a JSON object, none of which is there twice.
struct Members(Map<String, Value>);

impl<'de> Deserialize<'de> for Members {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Each;
        impl<'de> Visitor<'de> for Each {
            type Value = Members;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Members, A::Error> {
                let mut members = Map::new();
                while let Some((name, value)) = access.next_entry::<String, Value>()? {
                    if members.contains_key(&name) {
                        return Err(A::Error::custom(format_args!("duplicate field `{name}`")));
                    }
                    members.insert(name, value);
                }
                Ok(Members(members))
            }
        }
        deserializer.deserialize_map(Each)
    }
}

/// Refuses seeds from a file of the server.
fn refuse_path(parameters: &Parameters) -> Result<()> {
    match &parameters.seeds {
        Seeds::Coarse | Seeds::Morton | Seeds::Random | Seeds::Listed => Ok(()),
        Seeds::File(path) => Err(Error::parameter(format_args!(
            "seeds cannot be a path here: send the list as a part named seeds of multipart/form-data, not {:?}",
            path.display().to_string()
        ))),
    }
}

/// Parameters as a JSON object.
fn as_object(parameters: &Parameters) -> Result<Map<String, Value>> {
    match serde_json::to_value(parameters).map_err(internal)? {
        Value::Object(object) => Ok(object),
        other => Err(internal(format_args!("not an object: {other}"))),
    }
}

fn internal(error: impl fmt::Display) -> Error {
    Error::new(Kind::Internal, format_args!("parameters do not survive being written as JSON: {error}"))
}

#[cfg(test)]
mod tests;
