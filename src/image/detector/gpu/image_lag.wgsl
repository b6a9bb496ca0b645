// Charge that stays in the pixel: the steps of `image_lag.rs`.

struct Lag {
    // Share of the rest that comes with this frame.
    carried: f32,
    share: f32,
    unused: vec2<f32>,
}

@group(0) @binding(0) var<uniform> lag: Lag;
@group(0) @binding(1) var<storage, read_write> charge_e: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> rest_e: array<vec2<f32>>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pair = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (pair >= PAIRS) {
        return;
    }
    let all = charge_e[pair] + lag.carried * rest_e[pair];
    let rest = select(lag.share * min(all, vec2<f32>(FULL_WELL_E)), vec2<f32>(0.0), all < vec2<f32>(LEAST_E));
    rest_e[pair] = rest;
    charge_e[pair] = all - rest;
}
