// The sky where nothing else is drawn: black space, a thin blue limb, the blue above, haze at the horizon, the sun.

struct SkyVarying {
    @builtin(position) position: vec4<f32>,
    @location(0) ray: vec3<f32>,
}

@vertex
fn vs_main(@builtin(vertex_index) index: u32) -> SkyVarying {
    let xy = vec2<f32>(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    var out: SkyVarying;
    out.position = vec4<f32>(xy, 0.0, 1.0);
    out.ray = frame.forward.xyz + xy.x * frame.right.xyz + xy.y * frame.up.xyz;
    return out;
}

// From far away eight kilometres are less than a pixel: the limb is drawn thicker than it is.
fn limb_scale(scale_m: f32) -> f32 {
    return scale_m * (1.0 + 3.0 * smoothstep(HIGH_EYE_M, 3.0e6, frame.eye.w));
}

fn sky_color(ray: vec3<f32>) -> vec3<f32> {
    let way = normalize(to_sphere(ray));
    let eye = to_sphere(frame.eye.xyz);
    let radius_m = SEMI_MAJOR_M + frame.zenith.w;
    let cosine = dot(way, eye) / length(eye);
    let air = path_of_sky(radius_m, cosine, limb_scale(AIR_SCALE_M));
    let haze = path_of_sky(radius_m, cosine, frame.haze.y) * frame.haze.x;
    let depth = AIR_PER_M * air * 1.5 + vec3<f32>(haze);
    // The air that is seen lies where the ray comes lowest, if that is before us.
    let lowest = frame.eye.xyz + way * max(-cosine * radius_m, 0.0);
    let color = AIRLIGHT * daylight(normalize(lowest)) * (1.0 - exp(-depth));
    let to_sun = dot(normalize(ray), frame.sun.xyz);
    let disc = smoothstep(0.99996, 0.99998, to_sun) + 0.15 * pow(max(to_sun, 0.0), 600.0);
    return color + vec3<f32>(1.0, 0.96, 0.88) * disc * exp(-depth);
}

@fragment
fn fs_color(in: SkyVarying) -> @location(0) vec4<f32> {
    return vec4<f32>(sky_color(in.ray), 1.0);
}
