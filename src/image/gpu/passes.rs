//! Compute pipelines and their dispatch.

use crate::gpu::{device::GpuDevice, error::GpuError};

/// Invocations of every workgroup.
pub const WORKGROUP: u32 = 64;
/// Workgroups along one axis of a dispatch, by wgpu's default limits.
pub const MOST_WORKGROUPS: u32 = 65_535;

/// A compute pipeline with one bind group: bindings 0, 1, 2, ... in the order given to `bind`.
#[derive(Debug)]
pub struct ComputePass {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
}

impl ComputePass {
    /// Compiles the entry point `main` of a shader.
    ///
    /// # Errors
    /// When the shader or the pipeline is refused.
    pub fn new(gpu: &GpuDevice, name: &'static str, wgsl: String) -> Result<Self, GpuError> {
        let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        });
        gpu.check()?;
        let pipeline = gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        gpu.check()?;
        Ok(Self { name, pipeline })
    }

    /// Binds buffers and tables.
    pub fn bind<const N: usize>(&self, gpu: &GpuDevice, resources: [wgpu::BindingResource<'_>; N]) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry<'_>> =
            (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }

    /// Records one dispatch; nothing when it is empty.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, group: &wgpu::BindGroup, workgroups: [u32; 3]) {
        if workgroups.contains(&0) {
            return;
        }
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(self.name), timestamp_writes: None });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        let [x, y, z] = workgroups;
        pass.dispatch_workgroups(x, y, z);
    }
}

/// Workgroups for `invocations` along x, carried over into y above the limit of one axis. The shader's own index is
/// `(workgroup.y * workgroups.x + workgroup.x) * WORKGROUP + local`, and may pass the end.
pub fn grid(invocations: u32) -> [u32; 3] {
    let workgroups = invocations.div_ceil(WORKGROUP);
    let rows = workgroups.div_ceil(MOST_WORKGROUPS);
    if rows == 0 { [0; 3] } else { [workgroups.div_ceil(rows), rows, 1] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_cover_all_and_stay_within_an_axis() {
        for invocations in [0, 1, 64, 65, 65_535 * 64, 65_535 * 64 + 1, u32::MAX] {
            let [x, y, z] = grid(invocations);
            let covered = u64::from(x) * u64::from(y) * u64::from(z) * u64::from(WORKGROUP);
            assert!(covered >= u64::from(invocations), "{invocations}: {covered}");
            assert!(x <= MOST_WORKGROUPS && y <= MOST_WORKGROUPS, "{invocations}: {x} x {y}");
        }
    }
}
