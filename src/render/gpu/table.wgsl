// Stars from a table of the PSF, or of the PSF convolved with the path. One workgroup: one star; one invocation: one
// pixel of the star's box, all nodes of a slice, added to the image once.

// Texel (first phase along x, column; phase along y, row): the taps of four phases along x.
@group(0) @binding(4) var table: texture_2d<f32>;

struct Taps {
    first: i32,
    weights: vec4<f32>,
}

// First phase and cubic B-spline weights for a star fraction in [-1/2, 1/2].
fn taps(fraction: f32) -> Taps {
    let half = f32(frame.oversampling / 2);
    let s = half - fraction * f32(frame.oversampling);
    let j = clamp(floor(s), 0.0, 2.0 * half);
    let t = s - j;
    let r = 1.0 - t;
    let sixth = 1.0 / 6.0;
    let w1 = sixth * (4.0 - 3.0 * t * t * (2.0 - t));
    let w2 = sixth * (4.0 - 3.0 * r * r * (2.0 - r));
    return Taps(i32(j), vec4<f32>(sixth * (r * r * r), w1, w2, sixth * (t * t * t)));
}

fn share(place: Place, pixel: vec2<i32>) -> f32 {
    let x = taps(place.fraction.x);
    let y = taps(place.fraction.y);
    let rows = 2 * frame.half_px + 1;
    let at = vec2<i32>(x.first, y.first) * rows + pixel;
    return y.weights.x * dot(textureLoad(table, at, 0), x.weights)
        + y.weights.y * dot(textureLoad(table, at + vec2<i32>(0, rows), 0), x.weights)
        + y.weights.z * dot(textureLoad(table, at + vec2<i32>(0, 2 * rows), 0), x.weights)
        + y.weights.w * dot(textureLoad(table, at + vec2<i32>(0, 3 * rows), 0), x.weights);
}

fn draw_pixel(star: Star, pixel: vec2<i32>, first: u32, end: u32) {
    let from_origin = pixel - star.origin + frame.half_px;
    let last = 2 * frame.half_px;
    var sum = 0.0;
    for (var k = first; k < end; k++) {
        let node = nodes[k];
        let at = place(star, node);
        let in_image = from_origin - vec2<i32>(at.whole);
        if (all(in_image >= vec2<i32>(0)) && all(in_image <= vec2<i32>(last))) {
            sum += node.rest.z * share(at, in_image);
        }
    }
    let value = units(star.electrons * sum);
    if (value != 0) {
        atomicAdd(&sums[pixel.y * frame.size.x + pixel.x], value);
    }
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let first = group.z * frame.nodes_per_slice;
    let end = min(first + frame.nodes_per_slice, frame.nodes);
    for (var i = group.x; i < frame.stars; i += groups.x) {
        let star = stars[i];
        let size = box_of(star);
        let step = i32(groups.y * WORKGROUP);
        for (var p = i32(group.y * WORKGROUP + local); p < size.x * size.y; p += step) {
            draw_pixel(star, star.box_start + vec2<i32>(p % size.x, p / size.x), first, end);
        }
    }
}
