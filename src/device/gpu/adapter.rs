//! What adapters there are, and which of them can cluster.

use super::Tuning;
use super::buffers::Sizes;
use super::kernels::{self, KERNELS, needed};
use super::pages::Bindings;
use crate::device::adapter::{AdapterKind, AdapterReport, LargestMeshes};
use crate::surface::MOST_FACES;

impl From<wgpu::DeviceType> for AdapterKind {
    fn from(kind: wgpu::DeviceType) -> Self {
        match kind {
            wgpu::DeviceType::DiscreteGpu => Self::Discrete,
            wgpu::DeviceType::IntegratedGpu => Self::Integrated,
            wgpu::DeviceType::VirtualGpu => Self::Virtual,
            wgpu::DeviceType::Other => Self::Other,
            wgpu::DeviceType::Cpu => Self::Software,
        }
    }
}

/// An adapter that was found.
#[derive(Debug, Clone)]
pub struct Found {
    /// What is said about it.
    pub report: AdapterReport,
    pub(super) adapter: wgpu::Adapter,
}

impl Found {
    /// Whether buffers beyond its largest binding can have [`super::pages`].
    pub fn has_pages(&self) -> bool {
        bindings(&self.adapter).pages > 1
    }
}

/// What an adapter binds.
fn bindings(adapter: &wgpu::Adapter) -> Bindings {
    Bindings::new(adapter.features(), &adapter.limits(), kernels::most_bound())
}

/// Looks for adapters. This loads the drivers, which takes 20 to 370 ms.
///
/// Where Mesa's device-select layer is installed and there is no desktop, libwayland writes a line about
/// `XDG_RUNTIME_DIR` to standard error: wgpu requests the Wayland extension even without a window, and the layer then
/// searches a compositor. `NODEVICE_SELECT=1` in the environment turns the layer off.
pub fn enumerate() -> Vec<Found> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    // no dispatch is indirect, so wgpu need not compile what checks those
    descriptor.flags = wgpu::InstanceFlags::from_build_config() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL;
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
        .into_iter()
        .enumerate()
        .map(|(index, adapter)| Found { report: report(index, &adapter), adapter })
        .collect()
}

fn report(index: usize, adapter: &wgpu::Adapter) -> AdapterReport {
    let info = adapter.get_info();
    let limits = adapter.limits();
    let reason = unusable(adapter.features(), adapter.get_downlevel_capabilities().flags, &limits);
    AdapterReport {
        index,
        name: info.name,
        kind: info.device_type.into(),
        backend: info.backend.to_str().to_owned(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        usable: reason.is_none(),
        reason,
        largest: largest_meshes(&bindings(adapter)),
    }
}

/// Faces for each cluster in the largest meshes: what a parallel hierarchy has on average when its first round is
/// optimised.
pub(super) const FACES_A_CLUSTER: u64 = 4;

/// The largest closed triangle meshes, by the sizes of their buffers.
pub(super) fn largest_meshes(bindings: &Bindings) -> LargestMeshes {
    let [flat, hierarchy] = [false, true].map(|is_merging| {
        let needed = needed(is_merging);
        let fits = |faces: u64| bindings.hold(&needed, &Sizes::of(3, faces, (faces / FACES_A_CLUSTER).max(1)));
        let (mut least, mut beyond) = (0, MOST_FACES as u64 + 1);
        while beyond - least > 1 {
            let middle = least.midpoint(beyond);
            *(if fits(middle) { &mut least } else { &mut beyond }) = middle;
        }
        least
    });
    LargestMeshes { flat, hierarchy }
}

/// Why an adapter with these properties cannot cluster.
fn unusable(features: wgpu::Features, flags: wgpu::DownlevelFlags, limits: &wgpu::Limits) -> Option<String> {
    let workgroup = Tuning::default().workgroup;
    let storage_buffers = KERNELS.iter().filter(|kernel| !kernel.needs_many_buffers());
    let storage_buffers = storage_buffers.map(|kernel| kernel.bindings().len() as u32).max().unwrap_or(0);
    let bindable = limits.max_storage_buffers_per_shader_stage;
    if !features.contains(wgpu::Features::SHADER_INT64) {
        Some("it has no 64-bit integers in shaders".to_owned())
    } else if !flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS) {
        Some("it has no compute shaders".to_owned())
    } else if bindable < storage_buffers {
        Some(format!("a shader needs {storage_buffers} storage buffers, it has {bindable}"))
    } else if limits.max_compute_invocations_per_workgroup.min(limits.max_compute_workgroup_size_x) < workgroup {
        Some(format!("a workgroup needs {workgroup} threads, it has {}", limits.max_compute_invocations_per_workgroup))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adapter_is_unusable_for_a_reason() {
        let features = wgpu::Features::SHADER_INT64;
        let flags = wgpu::DownlevelFlags::all();
        let limits = wgpu::Limits::default();
        assert_eq!(unusable(features, flags, &limits), None);
        let reason = |features, flags, limits: &wgpu::Limits| unusable(features, flags, limits).expect("unusable");
        assert!(reason(wgpu::Features::empty(), flags, &limits).contains("64-bit"));
        assert!(reason(features, wgpu::DownlevelFlags::empty(), &limits).contains("compute"));
        let few_buffers = wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..limits.clone() };
        assert!(reason(features, flags, &few_buffers).ends_with("it has 4"));
        let few_threads = wgpu::Limits { max_compute_invocations_per_workgroup: 128, ..limits };
        assert!(reason(features, flags, &few_threads).ends_with("it has 128"));
    }
}
