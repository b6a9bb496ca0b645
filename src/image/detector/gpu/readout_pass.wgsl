// The stages after the neighbours: charge -> digital numbers.

@group(0) @binding(1) var<storage, read> charge_e: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> dsnu_e: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> lines: array<f32>;
@group(0) @binding(4) var<storage, read_write> dn: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pair = pair_of(group, groups, local);
    if (2u * pair >= ADC_PIXELS) {
        return;
    }
    let words = temporal_words(pair);
    dn[pair] = read_out(pair, charge_e[pair], words.xy);
}
