// Gaussian stars, every node by its own error functions. One invocation: one star, one block of 16 x 8 pixels, all
// nodes of a slice. The block is summed in registers and added to the image once.

const BLOCK_COLUMNS: i32 = 16;
const BLOCK_ROWS: i32 = 8;

fn erf4(argument: vec4<f32>) -> vec4<f32> {
    let x = clamp(argument, vec4<f32>(-ERF_CLAMP), vec4<f32>(ERF_CLAMP));
    let t = x * x;
    var p = fma(vec4<f32>(ERF_P_5), t, vec4<f32>(ERF_P_4));
    var q = fma(vec4<f32>(ERF_Q_5), t, vec4<f32>(ERF_Q_4));
    p = fma(p, t, vec4<f32>(ERF_P_3));
    q = fma(q, t, vec4<f32>(ERF_Q_3));
    p = fma(p, t, vec4<f32>(ERF_P_2));
    q = fma(q, t, vec4<f32>(ERF_Q_2));
    p = fma(p, t, vec4<f32>(ERF_P_1));
    q = fma(q, t, vec4<f32>(ERF_Q_1));
    p = fma(p, t, vec4<f32>(ERF_P_0));
    q = fma(q, t, vec4<f32>(ERF_Q_0));
    return x * p / q;
}

fn erf1(argument: f32) -> f32 {
    let x = clamp(argument, -ERF_CLAMP, ERF_CLAMP);
    let t = x * x;
    var p = fma(ERF_P_5, t, ERF_P_4);
    var q = fma(ERF_Q_5, t, ERF_Q_4);
    p = fma(p, t, ERF_P_3);
    q = fma(q, t, ERF_Q_3);
    p = fma(p, t, ERF_P_2);
    q = fma(q, t, ERF_Q_2);
    p = fma(p, t, ERF_P_1);
    q = fma(q, t, ERF_Q_1);
    p = fma(p, t, ERF_P_0);
    q = fma(q, t, ERF_Q_0);
    return x * p / q;
}

// Four edges from `edge` (px from the node's pixel), held within the footprint: pixels beyond it get nothing.
fn edges4(edge: f32, fraction: f32, half: f32) -> vec4<f32> {
    let reach = half + 0.5;
    let edges = clamp(vec4<f32>(edge, edge + 1.0, edge + 2.0, edge + 3.0), vec4<f32>(-reach), vec4<f32>(reach));
    return erf4((edges - fraction) * frame.edge_scale);
}

fn edges1(edge: f32, fraction: f32, half: f32) -> f32 {
    let reach = half + 0.5;
    return erf1((clamp(edge, -reach, reach) - fraction) * frame.edge_scale);
}

fn put16(x: i32, y: i32, e0: vec4<f32>, e1: vec4<f32>, e2: vec4<f32>, e3: vec4<f32>) {
    put4(x, y, e0);
    put4(x + 4, y, e1);
    put4(x + 8, y, e2);
    put4(x + 12, y, e3);
}

fn first_star() -> u32 {
    return 0u;
}

fn end_star() -> u32 {
    return frame.analytic;
}

fn draw_block(star: Star, corner: vec2<i32>, first: u32, end: u32) {
    let to_origin = vec2<f32>(star.spot.origin - corner);
    let half = f32(half_of(star.spot).x);
    var a0 = vec4<f32>(); var a1 = vec4<f32>(); var a2 = vec4<f32>(); var a3 = vec4<f32>();
    var b0 = vec4<f32>(); var b1 = vec4<f32>(); var b2 = vec4<f32>(); var b3 = vec4<f32>();
    var c0 = vec4<f32>(); var c1 = vec4<f32>(); var c2 = vec4<f32>(); var c3 = vec4<f32>();
    var d0 = vec4<f32>(); var d1 = vec4<f32>(); var d2 = vec4<f32>(); var d3 = vec4<f32>();
    var p0 = vec4<f32>(); var p1 = vec4<f32>(); var p2 = vec4<f32>(); var p3 = vec4<f32>();
    var q0 = vec4<f32>(); var q1 = vec4<f32>(); var q2 = vec4<f32>(); var q3 = vec4<f32>();
    var r0 = vec4<f32>(); var r1 = vec4<f32>(); var r2 = vec4<f32>(); var r3 = vec4<f32>();
    var s0 = vec4<f32>(); var s1 = vec4<f32>(); var s2 = vec4<f32>(); var s3 = vec4<f32>();
    for (var k = first; k < end; k++) {
        let node = nodes[k];
        let at = place(star, node);
        let o = to_origin + at.whole;
        if (o.y + half < 0.0 || o.y - half >= f32(BLOCK_ROWS) || o.x + half < 0.0 || o.x - half >= f32(BLOCK_COLUMNS)) {
            continue;
        }
        let edge = -0.5 - o;
        let e0 = edges4(edge.x, at.fraction.x, half);
        let e1 = edges4(edge.x + 4.0, at.fraction.x, half);
        let e2 = edges4(edge.x + 8.0, at.fraction.x, half);
        let e3 = edges4(edge.x + 12.0, at.fraction.x, half);
        let e4 = edges1(edge.x + 16.0, at.fraction.x, half);
        let f0 = edges4(edge.y, at.fraction.y, half);
        let f1 = edges4(edge.y + 4.0, at.fraction.y, half);
        let f2 = edges1(edge.y + 8.0, at.fraction.y, half);
        let x0 = vec4<f32>(e0.yzw, e1.x) - e0;
        let x1 = vec4<f32>(e1.yzw, e2.x) - e1;
        let x2 = vec4<f32>(e2.yzw, e3.x) - e2;
        let x3 = vec4<f32>(e3.yzw, e4) - e3;
        let upper = (vec4<f32>(f0.yzw, f1.x) - f0) * node.rest.x;
        let lower = (vec4<f32>(f1.yzw, f2) - f1) * node.rest.x;
        a0 += upper.x * x0; a1 += upper.x * x1; a2 += upper.x * x2; a3 += upper.x * x3;
        b0 += upper.y * x0; b1 += upper.y * x1; b2 += upper.y * x2; b3 += upper.y * x3;
        c0 += upper.z * x0; c1 += upper.z * x1; c2 += upper.z * x2; c3 += upper.z * x3;
        d0 += upper.w * x0; d1 += upper.w * x1; d2 += upper.w * x2; d3 += upper.w * x3;
        p0 += lower.x * x0; p1 += lower.x * x1; p2 += lower.x * x2; p3 += lower.x * x3;
        q0 += lower.y * x0; q1 += lower.y * x1; q2 += lower.y * x2; q3 += lower.y * x3;
        r0 += lower.z * x0; r1 += lower.z * x1; r2 += lower.z * x2; r3 += lower.z * x3;
        s0 += lower.w * x0; s1 += lower.w * x1; s2 += lower.w * x2; s3 += lower.w * x3;
    }
    let gain = 0.25 * star.spot.electrons;
    let x = corner.x;
    let y = corner.y;
    put16(x, y + 0, gain * a0, gain * a1, gain * a2, gain * a3);
    put16(x, y + 1, gain * b0, gain * b1, gain * b2, gain * b3);
    put16(x, y + 2, gain * c0, gain * c1, gain * c2, gain * c3);
    put16(x, y + 3, gain * d0, gain * d1, gain * d2, gain * d3);
    put16(x, y + 4, gain * p0, gain * p1, gain * p2, gain * p3);
    put16(x, y + 5, gain * q0, gain * q1, gain * q2, gain * q3);
    put16(x, y + 6, gain * r0, gain * r1, gain * r2, gain * r3);
    put16(x, y + 7, gain * s0, gain * s1, gain * s2, gain * s3);
}
