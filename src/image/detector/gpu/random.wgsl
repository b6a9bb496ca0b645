// Philox-4x32-10 and uniforms from its words: the same steps as `base::random` and `image::detector::elementary`.

// High half of a 32 x 32 bit product.
fn high(a: u32, b: u32) -> u32 {
    let a0 = a & 0xffffu;
    let a1 = a >> 16u;
    let b0 = b & 0xffffu;
    let b1 = b >> 16u;
    let middle = a1 * b0 + ((a0 * b0) >> 16u);
    let other = a0 * b1 + (middle & 0xffffu);
    return a1 * b1 + (middle >> 16u) + (other >> 16u);
}

fn philox_round(c: vec4<u32>, k: vec2<u32>) -> vec4<u32> {
    let p0 = high(PHILOX_M0, c.x);
    let p1 = high(PHILOX_M1, c.z);
    return vec4<u32>(p1 ^ c.y ^ k.x, PHILOX_M1 * c.z, p0 ^ c.w ^ k.y, PHILOX_M0 * c.x);
}

fn philox(counter: vec4<u32>, key: vec2<u32>) -> vec4<u32> {
    let step = vec2<u32>(PHILOX_W0, PHILOX_W1);
    var k = key;
    var c = philox_round(counter, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    k += step; c = philox_round(c, k);
    return c;
}

fn open_unit(word: vec2<u32>) -> vec2<f32> {
    return (vec2<f32>(bitcast<vec2<i32>>(word >> vec2<u32>(9u))) + 0.5) * (1.0 / 8388608.0);
}

fn unit(word: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(bitcast<vec2<i32>>(word >> vec2<u32>(8u))) * (1.0 / 16777216.0);
}
