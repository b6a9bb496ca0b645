// The full well as a stage between neighbour stages: charge -> charge.

@group(0) @binding(0) var<storage, read_write> charge_e: array<vec2<f32>>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pair = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (pair < PAIRS) {
        charge_e[pair] = min(charge_e[pair], vec2<f32>(FULL_WELL_E));
    }
}
