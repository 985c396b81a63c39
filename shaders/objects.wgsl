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
    spare: u32,
}

// A page in this frame.
struct ObjectsPlace {
    // Of the mesh's origin from the eye, metres.
    offset: vec3<f32>,
    spare: f32,
}

@group(1) @binding(0) var<storage, read> places: array<ObjectsPlace>;
@group(2) @binding(0) var<storage, read> records: array<ObjectRecord>;
// How far the drawn ground lies above each object's base, metres.
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
}

fn standing(vertex: ObjectVertex, instance: u32) -> Standing {
    let is_roof = vertex.packed >> 31u != 0u;
    let record = records[vertex.packed & 0xffffu];
    let offset = places[instance].offset;
    let place = record.place_m + offset;
    let up = up_at(place);
    // Ground that is pressed down takes the objects on it along, but never below their base.
    let lift_m = max(lifts[record.lift] - press_at(place), 0.0);
    let from_eye = vertex.position_m + offset + up * lift_m;
    let east = east_at(up);
    let facing = facing_of(vertex.packed >> 16u);
    let normal = facing.x * east + facing.y * cross(up, east) + facing.z * up;
    let albedo = linear_from_srgb(unpack4x8unorm(select(record.wall_color, record.roof_color, is_roof)).rgb);
    let above_base_m = select(dot(vertex.position_m - record.place_m, up), SHADE_M, is_roof);
    return Standing(from_eye, up, normal, albedo, above_base_m, record.id);
}

@vertex
fn vs_main(vertex: ObjectVertex, @builtin(instance_index) instance: u32) -> ObjectVarying {
    let at = standing(vertex, instance);
    let lit = lit(at.albedo, at.normal, at.up, at.above_base_m);
    var out: ObjectVarying;
    out.position = frame.clip_from_eye * vec4<f32>(at.from_eye, 1.0);
    out.color = through_air(lit, at.from_eye, height_at(at.from_eye), at.up);
    out.id = at.id;
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
    return vec4<f32>(in.color, 1.0);
}

@fragment
fn fs_aov(in: ObjectVarying) -> Aov {
    return Aov(vec4<f32>(in.color, 1.0), in.id, 1.0 / in.position.w);
}
