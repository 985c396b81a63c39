// egui's triangles over a picture. egui's own shader filters by hand behind a branch on a uniform, which a software
// driver pays for in every pixel: this one does what is needed and nothing else.

// Clip space from points: x and y are scaled by these, then shifted to the upper left corner.
@group(0) @binding(0) var<uniform> clip_per_point: vec4<f32>;
@group(1) @binding(0) var image: texture_2d<f32>;
@group(1) @binding(1) var image_sampler: sampler;

struct OverlayVertex {
    @location(0) position_points: vec2<f32>,
    @location(1) uv: vec2<f32>,
    // sRGB, premultiplied, as bytes.
    @location(2) color: vec4<f32>,
}

struct OverlayVarying {
    @builtin(position) position: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) color: vec4<f32>,
}

@vertex
fn vs_main(vertex: OverlayVertex) -> OverlayVarying {
    var out: OverlayVarying;
    out.position = vec4<f32>(vertex.position_points * clip_per_point.xy + vec2<f32>(-1.0, 1.0), 0.0, 1.0);
    out.uv = vertex.uv;
    out.color = vertex.color;
    return out;
}

// For targets that take sRGB as bytes: egui blends there.
@fragment
fn fs_color(in: OverlayVarying) -> @location(0) vec4<f32> {
    return in.color * textureSampleLevel(image, image_sampler, in.uv, 0.0);
}

// For targets that encode sRGB themselves.
@fragment
fn fs_linear(in: OverlayVarying) -> @location(0) vec4<f32> {
    let c = in.color * textureSampleLevel(image, image_sampler, in.uv, 0.0);
    let linear = select(pow((c.rgb + 0.055) / 1.055, vec3<f32>(2.4)), c.rgb / 12.92, c.rgb <= vec3<f32>(0.04045));
    return vec4<f32>(linear, c.a);
}
