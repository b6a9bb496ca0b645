// All stages in one pass: electrons in fixed point -> digital numbers.

@group(0) @binding(1) var<storage, read> sums: array<vec2<i32>>;
@group(0) @binding(2) var<storage, read> prnu: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> dark_factor: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> dsnu_e: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> lines: array<f32>;
@group(0) @binding(6) var<storage, read_write> dn: array<u32>;
@group(0) @binding(7) var<storage, read> illumination: array<vec2<f32>>;
@group(0) @binding(8) var<storage, read> outliers: array<Outlier>;

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
    var e = charge(pair, vec2<f32>(sums[pair]) * frame.electrons_per_unit, words.zw);
    e = min(e, vec2<f32>(frame.full_well_e));
    dn[pair] = read_out(pair, e, words.xy);
}
