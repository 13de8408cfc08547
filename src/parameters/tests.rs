//! Contradictions between parameters, and their help.

use super::*;
use crate::surface::Moves;

fn parameters(json: serde_json::Value) -> Parameters {
    serde_json::from_value(json).expect("parameters")
}

#[test]
fn what_contradicts_itself_is_refused_and_named() {
    use serde_json::json;
    for (asked, words) in [
        (json!({}), ["clusters", "missing"]),
        (json!({"clusters": 0}), ["clusters", "0"]),
        (json!({"clusters": 9, "levels": [20]}), ["levels", "bb"]),
        (json!({"clusters": 9, "optimize": "none"}), ["optimize", "bb"]),
        (json!({"clusters": 9, "ties": "largest-id"}), ["ties", "bb"]),
        (json!({"clusters": 9, "switch_to_ml_at": 20}), ["switch_to_ml_at", "bb"]),
        (json!({"clusters": 9, "collapse_fraction": 20}), ["collapse_fraction", "bb"]),
        (json!({"clusters": 9, "optimize_iterations": 20}), ["optimize_iterations", "bb"]),
        (json!({"algorithm": "pml", "seeds": "random"}), ["seeds", "pml"]),
        (json!({"algorithm": "ml", "seed": 3}), ["seed", "ml"]),
        (json!({"algorithm": "hr", "max_iterations": 3}), ["max_iterations", "hr"]),
        (json!({"algorithm": "ml", "quality": "fast"}), ["quality", "ml"]),
        (json!({"algorithm": "acvd", "clusters": 3, "quality": "best"}), ["quality", "acvd"]),
        (json!({"algorithm": "hr", "optimize_iterations": 3}), ["optimize_iterations", "hr"]),
        (json!({"algorithm": "pml", "optimize": "none", "optimize_iterations": 3}), ["optimize_iterations", "none"]),
        (json!({"algorithm": "ml", "switch_to_ml_at": 3}), ["switch_to_ml_at", "ml"]),
        (json!({"algorithm": "pml", "collapse_fraction": 3}), ["collapse_fraction", "pml"]),
        (json!({"algorithm": "ml", "collapse_fraction": 50.5}), ["collapse_fraction", "50.5"]),
        (json!({"algorithm": "ml", "collapse_fraction": 0}), ["collapse_fraction", "0"]),
        (json!({"algorithm": "pml", "clusters": 0}), ["clusters", "0"]),
        (json!({"clusters": 3, "curvature_exponent": -1}), ["curvature_exponent", "-1"]),
        (json!({"clusters": 3, "curvature_exponent": 10.5}), ["curvature_exponent", "10.5"]),
        (json!({"clusters": 3, "weight_attribute": "WEIGHT"}), ["weight_attribute", "WEIGHT"]),
        (json!({"clusters": 3, "subdivide": 2, "snapshots": 3}), ["subdivide", "snapshots"]),
        (json!({"clusters": 3, "subdivide": "auto", "weight_attribute": "_W"}), ["subdivide", "weight_attribute"]),
        (json!({"algorithm": "hr", "subdivide": 1}), ["subdivide", "hr"]),
        (json!({"clusters": 3, "features": "30,groups", "bridge_components": true}), ["features", "bridge_components"]),
        (json!({"clusters": 3, "weight_attribute": "_"}), ["weight_attribute", "underscore"]),
        (json!({"algorithm": "pml", "clusters": 30, "levels": [100, 20]}), ["levels", "20"]),
    ] {
        let error = parameters(asked.clone()).check(false).expect_err(&asked.to_string());
        assert!(words.iter().all(|word| error.message.contains(word)), "{asked}: {error}");
    }
    let error = parameters(json!({"algorithm": "pml"})).check(true).expect_err("listed seeds");
    assert!(error.message.contains("seeds"), "{error}");
}

#[test]
fn numbers_in_the_help_are_those_of_the_code() {
    let command = <Parameters as clap::Args>::augment_args(clap::Command::new("cluster"));
    let help = |id: &str| {
        let argument = command.get_arguments().find(|argument| argument.get_id() == id).expect(id);
        let help = argument.get_long_help().or(argument.get_help());
        help.expect(id).to_string().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let [fast, default, best] = [Quality::Fast, Quality::Default, Quality::Best];
    let limits = |quality: Quality| [Moves::Free, Moves::Connected].map(|moves| quality.max_iterations(moves));
    let [Some(iterations), Some(connected)] = limits(fast) else { panic!("limits") };
    assert_eq!([default, best].map(limits), [[None; 2]; 2]);
    assert_eq!((fast.refines(), default.refines(), best.refines()), (false, true, true));
    assert_eq!(fast.optimised_from(), default.optimised_from());
    assert_eq!(best.optimised_from(), 1);
    let [few, more, most] = [fast, default, best].map(|quality| quality.start(Moves::Free).surplus_percent);
    let [one, two, many] = [fast, default, best].map(Quality::iterations_a_round);
    for (id, words) in [
        (
            "quality",
            format!("stops after {iterations} iterations on the faces ({connected} for points and normals) and"),
        ),
        ("max_iterations", format!("and {iterations} with quality fast, {connected} for points and normals")),
        ("seeds", format!("begins with {more} percent more clusters on a coarser mesh, {few} with quality fast")),
        ("seeds", format!("and {most} with best, and merges")),
        ("optimize", format!("once clusters have {} faces on average", default.optimised_from())),
        ("optimize_iterations", format!("{two} in parallel rounds ({one} with quality fast, {many} with best)")),
    ] {
        let help = help(id);
        assert!(help.contains(&words), "{id}: {words:?} is not in {help:?}");
    }
}

#[test]
fn hierarchies_need_no_number_of_clusters() {
    use serde_json::json;
    for asked in [
        json!({"algorithm": "pml"}),
        json!({"algorithm": "pml", "switch_to_ml_at": 1633, "collapse_fraction": 0.5, "ties": "largest-id"}),
        json!({"algorithm": "ml", "collapse_fraction": 50, "optimize_iterations": 1, "levels": "70,9"}),
        json!({"algorithm": "hr", "clusters": 9, "levels": [9, 10]}),
        json!({"algorithm": "hr", "optimize": "none", "refine": "none"}),
    ] {
        assert_eq!(parameters(asked.clone()).check(false), Ok(()), "{asked}");
    }
}
