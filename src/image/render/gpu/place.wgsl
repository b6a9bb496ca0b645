// The code of both passes for one star, one path node, and the place of the star at that node.

struct Frame {
    size: vec2<i32>,
    // Stars that are drawn analytically come first.
    analytic: u32,
    stars: u32,
    // Nodes that one invocation takes; the rest go to the next z.
    nodes_per_slice: u32,
    // Fixed-point units per electron.
    scale: f32,
    // 1 / (sqrt(2) sigma), for the analytic pass.
    edge_scale: f32,
    // Grid points of the table per pixel.
    oversampling: i32,
    // Number of the first track in the buffer.
    first_track: u32,
}

// A star; one that is drawn once has no track.
struct Spot {
    // Pixel of the position that poses count from, and the rest of the position: |fraction| <= 1/2.
    origin: vec2<i32>,
    fraction: vec2<f32>,
    electrons: f32,
    layer: u32,
    // Half-width of the footprint: along x | along y << 16.
    half_px: u32,
    track: u32,
}

// How a star moves, and with which nodes.
struct Track {
    px_per_tangent: vec4<f32>,
    tangent: vec2<f32>,
    from_principal: vec2<f32>,
    // The star's light stays within this box, which lies on the image: first pixel, then width | height << 16.
    box_start: vec2<i32>,
    box_size: u32,
    first_node: u32,
    nodes: u32,
}

const NO_TRACK: u32 = 0xffffffffu;

// A star with its track.
struct Star {
    spot: Spot,
    track: Track,
}

struct Node {
    // Rows of R - I; then the sine of the roll, its cosine less one, the shift along x.
    turn_x: vec4<f32>,
    turn_y: vec4<f32>,
    turn_z: vec4<f32>,
    // Weight, the shift along y, nothing.
    rest: vec4<f32>,
}

struct Place {
    // From the star's origin to the node's pixel.
    whole: vec2<f32>,
    // From that pixel's centre to the star.
    fraction: vec2<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> spots: array<Spot>;
@group(0) @binding(2) var<storage, read> nodes: array<Node>;
@group(0) @binding(3) var<storage, read_write> sums: array<atomic<i32>>;

@group(0) @binding(4) var<storage, read> tracks: array<Track>;

fn unpacked(pair: u32) -> vec2<i32> {
    return vec2<i32>(i32(pair & 0xffffu), i32(pair >> 16u));
}

fn half_of(spot: Spot) -> vec2<i32> {
    return unpacked(spot.half_px);
}

// The star's own track; that of one drawn once: the node that does not move, and the box of its footprint on the image.
fn track_of(spot: Spot) -> Track {
    if (spot.track != NO_TRACK) {
        return tracks[spot.track - frame.first_track];
    }
    let half = half_of(spot);
    let start = max(spot.origin - half, vec2<i32>(0));
    let size = vec2<u32>(max(min(spot.origin + half, frame.size - 1) - start + 1, vec2<i32>(0)));
    return Track(vec4<f32>(), vec2<f32>(), vec2<f32>(), start, size.x | (size.y << 16u), 0u, 1u);
}

fn place(star: Star, node: Node) -> Place {
    let track = star.track;
    let direction = vec3<f32>(track.tangent, 1.0);
    let d = vec3<f32>(dot(node.turn_x.xyz, direction), dot(node.turn_y.xyz, direction), dot(node.turn_z.xyz, direction));
    let step = (d.xy - track.tangent * d.z) / (1.0 + d.z);
    let moved = vec2<f32>(dot(track.px_per_tangent.xy, step), dot(track.px_per_tangent.zw, step));
    let arm = track.from_principal + moved;
    let rolled = node.turn_y.w * arm + node.turn_x.w * vec2<f32>(-arm.y, arm.x);
    let at = star.spot.fraction + moved + rolled + vec2<f32>(node.turn_z.w, node.rest.y);
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
