// Electrons -> digital numbers: the stages of `ORDER`, one invocation for two pixels (they share one Philox block).
// Every function takes the same steps as its namesake in Rust; no built-in logarithm, exponential or sine.

struct Readout {
    pixels: u32,
    frame: u32,
    key: vec2<u32>,
    electrons_per_unit: f32,
    dark_e: f32,
    full_well_e: f32,
    read_noise_e: f32,
    dn_per_e: f32,
    // Black level plus the half that makes a floor round.
    black_dn: f32,
    largest_dn: f32,
    // 1: PRNU on, 2: DSNU on.
    patterns: u32,
    stray_light_e: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> readout: Readout;
@group(0) @binding(1) var<storage, read> sums: array<vec2<i32>>;
@group(0) @binding(2) var<storage, read> prnu: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> dsnu_e: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> dn: array<u32>;

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

// Natural logarithm of positive normal numbers.
fn ln(x: vec2<f32>) -> vec2<f32> {
    let bits = bitcast<vec2<u32>>(x) - vec2<u32>(0x3f3504f3u);
    let exponent = vec2<f32>(bitcast<vec2<i32>>(bits) >> vec2<u32>(23u));
    let m = bitcast<vec2<f32>>((bits & vec2<u32>(0x007fffffu)) + vec2<u32>(0x3f3504f3u));
    let s = (m - 1.0) / (m + 1.0);
    let t = s * s;
    var p = fma(t, vec2<f32>(2.0 / 9.0), vec2<f32>(2.0 / 7.0));
    p = fma(p, t, vec2<f32>(2.0 / 5.0));
    p = fma(p, t, vec2<f32>(2.0 / 3.0));
    p = fma(p, t, vec2<f32>(2.0));
    return fma(exponent, vec2<f32>(0.6931471805599453), s * p);
}

// exp(-x) for 0 <= x <= 80.
fn exp_negative(x: vec2<f32>) -> vec2<f32> {
    let k = floor(fma(x, vec2<f32>(-1.4426950408889634), vec2<f32>(0.5)));
    let r = fma(k, vec2<f32>(2.1219444e-4), fma(k, vec2<f32>(-0.6933594), -x));
    var p = fma(r, vec2<f32>(1.0 / 5040.0), vec2<f32>(1.0 / 720.0));
    p = fma(p, r, vec2<f32>(1.0 / 120.0));
    p = fma(p, r, vec2<f32>(1.0 / 24.0));
    p = fma(p, r, vec2<f32>(1.0 / 6.0));
    p = fma(p, r, vec2<f32>(0.5));
    p = fma(p, r, vec2<f32>(1.0));
    p = fma(p, r, vec2<f32>(1.0));
    return p * bitcast<vec2<f32>>((vec2<i32>(k) + vec2<i32>(127)) << vec2<u32>(23u));
}

// Cosine and sine of u turns, 0 <= u < 1.
fn cos_sin_turns(u: f32) -> vec2<f32> {
    let quarter = floor(fma(u, 4.0, 0.5));
    let x = (u - 0.25 * quarter) * 6.283185307179586;
    let t = x * x;
    var s = fma(t, 1.0 / 362880.0, -1.0 / 5040.0);
    s = fma(s, t, 1.0 / 120.0);
    s = fma(s, t, -1.0 / 6.0);
    s = fma(s * t, x, x);
    var c = fma(t, -1.0 / 3628800.0, 1.0 / 40320.0);
    c = fma(c, t, -1.0 / 720.0);
    c = fma(c, t, 1.0 / 24.0);
    c = fma(c, t, -0.5);
    c = fma(c, t, 1.0);
    let q = i32(quarter);
    let swap = (q & 1) != 0;
    let a = select(s, c, swap);
    let b = select(c, s, swap);
    return vec2<f32>(select(b, -b, ((q + 1) & 2) != 0), select(a, -a, (q & 2) != 0));
}

fn open_unit(word: vec2<u32>) -> vec2<f32> {
    return (vec2<f32>(bitcast<vec2<i32>>(word >> vec2<u32>(9u))) + 0.5) * (1.0 / 8388608.0);
}

fn unit(word: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(bitcast<vec2<i32>>(word >> vec2<u32>(8u))) * (1.0 / 16777216.0);
}

// Standard normal quantile (Giles 2010, single precision).
fn normal_quantile(u: vec2<f32>) -> vec2<f32> {
    let w = -ln(4.0 * u * (1.0 - u));
    let near = w - 2.5;
    let far = sqrt(max(w, vec2<f32>(0.0))) - 3.0;
    var a = vec2<f32>(2.8102264e-8);
    a = fma(a, near, vec2<f32>(3.4327394e-7));
    a = fma(a, near, vec2<f32>(-3.5233877e-6));
    a = fma(a, near, vec2<f32>(-4.3915065e-6));
    a = fma(a, near, vec2<f32>(2.1858087e-4));
    a = fma(a, near, vec2<f32>(-1.25372503e-3));
    a = fma(a, near, vec2<f32>(-4.17768164e-3));
    a = fma(a, near, vec2<f32>(0.246640727));
    a = fma(a, near, vec2<f32>(1.50140941));
    var b = vec2<f32>(-2.00214257e-4);
    b = fma(b, far, vec2<f32>(1.00950558e-4));
    b = fma(b, far, vec2<f32>(1.34934322e-3));
    b = fma(b, far, vec2<f32>(-3.67342844e-3));
    b = fma(b, far, vec2<f32>(5.73950773e-3));
    b = fma(b, far, vec2<f32>(-7.6224613e-3));
    b = fma(b, far, vec2<f32>(9.43887047e-3));
    b = fma(b, far, vec2<f32>(1.00167406));
    b = fma(b, far, vec2<f32>(2.83297682));
    return 1.4142135623730951 * select(b, a, w < vec2<f32>(5.0)) * (2.0 * u - 1.0);
}

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

fn read_noise(words: vec2<u32>) -> vec2<f32> {
    let radius = sqrt(-2.0 * ln(open_unit(words.xx)).x);
    return radius * cos_sin_turns(unit(words.yy).x);
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let pair = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (2u * pair >= readout.pixels) {
        return;
    }
    let words = philox(vec4<u32>(pair, readout.frame, STAGE_TEMPORAL, 0u), readout.key);
    var e = vec2<f32>(sums[pair]) * readout.electrons_per_unit;
    e += readout.stray_light_e;
    if ((readout.patterns & 1u) != 0u) {
        e += e * prnu[pair];
    }
    e += readout.dark_e;
    e = shot(e, words.zw);
    e = min(e, vec2<f32>(readout.full_well_e));
    if ((readout.patterns & 2u) != 0u) {
        e += dsnu_e[pair];
    }
    if (readout.read_noise_e > 0.0) {
        e = fma(vec2<f32>(readout.read_noise_e), read_noise(words.xy), e);
    }
    let level = floor(fma(e, vec2<f32>(readout.dn_per_e), vec2<f32>(readout.black_dn)));
    let value = vec2<u32>(clamp(level, vec2<f32>(0.0), vec2<f32>(readout.largest_dn)));
    dn[pair] = value.x | (value.y << 16u);
}
