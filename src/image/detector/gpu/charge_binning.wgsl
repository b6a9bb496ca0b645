// Squares of pixels become one in the charge domain: the sums of `binning.rs`, one invocation for a square.

@group(0) @binding(0) var<storage, read> charge_e: array<f32>;
@group(0) @binding(1) var<storage, read_write> sums_e: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let square = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (square >= COLUMNS * ROWS) {
        return;
    }
    let corner = (square / COLUMNS) * FACTOR * WIDTH + (square % COLUMNS) * FACTOR;
    var sum = 0.0;
    for (var y = 0u; y < FACTOR; y += 1u) {
        for (var x = 0u; x < FACTOR; x += 1u) {
            sum += charge_e[corner + y * WIDTH + x];
        }
    }
    sums_e[square] = min(sum, FULL_WELL_E);
}
