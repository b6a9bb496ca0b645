// Stars from a table of the PSF, or of the PSF convolved with the path. One invocation: one star, one block
// of 8 x 1 pixels, all nodes of a slice. The block is summed in registers and added to the image once.

const BLOCK_COLUMNS: i32 = 8;
const BLOCK_ROWS: i32 = 1;

// Texel (first phase along x, column; phase along y, row): the taps of four phases along x. A layer per table.
@group(0) @binding(5) var table: texture_2d_array<f32>;

fn first_star() -> u32 {
    return frame.analytic;
}

fn end_star() -> u32 {
    return frame.stars;
}

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

fn share(at: vec2<i32>, layer: u32, rows: i32, x: vec4<f32>, y: vec4<f32>) -> f32 {
    return y.x * dot(textureLoad(table, at, layer, 0), x)
        + y.y * dot(textureLoad(table, at + vec2<i32>(0, rows), layer, 0), x)
        + y.z * dot(textureLoad(table, at + vec2<i32>(0, 2 * rows), layer, 0), x)
        + y.w * dot(textureLoad(table, at + vec2<i32>(0, 3 * rows), layer, 0), x);
}

// Four pixels from `column` of a table image; nothing beyond its ends.
fn shares(column: i32, row: i32, half: vec2<i32>, layer: u32, x: Taps, y: Taps) -> vec4<f32> {
    let size = 2 * half + 1;
    let columns = vec4<i32>(column, column + 1, column + 2, column + 3);
    let inside = (columns >= vec4<i32>(0)) & (columns < vec4<i32>(size.x));
    let held = clamp(columns, vec4<i32>(0), vec4<i32>(size.x - 1)) + x.first * size.x;
    let down = y.first * size.y + row;
    let values = vec4<f32>(
        share(vec2<i32>(held.x, down), layer, size.y, x.weights, y.weights),
        share(vec2<i32>(held.y, down), layer, size.y, x.weights, y.weights),
        share(vec2<i32>(held.z, down), layer, size.y, x.weights, y.weights),
        share(vec2<i32>(held.w, down), layer, size.y, x.weights, y.weights),
    );
    return select(vec4<f32>(0.0), values, inside);
}

fn draw_block(star: Star, corner: vec2<i32>, first: u32, end: u32) {
    let half = half_of(star.spot);
    let from_origin = corner - star.spot.origin + half;
    let last = 2 * half;
    var a = vec4<f32>();
    var b = vec4<f32>();
    for (var k = first; k < end; k++) {
        let node = nodes[k];
        let at = place(star, node);
        let in_image = from_origin - vec2<i32>(at.whole);
        if (in_image.y < 0 || in_image.y > last.y || in_image.x <= -BLOCK_COLUMNS || in_image.x > last.x) {
            continue;
        }
        let x = taps(at.fraction.x);
        let y = taps(at.fraction.y);
        a += node.rest.x * shares(in_image.x, in_image.y, half, star.spot.layer, x, y);
        b += node.rest.x * shares(in_image.x + 4, in_image.y, half, star.spot.layer, x, y);
    }
    put4(corner.x, corner.y, star.spot.electrons * a);
    put4(corner.x + 4, corner.y, star.spot.electrons * b);
}
