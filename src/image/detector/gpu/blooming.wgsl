// Charge above the full well spills along its column: the steps of `blooming.rs`, one invocation for a column.

@group(0) @binding(0) var<storage, read_write> charge_e: array<f32>;
@group(0) @binding(1) var<storage, read_write> down_first: array<f32>;
@group(0) @binding(2) var<storage, read_write> up_first: array<f32>;

// Returns the share of a pixel's excess charge that goes in each direction.
fn own(at: u32) -> f32 {
    return max(charge_e[at] - FULL_WELL_E, 0.0) * EACH_WAY;
}

fn stream_down(at: u32, carry: f32) -> f32 {
    let taken = min(carry, FULL_WELL_E - down_first[at]);
    down_first[at] += taken;
    return (carry - taken) + own(at);
}

fn stream_up(at: u32, carry: f32) -> f32 {
    let taken = min(carry, FULL_WELL_E - up_first[at]);
    up_first[at] += taken;
    return (carry - taken) + own(at);
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let column = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (column >= WIDTH) {
        return;
    }
    // Most columns hold no saturated pixel, and are not touched.
    var over = false;
    for (var y = 0u; y < HEIGHT; y += 1u) {
        over = over || charge_e[y * WIDTH + column] > FULL_WELL_E;
    }
    if (!over) {
        return;
    }
    for (var y = 0u; y < HEIGHT; y += 1u) {
        let level = min(charge_e[y * WIDTH + column], FULL_WELL_E);
        down_first[y * WIDTH + column] = level;
        up_first[y * WIDTH + column] = level;
    }
    var down_carry = 0.0;
    var up_carry = 0.0;
    for (var y = 0u; y < HEIGHT; y += 1u) {
        down_carry = stream_down(y * WIDTH + column, down_carry);
        up_carry = stream_up((HEIGHT - 1u - y) * WIDTH + column, up_carry);
    }
    down_carry = 0.0;
    up_carry = 0.0;
    for (var y = 0u; y < HEIGHT; y += 1u) {
        down_carry = stream_down((HEIGHT - 1u - y) * WIDTH + column, down_carry);
        up_carry = stream_up(y * WIDTH + column, up_carry);
    }
    for (var y = 0u; y < HEIGHT; y += 1u) {
        let at = y * WIDTH + column;
        charge_e[at] = 0.5 * (down_first[at] + up_first[at]);
    }
}
