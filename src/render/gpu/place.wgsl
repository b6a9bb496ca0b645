// What both passes share: one star, one path node, and where the star stands at that node.

struct Frame {
    size: vec2<i32>,
    stars: u32,
    nodes: u32,
    // Nodes that one invocation takes; the rest go to the next z.
    nodes_per_slice: u32,
    half_px: i32,
    // Fixed-point units per electron.
    scale: f32,
    // 1 / (sqrt(2) sigma), for the analytic pass.
    edge_scale: f32,
    // Grid points of the table per pixel.
    oversampling: i32,
    unused_0: i32,
    unused_1: i32,
    unused_2: i32,
}

struct Star {
    // Pixel of the mid-exposure position, and the rest of the position: |fraction| <= 1/2.
    origin: vec2<i32>,
    fraction: vec2<f32>,
    // The star's light stays within this box, which lies on the image: first pixel, then width | height << 16.
    box_start: vec2<i32>,
    box_size: u32,
    electrons: f32,
    // Displacement per unit of features 0 to 3 along x, along y; of features 4 and 5 along x, along y.
    along_x: vec4<f32>,
    along_y: vec4<f32>,
    along_xy: vec4<f32>,
}

struct Node {
    phi: vec4<f32>,
    // Features 4 and 5, weight, nothing.
    rest: vec4<f32>,
}

struct Place {
    // From the star's origin to the node's pixel.
    whole: vec2<f32>,
    // From that pixel's centre to the star.
    fraction: vec2<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> stars: array<Star>;
@group(0) @binding(2) var<storage, read> nodes: array<Node>;
@group(0) @binding(3) var<storage, read_write> sums: array<atomic<i32>>;

fn box_of(star: Star) -> vec2<i32> {
    return vec2<i32>(i32(star.box_size & 0xffffu), i32(star.box_size >> 16u));
}

fn place(star: Star, node: Node) -> Place {
    var at = star.fraction;
    at = fma(vec2<f32>(star.along_x.x, star.along_y.x), vec2<f32>(node.phi.x), at);
    at = fma(vec2<f32>(star.along_x.y, star.along_y.y), vec2<f32>(node.phi.y), at);
    at = fma(vec2<f32>(star.along_x.z, star.along_y.z), vec2<f32>(node.phi.z), at);
    at = fma(vec2<f32>(star.along_x.w, star.along_y.w), vec2<f32>(node.phi.w), at);
    at = fma(star.along_xy.xz, vec2<f32>(node.rest.x), at);
    at = fma(star.along_xy.yw, vec2<f32>(node.rest.y), at);
    let whole = floor(at + 0.5);
    return Place(whole, at - whole);
}

// Nearest whole number of units; the host chose the scale so that no sum can wrap.
fn units(electrons: f32) -> i32 {
    return i32(floor(electrons * frame.scale + 0.5));
}

fn put1(x: i32, y: i32, electrons: f32) {
    let value = units(electrons);
    if (value != 0 && x < frame.size.x && y < frame.size.y) {
        atomicAdd(&sums[y * frame.size.x + x], value);
    }
}

fn put4(x: i32, y: i32, electrons: vec4<f32>) {
    put1(x, y, electrons.x);
    put1(x + 1, y, electrons.y);
    put1(x + 2, y, electrons.z);
    put1(x + 3, y, electrons.w);
}
