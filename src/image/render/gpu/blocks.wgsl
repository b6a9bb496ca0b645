// One invocation per star and block of BLOCK_COLUMNS x BLOCK_ROWS pixels; `draw_block` is the pass that this follows.

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let index = first_star() + id.x;
    if (index >= end_star()) {
        return;
    }
    let spot = spots[index];
    let track = track_of(spot);
    let star = Star(spot, track);
    let size = unpacked(track.box_size);
    let columns = (size.x + BLOCK_COLUMNS - 1) / BLOCK_COLUMNS;
    let blocks = columns * ((size.y + BLOCK_ROWS - 1) / BLOCK_ROWS);
    let first = track.first_node + group.z * frame.nodes_per_slice;
    let end = min(first + frame.nodes_per_slice, track.first_node + track.nodes);
    for (var block = i32(group.y); block < blocks; block += i32(groups.y)) {
        let corner = vec2<i32>(BLOCK_COLUMNS * (block % columns), BLOCK_ROWS * (block / columns));
        draw_block(star, track.box_start + corner, first, end);
    }
}
