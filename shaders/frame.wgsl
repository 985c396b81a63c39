// What every pass knows of the frame. All vectors have Earth-fixed axes; positions are relative to the eye.

struct Frame {
    clip_from_eye: mat4x4<f32>,
    // The eye from the Earth's centre (for directions and heights only: f32 is good to half a metre there);
    // w: its height above the ellipsoid.
    eye: vec4<f32>,
    // The ellipsoid's normal at the eye; w: height above the sphere of radius a after stretching, metres.
    zenith: vec4<f32>,
    // Towards the sun.
    sun: vec4<f32>,
    // A ray through the picture: forward + x right + y up with x and y in -1..1.
    right: vec4<f32>,
    up: vec4<f32>,
    forward: vec4<f32>,
    // Depth and radius of the ground press, metres.
    press: vec4<f32>,
    // Extinction of the haze at sea level, 1/m; its scale height, m.
    haze: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;

const SEMI_MAJOR_M: f32 = 6378137.0;
// a/b: stretches the ellipsoid to a sphere of radius a.
const STRETCH: f32 = 1.0033640898;

fn to_sphere(v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(v.xy, v.z * STRETCH);
}

// The ellipsoid's normal under a point: the gradient of x²/a² + y²/a² + z²/b².
fn up_at(from_eye: vec3<f32>) -> vec3<f32> {
    let p = frame.eye.xyz + from_eye;
    return normalize(vec3<f32>(p.xy, p.z * STRETCH * STRETCH));
}

fn east_at(up: vec3<f32>) -> vec3<f32> {
    // On the axis any horizontal direction will do.
    return normalize(vec3<f32>(-up.y, up.x, 0.0) + vec3<f32>(0.0, 1e-12, 0.0));
}

// Height above the ellipsoid, metres, good to about a metre.
fn height_at(from_eye: vec3<f32>) -> f32 {
    return length(to_sphere(frame.eye.xyz + from_eye)) - SEMI_MAJOR_M;
}

// How far the ground at a point is pressed down to keep the eye above it.
fn press_at(from_eye: vec3<f32>) -> f32 {
    // Without a branch on the frame: lavapipe compiles a shader anew whenever a uniform that it branches on is bound.
    let across = length(from_eye - frame.zenith.xyz * dot(from_eye, frame.zenith.xyz));
    return frame.press.x * (1.0 - smoothstep(max(frame.press.y, 1e-3), max(2.0 * frame.press.y, 2e-3), across));
}

// 1 by day, 0 by night, from the height of the sun over the local horizon.
fn daylight(up: vec3<f32>) -> f32 {
    return smoothstep(-0.12, 0.25, dot(up, frame.sun.xyz));
}

fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3<f32>(2.4)), c / 12.92, c <= vec3<f32>(0.04045));
}
