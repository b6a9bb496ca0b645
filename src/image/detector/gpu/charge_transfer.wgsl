// Charge that transfers leave behind: the sums of `charge_transfer.rs` along one axis, one invocation for a pixel.

@group(0) @binding(0) var<storage, read> from_e: array<f32>;
@group(0) @binding(1) var<storage, read> shares: array<f32>;
@group(0) @binding(2) var<storage, read_write> to_e: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pixel = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (pixel >= WIDTH * HEIGHT) {
        return;
    }
    let column = pixel % WIDTH;
    let row = pixel / WIDTH;
    // Places are counted from the output, along rows or columns.
    let along = select(column, row, ALONG_COLUMNS);
    let place = select(along, PLACES - 1u - along, FROM_END);
    let step = select(1u, WIDTH, ALONG_COLUMNS);
    var sum = 0.0;
    for (var delay = 0u; delay < min(TERMS, place + 1u); delay += 1u) {
        let earlier = select(pixel - delay * step, pixel + delay * step, FROM_END);
        sum += shares[delay * PLACES + (place - delay)] * from_e[earlier];
    }
    to_e[pixel] = sum;
}
