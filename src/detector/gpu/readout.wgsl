// Counted electrons -> digital numbers: the stages of `ORDER` after the neighbours.
// Every function takes the same steps as its namesake in Rust.

fn read_noise(words: vec2<u32>) -> vec2<f32> {
    let radius = sqrt(-2.0 * ln(open_unit(words.xx)).x);
    return radius * cos_sin_turns(unit(words.yy).x);
}

// Two digital numbers in one word.
fn read_out(pair: u32, electrons: vec2<f32>, words: vec2<u32>) -> u32 {
    var e = electrons;
    if (DSNU) {
        e += dsnu_e[pair];
    }
    if (READ_NOISE) {
        e = fma(vec2<f32>(frame.read_noise_e), read_noise(words), e);
    }
    let level = floor(fma(e, vec2<f32>(frame.dn_per_e), vec2<f32>(frame.black_dn)));
    let value = vec2<u32>(clamp(level, vec2<f32>(0.0), vec2<f32>(frame.largest_dn)));
    return value.x | (value.y << 16u);
}
