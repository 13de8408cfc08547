//! From a mesh to a [`Prepared`] one: the part of a job that is the same whether the mesh was read or is in memory.

use std::time::Instant;

use super::subject::Seen;
use super::{InputFile, JobSpec, Prepared, Refusal, milliseconds, weight_list};
use crate::energy;
use crate::error::{Error, Kind};
use crate::mesh::{Adjusted, Format, Limits, MeshView, Part};
use crate::parameters::{Features, Name, Parameters};
use crate::report::{Input, MeshInput, Timings, WeightedBy};
use crate::surface::{Surface, Wanted, WantedFeatures, lattice};

/// A job on a mesh that this program has in memory; a [`Request`](super::Request) has the bytes of a file.
#[derive(Debug, Clone, Copy)]
pub struct InMemory<'a> {
    /// The mesh.
    pub mesh: MeshView<'a>,
    /// Largest number of faces.
    pub limits: Limits,
    /// What to do.
    pub parameters: &'a Parameters,
    /// A list of seeds, as in a [`Request`](super::Request).
    pub seeds: Option<&'a [u8]>,
    /// A file with weights, as in a [`Request`](super::Request).
    pub weights: Option<&'a [u8]>,
}

/// Checks and prepares a mesh in memory. Its points are not copied, and it is not kept.
pub fn prepare_in_memory(job: &InMemory<'_>) -> Result<Prepared, Refusal> {
    let checked = Checked::new(job.parameters, job.seeds, job.weights)?;
    if let Some(name) = &checked.spec.weight_attribute {
        return Err(Refusal::from(Error::parameter(format_args!(
            "{} goes with glTF files, not with a mesh in memory; give {}: {name:?}",
            Name::WEIGHT_ATTRIBUTE,
            Name::WEIGHTS
        ))));
    }
    if checked.spec.subdivide.is_some() {
        return Err(Refusal::from(Error::parameter(format_args!(
            "{} goes with mesh files: divide a mesh in memory before it is clustered",
            Name::SUBDIVIDE
        ))));
    }
    if checked.spec.features.is_some_and(|features| features.groups) {
        return Err(Refusal::from(Error::parameter(format_args!(
            "groups go with OBJ and glTF files, not with a mesh in memory: leave groups out of {}",
            Name::FEATURES
        ))));
    }
    job.limits.check_faces(job.mesh.faces.len() as u64).map_err(Refusal::of(InputFile::Mesh))?;
    checked.lay(job.mesh, About::default(), Vec::new())?.plan()
}

/// Prepares a surface that the caller built of a mesh in memory, such as one of its points; without seeds and weights.
pub fn prepare_surface(parameters: &Parameters, mesh: MeshView<'_>, surface: Surface) -> Result<Prepared, Refusal> {
    let checked = Checked::new(parameters, None, None)?;
    let of_faces = [
        (Name::FEATURES, checked.spec.features.is_some()),
        (Name::ENERGY, checked.spec.energy != energy::Kind::default()),
    ];
    if let Some((name, _)) = of_faces.into_iter().find(|&(_, is_given)| is_given) {
        return Err(Refusal::from(Error::parameter(format_args!(
            "{name} goes with faces, not with the points of a mesh: leave it out"
        ))));
    }
    checked.laid(mesh, surface, Instant::now(), About::default(), Vec::new())?.plan()
}

/// A job whose parameters, seeds and weights were read and checked.
pub(super) struct Checked {
    pub spec: JobSpec,
    weights: Option<Vec<f64>>,
    started: Instant,
}

/// What is known of a mesh besides points and faces.
#[derive(Default)]
pub(super) struct About {
    pub format: Option<Format>,
    pub adjusted: Adjusted,
    pub parts: Vec<Part>,
    /// Weights of an attribute.
    pub weights: Option<Vec<f64>>,
    /// One a face, if features are at the edges of groups.
    pub groups: Option<Vec<u32>>,
}

impl Checked {
    pub fn new(parameters: &Parameters, seeds: Option<&[u8]>, weights: Option<&[u8]>) -> Result<Self, Refusal> {
        let started = Instant::now();
        parameters.check_mesh()?;
        let spec = JobSpec::new(parameters, seeds)?;
        if weights.is_some() && spec.weight_attribute.is_some() {
            return Err(Refusal::from(Error::parameter(format_args!(
                "{} and {} exclude each other: give one of them",
                Name::WEIGHTS,
                Name::WEIGHT_ATTRIBUTE
            ))));
        }
        if weights.is_some() && spec.subdivide.is_some() {
            return Err(Refusal::from(Error::parameter(format_args!(
                "{} divides the faces that {} is about: leave one of them out",
                Name::SUBDIVIDE,
                Name::WEIGHTS
            ))));
        }
        if weights.is_some() && spec.energy.is_of_shapes() {
            return Err(Refusal::from(parameters.is_not_of_shapes(Name::WEIGHTS)));
        }
        let weights = weights.map(weight_list::parse).transpose().map_err(Refusal::of(InputFile::Weights))?;
        Ok(Self { spec, weights, started })
    }

    /// Builds the surface. Weights are those of an attribute where none are listed; warnings are added to those given.
    pub fn lay(mut self, mesh: MeshView<'_>, mut about: About, mut warnings: Vec<String>) -> Result<Laid, Refusal> {
        let parsed = Instant::now();
        let are_listed = self.weights.is_some();
        let weights = self.weights.take().or(about.weights.take());
        let curvature_exponent = self.spec.curvature_exponent;
        let density = Wanted { weights: weights.as_deref(), curvature_exponent };
        let wanted = |features: Features| WantedFeatures { angle: features.angle, groups: about.groups.as_deref() };
        let features = self.spec.features.map(wanted);
        let surface = Surface::build_with(mesh, self.spec.bridge_components, density, features).map_err(|error| {
            let of_weights = are_listed && error.kind == Kind::InvalidParameter;
            Refusal::of(if of_weights { InputFile::Weights } else { InputFile::Mesh })(error)
        })?;
        if let Some(weights) = &weights {
            warnings.extend(lattice::lost_weights(weights.iter().copied(), &surface.weights, "faces"));
        }
        let mut laid = self.laid(mesh, surface, parsed, about, warnings)?;
        if are_listed && mesh.faces.len() == mesh.positions.len() {
            laid.warnings.push(format!(
                "there are as many faces as vertices, and the weights were taken as one a face: {}",
                mesh.faces.len()
            ));
        }
        if weights.is_some() {
            laid.weighted_by.push(if are_listed { WeightedBy::Weights } else { WeightedBy::Attribute });
        }
        if curvature_exponent.is_some() {
            laid.weighted_by.push(WeightedBy::Curvature);
        }
        Ok(laid)
    }

    /// Sees a surface, which was begun at `parsed`, as the energy does.
    fn laid(
        self,
        mesh: MeshView<'_>,
        surface: Surface,
        parsed: Instant,
        about: About,
        mut warnings: Vec<String>,
    ) -> Result<Laid, Refusal> {
        let Self { spec, started, .. } = self;
        let counts = surface.counts;
        if counts.degenerate_faces > 0 {
            warnings.push(format!("degenerate faces, with two corners at one position: {}", counts.degenerate_faces));
        }
        let weighed = counts.zero_area_faces - counts.loose_faces;
        if weighed > 0 {
            warnings.push(format!("faces without area, which weigh as little as a face can: {weighed}"));
        }
        if 2 * counts.tiny_faces > mesh.faces.len() as u64 {
            warnings.push(format!(
                "faces smaller than the squares of the lattice, {:e} wide, that places are rounded to: {}; they look \
                 alike, so cut off outliers, such as a vertex that is far away",
                libm::ldexp(1.0, -surface.frame().exponent),
                counts.tiny_faces
            ));
        }
        if counts.loose_faces > 0 {
            warnings.push(format!(
                "faces without area that share no edge with the others, which take no cluster and have the label of \
                 a face beside them: {}",
                counts.loose_faces
            ));
        }
        let input = describe(mesh, about, &surface);
        let seen = Seen::of(surface, mesh, &spec)?;
        Ok(Laid { seen, spec, input, weighted_by: Vec::new(), warnings, started, parsed })
    }
}

/// A job on a surface, which needs neither the mesh nor its bytes any more.
pub(super) struct Laid {
    seen: Seen,
    spec: JobSpec,
    input: Input,
    weighted_by: Vec<WeightedBy>,
    warnings: Vec<String>,
    started: Instant,
    parsed: Instant,
}

impl Laid {
    /// Chooses how to go about it.
    pub fn plan(self) -> Result<Prepared, Refusal> {
        let Self { seen, spec, input, weighted_by, warnings, started, parsed } = self;
        let subject = seen.planned(&spec.clustering)?;
        let timings = Timings {
            parse: milliseconds(parsed - started),
            topology: milliseconds(parsed.elapsed()),
            ..Timings::default()
        };
        Ok(Prepared {
            subject,
            spec,
            input,
            weighted_by,
            warnings,
            mesh: None,
            wants_table: false,
            origin: None,
            viewer: None,
            timings,
        })
    }
}

impl Prepared {
    /// Prepares the same for another number of clusters. Its timings are those of this alone.
    pub fn with_clusters(&mut self, clusters: u64) -> Result<(), Refusal> {
        let started = Instant::now();
        self.spec = self.spec.with_clusters(clusters)?;
        self.subject.replan(&self.spec.clustering)?;
        self.timings = Timings { topology: milliseconds(started.elapsed()), ..Timings::default() };
        Ok(())
    }

    /// Whether a gpu is slow at it, cannot do it, or does the smaller part of it.
    pub fn wants_cpu(&self) -> bool {
        self.spec.clustering.is_sequential() || self.spec.energy.is_of_shapes() || self.subject.is_for_cpu()
    }
}

/// What was read, for the report.
fn describe(mesh: MeshView<'_>, about: About, surface: &Surface) -> Input {
    let About { format, adjusted, parts, .. } = about;
    let counts = surface.counts;
    Input::Mesh(MeshInput {
        format,
        vertices: mesh.positions.len() as u64 + adjusted.vertices_left_out,
        faces: mesh.faces.len() as u64,
        triangles: mesh.faces.triangles(),
        welded_vertices: counts.welded_vertices,
        joined_across_parts: adjusted.joined_across_parts,
        components: counts.components,
        boundary_edges: counts.boundary_edges,
        non_manifold_edges: counts.non_manifold_edges,
        degenerate_faces: counts.degenerate_faces,
        loose_faces: counts.loose_faces,
        duplicate_faces: counts.duplicate_faces,
        feature_edges: surface.features.len() as u64,
        parts,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::npy_header;
    use crate::dev::sample::{Sample, generate};
    use crate::device::{Cancel, cpu::CpuDevice};
    use crate::job::{Request, prepare, run};
    use crate::mesh::Positions;

    #[test]
    fn a_mesh_in_memory_has_the_labels_of_its_file_in_both_precisions() {
        let mesh = generate(Sample::Parts, 600).expect("a sample");
        let single: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.map(|x| x as f32)).collect();
        let rounded = single.iter().map(|p| p.map(f64::from)).collect::<Vec<_>>();
        let parameters = Parameters { clusters: Some(40), ..Parameters::default() };
        let labels_of = |prepared: &Prepared| {
            run(prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| ()).expect("labels").labels
        };
        let in_memory = |positions| {
            let mesh = MeshView::new(positions, &mesh.faces).expect("a mesh");
            let job = InMemory { mesh, limits: Limits::default(), parameters: &parameters, seeds: None, weights: None };
            prepare_in_memory(&job).expect("a prepared mesh")
        };
        let mut file = Vec::new();
        crate::dev::sample::write_obj(&mut file, &mesh).expect("a vector takes everything");
        let request = Request::new(&file, Format::Obj, &parameters);
        let (of_file, of_memory) = (prepare(&request).expect("a mesh"), in_memory(Positions::Double(&mesh.positions)));
        assert_eq!(labels_of(&of_file), labels_of(&of_memory));
        let format = |prepared: &Prepared| match &prepared.input {
            Input::Mesh(mesh) => mesh.format,
            Input::Points(_) => panic!("a mesh"),
        };
        assert_eq!((format(&of_file), format(&of_memory)), (Some(Format::Obj), None));
        let (double, single) = (in_memory(Positions::Double(&rounded)), in_memory(Positions::Single(&single)));
        assert_eq!(labels_of(&double), labels_of(&single));
    }

    #[test]
    fn weights_that_are_lost_beside_a_large_one_are_named() {
        let mesh = generate(Sample::Sphere, 500).expect("a sample");
        let parameters = Parameters { clusters: Some(5), ..Parameters::default() };
        let warnings = |heavy: f64| {
            let weights: Vec<f64> = (0..mesh.faces.len()).map(|face| if face == 0 { heavy } else { 1.0 }).collect();
            let bytes = weights.iter().flat_map(|weight| weight.to_le_bytes());
            let weights: Vec<u8> =
                npy_header("<f8", &format!("({},)", weights.len())).into_iter().chain(bytes).collect();
            let (limits, weights) = (Limits::default(), Some(&weights[..]));
            let job = InMemory { mesh: (&mesh).into(), limits, parameters: &parameters, seeds: None, weights };
            prepare_in_memory(&job).expect("a prepared mesh").warnings
        };
        assert_eq!(warnings(1e3), Vec::<String>::new());
        assert!(warnings(1e12)[0].starts_with("weights of faces below"));
    }

    #[test]
    fn what_needs_a_file_or_is_over_the_limit_is_refused() {
        let mesh = generate(Sample::Knot, 500).expect("a sample");
        let parameters = Parameters { clusters: Some(5), ..Parameters::default() };
        let refusal = |parameters: &Parameters, max_faces| {
            let limits = Limits { max_faces, ..Limits::default() };
            let job = InMemory { mesh: (&mesh).into(), limits, parameters, seeds: None, weights: None };
            prepare_in_memory(&job).expect_err("a refusal").error
        };
        assert_eq!(refusal(&parameters, 10).kind, Kind::TooLarge);
        let with_attribute = Parameters { weight_attribute: Some("_W".to_owned()), ..parameters };
        assert!(refusal(&with_attribute, 1 << 20).message.contains("glTF"));
    }
}
