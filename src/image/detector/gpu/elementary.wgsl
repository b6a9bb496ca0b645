// Elementary functions: the same steps as `image::detector::elementary`; no built-in logarithm, exponential or sine.

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
