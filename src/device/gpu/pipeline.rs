//! Kernels compiled.

use super::Tuning;
use super::kernels::Kernel;
use super::layout::Iteration;

/// The layout of a kernel's bind group, and its pipeline.
pub(super) type Compiled = (wgpu::BindGroupLayout, wgpu::ComputePipeline);

/// A kernel of none of the tables, with the bindings that its source declares.
pub(super) fn with_own_layout(device: &wgpu::Device, name: &str, wgsl: &str) -> Compiled {
    let pipeline = pipeline(device, name, wgsl, None, &[]);
    (pipeline.get_bind_group_layout(0), pipeline)
}

/// Binding 0 is the uniform, at an offset that each dispatch chooses; then come the storage buffers of the row.
pub(super) fn compile(device: &wgpu::Device, kernel: &Kernel, tuning: &Tuning, axes: usize) -> Compiled {
    let uniform = (wgpu::BufferBindingType::Uniform, size_of::<Iteration>());
    let storage = kernel.bindings().into_iter().map(|binding| {
        let ty = wgpu::BufferBindingType::Storage { read_only: !binding.is_written };
        (ty, (binding.buffer.spec().stride)(axes))
    });
    let entries: Vec<_> = (0..)
        .zip(std::iter::once(uniform).chain(storage))
        .map(|(binding, (ty, bytes))| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty,
                has_dynamic_offset: binding == 0,
                min_binding_size: wgpu::BufferSize::new(bytes as u64),
            },
            count: None,
        })
        .collect();
    let label = Some(kernel.name);
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries: &entries });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label,
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let constants: Vec<_> = kernel.constant.into_iter().map(|(name, value)| (name, f64::from(value))).collect();
    let pipeline = pipeline(device, kernel.name, &kernel.source(tuning, axes), Some(&pipeline_layout), &constants);
    (layout, pipeline)
}

/// The pipeline of a source. Without a layout it has the bindings that the source declares.
fn pipeline(
    device: &wgpu::Device,
    name: &str,
    wgsl: &str,
    layout: Option<&wgpu::PipelineLayout>,
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    let (label, source) = (Some(name), wgpu::ShaderSource::Wgsl(wgsl.into()));
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label,
        layout,
        module: &device.create_shader_module(wgpu::ShaderModuleDescriptor { label, source }),
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}
