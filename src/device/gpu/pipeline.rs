//! Kernels compiled.

use std::num::NonZeroU32;

use super::Tuning;
use super::kernels::Kernel;
use super::layout::Iteration;
use super::pages::{Bindings, MOST_PAGES};

/// The layout of a kernel's bind group of storage buffers, and its pipeline.
pub(super) type Compiled = (wgpu::BindGroupLayout, wgpu::ComputePipeline);

/// A kernel of none of the tables, with the bindings that its source declares.
pub(super) fn with_own_layout(device: &wgpu::Device, name: &str, wgsl: &str) -> Compiled {
    let pipeline = pipeline(device, name, wgsl, None, &[]);
    (pipeline.get_bind_group_layout(0), pipeline)
}

/// The layout of group 0: the uniform, at an offset that each dispatch chooses.
pub(super) fn iteration_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let uniform = (wgpu::BufferBindingType::Uniform, size_of::<Iteration>());
    layout(device, "iteration", [uniform], None)
}

/// The layout of a group of buffers of these kinds and least bytes; with a count, each binding is an array.
fn layout(
    device: &wgpu::Device,
    name: &str,
    bindings: impl IntoIterator<Item = (wgpu::BufferBindingType, usize)>,
    count: Option<NonZeroU32>,
) -> wgpu::BindGroupLayout {
    let entry = |(binding, (ty, bytes)): (u32, (wgpu::BufferBindingType, usize))| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: ty == wgpu::BufferBindingType::Uniform,
            min_binding_size: wgpu::BufferSize::new(bytes as u64),
        },
        count,
    };
    let entries: Vec<_> = (0..).zip(bindings).map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(name), entries: &entries })
}

/// A kernel for points of so many axes; with `pages`, for buffers in pages. Group 0 is that of [`iteration_layout`],
/// group 1 has the storage buffers of the row.
pub(super) fn compile(
    (device, iteration): (&wgpu::Device, &wgpu::BindGroupLayout),
    kernel: &Kernel,
    tuning: &Tuning,
    axes: usize,
    pages: Option<&Bindings>,
) -> Compiled {
    let storage = kernel.bindings().into_iter().map(|binding| {
        let (ty, spec) = (wgpu::BufferBindingType::Storage { read_only: !binding.is_written }, binding.buffer.spec());
        (ty, spec.bytes_of(1, axes) as usize)
    });
    let count = pages.and_then(|_| NonZeroU32::new(MOST_PAGES as u32));
    let layout = layout(device, kernel.name, storage, count);
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(kernel.name),
        bind_group_layouts: &[Some(iteration), Some(&layout)],
        immediate_size: 0,
    });
    let constants: Vec<_> = kernel.constant.into_iter().map(|(name, value)| (name, f64::from(value))).collect();
    let pipeline =
        pipeline(device, kernel.name, &kernel.source(tuning, axes, pages), Some(&pipeline_layout), &constants);
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
