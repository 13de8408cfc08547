//! What a request may say, and how a wrong one is refused.

use tesserae_mesh::mesh::Format;

use super::*;

const OBJ: InputFormat = InputFormat::Mesh(Format::Obj);
const LISTED: Beside = Beside { listed_seeds: true, has_weights: false, has_graph: false };

fn wanted(query: &str) -> Result<Wanted> {
    Wanted::from_query(&format!("/v1/jobs?{query}").parse().expect("a URI"))
}

fn with_json(query: &str, json: &str) -> Result<Parameters> {
    let mut wanted = wanted(query)?;
    wanted.add_json(json.as_bytes())?;
    wanted.finish(OBJ, Beside::default()).map(|spec| spec.parameters)
}

#[test]
fn query_and_part_add_up() {
    let parameters = with_json("seed=7&format=obj", r#"{"clusters": 9}"#).expect("both");
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
    let kept = |query: &str, json: &str| {
        let mut wanted = wanted(query)?;
        wanted.add_json(json.as_bytes())?;
        wanted.finish(OBJ, Beside::default()).map(|spec| spec.kept)
    };
    let both = Kept { outputs: vec!["mesh.glb".to_owned(), "mesh.ply".to_owned()], mesh: true };
    for (query, json) in [
        ("clusters=9&outputs=mesh,mesh.ply&keep_mesh=true", "{}"),
        ("clusters=9", r#"{"outputs": ["mesh", "mesh.ply"], "keep_mesh": true}"#),
        ("clusters=9&outputs=mesh.glb%2Cmesh.ply", r#"{"keep_mesh": true}"#),
        ("clusters=9&keep_mesh=true", r#"{"outputs": "mesh,mesh.ply"}"#),
    ] {
        assert_eq!(kept(query, json), Ok(both.clone()), "{query} {json}");
    }
    for (query, json) in [
        ("clusters=9&outputs=mesh", r#"{"outputs": ["mesh.ply"]}"#),
        ("clusters=9&keep_mesh=false", r#"{"keep_mesh": true}"#),
        ("clusters=9", r#"{"keep_mesh": 1}"#),
        ("clusters=9", r#"{"outputs": [1]}"#),
        ("algorithm=pml", r#"{"outputs": ["mesh"]}"#),
    ] {
        assert_eq!(kept(query, json).expect_err(json).kind, Kind::InvalidParameter, "{query} {json}");
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
        let parameters = with_json(query, json).expect(query);
        assert_eq!(parameters.levels(), [20, 10], "{query} {json}");
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
    for (json, kind) in [
        ("{", Kind::BadRequest),
        ("", Kind::BadRequest),
        ("[1]", Kind::InvalidParameter),
        ("3", Kind::InvalidParameter),
        (r#"{"clusters": "3"}"#, Kind::InvalidParameter),
        (r#"{"clusters": 3, "x": 1}"#, Kind::InvalidParameter),
        (r#"{"clusters": 3, "clusters": 4}"#, Kind::InvalidParameter),
        (r#"{"webhook": "https://a.example/", "clusters": 3, "clusters": 4}"#, Kind::InvalidParameter),
        (
            r#"{"webhook": "https://a.example/", "webhook": "https://b.example/", "clusters": 3}"#,
            Kind::InvalidParameter,
        ),
        (r#"{"webhook": "https://a.example/", "clusters": 3, "x": 4}"#, Kind::InvalidParameter),
        (r#"{"webhook": null, "clusters": 3}"#, Kind::InvalidParameter),
        (r#"{"clusters": 0}"#, Kind::InvalidParameter),
        (r#"{"clusters": 3, "priority": 1.5}"#, Kind::InvalidParameter),
        (r#"{"clusters": 3, "priority": -101}"#, Kind::InvalidParameter),
        (r#"{}"#, Kind::InvalidParameter),
        (r#"{"clusters": 3, "seeds": "file:x"}"#, Kind::InvalidParameter),
    ] {
        let error = with_json("", json).expect_err(json);
        assert_eq!(error.kind, kind, "{json}: {error}");
    }
}

#[test]
fn a_list_of_seeds_stands_for_clusters_and_excludes_seeds() {
    let spec = wanted("seeds=listed").and_then(|wanted| wanted.finish(OBJ, LISTED));
    assert_eq!(spec.map(|spec| spec.parameters.seeds), Ok(Seeds::Listed));
    assert!(wanted("").and_then(|wanted| wanted.finish(OBJ, LISTED)).is_ok());
    assert!(wanted("").and_then(|wanted| wanted.finish(OBJ, Beside::default())).is_err());
    assert!(wanted("seeds=random").and_then(|wanted| wanted.finish(OBJ, LISTED)).is_err());
}
