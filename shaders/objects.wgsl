// Objects: walls and roofs in their own colours, lit by the sun and the sky, lifted on to the drawn ground.

// What triangles of one look share: an object's own, or other colours on some of its faces.
struct ObjectRecord {
    // Middle of the footprint's box at the base, from the mesh's origin, metres.
    place_m: vec3<f32>,
    // The number in the id picture.
    id: u32,
    // sRGB, red in the lowest byte.
    wall_color: u32,
    roof_color: u32,
    // Index of the object's lift.
    lift: u32,
    // 1 where its walls go on below its base.
    has_foundation: u32,
}

// A page in this frame.
struct ObjectsPlace {
    // Of the mesh's origin from the eye, metres.
    offset: vec3<f32>,
    // How far it has come, 0 to 1; how far it has gone, 0 to -1. Only fs_fading asks.
    fade: f32,
}

@group(1) @binding(0) var<storage, read> places: array<ObjectsPlace>;
@group(2) @binding(0) var<storage, read> records: array<ObjectRecord>;
// How far the drawn ground lies above each object's base, metres; below 0, how far foundations go down further.
@group(2) @binding(1) var<storage, read> lifts: array<f32>;

struct ObjectVertex {
    @location(0) position_m: vec3<f32>,
    // From the lowest: look in 16 bits; the normal's octahedral x and y in 8 and 7, signed; 0 for walls.
    @location(1) packed: u32,
}

struct ObjectVarying {
    @builtin(position) position: vec4<f32>,
    @location(0) color: vec3<f32>,
    @location(1) @interpolate(flat) id: u32,
    // Along the wall from the object's middle and above its base, metres.
    @location(2) facade: vec2<f32>,
    // Part of a bay's width that is glass; 0 for roofs.
    @location(3) @interpolate(flat) glass: f32,
    @location(4) @interpolate(flat) fade: f32,
}

// The pictures of a page with textures.
@group(3) @binding(0) var atlas: texture_2d<f32>;
@group(3) @binding(1) var atlas_sampler: sampler;

struct TexturedVarying {
    @builtin(position) position: vec4<f32>,
    // Right and down in the atlas.
    @location(0) uv: vec2<f32>,
    // What is seen of a white surface, less the air before it.
    @location(1) light: vec3<f32>,
    @location(2) air: vec3<f32>,
    // Of faces without a texture.
    @location(3) @interpolate(flat) albedo: vec3<f32>,
    @location(4) @interpolate(flat) is_textured: u32,
    @location(5) @interpolate(flat) id: u32,
    @location(6) @interpolate(flat) fade: f32,
}

struct Aov {
    @location(0) color: vec4<f32>,
    @location(1) id: u32,
    @location(2) depth_m: f32,
}

const SUNLIGHT: vec3<f32> = vec3<f32>(0.95, 0.91, 0.82);
const SKYLIGHT: vec3<f32> = vec3<f32>(0.36, 0.41, 0.48);
// Walls are darker towards the ground within this height.
const SHADE_M: f32 = 10.0;

fn lit(albedo: vec3<f32>, normal: vec3<f32>, up: vec3<f32>, above_base_m: f32) -> vec3<f32> {
    let sky = SKYLIGHT * (0.5 + 0.5 * dot(normal, up)) + vec3<f32>(0.06, 0.055, 0.045);
    let sun = SUNLIGHT * max(dot(normal, frame.sun.xyz), 0.0);
    let shade = mix(0.72, 1.0, smoothstep(0.0, SHADE_M, above_base_m));
    return albedo * (sky * shade + sun * mix(0.9, 1.0, shade)) * mix(0.04, 1.0, daylight(up));
}

// Windows: one a storey and bay, metres.
const STOREY_M: f32 = 3.2;
const BAY_M: f32 = 3.0;
// Where a window begins and how much of a storey's height it takes.
const SILL: f32 = 0.28;
const PANE: f32 = 0.5;
// What of a wall's light comes back from glass.
const GLASS_LIGHT: f32 = 0.5;

// Glass by material, which shows in the colour: little in brick and stone, most of the wall in blue and grey towers.
fn glass_of(albedo: vec3<f32>) -> f32 {
    return clamp(0.5 + 1.6 * (albedo.b - albedo.r), 0.3, 0.85);
}

// How much of a pulse train, 1 from `begin` on for `share` of each unit, lies within a box filter of a width about `at`.
fn pulses(at: f32, width: f32, begin: f32, share: f32) -> f32 {
    let ends = vec2<f32>(at - 0.5 * width, at + 0.5 * width);
    let sums = floor(ends) * share + clamp(fract(ends) - begin, vec2<f32>(0.0), vec2<f32>(share));
    return (sums.y - sums.x) / width;
}

// What the windows take of a wall's light and give to the wall between them: 1 in the mean, so that a facade looks the
// same from as far as its windows melt together.
fn facade_light(at: vec2<f32>, glass: f32) -> f32 {
    let bays = vec2<f32>(at.x / BAY_M, at.y / STOREY_M);
    let width = clamp(fwidth(bays), vec2<f32>(1e-3), vec2<f32>(1e3));
    let windows = pulses(bays.x, width.x, 0.5 - 0.5 * glass, glass) * pulses(bays.y, width.y, SILL, PANE);
    let mean = glass * PANE;
    // No windows in roofs and foundations.
    return select(1.0, mix((1.0 - GLASS_LIGHT * mean) / (1.0 - mean), GLASS_LIGHT, windows), glass > 0.0 && at.y > 0.0);
}

// East, north, up of an octahedral normal: 8 and 7 bits in two's complement.
fn facing_of(bits: u32) -> vec3<f32> {
    let at = vec2<f32>(f32(i32(bits << 24u) >> 24u) / 127.0, f32(i32(bits << 17u) >> 25u) / 63.0);
    let up = 1.0 - abs(at.x) - abs(at.y);
    let fold = max(-up, 0.0);
    return normalize(vec3<f32>(at - select(vec2<f32>(-fold), vec2<f32>(fold), at >= vec2<f32>(0.0)), up));
}

// A vertex where it is drawn.
struct Standing {
    from_eye: vec3<f32>,
    up: vec3<f32>,
    normal: vec3<f32>,
    albedo: vec3<f32>,
    above_base_m: f32,
    id: u32,
    // As ObjectVarying has them.
    facade: vec2<f32>,
    glass: f32,
    fade: f32,
}

fn standing(vertex: ObjectVertex, instance: u32) -> Standing {
    let is_roof = vertex.packed >> 31u != 0u;
    let record = records[vertex.packed & 0xffffu];
    let offset = places[instance].offset;
    let place = record.place_m + offset;
    let up = up_at(place);
    let from_place = vertex.position_m - record.place_m;
    let above_m = dot(from_place, up);
    // Ground that is pressed down takes the objects on it along, but never below their base: their foundations follow it.
    let ground_m = lifts[record.lift] - press_at(place);
    let is_foot = record.has_foundation != 0u && above_m < 0.0;
    let lift_m = select(max(ground_m, 0.0), ground_m, is_foot);
    let from_eye = vertex.position_m + offset + up * lift_m;
    let east = east_at(up);
    let facing = facing_of(vertex.packed >> 16u);
    let normal = facing.x * east + facing.y * cross(up, east) + facing.z * up;
    let albedo = linear_from_srgb(unpack4x8unorm(select(record.wall_color, record.roof_color, is_roof)).rgb);
    let above_base_m = select(above_m, SHADE_M, is_roof);
    let facade = vec2<f32>(dot(from_place, cross(up, normal)), above_m);
    let glass = select(glass_of(albedo), 0.0, is_roof);
    return Standing(from_eye, up, normal, albedo, above_base_m, record.id, facade, glass, places[instance].fade);
}

@vertex
fn vs_main(vertex: ObjectVertex, @builtin(instance_index) instance: u32) -> ObjectVarying {
    let at = standing(vertex, instance);
    let lit = lit(at.albedo, at.normal, at.up, at.above_base_m);
    var out: ObjectVarying;
    out.position = frame.clip_from_eye * vec4<f32>(at.from_eye, 1.0);
    out.color = through_air(lit, at.from_eye, height_at(at.from_eye), at.up);
    out.id = at.id;
    out.facade = at.facade;
    out.glass = at.glass;
    out.fade = at.fade;
    return out;
}

@vertex
fn vs_textured(
    vertex: ObjectVertex,
    @location(2) uv: vec2<f32>,
    @builtin(instance_index) instance: u32,
) -> TexturedVarying {
    let at = standing(vertex, instance);
    let white = lit(vec3<f32>(1.0), at.normal, at.up, at.above_base_m);
    let height_m = height_at(at.from_eye);
    var out: TexturedVarying;
    out.position = frame.clip_from_eye * vec4<f32>(at.from_eye, 1.0);
    out.uv = uv;
    out.air = through_air(vec3<f32>(0.0), at.from_eye, height_m, at.up);
    out.light = through_air(white, at.from_eye, height_m, at.up) - out.air;
    out.albedo = at.albedo;
    // The largest place there is stands for none.
    out.is_textured = u32(uv.x < 1.0);
    out.id = at.id;
    out.fade = at.fade;
    return out;
}

fn textured_color(in: TexturedVarying) -> vec4<f32> {
    let texel = textureSample(atlas, atlas_sampler, in.uv).rgb;
    let albedo = select(in.albedo, texel, in.is_textured != 0u);
    return vec4<f32>(albedo * in.light + in.air, 1.0);
}

@fragment
fn fs_textured(in: TexturedVarying) -> @location(0) vec4<f32> {
    return textured_color(in);
}

@fragment
fn fs_textured_aov(in: TexturedVarying) -> Aov {
    return Aov(textured_color(in), in.id, 1.0 / in.position.w);
}

@fragment
fn fs_color(in: ObjectVarying) -> @location(0) vec4<f32> {
    return vec4<f32>(in.color * facade_light(in.facade, in.glass), 1.0);
}

// Each of 64 values once in 8 x 8 pixels, between 0 and 1 (Bayer 1973).
fn bayer(pixel: vec2<u32>) -> f32 {
    let a = pixel.x ^ pixel.y;
    let y = pixel.y;
    let bits = (a & 1u) << 5u | (y & 1u) << 4u | (a & 2u) << 2u | (y & 2u) << 1u | (a & 4u) >> 1u | (y & 4u) >> 2u;
    return (f32(bits) + 0.5) / 64.0;
}

// What comes is drawn in the pixels that what goes leaves out.
fn is_left_out(position: vec4<f32>, fade: f32) -> bool {
    return (bayer(vec2<u32>(position.xy)) < abs(fade)) != (fade >= 0.0);
}

@fragment
fn fs_fading(in: ObjectVarying) -> @location(0) vec4<f32> {
    let light = facade_light(in.facade, in.glass);
    if is_left_out(in.position, in.fade) {
        discard;
    }
    return vec4<f32>(in.color * light, 1.0);
}

@fragment
fn fs_textured_fading(in: TexturedVarying) -> @location(0) vec4<f32> {
    let color = textured_color(in);
    if is_left_out(in.position, in.fade) {
        discard;
    }
    return color;
}

@fragment
fn fs_aov(in: ObjectVarying) -> Aov {
    let color = in.color * facade_light(in.facade, in.glass);
    return Aov(vec4<f32>(color, 1.0), in.id, 1.0 / in.position.w);
}
