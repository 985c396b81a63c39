// Terrain: a piece of a page's surface, morphed, pressed, with skirts, draped with imagery.

struct Piece {
    // Of the mesh's origin from the eye, metres.
    offset: vec3<f32>,
    // Morph weight: 0 the parent's surface, 1 the own.
    own: f32,
    // Texture coordinates = uv * uv_scale + uv_offset.
    uv_scale: vec2<f32>,
    uv_offset: vec2<f32>,
    skirt_m: f32,
    layer: u32,
    id: u32,
    // 1 with imagery, 0 without.
    textured: u32,
}

@group(1) @binding(0) var<storage, read> pieces: array<Piece>;
@group(2) @binding(0) var imagery: texture_2d_array<f32>;
@group(2) @binding(1) var imagery_sampler: sampler;

struct TerrainVertex {
    @location(0) position_m: vec3<f32>,
    @location(1) morph_m: f32,
    @location(2) uv: vec2<f32>,
    @location(3) slope_skirt: vec4<f32>,
}

struct TerrainVarying {
    @builtin(position) position: vec4<f32>,
    @location(0) from_eye: vec3<f32>,
    @location(1) uv: vec2<f32>,
    // Cosine of the sun over the horizon, and over the slope less that.
    @location(2) sun: vec2<f32>,
    @location(3) @interpolate(flat) piece: u32,
}

struct Aov {
    @location(0) color: vec4<f32>,
    @location(1) id: u32,
    @location(2) depth_m: f32,
}

// -1 on the southern border of a piece, 1 on the northern one.
fn rim(v: f32) -> f32 {
    return f32(v >= 1.0) - f32(v <= 0.0);
}

// Skirts lean outward along parallels: the chord of a parallel lies towards the pole by tan(latitude) times as far as
// it lies below the ellipsoid, so that from above a gap would show beside a network with other posts.
const STEEPEST: f32 = 8.0;

@vertex
fn vs_main(vertex: TerrainVertex, @builtin(instance_index) instance: u32) -> TerrainVarying {
    let piece = pieces[instance];
    let own_from_eye = vertex.position_m + piece.offset;
    let up = up_at(own_from_eye);
    let rise_m = vertex.morph_m * (1.0 - piece.own) - vertex.slope_skirt.z * piece.skirt_m - press_at(own_from_eye);
    let east = east_at(up);
    let flare_m = vertex.slope_skirt.z * piece.skirt_m * rim(vertex.uv.y) * min(abs(up.z) / length(up.xy), STEEPEST);
    let from_eye = own_from_eye + up * rise_m + cross(up, east) * flare_m;
    let slope = tan(clamp(vertex.slope_skirt.xy, vec2<f32>(-0.96), vec2<f32>(0.96)) * 1.5707963);
    let normal = normalize(up - slope.x * east - slope.y * cross(up, east));
    let level = dot(up, frame.sun.xyz);
    var out: TerrainVarying;
    out.position = frame.clip_from_eye * vec4<f32>(from_eye, 1.0);
    out.from_eye = from_eye;
    out.uv = vertex.uv * piece.uv_scale + piece.uv_offset;
    out.sun = vec2<f32>(level, dot(normal, frame.sun.xyz) - level);
    out.piece = instance;
    return out;
}

// Heights of the eye between which the drawn ground's own height ceases to count for the air before it, metres.
const COARSE_EYE_LOW_M: f32 = 1e4;
const COARSE_EYE_HIGH_M: f32 = 1e5;

// Texels across a pixel between which a picture counts as blurred and as sharp.
const BLURRED_TEXELS: f32 = 0.02;
const SHARP_TEXELS: f32 = 0.2;

// The colour of ground without imagery, linear.
fn tint(height_m: f32) -> vec3<f32> {
    let sea = vec3<f32>(0.012, 0.035, 0.075);
    let low = vec3<f32>(0.075, 0.115, 0.045);
    let dry = vec3<f32>(0.22, 0.185, 0.105);
    let rock = vec3<f32>(0.20, 0.18, 0.16);
    let snow = vec3<f32>(0.75, 0.77, 0.80);
    var color = mix(low, dry, smoothstep(200.0, 1500.0, height_m));
    color = mix(color, rock, smoothstep(1500.0, 3000.0, height_m));
    color = mix(color, snow, smoothstep(3500.0, 5000.0, height_m));
    return mix(sea, color, smoothstep(-2.0, 2.0, height_m));
}

fn terrain_color(in: TerrainVarying) -> vec3<f32> {
    let piece = pieces[in.piece];
    let textured = piece.textured != 0u;
    let picture = textureSample(imagery, imagery_sampler, in.uv, piece.layer).rgb;
    let up = up_at(in.from_eye);
    let height_m = height_at(in.from_eye);
    let albedo = select(tint(height_m), picture, textured);
    // Pictures often have their own relief: shade them less than plain ground, unless their texels are so much wider
    // than pixels that they show none.
    let texels = fwidth(in.uv) * f32(textureDimensions(imagery).x);
    let blurred = 1.0 - smoothstep(BLURRED_TEXELS, SHARP_TEXELS, max(texels.x, texels.y));
    let strength = select(1.3, mix(0.6, 2.4, blurred), textured);
    let relief = clamp(1.0 + in.sun.y * strength, 0.35, 1.8);
    let day = smoothstep(-0.12, 0.25, in.sun.x);
    // From high up the coarse surface may lie kilometres below the ground it stands for, the middle of a wide triangle
    // more than its corners: it must not be hazier for it, so there the air ends at sea level.
    let air_m = height_m * (1.0 - smoothstep(COARSE_EYE_LOW_M, COARSE_EYE_HIGH_M, frame.eye.w));
    return through_air(albedo * relief * mix(0.04, 1.0, day), in.from_eye, air_m, up);
}

@fragment
fn fs_color(in: TerrainVarying) -> @location(0) vec4<f32> {
    return vec4<f32>(terrain_color(in), 1.0);
}

@fragment
fn fs_aov(in: TerrainVarying) -> Aov {
    return Aov(vec4<f32>(terrain_color(in), 1.0), pieces[in.piece].id, 1.0 / in.position.w);
}
