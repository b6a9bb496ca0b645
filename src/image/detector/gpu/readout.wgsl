// Counted electrons -> digital numbers: the stages of `ORDER` after the neighbours.
// Every function takes the same steps as its namesake in Rust.

fn read_noise(words: vec2<u32>) -> vec2<f32> {
    let radius = sqrt(-2.0 * ln(open_unit(words.xx)).x);
    return radius * cos_sin_turns(unit(words.yy).x);
}

// Response to charge: a slope, and its changes at three thresholds.
fn bend(x: vec2<f32>) -> vec2<f32> {
    let zero = vec2<f32>(0.0);
    var y = fma(vec2<f32>(STEP_0), max(x - THRESHOLD_0, zero), SLOPE * x);
    y = fma(vec2<f32>(STEP_1), max(x - THRESHOLD_1, zero), y);
    return fma(vec2<f32>(STEP_2), max(x - THRESHOLD_2, zero), y);
}

// One number of each pixel's line, from one part of `lines`.
fn of_lines(start: u32, index: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(lines[start + index.x], lines[start + index.y]);
}

// Two digital numbers in one word.
fn read_out(pair: u32, electrons: vec2<f32>, words: vec2<u32>) -> u32 {
    var e = electrons;
    if (NONLINEAR) {
        e = bend(e);
    }
    // The second pixel of an odd image's last pair lies past the end.
    let pixel = min(vec2<u32>(2u * pair, 2u * pair + 1u), vec2<u32>(ADC_PIXELS - 1u));
    if (COLUMNS) {
        let column = pixel % vec2<u32>(WIDTH);
        e = fma(e, of_lines(COLUMN_GAIN, column), of_lines(COLUMN_E, column));
    }
    if (ROWS) {
        e += of_lines(ROW_E, pixel / vec2<u32>(WIDTH));
    }
    if (DSNU) {
        e += dsnu_e[pair];
    }
    if (ROW_NOISE) {
        e += of_lines(0u, pixel / vec2<u32>(WIDTH));
    }
    if (READ_NOISE) {
        e = fma(vec2<f32>(frame.read_noise_e), read_noise(words), e);
    }
    let level = floor(fma(e, vec2<f32>(frame.dn_per_e), vec2<f32>(frame.black_dn)));
    let value = vec2<u32>(clamp(level, vec2<f32>(0.0), vec2<f32>(frame.largest_dn)));
    return value.x | (value.y << 16u);
}
