// Adds the light of whole stars, which the host drew in tiles, to the image. One invocation: one pixel of a tile.

struct Frame {
    size: vec2<u32>,
    // Tiles in a row of the image, and tiles in all.
    columns: u32,
    tiles: u32,
    // Fixed-point units per electron, and the most electrons that a pixel takes.
    scale: f32,
    most_e: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> places: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> sums: array<i32>;

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let index = (group.y * groups.x + group.x) * WORKGROUP + local;
    let tile = index / (TILE_PX * TILE_PX);
    if (tile >= frame.tiles) {
        return;
    }
    let pixel = index % (TILE_PX * TILE_PX);
    let place = places[tile];
    let x = (place % frame.columns) * TILE_PX + pixel % TILE_PX;
    let y = (place / frame.columns) * TILE_PX + pixel / TILE_PX;
    if (x < frame.size.x && y < frame.size.y) {
        let at = y * frame.size.x + x;
        // No two tiles share a pixel.
        sums[at] += i32(floor(min(values[index], frame.most_e) * frame.scale + 0.5));
    }
}
