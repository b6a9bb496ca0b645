// The stages before the neighbours: electrons in fixed point -> charge.

@group(0) @binding(1) var<storage, read> sums: array<vec2<i32>>;
@group(0) @binding(2) var<storage, read> prnu: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> dark_factor: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> charge_e: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> illumination: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read> outliers: array<Outlier>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pair = pair_of(group, groups, local);
    if (2u * pair >= frame.pixels) {
        return;
    }
    let words = temporal_words(pair);
    charge_e[pair] = charge(pair, vec2<f32>(sums[pair]) * frame.electrons_per_unit, words.zw);
}
