//! The parameters of a job request: those of the query string and of the JSON part, merged.
//!
//! A parameter stands in one of the two places. A path is never a parameter here: files arrive in the request.

use std::fmt;

use axum::http::Uri;
use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, Visitor};
use serde_json::error::Category;
use serde_json::{Map, Value};
use tesserae_mesh::error::{Error, Kind, Result, wrong_json_at};
use tesserae_mesh::job::{self, InputFormat};
use tesserae_mesh::parameters::{Parameters, Seeds};

use crate::guard::query;
use crate::store::kept::{self, Kept};
use crate::store::{PRIORITIES, Spec};

/// Largest JSON part with parameters, in bytes.
pub(crate) const MAX_PARAMETERS_BYTES: u64 = 64 << 10;

#[derive(Debug, Clone)]
pub(crate) struct Wanted {
    /// Format of the mesh or the points, if the query has it.
    pub format: Option<InputFormat>,
    /// URL of the object of a bucket that is the mesh, if the request does not bring it.
    pub mesh_url: Option<String>,
    /// URL that receives the end of the job.
    webhook: Option<String>,
    /// Of the tenant's waiting jobs, those with a higher one start first.
    priority: i8,
    kept: Kept,
    parameters: Parameters,
    /// Names of the parameters that were given.
    given: Vec<String>,
}

/// What came beside a mesh or points.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Beside {
    /// Whether a list of seeds did.
    pub listed_seeds: bool,
    pub has_weights: bool,
    pub has_graph: bool,
}

/// Parameters of a job that are none of its clustering.
const OF_JOB: [&str; 4] = ["webhook", "priority", "outputs", "keep_mesh"];

impl Wanted {
    pub fn from_query(uri: &Uri) -> Result<Self> {
        let mut rest = query::pairs(uri)?;
        let given = rest.iter().map(|(name, _)| name.clone()).collect();
        let format = query::take(&mut rest, "format").as_deref().map(InputFormat::from_name).transpose()?;
        let mesh_url = query::take(&mut rest, "mesh_url");
        let of_job = OF_JOB.map(|name| (name, query::take(&mut rest, name)));
        let parameters: Parameters = query::parse(&rest)?;
        refuse_path(&parameters)?;
        let (webhook, priority, kept) = Default::default();
        let mut this = Self { format, mesh_url, webhook, priority, kept, parameters, given };
        for (name, text) in of_job.into_iter().filter_map(|(name, text)| Some((name, text?))) {
            let value = match name {
                "priority" => text.parse::<i64>().ok().map(Value::from),
                "keep_mesh" => text.parse::<bool>().ok().map(Value::from),
                _ => None,
            };
            this.set(name, &value.unwrap_or_else(|| text.into()))?;
        }
        Ok(this)
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
        if let Some(name) = object.keys().find(|name| self.given.contains(name)) {
            return Err(Error::parameter(format_args!(
                "a parameter stands in the query string and in the part \"parameters\": leave it out of one: {name}"
            )));
        }
        let before = object.len();
        for name in OF_JOB {
            object.remove(name).map(|value| self.set(name, &value)).transpose()?;
        }
        let parameters: Parameters = match object.len() == before {
            true => serde_json::from_slice(json).map_err(malformed)?,
            // no line numbers in messages here: the text is not the client's any more
            false => serde_json::from_value(Value::Object(object.clone())).map_err(malformed)?,
        };
        refuse_path(&parameters)?;
        let mut merged = as_object(&self.parameters)?;
        merged.extend(as_object(&parameters)?.into_iter().filter(|(name, _)| object.contains_key(name)));
        self.parameters = serde_json::from_value(Value::Object(merged)).map_err(internal)?;
        self.given.extend(object.into_iter().map(|(name, _)| name));
        Ok(())
    }

    fn set(&mut self, name: &str, value: &Value) -> Result<()> {
        let must_be = |what: &str| Error::parameter(format_args!("{name} must be {what}, not {value}"));
        match name {
            "webhook" => self.webhook = Some(value.as_str().ok_or_else(|| must_be("a text with a URL"))?.to_owned()),
            "priority" => {
                let priority = value.as_i64().and_then(|number| i8::try_from(number).ok());
                let (least, most) = (PRIORITIES.start(), PRIORITIES.end());
                self.priority = priority
                    .filter(|priority| PRIORITIES.contains(priority))
                    .ok_or_else(|| must_be(&format!("a whole number from {least} to {most}")))?;
            }
            "outputs" => {
                let names = match value {
                    Value::String(text) => Some(text.split(',').collect()),
                    Value::Array(names) => names.iter().map(Value::as_str).collect::<Option<Vec<&str>>>(),
                    _ => None,
                };
                self.kept.outputs = kept::files(names.ok_or_else(|| must_be("a list of names"))?.into_iter())?;
            }
            _ => self.kept.mesh = value.as_bool().ok_or_else(|| must_be("true or false"))?,
        }
        Ok(())
    }

    /// Checks what can be checked before the body is here: a form may still bring parameters and a list of seeds.
    pub fn check_early(&self, form: bool) -> Result<()> {
        if form { self.parameters.check_values() } else { self.parameters.check(false) }
    }

    /// The job, checked as far as it can be without the mesh, but for its webhook; the caller adds what it knows of the
    /// files. `beside` says what came with a file of this format.
    pub fn finish(mut self, format: InputFormat, beside: Beside) -> Result<Spec> {
        let Beside { listed_seeds, has_weights, has_graph } = beside;
        if listed_seeds {
            if self.given.iter().any(|name| name == "seeds") && self.parameters.seeds != Seeds::Listed {
                return Err(Error::parameter(format_args!(
                    "a list of seeds came as a part, so the parameter seeds must be left out or listed, not {}",
                    self.parameters.seeds
                )));
            }
            self.parameters.seeds = Seeds::Listed;
        }
        let Self { parameters, webhook, priority, kept, .. } = self;
        parameters.check(listed_seeds)?;
        kept.check_format(format)?;
        match format {
            InputFormat::Points(format) => job::check_points(&parameters, format, has_graph, has_weights)?,
            InputFormat::Mesh(_) if has_graph => {
                return Err(Error::parameter("the part graph goes with points, not with a mesh: leave it out"));
            }
            InputFormat::Mesh(_) => parameters.check_mesh()?,
        }
        kept.check(&parameters, format)?;
        Ok(Spec {
            tenant: String::new(),
            trace_parent: None,
            webhook,
            parameters,
            file_name: None,
            format,
            bytes: 0,
            buffers: Vec::new(),
            listed_seeds,
            has_weights,
            has_graph,
            is_small: false,
            priority,
            kept,
            referred: None,
        })
    }
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
        Seeds::Coarse | Seeds::Merged | Seeds::Morton | Seeds::Random | Seeds::Listed => Ok(()),
        Seeds::File(path) => Err(Error::parameter(format_args!(
            "seeds cannot be a path here: send the list as a part named seeds of multipart/form-data, not {:?}",
            path.display().to_string()
        ))),
    }
}

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
