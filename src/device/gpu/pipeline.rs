//! Kernels compiled.

use super::Tuning;
use super::kernels::Kernel;

/// The layout of a kernel's bind group, and its pipeline.
pub(super) type Compiled = (wgpu::BindGroupLayout, wgpu::ComputePipeline);

/// A kernel of none of the tables, with the bindings that its source declares.
pub(super) fn with_own_layout(device: &wgpu::Device, name: &str, wgsl: &str) -> Compiled {
    let (label, source) = (Some(name), wgpu::ShaderSource::Wgsl(wgsl.into()));
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label, source });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label,
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    (pipeline.get_bind_group_layout(0), pipeline)
}

/// Binding 0 is the uniform, at an offset that each dispatch chooses; then come the storage buffers of the row.
pub(super) fn compile(device: &wgpu::Device, kernel: &Kernel, tuning: &Tuning, axes: usize) -> Compiled {
    let storage = |is_written: bool| wgpu::BufferBindingType::Storage { read_only: !is_written };
    let types = kernel.bindings().into_iter().map(|binding| storage(binding.is_written));
    let entries: Vec<_> = (0..)
        .zip(std::iter::once(wgpu::BufferBindingType::Uniform).chain(types))
        .zip(kernel.binding_sizes(axes))
        .map(|((binding, ty), bytes)| wgpu::BindGroupLayoutEntry {
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
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label,
        source: wgpu::ShaderSource::Wgsl(kernel.source(tuning, axes).into()),
    });
    let constants: Vec<_> = kernel.constant.into_iter().map(|(name, value)| (name, f64::from(value))).collect();
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label,
        layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        })),
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
        cache: None,
    });
    (layout, pipeline)
}
