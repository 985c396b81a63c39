// Copies a drawn picture to what a window shows.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var picture_sampler: sampler;

struct PresentVarying {
    @builtin(position) position: vec4<f32>,
    // Fractions of the picture, from its upper left corner.
    @location(0) uv: vec2<f32>,
}

@vertex
fn vs_main(@builtin(vertex_index) index: u32) -> PresentVarying {
    let xy = vec2<f32>(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    var out: PresentVarying;
    out.position = vec4<f32>(xy, 0.0, 1.0);
    out.uv = vec2<f32>(0.5 + 0.5 * xy.x, 0.5 - 0.5 * xy.y);
    return out;
}

// Pixel by pixel, exactly.
@fragment
fn fs_color(in: PresentVarying) -> @location(0) vec4<f32> {
    return textureLoad(picture, vec2<i32>(in.position.xy), 0);
}

// Where the window has another size than the picture.
@fragment
fn fs_scaled(in: PresentVarying) -> @location(0) vec4<f32> {
    return textureSampleLevel(picture, picture_sampler, in.uv, 0.0);
}
