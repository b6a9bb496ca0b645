// Whole greys -> the numbers that a surface of unsigned normalised numbers stores for them. One pixel of the texture is one pixel of the
// surface, from the top left; beyond the texture it is black.

override most: f32;

@group(0) @binding(0) var greys: texture_2d<u32>;

// One triangle that covers the surface.
@vertex
fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    let at = array(vec2f(-1.0, -3.0), vec2f(-1.0, 1.0), vec2f(3.0, 1.0));
    return vec4f(at[i], 0.0, 1.0);
}

@fragment
fn grey(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let px = vec2u(at.xy);
    if any(px >= textureDimensions(greys)) {
        return vec4f(0.0, 0.0, 0.0, 1.0);
    }
    let share = f32(textureLoad(greys, px, 0).r) / most;
    return vec4f(share, share, share, 1.0);
}
