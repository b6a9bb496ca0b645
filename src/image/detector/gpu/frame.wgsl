// The inputs of every pass: `FrameUniform` of `mod.rs`. One invocation serves two pixels (they share one Philox block).

struct Frame {
    pixels: u32,
    frame: u32,
    key: vec2<u32>,
    electrons_per_unit: f32,
    dark_e: f32,
    full_well_e: f32,
    read_noise_e: f32,
    dn_per_e: f32,
    // Black level plus the number that is added before the fraction is cut off.
    black_dn: f32,
    largest_dn: f32,
    stray_light_e: f32,
    // Background that differs from pixel to pixel: `background.rs`.
    width: u32,
    offset_x: f32,
    offset_y: f32,
    scale: f32,
    gradient_x_e: f32,
    gradient_y_e: f32,
    quadratic_e: f32,
    sky_e: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;

// The pair of pixels of this invocation; may pass the end.
fn pair_of(group: vec3<u32>, groups: vec3<u32>, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * WORKGROUP + local;
}

fn temporal_words(pair: u32) -> vec4<u32> {
    return philox(vec4<u32>(pair, frame.frame, STAGE_TEMPORAL, 0u), frame.key);
}
