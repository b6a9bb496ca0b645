// Mean electrons -> counted electrons: the stages of `ORDER` before the neighbours.
// Every function takes the same steps as its namesake in Rust.

// Poisson counts below the limit, by inversion of the distribution function, four steps between looks.
fn invert(mean: vec2<f32>, words: vec2<u32>) -> vec2<f32> {
    let u = unit(words);
    var term = exp_negative(mean);
    var sum = term;
    var count = vec2<f32>(0.0);
    // A sum that no longer grows has ended; once ended it stays so, and its terms go to zero before they are denormal.
    var on = u >= sum;
    for (var step = 0.0; any(on) && step < 64.0; step += 4.0) {
        // Four steps, written out: nothing unrolls a loop whose bounds are checked at run time.
        count += select(vec2<f32>(0.0), vec2<f32>(1.0), on);
        term = select(vec2<f32>(0.0), term * (mean * (1.0 / (step + 1.0))), on);
        let sum1 = sum + term;
        on = (u >= sum1) & (sum1 > sum);
        count += select(vec2<f32>(0.0), vec2<f32>(1.0), on);
        term = select(vec2<f32>(0.0), term * (mean * (1.0 / (step + 2.0))), on);
        let sum2 = sum1 + term;
        on = (u >= sum2) & (sum2 > sum1);
        count += select(vec2<f32>(0.0), vec2<f32>(1.0), on);
        term = select(vec2<f32>(0.0), term * (mean * (1.0 / (step + 3.0))), on);
        let sum3 = sum2 + term;
        on = (u >= sum3) & (sum3 > sum2);
        count += select(vec2<f32>(0.0), vec2<f32>(1.0), on);
        term = select(vec2<f32>(0.0), term * (mean * (1.0 / (step + 4.0))), on);
        sum = sum3 + term;
        on = (u >= sum) & (sum > sum3);
    }
    return count;
}

// Poisson counts above the limit, by Cornish and Fisher's expansion.
fn cornish_fisher(mean_e: vec2<f32>, words: vec2<u32>) -> vec2<f32> {
    let mean = max(mean_e, vec2<f32>(1.0));
    let z = normal_quantile(open_unit(words));
    let s = sqrt(mean - 1.0 / 12.0);
    let skew = (z * z - 1.0) * (1.0 / 6.0);
    let tail = (z - z * z * z) / (72.0 * s);
    return max(floor(fma(s, z, mean) + skew + tail + 0.5), vec2<f32>(0.0));
}

fn shot(mean_e: vec2<f32>, words: vec2<u32>) -> vec2<f32> {
    let mean = max(mean_e, vec2<f32>(0.0));
    let bright = mean >= vec2<f32>(INVERSION_LIMIT);
    var counts = invert(select(mean, vec2<f32>(0.0), bright), words);
    if (any(bright)) {
        counts = select(counts, cornish_fisher(mean, words), bright);
    }
    return counts;
}

// Background that differs from pixel to pixel; every branch is the same for all invocations.
fn shaped_background(pair: u32, level_e: vec2<f32>) -> vec2<f32> {
    var e = level_e;
    if (frame.gradient_x_e != 0.0 || frame.gradient_y_e != 0.0 || frame.quadratic_e != 0.0) {
        let pixel = vec2<u32>(2u * pair, 2u * pair + 1u);
        let y = pixel / vec2<u32>(frame.width);
        let x = pixel - y * vec2<u32>(frame.width);
        let u = (vec2<f32>(x) + frame.offset_x) * frame.scale;
        let v = (vec2<f32>(y) + frame.offset_y) * frame.scale;
        let of_row = (frame.quadratic_e * v + frame.gradient_y_e) * v;
        e += (frame.quadratic_e * u + frame.gradient_x_e) * u + of_row;
    }
    if (frame.sky_e != 0.0) {
        e += frame.sky_e * illumination[pair];
    }
    return e;
}

fn charge(pair: u32, mean_e: vec2<f32>, words: vec2<u32>) -> vec2<f32> {
    let special = pair_outliers(pair);
    var e = mean_e;
    e += frame.stray_light_e;
    e = shaped_background(pair, e);
    if (PRNU) {
        e += e * prnu[pair];
    }
    e *= special.response;
    if (DARK_FACTOR) {
        e = fma(vec2<f32>(frame.dark_e), dark_factor[pair], e);
    } else {
        e += frame.dark_e;
    }
    e += special.dark_e;
    return shot(e, words) + special.charge_e;
}
