//! What the paper printed: measured in 2011 or before, on a 3 GHz Intel Core 2 Duo and a GeForce GTX 280 (P§7).

/// A mesh that the paper measured.
#[derive(Debug, Clone, Copy)]
pub struct Model {
    /// Its name in the paper.
    pub name: &'static str,
    /// Faces that it has there, in thousands.
    pub thousand_faces: u64,
}

/// The meshes.
pub const MODELS: [Model; 3] = [
    Model { name: "Bunny", thousand_faces: 70 },
    Model { name: "Horse", thousand_faces: 97 },
    Model { name: "Armadillo", thousand_faces: 346 },
];

/// A row of Table 1.
#[derive(Debug, Clone, Copy)]
pub struct FlatRow {
    /// The mesh.
    pub model: &'static str,
    /// Number of clusters.
    pub clusters: u64,
    /// ACVD on the CPU, in seconds.
    pub cpu_acvd_s: f64,
    /// Boundary-based clustering on the GPU, in milliseconds.
    pub gpu_bb_ms: f64,
}

/// Table 1.
pub const TABLE_1: [FlatRow; 6] = [
    FlatRow { model: "Bunny", clusters: 1000, cpu_acvd_s: 3.0, gpu_bb_ms: 172.0 },
    FlatRow { model: "Bunny", clusters: 3000, cpu_acvd_s: 3.0, gpu_bb_ms: 187.0 },
    FlatRow { model: "Horse", clusters: 1000, cpu_acvd_s: 3.0, gpu_bb_ms: 187.0 },
    FlatRow { model: "Horse", clusters: 2000, cpu_acvd_s: 4.0, gpu_bb_ms: 218.0 },
    FlatRow { model: "Armadillo", clusters: 2000, cpu_acvd_s: 12.0, gpu_bb_ms: 1140.0 },
    FlatRow { model: "Armadillo", clusters: 5000, cpu_acvd_s: 16.0, gpu_bb_ms: 891.0 },
];

/// A row of Table 2, in seconds.
#[derive(Debug, Clone, Copy)]
pub struct TreeRow {
    /// The mesh.
    pub model: &'static str,
    /// Multilevel clustering on the CPU.
    pub cpu_ml_s: f64,
    /// The same on the GPU.
    pub gpu_ml_s: f64,
    /// Parallel multilevel clustering on the GPU.
    pub gpu_pml_s: f64,
}

/// Table 2.
pub const TABLE_2: [TreeRow; 3] = [
    TreeRow { model: "Bunny", cpu_ml_s: 281.0, gpu_ml_s: 183.0, gpu_pml_s: 9.0 },
    TreeRow { model: "Horse", cpu_ml_s: 710.0, gpu_ml_s: 283.0, gpu_pml_s: 5.0 },
    TreeRow { model: "Armadillo", cpu_ml_s: 10856.0, gpu_ml_s: 6633.0, gpu_pml_s: 73.0 },
];

/// Figure 6: fewest and most clusters, and the number at which one of its curves goes from PML to ML.
pub const FIGURE_6: (u64, u64, u64) = (1000, 2000, 1633);
