//! Names of parameters in messages: `bridge_components` over HTTP, `--bridge-components` on the command line.

use std::fmt::{self, Display};
use std::sync::atomic::{AtomicBool, Ordering};

use super::Error;

/// Whether messages of this process spell parameters as flags.
static AS_FLAGS: AtomicBool = AtomicBool::new(false);

/// Spells parameters as flags of the command line in all messages of this process, or as over HTTP, the default.
///
/// Set once, before the work begins: a process either is a command or serves HTTP.
pub fn spell_as_flags(as_flags: bool) {
    AS_FLAGS.store(as_flags, Ordering::Relaxed);
}

/// Whether messages are about flags of the command line.
pub fn are_flags() -> bool {
    AS_FLAGS.load(Ordering::Relaxed)
}

/// The error of a number of clusters above that of the faces or items.
pub fn more_than(name: Name, number: u64, noun: &str, there: impl Display) -> Error {
    Error::parameter(format_args!("{name} must not be more than there are {noun}, {there}: {number}"))
}

/// A parameter that a message names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Name(&'static str);

macro_rules! names {
    ($($constant:ident $text:literal,)*) => {
        #[allow(missing_docs, reason = "each constant is the parameter of the same name")]
        impl Name {
            $(pub const $constant: Name = Name($text);)*

            /// Every name.
            pub const ALL: &[Name] = &[$(Name::$constant),*];
        }
    };
}

names! {
    ALLOW_DISCONNECTED "allow_disconnected",
    BRIDGE_COMPONENTS "bridge_components",
    CLUSTERS "clusters",
    COLLAPSE_FRACTION "collapse_fraction",
    COMPACTNESS "compactness",
    CURVATURE_EXPONENT "curvature_exponent",
    ENERGY "energy",
    FEATURES "features",
    GRAPH "graph",
    LEVELS "levels",
    MAX_CLUSTERS "max_clusters",
    MAX_ITERATIONS "max_iterations",
    MIN_CLUSTERS "min_clusters",
    OPTIMIZE "optimize",
    OPTIMIZE_ITERATIONS "optimize_iterations",
    PAIRS "pairs",
    QUALITY "quality",
    RESOLUTION "resolution",
    SEED "seed",
    SEEDS "seeds",
    SHAPES "shapes",
    SNAPSHOTS "snapshots",
    SUBDIVIDE "subdivide",
    SWITCH_TO_ML_AT "switch_to_ml_at",
    TIES "ties",
    TOLERANCE "tolerance",
    WEIGHTS "weights",
    WEIGHT_ATTRIBUTE "weight_attribute",
}

impl Name {
    /// The name with a value: `optimize=none`, or `--optimize none`.
    pub fn with(self, value: impl Display) -> impl Display {
        let separator = if are_flags() { ' ' } else { '=' };
        format!("{self}{separator}{value}")
    }

    /// The name as a flag or as a parameter over HTTP.
    pub fn spelled(self, as_flag: bool) -> String {
        if as_flag { format!("--{}", self.0.replace('_', "-")) } else { self.0.to_owned() }
    }
}

impl Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.spelled(are_flags()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn over_http_names_have_underscores() {
        assert_eq!(Name::BRIDGE_COMPONENTS.to_string(), "bridge_components");
        assert_eq!(Name::OPTIMIZE.with("none").to_string(), "optimize=none");
        assert_eq!(Name::BRIDGE_COMPONENTS.spelled(true), "--bridge-components");
    }
}
