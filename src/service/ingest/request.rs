//! The parameters of a job request: those of the query string and of the JSON part, merged.
//!
//! A parameter stands in one of the two places. A path is never a parameter here: files arrive in the request.

use std::fmt;

use axum::http::Uri;
use serde::de::{Deserializer, Error as _, MapAccess, Visitor};
use serde_json::error::Category;
use serde_json::{Map, Value};
use tesserae_mesh::error::{Error, Kind, Result, wrong_json_at};
use tesserae_mesh::job::{self, InputFormat};
use tesserae_mesh::parameters::{Parameters, Seeds};

use crate::files;
use crate::guard::query;
use crate::store::kept::{self, Kept};
use crate::store::{PRIORITIES, Spec};

#[derive(Debug, Clone)]
pub(crate) struct WantedJob {
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

/// Parameters of a job that are none of its clustering.
pub(crate) const OF_JOB: [&str; 4] = ["webhook", "priority", "outputs", "keep_mesh"];

impl WantedJob {
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
        let mut text = serde_json::Deserializer::from_slice(json);
        let object = text.deserialize_map(Members).and_then(|object| text.end().map(|()| object));
        let mut object = object.map_err(malformed)?;
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
                let what = format!("a whole number from {} to {}", PRIORITIES.start(), PRIORITIES.end());
                let priority = priority.filter(|priority| PRIORITIES.contains(priority));
                self.priority = priority.ok_or_else(|| must_be(&what))?;
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
    /// files. `has` says which parts came beside a file of this format.
    pub fn finish(mut self, format: InputFormat, has: impl Fn(&str) -> bool) -> Result<Spec> {
        let [listed_seeds, has_weights, has_graph] = [files::SEEDS, files::WEIGHTS, files::GRAPH].map(has);
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

/// Reads the members of a JSON object, none of which is there twice.
struct Members;

impl<'de> Visitor<'de> for Members {
    type Value = Map<String, Value>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Self::Value, A::Error> {
        let mut members = Map::new();
        while let Some((name, value)) = access.next_entry::<String, Value>()? {
            if members.contains_key(&name) {
                return Err(A::Error::custom(format_args!("duplicate field `{name}`")));
            }
            members.insert(name, value);
        }
        Ok(members)
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
    serde_json::to_value(parameters).and_then(serde_json::from_value).map_err(internal)
}

fn internal(error: serde_json::Error) -> Error {
    Error::internal(format_args!("parameters do not survive being written as JSON: {error}"))
}

#[cfg(test)]
mod tests {
    use tesserae_mesh::mesh::Format;

    use super::*;

    const OBJ: InputFormat = InputFormat::Mesh(Format::Obj);

    fn wanted(query: &str) -> Result<WantedJob> {
        WantedJob::from_query(&format!("/v1/jobs?{query}").parse().expect("a URI"))
    }

    fn with_json(query: &str, json: &str) -> Result<Spec> {
        let mut wanted = wanted(query)?;
        wanted.add_json(json.as_bytes())?;
        wanted.finish(OBJ, |_| false)
    }

    #[test]
    fn query_and_part_add_up() {
        let parameters = with_json("seed=7&format=obj", r#"{"clusters": 9}"#).expect("both").parameters;
        assert_eq!((parameters.seed, parameters.clusters), (7, Some(9)));
    }

    #[test]
    fn no_parameter_stands_in_both() {
        for (query, json, name) in [
            ("clusters=9", r#"{"clusters": 9}"#, "clusters"),
            ("clusters=9&seed=0", r#"{"seed": 1}"#, "seed"),
            ("clusters=9&webhook=x", r#"{"webhook": "x"}"#, "webhook"),
            ("clusters=9&priority=1", r#"{"priority": 1}"#, "priority"),
        ] {
            let error = with_json(query, json).expect_err(query);
            assert_eq!(error.kind, Kind::InvalidParameter);
            assert!(error.message.ends_with(&format!(": {name}")), "{error}");
        }
    }

    #[test]
    fn what_is_kept_means_the_same_in_every_form() {
        let both = Kept { outputs: vec!["mesh.glb".to_owned(), "mesh.ply".to_owned()], mesh: true };
        for (query, json) in [
            ("clusters=9&outputs=mesh,mesh.ply&keep_mesh=true", "{}"),
            ("clusters=9", r#"{"outputs": ["mesh", "mesh.ply"], "keep_mesh": true}"#),
            ("clusters=9&outputs=mesh.glb%2Cmesh.ply", r#"{"keep_mesh": true}"#),
            ("clusters=9&keep_mesh=true", r#"{"outputs": "mesh,mesh.ply"}"#),
        ] {
            assert_eq!(with_json(query, json).expect(query).kept, both, "{query} {json}");
        }
        for (query, json) in [
            ("clusters=9&outputs=mesh", r#"{"outputs": ["mesh.ply"]}"#),
            ("clusters=9&keep_mesh=false", r#"{"keep_mesh": true}"#),
            ("clusters=9", r#"{"keep_mesh": 1}"#),
            ("clusters=9", r#"{"outputs": [1]}"#),
            ("algorithm=pml", r#"{"outputs": ["mesh"]}"#),
        ] {
            assert_eq!(with_json(query, json).expect_err(json).kind, Kind::InvalidParameter, "{query} {json}");
        }
    }

    #[test]
    fn levels_mean_the_same_in_every_form() {
        for (query, json) in [
            ("algorithm=pml&levels=20,10", "{}"),
            ("algorithm=pml&levels=20%2C10", "{}"),
            ("algorithm=pml", r#"{"levels": [20, 10]}"#),
            ("algorithm=pml", r#"{"levels": "20,10"}"#),
        ] {
            assert_eq!(with_json(query, json).expect(query).parameters.levels(), [20, 10], "{query} {json}");
        }
        assert!(with_json("algorithm=pml&levels=20", r#"{"levels": [30]}"#).is_err());
    }

    #[test]
    fn what_a_form_may_still_make_right_is_not_refused_early() {
        assert_eq!(wanted("levels=20").and_then(|wanted| wanted.check_early(true)), Ok(()));
        assert!(wanted("levels=20&clusters=3").and_then(|wanted| wanted.check_early(false)).is_err());
        assert!(wanted("clusters=0").and_then(|wanted| wanted.check_early(true)).is_err());
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (query, name) in [
            ("clusters=2&cluster=3", "`cluster`"),
            ("clusters=two", "clusters"),
            ("clusters=-1", "clusters"),
            ("clusters=2&format=fbx", "fbx"),
            ("clusters=2&seeds=file:/etc/passwd", "/etc/passwd"),
            ("clusters=2&clusters=2", "clusters"),
            ("clusters=2&algorithm=magic", "magic"),
            ("algorithm=pml&levels=", "levels"),
            ("algorithm=pml&levels=9,x", "9,x"),
            ("algorithm=pml&ties=none", "ties"),
            ("clusters=2&priority=101", "101"),
            ("clusters=2&priority=high", "high"),
            ("clusters=2&keep_mesh=yes", "yes"),
        ] {
            let error = wanted(query).expect_err(query);
            assert_eq!(error.kind, Kind::InvalidParameter, "{query}: {error}");
            assert!(error.message.contains(name), "{query}: {error}");
        }
    }

    #[test]
    fn malformed_json_is_a_bad_request_and_wrong_json_a_wrong_parameter() {
        for json in ["{", "", "{} {}"] {
            assert_eq!(with_json("", json).expect_err(json).kind, Kind::BadRequest, "{json}");
        }
        for json in [
            "[1]",
            "3",
            r#"{"clusters": "3"}"#,
            r#"{"clusters": 3, "x": 1}"#,
            r#"{"clusters": 3, "clusters": 4}"#,
            r#"{"webhook": "https://a.example/", "clusters": 3, "clusters": 4}"#,
            r#"{"webhook": "https://a.example/", "webhook": "https://b.example/", "clusters": 3}"#,
            r#"{"webhook": "https://a.example/", "clusters": 3, "x": 4}"#,
            r#"{"webhook": null, "clusters": 3}"#,
            r#"{"clusters": 0}"#,
            r#"{"clusters": 3, "priority": 1.5}"#,
            r#"{"clusters": 3, "priority": -101}"#,
            "{}",
            r#"{"clusters": 3, "seeds": "file:x"}"#,
        ] {
            assert_eq!(with_json("", json).expect_err(json).kind, Kind::InvalidParameter, "{json}");
        }
    }

    #[test]
    fn a_list_of_seeds_stands_for_clusters_and_excludes_seeds() {
        let spec = wanted("seeds=listed").and_then(|wanted| wanted.finish(OBJ, |part| part == files::SEEDS));
        assert_eq!(spec.map(|spec| spec.parameters.seeds), Ok(Seeds::Listed));
        assert!(wanted("").and_then(|wanted| wanted.finish(OBJ, |part| part == files::SEEDS)).is_ok());
        assert!(wanted("").and_then(|wanted| wanted.finish(OBJ, |_| false)).is_err());
        assert!(wanted("seeds=random").and_then(|wanted| wanted.finish(OBJ, |part| part == files::SEEDS)).is_err());
    }
}
