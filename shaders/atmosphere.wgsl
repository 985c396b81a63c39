// Air and haze: exponential layers over a sphere (the ellipsoid stretched). Slant paths to and from infinity by
// Chapman's function as Schüler (2012, "An Approximation to the Chapman Grazing-Incidence Function for Atmospheric
// Scattering", GPU Pro 3) approximates it; paths between two points low in the air by the integral along a straight
// line with height taken as linear.

const AIR_PER_M: vec3<f32> = vec3<f32>(5.8e-6, 13.5e-6, 33.1e-6);
const AIR_SCALE_M: f32 = 8000.0;
// Share of the air's scattering that veils the ground: the rest comes back as light on it, which pictures have
// already. The whole of it would wash dark pictures out from far above.
const VEIL: f32 = 0.3;
// Light that air and haze scatter towards the eye when no end of them is in sight.
const AIRLIGHT: vec3<f32> = vec3<f32>(0.72, 0.82, 0.95);
// Between these heights of the eye the in-air formula hands over to the one for an eye in space.
const LOW_EYE_M: f32 = 20000.0;
const HIGH_EYE_M: f32 = 100000.0;

fn chapman(cosine: f32, scale_m: f32) -> f32 {
    let c = sqrt(1.5707963 * SEMI_MAJOR_M / scale_m);
    return c / ((c - 1.0) * cosine + 1.0);
}

fn density(height_m: f32, scale_m: f32) -> f32 {
    return exp(-max(height_m, -1000.0) / scale_m);
}

// Metres of sea-level matter between two heights over a straight way of the given length.
fn path_in_air(from_m: f32, to_m: f32, length_m: f32, scale_m: f32) -> f32 {
    let x = (to_m - from_m) / scale_m;
    if abs(x) < 0.02 {
        return length_m * density(0.5 * (from_m + to_m), scale_m);
    }
    return length_m * (density(from_m, scale_m) - density(to_m, scale_m)) / x;
}

// Metres of sea-level matter from a point out to space, towards the eye.
fn path_to_space(height_m: f32, cosine: f32, scale_m: f32) -> f32 {
    return scale_m * density(height_m, scale_m) * chapman(max(cosine, 0.0), scale_m);
}

fn path_to(from_eye: vec3<f32>, height_m: f32, up: vec3<f32>, scale_m: f32) -> f32 {
    let length_m = length(from_eye);
    let eye_m = frame.eye.w;
    // Without a branch on the frame: lavapipe compiles a shader anew whenever a uniform that it branches on is bound.
    let out = path_to_space(height_m, -dot(from_eye, up) / length_m, scale_m);
    let near = path_in_air(eye_m, height_m, length_m, scale_m);
    return mix(near, out, smoothstep(LOW_EYE_M, HIGH_EYE_M, eye_m));
}

// A lit surface as it is seen through the air.
fn through_air(lit: vec3<f32>, from_eye: vec3<f32>, height_m: f32, up: vec3<f32>) -> vec3<f32> {
    let air = path_to(from_eye, height_m, up, AIR_SCALE_M);
    let haze = path_to(from_eye, height_m, up, frame.haze.y) * frame.haze.x;
    let seen = exp(-(AIR_PER_M * air * VEIL + vec3<f32>(haze)));
    return lit * seen + AIRLIGHT * daylight(up) * (1.0 - seen);
}

// Metres of sea-level matter from the eye along a ray that meets nothing; in stretched space, `cosine` to the zenith.
fn path_of_sky(radius_m: f32, cosine: f32, scale_m: f32) -> f32 {
    let height_m = radius_m - SEMI_MAJOR_M;
    let here = path_to_space(height_m, abs(cosine), scale_m);
    if cosine >= 0.0 {
        return here;
    }
    let lowest_m = max(radius_m * sqrt(max(1.0 - cosine * cosine, 0.0)) - SEMI_MAJOR_M, 0.0);
    return max(2.0 * path_to_space(lowest_m, 0.0, scale_m) - here, 0.0);
}
