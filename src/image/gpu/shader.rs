//! Compute pipelines and their dispatch; Rust constants as WGSL text, so that a number exists once.

use crate::gpu::device::{GpuDevice, GpuError};
use core::fmt::Write as _;

/// Returns `const NAME = value;` with the digits that give the same f32 back.
pub fn constant(name: &str, value: f32) -> String {
    format!("const {name} = {};\n", literal(value))
}

/// Returns `const NAME: u32 = value;`.
pub fn constant_u32(name: &str, value: u32) -> String {
    format!("const {name} = {value}u;\n")
}

/// Returns `const NAME = true;`: an effect that is off costs nothing, as drivers drop code behind a false constant.
pub fn switch(name: &str, on: bool) -> String {
    format!("const {name} = {on};\n")
}

/// Returns one shader of constants and parts: WGSL takes declarations in any order.
pub fn assemble<'a>(constants: &str, parts: impl IntoIterator<Item = &'a str>) -> String {
    parts.into_iter().fold(constants.to_owned(), |text, part| text + "\n" + part)
}

/// Returns `const NAME_0 = ...; const NAME_1 = ...;`: a polynomial's coefficients.
pub fn coefficients(name: &str, values: &[f32]) -> String {
    values.iter().enumerate().fold(String::new(), |mut text, (i, value)| {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "const {name}_{i} = {};", literal(*value));
        text
    })
}

/// Returns the shortest decimal that reads back as the same number (nine digits at most), with a WGSL suffix.
fn literal(value: f32) -> String {
    format!("{value:e}f")
}

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
    fn literals_give_the_same_number_back() {
        for value in [1.0_f32, -0.1, 2.050_355_3e-6, 16_777_216.0, f32::MIN_POSITIVE, 0.333_333_34] {
            let text = literal(value);
            let back: f32 = text.trim_end_matches('f').parse().expect("a number");
            assert_eq!(back.to_bits(), value.to_bits(), "{text}");
        }
        assert_eq!(assemble(&switch("ON", true), ["fn a() {}\n", "b"]), "const ON = true;\n\nfn a() {}\n\nb");
        assert_eq!(coefficients("A", &[1.0, 0.5]), "const A_0 = 1e0f;\nconst A_1 = 5e-1f;\n");
    }
}

#[cfg(test)]
mod passes_tests {
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
